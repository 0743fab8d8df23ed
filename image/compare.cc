// PSNR, SSIM and difference pictures.
//
// SSIM is Wang, Bovik, Sheikh, Simoncelli, "Image quality assessment: from error visibility to
// structural similarity", IEEE Trans. Image Processing 13(4), 2004, equation 13 with the Gaussian
// window of section III-C, averaged over the windows that are entirely inside the picture. Luma is
// Rec. 601 of the 8-bit picture, not rounded. The picture is not scaled down first. If a side is
// shorter than 11, the window has that side, and its weights again sum to 1.

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>

#include "slf/image.h"

namespace slf {
namespace {

constexpr std::size_t kWindow = 11;
constexpr double kSigma = 1.5;
constexpr double kC1 = (0.01 * 255) * (0.01 * 255);
constexpr double kC2 = (0.03 * 255) * (0.03 * 255);

/// One number per pixel, rows from the top.
struct Plane {
  std::size_t width, height;
  std::vector<double> values;
};

Plane luma(const Image& image, const std::vector<std::uint8_t>& rgb) {
  Plane plane{image.width, image.height, {}};
  plane.values.reserve(rgb.size() / 3);
  for (std::size_t i = 0; i < rgb.size(); i += 3)
    plane.values.push_back(0.299 * rgb[i] + 0.587 * rgb[i + 1] + 0.114 * rgb[i + 2]);
  return plane;
}

/// A Gaussian of `side` samples around its middle, with sum 1.
std::vector<double> gaussian(std::size_t side) {
  std::vector<double> weights(side);
  const double middle = (static_cast<double>(side) - 1) / 2;
  double sum = 0;
  for (std::size_t i = 0; i < side; ++i) {
    const double x = static_cast<double>(i) - middle;
    sum += weights[i] = std::exp(-x * x / (2 * kSigma * kSigma));
  }
  for (double& weight : weights) weight /= sum;
  return weights;
}

/// The weighted means of all windows inside the picture. The window is separable.
Plane window_means(const Plane& in) {
  const std::vector<double> wx = gaussian(std::min(kWindow, in.width));
  const std::vector<double> wy = gaussian(std::min(kWindow, in.height));
  Plane rows{in.width - wx.size() + 1, in.height, {}};
  rows.values.resize(rows.width * rows.height);
  for (std::size_t y = 0; y < rows.height; ++y)
    for (std::size_t x = 0; x < rows.width; ++x)
      for (std::size_t k = 0; k < wx.size(); ++k)
        rows.values[y * rows.width + x] += wx[k] * in.values[y * in.width + x + k];

  Plane out{rows.width, rows.height - wy.size() + 1, {}};
  out.values.resize(out.width * out.height);
  for (std::size_t y = 0; y < out.height; ++y)
    for (std::size_t k = 0; k < wy.size(); ++k)
      for (std::size_t x = 0; x < out.width; ++x)
        out.values[y * out.width + x] += wy[k] * rows.values[(y + k) * rows.width + x];
  return out;
}

Plane product(const Plane& a, const Plane& b) {
  Plane out = a;
  for (std::size_t i = 0; i < out.values.size(); ++i) out.values[i] *= b.values[i];
  return out;
}

/// Over the windows whose middle pixel counts; 1 if there is none.
double mean_ssim(const Plane& x, const Plane& y, const std::vector<bool>& counted) {
  const Plane mean_x = window_means(x), mean_y = window_means(y);
  const Plane mean_xx = window_means(product(x, x));
  const Plane mean_yy = window_means(product(y, y));
  const Plane mean_xy = window_means(product(x, y));
  const std::size_t left = (x.width - mean_x.width + 1) / 2;
  const std::size_t above = (x.height - mean_x.height + 1) / 2;
  double sum = 0, windows = 0;
  for (std::size_t i = 0; i < mean_x.values.size(); ++i) {
    const std::size_t column = left + i % mean_x.width, row = above + i / mean_x.width;
    if (!counted.empty() && !counted[row * x.width + column]) continue;
    ++windows;
    const double mx = mean_x.values[i], my = mean_y.values[i];
    const double variance_x = mean_xx.values[i] - mx * mx;
    const double variance_y = mean_yy.values[i] - my * my;
    const double covariance = mean_xy.values[i] - mx * my;
    sum += (2 * mx * my + kC1) * (2 * covariance + kC2) /
           ((mx * mx + my * my + kC1) * (variance_x + variance_y + kC2));
  }
  return windows > 0 ? sum / windows : 1;
}

double psnr(const std::vector<std::uint8_t>& a, const std::vector<std::uint8_t>& b,
            const std::vector<bool>& counted) {
  double squares = 0, values = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (!counted.empty() && !counted[i / 3]) continue;
    const double error = static_cast<double>(a[i]) - static_cast<double>(b[i]);
    squares += error * error;
    ++values;
  }
  if (squares == 0) return std::numeric_limits<double>::infinity();
  return 10 * std::log10(255.0 * 255.0 * values / squares);
}

}  // namespace

ImageDifference compare(const Image& a, const Image& b, const std::vector<bool>& counted) {
  assert(a.width == b.width && a.height == b.height && a.rgba.size() == b.rgba.size());
  assert(counted.empty() || counted.size() == a.rgba.size());
  if (a.rgba.empty()) return {std::numeric_limits<double>::infinity(), 1};
  const std::vector<std::uint8_t> rgb_a = to_rgb8(a), rgb_b = to_rgb8(b);
  return {psnr(rgb_a, rgb_b, counted), mean_ssim(luma(a, rgb_a), luma(b, rgb_b), counted)};
}

Image shrink(const Image& image, std::uint32_t factor) {
  Image small{image.width / factor, image.height / factor, {}, {}};
  small.rgba.resize(std::size_t{small.width} * small.height);
  const auto share = 1.f / static_cast<float>(factor * factor);
  for (std::size_t k = 0; k < image.rgba.size(); ++k) {
    const std::size_t x = k % image.width / factor, y = k / image.width / factor;
    small.rgba[y * small.width + x] += share * image.rgba[k];
  }
  return small;
}

Image difference(const Image& a, const Image& b, float gain) {
  assert(a.width == b.width && a.height == b.height && a.rgba.size() == b.rgba.size());
  Image out{a.width, a.height, {}, {}};
  out.rgba.reserve(a.rgba.size());
  for (std::size_t i = 0; i < a.rgba.size(); ++i)
    out.rgba.emplace_back(glm::abs(glm::vec3(a.rgba[i]) - glm::vec3(b.rgba[i])) * gain, 1.0F);
  return out;
}

}  // namespace slf

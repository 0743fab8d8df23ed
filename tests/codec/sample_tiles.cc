#include "tests/codec/sample_tiles.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace slf::codec {
namespace {

// 0..1 each; premultiplied.
struct Sample {
  std::array<double, 4> rgba;
  double depth;
};

Sample at(Content content, double x, double y, LocalPoint where) {
  if (content == Content::zero) return {{0, 0, 0, 0}, 0};
  if (content == Content::constant) return {{0.8, 0.5, 0.25, 1}, 0.4};
  const double u = x + 0.02 * where.p, v = y + 0.02 * where.q;
  const double shade = 0.6 + 0.3 * std::sin(5 * u) * std::cos(4 * v) + 0.05 * std::sin(40 * u * v);
  double alpha = 1;
  if (content == Content::disc)
    alpha = std::clamp(8 * (0.45 - std::hypot(u - 0.4, v - 0.4)), 0., 1.);
  if (content == Content::veil) alpha = 0.5 + 0.5 * std::sin(7 * u + 3 * v);
  return {{alpha * shade, alpha * shade * 0.8, alpha * shade * 0.6 * (1 - 0.2 * u), alpha},
          alpha > 0 ? 0.3 + 0.3 * shade : 0};
}

std::uint8_t to_byte(double value) { return static_cast<std::uint8_t>(std::lround(value * 255)); }

// A positive, normal half or zero, rounded down.
std::uint16_t to_half(double value) {
  if (value < 1.0 / 16384) return 0;
  int exponent = 0;
  const double mantissa = std::frexp(value, &exponent);  // 0.5..1
  return static_cast<std::uint16_t>(((exponent + 14) << 10) |
                                    static_cast<int>((mantissa * 2 - 1) * 1024));
}

void append_color(bool half, const Sample& sample, Bytes& to) {
  for (const double value : sample.rgba)
    if (half)
      append_le(to, to_half(value * 2));
    else
      to.push_back(static_cast<std::byte>(to_byte(value)));
}

}  // namespace

std::string name(Content content) {
  constexpr const char* names[] = {"zero", "constant", "smooth", "disc", "veil", "noise"};
  return names[static_cast<int>(content)];
}

SampleTile make_tile(SampleFormat format, std::size_t rows, std::uint32_t side, Content content) {
  SampleTile result;
  std::size_t lattice_side = 0;
  while ((lattice_side + 1) * (lattice_side + 2) / 2 < rows) ++lattice_side;
  for (std::uint16_t q = 0; q <= lattice_side; ++q)
    for (std::uint16_t p = 0; p + q <= lattice_side && result.positions.size() < rows; ++p)
      result.positions.push_back({p, q});
  result.tile = {format, side, result.positions};
  Random random(rows * 1000 + side);
  if (content == Content::noise) {
    result.samples.resize(result.tile.bytes());
    for (std::byte& byte : result.samples) byte = static_cast<std::byte>(random.next() >> 56);
    return result;
  }
  const double unit = 1.0 / (side + 1);
  Bytes depths;
  for (const LocalPoint where : result.positions)
    for (std::uint32_t q = 0; q <= side; ++q)
      for (std::uint32_t p = 0; p <= side - q; ++p) {
        const Sample sample = at(content, p * unit, q * unit, where);
        append_color(is_half(format), sample, result.samples);
        if (has_depth(format)) depths.push_back(static_cast<std::byte>(to_byte(sample.depth)));
      }
  result.samples.insert(result.samples.end(), depths.begin(), depths.end());
  return result;
}

double psnr(const TileShape& tile, ByteSpan expected, ByteSpan found) {
  const auto of = [&](std::size_t begin, std::size_t end, const auto& counts) {
    double sum = 0;
    std::size_t count = 0;
    for (std::size_t i = begin; i < end; ++i) {
      if (!counts(i)) continue;
      const double difference = std::to_integer<int>(expected[i]) - std::to_integer<int>(found[i]);
      sum += difference * difference;
      ++count;
    }
    if (sum == 0) return std::numeric_limits<double>::infinity();
    return 10 * std::log10(255.0 * 255.0 * static_cast<double>(count) / sum);
  };
  const std::size_t colors = tile.color_bytes();
  return std::min(
      of(0, colors, [](std::size_t i) { return i % 4 != 3; }),
      of(colors, tile.bytes(), [&](std::size_t i) { return expected[i] != std::byte{0}; }));
}

}  // namespace slf::codec

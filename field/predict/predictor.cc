#include "field/predict/predictor.h"

#include <algorithm>
#include <cmath>

#include "base/per_thread.h"
#include "field/predict/upsample_kernel.h"

namespace slf {
namespace {

/// Most columns between those at which depth is found, along p and q.
constexpr unsigned kSparse = 8;

/// About (32 * 3.58)^4: the scale of tiles at the axes is 16 * 3.58. So a quality gives about the
/// picture that it gave without scales.
constexpr double kScaleAtAxes = 1.722e8;

/// Repeats the last point, because kernels work in whole vectors.
void fill_padding(Points& points) {
  for (auto* axis : {&points.x, &points.y, &points.z})
    axis->resize(axis->size() + kPadding, axis->back());
}

void push(Points& points, const glm::vec3& p) {
  points.x.push_back(p.x), points.y.push_back(p.y), points.z.push_back(p.z);
}

}  // namespace

int step_scale(const TileSections& sections) {
  // The squared distance of a section's middle from the centre, on an octahedron of radius 1.
  const auto squared = [](const Section& section) {
    glm::dvec3 sum{};
    for (const LocalPoint corner : {LocalPoint{0, 0}, LocalPoint{1, 0}, LocalPoint{0, 1}}) {
      const LatticeVertex v = vertex_at(section, corner, 1);
      sum += glm::dvec3(v.i, v.j, v.k);
    }
    const double radius = std::abs(sum.x) + std::abs(sum.y) + std::abs(sum.z);
    return glm::dot(sum, sum) / (radius * radius);
  };
  const double q = squared(sections.entry) * squared(sections.exit);
  const double limit = kScaleAtAxes * (q * q * q);
  int scale = 1;
  const auto fourth = [](double x) { return x * x * x * x; };
  while (fourth(2 * scale + 1) <= limit) ++scale;
  return scale;
}

TilePredictor::TilePredictor(const LevelGeometry& coarser, const LevelGeometry& finer,
                             const TileSections& sections, const References& references)
    : coarser_(coarser),
      references_(references),
      side_(finer.exit_side()),
      columns_(triangle_size(side_)),
      stride_(side_ % 2 == 0 ? 2 : 1),
      sparse_(stride_) {
  while (sparse_ < kSparse && side_ % (2 * sparse_) == 0) sparse_ *= 2;
  // Within a section, coordinates are linear in p and q.
  const LatticeVertex v = vertex_at(sections.exit, {0, 0}, side_);
  const LatticeVertex along_p = vertex_at(sections.exit, {1, 0}, side_);
  const LatticeVertex along_q = vertex_at(sections.exit, {0, 1}, side_);
  const auto n = static_cast<std::int32_t>(side_), step = static_cast<std::int32_t>(stride_),
             sparse = static_cast<std::int32_t>(sparse_);
  for (std::int32_t q = 0; q <= n; q += step)
    for (std::int32_t p = 0; p + q <= n; p += step) {
      const auto at = [p, q](std::int32_t a, std::int32_t b, std::int32_t c) {
        return a + p * (b - a) + q * (c - a);
      };
      const glm::vec3 point =
          exact_direction({at(v.i, along_p.i, along_q.i), at(v.j, along_p.j, along_q.j),
                           at(v.k, along_p.k, along_q.k)});
      push(points_, point);
      if (p % sparse == 0 && q % sparse == 0) push(sparse_points_, point);
    }
  fill_padding(points_);
  fill_padding(sparse_points_);
}

PredictedRow TilePredictor::row(std::size_t index, std::span<const ReferenceTile> from) const {
  const std::size_t exits = section_count(coarser_.level());
  const References::Row& row = references_.rows[index];
  PredictedRow out;
  out.x = row.direction.x, out.y = row.direction.y, out.z = row.direction.z;
  out.references = row.count;
  for (std::size_t c = 0; c < row.count; ++c) {
    const References::Vertex& vertex = row.vertex[c];
    ReferenceVertex& to = out.reference[c];
    to.x = vertex.direction.x, to.y = vertex.direction.y, to.z = vertex.direction.z;
    to.row_begin = static_cast<std::uint32_t>(vertex.row * columns_);
    to.tiles = from.data() + vertex.slot * exits;
  }
  return out;
}

std::vector<std::uint32_t> TilePredictor::uses(std::span<const std::uint8_t> alpha,
                                               std::span<const std::uint8_t> depth) const {
  const std::size_t exits = section_count(coarser_.level());
  const std::vector<ReferenceTile> none(references_.sections.size() * exits);
  std::vector<std::uint32_t> uses(none.size());
  const std::size_t count = triangle_size(side_ / stride_);
  std::vector<std::uint8_t> a(count + kPadding, 0), z(count + kPadding, 0);
  for (std::size_t k = 0; k < references_.rows.size(); ++k) {
    std::size_t column = k * columns_, to = 0;
    for (std::uint32_t q = 0; q <= side_; ++q)
      for (std::uint32_t p = 0; p + q <= side_; ++p, ++column)
        if (p % stride_ == 0 && q % stride_ == 0) a[to] = alpha[column], z[to++] = depth[column];
    PredictedRow looked_up = row(k, none);
    for (std::size_t c = 0; c < looked_up.references; ++c)
      looked_up.reference[c].uses = uses.data() + references_.rows[k].vertex[c].slot * exits;
    count_uses(coarser_, looked_up, points_, count, a.data(), z.data());
  }
  return uses;
}

void TilePredictor::predict(std::span<const ReferenceTile> from, bool four_taps,
                            PredictedSamples& predicted) const {
  const std::size_t samples = references_.rows.size() * columns_;
  predicted.alpha.resize(samples), predicted.depth.resize(samples);
  predicted.color.resize(samples);
  // Of a row, at columns further and further apart; each twice, to interpolate back and forth.
  auto& alpha = per_thread<std::vector<std::uint8_t>>([] {});
  auto& depth = per_thread<std::vector<std::uint8_t>>([] {});
  auto& finer_alpha = per_thread<std::vector<std::uint8_t>>([] {});
  auto& finer_depth = per_thread<std::vector<std::uint8_t>>([] {});
  auto& color = per_thread<std::vector<std::uint32_t>>([] {});
  auto& finer_color = per_thread<std::vector<std::uint32_t>>([] {});
  auto& spread_color = per_thread<std::vector<std::uint32_t>>([] {});
  for (auto* bytes : {&alpha, &depth, &finer_alpha, &finer_depth})
    bytes->resize(columns_ + kPadding);
  color.resize(columns_ + kPadding), finer_color.resize(columns_ + kPadding);
  const std::size_t line = upsample_stride(side_);
  spread_color.assign(line * (side_ / 2 + 4) + kPadding, 0);
  const auto upsample = [&](unsigned to) {
    upsample_columns(side_ / to, alpha.data(), depth.data(), finer_alpha.data(),
                     finer_depth.data());
    alpha.swap(finer_alpha), depth.swap(finer_depth);
  };
  const std::size_t count = triangle_size(side_ / stride_);
  for (std::size_t k = 0; k < references_.rows.size(); ++k) {
    const PredictedRow here = row(k, from);
    if (here.references == 2) {
      find_depth(coarser_, here, sparse_points_, triangle_size(side_ / sparse_), alpha.data(),
                 depth.data());
      for (unsigned stride = sparse_; stride > stride_; stride /= 2) upsample(stride / 2);
    }
    predict_samples(coarser_, here, points_, count, alpha.data(), depth.data(), color.data());
    // Where the references show nothing, repeat the colour of the previous sample.
    std::uint32_t last = codec::kUnpredictedColor;
    for (std::size_t c = 0; c < count; ++c) {
      if (color[c] == 0)
        color[c] = last & 0xFFFFFF;  // counts less than what is seen
      else
        last = color[c];
    }
    if (stride_ == 2) {
      upsample(1);
      std::uint32_t* const spread = &spread_color[line + 1];
      const std::uint32_t* coarse = color.data();
      for (std::size_t q = 0, length = side_ / 2 + 1; length > 0; ++q, coarse += length--)
        std::copy_n(coarse, length, spread + q * line);
      upsample_colors(side_, four_taps, spread, finer_color.data());
      color.swap(finer_color);
    }
    std::copy_n(alpha.data(), columns_, predicted.alpha.data() + k * columns_);
    std::copy_n(depth.data(), columns_, predicted.depth.data() + k * columns_);
    std::transform(color.data(), color.data() + columns_, predicted.color.data() + k * columns_,
                   [](std::uint32_t rgb) { return rgb | 0xFF000000; });
  }
}

}  // namespace slf

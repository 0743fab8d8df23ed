#include "field/predict/predictor.h"

#include <algorithm>

#include "field/predict/upsample_kernel.h"

namespace slf {
namespace {

/// Repeats the last point, because kernels work in whole vectors.
void fill_padding(Points& points, std::size_t count) {
  for (auto* axis : {&points.x, &points.y, &points.z}) {
    const float last = (*axis)[count - 1];
    axis->resize(count + kPadding);
    std::fill(axis->begin() + static_cast<std::ptrdiff_t>(count), axis->end(), last);
  }
}

void push(Points& points, const glm::vec3& p) {
  points.x.push_back(p.x), points.y.push_back(p.y), points.z.push_back(p.z);
}

}  // namespace

TilePredictor::TilePredictor(const LevelGeometry& coarser, const LevelGeometry& finer,
                             const TileSections& sections, References references)
    : coarser_(coarser),
      references_(std::move(references)),
      side_(finer.exit_side()),
      columns_(triangle_size(side_)) {
  // Within a section, coordinates are linear in p and q.
  const LatticeVertex v = vertex_at(sections.exit, {0, 0}, side_);
  const LatticeVertex along_p = vertex_at(sections.exit, {1, 0}, side_);
  const LatticeVertex along_q = vertex_at(sections.exit, {0, 1}, side_);
  const auto n = static_cast<std::int32_t>(side_);
  for (std::int32_t q = 0; q <= n; ++q)
    for (std::int32_t p = 0; p + q <= n; ++p) {
      const auto at = [p, q](std::int32_t a, std::int32_t b, std::int32_t c) {
        return a + p * (b - a) + q * (c - a);
      };
      const glm::vec3 point =
          exact_direction({at(v.i, along_p.i, along_q.i), at(v.j, along_p.j, along_q.j),
                           at(v.k, along_p.k, along_q.k)});
      push(points_, point);
      if (side_ % 2 != 0 || (p % 2 == 0 && q % 2 == 0)) push(even_points_, point);
    }
  fill_padding(points_, columns_);
  fill_padding(even_points_, even_points_.x.size());
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
    to.row = static_cast<std::uint32_t>(vertex.row * columns_);
    to.tiles = from.data() + vertex.slot * exits;
  }
  return out;
}

std::vector<std::uint32_t> TilePredictor::uses(std::span<const std::uint8_t> alpha,
                                               std::span<const std::uint8_t> depth) const {
  const std::size_t exits = section_count(coarser_.level());
  const std::vector<ReferenceTile> none(references_.sections.size() * exits);
  std::vector<std::uint32_t> uses(none.size());
  std::vector<std::uint8_t> a(columns_ + kPadding), z(columns_ + kPadding);
  std::vector<std::uint32_t> rgb(columns_ + kPadding);
  for (std::size_t k = 0; k < references_.rows.size(); ++k) {
    std::copy_n(alpha.data() + k * columns_, columns_, a.data());
    std::copy_n(depth.data() + k * columns_, columns_, z.data());
    PredictedRow looked_up = row(k, none);
    for (std::size_t c = 0; c < looked_up.references; ++c)
      looked_up.reference[c].uses = uses.data() + references_.rows[k].vertex[c].slot * exits;
    predict_color(coarser_, looked_up, points_, columns_, a.data(), z.data(), rgb.data());
  }
  return uses;
}

void TilePredictor::alpha_depth(std::span<const ReferenceTile> from, std::span<std::uint8_t> alpha,
                                std::span<std::uint8_t> depth) const {
  const std::size_t count = side_ % 2 == 0 ? triangle_size(side_ / 2) : columns_;
  std::vector<std::uint8_t> even_alpha(count + kPadding), even_depth(count + kPadding);
  std::vector<std::uint8_t> a(columns_ + kPadding), z(columns_ + kPadding);
  for (std::size_t k = 0; k < references_.rows.size(); ++k) {
    predict_alpha_depth(coarser_, row(k, from), even_points_, count, even_alpha.data(),
                        even_depth.data());
    if (side_ % 2 == 0)
      upsample_columns(side_, even_alpha.data(), even_depth.data(), a.data(), z.data());
    else
      a = even_alpha, z = even_depth;
    std::copy_n(a.data(), columns_, alpha.data() + k * columns_);
    std::copy_n(z.data(), columns_, depth.data() + k * columns_);
  }
}

void TilePredictor::color(std::span<const ReferenceTile> from, std::span<const std::uint8_t> alpha,
                          std::span<const std::uint8_t> depth,
                          std::span<std::uint32_t> color) const {
  std::vector<std::uint8_t> a(columns_ + kPadding), z(columns_ + kPadding);
  std::vector<std::uint32_t> rgb(columns_ + kPadding);
  for (std::size_t k = 0; k < references_.rows.size(); ++k) {
    std::copy_n(alpha.data() + k * columns_, columns_, a.data());
    std::copy_n(depth.data() + k * columns_, columns_, z.data());
    predict_color(coarser_, row(k, from), points_, columns_, a.data(), z.data(), rgb.data());
    // Where the references show nothing, repeat the colour of the previous sample.
    std::uint32_t last = 0xFF808080u;
    for (std::size_t c = 0; c < columns_; ++c) {
      if (rgb[c] != 0)
        last = rgb[c];
      else if (a[c] != 0)
        rgb[c] = last;
    }
    std::copy_n(rgb.data(), columns_, color.data() + k * columns_);
  }
}

}  // namespace slf

#include "field/predict/predictor.h"

#include <algorithm>

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
  for (std::uint32_t q = 0; q <= side_; ++q)
    for (std::uint32_t p = 0; p + q <= side_; ++p) {
      const LocalPoint local{static_cast<std::uint16_t>(p), static_cast<std::uint16_t>(q)};
      const glm::vec3 point = exact_direction(vertex_at(sections.exit, local, side_));
      push(points_, point);
      if (side_ % 2 != 0 || (p % 2 == 0 && q % 2 == 0)) {
        push(even_points_, point);
        even_columns_.push_back(triangle_index(side_, p, q));
      }
    }
  fill_padding(points_, columns_);
  fill_padding(even_points_, even_columns_.size());
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
  const std::size_t count = even_columns_.size();
  std::vector<std::uint8_t> coarse_alpha(count + kPadding), coarse_depth(count + kPadding);
  for (std::size_t k = 0; k < references_.rows.size(); ++k) {
    predict_alpha_depth(coarser_, row(k, from), even_points_, count, coarse_alpha.data(),
                        coarse_depth.data());
    std::uint8_t* const a = alpha.data() + k * columns_;
    std::uint8_t* const z = depth.data() + k * columns_;
    for (std::size_t c = 0; c < count; ++c) {
      a[even_columns_[c]] = coarse_alpha[c];
      z[even_columns_[c]] = coarse_depth[c];
    }
    if (side_ % 2 != 0) continue;
    // Other columns lie halfway between two of these. They get the mean alpha, and the mean depth
    // of those that are visible.
    const auto between = [&](std::uint32_t at, std::uint32_t one, std::uint32_t other) {
      a[at] = static_cast<std::uint8_t>((a[one] + a[other] + 1) / 2);
      z[at] = a[other] == 0 ? z[one]
              : a[one] == 0 ? z[other]
                            : static_cast<std::uint8_t>((z[one] + z[other] + 1) / 2);
    };
    for (std::uint32_t q = 0, at = 0; q <= side_; ++q)
      for (std::uint32_t p = 0; p + q <= side_; ++p, ++at) {
        const std::uint32_t up = side_ + 2 - q, down = side_ + 1 - q;  // to lines q - 1 and q + 1
        if (p % 2 != 0 && q % 2 == 0) between(at, at - 1, at + 1);
        if (p % 2 == 0 && q % 2 != 0) between(at, at - up, at + down);
        if (p % 2 != 0 && q % 2 != 0) between(at, at - up + 1, at + down - 1);
      }
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

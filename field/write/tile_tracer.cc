#include "field/write/tile_tracer.h"

#include <algorithm>
#include <optional>

#include "base/guarded.h"
#include "base/half.h"
#include "base/sort_unique.h"
#include "base/try.h"

namespace slf {
namespace {

constexpr std::size_t kRaysAtOnce = 1 << 16;

/// Tent-filtered means of rays from one entry vertex, around vertices of an exit lattice.
class TentFilter {
 public:
  explicit TentFilter(std::span<const LatticeVertex> centers) {
    const auto in_finer = [](const LatticeVertex& v) {
      return LatticeVertex{2 * v.i, 2 * v.j, 2 * v.k};
    };
    for (const LatticeVertex& center : centers) {
      const auto around = neighbors(in_finer(center));
      exit_vertices_.insert(exit_vertices_.end(), around.begin(), around.end());
      exit_vertices_.push_back(in_finer(center));
    }
    sort_unique(exit_vertices_);
    const auto add = [&](const LatticeVertex& v, float weight) {
      const auto at = std::lower_bound(exit_vertices_.begin(), exit_vertices_.end(), v) -
                      exit_vertices_.begin();
      shares_.push_back({static_cast<std::uint32_t>(at), weight});
    };
    for (const LatticeVertex& center : centers) {
      const auto around = neighbors(in_finer(center));
      // Halfway to the next vertex, a tent has half its height.
      const float side = 1 / static_cast<float>(around.size() + 2);
      for (const LatticeVertex& v : around) add(v, side);
      add(in_finer(center), 2 * side);
      end_.push_back(shares_.size());
    }
  }

  /// The exit points of the rays: vertices of the lattice twice as fine.
  [[nodiscard]] const std::vector<LatticeVertex>& exit_vertices() const { return exit_vertices_; }

  /// Computes the mean for each center. REQUIRES: `rays` are those to exit_vertices(); out.size()
  /// is the number of centers.
  void mean(std::span<const RaySample> rays, std::span<RaySample> out) const {
    for (std::size_t k = 0, share = 0; k < out.size(); ++k) {
      RaySample sum;
      for (; share < end_[k]; ++share) {
        const RaySample& ray = rays[shares_[share].ray];
        sum.rgba += shares_[share].weight * ray.rgba;
        sum.depth += shares_[share].weight * ray.rgba.a * ray.depth;
      }
      if (sum.rgba.a > 0) sum.depth /= sum.rgba.a;
      out[k] = sum;
    }
  }

 private:
  struct Share {
    std::uint32_t ray;
    float weight;
  };
  std::vector<LatticeVertex> exit_vertices_;
  std::vector<Share> shares_;
  std::vector<std::size_t> end_;  // per mean, into shares_
};

void store_color(const glm::vec4& rgba, SampleFormat format, std::byte* to) {
  if (is_half(format)) {
    for (int c = 0; c < 4; ++c) store_le<std::uint16_t>(to + 2 * c, half_from_float(rgba[c]));
    return;
  }
  to[3] = std::byte{byte_from_float(rgba.a)};
  for (int c = 0; c < 3; ++c) to[c] = std::min(std::byte{byte_from_float(rgba[c])}, to[3]);
}

/// Depth is undefined where nothing is visible. Fills such samples with smooth values, which cost
/// few bytes: along each line, a ramp between defined samples; a line without defined samples
/// repeats its neighbour.
void fill_undefined_depth(std::byte* picture, const std::vector<bool>& defined,
                          std::uint32_t side) {
  const auto line = [&](std::uint32_t q) { return triangle_index(side, 0, q); };
  std::vector<bool> filled(side + 1, false);
  for (std::uint32_t q = 0; q <= side; ++q) {
    const std::uint32_t begin = line(q), length = side + 1 - q;
    std::int64_t last = -1;
    for (std::uint32_t p = 0; p < length; ++p) {
      if (!defined[begin + p]) continue;
      const int right = std::to_integer<int>(picture[begin + p]);
      const int left = last < 0 ? right : std::to_integer<int>(picture[begin + last]);
      const auto gap = static_cast<int>(p - last);
      for (auto k = static_cast<std::uint32_t>(last + 1); k < p; ++k) {
        const int along = static_cast<int>(k - last);
        picture[begin + k] = static_cast<std::byte>(left + (right - left) * along / gap);
      }
      last = p;
    }
    if (last < 0) continue;
    std::fill(picture + begin + last + 1, picture + begin + length, picture[begin + last]);
    filled[q] = true;
  }
  const auto copy_line = [&](std::uint32_t from, std::uint32_t to) {
    const std::uint32_t have = side + 1 - from;
    for (std::uint32_t p = 0; p < side + 1 - to; ++p)
      picture[line(to) + p] = picture[line(from) + std::min(p, have - 1)];
    filled[to] = true;
  };
  for (std::uint32_t q = 1; q <= side; ++q)
    if (filled[q - 1] && !filled[q]) copy_line(q - 1, q);
  for (std::uint32_t q = side; q-- > 0;)
    if (filled[q + 1] && !filled[q]) copy_line(q + 1, q);
}

}  // namespace

TileTracer::TileTracer(std::span<const Scene* const> scenes, const Manifest& manifest,
                       std::string place)
    : scenes_(scenes.begin(), scenes.end()),
      place_(std::move(place)),
      shape_(manifest.shape),
      format_(manifest.format) {
  for (unsigned level = 0; level <= shape_.finest_level; ++level) {
    filtered_.push_back(manifest.filtered(level));
    levels_.emplace_back(shape_, level);
  }
}

TileShape TileTracer::shape(TileKey key) const {
  return levels_[key.level].tile(sections_of(key, shape_.entry_extra_levels).entry.index, format_);
}

std::uint64_t TileTracer::rays(TileKey key) const {
  const TileShape tile = shape(key);
  return tile.samples() * rays_per_slab(key.level);
}

std::uint64_t TileTracer::work(unsigned level) const {
  // Every entry vertex has one owner; every exit section has a whole triangle of vertices.
  const std::uint64_t entries = section_count(level + shape_.entry_extra_levels);
  return vertex_count(shape_.entry_resolution(level)) * triangle_size(shape_.exit_side) *
         rays_per_slab(level) / entries;
}

Result<void> TileTracer::tile(TileKey key, SourceTile& tile) const {
  return at_place(guarded([&] { trace(key, tile); }), place_, ": tile ", storage::name(key));
}

void TileTracer::trace(TileKey key, SourceTile& tile) const {
  const TileSections sections = sections_of(key, shape_.entry_extra_levels);
  const TileShape layout = shape(key);
  const Sphere& sphere = shape_.sphere;
  const auto entries = world_points(
      sphere, vertices_at(sections.entry, shape_.entry_section_side(), layout.positions));
  const auto vertices =
      vertices_at(sections.exit, shape_.exit_side, triangle_points(shape_.exit_side));
  std::optional<TentFilter> filter;
  if (filtered_[key.level]) filter.emplace(vertices);
  const auto exits = world_points(sphere, filter ? filter->exit_vertices() : vertices);

  const std::size_t columns = layout.columns();
  tile.ref = {TileState::empty, key};
  tile.samples.assign(layout.bytes(), std::byte{0});
  std::byte* const colors = tile.samples.data();
  std::byte* const depths = has_depth(format_) ? colors + layout.color_bytes() : nullptr;

  std::vector<bool> defined(columns);
  // Many rows at once, because a call can be costly for some scenes.
  const std::size_t rows =
      std::max<std::size_t>(1, std::min(kRaysAtOnce / exits.size(), entries.size()));
  std::vector<Segment> rays(rows * exits.size());
  std::vector<RaySample> seen(rays.size()), means(filter ? columns : 0);
  for (std::size_t row = 0; row < entries.size(); ++row) {
    const std::size_t in_batch = row % rows;
    if (in_batch == 0) {
      const std::size_t count = std::min(rows, entries.size() - row) * exits.size();
      for (std::size_t k = 0; k < count; ++k)
        rays[k] = {entries[row + k / exits.size()], exits[k % exits.size()]};
      scenes_[key.state]->trace_many(std::span(rays).first(count), std::span(seen).first(count));
    }
    const auto in_row = std::span(seen).subspan(in_batch * exits.size(), exits.size());
    if (filter) filter->mean(in_row, means);
    const std::span<const RaySample> samples = filter ? std::span(means) : in_row;
    bool any = false;
    for (std::size_t column = 0; column < columns; ++column) {
      const RaySample& sample = samples[column];
      defined[column] = sample.rgba.a > 0;
      if (!defined[column]) continue;
      any = true;
      const std::size_t at = row * columns + column;
      store_color(sample.rgba, format_, colors + at * color_bytes(format_));
      if (depths) depths[at] = std::byte{byte_from_float(sample.depth)};
    }
    if (!any) continue;
    tile.ref.state = TileState::stored;
    if (depths) fill_undefined_depth(depths + row * columns, defined, shape_.exit_side);
  }
}

}  // namespace slf

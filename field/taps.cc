#include "field/taps.h"

#include <Imath/half.h>

#include <bit>

namespace slf {
namespace {

glm::vec4 load_color(const std::byte* sample, codec::SampleFormat format) {
  if (format == codec::SampleFormat::rgba16f) {
    glm::vec4 rgba;
    for (int c = 0; c < 4; ++c) {
      Imath::half value;
      value.setBits(load_le<std::uint16_t>(sample + 2 * c));
      rgba[c] = value;
    }
    return rgba;
  }
  return glm::vec4(std::to_integer<int>(sample[0]), std::to_integer<int>(sample[1]),
                   std::to_integer<int>(sample[2]), std::to_integer<int>(sample[3])) *
         (1.f / 255);
}

}  // namespace

TapGatherer::TapGatherer(const Field& field, TileCache& cache)
    : cache_(cache),
      color_(field.layer("color").value_or(0)),
      depth_(field.layer("depth")),
      format_(field.manifest().layers[color_].format) {}

void TapGatherer::group(std::span<const Tap> taps) {
  // Rays of a block meet few tiles: number them in order of appearance, then sort by counting.
  groups_.clear();
  group_of_.resize(taps.size());
  slots_.assign(256, ~0u);
  std::uint64_t last_sections = ~0ull;
  std::uint32_t last_group = 0;
  const auto slot_of = [&](std::uint64_t sections) {
    return static_cast<std::size_t>(sections * 0x9E3779B97F4A7C15u >> 32) & (slots_.size() - 1);
  };
  for (std::size_t k = 0; k < taps.size(); ++k) {
    const std::uint64_t sections =
        std::uint64_t{taps[k].entry_section} << 32 | taps[k].exit_section;
    if (sections != last_sections) {
      if (2 * groups_.size() >= slots_.size()) {  // keep the table at most half full
        slots_.assign(4 * slots_.size(), ~0u);
        for (std::uint32_t g = 0; g < groups_.size(); ++g) {
          std::size_t slot = slot_of(groups_[g].sections);
          while (slots_[slot] != ~0u) slot = (slot + 1) & (slots_.size() - 1);
          slots_[slot] = g;
        }
      }
      std::size_t slot = slot_of(sections);
      while (slots_[slot] != ~0u && groups_[slots_[slot]].sections != sections)
        slot = (slot + 1) & (slots_.size() - 1);
      if (slots_[slot] == ~0u) {
        slots_[slot] = static_cast<std::uint32_t>(groups_.size());
        groups_.push_back({sections, 0, 0});
      }
      last_sections = sections;
      last_group = slots_[slot];
    }
    group_of_[k] = last_group;
    ++groups_[last_group].count;
  }
  std::uint32_t begin = 0;
  for (Group& g : groups_) {
    g.begin = begin;
    begin += g.count;
    g.count = 0;
  }
  order_.resize(taps.size());
  for (std::uint32_t k = 0; k < taps.size(); ++k) {
    Group& g = groups_[group_of_[k]];
    order_[g.begin + g.count++] = k;
  }
}

Result<void> TapGatherer::gather(const LevelGeometry& geometry, std::span<const Tap> taps,
                                 bool with_depth, std::vector<TapValue>& values) {
  values.assign(taps.size(), {});
  group(taps);
  const std::size_t columns = triangle_size(geometry.exit_side());
  const std::size_t sample_size = codec::sample_bytes(format_);
  const std::size_t first = touched_.size();
  for (const Group& g : groups_)
    touched_.push_back(
        tile_key({geometry.entry_section(static_cast<std::uint32_t>(g.sections >> 32)),
                  geometry.exit_section(static_cast<std::uint32_t>(g.sections))}));
  const std::span<const TileKey> keys(touched_.data() + first, groups_.size());
  cache_.advise(color_, keys);
  if (with_depth) cache_.advise(*depth_, keys);

  for (std::size_t n = 0; n < groups_.size(); ++n) {
    const Group& g = groups_[n];
    const TileKey key = keys[n];
    auto color = cache_.get(color_, key);
    if (!color) return tl::unexpected(color.error());
    if (color->state() == storage::TileState::missing)
      for (std::uint32_t k = 0; k < g.count; ++k) values[order_[g.begin + k]].missing = true;
    if (color->state() != storage::TileState::stored) continue;
    TileCache::Pin depth;
    const std::byte* depths = nullptr;
    if (with_depth) {
      auto pin = cache_.get(*depth_, key);
      if (!pin) return tl::unexpected(pin.error());
      depth = std::move(*pin);
      depths = depth.samples();
    }
    for (std::uint32_t k = 0; k < g.count; ++k) {
      const Tap& tap = taps[order_[g.begin + k]];
      TapValue& value = values[order_[g.begin + k]];
      for (int c = 0; c < 3; ++c) {
        if (tap.weights[c] == 0) continue;
        const std::size_t at = tap.row * columns + tap.columns[c];
        const glm::vec4 rgba = load_color(color->samples() + at * sample_size, format_);
        value.rgba += tap.weights[c] * rgba;
        if (depths)
          value.depth += tap.weights[c] * rgba.a *
                         static_cast<float>(std::to_integer<int>(depths[at])) * (1.f / 255);
      }
    }
  }
  return {};
}

}  // namespace slf

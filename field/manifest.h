// Manifest: everything needed to open a field, as JSON in the container (FORMAT.md).
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "base/error.h"
#include "codec/codec.h"
#include "field/scene.h"
#include "field/section.h"

namespace slf {

/// How a field samples its sphere. Level l of the tile pyramid is a complete field on entry
/// lattice(entry_side·2^l) and exit lattice(exit_side·2^l).
struct FieldShape {
  Sphere sphere;
  std::uint32_t entry_side = 8;  ///< cells along an octsphere's edge at level 0, entry side
  std::uint32_t exit_side = 32;  ///< the same, exit side; also the side of every tile's pictures
  unsigned levels = 2;           ///< the finest level: levels 0..levels are stored
  unsigned entry_depth = 0;      ///< how much deeper the entry side is split than the exit side
  /// The level-0 subfields that are kept, ascending: 8 × entry octant + exit octant. Empty: all 64.
  /// At entry_depth > 0 these are still octant pairs.
  std::vector<std::uint8_t> subfields;

  [[nodiscard]] std::uint32_t entry_resolution(unsigned level) const { return entry_side << level; }
  [[nodiscard]] std::uint32_t exit_resolution(unsigned level) const { return exit_side << level; }
  /// Cells along the edge of an entry section: entry_side / 2^entry_depth.
  [[nodiscard]] std::uint32_t entry_section_side() const { return entry_side >> entry_depth; }
  /// Rays of one level: entry vertices × exit vertices.
  [[nodiscard]] std::uint64_t slabs(unsigned level) const {
    return vertex_count(entry_resolution(level)) * vertex_count(exit_resolution(level));
  }
  /// Tiles of one level that the field is to have.
  [[nodiscard]] std::uint64_t tiles(unsigned level) const {
    const std::uint64_t all = tile_count(level, entry_depth);
    return subfields.empty() ? all : all / 64 * subfields.size();
  }
  /// Whether the field is to have a tile.
  [[nodiscard]] bool has(TileKey key) const;
  /// The most samples a tile can have.
  [[nodiscard]] std::uint64_t largest_tile() const {
    return std::uint64_t{triangle_size(entry_section_side())} * triangle_size(exit_side);
  }

  /// usage: a side or level out of range, or tiles too large to decode whole; says what would do.
  [[nodiscard]] Result<void> check() const;
};

/// A stored channel group of every tile.
struct Layer {
  std::string name;  ///< "color" or "depth"
  codec::SampleFormat format = codec::SampleFormat::rgba8;
  std::string codec;  ///< specification, e.g. "jpeg:75"
};

struct Manifest {
  static constexpr int kMajor = 1;
  static constexpr int kMinor = 0;

  FieldShape shape;
  std::vector<Layer> layers;
  nlohmann::json provenance;  ///< of the scene; free form

  [[nodiscard]] nlohmann::json to_json() const;

  /// Parses untrusted text. bad_file: not a manifest, a value missing or out of range, named by
  /// its place. unsupported: a newer major version or an unknown required feature.
  [[nodiscard]] static Result<Manifest> parse(std::string_view text, const std::string& file);
};

[[nodiscard]] const char* name(codec::SampleFormat format);

}  // namespace slf

// Manifest: everything needed to open a field, as JSON in the container (FORMAT.md).
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "slf/error.h"
#include "slf/field.h"
#include "slf/shape.h"

namespace slf {

struct Manifest {
  static constexpr int kMajor = 1;

  FieldShape shape;
  /// How many levels, from 0 on, hold means of rays instead of single rays. Absent in fields older
  /// than minor version 1.
  std::optional<unsigned> filtered_levels;
  std::vector<Layer> layers;
  nlohmann::json provenance;      ///< of the scene; free form
  std::optional<TileRange> part;  ///< the tiles that the file is to hold; none: all

  /// Whether the samples of a level are means of rays. Builds that did not record it took means
  /// below their finest level.
  [[nodiscard]] bool filtered(unsigned level) const {
    return level < filtered_levels.value_or(shape.levels);
  }

  [[nodiscard]] nlohmann::json to_json() const;

  /// Whether the file is to hold a tile of the field.
  [[nodiscard]] bool holds(TileKey key) const {
    return shape.has(key) && (!part || (key >= part->begin && key < part->end));
  }
  /// How many tiles of a level the file is to hold.
  [[nodiscard]] std::uint64_t tiles(unsigned level) const;

  /// Parses untrusted text. bad_file: not a manifest, a value missing or out of range, named by
  /// its place. unsupported: a newer major version or an unknown required feature.
  [[nodiscard]] static Result<Manifest> parse(std::string_view text, const std::string& file);
};

/// The place of the first member in which two manifests of builds differ; empty if none does. A
/// source is its content: where that is recorded, its path may differ. How levels are filtered, and
/// which part of the field a file holds, are not compared.
[[nodiscard]] std::string first_difference(const Manifest& there, const Manifest& wanted);

}  // namespace slf

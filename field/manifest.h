// Manifest: everything needed to open a field, as JSON in the container (FORMAT.md).
#pragma once

#include <cstdint>
#include <initializer_list>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "base/owned_json.h"
#include "slf/error.h"
#include "slf/field.h"
#include "slf/shape.h"

namespace slf {

struct Manifest {
  static constexpr int kMajor = 2;

  FieldShape shape;
  /// How many levels, from 0 on, hold means of rays instead of single rays. A text that does not
  /// say so means all but the finest.
  unsigned filtered_levels = 0;
  SampleFormat format = SampleFormat::rgba8;
  std::string codec;     ///< specification, such as "jpeg:75"
  OwnedJson provenance;  ///< of the scene; free form
  /// The states, if the field has several.
  struct State {
    std::string name;
    OwnedJson provenance;  ///< what differs from that of the first: a merge patch (RFC 7386)
  };
  std::vector<State> states;
  /// Whether predicted tiles may keep rays of earlier states. Releases up to 0.3 kept none.
  bool keeps_rays = false;
  /// The tiles of this file, if it is a part of a field: of each state those with the keys that
  /// these have in the first.
  std::optional<TileRange> part;

  /// Whether the samples of a level are means of rays.
  [[nodiscard]] bool filtered(unsigned level) const { return level < filtered_levels; }

  /// Sets the states, none if there is just one, and the provenance of each. usage: one of several
  /// has no name, or that of another.
  [[nodiscard]] Result<void> set_states(
      std::span<const std::pair<std::string, OwnedJson>> provenances);

  /// usage: the shape is none, or its levels are too many for the codec.
  [[nodiscard]] Result<void> check() const;

  [[nodiscard]] OwnedJson to_json() const;
  /// The provenance of a state. REQUIRES: it is 0, or below states.size().
  [[nodiscard]] OwnedJson provenance_of(unsigned state) const;
  /// A value in it, without a copy of all the others: what is at a path of names, unless that is an
  /// object. Null: nothing. REQUIRES: as provenance_of().
  [[nodiscard]] const nlohmann::json* provenance_at(unsigned state,
                                                    std::initializer_list<const char*> path) const;

  /// Whether a tile belongs to the field, and to its part if this is one.
  [[nodiscard]] bool holds(TileKey key) const {
    const TileKey first = in_state(key, 0);
    return shape.has(key) && (!part || (first >= part->begin && first < part->end));
  }
  /// The number of tiles of a level for which holds() is true.
  [[nodiscard]] std::uint64_t tiles(unsigned level) const;

  /// Parses untrusted text. bad_file: not a manifest, or a value is missing or out of range; the
  /// message names its place. unsupported: a newer major version or an unknown required feature.
  [[nodiscard]] static Result<Manifest> parse(std::string_view text, const std::string& file);
};

/// The JSON pointer of the first member in which two manifests of builds differ; empty if none
/// does. If the provenance records a hash of the source's content, the source's name may differ.
/// filtered_levels and part are not compared.
[[nodiscard]] std::string first_difference(const Manifest& existing, const Manifest& expected);

}  // namespace slf

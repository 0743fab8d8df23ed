// Inspecting fields: lists of tiles, single tiles, and the differences between two fields.
//
// All functions stream: memory does not depend on the number of tiles.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "slf/error.h"
#include "slf/field.h"
#include "slf/image.h"
#include "slf/progress.h"
#include "slf/tile_reader.h"

namespace slf {

/// A tile by its two sections: entry at level + entry_extra_levels, exit at level (FORMAT.md).
struct TileAddress {
  unsigned level = 0;
  std::uint64_t entry = 0;  ///< index of the entry section
  std::uint64_t exit = 0;   ///< index of the exit section
  friend bool operator==(const TileAddress&, const TileAddress&) = default;

  static constexpr const char* kPython = "TileAddress";
  void describe(auto& member) const {
    member("level", level, "of the tile");
    member("entry", entry, "index of the entry section");
    member("exit", exit, "index of the exit section");
  }
};
/// "2/3/17".
[[nodiscard]] std::string to_string(const TileAddress& address);
[[nodiscard]] TileAddress address_of(const Field& field, TileKey key);
/// The key of a tile, built or not. usage: the field has no such tile; the message states the valid
/// range.
[[nodiscard]] Result<TileKey> find_tile(const Field& field, const TileAddress& address);
/// The same by the index within the level, which is how error messages name tiles.
[[nodiscard]] Result<TileKey> find_tile(const Field& field, unsigned level, std::uint64_t index);

// ---- lists -------------------------------------------------------------------------------------

/// "missing", "empty", "stored", "same".
[[nodiscard]] const char* name(TileState state);

/// One tile.
struct ListedTile {
  TileKey key{};
  TileAddress address{};
  std::uint8_t subfield = 0;
  TileState state = TileState::missing;
  std::uint64_t payload_bytes = 0, offset_bytes = 0;

  static constexpr const char* kPython = "Tile";
  void describe(auto& member) const {
    member({"tile", nullptr}, to_string(address), "LEVEL/ENTRY/EXIT",
           R"("pattern": "^[0-9]+/[0-9]+/[0-9]+$")");
    member("level", address.level, "0 is the coarsest");
    member({"index", nullptr}, key.index, "within the level");
    member("entry", address.entry, "index of the entry section");
    member("exit", address.exit, "index of the exit section");
    member({"subfield", nullptr}, subfield, "8 × entry octant + exit octant", R"("maximum": 63)");
    member({"state", "content"}, name(state),
           "stored, empty, missing, or same: stored with an earlier state",
           R"("enum": ["missing", "empty", "stored", "same"])");
    member("payload_bytes", payload_bytes, "0 unless stored or same");
    member("offset_bytes", offset_bytes, "of the payload in the file; 0 without a payload");
  }
};

/// Which tiles to list.
struct TileFilter {
  unsigned first_level = 0;
  unsigned last_level = std::numeric_limits<unsigned>::max();
  std::vector<std::uint8_t> subfields = {};  ///< ascending; empty: all
  bool missing = false;                      ///< also list tiles that are missing, at most 2^24
};

/// Visits the tiles in key order. Reads the tables of records and no payload.
/// If the visitor returns an error, the list ends with that error.
/// usage: no such level or subfield. bad_file: a record is damaged.
[[nodiscard]] Result<void> list_tiles(
    const Field& field, const TileFilter& filter,
    const std::function<Result<void>(const ListedTile&)>& visitor);

// ---- single tiles ------------------------------------------------------------------------------

/// The samples of a tile: for each entry vertex a triangular picture, one sample per exit vertex.
struct TileSampleSet {
  unsigned numbers = 4;    ///< of a sample: 4, premultiplied R, G, B and A; or 1, the depth
  bool half = false;       ///< a number is a half float; otherwise it is a byte
  std::uint32_t side = 0;  ///< cells along the edge of a picture
  /// Position on the triangular lattice of entry vertices.
  struct Place {
    std::uint32_t p = 0, q = 0;
  };
  std::vector<Place> entries;          ///< the entry vertex of each picture
  bool empty = false;                  ///< nothing is visible: the samples are zeros
  std::span<const std::byte> samples;  ///< picture by picture, in the order of FORMAT.md
  std::shared_ptr<const void> owner;   ///< keeps `samples`; a decoded tile of the reader
};

/// Reads a tile. `channel` is "color" or "depth".
/// usage: the field has no such tile or channel. tile_missing: the tile, or one that it is
/// predicted from, was never built. bad_file: it is damaged.
[[nodiscard]] Result<TileSampleSet> read_tile(const TileReader& tiles, TileKey key,
                                              const std::string& channel);

/// Where the rays of a tile begin and end, in world units: sample k is that of the ray from
/// origins[k / targets.size()] to targets[k % targets.size()].
struct TileRays {
  std::vector<glm::dvec3> origins, targets;
};
/// REQUIRES: the field has such a tile.
[[nodiscard]] TileRays tile_rays(const Field& field, TileKey key);

/// The pictures of a tile side by side, each where its entry vertex lies among the others.
/// Premultiplied colour, or depth as grey; transparent between the pictures. Errors as read_tile().
[[nodiscard]] Result<Image> tile_picture(const TileReader& tiles, TileKey key,
                                         const std::string& channel);

// ---- differences -------------------------------------------------------------------------------

/// How the tiles of two fields differ in one channel, "color" or "depth". Depths are compared only
/// for samples whose colour in `a` is not fully transparent.
struct ChannelDifference {
  std::string channel;
  std::uint64_t compared = 0, only_in_a = 0, only_in_b = 0, recoded = 0, differing = 0;
  double psnr = std::numeric_limits<double>::infinity(), worst_psnr = psnr;
  std::optional<TileKey> worst;           ///< the tile that differs most, of any state
  std::optional<TileAddress> worst_at{};  ///< the same tile
  std::optional<std::string> worst_name{};

  static constexpr const char* kPython = "ChannelDifference";
  void describe(auto& member) const {
    constexpr const char* kDecibels = R"("type": ["number", "null"])";
    member("channel", channel, "what was compared", R"("enum": ["color", "depth"])");
    member({"tiles_compared", "compared"}, compared, "tiles that both fields have");
    member({"tiles_only_in_a", "only_in_a"}, only_in_a, "tiles that b lacks");
    member({"tiles_only_in_b", "only_in_b"}, only_in_b, "tiles that a lacks");
    member({"tiles_recoded", "recoded"}, recoded, "of those compared: other bytes, same samples");
    member({"tiles_differing", "differing"}, differing, "of those compared: other samples");
    member("psnr", psnr, "dB; infinite, in JSON null, if there is no difference", kDecibels);
    member("worst_psnr", worst_psnr, "dB, of the tile that differs most", kDecibels);
    member({nullptr, "worst"}, worst_at, "level, entry and exit of that tile");
    member({"worst_tile", nullptr}, worst_name, "LEVEL/ENTRY/EXIT, and its state",
           R"("pattern": "^[0-9]+/[0-9]+/[0-9]+( of state .*)?$")");
  }
};

struct FieldDifference {
  std::vector<std::string> manifest;
  bool comparable = false;
  std::vector<ChannelDifference> channels;

  static constexpr const char* kPython = "Difference";
  void describe(auto& member) const {
    member("equal", equal(), "the same manifest, and the same tiles with the same bytes");
    member("comparable", comparable,
           "tiles of one key sample the same rays; if not, none was compared");
    member("manifest", manifest, "places in which the manifests differ, as JSON pointers");
    member("channels", channels, "those that both fields have");
  }
  /// The same tiles with the same bytes, and the same manifest.
  [[nodiscard]] bool equal() const;
  /// Comparable, the same tiles, and no tile has a PSNR below this, in dB.
  [[nodiscard]] bool alike(double min_psnr) const;
};

struct DiffOptions {
  unsigned threads = 0;     ///< 0: all
  bool all_states = false;  ///< compare all states of both fields, not just those that they show
};

/// Compares two fields tile by tile, as they are composed. A sample that is no number differs
/// without bound (PSNR -inf) from any number. Two tiles with the same bytes count as equal and are
/// not decoded, unless other states that are not compared may predict them. If a tile that they are
/// predicted from differs, that tile itself is counted. Progress counts tiles. bad_file: one of two
/// tiles with different bytes is damaged. cancelled: the callback stopped the comparison.
[[nodiscard]] Result<FieldDifference> diff_fields(const Field& a, const Field& b,
                                                  const DiffOptions& options = {},
                                                  const ProgressCallback& progress = {});

}  // namespace slf

// Looking into fields by hand: lists of tiles, single tiles, and what differs between two fields.
//
// All of it streams: memory does not depend on the number of tiles.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "slf/build.h"
#include "slf/error.h"
#include "slf/field.h"
#include "slf/image.h"
#include "slf/tile.h"

namespace slf {

/// A tile by its two sections: entry at level + entry_extra_levels, exit at level (FORMAT.md).
struct TileAddress {
  unsigned level = 0;
  std::uint64_t entry = 0;  ///< index of the entry section
  std::uint64_t exit = 0;   ///< index of the exit section
  friend bool operator==(const TileAddress&, const TileAddress&) = default;
};
/// "2/3/17".
[[nodiscard]] std::string to_string(const TileAddress& address);
[[nodiscard]] TileAddress address_of(const Field& field, TileKey key);
/// usage: the field has no such tile; the message says what it has.
[[nodiscard]] Result<TileKey> find_tile(const Field& field, const TileAddress& address);
/// The same by its index within the level, as messages name tiles.
[[nodiscard]] Result<TileKey> find_tile(const Field& field, unsigned level, std::uint64_t index);

// ---- lists -------------------------------------------------------------------------------------

enum class TileContent { missing, empty, stored };
/// "missing", "empty", "stored".
[[nodiscard]] const char* name(TileContent content);

/// One tile of one layer.
struct ListedTile {
  TileKey key;
  TileAddress address;
  std::uint8_t subfield = 0;  ///< 8 × entry octant + exit octant
  std::size_t layer = 0;      ///< of Field::layers()
  TileContent content = TileContent::missing;
  std::uint64_t payload_bytes = 0;
  std::uint64_t offset_bytes = 0;  ///< of the payload in the file; 0 where nothing is stored
};

/// Which tiles to list.
struct TileFilter {
  unsigned first_level = 0;
  unsigned last_level = std::numeric_limits<unsigned>::max();
  std::vector<std::uint8_t> subfields = {};  ///< ascending; empty: all
  std::string layer = {};                    ///< empty: all
  bool missing = false;                      ///< also tiles that the field is to have and has not
};

/// Visits the tiles layer by layer, in key order. Reads the tables of records and no payload.
/// An error of the visitor ends the list and is returned.
/// usage: no such level, layer or subfield. bad_file: a record is damaged.
[[nodiscard]] Result<void> list_tiles(
    const Field& field, const TileFilter& filter,
    const std::function<Result<void>(const ListedTile&)>& visitor);

// ---- single tiles ------------------------------------------------------------------------------

/// The samples of a tile: a picture, a triangle of exit vertices, for each entry vertex.
struct TileSampleSet {
  SampleFormat format = SampleFormat::rgba8;  ///< rgba8, rgba16f or depth8
  std::uint32_t side = 0;                     ///< cells along the edge of a picture
  struct Place {
    std::uint32_t p = 0, q = 0;
  };
  std::vector<Place> entries;      ///< of each picture, on the triangular lattice of entry vertices
  bool empty = false;              ///< nothing is visible: the samples are zeros
  std::vector<std::byte> samples;  ///< picture by picture, in the order of FORMAT.md
};

/// Decodes a tile. `channel` is "color" or "depth", whether or not they share a layer.
/// usage: the field has no such channel. failed: the tile, or one that it is predicted from, was
/// never built. bad_file: it is damaged.
[[nodiscard]] Result<TileSampleSet> read_tile(const Field& field, TileKey key,
                                              const std::string& channel);

/// The pictures of a tile side by side, each where its entry vertex lies among the others.
/// Premultiplied colour, or depth as gray; transparent between the pictures. Errors of read_tile().
[[nodiscard]] Result<Image> tile_picture(const Field& field, TileKey key,
                                         const std::string& channel);

// ---- differences -------------------------------------------------------------------------------

/// How the tiles of two fields differ in one channel, "color" or "depth". Depths count where a's
/// colours are visible.
struct ChannelDifference {
  std::string channel;
  std::uint64_t compared = 0;   ///< tiles that both fields have
  std::uint64_t only_in_a = 0;  ///< tiles that b lacks
  std::uint64_t only_in_b = 0;
  std::uint64_t recoded = 0;    ///< of compared: other bytes that decode to the same samples
  std::uint64_t differing = 0;  ///< of compared: other samples
  double psnr = std::numeric_limits<double>::infinity();        ///< in dB, over all compared
  double worst_psnr = std::numeric_limits<double>::infinity();  ///< of the tile that differs most
  std::optional<TileKey> worst;                                 ///< that tile
};

struct FieldDifference {
  /// Places in the manifest where the two differ, as JSON pointers.
  std::vector<std::string> manifest;
  /// Whether tiles of the same key sample the same rays. If not, tiles were not compared.
  bool comparable = false;
  std::vector<ChannelDifference> channels;  ///< those that both fields have

  /// The same tiles with the same bytes, and the same manifest.
  [[nodiscard]] bool equal() const;
  /// Comparable, the same tiles, and no tile has a PSNR below this, in dB.
  [[nodiscard]] bool alike(double least_psnr) const;
};

struct DiffOptions {
  unsigned threads = 0;  ///< 0: all
};

/// Compares two fields tile by tile. Tiles whose bytes are the same are not decoded, and count as
/// the same even if one that they are predicted from differs, which is then counted itself.
/// Progress counts tiles. bad_file: a tile that differs is damaged. failed: stopped by the
/// callback.
[[nodiscard]] Result<FieldDifference> diff_fields(const Field& a, const Field& b,
                                                  const DiffOptions& options = {},
                                                  const ProgressCallback& progress = {});

}  // namespace slf

// FieldFile: the manifest, geometry, codec and tiles behind Fields, which show states of it.
#pragma once

#include <array>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <unordered_map>
#include <vector>

#include "codec/codec.h"
#include "field/geometry/level_geometry.h"
#include "field/geometry/tile_order.h"
#include "field/geometry/tile_selection.h"
#include "field/manifest.h"
#include "field/reference_index.h"
#include "field/tile_coder.h"
#include "slf/error.h"
#include "slf/field.h"
#include "storage/tile_store.h"

namespace slf {

/// Blob names in the container.
inline constexpr const char* kManifestBlob = "field";
inline constexpr const char* kTablesBlob = "tables";
inline constexpr const char* kLightBlob = "light";
inline constexpr const char* kRevealBlob = "reveal";
/// Those that views do not need, by name. Without bytes: none.
using KeptBlobs = std::map<std::string, Bytes>;

/// Through how many other states a tile can be predicted (doc/decisions/states.md).
inline constexpr unsigned kMaxChain = 1;
inline constexpr const char* kChained = ": is predicted through more states than a tile may be";

/// A tile that was found in the file.
struct FoundTile {
  storage::TileRef ref;
  std::vector<TileKey> references;  ///< that it is predicted from
};
/// Without those that could not be found or read: a second attempt tells why.
using FoundTiles = std::unordered_map<TileKey, FoundTile, TileKeyHash>;

/// The open container of a field, with all its states. A Field is a handle to one, and to a state.
/// The file is untrusted. Thread-safety: all const members may be called from many threads.
class FieldFile {
 public:
  /// Errors of Field::open(). An incomplete field opens: what was never built is reported as
  /// missing.
  [[nodiscard]] static Result<std::shared_ptr<const FieldFile>> open(const std::string& path);
  /// The same of a container that is open.
  [[nodiscard]] static Result<std::shared_ptr<const FieldFile>> open(storage::TileStore store);
  FieldFile(const FieldFile&) = delete;
  FieldFile& operator=(const FieldFile&) = delete;

  [[nodiscard]] const std::string& path() const { return store_.path(); }
  [[nodiscard]] const Manifest& manifest() const { return manifest_; }
  [[nodiscard]] const FieldShape& shape() const { return manifest_.shape; }
  /// That of one state.
  [[nodiscard]] const FieldShape& shape_of_state() const { return shape_of_state_; }
  [[nodiscard]] const storage::TileStore& store() const { return store_; }

  /// The light of the field's scene, and the code of its reveal, which view the map; no bytes if
  /// the field has none. bad_file: the checksum is wrong.
  [[nodiscard]] Result<ByteSpan> light() const;
  [[nodiscard]] Result<ByteSpan> reveal() const { return kept(kRevealBlob); }
  /// One of KeptBlobs, whichever state this shows.
  [[nodiscard]] Result<ByteSpan> kept(const char* blob) const;

  [[nodiscard]] SampleFormat format() const { return manifest().format; }
  [[nodiscard]] bool has_depth() const { return slf::has_depth(format()); }
  [[nodiscard]] const codec::Codec& codec() const { return *codec_; }

  /// The geometry of a level, computed on first use. REQUIRES: level <= shape().finest_level.
  [[nodiscard]] const LevelGeometry& geometry(unsigned level) const;

  /// Codes its tiles: the codec, with predictions where it needs them.
  [[nodiscard]] const TileCoder& coder() const { return *coder_; }
  /// The shape of a tile. REQUIRES: a key of this field.
  [[nodiscard]] TileShape tile_shape(TileKey key) const { return coder().tile_shape(key); }
  /// For messages: the path, the tile, and its state if the field has several.
  [[nodiscard]] std::string place(TileKey key) const {
    return path() + ": tile " + storage::name(key);
  }

  /// Decodes a stored tile, whose payload TileStore::check() has accepted, into exactly
  /// tile_shape().bytes() bytes. `from`: the samples of its references(). Code that needs samples
  /// reads them through TileCache, which calls this. bad_file: the tile is damaged.
  [[nodiscard]] Result<void> decode(const storage::TileRef& tile,
                                    std::span<const ReferenceSamples> from,
                                    std::span<std::byte> samples) const;

  /// Whether tiles are predicted from coarser ones.
  [[nodiscard]] bool predicts() const { return coder().predicts(); }
  /// The tiles that a tile is predicted from, as its payload names them: coarser ones and, in a
  /// field of several states, maybe the same tile of an earlier state. bad_file: the field has no
  /// such tile, or the chain is too long.
  [[nodiscard]] Result<std::vector<TileKey>> references(const storage::TileRef& tile) const;
  /// Through how many earlier states a tile is predicted. bad_file: more than kMaxChain.
  [[nodiscard]] Result<unsigned> chain(storage::TileRef tile) const;
  /// Finds tiles and, level by level, all that they are predicted from, except those that `skip`.
  /// If `advise`, asks the kernel to read each level's payloads before it reads the references in
  /// them. For a cold file, that takes as many trips to the disk as there are levels. For a remote
  /// file with an index, all are fetched together.
  using Skip = std::function<bool(TileKey)>;
  [[nodiscard]] FoundTiles find(std::span<const TileKey> keys, const Skip& skip = {},
                                bool advise = true) const;

  /// The numbers, in an order, of the tiles that the file has records of; all others are missing.
  /// `state`: of this one, in an order of one state. What loops over a field's tiles loops over
  /// these: a file declares levels for nothing. bad_file: the file has shrunk.
  [[nodiscard]] Result<TileSelection> recorded(const TileOrder& order,
                                               std::optional<unsigned> state = {}) const;

  /// Counts tiles and bytes, of all states or one, from the records' tables alone. Linear in the
  /// number of records.
  [[nodiscard]] Result<FieldContent> content(std::optional<unsigned> state = {}) const;

 private:
  explicit FieldFile(storage::TileStore store) : store_(std::move(store)) {}
  void read_reference_index();
  /// references() without a look at those of the tile of an earlier state.
  [[nodiscard]] Result<std::vector<TileKey>> listed(const storage::TileRef& tile) const;
  /// Advises tiles and all that they are predicted from, by the index of a remote file.
  void advise_together(std::vector<storage::TileRef> tiles) const;

  storage::TileStore store_;
  Manifest manifest_;
  FieldShape shape_of_state_;
  std::unique_ptr<codec::Codec> codec_;
  std::optional<TileCoder> coder_;               // from open() on
  std::vector<ReferenceIndex> reference_index_;  // [level - 1]; those in a remote file's index
  mutable std::array<std::once_flag, 16> geometry_once_;
  mutable std::array<std::unique_ptr<LevelGeometry>, 16> geometries_;
};

/// The fields that a field's tiles are read from: itself or, if it is composed, its structures.
[[nodiscard]] std::vector<Field> sources_of(const Field& field);

}  // namespace slf

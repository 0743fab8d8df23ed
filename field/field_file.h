// FieldFile: the manifest, geometry, codec and tiles behind a Field. field.cc implements both.
#pragma once

#include <array>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
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

/// The open container of a field. A Field is a handle to one. The file is untrusted.
/// Thread-safety: all const members may be called from many threads.
class FieldFile {
 public:
  /// Errors of Field::open(). An incomplete field opens: what was never built is reported as
  /// missing.
  [[nodiscard]] static Result<std::shared_ptr<const FieldFile>> open(const std::string& path);
  /// The same with a container that is open.
  [[nodiscard]] static Result<std::shared_ptr<const FieldFile>> open(storage::TileStore store);

  [[nodiscard]] const std::string& path() const { return store_.path(); }
  [[nodiscard]] const Manifest& manifest() const { return manifest_; }
  [[nodiscard]] const FieldShape& shape() const { return manifest_.shape; }
  [[nodiscard]] const storage::TileStore& store() const { return store_; }

  /// The light of the field's scene, which views the map; no bytes if the field has none. bad_file:
  /// it is damaged.
  [[nodiscard]] Result<ByteSpan> light() const;

  [[nodiscard]] SampleFormat format() const { return manifest_.format; }
  [[nodiscard]] bool has_depth() const { return slf::has_depth(format()); }
  [[nodiscard]] const codec::Codec& codec() const { return *codec_; }

  /// The geometry of a level, computed on first use. REQUIRES: level <= shape().levels.
  [[nodiscard]] const LevelGeometry& geometry(unsigned level) const;

  /// Codes its tiles: the codec, with predictions where it needs them.
  [[nodiscard]] const TileCoder& coder() const { return *coder_; }
  /// The shape of a tile. REQUIRES: a key of this field.
  [[nodiscard]] TileShape tile_shape(TileKey key) const { return coder_->tile_shape(key); }

  /// Checks and decodes a stored tile into exactly tile_shape().bytes() bytes. Code that needs
  /// samples reads them through TileCache, which calls this with references that it keeps.
  /// bad_file: the tile is damaged. Errors of `references` are returned as they are.
  [[nodiscard]] Result<void> decode(const storage::TileRef& tile, const ReferenceSource& references,
                                    std::span<std::byte> samples) const;

  /// Whether tiles are predicted from coarser ones.
  [[nodiscard]] bool predicts() const { return coder_->predicts(); }
  /// The tiles that a stored one is predicted from.
  [[nodiscard]] std::vector<TileKey> references(const storage::TileRef& tile) const {
    return coder_->references(tile.key, tile.payload);
  }
  /// `keys` and all tiles that they are predicted from, directly or through others, ascending.
  [[nodiscard]] Result<std::vector<TileKey>> with_references(std::span<const TileKey> keys) const;
  /// Asks the kernel to read the payloads of stored tiles, then, level by level, of those that they
  /// are predicted from, except those that `loaded`. For a cold file, that takes as many trips to
  /// the disk as there are levels. For a remote file with an index, all of them are fetched
  /// together.
  using IsLoaded = std::function<bool(TileKey)>;
  void advise(std::span<const storage::TileRef> tiles, const IsLoaded& loaded = {}) const;

  /// As TileStore::unchanged(); samples used in place may have been zeros.
  [[nodiscard]] Result<void> unchanged() const { return store_.unchanged(); }

  /// The numbers, in an order, of the tiles that the file has records of; all others are missing.
  /// What loops over a field's tiles loops over these: a file declares levels for nothing.
  /// bad_file: the file has shrunk.
  [[nodiscard]] Result<TileSelection> recorded(const TileOrder& order) const;

  /// Counts tiles and bytes, from the records' tables alone. Linear in the number of records.
  [[nodiscard]] Result<FieldContent> content() const;

 private:
  FieldFile(storage::TileStore store, Manifest manifest)
      : store_(std::move(store)), manifest_(std::move(manifest)) {}

  void read_reference_index();
  /// advise() with the reference index of a remote file: the tiles and all that they are predicted
  /// from, together.
  void advise_together(std::span<const storage::TileRef> tiles) const;
  /// Whether all tiles of the part are there.
  [[nodiscard]] Result<bool> part_is_complete() const;

  storage::TileStore store_;
  Manifest manifest_;
  std::unique_ptr<codec::Codec> codec_;
  std::optional<TileCoder> coder_;               // from open() on
  std::vector<ReferenceIndex> reference_index_;  // [level - 1]; the levels in a remote file's index
  mutable std::array<std::once_flag, 16> geometry_once_;
  mutable std::array<std::unique_ptr<LevelGeometry>, 16> geometry_;
};

}  // namespace slf

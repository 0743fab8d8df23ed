// FieldFile: the manifest, geometry, codecs and tiles behind a Field.
#pragma once

#include <array>
#include <atomic>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "codec/codec.h"
#include "field/geometry/level_geometry.h"
#include "field/manifest.h"
#include "field/predicted_tiles.h"
#include "field/reference_cache.h"
#include "field/reference_index.h"
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
  /// io: missing or unreadable. bad_file: damaged, truncated, not a field. unsupported: a newer
  /// format. An incomplete field opens: what was never built is reported as missing.
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

  /// The shape of a tile. REQUIRES: a key of this field.
  [[nodiscard]] codec::Tile tile_shape(TileKey key) const;

  /// Checks and decodes a stored tile into exactly tile_shape().bytes() bytes. Tiles that it is
  /// predicted from are decoded first. They are kept for others within set_reference_budget(), as
  /// is the tile itself if others may be predicted from it. bad_file: the tile, or one that it is
  /// predicted from, is damaged. tile_missing: one that it is predicted from was never built. The
  /// message names it.
  [[nodiscard]] Result<void> decode(const storage::TileRef& tile,
                                    std::span<std::byte> samples) const;
  /// The same with references from `source`, whose errors it returns as they are.
  [[nodiscard]] Result<void> decode(const storage::TileRef& tile, const ReferenceSource& source,
                                    std::span<std::byte> samples) const;

  /// Whether tiles are predicted from coarser ones.
  [[nodiscard]] bool predicts() const { return prediction_ != nullptr; }
  /// The tiles that a stored one is predicted from.
  [[nodiscard]] std::vector<TileKey> references(const storage::TileRef& tile) const;
  /// `keys` and all tiles that they are predicted from, directly or through others, ascending.
  [[nodiscard]] Result<std::vector<TileKey>> with_references(std::span<const TileKey> keys) const;
  /// The bytes of all payloads that were decoded since the field was opened.
  [[nodiscard]] std::uint64_t decoded_bytes() const { return decoded_bytes_; }

  /// Asks the kernel to read the payloads of stored tiles, then, level by level, of those that they
  /// are predicted from, except those that `loaded`. For a cold file, that takes as many trips to
  /// the disk as there are levels. For a remote file with an index, all of them are fetched
  /// together.
  using IsLoaded = std::function<bool(TileKey)>;
  void advise(std::span<const storage::TileRef> tiles, const IsLoaded& loaded = {}) const;

  /// Codes a tile against this field's tiles of the next coarser level. Errors as decode() of these
  /// tiles. REQUIRES: predicts().
  [[nodiscard]] Result<void> encode(TileKey key, ByteSpan samples, Bytes& payload) const;

  /// Limits the cache of decoded tiles that others are predicted from. The limit is 32 MiB at
  /// first; tiles that are in use come on top.
  void set_reference_budget(std::uint64_t bytes) const;

  /// bad_file: the file has shrunk while it was open; samples used in place may have been zeros.
  [[nodiscard]] Result<void> unchanged() const;

  /// Counts tiles and bytes, from the records' tables alone. Linear in the number of records.
  [[nodiscard]] Result<FieldContent> content() const;

 private:
  FieldFile(storage::TileStore store, Manifest manifest)
      : store_(std::move(store)), manifest_(std::move(manifest)) {}

  storage::TileStore store_;
  Manifest manifest_;
  /// The state that codes predicted tiles.
  struct Prediction {
    PredictedTiles tiles;
    ReferenceCache references;
    std::vector<ReferenceIndex> index;  ///< [level - 1]; the levels in a remote file's index
  };
  void predict();
  void advise_together(std::span<const storage::TileRef> tiles) const;
  /// Whether all tiles of the part are there.
  [[nodiscard]] Result<bool> part_is_complete() const;
  [[nodiscard]] Result<TileSamples> reference(TileKey key) const;
  [[nodiscard]] tl::unexpected<Error> changed() const;
  [[nodiscard]] Result<void> decode_payload(const storage::TileRef& tile,
                                            std::span<std::byte> samples) const;
  /// References from the cache, which `kept` keeps alive.
  [[nodiscard]] ReferenceSource cached(storage::LayerId layer,
                                       std::vector<TileSamples>& kept) const;

  std::unique_ptr<codec::Codec> codec_;
  std::unique_ptr<Prediction> prediction_;  // null if nothing is predicted
  mutable std::atomic<std::uint64_t> decoded_bytes_ = 0;
  mutable std::array<std::once_flag, 16> geometry_once_;
  mutable std::array<std::unique_ptr<LevelGeometry>, 16> geometry_;
};

}  // namespace slf

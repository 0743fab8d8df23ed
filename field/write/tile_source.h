// TileSource: what the tiles of a new field are made from.
//
// | source | has |
// |---|---|
// | TileTracer | samples, traced in scenes |
// | StoredTiles | payloads of a container, to be copied |
// | DecodedTiles | samples of fields, states and composed fields, to be encoded again |
// | CodedTiles | what a codec leaves of another source's samples |
// | KeptTiles | what another source has made before |
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "field/manifest.h"
#include "field/tile_coder.h"
#include "slf/repack.h"
#include "slf/tile_reader.h"
#include "storage/tile_store.h"

namespace slf {

/// What a source has of a tile; reused from tile to tile.
struct SourceTile {
  storage::TileRef ref;  ///< its key and state and, from StoredTiles, the checked payload
  Bytes samples;         ///< of a stored tile, from other sources, with the layout of TileShape
};

/// Thread-safety: any thread.
class TileSource {
 public:
  virtual ~TileSource() = default;
  /// Reads or makes a tile of the new field. Messages of errors name it.
  [[nodiscard]] virtual Result<void> tile(TileKey key, SourceTile& tile) const = 0;
  /// These tiles are wanted next; mapped pages of those before them no longer.
  virtual void prefetch(std::span<const TileKey> /*keys*/) const {}
  /// What a tile of a level takes, in units of progress.
  [[nodiscard]] virtual std::uint64_t work(unsigned /*level*/) const { return 1; }
};

/// The payloads of a container, which must stay open until they are written.
class StoredTiles final : public TileSource {
 public:
  /// `alone`: if one of several states becomes a field of its own, what codes its tiles; else null.
  explicit StoredTiles(storage::TileStore store, const TileCoder* alone = nullptr,
                       unsigned state = 0)
      : store_(std::move(store)), alone_(alone), state_(state) {}

  [[nodiscard]] Result<void> tile(TileKey key, SourceTile& tile) const override;
  void prefetch(std::span<const TileKey> keys) const override;

 private:
  storage::TileStore store_;
  const TileCoder* alone_;
  const unsigned state_;
};

/// The samples of fields, each of which is a state of the new one, in another format. A tile is
/// missing if one that it is predicted from is.
class DecodedTiles final : public TileSource {
 public:
  /// `states` must outlive this. `memory`: bytes of decoded tiles.
  DecodedTiles(std::span<const StateSource> states, SampleFormat format, std::uint64_t memory)
      : states_(states), format_(format), memory_(memory) {}

  [[nodiscard]] Result<void> tile(TileKey key, SourceTile& tile) const override;
  void prefetch(std::span<const TileKey> keys) const override;

 private:
  [[nodiscard]] TileReader reader(std::uint64_t state) const;

  const std::span<const StateSource> states_;
  const SampleFormat format_;
  const std::uint64_t memory_;
  mutable std::mutex mutex_;
  /// States are read one after the other, so two readers are enough: the threads that are ahead may
  /// have begun the next one.
  mutable std::array<std::optional<std::pair<std::uint64_t, TileReader>>, 2> readers_;
};

/// Samples that were encoded, each tile by itself, and decoded: as the tiles that others are
/// predicted from will be, nearly.
class CodedTiles final : public TileSource {
 public:
  /// Both must outlive this.
  CodedTiles(const TileSource& source, const TileCoder& coder) : source_(source), coder_(coder) {}

  [[nodiscard]] Result<void> tile(TileKey key, SourceTile& tile) const override;
  [[nodiscard]] std::uint64_t work(unsigned level) const override { return source_.work(level); }

 private:
  const TileSource& source_;
  const TileCoder& coder_;
};

/// Keeps tiles of a source that takes long, so that it makes them once: those that a codec is
/// fitted to are written later.
class KeptTiles final : public TileSource {
 public:
  /// `source` must outlive this. `memory`: bytes of samples that are kept; tiles that take less
  /// work may use a smaller share of them.
  KeptTiles(const TileSource& source, std::uint64_t memory) : source_(source), memory_(memory) {}

  [[nodiscard]] Result<void> tile(TileKey key, SourceTile& tile) const override;
  void prefetch(std::span<const TileKey> keys) const override { source_.prefetch(keys); }
  [[nodiscard]] std::uint64_t work(unsigned level) const override { return source_.work(level); }
  /// From now on each tile is asked for once more, so a tile that is kept is moved out, and none is
  /// added. Not while another thread asks for tiles.
  void stop_keeping() { keeps_ = false; }

 private:
  const TileSource& source_;
  const std::uint64_t memory_;
  bool keeps_ = true;
  mutable std::mutex mutex_;
  mutable std::uint64_t bytes_ = 0, most_ = 1;  // most_: the work of a tile
  mutable std::map<TileKey, SourceTile> kept_;
};

}  // namespace slf

// TileCoder: codes the tiles of a field with its codec. If that predicts, it makes the predictions
// of tiles of level l > 0 from their references, decoded tiles of level l - 1 that their payloads
// name (FORMAT.md, "The predictive codec"). In a field of several states, parts of a tile may be
// predicted from the same tile of an earlier state instead, which is one of the references then.
// The caller finds and decodes these:
//
//   for (const TileKey reference : coder.references(key, payload))
//     from.push_back({reference, ...});  // its samples
//   coder.decode(key, payload, from, samples);
//
// Thread-safety: immutable.
#pragma once

#include <functional>
#include <span>
#include <vector>

#include "codec/codec.h"
#include "field/geometry/level_geometry.h"
#include "field/predict/references.h"
#include "slf/error.h"
#include "slf/shape.h"

namespace slf {

/// A tile that another is predicted from, and its decoded samples; no bytes if it is empty.
struct ReferenceSamples {
  TileKey tile;
  ByteSpan samples;
};

class TileCoder {
 public:
  using Geometries = std::function<const LevelGeometry&(unsigned level)>;

  /// The codec must outlive this. `geometries` may be called from many threads. `keeps_rays`:
  /// whether tiles may keep rays of earlier states, if the codec can.
  TileCoder(const FieldShape& shape, SampleFormat format, const codec::Codec& codec,
            Geometries geometries, bool several_states = false, bool keeps_rays = false)
      : shape_(shape),
        format_(format),
        codec_(codec),
        geometries_(std::move(geometries)),
        several_states_(several_states && codec.predicts()),
        keeps_rays_(keeps_rays && codec.keeps_rays()) {}

  [[nodiscard]] TileShape tile_shape(TileKey key) const {
    return geometries_(key.level).tile(sections_of(key, shape_.entry_extra_levels).entry.index,
                                       format_);
  }

  /// Whether tiles are predicted from coarser ones.
  [[nodiscard]] bool predicts() const { return codec_.predicts(); }

  /// Whether payloads of tiles may name an earlier state.
  [[nodiscard]] bool uses_states() const { return several_states_; }

  /// The tiles that an untrusted payload names. The field may not have such a tile.
  [[nodiscard]] std::vector<TileKey> references(TileKey key, ByteSpan payload) const;
  /// The untrusted payload of a tile of state 0, as a field of that state alone has it.
  [[nodiscard]] Result<ByteSpan> without_states(TileKey key, ByteSpan payload) const;
  /// Decodes an untrusted payload into `samples`, which has exactly the tile's size. `from`: all
  /// that the payload names. bad_file: the payload is damaged, or names others.
  [[nodiscard]] Result<void> decode(TileKey key, ByteSpan payload,
                                    std::span<const ReferenceSamples> from,
                                    std::span<std::byte> samples) const;

  /// The tiles of the field's shape that predict enough of these samples to be worth reading.
  [[nodiscard]] std::vector<TileKey> choose(TileKey key, ByteSpan samples) const;
  /// Encodes samples and replaces `payload`, which will name the tiles in `from` that are not
  /// empty. REQUIRES: choose() names these; besides, there may be one that is the same tile of an
  /// earlier state, which is stored and not predicted from another state.
  [[nodiscard]] Result<void> encode(TileKey key, ByteSpan samples,
                                    std::span<const ReferenceSamples> from, Bytes& payload) const;

 private:
  struct Relation;  // of a tile to those that it may be predicted from
  struct Head;      // what a payload says of states
  [[nodiscard]] Result<Head> take_head(TileKey key, ByteSpan& payload) const;
  /// Calls `code` with the prediction, or null at level 0 without an earlier state.
  template <class Code>
  [[nodiscard]] Result<void> predict(TileKey key, const Head& head,
                                     std::span<const ReferenceSamples> from,
                                     const Code& code) const;
  [[nodiscard]] std::vector<std::uint8_t> choose_blocks(TileKey key, ByteSpan samples,
                                                        ByteSpan earlier,
                                                        const codec::Predicted* predicted) const;
  /// The block of each sample, and their number.
  [[nodiscard]] std::pair<std::vector<std::uint32_t>, std::uint32_t> blocks(TileKey key) const;

  [[nodiscard]] bool predicts(TileKey key) const { return predicts() && key.level > 0; }

  const FieldShape shape_;
  const SampleFormat format_;
  const codec::Codec& codec_;
  Geometries geometries_;
  const bool several_states_;
  const bool keeps_rays_;
};

}  // namespace slf

// The layers of a repack's output: which input layers they come from, and their samples.
#pragma once

#include <map>
#include <memory>
#include <optional>
#include <vector>

#include "field/field_file.h"
#include "slf/repack.h"

namespace slf {

/// One layer of the output.
struct OutputLayer {
  std::vector<storage::LayerId> from;  ///< the input layers that have its colour and its depth
  Layer layer;
  std::unique_ptr<codec::Codec> codec;
  bool copy = false;  ///< payloads are copied, not recoded
};

/// A tile of the input, each layer of which is decoded at most once.
class InputTile {
 public:
  /// Begins another tile: forgets the decoded layers.
  void begin(TileKey key) {
    key_ = key;
    decoded_.clear();
  }

  /// The tile's samples in the format of `out`. REQUIRES: the tile is stored in all of out.from.
  /// tile_missing: a tile that it is predicted from is missing. bad_file: the tile is damaged.
  [[nodiscard]] Result<void> samples(const FieldFile& field, const OutputLayer& out,
                                     Bytes& samples);

 private:
  Result<const Bytes*> layer(const FieldFile& field, storage::LayerId id);

  TileKey key_;
  std::map<storage::LayerId, Bytes> decoded_;
};

/// The state of an output's tile: missing if it is missing in any of out.from.
[[nodiscard]] Result<storage::TileState> state_of(const FieldFile& field, const OutputLayer& out,
                                                  TileKey key);

/// The shape of the output. usage: the field does not have a level or subfield.
[[nodiscard]] Result<FieldShape> plan_shape(const FieldFile& field, const RepackOptions& options);

/// Chooses the layers and makes their codecs, with tables fitted to a sample of the field. Errors
/// as repack_field().
[[nodiscard]] Result<std::vector<OutputLayer>> plan_layers(const FieldFile& field,
                                                           const FieldShape& shape,
                                                           const RepackOptions& options);

}  // namespace slf

// What a repack makes of a field: the layers of its output, where they come from, and their
// samples.
#pragma once

#include <map>
#include <memory>
#include <optional>
#include <vector>

#include "field/field_file.h"
#include "slf/repack.h"

namespace slf {

/// One layer of the output and where it comes from.
struct OutputLayer {
  std::vector<storage::LayerId> from;  ///< of colour, of depth or, for both together, of both
  Layer layer;
  std::unique_ptr<codec::Codec> codec;
  bool copy = false;  ///< payloads need no recoding
};

/// A tile of the input, each layer of which is decoded at most once.
class InputTile {
 public:
  /// From here on it is another tile.
  void begin(TileKey key) {
    key_ = key;
    decoded_.clear();
  }

  /// Its samples in the format of an output. REQUIRES: all layers that it comes from are stored.
  /// failed: a tile that it is predicted from is missing. bad_file: it is damaged.
  [[nodiscard]] Result<void> samples(const FieldFile& field, const OutputLayer& out,
                                     Bytes& samples);

 private:
  Result<const Bytes*> layer(const FieldFile& field, storage::LayerId id);

  TileKey key_;
  std::map<storage::LayerId, Bytes> decoded_;
};

/// Whether an output's tile is stored, empty, or missing as long as one is that it comes from.
[[nodiscard]] Result<storage::TileState> state_of(const FieldFile& field, const OutputLayer& out,
                                                  TileKey key);

/// The shape of the output. usage: a level or subfield that the field has not.
[[nodiscard]] Result<FieldShape> plan_shape(const FieldFile& field, const RepackOptions& options);

/// Chooses the layers and makes their codecs, with tables fitted to a sample of the field. Errors
/// as repack_field().
[[nodiscard]] Result<std::vector<OutputLayer>> plan_layers(const FieldFile& field,
                                                           const FieldShape& shape,
                                                           const RepackOptions& options);

}  // namespace slf

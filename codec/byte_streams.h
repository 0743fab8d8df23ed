// Byte streams: converts residuals in lanes to byte strings that zstd compresses well, and back.
//
// A stream has one byte per sample in the order group, column, lane. Group g is the pictures 16g to
// 16g + 15, or fewer in the last group. Samples with zero coverage are left out.
#pragma once

#include <cstdint>

#include "base/bytes.h"
#include "codec/codec.h"
#include "codec/lanes.h"
#include "slf/error.h"

namespace slf::codec {

[[nodiscard]] inline std::size_t group_count(const TileShape& tile) {
  return (tile.rows() + kLaneCount - 1) / kLaneCount;
}

/// How many pictures a group has, 1..kLaneCount.
[[nodiscard]] inline std::size_t lanes_of(const TileShape& tile, std::size_t group) {
  const std::size_t left = tile.rows() - group * kLaneCount;
  return left < kLaneCount ? left : kLaneCount;
}

/// The channels of a tile that are predicted together. Values and residuals are
/// [group][channel][column].
struct LaneStack {
  TileShape tile;
  LaneGroup group;             ///< the same for every group
  const LaneValues* coverage;  ///< [group][column]; null if all samples are stored
  std::size_t stored;          ///< how many samples of a channel are stored

  LaneStack(const TileShape& of_tile, const LaneGroup& of_group, const LaneValues* covered_by);

  [[nodiscard]] std::size_t channels() const { return group.channels.size(); }
  /// The offset of channel 0 of a group in values or residuals.
  [[nodiscard]] std::size_t offset(std::size_t of_group) const {
    return of_group * channels() * tile.columns();
  }
  [[nodiscard]] const LaneValues* coverage_of(std::size_t of_group) const {
    return coverage ? coverage + of_group * tile.columns() : nullptr;
  }
};

/// A stack of one channel that is flat almost everywhere and has sharp edges: alpha or depth.
[[nodiscard]] LaneStack single_stack(const TileShape& tile, std::uint32_t bits);

/// Predicts and appends all channels, channels 1 and 2 as a pair if `paired`. `residuals` is
/// scratch of the size of `values`.
[[nodiscard]] Result<void> append_stack(const LaneStack& stack, const LaneValues* values,
                                        LaneValues* residuals, bool paired, int level,
                                        Bytes& payload);

/// Undoes append_stack and removes the bytes it read from the front of `payload`; untrusted.
[[nodiscard]] Result<void> read_stack(const LaneStack& stack, bool paired, ByteSpan& payload,
                                      LaneValues* residuals, LaneValues* values);

}  // namespace slf::codec

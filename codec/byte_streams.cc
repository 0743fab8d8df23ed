#include "codec/byte_streams.h"

#include <algorithm>
#include <array>

#include "base/per_thread.h"
#include "base/try.h"
#include "codec/scratch.h"
#include "codec/zstd_frame.h"

namespace slf::codec {
namespace {

// Each pair of residuals from -kPairReach to kPairReach has a symbol. All other pairs share the
// next symbol, and their residuals follow in a stream of their own.
constexpr int kPairReach = 7;
constexpr int kPairSide = 2 * kPairReach + 1;
constexpr std::uint8_t kPairEscape = kPairSide * kPairSide;

using Pair = std::array<std::uint8_t, 2>;

// The pair of every symbol; zeros for the escape and for invalid symbols.
constexpr std::array<Pair, 256> make_pairs() {
  std::array<Pair, 256> pairs{};
  for (int symbol = 0; symbol < kPairEscape; ++symbol)
    pairs[static_cast<std::size_t>(symbol)] = {
        static_cast<std::uint8_t>(symbol / kPairSide - kPairReach),
        static_cast<std::uint8_t>(symbol % kPairSide - kPairReach)};
  return pairs;
}
constexpr std::array<Pair, 256> kPairs = make_pairs();

std::uint8_t pair_symbol(std::uint16_t first, std::uint16_t second) {
  const int a = static_cast<std::int8_t>(first) + kPairReach;
  const int b = static_cast<std::int8_t>(second) + kPairReach;
  if (a < 0 || a >= kPairSide || b < 0 || b >= kPairSide) return kPairEscape;
  return static_cast<std::uint8_t>(a * kPairSide + b);
}

// How many lanes have no coverage.
unsigned uncovered(const LaneValues& coverage) {
  unsigned count = 0;
  for (const std::uint16_t value : coverage) count += value == 0 ? 1 : 0;
  return count;
}

// Calls use(group, column, lane) for every stored sample, in stream order, but use_all(group,
// column) for columns in which all lanes are stored, so that its loop has constant length.
template <class UseAll, class Use>
void for_each_stored(const LaneStack& stack, UseAll use_all, Use use) {
  const std::size_t columns = stack.tile.columns();
  for (std::size_t group = 0; group < group_count(stack.tile); ++group) {
    const std::size_t lanes = lanes_of(stack.tile, group);
    const LaneValues* coverage = stack.coverage_of(group);
    for (std::size_t column = 0; column < columns; ++column) {
      if (lanes == kLaneCount && (!coverage || uncovered(coverage[column]) == 0)) {
        use_all(group, column);
        continue;
      }
      for (std::size_t lane = 0; lane < lanes; ++lane)
        if (!coverage || coverage[column][lane] != 0) use(group, column, lane);
    }
  }
}

template <class Use>
void for_each_stored(const LaneStack& stack, Use use) {
  const auto use_all = [&](std::size_t group, std::size_t column) {
    for (std::size_t lane = 0; lane < kLaneCount; ++lane) use(group, column, lane);
  };
  for_each_stored(stack, use_all, use);
}

// The residuals of channel 1 in a column of a group. Those of channel 2 are one channel further.
template <class Values>
Values* pair_of(const LaneStack& stack, Values* residuals, std::size_t group, std::size_t column) {
  return residuals + stack.offset(group) + stack.tile.columns() + column;
}

// Appends one zstd frame per byte of a channel's residuals, least significant byte first.
Result<void> append_channel(const LaneStack& stack, std::size_t channel,
                            const LaneValues* residuals, int level, Bytes& payload) {
  auto& scratch = per_thread<Scratch<std::uint8_t>>([] {});
  const std::span<std::uint8_t> stream = scratch.take(stack.stored);
  for (unsigned shift = 0; shift < stack.group.bits; shift += 8) {
    std::uint8_t* to = stream.data();
    for_each_stored(stack, [&](std::size_t group, std::size_t column, std::size_t lane) {
      const std::size_t at = stack.offset(group) + channel * stack.tile.columns() + column;
      *to++ = static_cast<std::uint8_t>(residuals[at][lane] >> shift);
    });
    SLF_TRY(append_stream(std::as_bytes(stream), level, payload));
  }
  return {};
}

// Undoes append_channel and removes the bytes it read from the front of `payload`; untrusted.
Result<void> read_channel(const LaneStack& stack, std::size_t channel, ByteSpan& payload,
                          LaneValues* residuals) {
  auto& scratch = per_thread<Scratch<std::uint8_t>>([] {});
  const std::span<std::uint8_t> stream = scratch.take(stack.stored);
  const std::size_t columns = stack.tile.columns();
  for (std::size_t group = 0; group < group_count(stack.tile); ++group)
    std::fill_n(residuals + stack.offset(group) + channel * columns, columns, LaneValues{});
  for (unsigned shift = 0; shift < stack.group.bits; shift += 8) {
    SLF_TRY(read_stream(payload, std::as_writable_bytes(stream)));
    const std::uint8_t* from = stream.data();
    const auto at = [&](std::size_t group, std::size_t column) -> LaneValues& {
      return residuals[stack.offset(group) + channel * columns + column];
    };
    for_each_stored(
        stack,
        [&](std::size_t group, std::size_t column) {
          LaneValues& to = at(group, column);
          for (std::size_t i = 0; i < kLaneCount; ++i)
            to[i] = static_cast<std::uint16_t>(to[i] | from[i] << shift);
          from += kLaneCount;
        },
        [&](std::size_t group, std::size_t column, std::size_t lane) {
          std::uint16_t& to = at(group, column)[lane];
          to = static_cast<std::uint16_t>(to | *from++ << shift);
        });
  }
  return {};
}

// Appends channels 1 and 2 as one stream of pairs. Their residuals are small and need little more
// than one bit each, while a Huffman code spends at least one bit per symbol.
Result<void> append_pair(const LaneStack& stack, const LaneValues* residuals, int level,
                         Bytes& payload) {
  auto& symbol_scratch = per_thread<Scratch<std::uint8_t>>([] {});
  auto& escape_scratch = per_thread<Scratch<std::uint8_t>>([] {});
  const std::span<std::uint8_t> symbols = symbol_scratch.take(stack.stored);
  const std::span<std::uint8_t> escapes = escape_scratch.take(2 * symbols.size());
  const std::size_t columns = stack.tile.columns();
  std::uint8_t* to = symbols.data();
  std::size_t escaped = 0;
  for_each_stored(stack, [&](std::size_t group, std::size_t column, std::size_t lane) {
    const LaneValues* pair = pair_of(stack, residuals, group, column);
    const std::uint16_t first = pair[0][lane], second = pair[columns][lane];
    const std::uint8_t symbol = pair_symbol(first, second);
    *to++ = symbol;
    if (symbol != kPairEscape) return;
    escapes[escaped++] = static_cast<std::uint8_t>(first);
    escapes[escaped++] = static_cast<std::uint8_t>(second);
  });
  SLF_TRY(append_stream(std::as_bytes(symbols), level, payload));
  return append_stream(std::as_bytes(escapes.first(escaped)), level, payload);
}

// Undoes append_pair and removes the bytes it read from the front of `payload`; untrusted.
Result<void> read_pair(const LaneStack& stack, ByteSpan& payload, LaneValues* residuals) {
  auto& symbol_scratch = per_thread<Scratch<std::uint8_t>>([] {});
  auto& escape_scratch = per_thread<Scratch<std::uint8_t>>([] {});
  const std::span<std::uint8_t> symbols = symbol_scratch.take(stack.stored);
  SLF_TRY(read_stream(payload, std::as_writable_bytes(symbols)));
  const auto escaped =
      static_cast<std::size_t>(std::count(symbols.begin(), symbols.end(), kPairEscape));
  const std::span<std::uint8_t> escapes = escape_scratch.take(2 * escaped);
  SLF_TRY(read_stream(payload, std::as_writable_bytes(escapes)));
  if (std::any_of(symbols.begin(), symbols.end(), [](auto s) { return s > kPairEscape; }))
    return bad_file("zstd", "a symbol that does not exist");

  const std::size_t columns = stack.tile.columns();
  const std::uint8_t* from = symbols.data();
  const std::uint8_t* escape = escapes.data();
  const auto read_one = [&](LaneValues* pair, std::size_t lane) {
    const std::uint8_t symbol = *from++;
    const Pair values = symbol == kPairEscape ? Pair{escape[0], escape[1]} : kPairs[symbol];
    if (symbol == kPairEscape) escape += 2;
    pair[0][lane] = values[0];
    pair[columns][lane] = values[1];
  };
  for (std::size_t group = 0; group < group_count(stack.tile); ++group)
    std::fill_n(pair_of(stack, residuals, group, 0), 2 * columns, LaneValues{});
  for_each_stored(
      stack,
      [&](std::size_t group, std::size_t column) {
        LaneValues* pair = pair_of(stack, residuals, group, column);
        for (std::size_t lane = 0; lane < kLaneCount; ++lane) read_one(pair, lane);
      },
      [&](std::size_t group, std::size_t column, std::size_t lane) {
        read_one(pair_of(stack, residuals, group, column), lane);
      });
  return {};
}

// The median predictor suits alpha, which is flat almost everywhere and has sharp edges.
constexpr ChannelPredictor kMedian;

}  // namespace

LaneStack::LaneStack(const TileShape& of_tile, const LaneGroup& of_group,
                     const LaneValues* covered_by)
    : tile(of_tile), group(of_group), coverage(covered_by), stored(tile.rows() * tile.columns()) {
  if (!coverage) return;
  stored = 0;
  // Lanes without a picture have no coverage.
  for (std::size_t i = 0; i < group_count(tile) * tile.columns(); ++i)
    stored += kLaneCount - uncovered(coverage[i]);
}

LaneStack single_stack(const TileShape& tile, std::uint32_t bits) {
  return LaneStack(tile, {tile.side, bits, {&kMedian, 1}}, nullptr);
}

Result<void> append_stack(const LaneStack& stack, const LaneValues* values, LaneValues* residuals,
                          bool paired, int level, Bytes& payload) {
  for (std::size_t group = 0; group < group_count(stack.tile); ++group)
    predict(stack.group, values + stack.offset(group), stack.coverage_of(group),
            residuals + stack.offset(group));
  const std::size_t singles = paired ? 1 : stack.channels();
  for (std::size_t channel = 0; channel < singles; ++channel)
    SLF_TRY(append_channel(stack, channel, residuals, level, payload));
  if (paired) return append_pair(stack, residuals, level, payload);
  return {};
}

Result<void> read_stack(const LaneStack& stack, bool paired, ByteSpan& payload,
                        LaneValues* residuals, LaneValues* values) {
  const std::size_t singles = paired ? 1 : stack.channels();
  for (std::size_t channel = 0; channel < singles; ++channel)
    SLF_TRY(read_channel(stack, channel, payload, residuals));
  if (paired) SLF_TRY(read_pair(stack, payload, residuals));
  for (std::size_t group = 0; group < group_count(stack.tile); ++group)
    restore(stack.group, residuals + stack.offset(group), values + stack.offset(group));
  return {};
}

}  // namespace slf::codec

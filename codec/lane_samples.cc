#include "codec/lane_samples.h"

#include <algorithm>

#include "base/half.h"
#include "base/per_thread.h"
#include "base/try.h"
#include "codec/byte_streams.h"
#include "codec/scratch.h"

namespace slf::codec {
namespace {

// Differences of halves are centred on this value, so that small ones of either sign do not wrap.
constexpr std::uint16_t kDifferenceOrigin = 0x8000;

// Values in lanes are those of ordered_half() modulo 2^16.
std::uint16_t from_ordered(std::uint16_t value) {
  return half_of_ordered(static_cast<std::int16_t>(value));
}

// One group of a tile: its lanes, and the samples of its first picture.
template <class Values, class Byte>
struct Group {
  std::size_t columns;
  std::size_t lanes;
  Values* alpha;
  Values* color;
  Byte* samples;

  Values& channel(std::size_t index, std::size_t column) const {
    return color[index * columns + column];
  }
};
using Loading = Group<LaneValues, const std::byte>;
using Storing = Group<const LaneValues, std::byte>;

template <class To, class Values, class Byte>
To group_of(const TileShape& tile, std::size_t index, Values* alpha, Values* color, Byte* colors) {
  const std::size_t columns = tile.columns();
  return {columns, lanes_of(tile, index), alpha + index * columns,
          color + index * columns * kColorChannels,
          colors + index * kLaneCount * columns * color_bytes(tile.format)};
}

void load_rgba8(const Loading& group) {
  const std::byte* from = group.samples;
  for (std::size_t lane = 0; lane < group.lanes; ++lane)
    for (std::size_t i = 0; i < group.columns; ++i, from += 4) {
      group.channel(0, i)[lane] = std::to_integer<std::uint8_t>(from[1]);
      group.channel(1, i)[lane] = std::to_integer<std::uint8_t>(from[0]);
      group.channel(2, i)[lane] = std::to_integer<std::uint8_t>(from[2]);
      group.alpha[i][lane] = std::to_integer<std::uint8_t>(from[3]);
    }
}

void load_rgba16f(const Loading& group) {
  const std::byte* from = group.samples;
  for (std::size_t lane = 0; lane < group.lanes; ++lane)
    for (std::size_t i = 0; i < group.columns; ++i, from += 8) {
      const auto at = [&](std::size_t c) {
        return static_cast<std::uint16_t>(ordered_half(load_le<std::uint16_t>(from + 2 * c)));
      };
      const int green = at(1);
      group.channel(0, i)[lane] = static_cast<std::uint16_t>(green);
      group.channel(1, i)[lane] = static_cast<std::uint16_t>(at(0) - green + kDifferenceOrigin);
      group.channel(2, i)[lane] = static_cast<std::uint16_t>(at(2) - green + kDifferenceOrigin);
      group.alpha[i][lane] = at(3);
    }
}

void store_rgba8(const Storing& group, bool clear) {
  for (std::size_t i = 0; i < group.columns; ++i) {
    std::uint32_t pixels[kLaneCount];
    for (std::size_t lane = 0; lane < kLaneCount; ++lane) {
      const std::uint32_t g = group.channel(0, i)[lane], r = group.channel(1, i)[lane],
                          b = group.channel(2, i)[lane], a = group.alpha[i][lane];
      pixels[lane] = clear && a == 0 ? 0 : r | g << 8 | b << 16 | a << 24;
    }
    std::byte* to = group.samples + i * 4;
    for (std::size_t lane = 0; lane < group.lanes; ++lane, to += group.columns * 4)
      store_le(to, pixels[lane]);
  }
}

void store_rgba16f(const Storing& group, bool clear) {
  for (std::size_t i = 0; i < group.columns; ++i)
    for (std::size_t lane = 0; lane < group.lanes; ++lane) {
      const int green = group.channel(0, i)[lane];
      const auto plus_green = [&](std::size_t c) {
        return static_cast<std::uint16_t>(group.channel(c, i)[lane] + green - kDifferenceOrigin);
      };
      const bool empty = clear && group.alpha[i][lane] == 0;
      const std::uint64_t r = empty ? 0 : from_ordered(plus_green(1));
      const std::uint64_t g = empty ? 0 : from_ordered(static_cast<std::uint16_t>(green));
      const std::uint64_t b = empty ? 0 : from_ordered(plus_green(2));
      const std::uint64_t a = from_ordered(group.alpha[i][lane]);
      store_le(group.samples + (lane * group.columns + i) * 8, r | g << 16 | b << 32 | a << 48);
    }
}
// Lanes without a picture become 0.
void clear_unused(const TileShape& tile, std::size_t channels, LaneValues* values) {
  if (tile.rows() % kLaneCount == 0) return;
  const std::size_t size = channels * tile.columns();
  std::fill_n(values + (group_count(tile) - 1) * size, size, LaneValues{});
}

// A channel of bytes in lanes, [group][column]; each thread keeps one.
struct ByteLanes {
  LaneValues* values;
  LaneValues* residuals;

  explicit ByteLanes(const TileShape& tile) {
    auto& scratch = per_thread<Scratch<LaneValues>>([] {});
    const std::size_t one = group_count(tile) * tile.columns();
    values = scratch.take(2 * one).data();
    residuals = values + one;
  }
};

void load_bytes(const TileShape& tile, const std::byte* bytes, LaneValues* values) {
  clear_unused(tile, 1, values);
  const std::size_t columns = tile.columns();
  for (std::size_t row = 0; row < tile.rows(); ++row)
    for (std::size_t i = 0; i < columns; ++i)
      values[row / kLaneCount * columns + i][row % kLaneCount] =
          std::to_integer<std::uint8_t>(*bytes++);
}

void store_bytes(const TileShape& tile, const LaneValues* values, std::byte* bytes) {
  const std::size_t columns = tile.columns();
  for (std::size_t row = 0; row < tile.rows(); ++row)
    for (std::size_t i = 0; i < columns; ++i)
      *bytes++ = static_cast<std::byte>(values[row / kLaneCount * columns + i][row % kLaneCount]);
}

}  // namespace

void load_colors(const TileShape& tile, const std::byte* colors, LaneValues* alpha,
                 LaneValues* color) {
  clear_unused(tile, 1, alpha);
  clear_unused(tile, kColorChannels, color);
  for (std::size_t index = 0; index < group_count(tile); ++index) {
    const auto group = group_of<Loading>(tile, index, alpha, color, colors);
    is_half(tile.format) ? load_rgba16f(group) : load_rgba8(group);
  }
}

void store_colors(const TileShape& tile, bool clear, const LaneValues* alpha,
                  const LaneValues* color, std::byte* colors) {
  for (std::size_t index = 0; index < group_count(tile); ++index) {
    const auto group = group_of<Storing>(tile, index, alpha, color, colors);
    is_half(tile.format) ? store_rgba16f(group, clear) : store_rgba8(group, clear);
  }
}

Result<void> append_bytes(const TileShape& tile, ByteSpan bytes, int level, Bytes& payload) {
  const ByteLanes lanes(tile);
  load_bytes(tile, bytes.data(), lanes.values);
  return append_stack(single_stack(tile, 8), lanes.values, lanes.residuals, false, level, payload);
}

Result<void> read_bytes(const TileShape& tile, ByteSpan& payload, std::span<std::byte> bytes) {
  const ByteLanes lanes(tile);
  SLF_TRY(read_stack(single_stack(tile, 8), false, payload, lanes.residuals, lanes.values));
  store_bytes(tile, lanes.values, bytes.data());
  return {};
}

}  // namespace slf::codec

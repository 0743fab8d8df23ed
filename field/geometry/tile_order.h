// TileOrder: numbers all tiles of a field from 0 on, in key order.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "field/geometry/section.h"
#include "field/geometry/tile_selection.h"
#include "slf/shape.h"

namespace slf {

/// The smallest key of a level. The keys of the level are those from it up to, but not including,
/// first_key(level + 1).
[[nodiscard]] constexpr TileKey first_key(unsigned level) {
  return {static_cast<std::uint8_t>(level), 0};
}

/// The keys of one state on a level.
[[nodiscard]] constexpr TileRange keys_of(unsigned level, unsigned state) {
  return {in_state(first_key(level), state), in_state(first_key(level), state + 1)};
}
/// These tiles of another state.
[[nodiscard]] inline std::vector<TileKey> in_state(std::span<const TileKey> keys, unsigned state) {
  std::vector<TileKey> others(keys.begin(), keys.end());
  for (TileKey& key : others) key = in_state(key, state);
  return others;
}

/// The keys of all tiles of a field.
[[nodiscard]] inline TileRange all_keys(const FieldShape& shape) {
  return {first_key(0), first_key(shape.finest_level + 1)};
}

class TileOrder {
 public:
  explicit TileOrder(const FieldShape& shape) : shape_(shape) {
    for (unsigned level = 0; level <= shape.finest_level; ++level) {
      first_.push_back(count_);
      count_ += shape.tiles(level);
    }
  }

  [[nodiscard]] std::uint64_t count() const { return count_; }

  /// The key of a tile by its number. REQUIRES: number < count().
  [[nodiscard]] TileKey key(std::uint64_t number) const {
    std::size_t level = first_.size() - 1;
    while (first_[level] > number) --level;
    const auto l = static_cast<unsigned>(level);
    const std::uint64_t tiles = shape_.tiles(l) / shape_.states;
    const std::uint64_t state = (number - first_[level]) / tiles;
    std::uint64_t index = (number - first_[level]) % tiles;
    if (!shape_.subfields.empty()) {
      const unsigned bits = subfield_bits(l);
      index = std::uint64_t{shape_.subfields[index >> bits]} << bits |
              (index & ((std::uint64_t{1} << bits) - 1));
    }
    return in_state({static_cast<std::uint8_t>(l), index}, state);
  }

  /// The same for number == count(), too: the end of all keys.
  [[nodiscard]] TileKey key_or_end(std::uint64_t number) const {
    return number < count_ ? key(number) : first_key(shape_.finest_level + 1);
  }

  /// The number of the first tile of a level. The number of tiles for the level after the last.
  [[nodiscard]] std::uint64_t first_number(unsigned level) const {
    return level < first_.size() ? first_[level] : count_;
  }
  /// The numbers of the tiles of a level.
  [[nodiscard]] NumberRange level(unsigned level) const {
    return {first_number(level), first_number(level + 1)};
  }

  /// The number of the first tile whose key is not below `key`; count() if there is none.
  [[nodiscard]] std::uint64_t number(TileKey key) const {
    std::uint64_t low = 0, high = count_;
    while (low < high) {
      const std::uint64_t middle = low + (high - low) / 2;
      if (this->key(middle) < key)
        low = middle + 1;
      else
        high = middle;
    }
    return low;
  }

 private:
  /// Bits of an index below its level-0 subfield.
  [[nodiscard]] unsigned subfield_bits(unsigned level) const {
    return 4 * level + 2 * shape_.entry_extra_levels;
  }

  FieldShape shape_;
  std::vector<std::uint64_t> first_;
  std::uint64_t count_ = 0;
};

/// The shape of one state. The numbers in its order are *positions* of the field, each with a tile
/// in every state. Parts of a field are ranges of positions.
[[nodiscard]] inline FieldShape one_state(FieldShape shape) {
  shape.states = 1;
  return shape;
}

/// Calls use(k, numbers) for each level, state and range k of positions, if there are any, in key
/// order: `numbers` are those of the tiles there. REQUIRES: the ranges are ascending.
template <class Ranges, class Use>
void for_each_state(const FieldShape& shape, const Ranges& positions, const Use& use) {
  const TileOrder order(one_state(shape));
  for (unsigned level = 0; level <= shape.finest_level; ++level)
    for (std::uint64_t state = 0; state < shape.states; ++state) {
      const NumberRange all = order.level(level);
      const std::uint64_t before = (shape.states - 1) * all.begin + state * all.count();
      for (std::size_t k = 0; k < positions.size(); ++k)
        if (const NumberRange own = positions[k].within(all); own.count() > 0)
          use(k, NumberRange{before + own.begin, before + own.end});
    }
}

}  // namespace slf

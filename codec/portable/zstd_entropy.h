// The entropy codes of zstd (RFC 8878): finite-state entropy and Huffman codes, read backwards.
// All input is untrusted: functions return false if it is damaged.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <span>

#include "base/bytes.h"

namespace slf::codec::zstd {

inline constexpr int kMaxHuffmanBits = 11;
inline constexpr int kMaxFseBits = 9;

/// Reads fields of bits from the end of some bytes to their start. Bits before the start are zeros.
class BackwardBits {
 public:
  BackwardBits() = default;
  /// The highest bit that is set marks the end. Returns false if no bit is set.
  bool open(ByteSpan bytes) {
    bytes_ = bytes;
    if (bytes.empty() || bytes.back() == std::byte{0}) return false;
    left_ = static_cast<std::ptrdiff_t>(bytes.size() * 8) -
            std::countl_zero(std::to_integer<std::uint8_t>(bytes.back())) - 1;
    return true;
  }
  /// How many bits are left; below 0 after reading too many.
  [[nodiscard]] std::ptrdiff_t left() const { return left_; }
  /// REQUIRES: n <= 32.
  [[nodiscard]] std::uint64_t peek(int n) const {
    const std::uint64_t mask = (std::uint64_t{1} << n) - 1;
    if (left_ >= n) return word(static_cast<std::size_t>(left_ - n)) & mask;
    if (left_ <= 0) return 0;
    return word(0) << (n - left_) & mask;
  }
  void skip(int n) { left_ -= n; }
  std::uint64_t read(int n) {
    const std::uint64_t value = peek(n);
    left_ -= n;
    return value;
  }

 private:
  /// At least 57 bits from a position on; zeros after the end.
  [[nodiscard]] std::uint64_t word(std::size_t bit) const {
    const std::size_t at = bit / 8;
    if (at + 8 <= bytes_.size()) return load_le<std::uint64_t>(&bytes_[at]) >> (bit % 8);
    std::uint64_t value = 0;
    for (std::size_t i = at; i < bytes_.size(); ++i)
      value |= std::uint64_t{std::to_integer<std::uint8_t>(bytes_[i])} << (8 * (i - at));
    return value >> (bit % 8);
  }

  ByteSpan bytes_;
  std::ptrdiff_t left_ = 0;
};

/// A table of finite-state entropy codes.
struct FseTable {
  struct Entry {
    std::uint8_t symbol = 0;
    std::uint8_t bits = 0;
    std::uint16_t base = 0;
  };
  std::array<Entry, 1 << kMaxFseBits> entries;
  int log = -1;  ///< -1: none

  void set_single(std::uint8_t symbol) {
    log = 0;
    entries[0] = {symbol, 0, 0};
  }

  /// `counts` are those of section 4.1.1; -1 means less than one.
  void build(std::span<const int> counts, int accuracy) {
    log = accuracy;
    const int size = 1 << log;
    int high = size - 1;
    std::array<std::uint16_t, 256> next{};
    for (std::size_t s = 0; s < counts.size(); ++s)
      if (counts[s] == -1) {
        entries[static_cast<std::size_t>(high--)].symbol = static_cast<std::uint8_t>(s);
        next[s] = 1;
      } else {
        next[s] = static_cast<std::uint16_t>(counts[s]);
      }
    const int step = (size >> 1) + (size >> 3) + 3;
    int at = 0;
    for (std::size_t s = 0; s < counts.size(); ++s)
      for (int i = 0; i < counts[s]; ++i) {
        entries[static_cast<std::size_t>(at)].symbol = static_cast<std::uint8_t>(s);
        do at = (at + step) & (size - 1);
        while (at > high);
      }
    for (int i = 0; i < size; ++i) {
      Entry& entry = entries[static_cast<std::size_t>(i)];
      const unsigned state = next[entry.symbol]++;
      entry.bits = static_cast<std::uint8_t>(log - (std::bit_width(state) - 1));
      entry.base = static_cast<std::uint16_t>((state << entry.bits) - static_cast<unsigned>(size));
    }
  }

  /// Reads a description and removes it from `bytes`. False: it is damaged.
  bool read(ByteSpan& bytes, int max_log, std::size_t max_symbols) {
    std::size_t bit = 0;
    const auto take = [&](int n) {
      unsigned value = 0;
      for (int i = 0; i < n; ++i, ++bit)
        if (bit / 8 < bytes.size())
          value |= (std::to_integer<unsigned>(bytes[bit / 8]) >> (bit % 8) & 1u) << i;
      return static_cast<int>(value);
    };
    const int accuracy = take(4) + 5;
    if (accuracy > max_log) return false;
    std::array<int, 256> counts{};
    std::size_t symbols = 0;
    int left = (1 << accuracy) + 1;
    while (left > 1) {
      if (symbols >= max_symbols || bit > bytes.size() * 8) return false;
      const int bits = std::bit_width(static_cast<unsigned>(left));
      const int few = (1 << bits) - 1 - left;  // values that need one bit less
      int value = take(bits - 1);
      if (value >= few) {
        value |= take(1) << (bits - 1);
        if (value >= 1 << (bits - 1)) value -= few;
      }
      const int count = value - 1;
      counts[symbols++] = count;
      left -= count < 0 ? 1 : count;
      if (left < 1) return false;
      if (count != 0) continue;
      for (int repeat = 3; repeat == 3;) {
        repeat = take(2);
        symbols += static_cast<std::size_t>(repeat);
        if (symbols > max_symbols || bit > bytes.size() * 8) return false;
      }
    }
    const std::size_t used = (bit + 7) / 8;
    if (used > bytes.size()) return false;
    bytes = bytes.subspan(used);
    build(std::span(counts).first(symbols), accuracy);
    return true;
  }
};

/// A table of Huffman codes, whose description may itself be coded.
struct HuffmanTable {
  struct Entry {
    std::uint8_t symbol = 0;
    std::uint8_t bits = 0;
  };
  std::array<Entry, 1 << kMaxHuffmanBits> entries;
  int log = 0;  ///< 0: none

  /// Reads a description and removes it from `bytes`. False: it is damaged.
  bool read(ByteSpan& bytes) {
    if (bytes.empty()) return false;
    const auto head = std::to_integer<std::size_t>(bytes[0]);
    bytes = bytes.subspan(1);
    std::array<std::uint8_t, 256> weights{};
    std::size_t count = 0;
    if (head >= 128) {
      count = head - 127;
      if (bytes.size() < (count + 1) / 2) return false;
      for (std::size_t i = 0; i < count; ++i) {
        const auto two = std::to_integer<unsigned>(bytes[i / 2]);
        weights[i] = static_cast<std::uint8_t>(i % 2 == 0 ? two >> 4 : two & 15);
      }
      bytes = bytes.subspan((count + 1) / 2);
    } else {
      if (head > bytes.size()) return false;
      ByteSpan coded = bytes.first(head);
      bytes = bytes.subspan(head);
      if (!read_weights(coded, weights, count)) return false;
    }
    return build(weights, count);
  }

 private:
  /// Two states take turns until the bits are used up.
  static bool read_weights(ByteSpan coded, std::array<std::uint8_t, 256>& weights,
                           std::size_t& count) {
    FseTable table;
    BackwardBits bits;
    if (!table.read(coded, 6, 256) || !bits.open(coded)) return false;
    std::uint64_t state[2];
    for (std::uint64_t& value : state) value = bits.read(table.log);
    if (bits.left() < 0) return false;
    for (int turn = 0;; turn ^= 1) {
      if (count >= 254) return false;
      const FseTable::Entry entry = table.entries[state[turn]];
      weights[count++] = entry.symbol;
      state[turn] = entry.base + bits.read(entry.bits);
      if (bits.left() >= 0) continue;
      weights[count++] = table.entries[state[turn ^ 1]].symbol;
      return true;
    }
  }

  /// The weight of the last symbol makes the sum a power of two.
  bool build(std::array<std::uint8_t, 256>& weights, std::size_t count) {
    std::uint32_t sum = 0;
    for (std::size_t i = 0; i < count; ++i) {
      if (weights[i] > kMaxHuffmanBits) return false;
      if (weights[i] > 0) sum += 1u << (weights[i] - 1);
    }
    if (sum == 0 || count > 255) return false;
    const int bits = std::bit_width(sum);
    const std::uint32_t rest = (1u << bits) - sum;
    if (bits > kMaxHuffmanBits || !std::has_single_bit(rest)) return false;
    weights[count++] = static_cast<std::uint8_t>(std::bit_width(rest));
    log = bits;
    std::size_t at = 0;
    for (int weight = 1; weight <= bits; ++weight)
      for (std::size_t s = 0; s < count; ++s) {
        if (weights[s] != weight) continue;
        const std::size_t run = std::size_t{1} << (weight - 1);
        std::fill_n(
            &entries[at], run,
            Entry{static_cast<std::uint8_t>(s), static_cast<std::uint8_t>(bits + 1 - weight)});
        at += run;
      }
    return true;
  }
};

}  // namespace slf::codec::zstd

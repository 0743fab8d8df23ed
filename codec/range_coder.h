// A binary adaptive range coder, for tiles that the predictive codec codes sample by sample
// (FORMAT.md, "Range coder").
//
// RangeEncoder and RangeDecoder have the same members, so one function template describes a syntax
// for both: bit(model, value) of the encoder codes `value`; that of the decoder ignores `value` and
// returns the decoded one. Decoding is safe on any input: bytes beyond the end read as zeros.
#pragma once

#include <cstdint>

#include "base/bytes.h"

namespace slf::codec {

/// The probability that a binary decision is 1: the mean of two estimates, a fast one that adapts
/// to changes within a tile and a slow one that adapts to its average. In 1/65536, never 0 or 1.
class BitModel {
 public:
  BitModel() = default;
  explicit BitModel(std::uint16_t probability) : both_(probability * 0x10001u) {}

  /// In 1/32768: 1..32767.
  [[nodiscard]] std::uint32_t probability() const {
    return ((both_ >> 16) + (both_ & 0xFFFF)) >> 2;
  }
  /// Moves both estimates towards 0 or 65536. Their sums do not carry.
  void learn(bool bit) {
    if (bit)
      both_ += share_of(0x10000u - both_);  // both estimates, subtracted from 65536
    else
      both_ -= share_of(both_);
  }

 private:
  static constexpr int kFast = 4, kSlow = 7;
  /// 1/16 of the fast estimate and 1/128 of the slow one, rounded down.
  static std::uint32_t share_of(std::uint32_t both) {
    return ((both >> kFast) & 0xFFFF0000u) + ((both & 0xFFFF) >> kSlow);
  }
  // The fast estimate in the upper half, the slow one in the lower: one load, one store.
  std::uint32_t both_ = 0x80008000u;
};

class RangeEncoder {
 public:
  /// Appends to `to`, which must outlive this.
  explicit RangeEncoder(Bytes& to) : to_(to) {}

  bool bit(BitModel& model, bool value) {
    const std::uint32_t one = (range_ >> 15) * model.probability();
    model.learn(value);
    return narrow(one, value);
  }
  /// Codes a decision whose two values are equally likely.
  bool even_bit(bool value) { return narrow(range_ >> 1, value); }

  /// Appends the last bytes: a number in the final range that ends in as many zeros as possible,
  /// without these zeros, which the decoder supplies.
  void finish() {
    low_ = (low_ + 0xFFFFFFu) & ~std::uint64_t{0xFFFFFF};
    for (int k = 0; k < 5; ++k) shift();
    for (int k = 0; k < 4 && to_.back() == std::byte{0}; ++k) to_.pop_back();
  }

 private:
  bool narrow(std::uint32_t one, bool value) {
    if (value) {
      range_ = one;
    } else {
      low_ += one;
      range_ -= one;
    }
    while (range_ < 1u << 24) {
      range_ <<= 8;
      shift();
    }
    return value;
  }
  /// Moves the top byte of `low_` out. A later carry can still turn bytes 0xFF into 0x00 and
  /// increment the byte before them, so that byte is held back and bytes 0xFF are only counted.
  void shift() {
    if (low_ < 0xFF000000u || low_ > 0xFFFFFFFFu) {
      const auto carry = static_cast<std::uint8_t>(low_ >> 32);
      if (has_pending_) to_.push_back(static_cast<std::byte>(pending_byte_ + carry));
      for (; pending_ff_ > 0; --pending_ff_) to_.push_back(static_cast<std::byte>(0xFF + carry));
      pending_byte_ = static_cast<std::uint8_t>(low_ >> 24);
      has_pending_ = true;
    } else {
      ++pending_ff_;
    }
    low_ = (low_ & 0x00FFFFFFu) << 8;
  }

  Bytes& to_;
  std::uint64_t low_ = 0;  // 33 bits
  std::uint32_t range_ = 0xFFFFFFFFu;
  std::uint64_t pending_ff_ = 0;
  std::uint8_t pending_byte_ = 0;
  bool has_pending_ = false;  // whether `pending_byte_` holds a byte
};

class RangeDecoder {
 public:
  /// Views `from`, untrusted.
  explicit RangeDecoder(ByteSpan from) : from_(from) {
    for (int k = 0; k < 4; ++k) code_ = code_ << 8 | next();
  }

  bool bit(BitModel& model, bool = false) {
    const std::uint32_t one = (range_ >> 15) * model.probability();
    const bool value = narrow(one);
    model.learn(value);
    return value;
  }
  bool even_bit(bool = false) { return narrow(range_ >> 1); }

  /// Whether the bytes are as many as were needed: none is left over, and no more are missing than
  /// an encoder leaves out.
  [[nodiscard]] bool finished() const { return at_ >= from_.size() && at_ - from_.size() <= 4; }

 private:
  bool narrow(std::uint32_t one) {
    const bool value = code_ < one;
    if (value) {
      range_ = one;
    } else {
      code_ -= one;
      range_ -= one;
    }
    while (range_ < 1u << 24) {
      range_ <<= 8;
      code_ = code_ << 8 | next();
    }
    return value;
  }
  std::uint32_t next() {
    const std::size_t at = at_++;
    return at < from_.size() ? std::to_integer<std::uint32_t>(from_[at]) : 0;
  }

  ByteSpan from_;
  std::size_t at_ = 0;
  std::uint32_t code_ = 0;
  std::uint32_t range_ = 0xFFFFFFFFu;
};

}  // namespace slf::codec

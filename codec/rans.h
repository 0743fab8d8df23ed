// The entropy coder of the predictive codec: rANS with static probabilities (FORMAT.md, "Symbols").
//
// SymbolList, which an encoder fills, and SymbolDecoder have the same members, so one function
// template describes a syntax for both: symbol(model, value) of the list notes `value`; that of the
// decoder ignores `value` and returns the decoded one. Decoding is safe on any input: words beyond
// the end read as zeros.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "base/bytes.h"
#include "codec/range_coder.h"

namespace slf::codec {

/// The probabilities of up to kMaxSymbols symbols, in 1/4096. None is 0.
class SymbolModel {
 public:
  static constexpr int kBits = 12;
  static constexpr std::size_t kMaxSymbols = 81;
  /// Stored weights are below this.
  static constexpr std::uint8_t kWeights = 64;

  /// From stored weights, one for each symbol: a weight `w` stands for (4 + w % 4) · 2^(w / 4).
  /// REQUIRES: 1 to kMaxSymbols of them, below kWeights.
  explicit SymbolModel(std::span<const std::uint8_t> weights);
  static constexpr std::uint32_t weight_of(std::uint8_t stored) {
    return (4u + stored % 4) << (stored / 4);
  }

  [[nodiscard]] std::uint32_t start(std::uint32_t symbol) const { return starts_[symbol]; }
  [[nodiscard]] std::uint32_t frequency(std::uint32_t symbol) const {
    return starts_[symbol + 1] - std::uint32_t{starts_[symbol]};
  }
  /// The symbol whose range holds `slot`, below 4096.
  [[nodiscard]] std::uint32_t symbol_at(std::uint32_t slot) const {
    std::uint32_t symbol = first_[slot >> kShift];
    while (starts_[symbol + 1] <= slot) ++symbol;
    return symbol;
  }

 private:
  static constexpr int kShift = 5;

  std::array<std::uint8_t, (1 << (kBits - kShift))> first_{};  // the symbols to search from
  std::array<std::uint16_t, kMaxSymbols + 1> starts_{};
};

/// The symbols of a part of a tile, before it is decided which models code them.
class SymbolList {
 public:
  static constexpr bool kEncodes = true;

  std::uint32_t symbol(std::size_t model, std::uint32_t value) {
    entries_.push_back({static_cast<std::uint16_t>(model), static_cast<std::uint16_t>(value)});
    return value;
  }
  /// `count` bits, up to 16, that are as likely 0 as 1.
  std::uint32_t bits(int count, std::uint32_t value) {
    return symbol(kEven + static_cast<std::size_t>(count), value);
  }

  struct Entry {
    std::uint16_t model, value;
    [[nodiscard]] bool even() const { return model >= kEven; }
    [[nodiscard]] int bits() const { return model - int{kEven}; }
  };
  [[nodiscard]] const std::vector<Entry>& entries() const { return entries_; }
  /// The length in bits when coded with `models`.
  [[nodiscard]] double cost(std::span<const SymbolModel> models) const;

 private:
  static constexpr std::uint16_t kEven = 0xFF00;
  std::vector<Entry> entries_;
};

/// Collects symbols, which are coded in reverse order at the end.
class RansEncoder {
 public:
  /// Appends to `to`, which must outlive this.
  explicit RansEncoder(Bytes& to) : to_(to) {}

  void symbol(const SymbolModel& model, std::uint32_t value) {
    ranges_.push_back({static_cast<std::uint16_t>(model.start(value)),
                       static_cast<std::uint16_t>(model.frequency(value)), SymbolModel::kBits});
  }
  void list(const SymbolList& symbols, std::span<const SymbolModel> models) {
    for (const auto& entry : symbols.entries())
      if (entry.even())
        ranges_.push_back({entry.value, 1, static_cast<std::uint8_t>(entry.bits())});
      else
        symbol(models[entry.model], entry.value);
  }
  bool bit(const BitModel& model, bool value) {
    const auto zero = static_cast<std::uint16_t>(zero_of(model));
    const auto one = static_cast<std::uint16_t>((1 << SymbolModel::kBits) - zero);
    ranges_.push_back(value ? Range{zero, one, SymbolModel::kBits}
                            : Range{0, zero, SymbolModel::kBits});
    return value;
  }
  void finish();

  /// The frequency of 0 in a model that does not adapt.
  [[nodiscard]] static std::uint32_t zero_of(const BitModel& model) {
    return (1u << SymbolModel::kBits) - std::max(1u, model.probability() >> 3);
  }

 private:
  struct Range {
    std::uint16_t start, frequency;
    std::uint8_t bits;  // start and frequency are in 1 / 2^bits
  };
  Bytes& to_;
  std::vector<Range> ranges_;
};

class RansDecoder {
 public:
  /// Views `from`, untrusted.
  explicit RansDecoder(ByteSpan from) : at_(from.data()), end_(from.data() + from.size()) {
    if (from.size() % 2 == 1) {
      state_ = std::to_integer<std::uint32_t>(*at_++);
    } else {
      state_ = next();
    }
    state_ = state_ << 16 | next();
  }

  std::uint32_t symbol(const SymbolModel& model) {
    const std::uint32_t slot = state_ & ((1u << SymbolModel::kBits) - 1);
    const std::uint32_t found = model.symbol_at(slot);
    advance(model.start(found), model.frequency(found), slot);
    return found;
  }
  bool bit(const BitModel& model, bool = false) {
    const std::uint32_t slot = state_ & ((1u << SymbolModel::kBits) - 1);
    const std::uint32_t zero = RansEncoder::zero_of(model);
    const bool one = slot >= zero;
    advance(one ? zero : 0, one ? (1u << SymbolModel::kBits) - zero : zero, slot);
    return one;
  }
  std::uint32_t bits(int count) {
    const std::uint32_t value = state_ & ((1u << count) - 1);
    state_ >>= count;
    refill();
    return value;
  }

  /// Whether what was read is all that was written, and as it was written, as far as one can see.
  [[nodiscard]] bool finished() const { return !overrun_ && at_ == end_ && state_ == kLowest; }

  /// The state of an encoder before its first symbol, and the lowest one between symbols.
  static constexpr std::uint32_t kLowest = 1u << 16;

 private:
  void advance(std::uint32_t start, std::uint32_t frequency, std::uint32_t slot) {
    state_ = frequency * (state_ >> SymbolModel::kBits) + slot - start;
    refill();
  }
  void refill() {
    if (state_ < kLowest) state_ = state_ << 16 | next();
  }
  std::uint32_t next() {
    if (end_ - at_ < 2) {
      overrun_ = true;
      return 0;
    }
    const std::uint32_t word = load_le<std::uint16_t>(at_);
    at_ += 2;
    return word;
  }

  const std::byte* at_;
  const std::byte* end_;
  std::uint32_t state_ = 0;
  bool overrun_ = false;
};

/// Decodes with one set of models. It works on a copy of the decoder, and copies it back at the
/// end, so that the compiler can keep the state in registers.
class SymbolDecoder {
 public:
  static constexpr bool kEncodes = false;

  SymbolDecoder(RansDecoder& decoder, const SymbolModel* models)
      : original_(decoder), decoder_(decoder), models_(models) {}
  ~SymbolDecoder() { original_ = decoder_; }
  SymbolDecoder(const SymbolDecoder&) = delete;
  SymbolDecoder& operator=(const SymbolDecoder&) = delete;

  std::uint32_t symbol(std::size_t model, std::uint32_t = 0) {
    return decoder_.symbol(models_[model]);
  }
  std::uint32_t bits(int count, std::uint32_t = 0) { return decoder_.bits(count); }

 private:
  RansDecoder& original_;
  RansDecoder decoder_;
  const SymbolModel* models_;
};

}  // namespace slf::codec

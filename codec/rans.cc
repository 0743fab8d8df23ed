#include "codec/rans.h"

#include <algorithm>
#include <cmath>

namespace slf::codec {
namespace {

constexpr std::uint32_t kTotal = 1u << SymbolModel::kBits;

}  // namespace

SymbolModel::SymbolModel(std::span<const std::uint8_t> weights) {
  std::uint64_t sum = 0;
  for (const std::uint8_t weight : weights) sum += weight_of(weight);
  std::array<std::uint32_t, kMaxSymbols> frequencies{};
  std::uint32_t total = 0;
  std::size_t most = 0;
  for (std::size_t k = 0; k < weights.size(); ++k) {
    const std::uint64_t share = std::uint64_t{weight_of(weights[k])} * kTotal;
    // NOLINTNEXTLINE(clang-analyzer-core.DivideZero): the sum of weights of 1 or more
    frequencies[k] = std::max(1u, static_cast<std::uint32_t>(share / sum));
    total += frequencies[k];
    if (weights[k] > weights[most]) most = k;
  }
  frequencies[most] += kTotal - total;  // which may be negative
  for (std::size_t k = 0; k < kMaxSymbols; ++k)
    starts_[k + 1] = static_cast<std::uint16_t>(starts_[k] + frequencies[k]);
  std::uint8_t symbol = 0;
  for (std::size_t k = 0; k < first_.size(); ++k) {
    while (starts_[symbol + 1u] <= k << kShift) ++symbol;
    first_[k] = symbol;
  }
}

double SymbolList::cost(std::span<const SymbolModel> models) const {
  static const std::array<float, kTotal + 1> kBitsOf = [] {
    std::array<float, kTotal + 1> bits{};
    for (std::uint32_t f = 1; f <= kTotal; ++f)
      bits[f] = static_cast<float>(SymbolModel::kBits - std::log2(f));
    return bits;
  }();
  double bits = 0;
  for (const Entry& entry : entries_)
    bits += entry.even() ? static_cast<float>(entry.bits())
                         : kBitsOf[models[entry.model].frequency(entry.value)];
  return bits;
}

void RansEncoder::finish() {
  std::uint32_t state = RansDecoder::kLowest;
  std::vector<std::uint16_t> words;
  for (auto range = ranges_.rbegin(); range != ranges_.rend(); ++range) {
    if (state >= std::uint64_t{range->frequency} << (32 - range->bits)) {
      words.push_back(static_cast<std::uint16_t>(state));
      state >>= 16;
    }
    state = ((state / range->frequency) << range->bits) + state % range->frequency + range->start;
  }
  // The length is odd if the state's highest byte is 0, and so is left out.
  if (state >> 24 != 0)
    append_le(to_, static_cast<std::uint16_t>(state >> 16));
  else
    to_.push_back(static_cast<std::byte>(state >> 16));
  append_le(to_, static_cast<std::uint16_t>(state));
  for (auto word = words.rbegin(); word != words.rend(); ++word) append_le(to_, *word);
}

}  // namespace slf::codec

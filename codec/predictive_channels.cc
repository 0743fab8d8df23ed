#include "codec/predictive_channels.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "codec/linear_system.h"
#include "codec/reference_coder.h"

namespace slf::codec {
namespace {

constexpr std::int32_t kMaxWeight = 2047;  // in 1/256
constexpr int kWeightBits = 12;            // of a weight plus kMaxWeight + 1

std::vector<ColumnNeighbours> find_neighbours(std::uint32_t side) {
  const auto n = static_cast<int>(side);
  std::vector<int> line(side + 1);  // the first column of each
  for (int q = 1; q <= n; ++q) line[q] = line[q - 1] + n + 2 - q;
  std::vector<ColumnNeighbours> all;
  for (int q = 0; q <= n; ++q)
    for (int p = 0; p + q <= n; ++p) {
      const auto column = [&](int x, int y) {
        const bool there = x >= 0 && y >= 0 && x + y <= n;
        return static_cast<std::int16_t>(there ? line[y] + x : -1);
      };
      all.push_back(
          {{column(p - 1, q), column(p, q - 1), column(p - 1, q - 1), column(p + 1, q - 1),
            column(p - 2, q), column(p, q - 2), column(p + 1, q), column(p, q + 1)}});
    }
  return all;
}

std::int32_t predict(std::int32_t base, const std::int32_t* weights, const std::int32_t* terms,
                     std::size_t count) {
  std::int64_t sum = 128;
  for (std::size_t k = 0; k < count; ++k) sum += std::int64_t{weights[k]} * terms[k];
  return base + static_cast<std::int32_t>(sum >> 8);
}

}  // namespace

template <class Coder>
template <class Bytes>
ChannelCoder<Coder>::ChannelCoder(const PredictiveLevel& level, const Tile& tile, Bytes& payload)
    : level_(level),
      rows_(tile.rows()),
      columns_(tile.columns()),
      min_value_(is_half(tile.format) ? -0x8000 : 0),
      max_value_(is_half(tile.format) ? 0x7FFF : 255),
      opaque_(is_half(tile.format) ? 0x3C00 : 255),
      neighbours_(find_neighbours(tile.side)),
      errors_(rows_ * columns_),
      color_errors_(rows_ * columns_),
      used_(level.level_models().used),
      coder_(payload) {}

template <class Coder>
std::int32_t ChannelCoder<Coder>::step(TileChannel channel) const {
  if (channel == kAlphaChannel) return 1;
  const auto plane = channel == kDepthChannel ? kDepthPlane : kLumaPlane;
  return std::max(1, level_.steps[plane].low / 16);
}

template <class Coder>
void ChannelCoder<Coder>::find_terms(TileChannel channel, const ChannelValues& predicted,
                                     const ChannelValues& values, std::size_t row,
                                     std::size_t column, std::int32_t* terms) const {
  using Next = ColumnNeighbours;
  const std::size_t first = row * columns_, sample = first + column;
  const auto& next = neighbours_[column].at;
  const std::int32_t base = predicted[channel][sample];
  const auto difference = [&](const ChannelValues& of, std::size_t c, std::size_t neighbour,
                              std::int32_t from) {
    const std::size_t at = first + static_cast<std::size_t>(std::max<int>(0, next[neighbour]));
    return next[neighbour] < 0 || !coded(channel, values, at) ? 0 : of[c][at] - from;
  };
  for (const auto k : {Next::W, Next::N, Next::NW, Next::NE, Next::WW, Next::NN})
    *terms++ = difference(values, channel, k, base);
  for (const auto k : {Next::W, Next::N, Next::NW, Next::NE, Next::E, Next::S})
    *terms++ = difference(predicted, channel, k, base);
  for (std::size_t c = kGreenChannel; c < channel; ++c) {
    const std::int32_t from = predicted[c][sample];
    *terms++ = values[c][sample] - from;
    for (const auto k : {Next::W, Next::N, Next::NW, Next::NE})
      *terms++ = difference(values, c, k, from);
  }
}

template <class Coder>
typename ChannelCoder<Coder>::FlatNeighbourhood ChannelCoder<Coder>::find_flat(
    const ChannelValues& predicted, const ChannelValues& values, std::size_t row,
    std::size_t column) const {
  using Next = ColumnNeighbours;
  const std::size_t first = row * columns_;
  const auto& next = neighbours_[column].at;
  std::int32_t value = -1;
  for (const auto k : {Next::W, Next::N, Next::NW, Next::NE}) {
    if (next[k] < 0) continue;
    const std::int32_t there = values[kAlphaChannel][first + static_cast<std::size_t>(next[k])];
    if ((there != 0 && there != opaque_) || (value >= 0 && there != value)) return {};
    value = there;
  }
  if (value < 0) return {};
  const auto differs = [&](std::size_t at) {
    return std::abs(predicted[kAlphaChannel][first + at] - value) * std::int64_t{256} / opaque_;
  };
  const auto here = differs(column);
  std::int64_t ahead = 0;
  for (const auto k : {Next::E, Next::S})
    if (next[k] >= 0) ahead += differs(static_cast<std::size_t>(next[k]));
  const std::size_t a = here == 0 ? 0 : here < 40 ? 1 : here < 128 ? 2 : 3;
  const std::size_t b = ahead == 0 ? 0 : ahead < 40 ? 1 : ahead < 150 ? 2 : 3;
  return {true, value, ResidualModels::kActivities + 4 * b + a};
}

template <class Coder>
std::size_t ChannelCoder<Coder>::activity(TileChannel channel, std::size_t row,
                                          std::size_t column) const {
  using Next = ColumnNeighbours;
  const std::size_t first = row * columns_;
  const auto& next = neighbours_[column].at;
  const auto error = [&](std::size_t k) {
    return next[k] < 0
               ? 0u
               : static_cast<std::uint32_t>(errors_[first + static_cast<std::size_t>(next[k])]);
  };
  std::uint32_t sum = 2 * error(Next::W) + 2 * error(Next::N) + error(Next::NE) + error(Next::NW);
  if (channel > kGreenChannel)
    sum = (sum + 4 * static_cast<std::uint32_t>(color_errors_[first + column])) * 5 / 8;
  return std::min<std::size_t>(std::bit_width(sum), ResidualModels::kActivities - 1);
}

template <class Coder>
void ChannelCoder<Coder>::code_channel(TileChannel channel, Weights weights,
                                       const ChannelValues& predicted, ChannelValues& values) {
  const std::size_t terms = term_count(channel);
  for (std::size_t k = 0; k < terms; ++k) {
    std::int32_t coded = 0;
    for (int bit = kWeightBits - 1; bit >= 0; --bit)
      coded = 2 * coded + (coder_.even_bit((weights[k] + kMaxWeight + 1) >> bit & 1) ? 1 : 0);
    weights[k] = coded - kMaxWeight - 1;
  }
  ResidualModels models;
  const std::int32_t by = step(channel);
  const std::int32_t min_value = channel == kDepthChannel ? 0 : min_value_;
  const std::int32_t max_value = channel == kDepthChannel ? 255 : max_value_;
  std::array<std::int32_t, kMaxTerms> term;
  std::fill(errors_.begin(), errors_.end(), 0);
  for (std::size_t row = 0; row < rows_; ++row)
    for (std::size_t column = 0; column < columns_; ++column) {
      const std::size_t sample = row * columns_ + column;
      std::int32_t& value = values[channel][sample];
      if (!coded(channel, values, sample)) {
        value = 0;
        continue;
      }
      const FlatNeighbourhood flat = channel == kAlphaChannel
                                         ? find_flat(predicted, values, row, column)
                                         : FlatNeighbourhood{};
      std::int32_t expected = flat.value;
      if (!flat.flat) {
        find_terms(channel, predicted, values, row, column, term.data());
        expected =
            std::clamp(predict(predicted[channel][sample], weights.data(), term.data(), terms),
                       min_value, max_value);
      }
      const std::int32_t off = value - expected;
      const std::int32_t steps = (std::abs(off) + by / 2) / by;
      const std::int32_t coded =
          code_residual(coder_, models, flat.flat ? flat.context : activity(channel, row, column),
                        off < 0 ? -steps : steps);
      errors_[sample] = std::abs(coded);
      value = static_cast<std::int32_t>(
          std::clamp<std::int64_t>(expected + std::int64_t{coded} * by, min_value, max_value));
    }
  if (channel >= kGreenChannel)
    for (std::size_t s = 0; s < errors_.size(); ++s) color_errors_[s] += errors_[s];
}

ChannelEncoder::ChannelEncoder(const PredictiveLevel& level, const Tile& tile, Bytes& payload)
    : ChannelCoder(level, tile, payload) {}

void ChannelEncoder::references(std::span<const std::uint8_t> kinds,
                                std::span<const std::uint8_t> used) {
  std::vector<std::uint8_t> coded(used.begin(), used.end());
  code_references(coder_, used_, kinds, coded);
}

/// The weights with the least squared error.
ChannelEncoder::Weights ChannelEncoder::fit(TileChannel channel, const ChannelValues& predicted,
                                            const ChannelValues& values) const {
  const std::size_t terms = term_count(channel);
  std::array<std::array<double, kMaxTerms + 1>, kMaxTerms> system{};
  std::array<std::int32_t, kMaxTerms> term;
  std::array<double, kMaxTerms + 1> x{};
  for (std::size_t row = 0; row < rows_; ++row)
    // A third of the samples suffices.
    for (std::size_t column = row % 3; column < columns_; column += 3) {
      const std::size_t sample = row * columns_ + column;
      if (!coded(channel, values, sample)) continue;
      if (channel == kAlphaChannel && find_flat(predicted, values, row, column).flat) continue;
      find_terms(channel, predicted, values, row, column, term.data());
      for (std::size_t k = 0; k < terms; ++k) x[k] = term[k];
      x[terms] = values[channel][sample] - predicted[channel][sample];
      for (std::size_t i = 0; i < terms; ++i)
        for (std::size_t j = i; j <= terms; ++j) system[i][j] += x[i] * x[j];
    }
  // Regularisation: keeps the system definite, and the weights of unimportant terms small.
  for (std::size_t i = 0; i < terms; ++i) {
    for (std::size_t j = 0; j < i; ++j) system[i][j] = system[j][i];
    system[i][i] += 4 + system[i][i] / 1024;
  }
  solve_system(system, terms);
  Weights weights{};
  for (std::size_t i = 0; i < terms; ++i)
    weights[i] = static_cast<std::int32_t>(std::nearbyint(
        std::clamp(system[i][terms] * 256, -double{kMaxWeight}, double{kMaxWeight})));
  return weights;
}

void ChannelEncoder::code(TileChannel channel, const ChannelValues& predicted,
                          ChannelValues& values) {
  if (channel == kGreenChannel) {
    bool hidden = false;
    for (std::size_t s = 0; s < values[kAlphaChannel].size(); ++s)
      if (values[kAlphaChannel][s] == 0)
        for (const auto c : {kGreenChannel, kRedChannel, kBlueChannel}) hidden |= values[c][s] != 0;
    code_hidden(hidden);
  }
  code_channel(channel, fit(channel, predicted, values), predicted, values);
}

ChannelDecoder::ChannelDecoder(const PredictiveLevel& level, const Tile& tile, ByteSpan payload)
    : ChannelCoder(level, tile, payload) {}

void ChannelDecoder::references(std::span<const std::uint8_t> kinds, std::span<std::uint8_t> used) {
  code_references(coder_, used_, kinds, used);
}

void ChannelDecoder::code(TileChannel channel, const ChannelValues& predicted,
                          ChannelValues& values) {
  if (channel == kGreenChannel) code_hidden(false);
  std::fill(values[channel].begin(), values[channel].end(), 0);
  code_channel(channel, {}, predicted, values);
}

Result<void> ChannelDecoder::finish() const {
  if (coder_.finished()) return {};
  return fail(ErrorCode::bad_file, "the payload does not end where its content does");
}

}  // namespace slf::codec

#include "codec/predictive_channels.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <vector>

#include "base/half.h"
#include "base/try.h"
#include "codec/color_kernel.h"
#include "codec/linear_system.h"
#include "codec/log_colors.h"
#include "codec/range_coder.h"
#include "codec/reference_coder.h"
#include "codec/residual_coder.h"

namespace slf::codec {
namespace {

constexpr std::int32_t kMaxWeight = 2047;  // in 1/256
constexpr int kWeightBits = 12;            // of a weight plus kMaxWeight + 1

/// Without a transform, colours are coded as they are: channels, in their order.
enum TileChannel : std::size_t {
  kAlphaChannel,
  kDepthChannel,
  kGreenChannel,
  kRedChannel,
  kBlueChannel
};
constexpr std::size_t kTileChannels = 5;

/// The channels of colour, and their positions in RGBA.
constexpr std::pair<TileChannel, std::size_t> kColors[] = {
    {kGreenChannel, 1}, {kRedChannel, 0}, {kBlueChannel, 2}};

/// For each channel, the value of each sample of a tile. Depth is 0..255. The others are 0..255 in
/// rgba8, and ordered_half() of the half float in rgba16f.
using ChannelValues = std::array<std::vector<std::int32_t>, kTileChannels>;

ChannelValues channels_of(const TileShape& tile, ByteSpan samples) {
  ChannelValues values;
  for (auto& channel : values) channel.resize(tile.samples());
  const auto value = [&](std::size_t s, std::size_t c) -> std::int32_t {
    const std::byte* const at = samples.data() + s * color_bytes(tile.format);
    return is_half(tile.format) ? ordered_half(load_le<std::uint16_t>(at + 2 * c))
                                : std::to_integer<std::int32_t>(at[c]);
  };
  for (std::size_t s = 0; s < tile.samples(); ++s) {
    for (const auto& [channel, place] : kColors) values[channel][s] = value(s, place);
    values[kAlphaChannel][s] = value(s, 3);
    values[kDepthChannel][s] = std::to_integer<std::int32_t>(samples[tile.color_bytes() + s]);
  }
  return values;
}

void store(const TileShape& tile, const ChannelValues& values, std::span<std::byte> samples) {
  const auto put = [&](std::size_t s, std::size_t c, std::int32_t value) {
    std::byte* const at = samples.data() + s * color_bytes(tile.format);
    if (is_half(tile.format))
      store_le(at + 2 * c, half_of_ordered(value));
    else
      at[c] = static_cast<std::byte>(value);
  };
  for (std::size_t s = 0; s < tile.samples(); ++s) {
    for (const auto& [channel, place] : kColors) put(s, place, values[channel][s]);
    put(s, 3, values[kAlphaChannel][s]);
    samples[tile.color_bytes() + s] = static_cast<std::byte>(values[kDepthChannel][s]);
  }
}

/// The columns next to one in a triangular picture; -1 where there is none.
struct ColumnNeighbours {
  enum { W, N, NW, NE, WW, NN, E, S, kCount };
  std::array<std::int32_t, kCount> at;
};

std::vector<ColumnNeighbours> find_neighbours(std::uint32_t side) {
  const auto n = static_cast<int>(side);
  std::vector<int> line(side + 1);  // the first column of each
  for (int q = 1; q <= n; ++q) line[q] = line[q - 1] + n + 2 - q;
  std::vector<ColumnNeighbours> all;
  for (int q = 0; q <= n; ++q)
    for (int p = 0; p + q <= n; ++p) {
      const auto column = [&](int x, int y) {
        const bool there = x >= 0 && y >= 0 && x + y <= n;
        return there ? line[y] + x : -1;
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

/// Codes the channels of a tile. Keeps references to its arguments, which must outlive it.
template <class Coder>
class ChannelCoder {
 public:
  template <class Bytes>
  ChannelCoder(const PredictiveLevel& level, const TileShape& tile, Bytes& payload);

  void references(std::span<const std::uint8_t> kinds, std::span<std::uint8_t> used) {
    code_references(coder_, used_, kinds, used);
  }
  /// Codes all channels. An encoder replaces `values` by those that the decoder will have; a
  /// decoder's are at first 0.
  void code(const Prediction& prediction, ChannelValues& values);
  [[nodiscard]] std::uint8_t alpha_byte(std::int32_t value) const {
    return half_ ? byte_from_half(half_of_ordered(value)) : static_cast<std::uint8_t>(value);
  }
  [[nodiscard]] Coder& coder() { return coder_; }

 private:
  static constexpr bool kEncodes = std::is_same_v<Coder, RangeEncoder>;
  /// Most terms of a prediction: 12 of the channel itself, 5 of each channel of colour before it.
  static constexpr std::size_t kMaxTerms = 22;
  using Weights = std::array<std::int32_t, kMaxTerms>;

  /// The weights with the least squared error.
  [[nodiscard]] Weights fit(TileChannel channel, const ChannelValues& predicted,
                            const ChannelValues& values) const;
  void code_channel(TileChannel channel, const ChannelValues& predicted, ChannelValues& values);

  /// Whether a sample of the channel is coded; if not, it is 0.
  [[nodiscard]] bool coded(TileChannel channel, const ChannelValues& values,
                           std::size_t sample) const {
    return channel == kAlphaChannel || values[kAlphaChannel][sample] != 0 ||
           (hidden_ && channel >= kGreenChannel);
  }
  [[nodiscard]] std::size_t term_count(TileChannel channel) const {
    return 12 + (channel > kGreenChannel ? 5 * (channel - kGreenChannel) : 0);
  }
  /// The terms of a sample's linear prediction: neighbours and predictions around it, as
  /// differences from the value predicted for it.
  void find_terms(TileChannel channel, const ChannelValues& predicted, const ChannelValues& values,
                  std::size_t row, std::size_t column, std::int32_t* terms) const;
  [[nodiscard]] std::int32_t step(TileChannel channel) const;
  /// The neighbourhood of a sample of alpha, if it is flat: all neighbours are 0 or all are opaque.
  struct FlatNeighbourhood {
    bool flat = false;
    std::int32_t value = 0;   ///< of the neighbours
    std::size_t context = 0;  ///< of the residual
  };
  [[nodiscard]] FlatNeighbourhood find_flat(const ChannelValues& predicted,
                                            const ChannelValues& values, std::size_t row,
                                            std::size_t column) const;
  /// A class of the magnitudes of the residuals around a sample, in this channel and in the colour
  /// channels coded before.
  [[nodiscard]] std::size_t activity(TileChannel channel, std::size_t row,
                                     std::size_t column) const;

  const PredictiveLevel& level_;
  const std::size_t rows_, columns_;
  const bool half_;
  const std::int32_t min_value_, max_value_;  // of the channels other than depth
  const std::int32_t opaque_;                 // the alpha that means opaque
  bool hidden_ = false;  // whether samples of zero alpha have coded colours, too
  std::vector<ColumnNeighbours> neighbours_;  // per column
  std::vector<std::int32_t> errors_;          // per sample: the residual's magnitude
  std::vector<std::int32_t> color_errors_;    // their sum over the colour channels before
  LevelModels::Used used_;
  Coder coder_;
};

template <class Coder>
template <class Bytes>
ChannelCoder<Coder>::ChannelCoder(const PredictiveLevel& level, const TileShape& tile,
                                  Bytes& payload)
    : level_(level),
      rows_(tile.rows()),
      columns_(tile.columns()),
      half_(is_half(tile.format)),
      min_value_(half_ ? -0x8000 : 0),
      max_value_(half_ ? 0x7FFF : 255),
      opaque_(half_ ? 0x3C00 : 255),
      neighbours_(find_neighbours(tile.side)),
      errors_(rows_ * columns_),
      color_errors_(rows_ * columns_),
      used_(level.level_models().used),
      coder_(payload) {}

template <class Coder>
std::int32_t ChannelCoder<Coder>::step(TileChannel channel) const {
  if (channel == kAlphaChannel) return 1;
  const auto plane = channel == kDepthChannel ? kDepthPlane : kYPlane;
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
void ChannelCoder<Coder>::code_channel(TileChannel channel, const ChannelValues& predicted,
                                       ChannelValues& values) {
  const std::size_t terms = term_count(channel);
  Weights weights{};
  if constexpr (kEncodes) weights = fit(channel, predicted, values);
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

template <class Coder>
typename ChannelCoder<Coder>::Weights ChannelCoder<Coder>::fit(TileChannel channel,
                                                               const ChannelValues& predicted,
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

template <class Coder>
void ChannelCoder<Coder>::code(const Prediction& prediction, ChannelValues& values) {
  const std::size_t samples = rows_ * columns_;
  ChannelValues predicted;
  for (auto& channel : predicted) channel.resize(samples);
  for (std::size_t s = 0; s < samples; ++s) {
    const std::uint8_t alpha = prediction.alpha[s];
    predicted[kAlphaChannel][s] = half_ ? ordered_half(half_from_byte(alpha)) : alpha;
    predicted[kDepthChannel][s] = prediction.depth[s];
  }
  code_channel(kAlphaChannel, predicted, values);
  code_channel(kDepthChannel, predicted, values);
  bool hidden = false;
  for (std::size_t s = 0; s < samples; ++s) {
    const std::int32_t alpha = values[kAlphaChannel][s];
    for (const auto& [channel, place] : kColors) {
      const auto full = static_cast<std::uint8_t>(prediction.color[s] >> (8 * place));
      predicted[channel][s] =
          half_ ? ordered_half(half_from_log_color(full, half_of_ordered(alpha)))
                : static_cast<std::int32_t>(premultiplied(full, alpha_byte(alpha)));
      hidden |= alpha == 0 && values[channel][s] != 0;
    }
  }
  hidden_ = coder_.even_bit(hidden);
  for (const auto& [channel, place] : kColors) code_channel(channel, predicted, values);
}

}  // namespace

void encode_channels(const PredictiveLevel& level, const TileShape& tile, ByteSpan samples,
                     const Predicted& from, Bytes& payload) {
  ChannelCoder<RangeEncoder> encoder(level, tile, payload);
  ChannelValues values = channels_of(tile, samples);
  std::vector<std::uint8_t> used(from.used.begin(), from.used.end());
  encoder.references(from.kinds, used);
  encoder.code(from.prediction, values);
  encoder.coder().finish();
}

Result<void> decode_channels(const PredictiveLevel& level, const TileShape& tile, ByteSpan payload,
                             const Predicted& from, std::span<std::byte> samples) {
  ChannelCoder<RangeDecoder> decoder(level, tile, payload);
  SLF_TRY(pass_references(decoder, from));
  ChannelValues values;
  for (auto& channel : values) channel.resize(tile.samples());
  decoder.code(from.prediction, values);
  store(tile, values, samples);
  if (decoder.coder().finished()) return {};
  return fail(ErrorCode::bad_file, "the payload does not end where its content does");
}

}  // namespace slf::codec

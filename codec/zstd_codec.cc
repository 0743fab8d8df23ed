#include "codec/zstd_codec.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>

#include "base/per_thread.h"
#include "base/tile_shape.h"
#include "base/try.h"
#include "codec/byte_streams.h"
#include "codec/lane_samples.h"
#include "codec/lanes.h"
#include "codec/linear_system.h"
#include "codec/scratch.h"

namespace slf::codec {
namespace {

// The first byte of a payload: whether colour is stored where alpha is 0, too.
constexpr std::uint8_t kKeepsClear = 1;

class ZstdCodec final : public Codec {
 public:
  ZstdCodec(SampleFormat format, int level) : format_(format), level_(level) {}

  std::string spec() const override { return "zstd:" + std::to_string(level_); }
  bool lossless() const override { return true; }

  Result<void> encode(const TileShape& tile, ByteSpan samples, const Predicted*,
                      Bytes& payload) const override;
  Result<void> decode(const TileShape& tile, ByteSpan payload, const Predicted*,
                      std::span<std::byte> samples) const override;

 private:
  SampleFormat format_;
  int level_;
};

// The columns of a sample's neighbours, replaced as in lanes.cc. REQUIRES: p > 0 or q > 0.
std::array<std::size_t, kOwnTaps> neighbours(std::uint32_t side, std::uint32_t p, std::uint32_t q,
                                             std::size_t column) {
  const std::size_t above = column - (side + 2 - q);  // line q - 1 holds side + 2 - q samples
  const std::size_t w = p > 0 ? column - 1 : above;
  const std::size_t n = q > 0 ? above : w;
  const std::size_t nw = p > 0 && q > 0 ? above - 1 : n;
  const std::size_t ne = q > 0 ? above + 1 : n;
  const std::size_t ww = p > 1 ? column - 2 : w;
  const std::size_t nn = q > 1 ? above - (side + 3 - q) : n;
  return {w, n, nw, ne, ww, nn};
}

/// Computes the weights of the linear predictor by least squares. Accumulates sums of products over
/// samples, and solves for the weights. The sums are exact, and the few operations that round are
/// the same on every machine.
class LinearFit {
 public:
  /// 1..3 channels.
  explicit LinearFit(std::size_t channels) : channels_(channels) {}

  /// Adds a third of the samples of the first `lanes` pictures of a group. `values` are those of
  /// predict, below 256. Samples whose `coverage`, if given, is 0 are left out.
  void add(std::uint32_t side, std::size_t lanes, const LaneValues* values,
           const LaneValues* coverage) {
    const std::size_t columns = triangle_size(side);
    const std::size_t terms = kTermsPerChannel * channels_;
    std::array<double, kMaxTerms> term{};
    std::size_t column = 1;  // the first sample has no neighbours
    for (std::uint32_t q = 0; q <= side; ++q)
      for (std::uint32_t p = q == 0 ? 1 : 0; p <= side - q; ++p, ++column) {
        const auto around = neighbours(side, p, q, column);
        for (std::size_t lane = column % 3; lane < lanes; lane += 3) {
          if (coverage && coverage[column][lane] == 0) continue;
          double* next = term.data();
          for (std::size_t channel = 0; channel < channels_; ++channel) {
            const LaneValues* plane = values + channel * columns;
            for (const std::size_t at : around) *next++ = plane[at][lane];
            *next++ = plane[column][lane];
          }
          for (std::size_t i = 0; i < terms; ++i)
            for (std::size_t j = 0; j < terms; ++j) products_[i][j] += term[i] * term[j];
        }
      }
  }

  [[nodiscard]] ChannelPredictor solve(std::size_t channel) const {
    // Select the terms that are taps of this channel, in the order of its weights.
    std::array<std::size_t, kMaxTaps> tap{};
    std::size_t count = 0;
    for (std::size_t i = 0; i < kOwnTaps; ++i) tap[count++] = channel * kTermsPerChannel + i;
    for (std::size_t earlier = 0; earlier < channel; ++earlier) {
      tap[count++] = earlier * kTermsPerChannel + kOwnTaps;
      for (std::size_t i = 0; i + 1 < kCrossTaps; ++i)
        tap[count++] = earlier * kTermsPerChannel + i;
    }
    const std::size_t target = channel * kTermsPerChannel + kOwnTaps;

    std::array<std::array<double, kMaxTaps + 1>, kMaxTaps> system{};
    for (std::size_t i = 0; i < count; ++i) {
      for (std::size_t j = 0; j < count; ++j) system[i][j] = products_[tap[i]][tap[j]];
      system[i][i] += 1;  // keeps the system definite if all samples are equal
      system[i][count] = products_[tap[i]][target];
    }
    solve_system(system, count);

    ChannelPredictor predictor{true, {}};
    for (std::size_t i = 0; i < count; ++i) {
      const double weight = std::nearbyint(
          std::clamp(system[i][count] * 256, -double{kMaxTapWeight}, double{kMaxTapWeight}));
      predictor.weights[i] = static_cast<std::int16_t>(weight);
    }
    return predictor;
  }

 private:
  // Per channel: W, N, NW, NE, WW, NN and the sample itself.
  static constexpr std::size_t kTermsPerChannel = kOwnTaps + 1;
  static constexpr std::size_t kMaxTerms = kTermsPerChannel * 3;

  std::size_t channels_;
  std::array<std::array<double, kMaxTerms>, kMaxTerms> products_{};
};

// A tile in lanes; each thread keeps one.
struct Workspace {
  Scratch<LaneValues> alpha_scratch, color_scratch, residual_scratch;
  LaneValues* alpha = nullptr;      // [group][column]
  LaneValues* color = nullptr;      // [group][channel][column]
  LaneValues* residuals = nullptr;  // as color

  void size_for(const TileShape& tile) {
    const std::size_t one = group_count(tile) * tile.columns();
    alpha = alpha_scratch.take(one).data();
    color = color_scratch.take(one * kColorChannels).data();
    residuals = residual_scratch.take(one * kColorChannels).data();
  }
};

// Alpha, which the samples that are left out of the colours depend on.
LaneStack alpha_stack(const TileShape& tile) { return single_stack(tile, value_bits(tile.format)); }

// Whether all samples of zero alpha are 0 in every channel, so that they need not be stored.
bool clear_is_zero(const LaneValues* alpha, const TileShape& tile, ByteSpan colors) {
  const std::size_t bytes = color_bytes(tile.format), columns = tile.columns();
  for (std::size_t row = 0; row < tile.rows(); ++row)
    for (std::size_t i = 0; i < columns; ++i) {
      if (alpha[row / kLaneCount * columns + i][row % kLaneCount] != 0) continue;
      const ByteSpan sample = colors.subspan((row * columns + i) * bytes, bytes);
      if (std::any_of(sample.begin(), sample.end(), [](auto b) { return b != std::byte{0}; }))
        return false;
    }
  return true;
}

void fit_predictors(const LaneStack& stack, const LaneValues* values,
                    std::span<ChannelPredictor> predictors) {
  LinearFit fit(predictors.size());
  for (std::size_t group = 0; group < group_count(stack.tile); ++group)
    fit.add(stack.tile.side, lanes_of(stack.tile, group), values + stack.offset(group),
            stack.coverage_of(group));
  for (std::size_t channel = 0; channel < predictors.size(); ++channel)
    predictors[channel] = fit.solve(channel);
}

void append_weights(std::span<const ChannelPredictor> predictors, Bytes& payload) {
  for (std::size_t channel = 0; channel < predictors.size(); ++channel)
    for (std::size_t i = 0; i < taps(channel); ++i)
      append_le(payload, static_cast<std::uint16_t>(predictors[channel].weights[i]));
}

bool read_weights(ByteSpan& payload, std::span<ChannelPredictor> predictors) {
  for (std::size_t channel = 0; channel < predictors.size(); ++channel) {
    if (payload.size() < taps(channel) * 2) return false;
    predictors[channel].linear = true;
    for (std::size_t i = 0; i < taps(channel); ++i) {
      const auto weight = static_cast<std::int16_t>(load_le<std::uint16_t>(payload.data()));
      if (weight < -kMaxTapWeight || weight > kMaxTapWeight) return false;
      predictors[channel].weights[i] = weight;
      payload = payload.subspan(2);
    }
  }
  return true;
}

Result<void> append_colors(const TileShape& tile, ByteSpan colors, int level, Workspace& work,
                           Bytes& payload) {
  load_colors(tile, colors.data(), work.alpha, work.color);
  const bool keeps_clear = !clear_is_zero(work.alpha, tile, colors);
  ChannelPredictor predictors[kColorChannels];
  const LaneStack stack{
      tile, {tile.side, value_bits(tile.format), predictors}, keeps_clear ? nullptr : work.alpha};
  const bool bytes = !is_half(tile.format);
  if (bytes) fit_predictors(stack, work.color, predictors);
  payload.push_back(static_cast<std::byte>(keeps_clear ? kKeepsClear : 0));
  if (bytes) append_weights(predictors, payload);
  SLF_TRY(append_stack(alpha_stack(tile), work.alpha, work.residuals, false, level, payload));
  // R and B of 8 bits share a stream; every other channel has its own.
  return append_stack(stack, work.color, work.residuals, bytes, level, payload);
}

Result<void> read_colors(const TileShape& tile, ByteSpan& payload, Workspace& work,
                         std::span<std::byte> colors) {
  if (payload.empty()) return bad_file("zstd", "the tile is cut short");
  const auto flag = std::to_integer<std::uint8_t>(payload[0]);
  const bool keeps_clear = flag == kKeepsClear;
  payload = payload.subspan(1);
  const bool bytes = !is_half(tile.format);
  ChannelPredictor predictors[kColorChannels];
  if (flag > kKeepsClear || (bytes && !read_weights(payload, predictors)))
    return bad_file("zstd", "the tile's header is damaged");
  SLF_TRY(read_stack(alpha_stack(tile), false, payload, work.residuals, work.alpha));
  const LaneStack stack{
      tile, {tile.side, value_bits(tile.format), predictors}, keeps_clear ? nullptr : work.alpha};
  SLF_TRY(read_stack(stack, bytes, payload, work.residuals, work.color));
  store_colors(tile, !keeps_clear, work.alpha, work.color, colors.data());
  return {};
}

Result<void> ZstdCodec::encode(const TileShape& tile, ByteSpan samples, const Predicted*,
                               Bytes& payload) const {
  assert(tile.format == format_ && samples.size() == tile.bytes());
  payload.clear();
  if (tile.bytes() == 0) return {};
  auto& work = per_thread<Workspace>([] {});
  work.size_for(tile);
  SLF_TRY(append_colors(tile, samples.first(tile.color_bytes()), level_, work, payload));
  if (!has_depth(format_)) return {};
  return append_bytes(tile, samples.subspan(tile.color_bytes()), level_, payload);
}

Result<void> ZstdCodec::decode(const TileShape& tile, ByteSpan payload, const Predicted*,
                               std::span<std::byte> samples) const {
  assert(tile.format == format_ && samples.size() == tile.bytes());
  if (tile.bytes() == 0 && payload.empty()) return {};
  if (tile.bytes() == 0) return bad_file("zstd", "bytes for a tile without rows");
  auto& work = per_thread<Workspace>([] {});
  work.size_for(tile);
  SLF_TRY(read_colors(tile, payload, work, samples.first(tile.color_bytes())));
  if (has_depth(format_)) SLF_TRY(read_bytes(tile, payload, samples.subspan(tile.color_bytes())));
  if (payload.empty()) return {};
  return bad_file("zstd", payload.size(), " bytes too many");
}

}  // namespace

std::unique_ptr<Codec> make_zstd_codec(SampleFormat format, int level) {
  return std::make_unique<ZstdCodec>(format, level);
}

}  // namespace slf::codec

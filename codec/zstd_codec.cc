#include "codec/zstd_codec.h"

#include <algorithm>
#include <cassert>

#include "codec/alpha_coder.h"
#include "codec/byte_streams.h"
#include "codec/lane_samples.h"
#include "codec/lanes.h"
#include "codec/linear_fit.h"
#include "codec/scratch.h"

namespace slf::codec {
namespace {

// The first byte of a payload.
constexpr std::uint8_t kFlagKeepsClear = 1;  // colour is stored where alpha is 0, too
constexpr std::uint8_t kFlagLinear = 2;      // weights follow

// R and B of rgba8 share a stream; every other channel has its own.
bool codes_pairs(SampleFormat format) { return format == SampleFormat::rgba8; }

class ZstdCodec final : public Codec {
 public:
  ZstdCodec(SampleFormat format, int level) : format_(format), level_(level) {}

  std::string spec() const override { return "zstd:" + std::to_string(level_); }
  bool lossless() const override { return true; }

  Result<void> encode(const Tile& tile, ByteSpan samples, Bytes& payload) const override;
  Result<void> decode(const Tile& tile, ByteSpan payload,
                      std::span<std::byte> samples) const override;

 private:
  SampleFormat format_;
  int level_;
};

// A tile in lanes; each thread keeps one.
struct Workspace {
  Scratch<LaneValues> alpha_scratch, color_scratch, residual_scratch;
  Scratch<std::uint8_t> byte_scratch;
  LaneValues* alpha = nullptr;      // [group][column]; null without alpha
  LaneValues* color = nullptr;      // [group][channel][column]
  LaneValues* residuals = nullptr;  // as color

  explicit Workspace() = default;
  void size_for(const Tile& tile) {
    const std::size_t one = group_count(tile) * tile.columns();
    const std::size_t all = one * color_channels(tile.format);
    alpha = has_alpha(tile.format) ? alpha_scratch.take(one).data() : nullptr;
    color = color_scratch.take(all).data();
    residuals = residual_scratch.take(all).data();
  }
};

// Alpha of 8 bits has a coder of its own; that of halves is coded in lanes like other channels.
Result<void> append_alpha_of(const Tile& tile, Workspace& work, int level, Bytes& payload) {
  if (tile.format == SampleFormat::rgba16f)
    return append_stack(alpha_stack(tile), work.alpha, work.residuals, false, level, payload);
  const std::size_t columns = tile.columns();
  const auto rows = work.byte_scratch.take(tile.rows() * columns);
  for (std::size_t row = 0; row < tile.rows(); ++row)
    for (std::size_t i = 0; i < columns; ++i)
      rows[row * columns + i] =
          static_cast<std::uint8_t>(work.alpha[row / kLaneCount * columns + i][row % kLaneCount]);
  return append_alpha(rows, tile.side, 255, payload);
}

Result<void> read_alpha_of(const Tile& tile, Workspace& work, ByteSpan& payload) {
  if (tile.format == SampleFormat::rgba16f)
    return read_stack(alpha_stack(tile), false, payload, work.residuals, work.alpha);
  const std::size_t columns = tile.columns();
  const auto rows = work.byte_scratch.take(tile.rows() * columns);
  if (auto done = read_alpha(payload, tile.side, 255, rows); !done) return done;
  std::fill_n(work.alpha + (group_count(tile) - 1) * columns, columns, LaneValues{});
  for (std::size_t row = 0; row < tile.rows(); ++row)
    for (std::size_t i = 0; i < columns; ++i)
      work.alpha[row / kLaneCount * columns + i][row % kLaneCount] = rows[row * columns + i];
  return {};
}

// Whether all samples of zero alpha are 0 in every channel, so that they need not be stored.
bool clear_is_zero(const LaneValues* alpha, const Tile& tile, ByteSpan samples) {
  const std::size_t bytes = sample_bytes(tile.format), columns = tile.columns();
  for (std::size_t row = 0; row < tile.rows(); ++row)
    for (std::size_t i = 0; i < columns; ++i) {
      if (alpha[row / kLaneCount * columns + i][row % kLaneCount] != 0) continue;
      const ByteSpan sample = samples.subspan((row * columns + i) * bytes, bytes);
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

Result<void> ZstdCodec::encode(const Tile& tile, ByteSpan samples, Bytes& payload) const {
  assert(tile.format == format_ && samples.size() == tile.bytes());
  payload.clear();
  if (tile.bytes() == 0) return {};
  thread_local Workspace work;
  work.size_for(tile);
  load(tile, samples.data(), work.alpha, work.color);
  const bool keeps_clear = work.alpha && !clear_is_zero(work.alpha, tile, samples);

  ChannelPredictor predictors[3];
  const std::span used(predictors, color_channels(format_));
  LaneStack stack{tile, {tile.side, value_bits(format_), used}, keeps_clear ? nullptr : work.alpha};
  const bool linear = format_ == SampleFormat::rgba8;
  if (linear) fit_predictors(stack, work.color, used);

  payload.push_back(
      static_cast<std::byte>((keeps_clear ? kFlagKeepsClear : 0) | (linear ? kFlagLinear : 0)));
  if (linear) append_weights(used, payload);
  if (work.alpha) {
    if (auto done = append_alpha_of(tile, work, level_, payload); !done) return done;
  }
  return append_stack(stack, work.color, work.residuals, codes_pairs(format_), level_, payload);
}

Result<void> ZstdCodec::decode(const Tile& tile, ByteSpan payload,
                               std::span<std::byte> samples) const {
  assert(tile.format == format_ && samples.size() == tile.bytes());
  if (tile.bytes() == 0 && payload.empty()) return {};
  if (tile.bytes() == 0) return fail(ErrorCode::bad_file, "zstd: bytes for a tile without rows");
  if (payload.empty()) return fail(ErrorCode::bad_file, "zstd: the tile is cut short");
  const auto flags = std::to_integer<std::uint8_t>(payload[0]);
  const bool keeps_clear = flags & kFlagKeepsClear, linear = flags & kFlagLinear;
  payload = payload.subspan(1);
  ChannelPredictor predictors[3];
  const std::span used(predictors, color_channels(format_));
  if (flags > (kFlagKeepsClear | kFlagLinear) || (keeps_clear && !has_alpha(format_)) ||
      (linear && value_bits(format_) != 8) || (linear && !read_weights(payload, used)))
    return fail(ErrorCode::bad_file, "zstd: the tile's header is damaged");

  thread_local Workspace work;
  work.size_for(tile);
  if (work.alpha) {
    if (auto done = read_alpha_of(tile, work, payload); !done) return done;
  }
  const LaneStack stack{
      tile, {tile.side, value_bits(format_), used}, keeps_clear ? nullptr : work.alpha};
  if (auto done = read_stack(stack, codes_pairs(format_), payload, work.residuals, work.color);
      !done)
    return done;
  if (!payload.empty())
    return fail(ErrorCode::bad_file, "zstd: ", payload.size(), " bytes too many");
  store(tile, stack.coverage != nullptr, work.alpha, work.color, samples.data());
  return {};
}

}  // namespace

std::unique_ptr<Codec> make_zstd_codec(SampleFormat format, int level) {
  return std::make_unique<ZstdCodec>(format, level);
}

}  // namespace slf::codec

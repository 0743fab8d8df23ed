#include "codec/predictive_channels.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "base/half.h"
#include "tests/codec/sample_tiles.h"

namespace slf::codec {
namespace {

constexpr TileChannel kInOrder[] = {kAlphaChannel, kDepthChannel, kGreenChannel, kRedChannel,
                                    kBlueChannel};

/// A ball in front of nothing, and a prediction of it that is off by up to `noise`.
struct Picture {
  ChannelValues values, predicted;

  Picture(const Tile& tile, int noise, std::uint32_t seed = 1) {
    std::mt19937 random(seed);
    const bool half = is_half(tile.format);
    const std::int32_t opaque = half ? 0x3C00 : 255, scale = half ? 64 : 1;
    for (std::size_t row = 0; row < tile.rows(); ++row)
      for (std::uint32_t q = 0; q <= tile.side; ++q)
        for (std::uint32_t p = 0; p + q <= tile.side; ++p) {
          const double x = p + 0.3 * static_cast<double>(row), y = q, n = tile.side + 1;
          const double inside = 0.4 * n - std::hypot(x - 0.4 * n, y - 0.3 * n);
          const auto alpha = static_cast<std::int32_t>(std::clamp(inside, 0., 1.) * opaque);
          const auto wave = static_cast<std::int32_t>(100 + 80 * std::sin(0.4 * x + 0.3 * y));
          const auto put = [&](TileChannel c, std::int32_t value, std::int32_t near, int off) {
            values[c].push_back(alpha == 0 ? 0 : value);
            const int by = off == 0 ? 0 : static_cast<int>(random() % (2u * off + 1)) - off;
            predicted[c].push_back(near + by);
          };
          put(kAlphaChannel, alpha, alpha, 0);
          put(kDepthChannel, wave / 2, wave / 2, noise);
          for (const TileChannel c : {kGreenChannel, kRedChannel, kBlueChannel})
            put(c, scale * wave, scale * wave, scale * noise);
        }
  }
};

PredictiveLevel level_of(int quality, SampleFormat format) {
  return predictive_tables({quality, format}, 0).level(0);
}

/// What the decoder will have goes to `coded`.
Bytes encode(const PredictiveLevel& level, const Tile& tile, const Picture& picture,
             ChannelValues& coded) {
  Bytes payload;
  ChannelEncoder encoder(level, tile, payload);
  const std::vector<std::uint8_t> kinds{0, 1, 2, 3}, used{1, 0, 0, 1};
  encoder.references(kinds, used);
  coded = picture.values;
  for (const TileChannel channel : kInOrder) encoder.code(channel, picture.predicted, coded);
  encoder.finish();
  return payload;
}

bool decode(const PredictiveLevel& level, const Tile& tile, const Picture& picture,
            ByteSpan payload, ChannelValues& values) {
  ChannelDecoder decoder(level, tile, payload);
  const std::vector<std::uint8_t> kinds{0, 1, 2, 3};
  std::vector<std::uint8_t> used(4);
  decoder.references(kinds, used);
  for (auto& channel : values) channel.assign(picture.values[0].size(), 77);
  for (const TileChannel channel : kInOrder) decoder.code(channel, picture.predicted, values);
  return decoder.finish() && used == std::vector<std::uint8_t>{1, 0, 0, 1};
}

SampleTile shape(SampleFormat format, std::size_t rows, std::uint32_t side) {
  return make_tile(format, rows, side, Content::zero);
}

TEST(PredictiveChannels, LosslessIsExact) {
  for (const auto format : {SampleFormat::rgba8_depth8, SampleFormat::rgba16f_depth8})
    for (const std::size_t rows : {1, 2, 7, 45})
      for (const std::uint32_t side : {1, 4, 32}) {
        const SampleTile sample = shape(format, rows, side);
        const Picture picture(sample.tile, 9);
        const PredictiveLevel level = level_of(kLosslessQuality, format);
        ChannelValues coded, back;
        const Bytes payload = encode(level, sample.tile, picture, coded);
        EXPECT_EQ(coded, picture.values);
        ASSERT_TRUE(decode(level, sample.tile, picture, payload, back));
        EXPECT_EQ(back, picture.values) << name(format) << ", " << rows << " rows, side " << side;
      }
}

TEST(PredictiveChannels, AnyValuesSurvive) {
  std::mt19937 random(2);
  for (const auto format : {SampleFormat::rgba8_depth8, SampleFormat::rgba16f_depth8}) {
    const SampleTile sample = shape(format, 5, 8);
    Picture picture(sample.tile, 3);
    const bool half = is_half(format);
    for (const TileChannel c : kInOrder)
      for (std::int32_t& value : picture.values[c]) {
        const auto any = static_cast<std::uint16_t>(random());
        value = half && c != kDepthChannel ? ordered_half(any) : any & 255;
        if (c == kDepthChannel && picture.values[kAlphaChannel][0] == 0) value = 0;
      }
    // Depth is not kept where nothing is visible; colour is.
    for (std::size_t s = 0; s < picture.values[0].size(); s += 3) {
      picture.values[kAlphaChannel][s] = 0;
      picture.values[kDepthChannel][s] = 0;
    }
    for (std::size_t s = 0; s < picture.values[0].size(); ++s)
      if (picture.values[kAlphaChannel][s] == 0) picture.values[kDepthChannel][s] = 0;
    const PredictiveLevel level = level_of(kLosslessQuality, format);
    ChannelValues coded, back;
    const Bytes payload = encode(level, sample.tile, picture, coded);
    ASSERT_TRUE(decode(level, sample.tile, picture, payload, back));
    EXPECT_EQ(back, picture.values) << name(format);
  }
}

TEST(PredictiveChannels, HalfFloatsStayWithinHalfAStep) {
  const SampleTile sample = shape(SampleFormat::rgba16f_depth8, 21, 16);
  const Picture picture(sample.tile, 9);
  std::size_t bytes = 1 << 30;
  for (const int quality : {95, 90, 60, 20}) {
    const PredictiveLevel level = level_of(quality, SampleFormat::rgba16f_depth8);
    ChannelValues coded, back;
    const Bytes payload = encode(level, sample.tile, picture, coded);
    ASSERT_TRUE(decode(level, sample.tile, picture, payload, back));
    EXPECT_EQ(back, coded);
    EXPECT_EQ(back[kAlphaChannel], picture.values[kAlphaChannel]);
    const std::int32_t step = level.steps[kLumaPlane].low / 16;
    for (std::size_t s = 0; s < back[0].size(); ++s)
      EXPECT_LE(2 * std::abs(back[kRedChannel][s] - picture.values[kRedChannel][s]), step);
    EXPECT_LT(payload.size(), bytes);
    bytes = payload.size();
  }
}

TEST(PredictiveChannels, AGoodPredictionSavesBytes) {
  const SampleTile sample = shape(SampleFormat::rgba8_depth8, 36, 32);
  const PredictiveLevel level = level_of(kLosslessQuality, SampleFormat::rgba8_depth8);
  ChannelValues coded;
  const std::size_t near = encode(level, sample.tile, Picture(sample.tile, 0), coded).size();
  Picture blind(sample.tile, 0);
  std::mt19937 random(3);
  for (const TileChannel c : kInOrder)
    for (std::size_t s = 0; s < blind.values[c].size(); ++s)
      if (blind.values[kAlphaChannel][s] != 0 && c != kAlphaChannel)
        blind.values[c][s] = static_cast<std::int32_t>(random() & 255);
  EXPECT_LT(4 * near, encode(level, sample.tile, blind, coded).size());
}

TEST(PredictiveChannels, AnyPayloadDecodesWithoutHarm) {
  for (const auto format : {SampleFormat::rgba8_depth8, SampleFormat::rgba16f_depth8}) {
    const SampleTile sample = shape(format, 3, 5);
    const Picture picture(sample.tile, 9);
    const PredictiveLevel level = level_of(kLosslessQuality, format);
    ChannelValues coded, back;
    const Bytes payload = encode(level, sample.tile, picture, coded);
    for (std::size_t size = 0; size < payload.size(); ++size)
      (void)decode(level, sample.tile, picture, ByteSpan(payload).first(size), back);
    for (std::size_t bit = 0; bit < 8 * payload.size(); ++bit) {
      Bytes flipped = payload;
      flipped[bit / 8] ^= static_cast<std::byte>(1 << bit % 8);
      (void)decode(level, sample.tile, picture, flipped, back);
      for (const TileChannel c : kInOrder)
        for (const std::int32_t value : back[c])
          ASSERT_TRUE(value >= -0x8000 && value <= 0x7FFF) << c;
    }
    Bytes longer = payload;
    longer.resize(longer.size() + 20, std::byte{1});
    EXPECT_FALSE(decode(level, sample.tile, picture, longer, back));
    EXPECT_FALSE(
        decode(level, sample.tile, picture, ByteSpan(payload).first(payload.size() / 2), back));
  }
}

TEST(HalfFloats, ConvertExactlyAndBack) {
  for (std::uint32_t bits = 0; bits < 0x10000; ++bits) {
    const auto half = static_cast<std::uint16_t>(bits);
    EXPECT_EQ(half_of_ordered(ordered_half(half)), half);
    const float value = half_to_float(half);
    if ((bits & 0x7FFF) > 0x7C00)
      EXPECT_TRUE(std::isnan(value));
    else
      EXPECT_EQ(half_from_float(value), half);
  }
  EXPECT_EQ(half_to_float(0x3C00), 1.f);
  EXPECT_EQ(half_to_float(1), 0x1p-24f);
  EXPECT_EQ(half_to_float(0x7BFF), 65504.f);
  EXPECT_EQ(half_from_float(1 + 0x1p-11f), 0x3C00);  // ties to even
  EXPECT_EQ(half_from_float(1 + 3 * 0x1p-11f), 0x3C02);
  EXPECT_EQ(half_from_float(65519.f), 0x7BFF);
  EXPECT_EQ(half_from_float(65520.f), 0x7C00);
  EXPECT_EQ(half_from_float(0x1p-25f), 0);
  EXPECT_EQ(half_from_float(3 * 0x1p-25f), 2);
  EXPECT_EQ(half_from_float(-0.5f), 0xB800);
}

}  // namespace
}  // namespace slf::codec

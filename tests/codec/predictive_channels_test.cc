// Tiles that the predictive codec codes sample by sample.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "base/half.h"
#include "codec/predictive_channels.h"
#include "codec/predictive_codec.h"
#include "tests/codec/sample_tiles.h"

namespace slf::codec {
namespace {

constexpr SampleFormat kFormats[] = {SampleFormat::rgba8_depth8, SampleFormat::rgba16f_depth8};

/// Predicts 8-bit samples, off by up to `noise`, from the first and the last of four candidates.
class Noisy {
 public:
  Noisy(const SampleTile& like, int noise) {
    std::mt19937 random(1);
    const auto near = [&](std::byte value) {
      const int off = noise == 0 ? 0 : static_cast<int>(random() % (2u * noise + 1)) - noise;
      return static_cast<std::uint8_t>(std::clamp(std::to_integer<int>(value) + off, 0, 255));
    };
    const std::size_t count = like.tile.samples();
    for (std::size_t s = 0; s < count; ++s) {
      const std::byte* const at = &like.samples[4 * s];
      alpha_.push_back(std::to_integer<std::uint8_t>(at[3]));
      depth_.push_back(near(like.samples[4 * count + s]));
      color_.push_back(near(at[0]) | std::uint32_t{near(at[1])} << 8 |
                       std::uint32_t{near(at[2])} << 16 | 0xFF000000u);
    }
  }

  [[nodiscard]] Predicted predicted() const { return {1, kKinds, kUsed, {alpha_, depth_, color_}}; }

 private:
  static constexpr std::uint8_t kKinds[] = {0, 1, 2, 3}, kUsed[] = {1, 0, 0, 1};
  std::vector<std::uint8_t> alpha_, depth_;
  std::vector<std::uint32_t> color_;
};

PredictiveCodec make(int quality, SampleFormat format) {
  const PredictiveSettings settings{quality, format};
  return {settings, predictive_tables(settings, 1)};
}

/// A tile with noise around `content` predicted.
struct Picture {
  SampleTile sample;
  Noisy noisy;

  Picture(SampleFormat format, std::size_t rows, std::uint32_t side, int noise,
          Content content = Content::disc)
      : sample(make_tile(format, rows, side, content)),
        noisy(make_tile(SampleFormat::rgba8_depth8, rows, side, Content::disc), noise) {
    // Depth is not kept where nothing is visible; colour is.
    const TileShape& tile = sample.tile;
    const std::size_t bytes = color_bytes(format), alpha = bytes / 4;
    for (std::size_t s = 0; s < tile.samples(); ++s) {
      std::byte* const at = &sample.samples[s * bytes];
      if (content == Content::noise && s % 3 == 0)
        std::fill(at + bytes - alpha, at + bytes, std::byte{0});
      if (std::all_of(at + bytes - alpha, at + bytes, [](auto b) { return b == std::byte{0}; }))
        sample.samples[tile.color_bytes() + s] = std::byte{0};
    }
  }
  Bytes encode(const Codec& codec) {
    Bytes payload;
    const Predicted from = noisy.predicted();
    EXPECT_TRUE(codec.encode(sample.tile, sample.samples, &from, payload));
    return payload;
  }
  /// Whether the payload is accepted.
  bool decode(const Codec& codec, ByteSpan payload, Bytes& samples) {
    samples.assign(sample.tile.bytes(), std::byte{77});
    const Predicted from = noisy.predicted();
    return codec.decode(sample.tile, payload, &from, samples).has_value();
  }
};

TEST(PredictiveChannels, LosslessIsExact) {
  for (const auto format : kFormats)
    for (const auto content : {Content::disc, Content::noise})
      for (const std::size_t rows : {1, 2, 7, 45})
        for (const std::uint32_t side : {1, 4, 32}) {
          Picture picture(format, rows, side, 9, content);
          const auto codec = make(kLosslessQuality, format);
          Bytes back;
          ASSERT_TRUE(picture.decode(codec, picture.encode(codec), back));
          EXPECT_EQ(back, picture.sample.samples)
              << name(format) << ", " << rows << " rows, side " << side;
        }
}

// A side of 256 has more columns than 16 bits with a sign count.
TEST(PredictiveChannels, TheLastOfManyColumnsHaveNeighbours) {
  constexpr std::uint32_t kSide = 256;
  constexpr SampleFormat kBytes = SampleFormat::rgba8_depth8;
  const auto codec = make(kLosslessQuality, kBytes);
  // Something is visible in the last lines only: in each another colour, or noise.
  const auto size = [&](bool noise) {
    Picture picture(kBytes, 1, kSide, 0, Content::zero);
    Bytes& samples = picture.sample.samples;
    Random random(1);
    std::size_t column = 0;
    for (std::uint32_t line = 0; line <= kSide; ++line) {
      std::uint64_t color = random.next();
      for (std::uint32_t p = 0; p + line <= kSide; ++p, ++column) {
        if (column <= 32768) continue;
        if (noise) color = random.next();
        for (std::size_t c = 0; c < 3; ++c)
          samples[4 * column + c] = static_cast<std::byte>(color >> (8 * c));
        samples[4 * column + 3] = std::byte{255};
        samples[picture.sample.tile.color_bytes() + column] = std::byte{99};
      }
    }
    const Bytes payload = picture.encode(codec);
    Bytes back;
    EXPECT_TRUE(picture.decode(codec, payload, back));
    EXPECT_EQ(back, samples);
    return payload.size();
  };
  EXPECT_LT(3 * size(false), 2 * size(true));
}

TEST(PredictiveChannels, PayloadsNameTheChosenCandidates) {
  for (const auto format : kFormats) {
    Picture picture(format, 3, 5, 9);
    const auto codec = make(kLosslessQuality, format);
    EXPECT_EQ(codec.references(1, picture.noisy.predicted().kinds, picture.encode(codec)),
              (std::vector<std::uint8_t>{1, 0, 0, 1}));
  }
}

TEST(PredictiveChannels, HalfFloatsStayWithinHalfAStep) {
  constexpr SampleFormat kHalf = SampleFormat::rgba16f_depth8;
  Picture picture(kHalf, 21, 16, 9);
  const Bytes& samples = picture.sample.samples;
  std::size_t bytes = 1 << 30;
  for (const int quality : {95, 90, 60, 20}) {
    const auto codec = make(quality, kHalf);
    const Bytes payload = picture.encode(codec);
    Bytes back;
    ASSERT_TRUE(picture.decode(codec, payload, back));
    const std::int32_t step =
        predictive_tables({quality, kHalf}, 1).level(1).steps[kYPlane].low / 16;
    for (std::size_t at = 0; at < picture.sample.tile.color_bytes(); at += 2) {
      const auto value = [&](const Bytes& of) {
        return ordered_half(load_le<std::uint16_t>(&of[at]));
      };
      EXPECT_LE(2 * std::abs(value(back) - value(samples)), at % 8 == 6 ? 0 : step);
    }
    EXPECT_LT(payload.size(), bytes);
    bytes = payload.size();
  }
}

TEST(PredictiveChannels, AGoodPredictionSavesBytes) {
  constexpr SampleFormat kBytes = SampleFormat::rgba8_depth8;
  const auto codec = make(kLosslessQuality, kBytes);
  EXPECT_LT(4 * Picture(kBytes, 36, 32, 0).encode(codec).size(),
            Picture(kBytes, 36, 32, 0, Content::noise).encode(codec).size());
}

TEST(PredictiveChannels, AnyPayloadDecodesWithoutHarm) {
  for (const auto format : kFormats) {
    Picture picture(format, 3, 5, 9);
    const auto codec = make(kLosslessQuality, format);
    const Bytes payload = picture.encode(codec);
    Bytes back;
    for (std::size_t size = 0; size < payload.size(); ++size)
      (void)picture.decode(codec, ByteSpan(payload).first(size), back);
    for (std::size_t bit = 0; bit < 8 * payload.size(); ++bit) {
      Bytes flipped = payload;
      flipped[bit / 8] ^= static_cast<std::byte>(1 << bit % 8);
      (void)picture.decode(codec, flipped, back);
    }
    Bytes longer = payload;
    longer.resize(longer.size() + 20, std::byte{1});
    EXPECT_FALSE(picture.decode(codec, longer, back));
    EXPECT_FALSE(picture.decode(codec, ByteSpan(payload).first(payload.size() / 2), back));
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

// What every codec promises, asked of all of them, in every format and over many shapes.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <string>
#include <thread>
#include <tuple>

#include "codec/codec.h"
#include "tests/codec/sample_tiles.h"

namespace slf::codec {
namespace {

struct Shape {
  std::size_t rows;
  std::uint32_t side;
};

constexpr Shape kShapes[] = {{0, 5},  {1, 0},  {1, 1},   {2, 0},   {3, 2},  {45, 1},
                             {45, 7}, {7, 16}, {13, 31}, {45, 32}, {2, 64}, {6, 63}};

using Parameter = std::tuple<std::string, SampleFormat>;

// Decodes into a buffer of exactly the right size, so that the address sanitizer sees any overrun.
Result<Bytes> decode_exactly(const Codec& codec, const TileShape& tile, ByteSpan payload) {
  const auto exact_payload = std::make_unique<std::byte[]>(payload.size());
  std::copy(payload.begin(), payload.end(), exact_payload.get());
  const auto samples = std::make_unique<std::byte[]>(tile.bytes());
  const Result<void> done = codec.decode(tile, {exact_payload.get(), payload.size()}, nullptr,
                                         {samples.get(), tile.bytes()});
  if (!done) return tl::unexpected(done.error());
  return Bytes(samples.get(), samples.get() + tile.bytes());
}

// The samples with the depths of what is not visible, which codecs that predict do not keep, at 0.
Bytes kept_by(const Codec& codec, const SampleTile& sample) {
  Bytes samples = sample.samples;
  const std::size_t bytes = color_bytes(sample.tile.format);
  for (std::size_t s = 0; codec.predicts() && s < sample.tile.samples(); ++s) {
    const auto alpha = ByteSpan(samples).subspan((s + 1) * bytes - bytes / 4, bytes / 4);
    if (std::ranges::all_of(alpha, [](std::byte b) { return b == std::byte{0}; }))
      samples[sample.tile.color_bytes() + s] = std::byte{0};
  }
  return samples;
}

class Conformance : public ::testing::TestWithParam<Parameter> {
 protected:
  void SetUp() override {
    auto made = make_codec(spec(), format());
    ASSERT_TRUE(made) << made.error().message;
    codec_ = std::move(*made);
  }
  const std::string& spec() const { return std::get<0>(GetParam()); }
  SampleFormat format() const { return std::get<1>(GetParam()); }

  Bytes encode(const SampleTile& sample) const {
    Bytes payload;
    const Result<void> done = codec_->encode(sample.tile, sample.samples, nullptr, payload);
    EXPECT_TRUE(done) << done.error().message;
    return payload;
  }

  std::unique_ptr<Codec> codec_;
};

TEST_P(Conformance, RoundTripsEveryShapeAndContent) {
  for (const Shape& shape : kShapes)
    for (const Content content : kAllContents) {
      SCOPED_TRACE(::testing::Message()
                   << shape.rows << " rows of side " << shape.side << ", " << name(content));
      const SampleTile sample = make_tile(format(), shape.rows, shape.side, content);
      const Result<Bytes> back = decode_exactly(*codec_, sample.tile, encode(sample));
      ASSERT_TRUE(back) << back.error().message;
      if (codec_->lossless()) {
        EXPECT_EQ(*back, kept_by(*codec_, sample));
      }
    }
}

TEST_P(Conformance, StaysCloseOnRealisticContent) {
  for (const Shape& shape : {Shape{45, 32}, Shape{6, 63}})
    for (const Content content :
         {Content::zero, Content::constant, Content::smooth, Content::disc}) {
      const SampleTile sample = make_tile(format(), shape.rows, shape.side, content);
      const Result<Bytes> back = decode_exactly(*codec_, sample.tile, encode(sample));
      ASSERT_TRUE(back) << back.error().message;
      if (!codec_->lossless() && !is_half(format())) {
        EXPECT_GT(psnr(sample.tile, sample.samples, *back), 33) << name(content);
      }
    }
}

TEST_P(Conformance, KeepsThePremultipliedInvariant) {
  if (format() != SampleFormat::rgba8) return;
  for (const Content content : {Content::disc, Content::veil}) {
    const SampleTile sample = make_tile(format(), 10, 24, content);
    const Result<Bytes> back = decode_exactly(*codec_, sample.tile, encode(sample));
    ASSERT_TRUE(back) << back.error().message;
    for (std::size_t i = 0; i < back->size(); i += 4) {
      const int error =
          std::to_integer<int>((*back)[i + 3]) - std::to_integer<int>(sample.samples[i + 3]);
      ASSERT_LE(std::abs(error), codec_->lossless() ? 0 : 24) << "alpha of sample " << i / 4;
      for (std::size_t c = 0; c < 3; ++c) ASSERT_LE((*back)[i + c], (*back)[i + 3]);
    }
  }
}

TEST_P(Conformance, ReplacesThePayload) {
  const SampleTile sample = make_tile(format(), 5, 9, Content::disc);
  Bytes payload(17, std::byte{3});
  ASSERT_TRUE(codec_->encode(sample.tile, sample.samples, nullptr, payload));
  EXPECT_EQ(payload, encode(sample));
}

TEST_P(Conformance, IsTheSameOnEveryThread) {
  const SampleTile sample = make_tile(format(), 12, 20, Content::smooth);
  const Bytes expected = encode(sample);
  std::vector<Bytes> payloads(4);
  {
    std::vector<std::jthread> threads;
    for (Bytes& payload : payloads)
      threads.emplace_back([&] {
        // Other tiles before it must leave no trace in what a thread keeps.
        const SampleTile other = make_tile(format(), 3, 33, Content::noise);
        Bytes ignored;
        (void)codec_->encode(other.tile, other.samples, nullptr, ignored);
        Bytes garbage(sample.tile.bytes());
        (void)codec_->decode(sample.tile, ignored, nullptr, garbage);
        (void)codec_->encode(sample.tile, sample.samples, nullptr, payload);
      });
  }
  EXPECT_THAT(payloads, ::testing::Each(expected));
}

TEST_P(Conformance, SpecAndTablesMakeTheSameCodec) {
  const auto again = make_codec(codec_->spec(), format(), codec_->tables());
  ASSERT_TRUE(again) << again.error().message;
  EXPECT_EQ((*again)->spec(), codec_->spec());
  EXPECT_TRUE(std::ranges::equal((*again)->tables(), codec_->tables()));
  EXPECT_EQ((*again)->lossless(), codec_->lossless());
  const SampleTile sample = make_tile(format(), 9, 15, Content::disc);
  Bytes payload;
  ASSERT_TRUE((*again)->encode(sample.tile, sample.samples, nullptr, payload));
  EXPECT_EQ(payload, encode(sample));
}

TEST_P(Conformance, TrainedCodecRoundTripsWhatItNeverSaw) {
  const SampleTile seen = make_tile(format(), 10, 16, Content::smooth);
  const TrainingTile training[] = {{seen.tile, seen.samples}};
  const auto trained = train_codec(spec(), format(), training);
  ASSERT_TRUE(trained) << trained.error().message;
  const auto opened = make_codec((*trained)->spec(), format(), (*trained)->tables());
  ASSERT_TRUE(opened) << opened.error().message;
  for (const Content content : kAllContents) {
    const SampleTile sample = make_tile(format(), 7, 21, content);
    Bytes payload;
    ASSERT_TRUE((*trained)->encode(sample.tile, sample.samples, nullptr, payload));
    const Result<Bytes> back = decode_exactly(**opened, sample.tile, payload);
    ASSERT_TRUE(back) << name(content) << ": " << back.error().message;
    if (codec_->lossless()) {
      EXPECT_EQ(*back, kept_by(*codec_, sample));
    }
  }
}

TEST_P(Conformance, TrainingIsDeterministicAndNeedsNoSample) {
  const SampleTile seen = make_tile(format(), 10, 16, Content::disc);
  const TrainingTile training[] = {{seen.tile, seen.samples}};
  const auto first = train_codec(spec(), format(), training);
  const auto second = train_codec(spec(), format(), training);
  const auto empty = train_codec(spec(), format(), {});
  ASSERT_TRUE(first && second && empty);
  EXPECT_TRUE(std::ranges::equal((*first)->tables(), (*second)->tables()));
  EXPECT_TRUE(std::ranges::equal((*empty)->tables(), codec_->tables()));
  EXPECT_EQ((*empty)->spec(), codec_->spec());
}

// Whatever comes out, error or samples, nothing may be touched that is not ours.
TEST_P(Conformance, SurvivesTruncationAtEveryLength) {
  for (const Content content : {Content::disc, Content::noise}) {
    const SampleTile sample = make_tile(format(), 6, 13, content);
    const Bytes payload = encode(sample);
    for (std::size_t length = 0; length < payload.size(); ++length) {
      const Result<Bytes> back =
          decode_exactly(*codec_, sample.tile, ByteSpan(payload).first(length));
      if (!back) {
        EXPECT_EQ(back.error().code, ErrorCode::bad_file);
      } else if (codec_->lossless() && !(codec_->predicts() && length + 4 >= payload.size())) {
        // A range coder leaves out zeros at the end.
        ADD_FAILURE() << length << " of " << payload.size() << " bytes were taken for a tile";
      }
    }
  }
}

TEST_P(Conformance, RefusesBytesAfterTheEnd) {
  const SampleTile sample = make_tile(format(), 6, 13, Content::disc);
  Bytes payload = encode(sample);
  // A JPEG decoder reads a few bytes ahead and cannot tell whether it needed them; a range decoder
  // takes them for zeros that were left out.
  payload.resize(payload.size() + (codec_->lossless() && !codec_->predicts() ? 1 : 16),
                 std::byte{0x55});
  EXPECT_FALSE(decode_exactly(*codec_, sample.tile, payload));
}

TEST_P(Conformance, SurvivesFlippedBits) {
  const SampleTile sample = make_tile(format(), 6, 13, Content::disc);
  const Bytes payload = encode(sample);
  Random random(1);
  for (int trial = 0; trial < 2000; ++trial) {
    Bytes damaged = payload;
    for (std::size_t flips = 1 + random.below(4); flips > 0; --flips)
      damaged[random.below(damaged.size())] ^= static_cast<std::byte>(1 << random.below(8));
    const Result<Bytes> back = decode_exactly(*codec_, sample.tile, damaged);
    if (!back) {
      EXPECT_EQ(back.error().code, ErrorCode::bad_file);
    }
  }
}

TEST_P(Conformance, RefusesNoiseOrMakesSamples) {
  const SampleTile sample = make_tile(format(), 6, 13, Content::zero);
  Random random(2);
  for (int trial = 0; trial < 2000; ++trial) {
    Bytes noise(random.below(200));
    for (std::byte& byte : noise) byte = static_cast<std::byte>(random.next() >> 56);
    const Result<Bytes> back = decode_exactly(*codec_, sample.tile, noise);
    if (!back) {
      EXPECT_EQ(back.error().code, ErrorCode::bad_file);
    }
  }
}

TEST_P(Conformance, RefusesAPayloadOfAnotherShape) {
  const SampleTile sample = make_tile(format(), 6, 13, Content::noise);
  const Bytes payload = encode(sample);
  for (const Shape& shape : {Shape{0, 13}, Shape{45, 13}, Shape{6, 60}}) {
    const SampleTile other = make_tile(format(), shape.rows, shape.side, Content::zero);
    const Result<Bytes> back = decode_exactly(*codec_, other.tile, payload);
    ASSERT_FALSE(back) << shape.rows << " rows of side " << shape.side;
    EXPECT_EQ(back.error().code, ErrorCode::bad_file);
  }
}

TEST_P(Conformance, RefusesDamagedTables) {
  const ByteSpan tables = codec_->tables();
  const SampleTile sample = make_tile(format(), 4, 9, Content::disc);
  const Bytes payload = encode(sample);
  for (std::size_t length = 1; length < tables.size(); ++length)
    EXPECT_FALSE(make_codec(spec(), format(), tables.first(length))) << length;
  Bytes longer(tables.begin(), tables.end());
  longer.push_back(std::byte{0});
  EXPECT_FALSE(make_codec(spec(), format(), longer));
  Random random(3);
  for (int trial = 0; trial < 500 && !tables.empty(); ++trial) {
    Bytes damaged(tables.begin(), tables.end());
    damaged[random.below(damaged.size())] ^= static_cast<std::byte>(1 << random.below(8));
    const auto made = make_codec(spec(), format(), damaged);
    if (!made) {
      EXPECT_EQ(made.error().code, ErrorCode::bad_file);
      continue;
    }
    // Tables that still make sense must be safe to use, both ways.
    (void)decode_exactly(**made, sample.tile, payload);
    Bytes ignored;
    (void)(*made)->encode(sample.tile, sample.samples, nullptr, ignored);
  }
}

TEST_P(Conformance, RawPayloadsAreTheSamples) {
  const SampleTile sample = make_tile(format(), 6, 13, Content::disc);
  EXPECT_EQ(encode(sample) == sample.samples, spec() == "raw");
}

std::string test_name(const ::testing::TestParamInfo<Parameter>& info) {
  std::string text = std::get<0>(info.param) + "_" + name(std::get<1>(info.param));
  std::ranges::replace(text, ':', '_');
  return text;
}

INSTANTIATE_TEST_SUITE_P(Lossless, Conformance,
                         ::testing::Combine(::testing::Values("raw", "zstd", "zstd:1", "zstd:19"),
                                            ::testing::ValuesIn(kAllFormats)),
                         test_name);
INSTANTIATE_TEST_SUITE_P(Lossy, Conformance,
                         ::testing::Combine(::testing::Values("jpeg:75", "jpeg:95:444", "jpeg:100"),
                                            ::testing::Values(SampleFormat::rgba8,
                                                              SampleFormat::rgba8_depth8)),
                         test_name);
// Without a predictor, as at level 0.
INSTANTIATE_TEST_SUITE_P(
    Predictive, Conformance,
    ::testing::Combine(::testing::Values("predictive:90", "predictive:lossless"),
                       ::testing::Values(SampleFormat::rgba8_depth8, SampleFormat::rgba16f_depth8)),
    test_name);

}  // namespace
}  // namespace slf::codec

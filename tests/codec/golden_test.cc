// What a tile is encoded to, byte for byte: if these tests fail, existing fields can no longer be
// read, or the same build gives another file than before. Change the files only with the format.
//
// To write them anew: SLF_WRITE_GOLDEN=1 codec_tests --gtest_filter='*Golden*'
#include <gtest/gtest.h>
#include <zstd.h>

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <iterator>

#include "codec/codec.h"
#include "tests/codec/sample_tiles.h"

namespace slf::codec {
namespace {

constexpr unsigned kGoldenZstd = 10504;

struct Case {
  const char* spec;
  SampleFormat format;
  Content content;
};

constexpr Case kCases[] = {{"raw", SampleFormat::rgba8_depth8, Content::smooth},
                           {"zstd:9", SampleFormat::rgba8, Content::disc},
                           {"zstd:9", SampleFormat::rgba8, Content::noise},
                           {"zstd:9", SampleFormat::rgba8_depth8, Content::disc},
                           {"zstd:9", SampleFormat::rgba16f_depth8, Content::disc},
                           {"jpeg:75", SampleFormat::rgba8, Content::disc},
                           {"jpeg:75", SampleFormat::rgba8, Content::veil},
                           {"jpeg:90:444", SampleFormat::rgba8, Content::disc},
                           {"jpeg:75", SampleFormat::rgba8_depth8, Content::disc}};

class Golden : public ::testing::TestWithParam<Case> {};

std::string golden_name(const ::testing::TestParamInfo<Case>& info) {
  std::string text =
      std::string(info.param.spec) + "_" + name(info.param.format) + "_" + name(info.param.content);
  std::ranges::replace(text, ':', '_');
  return text;
}

Bytes read(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  const std::string text((std::istreambuf_iterator<char>(file)), {});
  const auto bytes = std::as_bytes(std::span(text));
  return {bytes.begin(), bytes.end()};
}

TEST_P(Golden, TilesEncodeAndDecodeAsEver) {
  const auto codec = make_codec(GetParam().spec, GetParam().format);
  ASSERT_TRUE(codec) << codec.error().message;
  const SampleTile sample = make_tile(GetParam().format, 18, 5, GetParam().content);
  Bytes payload;
  ASSERT_TRUE((*codec)->encode(sample.tile, sample.samples, nullptr, payload));
  Bytes decoded(sample.tile.bytes());
  ASSERT_TRUE((*codec)->decode(sample.tile, payload, nullptr, decoded));

  const std::string base = std::string(SLF_TEST_DATA) + "/codec/" +
                           golden_name(::testing::TestParamInfo<Case>(GetParam(), 0));
  if (std::getenv("SLF_WRITE_GOLDEN")) {
    std::ofstream(base + ".payload", std::ios::binary)
        .write(reinterpret_cast<const char*>(payload.data()),
               static_cast<std::streamsize>(payload.size()));
    std::ofstream(base + ".samples", std::ios::binary)
        .write(reinterpret_cast<const char*>(decoded.data()),
               static_cast<std::streamsize>(decoded.size()));
  }
  const Bytes golden = read(base + ".payload");
  // Another zstd may find other matches; all must read what any of them wrote.
  if (ZSTD_versionNumber() == kGoldenZstd) {
    EXPECT_EQ(payload, golden);
  }
  Bytes from_golden(sample.tile.bytes());
  ASSERT_TRUE((*codec)->decode(sample.tile, golden, nullptr, from_golden));
  EXPECT_EQ(from_golden, read(base + ".samples"));
}

INSTANTIATE_TEST_SUITE_P(AllCodecs, Golden, ::testing::ValuesIn(kCases), golden_name);

}  // namespace
}  // namespace slf::codec

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "codec/codec.h"

namespace slf::codec {
namespace {

std::string normalised(const std::string& spec, SampleFormat format = SampleFormat::rgba8) {
  const auto made = make_codec(spec, format);
  return made ? (*made)->spec() : made.error().message;
}

TEST(Spec, IsNormalised) {
  EXPECT_EQ(normalised("raw"), "raw");
  EXPECT_EQ(normalised("zstd"), "zstd:9");
  EXPECT_EQ(normalised("zstd:22"), "zstd:22");
  EXPECT_EQ(normalised("jpeg"), "jpeg:75");
  EXPECT_EQ(normalised("jpeg:075"), "jpeg:75");
  EXPECT_EQ(normalised("jpeg:90:420"), "jpeg:90");
  EXPECT_EQ(normalised("jpeg:90:444"), "jpeg:90:444");
}

TEST(Spec, RefusesWhatItDoesNotKnow) {
  for (const char* spec :
       {"", "RAW", "raw:1", "zip", "zstd:", "zstd:0", "zstd:23", "zstd:9:1", "zstd:x", "zstd:9x",
        "jpeg:0", "jpeg:101", "jpeg:75:", "jpeg:75:422", "jpeg:75:444:1", "jpeg:-5", " raw"}) {
    const auto made = make_codec(spec, SampleFormat::rgba8);
    ASSERT_FALSE(made) << spec;
    EXPECT_EQ(made.error().code, ErrorCode::usage) << spec;
    EXPECT_THAT(made.error().message, ::testing::HasSubstr("jpeg[:QUALITY")) << spec;
  }
}

TEST(Spec, JpegCannotHoldHalves) {
  for (const auto format : {SampleFormat::rgba16f, SampleFormat::rgba16f_depth8}) {
    const auto made = make_codec("jpeg:75", format);
    ASSERT_FALSE(made);
    EXPECT_EQ(made.error().code, ErrorCode::unsupported);
    EXPECT_THAT(made.error().message, ::testing::HasSubstr("zstd"));
  }
}

TEST(Spec, PredictiveNeedsDepth) {
  for (const auto format : {SampleFormat::rgba8, SampleFormat::rgba16f}) {
    const auto made = make_codec("predictive:90", format);
    ASSERT_FALSE(made);
    EXPECT_EQ(made.error().code, ErrorCode::unsupported);
    EXPECT_THAT(made.error().message, ::testing::HasSubstr("needs depths"));
  }
}

TEST(Spec, CodecsWithoutTablesRefuseThem) {
  const Bytes tables(3);
  for (const char* spec : {"raw", "zstd"}) {
    const auto made = make_codec(spec, SampleFormat::rgba8, tables);
    ASSERT_FALSE(made);
    EXPECT_EQ(made.error().code, ErrorCode::bad_file);
  }
}

}  // namespace
}  // namespace slf::codec

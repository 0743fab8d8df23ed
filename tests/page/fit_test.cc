// Repacking a field to a given size.

#include "page/fit.h"

#include <gtest/gtest.h>

#include <array>

#include <filesystem>

#include "tests/field/write/rewriting.h"

namespace slf::page {
namespace {

class Fit : public ::testing::Test {
 protected:
  void SetUp() override {
    field_ = testing::build_and_open(testing::stripes(), folder_ / "in.slf",
                                     testing::lossless_options(2, 5, 1));
    ASSERT_TRUE(field_);
  }

  /// Repacks, and counts the times that all tiles were written.
  std::optional<Field> fit(std::uint64_t max_bytes, const RepackOptions& options = {}) {
    repacks_ = 0;
    std::filesystem::remove(folder_ / "out.slf");
    const std::uint64_t tiles = field_->shape().tiles(0) + field_->shape().tiles(1);
    const auto done = repack_to_fit(std::array{StateSource{"", *field_}}, folder_ / "out.slf",
                                    options, max_bytes, [&](const Progress& progress) {
                                      repacks_ += progress.done == tiles && progress.total == tiles;
                                      return true;
                                    });
    error_ = done ? "" : done.error().message;
    if (!done) {
      EXPECT_FALSE(std::filesystem::exists(folder_ / "out.slf"));
      return {};
    }
    report_ = *done;
    EXPECT_LE(std::filesystem::file_size(folder_ / "out.slf"), max_bytes);
    return *Field::open(folder_ / "out.slf");
  }

  testing::TemporaryFolder folder_;
  std::optional<Field> field_;
  RepackReport report_;
  std::string error_;
  int repacks_ = 0;
};

TEST_F(Fit, AFieldThatFitsKeepsItsCodecs) {
  ASSERT_TRUE(fit(field_->file_bytes())) << error_;
  EXPECT_EQ(report_.recoded, 0u);
}

TEST_F(Fit, QualityIsReducedBeforeLevels) {
  const auto smaller = fit(field_->file_bytes() * 2 / 3);
  ASSERT_TRUE(smaller) << error_;
  EXPECT_EQ(smaller->shape().finest_level, 1u);
  EXPECT_TRUE(smaller->codec().starts_with("predictive:")) << smaller->codec();
}

TEST_F(Fit, NothingIsWrittenThatTheEstimateSaysIsTooLarge) {
  const auto smallest = fit(120'000);
  ASSERT_TRUE(smallest) << error_;
  EXPECT_EQ(smallest->shape().finest_level, 0u);
  EXPECT_EQ(repacks_, 0);
}

TEST_F(Fit, TheLastResultSaysHowSmallItIs) {
  EXPECT_FALSE(fit(1000));
  EXPECT_NE(error_.find("there is room for 1000"), std::string::npos) << error_;
}

TEST_F(Fit, HalfFloatsLoseQualityOnlyWithDepth) {
  for (const bool depth : {true, false}) {
    auto options = testing::lossless_options(4, 12, 1);
    options.half = true;
    options.depth = depth;
    field_ = testing::build_and_open(testing::stripes(), folder_ / "half.slf", options);
    ASSERT_TRUE(field_);
    const auto smaller = fit(field_->file_bytes() * 2 / 3);
    ASSERT_TRUE(smaller) << error_;
    // jpeg, which would hold colour alone, holds no half floats.
    EXPECT_EQ(smaller->codec().starts_with("predictive:"), depth) << smaller->codec();
    EXPECT_EQ(smaller->shape().finest_level, depth ? 1u : 0u);
    std::filesystem::remove(folder_ / "half.slf");
  }
}

TEST_F(Fit, WhatTheOptionsFixStays) {
  RepackOptions options;
  options.finest_level = 1;
  options.codec = "jpeg:50";
  EXPECT_FALSE(fit(1000, options));
  const auto larger = fit(field_->file_bytes(), options);
  ASSERT_TRUE(larger) << error_;
  EXPECT_EQ(larger->shape().finest_level, 1u);
  EXPECT_EQ(larger->codec(), "jpeg:50");
}

}  // namespace
}  // namespace slf::page

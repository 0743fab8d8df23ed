#include "slf/error.h"

#include <gtest/gtest.h>

#include <memory>

#include "base/try.h"

namespace slf {
namespace {

Result<int> half_of(int value) {
  if (value % 2 != 0)
    return fail(ErrorCode::usage, "a.slf: expected an even number, found ", value);
  return value / 2;
}

TEST(Error, AResultHoldsTheValueOrTheError) {
  const Result<int> four = half_of(8);
  ASSERT_TRUE(four);
  EXPECT_EQ(*four, 4);
  const Result<int> none = half_of(7);
  ASSERT_FALSE(none);
  EXPECT_EQ(none.error().code, ErrorCode::usage);
}

TEST(Error, FailJoinsItsParts) {
  EXPECT_EQ(half_of(7).error().message, "a.slf: expected an even number, found 7");
  const auto mixed = fail(ErrorCode::io, std::string("b"), ':', 1.5, '/', 3u);
  EXPECT_EQ(mixed.value().message, "b:1.5/3");
  EXPECT_EQ(mixed.value().code, ErrorCode::io);
}

TEST(Error, APlaceComesBeforeTheMessage) {
  const auto placed = [](int value) { return at_place(half_of(value), "b.slf: tile ", 3); };
  EXPECT_EQ(*placed(4), 2);
  EXPECT_EQ(placed(5).error().message, "b.slf: tile 3: a.slf: expected an even number, found 5");
  EXPECT_EQ(placed(5).error().code, ErrorCode::usage);
  const Result<void> chosen = fail_without("time", ErrorCode::usage, "no time 3");
  EXPECT_STREQ(at_place(chosen, "a.nii").error().choice, "time");
}

TEST(Error, AnErrorMovesFromOneResultToAnother) {
  const auto doubled = [](int value) -> Result<std::string> {
    auto half = half_of(value);
    if (!half) return tl::unexpected(std::move(half.error()));
    return std::to_string(*half);
  };
  EXPECT_EQ(*doubled(4), "2");
  EXPECT_EQ(doubled(5).error().message, "a.slf: expected an even number, found 5");
}

TEST(Error, ResultsOfNothingAndOfWhatOnlyMoves) {
  const Result<void> done;
  EXPECT_TRUE(done);
  const Result<void> failed = fail(ErrorCode::failed, "no");
  EXPECT_FALSE(failed);
  Result<std::unique_ptr<int>> owned = std::make_unique<int>(3);
  const std::unique_ptr<int> moved = std::move(*owned);
  EXPECT_EQ(*moved, 3);
}

// Scripts depend on these numbers: doc/commands.md and the manual pages list them.
TEST(Error, CodesAreTheDocumentedExitCodes) {
  EXPECT_EQ(exit_code(ErrorCode::usage), 1);
  for (const auto code : {ErrorCode::io, ErrorCode::not_found}) EXPECT_EQ(exit_code(code), 2);
  EXPECT_EQ(exit_code(ErrorCode::bad_file), 3);
  for (const auto code : {ErrorCode::failed, ErrorCode::tile_missing, ErrorCode::busy,
                          ErrorCode::cancelled, ErrorCode::out_of_memory})
    EXPECT_EQ(exit_code(code), 4) << name(code);
  EXPECT_EQ(exit_code(ErrorCode::unsupported), 5);
  EXPECT_EQ(exit_code(ErrorCode::differs), 7);
}

}  // namespace
}  // namespace slf

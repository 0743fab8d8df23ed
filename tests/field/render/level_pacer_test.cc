// LevelPacer: the finest level that storage can deliver in time.

#include "field/render/level_pacer.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace slf {
namespace {

constexpr double kFrame = 1.0 / 30;
constexpr unsigned kFinest = 3;
constexpr std::size_t kMissing = 100;  // tiles that a frame lacks where storage is too slow

/// Plays for some seconds from a storage that loads one frame's tiles of level 0 in `cost`, and of
/// each finer level in four times as long. The level at the end.
unsigned play(LevelPacer& pacer, double cost, double seconds) {
  for (double t = 0; t < seconds; t += kFrame) {
    double busy = cost;
    for (unsigned level = 0; level < pacer.level(kFinest); ++level) busy *= 4;
    const bool finished = busy < kFrame;
    busy = std::min(busy, kFrame);
    pacer.add_plan({.requested = kFinest,
                    .idle = kFrame - busy,
                    .busy = busy,
                    .missing = finished ? 0 : kMissing,
                    .finished = finished});
  }
  return pacer.level(kFinest);
}

TEST(LevelPacer, LoadsEveryLevelWhereStorageKeepsUp) {
  LevelPacer pacer;
  for (int k = 0; k < 100; ++k) EXPECT_EQ(play(pacer, kFrame / 100, kFrame), kFinest);
}

TEST(LevelPacer, ASlowFrameNowAndThenChangesNothing) {
  LevelPacer pacer;
  for (int k = 0; k < 100; ++k) {
    pacer.add_plan({.requested = kFinest, .busy = 0.3, .missing = kMissing});
    EXPECT_EQ(play(pacer, 0, kFrame), kFinest);
  }
}

/// Plans that are not finished, from `missing` tiles down to `left`, `gone` fewer in each.
void fill(LevelPacer& pacer, std::size_t missing, std::size_t left, std::size_t gone) {
  for (; missing > left; missing -= gone)
    pacer.add_plan({.requested = kFinest, .busy = kFrame, .missing = missing});
}

TEST(LevelPacer, AViewMayTakeSecondsToFill) {
  LevelPacer pacer;
  fill(pacer, 800, 0, 8);  // 3.3 s
  EXPECT_EQ(pacer.level(kFinest), kFinest);
  EXPECT_EQ(play(pacer, kFrame / 100, 10), kFinest);
}

TEST(LevelPacer, TheViewOfARestingCameraMayTakeAnyTime) {
  LevelPacer pacer;
  ASSERT_EQ(play(pacer, kFrame / 5, 3), 1u);
  double seconds = 0;
  // Storage delivers 50 tiles a second, views have 160, 640 and 2,400 tiles at these levels.
  for (unsigned level = 1; level <= kFinest; level = pacer.level(kFinest)) {
    double missing = level == 1 ? 0 : level == 2 ? 640 : 2400;
    for (; missing > 0; missing -= 50 * kFrame, seconds += kFrame) {
      pacer.add_plan({.requested = kFinest,
                      .busy = kFrame,
                      .missing = static_cast<std::size_t>(missing),
                      .resting = true});
      ASSERT_EQ(pacer.level(kFinest), level);
    }
    if (level == kFinest) break;
    for (; pacer.level(kFinest) == level; seconds += kFrame) {
      ASSERT_LT(seconds, 80);
      pacer.add_plan({.requested = kFinest, .idle = kFrame, .finished = true, .resting = true});
    }
  }
  EXPECT_LT(seconds, 80);  // 3,040 tiles take 61
}

TEST(LevelPacer, AViewThatStopsFillingLosesALevel) {
  LevelPacer pacer;
  fill(pacer, 800, 400, 8);
  EXPECT_EQ(pacer.level(kFinest), kFinest);
  for (int frame = 0; frame < 20; ++frame)  // the camera needs as many tiles as are loaded
    pacer.add_plan({.requested = kFinest, .busy = kFrame, .missing = 400});
  EXPECT_EQ(pacer.level(kFinest), kFinest - 1);
}

TEST(LevelPacer, ACutToAnotherViewBeginsAgain) {
  LevelPacer pacer;
  for (int cut = 0; cut < 20; ++cut) fill(pacer, 400, 100, 30);
  EXPECT_EQ(pacer.level(kFinest), kFinest);
}

TEST(LevelPacer, LeavesOutLevelsThatComeTooLate) {
  LevelPacer pacer;
  EXPECT_EQ(play(pacer, kFrame / 5, 3), 1u);  // level 1 takes 4/5 of a frame, level 2 more than 3
  LevelPacer hopeless;
  EXPECT_EQ(play(hopeless, 2 * kFrame, 10), 0u);
  EXPECT_EQ(play(hopeless, 2 * kFrame, 60), 0u);
}

TEST(LevelPacer, AddsThemWhenTheCameraRests) {
  LevelPacer pacer;
  ASSERT_EQ(play(pacer, kFrame / 5, 3), 1u);
  EXPECT_EQ(play(pacer, 0, 20), kFinest);
}

TEST(LevelPacer, ALevelJustTooFineIsTriedMoreAndMoreRarely) {
  // Level 1 leaves time for what level 2 should take, which takes more.
  LevelPacer pacer;
  double fine = 0, seconds = 0;
  for (; seconds < 60; seconds += kFrame) {
    const bool too_fine = pacer.level(kFinest) >= 2;
    fine += too_fine ? kFrame : 0;
    pacer.add_plan({.requested = kFinest,
                    .idle = too_fine ? 0 : 0.9 * kFrame,
                    .busy = too_fine ? kFrame : 0.1 * kFrame,
                    .missing = too_fine ? kMissing : 0,
                    .finished = !too_fine});
  }
  EXPECT_LT(fine, 0.2 * seconds);
}

}  // namespace
}  // namespace slf

#include "base/parallel.h"

#include <gtest/gtest.h>

#include <array>
#include <chrono>
#include <new>
#include <stdexcept>

namespace slf {
namespace {

TEST(ParallelFor, CallsEachOnceOnAnyNumberOfThreads) {
  for (const unsigned threads : {0u, 1u, 2u, 5u}) {
    std::array<std::atomic<int>, 1000> calls{};
    ASSERT_TRUE(parallel_for(calls.size(), threads, [&](std::uint64_t k) { ++calls[k]; }));
    for (const auto& count : calls) EXPECT_EQ(count, 1);
  }
  EXPECT_TRUE(parallel_for(0, 3, [](std::uint64_t) { FAIL(); }));
}

TEST(ParallelFor, AnExceptionEndsTheLoopAndComesBackAsAnError) {
  for (const unsigned threads : {1u, 4u}) {
    std::atomic<std::uint64_t> calls{0};
    const auto done = parallel_for(1u << 20, threads, [&](std::uint64_t) {
      if (++calls == 10) throw std::bad_alloc();
    });
    ASSERT_FALSE(done);
    EXPECT_EQ(done.error().code, ErrorCode::out_of_memory);
    EXPECT_EQ(done.error().message, "out of memory");
    EXPECT_LT(calls, 1u << 20);
  }
  const auto done =
      parallel_for(3, 3, [](std::uint64_t) { throw std::runtime_error("no such ray"); });
  ASSERT_FALSE(done);
  EXPECT_NE(done.error().message.find("no such ray"), std::string::npos);
  EXPECT_FALSE(parallel_for(1, 1, [](std::uint64_t) { throw 7; }));  // NOLINT
  EXPECT_TRUE(parallel_for(3, 3, [](std::uint64_t) {}));             // the pool lives on
}

TEST(OnThreads, OtherThreadsTakePart) {
  std::atomic<int> present{0};
  const auto done = on_threads(3, [&] {
    ++present;
    while (present < 3) std::this_thread::yield();
  });
  EXPECT_TRUE(done);
  EXPECT_EQ(present, 3);
}

TEST(OnThreads, AnExceptionOnAnotherThreadComesBack) {
  const auto caller = std::this_thread::get_id();
  std::atomic<bool> thrown{false};
  const auto done = on_threads(2, [&] {
    if (std::this_thread::get_id() == caller) {
      while (!thrown) std::this_thread::yield();
    } else {
      thrown = true;
      throw std::bad_alloc();
    }
  });
  ASSERT_FALSE(done);
  EXPECT_EQ(done.error().message, "out of memory");
}

TEST(OnThreads, CallsNestAndComeFromSeveralThreads) {
  std::atomic<int> sum{0};
  std::vector<std::jthread> callers;
  for (int caller = 0; caller < 4; ++caller)
    callers.emplace_back([&] {
      for (int round = 0; round < 50; ++round)
        EXPECT_TRUE(parallel_for(4, 3, [&](std::uint64_t) {
          EXPECT_TRUE(parallel_for(5, 2, [&](std::uint64_t) { ++sum; }));
        }));
    });
  callers.clear();
  EXPECT_EQ(sum, 4 * 50 * 4 * 5);
}

TEST(OrderedPipeline, HandsOutInOrderAndStaysInsideItsWindow) {
  constexpr std::uint64_t kCount = 500;
  constexpr std::size_t kWindow = 7;
  for (const unsigned threads : {1u, 3u}) {
    std::atomic<std::uint64_t> taken{0}, furthest{0};
    OrderedPipeline<std::uint64_t> pipeline(kCount, threads, kWindow, [&] {
      return [&](std::uint64_t k) {
        EXPECT_LT(k, taken + kWindow + 1);  // `taken` is counted after take() made room
        for (std::uint64_t old = furthest; old < k && !furthest.compare_exchange_weak(old, k);) {
        }
        return 3 * k;
      };
    });
    for (std::uint64_t k = 0; k < kCount; ++k) {
      EXPECT_EQ(pipeline.take(), 3 * k);
      ++taken;
    }
    EXPECT_EQ(furthest, kCount - 1);
  }
}

TEST(OrderedPipeline, AnErrorOrExceptionComesBackInItsPlace) {
  OrderedPipeline<int> pipeline(4, 2, 2, [] {
    return [](std::uint64_t k) -> Result<int> {
      if (k == 1) throw std::bad_alloc();
      if (k == 2) return fail(ErrorCode::bad_file, "tile 2");
      return static_cast<int>(k);
    };
  });
  EXPECT_EQ(pipeline.take(), 0);
  const auto second = pipeline.take();
  ASSERT_FALSE(second);
  EXPECT_EQ(second.error().code, ErrorCode::out_of_memory);
  EXPECT_EQ(second.error().message, "out of memory");
  const auto third = pipeline.take();
  ASSERT_FALSE(third);
  EXPECT_EQ(third.error().message, "tile 2");
  EXPECT_EQ(pipeline.take(), 3);
}

TEST(OrderedPipeline, EndsEarlyAndWithoutItems) {
  OrderedPipeline<int> early(1000, 3, 4, [] { return [](std::uint64_t) { return 1; }; });
  EXPECT_EQ(early.take(), 1);
  OrderedPipeline<int> none(0, 2, 4, [] { return [](std::uint64_t) { return 1; }; });
}

TEST(OrderedPipeline, AMakerThatCannotBeMadeIsAnError) {
  OrderedPipeline<int> pipeline(3, 2, 4,
                                []() -> OrderedPipeline<int>::Maker { throw std::bad_alloc(); });
  const auto item = pipeline.take();
  ASSERT_FALSE(item);
  EXPECT_EQ(item.error().message, "out of memory");
}

}  // namespace
}  // namespace slf

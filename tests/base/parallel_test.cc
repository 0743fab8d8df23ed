#include "base/parallel.h"

#include <dlfcn.h>
#include <gtest/gtest.h>
#include <pthread.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <new>
#include <stdexcept>

#include "base/reporter.h"
#include "tests/sanitized.h"

namespace {
std::atomic<int> threads_left{1 << 30};
}

// Stands before that of the C library, so that a test can refuse threads.
extern "C" int pthread_create(pthread_t* thread, const pthread_attr_t* attributes,
                              void* (*run)(void*), void* argument) {
  static auto* const real =
      reinterpret_cast<decltype(&pthread_create)>(dlsym(RTLD_NEXT, "pthread_create"));
  return threads_left.fetch_sub(1) > 0 ? real(thread, attributes, run, argument) : EAGAIN;
}

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

/// A call in which `threads` threads are at work at once.
bool takes(int threads) {
  std::atomic<int> present{0};
  return on_threads(static_cast<unsigned>(threads),
                    [&] {
                      ++present;
                      while (present < threads) std::this_thread::yield();
                    })
      .has_value();
}

// On more threads than before, too, and while another thread uses the pool.
TEST(OnThreads, AForkedProcessHasThreadsOfItsOwn) {
#ifdef __SANITIZE_THREAD__
  GTEST_SKIP() << "the thread sanitizer ends forked processes that start threads";
#endif
  for (const bool busy : {false, true}) {
    std::jthread other([&](const std::stop_token& stop) {
      while (busy && !stop.stop_requested()) EXPECT_TRUE(takes(3));
    });
    for (int round = 0; round < testing::repetitions(50); ++round) {
      ASSERT_TRUE(takes(4));
      const pid_t child = fork();
      if (child == 0) {
        alarm(20);
        bool all = true;
        for (const int threads : {4, 2, 7, 4}) all = all && takes(threads);
        _exit(all ? 0 : 1);
      }
      int status = 0;
      waitpid(child, &status, 0);
      ASSERT_EQ(status, 0) << "hangs";
    }
  }
  EXPECT_TRUE(takes(5));
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

TEST(ParallelFor, ReportsAllWorkAndStopsWhenTold) {
  for (const unsigned threads : {1u, 3u}) {
    std::vector<std::uint64_t> reports;
    const ProgressCallback note = [&](const Progress& progress) {
      EXPECT_EQ(progress.total, 20u);
      reports.push_back(progress.done);
      return true;
    };
    Reporter reporter(note, {0, 20, 0}, "stopped");
    EXPECT_TRUE(parallel_for(20, threads, reporter, [](std::uint64_t) {}));
    EXPECT_TRUE(std::ranges::is_sorted(reports));
    EXPECT_EQ(reports.back(), 20u);

    const ProgressCallback stop = [](const Progress&) { return false; };
    Reporter stopping(stop, {0, 1u << 20, 0}, "stopped");
    std::atomic<std::uint64_t> calls{0};
    const auto done = parallel_for(1u << 20, threads, stopping, [&](std::uint64_t) {
      ++calls;
      std::this_thread::yield();
    });
    ASSERT_FALSE(done);
    EXPECT_EQ(done.error().code, ErrorCode::cancelled);
    EXPECT_EQ(done.error().message, "stopped");
    EXPECT_LT(calls, 1u << 20);
  }
}

TEST(MakeInOrder, HandsOutInOrderAndStaysInsideItsWindow) {
  constexpr std::uint64_t kCount = 500;
  constexpr std::size_t kWindow = 7;
  for (const unsigned threads : {1u, 3u}) {
    std::atomic<std::uint64_t> taken{0}, furthest{0};
    const auto make = [&](std::uint64_t k) -> Result<std::uint64_t> {
      EXPECT_LT(k, taken + kWindow + 1);  // `taken` is counted after that made room
      for (std::uint64_t old = furthest; old < k && !furthest.compare_exchange_weak(old, k);) {
      }
      return 3 * k;
    };
    const auto use = [&](std::uint64_t k, std::uint64_t item) -> Result<void> {
      EXPECT_EQ(k, taken);
      EXPECT_EQ(item, 3 * k);
      ++taken;
      return {};
    };
    EXPECT_TRUE(make_in_order(
        kCount, threads, kWindow, [&] { return make; }, use));
    EXPECT_EQ(taken, kCount);
    EXPECT_EQ(furthest, kCount - 1);
  }
}

TEST(MakeInOrder, NeedsNoThreadOfTheSystem) {
  for (const int allowed : {0, 1}) {
    std::uint64_t sum = 0;
    threads_left = allowed;
    const auto done = make_in_order(
        100, 3, 7, [] { return [](std::uint64_t k) -> Result<std::uint64_t> { return k; }; },
        [&](std::uint64_t, std::uint64_t item) -> Result<void> {
          sum += item;
          return {};
        });
    threads_left = 1 << 30;
    EXPECT_TRUE(done) << done.error().message;
    EXPECT_EQ(sum, 4950u);
  }
  threads_left = 0;
  const auto refused = guarded([] { std::thread([] {}).join(); });
  threads_left = 1 << 30;
  EXPECT_EQ(refused.error().message,
            "the system starts no more threads; raise its limit (ulimit -u)");
}

TEST(MakeInOrder, ReturnsTheFirstErrorOrException) {
  for (const bool throws : {false, true}) {
    const auto make = [&](std::uint64_t k) -> Result<int> {
      if (k == 2 && throws) throw std::bad_alloc();
      if (k >= 2) return fail(ErrorCode::bad_file, "tile ", k);
      return static_cast<int>(k);
    };
    std::uint64_t used = 0;
    const auto done = make_in_order(
        4, 2, 2, [&] { return make; },
        [&](std::uint64_t, int) -> Result<void> { return ++used, Result<void>(); });
    EXPECT_EQ(used, 2u);
    ASSERT_FALSE(done);
    EXPECT_EQ(done.error().message, throws ? "out of memory" : "tile 2");
  }
}

TEST(MakeInOrder, StopsWhenAnItemCannotBeUsed) {
  std::atomic<int> made{0};
  const auto make = [&](std::uint64_t) -> Result<int> { return ++made; };
  for (const bool throws : {false, true}) {
    made = 0;
    const auto use = [&](std::uint64_t k, int) -> Result<void> {
      if (k == 1 && throws) throw std::bad_alloc();
      if (k == 1) return fail(ErrorCode::cancelled, "stopped");
      return {};
    };
    const auto done = make_in_order(
        1000, 3, 4, [&] { return make; }, use);
    ASSERT_FALSE(done);
    EXPECT_EQ(done.error().message, throws ? "out of memory" : "stopped");
    EXPECT_LE(made, 2 + 4);
  }
  EXPECT_TRUE(make_in_order(
      0, 2, 4, [&] { return make; },
      [](auto, int) -> Result<void> {
        ADD_FAILURE();
        return {};
      }));
}

TEST(MakeInOrder, AMakerThatCannotBeMadeIsAnError) {
  using Maker = std::function<Result<int>(std::uint64_t)>;
  const auto done = make_in_order(
      3, 2, 4, []() -> Maker { throw std::bad_alloc(); },
      [](std::uint64_t, int) { return Result<void>(); });
  ASSERT_FALSE(done);
  EXPECT_EQ(done.error().message, "out of memory");
}

}  // namespace
}  // namespace slf

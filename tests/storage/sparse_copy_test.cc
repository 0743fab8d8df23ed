// SparseCopy: what threads fetch together, when fetching fails in any way.
#include "storage/internal/sparse_copy.h"

#include <gtest/gtest.h>

#include <atomic>
#include <future>
#include <new>
#include <string>
#include <thread>

namespace slf::storage::internal {
namespace {

/// Bytes that tell their place. Its fetches do what a test says first.
class Source final : public RangeSource {
 public:
  [[nodiscard]] const std::string& name() const override { return name_; }
  [[nodiscard]] std::uint64_t size() const override { return 1 << 20; }
  [[nodiscard]] Result<void> fetch(std::span<const FileRange> ranges, const Sink& sink) override {
    if (before) before(++fetches);
    for (const FileRange& range : ranges) {
      Bytes bytes(range.end - range.begin);
      for (std::size_t i = 0; i < bytes.size(); ++i) bytes[i] = at(range.begin + i);
      if (auto ok = sink(range.begin, bytes); !ok) return ok;
    }
    return {};
  }
  static std::byte at(std::uint64_t offset) { return static_cast<std::byte>(offset * 7 + 1); }

  std::function<void(int fetch)> before;
  std::atomic<int> fetches{0};

 private:
  const std::string name_ = "http://example.org/field.slf";
};

void expect_bytes(const SparseCopy& copy, std::uint64_t offset, std::uint64_t size) {
  const auto bytes = copy.bytes(offset, size);
  ASSERT_TRUE(bytes) << bytes.error().message;
  for (std::uint64_t i = 0; i < size; ++i) ASSERT_EQ((*bytes)[i], Source::at(offset + i));
}

TEST(SparseCopy, AFetchThatThrowsLeavesNothingClaimed) {
  const auto source = std::make_shared<Source>();
  const auto copy = SparseCopy::make(source);
  ASSERT_TRUE(copy);
  source->before = [](int fetch) {
    if (fetch == 1) throw std::bad_alloc();
  };
  EXPECT_EQ((*copy)->bytes(5000, 100).error().code, ErrorCode::out_of_memory);
  auto done = std::async(std::launch::async, [&] { expect_bytes(**copy, 5000, 100); });
  if (done.wait_for(std::chrono::seconds(10)) != std::future_status::ready) {
    std::fprintf(stderr, "the bytes still count as being fetched\n");
    std::abort();  // nothing ends the thread that waits
  }
}

TEST(SparseCopy, ThreadsThatWaitForAFetchThatFailsFetchThemselves) {
  const auto source = std::make_shared<Source>();
  const auto copy = SparseCopy::make(source);
  ASSERT_TRUE(copy);
  std::promise<void> begun, go_on;
  source->before = [&](int fetch) {
    if (fetch > 1) return;
    begun.set_value();
    go_on.get_future().wait();
    throw std::bad_alloc();
  };
  std::thread first([&] { EXPECT_FALSE((*copy)->bytes(0, 4096)); });
  begun.get_future().wait();
  std::vector<std::thread> others;
  for (std::uint64_t k = 0; k < 4; ++k)
    others.emplace_back([&, k] { expect_bytes(**copy, k * 1000, 1000); });
  std::this_thread::sleep_for(std::chrono::milliseconds(50));
  EXPECT_EQ(source->fetches, 1);  // what is on its way is not fetched twice
  go_on.set_value();
  first.join();
  for (std::thread& thread : others) thread.join();
  EXPECT_GE(source->fetches, 2);
}

TEST(SparseCopy, ThreadsFetchOverlappingRangesOnce) {
  const auto source = std::make_shared<Source>();
  const auto copy = SparseCopy::make(source);
  ASSERT_TRUE(copy);
  source->before = [](int) { std::this_thread::sleep_for(std::chrono::milliseconds(2)); };
  std::vector<std::thread> threads;
  for (unsigned thread = 0; thread < 4; ++thread)
    threads.emplace_back([&, thread] {
      for (std::uint64_t k = 0; k < 64; ++k)
        expect_bytes(**copy, (k * (thread + 3) * 16001) % ((1 << 20) - 40000), 40000);
    });
  for (std::thread& thread : threads) thread.join();
  EXPECT_LE(source->fetches, 64);
}

}  // namespace
}  // namespace slf::storage::internal

// Remote fields where memory is short: each allocation fails once. Nothing ends the program or
// waits for ever, and what follows works.
#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <iterator>
#include <new>
#include <optional>
#include <utility>

#include "field/remote/http_source.h"
#include "slf/remote.h"
#include "slf/render.h"
#include "tests/remote/http_host.h"
#include "tests/sanitized.h"

namespace {
thread_local long allocations_left = -1;  // of this thread, before one fails; -1: none does
}  // namespace

[[gnu::noinline]] void* operator new(std::size_t size) {
  if (allocations_left >= 0 && allocations_left-- == 0) throw std::bad_alloc();
  if (void* const memory = std::malloc(size == 0 ? 1 : size)) return memory;
  throw std::bad_alloc();
}
[[gnu::noinline]] void operator delete(void* memory) noexcept { std::free(memory); }
[[gnu::noinline]] void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }

namespace slf {
namespace {

using testing::HttpHost;

constexpr RemoteOptions kOptions{
    .parallel = 2, .attempts = 2, .stall_timeout = 2, .first_retry_delay = 0.01};

std::string content() {
  std::ifstream file(SLF_TEST_DATA "/golden/example.slf", std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

/// Calls `f` with allocation after allocation failing, until none does. Returns how many failed.
/// `f` returns a Result, or throws std::bad_alloc.
template <class F>
long fail_each_allocation(long step, const F& f) {
  for (long n = 0;; n += step) {
    allocations_left = n;
    bool done = false;
    try {
      done = f();
    } catch (const std::bad_alloc&) {
    }
    const bool none_failed = allocations_left >= 0;
    allocations_left = -1;
    if (none_failed) {
      EXPECT_TRUE(done);
      return n;
    }
  }
}

TEST(RemoteMemory, AFetchThatFailsLeavesItsSourceInOrder) {
  const std::string file = content();
  const HttpHost host(file);
  const auto source = HttpSource::open(host.url(), kOptions, {});
  ASSERT_TRUE(source);
  const storage::FileRange ranges[] = {{0, 5000}, {6000, 7000}, {8000, 9000}, {9500, 9600}};
  const auto fetch = [&] {
    std::size_t right = 0;
    const auto fetched =
        (*source)->fetch(ranges, [&](std::uint64_t offset, ByteSpan bytes) -> Result<void> {
          const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
          right += text == std::string_view(file).substr(offset, bytes.size());
          return {};
        });
    return fetched && right == std::size(ranges);
  };
  const long failed = fail_each_allocation(1, [&] {
    const bool done = fetch();
    return done;
  });
  EXPECT_GT(failed, 10);
  EXPECT_TRUE(fetch());
}

TEST(RemoteMemory, AnAddressIsOpenedOrNot) {
  const HttpHost host(content());
  EXPECT_GT(fail_each_allocation(
                1, [&] { return HttpSource::open(host.url(), kOptions, {}).has_value(); }),
            5);
}

// Opening is left out: the JSON library ends the program if it cannot allocate in a destructor.
TEST(RemoteMemory, AFieldIsDrawnOrNot) {
  const HttpHost host(content());
  std::optional<RemoteField> remote;
  std::optional<Renderer> renderer;
  const ViewOptions view{RenderMode::bitri, 0};
  const auto draw = [&] {
    const long left = std::exchange(allocations_left, -1);
    renderer.reset();
    remote = *RemoteField::open(host.url(), kOptions);
    const Camera camera = orbit_camera(remote->field().shape().sphere, 30, 20, 3, 32, 32);
    renderer.emplace(remote->field(), RendererOptions{.threads = 1});
    allocations_left = left;
    bool drawn = false;
    try {
      drawn = renderer->render(camera, view).has_value();
    } catch (const std::bad_alloc&) {
    }
    const long rest = std::exchange(allocations_left, -1);
    const auto again = renderer->render(camera, view);
    EXPECT_TRUE(again) << (again ? "" : again.error().message);
    allocations_left = rest;
    return drawn;
  };
  EXPECT_GT(fail_each_allocation(testing::kSanitized ? 50 : 1, draw), 50);
}

}  // namespace
}  // namespace slf

// A scene that throws, or runs out of memory, on any thread: the call returns an error.
#include <new>
#include <thread>

#include "slf/scene.h"
#include "tests/field/field_testing.h"

namespace slf {
namespace {

/// A scene that throws on every thread but the one that made it, once its bounds are known.
testing::FunctionScene throwing_elsewhere() {
  return testing::FunctionScene(
      [caller = std::this_thread::get_id()](const glm::dvec3&, const glm::dvec3&) -> RaySample {
        if (std::this_thread::get_id() != caller) throw std::bad_alloc();
        std::this_thread::yield();
        return {{0.5f, 0.5f, 0.5f, 1}, 0.5f};
      });
}

TEST(ExceptionsOnWorkers, EndABuildWithAnError) {
  const testing::TemporaryFolder scratch;
  const auto report =
      build_field(throwing_elsewhere(), scratch / "a.slf", testing::lossless_options(2, 3, 1));
  ASSERT_FALSE(report);
  EXPECT_EQ(report.error().code, ErrorCode::out_of_memory);
  EXPECT_NE(report.error().message.find("out of memory"), std::string::npos);
}

TEST(ExceptionsOnWorkers, EndATracedViewWithAnError) {
  const auto scene = throwing_elsewhere();
  const Camera camera = orbit_camera(scene.bounds(), 30, 20, 3, 256, 256);
  const auto image = trace_view(scene, scene.bounds(), camera, 3);
  ASSERT_FALSE(image);
  EXPECT_EQ(image.error().code, ErrorCode::out_of_memory);
  EXPECT_EQ(image.error().message, "out of memory");
}

}  // namespace
}  // namespace slf

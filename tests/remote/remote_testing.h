// RemoteTest: a field on a server that tests of remote fields draw from.
#pragma once

#include <gmock/gmock.h>

#include <chrono>
#include <fstream>
#include <iterator>
#include <memory>
#include <string>

#include "field/write/field_writer.h"
#include "slf/remote.h"
#include "tests/field/field_testing.h"
#include "tests/remote/http_host.h"

namespace slf {

using ::testing::HasSubstr;
using testing::HttpHost;
using Exchange = HttpHost::Exchange;

inline constexpr RemoteOptions kImpatient{
    .parallel = 4, .attempts = 3, .stall_timeout = 1, .first_retry_delay = 0.01};

inline std::string content(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

/// A field, built once: its tiles are predicted, and it ends with an index.
class RemoteTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = std::make_unique<testing::TemporaryFolder>();
    const auto scene = make_analytic_scene("balls");
    BuildOptions options = testing::lossless_options(4, 16, 1);
    options.codec = "predictive:90";
    const auto built = build_field(**scene, path(), options);
    ASSERT_TRUE(built) << built.error().message;
    ASSERT_TRUE(index_field(path()));
    content_ = content(path());
  }
  static void TearDownTestSuite() { folder_.reset(); }

  static std::string path() { return *folder_ / "field.slf"; }
  static Camera camera() {
    return orbit_camera(Field::open(path())->shape().sphere, 30, 20, 3, 96, 96);
  }
  /// Opens a field and draws it.
  static Result<Image> draw(const HttpHost& host, const RemoteOptions& options = kImpatient) {
    const auto remote = RemoteField::open(host.url(), options);
    if (!remote) return tl::unexpected(remote.error());
    Renderer renderer(remote->field(), {.threads = 2});
    return renderer.render(camera(), {RenderMode::depth, 1});
  }
  static void expect_picture(const Result<Image>& image) {
    ASSERT_TRUE(image) << image.error().message;
    EXPECT_EQ(image->rgba,
              testing::draw(*Field::open(path()), camera(), {RenderMode::depth, 1}).rgba);
  }
  static void expect_error(const HttpHost& host, ErrorCode code, const std::string& text) {
    const auto begin = std::chrono::steady_clock::now();
    const auto image = draw(host);
    ASSERT_FALSE(image);
    EXPECT_EQ(image.error().code, code) << image.error().message;
    EXPECT_THAT(image.error().message, HasSubstr(host.url()));
    EXPECT_THAT(image.error().message, HasSubstr(text));
    EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(20));
  }

  static inline std::unique_ptr<testing::TemporaryFolder> folder_;
  static inline std::string content_;
};

}  // namespace slf

// Images on disk: what is written is read back, the right way up, whole or not at all.
#include "slf/image.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <limits>

#include "tests/temporary_folder.h"

namespace slf {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

/// A folder of its own for each test.
class ImageFile : public ::testing::Test {
 protected:
  [[nodiscard]] std::string path(const std::string& name) const { return folder_ / name; }
  [[nodiscard]] int files() const { return static_cast<int>(folder_.files().size()); }

  testing::TemporaryFolder folder_{fs::temp_directory_path()};
};

float unit(std::uint32_t byte) { return static_cast<float>(byte) / 255; }

/// An opaque picture in which every pixel and both directions differ.
Image gradient(std::uint32_t width, std::uint32_t height) {
  Image image{width, height, {}, {}};
  for (std::uint32_t y = 0; y < height; ++y)
    for (std::uint32_t x = 0; x < width; ++x)
      image.rgba.emplace_back(unit(x * 7 % 256), unit(y * 11 % 256), unit((x + y) % 256), 1);
  return image;
}

void expect_equal(const Image& a, const Image& b, float tolerance) {
  ASSERT_EQ(a.width, b.width);
  ASSERT_EQ(a.height, b.height);
  ASSERT_EQ(a.rgba.size(), b.rgba.size());
  for (std::size_t i = 0; i < a.rgba.size(); ++i)
    for (int c = 0; c < 4; ++c)
      ASSERT_NEAR(a.rgba[i][c], b.rgba[i][c], tolerance) << "pixel " << i << " channel " << c;
  EXPECT_EQ(a.depth, b.depth);
}

TEST(ToRgb8, RoundsToNearestAndClamps) {
  Image image{5, 1, {}, {}};
  for (const float value : {0.49F / 255, 0.51F / 255, 254.4F / 255, 7.0F, -1.0F})
    image.rgba.emplace_back(value, 0.5F, std::numeric_limits<float>::quiet_NaN(), 1);
  EXPECT_THAT(to_rgb8(image),
              ::testing::ElementsAre(0, 128, 0, 1, 128, 0, 254, 128, 0, 255, 128, 0, 0, 128, 0));
}

TEST(ToRgb8, PutsThePictureOverTheBackground) {
  const Image image{2, 1, {glm::vec4(0.2F, 0, 0, 0.2F), glm::vec4(0)}, {}};
  EXPECT_THAT(to_rgb8(image, glm::vec3(1, 0.5F, 0)),
              ::testing::ElementsAre(255, 102, 0, 255, 128, 0));
}

TEST_F(ImageFile, PngKeepsEveryByte) {
  const Image image = gradient(67, 31);
  ASSERT_TRUE(write_image(path("a.png"), image));
  const auto read = read_image(path("a.png"));
  ASSERT_TRUE(read) << read.error().message;
  expect_equal(image, *read, 1e-6F);
  EXPECT_EQ(to_rgb8(image), to_rgb8(*read));
}

TEST_F(ImageFile, PngOfATransparentPictureKeepsStraightColourAndAlpha) {
  const Image image{
      3, 1, {glm::vec4(0.5F, 0.25F, 0, 0.5F), glm::vec4(0), glm::vec4(1, 0, 0, 1)}, {}};
  ASSERT_TRUE(write_image(path("a.png"), image, {.transparent = true}));
  const auto read = read_image(path("a.png"));
  ASSERT_TRUE(read) << read.error().message;
  expect_equal(image, *read, 1.01F / 255);
  EXPECT_EQ(read->rgba[1], glm::vec4(0));
}

TEST_F(ImageFile, OpaqueFormatsShowTheBackground) {
  const Image clear{8, 8, std::vector<glm::vec4>(64, glm::vec4(0)), {}};
  for (const char* name : {"a.png", "a.jpg"}) {
    ASSERT_TRUE(write_image(path(name), clear, {.background = glm::vec3(1, 0, 0)}));
    const auto read = read_image(path(name));
    ASSERT_TRUE(read) << read.error().message;
    EXPECT_NEAR(read->rgba[0].r, 1, 0.02);
    EXPECT_NEAR(read->rgba[0].g, 0, 0.02);
    EXPECT_EQ(read->rgba[0].a, 1);
  }
}

TEST_F(ImageFile, JpegIsCloseAndBetterAtHigherQuality) {
  Image image = gradient(64, 48);
  for (auto& pixel : image.rgba) pixel.r = pixel.b;  // smooth enough for JPEG
  double worse = 0;
  for (const int quality : {30, 92}) {
    ASSERT_TRUE(write_image(path("a.jpg"), image, {.jpeg_quality = quality}));
    const auto read = read_image(path("a.jpg"));
    ASSERT_TRUE(read) << read.error().message;
    const double psnr = compare(image, *read).psnr;
    EXPECT_GT(psnr, worse);
    worse = psnr;
  }
  EXPECT_GT(worse, 40);
}

TEST_F(ImageFile, ExrKeepsFloatsBeyondOneAndDepthToInfinity) {
  Image image = gradient(19, 7);
  image.rgba[3] = glm::vec4(1234.567F, 1e-6F, 0, 0.3F);
  image.depth.assign(image.pixels(), std::numeric_limits<float>::infinity());
  image.depth[5] = 123.456F;
  ASSERT_TRUE(write_image(path("a.exr"), image));
  const auto read = read_image(path("a.exr"));
  ASSERT_TRUE(read) << read.error().message;
  expect_equal(image, *read, 0);
}

TEST_F(ImageFile, ExrWithoutDepthReadsWithoutDepth) {
  ASSERT_TRUE(write_image(path("a.exr"), gradient(4, 4)));
  EXPECT_TRUE(read_image(path("a.exr"))->depth.empty());
}

TEST_F(ImageFile, FirstRowIsOnTopInEveryFormat) {
  Image image{16, 16, std::vector<glm::vec4>(256, glm::vec4(0, 0, 0, 1)), {}};
  for (int i = 0; i < 128; ++i) image.rgba[i] = glm::vec4(1);  // the upper half is white
  for (int y = 0; y < 16; ++y) image.rgba[y * 16] = glm::vec4(1, 0, 0, 1);  // the left edge is red
  for (const char* name : {"a.png", "a.jpg", "a.exr"}) {
    ASSERT_TRUE(write_image(path(name), image, {.jpeg_quality = 100}));
    const auto read = read_image(path(name));
    ASSERT_TRUE(read) << read.error().message;
    EXPECT_GT(read->rgba[8].g, 0.9) << name;
    EXPECT_LT(read->rgba[15 * 16 + 8].g, 0.1) << name;
    EXPECT_GT(read->rgba[8 * 16].r, 0.9) << name;
  }
}

TEST_F(ImageFile, ExtensionMayBeUpperCaseAndContentDecidesOnReading) {
  ASSERT_TRUE(write_image(path("a.JPEG"), gradient(9, 9)));
  fs::rename(path("a.JPEG"), path("b.png"));
  EXPECT_TRUE(read_image(path("b.png")));
}

TEST_F(ImageFile, RefusesUnknownExtensionsAndPicturesWithoutPixels) {
  for (const char* name : {"a.bmp", "a", "png"}) {
    const auto written = write_image(path(name), gradient(2, 2));
    ASSERT_FALSE(written);
    EXPECT_EQ(written.error().code, ErrorCode::usage);
    EXPECT_THAT(written.error().message, HasSubstr(".png, .jpg or .exr"));
  }
  EXPECT_EQ(write_image(path("a.png"), Image{}).error().code, ErrorCode::usage);
  EXPECT_EQ(write_image(path("a.png"), Image{2, 2, {glm::vec4(0)}, {}}).error().code,
            ErrorCode::usage);
  EXPECT_EQ(files(), 0);
}

TEST_F(ImageFile, TruncationAtEveryByteIsAnErrorAndNeverACrash) {
  Image image = gradient(13, 11);
  image.depth.assign(image.pixels(), 2);
  for (const char* name : {"a.png", "a.jpg", "a.exr"}) {
    ASSERT_TRUE(write_image(path(name), image));
    const auto size = fs::file_size(path(name));
    for (auto length = size; length-- > 0;) {
      fs::resize_file(path(name), length);
      const auto read = read_image(path(name));
      ASSERT_FALSE(read) << name << " cut to " << length << " of " << size;
      ASSERT_EQ(read.error().code, ErrorCode::bad_file) << read.error().message;
      ASSERT_THAT(read.error().message, HasSubstr(path(name)));
    }
  }
}

TEST_F(ImageFile, MissingFilesFoldersAndNonPicturesAreNamed) {
  const auto missing = read_image(path("none.png"));
  EXPECT_EQ(missing.error().code, ErrorCode::not_found);
  EXPECT_THAT(missing.error().message, HasSubstr(path("none.png") + ": no such file"));
  EXPECT_EQ(read_image(folder_.path()).error().code, ErrorCode::io);
  std::ofstream(path("text.png")) << "not a picture";
  EXPECT_EQ(read_image(path("text.png")).error().code, ErrorCode::bad_file);
}

TEST_F(ImageFile, WritingWhereNothingCanBeWrittenNamesPathAndCause) {
  const auto missing = write_image(path("no/such/a.png"), gradient(2, 2));
  ASSERT_FALSE(missing);
  EXPECT_EQ(missing.error().code, ErrorCode::not_found);
  EXPECT_THAT(missing.error().message, HasSubstr("no/such/a.png: cannot write: No such file"));

  fs::create_directory(path("folder.png"));
  EXPECT_THAT(write_image(path("folder.png"), gradient(2, 2)).error().message,
              HasSubstr("not a regular file"));
  EXPECT_EQ(files(), 1);
}

TEST_F(ImageFile, ReadOnlyFolderIsAnIoError) {
  // Root may write anywhere, so root becomes nobody for a moment.
  constexpr uid_t kNobody = 65534;
  const bool root = ::geteuid() == 0;
  fs::permissions(folder_.path(), fs::perms(0555));
  ASSERT_EQ(root ? ::seteuid(kNobody) : 0, 0);
  const auto written = write_image(path("a.png"), gradient(2, 2));
  ASSERT_EQ(root ? ::seteuid(0) : 0, 0);
  fs::permissions(folder_.path(), fs::perms::owner_all);
  ASSERT_FALSE(written);
  EXPECT_THAT(written.error().message, HasSubstr("a.png: cannot write: Permission denied"));
}

TEST_F(ImageFile, FailedWriteLeavesTheOldPictureAndNoTemporary) {
  ASSERT_TRUE(write_image(path("a.exr"), gradient(4, 4)));

  // A limit on file size stands in for a full disk: write() fails part of the way.
  rlimit old{};
  ASSERT_EQ(::getrlimit(RLIMIT_FSIZE, &old), 0);
  const rlimit small{512, old.rlim_max};
  const auto handler = std::signal(SIGXFSZ, SIG_IGN);
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &small), 0);
  const auto written = write_image(path("a.exr"), gradient(200, 200));
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &old), 0);
  std::signal(SIGXFSZ, handler);

  ASSERT_FALSE(written);
  EXPECT_EQ(written.error().code, ErrorCode::io);
  EXPECT_THAT(written.error().message, HasSubstr("a.exr: cannot write: File too large"));
  EXPECT_EQ(files(), 1);
  expect_equal(gradient(4, 4), *read_image(path("a.exr")), 0);
}

TEST_F(ImageFile, WritesThroughASymbolicLink) {
  ASSERT_TRUE(write_image(path("a.png"), gradient(2, 2)));
  fs::create_symlink("a.png", path("link.png"));
  ASSERT_TRUE(write_image(path("link.png"), gradient(5, 5)));
  EXPECT_TRUE(fs::is_symlink(path("link.png")));
  EXPECT_EQ(read_image(path("a.png"))->width, 5u);
}

}  // namespace
}  // namespace slf

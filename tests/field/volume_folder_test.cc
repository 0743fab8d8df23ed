// Folders of pictures as libpng writes them.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <png.h>

#include "volume_samples.h"

namespace slf {
namespace {

using namespace samples;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

/// A slice of the phantom through libpng's simplified writer.
void write_png(const Folder& folder, const std::string& name, std::uint32_t k, int format,
               bool colored = false) {
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  png.width = kDims[0];
  png.height = kDims[1];
  png.format = static_cast<png_uint_32>(format);
  const std::size_t channels = PNG_IMAGE_SAMPLE_CHANNELS(png.format);
  std::vector<std::uint8_t> pixels;
  for (std::uint32_t j = 0; j < kDims[1]; ++j)
    for (std::uint32_t i = 0; i < kDims[0]; ++i)
      for (std::size_t c = 0; c < channels; ++c)
        pixels.push_back(static_cast<std::uint8_t>(phantom_value(i, j, k) + (colored && c == 2)));
  ASSERT_NE(png_image_write_to_file(&png, folder.path(name).c_str(), 0, pixels.data(), 0, nullptr),
            0);
}

TEST(VolumeFolder, PngsAreStackedInTheOrderOfTheirNumbers) {
  const Folder folder;
  write_png(folder, "slice 10.png", 2, PNG_FORMAT_GRAY);
  write_png(folder, "slice 9.png", 1, PNG_FORMAT_GRAY);
  write_png(folder, "slice 08.png", 0, PNG_FORMAT_GRAY);
  folder.write("notes.txt", "not a picture");
  const auto volume = expect_read(folder.path(), {.spacing = glm::dvec3(1, 2, 3)});
  expect_phantom(volume, ScalarType::u8);
  EXPECT_EQ(volume.spacing(), glm::dvec3(1, 2, 3));
  EXPECT_THAT(volume.notes, IsEmpty());
  EXPECT_THAT(expect_read(folder.path()).notes, ElementsAre(HasSubstr("no spacing")));
  expect_error(folder.path("slice 9.png"), ErrorCode::unsupported, "give the folder");
}

TEST(VolumeFolder, ColorsAndOddOnesOut) {
  const Folder grey, colored, mixed, both;
  for (const std::uint32_t k : {0, 1, 2}) {
    write_png(grey, std::to_string(k) + ".png", k, PNG_FORMAT_RGB);
    write_png(colored, std::to_string(k) + ".png", k, PNG_FORMAT_RGB, true);
    write_png(mixed, std::to_string(k) + ".png", k, k == 1 ? PNG_FORMAT_RGB : PNG_FORMAT_GRAY);
  }
  expect_phantom(expect_read(grey.path()), ScalarType::u8);
  expect_error(colored.path(), ErrorCode::unsupported, "3 components");
  expect_phantom(expect_read(colored.path(), {.component = 0}), ScalarType::u8);
  expect_error(mixed.path(), ErrorCode::unsupported, "1.png: 5x4 u8, 3 components, unlike");
  write_png(both, "a.png", 0, PNG_FORMAT_GRAY);
  both.write("a.tif", std::string("II*\0\x08\0\0\0", 8));
  expect_error(both.path(), ErrorCode::unsupported, "1 PNGs and 1 TIFFs");
  colored.write("3.png", "\x89PNG\r\n\x1a\nxxxx");
  expect_error(colored.path(), ErrorCode::bad_file, "3.png: damaged PNG", {.component = 0});
}

TEST(VolumeFolder, SixteenBitsStayAsTheyAreStored) {
  const Folder folder;
  for (const std::uint32_t k : {0, 1, 2}) {
    std::FILE* file = std::fopen(folder.path(std::to_string(k) + ".png").c_str(), "wb");
    png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
    png_infop info = png_create_info_struct(png);
    png_init_io(png, file);
    png_set_IHDR(png, info, kDims[0], kDims[1], 16, PNG_COLOR_TYPE_GRAY, PNG_INTERLACE_ADAM7,
                 PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
    png_write_info(png, info);
    std::string slice = phantom_bytes(ScalarType::u16, true);
    slice = slice.substr(k * 40, 40);
    std::vector<png_bytep> rows;
    for (std::size_t j = 0; j < 4; ++j)
      rows.push_back(reinterpret_cast<png_bytep>(slice.data()) + 10 * j);
    png_write_image(png, rows.data());
    png_write_end(png, info);
    png_destroy_write_struct(&png, &info);
    std::fclose(file);
  }
  expect_phantom(expect_read(folder.path()), ScalarType::u16);
}

}  // namespace
}  // namespace slf

// Folders of pictures as libpng writes them.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <png.h>

#include "image/formats.h"
#include "tests/source/volume/samples.h"

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

TEST(VolumeFolder, PalettesAreIdsOfLabels) {
  const Folder folder;
  for (const std::uint32_t k : {0, 1, 2}) {
    std::FILE* file = std::fopen(folder.path(std::to_string(k) + ".png").c_str(), "wb");
    png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
    png_infop info = png_create_info_struct(png);
    png_init_io(png, file);
    png_set_IHDR(png, info, kDims[0], kDims[1], 8, PNG_COLOR_TYPE_PALETTE, PNG_INTERLACE_NONE,
                 PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
    std::vector<png_color> palette(256, png_color{9, 7, 5});
    png_set_PLTE(png, info, palette.data(), 256);
    png_write_info(png, info);
    for (std::uint32_t j = 0; j < kDims[1]; ++j) {
      std::vector<png_byte> row;
      for (std::uint32_t i = 0; i < kDims[0]; ++i)
        row.push_back(static_cast<png_byte>(phantom_value(i, j, k)));
      png_write_row(png, row.data());
    }
    png_write_end(png, nullptr);
    png_destroy_write_struct(&png, &info);
    std::fclose(file);
  }
  expect_phantom(expect_read(folder.path(), {.labels = true}), ScalarType::u8);
  expect_error(folder.path(), ErrorCode::unsupported, "3 components");
}

TEST(VolumeFolder, ColorsAndOddOnesOut) {
  const Folder grey, colored, mixed, both;
  for (const std::uint32_t k : {0, 1, 2}) {
    write_png(grey, std::to_string(k) + ".png", k, PNG_FORMAT_RGB);
    write_png(colored, std::to_string(k) + ".png", k, PNG_FORMAT_RGB, true);
    write_png(mixed, std::to_string(k) + ".png", k, k == 2 ? PNG_FORMAT_RGB : PNG_FORMAT_GRAY);
  }
  expect_phantom(expect_read(grey.path()), ScalarType::u8);
  expect_error(colored.path(), ErrorCode::unsupported, "3 components");
  expect_phantom(expect_read(colored.path(), {.component = 0}), ScalarType::u8);
  expect_error(mixed.path(), ErrorCode::unsupported, "2.png: 5x4 u8, 3 components, unlike");
  write_png(both, "a.png", 0, PNG_FORMAT_GRAY);
  both.write("a.tif", std::string("II*\0\x08\0\0\0", 8));
  both.write("a.jpg", "\xff\xd8\xff");
  expect_error(both.path(), ErrorCode::unsupported, "1 PNGs and 1 JPEGs and 1 TIFFs");
  for (const char* name : {"3.png", "4.png"}) colored.write(name, "\x89PNG\r\n\x1a\nxxxx");
  expect_error(colored.path(), ErrorCode::bad_file, "4.png: damaged PNG", {.component = 0});
}

// As ImageJ does, where no slice comes to lie in the place of another.
TEST(VolumeFolder, StraysAreLeftOutAndCounted) {
  const auto series = [](const Folder& folder, std::uint32_t from = 0) {
    for (const std::uint32_t k : {0, 1, 2})
      write_png(folder, "s" + std::to_string(k + from) + ".png", k, PNG_FORMAT_GRAY);
  };
  const auto read = [](const Folder& folder, const std::string& note) {
    const auto volume = expect_read(folder.path(), {.spacing = glm::dvec3(1)});
    expect_phantom(volume, ScalarType::u8);
    EXPECT_THAT(volume.notes, ElementsAre(HasSubstr(note)));
    EXPECT_EQ(volume.files.size(), 4u);  // and the folder
  };
  const Folder named, kind, first, last, middle;
  series(named);
  write_png(named, "thumb.png", 2, PNG_FORMAT_RGB);
  read(named, "left out 1 of 4 pictures, 'thumb.png', named unlike the series 's0.png'");
  series(kind);
  kind.write("s9.jpg", "\xff\xd8\xff");
  read(kind, "of 3 PNGs and 1 JPEGs, only the PNGs are read");
  series(first, 1);
  write_png(first, "s0.png", 2, PNG_FORMAT_RGBA);
  read(first, "left out 1 of 4 pictures: ");
  series(last);
  last.write("s3.png", "\x89PNG\r\n\x1a\nxxxx");
  read(last, "s3.png: damaged PNG");
  // A gap would shift all after it.
  series(middle);
  for (const char* more : {"s3.png", "s4.png", "s5.png"})
    write_png(middle, more, 0, PNG_FORMAT_GRAY);
  middle.write("s1.png", "\x89PNG\r\n\x1a\nxxxx");
  expect_error(middle.path(), ErrorCode::bad_file, "s1.png: damaged PNG");
}

// Two channels are no colour, and not opacity either.
TEST(VolumeFolder, OpacityIsNoChannelOfGrey) {
  const Folder folder;
  for (const std::uint32_t k : {0, 1, 2})
    write_png(folder, std::to_string(k) + ".png", k, PNG_FORMAT_GA);
  expect_phantom(expect_read(folder.path()), ScalarType::u8);
}

/// The error, or the notes, of a folder of pictures with these names.
std::string numbering(const std::vector<std::string>& names) {
  const Folder folder;
  for (const auto& name : names) write_png(folder, name, 0, PNG_FORMAT_GRAY);
  const auto volume = read_volume(folder.path(), {.spacing = glm::dvec3(1)});
  if (!volume) return volume.error().message;
  std::string notes;
  for (const auto& note : volume->notes) notes += note + "\n";
  return notes;
}

TEST(VolumeFolder, NumbersWithoutAGapAreOneSeries) {
  for (const auto& names : std::vector<std::vector<std::string>>{
           {"s000.png", "s001.png", "s002.png"},
           {"9.PNG", "10.png", "11.png"},
           {"scan 2 (1).png", "scan 2 (2).png"},
           {"20200101-0001.png", "20200102-0002.png", "20210103-0003.png"},
           {"z10.0.png", "z10.5.png", "z11.0.png", "z11.5.png"}})
    EXPECT_EQ(numbering(names), "") << names.front();
  EXPECT_THAT(numbering({"s0.png", "s2.png", "s4.png"}), HasSubstr("in steps of 2"));
  EXPECT_THAT(numbering({"s1.png", "s7.png", "s16.png", "s90.png"}), HasSubstr("uneven"));
  EXPECT_THAT(numbering({"head.png", "neck.png"}), HasSubstr("share no numbers"));
}

TEST(VolumeFolder, GapsSeriesAndDuplicatesAreNamed) {
  EXPECT_THAT(numbering({"s003.png", "s004.png", "s006.png", "s007.png"}),
              HasSubstr("numbered 3 to 7, 5 is missing"));
  EXPECT_THAT(numbering({"s1.png", "s2.png", "s5.png", "s6.png", "s8.png"}),
              HasSubstr("numbered 1 to 8, 3 to 4, 7 is missing"));
  // Every second one, one of which is missing.
  EXPECT_THAT(numbering({"s0.png", "s2.png", "s4.png", "s8.png"}), HasSubstr("6 is missing"));
  EXPECT_THAT(numbering({"a0.png", "a1.png", "b0.png", "b1.png", "b2.png"}),
              HasSubstr("pictures of 2 series: 3 as 'b0.png', 2 as 'a0.png'"));
  EXPECT_THAT(numbering({"0.png", "1.png", "thumb.png"}),
              HasSubstr("2 as '0.png', 1 as 'thumb.png'"));
  EXPECT_THAT(numbering({"t0_z0.png", "t0_z1.png", "t1_z0.png", "t1_z1.png"}),
              HasSubstr("'t0_z0.png' and 't1_z0.png' differ in more than one number"));
  EXPECT_THAT(numbering({"s1.png", "s01.png", "s2.png"}), HasSubstr("have the same number"));
  // Two series whose numbers follow each other at a distance.
  EXPECT_THAT(numbering({"s0.png", "s1.png", "s2.png", "s100.png", "s101.png"}),
              HasSubstr("3 to 99 is missing"));
}

std::string jpeg(std::uint32_t k, bool colored, int quality = 100) {
  Image image{kDims[0], kDims[1], {}, {}};
  for (std::uint32_t j = 0; j < kDims[1]; ++j)
    for (std::uint32_t i = 0; i < kDims[0]; ++i) {
      const auto value = static_cast<float>(phantom_value(i, j, k)) / 255;
      image.rgba.emplace_back(value, value, colored ? 1 - value : value, 1);
    }
  const auto bytes = image_formats::encode_jpeg("a", image, {.jpeg_quality = quality});
  if (!bytes) return "";
  return {reinterpret_cast<const char*>(bytes->data()), bytes->size()};
}

TEST(VolumeFolder, JpegsAreStackedLikeOtherPictures) {
  const Folder grey, colored;
  for (const std::uint32_t k : {0, 1, 2}) {
    grey.write("s" + std::to_string(k) + ".jpg", jpeg(k, false));
    colored.write("s" + std::to_string(k) + ".jpeg", jpeg(k, true));
  }
  const auto volume = expect_read(grey.path());
  EXPECT_THAT(volume.dims, ElementsAre(5, 4, 3));
  EXPECT_EQ(volume.type, ScalarType::u8);
  EXPECT_THAT(volume.notes, ElementsAre(HasSubstr("no spacing")));
  for (std::uint32_t k = 0; k < 3; ++k)
    EXPECT_NEAR(value_at(volume, 2, 1, k), phantom_value(2, 1, k), 3);
  expect_error(colored.path(), ErrorCode::unsupported, "3 components");
  EXPECT_NEAR(value_at(expect_read(colored.path(), {.component = 2}), 2, 1, 1),
              255 - phantom_value(2, 1, 1), 6);
  expect_error(grey.path("s0.jpg"), ErrorCode::unsupported, "give the folder");
  const std::string whole = jpeg(1, false);
  grey.write("s1.jpg", whole.substr(0, whole.size() / 2));
  expect_error(grey.path(), ErrorCode::bad_file, "s1.jpg: damaged JPEG");
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

// The pixels of DICOM files that are not plain 16-bit grey, and segmentations.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>

#include "slf/transfer.h"
#include "tests/source/volume/dicom_samples.h"

namespace slf {
namespace {

using namespace samples;
using ::testing::Contains;
using ::testing::HasSubstr;

constexpr std::uint32_t kSamples = 0x00280002, kPhotometric = 0x00280004, kPlanar = 0x00280006,
                        kAllocated = 0x00280100, kStored = 0x00280101, kHighBit = 0x00280102,
                        kSigned = 0x00280103, kPixels = 0x7fe00010;
constexpr std::size_t kPixelCount = std::size_t{kSliceWidth} * kSliceHeight;

void set_bits(DicomElements& slice, int bits) {
  slice[kAllocated] = us({static_cast<double>(bits)});
  slice[kStored] = us({static_cast<double>(bits)});
  slice[kHighBit] = us({bits - 1.0});
  slice[kSigned] = us({0});
}

/// Slice k in 8-bit colours with these bytes for pixel n.
template <class ColorOf>
DicomElements colored(int k, const std::string& photometric, bool planar, ColorOf&& color_of) {
  auto slice = small_slice(k);
  set_bits(slice, 8);
  slice[kSamples] = us({3});
  slice[kPhotometric] = text("CS", photometric);
  slice[kPlanar] = us({planar ? 1.0 : 0.0});
  std::string pixels(3 * kPixelCount, '\0');
  for (std::size_t n = 0; n < kPixelCount; ++n) {
    const std::array<int, 3> color = color_of(static_cast<int>(n) + 20 * k);
    for (std::size_t c = 0; c < 3; ++c)
      pixels[planar ? c * kPixelCount + n : 3 * n + c] = static_cast<char>(color[c]);
  }
  slice[kPixels] = bytes(pixels);
  return slice;
}

TEST(DicomColors, AComponentIsChosen) {
  for (const bool planar : {false, true}) {
    const Folder folder;
    for (const int k : {0, 1})
      folder.write(std::to_string(k), write_dicom(colored(k, "RGB", planar, [](int v) {
                     return std::array{v, 100 + v, 200 - v};
                   })));
    expect_error(folder.path(), ErrorCode::unsupported, "3 components");
    expect_error(folder.path(), ErrorCode::usage, "component 3", {.component = 3});
    const auto green = expect_read(folder.path(), {.component = 1});
    const auto blue = expect_read(folder.path("0"), {.component = 2});
    EXPECT_EQ(green.type, ScalarType::u8);
    EXPECT_EQ(value_at(green, 2, 1, 1), 100 + 26);
    EXPECT_EQ(value_at(blue, 2, 1, 1), 200 - 26);
  }
}

TEST(DicomColors, GreyColoursAreGrey) {
  const Folder folder;
  for (const int k : {0, 1})
    folder.write(std::to_string(k), write_dicom(colored(k, "RGB", k == 1, [](int v) {
                   return std::array{v, v, v};
                 })));
  EXPECT_EQ(value_at(expect_read(folder.path()), 2, 1, 1), 26);
}

TEST(DicomColors, LumaAndChromaBecomeRgb) {
  const Folder full, shared;
  for (const int k : {0, 1}) {
    full.write(std::to_string(k), write_dicom(colored(k, "YBR_FULL", false, [](int) {
                 return std::array{76, 85, 255};
               })));
    auto slice = colored(k, "YBR_FULL_422", false, [](int) { return std::array{0, 0, 0}; });
    std::string pixels;
    for (std::size_t pair = 0; pair < kPixelCount / 2; ++pair) pixels += "\x4c\x4c\x55\xff";
    slice[kPixels] = bytes(pixels);
    shared.write(std::to_string(k), write_dicom(slice));
  }
  for (const auto* folder : {&full, &shared})
    for (const std::uint32_t c : {0u, 1u, 2u})  // red, to rounding
      EXPECT_NEAR(value_at(expect_read(folder->path(), {.component = c}), 3, 2, 1), c ? 0 : 254, 1);
}

TEST(DicomColors, PalettesAreLookedUp) {
  for (const int bits : {8, 16}) {
    const Folder folder;
    for (const int k : {0, 1}) {
      auto slice = small_slice(k);
      set_bits(slice, 8);
      slice[kPhotometric] = text("CS", "PALETTE COLOR");
      std::string indices;
      for (std::size_t n = 0; n < kPixelCount; ++n) indices += static_cast<char>(n + 2);
      slice[kPixels] = bytes(indices);
      for (std::uint32_t c = 0; c < 3; ++c) {
        slice[0x00281101 + c] = us({4, 3, static_cast<double>(bits)});  // 4 entries from 3 on
        std::string table;
        for (int i = 0; i < 4; ++i) {
          const int value = (bits == 8 ? 1 : 1000) * (10 * (i + 1) + static_cast<int>(c));
          table += static_cast<char>(value & 255);
          if (bits == 16) table += static_cast<char>(value >> 8);
        }
        slice[0x00281201 + c] = {"OW", table};
      }
      folder.write(std::to_string(k), write_dicom(slice));
    }
    expect_error(folder.path(), ErrorCode::unsupported, "3 components");
    EXPECT_EQ(value_at(expect_read(folder.path(), {.labels = true}), 3, 2, 1), kPixelCount + 1);
    const auto volume = expect_read(folder.path(), {.component = 2});
    EXPECT_EQ(volume.type, bits == 8 ? ScalarType::u8 : ScalarType::u16);
    const double scale = bits == 8 ? 1 : 1000;
    EXPECT_EQ(value_at(volume, 0, 0, 0), 12 * scale);  // index 2 is below the first entry
    EXPECT_EQ(value_at(volume, 2, 0, 1), 22 * scale);
    EXPECT_EQ(value_at(volume, 3, 2, 1), 42 * scale);  // above the last
  }
}

TEST(DicomValues, TheirUnitIsWhatTheFileSays) {
  const Folder folder;
  const auto unit = [&](const std::string& modality, std::uint32_t tag, const std::string& stated) {
    for (const int k : {0, 1}) {
      auto slice = small_slice(k);
      slice[0x00080060] = text("CS", modality);
      if (tag) slice[tag] = text("CS", stated);
      folder.write(std::to_string(k), write_dicom(slice));
    }
    return expect_read(folder.path()).value_unit;
  };
  EXPECT_EQ(unit("CT", 0, ""), "HU");
  EXPECT_EQ(unit("CT", 0x00281054, "US"), "");  // "unspecified"
  EXPECT_EQ(unit("CT", 0x00281054, "MGML"), "MGML");
  EXPECT_EQ(unit("PT", 0x00541001, "BQML"), "BQML");
  EXPECT_EQ(unit("RTDOSE", 0x30040002, "GY"), "GY");
  EXPECT_EQ(unit("MR", 0, ""), "");
}

TEST(DicomValues, ModalityTablesGiveValues) {
  for (const char* sop : {"1.2.840.10008.5.1.4.1.1.1", "1.2.840.10008.5.1.4.1.1.12.1"}) {
    const Folder folder;
    for (const int k : {0, 1}) {
      auto slice = small_slice(k);
      set_bits(slice, 8);
      slice[0x00080016] = text("UI", sop);
      std::string indices;
      for (std::size_t n = 0; n < kPixelCount; ++n) indices += static_cast<char>(n);
      slice[kPixels] = bytes(indices);
      std::string table;
      for (const int value : {700, 900, 1200, 3000}) {
        table += static_cast<char>(value & 255);
        table += static_cast<char>(value >> 8);
      }
      slice[0x00283000] = sequence({{{0x00283002, us({4, 2, 16})}, {0x00283006, {"OW", table}}}});
      folder.write(std::to_string(k), write_dicom(slice));
    }
    const auto volume = expect_read(folder.path());
    const bool display = std::string(sop).ends_with("12.1");  // of X-ray angiography
    EXPECT_EQ(volume.type, display ? ScalarType::u8 : ScalarType::u16);
    const std::vector<int> values{700, 700, 700, 900, 1200, 3000, 3000};
    for (std::uint32_t n = 0; n < values.size() && !display; ++n) {
      const auto& v = volume.bytes();
      std::uint16_t value = 0;
      std::memcpy(&value, v.data() + std::size_t{2} * n, 2);
      EXPECT_EQ(value, values[n]) << n;
    }
  }
}

TEST(DicomValues, LeastAsWhiteIsNotedAndChangesNoValue) {
  const Folder folder;
  for (const int k : {0, 1}) {
    auto slice = small_slice(k);
    slice[0x00280004] = text("CS", "MONOCHROME1");
    folder.write(std::to_string(k), write_dicom(slice));
  }
  const auto volume = expect_read(folder.path());
  EXPECT_EQ(value_at(volume, 2, 1, 1), slice_value(2, 1, 1));
  EXPECT_THAT(volume.notes, ::testing::ElementsAre(::testing::HasSubstr("MONOCHROME1")));
}

TEST(DicomValues, BigEndianBytesInWords) {
  const Folder folder;
  const DicomForm form{.syntax = "1.2.840.10008.1.2.2", .big_endian = true};
  for (const int k : {0, 1}) {
    auto slice = small_slice(k);
    set_bits(slice, 8);
    std::string swapped;
    for (std::size_t n = 0; n < kPixelCount; n += 2)
      swapped += {static_cast<char>(n + 1), static_cast<char>(n)};
    slice[kPixels] = {"OW", swapped};
    folder.write(std::to_string(k), write_dicom(slice, form));
  }
  const auto volume = expect_read(folder.path());
  for (std::uint32_t i = 0; i < kSliceWidth; ++i) EXPECT_EQ(value_at(volume, i, 1, 1), 4 + i);
}

TEST(DicomValues, FloatingPoint) {
  const Folder folder;
  for (const int k : {0, 1}) {
    auto slice = small_slice(k);
    slice.erase(kPixels);
    set_bits(slice, 64);
    DicomValue pixels = fd({});
    for (std::size_t n = 0; n < kPixelCount; ++n) pixels.numbers.push_back(0.25 * double(n) - k);
    slice[0x7fe00009] = pixels;
    folder.write(std::to_string(k), write_dicom(slice));
  }
  const auto volume = expect_read(folder.path());
  EXPECT_EQ(volume.type, ScalarType::f64);
  EXPECT_EQ(value_at(volume, 3, 0, 1), 0.75 - 1);
}

TEST(DicomValues, EachFrameMayHaveItsScale) {
  std::vector<DicomElements> frames;
  for (const int k : {0, 1, 2}) {
    auto groups = frame_at(2.0 * k);
    groups[0x00289145] =
        sequence({{{0x00281052, decimals({-10.0 * k})}, {0x00281053, decimals({0.5 * (k + 1)})}}});
    frames.push_back(groups);
  }
  const Folder folder;
  const auto volume = expect_read(folder.write("a", write_dicom(enhanced_file(frames, {0, 1, 2}))));
  EXPECT_EQ(volume.type, ScalarType::f32);
  for (const std::uint32_t k : {0u, 1u, 2u})
    EXPECT_EQ(value_at(volume, 1, 2, k), 0.5 * (k + 1) * slice_value(1, 2, int(k)) - 10.0 * k);
}

TEST(DicomValues, BadFormatsAreNamed) {
  const Folder folder;
  auto none = small_slice(0);
  none.erase(kAllocated);
  expect_error(folder.write("a", write_dicom(none)), ErrorCode::bad_file,
               "BitsAllocated is missing");
  auto packed = small_slice(0);
  set_bits(packed, 12);
  expect_error(folder.write("a", write_dicom(packed)), ErrorCode::unsupported,
               "BitsAllocated is 12");
  auto short_pixels = small_slice(0);
  short_pixels[kPixels].numbers.pop_back();
  expect_error(folder.write("a", write_dicom(short_pixels)), ErrorCode::bad_file,
               "need 24 bytes, PixelData holds 22");
}

/// A segmentation with these frames: segment, z, pixels.
struct SegmentFrame {
  int segment;
  double z;
  std::string pixels;  ///< one byte each
};
DicomElements segmentation(const std::string& type, const std::vector<SegmentFrame>& from,
                           double stated_gap) {
  std::vector<DicomElements> frames;
  std::string pixels;
  for (const auto& frame : from) {
    auto groups = frame_at(frame.z);
    if (frame.segment > 0)
      groups[0x0062000a] = sequence({{{0x0062000b, us({double(frame.segment)})}}});
    frames.push_back(groups);
    pixels += frame.pixels;
  }
  auto file = enhanced_file(frames, {});
  file[0x00080016] = text("UI", "1.2.840.10008.5.1.4.1.1.66.4");
  file[0x00080060] = text("CS", "SEG");
  file[0x00620001] = text("CS", type);
  file[0x0062000e] = us({200});
  file[0x00620002] = sequence({{{0x00620004, us({1})},
                                {0x00620005, text("LO", "Liver")},
                                {0x0062000d, us({35580, 53665, 50856})}},  // sRGB red
                               {{0x00620004, us({3})}, {0x00620005, text("LO", "Kidney")}}});
  auto& measures = file[0x52009229].items[0][0x00289110].items[0];
  if (stated_gap > 0) measures[0x00180088] = decimals({stated_gap});
  set_bits(file, type == "BINARY" ? 1 : 8);
  if (type == "BINARY") {
    std::string packed((pixels.size() + 7) / 8, '\0');
    for (std::size_t i = 0; i < pixels.size(); ++i)
      if (pixels[i]) packed[i / 8] = static_cast<char>(packed[i / 8] | 1 << i % 8);
    pixels = packed;
  }
  file[kPixels] = bytes(pixels);
  return file;
}

std::string frame_with(std::initializer_list<std::pair<std::size_t, int>> pixels) {
  std::string frame(kPixelCount, '\0');
  for (const auto& [at, value] : pixels) frame[at] = static_cast<char>(value);
  return frame;
}

TEST(DicomSegmentations, BinarySegmentsBecomeLabels) {
  const Folder folder;
  // Planes 1 and 2 of 0 to 3 are empty and left out; the last one has both segments.
  const auto path =
      folder.write("seg.dcm", write_dicom(segmentation("BINARY",
                                                       {{1, 6, frame_with({{0, 1}, {5, 1}})},
                                                        {1, 0, frame_with({{11, 1}})},
                                                        {3, 6, frame_with({{5, 1}, {6, 1}})}},
                                                       2)));
  const auto volume = expect_read(path);
  ASSERT_EQ(volume.dims, (std::array<std::uint32_t, 3>{kSliceWidth, kSliceHeight, 4}));
  EXPECT_TRUE(volume.labels);
  EXPECT_EQ(volume.type, ScalarType::u8);
  EXPECT_LT(glm::length(volume.spacing() - glm::dvec3(0.7, 0.5, 2)), 1e-9);
  EXPECT_EQ(value_at(volume, 3, 2, 0), 1);
  EXPECT_EQ(value_at(volume, 0, 0, 3), 1);
  EXPECT_EQ(value_at(volume, 1, 1, 3), 3);  // both: the highest number
  EXPECT_EQ(value_at(volume, 2, 1, 3), 3);
  double sum = 0;
  for (std::uint32_t z = 0; z < 4; ++z)
    for (std::uint32_t n = 0; n < kPixelCount; ++n) sum += value_at(volume, n % 4, n / 4, z);
  EXPECT_EQ(sum, 1 + 1 + 3 + 3);
  EXPECT_THAT(volume.notes, Contains(HasSubstr("overlap at 1 voxels")));
  EXPECT_THAT(volume.notes, Contains(HasSubstr("2 segments: 1 'Liver', 3 'Kidney'")));
  ASSERT_EQ(volume.label_styles.size(), 2);
  EXPECT_EQ(volume.label_styles.at(3).name, "Kidney");
  ASSERT_TRUE(volume.label_styles.at(1).color);
  EXPECT_LT(glm::length(*volume.label_styles.at(1).color - glm::dvec3(1, 0, 0)), 0.02);
  const auto transfer = default_transfer(volume);
  ASSERT_EQ(transfer.colors.size(), 3);
  EXPECT_EQ(transfer.colors[1].rgb, *volume.label_styles.at(1).color);
}

TEST(DicomSegmentations, TheLargestFractionOfAtLeastHalfWins) {
  const Folder folder;
  const auto path = folder.write(
      "seg.dcm", write_dicom(segmentation("FRACTIONAL",
                                          {{1, 0, frame_with({{0, 150}, {1, 99}, {2, 100}})},
                                           {3, 0, frame_with({{0, 120}, {1, 90}, {2, 100}})},
                                           {1, 2, frame_with({{4, 200}})}},
                                          2)));
  const auto volume = expect_read(path);
  EXPECT_EQ(value_at(volume, 0, 0, 0), 1);
  EXPECT_EQ(value_at(volume, 1, 0, 0), 0);
  EXPECT_EQ(value_at(volume, 2, 0, 0), 3);
  EXPECT_EQ(value_at(volume, 0, 1, 1), 1);
}

TEST(DicomSegmentations, OnePlaneGetsEmptyNeighbours) {
  const Folder folder;
  const auto volume = expect_read(
      folder.write("a", write_dicom(segmentation("BINARY", {{1, 6, frame_with({{5, 1}})}}, 2))));
  ASSERT_EQ(volume.dims[2], 3);
  EXPECT_EQ(value_at(volume, 1, 1, 1), 1);
  EXPECT_EQ(volume.origin.z, 4);
}

TEST(DicomSegmentations, LabelMapsKeepTheirEmptyPlanes) {
  const std::vector<SegmentFrame> frames = {
      {0, 8, frame_with({{5, 3}})}, {0, 0, frame_with({{5, 1}})}, {0, 4, frame_with({{6, 2}})}};
  const Folder folder;
  const auto path = folder.write("a", write_dicom(segmentation("LABELMAP", frames, 2)));
  const auto volume = expect_read(path);
  ASSERT_EQ(volume.dims[2], 5);
  EXPECT_TRUE(volume.labels);
  EXPECT_EQ(volume.label_styles.at(1).name, "Liver");
  for (const std::uint32_t z : {0u, 1u, 2u, 3u, 4u})
    EXPECT_EQ(value_at(volume, 1, 1, z), z == 0 ? 1 : z == 4 ? 3 : 0);
  EXPECT_EQ(value_at(volume, 2, 1, 2), 2);
  // Labels that are no segmentation, read as labels.
  auto plain = segmentation("LABELMAP", frames, 2);
  plain.erase(0x00620001);
  plain[0x00080060] = text("CS", "MR");
  EXPECT_EQ(expect_read(folder.write("b", write_dicom(plain)), {.labels = true}).dims[2], 5);
  EXPECT_EQ(expect_read(folder.path("b")).dims[2], 3);
}

TEST(DicomSegmentations, ManySegmentsNeedSixteenBits) {
  const Folder folder;
  const auto volume = expect_read(folder.write(
      "a", write_dicom(segmentation(
               "BINARY", {{300, 0, frame_with({{5, 1}})}, {2, 2, frame_with({{5, 1}})}}, 2))));
  EXPECT_EQ(volume.type, ScalarType::u16);
  EXPECT_EQ(value_at(volume, 1, 1, 0), 300);
}

}  // namespace
}  // namespace slf

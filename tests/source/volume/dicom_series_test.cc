// DICOM folders as people have them: files of every form, bystanders, several series, time points,
// duplicates, gaps.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "source/volume/dicom/dicom.h"
#include "tests/source/volume/dicom_samples.h"

namespace slf {
namespace {

using namespace samples;
using ::testing::AllOf;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::SizeIs;

constexpr std::uint32_t kSeriesUid = 0x0020000e, kSeriesNumber = 0x00200011, kInstance = 0x00200013,
                        kPosition = 0x00200032, kOrientation = 0x00200037,
                        kInstanceUid = 0x00080018, kRows = 0x00280010, kSlicePixels = 0x7fe00010;
const std::string kImplicit = "1.2.840.10008.1.2", kBigEndian = "1.2.840.10008.1.2.2";

std::string file_name(int k) { return "IM" + std::to_string(k) + ".dcm"; }

void write_slices(const Folder& folder, std::initializer_list<int> slices,
                  const DicomForm& form = {}) {
  for (const int k : slices) folder.write(file_name(k), write_dicom(small_slice(k), form));
}

/// Expects the slices k of small_slice(), 2 mm apart.
void expect_slices(const Volume& volume, const std::vector<int>& slices) {
  ASSERT_EQ(volume.dims, (std::array<std::uint32_t, 3>{kSliceWidth, kSliceHeight,
                                                       std::uint32_t(slices.size())}));
  EXPECT_LT(glm::length(volume.spacing() - glm::dvec3(0.7, 0.5, 2)), 1e-9);
  for (std::uint32_t z = 0; z < slices.size(); ++z)
    for (std::uint32_t y = 0; y < kSliceHeight; ++y)
      for (std::uint32_t x = 0; x < kSliceWidth; ++x)
        ASSERT_EQ(value_at(volume, x, y, z), slice_value(x, y, slices[z])) << x << y << z;
}

DicomElements of_series(DicomElements slice, const std::string& uid, const std::string& number) {
  slice[kSeriesUid] = text("UI", uid);
  slice[kInstanceUid] = text("UI", uid + "." + slice[kInstance].text);
  slice[kSeriesNumber] = text("IS", number);
  return slice;
}

TEST(DicomForms, EveryEncodingReadsTheSame) {
  const DicomForm forms[] = {
      {},
      {.open = true},
      {.unknown = true},
      {.open = true, .unknown = true},
      {.syntax = kImplicit, .is_explicit = false},
      {.syntax = kImplicit, .is_explicit = false, .open = true},
      {.syntax = kBigEndian, .big_endian = true},
      {.syntax = kBigEndian, .big_endian = true, .open = true},
      {.syntax = "", .is_explicit = false},
      {.syntax = "", .is_explicit = true},
      {.syntax = "", .is_explicit = false, .meta = false},
      {.syntax = "", .is_explicit = false, .preamble = false, .meta = false},
      {.syntax = "", .is_explicit = true, .preamble = false, .meta = false},
      {.syntax = "", .big_endian = true, .preamble = false, .meta = false},
      {.preamble = false},
      {.syntax = kImplicit, .is_explicit = true},  // stated wrongly
      {.is_explicit = false},
  };
  int n = 0;
  for (const auto& form : forms) {
    SCOPED_TRACE("form " + std::to_string(n++));
    const Folder series, enhanced;
    write_slices(series, {2, 0, 1}, form);
    expect_slices(expect_read(series.path()), {0, 1, 2});
    expect_slices(expect_read(series.path("IM1.dcm")), {0, 1, 2});
    const auto file = enhanced_file({frame_at(4), frame_at(0), frame_at(2)}, {2, 0, 1});
    expect_slices(expect_read(enhanced.write("a", write_dicom(file, form))), {0, 1, 2});
  }
}

TEST(DicomForms, BytesAfterThePixelsDoNotMatter) {
  const Folder folder;
  for (const int k : {0, 1, 2})
    folder.write(file_name(k), write_dicom(small_slice(k)) + std::string(k + 1, '\0'));
  expect_slices(expect_read(folder.path()), {0, 1, 2});
}

// What lies beside a series: none of it may keep the named file from being read.
TEST(DicomFolders, BystandersDoNotBlockTheNamedFile) {
  const Folder folder;
  write_slices(folder, {0, 1, 2});
  const auto other = write_dicom(of_series(small_slice(1), "9.9", "9"));
  folder.write("cut.dcm", other.substr(0, other.size() - 10));
  folder.write("garbage.dcm", "this is no DICOM");
  folder.write("empty.dcm", "");
  folder.write("notes.txt", "not DICOM either");
  auto color = of_series(small_slice(0), "8.8", "8");
  color[0x00280002] = us({4});
  folder.write("color.dcm", write_dicom(color));
  auto compressed = of_series(small_slice(0), "7.7", "7");
  folder.write("video.dcm", write_dicom(compressed, {.syntax = "1.2.840.10008.1.2.4.100"}));
  auto report = of_series(small_slice(0), "6.6", "6");
  report.erase(kRows);
  report[0x00080016] = text("UI", "1.2.840.10008.5.1.4.1.1.88.11");
  folder.write("report.dcm", write_dicom(report));
  const auto volume = expect_read(folder.path("IM1.dcm"));
  expect_slices(volume, {0, 1, 2});
  EXPECT_THAT(volume.notes,
              AllOf(SizeIs(3), Contains(HasSubstr("cut.dcm")), Contains(HasSubstr("garbage.dcm")),
                    Contains(HasSubstr("empty.dcm"))));
  expect_error(folder.path("cut.dcm"), ErrorCode::bad_file, "truncated");
}

TEST(DicomFolders, SeriesAreListedAndChosen) {
  const Folder folder;
  write_slices(folder, {0, 1, 2});
  for (const int k : {0, 1})
    folder.write("b" + std::to_string(k), write_dicom(of_series(small_slice(k), "1.2.9", "12")));
  auto secondary = of_series(small_slice(0), "1.2.10", "501");
  for (const std::uint32_t tag : {kPosition, kOrientation, 0x00280030u}) secondary.erase(tag);
  folder.write("c", write_dicom(secondary));
  const auto list = list_series(folder.path());
  ASSERT_TRUE(list);
  ASSERT_THAT(list->series, SizeIs(3));
  const auto& first = list->series[0];
  EXPECT_EQ(first.id, "3");
  EXPECT_EQ(first.uid, "1.2.3");
  EXPECT_EQ(first.description, "Thorax");
  EXPECT_EQ(first.modality, "CT");
  EXPECT_EQ(first.dims, (std::array<std::uint32_t, 3>{4, 3, 3}));
  EXPECT_EQ(first.times, 1);
  EXPECT_EQ(list->series[1].id, "12");
  EXPECT_THAT(list->series[2].problem, HasSubstr("PixelSpacing"));

  expect_error(folder.path(), ErrorCode::unsupported,
               "3 DICOM series, expected one: choose series 3 (");
  expect_slices(expect_read(folder.path(), {.series = "12"}), {0, 1});
  expect_slices(expect_read(folder.path(), {.series = "1.2.9"}), {0, 1});
  expect_slices(expect_read(folder.path("c"), {.series = "3"}), {0, 1, 2});
  expect_error(folder.path(), ErrorCode::usage, "no series '4'", {.series = "4"});
  // A number that two series have does not choose.
  folder.write("d0", write_dicom(of_series(small_slice(0), "1.2.11", "12")));
  folder.write("d1", write_dicom(of_series(small_slice(1), "1.2.11", "12")));
  expect_error(folder.path(), ErrorCode::unsupported, "choose series 1.2.11", {.series = "12"});
  expect_slices(expect_read(folder.path(), {.series = "1.2.11"}), {0, 1});
}

TEST(DicomFolders, PicturesMayLieBelowADirectoryFile) {
  const Folder folder;
  for (const int k : {0, 1, 2})
    folder.write("A/B" + std::to_string(k) + "/IM", write_dicom(small_slice(k)));
  folder.write("DICOMDIR", write_dicom({{0x00041220, sequence({})},
                                        {0x00080016, text("UI", "1.2.840.10008.1.3.10")}}));
  expect_slices(expect_read(folder.path()), {0, 1, 2});
  expect_slices(expect_read(folder.path("DICOMDIR")), {0, 1, 2});
}

TEST(DicomFolders, ADamagedSliceIsNamedOrRefused) {
  const Folder end, inside;
  const auto cut = [](int k) {
    const auto whole = write_dicom(small_slice(k));
    return whole.substr(0, whole.size() - 1);
  };
  write_slices(end, {0, 1, 2});
  end.write("IM3.dcm", cut(3));
  const auto volume = expect_read(end.path());
  expect_slices(volume, {0, 1, 2});
  EXPECT_THAT(volume.notes, ElementsAre(HasSubstr("IM3.dcm")));
  // A picture of an unknown kind that has no place in the volume.
  auto report = small_slice(9);
  for (const std::uint32_t tag : {kPosition, kOrientation}) report.erase(tag);
  report[0x00280002] = us({4});
  end.write("report", write_dicom(report));
  EXPECT_THAT(expect_read(end.path()).notes,
              ElementsAre(HasSubstr("IM3.dcm"), HasSubstr("4 components")));
  // Without it, the others would be evenly spaced at twice the distance.
  write_slices(inside, {0, 2});
  inside.write("IM1.dcm", cut(1));
  expect_error(inside.path(), ErrorCode::bad_file, "IM1.dcm");
}

TEST(DicomFolders, ASliceCutBetweenTwoElementsIsNoGap) {
  // The others are evenly spaced, at twice the distance.
  const Folder folder;
  write_slices(folder, {0, 2});
  DicomElements some;
  for (const auto& [tag, value] : small_slice(1)) {
    folder.write("IM1.dcm", write_dicom(some));
    expect_error(folder.path(), ErrorCode::bad_file, "IM1.dcm");
    some[tag] = value;
  }
  folder.write("IM1.dcm", "");
  expect_error(folder.path(), ErrorCode::bad_file, "no slice number 2");
  folder.write("IM1.dcm", write_dicom(some));
  expect_slices(expect_read(folder.path()), {0, 1, 2});
  // A file that is no slice does no harm to a whole series.
  folder.write("IM3.dcm", "");
  EXPECT_THAT(expect_read(folder.path()).notes, ElementsAre(HasSubstr("IM3.dcm")));
}

TEST(DicomFolders, LocalizersInTheSeriesAreLeftOut) {
  const Folder folder;
  write_slices(folder, {0, 1, 2});
  auto localizer = small_slice(7);
  localizer[kOrientation] = decimals({1, 0, 0, 0, 0, -1});
  folder.write("localizer", write_dicom(localizer));
  for (const auto* path : {"", "IM0.dcm"}) {
    const auto volume = expect_read(folder.path(path));
    expect_slices(volume, {0, 1, 2});
    EXPECT_THAT(volume.notes, ElementsAre(HasSubstr("localizer")));
  }
  // Two stacks of one series are two volumes.
  localizer[kPosition] = decimals({-10, -22, 14});
  folder.write("second", write_dicom(localizer));
  expect_error(folder.path(), ErrorCode::unsupported, "choose series 3:1 (");
  expect_slices(expect_read(folder.path(), {.series = "3:1"}), {0, 1, 2});
  expect_slices(expect_read(folder.path("IM0.dcm")), {0, 1, 2});
  EXPECT_EQ(expect_read(folder.path("second")).dims[2], 2);
  EXPECT_EQ(expect_read(folder.path(), {.series = "1.2.3:2"}).dims[2], 2);
}

TEST(DicomFolders, DuplicatesAreNamed) {
  const Folder folder;
  write_slices(folder, {0, 1, 2, 3});
  folder.write("IM2_copy.dcm", write_dicom(small_slice(2)));
  const auto volume = expect_read(folder.path());
  expect_slices(volume, {0, 1, 2, 3});
  EXPECT_THAT(volume.notes,
              ElementsAre(AllOf(HasSubstr("IM2_copy.dcm, a duplicate of "), HasSubstr("IM2.dcm"))));
  // Other pixels at the same place: which of them is meant is not known.
  auto other = small_slice(2);
  other[kSlicePixels].numbers[0] = 7;
  folder.write("IM2_copy.dcm", write_dicom(other));
  expect_error(folder.path(), ErrorCode::unsupported, "IM2_copy.dcm and ");
  expect_error(folder.path(), ErrorCode::unsupported, "IM2.dcm lie at the same place");
}

TEST(DicomFolders, MissingSlicesAreNamed) {
  const Folder folder;
  write_slices(folder, {0, 1, 2, 4, 5, 6, 9});
  const auto volume = read_volume(folder.path());
  ASSERT_FALSE(volume);
  EXPECT_EQ(volume.error().code, ErrorCode::bad_file);
  EXPECT_THAT(volume.error().message,
              AllOf(HasSubstr("2 mm between " + folder.path("IM0.dcm")),
                    HasSubstr("3 slices are missing: 4 mm between " + folder.path("IM2.dcm") +
                              " and " + folder.path("IM4.dcm")),
                    HasSubstr("6 mm between " + folder.path("IM6.dcm"))));
}

DicomElements at_height(int k, double z) {
  auto slice = small_slice(k);
  slice[kPosition] = decimals({-10, -20, z});
  return slice;
}

TEST(DicomFolders, UnevenSlicesAreRefusedOrResampled) {
  const Folder folder;
  int k = 0;
  const double heights[] = {0, 2, 4, 7, 10};
  for (const double z : heights) folder.write(file_name(k), write_dicom(at_height(k, z))), ++k;
  expect_error(folder.path(), ErrorCode::bad_file, "2 mm between ");
  expect_error(folder.path(), ErrorCode::bad_file, "but 3 mm between ");
  const auto volume = expect_read(folder.path(), {.resample = true});
  ASSERT_EQ(volume.dims[2], 6);
  EXPECT_NEAR(volume.spacing().z, 2, 1e-9);
  EXPECT_EQ(volume.type, ScalarType::i16);
  EXPECT_THAT(volume.notes, ElementsAre(HasSubstr("resampled from 5")));
  for (std::uint32_t z = 0; z < 6; ++z) {
    const double at = 2 * z;  // slice k = at / 2 up to 4, then (at - 4) / 3 + 2
    const double slice = at <= 4 ? at / 2 : 2 + (at - 4) / 3;
    EXPECT_NEAR(value_at(volume, 1, 1, z), slice_value(1, 1, 0) + 50 * slice, 0.5) << z;
  }
  // The nearest slice's ids, never a mean of two.
  const auto labels = expect_read(folder.path(), {.labels = true, .resample = true});
  EXPECT_EQ(value_at(labels, 0, 0, 3), slice_value(0, 0, 3));
  // Even slices do not change.
  const Folder even;
  write_slices(even, {0, 1, 2});
  expect_slices(expect_read(even.path(), {.resample = true}), {0, 1, 2});
}

TEST(DicomFolders, FilesOfKindsWithoutPicturesAreUnsupported) {
  for (const auto& [kind, named] :
       {std::pair{"1.2.840.10008.5.1.4.1.1.481.3", "a DICOM RT structure set"},
        {"1.2.840.10008.5.1.4.1.1.481.5", "a DICOM RT plan"},
        {"1.2.840.10008.5.1.4.1.1.88.11", "no DICOM pictures"}}) {
    const Folder folder;
    for (const char* name : {"a.dcm", "b"})
      folder.write(name, write_dicom({{0x00080016, text("UI", kind)},
                                      {0x00080060, text("CS", "OT")},
                                      {0x0020000e, text("UI", "1.2.9")}}));
    expect_error(folder.path(), ErrorCode::unsupported, named);
  }
}

TEST(DicomFolders, SlicesBesideTheLineAreRefused) {
  const Folder folder;
  write_slices(folder, {0, 1, 2});
  auto shifted = small_slice(1);
  shifted[kPosition] = decimals({25, -20, 2});
  folder.write("IM1.dcm", write_dicom(shifted));
  expect_error(folder.path(), ErrorCode::unsupported, "IM1.dcm: lies beside");
}

TEST(DicomTimes, DatesComeBeforeTimes) {
  const Folder folder;
  for (int n = 0; n < 4; ++n) {
    auto slice = at_height(n, 2.0 * (n % 2));
    slice[0x00080022] = text("DA", n < 2 ? "20191231" : "20200101");
    slice[0x00080032] = text("TM", n < 2 ? "235959" : "000001");
    folder.write("f" + std::to_string(n), write_dicom(slice));
  }
  expect_slices(expect_read(folder.path(), {.time = 0}), {0, 1});
  expect_slices(expect_read(folder.path(), {.time = 1}), {2, 3});
}

// Each row: the elements that tell the times of a place apart. The numbers and names of the files
// run against them.
TEST(DicomTimes, ClassicSeriesByWhatTheFilesSay) {
  const std::map<std::uint32_t, std::array<DicomValue, 3>> kinds = {
      {0x00200100, {text("IS", "1"), text("IS", "2"), text("IS", "10")}},
      {0x00180081, {decimals({4.9}), decimals({9.8}), decimals({14.7})}},
      {0x00189087, {fd({0}), fd({500}), fd({1000})}},
      {0x00181060, {decimals({0}), decimals({55}), decimals({120.5})}},
      {0x00541300, {decimals({500}), decimals({1500}), decimals({11000})}},
      {0x00200012, {text("IS", "1"), text("IS", "2"), text("IS", "10")}},
      {0x0008002a,
       {text("DT", "20200101235959.5+0100"), text("DT", "20200102000000+0100"),
        text("DT", "20200102000001.25")}},
      {0x00080032, {text("TM", "095959.5"), text("TM", "100000"), text("TM", "100001.25")}},
      {0x00080022, {text("DA", "20191231"), text("DA", "20200101"), text("DA", "20200102")}},
      {0x00180086, {text("IS", "1"), text("IS", "2"), text("IS", "10")}},
      {0x00180082, {decimals({90}), decimals({150}), decimals({2000})}},
      {0x00181314, {decimals({5}), decimals({10}), decimals({90})}},
      {0x00209241, {fd({0}), fd({50}), fd({100})}},
      {0x00189089, {fd({0, 0, 2}), fd({0, 0, 3}), fd({1, 0, 0})}},
      {0x00089208, {text("CS", "MAGNITUDE"), text("CS", "PHASE"), text("CS", "REAL")}}};
  for (const auto& [tag, values] : kinds) {
    SCOPED_TRACE(tag);
    const Folder folder;
    int n = 40;
    for (const int t : {2, 0, 1})
      for (const int k : {1, 0, 2}) {
        auto slice = at_height(k + 10 * t, 2.0 * k);
        slice[tag] = values[static_cast<std::size_t>(t)];
        slice[kInstance] = text("IS", std::to_string(--n));
        folder.write("f" + std::to_string(n), write_dicom(slice));
      }
    expect_error(folder.path(), ErrorCode::unsupported,
                 "3 time points, expected one: choose time point");
    for (const std::uint32_t t : {0u, 1u, 2u}) {
      const int from = 10 * static_cast<int>(t);
      const auto volume = expect_read(folder.path(), {.time = t});
      expect_slices(volume, {from, from + 1, from + 2});
      const bool is_number = tag != 0x00189089 && tag != 0x00089208;
      EXPECT_THAT(volume.notes, SizeIs(is_number ? 1 : 0));
      for (const auto& note : volume.notes)
        EXPECT_THAT(note, HasSubstr("time point " + std::to_string(t) + " of 3"));
    }
    if (tag == 0x0008002a) {
      EXPECT_THAT(expect_read(folder.path(), {.time = 0}).notes,
                  ElementsAre(HasSubstr("AcquisitionDateTime 20200101235959.5")));
      EXPECT_THAT(expect_read(folder.path(), {.time = 1}).notes,
                  ElementsAre(HasSubstr("AcquisitionDateTime 20200102000000")));
    }
    expect_error(folder.path(), ErrorCode::usage, "time point 3", {.time = 3});
    EXPECT_EQ(list_series(folder.path())->series[0].times, 3);
  }
}

TEST(DicomTimes, WithoutAnythingElseTheInstanceNumberOrders) {
  for (const bool by_slice : {true, false}) {
    const Folder folder;
    for (const int t : {1, 0})
      for (const int k : {0, 1, 2}) {
        auto slice = at_height(k + 10 * t, 2.0 * k);
        const int n = by_slice ? 2 * k + t : 3 * t + k;
        slice[kInstance] = text("IS", std::to_string(n + 1));
        folder.write(std::to_string(t) + std::to_string(k), write_dicom(slice));
      }
    expect_slices(expect_read(folder.path(), {.time = 0}), {0, 1, 2});
    expect_slices(expect_read(folder.path("01"), {.time = 1}), {10, 11, 12});
    std::filesystem::remove(folder.path("11"));
    expect_error(folder.path(), ErrorCode::bad_file, "1 of 2 time points", {.time = 0});
  }
}

TEST(DicomTimes, OneFileOfManyFrames) {
  const auto time_groups = [](double z, const DicomElements& more) {
    auto groups = frame_at(z);
    groups.insert(more.begin(), more.end());
    return groups;
  };
  // Functional groups that tell times apart, by time.
  const auto content = [](std::uint32_t tag, const DicomValue& value) {
    return DicomElements{{0x00209111, sequence({{{tag, value}}})}};
  };
  const auto group = [](std::uint32_t group, std::uint32_t tag, const DicomValue& value) {
    return DicomElements{{group, sequence({{{tag, value}}})}};
  };
  const std::array<std::array<DicomElements, 2>, 12> kinds = {{
      {content(0x00209128, ul({1})), content(0x00209128, ul({2}))},
      {content(0x00209157, ul({1, 1})), content(0x00209157, ul({1, 2}))},
      {content(0x00189074, text("DT", "20200101235958.5+0100")),
       content(0x00189074, text("DT", "20200101235959.25+0100"))},
      {content(0x00189151, text("DT", "20191231235959-0500")),
       content(0x00189151, text("DT", "20200101000001-0500"))},
      {DicomElements{{0x00189114, sequence({{{0x00189082, fd({4.9})}}})}},
       DicomElements{{0x00189114, sequence({{{0x00189082, fd({9.8})}}})}}},
      {DicomElements{{0x00189117, sequence({{{0x00189087, fd({0})}}})}},
       DicomElements{{0x00189117, sequence({{{0x00189087, fd({1000})}}})}}},
      {DicomElements{{0x00189118, sequence({{{0x00209153, fd({0})}}})}},
       DicomElements{{0x00189118, sequence({{{0x00209153, fd({40})}}})}}},
      {DicomElements{{0x00209310, sequence({{{0x0020930d, fd({0})}}})}},
       DicomElements{{0x00209310, sequence({{{0x0020930d, fd({2.5})}}})}}},
      {group(0x00209253, 0x00209245, fd({0})), group(0x00209253, 0x00209245, fd({50}))},
      {group(0x00189115, 0x00189079, fd({90})), group(0x00189115, 0x00189079, fd({150}))},
      {group(0x00189112, 0x00181314, decimals({5})), group(0x00189112, 0x00181314, decimals({10}))},
      {group(0x00189325, 0x00180060, decimals({120})),
       group(0x00189325, 0x00180060, decimals({80}))},
  }};
  for (const auto& kind : kinds)
    for (const bool is_explicit : {true, false}) {
      std::vector<DicomElements> frames;
      std::vector<int> pixels;
      for (const int k : {0, 1, 2})
        for (const int t : {1, 0}) {
          frames.push_back(time_groups(2.0 * k, kind[static_cast<std::size_t>(t)]));
          pixels.push_back(k + 10 * t);
        }
      auto file = enhanced_file(frames, pixels);
      file[0x00209222] =
          sequence({{{0x00209165, us({0x0020, 0x9056})}}, {{0x00209165, us({0x0020, 0x9128})}}});
      const Folder folder;
      const DicomForm form{.syntax = is_explicit ? "1.2.840.10008.1.2.1" : kImplicit,
                           .is_explicit = is_explicit};
      const auto path = folder.write("a.dcm", write_dicom(file, form));
      expect_error(path, ErrorCode::unsupported, "2 time points");
      expect_slices(expect_read(path, {.time = 0}), {0, 1, 2});
      expect_slices(expect_read(path, {.time = 1}), {10, 11, 12});
    }
}

TEST(DicomTimes, OneFilePerTime) {
  const Folder folder;
  for (const int t : {0, 1}) {
    auto file =
        enhanced_file({frame_at(0), frame_at(2), frame_at(4)}, {10 * t, 10 * t + 1, 10 * t + 2});
    file[kInstance] = text("IS", std::to_string(t + 1));
    folder.write(t == 0 ? "late_name" : "early_name", write_dicom(file));
  }
  expect_slices(expect_read(folder.path(), {.time = 0}), {0, 1, 2});
  expect_slices(expect_read(folder.path(), {.time = 1}), {10, 11, 12});
  expect_slices(expect_read(folder.path("early_name")), {10, 11, 12});
}

TEST(DicomPlaces, WithoutPositionsSlicesNeedASpacingOrALocation) {
  const Folder folder;
  const auto write = [&](bool located) {
    for (const int k : {0, 1, 2}) {
      auto slice = small_slice(k);
      slice.erase(kPosition);
      if (located) slice[0x00201041] = decimals({2.0 * k});
      folder.write("f" + std::to_string(9 - k), write_dicom(slice));
    }
  };
  write(false);
  expect_error(folder.path(), ErrorCode::bad_file, "3 slices without ImagePositionPatient");
  expect_slices(expect_read(folder.path(), {.spacing = glm::dvec3(0.7, 0.5, 2)}), {0, 1, 2});
  write(true);
  const auto volume = expect_read(folder.path());
  expect_slices(volume, {0, 1, 2});
  EXPECT_THAT(volume.notes, ElementsAre(HasSubstr("SliceLocation")));
}

TEST(DicomPlaces, FramesWithoutFunctionalGroups) {
  const Folder folder;
  auto file = enhanced_file({{}, {}, {}}, {0, 1, 2});
  file.erase(0x52009229);
  file.erase(0x52009230);
  const auto write = [&] { return folder.write("a.dcm", write_dicom(file)); };
  expect_error(write(), ErrorCode::bad_file, "PixelSpacing");
  expect_slices(expect_read(write(), {.spacing = glm::dvec3(0.7, 0.5, 2)}), {0, 1, 2});
  file[0x00280030] = decimals({0.5, 0.7});
  expect_error(write(), ErrorCode::unsupported, "3 frames without");
  // A dose states its frames' offsets, and how to scale.
  file[kPosition] = decimals({-10, -20, 5});
  file[kOrientation] = decimals({1, 0, 0, 0, 1, 0});
  auto dose = file;
  dose[0x3004000c] = decimals({0, 2, 4});
  dose[0x3004000e] = decimals({0.5});
  const auto volume = expect_read(folder.write("dose", write_dicom(dose)));
  EXPECT_EQ(volume.slope, 0.5);
  EXPECT_EQ(volume.origin, glm::dvec3(-10, -20, 5));
  EXPECT_EQ(value_at(volume, 1, 1, 2), 0.5 * slice_value(1, 1, 2));
  // A tomogram of nuclear medicine states where it begins in its detector, and the spacing.
  auto tomogram = file;
  tomogram.erase(kPosition);
  tomogram.erase(kOrientation);
  tomogram[0x00080008] = text("CS", "ORIGINAL\\PRIMARY\\RECON TOMO\\EMISSION");
  tomogram[0x00180088] = decimals({2});
  tomogram[0x00540022] = sequence(
      {{{kPosition, decimals({-10, -20, 0})}, {kOrientation, decimals({1, 0, 0, 0, 1, 0})}}});
  expect_slices(expect_read(folder.write("nm", write_dicom(tomogram))), {0, 1, 2});
}

TEST(DicomPlaces, ATiltedGantryIsSheared) {
  const Folder folder;
  for (const int k : {0, 1, 2}) {
    auto slice = small_slice(k);
    slice[kPosition] = decimals({-10, -20 + 0.5 * k, 2.0 * k});
    folder.write(file_name(k), write_dicom(slice));
  }
  const auto volume = expect_read(folder.path());
  EXPECT_LT(glm::length(volume.axes[2] - glm::dvec3(0, 0.5, 2)), 1e-9);
}

TEST(DicomPlaces, AMosaicAndTilesAreNamed) {
  const Folder folder;
  auto mosaic = small_slice(0);
  mosaic[0x00080008] = text("CS", "ORIGINAL\\PRIMARY\\M\\ND\\MOSAIC");
  expect_error(folder.write("a", write_dicom(mosaic)), ErrorCode::unsupported, "mosaic");
  auto enhanced = enhanced_file({frame_at(0), frame_at(2), frame_at(4)}, {0, 1, 2});
  enhanced[0x00080008] = mosaic[0x00080008];  // a word of it only
  expect_slices(expect_read(folder.write("c", write_dicom(enhanced))), {0, 1, 2});
  auto tile = small_slice(0);
  tile[0x00480006] = ul({4096});
  expect_error(folder.write("b", write_dicom(tile)), ErrorCode::unsupported, "slide");
}

}  // namespace
}  // namespace slf

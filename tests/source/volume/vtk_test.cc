// Legacy VTK files of structured points.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <sstream>

#include "tests/source/volume/samples.h"

namespace slf {
namespace {

using namespace samples;
using ::testing::HasSubstr;

std::string vtk_type(ScalarType type) {
  static const std::array<std::string, 10> kNames = {
      "unsigned_char", "char", "unsigned_short", "short", "unsigned_int",
      "int",           "long", "vtktypeint64",   "float", "double"};
  return type == ScalarType::u64 ? "unsigned_long" : kNames[static_cast<std::size_t>(type)];
}

std::string text(const std::string& separator = " ") {
  std::ostringstream numbers;
  for (std::uint32_t k = 0; k < kDims[2]; ++k)
    for (std::uint32_t j = 0; j < kDims[1]; ++j)
      for (std::uint32_t i = 0; i < kDims[0]; ++i) numbers << phantom_value(i, j, k) << separator;
  return std::move(numbers).str();
}

std::string vtk(const std::string& encoding, const std::string& attributes,
                const std::string& dims = "5 4 3") {
  return "# vtk DataFile Version 3.0\na title\n" + encoding +
         "\nDATASET STRUCTURED_POINTS\nDIMENSIONS " + dims +
         "\nORIGIN -10 20 30.5\nSPACING 1.5 2 3\n" + attributes;
}

std::string scalars(ScalarType type, bool ascii) {
  return "POINT_DATA 60\nSCALARS density " + vtk_type(type) + "\nLOOKUP_TABLE default\n" +
         (ascii ? text() : phantom_bytes(type, true));
}

TEST(VolumeVtk, EveryTypeAsTextAndBinary) {
  const Folder folder;
  for (const auto type : kAllTypes)
    for (const bool ascii : {false, true}) {
      const auto volume =
          expect_read(folder.write("a.vtk", vtk(ascii ? "ASCII" : "BINARY", scalars(type, ascii))));
      expect_phantom(volume, type);
      EXPECT_EQ(volume.spacing(), glm::dvec3(1.5, 2, 3));
      EXPECT_EQ(volume.origin, glm::dvec3(-10, 20, 30.5));
    }
}

TEST(VolumeVtk, OtherAttributesOldKeywordsAndLineEnds) {
  const Folder folder;
  const std::string voxels = phantom_bytes(ScalarType::u8, true);
  const auto expect = [&](const std::string& bytes, const VolumeOptions& options = {}) {
    expect_phantom(expect_read(folder.write("a.vtk", bytes), options), ScalarType::u8);
  };
  // Without a look-up table, with one, and in capitals or not.
  expect(vtk("BINARY", "POINT_DATA 60\nSCALARS a unsigned_char\n" + voxels));
  expect("\xEF\xBB\xBF" + vtk("BINARY", scalars(ScalarType::u8, false)));
  expect(vtk("ASCII", "point_data 60\nscalars a unsigned_char 1\nlookup_table t\n" + text("\r\n")));
  expect(vtk("BINARY", "POINT_DATA 60\nFIELD FieldData 1\na 1 60 unsigned_char\n" + voxels + "\n"));
  expect(vtk("BINARY",
             "FIELD FieldData 1\nTIME 1 1 double\n12345678\nPOINT_DATA 60\nSCALARS a "
             "unsigned_char\nLOOKUP_TABLE default\n" +
                 voxels));
  expect(vtk("BINARY",
             "METADATA\nINFORMATION 0\n\nPOINT_DATA 60\nSCALARS a unsigned_char\n" + voxels));
  std::string vectors, fractions;
  for (const char value : voxels) {
    vectors += std::string("xy") + value;
    fractions += std::to_string(static_cast<unsigned char>(value) / 255.0) + " 0 ";
  }
  const auto path =
      folder.write("v.vtk", vtk("BINARY", "POINT_DATA 60\nVECTORS v unsigned_char\n" + vectors));
  expect_error(path, ErrorCode::unsupported, "choose component 0 to 2");
  expect_phantom(expect_read(path, {.component = 2}), ScalarType::u8);
  expect(vtk("BINARY", "POINT_DATA 60\nCOLOR_SCALARS c 3\n" + vectors), {.component = 2});
  expect(vtk("ASCII", "POINT_DATA 60\nCOLOR_SCALARS c 2\n" + fractions), {.component = 0});
  auto old = vtk("BINARY", scalars(ScalarType::u8, false));
  old.replace(old.find("SPACING"), 7, "ASPECT_RATIO");
  expect(old);
}

TEST(VolumeVtk, CellsLieBetweenPoints) {
  const Folder folder;
  const auto volume = expect_read(folder.write(
      "a.vtk",
      vtk("BINARY", "CELL_DATA 60\nSCALARS a unsigned_char\n" + phantom_bytes(ScalarType::u8, true),
          "6 5 4")));
  expect_phantom(volume, ScalarType::u8);
  EXPECT_EQ(volume.origin, glm::dvec3(-9.25, 21, 32));
}

TEST(VolumeVtk, OfSeveralArraysTheFirstOrTheNamed) {
  const Folder folder;
  const std::string voxels = phantom_bytes(ScalarType::u8, true);
  const auto path = folder.write(
      "a.vtk", vtk("BINARY", "POINT_DATA 60\nSCALARS a unsigned_char\nLOOKUP_TABLE default\n" +
                                 voxels + "\nSCALARS b short\nLOOKUP_TABLE default\n" +
                                 phantom_bytes(ScalarType::i16, true) + "\n"));
  const auto first = expect_read(path);
  expect_phantom(first, ScalarType::u8);
  EXPECT_THAT(first.notes, ::testing::ElementsAre("of its 2 arrays ('a', 'b'), 'a' is read"));
  const auto named = expect_read(path, {.array = "b"});
  expect_phantom(named, ScalarType::i16);
  EXPECT_TRUE(named.notes.empty());
  expect_error(path, ErrorCode::usage, "no array 'c'; there are 'a', 'b'", {.array = "c"});
}

TEST(VolumeVtk, WhatIsNoVolumeIsNamed) {
  const Folder folder;
  const auto refuse = [&](const std::string& bytes, ErrorCode code, const std::string& part) {
    expect_error(folder.write("a.vtk", bytes), code, part);
  };
  const std::string start = "# vtk DataFile Version 3.0\na title\n";
  for (const std::string dataset : {"UNSTRUCTURED_GRID", "POLYDATA", "RECTILINEAR_GRID"})
    refuse(start + "BINARY\nDATASET " + dataset + "\n", ErrorCode::unsupported,
           "a VTK file of '" + dataset + "'");
  refuse(start + "HEX\n", ErrorCode::bad_file, "third line is 'hex'");
  refuse(vtk("ASCII", "NONSENSE 1\n"), ErrorCode::bad_file, "found 'NONSENSE'");
  refuse(vtk("ASCII", ""), ErrorCode::bad_file, "no array");
  refuse(vtk("ASCII", "POINT_DATA 60\nSCALARS a bit\n" + text()), ErrorCode::unsupported,
         "type 'bit'");
  refuse(vtk("ASCII", "POINT_DATA 60\nSCALARS a float\nLOOKUP_TABLE default\n1 2 three"),
         ErrorCode::bad_file, "do not fit the file");
  refuse(vtk("ASCII", "POINT_DATA 60\nSCALARS a unsigned_char\nLOOKUP_TABLE default\n256" +
                          text().substr(1)),
         ErrorCode::bad_file, "holds '256', expected numbers of type u8");
  refuse(vtk("ASCII", "POINT_DATA 60\nSCALARS a unsigned_char\n" + text(), "5 4 4"),
         ErrorCode::bad_file, "has 60 tuples, but the dimensions are 5x4x4");
  refuse(vtk("BINARY", "POINT_DATA 9999999999\nSCALARS a double\nLOOKUP_TABLE default\n"),
         ErrorCode::bad_file, "do not fit the file");
  refuse(vtk("BINARY", scalars(ScalarType::u8, false), "5 4"), ErrorCode::bad_file, "DIMENSIONS");
}

TEST(VolumeVtk, NumbersBeyondTheRangeOfDoubleAreZeroOrInfinite) {
  const Folder folder;
  const std::string numbers = "POINT_DATA 8\nSCALARS a double\n1e-400 1e400 +.5 2 3 4 5 6\n";
  const auto volume = expect_read(folder.write("a.vtk", vtk("ASCII", numbers, "2 2 2")));
  EXPECT_EQ(value_at(volume, 0, 0, 0), 0);
  EXPECT_EQ(value_at(volume, 1, 0, 0), HUGE_VAL);
  EXPECT_EQ(value_at(volume, 0, 1, 0), 0.5);
}

TEST(VolumeVtk, TruncatedAnywhereIsAnError) {
  const Folder folder;
  for (const bool ascii : {false, true}) {
    auto bytes = vtk(ascii ? "ASCII" : "BINARY", scalars(ScalarType::i16, ascii));
    if (ascii) bytes.resize(bytes.find_last_of(' ') - 1);  // up to the last number, of two digits
    expect_cuts_refused(folder, "a.vtk", bytes);
  }
}

}  // namespace
}  // namespace slf

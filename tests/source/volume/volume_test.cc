// read_volume over every format, scalar type and byte order; place and value of one marker.
#include "slf/volume.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/source/volume/samples.h"

namespace slf {
namespace {

using namespace samples;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

// The place within a rounding of the header's numbers: float in NIfTI-1, decimal in the others.
void expect_in_place(const Volume& volume) {
  ASSERT_EQ(volume.dims, kDims);
  for (const auto& at : {std::array<std::uint32_t, 3>{0, 0, 0}, kMarker, {4, 0, 0}, {0, 3, 0}}) {
    const glm::dvec3 expected = phantom_origin() + phantom_axes() * glm::dvec3(at[0], at[1], at[2]);
    EXPECT_LT(glm::length(world_of(volume, at[0], at[1], at[2]) - expected), 1e-5);
  }
  EXPECT_EQ(value_at(volume, kMarker[0], kMarker[1], kMarker[2]), kMarkerValue);
}

Nifti placed_nifti() {
  Nifti header;
  header.type = ScalarType::i16;
  header.sform = 1;
  header.srow = phantom_srow();
  return header;
}

TEST(Volume, ReadsEveryTypeAndByteOrderOfNifti) {
  const Folder folder;
  for (const auto type : kAllTypes)
    for (const bool big : {false, true})
      for (const int version : {1, 2}) {
        SCOPED_TRACE(std::string(name(type)) + (big ? " big" : " little"));
        const auto bytes = nifti({.version = version, .big_endian = big, .type = type});
        expect_phantom(expect_read(folder.write("a.nii", bytes)), type);
        expect_phantom(expect_read(folder.write("a.nii.gz", gzip(bytes))), type);
      }
}

TEST(Volume, ReadsEveryTypeAndByteOrderOfNrrd) {
  const Folder folder;
  for (const auto type : kAllTypes)
    for (const bool big : {false, true}) {
      SCOPED_TRACE(std::string(name(type)) + (big ? " big" : " little"));
      const std::string head = "type: " + nrrd_type(type) +
                               "\ndimension: 3\nsizes: 5 4 3\nendian: " + (big ? "big" : "little") +
                               "\nencoding: ";
      const auto data = phantom_bytes(type, big);
      expect_phantom(expect_read(folder.write("a.nrrd", nrrd(head + "raw\n", data))), type);
      expect_phantom(expect_read(folder.write("b.nrrd", nrrd(head + "gzip\n", gzip(data)))), type);
      folder.write("c.raw", "skipped" + data);
      expect_phantom(expect_read(folder.write(
                         "c.nhdr", nrrd(head + "raw\nbyte skip: -1\ndata file: ./c.raw\n", ""))),
                     type);
      folder.write("d.raw.gz", gzip("1234" + data));
      expect_phantom(expect_read(folder.write(
                         "d.nhdr", nrrd(head + "gzip\nbyte skip: 4\ndatafile: d.raw.gz\n", ""))),
                     type);
      folder.write("e.raw", "one\ntwo\n12" + data);
      expect_phantom(
          expect_read(folder.write(
              "e.nhdr", nrrd(head + "raw\nline skip: 2\nbyte skip: 2\ndata file: e.raw\n", ""))),
          type);
    }
}

TEST(Volume, ReadsEveryTypeAndByteOrderOfMetaImage) {
  const Folder folder;
  for (const auto type : kAllTypes)
    for (const bool big : {false, true}) {
      SCOPED_TRACE(std::string(name(type)) + (big ? " big" : " little"));
      for (const bool packed : {false, true})
        expect_phantom(expect_read(folder.write("a.mha", phantom_meta(type, big, packed))), type);
      auto detached = phantom_meta(type, big, false);
      detached.resize(detached.find("ElementDataFile"));
      folder.write("d.raw", "head" + phantom_bytes(type, big));
      for (const auto* skip : {"-1", "4"})
        expect_phantom(expect_read(folder.write("d.mhd", detached + "HeaderSize = " + skip +
                                                             "\nElementDataFile = d.raw\n")),
                       type);
    }
}

TEST(Volume, ReadsEveryTypeAndByteOrderOfRaw) {
  const Folder folder;
  for (const auto type : kAllTypes)
    for (const bool big : {false, true}) {
      const auto path = folder.write("a.raw", "12345" + phantom_bytes(type, big));
      const RawLayout layout{
          .dims = kDims, .type = type, .spacing = {1, 2, 3}, .big_endian = big, .offset = 5};
      const auto volume = expect_read(path, {.raw = layout});
      expect_phantom(volume, type);
      EXPECT_EQ(volume.spacing(), glm::dvec3(1, 2, 3));
    }
}

TEST(Volume, MarkerIsAtOnePlaceInEveryFormat) {
  const Folder folder;
  expect_in_place(expect_read(folder.write("s.nii", nifti(placed_nifti()))));
  auto second = placed_nifti();
  second.version = 2;
  second.big_endian = true;
  expect_in_place(expect_read(folder.write("2.nii", nifti(second))));
  // The same as a quaternion: in RAS a turn by acos(0.8) about z, axis x and y negated (a turn by
  // half a circle about z), the third axis reversed by qfac.
  auto q = placed_nifti();
  q.sform = 0;
  q.qform = 1;
  q.pixdim = {-1, 1.5, 2, 3, 0, 0, 0, 0};
  q.quaternion = {0, 0, std::sqrt(0.9), 12.5, -7.25, 40};  // d = sin((180° + 36.87°) / 2)
  // cos of that half angle is negative; NIfTI wants a >= 0, so all signs turn.
  q.quaternion[2] = -q.quaternion[2];
  expect_in_place(expect_read(folder.write("q.nii", nifti(q))));
  for (const auto* space : {"RAS", "LPS", "LAS", "left-posterior-superior"}) {
    SCOPED_TRACE(space);
    expect_in_place(
        expect_read(folder.write("a.nrrd", phantom_nrrd(ScalarType::i16, false, space))));
  }
  expect_in_place(expect_read(folder.write("a.mha", phantom_meta(ScalarType::i16, false, true))));
}

TEST(Volume, AxesArePatientsOnlyWhereTheFileSaysSo) {
  const Folder folder;
  const auto stated = [&](const std::string& name, const std::string& content) {
    return expect_read(folder.write(name, content)).patient_axes;
  };
  auto q = placed_nifti();
  EXPECT_TRUE(stated("a.nii", nifti(q)));
  q.sform = 0;
  EXPECT_FALSE(stated("a.nii", nifti(q)));
  q.qform = 1;
  EXPECT_TRUE(stated("a.nii", nifti(q)));
  const auto nrrd_in = [](const std::string& lines) {
    return nrrd("type: uint8\ndimension: 3\nsizes: 5 4 3\nencoding: raw\n" + lines,
                phantom_bytes(ScalarType::u8, false));
  };
  const std::string directions = "space directions: (1,0,0) (0,1,0) (0,0,1)\n";
  for (const std::string space :
       {"LPS", "RAS", "las", "left-posterior-superior", "right-anterior-superior-time", "RAST"})
    EXPECT_TRUE(stated("a.nrrd", nrrd_in("space: " + space + "\n" + directions))) << space;
  for (const std::string space : {"scanner-xyz", "3D-right-handed", "3D-left-handed"})
    EXPECT_FALSE(stated("a.nrrd", nrrd_in("space: " + space + "\n" + directions))) << space;
  EXPECT_FALSE(stated("a.nrrd", nrrd_in("space dimension: 3\n" + directions)));
  EXPECT_FALSE(stated("a.nrrd", nrrd_in("spacings: 1 1 1\n")));
  EXPECT_FALSE(stated("a.nrrd", nrrd_in("")));
  const auto meta_with = [](const std::string& lines) {
    return "ObjectType = Image\nNDims = 3\nDimSize = 5 4 3\nElementType = MET_UCHAR\n" + lines +
           "ElementDataFile = LOCAL\n" + phantom_bytes(ScalarType::u8, false);
  };
  EXPECT_TRUE(stated("a.mha", meta_with("AnatomicalOrientation = RAI\n")));
  EXPECT_FALSE(stated("a.mha", meta_with("AnatomicalOrientation = ???\n")));
  EXPECT_FALSE(stated("a.mha", meta_with("TransformMatrix = 1 0 0 0 1 0 0 0 1\n")));
  const std::string raw = folder.write("a.raw", phantom_bytes(ScalarType::u8, false));
  EXPECT_FALSE(expect_read(raw, {.raw = RawLayout{kDims}}).patient_axes);
  for (const bool placed : {true, false}) {
    const Folder series;
    for (std::uint32_t k = 0; k < 3; ++k)
      series.write(std::to_string(k), dicom({.k = k, .placed = placed}));
    EXPECT_EQ(expect_read(series.path(), {.spacing = glm::dvec3(1)}).patient_axes, placed);
  }
}

TEST(Volume, DicomIsSortedByPlaceAndNotByName) {
  for (const auto* syntax : {"1.2.840.10008.1.2.1", "1.2.840.10008.1.2"}) {
    const Folder folder;
    folder.write("c", dicom({.syntax = syntax, .k = 0}));
    folder.write("a", dicom({.syntax = syntax, .k = 1}));
    folder.write("b", dicom({.syntax = syntax, .k = 2}));
    folder.write("README.txt", "not DICOM");
    const auto volume = expect_read(folder.path());
    ASSERT_EQ(volume.dims, kDims);
    EXPECT_EQ(volume.type, ScalarType::i16);
    // The phantom's third axis runs against the normal: its slices come out in reverse.
    const auto at = std::array<std::uint32_t, 3>{kMarker[0], kMarker[1], 2 - kMarker[2]};
    EXPECT_EQ(value_at(volume, at[0], at[1], at[2]), kMarkerValue);
    const glm::dvec3 expected =
        phantom_origin() + phantom_axes() * glm::dvec3(kMarker[0], kMarker[1], kMarker[2]);
    EXPECT_LT(glm::length(world_of(volume, at[0], at[1], at[2]) - expected), 1e-9);
  }
}

TEST(Volume, DicomScaleIsKeptWhereUniformAndAppliedWhereNot) {
  const Folder uniform, varied;
  for (std::uint32_t k = 0; k < 3; ++k) {
    uniform.write(std::to_string(k), dicom({.k = k, .slope = 2, .intercept = -1024}));
    varied.write(std::to_string(k), dicom({.k = k, .slope = 0.5 * (k + 1)}));
  }
  const auto ct = expect_read(uniform.path());
  EXPECT_EQ(ct.type, ScalarType::i16);
  EXPECT_EQ(ct.slope, 2);
  EXPECT_EQ(ct.intercept, -1024);
  EXPECT_EQ(value_at(ct, 1, 2, 0), 2 * kMarkerValue - 1024);
  const auto pet = expect_read(varied.path());
  EXPECT_EQ(pet.type, ScalarType::f32);
  EXPECT_EQ(pet.slope, 1);
  for (std::uint32_t k = 0; k < 3; ++k)
    EXPECT_EQ(value_at(pet, 3, 1, 2 - k), 0.5 * (k + 1) * phantom_value(3, 1, k));
}

TEST(Volume, NiftiSlopeOfZeroMeansNone) {
  const Folder folder;
  auto header = placed_nifti();
  EXPECT_EQ(expect_read(folder.write("a.nii", nifti(header))).slope, 1);
  header.slope = 0.5;
  header.intercept = -3;
  const auto scaled = expect_read(folder.write("b.nii", nifti(header)));
  EXPECT_EQ(scaled.type, ScalarType::i16);
  EXPECT_EQ(scaled.slope, 0.5);
  EXPECT_EQ(scaled.intercept, -3);
  EXPECT_EQ(scaled.value_range(), (std::array<double, 2>{0.5 * 1 - 3, 0.5 * kMarkerValue - 3}));
}

TEST(Volume, NiftiUnitsBecomeMillimetres) {
  const Folder folder;
  auto header = placed_nifti();
  header.units = 3;  // microns
  const auto volume = expect_read(folder.write("a.nii", nifti(header)));
  EXPECT_NEAR(volume.spacing().z, 0.003, 1e-9);
  EXPECT_NEAR(volume.origin.z, 0.040, 1e-9);
  EXPECT_EQ(volume.unit, "mm");
  header.units = 0;
  EXPECT_EQ(expect_read(folder.write("b.nii", nifti(header))).unit, "");
}

// What nibabel's Nifti1Header.get_best_affine gives, worked out here from its rules: the sform
// where its code is set, else the qform, else shape_zoom_affine: LAS, the world's origin at the
// centre of the grid. In RAS, rows of [axes | origin].
struct Affine {
  glm::dmat3 axes;
  glm::dvec3 origin;
};

Affine nibabel_affine(const Nifti& header) {
  Affine a{glm::dmat3(0.0), glm::dvec3(0.0)};
  for (int i = 0; i < 3; ++i) {
    const auto axis = static_cast<std::size_t>(i);
    const double zoom = header.pixdim[axis + 1];
    if (header.sform > 0) {
      for (std::size_t column = 0; column < 3; ++column)
        a.axes[static_cast<int>(column)][i] = header.srow[4 * axis + column];
      a.origin[i] = header.srow[4 * axis + 3];
    } else if (header.qform > 0) {  // of the identity quaternion only
      a.axes[i][i] = zoom * (i == 2 && header.pixdim[0] < 0 ? -1 : 1);
      a.origin[i] = header.quaternion[axis + 3];
    } else {
      a.axes[i][i] = i == 0 ? -zoom : zoom;
      a.origin[i] = -(header.dim[axis] - 1) / 2.0 * a.axes[i][i];
    }
  }
  return a;
}

TEST(Volume, NiftiIsPlacedAsNibabelPlacesIt) {
  const Folder folder;
  for (const int version : {1, 2})
    for (const int qform : {0, 1, 2})
      for (const int sform : {0, 1, 4})
        for (const double shear : {0.0, 0.5}) {
          Nifti header{.version = version, .qform = qform, .sform = sform};
          header.pixdim = {-1, 1.5, 2, 2.5, 0, 0, 0, 0};
          header.quaternion = {0, 0, 0, 10, -20, 30};
          header.srow = {1.5, shear, 0, 20, 0, 2, 0.25, 5, 0, 0, -2.5, 7};
          SCOPED_TRACE("version " + std::to_string(version) + " qform " + std::to_string(qform) +
                       " sform " + std::to_string(sform) + " shear " + std::to_string(shear));
          const auto volume = expect_read(folder.write("a.nii", nifti(header)));
          const Affine expected = nibabel_affine(header);
          for (const auto& at : {glm::dvec3(0.0), glm::dvec3(4, 0, 0), glm::dvec3(1, 3, 2)}) {
            const glm::dvec3 ras = expected.axes * at + expected.origin;
            const glm::dvec3 lps = volume.axes * at + volume.origin;
            EXPECT_LT(glm::length(lps - glm::dvec3(-ras.x, -ras.y, ras.z)), 1e-5);
          }
          EXPECT_THAT(volume.placement, HasSubstr(sform   ? "sform (code " + std::to_string(sform)
                                                  : qform ? "qform (code " + std::to_string(qform)
                                                          : "neither"));
        }
}

TEST(Volume, NiftiSaysWhatIsOddAboutItsPlace) {
  const Folder folder;
  const auto notes = [&](const Nifti& header) {
    return expect_read(folder.write("a.nii", nifti(header))).notes;
  };
  auto header = placed_nifti();
  EXPECT_THAT(notes(header), IsEmpty());
  EXPECT_THAT(notes({}), ElementsAre(HasSubstr("left and right may be swapped")));
  header.qform = 1;
  EXPECT_THAT(notes(header), ElementsAre(AllOf(HasSubstr("placed by its sform (code 1)"),
                                               HasSubstr("qform (code 1) differs by up to"))));
  header = placed_nifti();
  header.srow = {1, 1, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
  EXPECT_THAT(notes(header), ElementsAre(HasSubstr("sheared: two of its axes meet at 45 degrees")));
  header.srow[0] = 0;
  header.srow[5] = 0;
  header.qform = 1;
  EXPECT_THAT(notes(header), ElementsAre(HasSubstr("sform (code 1) is singular or not finite")));
}

TEST(Volume, DetachedNifti) {
  const Folder folder;
  const auto whole = nifti({.vox_offset = 0, .magic = "i"});
  folder.write("a.img", whole.substr(352));
  expect_phantom(expect_read(folder.write("a.hdr", whole.substr(0, 348))), ScalarType::u8);
  folder.write("b.IMG", whole.substr(352));  // in another case
  expect_phantom(expect_read(folder.write("b.hdr", whole.substr(0, 348))), ScalarType::u8);
  expect_phantom(expect_read(folder.path("b.IMG")), ScalarType::u8);
}

TEST(Volume, NrrdWithoutSpaceIsPlacedBySpacingsAndMins) {
  const Folder folder;
  const std::string head = "type: uchar\ndimension: 3\nsizes: 5 4 3\nencoding: raw\n";
  const auto data = phantom_bytes(ScalarType::u8, false);
  const auto bare = expect_read(folder.write("a.nrrd", nrrd(head, data)));
  EXPECT_EQ(bare.axes, glm::dmat3(1.0));
  const auto placed = expect_read(folder.write(
      "b.nrrd",
      nrrd(head + "spacings: 1 2 3\naxis mins: 10 20 30\ncenters: cell node cell\n", data)));
  EXPECT_EQ(placed.spacing(), glm::dvec3(1, 2, 3));
  EXPECT_EQ(placed.origin, glm::dvec3(10.5, 20, 31.5));
}

TEST(Volume, TrailingExtentsOfOneAreNoDimensions) {
  const Folder folder;
  expect_phantom(expect_read(folder.write("a.nii", nifti({.dim = {5, 4, 3, 1, 1}}))),
                 ScalarType::u8);
  expect_phantom(
      expect_read(folder.write(
          "a.nrrd", nrrd("type: uchar\ndimension: 4\nsizes: 1 5 4 3\nencoding: raw\nkinds: "
                         "vector space space space\nspace: LPS\nspace directions: none (1,0,0) "
                         "(0,1,0) (0,0,1)\n",
                         phantom_bytes(ScalarType::u8, false)))),
      ScalarType::u8);
}

TEST(Volume, LabelsAreIntegers) {
  const Folder folder;
  const auto ids = folder.write("a.nii", nifti({.type = ScalarType::f32}));
  EXPECT_TRUE(expect_read(ids, {.raw = {}, .labels = true}).labels);
  EXPECT_FALSE(expect_read(ids).labels);
  for (const auto type : {ScalarType::f32, ScalarType::u8}) {
    const auto amounts = folder.write("b.nii", nifti({.type = type, .slope = 0.25}));
    const auto refused = read_volume(amounts, {.raw = {}, .labels = true});
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.error().code, ErrorCode::usage);
    EXPECT_THAT(refused.error().message, HasSubstr("not all integers"));
  }
}

// Programs store ids as floats, or with a slope that is rounded.
TEST(Volume, LabelsAreIntegersUpToRounding) {
  const Folder folder;
  const auto exact = expect_read(folder.write("a.nii", nifti({.type = ScalarType::u8})));
  std::string values;
  for (const auto byte : exact.voxels) {
    const double value = std::to_integer<int>(byte) * (1 + 1e-7);
    values.append(reinterpret_cast<const char*>(&value), sizeof value);
  }
  const std::string doubles = nifti({.type = ScalarType::f64});
  const std::string header = doubles.substr(0, doubles.size() - values.size());
  for (const auto& path :
       {folder.write("b.nii", header + values),
        folder.write("c.nii", nifti({.type = ScalarType::f32, .slope = 1 + 1.2e-7}))}) {
    const auto labels = expect_read(path, {.raw = {}, .labels = true});
    EXPECT_TRUE(labels.labels);
    for (std::uint32_t k = 0; k < 3; ++k)
      for (std::uint32_t i = 0; i < 5; ++i)
        EXPECT_EQ(value_at(labels, i, 1, k), phantom_value(i, 1, k));
  }
  std::string amounts = values;
  const double half = 7.5;
  amounts.replace(8, 8, reinterpret_cast<const char*>(&half), 8);
  expect_error(folder.write("d.nii", header + amounts), ErrorCode::usage, "not all integers",
               {.raw = {}, .labels = true});
}

TEST(Volume, ScalarTypesByTheirManyNames) {
  for (const auto type : kAllTypes) {
    EXPECT_EQ(*parse_scalar_type(name(type)), type);
    EXPECT_EQ(*parse_scalar_type(nrrd_type(type)), type);
  }
  EXPECT_EQ(*parse_scalar_type("Float"), ScalarType::f32);
  EXPECT_EQ(*parse_scalar_type("uint8"), ScalarType::u8);
  const auto unknown = parse_scalar_type("u9");
  ASSERT_FALSE(unknown);
  EXPECT_EQ(unknown.error().code, ErrorCode::usage);
  EXPECT_THAT(unknown.error().message, HasSubstr("u8, i8, u16, i16, u32, i32, u64, i64, f32, f64"));
}

}  // namespace
}  // namespace slf

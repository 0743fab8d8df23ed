// gzip, bzip2, xz and zstd around any format.
#include "source/volume/packing.h"

#include <bzlib.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <lzma.h>
#include <zstd.h>

#include <filesystem>
#include <fstream>
#include <iterator>

#include "tests/source/volume/samples.h"

namespace slf {
namespace {

using namespace samples;
using ::testing::HasSubstr;
using ::testing::StartsWith;

std::string bzip2(const std::string& bytes) {
  std::string packed(bytes.size() + bytes.size() / 100 + 600, '\0');
  auto size = static_cast<unsigned>(packed.size());
  EXPECT_EQ(BZ2_bzBuffToBuffCompress(packed.data(), &size, const_cast<char*>(bytes.data()),
                                     static_cast<unsigned>(bytes.size()), 9, 0, 0),
            BZ_OK);
  packed.resize(size);
  return packed;
}

std::string xz(const std::string& bytes) {
  std::string packed(lzma_stream_buffer_bound(bytes.size()), '\0');
  std::size_t size = 0;
  EXPECT_EQ(lzma_easy_buffer_encode(
                6, LZMA_CHECK_CRC64, nullptr, reinterpret_cast<const std::uint8_t*>(bytes.data()),
                bytes.size(), reinterpret_cast<std::uint8_t*>(packed.data()), &size, packed.size()),
            LZMA_OK);
  packed.resize(size);
  return packed;
}

std::string zstd(const std::string& bytes) {
  std::string packed(ZSTD_compressBound(bytes.size()), '\0');
  ZSTD_CCtx* context = ZSTD_createCCtx();
  ZSTD_CCtx_setParameter(context, ZSTD_c_checksumFlag, 1);  // as the program zstd does
  packed.resize(ZSTD_compress2(context, packed.data(), packed.size(), bytes.data(), bytes.size()));
  ZSTD_freeCCtx(context);
  return packed;
}

std::string content_of(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

struct Kind {
  const char* ending;
  std::string (*pack)(const std::string&);
};
constexpr std::array kKinds{Kind{".gz", &gzip}, Kind{".bz2", &bzip2}, Kind{".xz", &xz},
                            Kind{".zst", &zstd}};

std::string vti() {
  return "<VTKFile type=\"ImageData\" byte_order=\"LittleEndian\"><ImageData WholeExtent=\"0 4 0 3 "
         "0 2\"><Piece Extent=\"0 4 0 3 0 2\"><PointData><DataArray type=\"UInt8\" Name=\"a\" "
         "format=\"appended\" offset=\"0\"/></PointData></Piece></ImageData><AppendedData "
         "encoding=\"raw\">_" +
         integer_bytes(60, false, false) + phantom_bytes(ScalarType::u8, false) +
         "</AppendedData></VTKFile>";
}

/// Formats whose readers unpack by themselves, and such as need the unpacked file.
std::vector<std::pair<std::string, std::string>> formats() {
  return {{"a.nii", nifti({})},
          {"a.nrrd", phantom_nrrd(ScalarType::u8, false, "RAS")},
          {"b.nrrd", nrrd("type: uchar\ndimension: 3\nsizes: 5 4 3\nencoding: gzip\n",
                          gzip(phantom_bytes(ScalarType::u8, false)))},
          {"c.nrrd", nrrd("type: uchar\ndimension: 3\nsizes: 5 4 3\nencoding: bzip2\n",
                          bzip2(phantom_bytes(ScalarType::u8, false)))},
          {"a.mha", phantom_meta(ScalarType::u8, false, true)},
          {"a.vti", vti()}};
}

TEST(VolumePacking, AroundAnyFormat) {
  const Folder folder;
  for (const auto& [file, bytes] : formats())
    for (const auto& [ending, pack] : kKinds) {
      const auto path = folder.write(file + ending, pack(bytes));
      const auto volume = expect_read(path);
      expect_phantom(volume, ScalarType::u8);
      EXPECT_EQ(volume.source, path);
      EXPECT_THAT(volume.files, ::testing::Contains(path));
      for (const auto& used : volume.files) EXPECT_THAT(used, StartsWith(folder.path()));
    }
}

TEST(VolumePacking, ContentDecidesNotTheName) {
  const Folder folder;
  for (const auto& [ending, pack] : kKinds)
    expect_phantom(expect_read(folder.write("a.nii", pack(nifti({})))), ScalarType::u8);
}

TEST(VolumePacking, SlicesOfADicomSeriesAlone) {
  const Folder folder, plain;
  for (const std::uint32_t k : {0, 1, 2}) {
    const auto& [ending, pack] = kKinds[k];
    folder.write(std::to_string(k) + ".dcm" + ending, pack(dicom({.k = k})));
    plain.write(std::to_string(k) + ".dcm", dicom({.k = k}));
  }
  const Volume expected = expect_read(plain.path());
  for (const Volume& volume : {expect_read(folder.path()), expect_read(folder.path("1.dcm.bz2"))}) {
    EXPECT_EQ(volume.voxels, expected.voxels);
    EXPECT_EQ(volume.axes, expected.axes);
  }
}

TEST(VolumePacking, DataFilesOfDetachedHeadersAndRawVoxels) {
  const Folder folder;
  const std::string voxels = phantom_bytes(ScalarType::i16, true);
  for (const auto& [ending, pack] : kKinds) {
    const std::string file = std::string("v.raw") + ending;
    const auto raw = folder.write(file, pack("12" + voxels));
    const RawLayout layout{.dims = kDims, .type = ScalarType::i16, .big_endian = true, .offset = 2};
    expect_phantom(expect_read(raw, {.raw = layout}), ScalarType::i16);
    expect_phantom(
        expect_read(folder.write("a.nhdr", nrrd("type: short\ndimension: 3\nsizes: 5 4 3\nendian: "
                                                "big\nencoding: raw\nbyte skip: 2\ndata file: " +
                                                    file + "\n",
                                                ""))),
        ScalarType::i16);
    expect_phantom(expect_read(folder.write(
                       "a.mhd",
                       "NDims = 3\nDimSize = 5 4 3\nElementType = MET_SHORT\nElementByteOrderMSB = "
                       "True\nHeaderSize = 2\nElementDataFile = " +
                           file + "\n")),
                   ScalarType::i16);
  }
  // Headers may be packed as well.
  for (const char* header : {"a.nhdr", "a.mhd"})
    expect_phantom(expect_read(folder.write(std::string(header) + ".gz",
                                            gzip(content_of(folder.path(header))))),
                   ScalarType::i16);
  // Voxels that begin as a packed file does are voxels.
  const std::string alike = "\x1f\x8b" + phantom_bytes(ScalarType::u8, false).substr(2);
  EXPECT_EQ(value_at(expect_read(folder.write("v.raw", alike), {.raw = RawLayout{.dims = kDims}}),
                     0, 0, 0),
            0x1f);
}

// As pigz, pbzip2, xz and pzstd write them, and as `cat` makes them.
TEST(VolumePacking, SeveralMembersAreOneFile) {
  const Folder folder;
  const std::string bytes = nifti({.type = ScalarType::f64});
  for (const auto& [ending, pack] : kKinds)
    for (const std::size_t cut : {std::size_t{5}, bytes.size() / 2, bytes.size() - 1})
      expect_phantom(
          expect_read(folder.write(std::string("a.nii") + ending,
                                   pack(bytes.substr(0, cut)) + pack(bytes.substr(cut)))),
          ScalarType::f64);
  const std::string skippable("\x50\x2a\x4d\x18\4\0\0\0size", 12);
  expect_phantom(expect_read(folder.write("p.nii.zst", skippable + zstd(bytes.substr(0, 99)) +
                                                           skippable + zstd(bytes.substr(99)))),
                 ScalarType::f64);
}

TEST(VolumePacking, TruncatedAnywhereIsAnErrorThatNamesTheFile) {
  const Folder folder;
  for (const auto& [file, bytes] : formats())
    for (const auto& [ending, pack] : kKinds)
      expect_cuts_refused(folder, file + ending, pack(bytes));
}

TEST(VolumePacking, DamageIsNamed) {
  const Folder folder;
  for (const auto& [ending, pack] : kKinds) {
    std::string packed = pack(nifti({}));
    packed[packed.size() / 2] = static_cast<char>(packed[packed.size() / 2] ^ 4);
    expect_error(folder.write(std::string("a.nii") + ending, packed), ErrorCode::bad_file,
                 "packed data");
  }
}

TEST(VolumePacking, WhatIsInsideIsNamed) {
  const Folder folder;
  for (const auto& [ending, pack] : kKinds) {
    expect_error(folder.write(std::string("a.fits") + ending, pack("SIMPLE  =    T")),
                 ErrorCode::unsupported, "a FITS image");
    expect_error(folder.write(std::string("a.nii") + ending, pack("A text.")), ErrorCode::bad_file,
                 "'A text.' at its start, unpacked from ");
  }
}

// Neither memory nor the disk is filled because a file says so.
TEST(VolumePacking, BombsAreRefused) {
  const Folder folder;
  // A header that claims 27 TB, and one that claims 4 GB and has 1 KB.
  for (const auto& [ending, pack] : kKinds)
    for (const auto& dim : {std::vector{30000, 30000, 30000}, std::vector{1600, 1600, 1600}})
      expect_error(folder.write(std::string("a.nii") + ending, pack(nifti({.dim = dim}))),
                   ErrorCode::bad_file, "truncated");
  EXPECT_EQ(volume_io::max_unpacked(volume_io::Packing::gzip, 10), 10320u);
  EXPECT_EQ(volume_io::max_unpacked(volume_io::Packing::bzip2, 10), std::uint64_t{4} << 30);
}

TEST(VolumePacking, DictionariesThatTakeTooMuchMemoryAreRefused) {
  const Folder folder;
  std::string packed = xz(nifti({}));
  // The header of the block begins at byte 12 with its size; the filter LZMA2 has the size of the
  // dictionary, here 1 GiB; a checksum ends it.
  const std::size_t bytes = (static_cast<std::size_t>(packed[12]) + 1) * 4;
  const auto filter = packed.find("\x21\x01", 13);
  ASSERT_LT(filter, 12 + bytes);
  packed[filter + 2] = 36;
  const auto sum =
      lzma_crc32(reinterpret_cast<const std::uint8_t*>(packed.data()) + 12, bytes - 4, 0);
  packed.replace(12 + bytes - 4, 4, integer_bytes(sum, false, false));
  expect_error(folder.write("a.nii.xz", packed), ErrorCode::bad_file,
               "its dictionary takes more than 256 MiB");
}

TEST(VolumePacking, UnpackedFilesLeaveNothingBehind) {
  const Folder folder, temporary;
  const auto path = folder.write("a.mha.zst", zstd(phantom_meta(ScalarType::u8, false, false)));
  ::setenv("TMPDIR", temporary.path().c_str(), 1);
  expect_phantom(expect_read(path), ScalarType::u8);
  EXPECT_TRUE(std::filesystem::is_empty(temporary.path()));
  ::setenv("TMPDIR", temporary.path("none").c_str(), 1);
  expect_error(path, ErrorCode::io, "cannot be unpacked into a temporary file");
  ::unsetenv("TMPDIR");
}

}  // namespace
}  // namespace slf

// VTK ImageData, written here with zlib.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <lz4.h>
#include <lzma.h>

#include "tests/source/volume/samples.h"

namespace slf {
namespace {

using namespace samples;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

std::string base64(const std::string& bytes) {
  const char* digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    unsigned bits = 0;
    for (std::size_t k = 0; k < 3; ++k)
      bits = bits << 8 | (i + k < bytes.size() ? static_cast<unsigned char>(bytes[i + k]) : 0u);
    for (std::size_t k = 0; k < 4; ++k)
      text += i + k > bytes.size() ? '=' : digits[bits >> (18 - 6 * k) & 63];
  }
  return text;
}

std::string pack(const std::string& compressor, const std::string& bytes) {
  if (compressor == "ZLib") return zlib(bytes);
  std::string packed(bytes.size() * 2 + 1024, '\0');
  if (compressor == "LZ4") {
    packed.resize(static_cast<std::size_t>(LZ4_compress_default(bytes.data(), packed.data(),
                                                                static_cast<int>(bytes.size()),
                                                                static_cast<int>(packed.size()))));
    return packed;
  }
  std::size_t size = 0;
  EXPECT_EQ(lzma_easy_buffer_encode(
                6, LZMA_CHECK_CRC32, nullptr, reinterpret_cast<const std::uint8_t*>(bytes.data()),
                bytes.size(), reinterpret_cast<std::uint8_t*>(packed.data()), &size, packed.size()),
            LZMA_OK);
  packed.resize(size);
  return packed;
}

struct Vti {
  ScalarType type = ScalarType::i16;
  std::string format = "appended";  ///< ascii, binary or appended
  bool raw = true;                  ///< of appended data; else base64
  bool packed = false, wide = false, big = false;
  std::string compressor = "ZLib";
  std::string extent = "0 4 0 3 0 2";
  std::string attributes{};
  int components = 1;
};

std::string vti(const Vti& v) {
  static const std::array<const char*, 10> kNames = {"UInt8",   "Int8",   "UInt16", "Int16",
                                                     "UInt32",  "Int32",  "UInt64", "Int64",
                                                     "Float32", "Float64"};
  std::string plain = phantom_bytes(v.type, v.big), voxels;
  const std::size_t width = bytes_per_voxel(v.type);
  for (std::size_t at = 0; at < plain.size(); at += width)
    for (int c = 0; c < v.components; ++c)
      voxels += c + 1 == v.components ? plain.substr(at, width) : std::string(width, '\0');
  std::string head, body;
  if (v.packed) {  // two blocks, the last one short
    const std::size_t block = voxels.size() / 2 + 5;
    const std::string a = pack(v.compressor, voxels.substr(0, block));
    const std::string b = pack(v.compressor, voxels.substr(block));
    for (const std::size_t n : {std::size_t{2}, block, voxels.size() - block, a.size(), b.size()})
      head += integer_bytes(n, v.wide, v.big);
    body = a + b;
  } else {
    head = integer_bytes(voxels.size(), v.wide, v.big);
    body = voxels;
  }
  const std::string text = v.packed ? base64(head) + base64(body) : base64(head + body);
  std::string array = std::string("<DataArray type=\"") + kNames[static_cast<std::size_t>(v.type)] +
                      "\" Name=\"density\" NumberOfComponents=\"" + std::to_string(v.components) +
                      "\" format=\"" + v.format + "\"";
  if (v.format == "ascii") {
    array += ">\n";
    for (std::uint32_t k = 0; k < 3; ++k)
      for (std::uint32_t j = 0; j < 4; ++j)
        for (std::uint32_t i = 0; i < 5; ++i)
          array += std::to_string(static_cast<int>(phantom_value(i, j, k))) + " ";
    array += "</DataArray>";
  } else if (v.format == "binary") {
    array += ">\n   " + text + "\n</DataArray>";
  } else {
    array += " offset=\"3\"/>";
  }
  std::string file =
      "<?xml version=\"1.0\"?>\n<VTKFile type=\"ImageData\" version=\"1.0\" byte_order=\"" +
      std::string(v.big ? "BigEndian" : "LittleEndian") + "\" header_type=\"" +
      (v.wide ? "UInt64" : "UInt32") + "\"" +
      (v.packed ? " compressor=\"vtk" + v.compressor + "DataCompressor\"" : "") +
      ">\n<ImageData WholeExtent=\"" + v.extent + "\" Origin=\"1 2 3\" Spacing=\"0.5 1 2\" " +
      v.attributes + ">\n<Piece Extent=\"" + v.extent + "\"><PointData Scalars=\"density\">" +
      array + "</PointData></Piece></ImageData>\n";
  if (v.format == "appended")
    file += std::string("<AppendedData encoding=\"") + (v.raw ? "raw" : "base64") + "\">\n _xyz" +
            (v.raw ? head + body : text) + "\n</AppendedData>";
  return file + "</VTKFile>\n";
}

TEST(VolumeVti, ReadsEveryTypeAndEncoding) {
  const Folder folder;
  for (const auto type : kAllTypes)
    for (const auto* format : {"ascii", "binary", "appended"})
      for (const bool raw : {true, false})
        for (const bool packed : {true, false})
          for (const bool wide : {true, false})
            for (const bool big : {true, false}) {
              const Vti v{.type = type,
                          .format = format,
                          .raw = raw,
                          .packed = packed,
                          .wide = wide,
                          .big = big};
              SCOPED_TRACE(std::string(name(type)) + " " + format + (raw ? " raw" : "") +
                           (packed ? " packed" : "") + (wide ? " wide" : "") + (big ? " big" : ""));
              const auto volume = expect_read(folder.write("a.vti", vti(v)));
              expect_phantom(volume, type);
              EXPECT_EQ(volume.spacing(), glm::dvec3(0.5, 1, 2));
              EXPECT_EQ(volume.origin, glm::dvec3(1, 2, 3));
            }
}

TEST(VolumeVti, OtherCompressors) {
  const Folder folder;
  for (const auto* compressor : {"LZ4", "LZMA"})
    for (const auto* format : {"binary", "appended"})
      for (const bool raw : {true, false}) {
        SCOPED_TRACE(std::string(compressor) + " " + format);
        const Vti v{.format = format, .raw = raw, .packed = true, .compressor = compressor};
        const std::string bytes = vti(v);
        expect_phantom(expect_read(folder.write("a.vti", bytes)), v.type);
        if (format != std::string("appended")) continue;
        for (std::size_t size = bytes.size() / 2; size < bytes.find("\n</AppendedData>"); ++size)
          EXPECT_FALSE(read_volume(folder.write("b.vti", bytes.substr(0, size))));
      }
  // Numbers as text need no decompressor.
  expect_phantom(expect_read(folder.write(
                     "c.vti", vti({.format = "ascii", .packed = true, .compressor = "Zstd"}))),
                 ScalarType::i16);
}

/// A document with two arrays of text: zeros, and the phantom.
std::string with_arrays() {
  std::string numbers, zeros;
  for (std::uint32_t k = 0; k < 3; ++k)
    for (std::uint32_t j = 0; j < 4; ++j)
      for (std::uint32_t i = 0; i < 5; ++i) {
        numbers += std::to_string(static_cast<int>(phantom_value(i, j, k))) + " ";
        zeros += "0 ";
      }
  const auto array = [](const std::string& name, const std::string& text) {
    return "<DataArray type=\"UInt8\" Name=\"" + name + "\" format=\"ascii\">" + text +
           "</DataArray>";
  };
  return "<VTKFile type=\"ImageData\"><ImageData WholeExtent=\"0 4 0 3 0 2\" Spacing=\"1 1 1\">"
         "<Piece Extent=\"0 4 0 3 0 2\"><PointData>" +
         array("zeros", zeros) + array("values", numbers) +
         "</PointData></Piece></ImageData></VTKFile>";
}

TEST(VolumeVti, ArraysAreChosenByName) {
  const Folder folder;
  const auto path = folder.write("a.vti", with_arrays());
  EXPECT_THAT(expect_read(path).notes,
              ElementsAre(HasSubstr("2 arrays ('zeros', 'values'), 'zeros' is read")));
  const auto chosen = expect_read(path, {.array = "values"});
  expect_phantom(chosen, ScalarType::u8);
  EXPECT_THAT(chosen.notes, IsEmpty());
  expect_error(path, ErrorCode::usage, "no array 'density'; there are 'zeros', 'values'",
               {.array = "density"});
}

/// A piece of the phantom from slice `first` to `last`.
std::string piece(std::uint32_t first, std::uint32_t last) {
  std::string text = "<Piece Extent=\"0 4 0 3 " + std::to_string(first) + " " +
                     std::to_string(last) +
                     "\"><PointData><DataArray type=\"Int16\" Name=\"d\" format=\"ascii\">";
  for (std::uint32_t k = first; k <= last; ++k)
    for (std::uint32_t j = 0; j < 4; ++j)
      for (std::uint32_t i = 0; i < 5; ++i)
        text += std::to_string(static_cast<int>(phantom_value(i, j, k))) + " ";
  return text + "</DataArray></PointData></Piece>";
}

std::string in_pieces(const std::string& pieces, const std::string& p = "") {
  return "<VTKFile type=\"" + p + "ImageData\"><" + p +
         "ImageData WholeExtent=\"0 4 0 3 0 2\" Origin=\"1 2 3\" Spacing=\"0.5 1 2\">" + pieces +
         "</" + p + "ImageData></VTKFile>";
}

// Pieces share their outer points.
TEST(VolumeVti, PiecesInOneFileOrInSeveral) {
  const Folder folder;
  expect_phantom(expect_read(folder.write("a.vti", in_pieces(piece(0, 1) + piece(1, 2)))),
                 ScalarType::i16);
  const std::string arrays =
      "<PPointData Scalars=\"d\"><PDataArray type=\"Int16\" Name=\"d\"/></PPointData>";
  const std::string names =
      "<Piece Extent=\"0 4 0 3 0 1\" Source=\"p/0.vti\"/>"
      "<Piece Extent=\"0 4 0 3 1 2\" Source=\"p/1.vti\"/>";
  folder.write("p/0.vti", in_pieces(piece(0, 1)));
  const auto path = folder.write("a.pvti", in_pieces(arrays + names, "P"));
  expect_error(path, ErrorCode::not_found, "its piece 2 of 2 cannot be read");
  folder.write("p/1.vti", in_pieces(piece(1, 2)));
  const auto volume = expect_read(path);
  expect_phantom(volume, ScalarType::i16);
  EXPECT_EQ(volume.origin, glm::dvec3(1, 2, 3));
  EXPECT_EQ(volume.spacing(), glm::dvec3(0.5, 1, 2));
  EXPECT_THAT(volume.files, ::testing::Contains(folder.path("p/1.vti")));
  expect_phantom(expect_read(path, {.array = "d"}), ScalarType::i16);

  const auto bad = ErrorCode::bad_file;
  expect_error(folder.write("b.vti", in_pieces(piece(0, 0) + piece(2, 2))), bad,
               "2 pieces do not cover its extent");
  expect_error(folder.write("b.vti", in_pieces(piece(0, 1) + piece(0, 1))), bad, "do not cover");
  std::string outside = in_pieces(piece(0, 1) + piece(1, 2));
  outside.replace(outside.find("0 2\""), 4, "0 1\"");
  expect_error(folder.write("b.vti", outside), bad, "outside of the image");
  folder.write("p/1.vti", in_pieces(arrays + names, "P"));
  expect_error(path, bad, "expected one piece of ImageData");
  std::string other = in_pieces(piece(1, 2));
  folder.write("p/1.vti", other.replace(other.find("Int16"), 5, "Int32"));
  expect_error(path, bad, "lacks the array 'd' as 'Int16'");
}

TEST(VolumeVti, PlaceAndComponents) {
  const Folder folder;
  const auto moved = expect_read(folder.write("a.vti", vti({.extent = "10 14 0 3 -1 1"})));
  EXPECT_EQ(moved.origin, glm::dvec3(6, 2, 1));
  const auto turned =
      expect_read(folder.write("b.vti", vti({.attributes = "Direction=\"0 -1 0 1 0 0 0 0 1\""})));
  EXPECT_EQ(turned.axes[0], glm::dvec3(0, 0.5, 0));
  EXPECT_EQ(turned.axes[1], glm::dvec3(-1, 0, 0));
  const auto vectors = folder.write("c.vti", vti({.components = 3}));
  expect_error(vectors, ErrorCode::unsupported, "3 components");
  expect_phantom(expect_read(vectors, {.component = 2}), ScalarType::i16);
}

TEST(VolumeVti, SaysWhatIsWrong) {
  const Folder folder;
  const auto expect = [&](const Vti& v, const std::string& from, const std::string& to,
                          ErrorCode code, const std::string& part) {
    std::string text = vti(v);
    const auto at = text.find(from);
    ASSERT_NE(at, std::string::npos) << from;
    text.replace(at, from.size(), to);
    expect_error(folder.write("a.vti", text), code, part);
  };
  const auto bad = ErrorCode::bad_file;
  expect({}, "type=\"ImageData\"", "type=\"PolyData\"", ErrorCode::unsupported, "'PolyData'");
  expect({.packed = true}, "vtkZLib", "vtkZstd", ErrorCode::unsupported,
         "packed by 'vtkZstdDataCompressor', expected ZLib, LZ4 or LZMA");
  expect({.packed = true}, "vtkZLib", "vtkLZ4", bad, "packed block 0 of 2 is damaged");
  expect({.packed = true}, "vtkZLib", "vtkLZMA", bad, "packed block 0 of 2 is damaged");
  expect({.extent = "0 4 0 3 0 9"}, "x", "x", bad, "");
  expect({.extent = "0 99999 0 99999 0 99999"}, "x", "x", bad, "needs 2000000000000000 bytes");
  expect({}, "Spacing=\"0.5", "Spacing=\"0", bad, "Spacing along x is 0");
  expect({}, "offset=\"3\"", "offset=\"99999\"", bad, "beyond the end of the file");
  expect({}, "</PointData>", "</CellData>", bad, "line 4");
  expect({}, "Int16", "Int17", bad, "'Int17'");
  expect({.format = "ascii"}, "</DataArray>", "x</DataArray>", bad, "'x'");
  const std::string packed = vti({.packed = true});
  for (std::size_t size = 8; size < packed.find("\n</AppendedData>"); size += 7) {
    const auto volume = read_volume(folder.write("b.vti", packed.substr(0, size)));
    EXPECT_FALSE(volume) << size;
  }
}

}  // namespace
}  // namespace slf

// VTK ImageData, written here with zlib.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "volume_samples.h"

namespace slf {
namespace {

using namespace samples;

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

struct Vti {
  ScalarType type = ScalarType::i16;
  std::string format = "appended";  ///< ascii, binary or appended
  bool raw = true;                  ///< of appended data; else base64
  bool packed = false, wide = false, big = false;
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
    const std::string a = zlib(voxels.substr(0, block)), b = zlib(voxels.substr(block));
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
      (v.packed ? " compressor=\"vtkZLibDataCompressor\"" : "") + ">\n<ImageData WholeExtent=\"" +
      v.extent + "\" Origin=\"1 2 3\" Spacing=\"0.5 1 2\" " + v.attributes + ">\n<Piece Extent=\"" +
      v.extent + "\"><PointData Scalars=\"density\">" + array +
      "</PointData></Piece></ImageData>\n";
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
  expect({.packed = true}, "vtkZLib", "vtkLZ4", ErrorCode::unsupported, "vtkLZ4DataCompressor");
  expect({.extent = "0 4 0 3 0 9"}, "x", "x", bad, "");
  expect({.extent = "0 99999 0 99999 0 99999"}, "x", "x", bad, "needs 2000000000000000 bytes");
  expect({}, "Spacing=\"0.5", "Spacing=\"0", bad, "Spacing 0 along x");
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

// TIFF, PNG, VTI and MRC, as other writers write them: libtiff, libpng, zlib and hand-made headers.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <png.h>
#include <tiffio.h>

#include <cstring>
#include <random>

#include "volume_samples.h"

namespace slf {
namespace {

using namespace samples;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

Volume expect_read(const std::string& path, const VolumeOptions& options = {}) {
  auto volume = read_volume(path, options);
  EXPECT_TRUE(volume) << (volume ? "" : volume.error().message);
  return volume ? *volume : Volume{};
}

void expect_error(const std::string& path, ErrorCode code, const std::string& part,
                  const VolumeOptions& options = {}) {
  const auto volume = read_volume(path, options);
  ASSERT_FALSE(volume) << part;
  EXPECT_EQ(volume.error().code, code) << volume.error().message;
  EXPECT_THAT(volume.error().message, HasSubstr(part));
}

void expect_phantom(const Volume& volume, ScalarType type) {
  ASSERT_EQ(volume.dims, kDims);
  EXPECT_EQ(volume.type, type);
  for (std::uint32_t k = 0; k < kDims[2]; ++k)
    for (std::uint32_t j = 0; j < kDims[1]; ++j)
      for (std::uint32_t i = 0; i < kDims[0]; ++i)
        ASSERT_EQ(value_at(volume, i, j, k), phantom_value(i, j, k)) << i << j << k;
}

// ---- TIFF ---------------------------------------------------------------------------------------

struct Tiff {
  ScalarType type = ScalarType::u8;
  const char* mode = "w";  ///< "wb" big-endian, "w8" BigTIFF
  int compression = COMPRESSION_NONE;
  bool tiled = false;
  int samples = 1;  ///< all the same, but for the last where `colored`
  bool colored = false;
  bool apart = false;  ///< planes one after the other
  std::string description{};
  double resolution = 0;                         ///< pixels a unit
  std::vector<std::uint32_t> pages = {0, 1, 2};  ///< slices of the phantom
};

std::string write_tiff(const Folder& folder, const std::string& name, const Tiff& t) {
  const std::string path = folder.path(name);
  TIFF* tiff = TIFFOpen(path.c_str(), t.mode);
  EXPECT_NE(tiff, nullptr);
  const std::size_t size = bytes_per_voxel(t.type);
  const std::string voxels = phantom_bytes(t.type, false);
  for (std::size_t page = 0; page < t.pages.size(); ++page) {
    const std::uint32_t w = kDims[0], h = kDims[1];
    TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, w);
    TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, h);
    TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, static_cast<int>(8 * size));
    const bool real = t.type == ScalarType::f32 || t.type == ScalarType::f64;
    const bool whole = static_cast<int>(t.type) % 2 == 0;
    TIFFSetField(tiff, TIFFTAG_SAMPLEFORMAT,
                 real    ? SAMPLEFORMAT_IEEEFP
                 : whole ? SAMPLEFORMAT_UINT
                         : SAMPLEFORMAT_INT);
    TIFFSetField(tiff, TIFFTAG_SAMPLESPERPIXEL, t.samples);
    TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC,
                 t.samples >= 3 ? PHOTOMETRIC_RGB : PHOTOMETRIC_MINISBLACK);
    TIFFSetField(tiff, TIFFTAG_PLANARCONFIG, t.apart ? PLANARCONFIG_SEPARATE : PLANARCONFIG_CONTIG);
    TIFFSetField(tiff, TIFFTAG_COMPRESSION, t.compression);
    if (page == 0 && !t.description.empty())
      TIFFSetField(tiff, TIFFTAG_IMAGEDESCRIPTION, t.description.c_str());
    if (t.resolution > 0) {
      TIFFSetField(tiff, TIFFTAG_XRESOLUTION, t.resolution);
      TIFFSetField(tiff, TIFFTAG_YRESOLUTION, t.resolution / 2);
    }
    const auto sample = [&](std::uint32_t x, std::uint32_t y, int channel) {
      std::string bytes = voxels.substr(((t.pages[page] * h + y) * w + x) * size, size);
      if (t.colored && channel == t.samples - 1) bytes[0] = static_cast<char>(bytes[0] ^ 1);
      return bytes;
    };
    const int planes = t.apart ? t.samples : 1, inner = t.apart ? 1 : t.samples;
    if (t.tiled) {
      TIFFSetField(tiff, TIFFTAG_TILEWIDTH, 16);
      TIFFSetField(tiff, TIFFTAG_TILELENGTH, 16);
      std::string tile;
      for (std::uint32_t y = 0; y < 16; ++y)
        for (std::uint32_t x = 0; x < 16; ++x)
          for (int c = 0; c < inner; ++c)
            tile += x < w && y < h ? sample(x, y, c) : std::string(size, '\0');
      TIFFWriteEncodedTile(tiff, 0, tile.data(), static_cast<tmsize_t>(tile.size()));
    } else {
      TIFFSetField(tiff, TIFFTAG_ROWSPERSTRIP, 3);
      for (int plane = 0; plane < planes; ++plane)
        for (std::uint32_t y = 0; y < h; ++y) {
          std::string row;
          for (std::uint32_t x = 0; x < w; ++x)
            for (int c = 0; c < inner; ++c) row += sample(x, y, t.apart ? plane : c);
          TIFFWriteScanline(tiff, row.data(), y, static_cast<std::uint16_t>(plane));
        }
    }
    TIFFWriteDirectory(tiff);
  }
  TIFFClose(tiff);
  return path;
}

TEST(VolumeTiff, ReadsEveryTypeByteOrderAndLayout) {
  const Folder folder;
  for (const auto type : kAllTypes)
    for (const auto* mode : {"w", "wb", "w8"})
      for (const bool tiled : {false, true}) {
        SCOPED_TRACE(std::string(name(type)) + " " + mode + (tiled ? " tiled" : ""));
        expect_phantom(
            expect_read(write_tiff(folder, "a.tif", {.type = type, .mode = mode, .tiled = tiled})),
            type);
      }
  for (const int compression :
       {COMPRESSION_LZW, COMPRESSION_ADOBE_DEFLATE, COMPRESSION_PACKBITS, COMPRESSION_ZSTD}) {
    SCOPED_TRACE(compression);
    expect_phantom(expect_read(write_tiff(folder, "a.tif",
                                          {.type = ScalarType::u16, .compression = compression})),
                   ScalarType::u16);
  }
}

TEST(VolumeTiff, ColorsAreGreyWhereTheyAreEqualAndElseAChoice) {
  const Folder folder;
  for (const int samples : {2, 3, 4})
    expect_phantom(expect_read(write_tiff(folder, "a.tif", {.samples = samples})), ScalarType::u8);
  for (const bool apart : {false, true}) {
    const auto colored =
        write_tiff(folder, "a.tif", {.samples = 3, .colored = true, .apart = apart});
    if (!apart)
      expect_error(colored, ErrorCode::unsupported, "3 components, expected one: choose component");
    expect_phantom(expect_read(colored, {.component = 1}), ScalarType::u8);
    EXPECT_NE(value_at(expect_read(colored, {.component = 2}), 1, 1, 1), phantom_value(1, 1, 1));
  }
}

TEST(VolumeTiff, ImageJSaysSpacingChannelsAndTimes) {
  const Folder folder;
  const auto volume = expect_read(
      write_tiff(folder, "a.tif",
                 {.description = "ImageJ=1.53c\nimages=3\nslices=3\nunit=micron\nspacing=2.5\n",
                  .resolution = 4}));
  expect_phantom(volume, ScalarType::u8);
  EXPECT_EQ(volume.spacing(), glm::dvec3(0.25, 0.5, 2.5));
  EXPECT_THAT(volume.notes, IsEmpty());
  EXPECT_THAT(volume.placement, HasSubstr("ImageJ metadata, in micrometres"));
  // Channels are the fastest, then slices, then times: choose the second of each.
  const auto hyper = write_tiff(
      folder, "b.tif",
      {.description = "ImageJ=1.53c\nimages=12\nchannels=2\nslices=3\nframes=2\nhyperstack=true\n",
       .pages = {0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 2}});
  expect_error(hyper, ErrorCode::unsupported, "2 time points");
  expect_error(hyper, ErrorCode::unsupported, "2 components", {.time = 1});
  expect_phantom(expect_read(hyper, {.component = 1, .time = 1}), ScalarType::u8);
  // Slices saved as times.
  const auto frames = expect_read(
      write_tiff(folder, "c.tif", {.description = "ImageJ=1.53c\nimages=3\nframes=3\n"}));
  expect_phantom(frames, ScalarType::u8);
  EXPECT_THAT(frames.notes, ElementsAre(HasSubstr("call its slices time points"),
                                        HasSubstr("states no spacing")));
}

// Beyond 4 GiB ImageJ writes one page, and the voxels of all the others behind its own.
TEST(VolumeTiff, ImageJsRawStack) {
  const Folder folder;
  const auto path = write_tiff(folder, "a.tif",
                               {.type = ScalarType::u16,
                                .mode = "wb",
                                .description = "ImageJ=1.53c\nimages=3\nslices=3\n",
                                .pages = {0}});
  std::string bytes;
  {
    std::FILE* file = std::fopen(path.c_str(), "rb");
    for (int c = std::fgetc(file); c != EOF; c = std::fgetc(file)) bytes += static_cast<char>(c);
    std::fclose(file);
  }
  // Put the pixels of all slices at the end, and let the one strip begin there.
  const auto all = phantom_bytes(ScalarType::u16, true);
  const auto first = bytes.find(all.substr(0, 30));
  ASSERT_NE(first, std::string::npos);
  EXPECT_EQ(bytes.substr(first, 40), all.substr(0, 40));
  const std::string joined = bytes.substr(0, first) + all + bytes.substr(first + 40);
  // The directory lies behind the pixels: its offset, at byte 4, moves with them.
  const auto be32 = [](std::string& text, std::size_t at, std::uint32_t add) {
    std::uint32_t value = 0;
    for (std::size_t i = 0; i < 4; ++i)
      value = value << 8 | static_cast<unsigned char>(text[at + i]);
    value += add;
    for (std::size_t i = 0; i < 4; ++i) text[at + i] = static_cast<char>(value >> (24 - 8 * i));
  };
  std::string moved = joined;
  be32(moved, 4, static_cast<std::uint32_t>(all.size() - 40));
  const auto volume = read_volume(folder.write("b.tif", moved));
  // Offsets of values behind the pixels have moved, too: damaged at worst, never a crash.
  if (volume) expect_phantom(*volume, ScalarType::u16);
}

TEST(VolumeTiff, OmeSaysSpacingAndOrder) {
  const Folder folder;
  const auto ome = [](const std::string& more) {
    return "<?xml version=\"1.0\"?><OME "
           "xmlns=\"http://www.openmicroscopy.org/Schemas/OME/2016-06\">"
           "<Image><Pixels ID=\"P\" SizeX=\"5\" SizeY=\"4\" " +
           more + "/></Image></OME>";
  };
  const auto volume = expect_read(write_tiff(
      folder, "a.ome.tif",
      {.description = ome("DimensionOrder=\"XYZCT\" SizeZ=\"3\" SizeC=\"1\" SizeT=\"1\" "
                          "PhysicalSizeX=\"0.5\" PhysicalSizeY=\"250\" PhysicalSizeYUnit=\"nm\" "
                          "PhysicalSizeZ=\"2\"")}));
  expect_phantom(volume, ScalarType::u8);
  EXPECT_EQ(volume.spacing(), glm::dvec3(0.5, 0.25, 2));
  const auto channels = write_tiff(
      folder, "b.ome.tif",
      {.description = ome("DimensionOrder=\"XYCZT\" SizeZ=\"3\" SizeC=\"2\" SizeT=\"1\""),
       .pages = {2, 0, 2, 1, 2, 2}});
  expect_phantom(expect_read(channels, {.component = 1}), ScalarType::u8);
  expect_error(
      write_tiff(
          folder, "c.ome.tif",
          {.description = ome("DimensionOrder=\"XYZCT\" SizeZ=\"9\" SizeC=\"1\" SizeT=\"1\"")}),
      ErrorCode::bad_file, "3 pages, but its OME metadata say 9 slices");
  expect_error(write_tiff(folder, "d.ome.tif", {.description = "<OME><Pixels SizeZ=\"0\"/></OME>"}),
               ErrorCode::bad_file, "OME metadata: SizeT is absurd or missing");
  expect_error(write_tiff(folder, "e.ome.tif",
                          {.description = "<!DOCTYPE a [<!ENTITY b \"c\">]>"
                                          "<OME>&b;</OME>"}),
               ErrorCode::bad_file, "entities");
}

TEST(VolumeTiff, SaysWhatItDoesNotRead) {
  const Folder folder;
  expect_error(folder.write("a.tif", std::string("II*\0\x08\0\0\0", 8) + "xx"), ErrorCode::bad_file,
               "damaged TIFF");
  expect_error(write_tiff(folder, "b.tif", {.pages = {0}}), ErrorCode::unsupported, "single slice");
  expect_error(write_tiff(folder, "c.tif", {}), ErrorCode::usage, "time point 4", {.time = 4});
}

// Every truncation and many flipped bits: an error or a volume that holds together.
TEST(VolumeTiff, DamageIsAnErrorOrAVolume) {
  const Folder folder;
  const auto path = write_tiff(folder, "a.tif",
                               {.type = ScalarType::u16,
                                .compression = COMPRESSION_ADOBE_DEFLATE,
                                .description = "ImageJ=1.53c\nimages=3\nslices=3\n"});
  std::string bytes;
  std::FILE* file = std::fopen(path.c_str(), "rb");
  for (int c = std::fgetc(file); c != EOF; c = std::fgetc(file)) bytes += static_cast<char>(c);
  std::fclose(file);
  const auto check = [&](const std::string& damaged) {
    const auto volume = read_volume(folder.write("b.tif", damaged));
    if (!volume) return;
    EXPECT_EQ(volume->voxels.size(), volume->voxel_count() * bytes_per_voxel(volume->type));
  };
  for (std::size_t size = 1; size < bytes.size(); ++size) check(bytes.substr(0, size));
  std::mt19937 random(1);
  for (int round = 0; round < 2000; ++round) {
    std::string damaged = bytes;
    damaged[random() % damaged.size()] ^= static_cast<char>(1 << random() % 8);
    check(damaged);
  }
}

// ---- a folder of pictures -----------------------------------------------------------------------

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
  write_tiff(both, "a.tif", {});
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

TEST(VolumeFolder, TiffsOfAPageEach) {
  const Folder folder;
  for (const std::uint32_t k : {0, 1, 2})
    write_tiff(folder, "z" + std::to_string(k) + ".tiff", {.type = ScalarType::f32, .pages = {k}});
  expect_phantom(expect_read(folder.path()), ScalarType::f32);
}

// ---- VTK ImageData ------------------------------------------------------------------------------

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

std::string number(std::uint64_t value, bool wide, bool big) {
  std::string bytes;
  const int width = wide ? 8 : 4;
  for (int i = 0; i < width; ++i)
    bytes += static_cast<char>(value >> 8 * (big ? width - 1 - i : i));
  return bytes;
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
      head += number(n, v.wide, v.big);
    body = a + b;
  } else {
    head = number(voxels.size(), v.wide, v.big);
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

// ---- MRC ----------------------------------------------------------------------------------------

struct Mrc {
  std::int32_t mode = 1;
  bool big = false;
  std::array<std::int32_t, 3> size{5, 4, 3}, start{}, intervals{5, 4, 3}, map{1, 2, 3};
  std::array<float, 3> cell{5, 8, 9}, angles{90, 90, 90}, origin{};
  std::int32_t space_group = 1, extended = 0;
  ScalarType type = ScalarType::i16;
  int volumes = 1;  ///< zeros, and the phantom last
};

std::string mrc(const Mrc& m) {
  std::string file(1024 + static_cast<std::size_t>(std::max(m.extended, 0)), '\0');
  const auto put = [&](std::size_t word, auto value) {
    std::uint32_t bits = 0;
    std::memcpy(&bits, &value, 4);
    file.replace(4 * (word - 1), 4, number(bits, false, m.big));
  };
  for (std::size_t i = 0; i < 3; ++i) {
    put(1 + i, m.size[i]);
    put(5 + i, m.start[i]);
    put(8 + i, m.intervals[i]);
    put(11 + i, m.cell[i]);
    put(14 + i, m.angles[i]);
    put(17 + i, m.map[i]);
    put(50 + i, m.origin[i]);
  }
  put(4, m.mode);
  put(23, m.space_group);
  put(24, m.extended);
  file.replace(208, 4, "MAP ");
  for (int i = 1; i < m.volumes; ++i) file += std::string(60 * bytes_per_voxel(m.type), '\0');
  return file + phantom_bytes(m.type, m.big);
}

TEST(VolumeMrc, ReadsModesAndByteOrders) {
  const Folder folder;
  for (const bool big : {false, true})
    for (const auto& [mode, type] :
         {std::pair{0, ScalarType::i8}, std::pair{1, ScalarType::i16},
          std::pair{2, ScalarType::f32}, std::pair{6, ScalarType::u16}}) {
      const auto bytes = mrc({.mode = mode, .big = big, .extended = 80, .type = type});
      const auto volume = expect_read(folder.write("a.mrc", bytes));
      expect_phantom(volume, type);
      EXPECT_EQ(volume.spacing(), glm::dvec3(1, 2, 3));
      expect_phantom(expect_read(folder.write("a.map.gz", gzip(bytes))), type);
    }
}

TEST(VolumeMrc, CellAxesAndOrigin) {
  const Folder folder;
  // Columns along z, rows along x, sections along y: by the sizes of the cell.
  const auto turned = expect_read(folder.write(
      "a.mrc",
      mrc({.start = {1, 2, 3}, .intervals = {4, 3, 5}, .map = {3, 1, 2}, .cell = {8, 9, 5}})));
  EXPECT_EQ(turned.axes[0], glm::dvec3(0, 0, 1));
  EXPECT_EQ(turned.axes[1], glm::dvec3(2, 0, 0));
  EXPECT_EQ(turned.axes[2], glm::dvec3(0, 3, 0));
  EXPECT_EQ(turned.origin, glm::dvec3(4, 9, 1));
  const auto origin =
      expect_read(folder.write("b.mrc", mrc({.start = {1, 2, 3}, .origin = {7, 8, 9}})));
  EXPECT_EQ(origin.origin, glm::dvec3(7, 8, 9));
  const auto oblique = expect_read(folder.write("c.mrc", mrc({.angles = {90, 90, 120}})));
  EXPECT_NEAR(glm::dot(glm::normalize(oblique.axes[0]), glm::normalize(oblique.axes[1])), -0.5,
              1e-6);
  EXPECT_NEAR(oblique.spacing().y, 2, 1e-6);
  const auto bare = expect_read(folder.write("d.mrc", mrc({.cell = {0, 0, 0}})));
  EXPECT_EQ(bare.spacing(), glm::dvec3(1));
  EXPECT_THAT(bare.notes, ElementsAre(HasSubstr("1x1x1")));
}

TEST(VolumeMrc, StacksAndErrors) {
  const Folder folder;
  const auto stack =
      folder.write("a.mrc", mrc({.size = {5, 4, 6}, .space_group = 401, .volumes = 2}));
  expect_error(stack, ErrorCode::unsupported, "2 time points");
  expect_phantom(expect_read(stack, {.time = 1}), ScalarType::i16);
  expect_error(folder.write("b.mrc", mrc({.mode = 4})), ErrorCode::unsupported, "complex");
  expect_error(folder.write("b.mrc", mrc({.mode = 77})), ErrorCode::bad_file, "mode is 77");
  expect_error(folder.write("b.mrc", mrc({.size = {50000, 50000, 50000}})), ErrorCode::bad_file,
               "need 250000000000000 bytes");
  expect_error(folder.write("b.mrc", mrc({.angles = {1, 1, 179}})), ErrorCode::bad_file,
               "singular");
  expect_error(folder.write("b.mrc", mrc({.extended = -1})), ErrorCode::bad_file,
               "extended header");
  const auto whole = mrc({});
  for (std::size_t size = 1; size < whole.size(); size += 13)
    EXPECT_FALSE(read_volume(folder.write("c.mrc", whole.substr(0, size)))) << size;
}

// ---- choices that all formats share -------------------------------------------------------------

TEST(VolumeChoices, TimesAndComponentsOfTheOlderFormats) {
  const Folder folder;
  const std::string phantom = phantom_bytes(ScalarType::u8, false), zeros(60, '\0');
  std::string rgb;
  for (const char c : phantom) rgb += std::string(1, '\x07') + c + std::string(1, '\x09');
  const auto header = nifti({.dim = {5, 4, 3, 2}}).substr(0, 352);
  for (const bool packed : {false, true}) {
    const auto write = [&](const std::string& name, const std::string& bytes) {
      return folder.write(name, packed ? gzip(bytes) : bytes);
    };
    expect_phantom(expect_read(write("a.nii", header + zeros + phantom), {.time = 1}),
                   ScalarType::u8);
    expect_phantom(expect_read(write("b.nii", nifti({.datatype = 128}).substr(0, 352) + rgb),
                               {.component = 1}),
                   ScalarType::u8);
  }
  expect_phantom(expect_read(folder.write("c.nii", nifti({.dim = {5, 4, 3, 2, 2}}).substr(0, 352) +
                                                       zeros + zeros + zeros + phantom),
                             {.component = 1, .time = 1}),
                 ScalarType::u8);
  expect_phantom(
      expect_read(folder.write("a.nrrd", nrrd("type: uchar\ndimension: 5\nsizes: 3 5 4 3 2\nkinds: "
                                              "RGB-color domain domain domain time\n"
                                              "encoding: raw\nbyte skip: -1\n",
                                              zeros + zeros + zeros + rgb)),
                  {.component = 1, .time = 1}),
      ScalarType::u8);
  expect_phantom(expect_read(folder.write("a.mha",
                                          "NDims = 4\nDimSize = 5 4 3 2\nElementType = MET_UCHAR\n"
                                          "ElementNumberOfChannels = 3\nElementDataFile = LOCAL\n" +
                                              zeros + zeros + zeros + rgb),
                             {.component = 1, .time = 1}),
                 ScalarType::u8);
}

TEST(VolumeChoices, CropKeepsItsPlaceInTheWorld) {
  const Folder folder;
  Nifti header{.type = ScalarType::i16, .sform = 1};
  header.srow = phantom_srow();
  const auto path = folder.write("a.nii", nifti(header));
  const auto whole = expect_read(path);
  const auto part = expect_read(path, {.crop = VoxelBox{{1, 0, 1}, {4, 3, 0}}});
  EXPECT_THAT(part.dims, ElementsAre(3, 3, 2));
  for (std::uint32_t k = 0; k < 2; ++k)
    for (std::uint32_t j = 0; j < 3; ++j)
      for (std::uint32_t i = 0; i < 3; ++i) {
        EXPECT_EQ(value_at(part, i, j, k), value_at(whole, i + 1, j, k + 1));
        EXPECT_LT(glm::length(world_of(part, i, j, k) - world_of(whole, i + 1, j, k + 1)), 1e-9);
      }
}

TEST(VolumeChoices, SpacingOverrulesTheFile) {
  const Folder folder;
  const auto volume =
      expect_read(folder.write("a.nii", nifti({})), {.spacing = glm::dvec3(1, 2, 3)});
  EXPECT_LT(glm::length(volume.spacing() - glm::dvec3(1, 2, 3)), 1e-12);
}

}  // namespace
}  // namespace slf

// TIFF stacks as libtiff writes them.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tiffio.h>

#include <random>

#include "volume_samples.h"

namespace slf {
namespace {

using namespace samples;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

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

// Beyond 4 GiB ImageJ writes one page, and the voxels of all the others after its own.
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
  // The directory lies after the pixels: its offset, at byte 4, moves with them.
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
  // Offsets of values after the pixels have moved, too: damaged at worst, never a crash.
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

// Slices 0 and 1 in one file, slice 2 in another, as OME's metadata say.
TEST(VolumeTiff, OmeMayBeASetOfFiles) {
  const Folder folder;
  const auto ome = [](const std::string& places, const std::string& size = "3") {
    return "<OME><Image><Pixels DimensionOrder=\"XYZCT\" SizeZ=\"" + size +
           "\" SizeC=\"1\" SizeT=\"1\">" + places + "</Pixels></Image></OME>";
  };
  const auto place = [](const std::string& attributes, const std::string& file) {
    return "<TiffData " + attributes + "><UUID FileName=\"" + file + "\">urn:1</UUID></TiffData>";
  };
  const auto write = [&](const std::string& name, const std::string& description,
                         const std::vector<std::uint32_t>& pages) {
    return write_tiff(folder, name, {.description = description, .pages = pages});
  };
  const std::string first = place("FirstZ=\"0\" IFD=\"0\" PlaneCount=\"2\"", "a.ome.tif");
  const std::string set = ome(first + place("FirstZ=\"2\" IFD=\"0\"", "b.ome.tif"));
  const auto a = write("a.ome.tif", set, {0, 1});
  expect_error(a, ErrorCode::io, "b.ome.tif");
  const auto b = write("b.ome.tif", set, {2});
  for (const auto& path : {a, b}) {
    const auto volume = expect_read(path);
    expect_phantom(volume, ScalarType::u8);
    EXPECT_THAT(volume.files, ::testing::IsSupersetOf({a, b}));
  }

  folder.write("set.companion.ome", set);
  expect_phantom(
      expect_read(
          write("c.ome.tif", "<OME><BinaryOnly MetadataFile=\"set.companion.ome\"/></OME>", {2})),
      ScalarType::u8);

  expect_error(write("d.ome.tif", ome(first), {0, 1}), ErrorCode::bad_file,
               "do not say where picture 2 is");
  expect_error(write("d.ome.tif", ome(place("", "d.ome.tif")), {0, 1}), ErrorCode::bad_file,
               "has 2 pages, but page 2 is part of the volume");
  for (const char* file : {"a.ome.tif", "b.ome.tif"})
    expect_error(write("d.ome.tif",
                       ome(first + place("FirstZ=\"2\"", "b.ome.tif") +
                               place("FirstZ=\"3\" IFD=\"0\"", file),
                           "4"),
                       {0, 1}),
                 ErrorCode::unsupported, "comes after a later one");
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

TEST(VolumeFolder, TiffsOfAPageEach) {
  const Folder folder;
  for (const std::uint32_t k : {0, 1, 2})
    write_tiff(folder, "z" + std::to_string(k) + ".tiff", {.type = ScalarType::f32, .pages = {k}});
  expect_phantom(expect_read(folder.path()), ScalarType::f32);
}

}  // namespace
}  // namespace slf

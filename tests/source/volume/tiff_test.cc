// TIFF stacks as libtiff writes them.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tiffio.h>

#include <filesystem>
#include <random>

#include "tests/source/volume/samples.h"

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
  bool alpha = false;  ///< the last sample is opacity
  std::string description{};
  double resolution = 0;                         ///< pixels a unit
  int unit = RESUNIT_NONE;                       ///< of the resolution
  std::size_t thumbnails = 0;                    ///< of the pages, the first: 2x2
  bool marked = true;                            ///< as reduced copies
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
    if (t.alpha) {
      std::uint16_t meaning = EXTRASAMPLE_UNASSALPHA;
      TIFFSetField(tiff, TIFFTAG_EXTRASAMPLES, 1, &meaning);
    }
    if (page < t.thumbnails) {
      if (t.marked) TIFFSetField(tiff, TIFFTAG_SUBFILETYPE, FILETYPE_REDUCEDIMAGE);
      TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, 2);
      TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, 2);
      TIFFSetField(tiff, TIFFTAG_ROWSPERSTRIP, 2);
      std::string pixels(4 * size * static_cast<std::size_t>(t.samples), '\x7f');
      TIFFWriteEncodedStrip(tiff, 0, pixels.data(), static_cast<tmsize_t>(pixels.size()));
      TIFFWriteDirectory(tiff);
      continue;
    }
    if (page == t.thumbnails && !t.description.empty())
      TIFFSetField(tiff, TIFFTAG_IMAGEDESCRIPTION, t.description.c_str());
    if (t.resolution > 0) {
      TIFFSetField(tiff, TIFFTAG_XRESOLUTION, t.resolution);
      TIFFSetField(tiff, TIFFTAG_YRESOLUTION, t.resolution / 2);
      TIFFSetField(tiff, TIFFTAG_RESOLUTIONUNIT, t.unit);
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
    expect_error(colored, ErrorCode::unsupported, "3 components, expected one: choose component");
    expect_phantom(expect_read(colored, {.component = 1}), ScalarType::u8);
    EXPECT_NE(value_at(expect_read(colored, {.component = 2}), 1, 1, 1), phantom_value(1, 1, 1));
  }
}

// Two samples are two channels, unless the second is said to be opacity.
TEST(VolumeTiff, OpacityIsNoChannel) {
  const Folder folder;
  for (const int samples : {2, 4})
    for (const bool apart : {false, true}) {
      SCOPED_TRACE(samples);
      Tiff tiff{.samples = samples, .colored = true, .apart = apart, .alpha = true};
      expect_phantom(expect_read(write_tiff(folder, "a.tif", tiff)), ScalarType::u8);
      tiff.alpha = false;
      expect_error(write_tiff(folder, "a.tif", tiff), ErrorCode::unsupported,
                   std::to_string(samples) + " components, expected one");
    }
}

TEST(VolumeTiff, ThumbnailsMayComeFirst) {
  const Folder folder;
  const Tiff tiff{.thumbnails = 1, .pages = {0, 0, 1, 2}};
  const auto marked = expect_read(write_tiff(folder, "a.tif", tiff));
  expect_phantom(marked, ScalarType::u8);
  EXPECT_THAT(marked.notes, ElementsAre(HasSubstr("no spacing")));
  Tiff unmarked = tiff;
  unmarked.marked = false;
  const auto volume = expect_read(write_tiff(folder, "b.tif", unmarked));
  expect_phantom(volume, ScalarType::u8);
  EXPECT_THAT(volume.notes, ElementsAre(HasSubstr("left out as a thumbnail"), HasSubstr("")));
  Tiff described = tiff;
  described.description = "ImageJ=1.53c\nimages=3\nslices=3\nunit=um\nspacing=2\n";
  described.resolution = 2;
  EXPECT_EQ(expect_read(write_tiff(folder, "c.tif", described)).spacing(), glm::dvec3(0.5, 1, 2));
  expect_error(write_tiff(folder, "d.tif", {.thumbnails = 2, .pages = {0, 0}}),
               ErrorCode::unsupported, "nothing but reduced copies");
}

// As ImageJ takes them: a resolution counts without a unit, except 72 dots per inch.
TEST(VolumeTiff, ImageJsResolutionWithoutAUnit) {
  const Folder folder;
  const auto spacing = [&](double resolution, int unit, const std::string& more) {
    const auto volume =
        expect_read(write_tiff(folder, "a.tif",
                               {.description = "ImageJ=1.53c\nimages=3\nslices=3\n" + more,
                                .resolution = resolution,
                                .unit = unit}));
    return volume;
  };
  const auto plain = spacing(2, RESUNIT_NONE, "spacing=2.0\n");
  EXPECT_EQ(plain.spacing(), glm::dvec3(0.5, 1, 2));
  EXPECT_THAT(plain.placement, HasSubstr("in a unit that they do not state"));
  EXPECT_EQ(plain.unit, "");
  EXPECT_EQ(spacing(4, RESUNIT_CENTIMETER, "spacing=2\n").spacing(), glm::dvec3(2500, 5000, 20000));
  EXPECT_EQ(spacing(72, RESUNIT_INCH, "spacing=2\n").spacing(), glm::dvec3(1, 1, 2));
  EXPECT_EQ(spacing(2, RESUNIT_INCH, "unit=mm\nspacing=2\n").spacing(),
            glm::dvec3(500, 1000, 2000));
  EXPECT_THAT(spacing(2, RESUNIT_NONE, "").notes, ElementsAre(HasSubstr("only some")));
}

// tifffile of Python states the shape of the array that it wrote.
TEST(VolumeTiff, TifffileSaysTheShape) {
  const Folder folder;
  const auto write = [&](const std::string& description, std::vector<std::uint32_t> pages) {
    return write_tiff(folder, "a.tif", {.description = description, .pages = std::move(pages)});
  };
  expect_phantom(expect_read(write(R"({"shape": [3, 4, 5]})", {0, 1, 2})), ScalarType::u8);
  const auto times = write(R"({"shape": [2, 3, 4, 5]})", {0, 0, 0, 0, 1, 2});
  expect_error(times, ErrorCode::unsupported, "2 time points");
  expect_phantom(expect_read(times, {.time = 1}), ScalarType::u8);
  const auto channels = write(R"({"axes": "ZCYX", "shape": [3, 2, 4, 5]})", {2, 0, 2, 1, 2, 2});
  expect_error(channels, ErrorCode::unsupported, "2 components");
  expect_phantom(expect_read(channels, {.component = 1}), ScalarType::u8);
  expect_error(write(R"({"shape": [2, 9, 4, 5]})", {0, 1, 2}), ErrorCode::bad_file,
               "3 pages, but its tifffile metadata say 9 slices");
  expect_phantom(expect_read(write(R"({"shape": "none"})", {0, 1, 2})), ScalarType::u8);
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
  EXPECT_EQ(volume.unit, "µm");
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

TEST(VolumeTiff, ImageJCalibratesValuesAndNamesUnits) {
  const Folder folder;
  const auto read = [&](const std::string& more) {
    return expect_read(write_tiff(
        folder, "a.tif",
        {.description = "ImageJ=1.53t\nimages=3\nslices=3\nspacing=2\n" + more, .resolution = 1}));
  };
  const auto with_sign = read("c0=-32768.0\nc1=1.0\nvunit=HU\n");
  EXPECT_EQ(with_sign.slope, 1);
  EXPECT_EQ(with_sign.intercept, -32768);
  EXPECT_EQ(read("cf=0\nc0=3\nc1=0.5\n").slope, 0.5);
  EXPECT_EQ(read("cf=3\nc0=3\nc1=0.5\n").slope, 1);  // another function
  EXPECT_EQ(read("unit=um\nzunit=mm\n").spacing(), glm::dvec3(1, 2, 2000));
  const Folder slices;
  for (const std::uint32_t k : {0u, 1u, 2u})
    write_tiff(slices, std::to_string(k) + ".tif",
               {.description = "ImageJ=1.53t\nc0=-32768.0\nc1=1.0\n", .pages = {k}});
  EXPECT_EQ(expect_read(slices.path()).intercept, -32768);
}

// Beyond 4 GiB ImageJ writes one page, and the voxels of all the others after its own.
/// A TIFF with one page of the phantom's size, 16 bits, whose pixels begin `pixels`.
std::string one_page(const std::string& description, const std::string& pixels) {
  const auto le = [](std::uint32_t value, int bytes) {
    std::string text;
    for (int k = 0; k < bytes; ++k) text += static_cast<char>(value >> (8 * k));
    return text;
  };
  constexpr std::uint32_t kEntries = 9, kText = 8 + 2 + 12 * kEntries + 4;
  const auto length = static_cast<std::uint32_t>(description.size()) + 1;
  std::string file = std::string("II*\0", 4) + le(8, 4) + le(kEntries, 2);
  const auto entry = [&](std::uint32_t tag, std::uint32_t type, std::uint32_t count,
                         std::uint32_t value) {
    file += le(tag, 2) + le(type, 2) + le(count, 4) + le(value, 4);
  };
  constexpr std::uint32_t kAscii = 2, kShort = 3, kLong = 4;
  entry(TIFFTAG_IMAGEWIDTH, kLong, 1, kDims[0]);
  entry(TIFFTAG_IMAGELENGTH, kLong, 1, kDims[1]);
  entry(TIFFTAG_BITSPERSAMPLE, kShort, 1, 16);
  entry(TIFFTAG_COMPRESSION, kShort, 1, COMPRESSION_NONE);
  entry(TIFFTAG_PHOTOMETRIC, kShort, 1, PHOTOMETRIC_MINISBLACK);
  entry(TIFFTAG_IMAGEDESCRIPTION, kAscii, length, kText);
  entry(TIFFTAG_STRIPOFFSETS, kLong, 1, kText + length);
  entry(TIFFTAG_ROWSPERSTRIP, kLong, 1, kDims[1]);
  entry(TIFFTAG_STRIPBYTECOUNTS, kLong, 1, kDims[0] * kDims[1] * 2);
  return file + le(0, 4) + description + std::string(1, '\0') + pixels;
}

// Beyond 4 GiB, ImageJ writes one page, and the pixels of all pictures after it.
TEST(VolumeTiff, ImageJsRawStack) {
  const Folder folder;
  const auto phantom = phantom_bytes(ScalarType::u16, false);
  const std::size_t slice = phantom.size() / 3;
  const auto plain = folder.write("a.tif", one_page("ImageJ=1.53c\nimages=3\nslices=3\n", phantom));
  expect_phantom(expect_read(plain), ScalarType::u16);
  std::string channels, times;
  for (std::size_t z = 0; z < 3; ++z)
    channels += std::string(slice, '\x7f') + phantom.substr(z * slice, slice);
  const auto two =
      folder.write("b.tif", one_page("ImageJ=1.53c\nimages=6\nchannels=2\nslices=3\n", channels));
  expect_error(two, ErrorCode::unsupported, "2 components");
  expect_phantom(expect_read(two, {.component = 1}), ScalarType::u16);
  EXPECT_EQ(value_at(expect_read(two, {.component = 0}), 1, 2, 2), 0x7f7f);
  const auto moving =
      folder.write("c.tif", one_page("ImageJ=1.53c\nimages=12\nchannels=2\nslices=3\nframes=2\n",
                                     std::string(channels.size(), '\0') + channels));
  expect_phantom(expect_read(moving, {.component = 1, .time = 1}), ScalarType::u16);
  expect_error(folder.write("d.tif", one_page("ImageJ=1.53c\nimages=6\nchannels=2\nslices=3\n",
                                              channels.substr(0, 5 * slice))),
               ErrorCode::bad_file, "truncated", {.component = 1});
}

// As tifffile and Bio-Formats do: the place of a picture is the one that is stated.
TEST(VolumeTiff, OmeSaysWhichPageIsWhichSlice) {
  const Folder folder;
  const auto write = [&](const std::string& name, const std::string& places,
                         const std::vector<std::uint32_t>& pages) {
    return write_tiff(
        folder, name,
        {.description = "<OME><Image><Pixels DimensionOrder=\"XYZCT\" SizeZ=\"3\" SizeC=\"1\" "
                        "SizeT=\"1\">" +
                        places + "</Pixels></Image></OME>",
         .pages = pages});
  };
  const auto place = [](int z, int page, const std::string& more = "") {
    return "<TiffData FirstZ=\"" + std::to_string(z) + "\" IFD=\"" + std::to_string(page) + "\">" +
           more + "</TiffData>";
  };
  const auto reversed = place(2, 0) + place(1, 1) + place(0, 2);
  expect_phantom(expect_read(write("a.ome.tif", reversed, {2, 1, 0})), ScalarType::u8);
  expect_phantom(
      expect_read(write("a.ome.tif", place(1, 0) + place(2, 1) + place(0, 2), {1, 2, 0})),
      ScalarType::u8);
  // The file was renamed.
  const std::string old = "<UUID FileName=\"old.ome.tif\">urn:1</UUID>";
  expect_phantom(
      expect_read(
          write("b.ome.tif", place(2, 0, old) + place(1, 1, old) + place(0, 2, old), {2, 1, 0})),
      ScalarType::u8);
  // Places that cannot be meant: pages in their order.
  for (const auto& wrong : {place(0, 0) + place(0, 1) + place(0, 2), place(0, 0) + place(1, 0),
                            place(0, 0) + place(1, 1) + place(2, 9)})
    expect_phantom(expect_read(write("c.ome.tif", wrong, {0, 1, 2})), ScalarType::u8);
  // A reversed set of files.
  const auto in = [](const std::string& file) {
    return "<UUID FileName=\"" + file + "\">urn:1</UUID>";
  };
  const auto set =
      place(2, 0, in("d.ome.tif")) + place(1, 0, in("e.ome.tif")) + place(0, 1, in("e.ome.tif"));
  write("e.ome.tif", set, {1, 0});
  expect_phantom(expect_read(write("d.ome.tif", set, {2})), ScalarType::u8);
  // One that leaves its metadata to another file of the set.
  write_tiff(folder, "f.ome.tif",
             {.description = "<OME><BinaryOnly MetadataFile=\"d.ome.tif\"/></OME>", .pages = {2}});
  expect_phantom(expect_read(folder.path("f.ome.tif")), ScalarType::u8);
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

TEST(VolumeTiff, OmeSizesMayHaveAnyUnit) {
  const Folder folder;
  const auto spacing = [&](const std::string& unit, const std::string& z) {
    const std::string ome =
        "<OME><Image><Pixels DimensionOrder=\"XYZCT\" SizeZ=\"3\" SizeC=\"1\" SizeT=\"1\" "
        "PhysicalSizeX=\"1\" PhysicalSizeY=\"1\" PhysicalSizeZ=\"" +
        z + "\" PhysicalSizeZUnit=\"" + unit + "\"/></Image></OME>";
    return expect_read(write_tiff(folder, "a.tif", {.description = ome}));
  };
  for (const auto& [unit, z] :
       std::vector<std::pair<std::string, std::string>>{{"Ym", "2e-30"},
                                                        {"Mm", "2e-12"},
                                                        {"km", "2e-9"},
                                                        {"dam", "2e-7"},
                                                        {"m", "2e-6"},
                                                        {"mm", "2e-3"},
                                                        {"\u00b5m", "2"},
                                                        {"\u03bcm", "2"},
                                                        {"nm", "2e3"},
                                                        {"pm", "2e6"},
                                                        {"am", "2e12"},
                                                        {"\u00c5", "2e4"},
                                                        {"in", "7.874015748031496e-05"},
                                                        {"thou", "0.07874015748031496"},
                                                        {"ft", "6.561679790026247e-06"},
                                                        {"mi", "1.2427423844746679e-09"},
                                                        {"pt", "0.005669291338582677"},
                                                        {"ua", "1.3369174e-17"}}) {
    const auto volume = spacing(unit, z);
    EXPECT_NEAR(volume.spacing().z, 2, 1e-6) << unit;
    EXPECT_EQ(volume.unit, "\u00b5m") << unit;
  }
  for (const char* unit : {"pixel", "reference frame", "no unit"}) {
    const auto volume = spacing(unit, "2");
    EXPECT_EQ(volume.spacing().z, 2);
    EXPECT_EQ(volume.unit, "") << unit;
  }
}

TEST(VolumeTiff, SlicesMayBeCalledChannels) {
  const Folder folder;
  const Tiff six{.pages = {0, 1, 2, 0, 1, 2}};
  for (const char* text : {"ImageJ=1.11a\nimages=6\nchannels=6\nhyperstack=true\n",
                           "<OME><Image><Pixels DimensionOrder=\"XYCZT\" SizeZ=\"1\" SizeC=\"6\" "
                           "SizeT=\"1\"/></Image></OME>"}) {
    Tiff t = six;
    t.description = text;
    const auto path = write_tiff(folder, "a.tif", t);
    const auto volume = expect_read(path);
    EXPECT_EQ(volume.dims[2], 6u);
    EXPECT_EQ(value_at(volume, 1, 2, 5), phantom_value(1, 2, 2));
    EXPECT_THAT(volume.notes, ::testing::Contains(HasSubstr("call its slices channels")));
    expect_error(path, ErrorCode::unsupported, "a single slice", {.component = 1});
  }
  // So few may be colours.
  expect_error(write_tiff(folder, "a.tif", {.description = "ImageJ=1\nimages=3\nchannels=3\n"}),
               ErrorCode::unsupported, "a single slice");
}

TEST(VolumeTiff, ImageJMayStoreSlicesFirst) {
  const Folder folder;
  for (const char* order : {"zct", "xyzct"}) {
    const auto path = write_tiff(
        folder, "a.tif",
        {.description = "ImageJ=1.52\nimages=6\nchannels=2\nslices=3\nhyperstack=true\norder=" +
                        std::string(order) + "\n",
         .pages = {0, 1, 2, 2, 2, 2}});
    expect_phantom(expect_read(path, {.component = 0}), ScalarType::u8);
    EXPECT_EQ(value_at(expect_read(path, {.component = 1}), 1, 1, 0), phantom_value(1, 1, 2));
  }
}

/// Three pages of 11x4 samples of so few bits, the rows as stored.
std::string write_pages(const Folder& folder, int bits, int format, const std::string& row,
                        int compression = COMPRESSION_NONE, int kind = PHOTOMETRIC_MINISBLACK) {
  const std::string path = folder.path("few.tif");
  TIFF* tiff = TIFFOpen(path.c_str(), "w");
  for (int page = 0; page < 3; ++page) {
    TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, 11);
    TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, 4);
    TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, bits);
    TIFFSetField(tiff, TIFFTAG_SAMPLEFORMAT, format);
    TIFFSetField(tiff, TIFFTAG_SAMPLESPERPIXEL, 1);
    TIFFSetField(tiff, TIFFTAG_COMPRESSION, compression);
    TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, kind);
    TIFFSetField(tiff, TIFFTAG_ROWSPERSTRIP, 3);
    for (std::uint32_t y = 0; y < 4; ++y) {
      std::string bytes = row;
      TIFFWriteScanline(tiff, bytes.data(), y, 0);
    }
    TIFFWriteDirectory(tiff);
  }
  TIFFClose(tiff);
  return path;
}

TEST(VolumeTiff, SlicesMayBeSamplesOfOnePage) {
  const Folder folder;
  for (const ScalarType type : {ScalarType::u8, ScalarType::f32})
    for (const bool apart : {false, true}) {
      const Tiff t{.type = type, .samples = 6, .colored = true, .apart = apart, .pages = {1}};
      const auto path = write_tiff(folder, "a.tif", t);
      const auto volume = expect_read(path);
      EXPECT_EQ(volume.dims[2], 6u);
      EXPECT_EQ(value_at(volume, 1, 2, 4), phantom_value(1, 2, 1));
      EXPECT_NE(value_at(volume, 1, 2, 5), phantom_value(1, 2, 1));
      EXPECT_THAT(volume.notes, ::testing::Contains(HasSubstr("they are its slices")));
      expect_error(path, ErrorCode::unsupported, "a single slice", {.component = 1});
    }
}

TEST(VolumeTiff, SamplesMayBeBitsOrHalfFloats) {
  const Folder folder;
  for (const int compression : {COMPRESSION_NONE, COMPRESSION_CCITTFAX3, COMPRESSION_CCITTFAX4})
    for (const int kind : {PHOTOMETRIC_MINISBLACK, PHOTOMETRIC_MINISWHITE}) {
      const auto bits =
          expect_read(write_pages(folder, 1, SAMPLEFORMAT_UINT, "\xA5\x20", compression, kind));
      EXPECT_EQ(bits.type, ScalarType::u8);
      for (std::uint32_t x = 0; x < 11; ++x)
        EXPECT_EQ(value_at(bits, x, 3, 2), std::string("10100101001")[x] - '0') << x;
      const bool said = std::ranges::any_of(
          bits.notes, [](const auto& note) { return note.starts_with("WhiteIsZero"); });
      EXPECT_EQ(said, kind == PHOTOMETRIC_MINISWHITE);
    }
  const std::string twos = "\x1B\x1B\x18", fours = "\x01\x23\x45\x67\x89\xA0";
  for (const auto& [bits, row, values] :
       {std::tuple{2, twos, std::array{0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2}},
        std::tuple{4, fours, std::array{0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10}}}) {
    const auto packed = expect_read(write_pages(folder, bits, SAMPLEFORMAT_UINT, row));
    EXPECT_EQ(packed.type, ScalarType::u8);
    for (std::uint32_t x = 0; x < 11; ++x) EXPECT_EQ(value_at(packed, x, 3, 2), values[x]) << x;
  }
  const std::string words = [] {  // 11 values of 12 bits: 257 times x
    std::string bits, bytes;
    for (int x = 0; x < 11; ++x)
      for (int k = 11; k >= 0; --k) bits += (257 * x >> k & 1) != 0 ? '1' : '0';
    bits.resize((bits.size() + 7) / 8 * 8, '0');
    for (std::size_t at = 0; at < bits.size(); at += 8)
      bytes += static_cast<char>(std::stoi(bits.substr(at, 8), nullptr, 2));
    return bytes;
  }();
  const auto packed = expect_read(write_pages(folder, 12, SAMPLEFORMAT_UINT, words));
  EXPECT_EQ(packed.type, ScalarType::u16);
  for (std::uint32_t x = 0; x < 11; ++x) EXPECT_EQ(value_at(packed, x, 3, 2), 257 * x) << x;
  std::string row;
  for (int x = 0; x < 11; ++x) row += std::string("\x00\x3E", 2);  // 1.5
  const auto halves = expect_read(write_pages(folder, 16, SAMPLEFORMAT_IEEEFP, row));
  EXPECT_EQ(halves.type, ScalarType::f32);
  EXPECT_EQ(value_at(halves, 10, 3, 2), 1.5);
}

TEST(VolumeTiff, OmeMayHoldSeveralImages) {
  const Folder folder;
  const auto image = [](const std::string& name, const std::string& more) {
    return "<Image ID=\"Image:" + name + "\" Name=\"" + name +
           "\"><Pixels DimensionOrder=\"XYZCT\" SizeC=\"1\" SizeT=\"1\" " + more +
           "</Pixels></Image>";
  };
  for (const auto& [first, second] :
       {std::pair{"SizeZ=\"2\">", "SizeZ=\"3\">"},
        std::pair{"SizeZ=\"2\"><TiffData IFD=\"0\" PlaneCount=\"2\"/>",
                  "SizeZ=\"3\"><TiffData IFD=\"2\" PlaneCount=\"3\"/>"}}) {
    const auto path = write_tiff(
        folder, "a.ome.tif",
        {.description = "<OME>" + image("scout", first) + image("scan", second) + "</OME>",
         .pages = {2, 2, 0, 1, 2}});
    expect_error(path, ErrorCode::unsupported,
                 "2 images (series) in one OME-TIFF, expected one: choose array 'scout', 'scan'");
    for (const auto* chosen : {"scan", "Image:scan", "1"})
      expect_phantom(expect_read(path, {.array = chosen}), ScalarType::u8);
    EXPECT_THAT(expect_read(path, {.array = "scout"}).dims, ElementsAre(5, 4, 2));
    expect_error(path, ErrorCode::usage, "no image 'third'", {.array = "third"});
  }
  expect_error(write_tiff(folder, "b.tif", {}), ErrorCode::usage, "the file names none",
               {.array = "scan"});
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
  expect_error(a, ErrorCode::not_found, "b.ome.tif");
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
                 ErrorCode::bad_file, "is that of two slices");
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

// Each file holds two channels: those are not slices.
TEST(VolumeFolder, TiffsOfSeveralChannels) {
  const Folder folder;
  for (const std::uint32_t k : {0, 1, 2})
    write_tiff(folder, "z" + std::to_string(k) + ".tif",
               {.description = "ImageJ=1.53c\nimages=2\nchannels=2\n", .pages = {2, k}});
  expect_error(folder.path(), ErrorCode::unsupported, "2 components");
  expect_phantom(expect_read(folder.path(), {.component = 1}), ScalarType::u8);
}

// A folder that holds a set that OME describes is read as the set, not in the order of names.
TEST(VolumeFolder, SetsOfOmeTiffs) {
  const Folder folder;
  std::string ome =
      "<OME><Image><Pixels DimensionOrder=\"XYZCT\" SizeZ=\"3\" SizeC=\"2\" "
      "SizeT=\"1\">";
  for (int c = 0; c < 2; ++c)
    ome += "<TiffData FirstC=\"" + std::to_string(c) + "\" IFD=\"0\" PlaneCount=\"3\"><UUID " +
           "FileName=\"c" + std::to_string(c) + ".tif\">urn:1</UUID></TiffData>";
  ome += "</Pixels></Image></OME>";
  write_tiff(folder, "c0.tif", {.description = ome, .pages = {2, 2, 2}});
  write_tiff(folder, "c1.tif", {.description = ome});
  expect_error(folder.path(), ErrorCode::unsupported, "2 components");
  expect_phantom(expect_read(folder.path(), {.component = 1}), ScalarType::u8);
  for (const char* stray : {"a.tif", "other.tif"}) {
    write_tiff(folder, stray, {});
    const auto volume = expect_read(folder.path(), {.component = 1});
    expect_phantom(volume, ScalarType::u8);
    EXPECT_THAT(volume.notes, ::testing::Contains(HasSubstr("left out 1 of 3 TIFFs")));
    std::filesystem::remove(folder.path(stray));
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

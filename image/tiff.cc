// TIFF pictures of 8 or 16 bits: grey or RGB, with or without alpha. Only the first page that is no
// thumbnail is read.
#include <cstring>

#include "base/try.h"
#include "image/formats.h"
#include "image/tiff_file.h"

namespace slf::image_formats {
namespace {

enum class Alpha { none, straight, premultiplied };

struct Layout {
  std::uint32_t width = 0, height = 0;
  std::uint32_t samples = 0;  ///< of a pixel
  bool colored = false;       ///< the first three are RGB, else the first is grey
  bool inverted = false;      ///< 0 is white
  bool wide = false;          ///< 16 bits, else 8
  Alpha alpha = Alpha::none;  ///< in the sample after the colours
};

Result<Layout> layout_of(const TiffFile& file) {
  const auto short_tag = [&](std::uint32_t id, std::uint16_t otherwise) {
    return file.tag<std::uint16_t>(id, otherwise);
  };
  Layout layout{.width = file.tag<std::uint32_t>(TIFFTAG_IMAGEWIDTH, 0),
                .height = file.tag<std::uint32_t>(TIFFTAG_IMAGELENGTH, 0),
                .samples = short_tag(TIFFTAG_SAMPLESPERPIXEL, 1)};
  SLF_TRY(check_size(file.path, layout.width, layout.height));
  SLF_TRY(check_compression(file));
  const auto bits = short_tag(TIFFTAG_BITSPERSAMPLE, 1);
  const auto format = short_tag(TIFFTAG_SAMPLEFORMAT, SAMPLEFORMAT_UINT);
  if ((bits != 8 && bits != 16) || (format != SAMPLEFORMAT_UINT && format != SAMPLEFORMAT_VOID))
    return unsupported(file.path, "TIFF with samples of ", bits, " bits, format ", format,
                       "; pictures are read with 8 or 16 bits without sign");
  layout.wide = bits == 16;
  std::uint16_t kind = 0;
  const bool stated = TIFFGetField(file.tiff.get(), TIFFTAG_PHOTOMETRIC, &kind) != 0;
  if (!stated) kind = layout.samples >= 3 ? PHOTOMETRIC_RGB : PHOTOMETRIC_MINISBLACK;
  // libtiff decodes these as RGB, but only in JPEG.
  const bool ycbcr = kind == PHOTOMETRIC_YCBCR &&
                     short_tag(TIFFTAG_COMPRESSION, COMPRESSION_NONE) == COMPRESSION_JPEG;
  layout.colored = kind == PHOTOMETRIC_RGB || ycbcr;
  layout.inverted = kind == PHOTOMETRIC_MINISWHITE;
  if (!layout.colored && !layout.inverted && kind != PHOTOMETRIC_MINISBLACK)
    return unsupported(file.path, "TIFF with colours of kind ", kind,
                       "; pictures are read as grey or RGB");
  const std::uint32_t colors = layout.colored ? 3 : 1;
  if (layout.samples < colors || layout.samples > 64)
    return bad_file(file.path, "TIFF with ", layout.samples, " samples for a pixel; expected ",
                    colors, ", and alpha");
  std::uint16_t extra = 0;
  std::uint16_t* meanings = nullptr;
  if (layout.samples > colors &&
      TIFFGetField(file.tiff.get(), TIFFTAG_EXTRASAMPLES, &extra, &meanings) && extra > 0)
    layout.alpha = meanings[0] == EXTRASAMPLE_ASSOCALPHA   ? Alpha::premultiplied
                   : meanings[0] == EXTRASAMPLE_UNASSALPHA ? Alpha::straight
                                                           : Alpha::none;
  return layout;
}

/// Goes to the first page that is no thumbnail.
Result<Layout> find_picture(TiffFile& file) {
  const bool found = SLF_TRY(file.skip_thumbnails());
  if (!found) return bad_file(file.path, "TIFF without a picture");
  return layout_of(file);
}

float sample_of(const std::byte* at, bool wide) {
  if (!wide) return static_cast<float>(std::to_integer<std::uint8_t>(*at)) / 255;
  std::uint16_t value = 0;
  std::memcpy(&value, at, 2);
  return static_cast<float>(value) / 65535;
}

}  // namespace

Result<ImageSize> tiff_size(const std::string& path) {
  const auto file = SLF_TRY(TiffFile::open(path));
  const auto layout = SLF_TRY(find_picture(*file));
  return ImageSize{layout.width, layout.height};
}

Result<Image> decode_tiff(const std::string& name, ByteSpan bytes) {
  const auto file = SLF_TRY(TiffFile::open(name, bytes));
  const auto layout = SLF_TRY(find_picture(*file));
  const std::uint32_t colors = layout.colored ? 3 : 1;
  const std::uint32_t used = colors + (layout.alpha != Alpha::none ? 1 : 0);
  const std::uint64_t sample = layout.wide ? 2 : 1;
  const bool apart = has_planes(*file);
  const std::uint64_t pixel = sample * (apart ? 1 : layout.samples);

  Image image{layout.width, layout.height, {}, {}};
  for (std::uint32_t plane = 0; plane < (apart ? used : 1); ++plane) {
    std::size_t at = 0;
    const auto take = [&](std::span<const std::byte> rows) -> Result<void> {
      const std::size_t count = rows.size() / pixel;
      if (image.rgba.size() < at + count) image.rgba.resize(at + count, glm::vec4(0, 0, 0, 1));
      for (std::size_t k = 0; k < count; ++k)
        for (std::uint32_t s = plane; s < (apart ? plane + 1 : used); ++s) {
          const std::byte* from = &rows[k * pixel + (apart ? 0 : s * sample)];
          image.rgba[at + k][s < colors ? static_cast<int>(s) : 3] = sample_of(from, layout.wide);
        }
      at += count;
      return {};
    };
    SLF_TRY(read_rows(*file, {layout.width, layout.height, pixel}, plane, take));
  }
  for (glm::vec4& p : image.rgba) {
    if (layout.inverted) p.x = 1 - p.x;
    if (!layout.colored) p.y = p.z = p.x;
    if (layout.alpha == Alpha::straight) p = glm::vec4(glm::vec3(p) * p.a, p.a);
  }
  return image;
}

}  // namespace slf::image_formats

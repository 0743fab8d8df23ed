// OpenEXR: float premultiplied RGBA and Z. Reads half, float or integer channels of single-part
// scan-line and tiled files. The picture is the display window, transparent where there is no data.

#include <ImathBox.h>
#include <ImfChannelList.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfInputFile.h>
#include <ImfOutputFile.h>
#include <ImfStdIO.h>
#include <ImfTileDescription.h>
#include <ImfTileDescriptionAttribute.h>
#include <ImfVersion.h>

#include <algorithm>
#include <exception>
#include <limits>
#include <optional>
#include <string>

#include "base/try.h"
#include "image/formats.h"

namespace slf::image_formats {
namespace {

using Imath::Box2i;

constexpr std::size_t kMagicAndVersion = 8;

/// Walks the header's attributes (name, type, 32-bit size, value; an empty name ends the list). The
/// library allocates the size that an attribute claims; this checks that the bytes exist.
bool attributes_fit(ByteSpan bytes) {
  std::size_t at = kMagicAndVersion;
  const auto skip_text = [&]() -> std::optional<std::size_t> {
    const std::size_t begin = at;
    while (at < bytes.size() && bytes[at] != std::byte{0}) ++at;
    if (at == bytes.size()) return std::nullopt;
    return at++ - begin;
  };
  for (;;) {
    const auto name = skip_text();
    if (!name) return false;
    if (*name == 0) return true;
    if (!skip_text() || bytes.size() - at < 4) return false;
    const std::size_t size = load_le<std::uint32_t>(&bytes[at]);
    at += 4;
    if (size > bytes.size() - at) return false;
    at += size;
  }
}

std::uint64_t side(int min, int max) {
  const std::int64_t length = std::int64_t{max} - min + 1;
  return length < 0 ? 0 : static_cast<std::uint64_t>(length);
}

Result<void> check_window(const std::string& name, const Box2i& window) {
  return check_size(name, side(window.min.x, window.max.x), side(window.min.y, window.max.y));
}

/// Refuses files for which the library would allocate too much: blocks with many rows or channels,
/// large tiles, and tables with more blocks than fit the file.
Result<void> check_blocks(const std::string& name, const Imf::Header& header,
                          std::size_t file_bytes) {
  constexpr std::uint64_t kMaxRowsInBlock = 256, kMaxBlockBytes = std::uint64_t{1} << 30;
  const Box2i& window = header.dataWindow();
  const std::uint64_t width = side(window.min.x, window.max.x);
  const std::uint64_t height = side(window.min.y, window.max.y);

  std::uint64_t block_pixels = width * kMaxRowsInBlock;
  std::uint64_t blocks = (height + kMaxRowsInBlock - 1) / kMaxRowsInBlock;
  if (header.hasTileDescription()) {
    const Imf::TileDescription& tile = header.tileDescription();
    SLF_TRY(check_size(name, tile.xSize, tile.ySize));
    block_pixels = std::uint64_t{tile.xSize} * tile.ySize;
    blocks = ((width + tile.xSize - 1) / tile.xSize) * ((height + tile.ySize - 1) / tile.ySize);
  }
  std::uint64_t channels = 0;
  for (auto c = header.channels().begin(); c != header.channels().end(); ++c) ++channels;
  if (block_pixels * std::max<std::uint64_t>(channels, 1) > kMaxBlockBytes / sizeof(float))
    return unsupported(name, "one block of its ", channels, " channels could take more than ",
                       kMaxBlockBytes, " bytes");
  if (blocks * sizeof(std::uint64_t) > file_bytes)
    return bad_file(name, "damaged OpenEXR: ", file_bytes, " bytes cannot hold the ", blocks,
                    " blocks it claims");
  return {};
}

/// Refuses files whose header alone shows that they cannot be read.
Result<void> check_header(const std::string& name, ByteSpan bytes) {
  if (bytes.size() < kMagicAndVersion || !attributes_fit(bytes))
    return bad_file(name, "OpenEXR ends inside its header");
  int version = static_cast<int>(load_le<std::uint32_t>(&bytes[4]));
  if (Imf::isMultiPart(version) || Imf::isNonImage(version))
    return unsupported(name, "OpenEXR of several parts or deep pixels");

  Imf::StdISStream stream;
  stream.str(std::string(chars_of(bytes)));
  stream.seekg(kMagicAndVersion);
  Imf::Header header;
  header.readFrom(stream, version);
  header.sanityCheck(Imf::isTiled(version));
  SLF_TRY(check_window(name, header.displayWindow()));
  SLF_TRY(check_window(name, header.dataWindow()));
  SLF_TRY(check_blocks(name, header, bytes.size()));

  const Imf::ChannelList& channels = header.channels();
  if (channels.findChannel("RY") != nullptr || channels.findChannel("BY") != nullptr)
    return unsupported(name, "OpenEXR with luminance-chroma channels");
  for (const char* wanted : {"R", "G", "B", "Y", "A", "Z"}) {
    const Imf::Channel* channel = channels.findChannel(wanted);
    if (channel != nullptr && (channel->xSampling != 1 || channel->ySampling != 1))
      return unsupported(name, "OpenEXR with subsampled channel ", wanted);
  }
  return {};
}

/// The pixels of the data window. Missing colours are 0, gray (Y) sets all three, missing alpha is
/// 1.
Image read_data_window(Imf::InputFile& file) {
  const Box2i window = file.header().dataWindow();
  const Imf::ChannelList& channels = file.header().channels();
  Image data;
  data.width = static_cast<std::uint32_t>(side(window.min.x, window.max.x));
  data.height = static_cast<std::uint32_t>(side(window.min.y, window.max.y));
  data.rgba.assign(std::size_t{data.width} * data.height, glm::vec4(0, 0, 0, 1));

  Imf::FrameBuffer buffer;
  const auto insert = [&](const char* channel, float* first, std::size_t stride) {
    if (channels.findChannel(channel) == nullptr) return false;
    buffer.insert(channel,
                  Imf::Slice::Make(Imf::FLOAT, first, window, stride, stride * data.width));
    return true;
  };
  float* first = &data.rgba[0].x;
  bool color = false;
  for (const auto& [channel, c] : {std::pair{"R", 0}, {"G", 1}, {"B", 2}})
    color |= insert(channel, first + c, sizeof(glm::vec4));
  const bool grey = !color && insert("Y", first, sizeof(glm::vec4));
  insert("A", first + 3, sizeof(glm::vec4));
  if (channels.findChannel("Z") != nullptr) {
    data.depth.assign(data.rgba.size(), std::numeric_limits<float>::infinity());
    insert("Z", data.depth.data(), sizeof(float));
  }
  file.setFrameBuffer(buffer);
  file.readPixels(window.min.y, window.max.y);
  if (grey)
    for (glm::vec4& pixel : data.rgba) pixel.y = pixel.z = pixel.x;
  return data;
}

/// The part of the data that is inside the display window.
Image crop(Image data, const Box2i& window, const Box2i& display) {
  if (window == display) return data;
  Image out;
  out.width = static_cast<std::uint32_t>(side(display.min.x, display.max.x));
  out.height = static_cast<std::uint32_t>(side(display.min.y, display.max.y));
  out.rgba.assign(std::size_t{out.width} * out.height, glm::vec4(0));
  if (!data.depth.empty())
    out.depth.assign(out.rgba.size(), std::numeric_limits<float>::infinity());

  for (int y = std::max(window.min.y, display.min.y); y <= std::min(window.max.y, display.max.y);
       ++y)
    for (int x = std::max(window.min.x, display.min.x); x <= std::min(window.max.x, display.max.x);
         ++x) {
      const auto offset = [&](const Box2i& box, std::uint32_t width) {
        return side(box.min.y, y - 1) * width + side(box.min.x, x - 1);
      };
      const std::size_t to = offset(display, out.width), from = offset(window, data.width);
      out.rgba[to] = data.rgba[from];
      if (!data.depth.empty()) out.depth[to] = data.depth[from];
    }
  return out;
}

}  // namespace

Result<Bytes> encode_exr(const std::string& name, const Image& image) try {
  Imf::Header header(static_cast<int>(image.width), static_cast<int>(image.height));
  header.compression() = Imf::ZIP_COMPRESSION;
  Imf::FrameBuffer buffer;
  const auto insert = [&](const char* channel, const float* first, std::size_t stride) {
    header.channels().insert(channel, Imf::Channel(Imf::FLOAT));
    // The library's base pointer is non-const for both reading and writing.
    auto* base = reinterpret_cast<char*>(const_cast<float*>(first));
    buffer.insert(channel, Imf::Slice(Imf::FLOAT, base, stride, stride * image.width));
  };
  for (const auto& [channel, c] : {std::pair{"R", 0}, {"G", 1}, {"B", 2}, {"A", 3}})
    insert(channel, &image.rgba[0].x + c, sizeof(glm::vec4));
  if (!image.depth.empty()) insert("Z", image.depth.data(), sizeof(float));

  Imf::StdOSStream stream;
  {
    Imf::OutputFile file(stream, header, /*numThreads=*/0);
    file.setFrameBuffer(buffer);
    file.writePixels(static_cast<int>(image.height));
  }  // The destructor completes the table of blocks.
  const std::string coded = stream.str();
  const ByteSpan bytes = bytes_of(coded);
  return Bytes(bytes.begin(), bytes.end());
} catch (const std::exception& error) {
  return fail(ErrorCode::failed, name, ": cannot encode as OpenEXR: ", error.what());
}

Result<Image> decode_exr(const std::string& name, ByteSpan bytes) try {
  SLF_TRY(check_header(name, bytes));
  Imf::StdISStream stream;
  stream.str(std::string(chars_of(bytes)));
  Imf::InputFile file(stream, /*numThreads=*/0);
  return crop(read_data_window(file), file.header().dataWindow(), file.header().displayWindow());
} catch (const std::exception& error) {
  std::string what = error.what();
  constexpr std::string_view kStream = " from image file \"(string)\"";  // nothing to a reader
  if (const auto at = what.find(kStream); at != std::string::npos) what.erase(at, kStream.size());
  return bad_file(name, "damaged OpenEXR: ", what);
}

}  // namespace slf::image_formats

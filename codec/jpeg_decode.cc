#include "codec/jpeg_decode.h"

#include <cassert>
#include <cstring>

#include "base/per_thread.h"
#include "codec/jpeg_errors.h"

namespace slf::codec {
namespace {

void append(Bytes& to, std::initializer_list<int> values) {
  for (const int value : values) to.push_back(static_cast<std::byte>(value));
}

// A JPEG stream: the tables, a frame header (SOF0), a scan header (SOS) and the scan.
Bytes stream_of(const JpegTables& tables, const JpegShape& shape, ByteSpan scan) {
  Bytes bytes = to_bytes(tables);
  bytes.resize(bytes.size() - 2);  // EOI
  const int components = shape.color == JpegColor::gray ? 1 : 3;
  const int luma_sampling = shape.color == JpegColor::ycbcr_420 ? 0x22 : 0x11;
  const int width = static_cast<int>(shape.width), height = static_cast<int>(shape.height);
  append(bytes, {0xFF, 0xC0, 0, 8 + 3 * components, 8, height >> 8, height & 255, width >> 8,
                 width & 255, components});
  for (int i = 0; i < components; ++i)
    append(bytes, {i + 1, i == 0 ? luma_sampling : 0x11, i == 0 ? 0 : 1});
  append(bytes, {0xFF, 0xDA, 0, 6 + 2 * components, components});
  for (int i = 0; i < components; ++i) append(bytes, {i + 1, i == 0 ? 0 : 0x11});
  append(bytes, {0, 63, 0});
  bytes.insert(bytes.end(), scan.begin(), scan.end());
  append(bytes, {0xFF, 0xD9});  // EOI
  return bytes;
}

// A decompressor; each thread keeps one from tile to tile.
class Decompressor {
 public:
  Decompressor() = default;
  ~Decompressor() { jpeg_destroy_decompress(&info_); }
  Decompressor(const Decompressor&) = delete;
  Decompressor& operator=(const Decompressor&) = delete;

  // Returns null, or a message if it fails.
  const char* decode(ByteSpan stream, const JpegShape& shape, std::uint8_t* pixels) {
    if (setjmp(errors_.jump)) {
      if (created_)
        jpeg_abort_decompress(&info_);
      else
        jpeg_destroy_decompress(&info_);
      return errors_.message;
    }
    if (!created_) {
      info_.err = init(errors_);
      jpeg_create_decompress(&info_);
      created_ = true;
    }
    jpeg_mem_src(&info_, reinterpret_cast<const unsigned char*>(stream.data()), stream.size());
    jpeg_read_header(&info_, TRUE);
    if (shape.color != JpegColor::gray) {
      info_.jpeg_color_space = JCS_YCbCr;
      info_.out_color_space = JCS_EXT_RGBA;
    }
    jpeg_start_decompress(&info_);
    const std::size_t stride = shape.width * pixel_bytes(shape.color);
    while (info_.output_scanline < info_.output_height) {
      JSAMPROW line = pixels + info_.output_scanline * stride;
      jpeg_read_scanlines(&info_, &line, 1);
    }
    jpeg_finish_decompress(&info_);
    return nullptr;
  }

  // Why it failed.
  [[nodiscard]] ErrorCode code() const {
    return errors_.base.msg_code == JERR_OUT_OF_MEMORY ? ErrorCode::out_of_memory
                                                       : ErrorCode::bad_file;
  }

 private:
  jpeg_decompress_struct info_{};
  ErrorManager errors_{};
  bool created_ = false;
};

// In entropy-coded bytes every FF is followed by a stuffed 00; anything else is a marker.
bool has_marker(ByteSpan scan) {
  const std::byte* at = scan.data();
  const std::byte* const end = at + scan.size();
  while (at != end) {
    at = static_cast<const std::byte*>(std::memchr(at, 0xFF, static_cast<std::size_t>(end - at)));
    if (!at) return false;
    if (at + 1 == end || at[1] != std::byte{0}) return true;
    at += 2;
  }
  return false;
}

}  // namespace

Result<void> decode_scan(const JpegTables& tables, const JpegShape& shape, ByteSpan scan,
                         std::span<std::uint8_t> pixels) {
  assert(pixels.size() == std::size_t{shape.width} * shape.height * pixel_bytes(shape.color));
  if (has_marker(scan)) return bad_file("JPEG", "a marker inside the scan");
  auto& decompressor = per_thread<Decompressor>([] {});
  const Bytes stream = stream_of(tables, shape, scan);
  if (const char* wrong = decompressor.decode(stream, shape, pixels.data()))
    return fail(decompressor.code(), "JPEG: ", wrong);
  return {};
}

}  // namespace slf::codec

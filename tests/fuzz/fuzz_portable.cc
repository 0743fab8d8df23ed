// The decoders that WebAssembly uses, on any bytes: no harm, and where libzstd decodes a frame as
// well, the same bytes.
//
// Input: byte 0 chooses the decoder, bytes 1 and 2 the size, byte 3 the quality; the rest is a
// frame, a scan, or tables followed by a scan.
#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <vector>

#include "codec/jpeg_decode.h"
#include "codec/jpeg_encode.h"
#include "codec/zstd_frame.h"

// The portable definitions, under names of their own.
#define read_stream portable_read_stream
#define append_stream portable_append_stream
#include "codec/portable/zstd_frame.cc"
#undef read_stream
#undef append_stream
#define decode_scan portable_decode_scan
#define standard_tables portable_standard_tables
#include "codec/portable/jpeg_decode.cc"
#undef decode_scan
#undef standard_tables

namespace {

using namespace slf;
using namespace slf::codec;

// Exactly as large as it must be, so that the sanitizer reports every overrun.
std::unique_ptr<std::byte[]> exact(ByteSpan bytes) {
  auto copy = std::make_unique<std::byte[]>(bytes.size());
  std::copy(bytes.begin(), bytes.end(), copy.get());
  return copy;
}

void decode_frame(std::size_t size, ByteSpan input) {
  const auto frame = exact(input);
  const auto found = std::make_unique<std::byte[]>(size);
  const auto expected = std::make_unique<std::byte[]>(size);
  ByteSpan rest{frame.get(), input.size()}, library_rest = rest;
  const auto by_us = portable_read_stream(rest, {found.get(), size});
  const auto by_library = read_stream(library_rest, {expected.get(), size});
  if (!by_us || !by_library) return;
  if (!std::equal(found.get(), found.get() + size, expected.get())) std::abort();
  if (rest.size() != library_rest.size()) std::abort();
}

void decode_picture(const JpegTables& tables, const JpegShape& shape, ByteSpan input) {
  const auto scan = exact(input);
  const std::size_t size = std::size_t{shape.width} * shape.height * pixel_bytes(shape.color);
  const auto pixels = std::make_unique<std::uint8_t[]>(size);
  (void)portable_decode_scan(tables, shape, {scan.get(), input.size()}, {pixels.get(), size});
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size < 4) return 0;
  ByteSpan rest = std::as_bytes(std::span(data + 4, size - 4));
  if (data[0] % 2 == 0) {
    decode_frame(data[1] | data[2] << 8, rest);
    return 0;
  }
  JpegShape shape{0, 0, static_cast<JpegColor>(data[0] / 2 % 3)};
  shape.width = alignment(shape.color) * (1 + data[1] % 8u);
  shape.height = alignment(shape.color) * (1 + data[2] % 8u);
  const int quality = data[3] % 128;
  if (quality >= 1 && quality <= 100) {
    decode_picture(standard_tables(quality), shape, rest);
    return 0;
  }
  if (const auto tables = take_tables(rest)) decode_picture(*tables, shape, rest);
  return 0;
}

// The tables that a JPEG encoder begins with.

#include "codec/jpeg_tables.h"

#include <algorithm>
#include <new>

#include "codec/jpeg_errors.h"

namespace slf::codec {
namespace {

HuffmanTable from_libjpeg(const JHUFF_TBL& table) {
  HuffmanTable result;
  std::copy(table.bits + 1, table.bits + 17, result.counts.begin());
  std::size_t total = 0;
  for (const std::uint8_t count : result.counts) total += count;
  result.symbols.assign(table.huffval, table.huffval + total);
  return result;
}

// `base` is the step at quality 50. Other qualities scale it as libjpeg scales its tables.
std::uint8_t quantisation_step(int quality, int base) {
  const int percent = quality < 50 ? 5000 / quality : 200 - 2 * quality;
  return static_cast<std::uint8_t>(std::clamp((base * percent + 50) / 100, 1, 255));
}

}  // namespace

JpegTables standard_tables(int quality) {
  JpegTables tables;
  tables.quantisation[0].fill(quantisation_step(quality, 28));
  tables.quantisation[1].fill(quantisation_step(quality, 18));
  struct Compressor : jpeg_compress_struct {
    ErrorManager errors{};
    ~Compressor() { jpeg_destroy_compress(this); }
  } compress{};
  compress.err = init(compress.errors);
  if (setjmp(compress.errors.jump)) throw std::bad_alloc();  // nothing else can fail
  jpeg_create_compress(&compress);
  compress.in_color_space = JCS_RGB;
  compress.input_components = 3;
  jpeg_set_defaults(&compress);
  for (std::size_t i = 0; i < 2; ++i) {
    tables.dc[i] = from_libjpeg(*compress.dc_huff_tbl_ptrs[i]);
    tables.ac[i] = from_libjpeg(*compress.ac_huff_tbl_ptrs[i]);
  }
  return tables;
}

}  // namespace slf::codec

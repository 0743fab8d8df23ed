#include "codec/jpeg_tables.h"

// jpeglib.h needs FILE and size_t declared before it.
#include <jpeglib.h>
#include <cstddef>
#include <cstdio>

#include <algorithm>
#include <bitset>

namespace slf::codec {
namespace {

constexpr std::uint8_t marker_soi = 0xD8, marker_eoi = 0xD9, marker_dqt = 0xDB, marker_dht = 0xC4;
constexpr std::uint8_t zigzag[64] = {
    0,  1,  8,  16, 9,  2,  3,  10, 17, 24, 32, 25, 18, 11, 4,  5,  12, 19, 26, 33, 40, 48,
    41, 34, 27, 20, 13, 6,  7,  14, 21, 28, 35, 42, 49, 56, 57, 50, 43, 36, 29, 22, 15, 23,
    30, 37, 44, 51, 58, 59, 52, 45, 38, 31, 39, 46, 53, 60, 61, 54, 47, 55, 62, 63};

HuffmanTable from_libjpeg(const JHUFF_TBL& table) {
  HuffmanTable result;
  std::copy(table.bits + 1, table.bits + 17, result.counts.begin());
  std::size_t total = 0;
  for (const std::uint8_t count : result.counts) total += count;
  result.symbols.assign(table.huffval, table.huffval + total);
  return result;
}

void append(Bytes& to, std::uint8_t value) { to.push_back(static_cast<std::byte>(value)); }

void append_segment(Bytes& to, std::uint8_t marker, std::size_t length) {
  append(to, 0xFF);
  append(to, marker);
  append(to, static_cast<std::uint8_t>((length + 2) >> 8));
  append(to, static_cast<std::uint8_t>(length + 2));
}

void append_huffman(Bytes& to, std::uint8_t id, const HuffmanTable& table) {
  append_segment(to, marker_dht, 17 + table.symbols.size());
  append(to, id);
  for (const std::uint8_t count : table.counts) append(to, count);
  for (const std::uint8_t symbol : table.symbols) append(to, symbol);
}

// Reads bytes one after the other; past the end it reads zeros and says so.
class Reader {
 public:
  explicit Reader(ByteSpan bytes) : bytes_(bytes) {}
  std::uint8_t next() {
    if (at_ < bytes_.size()) return static_cast<std::uint8_t>(bytes_[at_++]);
    overrun_ = true;
    return 0;
  }
  bool expect(std::uint8_t value) { return next() == value && !overrun_; }
  bool segment(std::uint8_t marker, std::size_t& length) {
    const bool found = expect(0xFF) && expect(marker);
    const std::size_t high = next();
    const std::size_t stored = high << 8 | next();
    length = stored - 2;
    return found && stored >= 2 && !overrun_;
  }
  bool at_end() const { return at_ == bytes_.size() && !overrun_; }

 private:
  ByteSpan bytes_;
  std::size_t at_ = 0;
  bool overrun_ = false;
};

// A prefix code exists, leaves the all-ones code free, and no symbol has two codes.
bool is_code(const HuffmanTable& table) {
  std::size_t free = 1;  // codes of this length that no shorter code is a prefix of
  for (const std::uint8_t count : table.counts) {
    free = free * 2;
    if (count >= free) return false;
    free -= count;
  }
  std::bitset<256> seen;
  for (const std::uint8_t symbol : table.symbols) {
    if (seen[symbol]) return false;
    seen[symbol] = true;
  }
  return true;
}

bool read_huffman(Reader& reader, std::uint8_t id, HuffmanTable& table) {
  std::size_t length = 0;
  if (!reader.segment(marker_dht, length) || !reader.expect(id)) return false;
  std::size_t total = 0;
  for (std::uint8_t& count : table.counts) total += count = reader.next();
  if (total > 256 || length != 17 + total) return false;
  table.symbols.resize(total);
  for (std::uint8_t& symbol : table.symbols) symbol = reader.next();
  return is_code(table);
}

}  // namespace

JpegTables standard_tables(int quality) {
  jpeg_compress_struct compress;
  jpeg_error_mgr errors;
  compress.err = jpeg_std_error(&errors);
  jpeg_create_compress(&compress);
  compress.in_color_space = JCS_RGB;
  compress.input_components = 3;
  jpeg_set_defaults(&compress);
  jpeg_set_quality(&compress, quality, TRUE);
  JpegTables tables;
  for (std::size_t i = 0; i < 2; ++i) {
    for (std::size_t k = 0; k < 64; ++k)
      tables.quantisation[i][k] =
          static_cast<std::uint8_t>(compress.quant_tbl_ptrs[i]->quantval[zigzag[k]]);
    tables.dc[i] = from_libjpeg(*compress.dc_huff_tbl_ptrs[i]);
    tables.ac[i] = from_libjpeg(*compress.ac_huff_tbl_ptrs[i]);
  }
  jpeg_destroy_compress(&compress);
  return tables;
}

Bytes to_bytes(const JpegTables& tables) {
  Bytes bytes;
  append(bytes, 0xFF);
  append(bytes, marker_soi);
  for (std::uint8_t i = 0; i < 2; ++i) {
    append_segment(bytes, marker_dqt, 65);
    append(bytes, i);
    for (const std::uint8_t step : tables.quantisation[i]) append(bytes, step);
  }
  for (std::uint8_t i = 0; i < 2; ++i) {
    append_huffman(bytes, i, tables.dc[i]);
    append_huffman(bytes, static_cast<std::uint8_t>(0x10 | i), tables.ac[i]);
  }
  append(bytes, 0xFF);
  append(bytes, marker_eoi);
  return bytes;
}

Result<JpegTables> parse_tables(ByteSpan bytes) {
  JpegTables tables;
  Reader reader(bytes);
  bool good = reader.expect(0xFF) && reader.expect(marker_soi);
  for (std::uint8_t i = 0; i < 2 && good; ++i) {
    std::size_t length = 0;
    good = reader.segment(marker_dqt, length) && length == 65 && reader.expect(i);
    for (std::uint8_t& step : tables.quantisation[i]) good = (step = reader.next()) != 0 && good;
  }
  for (std::uint8_t i = 0; i < 2 && good; ++i)
    good = read_huffman(reader, i, tables.dc[i]) &&
           read_huffman(reader, static_cast<std::uint8_t>(0x10 | i), tables.ac[i]);
  good = good && reader.expect(0xFF) && reader.expect(marker_eoi) && reader.at_end();
  if (!good) return fail(ErrorCode::bad_file, "shared JPEG tables are damaged");
  return tables;
}

}  // namespace slf::codec

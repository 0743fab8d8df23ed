#include "codec/jpeg_tables.h"

#include <algorithm>
#include <bitset>

namespace slf::codec {
namespace {

constexpr std::uint8_t kMarkerSoi = 0xD8, kMarkerEoi = 0xD9, kMarkerDqt = 0xDB, kMarkerDht = 0xC4;

void append(Bytes& to, std::uint8_t value) { to.push_back(static_cast<std::byte>(value)); }

void append_segment(Bytes& to, std::uint8_t marker, std::size_t length) {
  append(to, 0xFF);
  append(to, marker);
  append(to, static_cast<std::uint8_t>((length + 2) >> 8));
  append(to, static_cast<std::uint8_t>(length + 2));
}

void append_huffman(Bytes& to, std::uint8_t id, const HuffmanTable& table) {
  append_segment(to, kMarkerDht, 17 + table.symbols.size());
  append(to, id);
  for (const std::uint8_t count : table.counts) append(to, count);
  for (const std::uint8_t symbol : table.symbols) append(to, symbol);
}

// Reads bytes one after the other. Beyond the end it returns zeros and sets overrun_.
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
  [[nodiscard]] ByteSpan rest() const { return bytes_.subspan(at_); }

 private:
  ByteSpan bytes_;
  std::size_t at_ = 0;
  bool overrun_ = false;
};

// Whether this is a prefix code that leaves the all-ones code free and has each symbol once.
bool is_code(const HuffmanTable& table) {
  std::size_t free = 1;  // codes of this length without a shorter code as prefix
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
  if (!reader.segment(kMarkerDht, length) || !reader.expect(id)) return false;
  std::size_t total = 0;
  for (std::uint8_t& count : table.counts) total += count = reader.next();
  if (total > 256 || length != 17 + total) return false;
  table.symbols.resize(total);
  for (std::uint8_t& symbol : table.symbols) symbol = reader.next();
  return is_code(table);
}

bool covers(const HuffmanTable& table, bool (*can_occur)(int)) {
  for (int symbol = 0; symbol < 256; ++symbol)
    if (can_occur(symbol) &&
        std::find(table.symbols.begin(), table.symbols.end(), symbol) == table.symbols.end())
      return false;
  return true;
}

// The code lengths of a Huffman code for `weights`; 0 for symbols of weight 0.
std::array<int, 257> huffman_lengths(std::array<std::uint64_t, 257> weights) {
  std::array<int, 257> lengths{};
  std::array<int, 257> next;  // the symbols of each subtree, as a list
  next.fill(-1);
  while (true) {
    int rarest = -1, second = -1;  // on a tie the later symbol, as T.81 requires
    for (int i = 0; i < 257; ++i) {
      if (weights[i] == 0) continue;
      if (rarest < 0 || weights[i] <= weights[rarest]) {
        second = rarest;
        rarest = i;
      } else if (second < 0 || weights[i] <= weights[second]) {
        second = i;
      }
    }
    if (second < 0) return lengths;
    weights[rarest] += weights[second];
    weights[second] = 0;
    int last = rarest;
    for (int i = rarest; i >= 0; i = next[i]) {
      ++lengths[i];
      last = i;
    }
    next[last] = second;
    for (int i = second; i >= 0; i = next[i]) ++lengths[i];
  }
}

}  // namespace

bool is_dc_symbol(int symbol) { return symbol <= 11; }

bool is_ac_symbol(int symbol) {
  const int size = symbol & 15;
  return symbol == 0x00 || symbol == 0xF0 || (size >= 1 && size <= 10);
}

HuffmanTable optimal_huffman(const SymbolCounts& counts, bool (*can_occur)(int)) {
  // A counted symbol outweighs all uncounted ones together. Symbol 256 reserves the all-ones code:
  // it is the least likely, so it gets the last of the longest codes.
  std::array<std::uint64_t, 257> weights{};
  for (int i = 0; i < 256; ++i)
    weights[i] = counts[i] > 0 ? counts[i] * 1024 + 1 : can_occur(i) ? 2 : 0;
  weights[256] = 1;
  std::array<int, 257> lengths = huffman_lengths(weights);

  std::array<int, 258> of_length{};
  for (const int length : lengths) ++of_length[length];
  // Shorten the longest codes two at a time (T.81 figure K.3).
  for (int i = 257; i > 16; --i)
    while (of_length[i] > 0) {
      int j = i - 2;
      while (of_length[j] == 0) --j;
      of_length[i] -= 2;
      ++of_length[i - 1];
      of_length[j + 1] += 2;
      --of_length[j];
    }
  int longest = 16;
  while (of_length[longest] == 0) --longest;
  --of_length[longest];  // the reserved code

  HuffmanTable table;
  for (int i = 1; i <= 16; ++i) table.counts[i - 1] = static_cast<std::uint8_t>(of_length[i]);
  for (int length = 1; length <= 257; ++length)
    for (int i = 0; i < 256; ++i)
      if (lengths[i] == length) table.symbols.push_back(static_cast<std::uint8_t>(i));
  return table;
}

bool is_complete(const JpegTables& tables) {
  const auto all_cover = [](const auto& of, bool (*can_occur)(int)) {
    return std::all_of(of.begin(), of.end(), [&](auto& t) { return covers(t, can_occur); });
  };
  return all_cover(tables.dc, is_dc_symbol) && all_cover(tables.ac, is_ac_symbol);
}

Bytes to_bytes(const JpegTables& tables) {
  Bytes bytes;
  append(bytes, 0xFF);
  append(bytes, kMarkerSoi);
  for (std::uint8_t i = 0; i < 2; ++i) {
    append_segment(bytes, kMarkerDqt, 65);
    append(bytes, i);
    for (const std::uint8_t step : tables.quantisation[i]) append(bytes, step);
  }
  for (std::uint8_t i = 0; i < 2; ++i) {
    append_huffman(bytes, i, tables.dc[i]);
    append_huffman(bytes, static_cast<std::uint8_t>(0x10 | i), tables.ac[i]);
  }
  append(bytes, 0xFF);
  append(bytes, kMarkerEoi);
  return bytes;
}

Result<JpegTables> take_tables(ByteSpan& bytes) {
  JpegTables tables;
  Reader reader(bytes);
  bool good = reader.expect(0xFF) && reader.expect(kMarkerSoi);
  for (std::uint8_t i = 0; i < 2 && good; ++i) {
    std::size_t length = 0;
    good = reader.segment(kMarkerDqt, length) && length == 65 && reader.expect(i);
    for (std::uint8_t& step : tables.quantisation[i]) good = (step = reader.next()) != 0 && good;
  }
  for (std::uint8_t i = 0; i < 2 && good; ++i)
    good = read_huffman(reader, i, tables.dc[i]) &&
           read_huffman(reader, static_cast<std::uint8_t>(0x10 | i), tables.ac[i]);
  good = good && reader.expect(0xFF) && reader.expect(kMarkerEoi);
  if (!good) return fail(ErrorCode::bad_file, "shared JPEG tables are damaged");
  bytes = reader.rest();
  return tables;
}

}  // namespace slf::codec

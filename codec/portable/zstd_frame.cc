// Decompresses zstd frames (RFC 8878) where libzstd is not available: in WebAssembly. It replaces
// read_stream() of codec/zstd_frame.cc; nothing encodes there.

#include "codec/zstd_frame.h"

#include <xxhash.h>

#include <algorithm>
#include <array>
#include <memory>
#include <vector>

#include "codec/portable/zstd_entropy.h"

namespace slf::codec {
namespace {

constexpr std::size_t kMaxBlock = 128 << 10;

// ---- sequences: the codes of lengths and offsets (3.1.1.3.2.1) ----------------------------------

struct Extra {
  std::uint32_t base;
  std::uint8_t bits;
};

constexpr std::array<Extra, 36> kLiteralLengths = {
    {{0, 0},     {1, 0},      {2, 0},      {3, 0},     {4, 0},   {5, 0},     {6, 0},     {7, 0},
     {8, 0},     {9, 0},      {10, 0},     {11, 0},    {12, 0},  {13, 0},    {14, 0},    {15, 0},
     {16, 1},    {18, 1},     {20, 1},     {22, 1},    {24, 2},  {28, 2},    {32, 3},    {40, 3},
     {48, 4},    {64, 6},     {128, 7},    {256, 8},   {512, 9}, {1024, 10}, {2048, 11}, {4096, 12},
     {8192, 13}, {16384, 14}, {32768, 15}, {65536, 16}}};
constexpr std::array<Extra, 53> kMatchLengths = {
    {{3, 0},     {4, 0},     {5, 0},      {6, 0},      {7, 0},     {8, 0},   {9, 0},     {10, 0},
     {11, 0},    {12, 0},    {13, 0},     {14, 0},     {15, 0},    {16, 0},  {17, 0},    {18, 0},
     {19, 0},    {20, 0},    {21, 0},     {22, 0},     {23, 0},    {24, 0},  {25, 0},    {26, 0},
     {27, 0},    {28, 0},    {29, 0},     {30, 0},     {31, 0},    {32, 0},  {33, 0},    {34, 0},
     {35, 1},    {37, 1},    {39, 1},     {41, 1},     {43, 2},    {47, 2},  {51, 3},    {59, 3},
     {67, 4},    {83, 4},    {99, 5},     {131, 7},    {259, 8},   {515, 9}, {1027, 10}, {2051, 11},
     {4099, 12}, {8195, 13}, {16387, 14}, {32771, 15}, {65539, 16}}};
constexpr int kMaxOffsetCode = 31;

constexpr std::array<int, 36> kUsualLiteralLengths = {4, 3, 2, 2, 2, 2, 2, 2, 2,  2,  2,  2,
                                                      2, 1, 1, 1, 2, 2, 2, 2, 2,  2,  2,  2,
                                                      2, 3, 2, 1, 1, 1, 1, 1, -1, -1, -1, -1};
constexpr std::array<int, 53> kUsualMatchLengths = {
    1, 4, 3, 2, 2, 2, 2, 2, 2, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1,  1,  1,  1,  1,  1,  1, 1,
    1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, -1, -1, -1, -1, -1, -1, -1};
constexpr std::array<int, 29> kUsualOffsets = {1, 1, 1, 1, 1, 1, 2, 2, 2, 1,  1,  1,  1,  1, 1,
                                               1, 1, 1, 1, 1, 1, 1, 1, 1, -1, -1, -1, -1, -1};

/// Decodes the blocks of one frame into its content.
class FrameDecoder {
 public:
  explicit FrameDecoder(std::span<std::byte> to) : to_(to) {}

  /// Returns null, or an error message.
  const char* decode(ByteSpan& bytes);

 private:
  const char* block(ByteSpan bytes);
  bool literals(ByteSpan& bytes);
  bool huffman(ByteSpan bytes, std::span<std::byte> to) const;
  bool sequences(ByteSpan bytes);
  bool table(int mode, ByteSpan& bytes, std::span<const int> usual, int usual_log, int max_log,
             std::size_t symbols, zstd::FseTable& table) const;
  bool put(ByteSpan bytes) {
    if (bytes.size() > to_.size() - at_) return false;
    std::copy(bytes.begin(), bytes.end(), to_.begin() + static_cast<std::ptrdiff_t>(at_));
    at_ += bytes.size();
    return true;
  }

  std::span<std::byte> to_;
  std::size_t at_ = 0;
  ByteSpan literals_;
  std::vector<std::byte> literal_bytes_;
  zstd::HuffmanTable huffman_;
  zstd::FseTable literal_lengths_, offsets_, match_lengths_;
  std::array<std::size_t, 3> recent_ = {1, 4, 8};
};

const char* FrameDecoder::decode(ByteSpan& bytes) {
  constexpr const char* kCut = "the frame is cut short";
  if (bytes.size() < 6 || load_le<std::uint32_t>(bytes.data()) != 0xFD2FB528) return "no frame";
  const auto flags = std::to_integer<unsigned>(bytes[4]);
  const bool single = flags >> 5 & 1, has_checksum = flags >> 2 & 1;
  constexpr std::array<std::size_t, 4> kIdBytes = {0, 1, 2, 4}, kSizeBytes = {0, 2, 4, 8};
  const std::size_t id = kIdBytes[flags & 3];
  const std::size_t size = flags >> 6 == 0 && single ? 1 : kSizeBytes[flags >> 6];
  if ((flags & 8) != 0) return "a reserved flag is set";
  std::size_t at = single ? 5 : 6;
  if (bytes.size() < at + id + size) return kCut;
  for (std::size_t i = 0; i < id; ++i)
    if (bytes[at++] != std::byte{0}) return "it needs a dictionary";
  std::uint64_t content = 0;
  for (std::size_t i = 0; i < size; ++i)
    content |= std::uint64_t{std::to_integer<std::uint8_t>(bytes[at++])} << (8 * i);
  if (size == 2) content += 256;
  if (size > 0 && content != to_.size()) return "the content has another size";
  bytes = bytes.subspan(at);
  for (bool last = false; !last;) {
    if (bytes.size() < 3) return kCut;
    const unsigned head = load_le<std::uint16_t>(bytes.data()) | std::to_integer<unsigned>(bytes[2])
                                                                     << 16;
    bytes = bytes.subspan(3);
    last = head & 1;
    const unsigned type = head >> 1 & 3;
    const std::size_t length = head >> 3;
    if (length > kMaxBlock || type == 3) return "a block's header is damaged";
    const std::size_t stored = type == 1 ? 1 : length;
    if (bytes.size() < stored) return kCut;
    if (type == 2) {
      if (const char* wrong = block(bytes.first(stored))) return wrong;
    } else if (type == 1) {
      if (length > to_.size() - at_) return "the content is too long";
      std::fill_n(to_.begin() + static_cast<std::ptrdiff_t>(at_), length, bytes[0]);
      at_ += length;
    } else if (!put(bytes.first(stored))) {
      return "the content is too long";
    }
    bytes = bytes.subspan(stored);
  }
  if (at_ != to_.size()) return "the content is too short";
  if (!has_checksum) return nullptr;
  if (bytes.size() < 4) return kCut;
  const auto expected = load_le<std::uint32_t>(bytes.data());
  bytes = bytes.subspan(4);
  if (static_cast<std::uint32_t>(XXH64(to_.data(), to_.size(), 0)) != expected)
    return "the content does not match its checksum";
  return nullptr;
}

const char* FrameDecoder::block(ByteSpan bytes) {
  const std::size_t begin = at_;
  if (!literals(bytes)) return "literals are damaged";
  if (!sequences(bytes)) return "sequences are damaged";
  if (at_ - begin > kMaxBlock) return "a block is too long";
  return nullptr;
}

bool FrameDecoder::literals(ByteSpan& bytes) {
  if (bytes.empty()) return false;
  const auto first = std::to_integer<unsigned>(bytes[0]);
  const unsigned type = first & 3, format = first >> 2 & 3;
  std::uint64_t head = 0;
  for (std::size_t i = 0; i < std::min<std::size_t>(5, bytes.size()); ++i)
    head |= std::uint64_t{std::to_integer<std::uint8_t>(bytes[i])} << (8 * i);
  if (type < 2) {  // raw, or one byte repeated
    const std::size_t head_bytes = format == 1 ? 2 : format == 3 ? 3 : 1;
    const std::size_t size = head >> (head_bytes == 1 ? 3 : 4) &
                             ((1u << (head_bytes * 8 - (head_bytes == 1 ? 3 : 4))) - 1);
    const std::size_t stored = type == 0 ? size : 1;
    if (size > kMaxBlock || bytes.size() < head_bytes + stored) return false;
    literals_ = bytes.subspan(head_bytes, stored);
    bytes = bytes.subspan(head_bytes + stored);
    if (type == 1) {
      literal_bytes_.assign(size, literals_[0]);
      literals_ = literal_bytes_;
    }
    return true;
  }
  constexpr std::array<int, 4> kBits = {10, 10, 14, 18};
  constexpr std::array<std::size_t, 4> kBytes = {3, 3, 4, 5};
  const std::uint64_t mask = (std::uint64_t{1} << kBits[format]) - 1;
  const std::size_t size = head >> 4 & mask, stored = head >> (4 + kBits[format]) & mask;
  if (size > kMaxBlock || bytes.size() < kBytes[format] + stored) return false;
  ByteSpan coded = bytes.subspan(kBytes[format], stored);
  bytes = bytes.subspan(kBytes[format] + stored);
  if (type == 2 && !huffman_.read(coded)) return false;
  if (huffman_.log == 0) return false;
  literal_bytes_.resize(size);
  literals_ = literal_bytes_;
  if (format == 0) return huffman(coded, literal_bytes_);
  if (coded.size() < 6 || size < 6) return false;
  const std::size_t quarter = (size + 3) / 4;
  ByteSpan rest = coded.subspan(6);
  std::span<std::byte> to = literal_bytes_;
  for (std::size_t i = 0; i < 4; ++i) {
    const std::size_t part = i < 3 ? load_le<std::uint16_t>(coded.data() + 2 * i) : rest.size();
    const std::size_t count = i < 3 ? quarter : to.size();
    if (part > rest.size() || count > to.size() || !huffman(rest.first(part), to.first(count)))
      return false;
    rest = rest.subspan(part);
    to = to.subspan(count);
  }
  return true;
}

bool FrameDecoder::huffman(ByteSpan bytes, std::span<std::byte> to) const {
  zstd::BackwardBits bits;
  if (!bits.open(bytes)) return false;
  for (std::byte& value : to) {
    const zstd::HuffmanTable::Entry entry = huffman_.entries[bits.peek(huffman_.log)];
    bits.skip(entry.bits);
    value = static_cast<std::byte>(entry.symbol);
  }
  return bits.left() == 0;
}

bool FrameDecoder::table(int mode, ByteSpan& bytes, std::span<const int> usual, int usual_log,
                         int max_log, std::size_t symbols, zstd::FseTable& table) const {
  switch (mode) {
    case 0:
      table.build(usual, usual_log);
      return true;
    case 1:
      if (bytes.empty() || std::to_integer<std::size_t>(bytes[0]) >= symbols) return false;
      table.set_single(std::to_integer<std::uint8_t>(bytes[0]));
      bytes = bytes.subspan(1);
      return true;
    case 2:
      return table.read(bytes, max_log, symbols);
    default:
      return table.log >= 0;
  }
}

bool FrameDecoder::sequences(ByteSpan bytes) {
  if (bytes.empty()) return false;
  std::size_t count = std::to_integer<std::size_t>(bytes[0]), head = 1;
  if (count == 0) return bytes.size() == 1 && put(literals_);
  if (count >= 128) {
    head = count == 255 ? 3 : 2;
    if (bytes.size() < head) return false;
    count = count == 255 ? load_le<std::uint16_t>(&bytes[1]) + std::size_t{0x7F00}
                         : (count - 128) << 8 | std::to_integer<std::size_t>(bytes[1]);
  }
  if (bytes.size() < head + 1) return false;
  const auto modes = std::to_integer<int>(bytes[head]);
  bytes = bytes.subspan(head + 1);
  if ((modes & 3) != 0 ||
      !table(modes >> 6, bytes, kUsualLiteralLengths, 6, 9, kLiteralLengths.size(),
             literal_lengths_) ||
      !table(modes >> 4 & 3, bytes, kUsualOffsets, 5, 8, kMaxOffsetCode + 1, offsets_) ||
      !table(modes >> 2 & 3, bytes, kUsualMatchLengths, 6, 9, kMatchLengths.size(), match_lengths_))
    return false;
  zstd::BackwardBits bits;
  if (!bits.open(bytes)) return false;
  std::uint64_t literal_state = bits.read(literal_lengths_.log);
  std::uint64_t offset_state = bits.read(offsets_.log);
  std::uint64_t match_state = bits.read(match_lengths_.log);
  while (count-- > 0) {
    const auto& literal = literal_lengths_.entries[literal_state];
    const auto& match = match_lengths_.entries[match_state];
    const auto& far = offsets_.entries[offset_state];
    const std::uint64_t code = (std::uint64_t{1} << far.symbol) + bits.read(far.symbol);
    const Extra match_extra = kMatchLengths[match.symbol];
    std::size_t length = match_extra.base + bits.read(match_extra.bits);
    const Extra literal_extra = kLiteralLengths[literal.symbol];
    const std::size_t before = literal_extra.base + bits.read(literal_extra.bits);
    if (count > 0) {
      literal_state = literal.base + bits.read(literal.bits);
      match_state = match.base + bits.read(match.bits);
      offset_state = far.base + bits.read(far.bits);
    }
    if (bits.left() < 0) return false;

    std::size_t offset = 0;
    if (code > 3) {
      offset = code - 3;
      recent_ = {offset, recent_[0], recent_[1]};
    } else {
      const std::size_t which = code - 1 + (before == 0 ? 1 : 0);
      offset = which == 3 ? recent_[0] - 1 : recent_[which];
      if (which >= 2) recent_[2] = recent_[1];
      if (which >= 1) recent_[1] = recent_[0];
      recent_[0] = offset;
    }
    if (before > literals_.size() || !put(literals_.first(before))) return false;
    literals_ = literals_.subspan(before);
    if (offset == 0 || offset > at_ || length > to_.size() - at_) return false;
    for (; length > 0; --length, ++at_) to_[at_] = to_[at_ - offset];
  }
  return bits.left() == 0 && put(literals_);
}

}  // namespace

Result<void> append_stream(ByteSpan, int, Bytes&) {
  return fail(ErrorCode::unsupported, "zstd: this program only decodes");
}

Result<void> read_stream(ByteSpan& bytes, std::span<std::byte> stream) {
  if (stream.empty()) return {};
  const auto decoder = std::make_unique<FrameDecoder>(stream);  // large for a stack
  if (const char* wrong = decoder->decode(bytes)) return bad_file("zstd", wrong);
  return {};
}

}  // namespace slf::codec

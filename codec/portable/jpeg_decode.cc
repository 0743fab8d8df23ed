// Decodes baseline JPEG scans where libjpeg-turbo is not available: in WebAssembly. It replaces
// codec/jpeg_decode.cc and computes the same pixels: the accurate integer DCT, triangular ("fancy")
// upsampling and the fixed-point colours of libjpeg.

#include "codec/jpeg_decode.h"
#include "base/per_thread.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <iterator>
#include <vector>

#include "codec/scratch.h"
#include "codec/zigzag.h"

namespace slf::codec {
namespace {

/// The bits of a scan, without the zeros stuffed after each FF.
class ScanBits {
 public:
  explicit ScanBits(ByteSpan scan) : at_(scan.data()), end_(scan.data() + scan.size()) {}

  /// Whether a marker was found in the scan.
  [[nodiscard]] bool found_marker() const { return found_marker_; }
  /// Whether all bytes are used, and no more bits were read than they have.
  [[nodiscard]] bool exhausted() const { return at_ == end_ && left_ - missing_ < 8 && !overrun(); }
  [[nodiscard]] bool overrun() const { return left_ < missing_; }

  /// REQUIRES: n <= 16.
  [[nodiscard]] unsigned peek(int n) {
    if (left_ < n) fill();
    return static_cast<unsigned>(bits_ >> (left_ - n)) & ((1u << n) - 1);
  }
  void skip(int n) { left_ -= n; }
  unsigned read(int n) {
    if (n == 0) return 0;
    const unsigned value = peek(n);
    left_ -= n;
    return value;
  }

 private:
  void fill() {
    while (left_ <= 48) {
      unsigned byte = 0;
      if (at_ == end_) {
        missing_ += 8;
      } else {
        byte = std::to_integer<unsigned>(*at_++);
        if (byte == 0xFF) {
          if (at_ == end_ || *at_ != std::byte{0})
            found_marker_ = true;
          else
            ++at_;
        }
      }
      bits_ = bits_ << 8 | byte;
      left_ += 8;
    }
  }

  const std::byte* at_;
  const std::byte* end_;
  std::uint64_t bits_ = 0;
  int left_ = 0;
  int missing_ = 0;  ///< zeros appended after the end; always the last of left_
  bool found_marker_ = false;
};

/// Decodes Huffman codes: looks up the next 8 bits or, for longer codes, tries each length.
class Decoder {
 public:
  explicit Decoder(const HuffmanTable& table) : symbols_(table.symbols) {
    int code = 0, index = 0;
    for (int length = 1; length <= 16; ++length) {
      const int count = table.counts[static_cast<std::size_t>(length - 1)];
      first_[static_cast<std::size_t>(length)] = code;
      index_[static_cast<std::size_t>(length)] = index;
      count_[static_cast<std::size_t>(length)] = count;
      for (int i = 0; i < count && length <= 8; ++i)
        for (int low = 0; low < 1 << (8 - length); ++low)
          short_codes_[static_cast<std::size_t>((code + i) << (8 - length) | low) & 255] = {
              static_cast<std::uint8_t>(length), *std::next(symbols_.begin(), index + i)};
      code = (code + count) << 1;
      index += count;
    }
  }
  /// Returns the next symbol, or -1 if there is no such code.
  [[nodiscard]] int next(ScanBits& bits) const {
    const ShortCode code = short_codes_[bits.peek(8)];
    if (code.length > 0) {
      bits.skip(code.length);
      return code.symbol;
    }
    for (std::size_t length = 9; length <= 16; ++length) {
      const int offset = static_cast<int>(bits.peek(static_cast<int>(length))) - first_[length];
      if (offset < 0 || offset >= count_[length]) continue;
      bits.skip(static_cast<int>(length));
      return *std::next(symbols_.begin(), index_[length] + offset);
    }
    return -1;
  }

 private:
  struct ShortCode {
    std::uint8_t length = 0;
    std::uint8_t symbol = 0;
  };
  const std::vector<std::uint8_t>& symbols_;
  std::array<ShortCode, 256> short_codes_{};
  std::array<int, 17> first_{}, index_{}, count_{};
};

/// Reads a number of `size` bits, coded as in T.81 F.1.2.1.
int signed_bits(ScanBits& bits, int size) {
  if (size == 0) return 0;
  const int value = static_cast<int>(bits.read(size));
  return value < 1 << (size - 1) ? value - (1 << size) + 1 : value;
}

/// One dimension of the inverse DCT of libjpeg's jidctint.c, which follows Loeffler, Ligtenberg and
/// Moschytz; constants have 13 fractional bits.
template <int kStride, class Store>
void transform(const std::int32_t* in, const Store& store) {
  using Wide = std::int64_t;  // damaged scans have coefficients of any size
  const auto at = [&](int i) { return Wide{in[i * kStride]}; };
  const Wide even = (at(2) + at(6)) * 4433;
  const Wide c = even - at(6) * 15137, d = even + at(2) * 6270;
  const Wide a = (at(0) + at(4)) * 8192, b = (at(0) - at(4)) * 8192;
  const Wide e0 = a + d, e3 = a - d, e1 = b + c, e2 = b - c;

  const Wide z5 = (at(7) + at(3) + at(5) + at(1)) * 9633;
  const Wide z1 = (at(7) + at(1)) * -7373, z2 = (at(5) + at(3)) * -20995;
  const Wide z3 = (at(7) + at(3)) * -16069 + z5, z4 = (at(5) + at(1)) * -3196 + z5;
  const Wide o0 = at(7) * 2446 + z1 + z3, o1 = at(5) * 16819 + z2 + z4;
  const Wide o2 = at(3) * 25172 + z2 + z3, o3 = at(1) * 12299 + z1 + z4;
  store(0, e0 + o3), store(7, e0 - o3), store(1, e1 + o2), store(6, e1 - o2);
  store(2, e2 + o1), store(5, e2 - o1), store(3, e3 + o0), store(4, e3 - o0);
}

void inverse_dct(const std::int32_t* block, std::uint8_t* to, std::size_t stride) {
  std::int32_t columns[64];
  for (int x = 0; x < 8; ++x)
    transform<8>(block + x, [&](int y, std::int64_t v) {
      columns[y * 8 + x] = static_cast<std::int32_t>((v + (1 << 10)) >> 11);
    });
  for (int y = 0; y < 8; ++y)
    transform<1>(columns + y * 8, [&](int x, std::int64_t v) {
      const std::int64_t value = ((v + (1 << 17)) >> 18) + 128;
      to[static_cast<std::size_t>(y) * stride + static_cast<std::size_t>(x)] =
          static_cast<std::uint8_t>(std::clamp<std::int64_t>(value, 0, 255));
    });
}

struct Plane {
  std::size_t width = 0, height = 0;
  std::span<std::uint8_t> values;
  std::uint32_t dc = 0;  ///< of the previous block; damaged scans wrap around
};

std::uint8_t clamp_byte(int value) { return static_cast<std::uint8_t>(std::clamp(value, 0, 255)); }

/// One line of a plane at twice the resolution: 3/4 of the nearer line and 1/4 of the other, with
/// the same weights along the line. The rounding alternates.
void upsample(const std::uint8_t* near, const std::uint8_t* far, std::size_t width,
              std::uint8_t* to) {
  const auto sum = [&](std::size_t x) { return near[x] * 3 + far[x]; };
  for (std::size_t x = 0; x < width; ++x) {
    const int here = sum(x);
    const int left = x > 0 ? sum(x - 1) : here, right = x + 1 < width ? sum(x + 1) : here;
    to[2 * x] = static_cast<std::uint8_t>((here * 3 + left + 8) >> 4);
    to[2 * x + 1] = static_cast<std::uint8_t>((here * 3 + right + 7) >> 4);
  }
}

void convert(const std::uint8_t* luma, const std::uint8_t* blue, const std::uint8_t* red,
             std::size_t width, std::uint8_t* to) {
  constexpr int kHalf = 1 << 15;
  for (std::size_t x = 0; x < width; ++x) {
    const int y = luma[x], cb = blue[x] - 128, cr = red[x] - 128;
    to[4 * x] = clamp_byte(y + ((91881 * cr + kHalf) >> 16));
    to[4 * x + 1] = clamp_byte(y + ((-22554 * cb - 46802 * cr + kHalf) >> 16));
    to[4 * x + 2] = clamp_byte(y + ((116130 * cb + kHalf) >> 16));
    to[4 * x + 3] = 255;
  }
}

/// Returns null, or an error message.
const char* decode_planes(const JpegTables& tables, const JpegShape& shape, ByteSpan scan,
                          std::span<Plane> planes) {
  const Decoder dc[2] = {Decoder(tables.dc[0]), Decoder(tables.dc[1])};
  const Decoder ac[2] = {Decoder(tables.ac[0]), Decoder(tables.ac[1])};
  ScanBits bits(scan);
  const std::size_t unit = alignment(shape.color);
  for (std::size_t top = 0; top < shape.height; top += unit)
    for (std::size_t left = 0; left < shape.width; left += unit)
      for (std::size_t i = 0; i < planes.size(); ++i) {
        Plane& plane = planes[i];
        const std::size_t kind = i == 0 ? 0 : 1, edge = unit * plane.width / shape.width;
        const auto& steps = tables.quantisation[kind];
        for (std::size_t y = 0; y < edge; y += 8)
          for (std::size_t x = 0; x < edge; x += 8) {
            std::int32_t block[64] = {};
            const int size = dc[kind].next(bits);
            if (size < 0 || size > 15) return "no such Huffman code";
            plane.dc += static_cast<std::uint32_t>(signed_bits(bits, size));
            block[0] = static_cast<std::int16_t>(plane.dc) * steps[0];
            for (std::size_t k = 1; k < 64; ++k) {
              const int symbol = ac[kind].next(bits);
              if (symbol < 0) return "no such Huffman code";
              const int run = symbol >> 4, length = symbol & 15;
              if (length == 0 && run != 15) break;
              k += static_cast<std::size_t>(run);
              if (length == 0) continue;
              if (k > 63) return "a run leaves its block";
              block[kZigzag[k]] = signed_bits(bits, length) * steps[k];
            }
            if (bits.overrun()) return "the scan is cut short";
            const std::size_t px = left * plane.width / shape.width + x;
            const std::size_t py = top * plane.width / shape.width + y;
            inverse_dct(block, &plane.values[py * plane.width + px], plane.width);
          }
      }
  if (bits.found_marker()) return "a marker inside the scan";
  if (!bits.exhausted()) return "bytes after the picture";
  return nullptr;
}

}  // namespace

// Only an encoder needs these: fields have tables of their own.
JpegTables standard_tables(int) { return {}; }

Result<void> decode_scan(const JpegTables& tables, const JpegShape& shape, ByteSpan scan,
                         std::span<std::uint8_t> pixels) {
  assert(pixels.size() == std::size_t{shape.width} * shape.height * pixel_bytes(shape.color));
  const std::size_t width = shape.width, height = shape.height;
  const std::size_t part = shape.color == JpegColor::ycbcr_420 ? 2 : 1;
  auto& scratch = per_thread<Scratch<std::uint8_t>>([] {});
  std::array<Plane, 3> all;
  std::span<Plane> planes = all;
  if (shape.color == JpegColor::gray) {
    all[0] = {width, height, pixels, 0};
    planes = planes.first(1);
  } else {
    const std::size_t luma = width * height, chroma = luma / (part * part);
    const auto memory = scratch.take(luma + 2 * chroma + 2 * width);
    all[0] = {width, height, memory.first(luma), 0};
    all[1] = {width / part, height / part, memory.subspan(luma, chroma), 0};
    all[2] = {width / part, height / part, memory.subspan(luma + chroma, chroma), 0};
  }
  if (const char* wrong = decode_planes(tables, shape, scan, planes))
    return bad_file("JPEG", wrong);
  if (shape.color == JpegColor::gray) return {};

  std::uint8_t* lines[2] = {all[2].values.data() + all[2].values.size()};
  lines[1] = lines[0] + width;
  for (std::size_t y = 0; y < height; ++y) {
    const std::uint8_t* chroma[2];
    for (std::size_t i = 0; i < 2; ++i) {
      const Plane& plane = all[i + 1];
      const std::uint8_t* near = &plane.values[y / part * plane.width];
      chroma[i] = near;
      if (part == 1) continue;
      const std::size_t row = y / 2, last = plane.height - 1;
      const std::size_t other = y % 2 == 0 ? (row > 0 ? row - 1 : 0) : std::min(row + 1, last);
      upsample(near, &plane.values[other * plane.width], plane.width, lines[i]);
      chroma[i] = lines[i];
    }
    convert(&all[0].values[y * width], chroma[0], chroma[1], width, &pixels[y * width * 4]);
  }
  return {};
}

}  // namespace slf::codec

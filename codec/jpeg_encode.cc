#include "codec/jpeg_encode.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "codec/dct.h"
#include "codec/fill.h"
#include "codec/zigzag.h"

namespace slf::codec {
namespace {

constexpr std::size_t kSide = 8;

// Symbols of AC tables that no level follows: 16 zeros, and zeros up to the end of the block.
constexpr unsigned kSixteenZeros = 0xF0, kEndOfBlock = 0x00;

// The squared error that is worth one bit, relative to the squared quantisation step. On tiles of a
// brain this value gave the fewest bytes at equal error.
constexpr float kErrorPerBit = 0.09f;

// Row k is the k-th orthonormal cosine, sampled at 8 points. The values are written out because
// libraries compute cosines that differ in the last bit.
constexpr float kC0 = 0.353553391f, kC1 = 0.490392640f, kC2 = 0.461939766f, kC3 = 0.415734806f,
                kC5 = 0.277785117f, kC6 = 0.191341716f, kC7 = 0.097545161f;
constexpr std::array<float, 64> kCosines = {
    kC0, kC0,  kC0,  kC0,  kC0,  kC0,  kC0,  kC0, kC1, kC3,  kC5,  kC7,  -kC7, -kC5, -kC3, -kC1,
    kC2, kC6,  -kC6, -kC2, -kC2, -kC6, kC6,  kC2, kC3, -kC7, -kC1, -kC5, kC5,  kC1,  kC7,  -kC3,
    kC0, -kC0, -kC0, kC0,  kC0,  -kC0, -kC0, kC0, kC5, -kC1, kC7,  kC3,  -kC3, -kC7, kC1,  -kC5,
    kC6, -kC2, kC2,  -kC6, -kC6, kC2,  -kC2, kC6, kC7, -kC5, kC3,  -kC1, kC1,  -kC3, kC5,  -kC7};

constexpr std::array<float, 64> kTransposedCosines = transposed(kCosines);

// Transforms the 8 × 8 values at `from`.
std::array<float, 64> transform(const float* from, std::size_t stride) {
  std::array<float, 64> lines, both, block;
  multiply(kCosines.data(), kSide, from, stride, lines);
  multiply(lines.data(), kSide, kTransposedCosines.data(), kSide, both);
  for (std::size_t i = 0; i < 64; ++i) block[i] = both[kZigzag[i]];
  return block;
}

// Converts R, G, B to Y, Cb, Cr in place, all centred on 0 (JFIF).
void to_ycbcr(std::array<std::vector<float>, 3>& planes) {
  for (std::size_t i = 0; i < planes[0].size(); ++i) {
    const float r = planes[0][i], g = planes[1][i], b = planes[2][i];
    const float y = 0.299f * r + 0.587f * g + 0.114f * b;
    planes[0][i] = y - 128;
    planes[1][i] = (b - y) * (0.5f / 0.886f);
    planes[2][i] = (r - y) * (0.5f / 0.701f);
  }
}

// Replaces each square of 2 × 2 pixels by its mean, in place.
void halve(std::size_t width, std::size_t height, std::vector<float>& plane) {
  for (std::size_t y = 0; y < height / 2; ++y)
    for (std::size_t x = 0; x < width / 2; ++x) {
      const float* from = &plane[2 * y * width + 2 * x];
      plane[y * (width / 2) + x] = (from[0] + from[1] + from[width] + from[width + 1]) * 0.25f;
    }
}

// Makes the blocks of a plane, whose sides are `scale` times shorter than those of the weights.
JpegCoefficients::Component make_blocks(const JpegPicture& picture, std::size_t plane,
                                        std::size_t scale) {
  JpegCoefficients::Component component;
  const std::size_t width = picture.shape.width, stride = width / scale;
  component.across = static_cast<std::uint32_t>(stride / kSide);
  component.down = static_cast<std::uint32_t>(picture.shape.height / scale / kSide);
  component.blocks.resize(std::size_t{component.across} * component.down);
  auto block = component.blocks.begin();
  for (std::size_t y = 0; y < component.down; ++y)
    for (std::size_t x = 0; x < component.across; ++x, ++block) {
      const std::size_t pixels = kSide * scale;
      float sum = 0;
      for (std::size_t v = 0; v < pixels; ++v)
        for (std::size_t u = 0; u < pixels; ++u)
          sum += picture.weight[(y * pixels + v) * width + x * pixels + u];
      block->coverage = sum / static_cast<float>(pixels * pixels);
      if (block->coverage > 0)
        block->values = transform(&picture.planes[plane][y * kSide * stride + x * kSide], stride);
    }
  return component;
}

// A Huffman table in the form an encoder needs.
struct Codes {
  std::array<std::uint16_t, 256> code{};
  std::array<std::uint8_t, 256> length{};

  explicit Codes(const HuffmanTable& table) {
    unsigned next = 0;
    auto symbol = table.symbols.begin();
    for (std::size_t i = 0; i < 16; ++i, next <<= 1)
      for (int k = 0; k < table.counts[i]; ++k, ++next, ++symbol) {
        code[*symbol] = static_cast<std::uint16_t>(next);
        length[*symbol] = static_cast<std::uint8_t>(i + 1);
      }
  }
};

class BitWriter {
 public:
  explicit BitWriter(Bytes& to) : to_(to) {}
  /// Up to 32 bits; those above them are 0.
  void put(unsigned bits, unsigned count) {
    pending_ = pending_ << count | bits;
    for (count_ += count; count_ >= 8; count_ -= 8) put_byte(pending_ >> (count_ - 8) & 0xFF);
  }
  /// Pads the last byte with ones.
  void finish() {
    if (count_ > 0) put(0xFFu >> count_, 8 - count_);
  }

 private:
  void put_byte(std::uint64_t byte) {
    to_.push_back(static_cast<std::byte>(byte));
    if (byte == 0xFF) to_.push_back(std::byte{0});
  }
  Bytes& to_;
  std::uint64_t pending_ = 0;
  unsigned count_ = 0;
};

// The number of bits that follow a value's symbol, and these bits: those of value - 1 if negative.
unsigned size_of(int value) {
  return static_cast<unsigned>(std::bit_width(unsigned(std::abs(value))));
}
unsigned bits_of(int value) { return static_cast<unsigned>(value < 0 ? value - 1 : value); }

// The levels of a block, and which of its AC levels are not 0. Other AC levels are not set.
struct Quantised {
  std::array<std::int16_t, 64> levels;
  std::uint64_t some = 0;
};

// Chooses the AC levels of a block that minimise squared error + error per bit × bits, by dynamic
// programming over the position of the last level that is not 0.
class Quantiser {
 public:
  Quantiser(const std::array<std::uint8_t, 64>& steps, const Codes& codes)
      : end_bits_(codes.length[kEndOfBlock]), error_per_bit_(error_per_bit(steps)) {
    std::copy(steps.begin(), steps.end(), steps_.begin());
    for (unsigned size = 1; size < bits_.size(); ++size) {
      float fewest = std::numeric_limits<float>::max();
      for (unsigned run = 63; run-- > 0;) {
        const unsigned symbol = run % 16 << 4 | size, sixteens = run / 16;
        bits_[size][run] = static_cast<float>(codes.length[symbol] + size +
                                              sixteens * codes.length[kSixteenZeros]);
        fewest = std::min(fewest, bits_[size][run]);
        most_saved_ = std::max(most_saved_, bits_[size][run] - fewest);
      }
    }
  }

  void quantise(const JpegCoefficients::Block& block, Quantised& to) {
    const std::array<float, 64>& values = block.values;
    // The less the pixels of a block matter, the larger an error one bit may cause.
    const float block_error_per_bit = error_per_bit_ / block.coverage;
    // zeroed[i]: the error if coefficients 1..i are 0.
    std::array<float, 64> zeroed;
    std::array<std::int32_t, 64> nearest;
    for (std::size_t i = 0; i < 64; ++i) {
      const float rounded = std::min(std::abs(values[i]) / steps_[i] + 0.5f, 1023.f);
      nearest[i] = static_cast<std::int32_t>(rounded);
      zeroed[i] = values[i] * values[i];
    }
    zeroed[0] = 0;
    std::uint64_t left = 0;  // positions that may have a level
    for (std::size_t i = 1; i < 64; ++i) {
      zeroed[i] += zeroed[i - 1];
      left |= std::uint64_t{nearest[i] > 0} << i;
    }

    // Nodes are the start and every position that may have a level. Edges skip zeros. Live nodes
    // are those that some later node or the end may follow.
    std::array<std::uint8_t, 64> live;
    std::size_t count = 1;
    node_[live[0] = 0] = {0, 0, 0};
    for (; left != 0; left &= left - 1) {
      const auto i = static_cast<std::uint8_t>(std::countr_zero(left));
      Node& node = node_[i] = {0, 0, std::numeric_limits<float>::max()};
      // A lower level is only better if it is of another size.
      const int lower = (nearest[i] & (nearest[i] - 1)) == 0 ? nearest[i] - 1 : 0;
      for (const int level : {nearest[i], lower}) {
        if (level == 0) break;
        const std::array<float, 63>& bits = bits_[size_of(level)];
        const float error = std::abs(values[i]) - static_cast<float>(level) * steps_[i];
        for (std::size_t n = 0; n < count; ++n) {
          const std::uint8_t from = live[n];
          const float cost = node_[from].cost + (zeroed[i - 1u] - zeroed[from]) +
                             block_error_per_bit * bits[i - 1u - from] + error * error;
          if (cost < node.cost)
            node = {static_cast<std::int16_t>(values[i] < 0 ? -level : level), from, cost};
        }
      }
      // What follows a node costs at most this much more than what follows an earlier one.
      const float ahead = node.cost - zeroed[i] + block_error_per_bit * most_saved_;
      while (count > 0 && node_[live[count - 1]].cost - zeroed[live[count - 1]] >= ahead) --count;
      live[count++] = i;
    }
    float best = std::numeric_limits<float>::max();
    std::uint8_t last = 0;
    for (std::size_t n = 0; n < count; ++n) {
      const std::uint8_t i = live[n];
      const float cost = node_[i].cost + (zeroed[63] - zeroed[i]) +
                         (i == 63 ? 0 : block_error_per_bit * end_bits_);
      if (cost < best) best = cost, last = i;
    }
    to.levels[0] = static_cast<std::int16_t>(
        std::clamp(std::nearbyint(values[0] / steps_[0]), -1024.0f, 1016.0f));
    to.some = 0;
    for (; last != 0; last = node_[last].before)
      to.levels[last] = node_[last].level, to.some |= std::uint64_t{1} << last;
  }

 private:
  struct Node {
    std::int16_t level;
    std::uint8_t before;  // the position of the node before
    float cost;           // of the block up to this node
  };

  std::array<float, 64> steps_;
  float end_bits_, error_per_bit_;
  std::array<std::array<float, 63>, 11> bits_{};  // of a level after zeros: by its size, by these
  float most_saved_ = 0;                          // bits, by more zeros before a level
  std::array<Node, 64> node_;                     // at each position
};

// Writes or counts the symbols of the blocks of one component.
class BlockCoder {
 public:
  BlockCoder(const Codes& dc, const Codes& ac, BitWriter* writer, SymbolCounts* dc_counts,
             SymbolCounts* ac_counts)
      : dc_(dc), ac_(ac), writer_(writer), dc_counts_(dc_counts), ac_counts_(ac_counts) {}

  int last_dc() const { return last_dc_; }

  void code(const Quantised& of) {
    const int difference = of.levels[0] - last_dc_;
    last_dc_ = of.levels[0];
    put(dc_, dc_counts_, size_of(difference), difference, size_of(difference));
    unsigned next = 1;
    for (std::uint64_t some = of.some; some != 0; some &= some - 1) {
      const auto i = static_cast<unsigned>(std::countr_zero(some));
      unsigned run = i - next;
      for (; run >= 16; run -= 16) put(ac_, ac_counts_, kSixteenZeros, 0, 0);
      const unsigned size = size_of(of.levels[i]);
      put(ac_, ac_counts_, run << 4 | size, of.levels[i], size);
      next = i + 1;
    }
    if (next < 64) put(ac_, ac_counts_, kEndOfBlock, 0, 0);
  }

 private:
  void put(const Codes& codes, SymbolCounts* counts, unsigned symbol, int value, unsigned size) {
    if (counts) ++(*counts)[symbol];
    if (!writer_) return;
    writer_->put(codes.code[symbol] << size | (bits_of(value) & ((1u << size) - 1)),
                 codes.length[symbol] + size);
  }

  const Codes& dc_;
  const Codes& ac_;
  BitWriter* writer_;
  SymbolCounts* dc_counts_;
  SymbolCounts* ac_counts_;
  int last_dc_ = 0;
};

}  // namespace

float error_per_bit(const std::array<std::uint8_t, 64>& steps) {
  float sum = 0;
  for (const std::uint8_t step : steps) sum += step;
  const float mean = sum / 64;
  return kErrorPerBit * mean * mean;
}

JpegCoefficients::JpegCoefficients(JpegPicture picture) : color_(picture.shape.color) {
  const std::size_t width = picture.shape.width, height = picture.shape.height;
  const std::size_t planes = color_ == JpegColor::gray ? 1 : 3;
  for (std::size_t i = 0; i < planes; ++i) fill(width, height, picture.weight, picture.planes[i]);
  if (color_ == JpegColor::gray)
    for (float& value : picture.planes[0]) value -= 128;
  else
    to_ycbcr(picture.planes);
  const std::size_t scale = color_ == JpegColor::ycbcr_420 ? 2 : 1;
  for (std::size_t i = 0; i < planes; ++i) {
    if (i > 0 && scale == 2) halve(width, height, picture.planes[i]);
    components_.push_back(make_blocks(picture, i, i == 0 ? 1 : scale));
  }
}

void encode_scan(const JpegTables& tables, const JpegCoefficients& picture, Bytes* scan,
                 JpegCounts* counts) {
  const Codes dc[2] = {Codes(tables.dc[0]), Codes(tables.dc[1])};
  const Codes ac[2] = {Codes(tables.ac[0]), Codes(tables.ac[1])};
  Quantiser quantisers[2] = {{tables.quantisation[0], ac[0]}, {tables.quantisation[1], ac[1]}};
  Bytes ignored;
  BitWriter writer(scan ? *scan : ignored);
  std::vector<BlockCoder> coders;
  for (std::size_t i = 0; i < picture.components().size(); ++i) {
    const std::size_t table = i == 0 ? 0 : 1;
    coders.emplace_back(dc[table], ac[table], scan ? &writer : nullptr,
                        counts ? &counts->dc[table] : nullptr,
                        counts ? &counts->ac[table] : nullptr);
  }
  // For each minimum coded unit, row by row: the blocks of each component that cover its pixels.
  const auto& components = picture.components();
  const auto& smallest = components[components.size() - 1];
  Quantised quantised;
  for (std::uint32_t y = 0; y < smallest.down; ++y)
    for (std::uint32_t x = 0; x < smallest.across; ++x)
      for (std::size_t i = 0; i < components.size(); ++i) {
        const auto& component = components[i];
        const std::uint32_t scale = component.across / smallest.across;
        for (std::uint32_t v = 0; v < scale; ++v)
          for (std::uint32_t u = 0; u < scale; ++u) {
            const auto& block =
                component.blocks[std::size_t{y * scale + v} * component.across + x * scale + u];
            if (block.coverage > 0) {
              quantisers[i == 0 ? 0 : 1].quantise(block, quantised);
            } else {  // nothing shows it: the mean of the block before takes the fewest bits
              quantised.some = 0;
              quantised.levels[0] = static_cast<std::int16_t>(coders[i].last_dc());
            }
            coders[i].code(quantised);
          }
      }
  writer.finish();
}

}  // namespace slf::codec

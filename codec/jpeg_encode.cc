#include "codec/jpeg_encode.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

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
constexpr float kCosines[kSide][kSide] = {
    {kC0, kC0, kC0, kC0, kC0, kC0, kC0, kC0},     {kC1, kC3, kC5, kC7, -kC7, -kC5, -kC3, -kC1},
    {kC2, kC6, -kC6, -kC2, -kC2, -kC6, kC6, kC2}, {kC3, -kC7, -kC1, -kC5, kC5, kC1, kC7, -kC3},
    {kC0, -kC0, -kC0, kC0, kC0, -kC0, -kC0, kC0}, {kC5, -kC1, kC7, kC3, -kC3, -kC7, kC1, -kC5},
    {kC6, -kC2, kC2, -kC6, -kC6, kC2, -kC2, kC6}, {kC7, -kC5, kC3, -kC1, kC1, -kC3, kC5, -kC7}};

constexpr auto kTransposedCosines = [] {
  std::array<std::array<float, kSide>, kSide> result{};
  for (std::size_t k = 0; k < kSide; ++k)
    for (std::size_t x = 0; x < kSide; ++x) result[x][k] = kCosines[k][x];
  return result;
}();

// Transforms the 8 × 8 values at `from`. The inner loops vectorise without reordering any sum.
std::array<float, 64> transform(const float* from, std::size_t stride) {
  float lines[kSide][kSide]{};
  for (std::size_t y = 0; y < kSide; ++y)
    for (std::size_t k = 0; k < kSide; ++k)
      for (std::size_t x = 0; x < kSide; ++x) lines[k][x] += kCosines[k][y] * from[y * stride + x];
  float both[kSide][kSide]{};
  for (std::size_t k = 0; k < kSide; ++k)
    for (std::size_t x = 0; x < kSide; ++x)
      for (std::size_t j = 0; j < kSide; ++j) both[k][j] += lines[k][x] * kTransposedCosines[x][j];
  std::array<float, 64> block;
  for (std::size_t i = 0; i < 64; ++i) block[i] = both[kZigzag[i] / kSide][kZigzag[i] % kSide];
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
  void put(unsigned bits, unsigned count) {
    pending_ = pending_ << count | (bits & ((1u << count) - 1));
    for (count_ += count; count_ >= 8; count_ -= 8) put_byte(pending_ >> (count_ - 8) & 0xFF);
  }
  /// Pads the last byte with ones.
  void finish() {
    if (count_ > 0) put(0x7F, 8 - count_);
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

using Quantised = std::array<std::int16_t, 64>;

// Chooses the AC levels of a block that minimise squared error + error per bit × bits, by dynamic
// programming over the position of the last level that is not 0.
class Quantiser {
 public:
  Quantiser(const std::array<std::uint8_t, 64>& steps, const Codes& codes)
      : steps_(steps), codes_(codes), error_per_bit_(error_per_bit(steps)) {}

  void quantise(const JpegCoefficients::Block& block, Quantised& levels) {
    const std::array<float, 64>& values = block.values;
    // The less the pixels of a block matter, the larger an error one bit may cause.
    block_error_per_bit_ = error_per_bit_ / block.coverage;
    levels.fill(0);
    levels[0] = static_cast<std::int16_t>(
        std::clamp(std::nearbyint(values[0] / float(steps_[0])), -1024.0f, 1016.0f));
    // zeroed[i]: the error if coefficients 1..i are all zero.
    float zeroed[64];
    zeroed[0] = 0;
    for (std::size_t i = 1; i < 64; ++i) zeroed[i] = zeroed[i - 1] + values[i] * values[i];

    // Nodes are the start and every position that may have a level. Edges skip zeros.
    count_ = 0;
    node_[count_++] = {0, 0, 0, 0};
    for (std::size_t i = 1; i < 64; ++i) add_node(i, values[i], zeroed);
    float best = std::numeric_limits<float>::max();
    std::size_t last = 0;
    for (std::size_t n = 0; n < count_; ++n) {
      const bool at_end = node_[n].position == 63;
      const float cost = node_[n].cost + (zeroed[63] - zeroed[node_[n].position]) +
                         (at_end ? 0 : block_error_per_bit_ * float(codes_.length[kEndOfBlock]));
      if (cost < best) {
        best = cost;
        last = n;
      }
    }
    for (; last != 0; last = node_[last].before) levels[node_[last].position] = node_[last].level;
  }

 private:
  struct Node {
    std::size_t position;
    std::int16_t level;
    std::size_t before;
    float cost;  // of the block up to this node
  };

  void add_node(std::size_t position, float value, const float* zeroed) {
    const float step = steps_[position];
    const float magnitude = std::abs(value);
    const int nearest = std::min(static_cast<int>(std::floor(magnitude / step + 0.5f)), 1023);
    for (int level = nearest; level > 0 && level + 1 >= nearest; --level) {
      const float error = magnitude - float(level) * step;
      const unsigned size = size_of(level);
      Node node{position, static_cast<std::int16_t>(value < 0 ? -level : level), 0,
                std::numeric_limits<float>::max()};
      for (std::size_t n = 0; n < count_; ++n) {
        if (node_[n].position == position) break;  // the other level of this position
        const std::size_t run = position - node_[n].position - 1, runs_of_16 = run / 16;
        const unsigned symbol = static_cast<unsigned>(run % 16 * 16) | size;
        const float bits = float(codes_.length[symbol]) + float(size) +
                           float(runs_of_16) * float(codes_.length[kSixteenZeros]);
        const float cost = node_[n].cost + (zeroed[position - 1] - zeroed[node_[n].position]) +
                           block_error_per_bit_ * bits;
        if (cost >= node.cost) continue;
        node.cost = cost;
        node.before = n;
      }
      node.cost += error * error;
      node_[count_++] = node;
    }
  }

  const std::array<std::uint8_t, 64>& steps_;
  const Codes& codes_;
  float error_per_bit_;
  float block_error_per_bit_ = 0;
  std::array<Node, 1 + 2 * 63> node_;  // the start, and up to two levels at each position
  std::size_t count_ = 0;
};

// Writes or counts the symbols of the blocks of one component.
class BlockCoder {
 public:
  BlockCoder(const Codes& dc, const Codes& ac, BitWriter* writer, SymbolCounts* dc_counts,
             SymbolCounts* ac_counts)
      : dc_(dc), ac_(ac), writer_(writer), dc_counts_(dc_counts), ac_counts_(ac_counts) {}

  int last_dc() const { return last_dc_; }

  void code(const Quantised& levels) {
    const int difference = levels[0] - last_dc_;
    last_dc_ = levels[0];
    put(dc_, dc_counts_, size_of(difference), difference, size_of(difference));
    unsigned run = 0;
    for (std::size_t i = 1; i < 64; ++i) {
      if (levels[i] == 0) {
        ++run;
        continue;
      }
      for (; run >= 16; run -= 16) put(ac_, ac_counts_, kSixteenZeros, 0, 0);
      const unsigned size = size_of(levels[i]);
      put(ac_, ac_counts_, run << 4 | size, levels[i], size);
      run = 0;
    }
    if (run > 0) put(ac_, ac_counts_, kEndOfBlock, 0, 0);
  }

 private:
  void put(const Codes& codes, SymbolCounts* counts, unsigned symbol, int value, unsigned size) {
    if (counts) ++(*counts)[symbol];
    if (!writer_) return;
    writer_->put(codes.code[symbol], codes.length[symbol]);
    writer_->put(bits_of(value), size);
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
  Quantised levels;
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
              quantisers[i == 0 ? 0 : 1].quantise(block, levels);
            } else {  // nothing shows it: the mean of the block before takes the fewest bits
              levels = {};
              levels[0] = static_cast<std::int16_t>(coders[i].last_dc());
            }
            coders[i].code(levels);
          }
      }
  writer.finish();
}

}  // namespace slf::codec

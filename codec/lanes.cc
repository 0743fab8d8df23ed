#include "codec/lanes.h"

#include <algorithm>
#include <utility>

#include "codec/scratch.h"

namespace slf::codec {
namespace {

using Lanes = std::array<float, lane_count>;

constexpr Lanes nothing{};

// The neighbours of a sample, with stand-ins where the picture ends.
struct Neighbours {
  const Lanes *w, *n, *nw, *ne, *ww, *nn;
};

// The last three lines of one channel.
class Lines {
 public:
  Lines(Lanes* memory, std::uint32_t side) : memory_(memory), length_(side + 1) {}

  Lanes& at(std::uint32_t p, std::uint32_t q) { return memory_[q % 3 * length_ + p]; }

  Neighbours around(std::uint32_t p, std::uint32_t q) {
    Neighbours s;
    s.w = p > 0 ? &at(p - 1, q) : q > 0 ? &at(0, q - 1) : &nothing;
    s.n = q > 0 ? &at(p, q - 1) : s.w;
    s.nw = p > 0 && q > 0 ? &at(p - 1, q - 1) : s.n;
    s.ne = q > 0 ? &at(p + 1, q - 1) : s.n;  // the line above is longer by one
    s.ww = p > 1 ? &at(p - 2, q) : s.w;
    s.nn = q > 1 ? &at(p, q - 2) : s.n;
    return s;
  }

 private:
  Lanes* memory_;
  std::size_t length_;
};

void add(Lanes& sum, float weight, const Lanes& values) {
  for (std::size_t i = 0; i < lane_count; ++i) sum[i] += weight * values[i];
}

// JPEG-LS: the median of W, N and W + N - NW.
Lanes median_edge(const Neighbours& s) {
  Lanes guess;
  for (std::size_t i = 0; i < lane_count; ++i) {
    const float w = (*s.w)[i], n = (*s.n)[i];
    const float low = std::min(w, n), high = std::max(w, n);
    guess[i] = std::min(std::max(w + n - (*s.nw)[i], low), high);
  }
  return guess;
}

// floor((sum of weight × value + 128) / 256), within a byte.
Lanes weighted(const ChannelPredictor& predictor, std::size_t channel, Lines* lines,
               std::uint32_t p, std::uint32_t q) {
  Lanes sum;
  sum.fill(128);
  const std::int16_t* weight = predictor.weights.data();
  const Neighbours own = lines[channel].around(p, q);
  for (const Lanes* tap : {own.w, own.n, own.nw, own.ne, own.ww, own.nn}) add(sum, *weight++, *tap);
  for (std::size_t earlier = 0; earlier < channel; ++earlier) {
    const Neighbours cross = lines[earlier].around(p, q);
    for (const Lanes* tap :
         {&std::as_const(lines[earlier].at(p, q)), cross.w, cross.n, cross.nw, cross.ne})
      add(sum, *weight++, *tap);
  }
  for (float& value : sum) value = std::min(std::max(value * (1.0f / 256), 0.0f), 255.0f);
  return sum;
}

enum class Way { predict, predict_covered, restore };

// Walks a group's samples in the order in which they can be restored.
template <Way way>
void walk(const LaneGroup& group, const LaneValues* from, const LaneValues* coverage,
          LaneValues* to) {
  thread_local Scratch<Lanes> scratch;
  const std::size_t length = group.side + 1;
  Lanes* memory = scratch.take(max_channels * 3 * length).data();
  const auto make = [&](std::size_t i) { return Lines(memory + i * 3 * length, group.side); };
  Lines lines[max_channels] = {make(0), make(1), make(2), make(3)};
  const std::size_t columns = length * (length + 1) / 2;
  const int mask = (1 << group.bits) - 1;

  std::size_t column = 0;
  for (std::uint32_t q = 0; q <= group.side; ++q)
    for (std::uint32_t p = 0; p <= group.side - q; ++p, ++column)
      for (std::size_t channel = 0; channel < group.channels.size(); ++channel) {
        const ChannelPredictor& predictor = group.channels[channel];
        const Lanes guess = predictor.linear ? weighted(predictor, channel, lines, p, q)
                                             : median_edge(lines[channel].around(p, q));
        const LaneValues& in = from[channel * columns + column];
        LaneValues& out = to[channel * columns + column];
        Lanes& line = lines[channel].at(p, q);
        for (std::size_t i = 0; i < lane_count; ++i) {
          const int predicted = static_cast<int>(guess[i]);
          int residual = in[i], value = in[i];
          if (way == Way::restore) {
            value = (residual + predicted) & mask;
          } else {
            if (way == Way::predict_covered && coverage[column][i] == 0) value = predicted;
            residual = (value - predicted) & mask;
          }
          out[i] = static_cast<std::uint16_t>(way == Way::restore ? value : residual);
          line[i] = static_cast<float>(value);
        }
      }
}

}  // namespace

void predict(const LaneGroup& group, const LaneValues* values, const LaneValues* coverage,
             LaneValues* residuals) {
  if (coverage)
    walk<Way::predict_covered>(group, values, coverage, residuals);
  else
    walk<Way::predict>(group, values, nullptr, residuals);
}

void restore(const LaneGroup& group, const LaneValues* residuals, LaneValues* values) {
  walk<Way::restore>(group, residuals, nullptr, values);
}

}  // namespace slf::codec

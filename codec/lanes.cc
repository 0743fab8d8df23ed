#include "codec/lanes.h"

#include <cstring>

#include "codec/scratch.h"

namespace slf::codec {
namespace {

// Four lanes each: what every processor's vectors hold.
using Vector = float __attribute__((vector_size(16)));
using ShortVector = std::uint16_t __attribute__((vector_size(8)));
using IntVector = int __attribute__((vector_size(16)));
constexpr std::size_t vector_count = lane_count / 4;
using Lanes = std::array<Vector, vector_count>;

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

Vector least(Vector a, Vector b) { return a < b ? a : b; }
Vector greatest(Vector a, Vector b) { return a > b ? a : b; }

// JPEG-LS: the median of W, N and W + N - NW.
Lanes median_edge(const Neighbours& s) {
  Lanes guess;
  for (std::size_t i = 0; i < vector_count; ++i) {
    const Vector w = (*s.w)[i], n = (*s.n)[i];
    guess[i] = least(greatest(w + n - (*s.nw)[i], least(w, n)), greatest(w, n));
  }
  return guess;
}

// floor((sum of weight × value + 128) / 256), within a byte.
Lanes weighted(const ChannelPredictor& predictor, std::size_t channel, Lines* lines,
               std::uint32_t p, std::uint32_t q) {
  const Lanes* tap[max_taps];
  const Neighbours own = lines[channel].around(p, q);
  std::size_t count = 0;
  for (const Lanes* at : {own.w, own.n, own.nw, own.ne, own.ww, own.nn}) tap[count++] = at;
  for (std::size_t earlier = 0; earlier < channel; ++earlier) {
    const Neighbours cross = lines[earlier].around(p, q);
    tap[count++] = &lines[earlier].at(p, q);
    for (const Lanes* at : {cross.w, cross.n, cross.nw, cross.ne}) tap[count++] = at;
  }
  Vector a{128, 128, 128, 128}, b = a, c = a, d = a;
  for (std::size_t i = 0; i < count; ++i) {
    const float weight = predictor.weights[i];
    const Lanes& values = *tap[i];
    a += weight * values[0];
    b += weight * values[1];
    c += weight * values[2];
    d += weight * values[3];
  }
  const auto to_byte = [](Vector sum) {
    const Vector none{}, most = none + 255.0f;
    return least(greatest(sum * (1.0f / 256), none), most);
  };
  return {to_byte(a), to_byte(b), to_byte(c), to_byte(d)};
}

IntVector load(const std::uint16_t* from) {
  ShortVector values;
  std::memcpy(&values, from, sizeof(values));
  return __builtin_convertvector(values, IntVector);
}

void store(IntVector values, std::uint16_t* to) {
  const ShortVector narrow = __builtin_convertvector(values, ShortVector);
  std::memcpy(to, &narrow, sizeof(narrow));
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
        const std::uint16_t* in = from[channel * columns + column].data();
        std::uint16_t* out = to[channel * columns + column].data();
        Lanes& line = lines[channel].at(p, q);
        for (std::size_t i = 0; i < vector_count; ++i) {
          const IntVector predicted = __builtin_convertvector(guess[i], IntVector);
          IntVector value = load(in + 4 * i);
          if (way == Way::restore) {
            value = (value + predicted) & mask;
            store(value, out + 4 * i);
          } else {
            if (way == Way::predict_covered)
              value = load(coverage[column].data() + 4 * i) == 0 ? predicted : value;
            store((value - predicted) & mask, out + 4 * i);
          }
          line[i] = __builtin_convertvector(value, Vector);
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

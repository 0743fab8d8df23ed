#include "codec/lanes.h"

#include "base/per_thread.h"
#include "base/tile_shape.h"
#include "codec/scratch.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "codec/lanes.cc"
#include <hwy/foreach_target.h>  // compiles this file once per instruction set
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace slf::codec {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

// As many lanes at a time as the processor's vectors hold.
using Floats = hn::CappedTag<float, kLaneCount>;
using Ints = hn::RebindToSigned<Floats>;
using Shorts = hn::Rebind<std::uint16_t, Floats>;
using Vector = hn::Vec<Floats>;

struct alignas(kLaneCount * sizeof(float)) Lanes {
  float of[kLaneCount];
};

// Offsets of a sample and its neighbours in the memory of a channel, with replacements at the
// borders of the picture.
struct Neighbours {
  std::size_t self, w, n, nw, ne, ww, nn;
};

// The last three lines of every channel, and a zero as neighbour of the first sample.
class Lines {
 public:
  explicit Lines(std::uint32_t side) : length_(side + 1), size_(3 * length_ + 1) {
    auto& scratch = per_thread<Scratch<Lanes>>([] {});
    memory_ = scratch.take(kMaxChannels * size_).data();
    for (std::size_t channel = 0; channel < kMaxChannels; ++channel)
      memory_[channel * size_ + nothing()] = {};
  }

  float* at(std::size_t channel, std::size_t place) { return memory_[channel * size_ + place].of; }

  Neighbours around(std::uint32_t p, std::uint32_t q) const {
    const std::size_t line = q % 3 * length_, above = (q + 2) % 3 * length_;
    Neighbours s;
    s.self = line + p;
    s.w = p > 0 ? s.self - 1 : q > 0 ? above : nothing();
    s.n = q > 0 ? above + p : s.w;
    s.nw = p > 0 && q > 0 ? s.n - 1 : s.n;
    s.ne = q > 0 ? s.n + 1 : s.n;  // the line above is longer by one
    s.ww = p > 1 ? s.self - 2 : s.w;
    s.nn = q > 1 ? (q + 1) % 3 * length_ + p : s.n;
    return s;
  }

 private:
  std::size_t nothing() const { return size_ - 1; }

  std::size_t length_, size_;
  Lanes* memory_;
};

// The taps of one sample, from lane `first` on.
struct Taps {
  Lines* lines;
  Neighbours at;
  std::size_t first;

  Vector operator()(std::size_t channel, std::size_t place) const {
    return hn::Load(Floats(), lines->at(channel, place) + first);
  }
};

// JPEG-LS: the median of W, N and W + N - NW.
HWY_INLINE Vector median_edge(std::size_t channel, const Taps& tap) {
  const Vector w = tap(channel, tap.at.w), n = tap(channel, tap.at.n);
  const Vector gradient = hn::Sub(hn::Add(w, n), tap(channel, tap.at.nw));
  return hn::Min(hn::Max(gradient, hn::Min(w, n)), hn::Max(w, n));
}

// floor((sum of weight × value + 128) / 256), clamped to a byte. Sums of integers below 2^24 do not
// depend on the order, so taps that are restored last are added last: only these additions wait.
HWY_INLINE Vector weighted(const float* weights, std::size_t channel, const Taps& tap) {
  const Floats d;
  Vector sum = hn::Set(d, 128);
  const auto add = [&](std::size_t weight, std::size_t of, std::size_t place) {
    sum = hn::MulAdd(hn::Set(d, weights[weight]), tap(of, place), sum);
  };
  const Neighbours& at = tap.at;
  add(1, channel, at.n);
  add(2, channel, at.nw);
  add(3, channel, at.ne);
  add(5, channel, at.nn);
  const auto cross = [](std::size_t earlier) { return kOwnTaps + earlier * kCrossTaps; };
  for (std::size_t earlier = 0; earlier < channel; ++earlier) {
    add(cross(earlier) + 2, earlier, at.n);
    add(cross(earlier) + 3, earlier, at.nw);
    add(cross(earlier) + 4, earlier, at.ne);
  }
  for (std::size_t earlier = 0; earlier < channel; ++earlier) {
    add(cross(earlier) + 1, earlier, at.w);
    add(cross(earlier), earlier, at.self);
  }
  add(4, channel, at.ww);
  add(0, channel, at.w);
  return hn::Min(hn::Max(hn::Mul(sum, hn::Set(d, 1.0f / 256)), hn::Zero(d)), hn::Set(d, 255));
}

enum class Operation { predict, predict_covered, restore };

// Visits a group's samples in the order in which they can be restored.
template <Operation operation>
void walk(const LaneGroup& group, const LaneValues* from, const LaneValues* coverage,
          LaneValues* to) {
  const Ints ints;
  const Shorts shorts;
  const auto load = [&](const LaneValues& values, std::size_t first) {
    return hn::PromoteTo(ints, hn::LoadU(shorts, values.data() + first));
  };
  float weights[kMaxChannels][kMaxTaps] = {};
  for (std::size_t channel = 0; channel < group.channels.size(); ++channel)
    for (std::size_t i = 0; i < kMaxTaps; ++i)
      weights[channel][i] = group.channels[channel].weights[i];
  Lines lines(group.side);
  const std::size_t columns = triangle_size(group.side);
  const auto mask = hn::Set(ints, (1 << group.bits) - 1);

  std::size_t column = 0;
  for (std::uint32_t q = 0; q <= group.side; ++q)
    for (std::uint32_t p = 0; p <= group.side - q; ++p, ++column) {
      Taps tap{&lines, lines.around(p, q), 0};
      for (std::size_t channel = 0; channel < group.channels.size(); ++channel) {
        const std::size_t i = channel * columns + column;
        for (tap.first = 0; tap.first < kLaneCount; tap.first += hn::Lanes(ints)) {
          const auto predicted = hn::ConvertTo(ints, group.channels[channel].linear
                                                         ? weighted(weights[channel], channel, tap)
                                                         : median_edge(channel, tap));
          auto value = load(from[i], tap.first);
          auto result = value;
          if constexpr (operation == Operation::restore) {
            result = value = hn::And(hn::Add(value, predicted), mask);
          } else {
            if constexpr (operation == Operation::predict_covered) {
              const auto covered = load(coverage[column], tap.first);
              value = hn::IfThenElse(hn::Eq(covered, hn::Zero(ints)), predicted, value);
            }
            result = hn::And(hn::Sub(value, predicted), mask);
          }
          hn::StoreU(hn::DemoteTo(shorts, result), shorts, to[i].data() + tap.first);
          hn::Store(hn::ConvertTo(Floats(), value), Floats(),
                    lines.at(channel, tap.at.self) + tap.first);
        }
      }
    }
}

void predict_any(const LaneGroup& group, const LaneValues* values, const LaneValues* coverage,
                 LaneValues* residuals) {
  if (coverage)
    walk<Operation::predict_covered>(group, values, coverage, residuals);
  else
    walk<Operation::predict>(group, values, nullptr, residuals);
}

void restore_any(const LaneGroup& group, const LaneValues* residuals, LaneValues* values) {
  walk<Operation::restore>(group, residuals, nullptr, values);
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace slf::codec
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace slf::codec {

HWY_EXPORT(predict_any);
HWY_EXPORT(restore_any);

void predict(const LaneGroup& group, const LaneValues* values, const LaneValues* coverage,
             LaneValues* residuals) {
  HWY_DYNAMIC_DISPATCH(predict_any)(group, values, coverage, residuals);
}

void restore(const LaneGroup& group, const LaneValues* residuals, LaneValues* values) {
  HWY_DYNAMIC_DISPATCH(restore_any)(group, residuals, values);
}

}  // namespace slf::codec
#endif  // HWY_ONCE

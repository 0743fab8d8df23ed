#include "field/predict/upsample_kernel.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "field/predict/upsample_kernel.cc"
#include <hwy/foreach_target.h>  // compiles this file once per instruction set
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace slf {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

// Two of these vectors are as long as kPadding.
using Bytes = hn::CappedTag<std::uint8_t, 32>;

/// Columns next to each other on a line.
struct Columns {
  hn::Vec<Bytes> alpha, depth;

  static HWY_INLINE Columns load(const std::uint8_t* alpha, const std::uint8_t* depth) {
    return {hn::LoadU(Bytes(), alpha), hn::LoadU(Bytes(), depth)};
  }
  HWY_INLINE Columns mean(const Columns& other) const {
    const auto zero = hn::Zero(Bytes());
    const auto visible =
        hn::IfThenElse(hn::Eq(alpha, zero), other.depth, hn::AverageRound(depth, other.depth));
    return {hn::AverageRound(alpha, other.alpha),
            hn::IfThenElse(hn::Eq(other.alpha, zero), depth, visible)};
  }
  /// Stores these columns and `odd` ones in turn.
  HWY_INLINE void store(const Columns& odd, std::uint8_t* to_alpha, std::uint8_t* to_depth) const {
    hn::StoreInterleaved2(alpha, odd.alpha, Bytes(), to_alpha);
    hn::StoreInterleaved2(depth, odd.depth, Bytes(), to_depth);
  }
};

// Two of these vectors are half as long as kPadding colours.
using Pixels = hn::CappedTag<std::uint32_t, 16>;

/// Colours next to each other on a line.
struct Colors {
  hn::Vec<Pixels> rgba;

  static HWY_INLINE Colors load(const std::uint32_t* from) { return {hn::LoadU(Pixels(), from)}; }
  HWY_INLINE Colors mean(const Colors& other) const {
    const Pixels d;
    // Of each byte, rounded up.
    const auto differ =
        hn::And(hn::ShiftRight<1>(hn::Xor(rgba, other.rgba)), hn::Set(d, 0x7F7F7F7Fu));
    const auto both = hn::Sub(hn::Or(rgba, other.rgba), differ);
    const auto here = seen(rgba), there = seen(other.rgba);
    return {hn::IfThenElse(hn::AndNot(there, here), rgba,
                           hn::IfThenElse(hn::AndNot(here, there), other.rgba, both))};
  }
  /// The colours between these and the next ones of four.
  HWY_INLINE Colors middle(const Colors& next, const Colors& before, const Colors& after) const {
    const Pixels d;
    const hn::RebindToSigned<Pixels> i;
    const auto inner = sums(rgba, next.rgba), outer = sums(before.rgba, after.rgba);
    const auto tap = [&](auto in, auto out) {  // of one channel
      const auto sum = hn::Sub(hn::Mul(in, hn::Set(d, 9)), out);
      const auto value = hn::ShiftRight<4>(hn::BitCast(i, hn::Add(sum, hn::Set(d, 8))));
      return hn::BitCast(d, hn::Min(hn::Max(value, hn::Zero(i)), hn::Set(i, 255)));
    };
    const auto low = hn::Set(d, 0xFFFFu);
    const auto red = tap(hn::And(inner.red_blue, low), hn::And(outer.red_blue, low));
    const auto blue = tap(hn::ShiftRight<16>(inner.red_blue), hn::ShiftRight<16>(outer.red_blue));
    const auto green = tap(inner.green, outer.green);
    const auto all = hn::And(hn::And(rgba, next.rgba), hn::And(before.rgba, after.rgba));
    return {hn::IfThenElse(seen(all),
                           hn::Or3(red, hn::ShiftLeft<8>(green), hn::ShiftLeft<16>(blue)),
                           mean(next).rgba)};
  }
  /// Stores these colours and `odd` ones in turn.
  HWY_INLINE void store(const Colors& odd, std::uint32_t* to) const {
    hn::StoreInterleaved2(rgba, odd.rgba, Pixels(), to);
  }

 private:
  using Vector = hn::Vec<Pixels>;
  struct Sums {
    Vector red_blue, green;
  };

  static HWY_INLINE hn::Mask<Pixels> seen(Vector colors) {
    return hn::Ne(hn::ShiftRight<24>(colors), hn::Zero(Pixels()));
  }
  static HWY_INLINE Sums sums(Vector a, Vector b) {
    const auto two = hn::Set(Pixels(), 0xFF00FFu), one = hn::Set(Pixels(), 0xFFu);
    return {hn::Add(hn::And(a, two), hn::And(b, two)),
            hn::Add(hn::And(hn::ShiftRight<8>(a), one), hn::And(hn::ShiftRight<8>(b), one))};
  }
};

/// Calls even(at, to) for vectors of `lanes` columns of each even line and odd(above, below, to)
/// for those of the line after it. Arguments are columns: of the coarse lines at, above and below,
/// and of the fine line. Lines follow in order, because they overlap what vectors write beyond the
/// end of the line before. Coarse ones are `stride` apart; 0: each begins where the last one ends.
template <class Even, class Odd>
HWY_INLINE void for_each_line(std::uint32_t side, std::size_t stride, std::size_t lanes, Even even,
                              Odd odd) {
  std::size_t at = 0, to = 0;
  for (std::size_t length = side / 2 + 1; length > 0; --length) {
    const std::size_t next = at + (stride > 0 ? stride : length);
    for (std::size_t k = 0; k < length; k += lanes) even(at + k, to + 2 * k);
    to += 2 * length - 1;  // the next line is one shorter
    for (std::size_t k = 0; k + 1 < length; k += lanes) odd(at + k, next + k, to + 2 * k);
    to += 2 * length - 2;
    at = next;
  }
}

void upsample_columns_any(std::uint32_t side, const std::uint8_t* even_alpha,
                          const std::uint8_t* even_depth, std::uint8_t* alpha,
                          std::uint8_t* depth) {
  const auto load = [&](std::size_t at) { return Columns::load(even_alpha + at, even_depth + at); };
  for_each_line(
      side, 0, hn::Lanes(Bytes()),
      [&](std::size_t at, std::size_t to) {
        const Columns here = load(at);
        here.store(here.mean(load(at + 1)), alpha + to, depth + to);
      },
      [&](std::size_t above, std::size_t below, std::size_t to) {
        const Columns next = load(below);
        load(above).mean(next).store(load(above + 1).mean(next), alpha + to, depth + to);
      });
}

template <class Between>
HWY_INLINE void upsample_colors_by(std::uint32_t side, std::uint32_t* colors,
                                   const std::uint32_t* even, Between between) {
  const std::size_t stride = upsample_stride(side);
  const auto load = [&](std::size_t at) { return Colors::load(even + at); };
  for_each_line(
      side, stride, hn::Lanes(Pixels()),
      [&](std::size_t at, std::size_t to) { load(at).store(between(at, 1), colors + to); },
      [&](std::size_t above, std::size_t, std::size_t to) {
        between(above, stride).store(between(above + 1, stride - 1), colors + to);
      });
}

void upsample_colors_any(std::uint32_t side, bool four_taps, const std::uint32_t* even,
                         std::uint32_t* colors) {
  const auto at = [&](std::size_t column) {  // k - step may lie in the padding before `even`
    return Colors::load(even + static_cast<std::ptrdiff_t>(column));
  };
  if (four_taps)
    upsample_colors_by(side, colors, even, [&](std::size_t k, std::size_t step) {
      return at(k).middle(at(k + step), at(k - step), at(k + 2 * step));
    });
  else
    upsample_colors_by(side, colors, even,
                       [&](std::size_t k, std::size_t step) { return at(k).mean(at(k + step)); });
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace slf
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace slf {

HWY_EXPORT(upsample_columns_any);
HWY_EXPORT(upsample_colors_any);

void upsample_columns(std::uint32_t side, const std::uint8_t* even_alpha,
                      const std::uint8_t* even_depth, std::uint8_t* alpha, std::uint8_t* depth) {
  HWY_DYNAMIC_DISPATCH(upsample_columns_any)(side, even_alpha, even_depth, alpha, depth);
}

void upsample_colors(std::uint32_t side, bool four_taps, const std::uint32_t* even,
                     std::uint32_t* colors) {
  HWY_DYNAMIC_DISPATCH(upsample_colors_any)(side, four_taps, even, colors);
}

}  // namespace slf
#endif  // HWY_ONCE

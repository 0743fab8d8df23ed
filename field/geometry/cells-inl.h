// The chain from a point on the sphere to samples, in vectors: the lattice cell that contains the
// point, the cell's exit section, and the columns of the cell's corners in tiles. The same as
// slf::locate() and LevelGeometry::exit_cell(). The kernels that draw and that predict include
// this.
//
// Prediction must compute the same on every machine. So locate_cells() rounds after each operation,
// and all else are whole numbers or halves below 2^23, which floats hold exactly.
// Integers would multiply more slowly.

// Included once per instruction set.
#if defined(SLF_FIELD_GEOMETRY_CELLS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SLF_FIELD_GEOMETRY_CELLS_INL_H_
#undef SLF_FIELD_GEOMETRY_CELLS_INL_H_
#else
#define SLF_FIELD_GEOMETRY_CELLS_INL_H_
#endif

#include <hwy/highway.h>

#include <algorithm>

#include "field/geometry/level_geometry.h"
#include "field/geometry/vectors-inl.h"

HWY_BEFORE_NAMESPACE();
namespace slf {
namespace HWY_NAMESPACE {
namespace {

/// Cells of a lattice, as slf::Cell.
struct Cells {
  VI octant;  ///< times a step
  V x, y;     ///< whole numbers
  hn::Mask<D> inverted;
  V weight[3];
};

/// The sum of the coordinates' magnitudes.
template <class Point>
HWY_INLINE V norm1(const Point& p) {
  return hn::Add(hn::Add(hn::Abs(p.x), hn::Abs(p.y)), hn::Abs(p.z));
}

/// Weights sum to kWhole. If that is more than 1, they are rounded to whole numbers.
/// REQUIRES: points are finite and not zero.
template <int kWhole, class Point>
HWY_INLINE Cells locate_cells(const Point& p, std::int32_t resolution, std::int32_t octant_step) {
  const D d;
  const V zero = hn::Zero(d), one = hn::Set(d, 1.f), whole = hn::Set(d, kWhole);
  const V scale = hn::Div(hn::Set(d, static_cast<float>(resolution)), norm1(p));
  const V x = hn::Mul(hn::Abs(p.x), scale), y = hn::Mul(hn::Abs(p.y), scale);

  // Points on the far edges belong to the last cell, not to one beyond the octsphere.
  Cells cell;
  const V last = hn::Set(d, static_cast<float>(resolution - 1));
  cell.octant = hn::Add(
      hn::Add(flag(hn::Lt(p.x, zero), octant_step), flag(hn::Lt(p.y, zero), 2 * octant_step)),
      flag(hn::Lt(p.z, zero), 4 * octant_step));
  cell.x = hn::Min(hn::Floor(x), last);
  cell.y = hn::Min(hn::Floor(y), hn::Sub(last, cell.x));
  const auto share = [&](V at, V base) {
    const V rest = hn::Min(hn::Sub(at, base), one);
    if constexpr (kWhole == 1) return rest;
    return hn::Floor(hn::Add(hn::Mul(rest, whole), hn::Set(d, 0.5f)));
  };
  const V du = share(x, cell.x), dv = share(y, cell.y);

  // On the last diagonal du + dv exceeds the whole only by rounding: reduce dv.
  const auto diagonal = hn::Eq(hn::Add(cell.x, cell.y), last);
  const V sum = hn::Add(du, dv), rest = hn::Sub(whole, du), v = hn::Min(dv, rest);
  cell.inverted = hn::AndNot(diagonal, hn::Gt(sum, whole));
  cell.weight[0] = hn::IfThenElse(cell.inverted, hn::Sub(sum, whole), hn::Sub(rest, v));
  cell.weight[1] = hn::IfThenElse(cell.inverted, rest, du);
  cell.weight[2] = hn::IfThenElse(cell.inverted, hn::Sub(whole, dv), v);
  return cell;
}

/// The places of exit cells, as LevelGeometry::ExitCell.
struct ExitPlaces {
  VI section;
  V p, q;            ///< local coordinates of the first corner, the one opposite the hypotenuse
  hn::Mask<D> down;  ///< whether the other corners' coordinates are smaller
  V first, third;    ///< columns; the second one is that after the first, or, if `down`, before it
};

/// Finds exit sections and columns at one level. Holds LevelGeometry::exit_paths() in a few vectors
/// if they fit, which saves gathers.
class ExitFinder {
 public:
  explicit ExitFinder(const LevelGeometry& geometry)
      : geometry_(geometry),
        paths_(reinterpret_cast<const std::int32_t*>(geometry.exit_paths().data())),
        vectors_((geometry.exit_paths().size() + kLanes - 1) / kLanes) {
    HWY_ALIGN std::int32_t lanes[kMaxVectors * kLanes] = {};
    if (vectors_ <= kMaxVectors) std::copy_n(paths_, geometry.exit_paths().size(), lanes);
    for (std::size_t v = 0; v < kMaxVectors; ++v) table_[v] = hn::Load(DI(), lanes + v * kLanes);
  }

  /// Cells of the exit lattice that contain the points.
  template <int kWhole, class Point>
  [[nodiscard]] HWY_INLINE Cells cells(const Point& p) const {
    return locate_cells<kWhole>(p, geometry_.exit_resolution(), 1 << 2 * geometry_.level());
  }

  /// The column of local coordinates.
  [[nodiscard]] HWY_INLINE V column(V p, V q) const {
    const D d;
    const V longest = hn::Set(d, static_cast<float>(geometry_.exit_side()) + 1.5f);
    return hn::MulAdd(q, hn::NegMulAdd(q, hn::Set(d, 0.5f), longest), p);
  }

  [[nodiscard]] HWY_INLINE ExitPlaces places(const Cells& cell) const {
    const D d;
    const auto side = static_cast<float>(geometry_.exit_side());
    const V n = hn::Set(d, side), inverse = hn::Set(d, 1 / side);
    const V one = hn::Set(d, 1.f), half = hn::Set(d, 0.5f);
    // Divide by the side: half a cell keeps the quotients away from whole numbers.
    const V sx = hn::Floor(hn::Mul(hn::Add(cell.x, half), inverse));
    const V sy = hn::Floor(hn::Mul(hn::Add(cell.y, half), inverse));
    const V beyond = hn::IfThenElseZero(cell.inverted, one);
    const V p = hn::Add(hn::NegMulAdd(sx, n, cell.x), beyond);
    const V q = hn::Add(hn::NegMulAdd(sy, n, cell.y), beyond);
    const auto inverted = hn::Gt(hn::Sub(hn::Add(p, q), beyond), hn::Sub(n, one));
    const V across = hn::Set(d, static_cast<float>(2u << geometry_.level()));
    const V number =
        hn::Add(hn::MulAdd(sy, across, hn::Add(sx, sx)), hn::IfThenElseZero(inverted, one));
    const V last = hn::Set(d, static_cast<float>(geometry_.last_number()));
    const V place = hn::Min(number, hn::Sub(last, number));

    // In an inverted section local coordinates run backwards.
    ExitPlaces at;
    at.section = hn::Add(cell.octant, section(to_int(place)));
    at.p = hn::IfThenElse(inverted, hn::Sub(n, p), p);
    at.q = hn::IfThenElse(inverted, hn::Sub(n, q), q);
    at.down = hn::Xor(inverted, cell.inverted);
    at.first = column(at.p, at.q);
    const V back = hn::IfThenElseZero(at.down, one);
    const V line = hn::Sub(hn::Add(hn::Add(n, one), back), at.q);  // columns from q to q ± 1
    at.third = hn::IfThenElse(at.down, hn::Sub(at.first, line), hn::Add(at.first, line));
    return at;
  }

 private:
  static constexpr std::size_t kLanes = hn::MaxLanes(DI()), kMaxVectors = 4;

  [[nodiscard]] HWY_INLINE VI section(VI place) const {
    // One lane holds no table, and to check its index needs Highway's library, which builds that
    // only decode (tests/portable) do not link.
    if constexpr (kLanes > 1) {
      if (vectors_ <= kMaxVectors) {
        const auto set = [](std::size_t n) { return hn::Set(DI(), static_cast<std::int32_t>(n)); };
        const auto lane = hn::IndicesFromVec(DI(), hn::And(place, set(kLanes - 1)));
        VI found = hn::TableLookupLanes(table_[0], lane);
        for (std::size_t v = 1; v < vectors_; ++v)
          found = hn::IfThenElse(hn::Lt(place, set(v * kLanes)), found,
                                 hn::TableLookupLanes(table_[v], lane));
        return found;
      }
    }
    return hn::GatherIndex(DI(), paths_, place);
  }

  const LevelGeometry& geometry_;
  const std::int32_t* paths_;
  std::size_t vectors_;
  VI table_[kMaxVectors];
};

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace slf
HWY_AFTER_NAMESPACE();

#endif  // include guard

// visit_voxels: a volume's voxels as a span of their own type.
#pragma once

#include <algorithm>
#include <cmath>
#include <span>
#include <type_traits>

#include "slf/volume.h"

namespace slf {

namespace detail {

template <class T, class Visitor>
decltype(auto) visit_as(const Volume& volume, Visitor&& visitor) {
  const auto bytes = volume.bytes();
  return visitor(
      std::span<const T>(reinterpret_cast<const T*>(bytes.data()), bytes.size() / sizeof(T)));
}

}  // namespace detail

/// Calls `visitor` with a std::span<const T> of the stored voxels (before slope and intercept),
/// and returns what it returns:
/// `visit_voxels(volume, [](auto voxels) { return double(voxels.front()); })`
/// The span lives as long as the volume is not changed.
template <class Visitor>
decltype(auto) visit_voxels(const Volume& volume, Visitor&& visitor) {
  switch (volume.type) {
    case ScalarType::u8:
      return detail::visit_as<std::uint8_t>(volume, visitor);
    case ScalarType::i8:
      return detail::visit_as<std::int8_t>(volume, visitor);
    case ScalarType::u16:
      return detail::visit_as<std::uint16_t>(volume, visitor);
    case ScalarType::i16:
      return detail::visit_as<std::int16_t>(volume, visitor);
    case ScalarType::u32:
      return detail::visit_as<std::uint32_t>(volume, visitor);
    case ScalarType::i32:
      return detail::visit_as<std::int32_t>(volume, visitor);
    case ScalarType::u64:
      return detail::visit_as<std::uint64_t>(volume, visitor);
    case ScalarType::i64:
      return detail::visit_as<std::int64_t>(volume, visitor);
    case ScalarType::f32:
      return detail::visit_as<float>(volume, visitor);
    case ScalarType::f64:
      break;
  }
  return detail::visit_as<double>(volume, visitor);
}

/// False if all values are NaN or infinite: there is nothing to draw.
[[nodiscard]] inline bool has_finite_value(const Volume& volume) {
  return visit_voxels(volume, [](auto voxels) {
    using T = typename decltype(voxels)::value_type;
    if constexpr (std::is_floating_point_v<T>)
      return std::any_of(voxels.begin(), voxels.end(), [](T v) { return std::isfinite(v); });
    else
      return !voxels.empty();
  });
}

}  // namespace slf

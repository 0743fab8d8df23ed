// Voxels as what they are: their type, and spans of it.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <glm/glm.hpp>
#include <span>
#include <type_traits>

#include "slf/volume.h"

namespace slf {

/// The number of a place in a grid of these dimensions, x fastest.
[[nodiscard]] inline std::size_t number_in(const std::array<std::int32_t, 3>& dims,
                                           const glm::ivec3& at) {
  return (static_cast<std::size_t>(at.z) * dims[1] + at.y) * dims[0] + at.x;
}

/// Calls `visitor` with a zero of the C++ type that this is, and returns what it returns:
/// `with_type(type, []<class T>(T) { return sizeof(T); })`
template <class Visitor>
decltype(auto) with_type(ScalarType type, Visitor&& visitor) {
  switch (type) {
    case ScalarType::u8:
      return visitor(std::uint8_t{});
    case ScalarType::i8:
      return visitor(std::int8_t{});
    case ScalarType::u16:
      return visitor(std::uint16_t{});
    case ScalarType::i16:
      return visitor(std::int16_t{});
    case ScalarType::u32:
      return visitor(std::uint32_t{});
    case ScalarType::i32:
      return visitor(std::int32_t{});
    case ScalarType::u64:
      return visitor(std::uint64_t{});
    case ScalarType::i64:
      return visitor(std::int64_t{});
    case ScalarType::f32:
      return visitor(float{});
    case ScalarType::f64:
      break;
  }
  return visitor(double{});
}

/// Calls `visitor` with a std::span<const T> of the stored voxels (before slope and intercept),
/// and returns what it returns:
/// `visit_voxels(volume, [](auto voxels) { return double(voxels.front()); })`
/// The span lives as long as the volume is not changed.
template <class Visitor>
decltype(auto) visit_voxels(const Volume& volume, Visitor&& visitor) {
  return with_type(volume.type, [&]<class T>(T) -> decltype(auto) {
    const auto bytes = volume.bytes();
    return visitor(
        std::span<const T>(reinterpret_cast<const T*>(bytes.data()), bytes.size() / sizeof(T)));
  });
}

/// False if all values are NaN or infinite: there is nothing to draw.
[[nodiscard]] inline bool has_finite_value(const Volume& volume) {
  return visit_voxels(volume, [](auto voxels) {
    using T = typename decltype(voxels)::value_type;
    if constexpr (std::is_floating_point_v<T>)
      return std::ranges::any_of(voxels, [](T v) { return std::isfinite(v); });
    else
      return !voxels.empty();
  });
}

}  // namespace slf

// Numbers at fixed places of a binary header.
#pragma once

#include <bit>
#include <cstdint>
#include <string_view>
#include <type_traits>

#include "base/bytes.h"
#include "source/volume/voxels.h"

namespace slf::volume_io {

/// A header, in the file's own byte order.
struct Fields {
  std::string_view bytes;
  bool big_endian;

  /// REQUIRES: at + sizeof(T) <= bytes.size().
  template <class T>
  T get(std::size_t at) const {
    using Bits = std::conditional_t<
        sizeof(T) == 1, std::uint8_t,
        std::conditional_t<sizeof(T) == 2, std::uint16_t,
                           std::conditional_t<sizeof(T) == 4, std::uint32_t, std::uint64_t>>>;
    const auto* from = reinterpret_cast<const std::byte*>(bytes.data()) + at;
    return std::bit_cast<T>(big_endian ? load_be<Bits>(from) : load_le<Bits>(from));
  }
  /// A number of this type. REQUIRES: as get().
  [[nodiscard]] double number(ScalarType type, std::size_t at) const {
    return with_type(type, [&]<class T>(T) { return static_cast<double>(get<T>(at)); });
  }
};

}  // namespace slf::volume_io

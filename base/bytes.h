// Little- and big-endian integers in byte buffers, encoded byte by byte, never by a struct cast.
#pragma once

#include <bit>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <string_view>
#include <vector>

namespace slf {

using ByteSpan = std::span<const std::byte>;
using Bytes = std::vector<std::byte>;

/// The characters of a text.
[[nodiscard]] inline ByteSpan bytes_of(std::string_view text) {
  return std::as_bytes(std::span(text.data(), text.size()));
}
/// The same bytes as text.
[[nodiscard]] inline std::string_view chars_of(ByteSpan bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

/// Reads an unsigned integer stored least significant byte first.
/// REQUIRES: sizeof(T) readable bytes at `from`, at any alignment.
template <std::unsigned_integral T>
[[nodiscard]] T load_le(const std::byte* from) {
  T value = 0;
  for (std::size_t i = 0; i < sizeof(T); ++i)
    value = static_cast<T>(value | (static_cast<T>(from[i]) << (8 * i)));
  return value;
}

/// Writes an unsigned integer least significant byte first.
/// REQUIRES: sizeof(T) writable bytes at `to`, at any alignment.
template <std::unsigned_integral T>
void store_le(std::byte* to, T value) {
  for (std::size_t i = 0; i < sizeof(T); ++i) to[i] = static_cast<std::byte>(value >> (8 * i));
}

/// Reads an unsigned integer stored most significant byte first (as in keys, so that they sort as
/// bytes). REQUIRES: as load_le().
template <std::unsigned_integral T>
[[nodiscard]] T load_be(const std::byte* from) {
  T value = 0;
  for (std::size_t i = 0; i < sizeof(T); ++i)
    value = static_cast<T>((value << 8 * (sizeof(T) > 1)) | static_cast<T>(from[i]));
  return value;
}

/// Writes an unsigned integer most significant byte first. REQUIRES: as store_le().
template <std::unsigned_integral T>
void store_be(std::byte* to, T value) {
  for (std::size_t i = 0; i < sizeof(T); ++i)
    to[i] = static_cast<std::byte>(value >> (8 * (sizeof(T) - 1 - i)));
}

template <std::unsigned_integral T>
void append_le(Bytes& to, T value) {
  to.resize(to.size() + sizeof(T));
  store_le(to.data() + to.size() - sizeof(T), value);
}

}  // namespace slf

// ContentHash: the hash of what a source holds, as provenance records it.
#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <string>

namespace slf {

/// XXH3 of all bytes added, 128 bits.
class ContentHash {
 public:
  ContentHash();

  void add(std::span<const std::byte> bytes);

  /// "xxh3-128:" and 32 hexadecimal digits.
  [[nodiscard]] std::string text() const;

 private:
  std::unique_ptr<void, void (*)(void*)> state_;  // of xxhash
};

}  // namespace slf

// The hash of what a source holds, as provenance records it.
#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <string>

#include "slf/volume.h"

struct XXH3_state_s;

namespace slf {

/// XXH3 of all bytes added, 128 bits.
class ContentHash {
 public:
  ContentHash();

  void add(std::span<const std::byte> bytes);

  /// "xxh3-128:" and 32 hexadecimal digits.
  [[nodiscard]] std::string text() const;

 private:
  std::unique_ptr<XXH3_state_s, void (*)(XXH3_state_s*)> state_;
};

/// The text() of the voxels, their geometry, scale and type. Equal volumes have equal hashes,
/// whatever file they were read from.
[[nodiscard]] std::string content_hash(const Volume& volume);

}  // namespace slf

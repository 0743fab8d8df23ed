#include "field/volume/content_hash.h"

#include <xxhash.h>

#include <locale>
#include <sstream>

#include "base/bytes.h"

namespace slf {
namespace {

/// Dimensions, geometry, scale and type as text. Each number has exactly one representation.
std::string metadata_text(const Volume& v) {
  std::ostringstream text;
  text.imbue(std::locale::classic());
  text << std::hexfloat << name(v.type) << ' ' << v.labels << ' ' << v.slope << ' ' << v.intercept;
  for (int axis = 0; axis < 3; ++axis) {
    text << ' ' << v.dims[static_cast<std::size_t>(axis)] << ' ' << v.origin[axis];
    for (int c = 0; c < 3; ++c) text << ' ' << v.axes[axis][c];
  }
  return text.str();
}

}  // namespace

ContentHash::ContentHash()
    : state_(XXH3_createState(), [](auto* state) { XXH3_freeState(state); }) {
  XXH3_128bits_reset(state_.get());
}

void ContentHash::add(std::span<const std::byte> bytes) {
  XXH3_128bits_update(state_.get(), bytes.data(), bytes.size());
}

std::string ContentHash::text() const {
  XXH128_canonical_t canonical;
  XXH128_canonicalFromHash(&canonical, XXH3_128bits_digest(state_.get()));
  std::string text = "xxh3-128:";
  for (const unsigned char byte : canonical.digest) {
    text += "0123456789abcdef"[byte >> 4];
    text += "0123456789abcdef"[byte & 15];
  }
  return text;
}

std::string content_hash(const Volume& volume) {
  ContentHash hash;
  const std::string head = metadata_text(volume);
  hash.add(bytes_of(head));
  hash.add(volume.bytes());
  return hash.text();
}

}  // namespace slf

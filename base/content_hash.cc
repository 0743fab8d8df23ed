#include "base/content_hash.h"

#include <xxhash.h>

namespace slf {
namespace {

auto* hash(void* state) { return static_cast<XXH3_state_t*>(state); }

}  // namespace

ContentHash::ContentHash() : state_(XXH3_createState(), [](void* s) { XXH3_freeState(hash(s)); }) {
  XXH3_128bits_reset(hash(state_.get()));
}

void ContentHash::add(std::span<const std::byte> bytes) {
  XXH3_128bits_update(hash(state_.get()), bytes.data(), bytes.size());
}

std::string ContentHash::text() const {
  XXH128_canonical_t canonical;
  XXH128_canonicalFromHash(&canonical, XXH3_128bits_digest(hash(state_.get())));
  std::string text = "xxh3-128:";
  for (const unsigned char byte : canonical.digest) {
    text += "0123456789abcdef"[byte >> 4];
    text += "0123456789abcdef"[byte & 15];
  }
  return text;
}

}  // namespace slf

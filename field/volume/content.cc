#include "field/volume/content.h"

#include <xxhash.h>

#include <locale>
#include <memory>
#include <sstream>

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

std::string content_hash(const Volume& volume) {
  const std::unique_ptr<XXH3_state_t, XXH_errorcode (*)(XXH3_state_t*)> state(XXH3_createState(),
                                                                              XXH3_freeState);
  const std::string head = metadata_text(volume);
  XXH3_128bits_reset(state.get());
  XXH3_128bits_update(state.get(), head.data(), head.size());
  XXH3_128bits_update(state.get(), volume.bytes().data(), volume.bytes().size());
  XXH128_canonical_t canonical;
  XXH128_canonicalFromHash(&canonical, XXH3_128bits_digest(state.get()));
  std::string hash = "xxh3-128:";
  for (const unsigned char byte : canonical.digest) {
    hash += "0123456789abcdef"[byte >> 4];
    hash += "0123456789abcdef"[byte & 15];
  }
  return hash;
}

}  // namespace slf

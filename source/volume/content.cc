#include "source/volume/content.h"

#include <locale>
#include <sstream>

#include "base/bytes.h"
#include "base/content_hash.h"

namespace slf {
namespace {

/// Dimensions, geometry, scale and type as text. Each number has exactly one representation.
std::string metadata_text(const Volume& v) {
  std::ostringstream text;
  text.exceptions(std::ios::badbit);  // out of memory
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
  ContentHash hash;
  const std::string head = metadata_text(volume);
  hash.add(bytes_of(head));
  hash.add(volume.bytes());
  return hash.text();
}

}  // namespace slf

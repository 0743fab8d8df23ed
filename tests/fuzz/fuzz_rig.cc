// Light rigs from any bytes: an error that names the source, or finite numbers that survive a round
// trip through JSON.
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <string>

#include "source/light/light_rig.h"

namespace {

void require(bool condition) {
  if (!condition) std::abort();
}

template <class Vector>
void check_finite(const Vector& v) {
  for (int i = 0; i < 3; ++i) require(std::isfinite(v[i]));
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string text(reinterpret_cast<const char*>(data), size);
  const auto rig = slf::parse_rig(text, "input");
  if (!rig) {
    require(rig.error().message.starts_with("input"));
    return 0;
  }
  for (const slf::Light& light : rig->lights) {
    check_finite(light.direction);
    check_finite(light.color);
    require(std::isfinite(light.intensity) && std::isfinite(light.size) &&
            std::isfinite(light.distance));
  }
  check_finite(rig->sky.up);
  check_finite(rig->sky.horizon);
  check_finite(rig->sky.down);
  const auto again = slf::parse_rig(slf::to_json(*rig), "again");
  require(again.has_value() && slf::to_json(*again) == slf::to_json(*rig));
  return 0;
}

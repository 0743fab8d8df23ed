// Transfer functions from any bytes, in all formats: an error with a message, or presets that fit
// volumes, can be evaluated everywhere and survive a round trip.
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <string>
#include <vector>

#include "slf/transfer.h"
#include "slf/volume.h"

namespace {

void require(bool condition) {
  if (!condition) std::abort();
}

void check_values(const slf::TransferFunction& transfer) {
  for (const auto& point : transfer.opacities)
    for (const double value : {point.value, std::nextafter(point.value, 1e308), 0.0, 1e300}) {
      const auto rgba = transfer(value);
      for (int i = 0; i < 4; ++i) require(rgba[i] >= 0 && rgba[i] <= 1);
    }
  for (const auto& point : transfer.colors) {
    const auto rgba = transfer(std::nextafter(point.value, 1e308));
    for (int i = 0; i < 4; ++i) require(rgba[i] >= 0 && rgba[i] <= 1);
  }
}

}  // namespace

namespace {

slf::Volume volume_of(bool labels, float factor) {
  slf::Volume volume;
  volume.dims = {4, 2, 2};
  volume.type = slf::ScalarType::f32;
  volume.labels = labels;
  for (int i = 0; i < 16; ++i) {
    const float value = labels ? static_cast<float>(i / 3) : factor * static_cast<float>(i - 5);
    const auto* bytes = reinterpret_cast<const std::byte*>(&value);
    volume.voxels.insert(volume.voxels.end(), bytes, bytes + sizeof value);
  }
  return volume;
}

void check(const slf::TransferFunction& transfer) {
  require(!transfer.colors.empty() && !transfer.opacities.empty());
  require(transfer.unit_distance > 0);
  check_values(transfer);
  const auto again = slf::parse_transfer(slf::to_json(transfer), "again");
  require(again.has_value() && slf::to_json(*again) == slf::to_json(transfer));
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string text(reinterpret_cast<const char*>(data), size);
  if (const auto transfer = slf::parse_transfer(text, "input"))
    check(*transfer);
  else
    require(transfer.error().message.starts_with("input"));
  const auto presets = slf::parse_transfers(text, "input");
  if (!presets) {
    require(presets.error().message.starts_with("input"));
    return 0;
  }
  static const std::vector<slf::Volume> kVolumes = {volume_of(false, 100), volume_of(true, 1)};
  for (const auto& preset : *presets) {
    check(preset.function);
    for (const auto& volume : kVolumes) {
      check(preset.fit(volume));
      check(preset.fit(volume, std::array<double, 2>{-3, 8}));
    }
  }
  return 0;
}

// Volumes and colour maps for tests of transfer functions.
#pragma once

#include <gtest/gtest.h>

#include <cstring>
#include <string>
#include <vector>

#include "slf/transfer.h"
#include "slf/volume.h"
#include "source/transfer/transfer_formats.h"

namespace slf::samples {

template <class T>
Volume volume_of(ScalarType type, const std::vector<T>& values, std::uint32_t width = 0) {
  Volume volume;
  const auto columns = width ? width : static_cast<std::uint32_t>(values.size() / 4);
  volume.dims = {columns, 2, static_cast<std::uint32_t>(values.size() / columns / 2)};
  volume.type = type;
  volume.voxels.resize(values.size() * sizeof(T));
  std::memcpy(volume.voxels.data(), values.data(), volume.voxels.size());
  return volume;
}

/// 0 to 1000, half of it background.
inline Volume ramp_volume() {
  std::vector<std::int16_t> values(4000, 0);
  for (std::size_t i = 2000; i < 4000; ++i) values[i] = static_cast<std::int16_t>(i - 1999) / 2 + 1;
  values.back() = 1000;
  for (std::size_t i = 3900; i < 4000; ++i) values[i] = 1000;
  return volume_of(ScalarType::i16, values);
}

inline TransferPreset parse(const std::string& text, const std::string& source = "map.json") {
  auto presets = parse_transfers(text, source);
  EXPECT_TRUE(presets) << (presets ? "" : presets.error().message);
  return presets ? presets->front() : TransferPreset{};
}

inline constexpr const char* kMap =
    R"({"Name": "Map", "ColorSpace": "RGB", "RGBPoints": [-1, 0, 0, 1, 1, 1, 0, 0]})";

}  // namespace slf::samples

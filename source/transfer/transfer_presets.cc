// The built-in presets. Those for CT are in Hounsfield units, opacity per millimetre; the others
// are relative, 0 to 1, opacity per voxel.
#include <vector>

#include "slf/transfer.h"

namespace slf {

namespace {

struct Point {
  double value;
  unsigned color;  ///< 0xRRGGBB
  double opacity;
};

TransferPreset make(const char* name, TransferPreset::Values values, const char* description,
                    const std::vector<Point>& points) {
  TransferPreset preset;
  preset.function.name = name;
  preset.description = description;
  preset.values = values;
  preset.has_unit_distance = values == TransferPreset::Values::absolute;
  // fit() stretches from the first point to the last, so there must be a point at 0.
  std::vector<Point> all = points;
  if (values == TransferPreset::Values::relative && points.front().value > 0)
    all.insert(all.begin(), {0, points.front().color, 0});
  for (const auto& [value, color, opacity] : all) {
    const auto channel = [c = color](int shift) { return (c >> shift & 0xff) / 255.0; };
    preset.function.colors.push_back({value, {channel(16), channel(8), channel(0)}});
    preset.function.opacities.push_back({value, opacity, 0.5, 0});
  }
  return preset;
}

std::vector<TransferPreset> make_all() {
  constexpr auto kHounsfield = TransferPreset::Values::absolute;
  constexpr auto kRelative = TransferPreset::Values::relative;
  return {
      // clang-format off
      make("ct-bone", kHounsfield, "CT: bone alone",
           {{150, 0x8c4a32, 0}, {230, 0xb4764f, 0.06}, {350, 0xdcb58c, 0.3}, {600, 0xf2e4c8, 0.6},
            {1500, 0xfffaf0, 0.85}, {3000, 0xffffff, 0.9}}),
      make("ct-skin", kHounsfield, "CT: the surface of the body, opaque",
           {{-500, 0xb07a60, 0}, {-350, 0xd09a7c, 0.25}, {-150, 0xe6b496, 0.7},
            {60, 0xf0c4a8, 0.85}, {300, 0xf6dcc4, 0.9}, {1500, 0xfff6ea, 0.95}}),
      make("ct-skin-bone", kHounsfield, "CT: bone within translucent skin",
           {{-500, 0xc88c70, 0}, {-350, 0xd89c80, 0.03}, {-200, 0xe0a88c, 0.022},
            {-50, 0xd8947a, 0.006}, {130, 0xc4785c, 0.006}, {220, 0xd8a680, 0.06},
            {380, 0xf0dcb8, 0.35}, {700, 0xfff4e0, 0.7}, {3000, 0xffffff, 0.9}}),
      make("ct-muscle", kHounsfield, "CT: muscle and organs, bone beneath, no skin or fat",
           {{-20, 0x5a1410, 0}, {25, 0x8e2a20, 0.12}, {60, 0xb4483a, 0.32}, {110, 0xcc6a50, 0.36},
            {180, 0xdca078, 0.42}, {350, 0xf2e0c0, 0.7}, {1500, 0xffffff, 0.9}}),
      make("ct-vessels", kHounsfield, "CT with contrast: vessels and bone, soft tissue faint",
           {{90, 0x5c1010, 0}, {140, 0x9c1a14, 0.03}, {200, 0xd03020, 0.22}, {300, 0xe8684c, 0.45},
            {420, 0xf4c8a0, 0.55}, {700, 0xfff6e6, 0.75}, {3000, 0xffffff, 0.9}}),
      make("ct-lung", kHounsfield, "CT: lungs and airways, the body as haze",
           {{-980, 0x203040, 0}, {-930, 0x3c5870, 0.012}, {-860, 0x6a90a8, 0.025},
            {-740, 0x9cc0cc, 0.015}, {-640, 0xd89890, 0.06}, {-450, 0xe07868, 0.02},
            {-200, 0xc89078, 0.003}, {100, 0xd8a088, 0.003}, {400, 0xf4e8d0, 0.05},
            {1500, 0xffffff, 0.15}}),
      make("mr-brain", kRelative, "MR, skull removed: the cortex, opaque",
           {{0.2, 0x6a3226, 0}, {0.28, 0x96523e, 0.1}, {0.38, 0xc07a5c, 0.45}, {0.5, 0xdea482, 0.7},
            {0.7, 0xf4d4b0, 0.85}, {1, 0xfff6e4, 0.9}}),
      make("mr-head", kRelative, "MR: the head, skin translucent over brighter tissue",
           {{0.19, 0x6a4030, 0}, {0.25, 0xb07c64, 0.05}, {0.34, 0xcc947a, 0.14},
            {0.46, 0xe0b094, 0.3}, {0.65, 0xf0d0b4, 0.5}, {1, 0xfff4e4, 0.75}}),
      make("mr-angio", kRelative, "MR angiography: vessels in the brightest values",
           {{0.35, 0x3c0808, 0}, {0.5, 0x8c1410, 0.05}, {0.65, 0xc82c1c, 0.3}, {0.8, 0xec6c40, 0.6},
            {1, 0xffd8a8, 0.9}}),
      make("pet", kRelative, "PET: the body as haze, uptake hot",
           {{0.004, 0x20203c, 0}, {0.02, 0x383868, 0.008}, {0.06, 0x603880, 0.02},
            {0.15, 0xa83468, 0.06}, {0.35, 0xe85c30, 0.3}, {0.65, 0xfcac38, 0.7},
            {1, 0xfffce0, 0.95}}),
      make("cryo-em", kRelative, "Cryo-EM density: the molecule's surface above the noise",
           {{0.4, 0x24507c, 0}, {0.48, 0x3c78a4, 0.15}, {0.58, 0x6cacc4, 0.5},
            {0.75, 0xc4dcd4, 0.8}, {1, 0xfff8e8, 0.95}}),
      make("micro-ct", kRelative, "Industrial and micro-CT: material translucent, dense parts opaque",
           {{0.4, 0x5c6c7c, 0}, {0.48, 0x7c90a0, 0.02}, {0.6, 0x9cb0bc, 0.04},
            {0.68, 0xc4a878, 0.08}, {0.78, 0xe8a848, 0.5}, {1, 0xffe8b0, 0.9}}),
      make("fluorescence", kRelative, "Fluorescence microscopy: bright structures glow green",
           {{0.08, 0x001c10, 0}, {0.2, 0x005c38, 0.02}, {0.4, 0x18a858, 0.1}, {0.7, 0x7cec7c, 0.4},
            {1, 0xf4fff0, 0.85}}),
      make("flame", kRelative, "Simulations: a scalar from faint blue to bright yellow",
           {{0.02, 0x101848, 0}, {0.12, 0x283c9c, 0.01}, {0.3, 0x8c2c8c, 0.03},
            {0.5, 0xdc4038, 0.1}, {0.75, 0xfc9c28, 0.35}, {1, 0xfffcc8, 0.8}}),
      make("statistics", kRelative, "Signed maps: below 0 blue to cyan, above 0 red to yellow, 0 clear",
           {{-1, 0x98f8ff, 0.95}, {-0.5, 0x1a80f2, 0.24}, {-0.15, 0x1e2e98, 0.02}, {0, 0x1e2e98, 0},
            {0, 0x8c1a14, 0}, {0.15, 0x8c1a14, 0.02}, {0.5, 0xf5661a, 0.24}, {1, 0xfff280, 0.95}}),
      // clang-format on
  };
}

}  // namespace

std::span<const TransferPreset> built_in_transfers() {
  static const std::vector<TransferPreset> kPresets = make_all();
  return kPresets;
}

}  // namespace slf

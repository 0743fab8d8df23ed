// Analytic scenes: worlds whose every ray is known in closed form. For exact tests, and for huge
// fields that build as fast as they encode.
#pragma once

#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "slf/error.h"
#include "slf/scene.h"

namespace slf {

/// The scenes there are:
///   balls    opaque, textured, shaded spheres of several sizes
///   globe    one finely textured opaque sphere that fills most of the bounds
///   fog      overlapping translucent balls: opacity 1 - exp(-density × path)
[[nodiscard]] std::vector<std::string> analytic_scene_names();

/// usage: unknown name; the message lists the known ones.
[[nodiscard]] Result<std::unique_ptr<Scene>> make_analytic_scene(std::string_view name);

}  // namespace slf

// The formats of transfer functions, one per source file. `source` names the file in messages.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "slf/transfer.h"

namespace slf::transfer_formats {

using Presets = Result<std::vector<TransferPreset>>;

/// ParaView's preset JSON, or 3D Slicer's volume properties in JSON (.vp.json).
[[nodiscard]] Presets parse_json(const std::string& text, const std::string& source);

/// 3D Slicer's volume property as lines of numbers (.vp).
[[nodiscard]] bool looks_like_vp(std::string_view text);
[[nodiscard]] Presets parse_vp(std::string_view text, const std::string& source);

/// MRIcroGL's colour table (.clut).
[[nodiscard]] bool looks_like_clut(std::string_view text);
[[nodiscard]] Presets parse_clut(std::string_view text, const std::string& source);

/// Opacities that rise from 0 to 0.95, quadratically, so that low values stay faint.
[[nodiscard]] std::vector<TransferFunction::OpacityPoint> opacity_ramp(double from, double to);

/// The least and greatest value of the points of colour and, if has_opacity, of opacity.
[[nodiscard]] std::array<double, 2> extent(const TransferPreset& preset);

}  // namespace slf::transfer_formats

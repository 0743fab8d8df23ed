// The formats of transfer functions, one a file. `source` names the file in messages.
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

/// A rise from 0 to 0.95, as the square of the way: faint low, firm high.
[[nodiscard]] std::vector<TransferFunction::OpacityPoint> opacity_ramp(double from, double to);

/// Least and greatest value among the points, colours and, where they are its own, opacities.
[[nodiscard]] std::array<double, 2> extent(const TransferPreset& preset);

}  // namespace slf::transfer_formats

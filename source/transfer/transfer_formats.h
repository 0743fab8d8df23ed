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

/// The colour space that ParaView calls so, in any case. unsupported: unknown. `place` begins the
/// message.
[[nodiscard]] Result<TransferFunction::Space> parse_space(std::string_view name,
                                                          const std::string& place);

/// A colour map of categories, whose values are 0, 1, 2, …, or `values` if there is one for each
/// and they ascend.
[[nodiscard]] TransferPreset indexed_preset(const std::vector<glm::dvec3>& colors,
                                            const std::vector<std::optional<double>>& values);

/// 3D Slicer's volume property as lines of numbers (.vp).
[[nodiscard]] bool looks_like_vp(std::string_view text);
[[nodiscard]] Presets parse_vp(std::string_view text, const std::string& source);

/// The opacities and colours of one of 3D Slicer's volume properties: each a count of numbers, then
/// value and opacity, or value, red, green and blue, of each point.
[[nodiscard]] Result<TransferPreset> points_of(std::string_view opacities,
                                               const std::string& place_of_opacities,
                                               std::string_view colors,
                                               const std::string& place_of_colors);

/// XML: ParaView's colour maps (one or more ColorMap), or the volume properties of 3D Slicer's
/// presets.xml and scenes (.mrml).
[[nodiscard]] bool looks_like_xml(std::string_view text);
[[nodiscard]] Presets parse_xml(std::string_view text, const std::string& source);

/// MRIcroGL's colour table (.clut).
[[nodiscard]] bool looks_like_clut(std::string_view text);
[[nodiscard]] Presets parse_clut(std::string_view text, const std::string& source);

/// Opacities that rise from 0 to 0.95, quadratically, so that low values stay faint.
[[nodiscard]] std::vector<TransferFunction::OpacityPoint> opacity_ramp(double from, double to);

/// The least and greatest value of the points of colour and, if has_opacity, of opacity.
[[nodiscard]] std::array<double, 2> extent(const TransferPreset& preset);

}  // namespace slf::transfer_formats

// XML: ParaView's colour maps, and 3D Slicer's volume properties as in its presets.xml.
#include <algorithm>
#include <cmath>
#include <optional>

#include "base/try.h"
#include "base/xml.h"
#include "source/transfer/transfer_formats.h"
#include "source/volume/io.h"

namespace slf::transfer_formats {

namespace {

using volume_io::in_quotes;

/// Point `number` of a ColorMap. Of categories, only the colour counts.
Result<TransferFunction::ColorPoint> read_point(const pugi::xml_node& element, bool indexed,
                                                std::size_t number, const std::string& place) {
  TransferFunction::ColorPoint point{0, {}};
  for (const auto& [name, to] : {std::pair{"x", &point.value},
                                 {"r", &point.rgb.r},
                                 {"g", &point.rgb.g},
                                 {"b", &point.rgb.b}}) {
    const bool channel = to != &point.value;
    if (!channel && indexed) continue;
    const std::string text = attribute(element, name);
    const auto value = volume_io::parse_number(text);
    if (!value || !std::isfinite(*value) || (channel && !(*value >= 0 && *value <= 1)))
      return bad_file(place, "Point ", number, ": ", name, " is ", in_quotes(text), ", expected ",
                      channel ? "0 to 1" : "a number");
    *to = *value;
  }
  return point;
}

/// A ColorMap. As in ParaView, its points need not ascend, and their opacities ("o") do not count.
Result<TransferPreset> read_color_map(const pugi::xml_node& map, const std::string& place) {
  const std::string categories = lower_case(attribute(map, "indexedLookup")),
                    space = attribute(map, "space");
  const bool indexed = categories == "true" || categories == "1";
  std::vector<TransferFunction::ColorPoint> points;
  std::vector<std::optional<double>> annotations;
  for (const pugi::xml_node& element : elements_of(map)) {
    if (name_of(element) == "Annotation") {
      annotations.push_back(volume_io::parse_number(attribute(element, "v")));
    } else if (name_of(element) == "Point") {
      const auto point = SLF_TRY(read_point(element, indexed, points.size() + 1, place));
      points.push_back(point);
    }
  }
  if (points.empty())
    return bad_file(place, R"(expected <Point x="..." r="..." g="..." b="..."/>)");
  TransferPreset preset;
  if (indexed) {
    std::vector<glm::dvec3> colors(points.size());
    for (std::size_t k = 0; k < colors.size(); ++k) colors[k] = points[k].rgb;
    preset = indexed_preset(colors, annotations);
  } else {
    // Hues that wrap around are those of HSV here: it always goes the shorter way.
    const bool wrapped = lower_case(space) == "wrapped";
    preset.function.space =
        SLF_TRY(space.empty() ? TransferFunction::Space::rgb
                              : parse_space(wrapped ? "HSV" : space, place + ": space"));
    std::ranges::stable_sort(points, {}, &TransferFunction::ColorPoint::value);
    preset.function.colors = std::move(points);
  }
  preset.has_opacity = preset.has_unit_distance = false;
  const auto& colors = preset.function.colors;
  preset.function.opacities = opacity_ramp(colors.front().value, colors.back().value);
  return preset;
}

Result<TransferPreset> read_volume_property(const pugi::xml_node& property,
                                            const std::string& place) {
  return points_of(attribute(property, "scalarOpacity"), place + ": scalarOpacity",
                   attribute(property, "colorTransfer"), place + ": colorTransfer");
}

}  // namespace

bool looks_like_xml(std::string_view text) { return trim(text).starts_with('<'); }

Presets parse_xml(std::string_view text, const std::string& source) {
  const auto xml = SLF_TRY(slf::parse_xml(text, source));
  std::vector<TransferPreset> presets;
  for (const pugi::xml_node& element : elements_of(*xml)) {
    const auto kind = name_of(element);
    if (kind != "ColorMap" && kind != "VolumeProperty") continue;
    const std::string name = attribute(element, "name");
    const std::string place = source + ": " + std::string(kind) + " " +
                              (name.empty() ? std::to_string(presets.size() + 1) : in_quotes(name));
    auto preset = SLF_TRY(kind == "ColorMap" ? read_color_map(element, place)
                                             : read_volume_property(element, place));
    preset.function.name = name;
    presets.push_back(std::move(preset));
  }
  if (presets.empty())
    return bad_file(source, "XML of ", in_quotes(name_of(xml->document_element())),
                    ", expected ParaView's ColorMap or 3D Slicer's VolumeProperty");
  return presets;
}

}  // namespace slf::transfer_formats

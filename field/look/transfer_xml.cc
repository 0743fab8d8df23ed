// XML: ParaView's colour maps, and 3D Slicer's volume properties as in its presets.xml.
#include <algorithm>
#include <cmath>
#include <optional>

#include "base/try.h"
#include "field/volume/io.h"
#include "field/look/transfer_formats.h"
#include "field/volume/xml.h"

namespace slf::transfer_formats {

namespace {

using volume_io::in_quotes;
using volume_io::XmlAttributes;

std::string_view attribute(const XmlAttributes& attributes, std::string_view name) {
  const auto found = attributes.find(name);
  return found == attributes.end() ? std::string_view() : std::string_view(found->second);
}

/// A ColorMap. As in ParaView, its points need not ascend, and their opacities ("o") do not count.
struct ColorMap {
  std::string name, space;
  bool indexed = false;  ///< colours of categories
  std::vector<TransferFunction::ColorPoint> points{};
  std::vector<std::optional<double>> annotations{};
};

Result<TransferFunction::ColorPoint> read_point(const XmlAttributes& attributes,
                                                const ColorMap& map, const std::string& place) {
  TransferFunction::ColorPoint point{0, {}};
  for (const auto& [name, to] : {std::pair{"x", &point.value},
                                 {"r", &point.rgb.r},
                                 {"g", &point.rgb.g},
                                 {"b", &point.rgb.b}}) {
    const bool channel = to != &point.value;
    if (!channel && map.indexed) continue;
    const auto value = volume_io::parse_number(attribute(attributes, name));
    if (!value || !std::isfinite(*value) || (channel && !(*value >= 0 && *value <= 1)))
      return fail(ErrorCode::bad_file, place, ": Point ", map.points.size() + 1, ": ", name, " is ",
                  in_quotes(attribute(attributes, name)), ", expected ",
                  channel ? "0 to 1" : "a number");
    *to = *value;
  }
  return point;
}

Result<TransferPreset> preset_of(ColorMap map, const std::string& place) {
  if (map.points.empty())
    return fail(ErrorCode::bad_file, place,
                R"(: expected <Point x="..." r="..." g="..." b="..."/>)");
  TransferPreset preset;
  if (map.indexed) {
    std::vector<glm::dvec3> colors;
    for (const auto& point : map.points) colors.push_back(point.rgb);
    preset = indexed_preset(colors, map.annotations);
  } else {
    // Hues that wrap around are those of HSV here: it always goes the shorter way.
    const bool wrapped = volume_io::lower(map.space) == "wrapped";
    preset.function.space =
        SLF_TRY(map.space.empty() ? TransferFunction::Space::rgb
                                  : parse_space(wrapped ? "HSV" : map.space, place + ": space"));
    std::ranges::stable_sort(map.points, {}, &TransferFunction::ColorPoint::value);
    preset.function.colors = std::move(map.points);
  }
  preset.function.name = std::move(map.name);
  preset.has_opacity = preset.has_unit_distance = false;
  const auto& colors = preset.function.colors;
  preset.function.opacities = opacity_ramp(colors.front().value, colors.back().value);
  return preset;
}

Result<TransferPreset> read_volume_property(const XmlAttributes& attributes,
                                            const std::string& place) {
  auto preset = points_of(attribute(attributes, "scalarOpacity"), place + ": scalarOpacity",
                          attribute(attributes, "colorTransfer"), place + ": colorTransfer");
  if (preset) preset->function.name = attribute(attributes, "name");
  return preset;
}

}  // namespace

bool looks_like_xml(std::string_view text) { return volume_io::trim(text).starts_with('<'); }

Presets parse_xml(std::string_view text, const std::string& source) {
  std::vector<TransferPreset> presets;
  std::optional<ColorMap> map;  // that is being read
  std::string root;
  Result<void> ok;
  const auto place_of = [&](std::string_view element, std::string_view name) {
    return source + ": " + std::string(element) + " " +
           (name.empty() ? std::to_string(presets.size() + 1) : in_quotes(name));
  };
  const auto keep = [&](Result<TransferPreset> preset) {
    if (preset)
      presets.push_back(std::move(*preset));
    else
      ok = tl::unexpected(preset.error());
  };
  volume_io::XmlHandler handler;
  handler.start = [&](std::string_view element, const XmlAttributes& attributes) {
    if (root.empty()) root = element;
    const auto name = attribute(attributes, "name");
    if (element == "ColorMap") {
      const auto indexed = volume_io::lower(attribute(attributes, "indexedLookup"));
      map = ColorMap{.name = std::string(name),
                     .space = std::string(attribute(attributes, "space")),
                     .indexed = indexed == "true" || indexed == "1"};
    } else if (map && element == "Point") {
      const auto point = read_point(attributes, *map, place_of("ColorMap", map->name));
      if (point)
        map->points.push_back(*point);
      else
        ok = tl::unexpected(point.error());
    } else if (map && element == "Annotation") {
      map->annotations.push_back(volume_io::parse_number(attribute(attributes, "v")));
    } else if (element == "VolumeProperty") {
      keep(read_volume_property(attributes, place_of("VolumeProperty", name)));
    }
    return ok.has_value();
  };
  handler.end = [&](std::string_view element) {
    if (element != "ColorMap" || !map) return;
    const std::string place = place_of("ColorMap", map->name);
    keep(preset_of(std::move(*map), place));
    map.reset();
  };
  const auto parsed = volume_io::parse_xml(text, source, handler);
  if (!ok) return tl::unexpected(ok.error());
  if (!parsed) return tl::unexpected(parsed.error());
  if (presets.empty())
    return fail(ErrorCode::bad_file, source, ": XML of ", in_quotes(root),
                ", expected ParaView's ColorMap or 3D Slicer's VolumeProperty");
  return presets;
}

}  // namespace slf::transfer_formats

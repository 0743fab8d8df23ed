// ParaView's preset JSON, an array of presets or one alone; and 3D Slicer's volume properties.
#include <cmath>
#include <nlohmann/json.hpp>

#include "base/nesting.h"
#include "base/try.h"
#include "source/transfer/transfer_formats.h"
#include "source/volume/io.h"

namespace slf {

namespace {

using nlohmann::json;
using Space = TransferFunction::Space;
using volume_io::in_quotes;

// The names that ParaView writes. The first name of a space is the one we write.
struct SpaceName {
  const char* name;
  Space space;
};
constexpr SpaceName kSpaces[] = {{"RGB", Space::rgb},
                                 {"HSV", Space::hsv},
                                 {"Lab", Space::lab},
                                 {"CIELAB", Space::lab},
                                 {"Diverging", Space::diverging},
                                 {"Step", Space::step}};

/// A place in the document, for messages: "brain.json: [0].Points[8]".
struct Place {
  std::string file;
  std::string path;
  std::string operator()(std::string_view key) const {
    return file + ": " + path + (path.empty() ? "" : ".") + std::string(key);
  }
};

template <class... Parts>
tl::unexpected<Error> bad(const Parts&... parts) {
  return fail(ErrorCode::bad_file, parts...);
}

/// Reads an array of points of `stride` numbers each, 0 to 1. If `valued`, the first number of a
/// point is a value instead, and these must ascend.
Result<std::vector<double>> read_points(const json& preset, const Place& place, const char* key,
                                        std::size_t stride, const char* meaning,
                                        bool valued = true) {
  const auto found = preset.find(key);
  if (found == preset.end())
    return bad(place(key), " is missing, expected an array of ", meaning, " a point");
  if (!found->is_array() || found->empty() || found->size() % stride != 0)
    return bad(place(key), " is ", found->is_array() ? "an array of " : found->type_name(),
               found->is_array() ? std::to_string(found->size()) : "", ", expected ", stride,
               " numbers a point: ", meaning);
  std::vector<double> numbers;
  for (std::size_t i = 0; i < found->size(); ++i) {
    const auto where = place(std::string(key) + "[" + std::to_string(i) + "]");
    const json& item = (*found)[i];
    if (!item.is_number()) return bad(where, " is ", item.type_name(), ", expected a number");
    const double value = item.get<double>();
    if (!std::isfinite(value)) return bad(where, " is not finite");
    if (valued && i % stride == 0) {
      if (i > 0 && value < numbers[i - stride])
        return bad(where, " is ", value, ", below the point before it (", numbers[i - stride],
                   "): points must ascend in value");
    } else if (value < 0 || value > 1) {
      return bad(where, " is ", value, ", expected 0 to 1");
    }
    numbers.push_back(value);
  }
  return numbers;
}

Result<Space> read_space(const json& preset, const Place& place) {
  const auto found = preset.find("ColorSpace");
  if (found == preset.end()) return Space::rgb;
  if (!found->is_string())
    return bad(place("ColorSpace"), " is ", found->type_name(), ", expected a string");
  return transfer_formats::parse_space(found->get_ref<const std::string&>(), place("ColorSpace"));
}

/// Reads the colours of categories, and the annotations of their values where these are numbers.
Result<TransferPreset> read_indexed(const json& preset, const Place& place) {
  const auto numbers =
      SLF_TRY(read_points(preset, place, "IndexedColors", 3, "red, green, blue", false));
  std::vector<glm::dvec3> colors;
  for (auto p = numbers.begin(); p != numbers.end(); p += 3) colors.emplace_back(p[0], p[1], p[2]);
  // Pairs of value and text. In some files the values are strings.
  std::vector<std::optional<double>> values;
  if (const auto pairs = preset.find("Annotations"); pairs != preset.end() && pairs->is_array())
    for (std::size_t i = 0; i < pairs->size() && values.size() < colors.size(); i += 2) {
      const json& item = (*pairs)[i];
      values.push_back(item.is_number()   ? std::optional(item.get<double>())
                       : item.is_string() ? volume_io::parse_number(item.get<std::string>())
                                          : std::nullopt);
    }
  return transfer_formats::indexed_preset(colors, values);
}

Result<TransferPreset> read_preset(const json& preset, const Place& place) {
  if (!preset.is_object())
    return bad(place.file, ": ", place.path, place.path.empty() ? "" : " ", "is ",
               preset.type_name(),
               ", expected a ParaView preset, {\"RGBPoints\": [...], "
               "\"Points\": [...]}");
  TransferPreset result;
  TransferFunction& function = result.function;
  if (const auto found = preset.find("Name"); found != preset.end()) {
    if (!found->is_string())
      return bad(place("Name"), " is ", found->type_name(), ", expected a string");
    function.name = found->get<std::string>();
  }
  if (preset.contains("IndexedColors") && !preset.contains("RGBPoints")) {
    auto indexed = SLF_TRY(read_indexed(preset, place));
    std::swap(indexed.function.name, function.name);
    result = std::move(indexed);
  } else {
    function.space = SLF_TRY(read_space(preset, place));
    const auto colors =
        SLF_TRY(read_points(preset, place, "RGBPoints", 4, "value, red, green, blue"));
    for (auto p = colors.begin(); p != colors.end(); p += 4)
      function.colors.push_back({p[0], {p[1], p[2], p[3]}});
  }
  result.has_opacity =
      preset.contains("Points") && result.values != TransferPreset::Values::indexed;
  if (result.has_opacity) {
    const auto points =
        SLF_TRY(read_points(preset, place, "Points", 4, "value, opacity, midpoint, sharpness"));
    for (auto p = points.begin(); p != points.end(); p += 4)
      function.opacities.push_back({p[0], p[1], p[2], p[3]});
  } else {
    function.opacities =
        transfer_formats::opacity_ramp(function.colors.front().value, function.colors.back().value);
  }
  result.has_unit_distance = result.has_opacity;
  if (const auto found = preset.find("ScalarOpacityUnitDistance"); found != preset.end()) {
    const double distance = found->is_number() ? found->get<double>() : -1;
    if (!(distance > 0) || !std::isfinite(distance))
      return bad(place("ScalarOpacityUnitDistance"), " is ", in_quotes(found->dump().substr(0, 40)),
                 ", expected a positive number");
    function.unit_distance = distance;
  }
  return result;
}

/// Converts a function of 3D Slicer's JSON, {"points": [{"x": ..., KEY: ...}, ...]}, to ParaView's
/// flat array: for each point x, then its `stride` - 1 other numbers.
json flat_points(const json& component, const char* name, const char* key, std::size_t stride) {
  json flat = json::array();
  const auto found = component.find(name);
  if (found == component.end() || !found->is_object()) return flat;
  for (const json& point : found->value("points", json::array())) {
    if (!point.is_object()) return json("a point that is no object");
    flat.push_back(point.value("x", json()));
    const json value = point.value(key, json());
    if (value.is_array())
      for (const json& channel : value) flat.push_back(channel);
    else
      flat.push_back(value);
    if (stride == 4 && !value.is_array()) {
      flat.push_back(point.value("midpoint", 0.5));
      flat.push_back(point.value("sharpness", 0.0));
    }
  }
  return flat;
}

/// The first component of one of 3D Slicer's volume properties, as a ParaView preset.
json as_preset(const json& property, const std::string& name) {
  json preset{{"Name", name}};
  const json components = property.is_object() ? property.value("components", json()) : json();
  if (!components.is_array() || components.empty() || !components[0].is_object()) return preset;
  preset["RGBPoints"] = flat_points(components[0], "rgbTransferFunction", "color", 4);
  preset["Points"] = flat_points(components[0], "scalarOpacity", "y", 4);
  if (const auto found = components[0].find("scalarOpacityUnitDistance");
      found != components[0].end())
    preset["ScalarOpacityUnitDistance"] = *found;
  return preset;
}

}  // namespace

Result<Space> transfer_formats::parse_space(std::string_view text, const std::string& place) {
  for (const auto& [name, space] : kSpaces)
    if (lower_case(name) == lower_case(text)) return space;
  return fail(ErrorCode::unsupported, place, " is ", in_quotes(text),
              ", expected RGB, HSV, Lab, CIELAB, Diverging or Step");
}

TransferPreset transfer_formats::indexed_preset(const std::vector<glm::dvec3>& colors,
                                                const std::vector<std::optional<double>>& values) {
  bool ascend = values.size() == colors.size();
  for (std::size_t i = 0; ascend && i < values.size(); ++i)
    ascend = values[i] && std::isfinite(*values[i]) && (i == 0 || *values[i] > *values[i - 1]);
  TransferPreset preset;
  preset.values = TransferPreset::Values::indexed;
  preset.function.space = Space::step;
  for (std::size_t i = 0; i < colors.size(); ++i)
    preset.function.colors.push_back({ascend ? *values[i] : static_cast<double>(i), colors[i]});
  return preset;
}

transfer_formats::Presets transfer_formats::parse_json(const std::string& text,
                                                       const std::string& source) {
  // Parsed, a few bytes of text become 16 or more. All presets of ParaView have 0.3 MiB.
  constexpr std::size_t kMaxBytes = std::size_t{4} << 20;
  if (text.size() > kMaxBytes)
    return bad(source, ": ", text.size(), " bytes, expected JSON of at most ", kMaxBytes);
  try {
    json document = json::parse(text, limit_nesting);
    if (document.is_object() && document.contains("volumeProperties")) {
      json presets = json::array();
      for (const json& property : document["volumeProperties"])
        presets.push_back(as_preset(property, source));
      document = std::move(presets);
    }
    const bool alone = !document.is_array();
    if (alone) document = json::array({document});
    if (document.empty()) return bad(source, ": an empty array, expected at least one preset");
    std::vector<TransferPreset> presets;
    for (std::size_t i = 0; i < document.size(); ++i) {
      auto preset =
          SLF_TRY(read_preset(document[i], {source, alone ? "" : "[" + std::to_string(i) + "]"}));
      presets.push_back(std::move(preset));
    }
    return presets;
  } catch (const std::exception& error) {  // its what() names line and column
    return bad(source, ": not JSON: ", error.what());
  }
}

Result<TransferFunction> parse_transfer(const std::string& text, const std::string& source) try {
  try {
    const json document = json::parse(text);
    if (document.is_array() && document.empty())
      return bad(source, ": an empty array, expected at least one preset");
    const Place place{source, document.is_array() ? "[0]" : ""};
    auto preset = SLF_TRY(read_preset(document.is_array() ? document[0] : document, place));
    if (!preset.has_opacity)
      return bad(place("Points"),
                 " is missing, expected an array of value, opacity, midpoint, "
                 "sharpness a point");
    return std::move(preset.function);
  } catch (const std::exception& error) {
    return bad(source, ": not JSON: ", error.what());
  }
} catch (...) {
  return tl::unexpected(error_of_exception());
}

std::string to_json(const TransferFunction& transfer) {
  json preset;
  preset["Name"] = transfer.name;
  for (const auto& [name, space] : kSpaces)
    if (space == transfer.space && !preset.contains("ColorSpace")) preset["ColorSpace"] = name;
  for (const auto& [value, rgb] : transfer.colors)
    for (const double number : {value, rgb.x, rgb.y, rgb.z}) preset["RGBPoints"].push_back(number);
  for (const auto& [value, opacity, midpoint, sharpness] : transfer.opacities)
    for (const double number : {value, opacity, midpoint, sharpness})
      preset["Points"].push_back(number);
  preset["ScalarOpacityUnitDistance"] = transfer.unit_distance;
  return json::array({preset}).dump(1, ' ', false, json::error_handler_t::replace) + "\n";
}

}  // namespace slf

// ParaView's preset JSON: an array of presets, or one alone.
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "field/volume/io.h"
#include "slf/transfer.h"

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

/// The numbers of an array of points of `stride` numbers, ascending in their first.
Result<std::vector<double>> read_points(const json& preset, const Place& place, const char* key,
                                        std::size_t stride, const char* meaning) {
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
    if (i % stride == 0) {
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
  const auto& text = found->get_ref<const std::string&>();
  for (const auto& [name, space] : kSpaces)
    if (volume_io::lower(name) == volume_io::lower(text)) return space;
  return fail(ErrorCode::unsupported, place("ColorSpace"), " is ", in_quotes(text),
              ", expected RGB, HSV, Lab, CIELAB, Diverging or Step");
}

Result<TransferFunction> read_preset(const json& preset, const Place& place) {
  if (!preset.is_object())
    return bad(place.file, ": ", place.path, place.path.empty() ? "" : " ", "is ",
               preset.type_name(),
               ", expected a ParaView preset, {\"RGBPoints\": [...], "
               "\"Points\": [...]}");
  TransferFunction result;
  if (const auto found = preset.find("Name"); found != preset.end()) {
    if (!found->is_string())
      return bad(place("Name"), " is ", found->type_name(), ", expected a string");
    result.name = found->get<std::string>();
  }
  const auto space = read_space(preset, place);
  if (!space) return tl::unexpected(space.error());
  result.space = *space;
  const auto colors = read_points(preset, place, "RGBPoints", 4, "value, red, green, blue");
  if (!colors) return tl::unexpected(colors.error());
  for (auto p = colors->begin(); p != colors->end(); p += 4)
    result.colors.push_back({p[0], {p[1], p[2], p[3]}});
  const auto points =
      read_points(preset, place, "Points", 4, "value, opacity, midpoint, sharpness");
  if (!points) return tl::unexpected(points.error());
  for (auto p = points->begin(); p != points->end(); p += 4)
    result.opacities.push_back({p[0], p[1], p[2], p[3]});
  if (const auto found = preset.find("ScalarOpacityUnitDistance"); found != preset.end()) {
    const double distance = found->is_number() ? found->get<double>() : -1;
    if (!(distance > 0) || !std::isfinite(distance))
      return bad(place("ScalarOpacityUnitDistance"), " is ", in_quotes(found->dump().substr(0, 40)),
                 ", expected a positive number");
    result.unit_distance = distance;
  }
  return result;
}

}  // namespace

Result<TransferFunction> parse_transfer(const std::string& text, const std::string& source) {
  try {
    const json document = json::parse(text);
    if (!document.is_array()) return read_preset(document, {source, ""});
    if (document.empty()) return bad(source, ": an empty array, expected at least one preset");
    return read_preset(document[0], {source, "[0]"});
  } catch (const std::exception& error) {  // its what() names line and column
    return bad(source, ": not JSON: ", error.what());
  }
}

Result<TransferFunction> read_transfer(const std::string& path) {
  const auto size = volume_io::file_size(path);
  if (!size) return tl::unexpected(size.error());
  constexpr std::uint64_t kMost = std::uint64_t{64} << 20;
  if (*size > kMost)
    return bad(path, ": ", *size, " bytes, expected a ParaView preset of at most ", kMost);
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  if (!file || (*size > 0 && !(text << file.rdbuf())))
    return fail(ErrorCode::io, path, ": cannot be read");
  return parse_transfer(std::move(text).str(), path);
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

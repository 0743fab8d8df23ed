// Values of options: as text, as JSON, and their ranges.
#include <algorithm>
#include <cmath>
#include <filesystem>

#include "base/ascii.h"
#include "base/byte_count.h"
#include "base/join.h"
#include "base/try.h"
#include "slf/mesh.h"
#include "source/recipe/options.h"
#include "source/recipe/scenes.h"

namespace slf::recipe {
namespace {

using nlohmann::json;
using Form = Type::Form;

std::string shown(const json& value) {
  return value.is_string() ? value.get<std::string>()
                           : value.dump(-1, ' ', false, json::error_handler_t::replace);
}

std::string range_of(const Type& type) {
  const bool is_whole = type.form == Form::whole || type.form == Form::wholes;
  const double no_bound = is_whole ? 1e9 : 1e100;  // that anybody would want to read
  if (type.high > no_bound) return type.low < -no_bound ? "" : concat("at least ", type.low);
  return type.above ? concat("above ", type.low, ", at most ", type.high)
                    : concat(type.low, " to ", type.high);
}

/// What a value of the type is, for messages.
std::string expected(const Type& type) {
  const auto each = [&](const std::string& what) {
    const std::string range = range_of(type);
    return range.empty() ? what : what + ", each " + range;
  };
  switch (type.form) {
    case Form::flag:
      return "true or false";
    case Form::whole:
    case Form::number: {
      const std::string range = range_of(type);
      const char* const what = type.form == Form::whole ? "a whole number" : "a number";
      return range.empty() ? what : range;
    }
    case Form::bytes:
      return "a number of bytes, or one as 64MiB or 1.5GiB";
    case Form::text:
      return "a text";
    case Form::file:
      return "a path";
    case Form::choice:
      return joined(type.names, ", ");
    case Form::numbers:
      return each(concat(type.count, " numbers"));
    case Form::wholes:
      return type.count == 0 ? "whole numbers" : each(concat(type.count, " whole numbers"));
    case Form::planes:
      return "a point and a normal, as 0,0,40,0,0,1";
    case Form::box:
      return "X0:X1,Y0:Y1,Z0:Z1, as 10:200,:,50:";
  }
  return {};
}

bool is_whole(const json& value) {
  return value.is_number_integer() ||
         (value.is_number_float() && std::nearbyint(value.get<double>()) == value.get<double>() &&
          std::abs(value.get<double>()) <= 0x1p53);
}

bool in_range(const Type& type, const json& value) {
  if (!value.is_number()) return false;
  const auto number = value.get<double>();
  return (type.above ? number > type.low : number >= type.low) && number <= type.high;
}

bool are_numbers(const Type& type, const json& value, bool whole, std::size_t count) {
  return value.is_array() && (count == 0 ? !value.empty() : value.size() == count) &&
         std::ranges::all_of(value, [&](const json& one) {
           return in_range(type, one) && (!whole || is_whole(one));
         });
}

/// Whether the value is one of this type.
bool fits(const Type& type, const json& value) {
  const auto is_end = [](const json& end) {
    return end.is_null() || (is_whole(end) && end >= 0 && end <= UINT32_MAX);
  };
  switch (type.form) {
    case Form::flag:
      return value.is_boolean();
    case Form::whole:
    case Form::bytes:
      return in_range(type, value) && is_whole(value);
    case Form::number:
      return in_range(type, value);
    case Form::text:
      return value.is_string();
    case Form::file:
      return value.is_string() || value.is_object();
    case Form::choice:
      return value.is_string() &&
             std::ranges::find(type.names, value.get<std::string>()) != type.names.end();
    case Form::numbers:
      return are_numbers(type, value, false, type.count);
    case Form::wholes:
      return are_numbers(type, value, true, type.count);
    case Form::planes:
      return value.is_array() && std::ranges::all_of(value, [&](const json& plane) {
               return are_numbers(type, plane, false, 6);
             });
    case Form::box:
      return value.is_array() && value.size() == 3 && std::ranges::all_of(value, [&](auto& ends) {
               return ends.is_array() && ends.size() == 2 && is_end(ends[0]) && is_end(ends[1]) &&
                      ends[1] != 0;
             });
  }
  return false;
}

/// A number of JSON; null: it is none.
json number_of(std::string_view text) {
  json value = json::parse(text, nullptr, /*allow_exceptions=*/false);
  if (value.is_number()) return value;
  const auto plain = parse_number<double>(text);  // as .5 or +1, which JSON does not have
  return plain && std::isfinite(*plain) ? json(*plain) : json();
}

std::vector<std::string_view> split(std::string_view text, char delimiter) {
  std::vector<std::string_view> parts;
  for (std::size_t at = 0; at != std::string_view::npos;) {
    const std::size_t end = text.find(delimiter, at);
    parts.push_back(trim(text.substr(at, end - at)));
    at = end == std::string_view::npos ? end : end + 1;
  }
  return parts;
}

json numbers_of(std::string_view text, char delimiter) {
  json values = json::array();
  for (const std::string_view part : split(text, delimiter)) values.push_back(number_of(part));
  return values;
}

/// "10:200,:,50:" as [[10, 200], [null, null], [50, null]]; null if it is something else.
json box_of(std::string_view text) {
  json box = json::array();
  for (const std::string_view part : split(text, ',')) {
    box.push_back(json::array());
    for (const std::string_view end : split(part, ':')) {
      box.back().push_back(end.empty() ? json() : number_of(end));
      if (!end.empty() && box.back().back().is_null()) return {};
    }
  }
  return box;
}

/// The value that a text stands for, of any type.
json value_of(const Type& type, const std::string& text) {
  switch (type.form) {
    case Form::flag:
      return text == "true" ? json(true) : text == "false" ? json(false) : json();
    case Form::whole:
    case Form::number:
      return number_of(text);
    case Form::bytes: {
      const auto bytes = parse_byte_count(text);
      return bytes ? json(*bytes) : json();
    }
    case Form::text:
    case Form::file:
      return text;
    case Form::choice: {
      const auto scalar = parse_scalar_type(text);  // has many names
      return scalar && !fits(type, text) ? json(name(*scalar)) : json(text);
    }
    case Form::numbers:
    case Form::wholes:
      return numbers_of(text, type.delimiter);
    case Form::planes:
      return json::array({numbers_of(text, ',')});
    case Form::box:
      return box_of(text);
  }
  return {};
}

/// Text as what it stands for.
json normal(const Type& type, const json& value) {
  const bool is_text = type.form == Form::text || type.form == Form::file;
  if (value.is_string() && !is_text) return value_of(type, value.get<std::string>());
  const bool one_plane =
      type.form == Form::planes && value.is_array() && !value.empty() && value[0].is_number();
  return one_plane ? json::array({value}) : value;
}

/// A path of a recipe in `folder`. Names of what is built in stay.
std::string from_folder(const std::string& option, const std::string& path,
                        const std::string& folder) {
  if (folder.empty() || !names_file(option, path)) return path;
  const std::size_t prefix = path.starts_with(kPicturesPrefix) ? kPicturesPrefix.size() : 0;
  return path.substr(0, prefix) + (std::filesystem::path(folder) / path.substr(prefix)).string();
}

/// The same without folders.
json without_folders(const json& value) {
  if (!value.is_string()) return value;
  const auto text = value.get<std::string>();
  const std::size_t prefix = text.starts_with(kPicturesPrefix) ? kPicturesPrefix.size() : 0;
  return text.substr(0, prefix) + std::filesystem::path(text.substr(prefix)).filename().string();
}

struct KindName {
  Kind kind;
  const char *one, *many;
};
constexpr KindName kKinds[] = {{kVolume, "a volume", "volumes"},
                               {kMesh, "a mesh", "meshes"},
                               {kPictures, "a set of pictures", "pictures"},
                               {kAnalytic, "an analytic scene", "analytic scenes"}};

}  // namespace

Kind kind_of(const Recipe& recipe) {
  if (recipe.volume) return kVolume;
  if (recipe.input.starts_with(kScenePrefix)) return kAnalytic;
  if (recipe.is_pictures()) return kPictures;
  return is_mesh_name(recipe.input) ? kMesh : kVolume;
}

bool names_file(std::string_view option, const std::string& text) {
  if (text.empty() || text.starts_with('{')) return false;
  const auto& rigs = built_in_rigs();
  return option == "transfer"      ? !transfer_file(text).empty()
         : option == "light_rig"   ? std::ranges::find(rigs, text, &LightRig::name) == rigs.end()
         : option == "depth_cache" ? text != "none"
                                   : !text.starts_with(kScenePrefix);
}

Result<json> parse(const Type& type, const std::string& text) {
  json value = value_of(type, text);
  if (fits(type, value)) return value;
  return misuse(text, "expected ", expected(type));
}

std::string text_of(const Type& type, const json& value) {
  if (value.is_null()) return {};
  if (type.form == Form::bytes) return concat(value.get<std::uint64_t>() >> 20, "MiB");
  if (value.is_array())
    return joined(value, std::string_view(&type.delimiter, 1),
                  [](const json& one) { return shown(one); });
  return value.is_number_float() ? concat(value.get<double>()) : shown(value);
}

Result<void> set(Recipe& recipe, std::string_view name, const json& given,
                 const std::string& folder) {
  const Option* const option = find(name);
  if (!option) return fail(ErrorCode::usage, "'", name, "' is no option of a recipe");
  if (given.is_null()) {
    option->set(recipe, given);
    recipe.stated.erase(option->name);
    return {};
  }
  json value = normal(option->type, given);
  if (!fits(option->type, value))
    return fail_without(option->name, ErrorCode::usage, option->name, ": ", shown(given),
                        ": expected ", expected(option->type));
  if (option->type.form == Form::file && value.is_string())
    value = from_folder(option->name, value.get<std::string>(), folder);
  if (option->excludes && recipe.stated.erase(option->excludes) > 0)
    find(option->excludes)->set(recipe, {});
  option->set(recipe, value);
  recipe.stated.insert(option->name);
  return {};
}

const Option* rival_of(const Option& option, const std::set<std::string, std::less<>>& stated) {
  const auto excludes = [](const Option& one, const Option& other) {
    return one.excludes && one.excludes == std::string_view(other.name);
  };
  for (const Option& other : options())
    if ((excludes(option, other) || excludes(other, option)) && stated.contains(other.name))
      return &other;
  return nullptr;
}

Result<void> check_applies(const Recipe& recipe) {
  const Recipe defaults;
  const Kind kind = kind_of(recipe);
  for (const Option& option : options()) {
    const bool stated = recipe.stated.contains(option.name);
    if (!stated && option.get(recipe) == option.get(defaults)) continue;
    if (!(option.kinds & kind)) {
      std::vector<const char*> fitting;
      for (const KindName& known : kKinds)
        if (option.kinds & known.kind) fitting.push_back(known.many);
      return misuse(option.name, "only for ", joined(fitting, " and "), "; ",
                    recipe.volume ? "an array" : recipe.input, " is ",
                    std::ranges::find(kKinds, kind, &KindName::kind)->one);
    }
    if (stated && option.needs && !recipe.stated.contains(option.needs))
      return fail_without(option.needs, ErrorCode::usage, option.name, ": needs ", option.needs);
  }
  return {};
}

json to_json(const Recipe& recipe) {
  json out = json::object();
  for (const Option& option : options()) {
    if (option.use == Use::field || option.use == Use::cost || !recipe.stated.contains(option.name))
      continue;
    const json value = option.get(recipe);
    if (value.is_null()) continue;  // a volume in memory
    out[option.name] = option.type.form == Form::file ? without_folders(value) : value;
  }
  return out;
}

std::string published(const Recipe& recipe, const Scene& scene, const std::string& light_from) {
  json out = to_json(recipe);
  out.erase("input");  // which provenance names
  const json provenance = json::parse(scene.provenance(), nullptr, /*allow_exceptions=*/false);
  const bool dicom = provenance.value("source", "") == "DICOM";
  for (const char* file : {"labels_volume", "mask", "series"}) {
    if (!out.contains(file)) continue;
    const std::string ending =
        lower_case(std::filesystem::path(out[file].get<std::string>()).extension().string());
    if (dicom || ending.empty() || ending == ".dcm" || ending == ".ima") out.erase(file);
  }
  if (!light_from.empty()) out["light_from"] = light_from;
  if (recipe.each_time && !recipe.stated.contains("each_time")) out["time"] = "all";
  return out.dump(-1, ' ', false, json::error_handler_t::replace);
}

std::string help_of(const Option& option, bool command_line) {
  std::string text = option.help;
  if (option.negative && !command_line) text = "False: " + text;
  for (std::size_t open = 0; (open = text.find('{', open)) != std::string::npos;) {
    const std::size_t close = text.find('}', open);
    std::string name = text.substr(open + 1, close - open - 1);
    if (!find(name)) {
      open = close;
      continue;
    }
    if (command_line) {
      std::ranges::replace(name, '_', '-');
      name.insert(0, "--");
    }
    text.replace(open, close - open + 1, name);
  }
  return text;
}

}  // namespace slf::recipe

#include "page/views.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <span>
#include <string_view>
#include <vector>

#include "base/file.h"
#include "base/join.h"
#include "base/nesting.h"
#include "base/try.h"
#include "field/structure_looks.h"
#include "page/site.h"
#include "slf/camera.h"

namespace slf::page {
namespace {

using nlohmann::json;

constexpr std::uint64_t kMaxBytes = 1 << 20;
constexpr std::size_t kMaxEntries = 500;
constexpr double kMaxNumber = 1e12;

enum class Kind { title, text, address, orbit, point, titles, planes };
struct Member {
  std::string_view name;
  Kind kind;
  bool required;
};
constexpr Member kView[] = {{"title", Kind::title, true},  {"text", Kind::text, false},
                            {"orbit", Kind::orbit, true},  {"target", Kind::point, false},
                            {"state", Kind::title, false}, {"structures", Kind::titles, false},
                            {"clip", Kind::planes, false}, {"cap", Kind::title, false}};
constexpr Member kAbout[] = {{"title", Kind::title, true},
                             {"description", Kind::text, false},
                             {"author", Kind::text, false},
                             {"licence", Kind::text, false},
                             {"source", Kind::address, false}};
constexpr Member kNote[] = {
    {"label", Kind::title, true}, {"text", Kind::text, false}, {"point", Kind::point, true}};

/// What is expected of a value; empty if it is that.
std::string_view expected(const json& value, Kind kind) {
  const auto number = [](const json& v) {
    return v.is_number() && std::abs(v.get<double>()) <= kMaxNumber;
  };
  const bool three =
      value.is_array() && value.size() == 3 && std::all_of(value.begin(), value.end(), number);
  switch (kind) {
    case Kind::title:
      if (value.is_string() && !value.get_ref<const std::string&>().empty()) return "";
      return "a text that is not empty";
    case Kind::text:
      return value.is_string() ? "" : "a text";
    case Kind::address:
      if (value.is_string() && is_address(value.get_ref<const std::string&>())) return "";
      return "an address, https://…";
    case Kind::orbit:
      if (three && std::abs(value[1].get<double>()) <= 90 && value[2].get<double>() > 0 &&
          value[2].get<double>() <= kMaxOrbit)
        return "";
      return "[azimuth, elevation, distance]: degrees, elevations "
             "from -90 to 90, and radii of the sphere, above 0, at most 1e6";
    case Kind::point:
      return three ? "" : "three numbers [x, y, z] in world units";
    case Kind::titles:
      if (value.is_array() && std::all_of(value.begin(), value.end(), [](const json& one) {
            return expected(one, Kind::title).empty();
          }))
        return "";
      return "a list of texts, each NAME[:OPACITY][:#RRGGBB]";
    case Kind::planes:
      if (value.is_array() && std::all_of(value.begin(), value.end(), [&](const json& one) {
            return one.is_array() && one.size() == 6 && std::all_of(one.begin(), one.end(), number);
          }))
        return "";
      return "a list of planes [x, y, z, nx, ny, nz]: a point, and a normal to what is removed";
  }
  return "";
}

Result<void> check_entry(const json& entry, std::span<const Member> members,
                         const std::string& place) {
  const std::string names =
      joined(members, ", ", [](const Member& member) { return concat('"', member.name, '"'); });
  if (!entry.is_object()) return bad_file(place, "expected an object with the members ", names);
  for (const auto& [name, value] : entry.items())
    if (std::none_of(members.begin(), members.end(),
                     [&, &key = name](const Member& member) { return member.name == key; }))
      return bad_file(place, "no member \"", name, "\" is known; those are ", names);
  for (const Member& member : members) {
    const std::string key(member.name);
    if (!entry.contains(key) && !member.required) continue;
    const std::string_view wrong = expected(entry.value(key, json()), member.kind);
    if (!wrong.empty()) return fail(ErrorCode::bad_file, place, ".", key, ": expected ", wrong);
  }
  return {};
}

/// usage: the field does not have the structures that a saved view shows.
Result<void> check_structures(const json& view, const Field& field) {
  const auto names = view.value("structures", std::vector<std::string>());
  const auto looks = SLF_TRY(parse_structures(names, field.states()));
  if (looks.empty()) return {};
  std::vector<StructureLook> unknown = has_structures(field) ? std::vector<StructureLook>() : looks;
  if (unknown.empty()) SLF_TRY(structures_of(field, looks, unknown));
  if (unknown.empty()) return {};
  return misuse(field.path(), "has no structure '", unknown[0].name, "', which the saved view '",
                view["title"].get<std::string>(), "' shows");
}

/// A text with %XX in place of what separates texts in a list, or begins an escape.
std::string escaped(const std::string& text) {
  std::string result;
  for (const char c : text) result += c == ',' ? "%2C" : c == '%' ? "%25" : std::string(1, c);
  return result;
}

/// That of the page's element for the structures that it shows first.
std::string attribute(const std::vector<std::string>& structures) {
  return " structures=\"" + escape_html(joined(structures, ",", escaped)) + "\"";
}

}  // namespace

Result<ViewsFile> read_views(const std::string& path) {
  const auto bytes = SLF_TRY(read_file(path, kMaxBytes));
  return ViewsFile{path, bytes.empty() ? " " : std::string(chars_of(bytes))};
}

bool is_address(std::string_view text) {
  return (text.starts_with("https://") || text.starts_with("http://")) &&
         std::ranges::none_of(text, [](unsigned char c) { return c <= ' ' || c == '"'; });
}

Result<Views> parse_views(const ViewsFile& file, const Sphere& sphere) {
  const auto& [path, text] = file;
  if (text.empty()) return Views{};
  json root;
  try {
    root = json::parse(text, limit_nesting);
  } catch (const json::parse_error& error) {
    const auto end = text.begin() + static_cast<std::ptrdiff_t>(std::min(error.byte, text.size()));
    return fail(ErrorCode::bad_file, path, ", line ", 1 + std::count(text.begin(), end, '\n'),
                ": this is no JSON; schemas/views.json says what is expected");
  } catch (const std::exception& error) {
    return bad_file(path, error.what());
  }
  if (!root.is_object() || root.empty())
    return fail(ErrorCode::bad_file, path,
                R"(: expected an object with the lists "views" and "notes", and "about")");
  Views views;
  if (const auto about = root.find("about"); about != root.end()) {
    SLF_TRY(check_entry(*about, kAbout, path + ": about"));
    const auto member = [&](const char* name) { return about->value(name, ""); };
    views.about = {member("title"), member("description"), member("author"), member("licence"),
                   member("source")};
    root.erase(about);
  }
  for (const auto& [name, list] : root.items()) {
    if (name != "views" && name != "notes")
      return bad_file(path, "no member \"", name,
                      R"(" is known; those are "views", "notes" and "about")");
    if (!list.is_array() || list.size() > kMaxEntries)
      return bad_file(path, name, ": expected a list of at most ", kMaxEntries);
    const auto& members = name == "views" ? std::span<const Member>(kView) : kNote;
    std::string place = path;
    place.append(": ").append(name).append("[");
    for (std::size_t i = 0; i < list.size(); ++i)
      SLF_TRY(check_entry(list[i], members, std::string(place).append(std::to_string(i)) += "]"));
  }
  if (!root.empty()) views.json = root.dump(-1, ' ', /*ensure_ascii=*/true);
  for (std::size_t at = 0; (at = views.json.find('<', at)) != std::string::npos;)
    views.json.replace(at, 1, "\\u003c");
  if (const json list = root.value("views", json::array()); !list.empty()) {
    views.camera = list[0]["orbit"].get<std::vector<double>>();
    for (int k = 0; k < 3 && list[0].contains("target"); ++k)
      views.camera.push_back((list[0]["target"][k].get<double>() - sphere.center[k]) /
                             sphere.radius);
    const auto shown = joined(views.camera, ",", [](double v) { return json(v).dump(); });
    views.attributes = " view=\"" + shown + "\"";
    if (list[0].contains("state")) {
      views.state = list[0]["state"].get<std::string>();
      views.attributes += " state=\"" + escape_html(views.state) + "\"";
    }
    if (list[0].contains("structures")) {
      views.structures = list[0]["structures"].get<std::vector<std::string>>();
      views.attributes += attribute(*views.structures);
    }
    views.cut = !list[0].value("clip", json::array()).empty();
    for (const json& plane : list[0].value("clip", json::array())) {
      const std::string numbers = plane.dump();
      views.attributes += (views.attributes.ends_with('"') ? " clip=\"" : ";") +
                          numbers.substr(1, numbers.size() - 2);
    }
    if (views.cut) views.attributes += "\" cap=\"" + escape_html(list[0].value("cap", "")) + "\"";
  }
  return views;
}

Camera page_camera(const Sphere& sphere, const std::array<double, 6>& view, std::uint32_t width,
                   std::uint32_t height) {
  Camera camera = orbit_camera(sphere, view[0], view[1], view[2], width, height);
  const glm::dvec3 aside = sphere.radius * glm::dvec3(view[3], view[4], view[5]);
  camera.eye += aside;
  camera.look_at += aside;
  return camera;
}

Result<void> begin_with(const First& first, const Field& field, Views& views) {
  const json saved = views.json.empty() ? json::object() : json::parse(views.json);
  for (const json& view : saved.value("views", json::array())) {
    SLF_TRY(check_structures(view, field));
    SLF_TRY(field.in_state(view.value("state", "0")));
  }
  auto looks = SLF_TRY(parse_structures(first.structures, field.states()));
  std::vector<StructureLook> unknown;
  if (!first.state.empty()) {
    const auto shown = SLF_TRY(field.in_state(first.state));
    const std::string name = field.states().empty() ? "" : field.states()[shown.state()];
    if (has_structures(field) && looks.empty())
      looks.push_back({name});
    else if (views.state = name; !name.empty())
      views.attributes = " state=\"" + escape_html(name) + "\"" + views.attributes;
  }
  if (looks.empty()) return {};
  if (!has_structures(field))
    return misuse(field.path(), "has no structures that its page could choose from");
  SLF_TRY(structures_of(field, looks, unknown));
  if (!unknown.empty()) {
    const auto number = SLF_TRY(field.in_state(unknown[0].name));  // or else names what there is
    return misuse(field.path(), "a structure is named, here as '", field.states()[number.state()],
                  "'");
  }
  views.structures.emplace();
  for (const StructureLook& look : looks) views.structures->push_back(text_of(look));
  views.attributes = attribute(*views.structures) + views.attributes;
  return {};
}

}  // namespace slf::page

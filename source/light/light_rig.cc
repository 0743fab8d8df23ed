#include "source/light/light_rig.h"

#include <array>
#include <charconv>
#include <cmath>
#include <nlohmann/json.hpp>

#include "base/file.h"
#include "base/join.h"
#include "base/nesting.h"
#include "base/try.h"

namespace slf {
namespace {

using nlohmann::json;

/// The world direction (LPS) of a light as the patient sees it.
glm::dvec3 from(double right, double front, double up) { return {-right, -front, up}; }

/// Directions are chosen for a camera in front of the patient. From other sides, too, a white
/// surface gets no brighter than 1.5, which tone mapping still shows with its colour and shading.
std::vector<LightRig> make_rigs() {
  const glm::vec3 white(1), warm(1, 0.93f, 0.84f), cool(0.82f, 0.9f, 1);
  std::vector<LightRig> rigs;
  rigs.push_back({"studio",
                  "a large warm key light from the upper right, a weak cool fill, a rim light from "
                  "behind and a bright ceiling",
                  {{from(0.55, 0.6, 0.65), warm, 0.95f, 25},
                   {from(-0.9, 0.6, 0.1), cool, 0.18f, 50},
                   {from(-0.5, -0.8, 0.5), white, 0.5f, 20}},
                  {glm::vec3(0.55f), glm::vec3(0.28f), glm::vec3(0.12f)}});
  rigs.push_back({"rim",
                  "two bright lights from behind that draw outlines, over dim surroundings",
                  {{from(0.8, -0.55, 0.35), warm, 1, 15},
                   {from(-0.8, -0.55, 0.35), cool, 1, 15},
                   {from(0.3, 0.9, 0.6), white, 0.3f, 40}},
                  {glm::vec3(0.2f), glm::vec3(0.12f), glm::vec3(0.06f)}});
  rigs.push_back({"overcast",
                  "no lights but a wide bright sky: depth shows by ambient occlusion alone",
                  {},
                  {glm::vec3(1.25f), glm::vec3(0.8f), glm::vec3(0.3f)}});
  rigs.push_back(
      {"sun",
       "one small light with sharp shadows and a blue sky",
       {{from(0.5, 0.6, 0.75), glm::vec3(1, 0.95f, 0.86f), 1.3f, 0.5f}},
       {glm::vec3(0.16f, 0.22f, 0.34f), glm::vec3(0.18f, 0.2f, 0.24f), glm::vec3(0.08f)}});
  rigs.push_back({"headlamp",
                  "a light from the front, near the default camera, and even surroundings",
                  {{from(-0.45, 0.85, 0.4), white, 0.85f, 12}},
                  {glm::vec3(0.3f), glm::vec3(0.3f), glm::vec3(0.3f)}});
  return rigs;
}

json to_json(const glm::dvec3& v) { return {v.x, v.y, v.z}; }
/// The shortest decimal that reads back as the same float.
json number(float v) {
  std::array<char, 32> text{};
  const auto end = std::to_chars(text.begin(), text.end(), v).ptr;
  return json::parse(text.begin(), end);
}
json to_json(const glm::vec3& v) { return {number(v.x), number(v.y), number(v.z)}; }

/// Reads members of a JSON object. Keeps the first error, which names the member.
class Members {
 public:
  Members(const json& object, std::string place) : object_(object), place_(std::move(place)) {}

  template <class T>
  void number(const char* name, T& to) {
    const auto found = object_.find(name);
    if (found == object_.end()) return;
    if (found->is_number()) to = found->get<T>();
    if (!found->is_number() || !std::isfinite(to)) note_error(name, "a number");
  }
  template <class Vector>
  bool vector(const char* name, Vector& to) {
    const auto found = object_.find(name);
    if (found == object_.end()) return false;
    bool good = found->is_array() && found->size() == 3;
    for (std::size_t k = 0; good && k < 3; ++k) good = (*found)[k].is_number();
    if (!good) {
      note_error(name, "three numbers");
      return false;
    }
    for (int k = 0; k < 3; ++k) {
      to[k] = (*found)[static_cast<std::size_t>(k)].get<typename Vector::value_type>();
      if (!std::isfinite(to[k])) note_error(name, "three numbers");
    }
    return true;
  }
  void note_error(const char* name, const char* expected) {
    if (error_.empty()) error_ = place_ + name + ": expected " + expected;
  }
  [[nodiscard]] const std::string& error() const { return error_; }

 private:
  const json& object_;
  std::string place_, error_;
};

}  // namespace

Result<LightRig> parse_rig(const std::string& text, const std::string& source) {
  const auto bad = [&](const std::string& what) {
    return bad_file(source, "not a light rig: ", what);
  };
  json rig;
  try {
    rig = json::parse(text, limit_nesting);
  } catch (const std::exception& error) {
    return bad(concat("expected a JSON object: ", error.what()));
  }
  if (!rig.is_object()) return bad("expected a JSON object");
  LightRig out;
  out.name = source;
  if (const auto name = rig.find("name"); name != rig.end() && name->is_string())
    out.name = name->get<std::string>();
  const json lights = rig.value("lights", json::array());
  if (!lights.is_array()) return bad("lights: expected an array");
  for (std::size_t k = 0; k < lights.size(); ++k) {
    const std::string place = "lights[" + std::to_string(k) + "]";
    if (!lights[k].is_object()) return bad(place + ": expected an object");
    Light light;
    Members members(lights[k], place + ".");
    if (!members.vector("direction", light.direction))
      members.note_error("direction", "three numbers");
    members.vector("color", light.color);
    members.number("intensity", light.intensity);
    members.number("size", light.size);
    members.number("distance", light.distance);
    if (!members.error().empty()) return bad(members.error());
    out.lights.push_back(light);
  }
  const json sky = rig.value("sky", json::object());
  if (!sky.is_object()) return bad("sky: expected an object");
  Members members(sky, "sky.");
  members.vector("up", out.sky.up);
  members.vector("horizon", out.sky.horizon);
  members.vector("down", out.sky.down);
  if (!members.error().empty()) return bad(members.error());
  return out;
}

std::span<const LightRig> built_in_rigs() {
  static const std::vector<LightRig> rigs = make_rigs();
  return rigs;
}

Result<LightRig> read_rig(const std::string& reference) try {
  if (reference.starts_with('{')) return parse_rig(reference, "light rig");
  for (const LightRig& rig : built_in_rigs())
    if (rig.name == reference) return rig;
  constexpr std::uint64_t kMaxBytes = 1 << 20;
  const auto bytes = read_file(reference, kMaxBytes);
  if (!bytes && bytes.error().code == ErrorCode::not_found &&
      reference.find_first_of("./") == std::string::npos)
    return fail(ErrorCode::usage, "light rig '", reference, "': neither a file nor one of ",
                joined(built_in_rigs(), ", ", &LightRig::name));
  if (!bytes) return tl::unexpected(bytes.error());
  return parse_rig(std::string(chars_of(*bytes)), reference);
} catch (...) {
  return tl::unexpected(error_of_exception());
}

std::string to_json(const LightRig& rig) {
  json lights = json::array();
  for (const Light& light : rig.lights)
    lights.push_back({{"direction", to_json(light.direction)},
                      {"color", to_json(light.color)},
                      {"intensity", number(light.intensity)},
                      {"size", number(light.size)},
                      {"distance", number(light.distance)}});
  return json{{"name", rig.name},
              {"lights", lights},
              {"sky",
               {{"up", to_json(rig.sky.up)},
                {"horizon", to_json(rig.sky.horizon)},
                {"down", to_json(rig.sky.down)}}}}  // The name may be a path of any bytes.
      .dump(-1, ' ', false, json::error_handler_t::replace);
}

}  // namespace slf

// The reveals that recipes ask for, and those of finished fields.
#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "base/guarded.h"
#include "base/try.h"
#include "source/recipe/options.h"
#include "source/volume/content.h"

namespace slf {
namespace {

using nlohmann::json;

/// Two values as "LO,HI".
Result<std::array<double, 2>> window_of(const std::string& text) {
  const recipe::Type two{recipe::Type::Form::numbers, "", -1e300, 1e300, false, 2};
  const auto numbers = SLF_TRY(recipe::parse(two, text));
  return std::array<double, 2>{numbers[0], numbers[1]};
}

Result<RevealOptions> options_of(const Recipe& recipe) {
  RevealOptions options;
  options.side = recipe.reveal.value_or(options.side);
  options.loss = recipe.reveal_loss;
  options.threads = recipe.light_volume.threads;
  if (recipe.reveal_window == "visible") return options;
  const auto window = window_of(recipe.reveal_window);
  if (!window)
    return fail_without("reveal_window", ErrorCode::usage, recipe.reveal_window,
                        ": expected visible, or two values of the volume, as -100,300");
  options.window = *window;
  return options;
}

/// The states of a field that show the volume, as provenances; those that differ by the labels they
/// show as one.
Result<std::vector<std::string>> shown_of(const Field& field, const Volume& volume) {
  const std::string content = content_hash(volume);
  const std::size_t count = std::max<std::size_t>(1, field.states().size());
  std::map<std::string, json> labels;  // by all else
  for (unsigned state = 0; state < count; ++state) {
    const auto one = SLF_TRY(field.in_state(state));
    json provenance = json::parse(one.provenance());
    for (const char* other : {"light_of", "recipe"}) provenance.erase(other);
    if (provenance.value("content", json()) != content) continue;
    const json::json_pointer at("/structures/only");
    const json only = provenance.contains(at) ? provenance[at] : json();
    if (!only.is_null()) provenance["structures"].erase("only");
    json& all = labels[provenance.dump()];
    for (const json& id : only.is_array() ? only : json::array()) all.push_back(id);
  }
  std::vector<std::string> shown;
  for (auto& [text, ids] : labels) {
    json provenance = json::parse(text);
    if (!ids.is_null()) provenance["structures"]["only"] = std::move(ids);
    shown.push_back(provenance.dump());
  }
  if (shown.empty())
    return misuse(field.path(), "was built from another volume than ", volume.source,
                  ": their voxels differ; name the file that it was built from, as it was read");
  return shown;
}

/// The code of the reveal that the recipe asks for.
Result<std::vector<std::byte>> reveal_code(const Recipe& recipe,
                                           std::span<const FieldState> states) {
  const auto options = SLF_TRY(options_of(recipe));
  std::vector<const Scene*> scenes;
  for (const FieldState& state : states) scenes.push_back(state.scene);
  const auto reveal = SLF_TRY(make_reveal(scenes, options));
  return encode(reveal, options.threads);
}

}  // namespace

Sphere sphere_of(const Recipe& recipe, const Sphere& visible) {
  return {recipe.center.value_or(visible.center), recipe.radius.value_or(visible.radius)};
}

Result<BuildOptions> field_options(const Recipe& recipe, std::span<const FieldState> states) try {
  BuildOptions options = recipe.field;
  options.shape.sphere = sphere_of(recipe, bounds_of(states));
  if (recipe.reveal) options.reveal = SLF_TRY(reveal_code(recipe, states));
  return options;
} catch (...) {
  return tl::unexpected(error_of_exception());
}

Result<void> add_reveal(const std::string& path, Recipe recipe) try {
  if (!recipe.reveal) recipe.reveal = RevealOptions().side;
  const auto field = SLF_TRY(Field::open(path));
  auto volume = SLF_TRY(read_volume(recipe));
  const auto shown = SLF_TRY(shown_of(field, volume));
  volume.share();
  recipe.volume = std::make_shared<const Volume>(std::move(volume));
  recipe.raycast.shared = share_scenes();
  std::vector<std::unique_ptr<Scene>> scenes;
  std::vector<FieldState> states;
  for (const std::string& provenance : shown) {
    recipe.truth_of = provenance;
    scenes.push_back(SLF_TRY(make_scene(recipe)));
    states.push_back({"", scenes.back().get()});
  }
  const auto code = SLF_TRY(reveal_code(recipe, states));
  return set_reveal(path, code);
} catch (...) {
  return tl::unexpected(error_of_exception());
}

Result<std::shared_ptr<const Scene>> named_cap(const Field& field, std::span<const ClipPlane> clip,
                                               const std::string& name, CapOptions options) try {
  const auto colon = std::min(name.find(':'), name.size());
  const std::string kind = name.substr(0, colon);
  if (colon < name.size() && kind == "slice")
    options.window = SLF_TRY(at_place(window_of(name.substr(colon + 1)), "cap ", name));
  else if (colon < name.size() ||
           !std::set<std::string>{"", "shaded", "coarse", "slice", "hollow"}.contains(kind))
    return fail_without("cap", ErrorCode::usage, "cap ", name,
                        ": expected shaded, coarse, slice, slice:LO,HI or hollow");
  if (kind == "hollow" || clip.empty()) return std::shared_ptr<const Scene>();
  const std::string provenance = field.provenance();
  const bool composed = json::parse(provenance).contains("composed");
  const auto reveal = SLF_TRY(field.reveal());
  if ((!reveal || composed) && kind.empty()) return std::shared_ptr<const Scene>();
  if (!reveal || composed)
    return misuse(field.path(), composed ? "its structures are faded or tinted" : "has no reveal",
                  ": cap hollow needs none");
  options.cap = kind == "slice" ? Cap::slice : Cap::shaded;
  options.coarse_light = kind == "coarse";
  return make_cap(*reveal, provenance, clip, options);
} catch (...) {
  return tl::unexpected(error_of_exception());
}

}  // namespace slf

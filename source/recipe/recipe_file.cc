// Recipes in JSON, and the scenes of their states.
#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "base/file.h"
#include "base/join.h"
#include "base/nesting.h"
#include "base/try.h"
#include "source/recipe/options.h"
#include "source/recipe/scenes.h"
#include "source/volume/formats.h"

namespace slf {
namespace {

using nlohmann::json;

constexpr std::uint64_t kMaxBytes = 16 << 20;

/// The folder of a file; empty for the working folder.
std::string folder_of(const std::string& file) {
  return std::filesystem::path(file).parent_path().string();
}

/// Sets what the JSON states, but for options that `kept` names.
Result<void> set_all(Recipe& recipe, const json& options, const std::string& folder,
                     const std::set<std::string, std::less<>>& kept = {}) {
  for (const auto& [name, value] : options.items()) {
    const auto* const option = recipe::find(name);
    if (option && (kept.contains(option->name) || recipe::rival_of(*option, kept))) continue;
    if (option && option->excludes && !value.is_null() &&
        !options.value(option->excludes, json()).is_null())
      return fail_without(option->name, ErrorCode::usage, name, ": not beside ", option->excludes);
    SLF_TRY(recipe::set(recipe, name, value, folder));
  }
  return {};
}

/// Takes a member out of an object.
json taken(json& from, const char* name, const json& otherwise) {
  json value = from.value(name, otherwise);
  from.erase(name);
  return value;
}

Result<RecipeState> state_of(json state, const std::string& file) {
  if (!state.is_object()) return fail(ErrorCode::usage, "expected an object");
  const json name = taken(state, "name", ""), from = taken(state, "light_from", "");
  if (!name.is_string() || name.get<std::string>().empty())
    return fail(ErrorCode::usage, "has no name");
  if (!from.is_string()) return fail(ErrorCode::usage, "light_from: expected a name");
  RecipeState made{name, {}, file, from};
  if (state.value("time", json()) == "all") {
    state.erase("time");
    made.each_time = true;
  }
  Recipe tried;
  SLF_TRY(set_all(tried, state, folder_of(file)));
  made.options = state.dump();
  return made;
}

/// "labels-volume" as "labels_volume", in all objects but those that are values.
json with_underscores(const json& from) {
  json to = json::object();
  for (const auto& [name, value] : from.items()) {
    std::string plain = name;
    std::ranges::replace(plain, '-', '_');
    to[plain] = value;
  }
  if (const auto states = to.find("states"); states != to.end() && states->is_array())
    for (json& state : *states)
      if (state.is_object()) state = with_underscores(state);
  return to;
}

/// Whether a result is the error of a choice that was not made.
template <class T>
bool lacks(std::string_view choice, const Result<T>& result) {
  return !result && result.error().choice && choice == result.error().choice;
}

/// Adds the scenes of a state: those of each time point, if it has several.
Result<void> add_state(StateScenes& to, const Recipe& common, const RecipeState& state) {
  Recipe recipe = common;
  recipe.states.clear();
  const json own_options = json::parse(state.options);
  SLF_TRY(set_all(recipe, own_options, folder_of(state.file)));
  // What does not apply to this kind of source is not taken over.
  const recipe::Kind kind = recipe::kind_of(recipe);
  for (const recipe::Option& option : recipe::options())
    if (!(option.kinds & kind) && !own_options.contains(option.name))
      SLF_TRY(recipe::set(recipe, option.name, nullptr));
  recipe.each_time = recipe.each_time || state.each_time;
  if (!recipe.each_time) return to.add(state.name, std::move(recipe), state.light_from);
  const auto at = [&](unsigned time) {
    Recipe own = recipe;
    own.reading.time = time;
    return own;
  };
  const auto add = [&](unsigned time) {
    return to.add(concat(state.name, " ", time), at(time), state.light_from);
  };
  const auto keep_colors = [&](const Scene& of) {  // values keep their colours over time
    recipe.raycast.may_be_empty = true;
    const auto shown = json::parse(of.provenance());
    if (shown.value("labels", false)) return;
    recipe.transfer.clear();
    recipe.range.reset();
    recipe.make_transfer = [colors = shown["transfer"].dump()](const Volume&) {
      return parse_transfer(colors, "the first time");
    };
  };
  auto added = add(0);
  // Where the first times show nothing, the colours are those of the first one that does.
  for (unsigned time = 1; lacks("transfer", added); ++time) {
    Recipe own = at(time);
    own.on_note = {};  // add() notes the same
    auto scene = make_scene(own);
    if (lacks("time", scene)) break;
    if (lacks("transfer", scene)) continue;
    const auto shows = SLF_TRY(std::move(scene));
    keep_colors(*shows);
    added = add(0);
  }
  SLF_TRY(added);
  keep_colors(*to.scenes().back().scene);
  for (unsigned time = 1; !lacks("time", added = add(time)); ++time) SLF_TRY(added);
  return {};
}

}  // namespace

Result<void> recipe::add_states(Recipe& to, const json& states, const std::string& file) {
  if (!states.is_array() || states.empty())
    return fail(ErrorCode::usage, "states: expected [{\"name\": TEXT, OPTION: VALUE, ...}, ...]");
  if (states.size() > kMaxStates)
    return fail(ErrorCode::usage, states.size(), " states; a field has at most ", kMaxStates);
  std::set<std::string> names;
  for (std::size_t k = 0; k < states.size(); ++k) {
    auto state = state_of(states[k], file);
    if (!state) return fail_in(state.error(), "states[", k, "]: ");
    if (!names.insert(state->name).second)
      return fail(ErrorCode::usage, "states[", k, "]: has the name of another, ", state->name);
    to.states.push_back(std::move(*state));
  }
  return {};
}

bool is_recipe(std::string_view input) {
  return input.ends_with(".json") && !input.starts_with(recipe::kPicturesPrefix);
}

Result<void> read_recipe(const std::string& path, Recipe& to) try {
  const auto bytes = SLF_TRY(read_file(path, kMaxBytes));
  json options;
  try {
    options = json::parse(chars_of(bytes), limit_nesting);
  } catch (const std::exception& error) {
    return bad_file(path, "not JSON: ", error.what());
  }
  if (options.is_array()) options = {{"states", options}};
  if (!options.is_object()) return bad_file(path, "no recipe: expected {OPTION: VALUE, ...}");
  options = with_underscores(options);
  options.erase("$schema");
  const json states = taken(options, "states", nullptr);
  if (to.input == path) {
    to.input.clear();
    to.stated.erase("input");
  }
  const auto ok = [&]() -> Result<void> {
    SLF_TRY(set_all(to, options, folder_of(path), std::set(to.stated)));
    if (!states.is_null()) SLF_TRY(recipe::add_states(to, states, path));
    return {};
  }();
  if (ok) return {};
  SLF_TRY(volume_io::refuse_known(path, chars_of(bytes).substr(0, 4096)));
  if (options.contains("frames"))
    return bad_file(path, "has pictures with cameras, not a volume: name it pictures:", path);
  auto error = bad_file(path, ok.error().message);
  error.value().choice = ok.error().choice;
  return error;
} catch (...) {
  return tl::unexpected(error_of_exception());
}

Result<std::vector<NamedScene>> make_scenes(const Recipe& recipe) try {
  if (recipe.each_label) {
    if (!recipe.states.empty())
      return fail(ErrorCode::usage, "each_label makes states itself: state no others");
    return make_label_scenes(recipe);
  }
  if (recipe.states.empty() && !recipe.each_time) {
    std::shared_ptr<const Scene> scene = SLF_TRY(make_scene(recipe));
    return std::vector<NamedScene>{{"", scene, recipe::published(recipe, *scene)}};
  }
  StateScenes made;
  const std::vector<RecipeState> times{{"time", "{}"}};
  for (const RecipeState& state : recipe.states.empty() ? times : recipe.states)
    if (auto ok = add_state(made, recipe, state); !ok)
      return fail_in(ok.error(), state.file, state.file.empty() ? "" : ": ", "state '", state.name,
                     "': ");
  return made.scenes();
} catch (...) {
  return tl::unexpected(error_of_exception());
}

std::vector<FieldState> field_states(const std::vector<NamedScene>& scenes) {
  std::vector<FieldState> states;
  states.reserve(scenes.size());
  for (const NamedScene& one : scenes) states.push_back({one.name, one.scene.get(), one.recipe});
  return states;
}

}  // namespace slf

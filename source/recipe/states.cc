// The scenes of states, and of the structures of labels.
#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>
#include <utility>

#include "base/join.h"
#include "base/try.h"
#include "source/raycast/provenance.h"
#include "source/recipe/options.h"
#include "source/recipe/scenes.h"

namespace slf {
namespace {

using nlohmann::json;
using recipe::Readings;

/// Labels that are one structure.
struct LabelGroup {
  std::string name;
  std::vector<std::int64_t> ids;
};

Result<std::vector<LabelGroup>> label_groups(const Recipe& d, Readings* kept) {
  const auto labels = SLF_TRY(recipe::labels_of(d, kept));
  if (!labels.labels)
    return fail_without("labels", ErrorCode::usage, labels.source,
                        ": holds amounts, not labels of structures");
  const auto styles = SLF_TRY(recipe::styles_of(d, labels));
  const auto& only = d.only_labels;
  std::vector<LabelGroup> groups;
  for (const std::int64_t id : label_ids(labels)) {
    const auto style = styles.find(id);
    if (id == 0 || (style != styles.end() && style->second.opacity == 0)) continue;
    if (!only.empty() && std::ranges::find(only, id) == only.end()) continue;
    std::string name = style != styles.end() ? style->second.name : "";
    if (name.empty()) name = "label " + std::to_string(id);
    const auto same = std::ranges::find(groups, name, &LabelGroup::name);
    (same != groups.end() ? *same : groups.emplace_back(LabelGroup{name, {}})).ids.push_back(id);
  }
  if (groups.empty())
    return fail_without("label_table", ErrorCode::usage, labels.source, ": has no visible label");
  return groups;
}

}  // namespace

std::string name_of_state(std::string path, std::string state) {
  constexpr std::string_view kState = "{state}";
  std::ranges::replace_if(
      state, [](unsigned char c) { return c == '/' || c < ' '; }, '_');
  for (std::size_t at = 0; (at = path.find(kState, at)) != std::string::npos; at += state.size())
    path.replace(at, kState.size(), state);
  return path;
}

/// What the scenes have in common, and what is known of them.
struct StateScenes::Shared {
  Readings readings{};
  std::shared_ptr<SharedScenes> scenes = share_scenes();
  std::shared_ptr<std::set<std::string>> noted = std::make_shared<std::set<std::string>>();
  std::map<std::string, std::pair<std::string, std::string>> lights{};  // by file: state and key

  Result<std::unique_ptr<Scene>> make(Recipe d) {
    d.raycast.shared = scenes;
    if (d.on_note)
      d.on_note = [once = noted, on_note = d.on_note](const std::string& text, const char* choice) {
        if (once->insert(text).second) on_note(text, choice);
      };
    return recipe::scene_of(d, &readings);
  }
};

StateScenes::StateScenes() : shared_(std::make_unique<Shared>()) {}
StateScenes::~StateScenes() = default;

Result<void> StateScenes::add(const std::string& name, Recipe d,
                              const std::string& light_from) try {
  std::string& file = d.light_volume.file;
  file = name_of_state(file, name);
  std::shared_ptr<const Scene> scene = SLF_TRY(shared_->make(d));
  if (!light_from.empty()) {
    const auto from = std::ranges::find(made_, light_from, &NamedScene::name);
    if (from == made_.end())
      return fail(ErrorCode::usage, "no earlier state is named '", light_from,
                  "', whose light this one has");
    SLF_TRY(scene->share_light(from->scene).map_error([&](const Error& error) {
      return Error{error.code, concat("the light of '", light_from, "': ", error.message)};
    }));
  } else if (!file.empty() && json::parse(scene->provenance()).contains("lighting")) {
    const std::string key = light_key(scene->provenance());
    const auto& [other, others] = shared_->lights.try_emplace(file, name, key).first->second;
    if (others != key)
      return fail_without("light_file", ErrorCode::usage, file, ": has the light of state '", other,
                          "'; {state} in its name gives each its own");
  }
  std::string text = recipe::published(d, *scene, light_from);
  made_.push_back({name, std::move(scene), std::move(text)});
  return {};
} catch (...) {
  return tl::unexpected(error_of_exception());
}

Result<std::vector<NamedScene>> make_label_scenes(Recipe d) try {
  SLF_TRY(recipe::check_applies(d));
  if (d.check) SLF_TRY(d.check(d.files()));
  StateScenes states;
  const auto groups = SLF_TRY(label_groups(d, &states.shared_->readings));
  const Recipe whole = d;
  for (const LabelGroup& group : groups) {
    d.only_labels = group.ids;
    auto visible = states.shared_->make(d);
    const char* const choice = visible ? nullptr : visible.error().choice;
    if (choice && std::string_view(choice) == "only_labels" &&
        (!states.made_.empty() || &group != &groups.back())) {
      recipe::note(d, group.name + ": no voxel of it is visible, so it is no state");
      continue;
    }
    std::shared_ptr<const Scene> scene = SLF_TRY(std::move(visible));
    states.made_.push_back({group.name, scene, recipe::published(whole, *scene)});
  }
  return std::move(states.made_);
} catch (...) {
  return tl::unexpected(error_of_exception());
}

}  // namespace slf

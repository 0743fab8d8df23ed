// The states of a field to build: a JSON file of options that differ between them.
#include <algorithm>
#include <set>

#include "base/file.h"
#include "base/join.h"
#include "base/try.h"
#include "cli/command.h"

namespace slf::cli {
namespace {

constexpr std::uint64_t kMaxStatesFile = 16 << 20;
constexpr const char* kLightFrom = "light-from";

/// The arguments of the command line that a member of a state stands for. A list of lists is an
/// option that is repeated.
void append_arguments(const std::string& name, const nlohmann::json& value,
                      std::vector<std::string>& to) {
  const auto text = [](const nlohmann::json& one) {
    return one.is_string() ? one.get<std::string>() : one.dump();
  };
  if (value.is_array() && !value.empty() && value[0].is_array()) {
    for (const auto& each : value) append_arguments(name, each, to);
  } else if (value.is_array()) {
    to.push_back("--" + name + "=" + joined(value, ",", text));
  } else if (value == true) {
    to.push_back("--" + name);
  } else if (value != false) {
    to.push_back("--" + name + "=" + text(value));
  }
}

/// The options of a state in place of `common` ones.
Result<SourceArguments> arguments_of(const nlohmann::json& state, const SourceArguments& common) {
  SourceArguments source = common;
  CLI::App options;
  source.add_volume_to(options, "--input");
  source.add_light_to(options);
  source.add_pictures_to(options);
  options.get_option("--input")->required(false);
  std::vector<std::string> arguments;
  for (const auto& [name, value] : state.items()) {
    if (name == "name" || name == kLightFrom) continue;
    if (name.starts_with('-') || !options.get_option_no_throw("--" + name))
      return fail(
          ErrorCode::usage, "'", name,
          "' is no option of a volume, its light, a mesh or pictures: see slf build --help");
    append_arguments(name, value, arguments);
  }
  std::ranges::reverse(arguments);  // as CLI11 expects it
  try {
    options.parse(arguments);
  } catch (const CLI::ParseError& error) {
    return fail(ErrorCode::usage, error.what());
  }
  return source;
}

/// Gives the scene the light of the state that `state` names, one of those that were made.
Result<void> share_light(const nlohmann::json& state, const std::vector<MadeState>& made,
                         const Scene& scene) {
  if (!state.contains(kLightFrom)) return {};
  const std::string name = text_of(state, kLightFrom, "");
  const auto from = std::ranges::find(made, name, &MadeState::name);
  if (from == made.end()) return misuse(kLightFrom, "no earlier state is named '", name, "'");
  return scene.share_light(from->scene).map_error([&](const Error& error) {
    return Error{error.code, fmt::format("{}: '{}': {}", kLightFrom, name, error.message)};
  });
}

Result<nlohmann::json> read_states(const std::string& path) {
  const auto bytes = SLF_TRY(read_file(path, kMaxStatesFile));
  nlohmann::json json;
  try {
    json = nlohmann::json::parse(chars_of(bytes));
  } catch (const nlohmann::json::exception& error) {
    return bad_file(path, "not JSON: ", error.what());
  }
  const nlohmann::json states = json.is_object() ? json.value("states", nlohmann::json()) : json;
  if (!states.is_array() || states.empty())
    return bad_file(path, R"(expected {"states": [{"name": TEXT, OPTION: VALUE, ...}, ...]})");
  std::set<std::string> names;
  for (std::size_t k = 0; k < states.size(); ++k) {
    const std::string name = states[k].is_object() ? text_of(states[k], "name", "") : "";
    if (name.empty() || !names.insert(name).second)
      return bad_file(path, "states[", k, "] has ",
                      name.empty() ? "no name" : "the name of another, " + name);
  }
  return states;
}

}  // namespace

Result<std::vector<MadeState>> make_label_states(const SourceArguments& common) {
  SourceArguments source = common;
  if (!source.labels_volume) {  // the volume of labels is read once, and all states share it
    SLF_TRY(source.check(source.files()));
    auto volume = SLF_TRY(hinted(read_volume(source)));
    for (const std::string& text : volume.notes) source.on_note(volume.source + ": " + text, {});
    volume.share();
    volume.notes.clear();
    source.volume = std::make_shared<const Volume>(std::move(volume));
  }
  std::vector<MadeState> made;
  const auto groups = SLF_TRY(hinted(label_groups(source)));
  for (const LabelGroup& group : groups) {
    source.only_labels = group.ids;
    auto scene = SLF_TRY(hinted(make_scene(source)));
    if (made.empty()) {
      SLF_TRY(scene->prepare());
      source.on_note = {};
    } else if (const auto light = made[0].scene->light(); !light.empty()) {
      (void)scene->set_light(light);
    }
    made.push_back({group.name, std::move(scene)});
  }
  return made;
}

Result<std::vector<MadeState>> make_states(const std::string& file, const SourceArguments& common,
                                           const std::string& last) {
  std::vector<MadeState> made;
  const auto states = SLF_TRY(read_states(file));
  std::string lit_by;  // what gives `last` its light
  for (const nlohmann::json& state : states)
    if (text_of(state, "name", "") == last) lit_by = text_of(state, kLightFrom, "");
  for (nlohmann::json state : states) {
    const std::string name = text_of(state, "name", "");
    const bool all = state.value("time", nlohmann::json()) == "all";
    const bool needed = last.empty() || made.empty() || all || name == last || name == lit_by;
    for (unsigned time = 0; needed; ++time) {
      if (all) state["time"] = time;
      const auto own = arguments_of(state, common);
      auto scene = own ? make_scene(*own) : tl::unexpected(own.error());
      // There are no more times in the file.
      if (all && time > 0 && !scene && scene.error().choice &&
          std::string_view(scene.error().choice) == "time")
        break;
      scene = hinted(std::move(scene));
      const auto ok = scene ? share_light(state, made, **scene) : tl::unexpected(scene.error());
      if (!ok) return fail(ok.error().code, file, ": state '", name, "': ", ok.error().message);
      made.push_back({all ? fmt::format("{} {}", name, time) : name, std::move(*scene)});
      if (made.back().name == last || std::to_string(made.size() - 1) == last) return made;
      if (!all) break;
    }
  }
  if (!last.empty()) return misuse(file, "has no state '", last, "'");
  return made;
}

}  // namespace slf::cli

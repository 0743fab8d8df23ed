// The states of a field to build: a JSON file of options that differ between them.
#include <algorithm>
#include <map>
#include <set>

#include "base/file.h"
#include "base/join.h"
#include "base/nesting.h"
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

/// The options of the state `name` in place of `common` ones.
Result<SourceArguments> arguments_of(const nlohmann::json& state, const std::string& name,
                                     const SourceArguments& common) {
  SourceArguments source = common;
  CLI::App options;
  options.set_help_flag();
  source.add_volume_to(options, "--input");
  source.add_light_to(options);
  source.add_pictures_to(options);
  options.get_option("--input")->required(false);
  std::vector<std::string> arguments;
  for (const auto& [option, value] : state.items()) {
    if (option == "name" || option == kLightFrom) continue;
    if (option.starts_with('-') || !options.get_option_no_throw("--" + option))
      return fail(
          ErrorCode::usage, "'", option,
          "' is no option of a volume, its light, a mesh or pictures: see slf build --help");
    append_arguments(option, value, arguments);
  }
  std::ranges::reverse(arguments);  // as CLI11 expects it
  try {
    options.parse(arguments);
  } catch (const CLI::ParseError& error) {
    return fail(ErrorCode::usage, error.what());
  }
  if (options.count("--lighting") > 0) source.raycast.projection = Projection::none;
  source.light_volume.file = name_of_state(source.light_volume.file, name);
  return source;
}

/// Gives the scene the light of the state that `state` names, one of those that were made.
Result<void> share_light(const nlohmann::json& state, const std::vector<NamedScene>& made,
                         const Scene& scene) {
  if (!state.contains(kLightFrom)) return {};
  const std::string name = text_of(state, kLightFrom, "");
  const auto from = std::ranges::find(made, name, &NamedScene::name);
  if (from == made.end()) return misuse(kLightFrom, "no earlier state is named '", name, "'");
  return scene.share_light(from->scene).map_error([&](const Error& error) {
    return Error{error.code, fmt::format("{}: '{}': {}", kLightFrom, name, error.message)};
  });
}

/// usage: one of the states in `files` keeps its light in the same file.
Result<void> check_light_file(const nlohmann::json& state, const SourceArguments& source,
                              const std::string& name, std::map<std::string, std::string>& files) {
  const std::string& file = source.light_volume.file;
  if (file.empty() || state.contains(kLightFrom) || source.lighting == Lighting::direct) return {};
  const auto [other, added] = files.emplace(file, name);
  if (added) return {};
  return fail(ErrorCode::usage, "--light-file ", file, ": has the light of state '", other->second,
              "'; {state} in its name gives each its own");
}

Result<nlohmann::json> read_states(const std::string& path) {
  const auto bytes = SLF_TRY(read_file(path, kMaxStatesFile));
  nlohmann::json json;
  try {
    json = nlohmann::json::parse(chars_of(bytes), limit_nesting);
  } catch (const std::exception& error) {
    return bad_file(path, "not JSON: ", error.what());
  }
  const nlohmann::json states = json.is_object() ? json.value("states", nlohmann::json()) : json;
  if (!states.is_array() || states.empty())
    return bad_file(path, R"(expected {"states": [{"name": TEXT, OPTION: VALUE, ...}, ...]})");
  if (states.size() > kMaxStates)
    return bad_file(path, states.size(), " states; a field has at most ", kMaxStates);
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

Result<std::vector<NamedScene>> make_states(const std::string& file, const SourceArguments& common,
                                            const std::string& last) {
  std::vector<NamedScene> made;
  const auto states = SLF_TRY(read_states(file));
  bool named = false;  // else `last` is a number, or a time's name
  std::string lit_by;  // what gives `last` its light
  for (const nlohmann::json& state : states)
    if (text_of(state, "name", "") == last) named = true, lit_by = text_of(state, kLightFrom, "");
  std::map<std::string, std::string> light_files;
  for (nlohmann::json state : states) {
    const std::string stem = text_of(state, "name", "");
    const bool all = state.value("time", nlohmann::json()) == "all";
    const bool needed = !named || made.empty() || all || stem == last || stem == lit_by;
    for (unsigned time = 0; needed; ++time) {
      if (all) state["time"] = time;
      const std::string name = all ? fmt::format("{} {}", stem, time) : stem;
      auto own = arguments_of(state, name, common);
      if (own && time > 0 && !own->reading.labels) {  // values keep their colours over time
        own->transfer.clear(), own->range.reset();
        own->make_transfer = [first = made.back().scene](const Volume& volume) {
          if (volume.labels) return Result<TransferFunction>(default_transfer(volume));
          const auto built = nlohmann::json::parse(first->provenance());
          return parse_transfer(built["transfer"].dump(), "the first time");
        };
      }
      auto scene = own ? make_scene(*own) : tl::unexpected(own.error());
      // There are no more times in the file.
      if (all && time > 0 && !scene && scene.error().choice &&
          std::string_view(scene.error().choice) == "time")
        break;
      scene = hinted(std::move(scene));
      auto ok = scene ? share_light(state, made, **scene) : tl::unexpected(scene.error());
      if (ok && last.empty()) ok = check_light_file(state, *own, name, light_files);
      if (!ok) return fail(ok.error().code, file, ": state '", stem, "': ", ok.error().message);
      made.push_back({name, std::move(*scene)});
      if (name == last || (!named && std::to_string(made.size() - 1) == last)) return made;
      if (!all) break;
    }
  }
  if (!last.empty()) return misuse(file, "has no state '", last, "'");
  return made;
}

}  // namespace slf::cli

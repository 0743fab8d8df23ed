// The states of a field to build: a JSON file of options that differ between them.
#include <algorithm>
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

/// The options of the state in place of `common` ones.
Result<SourceArguments> arguments_of(const nlohmann::json& state, const SourceArguments& common) {
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
  return source;
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

Result<std::vector<NamedScene>> make_states(const std::string& file,
                                            const SourceArguments& common) {
  StateScenes made;
  const auto states = SLF_TRY(read_states(file));
  for (nlohmann::json state : states) {
    const std::string stem = text_of(state, "name", "");
    const bool all = state.value("time", nlohmann::json()) == "all";
    for (unsigned time = 0;; ++time) {
      if (all) state["time"] = time;
      auto own = arguments_of(state, common);
      if (own && time > 0) {  // values keep their colours over time
        const auto before = nlohmann::json::parse(made.scenes().back().scene->provenance());
        if (!before.value("labels", false)) {
          own->transfer.clear(), own->range.reset();
          own->make_transfer = [colors = before["transfer"].dump()](const Volume&) {
            return parse_transfer(colors, "the first time");
          };
        }
      }
      auto ok = own ? made.add(all ? fmt::format("{} {}", stem, time) : stem, *own,
                               text_of(state, kLightFrom, ""))
                    : tl::unexpected(own.error());
      // There are no more times in the file.
      if (all && time > 0 && !ok && ok.error().choice &&
          std::string_view(ok.error().choice) == "time")
        break;
      SLF_TRY(at_place(hinted(std::move(ok)), file, ": state '", stem, "'"));
      if (!all) break;
    }
  }
  return made.scenes();
}

std::vector<FieldState> field_states(const std::vector<NamedScene>& scenes) {
  std::vector<FieldState> states;
  for (const NamedScene& one : scenes) states.push_back({one.name, one.scene.get()});
  return states;
}

}  // namespace slf::cli

#include <algorithm>
#include <array>
#include <filesystem>
#include <fstream>

#include "base/try.h"
#include "cli/command.h"
#include "slf/remote.h"

namespace slf::cli {
#ifdef SLF_REMOTE
namespace {

/// The remote fields that were opened, for their traffic.
std::vector<RemoteField> remote_fields;

Result<Field> open_first_state(const std::string& path) {
  if (!is_address(path)) return Field::open(path);
  auto remote =
      SLF_TRY(RemoteField::open(path, {}, late_progress_bar("fetch", "bytes", OnSignal::end)));
  remote_fields.push_back(remote);
  return remote.field();
}

}  // namespace

nlohmann::json traffic_json() {
  if (remote_fields.empty()) return {};
  RemoteTraffic sum;
  for (const RemoteField& field : remote_fields) {
    const RemoteTraffic traffic = field.traffic();
    sum.requests += traffic.requests;
    sum.repeated += traffic.repeated;
    sum.bytes += traffic.bytes;
  }
  return {{"requests", sum.requests}, {"repeated", sum.repeated}, {"bytes", sum.bytes}};
}
#else
namespace {

Result<Field> open_first_state(const std::string& path) {
  if (!is_address(path)) return Field::open(path);
  return unsupported(path, "this slf was built without libcurl and does not read fields over HTTP");
}

}  // namespace

nlohmann::json traffic_json() { return {}; }
#endif

Result<Field> show_state(const Field& field, const std::string& state) {
  if (state.empty()) return field;
  unsigned number = 0;
  const auto names = field.states();
  const bool named = std::ranges::find(names, state) != names.end();
  return hinted(!named && CLI::detail::lexical_cast(state, number) ? field.in_state(number)
                                                                   : field.in_state(state));
}

Result<Field> open_field(const std::string& path, const std::string& state) {
  const auto field = SLF_TRY(open_first_state(path));
  return show_state(field, state);
}

Result<void> add_states(const std::string& input, const std::vector<std::string>& chosen,
                        std::vector<StateSource>& states) {
  const auto first = SLF_TRY(open_field(input));
  const std::vector<std::string> names = first.states();
  if (names.empty() && chosen.empty())
    states.push_back({std::filesystem::path(input).stem(), first});
  for (const std::string& name : chosen.empty() ? names : chosen) {
    const auto field = SLF_TRY(show_state(first, name));
    states.push_back({field.states().empty() ? "" : names[field.state()], field});
  }
  return {};
}

void FieldArguments::add_to(CLI::App& command, const char* help) {
  command.add_option("FIELD", path, help)->type_name(kFieldFile)->required();
  add_state(command, "--state", state,
            "The state of the field to show: its name or number, from 0");
}

void add_state(CLI::App& command, const char* name, std::string& state, const char* help) {
  command.add_option(name, state, help)->type_name("STATE");
}

bool is_field(const std::string& path) {
  if (is_address(path) || path.ends_with(".slf") || path.ends_with(".slf.unfinished")) return true;
  // FORMAT.md, "Pages": the magic number of the first page.
  std::error_code ignored;
  std::array<char, 20> head{};
  return std::filesystem::is_regular_file(path, ignored) &&
         std::ifstream(path).read(head.data(), head.size()) &&
         std::string_view(head.data() + 16, 4) == "\xDE\xC0\xEF\xBE";
}

}  // namespace slf::cli

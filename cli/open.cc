#include <algorithm>
#include <array>
#include <filesystem>
#include <fstream>
#include <span>

#include "base/try.h"
#include "cli/command.h"

namespace slf::cli {
namespace {

/// The remote fields that were opened, for their traffic.
std::vector<RemoteField> remote_fields;
RemoteOptions remote_options;

}  // namespace

void add_cache(CLI::App& app) {
  app.add_option("--cache", remote_options.cache,
                 "Keep what is read of fields on web servers, for later commands")
      ->type_name(kFolder);
  add_bytes(app, "--cache-size", remote_options.cache_bytes,
            "The least recently used beyond are removed")
      ->default_str("1GiB")
      ->needs("--cache");
}

std::optional<RemoteTraffic> traffic() {
  if (remote_fields.empty()) return std::nullopt;
  RemoteTraffic sum;
  for (const RemoteField& field : remote_fields) {
    const RemoteTraffic one = field.traffic();
    sum.requests += one.requests;
    sum.repeated += one.repeated;
    sum.bytes += one.bytes;
  }
  return sum;
}

Result<Field> open_field(const std::string& path, const std::string& state) {
  const auto field = SLF_TRY(slf::open_field(
      path, late_progress_bar("fetch", "bytes", OnSignal::end), &remote_fields, remote_options));
  return state.empty() ? field : hinted(field.in_state(state));
}

std::vector<std::string> join_names(const Field& field, std::span<const std::string> split) {
  const std::vector<std::string> names = field.states();
  const auto is_state = [&](const std::string& name) {
    return std::ranges::find(names, name) != names.end();
  };
  std::vector<std::string> joined;
  for (; !split.empty(); split = split.subspan(1)) {
    std::string name = split[0];
    for (std::size_t k = 1; k < std::min<std::size_t>(8, split.size()) && !is_state(split[0]); ++k)
      if (is_state(name += "," + split[k])) {
        split = split.subspan(k);
        break;
      }
    joined.push_back(is_state(name) ? name : split[0]);
  }
  return joined;
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

#include <fcntl.h>
#include <malloc.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstdio>

#include "base/utf8.h"
#include "cli/command.h"

namespace slf::cli {
namespace {

std::string scaled(double value, double base, const std::array<const char*, 5>& units) {
  std::size_t unit = 0;
  while (value >= base && unit + 1 < units.size()) value /= base, ++unit;
  const int digits = unit == 0 || value >= 100 ? 0 : value < 10 ? 2 : 1;
  return fmt::format("{:.{}f} {}", value, digits, units[unit]);
}

}  // namespace

bool quiet = false;
std::map<std::string, OutputSchema> output_schemas;

void reserve_standard_streams() {
  for (const int stream : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO})
    if (fcntl(stream, F_GETFD) < 0 && errno == EBADF) (void)open("/dev/null", O_RDONLY);
}

std::string printable(std::string_view text, Lines lines) {
  std::string out;
  while (!text.empty()) {
    const std::size_t length = utf8_length(text);
    const std::string_view character = text.substr(0, std::max<std::size_t>(length, 1));
    const bool begins_line =
        character == "\n" && lines == Lines::indented && !text.substr(1).starts_with("  ");
    if (length > 0 && !is_control(character) && !begins_line)
      out += character;
    else
      out += escaped(character);
    text.remove_prefix(character.size());
  }
  return out;
}

void print_text(std::string_view text) {
  const std::string line = printable(text);
  std::fwrite(line.data(), 1, line.size(), stdout);
}

void message(const std::string& text, Lines lines) {
  const std::string line = printable(text, lines) + "\n";
  std::fflush(stdout);  // keeps the order if both streams go to one place
  std::fwrite(line.data(), 1, line.size(), stderr);
}

void note(const std::string& text) {
  if (!quiet) message(text);
}

void print_document(nlohmann::json json) {
  if (const auto sum = traffic(); sum && json.is_object()) json["http"] = report::json_of(*sum);
  print_text(json.dump(2, ' ', false, nlohmann::json::error_handler_t::replace) + "\n");
}

std::string text_of(const nlohmann::json& json, const char* key, const std::string& otherwise) {
  if (!json.is_object() || !json.contains(key) || !json[key].is_string()) return otherwise;
  return json[key].get<std::string>();
}

std::string human_bytes(double bytes) {
  return scaled(bytes, 1024, {"B", "KiB", "MiB", "GiB", "TiB"});
}

std::string human_count(double count) { return scaled(count, 1000, {"", "k", "M", "G", "T"}); }

std::string human_time(double seconds) {
  if (!(seconds < 1e6)) return "days";
  const long s = std::lround(seconds);
  return s < 3600 ? fmt::format("{}:{:02}", s / 60, s % 60)
                  : fmt::format("{}:{:02}:{:02}", s / 3600, s / 60 % 60, s % 60);
}

void bound_freed_memory(std::uint64_t budget) {
#ifdef __GLIBC__
  const std::uint64_t given = budget ? budget : kDefaultBudget;
  const auto most = static_cast<int>(std::min<std::uint64_t>(given, 1 << 30));
  mallopt(M_MMAP_THRESHOLD, most / 256);
  mallopt(M_TRIM_THRESHOLD, most / 4);
#endif
}

void note_budget(const std::string& output, std::uint64_t given, std::uint64_t used) {
  if (given == 0 && used > kDefaultBudget)
    note(output + ": its tiles needed a budget of " + human_bytes(used) + ", more than the usual " +
         human_bytes(kDefaultBudget) + "; see --memory");
}

void print_table(const std::vector<std::string>& rows) {
  std::vector<std::size_t> width;
  for (const std::string& row : rows) {
    const auto cells = CLI::detail::split(row, '\t');
    width.resize(std::max(width.size(), cells.size()));
    for (std::size_t c = 0; c < cells.size(); ++c) width[c] = std::max(width[c], cells[c].size());
  }
  for (const std::string& row : rows) {
    const auto cells = CLI::detail::split(row, '\t');
    std::string line = fmt::format("{:<{}}", cells[0], width[0]);
    for (std::size_t c = 1; c < cells.size(); ++c)
      line += fmt::format("  {:>{}}", cells[c], width[c]);
    print("{}\n", line);
  }
}

}  // namespace slf::cli

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdio>

#include "cli/command.h"

namespace slf::cli {
namespace {

volatile std::sig_atomic_t signalled = 0;

std::string scaled(double value, double base, const std::array<const char*, 5>& units,
                   const char* separator) {
  std::size_t unit = 0;
  while (value >= base && unit + 1 < units.size()) value /= base, ++unit;
  return unit == 0 ? fmt::format("{:.0f}{}{}", value, separator, units[0])
                   : fmt::format("{:.{}f}{}{}", value,
                                 value < 10    ? 2
                                 : value < 100 ? 1
                                               : 0,
                                 separator, units[unit]);
}

std::string human_time(double seconds) {
  const long s = std::lround(seconds);
  return s < 3600 ? fmt::format("{}:{:02}", s / 60, s % 60)
                  : fmt::format("{}:{:02}:{:02}", s / 3600, s / 60 % 60, s % 60);
}

}  // namespace

bool quiet = false;

bool interrupted() { return signalled != 0; }

void watch_signals() {
  for (const int signal : {SIGINT, SIGTERM}) std::signal(signal, [](int) { signalled = 1; });
}

void note(const std::string& text) {
  if (!quiet) fmt::print(stderr, "{}\n", text);
}

void print_json(const nlohmann::json& json) {
  fmt::print("{}\n", json.dump(2, ' ', false, nlohmann::json::error_handler_t::replace));
}

std::string text_of(const nlohmann::json& json, const char* key, const std::string& otherwise) {
  if (!json.is_object() || !json.contains(key) || !json[key].is_string()) return otherwise;
  return json[key].get<std::string>();
}

std::string human_bytes(double bytes) {
  return scaled(bytes, 1024, {"B", "KiB", "MiB", "GiB", "TiB"}, " ");
}

std::string human_count(double count) { return scaled(count, 1000, {"", "k", "M", "G", "T"}, " "); }

void print_table(const std::vector<std::vector<std::string>>& rows) {
  std::vector<std::size_t> width;
  for (const auto& row : rows)
    for (std::size_t c = 0; c < row.size(); ++c) {
      width.resize(std::max(width.size(), c + 1));
      width[c] = std::max(width[c], row[c].size());
    }
  for (const auto& row : rows) {
    std::string line;
    for (std::size_t c = 0; c < row.size(); ++c)
      line += c == 0 ? fmt::format("{:<{}}", row[c], width[c])
                     : fmt::format("  {:>{}}", row[c], width[c]);
    fmt::print("{}\n", line);
  }
}

ProgressCallback progress_bar(const std::string& title, const std::string& unit) {
  using Clock = std::chrono::steady_clock;
  const bool shown = !quiet && isatty(STDERR_FILENO) != 0;
  const auto start = Clock::now();
  return [=, last = start](const Progress& progress) mutable {
    const auto now = Clock::now();
    const bool finished = progress.done == progress.total;
    if (shown && (finished || now - last > std::chrono::milliseconds(100))) {
      last = now;
      const double seconds = std::chrono::duration<double>(now - start).count();
      const double rate =
          static_cast<double>(progress.done - progress.skipped) / std::max(seconds, 1e-9);
      const double share =
          progress.total ? static_cast<double>(progress.done) / static_cast<double>(progress.total)
                         : 1;
      const auto filled = static_cast<std::size_t>(share * 30);
      const double left =
          static_cast<double>(progress.total - progress.done) / std::max(rate, 1e-9);
      fmt::print(stderr, "\r{} [{}{}] {:3.0f} %  {}{}/s  {} left \x1b[K", title,
                 std::string(filled, '#'), std::string(30 - filled, '.'), 100 * share,
                 human_count(rate), unit, human_time(left));
      if (finished)
        fmt::print(stderr, "\r{}: {}{} in {}\x1b[K\n", title,
                   human_count(static_cast<double>(progress.total)), unit, human_time(seconds));
      std::fflush(stderr);
    }
    return !interrupted();
  };
}

}  // namespace slf::cli

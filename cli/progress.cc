// Shows the progress of long commands, and lets signals stop them.
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <sstream>
#include <utility>

#include "base/remaining_time.h"
#include "cli/command.h"

namespace slf::cli {
namespace {

volatile std::sig_atomic_t signalled = 0;

/// A line of --progress json.
struct ProgressLine {
  std::string task{}, unit{};
  std::uint64_t done = 0, total = 0, resumed = 0;
  double elapsed_seconds = 0;
  std::optional<double> remaining_seconds{};

  void describe(auto& member) const {
    member("task", task, "what is under way");
    member("unit", unit, "what is counted: rays, tiles, frames");
    member("done", done, "units");
    member("total", total, "units");
    member("resumed", resumed, "units of done that were there when the run began");
    member("elapsed_seconds", elapsed_seconds, "of this run", R"("minimum": 0)");
    member("remaining_seconds", remaining_seconds, "estimate; null while unknown");
  }
};
class ProgressBar {
 public:
  ProgressBar(std::string title, std::string unit)
      : title_(std::move(title)), unit_(std::move(unit)) {}

  void show(const Progress& progress) {
    const auto now = Clock::now();
    const bool finished = progress.done == progress.total;
    const double took = seconds(now - start_);
    const double rate = speed_.rate(progress, took);
    const auto left = speed_(progress, took);
    if (finished && std::exchange(finished_, finished)) return;  // work without progress follows
    finished_ = finished;
    const auto interval = terminal_ ? 0.1 : progress_style.seconds;
    if (quiet || (!terminal_ && interval <= 0)) return;
    const bool short_work = !terminal_ && !progress_style.json && last_ == start_;
    if (finished ? short_work : seconds(now - last_) < interval) return;
    last_ = now;
    const auto done = static_cast<double>(progress.done),
               total = static_cast<double>(progress.total);
    if (progress_style.json) {
      const ProgressLine line{title_,           unit_, progress.done, progress.total,
                              progress.skipped, took,  left};
      return message(report::json_of(line).dump());
    }
    if (finished) {
      write(fmt::format("{}: {}{} in {}", title_, human_count(total), unit_, human_time(took)),
            "\n");
      return;
    }
    const double share = total > 0 ? std::min(done / total, 1.0) : 1;
    const auto filled = static_cast<std::size_t>(share * 30);
    const std::string bar =
        terminal_ ? fmt::format(" [{}{}]", std::string(filled, '#'), std::string(30 - filled, '.'))
                  : ":";
    write(fmt::format("{}{} {:3.0f} %  {}{}/s  {} left", title_, bar, 100 * share,
                      human_count(rate), unit_, left ? human_time(*left) : "?"),
          terminal_ ? " " : "\n");
  }

 private:
  using Clock = std::chrono::steady_clock;

  static double seconds(Clock::duration duration) {
    return std::chrono::duration<double>(duration).count();
  }
  /// Writes a line; on a terminal, overwrites the previous one.
  void write(const std::string& text, const char* end) const {
    const std::string line = (terminal_ ? "\r" + text + "\x1b[K" : text) + end;
    std::fwrite(line.data(), 1, line.size(), stderr);
  }

  std::string title_, unit_;
  bool terminal_ = !progress_style.json && isatty(STDERR_FILENO) != 0;
  Clock::time_point start_ = Clock::now(), last_ = start_;
  RemainingTime speed_;
  bool finished_ = false;  ///< the last call reported the end
};

}  // namespace

ProgressStyle progress_style;

void add_progress(CLI::App& app) {
  app.add_option("--progress", progress_style,
                 "Seconds between lines of progress where stderr is no terminal, 0: none;\n"
                 "or json, or json:SECONDS: lines of JSON on stderr, for programs")
      ->type_name("SECONDS")
      ->default_str(fmt::format("{}", progress_style.seconds));
  output_schemas["progress"] = {"A line that `slf --progress json` writes to standard error",
                                {&report::schema_of<ProgressLine>},
                                /*lines=*/true};
}

std::istream& operator>>(std::istream& in, ProgressStyle& style) {
  constexpr double kJsonSeconds = 5;
  constexpr std::string_view kJson = "json";
  std::string text;
  in >> text;
  style.json = text.starts_with(kJson);
  if (style.json) text.erase(0, kJson.size());
  if (style.json && text.starts_with(':'))
    text.erase(0, 1);
  else if (style.json && text.empty())
    text = fmt::format("{}", kJsonSeconds);
  std::istringstream number(text);
  if (!(number >> style.seconds) || !number.eof() || !(style.seconds >= 0))
    in.setstate(std::ios::failbit);
  return in;
}

// The first signal is only recorded, so that the command can commit its work; the second one ends
// the process. Signals that the process ignores stay ignored.
void watch_signals() {
  for (const int signal : {SIGINT, SIGTERM}) {
    struct sigaction before {};
    sigaction(signal, nullptr, &before);
    if (before.sa_handler == SIG_IGN) continue;
    struct sigaction action {};
    action.sa_handler = [](int number) { signalled = number; };
    action.sa_flags = static_cast<int>(SA_RESETHAND);
    sigaction(signal, &action, nullptr);
  }
}

int stop_signal() { return signalled; }

ProgressCallback progress_bar(const std::string& title, const std::string& unit,
                              OnSignal on_signal) {
  return [bar = ProgressBar(title, unit), on_signal,
          watched = false](const Progress& progress) mutable {
    if (!watched && on_signal == OnSignal::stop) watch_signals();
    watched = true;
    bar.show(progress);
    return stop_signal() == 0;
  };
}

ProgressCallback late_progress_bar(const std::string& title, const std::string& unit,
                                   OnSignal on_signal) {
  return [title, unit, on_signal, bar = ProgressCallback()](const Progress& progress) mutable {
    if (!bar) bar = progress_bar(title, unit, on_signal);
    return bar(progress);
  };
}

ProgressCallback light_progress(OnSignal on_signal) {
  return late_progress_bar("light", "paths", on_signal);
}

}  // namespace slf::cli

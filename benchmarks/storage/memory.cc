#include <fcntl.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <thread>

#include "benchmarks/storage/expect.h"
#include "benchmarks/storage/scenarios.h"

extern char** environ;

namespace slf::bench {
namespace {

constexpr std::uint64_t kBudget = 16;  // MiB
constexpr std::uint64_t kAllowed = 32;

struct Peak {
  double anonymous = 0, resident = 0;  // MiB, as the kernel reports them
  double seconds = 0;
};

// A field of /proc/PID/status, in MiB; 0 once the process is gone.
double status_of(pid_t process, const std::string& name) {
  std::ifstream status("/proc/" + std::to_string(process) + "/status");
  for (std::string line; std::getline(status, line);)
    if (line.starts_with(name + ":")) return std::stod(line.substr(name.size() + 1)) / 1024;
  return 0;
}

Peak run_watched(const std::vector<std::string>& arguments) {
  std::vector<char*> pointers;
  for (const std::string& argument : arguments)
    pointers.push_back(const_cast<char*>(argument.c_str()));
  pointers.push_back(nullptr);
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, "/dev/null", O_WRONLY, 0);
  pid_t child = 0;
  require(posix_spawn(&child, pointers[0], &actions, nullptr, pointers.data(), environ) == 0,
          arguments[0] + ": cannot start");
  posix_spawn_file_actions_destroy(&actions);
  Peak peak;
  const double begin = now();
  int status = 0;
  while (waitpid(child, &status, WNOHANG) == 0) {
    peak.anonymous = std::max(peak.anonymous, status_of(child, "RssAnon"));
    peak.resident = std::max(peak.resident, status_of(child, "VmHWM"));
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  peak.seconds = now() - begin;
  require(WIFEXITED(status) && WEXITSTATUS(status) == 0,
          arguments[0] + " " + arguments[1] + " failed");
  return peak;
}

}  // namespace

void measure_memory(const Settings& settings, Report& report) {
  if (settings.slf.empty()) {
    report.note("memory of repack is left out: --slf does not name the command");
    return;
  }
  const std::string input = settings.folder + "/large.slf";
  const std::string output = settings.folder + "/repacked.slf";
  std::filesystem::remove(input);
  (void)run_watched({settings.slf, "-q", "build", "scene:balls", "--entry", "8", "--exit", "32",
                     "--levels", "2", "--codec", "raw", "-o", input});
  const double mib = static_cast<double>(std::filesystem::file_size(input)) / (1 << 20);
  const std::string budget = std::to_string(kBudget) + "MiB";
  std::vector<Row> rows;
  double worst = 0;
  const auto measure = [&](const std::string& what, const std::vector<std::string>& more) {
    std::filesystem::remove(output);
    std::vector<std::string> command{settings.slf, "-q",   "repack",   input,
                                     "-o",         output, "--memory", budget};
    command.insert(command.end(), more.begin(), more.end());
    const Peak peak = run_watched(command);
    worst = std::max(worst, peak.anonymous);
    rows.push_back({{"repack", what},
                    {"field MiB", mib},
                    {"field/budget", mib / static_cast<double>(kBudget)},
                    {"--memory MiB", kBudget},
                    {"peak RssAnon MiB", peak.anonymous},
                    {"peak RSS MiB", peak.resident},
                    {"s", peak.seconds}});
  };
  measure("copied", {});
  measure("to zstd:1", {"--codec", "zstd:1"});
  measure("to jpeg:75", {"--codec", "jpeg:75"});
  measure("to jpeg:75, 8 threads", {"--codec", "jpeg:75", "-j", "8"});
  report.table("memory of slf repack, sampled every 2 ms", rows);
  report.target("peak RssAnon above --memory, MiB", worst - static_cast<double>(kBudget),
                static_cast<double>(kAllowed), false);
  std::filesystem::remove(input);
  std::filesystem::remove(output);
}

}  // namespace slf::bench

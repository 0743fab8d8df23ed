#include "benchmarks/storage/report.h"

#include <sys/statfs.h>
#include <sys/utsname.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <sstream>
#include <thread>

#include "benchmarks/storage/expect.h"

namespace slf::bench {
namespace {

std::string processor() {
  std::ifstream info("/proc/cpuinfo");
  for (std::string line; std::getline(info, line);)
    if (line.starts_with("model name")) return line.substr(line.find(':') + 2);
  return "unknown";
}

// Text of one cell: numbers with about four digits.
std::string text_of(const Row& value) {
  if (value.is_string()) return value.get<std::string>();
  if (value.is_null()) return "-";
  if (value.is_boolean()) return value.get<bool>() ? "yes" : "no";
  if (value.is_number_integer()) return std::to_string(value.get<std::int64_t>());
  char text[32];
  const double number = value.get<double>();
  std::snprintf(text, sizeof text,
                number >= 1000 ? "%.0f"
                : number >= 10 ? "%.1f"
                               : "%.3f",
                number);
  return text;
}

}  // namespace

Report::Report(const std::string& folder) {
  utsname system = {};
  uname(&system);
  struct statfs files = {};
  statfs(folder.c_str(), &files);
  double load[3] = {0, 0, 0};
  (void)getloadavg(load, 3);
  std::ostringstream type;
  type << "0x" << std::hex << files.f_type;
  json_["machine"] = {
      {"processor", processor()},
      {"cores", std::thread::hardware_concurrency()},
      {"memory_mib", sysconf(_SC_PHYS_PAGES) / 256 * (sysconf(_SC_PAGESIZE) / 4096)},
      {"kernel", system.release},
      {"file_system", type.str()},
      {"load_before", load[0]}};
  for (const auto& [name, value] : json_["machine"].items())
    std::printf("%s: %s\n", name.c_str(), text_of(value).c_str());
}

void Report::table(const std::string& title, const std::vector<Row>& rows) {
  std::printf("\n%s\n", title.c_str());
  json_["tables"].push_back({{"title", title}, {"rows", rows}});
  std::vector<std::size_t> widths;
  std::vector<std::vector<std::string>> cells;
  for (const Row& row : rows) {
    if (cells.empty()) {
      cells.emplace_back();
      for (const auto& [name, value] : row.items()) cells.back().push_back(name);
      widths.resize(cells.back().size());
    }
    cells.emplace_back();
    for (const auto& [name, value] : row.items()) cells.back().push_back(text_of(value));
  }
  for (const auto& line : cells)
    for (std::size_t k = 0; k < line.size(); ++k) widths[k] = std::max(widths[k], line[k].size());
  for (const auto& line : cells) {
    for (std::size_t k = 0; k < line.size(); ++k)
      std::printf(k == 0 ? "  %-*s" : "  %*s", static_cast<int>(widths[k]), line[k].c_str());
    std::printf("\n");
  }
  std::fflush(stdout);
}

void Report::target(const std::string& what, double found, double wanted, bool at_least) {
  const bool met = at_least ? found >= wanted : found <= wanted;
  std::printf("  %s  %s: %.3f, wanted at %s %.3f\n", met ? "ok  " : "MISS", what.c_str(), found,
              at_least ? "least" : "most", wanted);
  json_["targets"].push_back(
      {{"what", what}, {"found", found}, {"wanted", wanted}, {"at_least", at_least}, {"met", met}});
}

void Report::note(const std::string& text) {
  std::printf("%s\n", text.c_str());
  json_["notes"].push_back(text);
}

void Report::save(const std::string& path) const {
  std::ofstream file(path);
  file << json_.dump(2) << '\n';
  file.close();
  require(file.good(), path + ": cannot write");
}

double percentile(std::vector<double>& values, double share) {
  std::sort(values.begin(), values.end());
  const auto at = static_cast<std::size_t>(share * static_cast<double>(values.size()));
  return values[std::min(at, values.size() - 1)];
}

double now() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

}  // namespace slf::bench

// Report: the results of a run, as tables on stdout and as JSON in a file.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace slf::bench {

using Row = nlohmann::ordered_json;

class Report {
 public:
  /// Prints the machine: processor, cores, kernel, memory, file system of `folder`, load.
  explicit Report(const std::string& folder);

  /// Prints rows that share their columns, and keeps them.
  void table(const std::string& title, const std::vector<Row>& rows);

  /// Prints whether a figure meets its target: at least `wanted` if `at_least`, else at most.
  void target(const std::string& what, double found, double wanted, bool at_least);

  void note(const std::string& text);
  void save(const std::string& path) const;

 private:
  nlohmann::ordered_json json_;
};

/// The value below which `share` of the values lie; sorts them. REQUIRES: not empty.
[[nodiscard]] double percentile(std::vector<double>& values, double share);

/// Seconds of the wall clock.
[[nodiscard]] double now();

}  // namespace slf::bench

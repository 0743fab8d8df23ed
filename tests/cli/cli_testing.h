// Runs the `slf` command as a user would, and says what it printed and how it ended.
#pragma once

#include <fcntl.h>
#include <gtest/gtest.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <vector>

namespace slf::testing {

inline std::string read_text(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

/// A folder of one test, removed with it, in which commands run.
class Workplace {
 public:
  Workplace() {
    std::string name = std::filesystem::temp_directory_path() / "slf-cli-XXXXXX";
    path_ = mkdtemp(name.data());
  }
  ~Workplace() {
    std::error_code ignored;
    std::filesystem::permissions(path_, std::filesystem::perms::all, ignored);
    std::filesystem::remove_all(path_, ignored);
  }
  [[nodiscard]] std::string operator/(const std::string& name) const { return path_ + "/" + name; }
  [[nodiscard]] const std::string& path() const { return path_; }
  [[nodiscard]] std::vector<std::string> files() const {
    std::vector<std::string> names;
    for (const auto& entry : std::filesystem::directory_iterator(path_))
      names.push_back(entry.path().filename());
    std::sort(names.begin(), names.end());
    return names;
  }

 private:
  std::string path_;
};

struct Outcome {
  int exit_code = -1;
  int signal = 0;
  std::string out, err;
  [[nodiscard]] nlohmann::json json() const { return nlohmann::json::parse(out, nullptr, false); }
};

inline std::string shell_quoted(const std::string& text) {
  std::string quoted = "'";
  for (const char c : text) quoted += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return quoted + "'";
}

/// Runs `slf ARGUMENTS...`; `prefix` goes before the command in the shell ("ulimit -f 100;").
inline Outcome slf(const std::vector<std::string>& arguments, const std::string& prefix = "") {
  const Workplace streams;
  std::string line = prefix + " " + shell_quoted(SLF_COMMAND);
  for (const auto& argument : arguments) line += " " + shell_quoted(argument);
  line +=
      " >" + shell_quoted(streams / "out") + " 2>" + shell_quoted(streams / "err") + " </dev/null";
  const int status = std::system(line.c_str());
  Outcome outcome;
  if (WIFEXITED(status)) outcome.exit_code = WEXITSTATUS(status);
  if (WIFSIGNALED(status)) outcome.signal = WTERMSIG(status);
  outcome.out = read_text(streams / "out");
  outcome.err = read_text(streams / "err");
  return outcome;
}

}  // namespace slf::testing

/// Ended by itself with this exit code, saying this on stderr.
#define EXPECT_OUTCOME(outcome, code, part)                                               \
  do {                                                                                    \
    const ::slf::testing::Outcome o_ = (outcome);                                         \
    EXPECT_EQ(o_.signal, 0);                                                              \
    EXPECT_EQ(o_.exit_code, code) << o_.err;                                              \
    EXPECT_NE(o_.err.find(part), std::string::npos) << "stderr: " << o_.err << std::endl; \
  } while (false)

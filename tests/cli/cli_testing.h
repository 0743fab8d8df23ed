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

#include "tests/temporary_folder.h"

namespace slf::testing {

/// A small field.
inline const std::string kGoldenField = std::string(SLF_TEST_DATA) + "/golden/zstd.slf";

/// The folder of one test, on a disk, in which commands run.
struct Workplace : TemporaryFolder {
  Workplace() : TemporaryFolder(std::filesystem::temp_directory_path()) {}
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

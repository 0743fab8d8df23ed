// The surroundings of a command: streams that cannot be written, signals, paths and texts of any
// bytes, folders one may not enter, volumes that are not the ones they are taken for.
#include <signal.h>

#include <chrono>
#include <thread>

#include "tests/cli/cli_testing.h"

extern char** environ;

namespace slf {
namespace {

using testing::kGoldenField;
using testing::Outcome;
using testing::read_text;
using testing::shell_quoted;
using testing::slf;
using testing::Workplace;

/// Runs a line of sh in which $SLF is the command.
Outcome shell(const std::string& line) {
  const Workplace place;
  std::ofstream(place / "script") << "SLF=" << shell_quoted(SLF_COMMAND) << "\n" << line << "\n";
  const int status =
      std::system(("sh " + shell_quoted(place / "script") + " >" + shell_quoted(place / "out") +
                   " 2>" + shell_quoted(place / "err") + " </dev/null")
                      .c_str());
  return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, WIFSIGNALED(status) ? WTERMSIG(status) : 0,
          read_text(place / "out"), read_text(place / "err")};
}

/// A NIfTI of 8³ bytes with a bright middle.
void write_volume(const std::string& path, char middle = '\x7f') {
  std::string bytes(352 + 512, '\0');
  const auto put = [&](std::size_t at, auto value) {
    std::memcpy(&bytes[at], &value, sizeof value);
  };
  put(0, std::int32_t{348});
  for (const auto& [at, value] : {std::pair{40, 3}, {42, 8}, {44, 8}, {46, 8}, {70, 2}, {72, 8}})
    put(static_cast<std::size_t>(at), static_cast<std::int16_t>(value));
  for (const std::size_t at : {80, 84, 88}) put(at, 1.0f);
  put(108, 352.0f);
  std::memcpy(&bytes[344], "n+1", 4);
  for (std::size_t k = 0; k < 512; ++k)
    if (k % 8 > 1 && k % 8 < 6 && k / 64 > 1 && k / 64 < 6) bytes[352 + k] = '\x7f';
  bytes[352 + 219] = middle;
  std::ofstream(path, std::ios::binary) << bytes;
}

TEST(Streams, AnUnwritableStderrStopsNothing) {
  const Workplace place;
  for (const std::string broken : {"2>/dev/full", "2>&-"}) {
    EXPECT_EQ(shell("\"$SLF\" info none.slf " + broken).exit_code, 2) << broken;
    EXPECT_EQ(shell("\"$SLF\" bogus " + broken).exit_code, 1) << broken;
    EXPECT_EQ(
        shell("\"$SLF\" --progress 0.001 build scene:balls --entry 2 --exit 3 --levels 1 -o " +
              shell_quoted(place / "a.slf") + " " + broken)
            .exit_code,
        0)
        << broken;
    EXPECT_EQ(slf({"verify", place / "a.slf"}).exit_code, 0);
    std::filesystem::remove(place / "a.slf");
  }
}

TEST(Streams, AnUnwritableStdoutIsAnErrorOfInputAndOutput) {
  for (const std::string broken : {">/dev/full", ">&-"})
    for (const std::string& command :
         {"info " + shell_quoted(kGoldenField) + " --json", std::string("--help"),
          "verify " + shell_quoted(kGoldenField)}) {
      const Outcome outcome = shell("\"$SLF\" " + command + " " + broken);
      EXPECT_EQ(outcome.exit_code, 2) << command << broken;
      EXPECT_NE(outcome.err.find("stdout: cannot write"), std::string::npos) << outcome.err;
    }
}

TEST(Streams, ProgressShowsWithoutATerminal) {
  const Workplace place;
  const std::vector<std::string> build{"build",    "scene:balls", "-o",         place / "a.slf",
                                       "--entry",  "4",           "--exit",     "16",
                                       "--levels", "1",           "--progress", "0.01"};
  const Outcome outcome = slf(build);
  EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_NE(outcome.err.find(" %  "), std::string::npos) << outcome.err;
  EXPECT_NE(outcome.err.find(" left\n"), std::string::npos) << outcome.err;
  EXPECT_EQ(outcome.err.find('\r'), std::string::npos) << outcome.err;
  EXPECT_EQ(outcome.err.find('\x1b'), std::string::npos) << outcome.err;
  std::filesystem::remove(place / "a.slf");
  auto silent = build;
  silent.push_back("-q");
  EXPECT_EQ(slf(silent).err, "");
}

/// The share of its rays that a build has traced, by its lines of progress so far.
double share_done(const std::string& lines) {
  const std::size_t end = lines.rfind('\n');
  if (end == std::string::npos) return 0;
  const std::size_t begin = lines.find_last_of('\n', end - 1) + 1;
  const auto line = nlohmann::json::parse(lines.substr(begin, end - begin));
  return line["done"].get<double>() / line["total"].get<double>();
}

/// Starts a long build that commits nothing by itself, sends it a signal after some tiles and
/// returns how it ended.
int status_after(int signal, const std::string& output) {
  const std::vector<std::string> arguments{
      SLF_COMMAND, "--progress", "json:0.05", "build",          "scene:fog", "-o",
      output,      "--entry",    "8",         "--exit",         "32",        "--levels",
      "2",         "--codec",    "raw",       "--commit-every", "3600"};
  std::vector<char*> line;
  for (const std::string& argument : arguments) line.push_back(const_cast<char*>(argument.c_str()));
  line.push_back(nullptr);
  const std::string progress = output + ".progress";
  posix_spawn_file_actions_t streams;
  posix_spawn_file_actions_init(&streams);
  posix_spawn_file_actions_addopen(&streams, STDERR_FILENO, progress.c_str(), O_WRONLY | O_CREAT,
                                   0600);
  pid_t child = 0;
  const int failed = posix_spawn(&child, SLF_COMMAND, &streams, nullptr, line.data(), environ);
  posix_spawn_file_actions_destroy(&streams);
  if (failed != 0) return -1;
  for (int k = 0; k < 3000 && share_done(read_text(progress)) < 0.02; ++k)
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  kill(child, signal);
  int status = 0;
  waitpid(child, &status, 0);
  return status;
}

TEST(Signals, EndTheCommandAfterItHasTidiedUp) {
  for (const int signal : {SIGINT, SIGTERM}) {
    const Workplace place;
    const int status = status_after(signal, place / "a.slf");
    ASSERT_TRUE(WIFSIGNALED(status)) << status;
    EXPECT_EQ(WTERMSIG(status), signal);
    const Outcome verified = slf({"verify", place / "a.slf.unfinished"});
    EXPECT_EQ(verified.exit_code, 0) << verified.err;
    EXPECT_NE(verified.out.find("C1"), std::string::npos) << "the signal came too late";
    const auto info = slf({"info", place / "a.slf.unfinished", "--json"}).json();
    const auto& level = info["levels"][0];
    EXPECT_GT(level["stored"].get<int>() + level["empty"].get<int>(), 0) << "nothing was committed";
  }
}

TEST(Bytes, PathsNeedNotBeUtf8) {
  const Workplace place;
  const std::string volume = place / "br\xe4in.nii", field = place / "f\xfc.slf";
  write_volume(volume);
  const Outcome info = slf({"info", volume, "--json"});
  EXPECT_EQ(info.exit_code, 0) << info.err;
  EXPECT_TRUE(info.json()["source"].get<std::string>().ends_with("br\xef\xbf\xbdin.nii"));
  const std::vector<std::string> build{"build", volume,   "-o", field,      "--entry",
                                       "2",     "--exit", "2",  "--levels", "0"};
  const Outcome built = slf(build);
  EXPECT_EQ(built.exit_code, 0) << built.err;
  EXPECT_EQ(slf({"info", field, "--json"}).json()["complete"], true);
  EXPECT_NE(slf({"info", field}).out.find("f\\xfc.slf"), std::string::npos);
  EXPECT_OUTCOME(slf({"info", place / "no\xff.slf"}), 2, "no\\xff.slf");
}

TEST(Bytes, TextFromFilesCannotCommandTheTerminal) {
  const Workplace place;
  const std::string volume = place /
                             "a\x1b[2J\xc2\x9b"
                             "31m\nslf: all is well.nii",
                    field = place / "a.slf";
  write_volume(volume);
  ASSERT_EQ(
      slf({"build", volume, "-o", field, "--entry", "2", "--exit", "2", "--levels", "0"}).exit_code,
      0);
  for (const Outcome& outcome : {slf({"info", field}), slf({"info", volume}),
                                 slf({"info", volume + "x"}), slf({"info", field, volume})}) {
    const std::string all = outcome.out + outcome.err;
    EXPECT_EQ(all.find('\x1b'), std::string::npos) << all;
    EXPECT_EQ(all.find("\xc2\x9b"), std::string::npos) << all;
    EXPECT_EQ(all.find("\nslf: all is well"), std::string::npos) << all;
    EXPECT_NE(all.find("a\\x1b[2J\\xc2\\x9b31m\\x0aslf: all is well.nii"), std::string::npos)
        << all;
  }
}

TEST(OtherVolumes, OfTheSameShapeAreWarnedOf) {
  const Workplace place;
  write_volume(place / "a.nii");
  write_volume(place / "copy.nii");
  write_volume(place / "other.nii", '\x3c');
  ASSERT_EQ(slf({"build", place / "a.nii", "-o", place / "a.slf", "--entry", "2", "--exit", "2",
                 "--levels", "0"})
                .exit_code,
            0);
  const auto evaluate = [&](const std::string& volume) {
    return slf({"evaluate", place / "a.slf", "--volume", place / volume, "--views", "1", "--size",
                "16", "--json"});
  };
  EXPECT_EQ(evaluate("copy.nii").json()["same_source"], true);
  EXPECT_EQ(evaluate("copy.nii").err.find("warning: "), std::string::npos);
  const Outcome other = evaluate("other.nii");
  EXPECT_EQ(other.json()["same_source"], false);
  EXPECT_NE(other.err.find("warning: "), std::string::npos) << other.err;
}

TEST(Permissions, OfFoldersAreNamed) {
  const Workplace place;
  std::filesystem::create_symlink("loop.nii", place / "loop.nii");
  EXPECT_OUTCOME(slf({"info", place / "loop.nii"}), 2, "symbolic links");
  std::filesystem::create_directory(place / "closed");
  write_volume(place / "closed/a.nii");
  std::filesystem::permissions(place / "closed", std::filesystem::perms::none);
  std::filesystem::permissions(place.path(), std::filesystem::perms(0755));
  const std::string as_nobody =
      geteuid() == 0 ? "setpriv --reuid=65534 --regid=65534 --clear-groups" : "";
  const Outcome outcome = slf({"info", place / "closed/a.nii"}, as_nobody);
  if (outcome.exit_code == 126 || outcome.exit_code == 127)
    GTEST_SKIP() << "another user cannot run the command here";
  EXPECT_OUTCOME(outcome, 2, "ermission denied");
}

}  // namespace
}  // namespace slf

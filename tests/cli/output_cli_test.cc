// What a command may do to the files around it: nothing good is lost, whatever goes wrong.
#include <signal.h>
#include <sys/stat.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <map>
#include <memory>
#include <set>
#include <thread>

#include "tests/cli/cli_testing.h"
#include "tests/field/field_testing.h"
#include "tests/sanitized.h"

extern char** environ;

namespace slf {
namespace {

namespace fs = std::filesystem;
using testing::Outcome;
using testing::read_text;
using testing::slf;
using testing::Workplace;
using testing::write_text;
using Arguments = std::vector<std::string>;
using Names = std::vector<std::string>;

/// A small NRRD volume: a ball of values around `middle`, all of them at least 1 and at most 200.
std::string nrrd(double middle, const std::string& header = "") {
  std::string text =
      "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 12 12 12\nspacings: 1 1 1\nencoding: raw\n" +
      header + "\n";
  if (!header.empty()) return text;
  for (int z = 0; z < 12; ++z)
    for (int y = 0; y < 12; ++y)
      for (int x = 0; x < 12; ++x) {
        const double r = std::hypot(x - middle, y - 5.5, z - 5.5);
        text += static_cast<char>(r < 4 ? 200 : 1);
      }
  return text;
}

/// A build of small tiles; options in `more` replace those that are here.
Arguments build(const std::string& input, const std::string& output, const Arguments& more = {}) {
  std::map<std::string, std::string> options{{"--entry", "2"},
                                             {"--exit", "4"},
                                             {"--levels", "1"},
                                             {"--codec", "zstd:1"},
                                             {"--commit-every", "0"}};
  if (!input.starts_with("scene:")) options["--center"] = "5.5,5.5,5.5", options["--radius"] = "9";
  Arguments arguments{"build", input, "-o", output};
  for (const auto& [name, value] : options)
    if (std::find(more.begin(), more.end(), name) == more.end())
      arguments.insert(arguments.end(), {name, value});
  arguments.insert(arguments.end(), more.begin(), more.end());
  return arguments;
}

/// A command that runs beside the test.
class Running {
 public:
  explicit Running(const Arguments& arguments) {
    Arguments words = arguments;
    words.insert(words.begin(), SLF_COMMAND);
    std::vector<char*> line;
    for (std::string& word : words) line.push_back(word.data());
    line.push_back(nullptr);
    posix_spawn_file_actions_t streams;
    posix_spawn_file_actions_init(&streams);
    posix_spawn_file_actions_addopen(&streams, 1, "/dev/null", O_WRONLY, 0);
    posix_spawn_file_actions_addopen(&streams, 2, (files_ / "err").c_str(), O_WRONLY | O_CREAT,
                                     0600);
    EXPECT_EQ(posix_spawn(&child_, SLF_COMMAND, &streams, nullptr, line.data(), environ), 0);
    posix_spawn_file_actions_destroy(&streams);
  }
  ~Running() {
    if (child_ > 0) {
      kill(child_, SIGKILL);
      wait();
    }
  }
  Running(const Running&) = delete;
  Running& operator=(const Running&) = delete;
  void stop(int signal) const { kill(child_, signal); }
  Outcome wait() {
    int status = 0;
    waitpid(child_, &status, 0);
    child_ = 0;
    Outcome outcome;
    if (WIFEXITED(status)) outcome.exit_code = WEXITSTATUS(status);
    if (WIFSIGNALED(status)) outcome.signal = WTERMSIG(status);
    outcome.err = read_text(files_ / "err");
    return outcome;
  }

 private:
  Workplace files_;
  pid_t child_ = 0;
};

/// A build that takes a while: long enough to get in its way.
Arguments slow_build(const std::string& output) {
  return {"build",    "scene:fog", "-o", output, "--entry", "8",   "--exit",         "32",
          "--levels", "2",         "-j", "1",    "--codec", "raw", "--commit-every", "0.05"};
}

bool appears(const std::string& path) {
  for (int k = 0; k < 2000 && !fs::exists(path); ++k)
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  return fs::exists(path);
}

/// Waits until a writer has the container open.
bool is_locked(const std::string& path) {
  const int file = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  struct flock lock = {};
  for (int k = 0; k < 2000; ++k) {
    lock = {F_RDLCK, SEEK_SET, (off_t{1} << 62) - 1, 1, 0};
    if (fcntl(file, F_OFD_GETLK, &lock) == 0 && lock.l_type != F_UNLCK) break;
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  close(file);
  return lock.l_type == F_WRLCK;
}

TEST(Outputs, AMistypedSettingDoesNotDestroyAField) {
  Workplace place;
  const std::string field = place / "a.slf";
  ASSERT_EQ(slf(build("scene:balls", field)).exit_code, 0);
  const std::string before = read_text(field);
  EXPECT_OUTCOME(slf(build("scene:balls", field, {"-f", "--codec", "mp3"})), 1, "mp3");
  EXPECT_OUTCOME(slf(build("scene:balls", field, {"-f", "--levels", "40"})), 1, "levels");
  EXPECT_TRUE(read_text(field) == before);
  EXPECT_EQ(place.files(), Names{"a.slf"});
  // Nor does a full disk, which leaves what a later run goes on from.
  EXPECT_OUTCOME(slf(build("scene:balls", field, {"-f", "--exit", "16", "--codec", "raw"}),
                     "trap '' XFSZ; ulimit -f 400;"),
                 2, "goes on from");
  EXPECT_TRUE(read_text(field) == before);
  EXPECT_EQ(place.files(), (Names{"a.slf", "a.slf.unfinished"}));
  EXPECT_OUTCOME(slf(build("scene:balls", field, {"-f", "--exit", "16", "--codec", "raw"})), 0,
                 "resumed");
  EXPECT_EQ(place.files(), Names{"a.slf"});
  EXPECT_EQ(slf({"info", field, "--json"}).json()["exit_side"], 16);
}

TEST(Outputs, AnExportThatFailsLeavesNothingInTheWay) {
  Workplace place;
  const std::string field = place / "a.slf", site = place / "site";
  ASSERT_EQ(slf(build("scene:balls", field, {"--exit", "32", "--codec", "raw"})).exit_code, 0);
  const Arguments command{"export", field, "-o", site};
  if (slf({"export", field, "-o", place / "page.html"}).exit_code == 5)
    GTEST_SKIP() << "this slf has no page";
  EXPECT_OUTCOME(slf(command, "trap '' XFSZ; ulimit -f 100;"), 2, "File too large");
  EXPECT_TRUE(fs::is_empty(site));
  // Nor does one that is killed, whatever it was doing; the next one removes its draft.
  const Arguments smaller{"export", field, "-o", site, "-f", "--codec", "predictive:50"};
  const std::set<std::string> ours{"a.slf", "page.html", "site", "site.exporting.repacking"};
  int kills = 0;
  for (int k = 0; k < 40; ++k) {
    Running exporting(k % 2 == 0 ? smaller : command);
    std::this_thread::sleep_for(std::chrono::milliseconds(2 * k));
    exporting.stop(SIGKILL);
    kills += exporting.wait().signal == SIGKILL;
    for (const std::string& name : place.files()) EXPECT_TRUE(ours.contains(name)) << name;
    for (const auto& entry : fs::directory_iterator(site))
      EXPECT_FALSE(entry.path().string().ends_with(".tmp")) << entry.path();
  }
  EXPECT_GT(kills, 4);
  EXPECT_OUTCOME(slf(smaller), 0, "");
  EXPECT_EQ(place.files(), (Names{"a.slf", "page.html", "site"}));
}

// What it left of a field of several states is gone on from, or makes room for other ones.
TEST(Outputs, AnExportOfStatesThatIsKilledLeavesNothingInTheWay) {
  Workplace place;
  const std::string field = place / "a.slf", draft = place / "site.exporting.repacking";
  write_text(place / "v.nrrd", nrrd(5.5));
  write_text(place / "s.json", R"({"states": [{"name": "a"},
    {"name": "b", "clip": [[5.5, 5.5, 5.5, 0, 0, 1]]}, {"name": "c", "transfer": "flame"}]})");
  const Arguments lattice{"--states", place / "s.json", "--entry", "4", "--exit",
                          "16",       "--lighting",     "direct"};
  ASSERT_EQ(slf(build(place / "v.nrrd", field, lattice)).exit_code, 0);
  const auto command = [&](const std::string& states, const Arguments& more = {}) {
    Arguments arguments{"export", field, "-o", place / "site", "-f", "--states", states};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return arguments;
  };
  if (slf(command("a,b")).exit_code == 5) GTEST_SKIP() << "this slf has no page";
  const auto killed = [&](const Arguments& arguments) {
    for (int attempt = 0; attempt < 200; ++attempt) {
      Running exporting(arguments);
      for (int k = 0; k < 10'000 && !fs::exists(draft); ++k)  // it lives for some milliseconds
        std::this_thread::sleep_for(std::chrono::microseconds(50));
      exporting.stop(SIGKILL);
      if (exporting.wait().signal == SIGKILL && fs::exists(draft)) return true;
    }
    return false;
  };
  for (const Arguments& next :
       {command("a,b"), command("a,c"), command("b,c,a"), command("a,b", {"--codec", "raw"}),
        command("a,b", {"--max-size", "1100KiB"})}) {
    ASSERT_TRUE(killed(command("a,b")));
    EXPECT_OUTCOME(slf(next), 0, "");
    EXPECT_EQ(place.files(), (Names{"a.slf", "s.json", "site", "v.nrrd"}));
    if (next.back() == "1100KiB") continue;  // coarser
    const std::string exported = place / "site/field.slf";
    for (const char state : next[6]) {
      if (state == ',') continue;
      const std::string name(1, state);
      EXPECT_OUTCOME(
          slf({"diff", field, exported, "--state-a", name, "--state-b", name, "--min-psnr", "30"}),
          0, "");
    }
  }
  // A file of that name that is no draft stays.
  write_text(draft, "precious");
  EXPECT_OUTCOME(slf(command("a,b")), 3, "site.exporting.repacking");
  EXPECT_EQ(read_text(draft), "precious");
}

// A stopped preview is not a preview.
TEST(Outputs, AStoppedPreviewReplacesNothing) {
  Workplace place;
  const std::string preview = place / "p.webp";
  const Arguments play{"play",     testing::kGoldenField, "--size",    "16",   "--fps", "50", "-f",
                       "--frames", place / "frames",      "--preview", preview};
  for (const bool before : {true, false}) {
    if (before) write_text(preview, "precious");
    Running playing(play);
    ASSERT_TRUE(appears(place / "frames/00003.png"));
    playing.stop(SIGINT);
    EXPECT_EQ(playing.wait().signal, SIGINT);
    EXPECT_EQ(fs::exists(preview), before);
    if (before) {
      EXPECT_EQ(read_text(preview), "precious");
    }
    fs::remove_all(place / "frames");
    fs::remove(preview);
  }
}

TEST(Outputs, AFullDiskIsNamed) {
  const std::string mount = "unshare -rm sh -c 'mount -t tmpfs -o size=300k none \"$0\" && ";
  Workplace place;
  const std::string field = place / "a.slf", disk = place / "disk";
  fs::create_directory(disk);
  if (std::system((mount + "true' " + testing::shell_quoted(disk) + " 2>/dev/null").c_str()) != 0)
    GTEST_SKIP() << "no small disk: mounting one is not permitted here";
  ASSERT_EQ(slf(build("scene:balls", field, {"--exit", "32", "--codec", "raw"})).exit_code, 0);
  const std::string within = mount + "\"$@\"' " + testing::shell_quoted(disk);
  EXPECT_OUTCOME(slf({"export", field, "-o", disk + "/site"}, within), 2,
                 "No space left on device");
  EXPECT_OUTCOME(slf({"repack", field, "-o", disk + "/b.slf", "--codec", "raw"}, within), 2,
                 "No space left on device");
}

TEST(Outputs, NoInputIsWrittenOver) {
  Workplace place;
  write_text(place / "scan.nrrd", nrrd(5.5));
  write_text(place / "scan.nhdr", nrrd(5.5, "data file: scan.raw\n"));
  const std::string voxels = nrrd(5.5).substr(nrrd(5.5).find("\n\n") + 2);
  write_text(place / "scan.raw", voxels);
  fs::create_symlink("scan.nrrd", place / "soft.nrrd");
  fs::create_hard_link(place / "scan.nrrd", place / "hard.nrrd");
  fs::copy(SLF_TEST_DATA "/../../scripts/data/brain.json", place / "transfer.json");
  const std::string transfer = read_text(place / "transfer.json");
  const Names names = place.files();
  for (const char* output : {"scan.nrrd", "soft.nrrd", "hard.nrrd"}) {
    EXPECT_OUTCOME(slf(build(place / "scan.nrrd", place / output, {"-f"})), 1, "is the input");
    EXPECT_OUTCOME(slf(build(place / "scan.nrrd", place / output)), 1, "is the input");
  }
  for (const char* output : {"scan.nhdr", "scan.raw"})
    EXPECT_OUTCOME(slf(build(place / "scan.nhdr", place / output, {"-f"})), 1, "is the input");
  EXPECT_OUTCOME(slf(build(place / "scan.nrrd", place / "transfer.json",
                           {"-f", "--transfer", place / "transfer.json"})),
                 1, "is the input");
  EXPECT_EQ(read_text(place / "transfer.json"), transfer);
  EXPECT_EQ(read_text(place / "scan.nrrd"), nrrd(5.5));
  EXPECT_EQ(read_text(place / "scan.raw"), voxels);
  EXPECT_EQ(place.files(), names);
  EXPECT_TRUE(fs::is_symlink(place / "soft.nrrd"));

  ASSERT_EQ(slf(build("scene:balls", place / "a.slf")).exit_code, 0);
  fs::create_hard_link(place / "a.slf", place / "b.slf");
  for (const char* output : {"a.slf", "b.slf"})
    EXPECT_OUTCOME(slf({"repack", place / "a.slf", "-o", place / output, "-f"}), 1, "is the input");
}

TEST(Outputs, ASourceIsItsContent) {
  Workplace place;
  const std::string field = place / "a.slf";
  const auto run = [&](const std::string& input, const std::string& limit = "") {
    return slf(build(input, field, {"--exit", "16", "--codec", "raw"}),
               "cd " + testing::shell_quoted(place.path()) + ";" + limit);
  };
  write_text(place / "va.nrrd", nrrd(5.5));
  const Outcome full = run("va.nrrd", "trap '' XFSZ; ulimit -f 400;");  // stopped half way
  ASSERT_EQ(full.exit_code, 2) << full.err;

  // Another volume under the same name, alike in all but where its voxels lie.
  write_text(place / "va.nrrd", nrrd(4.5));
  EXPECT_OUTCOME(run("va.nrrd"), 1, "what the input holds has changed");
  // The same volume, under another name.
  write_text(place / "va.nrrd", nrrd(5.5));
  EXPECT_OUTCOME(run("./va.nrrd"), 0, "resumed");
  EXPECT_OUTCOME(slf({"verify", field}), 0, "");
  EXPECT_OUTCOME(run("va.nrrd"), 0, "nothing is left");
  // And against a field that is complete.
  write_text(place / "va.nrrd", nrrd(4.5));
  EXPECT_OUTCOME(run("va.nrrd"), 1, "what the input holds has changed");
}

TEST(Outputs, ACompleteBuildRunAgainIsDone) {
  Workplace place;
  ASSERT_EQ(slf(build("scene:balls", place / "a.slf")).exit_code, 0);
  const std::string before = read_text(place / "a.slf");
  EXPECT_OUTCOME(slf(build("scene:balls", place / "a.slf")), 0, "nothing is left to build");
  EXPECT_TRUE(read_text(place / "a.slf") == before);
  EXPECT_OUTCOME(slf(build("scene:balls", place / "a.slf", {"--exit", "5"})), 1, "exit_side");
}

TEST(Outputs, AReplacedFieldKeepsItsPermissionsAndLinksAreWrittenThrough) {
  Workplace place;
  fs::create_directory(place / "disk");
  ASSERT_EQ(slf(build("scene:balls", place / "disk/a.slf")).exit_code, 0);
  ASSERT_EQ(chmod((place / "disk/a.slf").c_str(), 0640), 0);
  fs::create_symlink("disk/a.slf", place / "a.slf");
  fs::create_symlink("disk/new.slf", place / "new.slf");
  const auto check = [&] {
    EXPECT_TRUE(fs::is_symlink(place / "a.slf"));
    EXPECT_EQ(fs::status(place / "disk/a.slf").permissions(), fs::perms(0640));
    EXPECT_EQ(slf({"verify", place / "disk/a.slf"}).exit_code, 0);
  };
  EXPECT_OUTCOME(slf(build("scene:globe", place / "a.slf", {"-f"})), 0, "");
  check();
  EXPECT_OUTCOME(slf({"repack", place / "a.slf", "-o", place / "new.slf", "--levels", "0"}), 0, "");
  EXPECT_TRUE(fs::is_symlink(place / "new.slf"));
  EXPECT_OUTCOME(slf({"repack", place / "new.slf", "-o", place / "a.slf", "-f"}), 0, "");
  check();
  EXPECT_EQ(slf({"info", place / "a.slf", "--json"}).json()["levels"].size(), 1u);

  const std::string picture = place / "p.png";
  ASSERT_EQ(slf({"render", place / "a.slf", "-o", picture, "--size", "8"}).exit_code, 0);
  fs::permissions(picture, fs::perms(0600));
  ASSERT_EQ(slf({"render", place / "a.slf", "-o", picture, "--size", "8", "-f"}).exit_code, 0);
  EXPECT_EQ(fs::status(picture).permissions(), fs::perms(0600));
}

TEST(Outputs, TwoBuildsDoNotWriteOneField) {
  for (const bool force : {false, true}) {
    Workplace place;
    const std::string field = place / "a.slf";
    Running first(slow_build(field));
    ASSERT_TRUE(appears(field + ".unfinished"));
    Arguments second = slow_build(field);
    if (force) second.emplace_back("-f");
    EXPECT_OUTCOME(slf(second), 4, "a.slf");
    Arguments other = slow_build(field);
    other.insert(other.end(), {"--entry-extra-levels", "1"});
    if (force) other.emplace_back("-f");
    EXPECT_EQ(slf(other).exit_code, 1);
    EXPECT_TRUE(fs::exists(field + ".unfinished"));
  }
}

TEST(Outputs, OfBuildsStartedTogetherOneWritesAndTheOthersAreTurnedAway) {
  Workplace place;
  const std::string field = place / "a.slf";
  for (int round = 0; round < testing::repetitions(50); ++round) {
    Arguments command = build("scene:balls", field);
    if (round % 2 != 0) command.emplace_back("-f");
    std::map<int, int> ended;
    {
      std::vector<std::unique_ptr<Running>> all(4);
      for (auto& one : all) one = std::make_unique<Running>(command);
      for (auto& one : all) {
        const Outcome outcome = one->wait();
        ++ended[outcome.exit_code];
        EXPECT_TRUE(outcome.exit_code == 0 || outcome.exit_code == 4) << outcome.err;
      }
    }
    EXPECT_GT(ended[0], 0);
    EXPECT_EQ(slf({"verify", field}).exit_code, 0);
    for (const std::string& name : place.files()) fs::remove(place / name);
  }
}

TEST(Outputs, AWriterNoticesThatItsFileIsGone) {
  Workplace place;
  const std::string growing = place / "a.slf.unfinished";
  for (const bool remove : {true, false}) {
    Running build(slow_build(place / "a.slf"));
    ASSERT_TRUE(appears(growing) && is_locked(growing));
    std::this_thread::sleep_for(std::chrono::milliseconds(500));  // the writer has it open
    if (remove)
      fs::remove(growing);
    else
      fs::rename(growing, place / "elsewhere");
    EXPECT_OUTCOME(build.wait(), 4, "removed, renamed or replaced");
    EXPECT_FALSE(fs::exists(place / "a.slf"));
  }
}

// A field with missing tiles is filled in place; until that is done it must not be replaced.
TEST(Outputs, AFieldThatIsBeingFilledIsNotReplaced) {
  Workplace place;
  const std::string field = place / "a.slf";
  {
    Running build(slow_build(field));
    ASSERT_TRUE(appears(field + ".unfinished"));
  }
  fs::rename(field + ".unfinished", field);  // as older versions left it
  ASSERT_EQ(slf(build("scene:balls", place / "b.slf")).exit_code, 0);
  Running filling(slow_build(field));
  ASSERT_TRUE(is_locked(field));
  EXPECT_OUTCOME(slf({"repack", place / "b.slf", "-o", field, "-f"}), 4, "another process");
  EXPECT_OUTCOME(slf(build("scene:balls", field, {"-f"})), 4, "another process");
  fs::rename(place / "b.slf", field);
  EXPECT_OUTCOME(filling.wait(), 4, "removed, renamed or replaced");
}

}  // namespace
}  // namespace slf

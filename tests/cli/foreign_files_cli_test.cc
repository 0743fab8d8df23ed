// Files that belong to somebody: no command destroys one, with or without -f. It may replace the
// output that it was given, and what slf itself left beside an output.
#include <filesystem>

#include "tests/cli/cli_testing.h"
#include "tests/sanitized.h"

namespace slf {
namespace {

namespace fs = std::filesystem;
using testing::Outcome;
using testing::read_text;
using testing::slf;
using testing::Workplace;
using testing::write_text;
using Arguments = std::vector<std::string>;

constexpr const char* kPrecious = "precious\n";

Arguments joined(Arguments all, const Arguments& more) {
  all.insert(all.end(), more.begin(), more.end());
  return all;
}

/// A field, its pictures, a volume of 12³ voxels and its transfer function, in one folder.
class ForeignFiles : public ::testing::Test {
 protected:
  ForeignFiles() {
    std::string voxels;
    for (int k = 0; k < 12 * 12 * 12; ++k)
      voxels += static_cast<char>(std::abs(k % 12 - 6) + std::abs(k / 12 % 12 - 6) < 5 ? 200 : 1);
    write_text(place / "scan.raw", voxels);
    EXPECT_EQ(slf({"transfer", "ct-bone", "-o", place / "t.json"}).exit_code, 0);
    EXPECT_EQ(slf(build("scene:balls", "a.slf")).exit_code, 0);
    for (const char* picture : {"a.png", "b.png"})
      EXPECT_EQ(slf({"render", place / "a.slf", "-o", place / picture, "--size", "16"}).exit_code,
                0);
  }

  [[nodiscard]] Arguments build(const std::string& input, const std::string& output,
                                const Arguments& more = {}) const {
    return joined({"build", input, "-o", place / output, "--entry", "2", "--exit", "4", "--levels",
                   "0", "--codec", "zstd"},
                  more);
  }
  /// A build of the volume, with a light volume.
  [[nodiscard]] Arguments lit(const std::string& output, const Arguments& more = {}) const {
    return build(
        place / "scan.raw", output,
        joined({"--dims", "12x12x12", "--lighting", "shadowed", "--light-samples", "1"}, more));
  }

  /// Expects that `command`, whose output is `output`, is refused if that leads to `input`.
  void expect_kept(const std::string& input, const std::string& output, const Arguments& command) {
    const std::string before = read_text(place / input);
    for (const bool soft : {true, false}) {
      SCOPED_TRACE(command.front() + (soft ? ", a symbolic link to " : ", a hard link to ") +
                   input);
      fs::create_directories(fs::path(place / output).parent_path());
      if (soft)
        fs::create_symlink(place / input, place / output);
      else
        fs::create_hard_link(place / input, place / output);
      const Outcome outcome = slf(command);
      EXPECT_OUTCOME(outcome, 1, "is the input");
      EXPECT_TRUE(fs::is_symlink(place / output) == soft);
      EXPECT_TRUE(read_text(place / input) == before);
      EXPECT_TRUE(read_text(place / output) == before);
      fs::remove(place / output);
    }
  }

  Workplace place;
};

TEST_F(ForeignFiles, NoOutputIsAnInput) {
  const std::string field = place / "a.slf", scan = place / "scan.raw";
  expect_kept("a.slf", "o.png", {"render", field, "-f", "-o", place / "o.png"});
  expect_kept("a.slf", "o.raw", {"tile", field, "0/0", "-f", "-o", place / "o.raw"});
  expect_kept("a.slf", "o.slf", {"repack", field, "-f", "-o", place / "o.slf"});
  expect_kept("a.slf", "o.slf", {"merge", field, "-f", "-o", place / "o.slf"});
  if (slf({"export", field, "-o", place / "page.html"}).exit_code != 5) {  // slf has the page
    expect_kept("a.slf", "o.html", {"export", field, "-f", "-o", place / "o.html"});
    expect_kept("a.slf", "site/index.html", {"export", field, "-f", "-o", place / "site"});
  }
  expect_kept(
      "a.slf", "o.webp",
      {"play", field, "-f", "--size", "8", "--seconds", "0.1", "--preview", place / "o.webp"});
  expect_kept(
      "a.slf", "frames/00000.png",
      {"play", field, "-f", "--size", "8", "--seconds", "0.1", "--frames", place / "frames"});
  expect_kept("t.json", "o.json", {"transfer", place / "t.json", "-f", "-o", place / "o.json"});
  for (const char* picture : {"a.png", "b.png"})
    expect_kept(picture, "o.png",
                {"compare", place / "a.png", place / "b.png", "-f", "--diff", place / "o.png"});
  const Arguments raycast{"raycast", scan,         "--dims",        "12x12x12",
                          "-f",      "-o",         place / "o.png", "--size",
                          "8",       "--transfer", place / "t.json"};
  expect_kept("scan.raw", "o.png", raycast);
  expect_kept("t.json", "o.png", raycast);
  const Arguments built =
      build(scan, "o.slf", {"--dims", "12x12x12", "-f", "--transfer", place / "t.json"});
  expect_kept("scan.raw", "o.slf", built);
  expect_kept("t.json", "o.slf", built);
  // The file of a light volume, which does not exist yet.
  EXPECT_OUTCOME(slf(lit("o.slf", {"--light-file", place / "o.slf"})), 1, "is the input");
  for (const std::string& draft : {place / "new.slf.unfinished", place / "./new.slf.unfinished"}) {
    EXPECT_OUTCOME(slf(lit("new.slf", {"--light-file", draft})), 1, "is the input, and");
    EXPECT_FALSE(std::filesystem::exists(draft));
  }
  EXPECT_FALSE(fs::exists(place / "o.slf"));
}

TEST_F(ForeignFiles, NoSliceOfAFolderIsReplaced) {
  fs::create_directory(place / "stack");
  for (const char* name : {"stack/1.png", "stack/2.png"}) fs::copy(place / "a.png", place / name);
  const std::string before = read_text(place / "stack/1.png");
  EXPECT_OUTCOME(
      slf({"raycast", place / "stack", "--component", "0", "-f", "-o", place / "stack/1.png"}), 1,
      "is the input");
  EXPECT_TRUE(read_text(place / "stack/1.png") == before);
}

TEST_F(ForeignFiles, OnlyALightVolumeIsReplacedByOne) {
  const std::string scan = read_text(place / "scan.raw");
  for (const char* file : {"scan.raw", "a.slf", "t.json", "a.png"}) {
    const std::string before = read_text(place / file);
    EXPECT_OUTCOME(slf(lit("n.slf", {"--light-file", place / file})), 1, "is not a light volume");
    EXPECT_OUTCOME(slf({"raycast", place / "scan.raw", "--dims", "12x12x12", "--lighting",
                        "shadowed", "-o", place / "o.png", "--light-file", place / file}),
                   1, "is not a light volume");
    EXPECT_TRUE(read_text(place / file) == before);
    EXPECT_FALSE(fs::exists(place / "n.slf"));
  }
  // A light volume of other settings is one.
  const Arguments kept{"--light-file", place / "n.light"};
  ASSERT_EQ(slf(lit("n.slf", kept)).exit_code, 0);
  const std::string light = read_text(place / "n.light");
  EXPECT_EQ(slf(lit("m.slf", joined(kept, {"--light-seed", "7"}))).exit_code, 0);
  EXPECT_TRUE(fs::exists(place / "n.light"));
  EXPECT_FALSE(read_text(place / "n.light") == light);
  EXPECT_OUTCOME(slf({"evaluate", place / "n.slf", "--volume", place / "scan.raw", "--dims",
                      "12x12x12", "--light-file", place / "t.json"}),
                 1, "is not a light volume");
}

TEST_F(ForeignFiles, ABuildLeavesFilesNamedLikeItsLightAlone) {
  write_text(place / "n.slf.light", kPrecious);
  EXPECT_EQ(slf(build("scene:balls", "n.slf")).exit_code, 0);
  EXPECT_EQ(slf(lit("n.slf", {"-f"})).exit_code, 0);
  EXPECT_EQ(read_text(place / "n.slf.light"), kPrecious);
}

TEST_F(ForeignFiles, ALargeForeignLightFileIsNotRead) {
  fs::resize_file(place / "b.png", std::uintmax_t{3} << 30);  // sparse
  // The sanitizers need more addresses than there is memory.
  const std::string limit = testing::kSanitized ? "" : "ulimit -v 1500000;";
  EXPECT_OUTCOME(slf(lit("n.slf", {"--light-file", place / "b.png"}), limit), 1,
                 "is not a light volume");
}

// A complete field with the name of a draft is somebody's work, too.
TEST_F(ForeignFiles, ACompleteFieldIsNoDraft) {
  for (const char* name : {"n.slf.unfinished", "n.slf.repacking"}) {
    fs::copy(place / "a.slf", place / name);
    const std::string before = read_text(place / name);
    const bool built = std::string(name).ends_with("unfinished");
    EXPECT_OUTCOME(built ? slf(build("scene:globe", "n.slf", {"-f"}))
                         : slf({"repack", place / "a.slf", "--no-depth", "-o", place / "n.slf"}),
                   1, built ? "with other settings" : "is a complete field");
    EXPECT_TRUE(read_text(place / name) == before);
  }
}

}  // namespace
}  // namespace slf

// The command line as users meet it: what is printed, where, and with which exit code.

#include <cmath>

#include "slf/image.h"
#include "tests/cli/cli_testing.h"
#include "tests/field/field_testing.h"

namespace slf {
namespace {

using testing::Outcome;
using testing::read_text;
using testing::slf;
using testing::Workplace;

bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

/// A small field, built once.
class Cli : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    place_ = new Workplace;
    const Outcome built = build(field());
    ASSERT_EQ(built.exit_code, 0) << built.err;
  }
  static void TearDownTestSuite() { delete place_; }
  static std::string field() { return *place_ / "balls.slf"; }
  static Outcome build(const std::string& path, const std::vector<std::string>& more = {}) {
    std::vector<std::string> arguments{"build",    "scene:balls", "-o",      path,
                                       "--entry",  "2",           "--exit",  "8",
                                       "--levels", "2",           "--codec", "zstd:1"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return slf(arguments);
  }
  static inline Workplace* place_ = nullptr;
};

TEST_F(Cli, InfoSaysWhatIsThere) {
  const auto json = slf({"info", field(), "--json"}).json();
  EXPECT_EQ(json["entry_resolution"], 8);
  EXPECT_EQ(json["exit_resolution"], 32);
  EXPECT_EQ(json["complete"], true);
  EXPECT_EQ(json["file_bytes"], std::filesystem::file_size(field()));
  ASSERT_EQ(json["levels"].size(), 3u);
  std::uint64_t payload = 0;
  for (const auto& level : json["levels"]) {
    EXPECT_EQ(level["stored"].get<int>() + level["empty"].get<int>(), level["tiles"].get<int>());
    payload += level["payload_bytes"].get<std::uint64_t>();
  }
  EXPECT_EQ(json["payload_bytes"], payload);
  EXPECT_EQ(json["format"], "rgba8_depth8");
  EXPECT_TRUE(contains(slf({"info", field()}).out, "sphere light field"));
}

TEST_F(Cli, RenderWritesEveryFormatAndSaysWhatItCost) {
  Workplace place;
  for (const std::string name : {"a.png", "a.jpg", "a.exr"}) {
    const Outcome drawn = slf({"render", field(), "-o", place / name, "--size", "40x30", "--json"});
    ASSERT_EQ(drawn.exit_code, 0) << drawn.err;
    const auto image = read_image(place / name);
    ASSERT_TRUE(image);
    EXPECT_EQ(image->width, 40u);
    EXPECT_EQ(image->height, 30u);
    EXPECT_GT(drawn.json()["tiles_touched"].get<int>(), 0);
    if (name == "a.exr") {
      EXPECT_FALSE(image->depth.empty());
    }
  }
  EXPECT_OUTCOME(slf({"render", field(), "-o", place / "a.png"}), 1, "-f overwrites");
  EXPECT_EQ(slf({"render", field(), "-o", place / "a.png", "-f", "--size", "8"}).exit_code, 0);
}

TEST_F(Cli, ModesRankAgainstTheTruth) {
  double last = 0;
  for (const std::string mode : {"nearest", "uv", "bitri", "depth"}) {
    const auto json = slf({"evaluate", field(), "--volume", "scene:balls", "--mode", mode,
                           "--views", "3", "--size", "96", "--json"})
                          .json();
    EXPECT_EQ(json["mode"], mode);
    EXPECT_EQ(json["views"], 3);
    EXPECT_EQ(json["per_view"].size(), 3u);
    EXPECT_GT(json["psnr"].get<double>(), last);
    EXPECT_GT(json["file_bytes"].get<int>(), 0);
    last = json["psnr"];
  }
  const std::vector<std::string> small{"evaluate", field(),  "--volume", "scene:balls", "--views",
                                       "1",        "--size", "32",       "--json"};
  auto smooth = small, absurd = small;
  smooth.insert(smooth.end(), {"--supersample", "4"});
  absurd.insert(absurd.end(), {"--supersample", "0"});
  EXPECT_NE(slf(smooth).json()["psnr"], slf(small).json()["psnr"]);
  EXPECT_OUTCOME(slf(absurd), 1, "--supersample");
}

TEST_F(Cli, MeasureCountsPerLevel) {
  const auto json = slf({"measure", field(), "--views", "3", "--size", "64", "--json"}).json();
  ASSERT_EQ(json["runs"].size(), 1u);
  const auto& run = json["runs"][0];
  EXPECT_EQ(run["views"], 3);
  ASSERT_EQ(run["levels"].size(), 3u);
  double last = 1;
  for (const auto& level : run["levels"]) {
    for (const char* key :
         {"tiles_touched", "compressed_bytes", "map_pages", "decoded_peak_bytes", "fraction"}) {
      EXPECT_GT(level[key]["mean"].get<double>(), 0) << key;
      EXPECT_GE(level[key]["max"].get<double>(), level[key]["mean"].get<double>() * 0.999) << key;
    }
    EXPECT_LT(level["fraction"]["mean"].get<double>(), last);
    last = level["fraction"]["mean"];
  }
  EXPECT_GT(run["rss_anon_peak_bytes"].get<std::uint64_t>(), 0u);
  EXPECT_GT(run["rss_file_peak_bytes"].get<std::uint64_t>(), 0u);
  EXPECT_TRUE(run["total"].contains("tiles_touched"));
}

TEST_F(Cli, MeasureComparesSettings) {
  const auto json = slf({"measure", field(), "--views", "2", "--size", "32,64", "--distance", "2,4",
                         "--mode", "bitri,depth", "--level", "1", "--json"})
                        .json();
  ASSERT_EQ(json["runs"].size(), 8u);
  EXPECT_EQ(json["runs"][0]["mode"], "bitri");
  EXPECT_EQ(json["runs"][7]["mode"], "depth");
  EXPECT_EQ(json["runs"][7]["distance_radii"], 4);
  EXPECT_EQ(json["runs"][7]["width_pixels"], 64);
  EXPECT_EQ(json["runs"][7]["height_pixels"], 64);
}

TEST_F(Cli, PlayReportsEveryFrame) {
  Workplace place;
  const auto json = slf({"play", field(), "--seconds", "0.2", "--turns", "0.1", "--size", "48x32",
                         "--loading", "ahead,demand,wait", "--preview", place / "p.webp",
                         "--frames", place / "frames", "--json"})
                        .json();
  ASSERT_EQ(json["runs"].size(), 3u);
  for (const auto& run : json["runs"]) {
    ASSERT_EQ(run["frames"].size(), 6u);
    EXPECT_EQ(run["summary"]["frames"], 6);
    for (const auto& frame : run["frames"])
      for (const char* key : {"ms", "full_share", "tiles", "loads", "load_bytes", "hit_rate"})
        EXPECT_TRUE(frame.contains(key)) << key;
  }
  EXPECT_EQ(json["runs"][2]["summary"]["full_share"], 1);
  EXPECT_TRUE(std::filesystem::exists(place / "frames/00005.png"));
  EXPECT_FALSE(std::filesystem::exists(place / "frames/00006.png"));
  EXPECT_TRUE(std::filesystem::exists(place / "p.webp"));
}

TEST_F(Cli, PlayFollowsKeyframesAndSaysWhatIsWrong) {
  Workplace place;
  std::ofstream(place / "keys.json")
      << R"({"keys": [{"at": 0, "orbit": [0, 20, 3]}, {"at": 0.1, "orbit": [20, 20, 8]}]})";
  std::ofstream(place / "bad.json") << R"({"keys": [{"at": 0, "orbit": [0, 20]}]})";
  const auto json = slf({"play", field(), "--path", place / "keys.json", "--level", "auto",
                         "--size", "32", "--json"})
                        .json();
  EXPECT_EQ(json["runs"][0]["frames"].size(), 3u);
  EXPECT_OUTCOME(slf({"play", field(), "--path", place / "bad.json"}), 3, "bad.json");
  EXPECT_OUTCOME(slf({"play", field(), "--path", place / "none.json"}), 2, "none.json");
  EXPECT_OUTCOME(slf({"play", field(), "--fps", "0"}), 1, "--fps");
  EXPECT_OUTCOME(slf({"play", field(), "--loading", "later"}), 1, "ahead");
}

TEST_F(Cli, CompareMeasuresAndWritesTheDifference) {
  Workplace place;
  ASSERT_EQ(
      slf({"render", field(), "-o", place / "a.png", "--size", "32", "--mode", "bitri"}).exit_code,
      0);
  ASSERT_EQ(slf({"raycast", "scene:balls", "-o", place / "t.png", "--size", "32"}).exit_code, 0);
  const Outcome same = slf({"compare", place / "a.png", place / "a.png", "--json"});
  EXPECT_EQ(same.exit_code, 0);
  EXPECT_EQ(same.json()["equal"], true);
  const Outcome other =
      slf({"compare", place / "a.png", place / "t.png", "--diff", place / "d.png", "--json"});
  EXPECT_GT(other.json()["psnr"].get<double>(), 10);
  EXPECT_TRUE(read_image(place / "d.png"));
  EXPECT_OUTCOME(slf({"compare", place / "a.png", place / "t.png", "--min-psnr", "90"}), 7,
                 "below 90");
}

TEST_F(Cli, WrongArgumentsAreUsageErrors) {
  Workplace place;
  const std::string out = place / "o.png";
  EXPECT_OUTCOME(slf({}), 1, "slf --help");
  EXPECT_OUTCOME(slf({"paint"}), 1, "unknown command 'paint'");
  EXPECT_OUTCOME(slf({"render", field(), "-o", out, "--mode", "sharp"}), 1,
                 "--mode: sharp not in {nearest,");
  EXPECT_OUTCOME(slf({"render", field(), "-o", out, "--level", "3"}), 1,
                 "finest level of this field is 2");
  EXPECT_OUTCOME(slf({"render", field(), "-o", out, "--size", "0x5"}), 1, "--size");
  EXPECT_OUTCOME(slf({"render", field(), "-o", out, "--size", "1000000x1000000"}), 1, "pixels");
  EXPECT_OUTCOME(slf({"render", field(), "-o", out, "--eye", "nan,0,0"}), 1,
                 "expected -1e+12 to 1e+12");
  EXPECT_OUTCOME(slf({"render", field(), "-o", out, "--eye", "0,0,0"}), 1, "same point");
  EXPECT_OUTCOME(slf({"render", field(), "-o", out, "--eye", "1,2"}), 1, "--eye X,Y,Z");
  EXPECT_OUTCOME(slf({"render", field(), "-o", out, "--fov", "400"}), 1, "below 180");
  EXPECT_OUTCOME(slf({"render", field(), "-o", out, "--memory", "lots"}), 1, "64MiB");
  EXPECT_OUTCOME(slf({"render", field(), "-o", place / "o.gif"}), 1, ".png");
  EXPECT_OUTCOME(slf({"evaluate", field(), "--volume", "scene:moon"}), 1, "unknown scene");
  EXPECT_OUTCOME(slf({"measure", field(), "--views", "0"}), 1, "--views");
  EXPECT_OUTCOME(slf({"build", "scene:balls", "-o", place / "x.slf", "--levels", "40"}), 1,
                 "levels");
  EXPECT_OUTCOME(slf({"build", "scene:balls", "-o", place / "x.slf", "--codec", "mp3"}), 1, "mp3");
  EXPECT_TRUE(place.files().empty());
}

TEST_F(Cli, MissingAndWrongFilesAreNamed) {
  Workplace place;
  std::ofstream(place / "empty.slf").close();
  std::ofstream(place / "text.slf") << std::string(100000, 'x');
  std::ofstream(place / "empty.nii").close();
  std::ofstream(place / "bad.json") << "{\"Points\": [1, 2";
  EXPECT_OUTCOME(slf({"info", place / "none.slf"}), 2, "none.slf");
  EXPECT_OUTCOME(slf({"info", place / "empty.slf"}), 3, "empty.slf");
  EXPECT_OUTCOME(slf({"info", place / "text.slf"}), 3, "text.slf");
  EXPECT_OUTCOME(slf({"info", place / "none.nii"}), 2, "none.nii");
  EXPECT_OUTCOME(slf({"info", place / "empty.nii"}), 3, "empty.nii");
  EXPECT_OUTCOME(slf({"build", place / "empty.nii", "-o", place / "o.slf"}), 3, "empty.nii");
  EXPECT_OUTCOME(
      slf({"build", place / "empty.nii", "-o", place / "o.slf", "--transfer", place / "bad.json"}),
      3, "bad.json");
  EXPECT_OUTCOME(slf({"render", field(), "-o", place / "no/such/o.png"}), 2, "o.png");
  EXPECT_OUTCOME(slf({"build", "scene:balls", "-o", place / "no/such/o.slf"}), 2, "o.slf");
  EXPECT_EQ(place.files().size(), 4u);
}

TEST_F(Cli, TheUsualBudgetGrowsWithTheTilesAndAGivenOneDoesNot) {
  const Workplace place;
  const std::vector<std::string> shape{"--entry", "64",      "--exit", "64",      "--levels",
                                       "0",       "--codec", "raw",    "--shard", "1/64"};
  std::vector<std::string> build{"build", "scene:balls", "-o", place / "a.slf"};
  build.insert(build.end(), shape.begin(), shape.end());
  EXPECT_OUTCOME(slf(build), 0, "its tiles needed a budget of ");
  std::vector<std::string> repack{"repack",        place / "a.slf", "-o",
                                  place / "b.slf", "--codec",       "zstd:1"};
  EXPECT_OUTCOME(slf(repack), 0, "its tiles needed a budget of ");
  for (auto* command : {&build, &repack}) {
    command->insert(command->end(), {"--memory", "256MiB", "-f"});
    EXPECT_OUTCOME(slf(*command), 1, "needs at least");
  }
}

TEST_F(Cli, WhatReadsNoAddressesSaysSo) {
  const Workplace place;
  const std::string address = "https://localhost:1/a.slf", output = place / "out.slf";
  for (const std::vector<std::string>& command :
       {std::vector<std::string>{"view", address},
        {"export", address, "-o", place / "out.html"},
        {"merge", address, "-o", output},
        {"build", "https://localhost:1/a.nii", "-o", output},
        {"build", "https://localhost:1/a.ply", "-o", output},
        {"build", "scene:balls", "-o", output, "--only-levels", "1", "--coarser", address},
        {"raycast", "https://localhost:1/a.nii", "-o", place / "a.png"}}) {
    const Outcome refused = slf(command);
    if (refused.exit_code == 5) continue;  // this slf has no page, or reads no addresses
    EXPECT_OUTCOME(refused, 2, "takes no address but a file");
    EXPECT_TRUE(contains(refused.err, "curl -LO")) << refused.err;
  }
}

TEST_F(Cli, AFieldTruncatedAnywhereIsAnErrorOrWhole) {
  Workplace place;
  ASSERT_EQ(slf({"render", field(), "-o", place / "good.png", "--size", "64"}).exit_code, 0);
  const std::string bytes = read_text(field());
  int refused = 0;
  for (int k = 0; k < 24; ++k) {
    const std::string cut = place / "cut.slf";
    std::ofstream(cut, std::ios::binary) << bytes.substr(0, bytes.size() * k / 24);
    const Outcome drawn = slf({"render", cut, "-o", place / "o.png", "-f", "--size", "64"});
    EXPECT_EQ(drawn.signal, 0);
    if (drawn.exit_code != 0) {
      EXPECT_EQ(drawn.exit_code, 3) << k << ": " << drawn.err;
      EXPECT_TRUE(contains(drawn.err, "cut.slf")) << drawn.err;
      EXPECT_FALSE(std::filesystem::exists(place / "o.png"));
      ++refused;
    } else {  // only the index at the end is cut, which readers of local files do not need
      EXPECT_EQ(read_text(place / "o.png"), read_text(place / "good.png"));
    }
    std::filesystem::remove(place / "o.png");
  }
  EXPECT_GT(refused, 18);
}

TEST_F(Cli, AFlippedByteInATileIsFoundWhenItIsDrawn) {
  Workplace place;
  const Outcome good = slf({"render", field(), "-o", place / "good.png", "--size", "64"});
  ASSERT_EQ(good.exit_code, 0);
  std::string bytes = read_text(field());
  int refused = 0;
  for (std::size_t at = bytes.size() / 5; at < bytes.size(); at += bytes.size() / 64) {
    std::string damaged = bytes;
    damaged[at] = static_cast<char>(damaged[at] ^ 0x10);
    const std::string path = place / "damaged.slf";
    std::ofstream(path, std::ios::binary) << damaged;
    const Outcome drawn = slf({"render", path, "-o", place / "o.png", "-f", "--size", "64"});
    ASSERT_EQ(drawn.signal, 0);
    if (drawn.exit_code != 0) {  // found: named, and nothing written
      EXPECT_EQ(drawn.exit_code, 3) << drawn.err;
      EXPECT_TRUE(contains(drawn.err, "damaged.slf")) << drawn.err;
      ++refused;
    } else {  // not in what this view touches: the very same picture
      EXPECT_EQ(read_text(place / "o.png"), read_text(place / "good.png"));
    }
    std::filesystem::remove(place / "o.png");
  }
  EXPECT_GT(refused, 3);  // how many depends on where the pages lie, and so on the commits
}

TEST_F(Cli, BuildRefusesToOverwriteAndForceStartsOver) {
  Workplace place;
  ASSERT_EQ(build(place / "a.slf").exit_code, 0);
  EXPECT_OUTCOME(build(place / "a.slf"), 0, "nothing is left to build");
  // Other settings than those of the field that is there.
  EXPECT_OUTCOME(build(place / "a.slf", {"--radius", "0.9"}), 1, "other settings");
  EXPECT_OUTCOME(build(place / "a.slf", {"--entry-extra-levels", "1"}), 1, "other settings");
  EXPECT_OUTCOME(build(place / "a.slf", {"--no-depth"}), 1, "other settings");
  EXPECT_OUTCOME(build(place / "a.slf", {"--exit-depth"}), 1, "unknown option '--exit-depth'");
  EXPECT_EQ(build(place / "a.slf", {"-f"}).exit_code, 0);
}

TEST_F(Cli, AFullDiskIsSaidAndTheBuildResumesWhenThereIsRoom) {
  Workplace place;
  // 400 blocks of 1 KiB: the file may not grow beyond; writes fail as on a full disk.
  const std::vector<std::string> arguments{"build",    "scene:balls", "-o",      place / "a.slf",
                                           "--entry",  "2",           "--exit",  "8",
                                           "--levels", "2",           "--codec", "raw"};
  const Outcome full = slf(arguments, "trap '' XFSZ; ulimit -f 400;");
  EXPECT_EQ(full.exit_code, 2) << full.err;
  EXPECT_TRUE(contains(full.err, "a.slf")) << full.err;
  const Outcome resumed = slf(arguments);
  EXPECT_EQ(resumed.exit_code, 0) << resumed.err;
  EXPECT_EQ(slf({"info", place / "a.slf", "--json"}).json()["complete"], true);
}

TEST_F(Cli, AnUnfinishedFieldDrawsWhatIsThereAndSaysSo) {
  Workplace place;
  // A file size limit ends the build in the middle of level 2.
  const Outcome full = build(place / "whole.slf");
  ASSERT_EQ(full.exit_code, 0);
  const auto limit = std::filesystem::file_size(place / "whole.slf") / 1024 / 2;
  slf({"build", "scene:balls", "-o", place / "part.slf", "--entry", "2", "--exit", "8", "--levels",
       "2", "--codec", "zstd:1", "--commit-every", "0"},
      "trap '' XFSZ; ulimit -f " + std::to_string(limit) + ";");
  const Outcome info = slf({"info", place / "part.slf.unfinished", "--json"});
  ASSERT_EQ(info.exit_code, 0) << info.err;
  EXPECT_EQ(info.json()["complete"], false);
  EXPECT_TRUE(contains(info.err, "incomplete"));
  const Outcome drawn =
      slf({"render", place / "part.slf.unfinished", "-o", place / "o.png", "--size", "64"});
  EXPECT_EQ(drawn.exit_code, 0) << drawn.err;
  EXPECT_TRUE(contains(drawn.err, "incomplete")) << drawn.err;
  EXPECT_TRUE(std::filesystem::exists(place / "o.png"));
}

TEST_F(Cli, ReadOnlyFoldersAndFilesOpen) {
  // Root may write anywhere, so as root the command runs as somebody else.
  const std::string as_user =
      geteuid() == 0 ? "setpriv --reuid=65534 --regid=65534 --clear-groups " : "";
  if (slf({"--version"}, as_user).exit_code != 0)
    GTEST_SKIP() << "cannot run " << SLF_COMMAND << " without the right to write";
  Workplace place;
  std::filesystem::copy(field(), place / "a.slf");
  std::filesystem::permissions(place / "a.slf", std::filesystem::perms(0444));
  std::filesystem::permissions(place.path(), std::filesystem::perms(0555));
  EXPECT_EQ(slf({"info", place / "a.slf"}, as_user).exit_code, 0);
  EXPECT_OUTCOME(slf({"render", place / "a.slf", "-o", place / "o.png"}, as_user), 2, "o.png");
  EXPECT_OUTCOME(
      slf({"build", "scene:balls", "-o", place / "b.slf", "--entry", "2", "--exit", "8"}, as_user),
      2, "b.slf");
}

TEST_F(Cli, HelpTeaches) {
  const Outcome help = slf({"--help"});
  EXPECT_EQ(help.exit_code, 0);
  for (const char* command :
       {"build", "info", "render", "raycast", "measure", "evaluate", "compare"}) {
    EXPECT_TRUE(contains(help.out, command));
    EXPECT_EQ(slf({command, "--help"}).exit_code, 0);
  }
  EXPECT_TRUE(contains(help.out, "Exit codes"));
  EXPECT_TRUE(contains(slf({"--version"}).out, "slf "));
}

}  // namespace
}  // namespace slf

// slf repack and slf verify as users meet them: exit codes, messages, and what is left on the disk.
#include "field/field_file.h"
#include "slf/image.h"
#include "tests/cli/cli_testing.h"
#include "tests/field/field_testing.h"

namespace slf {
namespace {

using testing::Outcome;
using testing::read_text;
using testing::slf;
using testing::Workplace;

using Names = std::vector<std::string>;

/// A field of a few megabytes, built once and copied where it is to be damaged.
class RepackCli : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    place_ = new Workplace;
    const Outcome built = build(field());
    ASSERT_EQ(built.exit_code, 0) << built.err;
  }
  static void TearDownTestSuite() { delete place_; }
  static std::string field() { return *place_ / "in.slf"; }
  static Outcome build(const std::string& path) {
    return slf({"build", "scene:balls", "-o", path, "--entry", "4", "--exit", "8", "--levels", "2",
                "--codec", "raw"});
  }

  /// A copy of the field with a bit of one tile flipped.
  static void damage(const std::string& path, TileKey key) {
    std::string bytes = read_text(field());
    const auto open = Field::open(field());
    const auto tile = open->file().store().find(key);
    ASSERT_EQ(tile->state, storage::TileState::stored);
    bytes[open->file().store().range(*tile).begin] ^= 1;
    std::ofstream(path, std::ios::binary) << bytes;
  }

  static inline Workplace* place_ = nullptr;
};

TEST_F(RepackCli, RecodesAndSaysWhatItDid) {
  Workplace place;
  const Outcome done = slf({"repack", field(), "-o", place / "out.slf", "--codec", "jpeg:70",
                            "--levels", "1", "--json"});
  ASSERT_EQ(done.exit_code, 0) << done.err;
  const auto json = done.json();
  EXPECT_EQ(json["tiles"], 64 + 1024);
  EXPECT_EQ(json["recoded"], json["tiles"]);
  EXPECT_EQ(json["copied"], 0);
  EXPECT_EQ(json["missing"], 0);
  EXPECT_EQ(json["file_bytes"], std::filesystem::file_size(place / "out.slf"));
  EXPECT_EQ(json["input_bytes"], std::filesystem::file_size(field()));
  const auto info = slf({"info", place / "out.slf", "--json"}).json();
  EXPECT_EQ(info["codec"], "jpeg:70");
  EXPECT_EQ(info["levels"].size(), 2u);
  EXPECT_EQ(info["payload_bytes"], json["payload_bytes"]);
  EXPECT_EQ(place.files(), Names{"out.slf"});
  EXPECT_OUTCOME(slf({"verify", place / "out.slf"}), 0, "");
}

TEST_F(RepackCli, AKeptSubfieldRenders) {
  Workplace place;
  ASSERT_EQ(slf({"repack", field(), "-o", place / "out.slf", "--subfields", "7,8-10", "--no-depth"})
                .exit_code,
            0);
  const auto info = slf({"info", place / "out.slf", "--json"}).json();
  EXPECT_EQ(info["subfields"], (std::vector<int>{7, 8, 9, 10}));
  EXPECT_EQ(info["format"], "rgba8");
  EXPECT_EQ(info["complete"], true);
  EXPECT_OUTCOME(
      slf({"render", place / "out.slf", "-o", place / "o.png", "--size", "32", "--transparent"}), 0,
      "");
  EXPECT_OUTCOME(
      slf({"repack", place / "out.slf", "-o", place / "more.slf", "--subfields", "7,11"}), 1,
      "no subfield 11");
}

TEST_F(RepackCli, RefusesNonsense) {
  Workplace place;
  const std::string out = place / "out.slf";
  for (const char* wrong : {"64", "5-3", "x", "1;2", "-1", "1-2-3"})
    EXPECT_OUTCOME(slf({"repack", field(), "-o", out, "--subfields=" + std::string(wrong)}), 1,
                   "--subfields");
  EXPECT_OUTCOME(slf({"repack", field(), "-o", out, "--levels", "-1"}), 1, "--finest-level");
  EXPECT_OUTCOME(slf({"repack", field(), "-o", out, "--levels", "3"}), 1, "levels 0 to 2");
  EXPECT_OUTCOME(slf({"repack", field(), "-o", out, "--codec", "mp3"}), 1, "mp3");
  EXPECT_OUTCOME(slf({"repack", field(), "-o", out, "--color-type", "float"}), 1, "float");
  EXPECT_OUTCOME(slf({"repack", field(), "-o", out, "--memory", "lots"}), 1, "64MiB");
  EXPECT_OUTCOME(slf({"repack", field(), "-o", field(), "-f"}), 1, "is the input");
  EXPECT_OUTCOME(slf({"repack", field(), "-o", out, "--color-type", "half", "--codec", "jpeg:90"}),
                 5, "jpeg");
  EXPECT_OUTCOME(slf({"repack", place / "none.slf", "-o", out}), 2, "none.slf");
  EXPECT_OUTCOME(slf({"repack", field(), "-o", place / "no/such.slf"}), 2, "no/such.slf");
  EXPECT_EQ(place.files(), Names{});
}

TEST_F(RepackCli, AnExistingOutputIsKeptUnlessForced) {
  Workplace place;
  const std::string out = place / "out.slf";
  std::ofstream(out) << "precious";
  EXPECT_OUTCOME(slf({"repack", field(), "-o", out}), 1, "exists");
  EXPECT_OUTCOME(slf({"repack", field(), "-o", out, "-f", "--codec", "mp3"}), 1, "mp3");
  EXPECT_EQ(read_text(out), "precious");
  EXPECT_OUTCOME(slf({"repack", field(), "-o", out, "-f", "--levels", "0"}), 0, "");
  EXPECT_OUTCOME(slf({"verify", out}), 0, "");
  EXPECT_EQ(place.files(), Names{"out.slf"});
}

TEST_F(RepackCli, FixingWithLittleAddressSpaceLosesNothing) {
  if (testing::kSanitized) GTEST_SKIP() << "sanitizers need more address space";
  Workplace place;
  const std::string file = place / "deep.slf";
  ASSERT_EQ(slf({"build", "scene:balls", "-o", file, "--entry", "1", "--exit", "2",
                 "--finest-level", "4", "--shard", "1/256"})
                .exit_code,
            0);
  const std::string before = read_text(file);
  for (const char* kilobytes : {"80000", "100000", "150000"}) {
    const Outcome fixed =
        slf({"verify", file, "--fix"}, "ulimit -v " + std::string(kilobytes) + ";");
    EXPECT_TRUE(fixed.exit_code == 0 || fixed.exit_code == 4) << kilobytes << fixed.err;
    EXPECT_TRUE(read_text(file) == before) << kilobytes;
  }
}

TEST_F(RepackCli, AFullDiskLeavesNothing) {
  Workplace place;
  const std::string before = read_text(field());
  // Blocks of 1 KiB: writes beyond fail as on a full disk.
  for (const char* blocks : {"4", "60", "400", "1500"}) {
    const Outcome full = slf({"repack", field(), "-o", place / "out.slf"},
                             "trap '' XFSZ; ulimit -f " + std::string(blocks) + ";");
    EXPECT_EQ(full.exit_code, 2) << blocks << full.err;
    EXPECT_NE(full.err.find("out.slf"), std::string::npos) << full.err;
    EXPECT_EQ(place.files(), Names{}) << blocks;
  }
  EXPECT_TRUE(read_text(field()) == before);
}

TEST_F(RepackCli, AFullDiskStopsAMergeAndLeavesTheParts) {
  Workplace place;
  for (const char* range : {"0-31", "32-63"})
    ASSERT_EQ(
        slf({"repack", field(), "-o", place / (range + std::string(".slf")), "--subfields", range})
            .exit_code,
        0);
  const std::vector<std::string> merge{"merge", place / "0-31.slf", place / "32-63.slf", "-o",
                                       place / "out.slf"};
  for (const char* blocks : {"4", "60", "400", "1500"}) {
    const Outcome full = slf(merge, "trap '' XFSZ; ulimit -f " + std::string(blocks) + ";");
    EXPECT_EQ(full.exit_code, 2) << blocks << full.err;
    EXPECT_NE(full.err.find("out.slf"), std::string::npos) << full.err;
    EXPECT_EQ(place.files(), (Names{"0-31.slf", "32-63.slf"})) << blocks;
  }
  EXPECT_EQ(slf(merge).exit_code, 0);
  EXPECT_EQ(slf({"diff", field(), place / "out.slf"}).exit_code, 0);
}

TEST_F(RepackCli, ADamagedTileIsNamedAndNothingIsLeft) {
  Workplace place;
  damage(place / "bad.slf", {0, 7});
  const std::string before = read_text(place / "bad.slf");
  for (const auto& [command, output] : {std::pair{"repack", "out.slf"},
                                        {"merge", "out.slf"},
                                        {"export", "page.html"},
                                        {"export", "site"}}) {
    const Outcome copied = slf({command, place / "bad.slf", "-o", place / output});
    if (copied.exit_code == 5) continue;  // this slf has no page
    EXPECT_OUTCOME(copied, 3, "tile 0/7");
    EXPECT_OUTCOME(copied, 3, "slf verify --fix");
  }
  EXPECT_EQ(place.files(), Names{"bad.slf"});
  EXPECT_TRUE(read_text(place / "bad.slf") == before);
}

TEST_F(RepackCli, VerifyTellsDamageFromIncompleteness) {
  Workplace place;
  const Outcome good = slf({"verify", field()});
  EXPECT_EQ(good.exit_code, 0) << good.err;
  EXPECT_NE(good.out.find("all good"), std::string::npos);

  const std::string bad = place / "bad.slf";
  damage(bad, {0, 7});
  const Outcome found = slf({"verify", bad});
  EXPECT_EQ(found.exit_code, 3);
  EXPECT_EQ(found.out.substr(0, 3), "T1 ");
  EXPECT_NE(found.out.find("0/7"), std::string::npos) << found.out;
  EXPECT_NE(found.err.find("--fix"), std::string::npos) << found.err;
  EXPECT_EQ(slf({"verify", bad, "--quick"}).exit_code, 0);

  const auto json = slf({"verify", bad, "--json"}).json();
  EXPECT_EQ(json["findings"][0]["id"], "T1");
  EXPECT_EQ(json["found"], 1);
  EXPECT_EQ(json["damaged"], 1);
  EXPECT_EQ(json["unfixed"], 1);
  EXPECT_EQ(json["dropped"], 0);
  EXPECT_EQ(json["complete"], true);
  EXPECT_EQ(json["tiles"], 64 + 1024 + 16384);

  const auto fixed = slf({"verify", bad, "--fix", "--json"});
  EXPECT_EQ(fixed.exit_code, 0) << fixed.err;
  EXPECT_EQ(fixed.json()["dropped"], 1);
  EXPECT_EQ(fixed.json()["unfixed"], 0);
  const Outcome incomplete = slf({"verify", bad});
  EXPECT_EQ(incomplete.exit_code, 0);
  EXPECT_EQ(incomplete.out.substr(0, 3), "C1 ");

  ASSERT_EQ(build(bad).exit_code, 0);
  EXPECT_EQ(slf({"verify", bad}).exit_code, 0);
  EXPECT_EQ(testing::all_tiles(*Field::open(bad)), testing::all_tiles(*Field::open(field())));
}

TEST_F(RepackCli, MessagesNameTheFileThatTheUserNamed) {
  Workplace place;
  const std::string out = place / "no/such.slf";
  for (const Outcome& outcome : {slf({"repack", field(), "-o", out}), build(out)}) {
    EXPECT_EQ(outcome.exit_code, 2);
    EXPECT_NE(outcome.err.find(out + ": cannot write"), std::string::npos) << outcome.err;
  }
}

TEST_F(RepackCli, VerifySaysWhatItCannotFix) {
  Workplace place;
  const std::string bytes = read_text(field());
  std::ofstream(place / "short.slf") << bytes.substr(0, bytes.size() / 2);
  const Outcome cut = slf({"verify", place / "short.slf"});
  EXPECT_EQ(cut.exit_code, 3);
  EXPECT_NE(cut.err.find("restore a copy"), std::string::npos) << cut.err;
  EXPECT_EQ(cut.err.find("--fix"), std::string::npos) << cut.err;
  std::ofstream(place / "text.slf") << std::string(20000, 'x');
  EXPECT_OUTCOME(slf({"verify", place / "text.slf", "--fix"}), 3, "cannot be fixed");
  EXPECT_OUTCOME(slf({"verify", place / "text.slf"}), 3, "text.slf");
  EXPECT_OUTCOME(slf({"verify", place / "none.slf"}), 2, "none.slf");
}

// Values above 1 survive from a half-float field to an OpenEXR picture.
TEST_F(RepackCli, BrightColoursReachThePicture) {
  Workplace place;
  const testing::FunctionScene bright([](const glm::dvec3&, const glm::dvec3&) {
    return RaySample{{7.5f, 0.25f, 100, 1}, 0.5f};
  });
  auto options = testing::lossless_options(2, 3, 1);
  options.half = true;
  ASSERT_TRUE(testing::build_and_open(bright, place / "in.slf", options));
  ASSERT_EQ(
      slf({"repack", place / "in.slf", "-o", place / "out.slf", "--codec", "zstd:9"}).exit_code, 0);
  const Outcome drawn =
      slf({"render", place / "out.slf", "-o", place / "o.exr", "--size", "16", "--mode", "bitri"});
  ASSERT_EQ(drawn.exit_code, 0) << drawn.err;
  const auto image = read_image(place / "o.exr");
  ASSERT_TRUE(image);
  const glm::vec4 middle = image->rgba[8 * 16 + 8];
  EXPECT_NEAR(middle.r, 7.5f, 0.01f);
  EXPECT_NEAR(middle.b, 100, 0.1f);
}

TEST_F(RepackCli, HalfFloatFieldsBuildFromTheCommandLine) {
  Workplace place;
  ASSERT_EQ(slf({"build", "scene:balls", "-o", place / "half.slf", "--entry", "2", "--exit", "4",
                 "--levels", "1", "--color-type", "half"})
                .exit_code,
            0);
  const auto info = slf({"info", place / "half.slf", "--json"}).json();
  EXPECT_EQ(info["format"], "rgba16f_depth8");
  EXPECT_EQ(info["codec"], "predictive:90");
  EXPECT_EQ(slf({"verify", place / "half.slf"}).exit_code, 0);
  ASSERT_EQ(slf({"repack", place / "half.slf", "-o", place / "u8.slf", "--color-type", "u8",
                 "--codec", "jpeg:80"})
                .exit_code,
            0);
  EXPECT_EQ(slf({"info", place / "u8.slf", "--json"}).json()["format"], "rgba8_depth8");
}

}  // namespace
}  // namespace slf

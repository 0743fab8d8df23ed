// slf build --reveal, slf reveal, and what other commands do with the record.
#include <fstream>

#include "tests/cli/cli_testing.h"

namespace slf {
namespace {

using Arguments = std::vector<std::string>;
using testing::slf;

/// Ended well, saying this on stdout.
#define EXPECT_PRINTS(outcome, part)                                                      \
  do {                                                                                    \
    const ::slf::testing::Outcome p_ = (outcome);                                         \
    EXPECT_EQ(p_.exit_code, 0) << p_.err;                                                 \
    EXPECT_NE(p_.out.find(part), std::string::npos) << "stdout: " << p_.out << std::endl; \
  } while (false)

class RevealCli : public ::testing::Test {
 protected:
  void SetUp() override {
    write("ball.raw", 0);
    write("other.raw", 3);
  }
  /// A ball in air, of another value inside.
  void write(const std::string& name, int more) const {
    std::ofstream file(place / name, std::ios::binary);
    for (int z = 0; z < 24; ++z)
      for (int y = 0; y < 24; ++y)
        for (int x = 0; x < 24; ++x) {
          const int r2 = (x - 12) * (x - 12) + (y - 12) * (y - 12) + (z - 12) * (z - 12);
          file.put(static_cast<char>(r2 < 30 ? 200 + more : r2 < 81 ? 120 : r2 % 7));
        }
  }
  [[nodiscard]] Arguments build(const std::string& output, const Arguments& more = {}) const {
    Arguments all{"build",
                  place / "ball.raw",
                  "--dims",
                  "24x24x24",
                  "-o",
                  place / output,
                  "--entry",
                  "2",
                  "--exit",
                  "4",
                  "--finest-level",
                  "1",
                  "--transfer",
                  place / "t.json",
                  "--light-samples",
                  "2"};
    all.insert(all.end(), more.begin(), more.end());
    std::ofstream(place / "t.json") << R"([{"Name": "t", "RGBPoints": [0, 1, 1, 1, 255, 1, 0, 0],
                "Points": [0, 0, 0.5, 0, 50, 0, 0.5, 0, 100, 1, 0.5, 0]}])";
    return all;
  }
  [[nodiscard]] std::string bytes(const std::string& name) const {
    return testing::read_text(place / name);
  }
  [[nodiscard]] bool reveals(const std::string& name) const {
    return slf({"info", place / name, "--json"}).json().contains("reveal");
  }
  /// The record itself.
  [[nodiscard]] std::string record(const std::string& name) const {
    const std::string text = bytes(name);
    const std::size_t size = slf({"info", place / name, "--json"}).json()["reveal"]["bytes"];
    return text.substr(text.rfind("SLV1"), size);
  }
  void flip(const std::string& name, std::string_view at, std::size_t by) const {
    std::string text = bytes(name);
    const std::size_t found = text.find(at);
    ASSERT_NE(found, std::string::npos);
    text[found + by] = static_cast<char>(text[found + by] ^ 1);
    std::ofstream(place / name, std::ios::binary) << text;
  }

  testing::Workplace place;
};

TEST_F(RevealCli, IsOffByDefault) {
  ASSERT_EQ(slf(build("a.slf")).exit_code, 0);
  EXPECT_FALSE(reveals("a.slf"));
  EXPECT_EQ(bytes("a.slf").find("SLV1"), std::string::npos);
}

TEST_F(RevealCli, IsBuiltAddedAndSaid) {
  ASSERT_EQ(slf(build("a.slf", {"--reveal", "16"})).exit_code, 0);
  ASSERT_EQ(slf(build("b.slf")).exit_code, 0);
  EXPECT_OUTCOME(slf(build("b.slf", {"--reveal", "16"})), 0, "nothing is left");  // adds it
  ASSERT_EQ(slf(build("c.slf")).exit_code, 0);
  const Arguments add{"reveal", place / "c.slf", "--volume", place / "ball.raw",
                      "--dims", "24x24x24",      "--reveal", "16"};
  EXPECT_PRINTS(slf(add), "bytes");
  for (const char* name : {"a.slf", "b.slf", "c.slf"}) {
    EXPECT_PRINTS(slf({"info", place / name}), "reveal  16x16x16 bytes");
    EXPECT_PRINTS(slf({"verify", place / name}), "all good");
  }
  EXPECT_TRUE(record("a.slf") == record("b.slf"));
  EXPECT_TRUE(record("a.slf") == record("c.slf"));
  EXPECT_EQ(slf({"diff", place / "a.slf", place / "c.slf"}).exit_code, 0);
}

TEST_F(RevealCli, TheNumberMayBeLeftOut) {
  Arguments first = build("a.slf");
  first.insert(first.begin() + 1, "--reveal");  // before the input
  ASSERT_EQ(slf(first).exit_code, 0);
  EXPECT_PRINTS(slf({"info", place / "a.slf"}), "reveal  ");
  EXPECT_OUTCOME(slf(build("b.slf", {"--reveal"})), 0, "complete");
  EXPECT_OUTCOME(slf(build("c.slf", {"--reveal", "7"})), 1, "16 to 512");
  EXPECT_OUTCOME(slf(build("c.slf", {"--reveal-window", "1,2"})), 1, "reveal");
  EXPECT_OUTCOME(slf(build("c.slf", {"--reveal", "--reveal-window", "2,1"})), 1, "ascending");
  EXPECT_OUTCOME(slf({"build", "scene:balls", "-o", place / "d.slf", "--reveal"}), 1, "reveal");
}

TEST_F(RevealCli, AnotherVolumeIsRefused) {
  ASSERT_EQ(slf(build("a.slf")).exit_code, 0);
  const std::string before = bytes("a.slf");
  EXPECT_OUTCOME(
      slf({"reveal", place / "a.slf", "--volume", place / "other.raw", "--dims", "24x24x24"}), 1,
      "another volume");
  EXPECT_TRUE(bytes("a.slf") == before);
}

TEST_F(RevealCli, CopiesKeepItOrLeaveItOut) {
  ASSERT_EQ(slf(build("a.slf", {"--reveal"})).exit_code, 0);
  ASSERT_EQ(slf({"repack", place / "a.slf", "-o", place / "b.slf"}).exit_code, 0);
  ASSERT_EQ(slf({"repack", place / "a.slf", "-o", place / "c.slf", "--no-reveal"}).exit_code, 0);
  EXPECT_TRUE(reveals("b.slf"));
  EXPECT_FALSE(reveals("c.slf"));
  EXPECT_EQ(bytes("c.slf").find("SLV1"), std::string::npos);
  ASSERT_EQ(slf({"export", place / "a.slf", "-o", place / "kept"}).exit_code, 0);
  ASSERT_EQ(slf({"export", place / "a.slf", "-o", place / "bare", "--no-reveal"}).exit_code, 0);
  EXPECT_TRUE(reveals("kept/field.slf"));
  EXPECT_FALSE(reveals("bare/field.slf"));
}

TEST_F(RevealCli, AStateOfAnotherVolumeTakesNoneAlong) {
  std::ofstream(place / "s.json")
      << R"({"states": [{"name": "one"}, {"name": "two", "input": "other.raw"}]})";
  ASSERT_EQ(slf(build("a.slf", {"--reveal", "--states", place / "s.json"})).exit_code, 0);
  ASSERT_TRUE(reveals("a.slf"));
  ASSERT_EQ(slf({"repack", place / "a.slf", "-o", place / "two.slf", "--states", "two"}).exit_code,
            0);
  EXPECT_FALSE(reveals("two.slf"));
  EXPECT_EQ(bytes("two.slf").find("SLV1"), std::string::npos);
  const Arguments cut{"render", place / "a.slf",  "--state", "two",
                      "--clip", "12,12,12,1,0,0", "--size",  "16",
                      "-o",     place / "p.png",  "-f"};
  EXPECT_OUTCOME(slf(cut), 0, "the cut is hollow");
}

TEST_F(RevealCli, MergedPartsHaveItOnce) {
  for (const std::string k : {"1", "2"})
    ASSERT_EQ(slf(build(k + ".slf", {"--reveal", "--shard", k + "/2"})).exit_code, 0);
  ASSERT_EQ(slf(build("whole.slf", {"--reveal"})).exit_code, 0);
  ASSERT_EQ(slf({"merge", place / "1.slf", place / "2.slf", "-o", place / "merged.slf"}).exit_code,
            0);
  EXPECT_EQ(slf({"diff", place / "merged.slf", place / "whole.slf"}).exit_code, 0);
  EXPECT_TRUE(record("merged.slf") == record("whole.slf"));
}

TEST_F(RevealCli, DamageIsFoundAndDropped) {
  ASSERT_EQ(slf(build("a.slf", {"--reveal"})).exit_code, 0);
  flip("a.slf", "SLV1", 300);
  const auto found = slf({"verify", place / "a.slf"});
  EXPECT_EQ(found.exit_code, 3);
  EXPECT_NE(found.out.find("V1"), std::string::npos) << found.out;
  EXPECT_OUTCOME(slf({"info", place / "a.slf"}), 0, "checksum");
  EXPECT_OUTCOME(slf({"repack", place / "a.slf", "-o", place / "b.slf"}), 3,
                 "leave the reveal out");
  const Arguments view{"render", place / "a.slf", "--size", "16", "-o", place / "p.png", "-f"};
  EXPECT_EQ(slf(view).exit_code, 0);
  Arguments cut = view;
  cut.insert(cut.end(), {"--clip", "12,12,12,1,0,0"});
  EXPECT_OUTCOME(slf(cut), 3, "reveal");
  EXPECT_EQ(slf({"verify", place / "a.slf", "--fix"}).exit_code, 0);
  EXPECT_PRINTS(slf({"verify", place / "a.slf"}), "all good");
  EXPECT_FALSE(reveals("a.slf"));
}

TEST_F(RevealCli, AFullDiskLeavesTheFieldAsItWas) {
  ASSERT_EQ(slf(build("a.slf")).exit_code, 0);
  const std::string before = bytes("a.slf");
  const Arguments add{"reveal",   place / "a.slf",   "--volume", place / "ball.raw", "--dims",
                      "24x24x24", "--reveal-window", "0,255",    "--reveal"};
  const auto full =
      slf(add, "trap '' XFSZ; ulimit -f " + std::to_string(before.size() / 512) + ";");
  EXPECT_EQ(full.exit_code, 2) << full.err;
  EXPECT_EQ(slf({"verify", place / "a.slf"}).exit_code, 0);
  EXPECT_EQ(slf(add).exit_code, 0);
  EXPECT_TRUE(reveals("a.slf"));
}

TEST_F(RevealCli, CutsShowTheInside) {
  ASSERT_EQ(slf(build("a.slf", {"--reveal"})).exit_code, 0);
  const auto drawn = [&](const std::string& name, const Arguments& more) {
    Arguments all{"render", place / "a.slf", "--orbit", "90,0,3", "--size", "32",
                  "-o",     place / name,    "-f"};
    all.insert(all.end(), more.begin(), more.end());
    const auto outcome = slf(all);
    EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
    return bytes(name);
  };
  const Arguments plane{"--clip", "12,12,12,1,0,0"};
  std::vector<std::string> pictures{drawn("whole.png", {})};
  for (const std::string cap : {"shaded", "coarse", "slice", "slice:100,150", "hollow"})
    pictures.push_back(drawn("cut.png", {plane[0], plane[1], "--cap", cap}));
  for (std::size_t a = 0; a < pictures.size(); ++a)
    for (std::size_t b = a + 1; b < pictures.size(); ++b) EXPECT_TRUE(pictures[a] != pictures[b]);
  EXPECT_TRUE(drawn("d.png", plane) == pictures[1]);
  // Planes that miss change nothing.
  EXPECT_TRUE(drawn("m.png", {"--clip", "120,12,12,1,0,0"}) == pictures[0]);
  const auto pick = slf({"pick", place / "a.slf", "16,16", "--orbit", "90,0,3", "--size", "32",
                         "--clip", "12,12,12,1,0,0", "--json"});
  ASSERT_EQ(pick.exit_code, 0) << pick.err;
  EXPECT_NEAR(pick.json()["point"][0].get<double>(), 12, 0.6);
  EXPECT_PRINTS(
      slf({"measure", place / "a.slf", "--views", "1", "--size", "16", "--clip", "12,12,12,1,0,0"}),
      "tiles");
  EXPECT_PRINTS(slf({"play", place / "a.slf", "--seconds", "0.1", "--size", "16", "--clip",
                     "12,12,12,1,0,0", "--loading", "wait"}),
                "frames");
  const auto quality =
      slf({"evaluate", place / "a.slf", "--volume", place / "ball.raw", "--dims", "24x24x24",
           "--views", "2", "--size", "24", "--clip", "12,12,12,1,0,0", "--json"});
  ASSERT_EQ(quality.exit_code, 0) << quality.err;
  EXPECT_GT(quality.json()["psnr"].get<double>(), 24);
}

TEST_F(RevealCli, EachStateIsCutInItsOwnColours) {
  std::ofstream(place / "u.json") << R"([{"Name": "u", "RGBPoints": [0, 0, 0, 1, 255, 0, 1, 0],
                "Points": [0, 0, 0.5, 0, 50, 0, 0.5, 0, 100, 1, 0.5, 0]}])";
  std::ofstream(place / "s.json")
      << R"({"states": [{"name": "one"}, {"name": "two", "transfer": "u.json"}]})";
  ASSERT_EQ(slf(build("a.slf", {"--reveal", "--states", place / "s.json"})).exit_code, 0);
  for (const char* state : {"one", "two"}) {
    const auto quality = slf({"evaluate", place / "a.slf", "--state", state, "--volume",
                              place / "ball.raw", "--dims", "24x24x24", "--views", "2", "--size",
                              "24", "--clip", "12,12,12,1,0,0", "--cap", "shaded", "--json"});
    ASSERT_EQ(quality.exit_code, 0) << quality.err;
    EXPECT_GT(quality.json()["psnr"].get<double>(), 24) << state;
  }
}

TEST_F(RevealCli, WrongCutsAreRefused) {
  ASSERT_EQ(slf(build("a.slf")).exit_code, 0);
  const auto refused = [&](const Arguments& more, const char* why) {
    Arguments all{"render", place / "a.slf", "--size", "16", "-o", place / "p.png", "-f"};
    all.insert(all.end(), more.begin(), more.end());
    EXPECT_OUTCOME(slf(all), 1, why);
  };
  const Arguments plane{"--clip", "12,12,12,1,0,0"};
  refused({plane[0], plane[1], "--cap", "shaded"}, "no reveal");
  refused({plane[0], plane[1], "--cap", "round"}, "expected shaded");
  refused({plane[0], plane[1], "--cap", "slice:2"}, "numbers");
  refused({plane[0], plane[1], "--mode", "bitri"}, "depth");
  refused({"--clip", "0,0,0,0,0,0"}, "not zero");
  Arguments seven;
  for (int k = 0; k < 7; ++k)
    seven.insert(seven.end(), {"--clip", std::to_string(k) + ",0,0,1,0,0"});
  refused(seven, "at most 6");
}

}  // namespace
}  // namespace slf

// Light that takes long: stopped, resumed, and shared by the parts of a field.
#include <signal.h>

#include <cmath>
#include <limits>

#include "slf/image.h"
#include "tests/cli/cli_testing.h"

extern char** environ;

namespace slf {
namespace {

using testing::slf;
using testing::Workplace;
using Arguments = std::vector<std::string>;

/// A ball of 24³ voxels, and a transfer function that shows it.
class LightCli : public ::testing::Test {
 protected:
  LightCli() {
    std::ofstream volume(place / "ball.raw", std::ios::binary);
    for (int k = 0; k < 24 * 24 * 24; ++k) {
      const double r = std::hypot(k % 24 - 11.5, k / 24 % 24 - 11.5, k / 576 - 11.5);
      volume.put(static_cast<char>(std::clamp(128 + 40 * (8 - r), 0.0, 255.0)));
    }
    std::ofstream(place / "t.json") << R"([{"Name": "t", "RGBPoints": [0, 1, 0.8, 0.6],
        "Points": [100, 0, 0.5, 0, 160, 0.6, 0.5, 0]}])";
  }

  [[nodiscard]] Arguments command(const std::string& name, const std::string& output,
                                  const std::string& samples, const Arguments& more) const {
    Arguments all{"--progress",      "json:0.01",      name,         place / "ball.raw",
                  "--dims",          "24x24x24",       "-o",         place / output,
                  "--transfer",      place / "t.json", "--lighting", "global",
                  "--light-samples", samples};
    all.insert(all.end(), more.begin(), more.end());
    return all;
  }
  [[nodiscard]] Arguments build(const std::string& output, const Arguments& more = {},
                                const std::string& samples = "4") const {
    Arguments all{"--entry", "3", "--exit", "8", "--levels", "1", "--commit-every", "0.001"};
    all.insert(all.end(), more.begin(), more.end());
    return command("build", output, samples, all);
  }

  /// Runs the command and sends it SIGINT once it reports that `done` units of `task` are done. The
  /// signal that ended it, 0 if none did.
  [[nodiscard]] static int interrupt(const Arguments& arguments, const std::string& task,
                                     int done = 0) {
    std::vector<char*> line{const_cast<char*>(SLF_COMMAND)};
    for (const auto& argument : arguments) line.push_back(const_cast<char*>(argument.c_str()));
    line.push_back(nullptr);
    int ends[2];
    EXPECT_EQ(pipe2(ends, O_CLOEXEC), 0);
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_adddup2(&actions, ends[1], STDERR_FILENO);
    pid_t child = 0;
    EXPECT_EQ(posix_spawn(&child, line[0], &actions, nullptr, line.data(), environ), 0);
    posix_spawn_file_actions_destroy(&actions);
    close(ends[1]);
    std::string text, line_of_text;
    char byte = 0;
    bool sent = false;
    while (read(ends[0], &byte, 1) == 1) {
      text += byte;
      if (byte != '\n') {
        line_of_text += byte;
        continue;
      }
      const auto report = nlohmann::json::parse(line_of_text, nullptr, false);
      line_of_text.clear();
      if (sent || !report.is_object() || report.value("task", "") != task ||
          report.value("done", 0) < done)
        continue;
      kill(child, SIGINT);
      sent = true;
    }
    close(ends[0]);
    EXPECT_TRUE(sent) << text;
    int status = 0;
    waitpid(child, &status, 0);
    return WIFSIGNALED(status) ? WTERMSIG(status) : 0;
  }

  Workplace place;
  const std::vector<std::string> inputs{"ball.raw", "t.json"};
};

TEST_F(LightCli, AnInterruptedLightVolumeLeavesNothing) {
  // 65,536 paths a node take minutes. A stop must not wait for many of them.
  EXPECT_EQ(interrupt(build("a.slf", {}, "65536"), "light"), SIGINT);
  EXPECT_EQ(place.files(), inputs);
  EXPECT_EQ(interrupt(command("raycast", "a.png", "65536", {}), "light"), SIGINT);
  EXPECT_EQ(place.files(), inputs);
}

TEST_F(LightCli, AnInterruptedReferenceLeavesNothing) {
  EXPECT_EQ(interrupt(command("raycast", "a.png", "1",
                              {"--reference", "--samples", "4096", "--size", "64"}),
                      "raycast"),
            SIGINT);
  EXPECT_EQ(place.files(), inputs);
}

TEST_F(LightCli, EvaluateComparesWithTheReference) {
  ASSERT_EQ(slf(build("a.slf", {"--codec", "zstd"}, "16")).exit_code, 0);
  const auto psnr = [&](const Arguments& more) {
    Arguments all{"evaluate", place / "a.slf", "--volume", place / "ball.raw", "--dims",
                  "24x24x24", "--views",       "2",        "--size",           "32",
                  "--json"};
    all.insert(all.end(), more.begin(), more.end());
    const auto said = slf(all);
    EXPECT_EQ(said.exit_code, 0) << said.err;
    return said.json().value("psnr", 0.0);
  };
  // The more paths, the closer is the reference to the light volume.
  const double few = psnr({"--reference", "--samples", "1"});
  const double many = psnr({"--reference", "--samples", "64"});
  EXPECT_GT(few, 10);
  EXPECT_GT(many, few + 1);
  EXPECT_LE(many, psnr({}) + 0.5);
}

TEST_F(LightCli, ASkyThatIsNoLightIsRefused) {
  Image sky;
  sky.width = 4, sky.height = 2;
  sky.rgba.assign(8, glm::vec4(1));
  for (const float wrong :
       {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity(), -1.f}) {
    sky.rgba[6].g = wrong;
    ASSERT_TRUE(write_image(place / "sky.exr", sky));
    EXPECT_OUTCOME(slf(command("raycast", "a.png", "4", {"--environment", place / "sky.exr"})), 1,
                   "the radiance at pixel 2,1 is negative or not finite");
  }
}

TEST_F(LightCli, AResumedBuildKeepsItsLight) {
  ASSERT_EQ(slf(build("whole.slf", {"--keep-light"})).exit_code, 0);
  ASSERT_EQ(interrupt(build("a.slf", {"--keep-light"}), "build", 1), SIGINT);
  const auto resumed = slf(build("a.slf", {"--keep-light"}));
  EXPECT_EQ(resumed.exit_code, 0) << resumed.err;
  EXPECT_EQ(resumed.err.find("\"light\""), std::string::npos);
  EXPECT_EQ(place.files(), (std::vector<std::string>{"a.slf", "ball.raw", "t.json", "whole.slf"}));
  EXPECT_EQ(slf({"diff", place / "a.slf", place / "whole.slf"}).exit_code, 0);
}

TEST_F(LightCli, ACompleteFieldNeedsNoLight) {
  const auto built = slf(build("a.slf"));
  ASSERT_EQ(built.exit_code, 0) << built.err;
  EXPECT_NE(built.err.find("\"light\""), std::string::npos);
  const auto again = slf(build("a.slf"));
  EXPECT_OUTCOME(again, 0, "nothing is left to build");
  EXPECT_EQ(again.err.find("\"light\""), std::string::npos);
}

TEST_F(LightCli, AFieldKeepsItsLightIfAsked) {
  ASSERT_EQ(slf(build("a.slf", {"--keep-light"})).exit_code, 0);
  ASSERT_EQ(slf({"repack", place / "a.slf", "-o", place / "same.slf"}).exit_code, 0);
  ASSERT_EQ(slf({"repack", place / "a.slf", "-o", place / "bare.slf", "--no-light"}).exit_code, 0);
  EXPECT_LT(std::filesystem::file_size(place / "bare.slf"),
            std::filesystem::file_size(place / "same.slf"));
  ASSERT_EQ(slf(build("none.slf")).exit_code, 0);
  ASSERT_EQ(slf({"repack", place / "none.slf", "-o", place / "none2.slf"}).exit_code, 0);
  EXPECT_EQ(std::filesystem::file_size(place / "none2.slf"),
            std::filesystem::file_size(place / "bare.slf"));
  const auto evaluate = [&](const std::string& field) {
    return slf({"--progress", "json:0.01", "evaluate", place / field, "--volume",
                place / "ball.raw", "--dims", "24x24x24", "--views", "1", "--size", "16",
                "--json"});
  };
  const auto a = evaluate("a.slf"), same = evaluate("same.slf"), bare = evaluate("bare.slf");
  ASSERT_EQ(a.exit_code, 0) << a.err;
  EXPECT_EQ(a.err.find("\"light\""), std::string::npos) << a.err;
  EXPECT_EQ(same.err.find("\"light\""), std::string::npos);
  EXPECT_NE(bare.err.find("\"light\""), std::string::npos);
  EXPECT_EQ(a.json()["psnr"], bare.json()["psnr"]);
  EXPECT_EQ(slf({"verify", place / "a.slf"}).exit_code, 0);
}

// Radiance without a tone curve is far too dark, and bright parts are cut off.
TEST_F(LightCli, PlayShowsRadianceAsRenderDoes) {
  ASSERT_EQ(slf(build("a.slf", {"--color-type", "half", "--codec", "zstd"})).exit_code, 0);
  ASSERT_EQ(slf({"play", place / "a.slf", "--orbit", "10,20,3", "--seconds", "0.1", "--size", "32",
                 "--loading", "wait", "--frames", place / "frames"})
                .exit_code,
            0);
  ASSERT_EQ(
      slf({"render", place / "a.slf", "--orbit", "10,20,3", "--size", "32", "-o", place / "r.png"})
          .exit_code,
      0);
  const auto played = read_image(place / "frames/00000.png"), drawn = read_image(place / "r.png");
  ASSERT_TRUE(played && drawn);
  EXPECT_TRUE(played->rgba == drawn->rgba);
}

TEST_F(LightCli, DamagedLightIsFoundAndComputedAgain) {
  ASSERT_EQ(slf(build("a.slf", {"--keep-light"})).exit_code, 0);
  std::string bytes = testing::read_text(place / "a.slf");
  const std::size_t at = bytes.find("SLG2");
  ASSERT_NE(at, std::string::npos);
  bytes[at + 100] = static_cast<char>(bytes[at + 100] ^ 1);
  std::ofstream(place / "a.slf", std::ios::binary) << bytes;
  const auto found = slf({"verify", place / "a.slf"});
  EXPECT_EQ(found.exit_code, 3);
  EXPECT_NE(found.out.find("L1"), std::string::npos) << found.out;
  const Arguments evaluate{"evaluate", place / "a.slf", "--volume", place / "ball.raw", "--dims",
                           "24x24x24", "--views",       "1",        "--size",           "16"};
  EXPECT_OUTCOME(slf(evaluate), 0, "computing the light again");
  EXPECT_OUTCOME(slf({"repack", place / "a.slf", "-o", place / "b.slf"}), 3, "leave the light out");
  EXPECT_EQ(slf({"verify", place / "a.slf", "--fix"}).exit_code, 0);
  EXPECT_EQ(slf({"verify", place / "a.slf"}).exit_code, 0);
}

TEST_F(LightCli, ShardsShareALightVolume) {
  const Arguments share{"--light-file", place / "shared.light"};
  for (const std::string k : {"1", "2", "3"}) {
    Arguments shard{"--shard", k + "/3"};
    shard.insert(shard.end(), share.begin(), share.end());
    const auto built = slf(build(k + ".slf", shard));
    ASSERT_EQ(built.exit_code, 0) << built.err;
    EXPECT_EQ(built.err.find("\"light\"") != std::string::npos, k == "1");
  }
  ASSERT_EQ(slf(build("alone.slf", {"--shard", "2/3"})).exit_code, 0);
  ASSERT_EQ(slf(build("whole.slf")).exit_code, 0);
  ASSERT_EQ(
      slf({"merge", place / "1.slf", place / "2.slf", place / "3.slf", "-o", place / "merged.slf"})
          .exit_code,
      0);
  EXPECT_EQ(slf({"diff", place / "merged.slf", place / "whole.slf"}).exit_code, 0);
  EXPECT_EQ(testing::read_text(place / "alone.slf"), testing::read_text(place / "2.slf"));
}

}  // namespace
}  // namespace slf

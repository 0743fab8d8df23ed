// Arguments that make no sense are refused, with the option, the value and what is accepted; and
// what `slf help` and misspelt names say.
#include "tests/cli/cli_testing.h"
#include "tests/sanitized.h"

namespace slf {
namespace {

using testing::kGoldenField;
using testing::Outcome;
using testing::read_text;
using testing::slf;
using testing::Workplace;

using Arguments = std::vector<std::string>;

/// A usage error that says all of this, and writes nothing.
void expect_refused(Arguments arguments, const Arguments& parts) {
  const Workplace place;
  for (std::string& argument : arguments)
    if (argument.starts_with("OUT")) argument = place / ("out" + argument.substr(3));
  const Outcome outcome = slf(arguments);
  EXPECT_EQ(outcome.signal, 0);
  EXPECT_EQ(outcome.exit_code, 1) << outcome.err;
  for (const std::string& part : parts)
    EXPECT_NE(outcome.err.find(part), std::string::npos) << part << " in " << outcome.err;
  EXPECT_TRUE(place.files().empty());
}

Arguments render(const Arguments& more, const std::string& output = "OUT.png") {
  Arguments all{"render", kGoldenField, "-o", output};
  all.insert(all.end(), more.begin(), more.end());
  return all;
}

TEST(Refused, CamerasThatSeeNothing) {
  expect_refused(render({"--fov", "0"}), {"--fov", "0", "above 0 and below 180"});
  expect_refused(render({"--fov", "180"}), {"--fov", "180", "below 180"});
  expect_refused(render({"--fov", "nan"}), {"--fov", "nan", "below 180"});
  expect_refused(render({"--orbit", "0,0,-3"}), {"--orbit", "-3", "a distance above 0"});
  expect_refused(render({"--orbit", "0,0,0"}), {"--orbit", "a distance above 0"});
  expect_refused({"play", kGoldenField, "--orbit", "0,0,-3"},
                 {"--orbit", "-3", "a distance above 0"});
  expect_refused(render({"--eye", "500,0,0", "--orbit", "0,0,3"}), {"--eye", "--orbit"});
  expect_refused(render({"--eye", "0,0,500", "--up", "0,0,1"}), {"up", "--up"});
}

TEST(Refused, ValuesOutOfRange) {
  expect_refused(render({"--background", "2,0,0"}), {"--background", "2", "0 to 1"});
  expect_refused(render({"--background", "0.5"}), {"--background", "R,G,B"});
  expect_refused(render({"--memory", "-5"}), {"--memory", "-5", "64MiB"});
  for (const char* size : {"5 parsecs", "5mm", "5bb", "1e40", "nan", "G", ""})
    expect_refused(render({"--memory", size}), {"--memory", size, "64MiB"});
  expect_refused(render({"--size", "64x"}), {"--size", "64x", "WIDTHxHEIGHT"});
  expect_refused(render({"--size", "64x64x64"}), {"--size", "64x64x64"});
  expect_refused(render({"--size", "-64"}), {"--size", "-64"});
  expect_refused(render({"--level", "-1"}), {"--level", "-1", "finest; auto"});
  expect_refused({"info", "a.raw", "--dims", "2x2"}, {"--dims", "NXxNYxNZ"});
  expect_refused({"info", "a.raw", "--dims", "2x0x2"}, {"--dims", "0"});
  expect_refused({"info", "a.raw", "--dims", "2x2x2", "--type", "u7"}, {"--type", "u7", "u8"});
  expect_refused({"info", "a.raw", "--type", "u8"}, {"--type", "--dims"});
}

TEST(Refused, NumbersWithoutBounds) {
  const Arguments build{"build", "scene:balls", "-o", "OUT.slf"};
  const Arguments raycast{"raycast", "scene:balls", "-o", "OUT.png"};
  const Arguments play{"play", kGoldenField}, measure{"measure", kGoldenField};
  const Arguments evaluate{"evaluate", kGoldenField, "--volume", "scene:balls"};
  const Arguments compare{"compare", "a.png", "b.png"}, diff{"diff", kGoldenField, kGoldenField};
  const struct {
    Arguments command;
    std::string option, before, after;  // the number is between two others
  } cases[] = {{render({}), "--background", "0,", ",0"},
               {render({}), "--eye", "0,", ",0"},
               {render({}), "--look-at", "", ",0,0"},
               {render({}), "--up", "0,0,", ""},
               {render({}), "--orbit", "", ",0,3"},
               {render({}), "--orbit", "0,0,", ""},
               {render({}), "--fov", "", ""},
               {render({}), "--exposure", "", ""},
               {raycast, "--step", "", ""},
               {raycast, "--light", "0,0,", ""},
               {raycast, "--ambient", "", ""},
               {raycast, "--environment-gain", "", ""},
               {raycast, "--light-spacing", "", ""},
               {raycast, "--light-samples", "", ""},
               {raycast, "--spacing", "1x1x", ""},
               {build, "--radius", "", ""},
               {build, "--center", "0,", ",0"},
               {build, "--commit-every", "", ""},
               {play, "--seconds", "", ""},
               {play, "--turns", "", ""},
               {play, "--fps", "", ""},
               {play, "--orbit", "0,0,", ""},
               {measure, "--distance", "", ""},
               {measure, "--views", "", ""},
               {evaluate, "--distance", "", ""},
               {evaluate, "--supersample", "", ""},
               {compare, "--gain", "", ""},
               {compare, "--min-psnr", "", ""},
               {diff, "--min-psnr", "", ""}};
  for (const auto& [command, option, before, after] : cases)
    for (const std::string number : {"nan", "inf", "-inf", "1e999"}) {
      Arguments all = command;
      all.insert(all.end(), {option, before + number + after});
      expect_refused(all, {option});
    }
  for (const char* radius : {"1e308", "1e-308", "0"}) {
    Arguments all = build;
    all.insert(all.end(), {"--radius", radius});
    expect_refused(all, {"--radius", radius, "1e-12 to 1e+12"});
  }
  for (const Arguments& command : {render({}),
                                   raycast,
                                   build,
                                   play,
                                   measure,
                                   diff,
                                   {"verify", kGoldenField},
                                   {"merge", kGoldenField, "-o", "OUT.slf"},
                                   {"repack", kGoldenField, "-o", "OUT.slf"}}) {
    Arguments all = command;
    all.insert(all.end(), {"--threads", "100000"});
    expect_refused(all, {"--threads", "100000", "0 to 1024"});
  }
  expect_refused(render({"--size", "4294967295"}), {"--size", "4294967295"});
}

TEST(Refused, CodecsThatCannotHoldTheColours) {
  const Workplace place;
  EXPECT_OUTCOME(slf({"build", "scene:balls", "-o", place / "a.slf", "--color-type", "half",
                      "--codec", "jpeg:90"}),
                 5, "JPEG cannot hold half floats; use zstd");
  EXPECT_TRUE(place.files().empty());
}

// A file without an end is no regular file.
TEST(Refused, FilesWithoutAnEnd) {
  const Workplace place;
  const std::string volume = place / "a.raw";
  std::ofstream(volume) << std::string(8 * 8 * 4, '\0') + std::string(8 * 8 * 4, 'x');
  // The sanitizers need more addresses than there is memory.
  const std::string limit = testing::kSanitized ? "" : "ulimit -v 1500000;";
  EXPECT_OUTCOME(slf({"compare", "/dev/zero", "/dev/zero"}, limit), 2, "not a regular file");
  for (const std::string option :
       {"--environment", "--light-rig", "--transfer", "--labels-volume", "--mask"}) {
    const Outcome outcome = slf({"raycast", volume, "--dims", "8x8x8", "-o", place / "a.png",
                                 "--lighting", "shadowed", option, "/dev/zero"},
                                limit);
    EXPECT_NE(outcome.exit_code, 0) << option;
    EXPECT_NE(outcome.err.find("/dev/zero: "), std::string::npos) << outcome.err;
    EXPECT_EQ(outcome.err.find("memory"), std::string::npos) << outcome.err;
  }
}

TEST(Sizes, HaveFractionsAndUnitsOfAnyCase) {
  for (const char* size : {"1.5GiB", "1.5g", "0.25 gb", "5e8", "300000k"}) {
    const Workplace place;
    EXPECT_EQ(slf({"render", kGoldenField, "-o", place / "o.png", "--size", "8", "--memory", size})
                  .exit_code,
              0)
        << size;
  }
}

TEST(Refused, OutputsThatCannotHoldWhatIsAskedFor) {
  expect_refused(render({"--transparent"}, "OUT.jpg"), {"--transparent", ".jpg", ".png"});
  expect_refused(render({"--transparent"}, "OUT.jpeg"), {"--transparent", ".jpeg", ".png"});
  expect_refused({"play", kGoldenField, "--preview", "OUT.gif"}, {"--preview", "out.gif", ".webp"});
}

TEST(Refused, ASphereThatMissesEverything) {
  expect_refused({"build", "scene:balls", "-o", "OUT.slf", "--center", "1000,0,0"},
                 {"around 1000,0,0 misses all that is visible", "see --center and --radius"});
  expect_refused({"build", "scene:balls", "-o", "OUT.slf", "--radius", "-1"}, {"--radius", "-1"});
}

TEST(EntryDepth, IsStillTakenForEntryExtraLevels) {
  const Workplace place;
  for (const std::string option : {"--entry-depth", "--entry-extra-levels"})
    ASSERT_EQ(slf({"build", "scene:balls", "-o", place / (option + ".slf"), "--entry", "4",
                   "--exit", "3", "--levels", "0", option, "1"})
                  .exit_code,
              0);
  EXPECT_EQ(slf({"info", place / "--entry-depth.slf", "--json"}).out,
            slf({"info", place / "--entry-extra-levels.slf", "--json"}).out);
  EXPECT_EQ(slf({"info", place / "--entry-depth.slf", "--json"}).json()["entry_depth"], 1);
  expect_refused(
      {"build", "scene:balls", "-o", "OUT.slf", "--entry-depth", "1", "--entry-extra-levels", "1"},
      {"--entry-extra-levels", "At Most 1"});
  const std::string help = slf({"build", "--help"}).out;
  EXPECT_EQ(help.find("--entry-depth"), std::string::npos);
  EXPECT_EQ(help.find("--entry-extra-levels UINT=0 Excludes"), std::string::npos) << help;
}

TEST(Help, IsACommandToo) {
  EXPECT_EQ(slf({"help"}).out, slf({"--help"}).out);
  EXPECT_EQ(slf({"help", "render"}).out, slf({"render", "--help"}).out);
  EXPECT_FALSE(slf({"help", "render"}).out.empty());
  EXPECT_OUTCOME(slf({"help", "rendr"}), 1, "did you mean 'render'?");
}

TEST(Help, SuggestsTheNearestName) {
  EXPECT_OUTCOME(slf({"bogus"}), 1, "unknown command 'bogus'");
  EXPECT_EQ(slf({"bogus"}).err.find("did you mean"), std::string::npos);
  EXPECT_OUTCOME(slf({"rendr", "a.slf"}), 1, "did you mean 'render'?");
  EXPECT_OUTCOME(slf({"verfy", "a.slf"}), 1, "did you mean 'verify'?");
  EXPECT_OUTCOME(slf(render({"--colour"})), 1, "unknown option '--colour'");
  EXPECT_OUTCOME(slf(render({"--backgroud=0,0,0"})), 1, "did you mean '--background'?");
  EXPECT_OUTCOME(slf({}), 1, "no command given");
}

TEST(OtherVolumes, AreWarnedOf) {
  const Outcome same = slf({"evaluate", kGoldenField, "--volume", "scene:balls", "--views", "1",
                            "--size", "16", "--json"});
  EXPECT_EQ(same.exit_code, 0) << same.err;
  EXPECT_EQ(same.json()["same_source"], true);
  EXPECT_EQ(same.err, "");
  const Outcome other = slf({"-q", "evaluate", kGoldenField, "--volume", "scene:globe", "--views",
                             "1", "--size", "16", "--json"});
  EXPECT_EQ(other.exit_code, 0) << other.err;
  EXPECT_EQ(other.json()["same_source"], false);
  EXPECT_NE(other.err.find("warning: " + kGoldenField), std::string::npos) << other.err;
}

}  // namespace
}  // namespace slf

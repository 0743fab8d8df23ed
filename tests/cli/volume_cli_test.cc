// The options that name a volume and its transfer function, and `slf transfer`.
#include <gmock/gmock.h>

#include "tests/cli/cli_testing.h"
#include "tests/sanitized.h"
#include "tests/source/volume/samples.h"

namespace slf {
namespace {

using samples::Folder;
using samples::nifti;
using samples::Nifti;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
using testing::Outcome;
using testing::slf;

Nifti placed() {
  Nifti header{.type = ScalarType::i16, .sform = 1};
  header.srow = samples::phantom_srow();
  return header;
}

Outcome raycast(const std::string& volume, std::vector<std::string> more) {
  const Folder folder;
  std::vector<std::string> all{"raycast", volume, "-o", folder.path("a.png"), "--size", "16x16"};
  all.insert(all.end(), more.begin(), more.end());
  return slf(all);
}

TEST(VolumeCli, SaysWhatPlacedANiftiAndWhatIsOdd) {
  const Folder folder;
  const auto plain = slf({"info", folder.write("a.nii", nifti(placed()))});
  EXPECT_EQ(plain.exit_code, 0) << plain.err;
  EXPECT_THAT(plain.out, HasSubstr("placed  by sform (code 1)"));
  EXPECT_THAT(plain.out, Not(HasSubstr("note")));
  const auto odd = folder.write("b.nii", nifti({}));
  EXPECT_THAT(slf({"info", odd}).out, HasSubstr("left and right may be swapped"));
  EXPECT_EQ(slf({"info", odd, "--json"}).json()["notes"].size(), 1);
  EXPECT_THAT(raycast(odd, {}).err, HasSubstr("b.nii: it names no orientation"));
  EXPECT_THAT(raycast(odd, {"-q"}).err, Not(HasSubstr("orientation")));
}

TEST(VolumeCli, HintsAtLabels) {
  const Folder folder;
  // Two blocks of ids side by side.
  std::string voxels;
  for (int row = 0; row < 64; ++row) voxels += std::string(8, '\x05') + std::string(8, '\x60');
  const auto path = folder.write("ids.raw", voxels);
  const std::vector<std::string> layout{"--dims", "16x8x8"};
  auto info = std::vector<std::string>{"info", path};
  info.insert(info.end(), layout.begin(), layout.end());
  EXPECT_THAT(slf(info).out, HasSubstr("--labels"));
  EXPECT_THAT(raycast(path, layout).err, HasSubstr("--labels"));
  auto labels = layout;
  labels.emplace_back("--labels");
  EXPECT_THAT(raycast(path, labels).err, Not(HasSubstr("--labels")));
}

TEST(VolumeCli, TransferFunctionsByNameFileAndRange) {
  const Folder folder;
  const auto volume = folder.write("a.nii", nifti(placed()));
  const auto map =
      folder.write("maps.json", R"([{"Name": "One", "RGBPoints": [0, 0, 0, 1, 1, 1, 0, 0]},
                       {"Name": "Two", "RGBPoints": [0, 0, 1, 0, 1, 1, 1, 0]}])");
  for (const auto* name : {"mr-brain", "PET", "flame"})
    EXPECT_EQ(raycast(volume, {"--transfer", name}).exit_code, 0) << name;
  EXPECT_EQ(raycast(volume, {"--transfer", map + "#two"}).exit_code, 0);
  EXPECT_EQ(raycast(volume, {"--range", "1,60"}).exit_code, 0);
  EXPECT_EQ(raycast(volume, {"--transfer", "ct-bone", "--range", "1,60"}).exit_code, 0);
  const auto none = raycast(volume, {"--transfer", map + "#Three"});
  EXPECT_EQ(none.exit_code, 1);
  EXPECT_THAT(none.err, HasSubstr("no preset 'Three'; there are One, Two"));
  const auto unknown = raycast(volume, {"--transfer", "ct-brain"});
  EXPECT_EQ(unknown.exit_code, 1);
  EXPECT_THAT(unknown.err, HasSubstr("no built-in transfer function"));
  const auto far = raycast(volume, {"--transfer", "ct-bone"});  // all values are below bone
  EXPECT_EQ(far.exit_code, 4);
  EXPECT_THAT(far.err, HasSubstr("it runs from 150 to 3000: choose another, or stretch it to a "
                                 "range; see --transfer and --range"));
  for (const auto* range : {"5,5", "9,1", "0,inf"}) {
    const auto wrong = raycast(volume, {"--range", range});
    EXPECT_EQ(wrong.exit_code, 1) << range;
    EXPECT_THAT(wrong.err, HasSubstr("--range"));
  }
  for (const auto* range : {"5", "a,b"})
    EXPECT_EQ(raycast(volume, {"--range", range}).exit_code, 1) << range;
}

TEST(VolumeCli, ListsDrawsAndConvertsTransferFunctions) {
  const Folder folder;
  const auto list = slf({"transfer", "--list"});
  EXPECT_EQ(list.exit_code, 0);
  EXPECT_THAT(list.out, AllOf(HasSubstr("ct-bone "), HasSubstr("cryo-em "), HasSubstr("relative")));
  const auto json = slf({"transfer", "--list", "--json"}).json();
  ASSERT_TRUE(json.is_array());
  for (const auto& preset : json) {
    const auto name = preset["name"].get<std::string>();
    const auto drawn = slf({"transfer", name, "-o", folder.path(name + ".png")});
    EXPECT_EQ(drawn.exit_code, 0) << drawn.err;
    EXPECT_TRUE(std::filesystem::exists(folder.path(name + ".png")));
  }
  const auto converted = folder.path("bone.json");
  EXPECT_EQ(slf({"transfer", "ct-bone", "-o", converted}).exit_code, 0);
  EXPECT_THAT(slf({"transfer", converted}).out, HasSubstr("ct-bone"));
  const auto again = slf({"transfer", "ct-bone", "-o", converted});
  EXPECT_EQ(again.exit_code, 1);
  EXPECT_THAT(again.err, HasSubstr("exists; -f overwrites it"));
  EXPECT_EQ(slf({"transfer"}).exit_code, 1);
  EXPECT_EQ(slf({"transfer", folder.path("none.json")}).exit_code, 2);
}

TEST(VolumeCli, CropsAndChooses) {
  const Folder folder;
  const auto volume = folder.write("a.nii", nifti(placed()));
  const auto dims = [&](const std::string& crop) {
    return slf({"info", volume, "--crop", crop, "--json"}).json()["dims"];
  };
  EXPECT_EQ(dims("1:4,:,1:"), nlohmann::json({3, 4, 2}));
  EXPECT_EQ(dims(":,:,:"), nlohmann::json({5, 4, 3}));
  for (const auto* crop : {"1:4", "1:4,2,3", "a:b,:,:", "0:0,:,:", "-1:3,:,:"}) {
    const auto wrong = slf({"info", volume, "--crop", crop});
    EXPECT_EQ(wrong.exit_code, 1) << crop;
  }
  const auto series = folder.write("b.nii", nifti({.dim = {5, 4, 3, 2}}) + std::string(60, '\0'));
  const auto open = slf({"info", series});
  EXPECT_EQ(open.exit_code, 5);
  EXPECT_THAT(open.err, HasSubstr("2 time points, expected one: choose time point 0 to 1"));
  EXPECT_EQ(slf({"info", series, "--time", "1"}).exit_code, 0);
  EXPECT_EQ(slf({"info", series, "--time", "2"}).exit_code, 1);
}

/// Files that hostile bytes could take over are read in a process with limits, or not at all.
TEST(VolumeCli, SaysWhatAReaderWithoutLimitsLacks) {
  if (testing::kSanitized)
    GTEST_SKIP() << "the sanitizer needs /proc, also to read that it need not look for leaks";
  const std::string within = "unshare -rm sh -c 'mount -t tmpfs none /proc && \"$@\"' sh";
  if (std::system((within + " true 2>/dev/null").c_str()) != 0)
    GTEST_SKIP() << "nothing can be mounted here";
  const Folder folder;
  const std::string output = folder.path("a.png");
  const std::vector<std::string> arguments{
      "raycast", SLF_TEST_DATA "/../install/rle", "-o", output, "-f", "--size", "16x16"};
  EXPECT_OUTCOME(slf(arguments, within), 4, "mount /proc");
  EXPECT_OUTCOME(slf(arguments), 0, "");
}

}  // namespace
}  // namespace slf

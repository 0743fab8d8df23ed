// What is published tells nothing of whose data it is, nor of the machine: no folders, and nothing
// of a DICOM file but its voxels.
#include "slf/field.h"
#include "tests/cli/cli_testing.h"
#include "tests/source/volume/dicom_samples.h"
#include "tests/source/volume/samples.h"

namespace slf {
namespace {

using testing::read_text;
using testing::slf;
using testing::Workplace;

constexpr const char* kFolder = "Doe_Jane_19700101";

/// All that a published file says: its bytes, and, of a field, its manifest.
std::string told(const std::string& path) {
  const auto field = Field::open(path);
  return read_text(path) + (field ? field->manifest() : "");
}

void expect_done(const std::vector<std::string>& arguments) {
  const auto done = slf(arguments);
  EXPECT_EQ(done.exit_code, 0) << done.err;
}

/// Builds, and publishes in every way.
std::vector<std::string> publish(const Workplace& place, const std::string& input) {
  const std::string field = place / "out.slf", light = place / "light";
  const std::vector<std::string> shape{"--entry", "2", "--exit", "4", "--levels", "1"};
  const auto build = [&](const std::string& output, std::vector<std::string> more) {
    more.insert(more.begin(), {"build", input, "-o", output});
    more.insert(more.end(), shape.begin(), shape.end());
    expect_done(more);
  };
  build(field, {"--light-file", light});
  build(place / "direct.slf", {"--lighting", "direct"});
  expect_done({"repack", field, "-o", place / "repack.slf", "--codec", "zstd"});
  std::filesystem::create_directory(place / "site");
  expect_done({"export", field, "-o", place / "site"});
  expect_done({"export", place / "direct.slf", "-o", place / "direct.html"});
  std::ofstream(place / "states.json")
      << R"({"states": [{"name": "a"}, {"name": "b", "ambient": 0.5}]})";
  build(place / "states.slf", {"--lighting", "direct", "--states", place / "states.json"});
  std::vector<std::string> all{field,
                               light,
                               place / "direct.slf",
                               place / "repack.slf",
                               place / "states.slf",
                               place / "site/field.slf",
                               place / "site/index.html",
                               place / "direct.html"};
  for (const std::string& path : all) EXPECT_TRUE(std::filesystem::exists(path)) << path;
  return all;
}

TEST(Privacy, FieldsKeepTheNameOfTheirSourceAlone) {
  const Workplace place;
  std::filesystem::create_directory(place / kFolder);
  const std::string volume = place / (std::string(kFolder) + "/ct.nrrd");
  std::string bytes(64, '\0');
  for (std::size_t k = 21; k < 43; ++k) bytes[k] = '\x7f';
  testing::write_text(
      volume, samples::nrrd("type: uint8\ndimension: 3\nsizes: 4 4 4\nencoding: raw\n", bytes));
  for (const std::string& path : publish(place, volume)) {
    EXPECT_EQ(told(path).find(kFolder), std::string::npos) << path;
    EXPECT_EQ(told(path).find(place / ""), std::string::npos) << path;
  }
  EXPECT_NE(told(place / "out.slf").find("\"source\":\"ct.nrrd\""), std::string::npos);
  // The same build finds that nothing is left to do, from another folder, too.
  std::filesystem::rename(place / kFolder, place / "elsewhere");
  EXPECT_EQ(slf({"evaluate", place / "out.slf", "--volume", place / "elsewhere/ct.nrrd", "--views",
                 "1", "--size", "16", "--json"})
                .json()["same_source"],
            true);
}

TEST(Privacy, FieldsOfDicomKeepVoxelsAlone) {
  const Workplace place;
  const std::map<std::uint32_t, std::pair<std::string, std::string>> planted{
      {0x00080012, {"DA", "20190203"}},          {0x00080020, {"DA", "20190204"}},
      {0x00080021, {"DA", "20190205"}},          {0x00080050, {"SH", "ACC4711"}},
      {0x00080080, {"LO", "St Elsewhere"}},      {0x00080090, {"PN", "House^Gregory"}},
      {0x00081030, {"LO", "Planted study"}},     {0x0008103e, {"LO", "Planted series"}},
      {0x00081010, {"SH", "STATION9"}},          {0x00100010, {"PN", "Doe^Jane"}},
      {0x00100020, {"LO", "PID-12345"}},         {0x00100030, {"DA", "19700101"}},
      {0x00101040, {"LO", "12 Baker Street"}},   {0x00181000, {"LO", "SERIAL77"}},
      {0x0020000d, {"UI", "1.2.826.0.1.77777"}}, {0x0020000e, {"UI", "1.2.826.0.1.88888"}},
      {0x00200010, {"SH", "STUDY42"}},           {0x00204000, {"LT", "Planted comment"}},
      {0x00200052, {"UI", "1.2.826.0.1.99999"}}, {0x00104000, {"LT", "Planted remark"}}};
  // Folders and files of DICOM are often named after patients, and by UIDs.
  const std::string folder = place / kFolder;
  std::filesystem::create_directory(folder);
  for (int k = 0; k < 4; ++k) {
    auto elements = samples::small_slice(k);
    elements[0x00080018] = samples::text("UI", "1.2.826.0.1.5555" + std::to_string(k));
    for (const auto& [tag, value] : planted)
      elements[tag] = samples::text(value.first, value.second);
    testing::write_text(folder + "/1.2.826.0.1.5555" + std::to_string(k) + ".dcm",
                        samples::write_dicom(elements));
  }
  for (const std::string& input : {folder, folder + "/1.2.826.0.1.55550.dcm"}) {
    for (const std::string& path : publish(place, input)) {
      const std::string said = told(path);
      for (const auto& [tag, value] : planted)
        EXPECT_EQ(said.find(value.second), std::string::npos) << path << ": " << value.second;
      for (const char* const word : {"1.2.826", kFolder})
        EXPECT_EQ(said.find(word), std::string::npos) << path << ": " << word;
    }
    for (const char* const made :
         {"out.slf", "direct.slf", "repack.slf", "states.slf", "light", "direct.html"})
      std::filesystem::remove(place / made);
    std::filesystem::remove_all(place / "site");
  }
}

}  // namespace
}  // namespace slf

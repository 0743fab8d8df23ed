// Fields of this format version, kept for ever, and what `slf` says of them: if these tests fail,
// existing fields can no longer be read, or are read as something else. Bad ones too: what is
// refused today must be refused tomorrow, with the same exit code.
//
// "predictive" has tables of version 2, which no release writes any more. "states" and "kept_rays"
// are of a small volume, built by releases up to 0.3 and by later ones.
//
// To write others anew, only with a new format version:
//   SLF_WRITE_GOLDEN=1 cli_tests --gtest_filter='GoldenFields*'
#include <cmath>
#include <cstdlib>
#include <map>
#include <optional>

#include "codec/predictive_tables.h"
#include "field/field_file.h"
#include "field/write/field_writer.h"
#include "slf/image.h"
#include "slf/repack.h"
#include "slf/scene.h"
#include "storage/tile_writer.h"
#include "tests/cli/cli_testing.h"
#include "tests/field/field_testing.h"

namespace slf {
namespace {

using testing::read_text;
using testing::slf;
using testing::Workplace;
using testing::write_text;

std::string golden(const std::string& name) {
  return std::string(SLF_TEST_DATA) + "/golden/" + name;
}

/// `slf info --json` without what depends on where the file is.
nlohmann::json info_of(const std::string& path) { return slf({"info", path, "--json"}).json(); }

std::vector<std::string> view_of(const std::string& path, const std::string& picture) {
  const bool states = path.ends_with("states.slf") || path.ends_with("kept_rays.slf");
  return {"render",  path,       "-o", picture,   "--size",          "64",
          "--orbit", "315,35,3", "-f", "--state", states ? "2" : "0"};
}

struct Good {
  const char* name;
  double min_psnr;  ///< of the picture; JPEG decoders and float arithmetic may differ a little
};
constexpr Good kGood[] = {{"example", 50},    {"jpeg", 40},     {"zstd", 50},
                          {"half", 50},       {"deep", 50},     {"subfields", 50},
                          {"predictive", 50}, {"lossless", 50}, {"predicted_half", 50},
                          {"fitted", 50},     {"states", 50},   {"kept_rays", 50}};

struct Bad {
  const char* name;
  std::vector<std::string> command;
  int exit_code;
  const char* message;  ///< part of what stderr or, for verify, stdout says
};
const Bad kBad[] = {
    {"truncated", {"info"}, 3, "truncated.slf"},
    {"truncated", {"verify"}, 3, "S1 "},
    {"flipped_tile", {"info"}, 0, ""},
    {"flipped_tile", {"verify"}, 3, "T1 "},
    {"flipped_tile", {"verify", "--quick"}, 0, "all good"},
    {"newer_major", {"info"}, 5, "update slf"},
    {"newer_major", {"verify"}, 5, "update slf"},
    {"older_major", {"info"}, 5, "build it anew"},
    {"required_feature", {"info"}, 5, "hologram"},
    {"not_a_field", {"info"}, 3, "not_a_field.slf"},
    {"not_a_field", {"verify"}, 3, "M1 "},
    {"not_a_container", {"info"}, 3, "not_a_container.slf"},
    {"not_a_container", {"verify"}, 3, "S1 "},
    {"incomplete", {"info"}, 0, "incomplete"},
    {"incomplete", {"verify"}, 0, "C1 "},
};

// ---- writing them ----------------------------------------------------------------------------

BuildOptions options_for(const std::string& name) {
  auto options = testing::lossless_options(1, 3, 1);
  options.codec = name == "jpeg" ? "jpeg:80" : name == "example" ? "raw" : "zstd:9";
  options.depth = name != "example";
  options.half = name == "half" || name == "predicted_half";
  if (name == "deep") {
    options.shape.entry_side = 2, options.shape.entry_extra_levels = 1;
    options.shape.finest_level = 0;
  }
  if (name == "subfields" || name == "example")
    options.shape.entry_side = 4, options.shape.finest_level = 0;
  if (name == "example") options.shape.exit_side = 2;
  if (name == "predictive" || name == "fitted" || name == "lossless" || name == "predicted_half") {
    options.shape.entry_side = 2, options.shape.exit_side = 4;
    options.codec = name == "lossless" ? "predictive:lossless" : "predictive:80";
  }
  return options;
}

/// Begins a field like `like`, with a colour matrix as the tables of large fields have it.
void begin_fitted(const FieldFile& like, const std::string& path) {
  auto tables = codec::parse_predictive_tables(like.codec().tables());
  ASSERT_TRUE(tables);
  for (codec::PredictiveLevel& level : tables->levels)
    level.matrix = {239, -335, 148, 262, 26, -350, 265, 277, 212};
  const auto output = FieldOutput::at(path, Existing::keep, {});
  ASSERT_TRUE(output);
  auto writer =
      FieldWriter::create(*output, FieldWriter::Draft::discard, like.manifest(), to_bytes(*tables));
  ASSERT_TRUE(writer && writer->finish());
}

/// Builds a field and repacks it, so that it is as small as can be. A few subfields, entered from
/// one side, do where that is what is tested.
void write_good(const std::string& name) {
  if (name == "states" || name == "kept_rays") return;
  const Workplace place;
  const auto scene = make_analytic_scene("balls");
  auto field = testing::build_and_open(**scene, place / "built.slf", options_for(name));
  if (name == "fitted") {
    begin_fitted(field->file(), place / "fitted.slf");
    field = testing::build_and_open(**scene, place / "fitted.slf", options_for(name));
  }
  RepackOptions options;
  options.replace = true;
  if (name == "example") options.subfields = {28};
  if (name == "subfields") options.subfields = {24, 25, 26, 27, 28, 29, 30, 31};
  const auto done = repack_field(*field, golden(name + ".slf"), options);
  ASSERT_TRUE(done) << done.error().message;
  write_text(golden(name + ".json"), info_of(golden(name + ".slf")).dump(1) + "\n");
  ASSERT_EQ(slf(view_of(golden(name + ".slf"), golden(name + ".png"))).exit_code, 0);
}

/// A container with this manifest, if any, and no tiles.
void write_container(const std::string& path, const nlohmann::json& manifest) {
  std::filesystem::remove(path);
  std::vector<std::pair<std::string, Bytes>> blobs{{kTablesBlob, {}}};
  const std::string text = manifest.dump();
  const ByteSpan bytes = as_bytes(std::span<const char>(text));
  if (!manifest.is_null()) blobs.emplace_back(kManifestBlob, Bytes(bytes.begin(), bytes.end()));
  auto writer = storage::TileWriter::create(path, blobs);
  ASSERT_TRUE(writer);
  ASSERT_TRUE(writer->close());
}

void write_bad() {
  const std::string bytes = read_text(golden("example.slf"));
  write_text(golden("truncated.slf"), bytes.substr(0, bytes.size() / 2));
  write_text(golden("not_a_container.slf"), "Sphere light field? No: text.\n");
  const auto field = Field::open(golden("example.slf"));
  const auto tile = field->file().store().find({0, 28});
  ASSERT_EQ(tile->state, storage::TileState::stored);
  std::string flipped = bytes;
  flipped[field->file().store().range(*tile).begin + 5] ^= 1;
  write_text(golden("flipped_tile.slf"), flipped);
  nlohmann::json json = *field->file().manifest().to_json();
  write_container(golden("incomplete.slf"), json);
  write_container(golden("not_a_field.slf"), nullptr);
  json["required"] = {"hologram"};
  write_container(golden("required_feature.slf"), json);
  json["required"] = nlohmann::json::array();
  json["slf"]["major"] = 3;
  write_container(golden("newer_major.slf"), json);
  json["slf"]["major"] = 1;
  write_container(golden("older_major.slf"), json);
}

class GoldenFields : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    const char* const wanted = std::getenv("SLF_WRITE_GOLDEN");
    if (!wanted) return;
    std::filesystem::create_directories(golden(""));
    for (const auto& [name, min_psnr] : kGood)
      if (wanted == std::string("1") || wanted == std::string(name)) write_good(name);
    if (wanted == std::string("1")) write_bad();
  }
};

// ---- reading them ----------------------------------------------------------------------------

TEST_F(GoldenFields, GoodOnesAreReadAsEver) {
  const Workplace place;
  for (const auto& [name, min_psnr] : kGood) {
    SCOPED_TRACE(name);
    const std::string path = golden(std::string(name) + ".slf");
    const auto expected = nlohmann::json::parse(read_text(golden(std::string(name) + ".json")),
                                                nullptr, /*allow_exceptions=*/false);
    const auto info = info_of(path);
    for (const auto& [member, value] : expected.items())  // newer programs may say more
      EXPECT_EQ(info.value(member, nlohmann::json()), value) << member;
    EXPECT_EQ(slf({"verify", path}).exit_code, 0);
    ASSERT_EQ(slf(view_of(path, place / "o.png")).exit_code, 0);
    const auto drawn = read_image(place / "o.png");
    const auto picture = read_image(golden(std::string(name) + ".png"));
    ASSERT_TRUE(drawn && picture);
    EXPECT_GE(compare(*drawn, *picture).psnr, min_psnr);
    float max = 0;
    for (const glm::vec4& pixel : drawn->rgba) max = std::max({max, pixel.r, pixel.g, pixel.b});
    EXPECT_GT(max, 0.2f);  // there is something to see
  }
}

TEST_F(GoldenFields, BadOnesAreRefusedAsEver) {
  for (const Bad& bad : kBad) {
    auto arguments = bad.command;
    arguments.push_back(golden(std::string(bad.name) + ".slf"));
    const auto outcome = slf(arguments);
    SCOPED_TRACE(bad.name + (" " + bad.command[0]) + ": " + outcome.out + outcome.err);
    EXPECT_EQ(outcome.signal, 0);
    EXPECT_EQ(outcome.exit_code, bad.exit_code);
    EXPECT_NE((outcome.err + outcome.out).find(bad.message), std::string::npos);
  }
}

TEST_F(GoldenFields, EveryOneIsTested) {
  std::vector<std::string> tested, there;
  for (const Good& good : kGood) tested.push_back(good.name);
  for (const Bad& bad : kBad)
    if (tested.back() != bad.name) tested.push_back(bad.name);
  for (const auto& entry : std::filesystem::directory_iterator(golden("")))
    if (entry.path().extension() == ".slf") there.push_back(entry.path().stem());
  std::sort(tested.begin(), tested.end());
  std::sort(there.begin(), there.end());
  EXPECT_EQ(tested, there);
}

// ---- what doc/format/examples.md quotes of them ----------------------------------------------

/// The byte that a line of a dump ("7080: 7f78 6aff ...") shows at place k, if it shows one.
std::optional<unsigned> quoted(const std::string& line, std::size_t k) {
  const std::size_t at = 6 + k / 2 * 5 + k % 2 * 2;
  if (line.size() < at + 2 || line[at] == ' ') return {};
  return std::stoul(line.substr(at, 2), nullptr, 16);
}

TEST(Format, QuotesBytesThatAreInTheFiles) {
  const std::string root = std::string(SLF_TEST_DATA) + "/../../";
  std::istringstream text(read_text(root + "doc/format/examples.md"));
  std::map<std::string, int> checked;
  std::string name, file;
  bool dump = false;
  for (std::string line; std::getline(text, line);) {
    if (line.starts_with("```")) dump = !dump;
    if (!dump && line.starts_with("`tests/")) {
      name = line.substr(1, line.find('`', 1) - 1);
      file = read_text(root + name);
      ASSERT_FALSE(file.empty()) << name;
    }
    if (!dump || line.size() < 10 || line.find_first_not_of("0123456789abcdef") != 4 ||
        line[4] != ':')
      continue;
    const std::size_t offset = std::stoul(line.substr(0, 4), nullptr, 16);
    for (std::size_t k = 0; k < 16; ++k) {
      const auto byte = quoted(line, k);
      if (!byte) continue;
      ASSERT_LT(offset + k, file.size()) << line;
      EXPECT_EQ(static_cast<unsigned char>(file[offset + k]), *byte) << name << " " << line;
      ++checked[name];
    }
  }
  EXPECT_GT(checked["tests/data/golden/example.slf"], 300);
  EXPECT_GT(checked["tests/fuzz/corpus/store/tiny.slf"], 300);
}

TEST(Format, TheSlabOfItsExampleIsThatRay) {
  const auto scene = make_analytic_scene("balls");
  ASSERT_TRUE(scene);
  const RaySample sample =
      (*scene)->trace(glm::normalize(glm::dvec3(-3, -1, 0)), glm::normalize(glm::dvec3(0, 1, -1)));
  const double expected[] = {26, 52, 78, 255};
  for (int c = 0; c < 4; ++c) EXPECT_NEAR(sample.rgba[c] * 255, expected[c], 0.5001);
}

}  // namespace
}  // namespace slf

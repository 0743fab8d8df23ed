// Fields that declare far more tiles or states than they hold: what they take depends on what is
// stored.
#include <gtest/gtest.h>

#include <fstream>

#include "field/field_file.h"
#include "field/structure_looks.h"
#include "field/tiles/tile_cache.h"
#include "slf/inspect.h"
#include "slf/player.h"
#include "slf/repack.h"
#include "slf/verify.h"
#include "storage/tile_writer.h"
#include "tests/field/field_testing.h"
#include "tests/sanitized.h"

namespace slf {
namespace {

using testing::TemporaryFolder;

/// The most memory that the process had since reset_peak(), in MiB.
std::uint64_t peak_mib() {
  std::ifstream status("/proc/self/status");
  for (std::string word; status >> word;)
    if (word == "VmHWM:" && status >> word) return std::stoull(word) / 1024;
  return 0;
}
void reset_peak() { std::ofstream("/proc/self/clear_refs") << 5; }

class DeclaredLevels : public ::testing::Test {
 protected:
  DeclaredLevels() {
    const auto scene = std::move(*make_analytic_scene("balls"));
    const auto built =
        testing::build_and_open(*scene, folder_ / "few.slf", testing::lossless_options(4, 4, 1));
    few_ = built->content()->levels[1].tiles + built->content()->levels[0].tiles;
    nlohmann::json manifest = nlohmann::json::parse(built->manifest());
    manifest["levels"] = kLevels;
    path_ = folder_ / "declared.slf";
    std::filesystem::copy_file(built->path(), path_);
    auto writer = storage::TileWriter::resume(path_);
    const std::string text = manifest.dump();
    EXPECT_TRUE(writer && writer->set_blob(kManifestBlob, bytes_of(text)) && writer->commit());
    // And a tile of the finest level.
    EXPECT_TRUE(writer->append({kLevels, 1ull << 40}, Bytes(8)) && writer->close());
    field_ = Field::open(path_).value();
    reset_peak();
  }
  ~DeclaredLevels() override { EXPECT_LT(peak_mib(), before_ + 200); }

  static constexpr std::uint8_t kLevels = 10;
  TemporaryFolder folder_;
  const std::uint64_t before_ = (reset_peak(), peak_mib());
  std::string path_;
  std::uint64_t few_ = 0;
  std::optional<Field> field_;
};

TEST_F(DeclaredLevels, Diff) {
  const auto few = Field::open(folder_ / "few.slf");
  ASSERT_TRUE(few);
  const auto difference = diff_fields(*field_, *few, {});
  ASSERT_TRUE(difference) << difference.error().message;
  EXPECT_EQ(difference->channels[0].compared, few_);
  EXPECT_EQ(difference->channels[0].only_in_a, 1u);
  EXPECT_EQ(difference->channels[0].only_in_b, 0u);
  EXPECT_EQ(difference->channels[0].differing, 0u);
  const auto other_way = diff_fields(*few, *field_, {});
  ASSERT_TRUE(other_way);
  EXPECT_EQ(other_way->channels[0].only_in_b, 1u);
}

TEST_F(DeclaredLevels, Repack) {
  const auto report = repack_field(*field_, folder_ / "copy.slf", {});
  ASSERT_TRUE(report) << report.error().message;
  EXPECT_EQ(report->copied, few_ + 1);
  std::uint64_t declared = 0;
  for (unsigned level = 0; level <= kLevels; ++level) declared += field_->shape().tiles(level);
  EXPECT_EQ(report->missing, declared - few_ - 1);
  const auto copy = Field::open(folder_ / "copy.slf");
  ASSERT_TRUE(copy);
  EXPECT_EQ(testing::all_tiles(*copy), testing::all_tiles(*field_));
  const auto estimate = estimate_repack(*field_, {});
  ASSERT_TRUE(estimate) << estimate.error().message;
}

TEST_F(DeclaredLevels, Lists) {
  std::uint64_t listed = 0;
  const auto count = [&](const ListedTile&) -> Result<void> { return ++listed, Result<void>(); };
  ASSERT_TRUE(list_tiles(*field_, {}, count));
  EXPECT_EQ(listed, few_ + 1);
  TileFilter filter;
  filter.missing = true;
  const auto all = list_tiles(*field_, filter, count);
  ASSERT_FALSE(all);
  EXPECT_EQ(all.error().code, ErrorCode::usage);
  filter.last_level = 2;
  listed = 0;
  ASSERT_TRUE(list_tiles(*field_, filter, count));
  EXPECT_EQ(listed, few_ + field_->shape().tiles(2));
}

TEST_F(DeclaredLevels, Verify) {
  const std::string before = testing::read_text(path_);
  const auto decoded = verify_field(path_, {.fix = true});  // proves no damage, so drops no tile
  ASSERT_FALSE(decoded);
  EXPECT_EQ(decoded.error().code, ErrorCode::unsupported);
  EXPECT_TRUE(testing::read_text(path_) == before);
  const auto report = verify_field(path_, {.quick = true});
  ASSERT_TRUE(report) << report.error().message;
  EXPECT_FALSE(report->complete);
  EXPECT_EQ(report->tiles, few_ + 1);
}

TEST_F(DeclaredLevels, Views) {
  Renderer renderer(*field_, {.memory = 8 << 20, .threads = 1});
  const Camera camera = orbit_camera(field_->shape().sphere, 30, 20, 3, 64, 64);
  for (const unsigned level : {10u, 9u, 8u}) {
    const auto image = renderer.render(camera, {RenderMode::bitri, level});
    ASSERT_FALSE(image);
    EXPECT_EQ(image.error().code, ErrorCode::unsupported);
  }
  EXPECT_TRUE(renderer.render(camera, {RenderMode::bitri, 1}));
  EXPECT_TRUE(renderer.render(camera, {RenderMode::bitri, 3}));  // drawn from level 1
  const TileReader tiles(*field_, {.memory = 8 << 20});
  EXPECT_EQ(tiles.read({kLevels, 1ull << 40}).error().code, ErrorCode::unsupported);
}

// The states of a field share its manifest, its codec and its geometry.
TEST(DeclaredStates, Structures) {
  reset_peak();
  const std::uint64_t before = peak_mib();
  TemporaryFolder folder;
  auto options = testing::lossless_options(4, 4, 1);
  options.depth = true;
  const auto scene = std::move(*make_analytic_scene("balls"));
  const auto built = testing::build_and_open(*scene, folder / "a.slf", options);
  nlohmann::json manifest = nlohmann::json::parse(built->manifest());
  manifest["required"].push_back("states");
  manifest["provenance"]["structures"]["only"] = std::vector<int>(20000, 1);
  for (unsigned k = 0; k < kMaxStates; ++k)
    manifest["states"].push_back({{"name", "state " + std::to_string(k)}});
  const std::string text = manifest.dump();
  {
    auto writer = storage::TileWriter::resume(built->path());
    ASSERT_TRUE(writer && writer->set_blob(kManifestBlob, bytes_of(text)) && writer->close());
  }
  const auto field = Field::open(built->path());
  ASSERT_TRUE(field) << field.error().message;
  const auto all = all_structures(*field);
  ASSERT_TRUE(all) << all.error().message;
  ASSERT_EQ(all->structures()->size(), kMaxStates);
  EXPECT_EQ(nlohmann::json::parse(all->provenance())["structures"]["only"], std::vector{1});
  Renderer renderer(*all, {.memory = 64 << 20, .threads = 1});
  const Camera camera = orbit_camera(all->shape().sphere, 30, 20, 3, 32, 32);
  EXPECT_TRUE(renderer.render(camera, {RenderMode::bitri, 1}));
  EXPECT_TRUE(all->content());
  if (!testing::kSanitized) {  // which keeps what was freed
    EXPECT_LT(peak_mib(), before + 250);
  }
}

// A manifest is free text where it says what a field was built from.
TEST(DeclaredStates, ProvenanceOfAnyKind) {
  TemporaryFolder folder;
  auto options = testing::lossless_options(4, 4, 0);
  options.depth = true;
  const auto scene = std::move(*make_analytic_scene("balls"));
  const auto built = testing::build_and_open(*scene, folder / "a.slf", options);
  const std::string path = folder / "b.slf";
  const nlohmann::json only{{"structures", {{"only", {1, 2}}}}};
  const auto light = [](const nlohmann::json& linear, const nlohmann::json& mode) {
    return nlohmann::json{{"lighting", {{"linear", linear}, {"mode", mode}}}};
  };
  std::vector<nlohmann::json> kinds{nlohmann::json::object(), only, light(true, "global")};
  for (const nlohmann::json& wrong :
       std::vector<nlohmann::json>{nullptr, 1, "?", true, {1, "2"}, nlohmann::json::object()}) {
    kinds.push_back({{"structures", wrong}, {"lighting", wrong}, {"composed", wrong}});
    kinds.push_back({{"structures", {{"only", wrong}}}, {"lighting", {{"mode", wrong}}}});
    kinds.push_back(light(true, wrong));
    kinds.push_back(light(wrong, "global"));
  }
  for (const nlohmann::json& base : kinds)
    for (const nlohmann::json& other : kinds) {
      SCOPED_TRACE(base.dump() + " and " + other.dump());
      nlohmann::json manifest = nlohmann::json::parse(built->manifest());
      manifest["required"].push_back("states");
      manifest["provenance"] = base;
      manifest["states"] = {{{"name", "a"}}, {{"name", "b"}, {"provenance", other}}};
      const std::string text = manifest.dump();
      std::filesystem::copy_file(built->path(), path,
                                 std::filesystem::copy_options::overwrite_existing);
      {
        auto writer = storage::TileWriter::resume(path);
        ASSERT_TRUE(writer && writer->set_blob(kManifestBlob, bytes_of(text)) && writer->close());
      }
      const Field field = Field::open(path).value();
      for (const Field& shown : {field, field.in_state(1).value()}) {
        nlohmann::json whole = base;
        if (shown.state() == 1) whole.merge_patch(other);
        EXPECT_EQ(shown.provenance(), whole.dump());
        const nlohmann::json said = whole.value("lighting", nlohmann::json());
        EXPECT_EQ(shown.linear(), said == light(true, "global")["lighting"]);
      }
      const auto composed = compose(field, {{field.in_state(1).value()}});
      if (!composed) continue;  // one of the two is linear
      const auto told = nlohmann::json::parse(composed->provenance());
      EXPECT_TRUE(told.contains("composed") || told["structures"]["only"].is_array());
    }
}

}  // namespace
}  // namespace slf

// Fields whose tiles are predicted from coarser ones: built, resumed, drawn, repacked, damaged and
// repaired.
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <functional>
#include <set>

#include "field/field_file.h"
#include "slf/measure.h"
#include "slf/player.h"
#include "slf/repack.h"
#include "slf/verify.h"
#include "storage/tile_writer.h"
#include "tests/field/write/rewriting.h"
#include "tests/instruction_set.h"

namespace slf {
namespace {

using storage::TileState;
using testing::all_samples;
using testing::all_tiles;
using testing::build_and_open;
using testing::draw;
using testing::lossless_options;
using testing::TemporaryFolder;

/// Of all decoded samples of the golden fields, in key order.
constexpr std::pair<const char*, std::uint64_t> kGoldenHashes[] = {
    {"predictive", 5951815458954704591u}};

BuildOptions predictive_options(unsigned levels = 2, const std::string& codec = "predictive:90") {
  BuildOptions options = lossless_options(4, 8, levels);
  options.codec = codec;
  return options;
}

double psnr(const Image& a, const Image& b) {
  double sum = 0;
  for (std::size_t k = 0; k < a.pixels(); ++k)
    for (int c = 0; c < 3; ++c) sum += std::pow(a.rgba[k][c] - b.rgba[k][c], 2);
  return -10 * std::log10(sum / (3. * static_cast<double>(a.pixels())) + 1e-12);
}

Camera camera_of(const Field& field) {
  Camera camera;
  const Sphere& sphere = field.shape().sphere;
  camera.eye = sphere.center + sphere.radius * glm::dvec3(1.9, 1.3, 1.7);
  camera.look_at = sphere.center;
  camera.width = camera.height = 96;
  return camera;
}

class PredictiveField : public ::testing::Test {
 protected:
  std::optional<Field> build(const std::string& name, const BuildOptions& options) {
    return build_and_open(*scene, folder / name, options);
  }
  std::optional<Field> open(const std::string& name) {
    auto field = Field::open(folder / name);
    EXPECT_TRUE(field) << (field ? "" : field.error().message);
    if (!field) return {};
    return *field;
  }
  void drop(const std::string& name, TileKey key) {
    auto writer = storage::TileWriter::resume(folder / name);
    ASSERT_TRUE(writer) << writer.error().message;
    ASSERT_TRUE(writer->drop(key));
    ASSERT_TRUE(writer->close());
  }
  /// A tile of level 0 and one that is predicted from it.
  std::pair<TileKey, TileKey> reference_and_dependant(const Field& field) {
    for (std::uint64_t index = 0; index < tile_count(1, 0); ++index) {
      const auto tile = field.file().store().find({1, index});
      if (!tile || tile->state != TileState::stored) continue;
      const auto references = field.file().references(*tile);
      if (!references->empty()) return {references->front(), tile->key};
    }
    ADD_FAILURE() << "no tile has references";
    return {};
  }

  TemporaryFolder folder;
  std::unique_ptr<Scene> scene = std::move(*make_analytic_scene("balls"));
};

TEST_F(PredictiveField, LooksLikeTheScene) {
  const auto exact = build("exact.slf", lossless_options(4, 8, 2));
  const auto field = build("a.slf", predictive_options());
  ASSERT_TRUE(exact && field);
  EXPECT_TRUE(field->has_depth());
  EXPECT_TRUE(field->content()->complete);
  EXPECT_EQ(nlohmann::json::parse(field->manifest())["required"],
            nlohmann::json::array({"predictive"}));
  for (unsigned level = 0; level <= 2; ++level) {
    ViewOptions view;
    view.level = level;
    EXPECT_GT(psnr(draw(*field, camera_of(*field), view), draw(*exact, camera_of(*field), view)),
              30)
        << level;
  }
}

TEST_F(PredictiveField, TakesFewerBytesThanJpegAtTheSameQuality) {
  auto jpeg = predictive_options();
  jpeg.codec = "jpeg:90";
  const auto exact = build("exact.slf", lossless_options(4, 8, 2));
  const auto one = build("jpeg.slf", jpeg), two = build("predictive.slf", predictive_options());
  const auto error = [&](const Field& field) {
    return psnr(draw(field, camera_of(field), {}), draw(*exact, camera_of(field), {}));
  };
  EXPECT_GT(error(*two), error(*one) - 1);
  EXPECT_LT(two->content()->payload_bytes, 0.8 * one->content()->payload_bytes);
}

TEST_F(PredictiveField, BytesDoNotDependOnThreadsOrInterruptions) {
  const auto whole = build("whole.slf", predictive_options());
  auto options = predictive_options();
  options.threads = 1;
  const auto single = build("single.slf", options);
  ASSERT_TRUE(whole && single);
  EXPECT_EQ(all_tiles(*single), all_tiles(*whole));

  options.threads = 2;
  options.commit_seconds = 0;
  int stops = 0;
  for (std::uint64_t step = 50;; step = step * 3 / 2) {
    std::uint64_t tiles = 0;
    const auto report = build_field(*scene, folder / "parts.slf", options,
                                    [&](const Progress&) { return ++tiles < step; });
    if (report) break;
    ASSERT_EQ(report.error().code, ErrorCode::cancelled) << report.error().message;
    ++stops;
  }
  EXPECT_GT(stops, 3);
  EXPECT_EQ(all_tiles(*open("parts.slf")), all_tiles(*whole));
}

TEST_F(PredictiveField, CommitsLeaveFewFreePages) {
  auto options = predictive_options(1, "predictive:lossless");
  options.shape.exit_side = 48;
  options.commit_seconds = 0;
  const auto field = build("a.slf", options);
  ASSERT_TRUE(field);
  const auto content = field->content();
  ASSERT_TRUE(content);
  EXPECT_LT(static_cast<double>(content->file_bytes),
            1.1 * static_cast<double>(content->payload_bytes));
}

TEST_F(PredictiveField, AViewIsTheSameInAnyMemory) {
  const auto field = build("a.slf", predictive_options());
  const Image expected = draw(*field, camera_of(*field), {});
  for (const std::uint64_t memory : {1ull << 14, 1ull << 18, 1ull << 22}) {
    RendererOptions options;
    options.memory = memory;
    EXPECT_EQ(draw(*open("a.slf"), camera_of(*field), {}, options).rgba, expected.rgba) << memory;
  }
}

TEST_F(PredictiveField, ATileIsDecodedOnceForItselfAndForOthers) {
  const auto field = build("a.slf", predictive_options());
  ASSERT_TRUE(field);
  const FieldFile& file = field->file();
  const TileKey dependant = reference_and_dependant(*field).second;
  std::set<TileKey> keys;
  for (const auto& [key, tile] : file.find(std::span(&dependant, 1))) keys.insert(key);
  ASSERT_GT(keys.size(), 1u);
  TileCache cache(file, 64 << 20);
  std::uint64_t payloads = 0;
  for (int round = 0; round < 2; ++round)
    for (const TileKey key : keys) {  // coarse levels first
      const auto tile = file.store().find(key);
      ASSERT_TRUE(tile);
      if (tile->state != TileState::stored) continue;
      ASSERT_TRUE(cache.read(tile->key));
      payloads += round == 0 ? tile->payload.size() : 0;
    }
  EXPECT_EQ(cache.statistics().loaded_bytes, payloads);
}

TEST_F(PredictiveField, TheBytesOfAViewIncludeWhatItsTilesArePredictedFrom) {
  const auto field = build("a.slf", predictive_options());
  ASSERT_TRUE(field);
  ViewOptions view;
  view.level = 2;
  ViewStatistics statistics;
  draw(*field, camera_of(*field), view, {}, &statistics);
  std::set<TileKey> needed;
  std::uint64_t bytes = 0;
  const std::function<void(TileKey)> need = [&](TileKey key) {
    const auto tile = field->file().store().find(key);
    if (!tile || tile->state != TileState::stored || !needed.insert(key).second) return;
    bytes += tile->payload.size();
    const auto named = field->file().references(*tile);
    for (const TileKey reference : *named) need(reference);
  };
  for (const TileKey key : statistics.tiles) need(key);
  const auto file = footprint(*field, statistics.tiles);
  ASSERT_TRUE(file);
  EXPECT_EQ(file->compressed_bytes, bytes);
  EXPECT_LT(file->stored_tiles, needed.size());

  PlayOptions options;
  options.view = view;
  options.loading = Loading::wait;
  auto player = Player::make(*open("a.slf"), options);
  ASSERT_TRUE(player);
  Image image;
  FrameReport report;
  ASSERT_TRUE(player->draw(camera_of(*field), image, &report));
  EXPECT_EQ(report.load_bytes, bytes);
}

TEST_F(PredictiveField, WithoutAReferenceACoarserLevelIsDrawn) {
  const auto [reference, dependant] =
      reference_and_dependant(*build("a.slf", predictive_options(1)));
  drop("a.slf", reference);
  const auto field = open("a.slf");
  const auto decoded = TileCache(field->file(), 1 << 20).read(dependant);
  ASSERT_FALSE(decoded);
  EXPECT_EQ(decoded.error().code, ErrorCode::tile_missing);
  EXPECT_NE(decoded.error().message.find("tile 0/" + std::to_string(reference.index)),
            std::string::npos)
      << decoded.error().message;
  draw(*field, camera_of(*field), {});  // succeeds
}

TEST_F(PredictiveField, VerifyNamesWhatALostReferenceTakesAlongAndARebuildRestoresAll) {
  const auto before = all_tiles(*build("a.slf", predictive_options(1)));
  const auto reference = reference_and_dependant(*open("a.slf")).first;
  drop("a.slf", reference);
  VerifyOptions fix;
  fix.fix = true;
  const auto report = verify_field(folder / "a.slf", fix);
  ASSERT_TRUE(report);
  EXPECT_FALSE(report->complete);
  EXPECT_EQ(report->damaged, 0u);
  EXPECT_EQ(report->dropped, 0u);  // dependants are sound
  std::size_t dependants = 0;
  for (const Finding& finding : report->findings)
    dependants += finding.kind == FindingKind::reference ? 1 : 0;
  EXPECT_GT(dependants, 0u);
  EXPECT_EQ(report->findings.size(), dependants + 1);  // and that a tile is missing

  const auto again = build("a.slf", predictive_options(1));
  EXPECT_EQ(all_tiles(*again), before);
  EXPECT_TRUE(verify_field(folder / "a.slf", {})->complete);
}

TEST_F(PredictiveField, RepacksToOtherCodecsAndBack) {
  const auto field = build("a.slf", predictive_options());
  RepackOptions to_zstd;
  to_zstd.codec = "zstd:1";
  ASSERT_TRUE(repack_field(*field, folder / "zstd.slf", to_zstd));
  const auto plain = open("zstd.slf");
  EXPECT_EQ(nlohmann::json::parse(plain->manifest())["required"], nlohmann::json::array());
  EXPECT_EQ(all_samples(*plain), all_samples(*field));

  RepackOptions back;
  back.codec = "predictive:90";
  const auto report = repack_field(*plain, folder / "back.slf", back);
  ASSERT_TRUE(report) << report.error().message;
  EXPECT_GT(
      psnr(draw(*open("back.slf"), camera_of(*field), {}), draw(*field, camera_of(*field), {})),
      34);
  ASSERT_TRUE(repack_field(*plain, folder / "one.slf", [&] {
    RepackOptions one = back;
    one.threads = 1;
    return one;
  }()));
  EXPECT_EQ(all_tiles(*open("one.slf")), all_tiles(*open("back.slf")));
}

TEST_F(PredictiveField, AnEqualRepackAndFewerLevelsCopy) {
  const auto field = build("a.slf", predictive_options());
  const auto tiles = all_tiles(*field);
  const auto report = repack_field(*field, folder / "b.slf", {});
  ASSERT_TRUE(report);
  EXPECT_EQ(report->recoded, 0u);
  EXPECT_EQ(all_tiles(*open("b.slf")), tiles);

  RepackOptions fewer;
  fewer.finest_level = 1;
  EXPECT_EQ(repack_field(*field, folder / "c.slf", fewer)->recoded, 0u);
  for (const auto& [place, payload] : all_tiles(*open("c.slf")))
    EXPECT_EQ(payload, tiles.at(place));
  EXPECT_EQ(all_samples(*open("c.slf")).size(), 64u + 1024u);
}

TEST_F(PredictiveField, SubfieldsAreEncodedAnewAmongThemselves) {
  const auto field = build("a.slf", predictive_options());
  RepackOptions some;
  some.subfields = {3, 4, 28};
  const auto report = repack_field(*field, folder / "b.slf", some);
  ASSERT_TRUE(report) << report.error().message;
  EXPECT_EQ(report->copied, 0u);
  const auto part = open("b.slf");
  const auto before = all_samples(*field);
  double sum = 0, count = 0;
  for (const auto& [key, samples] : all_samples(*part)) {
    EXPECT_TRUE(part->shape().has(key));
    for (std::size_t k = 0; k < samples.size() / 5 * 4; ++k, ++count) {
      const double off = std::to_integer<int>(samples[k]) - std::to_integer<int>(before.at(key)[k]);
      sum += off * off;
    }
  }
  EXPECT_GT(10 * std::log10(255 * 255 * count / (sum + 1)), 32);
  EXPECT_TRUE(verify_field(folder / "b.slf", {})->findings.empty());
}

TEST_F(PredictiveField, GoldenSamplesAreTheSameOnEveryInstructionSet) {
  testing::with_each_instruction_set([&](const char* set) {
    for (const auto& [name, expected] : kGoldenHashes) {
      const auto field =
          Field::open(std::string(SLF_TEST_DATA) + "/golden/" + name + ".slf");  // nothing decoded
      ASSERT_TRUE(field) << field.error().message;
      std::uint64_t hash = 0xCBF29CE484222325u;  // FNV-1a
      for (const auto& [key, samples] : all_samples(*field))
        for (const std::byte byte : samples)
          hash = (hash ^ std::to_integer<std::uint64_t>(byte)) * 0x100000001B3u;
      EXPECT_EQ(hash, expected) << name << " " << set;
    }
  });
}

/// A tile's samples with the depths of what is not visible, which mean nothing, set to 0.
Bytes meaningful(Bytes samples, std::size_t color_bytes) {
  const std::size_t count = samples.size() / (color_bytes + 1);
  for (std::size_t s = 0; s < count; ++s) {
    const std::byte* const alpha = samples.data() + (s + 1) * color_bytes - color_bytes / 4;
    if (std::all_of(alpha, alpha + color_bytes / 4, [](std::byte b) { return b == std::byte{0}; }))
      samples[color_bytes * count + s] = std::byte{0};
  }
  return samples;
}

TEST_F(PredictiveField, LosslessHoldsWhatZstdHoldsInFewerBytes) {
  for (const bool half : {false, true}) {
    auto zstd = lossless_options(4, 8, 2);
    zstd.half = half;
    zstd.codec = "zstd";
    auto predicted = predictive_options(2, "predictive:lossless");
    predicted.half = half;
    const auto one = build("zstd.slf", zstd), two = build("lossless.slf", predicted);
    ASSERT_TRUE(one && two);
    const auto expected = all_samples(*one);
    for (const auto& [key, samples] : all_samples(*two))
      EXPECT_EQ(samples, meaningful(expected.at(key), half ? 8 : 4))
          << int{key.level} << "/" << key.index;
    // The last bits of half floats are noise, which nothing compresses.
    EXPECT_LT(two->content()->payload_bytes, (half ? 1 : 0.9) * one->content()->payload_bytes);
    EXPECT_EQ(draw(*one, camera_of(*one), {}).rgba, draw(*two, camera_of(*two), {}).rgba);

    RepackOptions back;
    back.codec = "predictive:lossless";
    ASSERT_TRUE(repack_field(*one, folder / "back.slf", back));
    EXPECT_EQ(all_tiles(*open("back.slf")), all_tiles(*two));
    for (const char* name : {"zstd.slf", "lossless.slf", "back.slf"})
      std::filesystem::remove(folder / name);
  }
}

TEST_F(PredictiveField, HoldsHalfFloats) {
  auto options = predictive_options();
  options.half = true;
  const auto field = build("half.slf", options);
  ASSERT_TRUE(field);
  auto exact = options;
  exact.codec = "predictive:lossless";
  const auto lossless = build("exact.slf", exact);
  ASSERT_TRUE(lossless);
  EXPECT_LT(field->content()->payload_bytes, 0.6 * lossless->content()->payload_bytes);
  EXPECT_GT(psnr(draw(*field, camera_of(*field), {}), draw(*lossless, camera_of(*field), {})), 36);

  // From half floats to bytes, and back.
  RepackOptions bytes;
  bytes.half = false;
  ASSERT_TRUE(repack_field(*field, folder / "bytes.slf", bytes));
  EXPECT_GT(
      psnr(draw(*open("bytes.slf"), camera_of(*field), {}), draw(*lossless, camera_of(*field), {})),
      32);
  RepackOptions halves;
  halves.half = true;
  ASSERT_TRUE(repack_field(*open("bytes.slf"), folder / "again.slf", halves));
  EXPECT_EQ(open("again.slf")->format(), SampleFormat::rgba16f_depth8);
}

TEST_F(PredictiveField, NeedsDepths) {
  auto options = predictive_options();
  options.depth = false;
  const auto report = build_field(*scene, folder / "a.slf", options);
  ASSERT_FALSE(report);
  EXPECT_EQ(report.error().code, ErrorCode::unsupported);
}

}  // namespace
}  // namespace slf

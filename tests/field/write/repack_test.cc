#include "slf/repack.h"

#include <gtest/gtest.h>

#include <cmath>

#include "field/field_file.h"
#include "field/write/train_codec.h"
#include "slf/render.h"
#include "slf/verify.h"
#include "storage/tile_writer.h"
#include "tests/field/write/rewriting.h"

namespace slf {
namespace {

using testing::all_colors;
using testing::all_samples;
using testing::all_tiles;
using testing::build_and_open;
using testing::lossless_options;
using testing::read_text;
using testing::stripes;
using testing::TemporaryFolder;
using testing::write_text;

/// Repacks, expects a sound and complete file, and opens it.
std::optional<Field> repack(const Field& field, const std::string& path,
                            const RepackOptions& options, RepackReport* report = nullptr) {
  const std::string before = read_text(field.path());
  const auto done = repack_field(field, path, options);
  EXPECT_TRUE(done) << (done ? "" : done.error().message);
  if (!done) return {};
  if (report) *report = *done;
  EXPECT_EQ(done->file_bytes, std::filesystem::file_size(path));
  EXPECT_TRUE(read_text(field.path()) == before) << "the input was touched";
  const auto verified = verify_field(path, {});
  EXPECT_TRUE(verified);
  for (const Finding& finding : verified->findings) ADD_FAILURE() << finding.message;
  EXPECT_EQ(verified->payload_bytes, done->payload_bytes);
  auto opened = Field::open(path);
  EXPECT_TRUE(opened) << (opened ? "" : opened.error().message);
  if (!opened) return {};
  return *opened;
}

std::optional<Field> repack(const Field& field, const std::string& path, const std::string& codec,
                            std::optional<bool> half = {}) {
  RepackOptions options;
  options.codec = codec;
  options.half = half;
  return repack(field, path, options);
}

ErrorCode refusal(const Field& field, const std::string& path, const RepackOptions& options,
                  const std::string& part) {
  const auto done = repack_field(field, path, options);
  EXPECT_FALSE(done) << part;
  if (done) return ErrorCode{};
  EXPECT_NE(done.error().message.find(part), std::string::npos) << done.error().message;
  return done.error().code;
}

class Repack : public ::testing::Test {
 protected:
  void SetUp() override {
    auto options = lossless_options(2, 5, 1);
    lossless_ = build_and_open(stripes(), folder_ / "in.slf", options);
    options.codec = "jpeg:75";
    jpeg_ = build_and_open(stripes(), folder_ / "jpeg.slf", options);
    ASSERT_TRUE(lossless_ && jpeg_);
  }
  TemporaryFolder folder_;
  std::optional<Field> lossless_, jpeg_;
};

TEST_F(Repack, HolesOfAnIncompleteFieldCanBeFilledAfterwards) {
  const auto options = lossless_options(2, 5, 1);
  const auto whole = all_tiles(*lossless_);
  {  // at the end of a level, in the middle of one, and at the end of the field
    auto writer = storage::TileWriter::resume(folder_ / "in.slf");
    ASSERT_TRUE(writer);
    for (const TileKey key : {TileKey{0, 62}, {0, 63}, {1, 100}, {1, 1022}, {1, 1023}})
      ASSERT_TRUE(writer->drop(key));
    ASSERT_TRUE(writer->close());
  }
  const auto holed = Field::open(folder_ / "in.slf");
  const auto done = repack_field(*holed, folder_ / "out.slf", {});
  ASSERT_TRUE(done) << done.error().message;
  EXPECT_EQ(done->missing, 5u);
  EXPECT_FALSE(Field::open(folder_ / "out.slf")->content()->complete);
  const auto filled = build_and_open(stripes(), folder_ / "out.slf", options);
  ASSERT_TRUE(filled);
  EXPECT_TRUE(filled->content()->complete);
  EXPECT_EQ(all_tiles(*filled), whole);
}

TEST_F(Repack, ItsSizeIsEstimatedWithinTheStatedError) {
  int k = 0;
  for (const char* codec : {"raw", "zstd:3", "jpeg:60", "predictive:80", ""}) {
    SCOPED_TRACE(codec);
    RepackOptions options;
    options.codec = codec;
    const auto estimate = estimate_repack(*lossless_, options);
    ASSERT_TRUE(estimate) << estimate.error().message;
    const auto done = repack_field(*lossless_, folder_ / (std::to_string(++k) + ".slf"), options);
    ASSERT_TRUE(done);
    const auto within = [](std::uint64_t found, std::uint64_t expected, std::uint64_t error) {
      return std::max(found, expected) - std::min(found, expected) <= error;
    };
    EXPECT_TRUE(
        within(done->payload_bytes, estimate->payload_bytes, estimate->payload_error_bytes * 3 / 2))
        << done->payload_bytes << " is not " << estimate->payload_bytes << " +- "
        << estimate->payload_error_bytes;
    EXPECT_TRUE(within(done->file_bytes, estimate->file_bytes, estimate->file_error_bytes))
        << done->file_bytes << " is not " << estimate->file_bytes << " +- "
        << estimate->file_error_bytes;
    EXPECT_EQ(estimate->payload_error_bytes == 0, std::string(codec).empty());
    EXPECT_LT(estimate->payload_error_bytes, estimate->payload_bytes / 5);
  }
}

/// Counts what is read of the tiles of a field.
class CountedTiles final : public TileSource {
 public:
  explicit CountedTiles(const Field& field) : state_{"", field} {}
  Result<void> tile(TileKey key, SourceTile& tile) const override {
    ++count;
    return tiles_.tile(key, tile);
  }
  mutable unsigned count = 0;

 private:
  StateSource state_;
  DecodedTiles tiles_{{&state_, 1}, state_.field.format(), 16 << 20};
};

TEST_F(Repack, NoTileIsReadForTablesThatDoNotDependOnTiles) {
  const auto reads = [&](const std::string& codec) {
    const FieldFile& field = lossless_->file();
    const CountedTiles tiles(*lossless_);
    Manifest manifest = field.manifest();
    manifest.codec = codec;
    const auto geometries = [&](unsigned level) -> const LevelGeometry& {
      return field.geometry(level);
    };
    EXPECT_TRUE(train_codec(tiles, geometries, manifest, 1, [] { return true; }));
    return tiles.count;
  };
  EXPECT_EQ(reads("raw"), 0u);
  EXPECT_EQ(reads("predictive:80"), 0u);
  EXPECT_GT(reads("jpeg:80"), 0u);
}

TEST_F(Repack, LosslessCodecsKeepEverySample) {
  int k = 0;
  for (const char* codec : {"raw", "zstd:3", "zstd:19"}) {
    const auto out = repack(*lossless_, folder_ / (std::to_string(++k) + ".slf"), codec);
    ASSERT_TRUE(out);
    EXPECT_EQ(out->file().manifest().codec, codec);
    EXPECT_EQ(all_samples(*out), all_samples(*lossless_));
    const auto back = repack(*out, folder_ / (std::to_string(++k) + ".slf"), "zstd:1");
    ASSERT_TRUE(back);
    EXPECT_EQ(all_tiles(*back), all_tiles(*lossless_));
    EXPECT_EQ(back->file().manifest().to_json(), lossless_->file().manifest().to_json());
  }
}

TEST_F(Repack, TheSameCodecCopiesPayloads) {
  RepackReport report;
  const auto out = repack(*jpeg_, folder_ / "out.slf", RepackOptions{}, &report);
  ASSERT_TRUE(out);
  EXPECT_EQ(all_tiles(*out), all_tiles(*jpeg_));
  EXPECT_EQ(report.copied, report.tiles);
  EXPECT_EQ(report.tiles, 64u + 1024);
  EXPECT_EQ(report.recoded + report.missing, 0u);
  // The decoder's tables came along: samples, not only payloads, are the same.
  EXPECT_EQ(all_samples(*out), all_samples(*jpeg_));
}

TEST_F(Repack, AHigherQualityIsCloserToTheSource) {
  const auto truth = all_colors(*lossless_);
  double last = 1e9;
  for (const char* codec : {"jpeg:20", "jpeg:60", "jpeg:95:444"}) {
    const auto out = repack(*lossless_, folder_ / (std::string(codec) + ".slf"), codec);
    ASSERT_TRUE(out);
    double error = 0;
    for (const auto& [key, samples] : all_colors(*out)) {
      const Bytes& expected = truth.at(key);
      ASSERT_EQ(samples.size(), expected.size());
      for (std::size_t k = 0; k < samples.size(); ++k)
        error += std::abs(std::to_integer<int>(samples[k]) - std::to_integer<int>(expected[k]));
    }
    EXPECT_GT(error, 0);
    EXPECT_LT(error, 0.7 * last) << codec;
    last = error;
  }
}

TEST_F(Repack, DepthLevelsAndSubfieldsCanBeLeftOut) {
  RepackOptions options;
  options.depth = false;
  options.finest_level = 0;
  options.subfields = {3, 7, 63};
  const auto out = repack(*lossless_, folder_ / "out.slf", options);
  ASSERT_TRUE(out);
  EXPECT_FALSE(out->has_depth());
  EXPECT_EQ(out->shape().finest_level, 0u);
  EXPECT_EQ(out->shape().subfields, options.subfields);
  EXPECT_TRUE(out->content()->complete);
  const auto source = all_colors(*lossless_), kept = all_samples(*out);
  EXPECT_EQ(kept.size(), 3u);
  for (const auto& [key, samples] : kept) EXPECT_EQ(samples, source.at(key)) << key.index;
}

TEST_F(Repack, SubfieldsAreKeptAtEveryEntryDepthAndOfWhatIsThere) {
  auto build = lossless_options(4, 3, 1);
  build.shape.entry_extra_levels = 1;
  const auto deep = build_and_open(stripes(), folder_ / "deep.slf", build);
  RepackOptions options;
  options.subfields = {5, 60};
  const auto two = repack(*deep, folder_ / "two.slf", options);
  ASSERT_TRUE(two);
  EXPECT_EQ(all_samples(*two).size(), 2u * (4 + 64));
  const auto source = all_samples(*deep);
  for (const auto& [key, samples] : all_samples(*two))
    EXPECT_EQ(samples, source.at(key)) << int{key.level} << "/" << key.index;
  options.subfields = {60};
  const auto one = repack(*two, folder_ / "one.slf", options);
  ASSERT_TRUE(one);
  EXPECT_EQ(all_samples(*one).size(), 68u);
  options.subfields = {6};
  EXPECT_EQ(refusal(*two, folder_ / "x.slf", options, "no subfield 6"), ErrorCode::usage);
}

TEST_F(Repack, ASubfieldRendersAsInTheWholeAndTheRestIsTransparent) {
  RepackOptions options;
  options.subfields = {7};  // enters where all coordinates are positive, leaves opposite
  const auto part = repack(*lossless_, folder_ / "part.slf", options);
  ASSERT_TRUE(part);
  Camera camera;
  camera.eye = {3, 3, 3};
  camera.up = {0, 0, 1};
  camera.width = camera.height = 48;
  ViewOptions view;
  view.mode = RenderMode::nearest;
  view.level = 1;
  Renderer whole_renderer(*lossless_), part_renderer(*part);
  const auto whole = whole_renderer.render(camera, view), kept = part_renderer.render(camera, view);
  ASSERT_TRUE(whole && kept);
  std::size_t equal = 0, clear = 0;
  for (std::size_t k = 0; k < kept->rgba.size(); ++k) {
    if (kept->rgba[k].a == 0)
      ++clear;
    else if (kept->rgba[k] == whole->rgba[k])
      ++equal;
  }
  EXPECT_EQ(equal + clear, kept->rgba.size());
  EXPECT_GT(equal, 100u);
  camera.eye = {-3, -3, -3};  // the opposite way: nothing was kept
  const auto behind = part_renderer.render(camera, view);
  ASSERT_TRUE(behind) << behind.error().message;
  for (const auto& pixel : behind->rgba) ASSERT_EQ(pixel.a, 0);
}

TEST_F(Repack, EightBitsGoToHalfFloatsAndBackExactly) {
  const auto half = repack(*lossless_, folder_ / "half.slf", "zstd:1", true);
  ASSERT_TRUE(half);
  EXPECT_EQ(half->format(), SampleFormat::rgba16f_depth8);
  const auto back = repack(*half, folder_ / "back.slf", "zstd:1", false);
  ASSERT_TRUE(back);
  EXPECT_EQ(all_tiles(*back), all_tiles(*lossless_));
}

TEST_F(Repack, HalfFloatsOfAJpegFieldGoToZstdUnlessJpegIsAskedFor) {
  const auto half = repack(*jpeg_, folder_ / "half.slf", "", true);
  ASSERT_TRUE(half);
  EXPECT_TRUE(half->codec().starts_with("zstd"));
  RepackOptions options;
  options.half = true;
  options.codec = "jpeg:90";
  EXPECT_EQ(refusal(*jpeg_, folder_ / "x.slf", options, "half"), ErrorCode::unsupported);
}

TEST_F(Repack, BrightHalfFloatsAreClampedToEightBits) {
  auto build = lossless_options(2, 3, 0);
  build.half = true;
  const auto bright = build_and_open(stripes(40), folder_ / "bright.slf", build);
  const auto copy = repack(*bright, folder_ / "copy.slf", "raw", true);
  ASSERT_TRUE(copy);
  EXPECT_EQ(all_samples(*copy), all_samples(*bright));
  const auto flat = repack(*bright, folder_ / "flat.slf", "", false);
  ASSERT_TRUE(flat);
  build.half = false;
  const auto built = build_and_open(stripes(40), folder_ / "built.slf", build);
  const auto expected = all_colors(*built);
  std::size_t clamped = 0;
  for (const auto& [key, samples] : all_colors(*flat))
    for (std::size_t k = 0; k < samples.size(); ++k) {
      // Half floats have 11 bits: rounding them may fall on the other side.
      EXPECT_NEAR(std::to_integer<int>(samples[k]), std::to_integer<int>(expected.at(key)[k]), 1);
      clamped += k % 4 == 0 && samples[k] > std::byte{0} && samples[k] == samples[k + 3];
    }
  EXPECT_GT(clamped, 100u);
}

TEST_F(Repack, TheFileIsTheSameForAnyNumberOfThreads) {
  RepackOptions options;
  options.codec = "jpeg:60";
  options.threads = 1;
  ASSERT_TRUE(repack(*lossless_, folder_ / "1.slf", options));
  for (const unsigned threads : {2u, 7u}) {
    options.threads = threads;
    ASSERT_TRUE(repack(*lossless_, folder_ / "n.slf", options));
    EXPECT_TRUE(read_text(folder_ / "1.slf") == read_text(folder_ / "n.slf")) << threads;
    std::filesystem::remove(folder_ / "n.slf");
  }
  options.memory = 1;
  const auto refused = repack_field(*lossless_, folder_ / "n.slf", options);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::usage);
  const std::string& message = refused.error().message;
  const auto at = message.find("at least ");
  ASSERT_NE(at, std::string::npos) << message;
  options.memory = std::stoull(message.substr(at + 9)) << 10;  // one tile at a time
  ASSERT_TRUE(repack(*lossless_, folder_ / "n.slf", options));
  const auto a = Field::open(folder_ / "1.slf"), b = Field::open(folder_ / "n.slf");
  EXPECT_EQ(all_tiles(*a), all_tiles(*b));
}

TEST_F(Repack, WhatWasNeverBuiltStaysMissing) {
  const std::string path = folder_ / "half-done.slf";
  std::uint64_t calls = 0;
  ASSERT_FALSE(build_field(stripes(), path, lossless_options(2, 5, 1),
                           [&](const Progress&) { return ++calls < 500; }));
  {
    auto writer = storage::TileWriter::resume(path + ".unfinished");  // and a hole
    ASSERT_TRUE(writer);
    ASSERT_TRUE(writer->drop({0, 20}));
    ASSERT_TRUE(writer->close());
  }
  const auto partial = Field::open(path + ".unfinished");
  ASSERT_TRUE(partial);
  RepackOptions options;
  options.codec = "raw";
  const auto done = repack_field(*partial, folder_ / "out.slf", options);
  ASSERT_TRUE(done) << done.error().message;
  EXPECT_GT(done->missing, 1u);
  EXPECT_EQ(done->missing + done->tiles, 64u + 1024);
  const auto out = Field::open(folder_ / "out.slf");
  ASSERT_TRUE(out);
  EXPECT_FALSE(out->content()->complete);
  EXPECT_EQ(all_samples(*out), all_samples(*partial));
  EXPECT_EQ(out->file().store().find({0, 20})->state, storage::TileState::missing);
}

TEST_F(Repack, ADamagedTileIsNamedAndNothingIsLeft) {
  const TileKey key{1, 500};
  std::string bytes = read_text(lossless_->path());
  const auto tile = lossless_->file().store().find(key);
  ASSERT_EQ(tile->state, storage::TileState::stored);
  bytes[lossless_->file().store().range(*tile).begin] ^= 1;
  write_text(folder_ / "damaged.slf", bytes);
  const auto damaged = Field::open(folder_ / "damaged.slf");
  ASSERT_TRUE(damaged);
  const auto before = folder_.files();
  RepackOptions options;
  EXPECT_EQ(refusal(*damaged, folder_ / "out.slf", options, "1/500"), ErrorCode::bad_file);
  options.codec = "raw";
  EXPECT_EQ(refusal(*damaged, folder_ / "out.slf", options, "1/500"), ErrorCode::bad_file);
  EXPECT_EQ(folder_.files(), before);
}

TEST_F(Repack, NonsenseIsRefused) {
  const auto before = folder_.files();
  const std::string out = folder_ / "out.slf";
  RepackOptions options;
  options.finest_level = 2;
  EXPECT_EQ(refusal(*lossless_, out, options, "levels 0 to 1"), ErrorCode::usage);
  options = {};
  options.codec = "predictive:90";
  options.depth = false;
  EXPECT_EQ(refusal(*lossless_, out, options, "needs depths"), ErrorCode::unsupported);
  options = {};
  options.codec = "gif";
  EXPECT_EQ(refusal(*lossless_, out, options, "gif"), ErrorCode::usage);
  for (const std::vector<std::uint8_t>& wrong :
       std::vector<std::vector<std::uint8_t>>{{64}, {2, 1}, {1, 1}}) {
    options = {};
    options.subfields = wrong;
    EXPECT_EQ(refusal(*lossless_, out, options, "subfield"), ErrorCode::usage);
  }
  EXPECT_EQ(refusal(*lossless_, jpeg_->path(), {}, "exists"), ErrorCode::usage);
  options = {};
  options.replace = true;
  EXPECT_EQ(refusal(*lossless_, lossless_->path(), options, "is the input"), ErrorCode::usage);
  EXPECT_EQ(refusal(*lossless_, folder_ / "", options, "folder"), ErrorCode::usage);
  EXPECT_EQ(refusal(*lossless_, folder_ / "no/such.slf", {}, "no/such.slf"), ErrorCode::not_found);
  EXPECT_EQ(folder_.files(), before);
}

TEST_F(Repack, StoppedItLeavesWhatWasThereBefore) {
  write_text(folder_ / "out.slf", "precious");
  RepackOptions options;
  options.replace = true;
  const auto before = folder_.files();
  for (std::uint64_t limit = 1; limit < 1088; limit += 271) {
    std::uint64_t calls = 0;
    const auto stopped = repack_field(*lossless_, folder_ / "out.slf", options,
                                      [&](const Progress&) { return ++calls < limit; });
    ASSERT_FALSE(stopped);
    EXPECT_EQ(stopped.error().code, ErrorCode::cancelled);
    EXPECT_EQ(folder_.files(), before);
    EXPECT_EQ(read_text(folder_ / "out.slf"), "precious");
  }
  EXPECT_TRUE(repack(*lossless_, folder_ / "out.slf", options));
  EXPECT_EQ(folder_.files(), before);
}

TEST_F(Repack, WhatAKilledRunLeftGoesWithTheNext) {
  const std::string out = folder_ / "out.slf";
  const auto leave_draft = [&] {
    std::filesystem::copy(jpeg_->path(), out + ".repacking");
    auto writer = storage::TileWriter::resume(out + ".repacking");
    ASSERT_TRUE(writer && writer->drop({1, 1023}));
    ASSERT_TRUE(writer->close());
  };
  leave_draft();
  ASSERT_TRUE(repack(*lossless_, out, RepackOptions{}));
  EXPECT_EQ(folder_.files(), (std::vector<std::string>{"in.slf", "jpeg.slf", "out.slf"}));
  // But not what is no draft, nor what somebody is writing right now.
  std::filesystem::remove(out);
  write_text(out + ".repacking", "a diary");
  EXPECT_EQ(refusal(*lossless_, out, {}, "remove it"), ErrorCode::bad_file);
  EXPECT_EQ(read_text(out + ".repacking"), "a diary");
  std::filesystem::remove(out + ".repacking");
  std::filesystem::copy(jpeg_->path(), out + ".repacking");
  EXPECT_EQ(refusal(*lossless_, out, {}, "is a complete field"), ErrorCode::usage);
  std::filesystem::remove(out + ".repacking");
  leave_draft();
  const auto other = storage::TileWriter::resume(out + ".repacking");
  ASSERT_TRUE(other);
  EXPECT_EQ(refusal(*lossless_, out, {}, "another process"), ErrorCode::busy);
  EXPECT_TRUE(std::filesystem::exists(out + ".repacking"));
}

}  // namespace
}  // namespace slf

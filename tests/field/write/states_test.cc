// Fields of several states: what is stored once, and that each state is a field of its own.
#include <gmock/gmock.h>

#include <nlohmann/json.hpp>

#include "base/varint.h"
#include "field/field_file.h"
#include "slf/build.h"
#include "slf/inspect.h"
#include "slf/merge.h"
#include "slf/render.h"
#include "slf/repack.h"
#include "slf/verify.h"
#include "storage/tile_writer.h"
#include "tests/field/field_testing.h"

namespace slf {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;
using testing::read_text;
using testing::TemporaryFolder;

/// A ball, of which planes leave a part; or another colour of it.
class Ball final : public Scene {
 public:
  explicit Ball(double top, float red = 1) : top_(top), red_(red) {}
  [[nodiscard]] Sphere bounds() const override { return {glm::dvec3(0), 1}; }
  [[nodiscard]] RaySample trace(const glm::dvec3& from, const glm::dvec3& to) const override {
    const auto hit = intersect({glm::dvec3(0), 0.6}, from, to - from);
    if (!hit.hit) return {};
    const glm::dvec3 at = from + hit.enter * (to - from);
    if (at.z > top_) return {};
    return {{red_ * (0.5 + at.x / 2), 0.5 + at.y / 2, 0.5, 1}, static_cast<float>(hit.enter)};
  }
  [[nodiscard]] std::string provenance() const override {
    return "{\"kind\":\"ball\",\"top\":" + std::to_string(top_) +
           (red_ == 1 ? "" : ",\"red\":" + std::to_string(red_)) + "}";
  }

 private:
  double top_;
  float red_;
};

class States : public ::testing::TestWithParam<const char*> {
 protected:
  BuildOptions options() const {
    BuildOptions options;
    options.shape.entry_side = 2;
    options.shape.exit_side = 4;
    options.shape.finest_level = levels_;
    options.codec = GetParam();
    return options;
  }
  [[nodiscard]] bool predicts() const { return options().codec.starts_with("predictive"); }
  std::string path(const std::string& name) const { return folder_ / name; }
  std::string build_all(const std::string& name = "all.slf") const {
    const auto report = build_field(states_, path(name), options());
    EXPECT_TRUE(report) << report.error().message;
    return path(name);
  }
  static Image view(const Field& field) {
    Camera camera;
    camera.eye = {1.2, -2.5, 1.4};
    camera.width = camera.height = 48;
    auto image = Renderer(field).render(camera, {});
    EXPECT_TRUE(image) << image.error().message;
    return std::move(*image);
  }

  /// Builds a part, and returns its path.
  std::string part(const std::string& name, const ShardOptions& shard) const {
    BuildOptions some = options();
    some.shard = shard;
    const auto report = build_field(states_, path(name), some);
    EXPECT_TRUE(report) << report.error().message;
    const auto verified = verify_field(path(name), {});
    EXPECT_TRUE(verified && verified->found == 0 && verified->complete) << name;
    return path(name);
  }
  std::string shard(std::uint32_t k, std::uint32_t n, const std::string& coarser = "") const {
    return part(std::to_string(k) + "-of-" + std::to_string(n), {k, n, {}, {}, coarser});
  }
  std::string levels(unsigned first, unsigned last, const std::string& name) const {
    return part(name, {1, 1, first, last, {}});
  }
  /// The bytes of the merged parts.
  std::string merge(const std::vector<std::string>& parts) const {
    MergeOptions options;
    options.replace = true;
    const auto merged = merge_fields(parts, path("merged.slf"), options);
    EXPECT_TRUE(merged) << merged.error().message;
    const auto verified = verify_field(path("merged.slf"), {});
    EXPECT_TRUE(verified && verified->found == 0 && verified->complete);
    return read_text(path("merged.slf"));
  }
  void expect_refused(const std::vector<std::string>& parts, const std::string& says,
                      ErrorCode code = ErrorCode::usage) const {
    const auto merged = merge_fields(parts, path("refused.slf"), {});
    ASSERT_FALSE(merged) << says;
    EXPECT_EQ(merged.error().code, code);
    EXPECT_THAT(merged.error().message, HasSubstr(says));
  }

  unsigned levels_ = 1;
  TemporaryFolder folder_;
  Ball whole_{1}, cut_{0.3}, deep_{-0.2}, again_{0.3}, red_{0.3, 0.5f};
  std::vector<FieldState> states_{
      {"whole", &whole_}, {"cut", &cut_}, {"deep", &deep_}, {"again", &again_}, {"red", &red_}};
};

TEST_P(States, ShowWhatFieldsOfTheirOwnShow) {
  const auto field = Field::open(build_all());
  ASSERT_TRUE(field) << field.error().message;
  EXPECT_EQ(field->states().size(), states_.size());
  const bool lossless = std::string_view(GetParam()).find("lossless") != std::string_view::npos ||
                        std::string_view(GetParam()) == "zstd:3";
  for (unsigned s = 0; s < states_.size(); ++s) {
    const auto state = field->in_state(s);
    ASSERT_TRUE(state) << state.error().message;
    EXPECT_EQ(state->provenance(), nlohmann::json::parse(states_[s].scene->provenance()).dump());
    const auto built = build_field(*states_[s].scene, path("one.slf"), [&] {
      BuildOptions own = options();
      own.replace = true;
      return own;
    }());
    ASSERT_TRUE(built) << built.error().message;
    const auto own = Field::open(path("one.slf"));
    ASSERT_TRUE(own);
    const Image a = view(*state), b = view(*own);
    double worst = 0;
    for (std::size_t k = 0; k < a.rgba.size(); ++k)
      worst = std::max(worst, double{glm::distance(a.rgba[k], b.rgba[k])});
    EXPECT_LE(worst, lossless || s == 0 ? 0 : 0.2) << s;
    const auto content = state->content();
    ASSERT_TRUE(content);
    EXPECT_TRUE(content->complete);
    for (const LevelContent& level : content->levels)
      EXPECT_EQ(level.same > 0, s == 1 || s == 2 || s == 3) << s << " at " << level.level;
    // All that "again" shows is in "cut".
    EXPECT_EQ(content->payload_bytes == 0, s == 3) << s;
  }
  const auto verified = verify_field(path("all.slf"), {});
  ASSERT_TRUE(verified) << verified.error().message;
  EXPECT_TRUE(verified->complete);
  EXPECT_EQ(verified->found, 0u);
}

// A cut changes a ball's tiles in part, and another colour changes none of its edges.
TEST_P(States, TilesArePredictedFromThoseOfOtherStates) {
  const auto field = FieldFile::open(build_all());
  ASSERT_TRUE(field);
  if (!(*field)->predicts()) return;
  std::map<std::uint64_t, std::uint64_t> predicted, stored;
  const auto count = [&](const storage::TileRef& tile) -> Result<void> {
    if (tile.state != TileState::stored) return {};
    ++stored[tile.key.state];
    const auto references = (*field)->references(tile);
    EXPECT_TRUE(references) << references.error().message;
    for (const TileKey reference : *references)
      if (reference.level == tile.key.level) {
        ++predicted[tile.key.state];
        EXPECT_LE((*field)->chain(tile).value_or(99), kMaxChain);
        EXPECT_LT(reference.state, tile.key.state);
        EXPECT_EQ(in_state(reference, 0), in_state(tile.key, 0));
      } else {
        EXPECT_EQ(reference.state, tile.key.state);
      }
    return {};
  };
  ASSERT_TRUE((*field)->store().visit({0, 0}, {255, 0}, count));
  EXPECT_EQ(predicted[0], 0u);
  EXPECT_GT(predicted[1], stored[1] / 4);
  EXPECT_GT(predicted[4], stored[4] / 4);
}

/// With another number in the place of the one that names the state.
Bytes with_head(ByteSpan payload, std::uint64_t head) {
  Bytes changed;
  append_varint(changed, head);
  (void)take_varint(payload);
  changed.insert(changed.end(), payload.begin(), payload.end());
  return changed;
}

TEST_P(States, HeadsThatNameNoStateAreRefused) {
  const auto field = FieldFile::open(build_all());
  ASSERT_TRUE(field);
  if (!(*field)->predicts()) return;
  const bool by_sample = options().codec.ends_with("lossless");
  std::size_t keep_rays = 0;
  const auto check = [&](const storage::TileRef& tile) -> Result<void> {
    if (tile.state != TileState::stored) return {};
    ByteSpan rest = tile.payload;
    const auto head = take_varint(rest);
    if (head && *head > kMaxStates) ++keep_rays;
    const TileCoder& coder = (*field)->coder();
    Bytes samples(coder.tile_shape(tile.key).bytes());
    for (const std::uint64_t bad : {kMaxStates + 0ull, 2 * kMaxStates + 1ull})
      EXPECT_FALSE(coder.decode(tile.key, with_head(tile.payload, bad), {}, samples)) << bad;
    const Bytes other = with_head(tile.payload, kMaxStates + 1ull);
    const auto named = coder.references(tile.key, other);
    const bool earlier = std::any_of(named.begin(), named.end(),
                                     [&](TileKey one) { return one.level == tile.key.level; });
    EXPECT_EQ(earlier, !by_sample);
    EXPECT_FALSE(coder.decode(tile.key, other, {}, samples));  // without that tile
    return {};
  };
  ASSERT_TRUE((*field)->store().visit({0, 0}, {255, 0}, check));
  EXPECT_EQ(keep_rays > 0, !by_sample);
}

TEST_P(States, DamageSpreadsToWhatIsPredictedFromIt) {
  const std::string file = build_all();
  const auto depends = [&](const FieldFile& field, TileKey on) {
    std::set<TileKey> found{on};
    const auto visit = [&](const storage::TileRef& tile) -> Result<void> {
      bool uses = tile.state == TileState::same && tile.source == on;
      const auto references = field.references(tile);
      for (const TileKey reference : *references) uses |= found.contains(reference);
      if (uses) found.insert(tile.key);
      return {};
    };
    EXPECT_TRUE(field.store().visit({0, 0}, {255, 0}, visit));
    return found.size();
  };
  TileKey lost;
  std::size_t expected = 0;
  {
    const auto field = FieldFile::open(file);
    ASSERT_TRUE(field);
    const auto find = [&](const storage::TileRef& tile) -> Result<void> {
      if (tile.state == TileState::stored && tile.key.level == 1 && tile.key.state == 0)
        if (const std::size_t count = depends(**field, tile.key); count > expected)
          expected = count, lost = tile.key;
      return {};
    };
    ASSERT_TRUE((*field)->store().visit({1, 0}, {1, 200}, find));
    auto writer = storage::TileWriter::resume(file);
    ASSERT_TRUE(writer);
    ASSERT_TRUE(writer->drop(lost));
    ASSERT_TRUE(writer->close());
  }
  const auto verified = verify_field(file, {});
  ASSERT_TRUE(verified);
  EXPECT_EQ(verified->damaged, 0u);
  std::size_t told = 0;
  for (const Finding& finding : verified->findings) told += finding.kind == FindingKind::reference;
  EXPECT_EQ(told, expected - 1);
}

TEST_P(States, OneIsAFieldWithoutStates) {
  ASSERT_TRUE(build_field(whole_, path("a.slf"), options()));
  ASSERT_TRUE(build_field(std::span(states_).first(1), path("b.slf"), options()));
  EXPECT_TRUE(read_text(path("a.slf")) == read_text(path("b.slf")));
}

TEST_P(States, AnInterruptedBuildEndsWithTheSameBytes) {
  build_all();
  for (const int stop : {1, 7, 20, 60, 200, 400}) {
    BuildOptions often = options();
    often.commit_seconds = 0;
    int reports = 0;
    const auto stopped = build_field(states_, path("b.slf"), often,
                                     [&](const Progress&) { return ++reports < stop; });
    EXPECT_FALSE(stopped) << stop;
  }
  build_all("b.slf");
  const auto in_a = FieldFile::open(path("all.slf")), in_b = FieldFile::open(path("b.slf"));
  ASSERT_TRUE(in_a && in_b);
  std::vector<storage::TileRef> tiles;
  const auto add = [&](const storage::TileRef& tile) -> Result<void> {
    tiles.push_back(tile);
    return {};
  };
  ASSERT_TRUE((*in_a)->store().visit({0, 0}, {255, 0}, add));
  for (const storage::TileRef& tile : tiles) {
    const auto one = (*in_a)->store().find(tile.key), other = (*in_b)->store().find(tile.key);
    ASSERT_TRUE(one && other);
    EXPECT_EQ(other->state, one->state);
    EXPECT_EQ(other->source, one->source);
    EXPECT_TRUE(std::ranges::equal(other->payload, one->payload));
  }
}

std::map<TileKey, std::pair<TileKey, std::string>> tiles_of(const std::string& path) {
  std::map<TileKey, std::pair<TileKey, std::string>> tiles;
  const auto field = FieldFile::open(path);
  EXPECT_TRUE(field) << field.error().message;
  const auto add = [&](const storage::TileRef& tile) -> Result<void> {
    const auto* bytes = reinterpret_cast<const char*>(tile.payload.data());
    tiles[tile.key] = {tile.source, {bytes, tile.payload.size()}};
    return {};
  };
  EXPECT_TRUE((*field)->store().visit({0, 0}, {255, 0}, add));
  return tiles;
}

TEST_P(States, PartsMergeToTheFieldOfOneBuild) {
  levels_ = 2;
  const auto all = tiles_of(build_all());
  const std::string expected = merge({path("all.slf")});
  EXPECT_TRUE(tiles_of(path("merged.slf")) == all);
  for (const std::uint32_t n : {1u, 3u, 8u}) {
    std::vector<std::string> parts;
    for (std::uint32_t k = n; k > 0; --k) parts.push_back(shard(k, n));
    EXPECT_TRUE(merge(parts) == expected) << n;
    // Of each state, a part has the same tiles.
    std::map<std::uint64_t, std::uint64_t> count;
    for (const auto& [key, tile] : tiles_of(parts.front())) ++count[key.state];
    EXPECT_EQ(count.size(), states_.size());
    for (const auto& [state, tiles] : count) EXPECT_EQ(tiles, count[0]) << state;
  }
  // Each part as two halves.
  EXPECT_TRUE(merge({shard(1, 3), shard(5, 6), shard(2, 3), shard(6, 6)}) == expected);
}

TEST_P(States, CoarserLevelsOfAllStatesAreBuiltOnce) {
  levels_ = 2;
  build_all();
  const std::string expected = merge({path("all.slf")});
  const std::string zero = levels(0, 0, "zero"), both = levels(0, 1, "both");
  if (!predicts()) {
    EXPECT_TRUE(merge({levels(2, 2, "two"), both}) == expected);
    return;
  }
  std::vector<std::string> parts{both};
  std::size_t tiles = 0;
  for (const std::uint32_t k : {1u, 2u, 3u}) {
    parts.push_back(shard(k, 3, both));
    tiles += tiles_of(parts.back()).size();
  }
  EXPECT_EQ(tiles, states_.size() * tile_count(2, 0));  // none is in two of them
  EXPECT_TRUE(merge(parts) == expected);
  // A finer level is predicted from coarser ones that were merged, too.
  MergeOptions partly;
  partly.part = true;
  ASSERT_TRUE(merge_fields({shard(1, 2, zero), zero, shard(2, 2, zero)}, path("ones"), partly));
  ASSERT_TRUE(merge_fields({both}, path("twos"), partly));
  EXPECT_TRUE(read_text(path("ones")) == read_text(path("twos")));
}

TEST_P(States, AnInterruptedPartEndsWithTheSameTiles) {
  levels_ = 2;
  const std::string coarse = predicts() ? levels(0, 1, "coarse") : "";
  for (const std::string& coarser : {std::string(), coarse}) {
    const auto expected = tiles_of(shard(2, 3, coarser));
    BuildOptions often = options();
    often.commit_seconds = 0;
    often.shard = {2, 3, {}, {}, coarser};
    for (const int stop : {9, 300, 2000, 2500}) {
      int reports = 0;
      EXPECT_FALSE(build_field(states_, path("stopped"), often,
                               [&](const Progress&) { return ++reports < stop; }));
    }
    expect_refused({path("stopped")}, "stopped: is not finished", ErrorCode::failed);
    EXPECT_GT(build_field(states_, path("stopped"), often)->resumed, 0u);
    EXPECT_TRUE(tiles_of(path("stopped")) == expected);
    // What is lost of it, the same build fills.
    const auto last = expected.rbegin()->first;
    {
      auto writer = storage::TileWriter::resume(path("stopped"));
      ASSERT_TRUE(writer);
      ASSERT_TRUE(writer->drop(last));
      ASSERT_TRUE(writer->close());
    }
    expect_refused({path("stopped")}, "were not built, or were dropped", ErrorCode::failed);
    EXPECT_EQ(build_field(states_, path("stopped"), often)->tiles, 1u);
    EXPECT_TRUE(tiles_of(path("stopped")) == expected);
    std::filesystem::remove(path("stopped"));
    std::filesystem::remove(path("2-of-3"));
  }
}

TEST_P(States, PartsOfOtherFieldsAreRefusedByName) {
  const std::string one = shard(1, 3), two = shard(2, 3);
  expect_refused({one, two}, "no part holds tiles 1/");
  expect_refused({one, two, one}, "1-of-3: is given twice");
  expect_refused({one, shard(1, 2)}, "both hold tiles 0/0 to ");
  const auto states = states_;
  const auto refused = [&](const std::string& says) {
    expect_refused({one, two, shard(3, 3)},
                   "3-of-3: is not of the same field as " + one + ": " + says);
    std::filesystem::remove(path("3-of-3"));
    states_ = states;
  };
  states_.pop_back();
  refused("/states/4 differs");
  states_.push_back({"more", &deep_});
  refused("/states differs");
  states_.resize(1);
  refused("/states differs");
  states_[2].name = "other";
  refused("/states/2/name differs");
  states_[2].scene = &red_;
  refused("/states/2/provenance/top differs");
  std::swap(states_[1], states_[2]);
  refused("/states/1/name differs");
  if (!predicts()) return;
  BuildOptions other = options();
  other.shard = {2, 3, {}, {}, levels(0, 0, "coarse")};
  states_[2].name = "other";
  const auto built = build_field(states_, path("x"), other);
  ASSERT_FALSE(built);
  EXPECT_THAT(built.error().message, HasSubstr("/states/2/name differs"));
  // Tiles that a repack encoded again predict no others.
  build_all();
  RepackOptions coarse;
  coarse.finest_level = 0;
  std::vector<StateSource> chosen;
  for (unsigned s = 0; s < states.size(); ++s)
    chosen.push_back({states[s].name, *Field::open(path("all.slf"))->in_state(s)});
  ASSERT_TRUE(join_states(chosen, path("again"), coarse));
  states_ = states;
  expect_refused({levels(1, 1, "fine"), path("again")}, "encoded anew");
}

TEST_P(States, ALostTileIsMissingInAllStatesThatShareIt) {
  const std::string file = build_all();
  TileKey shared, source;
  {
    const auto field = FieldFile::open(file);
    ASSERT_TRUE(field);
    const auto take = [&](const storage::TileRef& tile) -> Result<void> {
      if (tile.state == TileState::same) shared = tile.key, source = tile.source;
      return {};
    };
    ASSERT_TRUE((*field)->store().visit({1, 0}, {2, 0}, take));
    auto writer = storage::TileWriter::resume(file);
    ASSERT_TRUE(writer);
    ASSERT_TRUE(writer->drop(source));
    ASSERT_TRUE(writer->close());
  }
  const auto verified = verify_field(file, {});
  ASSERT_TRUE(verified);
  EXPECT_FALSE(verified->complete);
  EXPECT_EQ(verified->damaged, 0u);
  EXPECT_THAT(verified->findings.at(0).message, HasSubstr(", which it is the same as, is missing"));
  {
    const auto state = Field::open(file)->in_state(static_cast<unsigned>(shared.state));
    ASSERT_TRUE(state);
    EXPECT_EQ(state->file().store().find(in_state(shared, 0))->state, TileState::missing);
  }
  build_all();
  EXPECT_EQ(verify_field(file, {})->found, 0u);
}

// The first record of a state in a level comes after the last one of the state before: repair and
// rebuild must not mix up their tiles.
TEST_P(States, AnyLostRecordIsRebuilt) {
  const std::string file = build_all(), good = read_text(file);
  const auto content = [&] {
    const auto field = FieldFile::open(file);
    EXPECT_TRUE(field) << field.error().message;
    return testing::all_tiles(Field::of(*field));
  };
  const auto tiles = content();
  std::vector<Image> views;
  for (unsigned s = 0; s < states_.size(); ++s)
    views.push_back(view(*Field::open(file)->in_state(s)));
  std::vector<std::size_t> records;  // where their tables begin, in overflow pages
  for (std::size_t page = 0; page < good.size(); page += 4096)
    if (good.compare(page + 24, 3, "SLR") == 0) records.push_back(page + 24);
  ASSERT_GE(records.size(), 2 * states_.size());

  std::set<TileKey> lost;  // of these records
  const auto expect_rebuilt = [&](const std::string& damaged) {
    testing::write_text(file, damaged);
    const auto fixed = verify_field(file, {.fix = true});
    ASSERT_TRUE(fixed) << fixed.error().message;
    EXPECT_EQ(fixed->unfixed, 0u);
    for (const Finding& finding : fixed->findings)
      EXPECT_THAT(finding.message, Not(HasSubstr("/1125899")));  // an index in the file
    const auto left = content();
    for (const auto& [key, payload] : tiles)
      if (!left.contains(key)) lost.insert(key);
    build_all();
    const auto verified = verify_field(file, {});
    ASSERT_TRUE(verified) << verified.error().message;
    EXPECT_EQ(verified->found, 0u) << verified->findings[0].message;
    EXPECT_EQ(content(), tiles);
    for (unsigned s = 0; s < states_.size(); ++s)
      EXPECT_EQ(view(*Field::open(file)->in_state(s)).rgba, views[s].rgba);
  };
  std::string all = good;
  for (const std::size_t at : records) {
    SCOPED_TRACE(at);
    std::string one = good;
    one[at + 20] ^= 1, all[at + 20] ^= 1;
    expect_rebuilt(one);
  }
  for (unsigned s = 0; s < states_.size(); ++s)
    for (const std::uint8_t level : {0, 1})
      EXPECT_TRUE(lost.contains(in_state({level, 0}, s))) << s << " at " << int{level};
  expect_rebuilt(all);
}

TEST_P(States, DifferencesOfLaterStatesAreFound) {
  const auto a = Field::open(build_all());
  states_[1].scene = &deep_;
  const auto b = Field::open(build_all("other.slf"));
  ASSERT_TRUE(a && b);
  const auto differing = [&](unsigned state, bool all_states) {
    const auto difference = diff_fields(*a->in_state(state), *b->in_state(state), {0, all_states});
    EXPECT_TRUE(difference) << difference.error().message;
    return difference->channels[0].differing;
  };
  EXPECT_EQ(differing(0, false), 0u);
  EXPECT_GT(differing(1, false), 0u);
  EXPECT_GT(differing(0, true), 0u);
  const auto all = diff_fields(*a, *b, {0, true});
  EXPECT_FALSE(all->alike(60));
  EXPECT_EQ(all->channels[0].worst->state, 1u);
  EXPECT_TRUE(diff_fields(*a, *a, {0, true})->equal());

  const auto composed = [](const Field& field, float opacity) {
    return *compose(field, {{*field.in_state(0), 1}, {*field.in_state(1), opacity}});
  };
  EXPECT_TRUE(diff_fields(composed(*a, 1), composed(*a, 1))->equal());
  EXPECT_FALSE(diff_fields(composed(*a, 1), composed(*a, 0.5))->alike(100));
  EXPECT_FALSE(diff_fields(composed(*a, 1), *a)->alike(100));
}

// Of a field that is shown with structures, a copy has what is drawn.
TEST_P(States, ACopyOfStructuresShowsThemTogether) {
  const auto field = Field::open(build_all());
  ASSERT_TRUE(field);
  const auto composed = *compose(*field, {{*field->in_state(2), 1}, {*field->in_state(4), 0.5f}});
  RepackOptions exact;
  exact.codec = "zstd:3";
  const auto done = repack_field(composed, path("copy.slf"), exact);
  ASSERT_TRUE(done) << done.error().message;
  EXPECT_EQ(done->missing + done->copied, 0u);
  const auto copy = Field::open(path("copy.slf"));
  ASSERT_TRUE(copy);
  EXPECT_TRUE(diff_fields(composed, *copy)->alike(200));
  EXPECT_FALSE(diff_fields(*field, *copy)->alike(60));
  EXPECT_EQ(copy->provenance(), composed.provenance());
  EXPECT_EQ(verify_field(path("copy.slf"), {})->found, 0u);
  const auto estimate = estimate_repack(composed, exact);
  ASSERT_TRUE(estimate) << estimate.error().message;
  EXPECT_EQ(estimate->tiles, done->tiles);

  // It may be a state of another field.
  const auto sources = state_sources(composed, {});
  ASSERT_TRUE(sources);
  ASSERT_EQ(sources->size(), 1u);
  const std::vector<StateSource> both{{"plain", *field->in_state(2)}, {"both", composed}};
  ASSERT_TRUE(join_states(both, path("joined.slf"), exact));
  const auto joined = Field::open(path("joined.slf"));
  EXPECT_TRUE(diff_fields(composed, *joined->in_state(1))->alike(200));
  EXPECT_TRUE(diff_fields(*field->in_state(2), *joined)->alike(200));
  const std::string chosen[] = {"deep"};
  EXPECT_EQ(state_sources(composed, chosen).error().code, ErrorCode::usage);
}

// What a state lacks, its copy lacks, whether or not it is encoded again.
TEST_P(States, MissingTilesStayMissing) {
  const std::string file = build_all();
  {
    auto writer = storage::TileWriter::resume(file);
    ASSERT_TRUE(writer && writer->drop(in_state({1, 3}, 2)) && writer->close());
  }
  const auto field = Field::open(file);
  for (const char* codec : {"", "zstd:1", "predictive:80"}) {
    RepackOptions options;
    options.codec = codec, options.replace = true;
    const auto done = join_states(*state_sources(*field, {}), path("copy.slf"), options);
    ASSERT_TRUE(done) << done.error().message;
    EXPECT_GE(done->missing, 1u);
    const auto copy = Field::open(path("copy.slf"))->in_state(2);
    EXPECT_EQ(copy->file().store().find(in_state({1, 3}, 2))->state, TileState::missing);
    EXPECT_FALSE(copy->content()->complete);
  }
}

// The light that a field keeps is that of its first state, and so that of a copy which begins with
// it, however that is made.
TEST_P(States, CopiesKeepTheLightOfTheFirst) {
  const std::string file = build_all();
  {
    auto writer = storage::TileWriter::resume(file);
    ASSERT_TRUE(writer && writer->set_blob(kLightBlob, bytes_of("light")));
    ASSERT_TRUE(writer->drop({1, 3}) && writer->close());
  }
  ASSERT_EQ(build_field(states_, file, options())->tiles, 1u);
  const auto field = Field::open(file);
  const auto light_of = [&](std::vector<unsigned> chosen, const RepackOptions& options) {
    std::vector<StateSource> sources;
    for (const unsigned s : chosen) sources.push_back({states_[s].name, *field->in_state(s)});
    RepackOptions replace = options;
    replace.replace = true;
    const auto done = join_states(sources, path("copy.slf"), replace);
    EXPECT_TRUE(done) << done.error().message;
    const auto copy = Field::open(path("copy.slf"));
    EXPECT_EQ(verify_field(path("copy.slf"), {})->found, 0u);
    const auto light = copy->light();
    return std::string(chars_of(*light));
  };
  EXPECT_EQ(light_of({0, 1, 2, 3, 4}, {}), "light");
  RepackOptions dark, raw;
  dark.light = false;
  raw.codec = "raw";
  EXPECT_EQ(light_of({0, 1, 2, 3, 4}, dark), "");
  EXPECT_EQ(light_of({0, 1, 2, 3, 4}, raw), "light");
  EXPECT_EQ(light_of({0, 2}, {}), "light");
  EXPECT_EQ(light_of({0}, {}), "light");
  EXPECT_EQ(light_of({2, 0}, {}), "");
  EXPECT_EQ(light_of({1}, {}), "");
}

TEST_P(States, TheFirstIsTakenOutAsItIs) {
  const auto field = Field::open(build_all());
  const auto done = repack_field(*field, path("first.slf"), {});
  ASSERT_TRUE(done) << done.error().message;
  EXPECT_EQ(done->recoded, 0u);
  EXPECT_EQ(verify_field(path("first.slf"), {})->found, 0u);
  const auto first = Field::open(path("first.slf"));
  const auto difference = diff_fields(*first, *field);
  ASSERT_TRUE(difference);
  EXPECT_EQ(difference->channels[0].differing + difference->channels[1].differing, 0u);
  EXPECT_EQ(view(*first).rgba, view(*field).rgba);
}

TEST_P(States, SomeSubfieldsAreJoined) {
  RepackOptions some;
  some.subfields = {7, 14};
  std::vector<StateSource> sources;
  for (const unsigned s : {0u, 1u}) {
    const std::string name = states_[s].name;
    ASSERT_TRUE(build_field(*states_[s].scene, path(name), options()));
    ASSERT_TRUE(repack_field(*Field::open(path(name)), path("some " + name), some));
    sources.push_back({name, *Field::open(path("some " + name))});
  }
  for (const char* codec : {"", "jpeg:75", "predictive:80"}) {
    RepackOptions other;
    other.codec = codec;
    other.replace = true;
    const auto joined = join_states(sources, path("joined.slf"), other);
    ASSERT_TRUE(joined) << joined.error().message;
    EXPECT_EQ(verify_field(path("joined.slf"), {})->found, 0u);
  }
}

TEST_P(States, AreCopiedTogetherAndAlone) {
  const auto all = Field::open(build_all());
  ASSERT_TRUE(all);
  const auto lossless = std::string_view(GetParam()) != "predictive:80";
  const auto same_samples = [&](const Field& a, const Field& b) {
    DiffOptions options;
    const auto difference = diff_fields(a, b, options);
    ASSERT_TRUE(difference) << difference.error().message;
    for (const ChannelDifference& channel : difference->channels)
      EXPECT_TRUE(lossless ? channel.differing == 0 : channel.worst_psnr > 20)
          << channel.worst_psnr;
  };
  // One state is a field without states, several of them are one with their names.
  const auto deep = all->in_state(2);
  ASSERT_TRUE(repack_field(*deep, path("deep.slf"), {}));
  const auto alone = Field::open(path("deep.slf"));
  ASSERT_TRUE(alone);
  EXPECT_EQ(alone->states().size(), 0u);
  EXPECT_EQ(alone->provenance(), deep->provenance());
  same_samples(*deep, *alone);
  const std::vector<StateSource> chosen{
      {"deep", *deep}, {"red", *all->in_state(4)}, {"deep again", *alone}};
  const auto joined = join_states(chosen, path("some.slf"), {});
  ASSERT_TRUE(joined) << joined.error().message;
  const auto some = Field::open(path("some.slf"));
  ASSERT_TRUE(some);
  EXPECT_EQ(some->states(), (std::vector<std::string>{"deep", "red", "deep again"}));
  for (unsigned s = 0; s < 3; ++s) {
    same_samples(*some->in_state(s), chosen[s].field);
    EXPECT_EQ(some->in_state(s)->provenance(), chosen[s].field.provenance());
  }
  EXPECT_TRUE(!lossless || some->in_state(2)->content()->payload_bytes == 0);
  EXPECT_EQ(verify_field(path("some.slf"), {})->found, 0u);
  // All of one field, as they are, are merged.
  std::vector<StateSource> every = *state_sources(*all, {});
  ASSERT_TRUE(join_states(every, path("every.slf"), {}));
  EXPECT_EQ(read_text(path("every.slf")), merge({all->path()}));
  std::swap(every[0], every[1]);
  const auto swapped = join_states(every, path("swapped.slf"), {});
  ASSERT_TRUE(swapped);
  EXPECT_EQ(swapped->copied, 0u);
  // Nothing of the manifest says which samples were copied, so a copy is never gone on with.
  const auto again = join_states(chosen, path("some.slf"), {});
  EXPECT_EQ(again.error().code, ErrorCode::usage);
  const auto stop = [](const Progress&) { return false; };
  EXPECT_EQ(join_states(chosen, path("stopped.slf"), {}, stop).error().code, ErrorCode::cancelled);
  EXPECT_FALSE(std::filesystem::exists(path("stopped.slf.unfinished")));
  BuildOptions other = options();
  other.shape.exit_side = 2;
  ASSERT_TRUE(build_field(whole_, path("other.slf"), other));
  const std::vector<StateSource> unlike{{"deep", *deep},
                                        {"other", *Field::open(path("other.slf"))}};
  EXPECT_EQ(join_states(unlike, path("no.slf"), {}).error().code, ErrorCode::usage);
}

/// A ball that is visible where planes leave it, whatever its bounds are.
class Part final : public Scene {
 public:
  Part(const Sphere& bounds, double reach) : bounds_(bounds), reach_(reach) {}
  [[nodiscard]] Sphere bounds() const override { return bounds_; }
  [[nodiscard]] double reach(const glm::dvec3& from) const override {
    return reach_ > 0 ? reach_ : Scene::reach(from);
  }
  [[nodiscard]] RaySample trace(const glm::dvec3&, const glm::dvec3&) const override { return {}; }
  [[nodiscard]] std::string provenance() const override { return "{}"; }

 private:
  Sphere bounds_;
  double reach_;
};

TEST(StatesSphere, HoldsAllThatIsVisible) {
  const auto around = [](std::vector<Part> parts) {
    std::vector<FieldState> states;
    for (const Part& part : parts) states.push_back({"", &part});
    return bounds_of(states);
  };
  const Part first({{0, 0, 0}, 2}, 0);
  const auto expect = [](const Sphere& sphere, const glm::dvec3& center, double radius) {
    EXPECT_NEAR(glm::distance(sphere.center, center), 0, 1e-12);
    EXPECT_NEAR(sphere.radius, radius, 1e-12);
  };
  expect(around({first}), {0, 0, 0}, 2);
  expect(around({first, Part({{1, 0, 0}, 1}, 0)}), {0, 0, 0}, 2);
  expect(around({first, Part({{1, 0, 0}, 1.5}, 1.9)}), {0, 0, 0},
         2);  // what is visible lies inside
  expect(around({first, Part({{1, 0, 0}, 1.5}, 0)}), {0.25, 0, 0}, 2.25);
  expect(around({first, Part({{0, 9, 0}, 1}, 0)}), {0, 4, 0}, 6);
  expect(around({first, Part({{0, 1, 0}, 5}, 0)}), {0, 1, 0}, 5);
  expect(around({first, Part({{0, 0, 0}, 3}, 0)}), {0, 0, 0}, 3);
  expect(around({first, Part({{0, 4, 0}, 1}, 0), Part({{0, 0, 0}, 1}, 0)}), {0, 1.5, 0}, 3.5);
}

TEST_P(States, WhatTheyAreNotIsSaid) {
  const auto field = Field::open(build_all());
  ASSERT_TRUE(field);
  EXPECT_EQ(field->in_state(5).error().code, ErrorCode::usage);
  EXPECT_THAT(field->in_state("none").error().message, HasSubstr("whole, cut, deep, again, red"));
  EXPECT_EQ(field->in_state("deep")->state(), 2u);
  states_.push_back({"cut", &deep_});
  EXPECT_EQ(build_field(states_, path("q.slf"), options()).error().code, ErrorCode::usage);
}

INSTANTIATE_TEST_SUITE_P(Codecs, States,
                         ::testing::Values("zstd:3", "predictive:lossless", "predictive:80"));

}  // namespace
}  // namespace slf

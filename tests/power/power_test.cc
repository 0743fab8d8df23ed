// Power cuts: whatever is lost, reordered or torn of what was not synced, a field opens as it was
// at an old or a new commit, a published name is that of a whole file, and what a function has
// returned for is kept. Without any one of slf's syncs, it is not so.
#include <fcntl.h>
#include <gtest/gtest.h>

#include <deque>
#include <random>

#include "base/file.h"
#include "slf/merge.h"
#include "slf/repack.h"
#include "slf/reveal.h"
#include "slf/verify.h"
#include "storage/tile_writer.h"
#include "tests/field/field_testing.h"
#include "tests/power/disk.h"

namespace slf::testing {
namespace {

using Kind = Call::Kind;

constexpr const char* kDraft = ".unfinished";

BuildOptions options_of(const std::string& codec = "zstd:1") {
  BuildOptions options = lossless_options(3, 8, 1);
  options.codec = codec;
  options.threads = 1;
  options.commit_seconds = 0;  // a commit for every record
  return options;
}

void build(const std::string& path, const BuildOptions& options,
           const ProgressCallback& progress = {}) {
  static const std::unique_ptr<Scene> scene = std::move(*make_analytic_scene("balls"));
  const auto built = build_field(*scene, path, options, progress);
  EXPECT_TRUE(built || built.error().code == ErrorCode::cancelled) << built.error().message;
  note_done();
}

void build_twice(const std::string& folder) {
  for (const char* codec : {"zstd:1", "predictive:90"}) {
    const std::string path = folder + "/" + std::string(codec, 4) + ".slf";
    build(path, options_of(codec), [](const Progress& p) { return p.done < p.total / 2; });
    build(path, options_of(codec));
  }
}

void repack_over(const std::string& folder) {
  build(folder + "/a.slf", options_of());
  const Field field = Field::open(folder + "/a.slf").value();
  for (const char* codec : {"zstd:3", "raw"}) {
    RepackOptions options;
    options.codec = codec;
    options.replace = true;
    options.threads = 1;
    EXPECT_TRUE(repack_field(field, folder + "/b.slf", options));
    note_done();
  }
}

void merge_shards(const std::string& folder) {
  std::vector<std::string> parts;
  for (const std::uint32_t k : {1, 2}) {
    BuildOptions options = options_of();
    options.shard.index = k;
    options.shard.count = 2;
    parts.push_back(folder + "/" + std::to_string(k) + ".slf");
    build(parts.back(), options);
  }
  EXPECT_TRUE(merge_fields(parts, folder + "/whole.slf", {}));
  note_done();
}

void join_and_reveal(const std::string& folder) {
  build(folder + "/a.slf", options_of());
  const Field field = Field::open(folder + "/a.slf").value();
  RepackOptions options;
  options.threads = 1;
  const std::vector<StateSource> states{{"one", field}, {"two", field}};
  EXPECT_TRUE(join_states(states, folder + "/joined.slf", options));
  note_done();
  for (const std::uint32_t side : {16, 40}) {
    Reveal reveal{.dims = {side, side, side}, .voxels = Bytes(side * side * side)};
    for (std::size_t k = 0; k < reveal.voxels.size(); ++k)
      reveal.voxels[k] = static_cast<std::byte>(k * k >> 9);
    EXPECT_TRUE(set_reveal(folder + "/joined.slf", *encode(reveal, 1)));
    note_done();
  }
}

void fix_and_fill(const std::string& folder) {
  const std::string path = folder + "/a.slf";
  build(path, options_of());
  for (TileKey key : {TileKey{0, 20}, TileKey{1, 300}}) {  // of two records
    const auto store = storage::TileStore::open(path).value();
    while (store.find(key)->payload.size() < 100) ++key.index;
    const auto at = store.find(key)->payload.data() + 50 - store.map();
    const Descriptor file(::open(path.c_str(), O_RDWR | O_DSYNC));
    EXPECT_EQ(write_all(file.get(), Bytes(4, std::byte{0xA5}), static_cast<std::uint64_t>(at)), 0);
  }
  note_done();
  const auto report = verify_field(path, {.fix = true, .threads = 1});
  EXPECT_TRUE(report && report->dropped == 2);
  note_done();
  build(path, options_of());
}

/// Commits of all kinds of changes.
void edit(const std::string& folder) {
  const std::string path = folder + "/a.slf";
  build(path, options_of());
  std::mt19937 random(7);
  auto writer = storage::TileWriter::resume(path).value();
  for (unsigned commit = 0; commit < 20; ++commit) {
    for (unsigned changes = random() % 4; changes > 0; --changes) {
      const TileKey key{1, random() % 1000};
      const Bytes bytes(random() % 3 == 0 ? 1 + random() % 99999 : 1 + random() % 999,
                        std::byte{1});
      EXPECT_TRUE(random() % 4 > 0 ? writer.replace(key, bytes) : writer.drop(key));
    }
    if (random() % 3 == 0) {
      EXPECT_TRUE(writer.set_blob("more", Bytes(random() % 99999, std::byte{2})));
    }
    EXPECT_TRUE(writer.commit());
    note_done();
  }
}

void write_over(const std::string& folder) {
  for (const std::size_t size : {3000, 20000}) {
    EXPECT_TRUE(write_file(folder + "/picture", Bytes(size, static_cast<std::byte>(size % 251))));
    note_done();
  }
}

/// Containers that are synced at their end alone.
void write_containers(const std::string& folder) {
  for (const bool publish : {false, true}) {
    const std::string path = folder + (publish ? "/b" : "/a");
    auto writer = storage::TileWriter::create(path + ".repacking", {}).value();
    writer.defer_sync();
    for (std::uint64_t k = 0; k < 50; ++k)
      EXPECT_TRUE(writer.append({0, k}, Bytes(1000 + k * 97, static_cast<std::byte>(k))));
    EXPECT_TRUE(publish ? writer.publish(path, Existing::keep) : writer.close());
    note_done();
  }
}

using Scenario = void (*)(const std::string& folder);

/// What a scenario asked of the file system, and what files may be after a power cut.
class Recorded {
 public:
  /// The bytes as text, which GCC 12 compares without a false warning.
  static std::string text_of(const Bytes& bytes) {
    return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
  }

  explicit Recorded(Scenario scenario) {
    {
      const TemporaryFolder folder;
      const std::string path = std::filesystem::path(folder / "x").parent_path();
      begin_calls(path);
      scenario(path);
      calls_ = end_calls();
    }
    Disk disk;
    for (const Call& call : calls_) {
      disk.make(call);
      if (call.kind != Kind::done) continue;
      for (const auto& [name, content] : disk.now()) {
        if (!versions_[name].insert(text_of(content)).second || !name.ends_with(".slf")) continue;
        write(name, content);
        const Payloads all = tiles(name);
        for (const auto& [key, payload] : all) tiles_[name][key].insert(payload);
        fewest_[name] = std::min(fewest_.try_emplace(name, all.size()).first->second, all.size());
      }
    }
  }

  [[nodiscard]] std::set<const void*> sites() const {
    std::set<const void*> sites;
    for (const Call& call : calls_)
      if (call.site) sites.insert(call.site);
    return sites;
  }

  /// What is wrong after some power cut, without the syncs of a site; empty: nothing is. Counts the
  /// images that differ.
  [[nodiscard]] std::string fault(const void* without, int& images) {
    Disk disk;
    std::set<std::string> published;
    std::set<std::size_t> known;
    for (std::size_t k = 0; k < calls_.size(); ++k) {
      if (!without || calls_[k].site != without) disk.make(calls_[k]);
      const bool done = calls_[k].kind == Kind::done;
      if (done)
        for (const auto& [name, content] : disk.now())
          if (!name.ends_with(kDraft)) published.insert(name);
      std::mt19937 random(static_cast<unsigned>(k));
      for (int cut = 0; cut < 9; ++cut) {
        const Disk::Image image = disk.image(luck(cut, random));
        if (!known.insert(hash(image, done)).second) continue;
        ++images;
        std::string wrong = check(disk, image, published, done);
        if (!wrong.empty())
          return wrong + " after call " + std::to_string(k) + " of " +
                 std::to_string(calls_.size()) + ", cut " + std::to_string(cut);
      }
    }
    return {};
  }

 private:
  /// All, nothing, one without the other, and at random: single sectors, or many together.
  static Disk::Luck luck(int cut, std::mt19937& random) {
    if (cut < 4) return {[=] { return cut % 2 == 1; }, [=] { return cut / 2 == 1; }};
    const auto names = [&random] { return random() % 2 == 0; };
    if (cut < 7)
      return {[&random, cut] { return random() % 10 < 2u * static_cast<unsigned>(cut) - 5; },
              names};
    return {[&random, keeps = cut == 7]() mutable {
              if (random() % 16 == 0) keeps = !keeps;
              return keeps;
            },
            names};
  }

  static std::size_t hash(const Disk::Image& image, bool done) {
    std::size_t sum = done;
    for (const auto& [name, content] : image)
      sum = (sum * 31 + std::hash<std::string>()(name)) * 31 +
            std::hash<std::string_view>()(
                std::string_view(reinterpret_cast<const char*>(content.data()), content.size()));
    return sum;
  }

  std::string check(const Disk& disk, const Disk::Image& image,
                    const std::set<std::string>& published, bool done) {
    for (const std::string& name : published)
      if (!image.contains(name)) return name + " is lost";
    if (done && image != disk.now()) return "a function returned too early";
    for (const auto& [name, transaction] : disk.promised()) {
      if (transaction <= kCreated) continue;
      auto kept = image.find(name);
      if (kept == image.end()) kept = image.find(name + kDraft);
      if (kept == image.end() || last_transaction(kept->second) < transaction)
        return name + " has lost a commit";
    }
    for (const auto& [name, content] : image)
      if (std::string wrong = check(name, content); !wrong.empty()) return name + ": " + wrong;
    return {};
  }

  std::string check(const std::string& name, const Bytes& content) {
    if (versions_[name].contains(text_of(content)) || is_useless(name)) return {};
    const bool draft = name.ends_with(kDraft);
    const std::string field = draft ? name.substr(0, name.size() - std::strlen(kDraft)) : name;
    if (!tiles_.contains(field)) return "neither the old file nor the new one";
    write(name, content);
    const auto report = verify_field(folder_ / name, {.threads = 1});
    if (!report) return report.error().message;
    for (const Finding& finding : report->findings)
      if (finding.kind < FindingKind::checksum) return finding.message;  // no tile's
    for (const auto& [key, payload] : tiles(name))
      if (!tiles_[field][key].contains(payload)) return "has other tiles";
    if (!draft && report->tiles < fewest_[field]) return "lacks tiles";
    return {};
  }

  void write(const std::string& name, const Bytes& content) {
    write_text(folder_ / name, {reinterpret_cast<const char*>(content.data()), content.size()});
  }

  /// Payloads, damaged ones too.
  Payloads tiles(const std::string& name) {
    Payloads tiles;
    const auto store = storage::TileStore::open(folder_ / name);
    const auto visited =
        store->visit({0, 0}, {255, 0}, [&](const storage::TileRef& tile) -> Result<void> {
          tiles[tile.key] = {reinterpret_cast<const char*>(tile.payload.data()),
                             tile.payload.size()};
          return {};
        });
    EXPECT_TRUE(visited);
    return tiles;
  }

  /// Until it is complete, and named otherwise.
  static bool is_useless(const std::string& name) {
    return name.ends_with(".repacking") || name.ends_with(".tmp");
  }

  static std::uint64_t last_transaction(const Bytes& content) {
    if (content.size() < 2 * 4096) return 0;
    return std::max(load_le<std::uint64_t>(content.data() + 144),
                    load_le<std::uint64_t>(content.data() + 4096 + 144));
  }

  static constexpr std::uint64_t kCreated = 2;  // transactions of an empty field

  TemporaryFolder folder_;
  std::vector<Call> calls_;
  std::map<std::string, std::set<std::string>>
      versions_;  // of each name, when functions had returned
  std::map<std::string, std::map<TileKey, std::set<std::string>>> tiles_;  // in these versions
  std::map<std::string, std::size_t> fewest_;                              // tiles of a version
};

TEST(Power, CutsDamageNothingAndEverySyncIsNeeded) {
  std::deque<Recorded> scenarios;
  std::set<const void*> sites;
  for (const Scenario scenario : {write_over, write_containers, fix_and_fill, edit, build_twice,
                                  repack_over, merge_shards, join_and_reveal}) {
    Recorded& recorded = scenarios.emplace_back(scenario);
    int images = 0;
    EXPECT_EQ(recorded.fault(nullptr, images), "") << "scenario " << scenarios.size();
    EXPECT_GT(images, 5);
    sites.merge(recorded.sites());
  }
  EXPECT_GE(sites.size(), 6u);
  for (const void* site : sites) {
    std::string fault;
    int images = 0;
    for (auto at = scenarios.begin(); at != scenarios.end() && fault.empty(); ++at)
      if (at->sites().contains(site)) fault = at->fault(site, images);
    EXPECT_NE(fault, "") << name_of_site(site) << " is not needed";
    std::printf("without the sync in %s: %s\n", name_of_site(site).c_str(), fault.c_str());
  }
}

}  // namespace
}  // namespace slf::testing

// `slf build`, `slf repack` and `slf merge`, killed at any moment of their lives: nothing committed
// is lost, nothing half done can be taken for a field, and the same command ends as if nothing had
// happened.
#include <signal.h>

#include <chrono>
#include <optional>
#include <random>
#include <thread>

#include "tests/cli/cli_testing.h"
#include "tests/field/field_testing.h"

extern char** environ;

namespace slf {
namespace {

using testing::all_tiles;
using testing::Workplace;
using Clock = std::chrono::steady_clock;
using Seconds = std::chrono::duration<double>;
using Arguments = std::vector<std::string>;

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr int kKills = 15;  // the commands take ten times as long
#else
constexpr int kKills = 110;  // of each command
#endif

/// Runs the command, killing it after `limit` if it still lives. Its exit code, or nothing.
std::optional<int> run(const Arguments& arguments, std::optional<Seconds> limit = {}) {
  std::vector<char*> line{const_cast<char*>(SLF_COMMAND)};
  for (const std::string& argument : arguments) line.push_back(const_cast<char*>(argument.c_str()));
  line.push_back(nullptr);
  posix_spawn_file_actions_t silent;
  posix_spawn_file_actions_init(&silent);
  posix_spawn_file_actions_addopen(&silent, STDOUT_FILENO, "/dev/null", O_WRONLY, 0);
  pid_t child = 0;
  const int failed = posix_spawn(&child, line[0], &silent, nullptr, line.data(), environ);
  posix_spawn_file_actions_destroy(&silent);
  if (failed != 0) return 127;
  if (limit) {
    std::this_thread::sleep_for(*limit);
    kill(child, SIGKILL);  // not reaped yet, so the number is still its own
  }
  int status = 0;
  waitpid(child, &status, 0);
  if (WIFEXITED(status)) return WEXITSTATUS(status);
  EXPECT_EQ(WTERMSIG(status), SIGKILL);
  return std::nullopt;
}

/// Kills commands at moments spread at random over a little more than the time that one takes.
class Moments {
 public:
  explicit Moments(const Arguments& arguments) {
    const auto begin = Clock::now();
    EXPECT_EQ(slf::run(arguments), 0);
    whole_ = Clock::now() - begin;
  }

  /// The exit code of the command, or nothing if it was killed.
  std::optional<int> run(const Arguments& arguments) {
    const auto ended =
        slf::run(arguments, whole_ * std::uniform_real_distribution<>(0, 1.1)(random_));
    whole_ *= ended ? 0.96 : 1.01;  // the first run can have been far from the usual time
    return ended;
  }

 private:
  Seconds whole_{};
  std::mt19937 random_{1};
};

using Tiles = decltype(all_tiles(std::declval<const Field&>()));

Tiles tiles_of(const std::string& path) {
  const auto field = Field::open(path);
  EXPECT_TRUE(field) << field.error().message;
  return field ? all_tiles(*field) : Tiles();
}

Arguments join(Arguments arguments, const Arguments& more) {
  arguments.insert(arguments.end(), more.begin(), more.end());
  return arguments;
}

/// With the options that choose the codecs.
class Killed : public ::testing::TestWithParam<Arguments> {
 protected:
  static Arguments build(const std::string& output) {
    return join({"-q", "build", "scene:balls", "-o", output, "--entry", "3", "--exit", "8",
                 "--levels", "1", "-j", "2", "--commit-every", "0.002"},
                GetParam());
  }
};

INSTANTIATE_TEST_SUITE_P(Codecs, Killed,
                         ::testing::Values(Arguments{"--codec", "zstd:1"},
                                           Arguments{"--codec", "predictive:90"}),
                         [](const auto& param) {
                           return param.index == 0 ? "zstd" : "predictive";
                         });

TEST_P(Killed, ABuildKeepsWhatItCommittedAndEndsTheSame) {
  Workplace place;
  Moments moments(build(place / "whole.slf"));
  const Tiles whole = tiles_of(place / "whole.slf");
  const std::string path = place / "a.slf";
  int kills = 0, resumed = 0, partial = 0;
  std::size_t kept = 0;
  for (int runs = 0; kills < kKills && runs < 4 * kKills; ++runs) {
    const auto ended = moments.run(build(path));
    if (!ended) ++kills;
    const std::string growing = path + ".unfinished";
    const bool finished = std::filesystem::exists(path);
    const bool begun = std::filesystem::exists(growing);
    EXPECT_FALSE(finished && begun);
    if (!finished && !begun) {
      EXPECT_EQ(kept, 0u);
      continue;
    }
    const Tiles found = tiles_of(finished ? path : growing);
    EXPECT_GE(found.size(), kept);
    for (const auto& [place_of_tile, payload] : found) {
      const auto expected = whole.find(place_of_tile);
      ASSERT_NE(expected, whole.end());
      ASSERT_TRUE(expected->second == payload);
    }
    resumed += kept > 0 && found.size() > kept;
    partial += !found.empty() && found.size() < whole.size();
    kept = found.size();
    EXPECT_EQ(ended.value_or(0), 0);
    EXPECT_TRUE(!finished || kept == whole.size());
    if (!finished) continue;
    EXPECT_TRUE(ended || run({"-q", "verify", path}) == 0);
    EXPECT_EQ(place.files(), (std::vector<std::string>{"a.slf", "whole.slf"}));
    std::filesystem::remove(path);
    kept = 0;
  }
  EXPECT_EQ(kills, kKills);
  EXPECT_GT(partial, kKills / 10) << "kills hardly ever met a half-built field";
  EXPECT_GT(resumed, 0);
  if (kept == 0) return;
  EXPECT_EQ(run(build(path)), 0);
  EXPECT_TRUE(tiles_of(path) == whole);
}

// States of one light, of which a part is computed again after each kill; whole, and in shards.
TEST(KilledStates, ABuildEndsWithTheBytesOfOneThatWasNot) {
  Workplace place;
  std::string voxels;
  for (int k = 0; k < 12 * 12 * 12; ++k) {
    const int x = k % 12 - 6, y = k / 12 % 12 - 6, z = k / 144 - 6;
    voxels += static_cast<char>(std::max(0, 255 - 9 * (x * x + y * y + z * z)));
  }
  testing::write_text(place / "v.raw", voxels);
  testing::write_text(place / "s.json", R"({"states": [{"name": "whole"},
      {"name": "cut", "clip": [[6, 6, 7, 0, 0, 1]], "light-from": "whole"},
      {"name": "deep", "clip": [[6, 6, 5, 0, 0, 1]], "light-from": "whole"}]})");
  const auto build = [&](const std::string& output, const std::string& shard = "1/1") -> Arguments {
    return {"-q",
            "build",
            place / "v.raw",
            "--shard",
            shard,
            "--dims",
            "12x12x12",
            "--type",
            "u8",
            "-o",
            output,
            "--states",
            place / "s.json",
            "--transfer",
            "ct-bone",
            "--range",
            "20,120",
            "--light-samples",
            "4",
            "--entry",
            "3",
            "--exit",
            "8",
            "--levels",
            "1",
            "-j",
            "2",
            "--commit-every",
            "0.002"};
  };
  Moments moments(build(place / "whole.slf"));
  const auto states_of = [](const std::string& path) {
    std::vector<Tiles> states;
    const auto field = Field::open(path);
    EXPECT_TRUE(field) << field.error().message;
    for (unsigned s = 0; field && s < field->states().size(); ++s)
      states.push_back(all_tiles(*field->in_state(s)));
    return states;
  };
  const auto whole = states_of(place / "whole.slf");
  ASSERT_EQ(whole.size(), 3u);
  const std::string path = place / "a.slf";
  int kills = 0, ends = 0;
  for (int runs = 0; (kills < kKills / 3 || ends == 0) && runs < 2 * kKills; ++runs) {
    const auto ended = moments.run(build(path));
    EXPECT_EQ(ended.value_or(0), 0);
    kills += !ended;
    if (!std::filesystem::exists(path)) continue;
    EXPECT_TRUE(states_of(path) == whole) << "after " << kills << " kills";
    std::filesystem::remove(path);
    ++ends;
  }
  EXPECT_GE(kills, kKills / 3);
  EXPECT_GT(ends, 0);
  const Arguments parts{place / "1.slf", place / "2.slf"};
  Moments moments_of_shards(build(place / "x.slf", "1/2"));
  for (kills = 0; kills < 3;)
    for (std::size_t k = 0; k < 2; ++k) {
      std::filesystem::remove(parts[k]);
      while (!std::filesystem::exists(parts[k]))
        kills += !moments_of_shards.run(build(parts[k], std::to_string(k + 1) + "/2"));
    }
  EXPECT_EQ(run(join({"-q", "merge", "-o", path}, parts)), 0);
  EXPECT_TRUE(states_of(path) == whole) << "after " << kills << " kills";
}

TEST_P(Killed, ARepackLeavesNoFieldOrAWholeOne) {
  Workplace place;
  ASSERT_EQ(run({"-q", "build", "scene:balls", "-o", place / "in.slf", "--entry", "3", "--exit",
                 "8", "--levels", "1", "--codec", "raw"}),
            0);
  const auto repack = [&](const std::string& output) {
    return join({"-q", "repack", place / "in.slf", "-o", output, "--memory", "1MiB", "-j", "2"},
                GetParam());
  };
  Moments moments(repack(place / "whole.slf"));
  const Tiles whole = tiles_of(place / "whole.slf");
  std::filesystem::remove(place / "whole.slf");
  const std::string path = place / "a.slf";
  int kills = 0, left_over = 0;
  for (int runs = 0; kills < kKills && runs < 4 * kKills; ++runs) {
    const auto ended = moments.run(repack(path));
    EXPECT_EQ(ended.value_or(0), 0);
    kills += !ended;
    for (const std::string& name : place.files()) {
      EXPECT_TRUE(name == "in.slf" || name == "a.slf" || !name.ends_with(".slf")) << name;
      left_over += name != "in.slf" && name != "a.slf";
    }
    if (!std::filesystem::exists(path)) {
      EXPECT_FALSE(ended);
      continue;
    }
    EXPECT_TRUE(tiles_of(path) == whole);  // killed when all was done, if at all
    std::filesystem::remove(path);
  }
  EXPECT_EQ(kills, kKills);
  EXPECT_GT(left_over, 0) << "no kill met a repack at work";
  EXPECT_EQ(run(repack(path)), 0);  // goes over what the others left
  EXPECT_TRUE(tiles_of(path) == whole);
  EXPECT_EQ(place.files(), (std::vector<std::string>{"a.slf", "in.slf"}));
}

// Shards and merges, with the codec whose shards build coarser tiles, too.
TEST(KilledMerge, ShardsAndMergesEndInTheFieldOfOneBuild) {
  Workplace place;
  const auto shard = [&](const std::string& output, const std::string& number) -> Arguments {
    return {"-q", "build",          "scene:balls", "-o",       output, "--entry",
            "3",  "--exit",         "8",           "--levels", "1",    "-j",
            "2",  "--commit-every", "0.002",       "--shard",  number};
  };
  const std::string merged = place / "merged.slf";
  const Arguments merge{"-q", "merge", place / "1.slf", place / "2.slf", place / "3.slf",
                        "-o", merged};
  ASSERT_EQ(run(shard(place / "whole.slf", "1/1")), 0);
  ASSERT_EQ(run({"-q", "repack", place / "whole.slf", "-o", place / "repacked.slf"}), 0);
  const std::string whole = testing::read_text(place / "repacked.slf");

  Moments moments_of_shards(shard(place / "x.slf", "2/3"));
  std::filesystem::remove(place / "x.slf");
  int kills = 0, rounds = 0;
  for (; kills < kKills && rounds < kKills; ++rounds) {
    for (const char* k : {"1", "2", "3"}) {
      const std::string path = place / (std::string(k) + ".slf");
      std::filesystem::remove(path);
      for (bool done = false; !done;) {
        const auto ended = moments_of_shards.run(shard(path, k + std::string("/3")));
        EXPECT_EQ(ended.value_or(0), 0);
        kills += !ended;
        done = std::filesystem::exists(path);
      }
    }
    Moments moments_of_merges([&] {
      std::filesystem::remove(merged);
      return merge;
    }());
    std::filesystem::remove(merged);
    for (int k = 0; k < 8; ++k) {
      const auto ended = moments_of_merges.run(merge);
      kills += !ended;
      if (!std::filesystem::exists(merged)) continue;
      EXPECT_TRUE(testing::read_text(merged) == whole);
      std::filesystem::remove(merged);
    }
    EXPECT_EQ(run(merge), 0);
    EXPECT_TRUE(testing::read_text(merged) == whole) << "after " << kills << " kills";
    EXPECT_EQ(place.files(), (std::vector<std::string>{"1.slf", "2.slf", "3.slf", "merged.slf",
                                                       "repacked.slf", "whole.slf"}));
  }
  EXPECT_GE(kills, kKills);
}

// A finished field gets a reveal, or stays what it was.
TEST(KilledReveal, LeavesTheFieldWithItOrWithoutIt) {
  Workplace place;
  std::string voxels;
  for (unsigned k = 0; k < 40 * 40 * 40; ++k) voxels += static_cast<char>(k * k / 1009);
  testing::write_text(place / "v.raw", voxels);
  const Arguments volume{"--dims", "40x40x40"};
  ASSERT_EQ(run(join({"-q", "build", place / "v.raw", "-o", place / "in.slf", "--entry", "2",
                      "--exit", "4", "--levels", "1", "--lighting", "direct"},
                     volume)),
            0);
  const Tiles whole = tiles_of(place / "in.slf");
  const std::string path = place / "a.slf";
  const Arguments add = join({"-q", "reveal", path, "--volume", place / "v.raw"}, volume);
  const auto renew = [&] {
    std::filesystem::copy_file(place / "in.slf", path,
                               std::filesystem::copy_options::overwrite_existing);
  };
  renew();
  Moments moments(add);
  int kills = 0, added = 0;
  for (int runs = 0; kills < kKills / 2 && runs < 2 * kKills; ++runs) {
    renew();
    const auto ended = moments.run(add);
    EXPECT_EQ(ended.value_or(0), 0);
    kills += !ended;
    EXPECT_TRUE(tiles_of(path) == whole);
    const auto field = Field::open(path);
    const auto reveal = field->reveal();
    ASSERT_TRUE(reveal) << reveal.error().message;
    added += reveal->has_value();
    EXPECT_TRUE(!ended || *reveal);
  }
  EXPECT_GT(kills, kKills / 10);
  EXPECT_GT(added, 0);
}

}  // namespace
}  // namespace slf

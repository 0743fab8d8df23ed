// Damaged, truncated and shrinking files: an error, or exactly the right bytes; never a crash.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <signal.h>
#include <sys/mman.h>
#include <sys/syscall.h>

#include <atomic>
#include <csetjmp>
#include <set>

#include "storage/internal/snapshot.h"
#include "storage/internal/structure.h"
#include "tests/storage/storage_testing.h"

namespace slf::storage::testing {
namespace {

using ::testing::HasSubstr;

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr std::size_t kThin = 17;  // of all the bit flips, every how many-th: sanitizers are slow
#else
constexpr std::size_t kThin = 1;
#endif

// A small container with pages of every kind: metas, branches, leaves, values inside leaves, runs
// of overflow pages, a free list, and freed pages.
Model build_small(const std::string& path) {
  Model model;
  TileWriter writer = create(path);
  for (int i = 0; i < 20; ++i)  // long names: the tree of blobs needs a branch page
    EXPECT_TRUE(ok(writer.set_blob(std::string(240, static_cast<char>('a' + i)), bytes_of("x"))));
  const auto append = [&](TileKey key, std::size_t size) {
    model[key] = tile_bytes(key, size);
    EXPECT_TRUE(ok(writer.append(key, model[key])));
  };
  for (std::uint64_t i = 0; i < 12; ++i) append({0, i}, i % 5 * 20);
  for (std::uint64_t i = 0; i < 3; ++i) append({1, 2000 * i}, 100);
  EXPECT_TRUE(ok(writer.commit()));
  for (std::uint64_t i = 0; i < 4; ++i) append({2, i}, 600);
  for (std::uint64_t i = 0; i < 4; ++i) {
    const TileKey key = in_state({2, i}, 2);
    if (i == 1) {
      append(key, 50);
    } else {
      EXPECT_TRUE(ok(writer.append(key, {}, 2)));
      model[key] = model[{2, i}];
    }
  }
  EXPECT_TRUE(ok(writer.set_blob("large", Bytes(5000, std::byte{5}))));
  EXPECT_TRUE(ok(writer.commit()));
  EXPECT_TRUE(ok(writer.set_blob("large", Bytes(6000, std::byte{6}))));
  EXPECT_TRUE(ok(writer.close()));
  return model;
}

// Reads all there is in every way and compares. Returns whether everything was there.
bool survives(const std::string& path, const Model& model, const std::string& what) {
  auto store = TileStore::open(path);
  if (!store) {
    EXPECT_TRUE(store.error().code == ErrorCode::bad_file ||
                store.error().code == ErrorCode::unsupported)
        << what << ": " << store.error().message;
    return false;
  }
  bool whole = true;
  std::set<TileKey> accounted;
  const auto visited = store->visit(
      {0, 0}, {255, 0},
      [&](const TileRef& tile) {
        const auto expected = model.find(tile.key);
        if (expected == model.end()) {
          ADD_FAILURE() << what << ": a tile that never was";
          return Result<void>();
        }
        accounted.insert(tile.key);
        if (const auto same = find_whole(*store, tile.key)) {
          EXPECT_TRUE(std::ranges::equal(same->payload, expected->second)) << what;
        } else {
          whole = false;
        }
        return Result<void>();
      },
      [&](const Damage& damage) {
        whole = false;
        EXPECT_LE(damage.first, damage.last) << what;
        for (const auto& [key, bytes] : model)
          if (key >= damage.first && key <= damage.last) accounted.insert(key);
      });
  EXPECT_TRUE(ok(visited)) << what;
  EXPECT_EQ(accounted.size(), model.size()) << what << ": tiles vanished from visit()";
  for (const auto& [key, bytes] : model) {
    const auto tile = find_whole(*store, key);
    if (!tile) {
      whole = false;
      continue;
    }
    EXPECT_EQ(tile->state, bytes.empty() ? TileState::empty : TileState::stored) << what;
    EXPECT_TRUE(std::ranges::equal(tile->payload, bytes)) << what;
  }
  SCOPED_TRACE(what);
  expect_finds_alike(*store, model);
  const auto large = store->blob("large");
  if (large && !std::ranges::equal(*large, Bytes(6000, std::byte{6})))
    ADD_FAILURE() << what << ": a wrong blob";
  return whole;
}

// What a writer does to a damaged file: refuses it, or keeps every tile that was still whole.
void resume_survives(const std::string& path, const Model& model, const std::string& what) {
  auto writer = TileWriter::resume(path);
  if (!writer) return;
  EXPECT_TRUE(ok(writer->append({9, 0}, bytes_of("more")))) << what;
  EXPECT_TRUE(ok(writer->close())) << what;
  Model grown = model;
  grown[{9, 0}] = bytes_of("more");
  (void)survives(path, grown, what);
}

void put_byte(int file, std::size_t at, std::byte value) {
  ASSERT_EQ(pwrite(file, &value, 1, static_cast<off_t>(at)), 1);
}

class Damaged : public ::testing::Test {
 protected:
  void SetUp() override {
    model_ = build_small(path_);
    ASSERT_TRUE(survives(path_, model_, "as built"));
    bytes_ = read_file(path_);
    file_ = ::open(path_.c_str(), O_RDWR | O_CLOEXEC);
    ASSERT_GE(file_, 0);
  }
  void TearDown() override { ::close(file_); }

  void put(std::size_t at, std::byte value) const { put_byte(file_, at, value); }

  // Inside long runs of one byte (most of them zeros nobody reads), one bit of each byte must do.
  [[nodiscard]] bool monotonous(std::size_t at) const {
    const std::size_t begin = at < 32 ? 0 : at - 32;
    const std::size_t end = std::min(bytes_.size(), at + 32);
    return std::all_of(bytes_.begin() + static_cast<long>(begin),
                       bytes_.begin() + static_cast<long>(end),
                       [&](std::byte b) { return b == bytes_[at]; });
  }

  TemporaryFolder folder_;
  std::string path_ = folder_ / "small.slf";
  Model model_;
  Bytes bytes_;
  int file_ = -1;
};

TEST_F(Damaged, HasPagesOfEveryKind) {
  std::map<unsigned, int> kinds;
  for (std::size_t page = 0; page < bytes_.size(); page += 4096)
    ++kinds[load_le<std::uint16_t>(bytes_.data() + page + 10)];
  for (const unsigned kind : {1u, 2u, 4u, 8u}) EXPECT_GT(kinds[kind], 0) << kind;
  EXPECT_LT(bytes_.size(), 400000u);
}

TEST_F(Damaged, AnyFlippedBitIsAnErrorOrHarmless) {
  std::size_t harmful = 0;
  for (std::size_t at = 0; at < bytes_.size() && !HasFailure(); ++at) {
    const bool dull = monotonous(at);
    for (std::size_t bit = 0; bit < 8; ++bit) {
      if (dull && bit != at % 8) continue;
      if ((at * 8 + bit) % kThin != 0) continue;
      put(at, bytes_[at] ^ static_cast<std::byte>(1u << bit));
      if (!survives(path_, model_, "bit " + std::to_string(at * 8 + bit))) ++harmful;
    }
    put(at, bytes_[at]);
  }
  EXPECT_GT(harmful, 100u);
}

TEST_F(Damaged, TheStructureCheckRunsOverAnything) {
  std::size_t found = 0;
  for (std::size_t at = 0; at < bytes_.size() && !HasFailure(); ++at) {
    if (monotonous(at) || at % (3 * kThin) != 0) continue;
    put(at, bytes_[at] ^ static_cast<std::byte>(1u << at / 3 % 8));
    if (auto store = TileStore::open(path_)) {
      std::vector<Error> findings;
      store->check_structure(findings);
      for (const Error& finding : findings) EXPECT_EQ(finding.code, ErrorCode::bad_file);
      if (!findings.empty()) ++found;
    }
    put(at, bytes_[at]);
  }
  EXPECT_GT(found, 10u);
}

TEST_F(Damaged, ResumingAFileWithAFlippedBitLosesNothingElse) {
  const std::string copy = folder_ / "copy.slf";
  std::mt19937 random(1);
  std::vector<std::size_t> places;
  for (std::size_t at = 0; at < bytes_.size(); ++at)
    if (!monotonous(at)) places.push_back(at);
  for (std::size_t i = 0; i < 3000 / kThin && !HasFailure(); ++i) {
    Bytes bytes = bytes_;
    // Half of the flips in the heads of pages, where the structure is.
    std::size_t at = places[random() % places.size()];
    if (i % 2 == 0) at = at / 4096 * 4096 + random() % 200;
    const unsigned bit = random() % 8;
    bytes[at] ^= static_cast<std::byte>(1u << bit);
    write_file(copy, bytes);
    resume_survives(copy, model_, "bit " + std::to_string(at * 8 + bit));
  }
}

TEST_F(Damaged, EveryTruncationIsAnErrorAtOpen) {
  for (std::size_t size = bytes_.size(); size-- > 0 && !HasFailure();) {
    ASSERT_EQ(ftruncate(file_, static_cast<off_t>(size)), 0);
    if (size % kThin != 0) continue;
    const auto store = TileStore::open(path_);
    ASSERT_FALSE(store) << size;
    EXPECT_EQ(store.error().code, ErrorCode::bad_file) << size;
  }
}

TEST_F(Damaged, LongerFilesAreFine) {
  Bytes longer = bytes_;
  longer.resize(longer.size() + 10000, std::byte{0xAA});
  write_file(path_, longer);
  EXPECT_TRUE(survives(path_, model_, "longer"));
}

TEST_F(Damaged, ShrinkingWhileMappedIsAnError) {
  for (std::size_t size = bytes_.size() / 4096 * 4096; size > 0; size -= 4096) {
    write_file(path_, bytes_);
    auto store = TileStore::open(path_);
    ASSERT_TRUE(ok(store));
    std::vector<TileRef> tiles;
    for (const auto& [key, bytes] : model_) tiles.push_back(*store->find(key));
    EXPECT_TRUE(ok(store->unchanged()));
    ASSERT_EQ(truncate(path_.c_str(), static_cast<off_t>(size - 4096)), 0);
    for (const TileRef& tile : tiles) {
      const auto again = find_whole(*store, tile.key);
      const Bytes& expected = model_[tile.key];
      if (again) {
        EXPECT_TRUE(std::ranges::equal(again->payload, expected));
      }
      if (store->check(tile) && tile.state != TileState::same) {
        EXPECT_TRUE(std::ranges::equal(tile.payload, expected));
      }
    }
    std::vector<Error> findings;
    store->check_structure(findings);
    EXPECT_FALSE(findings.empty()) << size;
    EXPECT_EQ(store->unchanged().error().code, ErrorCode::bad_file);
    const auto visited =
        store->visit({0, 0}, {9, 0}, [](const TileRef&) { return Result<void>(); });
    ASSERT_FALSE(visited);
    EXPECT_THAT(visited.error().message, HasSubstr("changed while open"));
  }
}

// The kernel reports a page that the disk cannot read as it does one beyond the end of the file.
TEST_F(Damaged, APageThatTheDiskCannotReadIsAnErrorOfInputAndOutput) {
  auto store = TileStore::open(path_);
  ASSERT_TRUE(ok(store));
  const auto tile = store->find(model_.rbegin()->first);
  ASSERT_TRUE(ok(tile));
  siginfo_t fault = {};
  fault.si_signo = SIGBUS;
  fault.si_code = BUS_ADRERR;
  fault.si_addr = const_cast<std::byte*>(store->map()) + 8192;
  ASSERT_EQ(syscall(SYS_rt_tgsigqueueinfo, getpid(), gettid(), SIGBUS, &fault), 0);
  EXPECT_EQ(store->unchanged().error().code, ErrorCode::io);
  const auto found = store->find(tile->key);
  ASSERT_FALSE(found);
  EXPECT_EQ(found.error().code, ErrorCode::io);
  EXPECT_THAT(found.error().message, HasSubstr("the disk reports an error"));
}

std::atomic<int> foreign_faults = 0;
sigjmp_buf after_fault;

void take_fault(int, siginfo_t*, void*) {
  ++foreign_faults;
  siglongjmp(after_fault, 1);
}

// The handler is installed once per process, so the program that had its own before is a child.
TEST_F(Damaged, ShrinkingUnderAWriterIsAnError) {
  for (const std::size_t left : {std::size_t{0}, std::size_t{4096}, std::size_t{5000},
                                 std::size_t{8192}, bytes_.size() / 2, bytes_.size() - 4096}) {
    SCOPED_TRACE(left);
    for (const bool replaces : {false, true}) {
      write_file(path_, bytes_);
      auto writer = TileWriter::resume(path_);
      ASSERT_TRUE(ok(writer));
      EXPECT_TRUE(ok(writer->append({9, 0}, bytes_of("more"))));
      ASSERT_EQ(truncate(path_.c_str(), static_cast<off_t>(left)), 0);
      const auto replaced = replaces ? writer->replace({0, 1}, {}) : Result<void>();
      EXPECT_TRUE(replaced || replaced.error().code == ErrorCode::bad_file);
      ASSERT_TRUE(ok(writer->set_blob("note", bytes_of("x"))));
      const auto committed = writer->commit();
      ASSERT_FALSE(committed);
      EXPECT_EQ(committed.error().code, ErrorCode::bad_file);
      EXPECT_THAT(committed.error().message, HasSubstr("shorter"));
      EXPECT_EQ(writer->close().error().code, ErrorCode::bad_file);
      EXPECT_EQ(std::filesystem::file_size(path_), left);
    }
  }
}

TEST_F(Damaged, FaultsElsewhereGoToThePreviousHandler) {
  const auto child = [&]() -> int {
    struct sigaction action = {};
    action.sa_sigaction = take_fault;
    action.sa_flags = SA_SIGINFO;
    sigaction(SIGBUS, &action, nullptr);
    auto store = TileStore::open(path_);
    if (!store) return 1;
    const std::string other = folder_ / "other";
    write_file(other, Bytes(8192));
    const int file = ::open(other.c_str(), O_RDWR);
    auto* map = static_cast<volatile char*>(mmap(nullptr, 8192, PROT_READ, MAP_SHARED, file, 0));
    if (ftruncate(file, 0) != 0) return 2;
    if (sigsetjmp(after_fault, 1) == 0) {
      (void)map[5000];
      return 3;
    }
    return foreign_faults == 1 && store->unchanged() ? 0 : 4;
  };
  const auto child_alone = [&] {  // it has a folder of its own
    const int result = child();
    std::filesystem::remove_all(folder_.path());
    _exit(result);
  };
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  EXPECT_EXIT(child_alone(), ::testing::ExitedWithCode(0), "");
}

void count_fault(int) { ++foreign_faults; }

void install_another(int) {
  ++foreign_faults;
  (void)signal(SIGBUS, count_fault);
}

/// The handler of a program that runs this test alone, before it opens its first field.
const auto previous_handler = [] {
  std::ifstream line("/proc/self/cmdline");
  const std::string words(std::istreambuf_iterator<char>(line), {});
  if (words.find("internal_run_death_test") == std::string::npos) return SIG_DFL;
  const auto runs = [&](const char* test) { return words.find(test) != std::string::npos; };
  const auto handler = runs("OfAProgramThatIgnores")    ? SIG_IGN
                       : runs("OfAProgramThatCounts")   ? count_fault
                       : runs("OfAProgramThatInstalls") ? install_another
                                                        : SIG_DFL;
  (void)signal(SIGBUS, handler);
  return handler;
}();

/// A signal that is not about a map says nothing against the next one, which is: the field becomes
/// shorter. 0: it was treated so.
class ForeignSignals : public Damaged {
 protected:
  [[noreturn]] void run(int handled) {
    const int result = [&] {
      auto store = TileStore::open(path_);
      if (!store) return 1;
      for (int k = 0; k < 3; ++k) kill(getpid(), SIGBUS);
      if (foreign_faults != handled) return 2;
      if (truncate(path_.c_str(), 4096) != 0) return 3;
      std::vector<Error> findings;
      store->check_structure(findings);
      return store->unchanged() ? 4 : 0;
    }();
    std::filesystem::remove_all(folder_.path());
    _exit(result);
  }
  void SetUp() override {
    Damaged::SetUp();
    GTEST_FLAG_SET(death_test_style, "threadsafe");
  }
};

TEST_F(ForeignSignals, OfAProgramThatIgnores) {
  EXPECT_EXIT(run(0), ::testing::ExitedWithCode(0), "");
}
TEST_F(ForeignSignals, OfAProgramThatCounts) {
  EXPECT_EXIT(run(3), ::testing::ExitedWithCode(0), "");
}
TEST_F(ForeignSignals, OfAProgramThatInstallsAnother) {
  EXPECT_EXIT(run(3), ::testing::ExitedWithCode(0), "");
}
TEST_F(ForeignSignals, OfAProgramWithoutAHandler) {
  EXPECT_EXIT(run(0), ::testing::KilledBySignal(SIGBUS), "");
}

TEST(DamagedTree, SpottyDamageInALargerTreeIsReportedWithItsKeys) {
  TemporaryFolder folder;
  const std::string path = folder / "a.slf";
  Model model;
  {
    TileWriter writer = create(path);
    for (std::uint64_t i = 0; i < 300; ++i) {  // a record each
      const TileKey key{2, i * 2000};
      model[key] = tile_bytes(key, 20);
      ASSERT_TRUE(ok(writer.append(key, model[key])));
    }
    ASSERT_TRUE(ok(writer.close()));
  }
  ASSERT_TRUE(survives(path, model, "as built"));
  const Bytes bytes = read_file(path);
  const int file = ::open(path.c_str(), O_RDWR | O_CLOEXEC);
  std::mt19937 random(2);
  std::size_t harmful = 0;
  for (std::size_t page = 2; page < bytes.size() / 4096 && !::testing::Test::HasFailure(); ++page) {
    const auto kind = load_le<std::uint16_t>(bytes.data() + page * 4096 + 10);
    for (std::size_t i = 0; i < (kind == 4 ? 1 : 200 / kThin); ++i) {
      const std::size_t at = page * 4096 + random() % 4096;
      put_byte(file, at, bytes[at] ^ static_cast<std::byte>(1u << random() % 8));
      if (!survives(path, model, "byte " + std::to_string(at))) ++harmful;
      put_byte(file, at, bytes[at]);
    }
  }
  ::close(file);
  EXPECT_GT(harmful, 10u);
}

TEST(DamagedTree, TooManyFindingsAreSaidSo) {
  TemporaryFolder folder;
  const std::string path = folder / "a.slf";
  TileWriter writer = create(path);
  for (int i = 0; i < 400; ++i)
    ASSERT_TRUE(ok(writer.set_blob(std::to_string(i), Bytes(5000, std::byte{5}))));
  ASSERT_TRUE(ok(writer.close()));
  Bytes bytes = read_file(path);
  for (std::size_t page = 2 * 4096; page < bytes.size(); page += 4096)
    if (load_le<std::uint16_t>(&bytes[page + 10]) == 4) bytes[page] ^= std::byte{1};
  write_file(path, bytes);
  const auto snapshot = internal::Snapshot::open(path);
  ASSERT_TRUE(ok(snapshot));
  for (const auto scope : {internal::CheckScope::trees, internal::CheckScope::everything}) {
    std::vector<Error> findings(1);  // does not count
    internal::check_pages((*snapshot)->pages(), scope, findings);
    ASSERT_EQ(findings.size(), 302u);
    EXPECT_THAT(findings[300].message, HasSubstr("page"));
    EXPECT_THAT(findings.back().message, HasSubstr("too many findings"));
  }
}

TEST(DamagedRecord, CanBeMarkedMissingAndFilledAgain) {
  TemporaryFolder folder;
  const std::string path = folder / "a.slf";
  Model model;
  {
    TileWriter writer = create(path);
    for (std::uint64_t i = 0; i < 600; ++i) {
      model[{1, i}] = tile_bytes({1, i}, 1000);
      ASSERT_TRUE(ok(writer.append({1, i}, model[{1, i}])));
    }
    ASSERT_TRUE(ok(writer.close()));
  }
  FileRange range;
  {
    auto store = TileStore::open(path);
    ASSERT_TRUE(ok(store));
    range = store->range(*store->find({1, 300}));
  }
  // The table of the record that holds tile 300 begins some pages before it.
  Bytes bytes = read_file(path);
  std::size_t page = range.begin / 4096;
  while (load_le<std::uint16_t>(bytes.data() + page * 4096 + 10) != 4 ||
         load_le<std::uint64_t>(bytes.data() + page * 4096) != page)
    --page;
  bytes[page * 4096 + 16 + 50] ^= std::byte{1};
  write_file(path, bytes);

  std::vector<Damage> damages;
  const auto visit = [&] {
    damages.clear();
    auto store = TileStore::open(path);
    Model found;
    EXPECT_TRUE(ok(store->visit(
        {0, 0}, {9, 0},
        [&](const TileRef& tile) {
          found[tile.key] = Bytes(tile.payload.begin(), tile.payload.end());
          return Result<void>();
        },
        [&](const Damage& damage) { damages.push_back(damage); })));
    return found;
  };
  visit();
  ASSERT_EQ(damages.size(), 1u);
  const Damage damage = damages[0];
  EXPECT_LE(damage.first, (TileKey{1, 300}));
  EXPECT_GE(damage.last, (TileKey{1, 300}));
  {
    auto writer = TileWriter::resume(path);
    ASSERT_TRUE(ok(writer));
    ASSERT_TRUE(ok(writer->drop(damage.last)));
    ASSERT_TRUE(ok(writer->close()));
  }
  Model expected = model;
  std::erase_if(expected, [&](const auto& tile) {
    return tile.first >= damage.first && tile.first <= damage.last;
  });
  EXPECT_EQ(visit(), expected);
  EXPECT_TRUE(damages.empty());
  {
    auto writer = TileWriter::resume(path);
    ASSERT_TRUE(ok(writer));
    for (std::uint64_t i = damage.first.index; i <= damage.last.index; ++i) {
      ASSERT_TRUE(ok(writer->replace({1, i}, model[{1, i}])));
    }
    ASSERT_TRUE(ok(writer->close()));
  }
  expect_holds(path, model);
}

}  // namespace
}  // namespace slf::storage::testing

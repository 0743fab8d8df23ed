#include <algorithm>
#include <barrier>
#include <ctime>
#include <fstream>
#include <numeric>
#include <random>
#include <thread>

#include "benchmarks/storage/expect.h"
#include "benchmarks/storage/page_cache.h"
#include "benchmarks/storage/scenarios.h"
#include "benchmarks/storage/store_peer.h"

namespace slf::bench {
namespace {

constexpr std::size_t kAhead = 16;
constexpr unsigned kThreads[] = {1, 8};
constexpr std::size_t kSegment = 128;         // tiles that a store reads per turn
constexpr std::size_t kManyThreadsShare = 4;  // segments per turn with several threads

enum class Operation { get, decode };

struct Mode {
  bool cold = false;
  unsigned threads = 1;
  Operation operation = Operation::decode;
};

// Bytes that the kernel has read from disks for this process, including readahead.
std::uint64_t bytes_from_disk() {
  std::ifstream io("/proc/self/io");
  for (std::string name; io >> name;)
    if (std::uint64_t bytes = 0; name == "read_bytes:" && io >> bytes) return bytes;
  return 0;
}

// An open store under test, with a reader for each thread.
struct Contestant {
  const StorePeer* peer = nullptr;
  std::string path;
  std::unique_ptr<OpenStore> store;
  std::vector<std::unique_ptr<StoreReader>> readers;
  std::uint64_t stayed = 0;                // pages in the cache before a cold run
  std::uint64_t bytes_read = 0;            // from the disk, for the tiles
  std::vector<double> seconds, latencies;  // per segment; per tile
};

double thread_seconds() {
  timespec time = {};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + static_cast<double>(time.tv_nsec) * 1e-9;
}

// Reads one byte of every page: the minimum that ensures that a payload is in memory.
std::byte touch(ByteSpan payload) {
  std::byte sum{0};
  for (std::size_t i = 0; i < payload.size(); i += 4096) sum ^= payload[i];
  return sum;
}

// One thread's share of the work. A tile's latency begins when the previous tile is done, so the
// time of ahead() counts towards the first tile of its batch.
void read_share(StoreReader& reader, std::span<const std::size_t> order, const Mode& mode,
                std::vector<double>& latencies) {
  Bytes samples;
  volatile std::byte sink{0};
  const auto batch = [&](std::size_t begin) {
    const std::size_t from = std::min(begin, order.size());
    return order.subspan(from, std::min(kAhead, order.size() - from));
  };
  double last = now();
  if (mode.cold) reader.ahead(batch(0));
  for (std::size_t begin = 0; begin < order.size(); begin += kAhead) {
    if (mode.cold) reader.ahead(batch(begin + kAhead));
    for (const std::size_t tile : batch(begin)) {
      if (mode.operation == Operation::decode)
        reader.read(tile, samples);
      else
        sink = touch(reader.get(tile));
      const double done = now();
      latencies.push_back(done - last);
      last = done;
    }
  }
  (void)sink;
}

// Reads a segment with all threads. Returns seconds by the wall clock if cold, else processor
// seconds of all threads: hot reads do not wait, and other processes may share the machine.
double read_segment(Contestant& contestant, std::span<const std::size_t> order, const Mode& mode) {
  std::vector<std::vector<double>> latencies(mode.threads);
  std::vector<double> busy(mode.threads);
  double begin = 0;
  std::barrier ready(static_cast<std::ptrdiff_t>(mode.threads), [&]() noexcept { begin = now(); });
  std::vector<std::thread> threads;
  for (unsigned t = 0; t < mode.threads; ++t)
    threads.emplace_back([&, t] {
      const std::size_t from = order.size() * t / mode.threads;
      const std::size_t to = order.size() * (t + 1) / mode.threads;
      latencies[t].reserve(to - from);
      ready.arrive_and_wait();
      const double before = thread_seconds();
      read_share(*contestant.readers[t], order.subspan(from, to - from), mode, latencies[t]);
      busy[t] = thread_seconds() - before;
    });
  for (std::thread& thread : threads) thread.join();
  const double wall = now() - begin;
  for (const auto& some : latencies)
    contestant.latencies.insert(contestant.latencies.end(), some.begin(), some.end());
  return mode.cold ? wall : std::accumulate(busy.begin(), busy.end(), 0.0);
}

// Reopens a store, with all of its pages dropped from the cache (cold), or all in it (hot).
void open(Contestant& contestant, const TileSet& set, const Mode& mode,
          std::span<const std::size_t> order) {
  contestant.readers.clear();
  contestant.store.reset();
  if (mode.cold) contestant.stayed = std::max(contestant.stayed, drop_from_cache(contestant.path));
  contestant.store = contestant.peer->open(set, contestant.path);
  Bytes samples;
  for (unsigned t = 0; t < mode.threads; ++t) {
    contestant.readers.push_back(contestant.store->reader());
    for (const std::size_t tile : order) {  // fills the caches of the kernel and of the store
      if (mode.cold) break;
      if (contestant.peer->returns_payloads())
        (void)touch(contestant.readers.back()->get(tile));
      else if (t == 0)
        contestant.readers.back()->read(tile, samples);
    }
  }
}

// How many times faster `ours` is than `other`: the median over the turns, which is robust against
// other load on the machine.
double ratio_to(const Contestant& ours, const Contestant& other) {
  std::vector<double> ratios;
  for (std::size_t s = 0; s < ours.seconds.size(); ++s)
    ratios.push_back(other.seconds[s] / ours.seconds[s]);
  return percentile(ratios, 0.5);
}

// In each turn all stores read the same tiles, and each turn begins with another store, so that
// other load on the machine affects all alike. When cold, the file is dropped before every turn;
// otherwise a generous readahead would load tiles of later turns, unlike in files above memory.
void race(std::vector<Contestant>& contestants, const TileSet& set, const Mode& mode,
          std::span<const std::size_t> order) {
  const std::size_t length = kSegment * (mode.threads > 1 ? kManyThreadsShare : 1);
  for (std::size_t begin = 0, turn = 0; begin + length <= order.size(); begin += length, ++turn)
    for (std::size_t k = 0; k < contestants.size(); ++k) {
      Contestant& next = contestants[(k + turn) % contestants.size()];
      if (mode.cold) open(next, set, mode, order);
      const std::uint64_t before = bytes_from_disk();
      next.seconds.push_back(read_segment(next, order.subspan(begin, length), mode));
      next.bytes_read += bytes_from_disk() - before;
      if (!mode.cold) continue;
      next.readers.clear();
      next.store.reset();
    }
}

void report_race(const TileSet& set, std::vector<Contestant>& contestants, const Mode& mode,
                 Report& report) {
  std::vector<Row> rows;
  double min_ratio = 1e9, min_bound_ratio = 1e9;
  const double tiles = static_cast<double>(contestants[0].latencies.size());
  for (Contestant& contestant : contestants) {
    const double ratio = ratio_to(contestants[0], contestant);
    double& smallest = contestant.peer->is_bound() ? min_bound_ratio : min_ratio;
    if (&contestant != &contestants[0]) smallest = std::min(smallest, ratio);
    rows.push_back(
        {{"store", contestant.peer->name()},
         {mode.cold ? "tiles/s" : "tiles/cpu s",
          tiles / std::accumulate(contestant.seconds.begin(), contestant.seconds.end(), 0.0)},
         {"ours/it", ratio},
         {"p50 us", percentile(contestant.latencies, 0.5) * 1e6},
         {"p99 us", percentile(contestant.latencies, 0.99) * 1e6},
         {"file/payload",
          static_cast<double>(disk_bytes(contestant.path)) / static_cast<double>(set.bytes())},
         {"read KiB/tile", static_cast<double>(contestant.bytes_read) / 1024 / tiles},
         {"pages not cold", mode.cold ? Row(contestant.stayed) : Row()}});
  }
  const std::string title = set.name + ", " + (mode.cold ? "cold" : "hot") + ", " +
                            std::to_string(mode.threads) +
                            (mode.threads > 1 ? " threads" : " thread") +
                            (mode.operation == Operation::get ? ", get" : ", get + decode");
  report.table(title, rows);
  if (mode.operation == Operation::get && !mode.cold) return;
  // If the bound misses the target, too, decoding or the disk is the limit.
  report.note(title + ": the bound / best peer: " +
              std::to_string(min_ratio / min_bound_ratio).substr(0, 5));
  report.target(title + ": ours / best peer", min_ratio, mode.cold ? 1.5 : 0.95, true);
}

}  // namespace

void measure_reads(const Settings& settings, const TileSet& set, Report& report) {
  const std::vector<std::unique_ptr<StorePeer>> peers = store_peers();
  std::vector<Contestant> all;
  for (const auto& peer : peers) {
    if (!peer->can_store(set)) continue;
    Contestant& contestant = all.emplace_back();
    contestant.peer = peer.get();
    contestant.path = settings.folder + "/reads-" + std::to_string(all.size());
    remove_files(contestant.path);
    peer->write(set, contestant.path);
    (void)drop_from_cache(contestant.path);
  }
  std::vector<std::size_t> order(set.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::shuffle(order.begin(), order.end(), std::mt19937_64(1));
  order.resize(std::min(order.size(), settings.reads));
  require(order.size() >= kSegment * kManyThreadsShare,
          "a turn takes " + std::to_string(kSegment * kManyThreadsShare) +
              " tiles: --reads or --mb is too small for " + set.name);

  for (const bool cold : {false, true})
    for (const unsigned threads : kThreads)
      for (const Operation operation : {Operation::get, Operation::decode}) {
        const Mode mode{cold, threads, operation};
        std::vector<Contestant> contestants;
        for (Contestant& contestant : all) {
          if (operation == Operation::get && !contestant.peer->returns_payloads()) continue;
          Contestant& opened = contestants.emplace_back();
          opened.peer = contestant.peer;
          opened.path = contestant.path;
          if (!cold) open(opened, set, mode, order);
        }
        race(contestants, set, mode, order);
        report_race(set, contestants, mode, report);
      }
  for (const Contestant& contestant : all) remove_files(contestant.path);
}

}  // namespace slf::bench

#include "field/write/write_tiles.h"

#include <xxhash.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <mutex>
#include <utility>
#include <vector>

#include "base/parallel.h"
#include "base/try.h"
#include "field/field_file.h"
#include "field/geometry/tile_order.h"
#include "field/geometry/tile_selection.h"
#include "field/tiles/tile_cache.h"
#include "field/write/tile_source.h"

namespace slf {
namespace {

using storage::TileState;
using Clock = std::chrono::steady_clock;

constexpr std::uint64_t kPrefetched = 64;  // tiles per call of prefetch()

/// After so many commits, the coarser levels are read from the file opened anew. While it is open,
/// LMDB reuses no page that later commits free, about four each. Opening it anew empties the cache
/// of references.
constexpr std::uint64_t kCommitsPerReader = 4;

/// How many states before a tile's own are searched for one to predict it from.
constexpr std::uint64_t kSearchedStates = 64;

static_assert(kMaxChain == 1, "what earlier_tiles() finds is predicted from coarser tiles alone");

/// The tiles of earlier states that a tile may be predicted from: the latest one that is stored and
/// not predicted from another state itself, and that of the first state.
Result<std::vector<storage::TileRef>> earlier_tiles(const FieldFile& field, TileKey key) {
  std::vector<storage::TileRef> found;
  const std::uint64_t state = key.state;
  const auto add = [&](std::uint64_t earlier) -> Result<bool> {
    auto tile = SLF_TRY(field.store().find(in_state(key, earlier)));
    if (tile.state != TileState::stored) return false;
    SLF_TRY(field.store().check(tile));
    tile.key = tile.source;
    const unsigned chain = SLF_TRY(field.chain(tile));
    if (chain >= kMaxChain) return false;
    if (found.empty() || found.back().key != tile.key) found.push_back(tile);
    return true;
  };
  bool added = false;
  for (std::uint64_t back = 1; !added && back <= std::min(state, kSearchedStates); ++back)
    added = SLF_TRY(add(state - back));
  if (state > 0) SLF_TRY(add(0));
  return found;
}

/// Coarser tiles, loaded.
struct Coarser {
  std::vector<TileCache::Pin> pins;
  std::vector<ReferenceSamples> samples;

  [[nodiscard]] static Result<Coarser> load(TileCache& cache, std::span<const TileKey> keys) {
    Coarser loaded;
    loaded.pins = SLF_TRY(cache.load(keys));
    for (std::size_t k = 0; k < keys.size(); ++k)
      loaded.samples.push_back({keys[k], loaded.pins[k].samples()});
    return loaded;
  }
};

/// Encodes a tile as a difference from what the tiles of the next coarser level predict, or from
/// the same tile of an earlier state, whichever takes fewer bytes. `coarser`: of the field, or of
/// another with the same coarser tiles; null if tiles are not predicted. `earlier`, not null in a
/// field of several states, has those; the rest of it need not be there. Errors of
/// TileCache::load(). REQUIRES: both show all states.
Result<void> encode_tile(const TileCoder& coder, TileCache* coarser, const FieldFile* earlier,
                         TileKey key, ByteSpan samples, Bytes& payload) {
  Coarser from;
  if (coarser) from = SLF_TRY(Coarser::load(*coarser, coder.choose(key, samples)));
  SLF_TRY(coder.encode(key, samples, from.samples, payload));
  if (!coder.uses_states()) return {};
  Bytes other, decoded(samples.size());
  const auto others = SLF_TRY(earlier_tiles(*earlier, key));
  for (const storage::TileRef& tile : others) {
    const auto named = SLF_TRY(earlier->references(tile));
    const auto below = SLF_TRY(Coarser::load(*coarser, named));
    SLF_TRY(earlier->decode(tile, below.samples, decoded));
    from.samples.push_back({tile.key, decoded});
    SLF_TRY(coder.encode(key, samples, from.samples, other));
    from.samples.pop_back();
    if (other.size() < payload.size()) payload.swap(other);
  }
  return {};
}

/// Finds tiles that have the same samples in an earlier state. Keeps a hash of the samples of each
/// tile of a field; those that another thread makes, or that an earlier call of a build made, are
/// made again. The arguments of the constructor must outlive it. Thread-safety: any thread.
class SameTiles {
 public:
  /// `tiles`: those of the field.
  SameTiles(const TileSource& source, const TileOrder& order, const TileSelection& tiles,
            unsigned states)
      : source_(source), order_(order), tiles_(tiles), hashes_(states > 1 ? tiles.count() : 0) {}

  /// The tile of the first state that has the samples, so one that is stored: this tile itself if
  /// no earlier one has, or if it is not stored. Errors as the source.
  [[nodiscard]] Result<TileKey> find(const SourceTile& tile) {
    const TileKey key = tile.ref.key;
    if (hashes_.empty()) return key;
    const Hash own = remember(tile);
    for (std::uint64_t state = 0; own != kNoSamples && state < key.state; ++state) {
      const Hash other = SLF_TRY(hash_of(in_state(key, state)));
      if (other == own) return in_state(key, state);
    }
    return key;
  }

 private:
  using Hash = std::array<std::uint64_t, 2>;
  static constexpr Hash kNoSamples{0, 1};

  [[nodiscard]] Hash& hash(TileKey key) { return hashes_[tiles_.rank(order_.number(key))]; }

  Hash remember(const SourceTile& tile) {
    Hash hash = kNoSamples;
    if (tile.ref.state == TileState::stored) {
      const XXH128_hash_t found = XXH3_128bits(tile.samples.data(), tile.samples.size());
      hash = {found.low64 | 1, found.high64};
    }
    const std::lock_guard lock(mutex_);
    return this->hash(tile.ref.key) = hash;
  }

  Result<Hash> hash_of(TileKey key) {
    if (!tiles_.has(order_.number(key))) return kNoSamples;  // it is missing
    {
      const std::lock_guard lock(mutex_);
      if (const Hash& known = hash(key); known != Hash{}) return known;
    }
    SourceTile tile;
    SLF_TRY(source_.tile(key, tile));
    return remember(tile);
  }

  const TileSource& source_;
  const TileOrder& order_;
  const TileSelection& tiles_;
  std::mutex mutex_;
  std::vector<Hash> hashes_;  // by the tile's rank; 0: not known
};

/// A tile that a worker made.
struct MadeTile {
  TileKey key;
  TileState state = TileState::missing;
  Bytes payload{};
  std::uint64_t back = 0;  ///< if it is the same as one of an earlier state: how many states back
};

class Pipeline {
 public:
  Pipeline(const TileSource& source, const WritePlan& plan, const TileSelection& tiles,
           FieldWriter& writer, Reporter& reporter)
      : source_(source),
        plan_(plan),
        order_(plan.manifest.shape),
        tiles_(tiles),
        writer_(writer),
        reporter_(reporter),
        same_(source, order_, plan.all, plan.coder ? plan.manifest.shape.states : 1),
        reads_own_file_(plan.coder && plan.coder->predicts() &&
                        (!plan.coarser || plan.coder->uses_states())) {}

  Result<WriteReport> run() {
    writer_.set_pending_limit(plan_.budget.pending);
    for (std::uint64_t begin = 0, end = 0; begin < tiles_.count(); begin = end) {
      end = tiles_.count();
      if (reads_own_file_) {
        const TileKey first = key(begin);
        end = tiles_.rank(order_.number(in_state(first_key(first.level), first.state + 1)));
        set_written({});  // it lacks the level or state before, and commits could reuse no pages
        SLF_TRY(writer_.commit_level());
        SLF_TRY(follow());
      }
      SLF_TRY(write(begin, end));
    }
    return report_;
  }

 private:
  [[nodiscard]] TileKey key(std::uint64_t k) const { return order_.key(tiles_.number(k)); }

  /// Makes the tiles [begin, end) on all threads, and puts them in order.
  Result<void> write(std::uint64_t begin, std::uint64_t end) {
    const WriteBudget& budget = plan_.budget;
    const std::uint64_t batch = budget.batch;
    const auto keys = [&](std::uint64_t from, std::uint64_t count) {
      std::vector<TileKey> some;
      for (std::uint64_t k = from; k < std::min(from + count, end); ++k) some.push_back(key(k));
      return some;
    };
    const auto new_maker = [&] {
      return [&, tile = SourceTile()](std::uint64_t k) mutable {
        return make_all(keys(begin + k * batch, batch), tile);
      };
    };
    committed_at_ = Clock::now();
    const std::uint64_t ahead = budget.window * batch + kPrefetched;
    source_.prefetch(keys(begin, ahead + kPrefetched));
    std::uint64_t next = begin;
    const auto put_all = [&](std::uint64_t, std::vector<MadeTile> made) -> Result<void> {
      for (MadeTile& tile : made) {
        SLF_TRY(put(std::move(tile)));
        if ((++next - begin) % kPrefetched == 0) source_.prefetch(keys(next + ahead, kPrefetched));
      }
      return {};
    };
    const std::uint64_t items = (end - begin + batch - 1) / batch;
    return make_in_order(items, budget.threads, budget.window, new_maker, put_all);
  }

  Result<std::vector<MadeTile>> make_all(const std::vector<TileKey>& keys, SourceTile& tile) {
    std::vector<MadeTile> made;
    for (const TileKey key : keys) {
      auto one = SLF_TRY(make(key, tile));
      made.push_back(std::move(one));
    }
    return made;
  }

  Result<MadeTile> make(TileKey key, SourceTile& tile) {
    SLF_TRY(source_.tile(key, tile));
    MadeTile made{key, tile.ref.state};
    const auto source = SLF_TRY(plan_.coder ? same_.find(tile) : tile.ref.source);
    made.back = key.state - source.state;
    if (made.state != TileState::stored || made.back > 0) return made;
    if (!plan_.coder) {
      made.payload.assign(tile.ref.payload.begin(), tile.ref.payload.end());
      return made;
    }
    const auto own = written();
    const auto& coarser = plan_.coarser ? plan_.coarser : own;
    SLF_TRY(encode_tile(*plan_.coder, coarser ? &coarser->cache() : nullptr,
                        own ? &own->field().file() : nullptr, key, tile.samples, made.payload));
    return made;
  }

  Result<void> put(MadeTile tile) {
    const TileKey key = tile.key;
    const bool missing = tile.state == TileState::missing;
    ++(missing ? report_.missing : report_.tiles);
    report_.payload_bytes += tile.payload.size();
    if (!missing)
      SLF_TRY(writer_.put(key, std::move(tile.payload), tile.back));
    else if (plan_.manifest.holds(key))
      SLF_TRY(writer_.put_missing(key));
    auto go_on = reporter_.add(source_.work(key.level));
    const std::chrono::duration<double> interval(plan_.commit_seconds);
    if (!go_on || Clock::now() - committed_at_ >= interval) {
      SLF_TRY(writer_.commit());
      SLF_TRY(follow());
      committed_at_ = Clock::now();
    }
    return go_on;
  }

  /// Opens the file that is being written as of the last commit, if it is read, and was not opened
  /// for some commits.
  Result<void> follow() {
    const auto own = written();
    const auto read = [&] { return own->field().file().store().transaction(); };
    if (!reads_own_file_ || (own && writer_.transaction() < read() + kCommitsPerReader)) return {};
    auto opened = SLF_TRY(FieldFile::open(writer_.file()));
    set_written(TileReader(Field::of(std::move(opened)), {.memory = plan_.budget.cache}));
    return {};
  }

  /// The tiles of the file that is being written, or none. Workers read them while the writer
  /// replaces the file. A mutex guards it, because the load() of libstdc++ 12's atomic shared_ptr
  /// does not release.
  [[nodiscard]] std::optional<TileReader> written() const {
    const std::lock_guard lock(mutex_);
    return written_;
  }
  void set_written(std::optional<TileReader> tiles) {
    const std::lock_guard lock(mutex_);
    written_.swap(tiles);  // the last user of the old one closes it
  }

  const TileSource& source_;
  const WritePlan& plan_;
  const TileOrder order_;
  const TileSelection& tiles_;
  FieldWriter& writer_;
  Reporter& reporter_;
  SameTiles same_;
  const bool reads_own_file_;  // to predict tiles
  WriteReport report_;
  Clock::time_point committed_at_;
  mutable std::mutex mutex_;
  std::optional<TileReader> written_;
};

}  // namespace

Result<WriteReport> write_tiles(const TileSource& source, const WritePlan& plan,
                                const TileSelection& tiles, FieldWriter& writer,
                                Reporter& reporter) {
  return Pipeline(source, plan, tiles, writer, reporter).run();
}

}  // namespace slf

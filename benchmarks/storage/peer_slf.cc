// Ours: TileStore, as Field uses it, checksums and all.
#include <unordered_map>

#include "benchmarks/storage/expect.h"
#include "benchmarks/storage/store_peer.h"
#include "storage/tile_store.h"
#include "storage/tile_writer.h"

namespace slf::bench {
namespace {

constexpr std::uint64_t kCommitBytes = 32ull << 20;

class SlfReader final : public StoreReader {
 public:
  SlfReader(const TileSet& set, const storage::TileStore& store)
      : StoreReader(set), store_(store) {}

  void ahead(std::span<const std::size_t> tiles) override {
    keys_.clear();
    for (const std::size_t tile : tiles) keys_.push_back({set().level, set().keys[tile]});
    refs_.clear();
    for (auto& found : store_.find_all(keys_)) refs_.push_back(expect(std::move(found)));
    store_.advise(refs_);
    for (std::size_t i = 0; i < tiles.size(); ++i) found_[tiles[i]] = refs_[i];
  }

  ByteSpan get(std::size_t tile) override {
    storage::TileRef ref;
    if (const auto known = found_.find(tile); known != found_.end()) {
      ref = known->second;
      found_.erase(known);
    } else {
      ref = expect(store_.find({set().level, set().keys[tile]}));
    }
    expect(store_.check(ref));
    return ref.payload;
  }

 private:
  const storage::TileStore& store_;
  std::vector<storage::TileKey> keys_;
  std::vector<storage::TileRef> refs_;
  std::unordered_map<std::size_t, storage::TileRef> found_;
};

class SlfStore final : public OpenStore {
 public:
  SlfStore(const TileSet& set, const std::string& path)
      : set_(set), store_(expect(storage::TileStore::open(path))) {}
  std::unique_ptr<StoreReader> reader() const override {
    return std::make_unique<SlfReader>(set_, store_);
  }

 private:
  const TileSet& set_;
  storage::TileStore store_;
};

class Slf final : public StorePeer {
 public:
  std::string name() const override { return "slf"; }

  void write(const TileSet& set, const std::string& path) const override {
    auto writer = expect(storage::TileWriter::create(path, {}));
    for (std::size_t i = 0; i < set.size(); ++i) {
      expect(writer.append({set.level, set.keys[i]}, set.payloads[i]));
      if (writer.pending_bytes() >= kCommitBytes) expect(writer.commit());
    }
    expect(writer.close());
  }

  std::unique_ptr<OpenStore> open(const TileSet& set, const std::string& path) const override {
    return std::make_unique<SlfStore>(set, path);
  }
};

}  // namespace

std::unique_ptr<StorePeer> make_slf() { return std::make_unique<Slf>(); }

}  // namespace slf::bench

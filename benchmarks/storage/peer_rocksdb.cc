// RocksDB: compacted, without compression (payloads are compressed), with all blocks in its cache.
#include <rocksdb/cache.h>
#include <rocksdb/db.h>
#include <rocksdb/filter_policy.h>
#include <rocksdb/table.h>

#include "benchmarks/storage/expect.h"
#include "benchmarks/storage/store_peer.h"

namespace slf::bench {
namespace {

constexpr std::size_t kCacheBytes = std::size_t{1} << 30;

std::string key_of(const TileSet& set, std::size_t tile) {
  std::string key(8, '\0');
  store_be<std::uint64_t>(reinterpret_cast<std::byte*>(key.data()), set.keys[tile]);
  return key;
}

void check(const rocksdb::Status& status) { require(status.ok(), "RocksDB: " + status.ToString()); }

rocksdb::Options options() {
  rocksdb::BlockBasedTableOptions table;
  table.block_cache = rocksdb::NewLRUCache(kCacheBytes);
  table.filter_policy.reset(rocksdb::NewBloomFilterPolicy(10));
  rocksdb::Options options;
  options.compression = rocksdb::kNoCompression;
  options.table_factory.reset(rocksdb::NewBlockBasedTableFactory(table));
  return options;
}

class RocksReader final : public StoreReader {
 public:
  RocksReader(const TileSet& set, rocksdb::DB& database) : StoreReader(set), database_(database) {}

  ByteSpan get(std::size_t tile) override {
    value_.Reset();
    check(database_.Get({}, database_.DefaultColumnFamily(), key_of(set(), tile), &value_));
    return {reinterpret_cast<const std::byte*>(value_.data()), value_.size()};
  }

 private:
  rocksdb::DB& database_;
  rocksdb::PinnableSlice value_;
};

class RocksStore final : public OpenStore {
 public:
  RocksStore(const TileSet& set, const std::string& path) : set_(set) {
    rocksdb::DB* database = nullptr;
    check(rocksdb::DB::OpenForReadOnly(options(), path, &database));
    database_.reset(database);
  }
  std::unique_ptr<StoreReader> reader() const override {
    return std::make_unique<RocksReader>(set_, *database_);
  }

 private:
  const TileSet& set_;
  std::unique_ptr<rocksdb::DB> database_;
};

class Rocks final : public StorePeer {
 public:
  std::string name() const override { return "RocksDB"; }

  void write(const TileSet& set, const std::string& path) const override {
    rocksdb::Options bulk = options();
    bulk.create_if_missing = true;
    bulk.PrepareForBulkLoad();
    rocksdb::DB* opened = nullptr;
    check(rocksdb::DB::Open(bulk, path, &opened));
    const std::unique_ptr<rocksdb::DB> database(opened);
    rocksdb::WriteOptions unlogged;
    unlogged.disableWAL = true;
    for (std::size_t i = 0; i < set.size(); ++i)
      check(database->Put(
          unlogged, key_of(set, i),
          {reinterpret_cast<const char*>(set.payloads[i].data()), set.payloads[i].size()}));
    check(database->Flush({}));
    check(database->CompactRange({}, nullptr, nullptr));
    check(database->Close());
  }

  std::unique_ptr<OpenStore> open(const TileSet& set, const std::string& path) const override {
    return std::make_unique<RocksStore>(set, path);
  }
};

}  // namespace

std::unique_ptr<StorePeer> make_rocksdb() { return std::make_unique<Rocks>(); }

}  // namespace slf::bench

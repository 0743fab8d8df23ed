// StorePeer: the common interface of stores for encoded tiles, ours and others.
//
// A new peer is one file that implements it and one line in store_peers.cc.
#pragma once

#include <memory>
#include <span>
#include <string>
#include <vector>

#include "benchmarks/storage/tile_set.h"

namespace slf::bench {

/// Reads tiles. One per thread.
class StoreReader {
 public:
  virtual ~StoreReader() = default;

  /// A hint: the tiles that will be read next. Stores may prefetch them.
  virtual void ahead(std::span<const std::size_t> /*tiles*/) {}

  /// A tile's payload, checked if the store checks payloads. Valid until the next call.
  /// Empty for picture formats, which decode while they read.
  virtual ByteSpan get(std::size_t tile) = 0;

  /// get() and decode.
  virtual void read(std::size_t tile, Bytes& samples) { set().decode(tile, get(tile), samples); }

 protected:
  explicit StoreReader(const TileSet& set) : set_(&set) {}
  [[nodiscard]] const TileSet& set() const { return *set_; }

 private:
  const TileSet* set_;
};

/// An open store. Thread-safety: reader() may be called from many threads at once.
class OpenStore {
 public:
  virtual ~OpenStore() = default;
  [[nodiscard]] virtual std::unique_ptr<StoreReader> reader() const = 0;
};

class StorePeer {
 public:
  virtual ~StorePeer() = default;
  [[nodiscard]] virtual std::string name() const = 0;

  /// Whether this is not a store but a bound: it uses knowledge that users do not have.
  [[nodiscard]] virtual bool is_bound() const { return false; }

  /// Whether the store can hold the tiles of this set.
  [[nodiscard]] virtual bool can_store(const TileSet&) const { return true; }

  /// Whether get() returns payloads.
  [[nodiscard]] virtual bool returns_payloads() const { return true; }

  /// Writes the tiles to `path`, a file or a folder, which does not exist.
  virtual void write(const TileSet& set, const std::string& path) const = 0;

  /// Opens the output of write(), with the fastest settings. `set` must outlive the store.
  [[nodiscard]] virtual std::unique_ptr<OpenStore> open(const TileSet& set,
                                                        const std::string& path) const = 0;
};

[[nodiscard]] std::unique_ptr<StorePeer> make_slf();
[[nodiscard]] std::unique_ptr<StorePeer> make_flat(bool hints);
[[nodiscard]] std::unique_ptr<StorePeer> make_sqlite(bool mapped);
[[nodiscard]] std::unique_ptr<StorePeer> make_rocksdb();
[[nodiscard]] std::unique_ptr<StorePeer> make_hdf5();
[[nodiscard]] std::unique_ptr<StorePeer> make_tiff();

/// Ours first, then every peer whose library was found by the build.
[[nodiscard]] std::vector<std::unique_ptr<StorePeer>> store_peers();

/// Names of the peers that are left out.
[[nodiscard]] std::vector<std::string> missing_peers();

}  // namespace slf::bench

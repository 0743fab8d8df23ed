// StorePeer: a way to keep encoded tiles in files, ours or another's, behind one interface.
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

  /// Tiles that will be asked for next, for stores that can make use of it.
  virtual void ahead(std::span<const std::size_t> /*tiles*/) {}

  /// A tile's payload, checked where the store checks. Valid until the next call.
  /// A picture format, which decodes as it reads, returns nothing.
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

  /// A bound, not a product: what could be reached with more knowledge than a user has.
  [[nodiscard]] virtual bool bound() const { return false; }

  /// Whether tiles of this set can be kept.
  [[nodiscard]] virtual bool holds(const TileSet&) const { return true; }

  /// Whether get() alone means anything.
  [[nodiscard]] virtual bool gets() const { return true; }

  /// Writes the tiles to `path`, a file or a folder, which does not exist.
  virtual void write(const TileSet& set, const std::string& path) const = 0;

  /// Opens what write() made, as fast as the store can be used. `set` must outlive the store.
  [[nodiscard]] virtual std::unique_ptr<OpenStore> open(const TileSet& set,
                                                        const std::string& path) const = 0;
};

[[nodiscard]] std::unique_ptr<StorePeer> make_slf();
[[nodiscard]] std::unique_ptr<StorePeer> make_flat(bool hints);
[[nodiscard]] std::unique_ptr<StorePeer> make_sqlite(bool mapped);
[[nodiscard]] std::unique_ptr<StorePeer> make_rocksdb();
[[nodiscard]] std::unique_ptr<StorePeer> make_hdf5();
[[nodiscard]] std::unique_ptr<StorePeer> make_tiff();

/// Ours first, then every peer whose library was there when this was built.
[[nodiscard]] std::vector<std::unique_ptr<StorePeer>> store_peers();

/// Names of the peers that are left out.
[[nodiscard]] std::vector<std::string> missing_peers();

}  // namespace slf::bench

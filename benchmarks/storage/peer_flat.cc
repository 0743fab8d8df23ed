// A flat file of payloads with its index in memory, read with pread: the minimum work of a store,
// without any check. With hints, it prefetches the tiles that will be read next, as ours does.
#include <fcntl.h>
#include <unistd.h>

#include <fstream>

#include "benchmarks/storage/expect.h"
#include "benchmarks/storage/store_peer.h"

namespace slf::bench {
namespace {

class FlatStore final : public OpenStore {
 public:
  FlatStore(const TileSet& tiles, const std::string& path, bool told) : set(tiles), hints(told) {
    file = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
    require(file >= 0, path + ": cannot open");
    (void)posix_fadvise(file, 0, 0, POSIX_FADV_RANDOM);
    std::ifstream index(path + ".index", std::ios::binary);
    begin.resize(tiles.size() + 1);
    index.read(reinterpret_cast<char*>(begin.data()),
               static_cast<std::streamsize>(begin.size() * sizeof(begin[0])));
    require(index.good(), path + ".index: cannot read");
  }
  ~FlatStore() override { ::close(file); }
  std::unique_ptr<StoreReader> reader() const override;

  const TileSet& set;
  const bool hints;
  int file = -1;
  std::vector<std::uint64_t> begin;
};

class FlatReader final : public StoreReader {
 public:
  explicit FlatReader(const FlatStore& store) : StoreReader(store.set), store_(store) {}

  void ahead(std::span<const std::size_t> tiles) override {
    if (!store_.hints) return;
    for (const std::size_t tile : tiles)
      (void)posix_fadvise(store_.file, offset(tile), size(tile), POSIX_FADV_WILLNEED);
  }

  ByteSpan get(std::size_t tile) override {
    payload_.resize(static_cast<std::size_t>(size(tile)));
    require(pread(store_.file, payload_.data(), payload_.size(), offset(tile)) == size(tile),
            "flat file: short read");
    return payload_;
  }

 private:
  off_t offset(std::size_t tile) const { return static_cast<off_t>(store_.begin[tile]); }
  off_t size(std::size_t tile) const {
    return static_cast<off_t>(store_.begin[tile + 1] - store_.begin[tile]);
  }

  const FlatStore& store_;
  Bytes payload_;
};

std::unique_ptr<StoreReader> FlatStore::reader() const {
  return std::make_unique<FlatReader>(*this);
}

class Flat final : public StorePeer {
 public:
  explicit Flat(bool hints) : hints_(hints) {}
  std::string name() const override { return hints_ ? "flat, pread, hints" : "flat, pread"; }
  bool is_bound() const override { return hints_; }

  void write(const TileSet& set, const std::string& path) const override {
    std::ofstream file(path, std::ios::binary);
    std::vector<std::uint64_t> begin{0};
    for (const Bytes& payload : set.payloads) {
      file.write(reinterpret_cast<const char*>(payload.data()),
                 static_cast<std::streamsize>(payload.size()));
      begin.push_back(begin.back() + payload.size());
    }
    std::ofstream index(path + ".index", std::ios::binary);
    index.write(reinterpret_cast<const char*>(begin.data()),
                static_cast<std::streamsize>(begin.size() * sizeof(begin[0])));
    file.close();
    index.close();
    require(file.good() && index.good(), path + ": cannot write");
  }

  std::unique_ptr<OpenStore> open(const TileSet& set, const std::string& path) const override {
    return std::make_unique<FlatStore>(set, path, hints_);
  }

 private:
  bool hints_;
};

}  // namespace

std::unique_ptr<StorePeer> make_flat(bool hints) { return std::make_unique<Flat>(hints); }

}  // namespace slf::bench

// HDF5: a chunked dataset with one tile per chunk; payloads are written and read as raw chunks. The
// library has one global lock.
#include <hdf5.h>

#include <algorithm>
#include <mutex>

#include "benchmarks/storage/expect.h"
#include "benchmarks/storage/store_peer.h"

namespace slf::bench {
namespace {

std::mutex library;

struct Hdf5Store final : OpenStore {
  Hdf5Store(const TileSet& tiles, const std::string& path) : set(tiles) {
    const std::lock_guard lock(library);
    const hid_t access = H5Pcreate(H5P_FILE_ACCESS);
    H5Pset_libver_bounds(access, H5F_LIBVER_LATEST, H5F_LIBVER_LATEST);
    file = H5Fopen(path.c_str(), H5F_ACC_RDONLY, access);
    H5Pclose(access);
    data = file < 0 ? -1 : H5Dopen2(file, "tiles", H5P_DEFAULT);
    require(data >= 0, path + ": HDF5 cannot open");
  }
  ~Hdf5Store() override {
    const std::lock_guard lock(library);
    H5Dclose(data);
    H5Fclose(file);
  }
  std::unique_ptr<StoreReader> reader() const override;

  const TileSet& set;
  hid_t file = -1, data = -1;
};

class Hdf5Reader final : public StoreReader {
 public:
  explicit Hdf5Reader(const Hdf5Store& store) : StoreReader(store.set), store_(store) {}

  ByteSpan get(std::size_t tile) override {
    const std::lock_guard lock(library);
    const hsize_t place[2] = {tile, 0};
    hsize_t bytes = 0;
    require(H5Dget_chunk_storage_size(store_.data, place, &bytes) >= 0, "HDF5: no such chunk");
    payload_.resize(bytes);
    std::uint32_t filters = 0;
    require(H5Dread_chunk(store_.data, H5P_DEFAULT, place, &filters, payload_.data()) >= 0,
            "HDF5: cannot read a chunk");
    return payload_;
  }

 private:
  const Hdf5Store& store_;
  Bytes payload_;
};

std::unique_ptr<StoreReader> Hdf5Store::reader() const {
  return std::make_unique<Hdf5Reader>(*this);
}

class Hdf5 final : public StorePeer {
 public:
  std::string name() const override { return "HDF5 chunks"; }

  void write(const TileSet& set, const std::string& path) const override {
    std::size_t largest = 1;
    for (const Bytes& payload : set.payloads) largest = std::max(largest, payload.size());
    const hsize_t extent[2] = {set.size(), largest};
    const hsize_t chunk[2] = {1, largest};
    const std::lock_guard lock(library);
    const hid_t access = H5Pcreate(H5P_FILE_ACCESS);
    H5Pset_libver_bounds(access, H5F_LIBVER_LATEST, H5F_LIBVER_LATEST);
    const hid_t file = H5Fcreate(path.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, access);
    const hid_t space = H5Screate_simple(2, extent, nullptr);
    const hid_t layout = H5Pcreate(H5P_DATASET_CREATE);
    H5Pset_chunk(layout, 2, chunk);
    H5Pset_shuffle(layout);  // only a dataset with a filter may have chunks of any length
    H5Pset_fill_time(layout, H5D_FILL_TIME_NEVER);
    const hid_t data =
        H5Dcreate2(file, "tiles", H5T_STD_U8LE, space, H5P_DEFAULT, layout, H5P_DEFAULT);
    require(data >= 0, path + ": HDF5 cannot create");
    constexpr std::uint32_t kWithoutFilter = 1;
    for (std::size_t i = 0; i < set.size(); ++i) {
      const hsize_t place[2] = {i, 0};
      require(H5Dwrite_chunk(data, H5P_DEFAULT, kWithoutFilter, place, set.payloads[i].size(),
                             set.payloads[i].data()) >= 0,
              "HDF5: cannot write a chunk");
    }
    H5Dclose(data);
    H5Pclose(layout);
    H5Sclose(space);
    H5Fclose(file);
    H5Pclose(access);
  }

  std::unique_ptr<OpenStore> open(const TileSet& set, const std::string& path) const override {
    return std::make_unique<Hdf5Store>(set, path);
  }
};

}  // namespace

std::unique_ptr<StorePeer> make_hdf5() { return std::make_unique<Hdf5>(); }

}  // namespace slf::bench

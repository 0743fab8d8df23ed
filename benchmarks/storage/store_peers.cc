#include "benchmarks/storage/store_peer.h"

namespace slf::bench {

std::vector<std::unique_ptr<StorePeer>> store_peers() {
  std::vector<std::unique_ptr<StorePeer>> peers;
  peers.push_back(make_slf());
  peers.push_back(make_flat(false));
  peers.push_back(make_flat(true));
#ifdef SLF_WITH_SQLITE
  peers.push_back(make_sqlite(false));
  peers.push_back(make_sqlite(true));
#endif
#ifdef SLF_WITH_ROCKSDB
  peers.push_back(make_rocksdb());
#endif
#ifdef SLF_WITH_HDF5
  peers.push_back(make_hdf5());
#endif
#ifdef SLF_WITH_TIFF
  peers.push_back(make_tiff());
#endif
  return peers;
}

std::vector<std::string> missing_peers() {
  std::vector<std::string> names;
#ifndef SLF_WITH_SQLITE
  names.emplace_back("SQLite");
#endif
#ifndef SLF_WITH_ROCKSDB
  names.emplace_back("RocksDB");
#endif
#ifndef SLF_WITH_HDF5
  names.emplace_back("HDF5");
#endif
#ifndef SLF_WITH_TIFF
  names.emplace_back("BigTIFF");
#endif
  return names;
}

}  // namespace slf::bench

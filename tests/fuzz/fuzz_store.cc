// Any bytes as a container: opening, every way of reading, and the structure check neither crash
// nor hang. The same bytes as one record and as one container blob, with checksums that fit, reach
// what a checksum of the whole file would keep from a fuzzer.
#include <sys/mman.h>
#include <unistd.h>

#include <cstdint>
#include <cstdlib>
#include <string>
#include <vector>

#include "storage/internal/container.h"
#include "storage/internal/record.h"
#include "storage/tile_store.h"

namespace {

using namespace slf;
using namespace slf::storage;

std::uint64_t touched = 0;

void touch(ByteSpan bytes) {
  for (const std::byte b : bytes) touched += static_cast<std::uint64_t>(b);
}

void read_store(const TileStore& store) {
  for (const char* name : {"manifest.json", "container", ""})
    if (auto blob = store.blob(name)) touch(*blob);
  std::vector<TileRef> tiles;
  TileKey before;
  bool any = false;
  (void)store.visit(
      {0, 0}, {255, ~std::uint64_t{0}},
      [&](const TileRef& tile) -> Result<void> {
        if (any && tile.key <= before) std::abort();
        before = tile.key;
        any = true;
        const FileRange range = store.range(tile);
        if (range.end > store.file_bytes() || range.begin > range.end) std::abort();
        (void)store.check(tile);
        touch(tile.payload);
        if (tiles.size() < 64) tiles.push_back(tile);
        return {};
      },
      [](const Damage&) {});
  const std::vector<TileKey> keys{{0, 0}, {0, 3}, {1, 4000}, {254, 1}, {0, 3, 1}, {0, 3, 4095}};
  for (const TileKey key : keys)
    if (auto tile = store.find(key)) (void)store.check(*tile);
  (void)store.find_all(keys);
  (void)store.statistics({{}, {255, 0}});
  (void)store.covered({{}, {255, 0}});
  store.advise(tiles);
  store.release(tiles);
  std::vector<Error> findings;
  store.check_structure(findings);
  if (findings.size() > 1000) std::abort();
}

void read_record(Bytes bytes, std::uint32_t magic) {
  if (bytes.size() < internal::kRecordHeader) return;
  const std::size_t table = internal::Record::table_end(bytes);
  store_le<std::uint32_t>(&bytes[8], magic);
  if (table <= bytes.size())
    store_le(bytes.data(), internal::checksum(ByteSpan(bytes).subspan(8, table - 8)));
  const auto record = internal::Record::parse(bytes);
  if (!record) return;
  for (internal::Record::Walk walk(*record); walk.next();) touch(walk.tile().payload);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const ByteSpan bytes = std::as_bytes(std::span(data, size));
  for (const std::uint32_t magic : {0x32524C53, 0x33524C53})
    read_record(Bytes(bytes.begin(), bytes.end()), magic);
  (void)internal::decode_container(bytes);

  const int file = memfd_create("store", MFD_CLOEXEC);
  if (file < 0 || write(file, data, size) != static_cast<ssize_t>(size)) std::abort();
  if (auto store = TileStore::open("/proc/self/fd/" + std::to_string(file))) read_store(*store);
  close(file);
  return 0;
}

// Any bytes as a container that is read by ranges, as over HTTP: opening and finding neither crash
// nor hang, and payloads lie within the file. The same bytes as an index and as one of its
// sections, with checksums that fit, reach what checksums would keep from a fuzzer.
#include <algorithm>
#include <cstdint>
#include <cstdlib>

#include "storage/internal/record.h"
#include "storage/ranged_store.h"

namespace {

using namespace slf;
using namespace slf::storage;

void require(bool promise) {
  if (!promise) std::abort();
}

/// Gives a store what it wants until a call succeeds or fails for another reason.
template <class Call>
auto complete(RangedStore& store, ByteSpan file, const Call& call) {
  constexpr int kMaxRounds = 200;
  for (int round = 0;; ++round) {
    auto result = call();
    const auto needed = store.take_needed_ranges();
    if (result || needed.empty()) return result;
    require(round < kMaxRounds);
    std::uint64_t last = 0;
    for (const FileRange& range : needed) {
      require(last <= range.begin && range.begin < range.end && range.end <= file.size());
      last = range.end;
      const ByteSpan bytes = file.subspan(range.begin, range.end - range.begin);
      store.add(range.begin, Bytes(bytes.begin(), bytes.end()));
    }
  }
}

void read_file(ByteSpan file) {
  RangedStore store("input", file.size());
  if (!complete(store, file, [&] { return store.open(); })) return;
  for (const char* name : {"manifest.json", "container", ""})
    (void)complete(store, file, [&] { return store.blob(name); });
  for (const TileKey key : {TileKey{0, 0}, TileKey{0, 3}, TileKey{1, 0}, TileKey{1, 4000},
                            TileKey{254, 1}, in_state({0, 3}, 1)}) {
    const auto found = complete(store, file, [&] { return store.find(key); });
    if (found && found->state == TileState::stored)
      require(found->payload.begin <= found->payload.end && found->payload.end <= file.size());
  }
}

void read_index(ByteSpan bytes) {
  if (bytes.size() < internal::kIndexFooter) return;
  const std::uint64_t size = internal::FileIndex::size(bytes.last(internal::kIndexFooter));
  if (size == 0 || size > bytes.size()) return;
  Bytes end(bytes.end() - static_cast<std::ptrdiff_t>(size), bytes.end());
  std::byte* const footer = end.data() + end.size() - internal::kIndexFooter;
  store_le<std::uint64_t>(footer, 0);
  store_le(footer, internal::checksum(end));
  if (const auto index = internal::FileIndex::parse(end, bytes.size()))
    for (const auto& section : index->sections)
      require(section.range.begin <= section.range.end && section.range.end <= bytes.size());
}

void read_section(ByteSpan bytes) {
  constexpr std::uint64_t kFileBytes = 1 << 20;
  const internal::IndexSection section{
      internal::kCoreSection, {0, bytes.size()}, internal::checksum(bytes)};
  (void)internal::open_section(section, bytes, kFileBytes, [](std::uint64_t offset, ByteSpan part) {
    require(offset <= kFileBytes && part.size() <= kFileBytes - offset);
  });
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const ByteSpan bytes = std::as_bytes(std::span(data, size));
  read_file(bytes);
  read_index(bytes);
  read_section(bytes);
  return 0;
}

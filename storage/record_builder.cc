#include "storage/internal/record_builder.h"

#include <algorithm>
#include <cassert>
#include <iterator>
#include <utility>

namespace slf::storage::internal {
namespace {

// A resumed build must end its records at the same tiles, on any machine. So these sizes do not
// depend on the machine's page size.
constexpr std::size_t kPage = 4096;
constexpr std::size_t kPageHead = 16;
constexpr std::size_t kSmall = 16 * kPage - kPageHead;
constexpr std::size_t kLarge = 64 * kPage - kPageHead;

constexpr std::size_t unused(std::size_t bytes) {
  return (kPage - (bytes + kPageHead) % kPage) % kPage;
}

}  // namespace

void CutRecord::write(std::span<std::byte> to) const {
  std::size_t end = 0;
  const auto put = [&](ByteSpan part) {
    std::ranges::fill(to.subspan(end, align8(end) - end), std::byte{0});
    end = align8(end);
    std::ranges::copy(part, to.subspan(end).begin());
    end += part.size();
  };
  put(head);
  for (const Payload& payload : payloads) put(payload.bytes());
  std::ranges::fill(to.subspan(end, bytes - end), std::byte{0});
}

void RecordBuilder::append(NewTile tile, std::vector<CutRecord>& out) {
  assert(!last() || *last() < tile.key);
  add({std::move(tile), 0}, out);
}

void RecordBuilder::keep_payloads() {
  for (Held& tile : held_) tile.payload.keep();
}

void RecordBuilder::finish(std::vector<CutRecord>& out) {
  if (!held_.empty()) cut(held_.size(), out);
}

void RecordBuilder::add(Held tile, std::vector<CutRecord>& out) {
  while (!held_.empty()) {
    const TileKey first = held_.front().key;
    if (tile.key.level != first.level || tile.key.index - first.index >= kMaxTiles) {
      cut(held_.size(), out);
    } else if (held_.back().record_bytes + tile.payload.bytes().size() > kLarge) {
      cut(best_cut(), out);
    } else {
      break;
    }
  }
  const std::uint64_t skipped = held_.empty() ? 0 : tile.key.index - held_.back().key.index - 1;
  code_bytes_ += skipped + code_bytes(tile.payload.bytes().size());
  stored_ += tile.payload.bytes().empty() ? 0 : 1;
  payload_bytes_ += align8(tile.payload.bytes().size());
  tile.record_bytes = align8(kRecordHeader + code_bytes_) + 8 * stored_ + payload_bytes_;
  held_.push_back(std::move(tile));

  const std::size_t bytes = held_.back().record_bytes;
  if (bytes >= kSmall && (bytes > kLarge || unused(bytes) <= bytes / 256)) cut(held_.size(), out);
}

// How many tiles to cut so that the record wastes the smallest share of its pages.
std::size_t RecordBuilder::best_cut() const {
  std::size_t best = held_.size();
  double least = 1;
  for (std::size_t n = 1; n <= held_.size(); ++n) {
    const std::size_t bytes = held_[n - 1].record_bytes;
    const double share = static_cast<double>(unused(bytes)) / static_cast<double>(bytes);
    if (bytes >= kSmall && share < least) {
      least = share;
      best = n;
    }
  }
  return best;
}

void RecordBuilder::cut(std::size_t tiles, std::vector<CutRecord>& out) {
  const TileKey first = held_.front().key;
  const TileKey last = held_[tiles - 1].key;
  std::vector<Tile> table(last.index - first.index + 1);
  CutRecord record{layer_, last, {}, {}, 0};
  std::size_t payload_bytes = 0;
  for (std::size_t i = 0; i < tiles; ++i) {
    Held& held = held_[i];
    Tile& tile = table[held.key.index - first.index];
    tile.state = held.state;
    tile.payload = held.payload.bytes();
    if (tile.payload.empty()) continue;
    tile.checksum =
        held.checksum ? *held.checksum : payload_checksum(layer_, held.key, tile.payload);
    payload_bytes = align8(payload_bytes) + tile.payload.size();
    record.payloads.push_back(std::move(held.payload));
  }
  record.head = encode_record_head(layer_, previous_, first, table);
  record.bytes = std::max(record.head.size() + payload_bytes, kMinRecordBytes);
  out.push_back(std::move(record));
  previous_ = last;

  // The remaining tiles begin the next record, as if they were appended now.
  std::vector<Held> rest(
      std::make_move_iterator(held_.begin() + static_cast<std::ptrdiff_t>(tiles)),
      std::make_move_iterator(held_.end()));
  held_.clear();
  code_bytes_ = stored_ = payload_bytes_ = 0;
  for (Held& tile : rest) add(std::move(tile), out);
}

}  // namespace slf::storage::internal

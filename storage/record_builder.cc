#include "storage/internal/record_builder.h"

#include <algorithm>
#include <cassert>
#include <iterator>
#include <utility>

#include "storage/internal/pages.h"

namespace slf::storage::internal {
namespace {

// A resumed build must end its records at the same tiles, on any machine.
constexpr std::size_t kSmallRecord = 16 * kPageSize - kPageHeader;
constexpr std::size_t kLargeRecord = 64 * kPageSize - kPageHeader;

constexpr std::size_t unused(std::size_t bytes) {
  return (kPageSize - (bytes + kPageHeader) % kPageSize) % kPageSize;
}

}  // namespace

std::size_t CompleteRecord::bytes() const {
  std::size_t end = head.size();
  for (const ByteSpan payload : payloads) end = align8(end) + payload.size();
  return std::max(end, kMinRecordBytes);
}

void CompleteRecord::write(std::span<std::byte> to) const {
  std::size_t end = 0;
  const auto put = [&](ByteSpan part) {
    std::ranges::fill(to.subspan(end, align8(end) - end), std::byte{0});
    end = align8(end);
    std::ranges::copy(part, to.subspan(end).begin());
    end += part.size();
  };
  put(head);
  for (const ByteSpan payload : payloads) put(payload);
  std::ranges::fill(to.subspan(end), std::byte{0});
}

void RecordBuilder::append(NewTile tile, std::vector<CompleteRecord>& out) {
  assert(!last() || *last() < tile.key);
  while (!pending_.empty()) {
    const TileKey first = pending_.front().key;
    if (tile.key.level != first.level || tile.key.state != first.state ||
        tile.key.index - first.index >= kMaxTiles) {
      end_record(pending_.size(), out);
    } else if (pending_.back().record_bytes + tile.payload.size() > kLargeRecord) {
      end_record(best_record_end(), out);
    } else {
      break;
    }
  }
  const std::uint64_t skipped =
      pending_.empty() ? 0 : tile.key.index - pending_.back().key.index - 1;
  code_bytes_ += skipped + code_bytes({tile.state, tile.payload, 0, 0, 0, tile.back});
  stored_ += tile.payload.empty() ? 0 : 1;
  payload_bytes_ += align8(tile.payload.size());
  tile.record_bytes = align8(kRecordHeader + code_bytes_) + 8 * stored_ + payload_bytes_;
  pending_.push_back(std::move(tile));

  const std::size_t bytes = pending_.back().record_bytes;
  if (bytes >= kSmallRecord && (bytes > kLargeRecord || unused(bytes) <= bytes / 256))
    end_record(pending_.size(), out);
}

void RecordBuilder::finish(std::vector<CompleteRecord>& out) {
  if (!pending_.empty()) end_record(pending_.size(), out);
}

// How many tiles to cut so that the record wastes the smallest share of its pages.
std::size_t RecordBuilder::best_record_end() const {
  std::size_t best = pending_.size();
  double min_share = 1;
  for (std::size_t n = 1; n <= pending_.size(); ++n) {
    const std::size_t bytes = pending_[n - 1].record_bytes;
    const double share = static_cast<double>(unused(bytes)) / static_cast<double>(bytes);
    if (bytes >= kSmallRecord && share < min_share) {
      min_share = share;
      best = n;
    }
  }
  return best;
}

void RecordBuilder::end_record(std::size_t tiles, std::vector<CompleteRecord>& out) {
  const TileKey first = pending_.front().key;
  const TileKey last = pending_[tiles - 1].key;
  std::vector<Tile> table(last.index - first.index + 1);
  CompleteRecord record{last, {}, {}};
  for (std::size_t i = 0; i < tiles; ++i) {
    NewTile& pending = pending_[i];
    Tile& tile = table[pending.key.index - first.index];
    tile.state = pending.state;
    tile.back = pending.back;
    if (pending.payload.empty()) continue;
    record.own.push_back(std::move(pending.payload));
    tile.payload = record.payloads.emplace_back(record.own.back());
    tile.checksum = payload_checksum(pending.key, tile.payload);
  }
  record.head = encode_record_head(previous_, first, table);
  out.push_back(std::move(record));
  previous_ = last;

  // The remaining tiles begin the next record, as if they were appended now.
  std::vector<NewTile> rest(
      std::make_move_iterator(pending_.begin() + static_cast<std::ptrdiff_t>(tiles)),
      std::make_move_iterator(pending_.end()));
  pending_.clear();
  code_bytes_ = stored_ = payload_bytes_ = 0;
  for (NewTile& tile : rest) append(std::move(tile), out);
}

}  // namespace slf::storage::internal

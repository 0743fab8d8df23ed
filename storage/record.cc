#include "storage/internal/record.h"

#include <xxhash.h>

#include <algorithm>
#include <cassert>

#include "base/varint.h"

namespace slf::storage::internal {
namespace {

constexpr std::uint32_t kRecordMagic = 0x32524C53;    // "SLR2"
constexpr std::uint32_t kWithSameMagic = 0x33524C53;  // "SLR3"
constexpr std::uint64_t kEmpty = 0;
constexpr std::uint64_t kMissing = 1;
constexpr std::uint64_t kSame = 2;   ///< if the record has such tiles: how many states back follows
constexpr std::size_t kMaxCode = 5;  ///< bytes of the longest code, that of kMaxPayload + 1
constexpr int kStateBit = 50;        ///< of a packed index

std::uint64_t code_of(const Tile& tile, bool has_same) {
  switch (tile.state) {
    case TileState::empty:
      return kEmpty;
    case TileState::missing:
      return kMissing;
    case TileState::same:
      return kSame;
    case TileState::stored:
      return tile.payload.size() + (has_same ? 2 : 1);
  }
  return kMissing;
}

/// Takes the code of a tile from a table: its state, `size` and `back`. None: it is damaged.
std::optional<Tile> take_code(ByteSpan& table, bool has_same) {
  const auto code = take_varint(table);
  if (!code) return std::nullopt;
  Tile tile;
  if (*code == kEmpty) tile.state = TileState::empty;
  if (*code <= kMissing) return tile;
  if (!has_same || *code != kSame) {
    tile.state = TileState::stored;
    tile.size = *code - (has_same ? 2 : 1);
    return tile;
  }
  const auto back = take_varint(table);
  if (!back || *back == 0 || *back >= kMaxStates) return std::nullopt;
  tile.state = TileState::same;
  tile.back = *back;
  return tile;
}

}  // namespace

std::uint64_t checksum(ByteSpan bytes, std::uint64_t seed) {
  return XXH3_64bits_withSeed(bytes.data(), bytes.size(), seed);
}

std::uint64_t packed_index(TileKey key) {
  return (std::uint64_t{key.state} << kStateBit) + key.index;
}

TileKey unpacked_key(std::uint8_t level, std::uint64_t packed) {
  return {level, packed & ((std::uint64_t{1} << kStateBit) - 1),
          static_cast<std::uint16_t>(packed >> kStateBit)};
}

RecordKey encode_key(TileKey last) {
  RecordKey key;
  key[0] = static_cast<std::byte>(last.level);
  store_be<std::uint64_t>(key.data() + 1, packed_index(last));
  return key;
}

std::optional<TileKey> decode_key(ByteSpan bytes) {
  if (bytes.size() != RecordKey{}.size()) return std::nullopt;
  return unpacked_key(static_cast<std::uint8_t>(bytes[0]),
                      load_be<std::uint64_t>(bytes.data() + 1));
}

std::size_t code_bytes(const Tile& tile) {
  return varint_bytes(code_of(tile, false)) +
         (tile.state == TileState::same ? varint_bytes(tile.back) : 0);
}

std::uint64_t Record::table_end(ByteSpan start) {
  return align8(kRecordHeader + load_le<std::uint16_t>(start.data() + 34)) +
         8 * std::uint64_t{load_le<std::uint16_t>(start.data() + 32)};
}

Result<Record> Record::parse(ByteSpan value, std::uint64_t size) {
  if (value.size() < kRecordHeader)
    return fail(ErrorCode::bad_file, "the record is shorter than its header");
  const std::byte* head = value.data();
  const auto magic = load_le<std::uint32_t>(head + 8);
  if (magic != kRecordMagic && magic != kWithSameMagic)
    return fail(ErrorCode::bad_file, "no tile record");
  Record record;
  record.has_same_ = magic == kWithSameMagic;
  record.value_ = value;
  record.size_ = size;
  record.first_ =
      unpacked_key(static_cast<std::uint8_t>(head[12]), load_le<std::uint64_t>(head + 16));
  record.count_ = load_le<std::uint16_t>(head + 14);
  record.stored_ = load_le<std::uint16_t>(head + 32);
  const std::size_t codes = load_le<std::uint16_t>(head + 34);
  if (const auto level = static_cast<std::uint8_t>(head[13]); level != kNoLevel)
    record.previous_ = unpacked_key(level, load_le<std::uint64_t>(head + 24));
  record.checksums_ = align8(kRecordHeader + codes);
  record.payloads_ = record.checksums_ + 8 * std::size_t{record.stored_};
  if (record.count_ == 0 || record.count_ > kMaxTiles || record.stored_ > record.count_ ||
      codes < record.count_ || codes > kMaxCode * record.count_ ||
      record.payloads_ > value.size() || record.first_.level == kNoLevel ||
      record.last().index >> kStateBit != 0)
    return fail(ErrorCode::bad_file, "the record's header is damaged");
  if (checksum(value.subspan(8, record.payloads_ - 8)) != load_le<std::uint64_t>(head))
    return fail(ErrorCode::bad_file, "the record's table does not match its checksum");
  if (record.previous_ && *record.previous_ >= record.first_)
    return fail(ErrorCode::bad_file, "the record claims to come after its own tiles");

  // A checksum can be forged: check that codes are complete and payloads are inside the value.
  ByteSpan table = value.subspan(kRecordHeader, codes);
  std::uint32_t stored = 0;
  std::uint64_t payload = record.payloads_;
  for (std::uint32_t i = 0; i < record.count_; ++i) {
    const auto tile = take_code(table, record.has_same_);
    if (!tile || tile->back > record.first_.state)
      return fail(ErrorCode::bad_file, "the record's table is damaged");
    if (tile->state != TileState::stored) continue;
    ++stored;
    payload = align8(payload);
    if (payload > size || tile->size > size - payload)
      return fail(ErrorCode::bad_file, "a payload leaves the record");
    payload += tile->size;
  }
  if (!table.empty() || stored != record.stored_)
    return fail(ErrorCode::bad_file, "the record's table is damaged");
  return record;
}

Record::Walk::Walk(const Record& record)
    : record_(&record),
      table_(record.value_.subspan(kRecordHeader, record.checksums_ - kRecordHeader)),
      payload_(record.payloads_) {}

// The file may change after the table was checked, so check the bounds here too.
bool Record::Walk::next() {
  if (position_ == record_->count_) return false;
  ++position_;
  const ByteSpan value = record_->value_;
  tile_ = take_code(table_, record_->has_same_).value_or(Tile());
  if (tile_.state != TileState::stored) return true;
  payload_ = align8(payload_);
  const std::uint64_t size = record_->size_;
  if (stored_ == record_->stored_ || payload_ > size || tile_.size > size - payload_) {
    tile_ = {};
    return true;
  }
  tile_.offset = payload_;
  if (value.size() == size) tile_.payload = value.subspan(payload_, tile_.size);
  tile_.checksum = load_le<std::uint64_t>(value.data() + record_->checksums_ + 8 * stored_);
  payload_ += tile_.size;
  ++stored_;
  return true;
}

Tile Record::tile(std::uint32_t position) const {
  assert(position < count_);
  Walk walk(*this);
  for (std::uint32_t i = 0; i <= position; ++i) (void)walk.next();
  return walk.tile();
}

Bytes encode_record_head(std::optional<TileKey> previous, TileKey first,
                         std::span<const Tile> tiles) {
  assert(!tiles.empty() && tiles.size() <= kMaxTiles);
  Bytes head(kRecordHeader);
  head.reserve(kRecordHeader + (kMaxCode + 8) * tiles.size());
  std::size_t stored = 0;
  const bool has_same = std::any_of(tiles.begin(), tiles.end(),
                                    [](const Tile& tile) { return tile.state == TileState::same; });
  for (const Tile& tile : tiles) {
    append_varint(head, code_of(tile, has_same));
    if (tile.state == TileState::same) append_varint(head, tile.back);
    if (tile.state == TileState::stored) ++stored;
  }
  const std::size_t codes = head.size() - kRecordHeader;
  head.resize(align8(head.size()));
  for (const Tile& tile : tiles)
    if (tile.state == TileState::stored) append_le<std::uint64_t>(head, tile.checksum);

  std::byte* at = head.data();
  store_le<std::uint32_t>(at + 8, has_same ? kWithSameMagic : kRecordMagic);
  at[12] = static_cast<std::byte>(first.level);
  at[13] = static_cast<std::byte>(previous ? previous->level : kNoLevel);
  store_le<std::uint16_t>(at + 14, static_cast<std::uint16_t>(tiles.size()));
  store_le<std::uint64_t>(at + 16, packed_index(first));
  store_le<std::uint64_t>(at + 24, previous ? packed_index(*previous) : 0);
  store_le<std::uint16_t>(at + 32, static_cast<std::uint16_t>(stored));
  store_le<std::uint16_t>(at + 34, static_cast<std::uint16_t>(codes));
  store_le<std::uint64_t>(at, checksum(ByteSpan(head).subspan(8)));
  return head;
}

}  // namespace slf::storage::internal

namespace slf::storage {

std::uint64_t payload_checksum(TileKey key, ByteSpan payload) {
  return internal::checksum(payload, internal::checksum(internal::encode_key(key)));
}

}  // namespace slf::storage

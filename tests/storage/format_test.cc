// The bytes of format version 1, and how many of them a container needs.
#include <gmock/gmock.h>

#include <iomanip>
#include <iostream>

#include "storage/internal/container.h"
#include "storage/internal/record.h"
#include "storage/internal/record_builder.h"
#include "tests/storage/storage_testing.h"

namespace slf::storage::testing {
namespace {

std::string hex(ByteSpan bytes) {
  std::ostringstream text;
  for (const std::byte b : bytes)
    text << std::hex << std::setw(2) << std::setfill('0') << static_cast<int>(b);
  return std::move(text).str();
}

Bytes encode_record(std::optional<TileKey> previous, TileKey first,
                    std::span<const internal::Tile> tiles) {
  internal::CompleteRecord record{{}, internal::encode_record_head(previous, first, tiles), {}};
  for (const internal::Tile& tile : tiles)
    if (tile.state == TileState::stored) record.payloads.emplace_back(tile.payload);
  Bytes bytes(record.bytes());
  record.write(bytes);
  return bytes;
}

internal::Tile stored(TileKey key, ByteSpan payload) {
  return {TileState::stored, payload, payload_checksum(key, payload)};
}

TEST(Format, ARecordIsTheseBytes) {
  const Bytes abc = bytes_of("abc");
  const Bytes long_one(200, std::byte{7});
  const std::vector<internal::Tile> tiles = {stored({2, 0x1122334455667788}, abc),
                                             {TileState::empty, {}, 0},
                                             {TileState::missing, {}, 0},
                                             stored({2, 0x112233445566778B}, long_one)};
  const Bytes record = encode_record(TileKey{2, 0x10}, {2, 0x1122334455667788}, tiles);
  ASSERT_EQ(record.size(), 2048u);
  EXPECT_EQ(hex(ByteSpan(record).first(72)),
            "2ba9e3b5073e8000534c5232020204008877665544332211"
            "100000000000000002000500040001c9"
            "0100000000000000"
            "cd7c5bcadce62a56"
            "d8e5a9b95fa36eab"
            "6162630000000000");
  EXPECT_EQ(hex(ByteSpan(record).subspan(72, 3)), "070707");
}

TEST(Format, ARecordWithTilesOfEarlierStatesIsTheseBytes) {
  const TileKey first = in_state({2, 7}, 300);
  const Bytes abc = bytes_of("abc");
  const std::vector<internal::Tile> tiles = {stored(first, abc),
                                             {TileState::same, {}, 0, 0, 0, 1},
                                             {TileState::empty, {}, 0},
                                             {TileState::same, {}, 0, 0, 0, 300},
                                             {TileState::missing, {}, 0}};
  const Bytes record = encode_record(std::nullopt, first, tiles);
  EXPECT_EQ(hex(ByteSpan(record).subspan(8, 40)),
            "534c523302ff0500"
            "070000000000b004"
            "0000000000000000"
            "010008000502010002ac0201"
            "00000000");
  const auto read = internal::Record::parse(record);
  ASSERT_TRUE(ok(read));
  std::vector<std::uint64_t> back;
  for (internal::Record::Walk walk(*read); walk.next();) {
    EXPECT_EQ(walk.tile().state, tiles[walk.position()].state);
    EXPECT_EQ(Bytes(walk.tile().payload.begin(), walk.tile().payload.end()),
              Bytes(tiles[walk.position()].payload.begin(), tiles[walk.position()].payload.end()));
    back.push_back(walk.tile().back);
  }
  EXPECT_EQ(back, (std::vector<std::uint64_t>{0, 1, 0, 300, 0}));
  // No state is before the first one.
  const auto early = encode_record(std::nullopt, in_state(first, 299), tiles);
  EXPECT_FALSE(internal::Record::parse(early));
}

TEST(Format, ARecordReadsBackAsWritten) {
  const Bytes abc = bytes_of("abc");
  const std::vector<internal::Tile> tiles = {stored({9, 5}, abc), {}, {TileState::empty, {}, 0}};
  const Bytes bytes = encode_record(std::nullopt, {9, 5}, tiles);
  const auto record = internal::Record::parse(bytes);
  ASSERT_TRUE(ok(record));
  EXPECT_EQ(record->first(), (TileKey{9, 5}));
  EXPECT_EQ(record->last(), (TileKey{9, 7}));
  EXPECT_FALSE(record->previous());
  EXPECT_EQ(record->tile(0).state, TileState::stored);
  EXPECT_TRUE(std::ranges::equal(record->tile(0).payload, abc));
  EXPECT_EQ(record->tile(1).state, TileState::missing);
  EXPECT_EQ(record->tile(2).state, TileState::empty);
}

// A checksum is no signature: a forged record may lie in every number and still has one that fits.
TEST(Format, ForgedRecordsAreRefusedOrHarmless) {
  const Bytes payload(100, std::byte{1});
  std::vector<internal::Tile> tiles;
  for (std::uint64_t i = 0; i < 20; ++i) tiles.push_back(stored({1, i}, payload));
  std::vector<Bytes> good = {encode_record(std::nullopt, {1, 0}, tiles)};
  for (std::size_t i = 0; i < 20; i += 3) tiles[i] = {TileState::same, {}, 0, 0, 0, 1 + i * 9};
  good.push_back(encode_record(std::nullopt, in_state({1, 0}, 200), tiles));
  std::mt19937 random(5);
  int accepted = 0;
  for (int round = 0; round < 200000; ++round) {
    Bytes forged = good[random() % good.size()];
    for (std::size_t n = random() % 3 + 1; n-- > 0;)
      forged[8 + random() % 72] = static_cast<std::byte>(random() % 4 == 0 ? 255 : random());
    forged.resize(random() % 8 == 0 ? random() % 300 : forged.size());
    forged.shrink_to_fit();
    const std::size_t table =
        forged.size() < internal::kRecordHeader ? 0 : internal::Record::table_end(forged);
    if (table >= 8 && table <= forged.size())
      store_le(forged.data(), internal::checksum(ByteSpan(forged).subspan(8, table - 8)));
    const auto record = internal::Record::parse(forged);
    if (!record) continue;
    ++accepted;
    for (internal::Record::Walk walk(*record); walk.next();) {
      EXPECT_LE(walk.tile().back, record->first().state);
      EXPECT_EQ(walk.tile().back > 0, walk.tile().state == TileState::same);
      const ByteSpan view = walk.tile().payload;
      const bool inside =
          view.empty() || (view.data() >= forged.data() &&
                           view.data() + view.size() <= forged.data() + forged.size());
      EXPECT_TRUE(inside);
    }
  }
  EXPECT_GT(accepted, 100);
}

TEST(Format, TheContainerBlobIsTheseBytes) {
  const Bytes blob = internal::encode_container({7, 3, TileKey{2, 0x0102}});
  EXPECT_EQ(hex(blob),
            "534c430202000000"
            "0700000000000000"
            "0300000000000000"
            "0201000000000000");
  for (std::size_t size = 0; size < blob.size(); ++size)
    EXPECT_FALSE(internal::decode_container(ByteSpan(blob).first(size))) << size;
  for (const std::uint8_t version : {1, 3}) {
    Bytes other = blob;
    other[3] = std::byte{version};
    EXPECT_EQ(internal::decode_container(other).error().code, ErrorCode::unsupported);
  }
  EXPECT_TRUE(ok(internal::decode_container(blob)));
}

// Random sizes around `mean`, as codecs give them.
double file_over_payload(std::size_t mean, bool constant) {
  TemporaryFolder folder;
  const std::string path = folder / "a.slf";
  std::mt19937 random(4);
  std::uint64_t payload = 0;
  TileWriter writer = create(path);
  for (std::uint64_t i = 0; payload < 24'000'000; ++i) {
    const std::size_t size = constant ? mean : mean / 2 + random() % mean;
    EXPECT_TRUE(ok(writer.append({5, i}, Bytes(size, std::byte{1}))));
    payload += size;
    if (writer.pending_bytes() > 4'000'000) {
      EXPECT_TRUE(ok(writer.commit()));
    }
  }
  EXPECT_TRUE(ok(writer.close()));
  return static_cast<double>(std::filesystem::file_size(path)) / static_cast<double>(payload);
}

TEST(Format, AContainerIsLittleLargerThanItsPayloads) {
  for (const std::size_t mean : {1u, 2u, 4u, 8u, 16u, 24u, 32u, 48u, 64u}) {
    const double random = file_over_payload(mean * 1024, false);
    const double constant = file_over_payload(mean * 1024, true);
    std::cout << "tiles of " << mean << " KiB: file / payload " << std::fixed
              << std::setprecision(4) << random << " (random sizes), " << constant
              << " (one size)\n";
    EXPECT_LE(random, 1.06) << mean;
    EXPECT_LE(constant, 1.06) << mean;
  }
}

}  // namespace
}  // namespace slf::storage::testing

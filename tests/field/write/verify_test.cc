#include "slf/verify.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>

#include "field/field_file.h"
#include "slf/repack.h"
#include "storage/internal/file_index.h"
#include "storage/tile_writer.h"
#include "tests/field/write/rewriting.h"

namespace slf {
namespace {

using storage::TileState;
using storage::TileWriter;
using testing::all_tiles;
using testing::build_and_open;
using testing::lossless_options;
using testing::read_text;
using testing::stripes;
using testing::TemporaryFolder;
using testing::write_text;

std::vector<std::string> ids(const VerifyReport& report) {
  std::vector<std::string> found;
  for (const Finding& finding : report.findings) found.emplace_back(id(finding.kind));
  return found;
}

std::string name(TileKey key) {
  return std::to_string(key.level) + "/" + std::to_string(key.index);
}

/// Everywhere that a text is in a file: pages that were replaced may still hold it.
std::vector<std::size_t> places_of(const std::string& bytes, const std::string& text) {
  std::vector<std::size_t> places;
  for (std::size_t at = 0; (at = bytes.find(text, at)) != std::string::npos; ++at)
    places.push_back(at);
  EXPECT_FALSE(places.empty()) << text;
  return places;
}

/// Whether the file ends with the index of its last commit.
bool has_index(const std::string& path) {
  using storage::internal::FileIndex;
  const auto field = Field::open(path);
  const std::string bytes = read_text(path);
  const ByteSpan all = bytes_of(bytes);
  const std::uint64_t size = FileIndex::size(all.last(storage::internal::kIndexFooter));
  if (!field || size == 0) return false;
  const auto index = FileIndex::parse(all.last(size), all.size());
  return index && index->transaction == field->file().store().transaction();
}

VerifyReport verify(const std::string& path, const VerifyOptions& options = {}) {
  auto report = verify_field(path, options);
  EXPECT_TRUE(report) << (report ? "" : report.error().message);
  return report ? std::move(*report) : VerifyReport{};
}

/// A small field, and ways to damage copies of it.
class Verify : public ::testing::Test {
 protected:
  using Ids = std::vector<std::string>;

  void SetUp() override {
    options_.codec = "jpeg:90";  // level 1 has several records
    ASSERT_TRUE(build_and_open(stripes(), path_, options_));
    const auto field = Field::open(path_);
    tiles_ = all_tiles(*field);
    for (const auto& [key, payload] : tiles_)
      if (key.level == 1 && !payload.empty()) stored_.push_back(key);
    ASSERT_GT(stored_.size(), 100u);
  }

  /// Flips a bit of a stored tile's payload.
  void flip_payload(TileKey key) const {
    std::uint64_t at = 0;
    {
      const auto field = Field::open(path_);
      const auto tile = field->file().store().find(key);
      ASSERT_EQ(tile->state, TileState::stored);
      at = field->file().store().range(*tile).begin + tile->payload.size() / 2;
    }
    std::string bytes = read_text(path_);
    bytes[at] ^= 4;
    write_text(path_, bytes);
  }

  /// Flips a bit in the table of the record that holds a tile.
  void flip_record(TileKey key) const {
    std::string bytes = read_text(path_);
    const auto field = Field::open(path_);
    const auto tile = field->file().store().find(key);
    const std::size_t at =
        bytes.rfind("SLR2", field->file().store().range(*tile).begin);  // a record's magic
    ASSERT_NE(at, std::string::npos);
    bytes[at + 20] ^= 1;
    write_text(path_, bytes);
  }

  /// Makes a tile missing if there is no payload.
  void replace(TileKey key, std::string_view payload = {}) const {
    auto writer = TileWriter::resume(path_);
    ASSERT_TRUE(writer) << writer.error().message;
    ASSERT_TRUE(payload.empty() ? writer->drop(key) : writer->replace(key, bytes_of(payload)));
    ASSERT_TRUE(writer->close());
  }

  /// Makes a container with this field's manifest, changed, and no tiles.
  void remake(const std::function<void(nlohmann::json&)>& change) {
    nlohmann::json json = *Field::open(path_)->file().manifest().to_json();
    change(json);
    std::filesystem::remove(path_);
    const std::string text = json.dump();
    const ByteSpan bytes = as_bytes(std::span<const char>(text));
    const std::vector<std::pair<std::string, Bytes>> blobs{
        {kManifestBlob, Bytes(bytes.begin(), bytes.end())}, {kTablesBlob, {}}};
    auto writer = TileWriter::create(path_, blobs);
    ASSERT_TRUE(writer);
    ASSERT_TRUE(writer->close());
  }

  /// With fix: everything is dropped, and the same build makes the field what it was.
  void expect_fixed_and_refilled() const {
    VerifyOptions fix;
    fix.fix = true;
    const auto fixed = verify(path_, fix);
    EXPECT_GT(fixed.dropped, 0u);
    EXPECT_EQ(fixed.unfixed, 0u);
    EXPECT_FALSE(fixed.complete);
    EXPECT_TRUE(has_index(path_));
    const auto dropped = verify(path_);
    EXPECT_EQ(dropped.damaged, 0u);
    EXPECT_GT(dropped.found, 0u);
    const auto rebuilt = build_field(stripes(), path_, options_);
    ASSERT_TRUE(rebuilt) << rebuilt.error().message;
    EXPECT_GT(rebuilt->resumed, 0u);
    EXPECT_TRUE(has_index(path_));
    EXPECT_EQ(verify(path_).found, 0u);
    EXPECT_EQ(all_tiles(*Field::open(path_)), tiles_);
  }

  /// With fix: nothing is done, and the report says that the damage is still there.
  void expect_unfixable() const {
    const std::string before = read_text(path_);
    VerifyOptions fix;
    fix.fix = true;
    const auto report = verify(path_, fix);
    EXPECT_GT(report.unfixed, 0u);
    EXPECT_EQ(report.dropped, 0u);
    EXPECT_TRUE(read_text(path_) == before);
  }

  TemporaryFolder folder_;
  const std::string path_ = folder_ / "a.slf";
  BuildOptions options_ = lossless_options(2, 4, 1);
  testing::Payloads tiles_;
  std::vector<TileKey> stored_;  ///< of level 1
};

const VerifyOptions kQuick{.quick = true};

TEST_F(Verify, ASoundFieldHasNoFindings) {
  const std::string before = read_text(path_);
  for (const bool quick : {false, true}) {
    VerifyOptions options;
    options.quick = quick;
    options.fix = true;  // nothing to do
    const auto report = verify(path_, options);
    EXPECT_EQ(ids(report), Ids{});
    EXPECT_EQ(report.found + report.damaged + report.unfixed + report.dropped, 0u);
    EXPECT_TRUE(report.complete);
    EXPECT_EQ(report.tiles, 64u + 1024);
    EXPECT_EQ(report.payload_bytes, Field::open(path_)->content()->payload_bytes);
  }
  EXPECT_TRUE(read_text(path_) == before);
}

TEST_F(Verify, T1AFlippedPayloadByte) {
  flip_payload({0, 7});
  flip_payload(stored_.back());
  const auto report = verify(path_);
  EXPECT_EQ(ids(report), (Ids{"T1", "T1"}));
  EXPECT_NE(report.findings[0].message.find("0/7"), std::string::npos);
  EXPECT_NE(report.findings[1].message.find(name(stored_.back())), std::string::npos);
  EXPECT_EQ(report.unfixed, 2u);
  EXPECT_EQ(ids(verify(path_, kQuick)), Ids{});  // reads no payload
  expect_fixed_and_refilled();
}

TEST_F(Verify, T2APayloadThatDoesNotDecode) {
  replace(stored_[0], "not a picture");
  const auto report = verify(path_);
  EXPECT_EQ(ids(report), Ids{"T2"});
  EXPECT_NE(report.findings[0].message.find(name(stored_[0])), std::string::npos);
  EXPECT_EQ(ids(verify(path_, kQuick)), Ids{});
  expect_fixed_and_refilled();
}

TEST_F(Verify, R1ARecordThatCannotBeRead) {
  flip_record(stored_.back());
  for (const bool quick : {false, true}) {
    VerifyOptions options;
    options.quick = quick;
    const auto report = verify(path_, options);
    EXPECT_EQ(ids(report), (Ids{"R1", "C1"}));
    EXPECT_EQ(report.damaged, 1u);
    EXPECT_FALSE(report.complete);
  }
  expect_fixed_and_refilled();
}

TEST_F(Verify, K1ATileThatShouldNotBe) {
  {
    auto writer = TileWriter::resume(path_);
    ASSERT_TRUE(writer);
    ASSERT_TRUE(writer->append({2, 99}, Bytes(5)));
    ASSERT_TRUE(writer->close());
  }
  const auto report = verify(path_);
  EXPECT_EQ(ids(report), Ids{"K1"});
  EXPECT_NE(report.findings[0].message.find("2/99"), std::string::npos);
  EXPECT_EQ(ids(verify(path_, kQuick)), Ids{"K1"});
  VerifyOptions fix;
  fix.fix = true;
  EXPECT_EQ(verify(path_, fix).unfixed, 0u);
  const auto fixed = verify(path_);
  EXPECT_EQ(ids(fixed), Ids{});
  EXPECT_TRUE(fixed.complete);
}

TEST_F(Verify, C1TilesThatWereNeverBuilt) {
  replace({1, 3});
  const auto report = verify(path_);
  EXPECT_EQ(ids(report), Ids{"C1"});
  EXPECT_EQ(report.damaged, 0u);
  EXPECT_FALSE(report.complete);
  EXPECT_NE(report.findings[0].message.find("1023 of 1024"), std::string::npos);
  EXPECT_EQ(ids(verify(path_, kQuick)), Ids{"C1"});
  ASSERT_TRUE(build_field(stripes(), path_, options_));
  EXPECT_EQ(all_tiles(*Field::open(path_)), tiles_);
}

TEST_F(Verify, S1ADamagedPage) {
  std::string bytes = read_text(path_);
  for (const std::size_t at : places_of(bytes, "tables"))
    bytes[at / 4096 * 4096 + 10] ^= 0x20;  // the page's kind
  write_text(path_, bytes);
  const auto report = verify(path_);
  ASSERT_FALSE(report.findings.empty());
  EXPECT_EQ(ids(report)[0], "S1");
  EXPECT_EQ(ids(verify(path_, kQuick))[0], "S1");
  expect_unfixable();
}

TEST_F(Verify, S1WhatIsNoContainer) {
  const std::string bytes = read_text(path_);
  for (const std::string& text :
       {std::string(), std::string("text"), std::string(10000, 'x'), bytes.substr(0, 9000)}) {
    write_text(path_, text);
    EXPECT_EQ(ids(verify(path_)), Ids{"S1"});
    expect_unfixable();
  }
}

TEST_F(Verify, S1KeepsDamagedTilesFromBeingDropped) {
  flip_payload(stored_.back());
  std::string bytes = read_text(path_);
  const auto field = Field::open(path_);
  const auto tile = field->file().store().find({0, 0});
  const std::size_t page = field->file().store().range(*tile).begin / 4096 * 4096;
  bytes[page] ^= 1;  // its number
  write_text(path_, bytes);
  const auto found = ids(verify(path_));
  EXPECT_GE(std::count(found.begin(), found.end(), "S1"), 1);
  EXPECT_EQ(std::count(found.begin(), found.end(), "T1"), 1);
  expect_unfixable();
}

TEST_F(Verify, M1ADamagedManifest) {
  remake([](nlohmann::json& json) { json.erase("sphere"); });
  EXPECT_EQ(ids(verify(path_)), Ids{"M1"});
  EXPECT_EQ(ids(verify(path_, kQuick)), Ids{"M1"});
  expect_unfixable();
}

TEST_F(Verify, M1DamagedTables) {
  std::string bytes = read_text(path_);
  for (const std::size_t at : places_of(bytes, "tables")) bytes[at + 40] ^= 1;
  write_text(path_, bytes);
  EXPECT_EQ(ids(verify(path_)), Ids{"M1"});
  expect_unfixable();
}

TEST_F(Verify, ANewerFormatIsNotDamage) {
  remake([](nlohmann::json& json) { json["slf"]["major"] = 3; });
  const auto report = verify_field(path_, {});
  ASSERT_FALSE(report);
  EXPECT_EQ(report.error().code, ErrorCode::unsupported);
  EXPECT_EQ(verify_field(folder_ / "none.slf", {}).error().code, ErrorCode::not_found);
}

TEST_F(Verify, EveryKindOfDamageAtOnceIsDropped) {
  flip_payload({0, 7});
  flip_payload(stored_[3]);
  replace(stored_[1], "not a picture");
  flip_record(stored_.back());
  VerifyOptions options;
  options.threads = 1;
  const auto one = verify(path_, options);
  EXPECT_EQ(ids(one), (Ids{"T1", "T2", "T1", "R1", "C1"}));
  options.threads = 5;
  const auto five = verify(path_, options);
  ASSERT_EQ(one.findings.size(), five.findings.size());
  for (std::size_t k = 0; k < one.findings.size(); ++k)
    EXPECT_EQ(one.findings[k].message, five.findings[k].message);
  expect_fixed_and_refilled();
}

TEST_F(Verify, FillingHolesMayBeInterrupted) {
  const std::vector<TileKey> holes{stored_[0], stored_[1], {0, 5}, stored_.back()};
  for (const TileKey& key : holes) replace(key);
  int calls = 0;
  EXPECT_FALSE(
      build_field(stripes(), path_, options_, [&](const Progress&) { return ++calls < 2; }));
  EXPECT_EQ(verify(path_).found, 1u);  // two of level 1 are still to fill
  EXPECT_TRUE(has_index(path_));
  const auto rebuilt = build_field(stripes(), path_, options_);
  ASSERT_TRUE(rebuilt) << rebuilt.error().message;
  EXPECT_EQ(rebuilt->tiles, holes.size() - 2);
  EXPECT_EQ(verify(path_).found, 0u);
  EXPECT_EQ(all_tiles(*Field::open(path_)), tiles_);
}

// A copy without its finest level has means in all levels: holes are filled with means, too.
TEST_F(Verify, HolesAreFilledAsTheirLevelWasSampled) {
  auto options = options_;
  options.codec = "zstd:1";
  const std::string whole = folder_ / "whole.slf", cut = folder_ / "cut.slf";
  ASSERT_TRUE(build_and_open(stripes(), whole, options));
  RepackOptions repack;
  repack.finest_level = 0;
  ASSERT_TRUE(repack_field(*Field::open(whole), cut, repack));
  const auto before = all_tiles(*Field::open(cut));
  {
    auto writer = TileWriter::resume(cut);
    ASSERT_TRUE(writer);
    for (const std::uint64_t index : {5u, 7u, 40u}) ASSERT_TRUE(writer->drop({0, index}));
    ASSERT_TRUE(writer->close());
  }
  options.shape.finest_level = 0;
  const auto filled = build_field(stripes(), cut, options);
  ASSERT_TRUE(filled) << filled.error().message;
  EXPECT_EQ(filled->tiles, 3u);
  EXPECT_EQ(all_tiles(*Field::open(cut)), before);
  EXPECT_TRUE(Field::open(cut)->file().manifest().filtered(0));
  EXPECT_FALSE(Field::open(whole)->file().manifest().filtered(1));
}

TEST_F(Verify, ItCanBeStopped) {
  int calls = 0;
  const auto stopped = verify_field(path_, {}, [&](const Progress& state) {
    EXPECT_EQ(state.total, 1088u);
    return ++calls < 700;
  });
  ASSERT_FALSE(stopped);
  EXPECT_EQ(stopped.error().code, ErrorCode::cancelled);
  EXPECT_EQ(calls, 700);
}

TEST_F(Verify, FixingWhileAnotherWritesIsRefused) {
  flip_payload({0, 7});
  const auto other = TileWriter::resume(path_);
  ASSERT_TRUE(other);
  VerifyOptions fix;
  fix.fix = true;
  const auto report = verify_field(path_, fix);
  ASSERT_FALSE(report);
  EXPECT_EQ(report.error().code, ErrorCode::busy);
}

/// What a reader can see of a field.
std::optional<testing::Payloads> visible(const std::string& path) {
  const auto field = Field::open(path);
  if (!field) return std::nullopt;
  return all_tiles(*field);
}

// Every byte of a field of one subfield in turn. SLF_EVERY_BYTE=1 takes each; else every 17th.
TEST(VerifyFlips, EveryFlippedByteIsFoundOrDoesNoHarm) {
  TemporaryFolder folder;
  const std::string path = folder / "a.slf";
  auto options = lossless_options(1, 2, 1);
  options.shape.subfields = {7, 14};
  options.codec = "jpeg:75";
  ASSERT_TRUE(build_and_open(stripes(), path, options));
  const std::string bytes = read_text(path);
  ASSERT_LT(bytes.size(), 200u << 10);
  const auto truth = visible(path);
  VerifyOptions single;
  single.threads = 1;
  std::size_t found = 0, harmless = 0;
  const std::size_t step = std::getenv("SLF_EVERY_BYTE") ? 1 : 17;
  std::fstream file(path, std::ios::binary | std::ios::in | std::ios::out);
  const auto put = [&](std::size_t at, char byte) {
    file.seekp(static_cast<std::streamoff>(at));
    file.put(byte).flush();
  };
  for (std::size_t at = 0; at < bytes.size(); at += step) {
    put(at, static_cast<char>(bytes[at] ^ (1 << (at / step) % 8)));
    const auto report = verify_field(path, single);
    if (!report || report->found > 0) {
      ++found;
    } else {
      ++harmless;
      ASSERT_EQ(visible(path), truth) << at;
    }
    put(at, bytes[at]);
  }
  EXPECT_GT(found, 1000u / step);
  EXPECT_GT(harmless, 1000u / step);  // what is between nodes, and after payloads
  EXPECT_EQ(verify(path).found, 0u);
}

}  // namespace
}  // namespace slf

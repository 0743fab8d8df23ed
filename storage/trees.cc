#include "storage/internal/trees.h"

#include <algorithm>

#include "base/try.h"
#include "storage/tile_store.h"

namespace slf::storage {

std::string name(TileKey key) {
  return std::to_string(key.level) + "/" + std::to_string(key.index) +
         (key.state > 0 ? " of state " + std::to_string(key.state) : "");
}

namespace internal {
namespace {

constexpr std::size_t kUsualCode = 3;  ///< bytes per code of the table, for payloads below 2 MiB

}  // namespace

// The record begins after the previous entry's key, which limits how many tiles it can have.
std::uint64_t max_tiles_in_record(const TreePage& leaf, std::uint32_t index, const Node& node) {
  Node before;
  if (index == 0 || !leaf.node(index - 1, before)) return kMaxTiles;
  const auto last = decode_key(node.key);
  const auto previous = decode_key(before.key);
  if (!last || !previous || *previous >= *last) return kMaxTiles;
  const std::uint64_t span = previous->level == last->level
                                 ? packed_index(*last) - packed_index(*previous)
                                 : packed_index(*last) + 1;
  return std::min(span, kMaxTiles);
}

std::uint64_t usual_head_bytes(std::uint64_t span) {
  return kRecordHeader + span * (kUsualCode + 8);
}

Result<void> Trees::load(const Pages& pages) {
  pages_ = pages;
  manifest_ = SLF_TRY(named_tree(kManifest));
  auto sealed = SLF_TRY(blob(kContainer));
  container_ = SLF_TRY(at_place(decode_container(sealed), path_, ": container"));
  if (container_.transaction != meta().transaction)
    return bad_file(path_, "the meta page names transaction ", meta().transaction,
                    ", the container ", container_.transaction,
                    ": damaged, or written to by another program");
  tiles_ = SLF_TRY(named_tree(kTiles));
  if (tiles_.entries != container_.records)
    return bad_file(path_, "has ", tiles_.entries, " records, expected ", container_.records);
  return unchanged();
}

Result<Tree> Trees::named_tree(std::string_view name) const {
  Cursor cursor(pages_, meta().main);
  const bool found = SLF_TRY(cursor.find(name));
  if (!found) return bad_file(path_, "not a field, or damaged: it has no tree '", name, "'");
  if (cursor.node().flags != kSubTree || cursor.node().data.size() != kTreeBytes)
    return bad_file(path_, "the entry of tree '", name, "' is damaged");
  const Tree tree = Tree::parse(cursor.node().data.data());
  if (tree.flags != 0)
    return bad_file(path_, "tree '", name, "' has flags ", tree.flags, ", expected none");
  return tree;
}

Result<bool> Trees::has_blob(std::string_view name) const {
  return Cursor(pages_, manifest_).find(name);
}

Result<ByteSpan> Trees::blob(std::string_view name) const {
  Cursor cursor(pages_, manifest_);
  const bool found = SLF_TRY(cursor.find(name));
  if (!found) return bad_file(path_, "not a field, or damaged: it has no entry '", name, "'");
  const auto sealed = SLF_TRY(cursor.value());
  auto bytes = open_blob(name, sealed);
  SLF_TRY(unchanged());
  return at_place(bytes, path_, ": blob '", name, "'");
}

// If the record comes from a source, this reads its header and table only.
Result<Record> Trees::parse(const Cursor& at) const {
  const Node& node = at.node();
  if (pages_.mapped() || (node.flags & kBigData) == 0) {
    auto value = SLF_TRY(at.value());
    return Record::parse(value);
  }
  auto start =
      pages_.value(node, usual_head_bytes(max_tiles_in_record(at.leaf(), at.index(), node)));
  if (start && start->size() >= kRecordHeader)
    if (const std::uint64_t end = Record::table_end(*start); end > start->size())
      start = pages_.value(node, end);
  if (!start) return tl::unexpected(std::move(start.error()));
  if (const ByteSpan file = pages_.file(); !file.empty())
    return Record::parse(file.subspan(pages_.value_offset(node), node.data_size));
  return Record::parse(*start, node.data_size);
}

Result<Record> Trees::record(const Cursor& at) const {
  const auto key = decode_key(at.key());
  if (!key) return bad_file(path_, "a record's key of ", at.key().size(), " bytes, expected 9");
  auto record = parse(at);
  if (record && record->last() != *key)
    record = fail(ErrorCode::bad_file, "a record that ends at tile ", name(record->last()),
                  " lies in its place");
  return at_place(std::move(record), path_, ": record ending at tile ", name(*key));
}

Result<std::optional<TileKey>> Trees::last_before(TileKey key) const {
  Cursor cursor(pages_, tiles_);
  auto found = SLF_TRY(cursor.seek_before(encode_key(key)));
  if (!found) return std::nullopt;
  const auto before = decode_key(cursor.key());
  if (!before || *before >= key) return bad_file(path_, "the records are out of order");
  return *before;
}

Result<std::optional<Record>> Trees::find(TileKey key, std::uint64_t* offset) const {
  if (!container_.last || key > *container_.last) return std::nullopt;
  Cursor cursor(pages_, tiles_);
  auto found = SLF_TRY(cursor.seek(encode_key(key)));
  auto found_record =
      found ? record(cursor) : bad_file(path_, "the records end before the last tile");
  SLF_TRY(unchanged());
  if (!found_record) return tl::unexpected(std::move(found_record.error()));
  if (key > found_record->last() || (found_record->previous() && key <= *found_record->previous()))
    return bad_file(path_, "the record of tile ", name(key), " is lost");
  if (key < found_record->first()) return std::nullopt;
  if (offset != nullptr && (cursor.node().flags & kBigData) == 0)
    return bad_file(path_, "a record inside a tree page");
  if (offset != nullptr) *offset = pages_.value_offset(cursor.node());
  return *found_record;
}

}  // namespace internal
}  // namespace slf::storage

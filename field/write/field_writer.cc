#include "field/write/field_writer.h"

#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <map>
#include <utility>
#include <vector>

#include "base/guarded.h"
#include "base/sort_unique.h"
#include "base/try.h"
#include "field/field_file.h"
#include "field/geometry/tile_order.h"
#include "field/reference_index.h"
#include "storage/tile_writer.h"

namespace slf {
namespace {

/// The tiles of a level, each with those of the next coarser level that it is predicted from in any
/// state, as if of state 0.
Result<std::vector<ReferenceIndex::Tile>> references_of(const FieldFile& field, unsigned level,
                                                        const GoOn& go_on) {
  std::map<TileKey, std::vector<TileKey>> references;
  const auto visit = [&](const storage::TileRef& tile) -> Result<void> {
    if (go_on && !go_on()) return fail(ErrorCode::cancelled, field.path(), ": interrupted");
    if (tile.state != storage::TileState::stored || !field.shape().has(tile.key)) return {};
    auto& of_all = references[in_state(tile.key, 0)];
    for (const TileKey reference : field.coder().references(tile.key, tile.payload))
      if (reference.level < level) of_all.push_back(in_state(reference, 0));
    sort_unique(of_all);
    return {};
  };
  SLF_TRY(field.store().visit(first_key(level), first_key(level + 1), visit));
  std::vector<ReferenceIndex::Tile> tiles;
  tiles.reserve(references.size());
  for (auto& [key, of_all] : references) tiles.push_back({key, std::move(of_all)});
  return tiles;
}

using storage::TileWriter;

constexpr std::uint64_t kPendingLimit = 32ull << 20;

/// busy: another process was faster.
tl::unexpected<Error> just_written(const std::string& path) {
  return fail(ErrorCode::busy, path, ": another process has just written it; try again");
}

/// busy: another process is writing the output itself, which is to be replaced.
Result<void> check_no_writer(const FieldOutput& output) {
  return output.existing == Existing::replace ? storage::check_no_writer(output.target)
                                              : Result<void>();
}

/// Removes a draft that an earlier process left. Refuses to remove what is no draft: a file that is
/// not a field, one that another process is writing, or a complete field, unless it has the
/// manifest of the new one: then that process was killed when all but the renaming was done.
Result<void> remove_leftover(const std::string& file, ByteSpan manifest) {
  struct stat status {};
  if (::lstat(file.c_str(), &status) != 0) return {};
  if (S_ISLNK(status.st_mode)) return name_is_taken({ErrorCode::usage, file + ": is a link"});
  const auto writer = TileWriter::resume(file);                           // holds the writer's lock
  if (!writer && writer.error().code == ErrorCode::not_found) return {};  // by now
  if (!writer && writer.error().code == ErrorCode::busy) return tl::unexpected(writer.error());
  if (!writer) return name_is_taken(writer.error());
  const auto field = FieldFile::open(file);
  if (!field) return name_is_taken(field.error());
  const auto content = (*field)->content();
  if (!content) return name_is_taken(content.error());
  const auto found = (*field)->store().blob(kManifestBlob);
  if (content->complete && !(found && std::ranges::equal(*found, manifest)))
    return name_is_taken({ErrorCode::usage, file + ": is a complete field, no draft of one"});
  unlink(file.c_str());
  return {};
}

/// Leaves of the path of a source the file's name: fields are published, and folders name people.
/// Where no hash tells sources apart, `source` is a free text that does.
void drop_folders(nlohmann::json& manifest) {
  if (!manifest["provenance"].contains("content")) return;
  const auto drop = [](nlohmann::json& of) {
    const nlohmann::json::json_pointer at("/provenance/source");
    if (!of.contains(at) || !of[at].is_string()) return;
    auto& path = of[at].get_ref<std::string&>();
    while (path.size() > 1 && path.ends_with('/')) path.pop_back();
    path.erase(0, path.rfind('/') + 1);
  };
  drop(manifest);
  if (manifest.contains("states"))
    for (nlohmann::json& state : manifest["states"]) drop(state);
}

/// Encodes a manifest, without folders. usage: readers would refuse it.
Result<Bytes> encode(const Manifest& manifest, const std::string& path) {
  OwnedJson json = manifest.to_json();
  drop_folders(*json);
  const std::string text = json->dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
  if (auto parsed = Manifest::parse(text, path); !parsed)
    return fail(ErrorCode::usage, parsed.error().message);
  const ByteSpan bytes = bytes_of(text);
  return Bytes(bytes.begin(), bytes.end());
}

}  // namespace

tl::unexpected<Error> name_is_taken(Error error) {
  if (error.code != ErrorCode::out_of_memory)
    error.message += "; move or remove it: a new file needs its name";
  return tl::unexpected(std::move(error));
}

Result<FieldOutput> FieldOutput::at(const std::string& path, Existing existing,
                                    std::span<const std::string> inputs) {
  FieldOutput output{path, resolve_links(path), existing};
  SLF_TRY(check_output(path, inputs));
  for (const std::string& draft : {output.unfinished(), output.repacking()}) {
    for (const std::string& input : inputs)
      if (!input.empty() && is_same_place(draft, input))
        return misuse(input, "is the input, and ", draft, " is the name under which ", path,
                      " grows; rename it, or choose another output");
  }
  return output;
}

bool FieldOutput::exists() const {
  struct stat status {};
  return ::lstat(target.c_str(), &status) == 0;
}

Result<void> index_field(const std::string& path, const GoOn& go_on) {
  std::vector<storage::IndexExtra> extras;
  {
    const auto field = SLF_TRY(FieldFile::open(path));
    for (unsigned level = 1; field->predicts() && level <= field->shape().finest_level; ++level) {
      if (field->shape().tiles(level) / field->shape().states > kMaxIndexedTiles) break;
      const auto tiles = SLF_TRY(references_of(*field, level, go_on));
      extras.push_back({reference_section(level), ReferenceIndex::encode(tiles)});
    }
  }
  return storage::write_index(path, extras, go_on);
}

FieldWriter::FieldWriter(TileWriter writer, std::string file)
    : writer_(std::move(writer)),
      file_(std::move(file)),
      pending_limit_(kPendingLimit),
      last_(writer_->last()) {}

FieldWriter::FieldWriter(FieldWriter&& other) noexcept
    : writer_(std::exchange(other.writer_, std::nullopt)),
      file_(std::move(other.file_)),
      output_(std::move(other.output_)),
      discard_(std::exchange(other.discard_, false)),
      pending_limit_(other.pending_limit_),
      last_(other.last_) {}

FieldWriter::~FieldWriter() {
  if (discard_) unlink(file_.c_str());  // while the writer holds the lock
}

Result<FieldWriter> FieldWriter::create(const FieldOutput& output, Draft draft,
                                        const Manifest& manifest, ByteSpan tables,
                                        const KeptBlobs& kept) {
  // A build that finds its output goes on with it. If it is there now, it has just been finished.
  if (draft == Draft::keep && output.existing == Existing::keep && output.exists())
    return just_written(output.path);
  if (output.existing == Existing::keep && output.exists())
    return misuse(output.path, "exists; choose another output, or let it be replaced");
  const auto text = SLF_TRY(encode(manifest, output.path));
  std::vector<std::pair<std::string, Bytes>> blobs{
      {kManifestBlob, text}, {kTablesBlob, Bytes(tables.begin(), tables.end())}};
  for (const auto& [name, bytes] : kept)
    if (!bytes.empty()) blobs.emplace_back(name, bytes);

  const std::string file = draft == Draft::keep ? output.unfinished() : output.repacking();
  const auto busy = [&] {
    return fail(ErrorCode::busy, output.path, ": another process is writing it (", file, ")");
  };
  SLF_TRY(check_no_writer(output));
  if (auto cleared = remove_leftover(file, text); !cleared)
    return cleared.error().code == ErrorCode::busy ? busy() : tl::unexpected(cleared.error());
  auto begun = TileWriter::create(file, blobs, output.path);
  if (!begun && begun.error().code == ErrorCode::usage) return busy();  // begun meanwhile
  auto writer = SLF_TRY(std::move(begun));
  if (output.existing == Existing::keep && output.exists()) {  // written meanwhile
    unlink(file.c_str());
    return just_written(output.path);
  }
  auto created = guarded([&]() -> Result<FieldWriter> {
    // The draft of a file that replaces a private one must never be public.
    if (output.existing == Existing::replace)
      copy_permissions(output.target, file, /*writable=*/true);
    FieldWriter made(std::move(writer), file);
    made.output_ = output;
    made.discard_ = draft == Draft::discard;
    if (made.discard_) made.writer_->defer_sync();
    return made;
  });
  if (!created) unlink(file.c_str());
  return created;
}

Result<FieldWriter> FieldWriter::open(const std::string& file, std::uint64_t transaction) {
  auto resumed = TileWriter::resume(file);
  if (!resumed && resumed.error().code == ErrorCode::not_found) return just_written(file);
  auto writer = SLF_TRY(std::move(resumed));
  if (writer.transaction() != transaction)
    return fail(ErrorCode::busy, file, ": another process has just written to it; try again");
  return FieldWriter(std::move(writer), file);
}

Result<FieldWriter> FieldWriter::resume(const FieldOutput& output, std::uint64_t transaction) {
  SLF_TRY(check_no_writer(output));
  auto opened = open(output.unfinished(), transaction);
  if (opened) opened->output_ = output;
  return opened;
}

Result<FieldWriter> FieldWriter::edit(const std::string& path, std::uint64_t transaction) {
  return open(resolve_links(path), transaction);
}

void FieldWriter::set_pending_limit(std::uint64_t bytes) {
  pending_limit_ = std::clamp<std::uint64_t>(bytes, 1, kPendingLimit);
}

/// Adds to the message of an error of the system what happens to the file.
Result<void> FieldWriter::with_file_state(Result<void> written) const {
  if (written ||
      (written.error().code != ErrorCode::io && written.error().code != ErrorCode::out_of_memory))
    return written;
  return fail(written.error().code, output_ ? output_->path + ": not written: " : "",
              written.error().message,
              discard_ ? "; no file remains"
                       : "; what was committed stays, and the same call goes on from there");
}

Result<void> FieldWriter::commit() { return with_file_state(writer_->commit()); }

Result<void> FieldWriter::commit_level() {
  writer_->end_records();
  return commit();
}

Result<void> FieldWriter::commit_when_due() {
  if (writer_->pending_bytes() < pending_limit_) return {};
  return commit();
}

Result<void> FieldWriter::put(TileKey key, Bytes payload, std::uint64_t back) {
  const bool hole = last_ && key <= *last_;
  SLF_TRY(hole ? writer_->replace(key, payload, back)
               : writer_->append(key, std::move(payload), back));
  return commit_when_due();
}

Result<void> FieldWriter::put_missing(TileKey key) {
  SLF_TRY(writer_->append_missing(key));
  return commit_when_due();
}

Result<void> FieldWriter::keep(const std::string& blob, ByteSpan bytes) {
  return writer_->set_blob(blob, bytes);
}

Result<void> FieldWriter::drop(TileKey key) {
  SLF_TRY(writer_->drop(key));
  return commit_when_due();
}

Result<void> FieldWriter::finish(const GoOn& go_on) {
  const auto add_index = [&](const std::string& file) -> Result<void> {
    auto indexed = index_field(file, go_on);
    // A field that stays damaged elsewhere is not worse for having no index.
    if (!output_ && !indexed && indexed.error().code == ErrorCode::bad_file) return {};
    return indexed;
  };
  if (!output_) return with_file_state(writer_->close(add_index));
  SLF_TRY(check_no_writer(*output_));
  auto published = writer_->publish(output_->target, output_->existing, add_index);
  if (published) discard_ = false;
  if (!published && published.error().code == ErrorCode::usage)
    return fail(ErrorCode::busy, output_->path, ": another process has just written it",
                discard_ ? "" : "; the new field stays at " + file_);
  return with_file_state(std::move(published));
}

}  // namespace slf

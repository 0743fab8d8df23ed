// FieldWriter: writes fields, for builds, repacks, merges and repairs.
//
// A new field, the draft, grows in a file beside its output and is renamed to the output's name
// when it is complete. Until then a file of that name does not change. There are two kinds:
//
//   PATH.unfinished   the draft of a build. It stays when the build stops, and the same build
//                     continues it. It opens as a field, with the tiles that were committed.
//   PATH.repacking    the draft of a repack or merge. It is removed when that stops. If the process
//                     is killed, the next repack or merge to PATH removes it.
//
// Missing tiles of a field, and fields that older versions left unfinished under their final names,
// are filled in place.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "base/file.h"
#include "base/reporter.h"
#include "field/field_file.h"
#include "field/manifest.h"
#include "slf/error.h"
#include "storage/tile_writer.h"

namespace slf {

/// The destination of a new field.
struct FieldOutput {
  std::string path;    ///< as the caller named it
  std::string target;  ///< `path` with symbolic links resolved
  Existing existing = Existing::keep;

  /// usage: `path` leads to a folder or a device, or to one of `inputs`, which would be lost; or
  /// an input has the name of one of its drafts.
  [[nodiscard]] static Result<FieldOutput> at(const std::string& path, Existing existing,
                                              std::span<const std::string> inputs);

  [[nodiscard]] bool exists() const;
  [[nodiscard]] std::string unfinished() const { return target + ".unfinished"; }
  [[nodiscard]] std::string repacking() const { return target + ".repacking"; }
};

/// Adds what to do to an error about a file that has the name of a draft, but is none.
[[nodiscard]] tl::unexpected<Error> name_is_taken(Error error);

/// Thread-safety: none; one thread.
class FieldWriter {
 public:
  /// Whether the destructor keeps or removes an unfinished draft.
  enum class Draft { keep, discard };

  /// Begins a new field. `tables` are those of its codec; `kept`, what else it keeps. After an
  /// error no file remains. usage: the output exists and is to be kept, or readers would refuse the
  /// manifest. busy: another process is writing the field. bad_file: a file with the draft's name
  /// exists and is no container, so it is not a draft. io: the system refuses.
  [[nodiscard]] static Result<FieldWriter> create(const FieldOutput& output, Draft draft,
                                                  const Manifest& manifest, ByteSpan tables,
                                                  const KeptBlobs& kept = {});

  /// Continues the unfinished field of an output. `transaction` is the commit that the caller has
  /// read. busy: another process is writing the field, or has written to it since.
  [[nodiscard]] static Result<FieldWriter> resume(const FieldOutput& output,
                                                  std::uint64_t transaction);

  /// Writes to the field `path` itself. Errors as resume().
  [[nodiscard]] static Result<FieldWriter> edit(const std::string& path, std::uint64_t transaction);

  FieldWriter(FieldWriter&& other) noexcept;
  FieldWriter& operator=(FieldWriter&&) = delete;
  /// Discards tiles that were not committed; keeps or removes the draft.
  ~FieldWriter();

  /// The file that is being written. Once committed, it opens as a field.
  [[nodiscard]] const std::string& file() const { return file_; }
  /// The last commit.
  [[nodiscard]] std::uint64_t transaction() const { return writer_->transaction(); }

  /// Sets about how many bytes of records may wait before a commit, at most 32 MiB (the default).
  void set_pending_limit(std::uint64_t bytes);

  /// Writes a tile. Tiles come in key order. A tile above the last one is appended; a
  /// lower one replaces a missing tile of the file that was opened. An empty payload means an empty
  /// tile or, if `back` is not 0, one that is the same as the one stored `back` states before.
  [[nodiscard]] Result<void> put(TileKey key, Bytes payload, std::uint64_t back = 0);

  /// Appends a missing tile, which put() can fill later.
  [[nodiscard]] Result<void> put_missing(TileKey key);

  /// Sets a blob that the field keeps, in the next commit. Empty: none.
  [[nodiscard]] Result<void> keep(const std::string& blob, ByteSpan bytes);

  /// Makes a tile missing. Errors other than io concern this tile alone.
  [[nodiscard]] Result<void> drop(TileKey key);

  /// Makes the tiles of all complete records durable. io: the disk is full, or the system refuses;
  /// the message says whether the work can be continued. failed: the file was removed, renamed or
  /// replaced.
  [[nodiscard]] Result<void> commit();

  /// Ends the incomplete records, then commits, so every tile is durable. Call it between levels
  /// only, where records end anyway.
  [[nodiscard]] Result<void> commit_level();

  /// Commits every tile, closes, adds an index, and renames a draft to its output. Errors as
  /// commit(); usage: the output exists by now and is to be kept. busy: another process is writing
  /// the output. cancelled: stopped by `go_on`, with every tile committed.
  [[nodiscard]] Result<void> finish(const GoOn& go_on = {});

 private:
  FieldWriter(storage::TileWriter writer, std::string file);
  [[nodiscard]] static Result<FieldWriter> open(const std::string& file, std::uint64_t transaction);
  [[nodiscard]] Result<void> with_file_state(Result<void> written) const;
  [[nodiscard]] Result<void> commit_when_due();

  std::optional<storage::TileWriter> writer_;
  std::string file_;
  std::optional<FieldOutput> output_;  ///< of a new field
  bool discard_ = false;               ///< remove the file unless it is finished
  std::uint64_t pending_limit_;
  std::optional<TileKey> last_;  ///< when the writer was opened
};

/// Writes the index of a complete, closed field, for readers of remote files
/// (doc/format/optional.md, "Index"), after its last page, and replaces whatever follows that page.
/// The same pages give the same index. Errors as FieldFile::open(), or io. cancelled: stopped by
/// `go_on`; the field has no index then.
[[nodiscard]] Result<void> index_field(const std::string& path, const GoOn& go_on = {});

}  // namespace slf

// FieldWriter: the one way in which fields are written: built, repacked and repaired.
//
// A new field grows in a file beside its output and takes the output's name when it is complete.
// Until then whatever has that name stays as it is:
//
//   PATH.unfinished   a build. It stays when the build stops, and the same build continues it.
//                     It is a field that opens and that shows what was committed.
//   PATH.repacking    a repack or a merge. It goes when that stops; the next one removes what a
//                     killed one has left.
//
// Holes of a field, and fields that older versions left unfinished under their final names, are
// filled in place.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/file.h"
#include "field/manifest.h"
#include "slf/error.h"
#include "storage/tile_writer.h"

namespace slf {

/// Where a field goes.
struct FieldOutput {
  std::string path;    ///< as the caller named it
  std::string target;  ///< the file it leads to through symbolic links
  Existing existing = Existing::keep;

  /// usage: `path` leads to a folder or a device, or to one of `inputs`, which would be lost.
  [[nodiscard]] static Result<FieldOutput> at(const std::string& path, Existing existing,
                                              std::span<const std::string> inputs);

  [[nodiscard]] bool exists() const;
  [[nodiscard]] std::string unfinished() const { return target + ".unfinished"; }
};

/// Thread-safety: none; one thread.
class FieldWriter {
 public:
  /// What becomes of a new field that is not finished.
  enum class Draft { keep, discard };

  /// Begins a new field; its layers' tables are in the order of the manifest. Nothing is left
  /// behind on errors. usage: the output exists and is to be kept, or a reader would refuse the
  /// manifest. failed: another process is writing the field. bad_file: the file in which the field
  /// is to grow exists and is no container, so no draft of ours. io: the system refuses.
  [[nodiscard]] static Result<FieldWriter> create(const FieldOutput& output, Draft draft,
                                                  const Manifest& manifest,
                                                  std::span<const ByteSpan> tables);

  /// Continues the unfinished field of an output. `transaction` is the state that the caller has
  /// read. failed: another process is writing it, or has written to it since.
  [[nodiscard]] static Result<FieldWriter> resume(const FieldOutput& output,
                                                  std::uint64_t transaction);

  /// Writes to the field `path` itself. Errors as resume().
  [[nodiscard]] static Result<FieldWriter> edit(const std::string& path, std::uint64_t transaction);

  FieldWriter(FieldWriter&& other) noexcept;
  FieldWriter& operator=(FieldWriter&&) = delete;
  /// What was not committed is lost; a draft is kept or discarded.
  ~FieldWriter();

  /// The file that is being written. Once committed, it opens as a field.
  [[nodiscard]] const std::string& file() const { return file_; }

  /// How many bytes of records wait before a commit, about. Between 1 and 32 MiB.
  void set_pending_limit(std::uint64_t bytes);

  /// Writes a tile, in key order: behind the tiles of its layer, or into a hole among those that
  /// were there when the writer was opened. An empty payload means an empty tile.
  [[nodiscard]] Result<void> put(storage::LayerId layer, TileKey key, Bytes payload);

  /// Writes a tile of another field behind the tiles of its layer, without copying its payload. The
  /// store that it comes from must live, and have checked it, until keep_payloads().
  [[nodiscard]] Result<void> put_view(const storage::TileRef& tile);

  /// Copies the payloads given to put_view() that are not committed.
  void keep_payloads() { writer_->keep_payloads(); }

  /// Leaves a hole for a tile, behind the tiles of its layer, which put() can fill later.
  [[nodiscard]] Result<void> put_missing(storage::LayerId layer, TileKey key);

  /// Makes a tile a hole. Errors other than io concern this tile alone.
  [[nodiscard]] Result<void> drop(storage::LayerId layer, TileKey key);

  /// Makes what was put durable, but for the record that is being filled.
  /// io: the disk is full, or the system refuses; says whether the work can be continued.
  /// failed: the file was removed, renamed or replaced.
  [[nodiscard]] Result<void> commit();

  /// The same with every tile that was put. Only between levels, where records end anyway.
  [[nodiscard]] Result<void> commit_level();

  /// Commits all, closes, and gives a new field its name. Errors as commit(); usage: the output
  /// exists by now and is to be kept. failed: another process is writing the output.
  [[nodiscard]] Result<void> finish();

 private:
  FieldWriter(storage::TileWriter writer, std::string file, std::size_t layers);
  [[nodiscard]] static Result<FieldWriter> open(const std::string& file, std::uint64_t transaction);
  [[nodiscard]] Result<void> explained(Result<void> written) const;
  [[nodiscard]] Result<void> commit_when_due();

  std::optional<storage::TileWriter> writer_;
  std::string file_;
  std::optional<FieldOutput> output_;  ///< of a new field
  bool discard_ = false;               ///< the file goes unless it is finished
  std::uint64_t pending_limit_;
  std::vector<std::optional<TileKey>> last_;  ///< of each layer, when the writer was opened
};

}  // namespace slf

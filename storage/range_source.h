// RangeSource: the interface to a file that is read in ranges, such as one on a web server.
// TileStore::open() takes one; field/remote implements it.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>

#include "base/bytes.h"
#include "slf/error.h"
#include "storage/tile_store.h"

namespace slf::storage {

/// A file whose bytes are fetched in ranges. Thread-safety: any thread.
class RangeSource {
 public:
  virtual ~RangeSource() = default;

  /// Its address, for messages.
  [[nodiscard]] virtual const std::string& name() const = 0;
  /// The length of the file in bytes.
  [[nodiscard]] virtual std::uint64_t size() const = 0;
  /// Whether fetch() notices any change of the file, by what its server says of each answer.
  [[nodiscard]] virtual bool has_version() const { return true; }

  /// Receives fetched bytes, on the thread that called fetch(). An error that it returns ends the
  /// fetch.
  using Sink = std::function<Result<void>(std::uint64_t offset, ByteSpan bytes)>;

  /// Fetches ranges of the file, concurrently if possible, and passes each to `sink` as soon as it
  /// is complete, in any order. Returns when all are complete, or with the first error.
  /// io: the bytes cannot be fetched. bad_file: the file has changed since it was opened.
  [[nodiscard]] virtual Result<void> fetch(std::span<const FileRange> ranges, const Sink& sink) = 0;
};

}  // namespace slf::storage

// DicomDecoder: compressed DICOM pixels, decoded by GDCM in a process of its own.
//
// Why a process: GDCM, built with assertions, aborts on damaged input, and the decoders beneath it
// (three libjpegs, OpenJPEG, CharLS) have a history of memory errors. What happens to a forked
// child happens to nobody else: it has no more memory and processor time than its files call for,
// writes to nothing but a pipe, and ends by _exit, so that no destructor or exit handler of this
// process runs twice. This side believes none of it: it takes from the pipe exactly as many bytes
// as the headers, which our own parser read, say there are.
//
// One child decodes all files of a series, one ahead of the reader. It is forked with one thread
// out of many; should another have held a lock the child needs, the child stalls, is ended after
// its time, and that is an error like any other. Read volumes before starting threads.
#pragma once

#include <sys/types.h>

#include <cstddef>
#include <memory>
#include <vector>

#include "field/volume/dicom.h"
#include "slf/error.h"

namespace slf::volume_io {

class DicomDecoder {
 public:
  /// Starts the child. `files`: any slice of each, in the order they will be asked for.
  /// failed: no process or pipe to be had. unsupported: a file that decodes to more than 1 GiB.
  [[nodiscard]] static Result<std::unique_ptr<DicomDecoder>> start(
      const std::vector<DicomSlice>& files);
  /// Ends the child, whatever it is at.
  ~DicomDecoder();
  DicomDecoder(const DicomDecoder&) = delete;
  DicomDecoder& operator=(const DicomDecoder&) = delete;

  /// All frames of `file`, which must be the next one.
  /// bad_file: the child could not decode it, crashed on it or took too long; after that, no
  /// further file can be read.
  [[nodiscard]] Result<std::vector<std::byte>> read(const DicomSlice& file);

 private:
  DicomDecoder(pid_t child, int pipe) : child_(child), pipe_(pipe) {}
  [[nodiscard]] tl::unexpected<Error> why_not(const DicomSlice& file, bool late);

  pid_t child_;
  int pipe_;
};

}  // namespace slf::volume_io

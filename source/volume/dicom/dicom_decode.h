// DicomDecoder: decodes compressed DICOM pixels by GDCM, in a child process.
//
// Why a process? GDCM, built with assertions, aborts on damaged input, and the decoders it uses
// (three libjpegs, OpenJPEG, CharLS) have a history of memory errors. A forked child harms only
// itself: its memory and CPU time are limited to what its files need, it writes only to a pipe, and
// it ends by _exit, so that no destructor or exit handler of the parent runs twice. The parent does
// not trust the child: it reads exactly as many bytes as the headers state, which our own parser
// has read.
//
// One child decodes all files of a series, one file ahead of the reader. A fork copies only the
// calling thread. If another thread holds a lock that the child needs, the child stalls until its
// time is over, and the result is an error like any other. So read volumes before you start
// threads.
#pragma once

#include <sys/types.h>

#include <cstddef>
#include <memory>
#include <vector>

#include "slf/error.h"
#include "source/volume/dicom/dicom.h"

namespace slf::volume_io {

class DicomDecoder {
 public:
  /// Loads the module that decodes (gdcm_module.h) and starts the child. `files`: any slice of
  /// each, in the order they will be asked for.
  /// failed: no process or pipe can be created. unsupported: a file decodes to more than 1 GiB, or
  /// the module is not there.
  [[nodiscard]] static Result<std::unique_ptr<DicomDecoder>> start(
      const std::vector<DicomSlice>& files);
  /// Kills the child.
  ~DicomDecoder();
  DicomDecoder(const DicomDecoder&) = delete;
  DicomDecoder& operator=(const DicomDecoder&) = delete;

  /// All frames of `file`, which must be the next one. bad_file: the child could not decode it,
  /// crashed or took too long; no further file can be read.
  [[nodiscard]] Result<std::vector<std::byte>> read(const DicomSlice& file);

 private:
  DicomDecoder(pid_t child, int pipe) : child_(child), pipe_(pipe) {}
  [[nodiscard]] tl::unexpected<Error> decoding_error(const DicomSlice& file, bool late);

  pid_t child_;
  int pipe_;
};

}  // namespace slf::volume_io

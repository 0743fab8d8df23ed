#include "source/volume/dicom/dicom_decode.h"

#include <dlfcn.h>
#include <fcntl.h>
#include <poll.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <string>
#include <string_view>

#include "base/child_process.h"
#include "base/file.h"
#include "source/volume/dicom/gdcm_module.h"
#include "source/volume/packing.h"

namespace slf::volume_io {

namespace {

constexpr std::uint64_t kMaxBytes = std::uint64_t{1} << 30;

/// Seconds that decoding a file may take. The slowest decoder makes tens of megabytes per second.
std::uint64_t time_limit(const DicomSlice& file) { return 60 + (file.file_bytes() >> 20); }

// In the child.

/// The content of a file, in memory that is not freed before the process ends.
std::string_view map_file(const std::string& path) {
  const Descriptor file(::open(path.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC));
  struct stat status {};
  if (::fstat(file.get(), &status) != 0 || !S_ISREG(status.st_mode) || status.st_size == 0)
    ::_exit(1);
  const auto size = static_cast<std::size_t>(status.st_size);
  void* map = ::mmap(nullptr, size, PROT_READ, MAP_PRIVATE, file.get(), 0);
  if (map == MAP_FAILED) ::_exit(1);
  return {static_cast<const char*>(map), size};
}

std::string_view content_of(const DicomSlice& file) {
  if (packing_of_file(file.path) == Packing::none) return map_file(file.path);
  const auto unpacked = UnpackedFile::make(file.path);
  if (!unpacked) ::_exit(1);
  return map_file(unpacked->path());
}

/// Its address space may grow by GDCM's several copies of a file; its processor time is what the
/// files need.
void confine(const std::vector<DicomSlice>& files, int to) {
  std::uint64_t largest = 0, seconds = 0;
  for (const auto& file : files) {
    largest = std::max(largest, file.file_bytes());
    seconds += time_limit(file);
  }
  constexpr std::uint64_t kSpareBytes = std::uint64_t{1} << 30;
  confine_child(kSpareBytes + 12 * largest, seconds, to);
}

bool decode(GdcmDecode* gdcm, const DicomSlice& file, std::string_view content, int to) {
  const GdcmInput input{content, file.width, file.height, bytes_per_voxel(file.type) * file.samples,
                        name_of_compression(file.syntax).starts_with("JPEG 2000")};
  std::vector<std::byte> pixels(file.file_bytes());
  return gdcm(input, pixels) && write_all(to, pixels) == 0;
}

[[noreturn]] void be_child(GdcmDecode* gdcm, const std::vector<DicomSlice>& files,
                           int to) noexcept {
  try {
    std::vector<std::string_view> contents(files.size());
    std::ranges::transform(files, contents.begin(), content_of);
    confine(files, to);
    bool good = true;
    for (std::size_t i = 0; good && i < files.size(); ++i)
      good = decode(gdcm, files[i], contents[i], to);
    ::_exit(good ? 0 : 1);
  } catch (...) {
    ::_exit(1);
  }
}

// In the parent.

Result<GdcmDecode*> load_gdcm() {
  // Where this program looks for what it was installed or built with, then where slf was installed.
  std::string why;
  for (const char* name : {"slf_gdcm.so", SLF_MODULES "/slf_gdcm.so"}) {
    void* module = dlopen(name, RTLD_NOW);
    if (void* decode = module != nullptr ? dlsym(module, kGdcmDecode) : nullptr)
      return reinterpret_cast<GdcmDecode*>(decode);
    why += std::string(why.empty() ? "" : "; ") + dlerror();
  }
  return fail(ErrorCode::unsupported,
              "slf's module slf_gdcm.so, which decodes compressed DICOM, cannot be loaded: ", why);
}

enum class Wait { ready, late };

/// Polls for one second at a time, so that a time in which both processes are stopped counts as one
/// second.
Wait wait_for_bytes(int from, std::uint64_t seconds) {
  pollfd entry{.fd = from, .events = POLLIN, .revents = 0};
  for (std::uint64_t i = 0; i < seconds; ++i)
    if (::poll(&entry, 1, 1000) > 0) return Wait::ready;
  return Wait::late;
}

}  // namespace

Result<std::unique_ptr<DicomDecoder>> DicomDecoder::start(const std::vector<DicomSlice>& files) {
  for (const auto& file : files)
    if (file.file_bytes() > kMaxBytes)
      return unsupported(
          file.path, file.frames, " frames of ", file.height, "x", file.width, " decode to ",
          file.file_bytes(),
          " bytes, expected at most 2^30: decompress it first, `gdcmconv --raw IN OUT`");
  static const Result<GdcmDecode*> loaded = load_gdcm();
  if (!loaded) return fail_in(loaded.error(), files.front().path, ": ");
  GdcmDecode* const gdcm = *loaded;
  std::array<int, 2> ends{};
  if (::pipe2(ends.data(), O_CLOEXEC) != 0)
    return fail(ErrorCode::failed, files.front().path,
                ": no pipe to its decoder: ", std::strerror(errno));
  const pid_t child = ::fork();
  if (child == 0) {
    ::close(ends[0]);
    be_child(gdcm, files, ends[1]);
  }
  const int error = errno;
  ::close(ends[1]);
  if (child < 0) {
    ::close(ends[0]);
    return fail(ErrorCode::failed, files.front().path,
                ": no process to decode it: ", std::strerror(error));
  }
  return std::unique_ptr<DicomDecoder>(new DicomDecoder(child, ends[0]));
}

DicomDecoder::~DicomDecoder() {
  ::close(pipe_);
  if (child_ <= 0) return;
  ::kill(child_, SIGKILL);
  while (::waitpid(child_, nullptr, 0) < 0 && errno == EINTR) {
  }
}

Result<std::vector<std::byte>> DicomDecoder::read(const DicomSlice& file) {
  // Allocate memory as bytes arrive, not because a header asks for it.
  std::vector<std::byte> pixels;
  const std::uint64_t needed = file.file_bytes();
  while (pixels.size() < needed) {
    if (wait_for_bytes(pipe_, time_limit(file)) == Wait::late) return decoding_error(file, true);
    const std::size_t from = pixels.size();
    if (from == 0) pixels.reserve(needed);
    constexpr std::uint64_t kStep = std::uint64_t{1} << 18;
    pixels.resize(from + std::min(needed - from, kStep));
    const ssize_t got = ::read(pipe_, pixels.data() + from, pixels.size() - from);
    pixels.resize(from + static_cast<std::size_t>(std::max<ssize_t>(got, 0)));
    if (got == 0 || (got < 0 && errno != EINTR)) return decoding_error(file, false);
  }
  return pixels;
}

tl::unexpected<Error> DicomDecoder::decoding_error(const DicomSlice& file, bool late) {
  const std::string what = name_of_compression(file.syntax);
  if (late)
    return bad_file(file.path, "its pixels, ", what, ", were not decoded within ", time_limit(file),
                    " s: they are damaged");
  int status = 0;
  pid_t ended = 0;
  while ((ended = ::waitpid(child_, &status, 0)) < 0 && errno == EINTR) {
  }
  child_ = 0;
  if (ended > 0 && WIFSIGNALED(status) &&
      (WTERMSIG(status) == SIGINT || WTERMSIG(status) == SIGTERM || WTERMSIG(status) == SIGKILL))
    return fail(ErrorCode::failed, file.path,
                ": its decoder was killed: ", ::strsignal(WTERMSIG(status)));
  if (ended > 0 && WIFEXITED(status) && WEXITSTATUS(status) == kNotConfined)
    return not_confined(file.path);
  return bad_file(file.path, "its pixels, ", what,
                  ended > 0 && WIFSIGNALED(status) ? ", crash the decoder" : ", cannot be decoded",
                  " to ", file.frames, " frames of ", file.height, "x", file.width, " ",
                  name(file.type), ": they are damaged, copy the file again");
}

}  // namespace slf::volume_io

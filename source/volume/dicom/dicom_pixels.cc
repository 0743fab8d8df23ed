// The pixels of DICOM files: our own parser reads plain ones, DicomDecoder compressed ones.
#include <dlfcn.h>
#include <fcntl.h>
#include <poll.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/types.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cerrno>
#include <cmath>
#include <csignal>
#include <cstddef>
#include <cstring>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include "base/child_process.h"
#include "base/file.h"
#include "base/try.h"
#include "slf/error.h"
#include "source/volume/dicom/dicom.h"
#include "source/volume/dicom/dicom_elements.h"
#include "source/volume/dicom/gdcm_module.h"
#include "source/volume/io.h"
#include "source/volume/packing.h"
#include "source/volume/voxels.h"

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

/// DicomDecoder: decodes compressed DICOM pixels by GDCM, in a child process.
///
/// Why a process? GDCM, built with assertions, aborts on damaged input, and the decoders it uses
/// (three libjpegs, OpenJPEG, CharLS) have a history of memory errors. A forked child harms only
/// itself: its memory and CPU time are limited to what its files need, it writes only to a pipe,
/// and it ends by _exit, so that no destructor or exit handler of the parent runs twice. The parent
/// does not trust the child: it reads exactly as many bytes as the headers state, which our own
/// parser has read.
///
/// One child decodes all files of a series, one file ahead of the reader. A fork copies only the
/// calling thread. If another thread holds a lock that the child needs, the child stalls until its
/// time is over, and the result is an error like any other. So read volumes before you start
/// threads.
class DicomDecoder {
 public:
  /// Loads the module that decodes (gdcm_module.h) and starts the child. `files`: any slice of
  /// each, in the order they will be asked for.
  /// failed: no process or pipe can be created. unsupported: a file decodes to more than 1 GiB, or
  /// the module is not there.
  [[nodiscard]] static Result<std::unique_ptr<DicomDecoder>> start(
      const std::vector<DicomSlice>& files) {
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

  /// Kills the child.
  ~DicomDecoder() {
    ::close(pipe_);
    if (child_ <= 0) return;
    ::kill(child_, SIGKILL);
    while (::waitpid(child_, nullptr, 0) < 0 && errno == EINTR) {
    }
  }
  DicomDecoder(const DicomDecoder&) = delete;
  DicomDecoder& operator=(const DicomDecoder&) = delete;

  /// All frames of `file`, which must be the next one. bad_file: the child could not decode it,
  /// crashed or took too long; no further file can be read.
  [[nodiscard]] Result<std::vector<std::byte>> read(const DicomSlice& file) {
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

 private:
  DicomDecoder(pid_t child, int pipe) : child_(child), pipe_(pipe) {}

  [[nodiscard]] tl::unexpected<Error> decoding_error(const DicomSlice& file, bool late) {
    const std::string what = name_of_compression(file.syntax);
    if (late)
      return bad_file(file.path, "its pixels, ", what, ", were not decoded within ",
                      time_limit(file), " s: they are damaged");
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
    return bad_file(
        file.path, "its pixels, ", what,
        ended > 0 && WIFSIGNALED(status) ? ", crash the decoder" : ", cannot be decoded", " to ",
        file.frames, " frames of ", file.height, "x", file.width, " ", name(file.type),
        ": they are damaged, copy the file again");
  }

  pid_t child_;
  int pipe_;
};

/// Clears the bits that are not stored (old files have overlays there) and extends the sign.
void keep_stored_bits(std::vector<std::byte>& pixels, const DicomSlice& slice) {
  with_type(slice.type, [&]<class T>(T) {
    if constexpr (std::is_integral_v<T>) {
      using Bits = std::make_unsigned_t<T>;
      constexpr unsigned kBits = 8 * sizeof(T);
      if (slice.bits_stored == kBits) return;
      const unsigned left = kBits - 1 - slice.high_bit;
      const unsigned right = kBits - slice.bits_stored;
      for (std::size_t at = 0; at + sizeof(T) <= pixels.size(); at += sizeof(T)) {
        Bits raw;
        std::memcpy(&raw, pixels.data() + at, sizeof(T));
        const T kept = static_cast<T>(static_cast<T>(static_cast<Bits>(raw << left)) >> right);
        std::memcpy(pixels.data() + at, &kept, sizeof(T));
      }
    }
  });
}

/// One byte per pixel from bits, the lowest first, from pixel `first` on.
std::vector<std::byte> unpacked(std::span<const std::byte> bits, std::uint64_t first,
                                std::uint64_t count) {
  std::vector<std::byte> pixels(count);
  for (std::uint64_t i = 0; i < count; ++i)
    pixels[i] = (bits[(first + i) / 8] >> ((first + i) % 8)) & std::byte{1};
  return pixels;
}

/// Puts the samples of a pixel side by side, which were in planes.
std::vector<std::byte> interleaved(std::span<const std::byte> planes, const DicomSlice& slice) {
  const std::size_t width = bytes_per_voxel(slice.type);
  const std::size_t plane = planes.size() / slice.samples;
  std::vector<std::byte> pixels(planes.size());
  auto to = pixels.begin();
  for (std::size_t at = 0; at < plane; at += width)
    for (std::size_t s = 0; s < slice.samples; ++s)
      to = std::copy_n(planes.begin() + static_cast<std::ptrdiff_t>(s * plane + at), width, to);
  return pixels;
}

/// Repeats the chroma that two pixels share: Y Y Cb Cr to Y Cb Cr, Y Cb Cr.
std::vector<std::byte> with_full_chroma(std::span<const std::byte> shared, std::uint64_t count) {
  std::vector<std::byte> pixels;
  pixels.reserve(3 * count);
  for (std::uint64_t i = 0; i < count; ++i) {
    const auto* pair = &shared[i / 2 * 4];
    pixels.insert(pixels.end(), {pair[i % 2], pair[2], pair[3]});
  }
  return pixels;
}

/// Red, green and blue of luma and chroma with 8 bits and full range (PS3.3 C.7.6.3.1.2).
void to_rgb(std::vector<std::byte>& pixels) {
  for (std::size_t at = 0; at + 3 <= pixels.size(); at += 3) {
    const double y = std::to_integer<int>(pixels[at]);
    const double cb = std::to_integer<int>(pixels[at + 1]) - 128.0;
    const double cr = std::to_integer<int>(pixels[at + 2]) - 128.0;
    const double rgb[3] = {y + 1.402 * cr, y - 0.344136 * cb - 0.714136 * cr, y + 1.772 * cb};
    for (std::size_t i = 0; i < 3; ++i)
      pixels[at + i] = static_cast<std::byte>(std::lround(std::clamp(rgb[i], 0.0, 255.0)));
  }
}

/// The colours or values that a palette gives to indices.
std::vector<std::byte> looked_up(const std::vector<std::byte>& indices, const DicomSlice& slice) {
  const DicomPalette& palette = *slice.palette;
  const auto last = static_cast<std::int64_t>(palette.channels[0].size()) - 1;
  Volume one;
  one.type = slice.type;
  one.voxels = indices;
  std::vector<std::byte> colors;
  visit_voxels(one, [&](auto voxels) {
    for (const auto index : voxels) {
      const auto entry = static_cast<std::size_t>(
          std::clamp<std::int64_t>(static_cast<std::int64_t>(index) - palette.first, 0, last));
      for (const auto& channel : palette.channels) {
        const auto* from = reinterpret_cast<const std::byte*>(&channel[entry]);
        const std::uint8_t narrow = static_cast<std::uint8_t>(channel[entry]);
        if (palette.wide)
          colors.insert(colors.end(), from, from + 2);
        else
          colors.push_back(static_cast<std::byte>(narrow));
      }
    }
  });
  return colors;
}

Result<std::vector<std::byte>> read_plain(const DicomSlice& file) {
  const auto bytes = SLF_TRY(read_dicom_bytes(file.path));
  const DicomFile elements = parse_dicom(file.path, bytes);
  const auto data = DicomLookup(elements.big_endian, {&elements.data}).raw(file.pixels_at);
  if (data.size() < file.file_bytes())
    return bad_file(file.path, "it has changed while it was read");
  const auto* from = reinterpret_cast<const std::byte*>(data.data());
  return std::vector<std::byte>(from, from + file.file_bytes());
}

/// A frame of a file with these pixels, as stored: what for_each_frame() visits.
std::vector<std::byte> frame_of(const DicomSlice& slice, std::span<const std::byte> file) {
  const std::uint64_t count = std::uint64_t{slice.width} * slice.height;
  if (slice.one_bit) return unpacked(file, slice.frame * count, count);
  const auto stored = file.subspan(slice.frame * slice.bytes(), slice.bytes());
  std::vector<std::byte> pixels(stored.begin(), stored.end());
  if (!slice.compressed && (slice.swapped > 1) == (std::endian::native == std::endian::little))
    swap_bytes(pixels, slice.swapped > 1 ? slice.swapped : bytes_per_voxel(slice.type));
  keep_stored_bits(pixels, slice);
  if (slice.palette) return looked_up(pixels, slice);
  if (slice.color == DicomColor::ybr_full_422 && !slice.compressed)
    pixels = with_full_chroma(pixels, count);
  else if (slice.planar)
    pixels = interleaved(pixels, slice);
  if (slice.color != DicomColor::grey && slice.color != DicomColor::rgb) to_rgb(pixels);
  return pixels;
}

}  // namespace

Result<void> for_each_frame(
    const std::vector<DicomSlice>& slices,
    const std::function<Result<void>(std::size_t, const std::vector<std::byte>&)>& visit) {
  std::map<std::string, std::vector<std::size_t>> by_file;
  for (std::size_t i = 0; i < slices.size(); ++i) by_file[slices[i].path].push_back(i);
  std::vector<DicomSlice> compressed;  // any slice of each such file
  for (const auto& [path, of_file] : by_file)
    if (slices[of_file.front()].compressed) compressed.push_back(slices[of_file.front()]);
  std::unique_ptr<DicomDecoder> decoder;
  if (!compressed.empty()) decoder = SLF_TRY(DicomDecoder::start(compressed));
  for (const auto& [path, of_file] : by_file) {
    const DicomSlice& file = slices[of_file.front()];
    const auto pixels = SLF_TRY(file.compressed ? decoder->read(file) : read_plain(file));
    for (const std::size_t i : of_file) SLF_TRY(visit(i, frame_of(slices[i], pixels)));
  }
  return {};
}

}  // namespace slf::volume_io

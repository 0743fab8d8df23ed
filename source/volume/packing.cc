#include "source/volume/packing.h"

#include <bzlib.h>
#include <lzma.h>
#include <unistd.h>
#include <zlib.h>
#include <zstd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <limits>
#include <vector>

#include "base/try.h"
#include "source/volume/io.h"

namespace slf::volume_io {

namespace {

// The most that deflate can expand, from its format: 258 bytes for two one-bit codes.
constexpr std::uint64_t kDeflateExpansion = 1032;
constexpr std::uint64_t kSmallVolume = std::uint64_t{4} << 30;
constexpr std::uint64_t kMaxDictionary = std::uint64_t{256} << 20;
constexpr std::size_t kMaxStep = std::size_t{1} << 30;  // lengths of zlib and bzip2 have 32 bits

/// One step of a stream of zlib, bzip2 or lzma, which have the same members. Returns its status.
template <class Stream, class Code>
auto step_of(Stream& stream, std::span<const std::byte>& in, std::span<std::byte>& out,
             const Code& code) {
  const std::size_t given = std::min(in.size(), kMaxStep), room = std::min(out.size(), kMaxStep);
  stream.next_in = reinterpret_cast<decltype(stream.next_in)>(const_cast<std::byte*>(in.data()));
  stream.avail_in = static_cast<decltype(stream.avail_in)>(given);
  stream.next_out = reinterpret_cast<decltype(stream.next_out)>(out.data());
  stream.avail_out = static_cast<decltype(stream.avail_out)>(room);
  const auto status = code(&stream);
  in = in.subspan(given - stream.avail_in);
  out = out.subspan(room - stream.avail_out);
  return status;
}

class Inflater final : public Unpacker {
 public:
  explicit Inflater(int window) {
    if (inflateInit2(&stream_, window) != Z_OK) throw std::bad_alloc();
  }
  ~Inflater() override { inflateEnd(&stream_); }

  State step(std::span<const std::byte>& in, std::span<std::byte>& out) override {
    const int status =
        step_of(stream_, in, out, [](z_stream* stream) { return inflate(stream, Z_NO_FLUSH); });
    if (status == Z_STREAM_END) return State::ended;
    return status == Z_OK || status == Z_BUF_ERROR ? State::more : State::damaged;
  }
  bool restart() override { return inflateReset(&stream_) == Z_OK; }
  std::string problem() const override { return stream_.msg ? stream_.msg : "not gzip or zlib"; }

 private:
  z_stream stream_{};
};

class Bunzipper final : public Unpacker {
 public:
  Bunzipper() {
    if (!start()) throw std::bad_alloc();
  }
  ~Bunzipper() override { BZ2_bzDecompressEnd(&stream_); }

  State step(std::span<const std::byte>& in, std::span<std::byte>& out) override {
    const int status = step_of(stream_, in, out, BZ2_bzDecompress);
    if (status == BZ_STREAM_END) return State::ended;
    return status == BZ_OK ? State::more : State::damaged;
  }
  bool restart() override {
    BZ2_bzDecompressEnd(&stream_);
    return start();
  }
  std::string problem() const override { return "not bzip2, or its checksum differs"; }

 private:
  bool start() {
    stream_ = {};
    return BZ2_bzDecompressInit(&stream_, 0, 0) == BZ_OK;
  }
  bz_stream stream_{};
};

class Unxzer final : public Unpacker {
 public:
  Unxzer() {
    if (!restart()) throw std::bad_alloc();
  }
  ~Unxzer() override { lzma_end(&stream_); }

  State step(std::span<const std::byte>& in, std::span<std::byte>& out) override {
    status_ =
        step_of(stream_, in, out, [](lzma_stream* stream) { return lzma_code(stream, LZMA_RUN); });
    if (status_ == LZMA_STREAM_END) return State::ended;
    return status_ == LZMA_OK || status_ == LZMA_BUF_ERROR ? State::more : State::damaged;
  }
  bool restart() override { return lzma_stream_decoder(&stream_, kMaxDictionary, 0) == LZMA_OK; }
  std::string problem() const override {
    return status_ == LZMA_MEMLIMIT_ERROR  ? "its dictionary takes more than 256 MiB; pack it anew"
           : status_ == LZMA_OPTIONS_ERROR ? "a filter that is not known"
                                           : "not xz, or its checksum differs";
  }

 private:
  lzma_stream stream_ = LZMA_STREAM_INIT;
  lzma_ret status_ = LZMA_OK;
};

class Unzstder final : public Unpacker {
 public:
  Unzstder() : stream_(ZSTD_createDStream(), &ZSTD_freeDStream) {
    if (!stream_) throw std::bad_alloc();
  }

  State step(std::span<const std::byte>& in, std::span<std::byte>& out) override {
    ZSTD_inBuffer from{in.data(), in.size(), 0};
    ZSTD_outBuffer to{out.data(), out.size(), 0};
    status_ = ZSTD_decompressStream(stream_.get(), &to, &from);
    in = in.subspan(from.pos);
    out = out.subspan(to.pos);
    if (ZSTD_isError(status_)) return State::damaged;
    return status_ == 0 ? State::ended : State::more;
  }
  bool restart() override {
    return ZSTD_isError(ZSTD_DCtx_reset(stream_.get(), ZSTD_reset_session_only)) == 0;
  }
  std::string problem() const override { return ZSTD_getErrorName(status_); }

 private:
  std::unique_ptr<ZSTD_DStream, decltype(&ZSTD_freeDStream)> stream_;
  std::size_t status_ = 0;
};

}  // namespace

Packing packing_of(std::string_view head) {
  using namespace std::string_view_literals;
  if (head.starts_with("\x1f\x8b")) return Packing::gzip;
  if (head.starts_with("\xfd"
                       "7zXZ\0"sv))
    return Packing::xz;
  if (head.starts_with("\x28\xb5\x2f\xfd")) return Packing::zstd;
  // A frame without data, which parallel zstd writes before each of its frames.
  if (head.size() >= 4 && (head[0] & 0xf0) == 0x50 && head.substr(1, 3) == "\x2a\x4d\x18")
    return Packing::zstd;
  // The level, then the start of a block or the end of an empty stream.
  if (head.starts_with("BZh") && head.size() >= 10 && head[3] >= '1' && head[3] <= '9' &&
      (head.substr(4, 6) == "1AY&SY" || head.substr(4, 6) == "\x17rE8P\x90"))
    return Packing::bzip2;
  return Packing::none;
}

bool begins_member(Packing packing, std::byte first) {
  const auto byte = std::to_integer<unsigned>(first);
  return packing == Packing::gzip    ? byte == 0x1f
         : packing == Packing::bzip2 ? byte == 'B'
         : packing == Packing::xz    ? byte == 0xfd
         : packing == Packing::zstd  ? byte == 0x28 || byte >> 4 == 5
                                     : false;
}

Packing packing_of_file(const std::string& path, std::uint64_t offset) {
  std::array<char, 10> head{};
  auto file = open_regular(path);
  if (!file) return Packing::none;  // reading it says what is wrong
  file->seekg(static_cast<std::streamoff>(offset));
  file->read(head.data(), head.size());
  return packing_of({head.data(), static_cast<std::size_t>(file->gcount())});
}

const char* name(Packing packing) {
  constexpr std::array kNames{"none", "gzip", "zlib", "deflate", "bzip2", "xz", "zstd"};
  return kNames[static_cast<std::size_t>(packing)];
}

std::uint64_t max_unpacked(Packing packing, std::uint64_t packed) {
  std::uint64_t most = 0;
  if (__builtin_mul_overflow(packed, kDeflateExpansion, &most))
    most = std::numeric_limits<std::uint64_t>::max();
  const bool expands_far =
      packing == Packing::bzip2 || packing == Packing::xz || packing == Packing::zstd;
  return expands_far ? std::max(most, kSmallVolume) : most;
}

std::unique_ptr<Unpacker> Unpacker::make(Packing packing) {
  constexpr int kGzipOrZlib = 15 + 32, kNoHeader = -15;
  switch (packing) {
    case Packing::bzip2:
      return std::make_unique<Bunzipper>();
    case Packing::xz:
      return std::make_unique<Unxzer>();
    case Packing::zstd:
      return std::make_unique<Unzstder>();
    case Packing::deflate:
      return std::make_unique<Inflater>(kNoHeader);
    default:
      return std::make_unique<Inflater>(kGzipOrZlib);
  }
}

Result<std::string> read_unpacked(const std::string& path, std::size_t limit) {
  constexpr std::size_t kStep = std::size_t{1} << 20;
  auto reader = SLF_TRY(ByteReader::open(path, 0, true));
  std::string bytes;
  while (bytes.size() <= limit) {
    const auto more = SLF_TRY(reader.read_text(kStep));
    bytes += more;
    if (more.size() < kStep) return bytes;
  }
  return unsupported(path, "unpacks to more than ", limit,
                     " bytes: unpack it yourself, and give the unpacked file");
}

Result<UnpackedFile> UnpackedFile::make(const std::string& path) {
  // Far more than scans shrink by: what expands further is a bomb, and would fill the disk.
  constexpr std::uint64_t kMaxRatio = 100, kSmallFile = std::uint64_t{1} << 30;
  const auto size = SLF_TRY(file_size(path));
  const std::uint64_t most = std::max(size * kMaxRatio, kSmallFile);
  auto reader = SLF_TRY(ByteReader::open(path, 0, true));
  const auto no_room = [&] {
    return fail(ErrorCode::io, path,
                ": cannot be unpacked into a temporary file: ", std::strerror(errno),
                ": unpack it yourself, and give the unpacked file");
  };
  UnpackedFile unpacked(open_unnamed_file());
  if (unpacked.file_.get() < 0) return no_room();
  std::vector<std::byte> chunk(std::size_t{1} << 18);
  for (std::uint64_t done = 0;;) {
    const auto got = SLF_TRY(reader.read(chunk));
    if (got == 0) return unpacked;
    done += got;
    if (done > most)
      return unsupported(path, size, " packed bytes become more than ", most,
                         ": if that is right, unpack it yourself, and give the unpacked file");
    if (write_all(unpacked.file_.get(), ByteSpan(chunk).first(got)) != 0) return no_room();
  }
}

std::string UnpackedFile::path() const { return path_of_descriptor(file_.get()); }

}  // namespace slf::volume_io

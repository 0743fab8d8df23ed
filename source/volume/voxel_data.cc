// Reads the voxels that a header locates, in one file or in several.
#include <algorithm>
#include <bit>
#include <cstring>
#include <optional>
#include <utility>

#include "base/try.h"
#include "source/volume/io.h"

namespace slf::volume_io {

namespace {

constexpr std::size_t kChunk = std::size_t{1} << 18;

/// The sizes in bytes of what a VoxelData describes.
struct VoxelBytes {
  std::uint64_t volume = 0;  ///< one volume, with all components
  std::uint64_t begin = 0;   ///< before the volume to read
  std::uint64_t all = 0;     ///< all volumes
  std::uint64_t part = 0;    ///< what each file holds
};

Result<VoxelBytes> count_bytes(const VoxelData& from, const Volume& volume) {
  VoxelBytes bytes;
  const std::uint64_t volumes = std::max(from.volumes, from.index + 1);
  std::uint64_t end = 0;
  if (__builtin_mul_overflow(voxel_bytes(volume), from.components, &bytes.volume) ||
      __builtin_mul_overflow(bytes.volume, volumes, &bytes.all) ||
      __builtin_add_overflow(bytes.all, from.skip, &end) ||
      __builtin_add_overflow(end, from.offset, &end))
    return bad_file(from.files.front(), "absurd dims: ", volumes, " volumes end beyond 2^64 bytes");
  bytes.begin = bytes.volume * from.index;
  const std::uint64_t files = from.files.size();
  bytes.part = bytes.all / files;
  if (bytes.part == 0 || bytes.part * files != bytes.all)
    return bad_file(volume.source, "its ", bytes.all, " bytes of voxels cannot be ", files,
                    " data files of one size: its list of files or its sizes are wrong");
  return bytes;
}

/// Where the data begin in a file of this size.
std::uint64_t offset_in(const VoxelData& from, const VoxelBytes& bytes, std::uint64_t size) {
  if (!from.at_end) return from.offset;
  return size > bytes.part ? size - bytes.part : 0;
}

/// Reads bytes and drops them; fewer where the data end.
Result<std::uint64_t> skip_bytes(ByteReader& reader, std::uint64_t count) {
  std::vector<std::byte> scratch(std::min<std::uint64_t>(count, kChunk));
  std::uint64_t done = 0;
  while (done < count) {
    const auto got = SLF_TRY(reader.read(
        std::span(scratch).first(std::min<std::uint64_t>(count - done, scratch.size()))));
    if (got == 0) break;
    done += got;
  }
  return done;
}

/// The stored volumes as one stream over all their files, forward only.
class VoxelStream {
 public:
  VoxelStream(const VoxelData& from, const VoxelBytes& bytes)
      : from_(from), bytes_(bytes), at_(bytes.begin) {}

  /// Fills `to` and returns its size, or fewer bytes where a file ends early.
  Result<std::size_t> read(std::span<std::byte> to) {
    std::size_t done = 0;
    while (done < to.size()) {
      SLF_TRY(open());
      const std::size_t wanted =
          std::min<std::uint64_t>(to.size() - done, bytes_.part - at_ % bytes_.part);
      const auto got = SLF_TRY(reader_->read(to.subspan(done, wanted)));
      done += got;
      at_ += got;
      if (got < wanted) break;
    }
    return done;
  }

  Result<void> skip(std::uint64_t count) {
    const bool same_file = reader_ && at_ + count <= (part_ + 1) * bytes_.part;
    if (from_.packed && same_file)
      SLF_TRY(skip_bytes(*reader_, count));
    else
      reader_.reset();
    at_ += count;
    return {};
  }

  /// The number of bytes that follow in the file that was read last, at most `limit`; 0 if the last
  /// call skipped to another file.
  Result<std::uint64_t> rest(std::uint64_t limit) {
    if (!reader_) return 0;
    return skip_bytes(*reader_, limit);
  }

 private:
  /// Opens the file that holds the next byte, unless it is open.
  Result<void> open() {
    const auto part = static_cast<std::size_t>(at_ / bytes_.part);
    if (reader_ && part == part_) return {};
    const std::uint64_t before = from_.skip + at_ % bytes_.part;
    const auto size = SLF_TRY(file_size(from_.files[part]));
    const std::uint64_t offset = offset_in(from_, bytes_, size);
    auto reader = SLF_TRY(ByteReader::open(from_.files[part], offset + (from_.packed ? 0 : before),
                                           from_.packed, from_.packing));
    if (from_.packed) SLF_TRY(skip_bytes(reader, before));
    reader_ = std::move(reader);
    part_ = part;
    return {};
  }

  const VoxelData& from_;
  const VoxelBytes bytes_;
  std::uint64_t at_;      ///< in the volumes
  std::size_t part_ = 0;  ///< of the open reader
  std::optional<ByteReader> reader_;
};

/// Fills `to` with the component of from.component in each voxel, whose values are `width` bytes.
Result<std::size_t> read_component(VoxelStream& stream, const VoxelData& from, std::size_t width,
                                   std::span<std::byte> to) {
  if (from.components == 1) return stream.read(to);
  const std::uint64_t run = from.run * width, stride = run * from.components;
  std::size_t done = 0;
  if (stride <= kChunk) {  // whole voxels at a time
    std::vector<std::byte> chunk(kChunk / stride * stride);
    while (done < to.size()) {
      const std::size_t wanted =
          std::min<std::uint64_t>(chunk.size(), (to.size() - done) / run * stride);
      const auto got = SLF_TRY(stream.read(std::span(chunk).first(wanted)));
      for (std::size_t at = 0; at + stride <= got; at += stride, done += run)
        std::memcpy(&to[done], &chunk[at + from.component * run], run);
      if (got < wanted) break;
    }
    return done;
  }
  while (done < to.size()) {
    SLF_TRY(stream.skip(from.component * run));
    const auto got = SLF_TRY(stream.read(to.subspan(done, run)));
    done += got;
    if (got < run) break;
    SLF_TRY(stream.skip((from.components - 1 - from.component) * run));
  }
  return done;
}

/// "5x4x3 voxels of u8 with 2 components".
std::string describe(const VoxelData& from, const Volume& volume) {
  const std::string text = concat(joined(volume.dims, "x"), " voxels of ", name(volume.type));
  return from.components == 1 ? text : concat(text, " with ", from.components, " components");
}

/// Adds a note if a file goes on after what its header describes: too small a type, say. Reads
/// packed data on, because zlib compares its checksum only past the voxels.
Result<void> note_longer(const VoxelData& from, const VoxelBytes& bytes, VoxelStream& stream,
                         Volume& volume) {
  const std::uint64_t needs = (from.packed ? 0 : from.offset) + from.skip + bytes.part;
  const auto add = [&](const std::string& file, std::uint64_t has) {
    volume.notes.push_back(
        concat(file, " has ", has, from.packed ? " unpacked" : "", " bytes, but ",
               from.volumes > 1 ? concat(from.volumes, " volumes of ") : "", describe(from, volume),
               " need ", needs, ": the rest is not read; check the type and the sizes"));
  };
  if (from.packed) {
    // A hostile stream unpacks to no end.
    constexpr std::uint64_t kMost = std::uint64_t{1} << 26;
    const bool last = from.index + 1 == from.volumes;
    const auto rest = SLF_TRY(stream.rest(last ? std::max(bytes.all, kMost) : 1));
    if (last && rest > 0) add(from.files.back(), needs + rest);
    return {};
  }
  if (from.volumes == 0 || from.at_end) return {};
  for (const std::string& file : from.files) {
    const auto size = SLF_TRY(file_size(file));
    if (size > needs) {
      add(file, size);
      break;
    }
  }
  return {};
}

/// bad_file: a file that is too short for what it must hold of the volume.
Result<void> check_lengths(const VoxelData& from, const VoxelBytes& bytes, const Volume& volume) {
  const auto& files = from.files;
  const std::uint64_t end = bytes.begin + bytes.volume;
  for (std::size_t i = bytes.begin / bytes.part; i * bytes.part < end; ++i) {
    const auto size = file_size(files[i]);
    if (!size && files.size() == 1) return tl::unexpected(size.error());
    if (!size)
      return fail_in(size.error(), volume.source, ": its data file ", i + 1, " of ", files.size(),
                     " cannot be read: ");
    const std::uint64_t offset = offset_in(from, bytes, *size);
    const std::uint64_t there = *size > offset ? *size - offset : 0;
    const std::uint64_t max_bytes =
        from.packed ? max_unpacked(from.packing == Packing::none ? packing_of_file(files[i], offset)
                                                                 : from.packing,
                                   there)
                    : there;
    const std::uint64_t begin = std::max(bytes.begin, i * bytes.part);
    const std::uint64_t needed = std::min(end, (i + 1) * bytes.part) - begin;
    const std::uint64_t before = from.skip + (begin - i * bytes.part);
    if (before > max_bytes || needed > max_bytes - before)
      return bad_file(files[i], describe(from, volume), " need ", needed, " bytes from byte ",
                      offset + before, " on, but the file holds ", there,
                      from.packed ? " packed" : "",
                      " bytes there: it is truncated, or its header is wrong");
  }
  return {};
}

}  // namespace

Result<void> read_voxels(const VoxelData& given, Volume& volume) {
  VoxelData from = given;
  if (!from.packed && !from.at_end && from.files.size() == 1 &&
      is_named_and_packed(from.files[0])) {
    from.packed = true;
    from.skip += std::exchange(from.offset, 0);
  }
  const auto bytes = SLF_TRY(count_bytes(from, volume));
  SLF_TRY(check_lengths(from, bytes, volume));
  volume.files.insert(volume.files.end(), from.files.begin(), from.files.end());
  VoxelStream stream(from, bytes);
  const std::size_t width = bytes_per_voxel(volume.type);
  const std::uint64_t needed = voxel_bytes(volume), run = from.run * width;
  // In steps, so that packed data take memory only as they unpack.
  constexpr std::uint64_t kStep = std::uint64_t{1} << 24;
  const std::uint64_t step = std::max<std::uint64_t>(kStep / run, 1) * run;
  if (!from.packed) volume.voxels.reserve(needed);
  for (std::uint64_t done = 0; done < needed;) {
    const std::uint64_t wanted = std::min(step, needed - done);
    volume.voxels.resize(done + wanted);
    const auto got =
        SLF_TRY(read_component(stream, from, width, std::span(volume.voxels).subspan(done)));
    done += got;
    if (got != wanted)
      return bad_file(from.files.front(), "expected ", needed, " bytes of voxels, found ", done,
                      ": the file is truncated, or its header is wrong");
  }
  SLF_TRY(note_longer(from, bytes, stream, volume));
  if (from.big_endian != (std::endian::native == std::endian::big))
    swap_bytes(volume.voxels, width);
  return {};
}

}  // namespace slf::volume_io

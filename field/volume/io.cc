#include "field/volume/io.h"

#include <zlib.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <limits>

namespace slf::volume_io {

namespace {

constexpr std::size_t kChunk = std::size_t{1} << 18;

}  // namespace

struct ByteReader::State {
  std::string path;
  std::ifstream file;
  bool packed = false;
  bool ended = false;    // the packed stream is complete
  bool started = false;  // inflateInit2 was called and inflateEnd is due
  z_stream stream{};
  std::vector<char> chunk;

  State() = default;
  State(const State&) = delete;
  State& operator=(const State&) = delete;
  ~State() {
    if (started) inflateEnd(&stream);
  }

  void refill() {
    file.read(chunk.data(), static_cast<std::streamsize>(chunk.size()));
    stream.next_in = reinterpret_cast<Bytef*>(chunk.data());
    stream.avail_in = static_cast<uInt>(file.gcount());
  }

  // A gzip file may have several members, one after the other. Anything else after them is ignored.
  bool next_member() {
    if (stream.avail_in == 0) refill();
    if (stream.avail_in == 0 || *stream.next_in != 0x1f) return false;
    return inflateReset(&stream) == Z_OK;
  }

  Result<std::size_t> unpack(std::span<std::byte> to) {
    std::size_t done = 0;
    while (done < to.size() && !ended) {
      if (stream.avail_in == 0) refill();
      const auto room = static_cast<uInt>(std::min<std::size_t>(to.size() - done, 1u << 30));
      stream.next_out = reinterpret_cast<Bytef*>(to.data() + done);
      stream.avail_out = room;
      const int status = inflate(&stream, Z_NO_FLUSH);
      done += room - stream.avail_out;
      if (status == Z_STREAM_END)
        ended = !next_member();
      else if (status == Z_BUF_ERROR && stream.avail_in == 0)
        return fail(ErrorCode::bad_file, path, ": the packed data stop after ", stream.total_out,
                    " unpacked bytes, before their end: the file is truncated, copy it again");
      else if (status != Z_OK)
        return fail(ErrorCode::bad_file, path, ": damaged packed data after ", stream.total_out,
                    " unpacked bytes (", stream.msg ? stream.msg : "not gzip or zlib",
                    "): the file is corrupt, copy it again");
    }
    return done;
  }
};

ByteReader::ByteReader(std::unique_ptr<State> state) : state_(std::move(state)) {}
ByteReader::ByteReader(ByteReader&&) noexcept = default;
ByteReader& ByteReader::operator=(ByteReader&&) noexcept = default;
ByteReader::~ByteReader() = default;

Result<ByteReader> ByteReader::open(const std::string& path, std::uint64_t offset, bool packed) {
  const auto size = file_size(path);
  if (!size) return tl::unexpected(size.error());
  auto state = std::make_unique<State>();
  state->path = path;
  state->packed = packed;
  state->file.open(path, std::ios::binary);
  if (!state->file) return fail(ErrorCode::io, path, ": cannot be opened: ", std::strerror(errno));
  state->file.seekg(static_cast<std::streamoff>(offset));
  if (packed) {
    state->chunk.resize(std::clamp<std::uint64_t>(*size, 1, kChunk));
    constexpr int kGzipOrZlib = 15 + 32;
    if (inflateInit2(&state->stream, kGzipOrZlib) != Z_OK)
      return fail(ErrorCode::failed, path, ": no memory to unpack");
    state->started = true;
  }
  return ByteReader(std::move(state));
}

Result<std::size_t> ByteReader::read(std::span<std::byte> to) {
  if (state_->packed) return state_->unpack(to);
  state_->file.read(reinterpret_cast<char*>(to.data()), static_cast<std::streamsize>(to.size()));
  return static_cast<std::size_t>(state_->file.gcount());
}

Result<std::uint64_t> file_size(const std::string& path) {
  std::error_code code;
  const auto status = std::filesystem::status(path, code);
  if (status.type() == std::filesystem::file_type::not_found)
    return fail(ErrorCode::io, path, ": no such file");
  if (code) return fail(ErrorCode::io, path, ": ", code.message());  // such as permission denied
  if (status.type() != std::filesystem::file_type::regular)
    return fail(ErrorCode::io, path, ": not a regular file");
  const auto size = std::filesystem::file_size(path, code);
  if (code) return fail(ErrorCode::io, path, ": ", code.message());
  return size;
}

Result<std::string> read_head(const std::string& path, std::size_t limit) {
  std::string head(limit, '\0');
  const auto bytes = std::as_writable_bytes(std::span(head));
  bool packed = false;
  for (int attempt = 0; attempt < 2; ++attempt) {
    auto reader = ByteReader::open(path, 0, packed);
    if (!reader) return tl::unexpected(reader.error());
    const auto got = reader->read(bytes);
    if (!got) return tl::unexpected(got.error());
    head.resize(*got);
    packed = head.starts_with("\x1f\x8b");
    if (!packed || attempt == 1) break;
    head.resize(limit);
  }
  return head;
}

std::uint64_t voxel_bytes(const Volume& volume) {
  return volume.voxel_count() * bytes_per_voxel(volume.type);
}

void swap_bytes(std::span<std::byte> values, std::size_t bytes_per_value) {
  for (std::size_t at = 0; at + bytes_per_value <= values.size(); at += bytes_per_value)
    std::reverse(values.begin() + static_cast<std::ptrdiff_t>(at),
                 values.begin() + static_cast<std::ptrdiff_t>(at + bytes_per_value));
}

Result<std::array<std::uint32_t, 3>> check_dims(const std::string& source,
                                                std::span<const std::uint64_t> sizes) {
  if (sizes.size() < 3)
    return fail(ErrorCode::unsupported, source, ": a picture of ", sizes.size(),
                " dimensions, expected a volume of 3: give the file of the whole stack");
  std::array<std::uint32_t, 3> dims{};
  std::uint64_t product = 8;  // the widest voxel, so that a byte count cannot overflow
  for (std::size_t i = 0; i < 3; ++i) {
    if (sizes[i] == 0 || sizes[i] > std::numeric_limits<std::uint32_t>::max() ||
        product > std::numeric_limits<std::int64_t>::max() / sizes[i])
      return fail(ErrorCode::bad_file, source, ": absurd dims ", sizes[0], "x", sizes[1], "x",
                  sizes[2], ": each must be at least 1 and the volume below 2^63 bytes");
    dims[i] = static_cast<std::uint32_t>(sizes[i]);
    product *= sizes[i];
  }
  for (std::size_t i = 0; i < 3; ++i)
    if (dims[i] == 1)
      return fail(ErrorCode::unsupported, source, ": dims ", dims[0], "x", dims[1], "x", dims[2],
                  " are a single slice; a volume has at least 2 voxels along each axis: give the "
                  "file of the whole stack");
  return dims;
}

Result<std::uint32_t> choose(const std::string& source, const std::optional<std::uint32_t>& chosen,
                             std::uint64_t count, std::string_view what) {
  if (!chosen && count > 1)
    return fail(ErrorCode::unsupported, source, ": ", count, " ", what, "s, expected one: choose ",
                what, " 0 to ", count - 1);
  if (chosen.value_or(0) >= count)
    return fail(ErrorCode::usage, source, ": ", what, " ", *chosen, " was chosen, but it has ",
                count, ", counted from 0");
  return chosen.value_or(0);
}

Result<void> expect_one_number(const std::string& source, const VolumeOptions& options) {
  for (const auto& [chosen, what] :
       {std::pair{options.component, "component"}, std::pair{options.time, "time point"}})
    if (const auto ok = choose(source, chosen, 1, what); !ok) return tl::unexpected(ok.error());
  return {};
}

Result<ChosenVolume> choose_volume(const std::string& source, std::vector<std::uint64_t> sizes,
                                   const VolumeOptions& options) {
  while (sizes.size() > 3 && sizes.back() == 1) sizes.pop_back();
  if (sizes.size() > 5) {
    std::string found;
    for (const auto size : sizes)
      found.append(found.empty() ? "" : "x").append(std::to_string(size));
    return fail(ErrorCode::unsupported, source, ": dims ", found,
                ", expected 3, then time, then components: extract one volume into a file of its "
                "own");
  }
  const std::uint64_t times = sizes.size() > 3 ? sizes[3] : 1;
  const std::uint64_t components = sizes.size() > 4 ? sizes[4] : 1;
  std::uint64_t count = 0;
  if (__builtin_mul_overflow(times, components, &count))
    return fail(ErrorCode::bad_file, source, ": absurd dims: ", times, " time points of ",
                components, " components");
  const auto dims =
      check_dims(source, std::span(sizes).first(std::min<std::size_t>(sizes.size(), 3)));
  if (!dims) return tl::unexpected(dims.error());
  const auto time = choose(source, options.time, times, "time point");
  if (!time) return tl::unexpected(time.error());
  std::uint64_t index = 0;
  if (components > 1) {
    const auto component = choose(source, options.component, components, "component");
    if (!component) return tl::unexpected(component.error());
    index = *component * times;
  }
  return ChosenVolume{*dims, index + *time, count, components > 1};
}

Result<void> check_axes(const Volume& volume) {
  double scale = 1;
  for (int i = 0; i < 3; ++i) {
    const double length = glm::length(volume.axes[i]);
    if (!std::isfinite(length) || !(length > 1e-30) || !(length < 1e30))
      return fail(ErrorCode::bad_file, volume.source, ": spacing of axis ", i, " is ", length,
                  ", expected a positive finite number: choose the spacing");
    scale *= length;
    if (!std::isfinite(volume.origin[i]))
      return fail(ErrorCode::bad_file, volume.source, ": origin is not finite");
  }
  const double volume_of_voxel = std::abs(glm::determinant(volume.axes));
  if (!(volume_of_voxel > 1e-6 * scale))
    return fail(ErrorCode::bad_file, volume.source,
                ": its axes are singular: two of them point the same way");
  return {};
}

namespace {

bool is_length(double length) { return length > 1e-30 && length < 1e30; }

}  // namespace

double spacing_or(const VolumeOptions& options, std::size_t axis, double stated) {
  return options.spacing ? (*options.spacing)[static_cast<int>(axis)] : stated;
}

Result<void> place(const VolumeOptions& options, Volume& volume) {
  if (!options.spacing) return check_axes(volume);
  std::vector<int> lost;
  for (int i = 0; i < 3; ++i)
    if (const double length = glm::length(volume.axes[i]); is_length(length))
      volume.axes[i] /= length;
    else
      lost.push_back(i);
  if (lost.size() == 1) {
    const int i = lost.front();
    const glm::dvec3 normal = glm::cross(volume.axes[(i + 1) % 3], volume.axes[(i + 2) % 3]);
    volume.axes[i] = normal / glm::length(normal);  // parallel axes fail the check below
  } else if (lost.size() > 1) {
    volume.axes = glm::dmat3(1);
    volume.notes.emplace_back("it states no directions: its axes are taken as x, y and z");
  }
  for (int i = 0; i < 3; ++i) volume.axes[i] *= (*options.spacing)[i];
  return check_axes(volume);
}

}  // namespace slf::volume_io

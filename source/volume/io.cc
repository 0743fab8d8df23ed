#include "source/volume/io.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <utility>

#include "base/half.h"
#include "base/try.h"

namespace slf::volume_io {

bool ByteReader::refill() {
  file_.read(reinterpret_cast<char*>(chunk_.data()), static_cast<std::streamsize>(chunk_.size()));
  in_ = std::span(chunk_).first(static_cast<std::size_t>(file_.gcount()));
  return !in_.empty();
}

// A packed file may have several members, one after the other. Anything else after them is ignored.
bool ByteReader::next_member() {
  if (in_.empty() && !refill()) return false;
  return begins_member(packing_, in_.front()) && unpacker_->restart();
}

Result<std::size_t> ByteReader::unpack(std::span<std::byte> to) {
  const std::size_t wanted = to.size();
  while (!to.empty() && !ended_) {
    const bool at_end = in_.empty() && !refill();
    const std::size_t room = to.size();
    const auto state = unpacker_->step(in_, to);
    unpacked_ += room - to.size();
    if (state == Unpacker::State::ended)
      ended_ = !next_member();
    else if (state == Unpacker::State::damaged)
      return bad_file(path_, "damaged packed data after ", unpacked_, " unpacked bytes (",
                      unpacker_->problem(), "): the file is corrupt, copy it again");
    else if (at_end && room == to.size())
      return bad_file(path_, "the packed data stop after ", unpacked_,
                      " unpacked bytes, before their end: the file is truncated, copy it again");
  }
  return wanted - to.size();
}

Result<ByteReader> ByteReader::open(const std::string& path, std::uint64_t offset, bool packed,
                                    Packing packing) {
  constexpr std::uint64_t kInputChunk = std::uint64_t{1} << 18;
  const auto size = SLF_TRY(file_size(path));
  ByteReader reader;
  reader.path_ = path;
  reader.file_ = SLF_TRY(open_regular(path));
  reader.file_.seekg(static_cast<std::streamoff>(offset));
  if (packed) {
    reader.chunk_.resize(std::clamp<std::uint64_t>(size, 1, kInputChunk));
    reader.refill();
    const std::string_view head = chars_of(reader.in_);
    if (packing == Packing::none) packing = packing_of(head);
    reader.packing_ = packing == Packing::none ? Packing::zlib : packing;
    reader.unpacker_ = Unpacker::make(reader.packing_);
  }
  return reader;
}

Result<std::size_t> ByteReader::read(std::span<std::byte> to) {
  if (unpacker_) return unpack(to);
  file_.read(reinterpret_cast<char*>(to.data()), static_cast<std::streamsize>(to.size()));
  return static_cast<std::size_t>(file_.gcount());
}

Result<std::string> ByteReader::read_text(std::size_t limit) {
  std::string text(limit, '\0');
  const auto got = SLF_TRY(read(std::as_writable_bytes(std::span(text))));
  text.resize(got);
  return text;
}

Result<std::string> read_head(const std::string& path, std::size_t limit) {
  auto reader = SLF_TRY(ByteReader::open(path, 0, packing_of_file(path) != Packing::none));
  return reader.read_text(limit);
}

bool is_named_and_packed(const std::string& path) {
  return without_packing(path) != path && packing_of_file(path) != Packing::none;
}

std::uint64_t voxel_bytes(const Volume& volume) {
  return volume.voxel_count() * bytes_per_voxel(volume.type);
}

void swap_bytes(std::span<std::byte> values, std::size_t bytes_per_value) {
  for (std::size_t at = 0; at + bytes_per_value <= values.size(); at += bytes_per_value)
    std::reverse(values.begin() + static_cast<std::ptrdiff_t>(at),
                 values.begin() + static_cast<std::ptrdiff_t>(at + bytes_per_value));
}

std::vector<std::byte> floats_of_halves(std::span<const std::byte> halves) {
  std::vector<std::byte> floats(halves.size() * 2);
  for (std::size_t k = 0; 4 * k < floats.size(); ++k) {
    std::uint16_t bits = 0;
    std::memcpy(&bits, &halves[2 * k], sizeof bits);
    const float value = half_to_float(bits);
    std::memcpy(&floats[4 * k], &value, sizeof value);
  }
  return floats;
}

void widen_half_floats(Volume& volume) {
  volume.voxels = floats_of_halves(volume.voxels);
  volume.type = ScalarType::f32;
}

Result<std::array<std::uint32_t, 3>> check_dims(const std::string& source,
                                                const std::vector<std::uint64_t>& sizes) {
  if (sizes.size() < 3)
    return unsupported(source, "a picture of ", sizes.size(),
                       " dimensions, expected a volume of 3: give the file of the whole stack");
  std::array<std::uint32_t, 3> dims{};
  std::uint64_t product = 8;  // the widest voxel, so that a byte count cannot overflow
  for (std::size_t i = 0; i < 3; ++i) {
    if (sizes[i] == 0 || sizes[i] > std::numeric_limits<std::uint32_t>::max() ||
        product > std::numeric_limits<std::int64_t>::max() / sizes[i])
      return bad_file(source, "absurd dims ", sizes[0], "x", sizes[1], "x", sizes[2],
                      ": each must be at least 1 and the volume below 2^63 bytes");
    dims[i] = static_cast<std::uint32_t>(sizes[i]);
    product *= sizes[i];
  }
  for (std::size_t i = 0; i < 3; ++i)
    if (dims[i] == 1)
      return unsupported(source, "dims ", joined(dims, "x"),
                         " are a single slice; a volume has at least 2 voxels along each axis: "
                         "give the file of the whole stack");
  return dims;
}

Result<std::uint32_t> choose(const std::string& source, const std::optional<std::uint32_t>& chosen,
                             std::uint64_t count, std::string_view what) {
  const bool component = what == "component";
  if (!chosen && count > 1)
    return fail_without(component ? "component" : "time", ErrorCode::unsupported, source, ": ",
                        count, " ", what, "s, expected one: choose ", what, " 0 to ", count - 1);
  if (chosen.value_or(0) >= count)
    return fail_without(component ? nullptr : "time", ErrorCode::usage, source, ": ", what, " ",
                        *chosen, " was chosen, but it has ", count, ", counted from 0");
  return chosen.value_or(0);
}

Result<VoxelData> choose_volume(std::vector<std::uint64_t> sizes, std::uint32_t components,
                                const VolumeOptions& options, Volume& volume) {
  const std::string& source = volume.source;
  while (sizes.size() > 3 && sizes.back() == 1) sizes.pop_back();
  if (sizes.size() > 5)
    return unsupported(
        source, "dims ", joined(sizes, "x"),
        ", expected 3, then time, then components: extract one volume into a file of its own");
  const std::uint64_t times = sizes.size() > 3 ? sizes[3] : 1;
  const std::uint64_t outer = sizes.size() > 4 ? sizes[4] : 1;
  VoxelData data{.files = {source}, .components = components};
  if (__builtin_mul_overflow(times, outer, &data.volumes))
    return bad_file(source, "absurd dims: ", times, " time points of ", outer, " components");
  volume.dims = SLF_TRY(check_dims(source, sizes));
  data.index = SLF_TRY(choose(source, options.time, times, "time point"));
  if (outer > 1) {
    const auto component = SLF_TRY(choose(source, options.component, outer, "component"));
    data.index += component * times;
  }
  if (components > 1 || outer == 1)
    data.component = SLF_TRY(choose(source, options.component, components, "component"));
  return data;
}

Result<void> check_axes(const Volume& volume) {
  double scale = 1;
  for (int i = 0; i < 3; ++i) {
    const double length = glm::length(volume.axes[i]);
    if (!std::isfinite(length) || !(length > 1e-30) || !(length < 1e30))
      return fail_without("spacing", ErrorCode::bad_file, volume.source, ": spacing of axis ", i,
                          " is ", length,
                          ", expected a positive finite number: choose the spacing");
    scale *= length;
    if (!std::isfinite(volume.origin[i])) return bad_file(volume.source, "origin is not finite");
  }
  const double volume_of_voxel = std::abs(glm::determinant(volume.axes));
  if (!(volume_of_voxel > 1e-6 * scale))
    return bad_file(volume.source, "its axes are singular: two of them point the same way");
  return {};
}

Result<double> spacing_or(const VolumeOptions& options, std::size_t axis, double stated,
                          const std::string& source, const std::string& field) {
  if (options.spacing) return (*options.spacing)[static_cast<int>(axis)];
  if (stated > 0 && std::isfinite(stated)) return stated;
  return fail_without("spacing", ErrorCode::bad_file, source, ": ", field, " is ", stated,
                      ", expected a positive number: choose the spacing");
}

Result<void> place(const VolumeOptions& options, Volume& volume) {
  if (!options.spacing) return check_axes(volume);
  std::vector<int> lost;
  for (int i = 0; i < 3; ++i)
    if (const double length = glm::length(volume.axes[i]); length > 1e-30 && length < 1e30)
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

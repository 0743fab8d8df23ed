// VTK ImageData (.vti, and .pvti with its pieces in files),
// https://docs.vtk.org/en/latest/design_documents/VTKFileFormats.html.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

#include "base/try.h"
#include "source/volume/io.h"
#include "source/volume/vtk/vti_file.h"

namespace slf::volume_io {
namespace {

Result<std::vector<double>> numbers(const std::string& path, const char* what,
                                    const std::string& text, std::size_t count, double otherwise) {
  if (text.empty()) return std::vector<double>(count, otherwise);
  std::vector<double> result;
  for (const auto word : words(text)) {
    const auto value = parse_number(word);
    if (!value || !std::isfinite(*value) || result.size() == count)
      return bad_file(path, what, " is ", in_quotes(text), ", expected ", count, " numbers");
    result.push_back(*value);
  }
  if (result.size() != count)
    return bad_file(path, what, " is ", in_quotes(text), ", expected ", count, " numbers");
  return result;
}

/// The first and last index along each axis, as written.
struct Extent {
  std::array<std::int64_t, 3> low{}, high{};
};

/// Parses an extent. `of_cells`: of the points around them.
Result<Extent> parse_extent(const std::string& path, const std::string& text, bool of_cells) {
  const auto values = SLF_TRY(numbers(path, "Extent", text, 6, 0));
  Extent extent;
  for (std::size_t i = 0; i < 3; ++i) {
    const double low = values[2 * i], high = values[2 * i + 1];
    if (!(std::abs(low) < 0x1p31) || !(std::abs(high) < 0x1p31) ||
        !(high - low + (of_cells ? 0 : 1) >= 1))
      return bad_file(path, "Extent ", low, " to ", high, " along ", "xyz"[i], " holds no voxels");
    extent.low[i] = static_cast<std::int64_t>(low);
    extent.high[i] = static_cast<std::int64_t>(high) - (of_cells ? 1 : 0);
  }
  return extent;
}

std::vector<std::uint64_t> sizes_of(const Extent& extent) {
  std::vector<std::uint64_t> sizes;
  for (std::size_t i = 0; i < 3; ++i)
    sizes.push_back(static_cast<std::uint64_t>(extent.high[i] - extent.low[i] + 1));
  return sizes;
}

/// Sets dims and position from the extent of the image.
Result<void> set_position(const VtiDocument& d, const Extent& extent, const VolumeOptions& options,
                          Volume& volume) {
  const std::string& path = volume.source;
  const auto origin = SLF_TRY(numbers(path, "Origin", d.origin, 3, 0));
  auto spacing = SLF_TRY(numbers(path, "Spacing", options.spacing ? "" : d.spacing, 3, 1));
  auto direction = SLF_TRY(numbers(path, "Direction", d.direction, 9, 0));
  if (d.direction.empty())
    for (const std::size_t i : {0, 4, 8}) direction[i] = 1;
  if (!options.spacing && d.spacing.empty()) volume.notes.emplace_back(kNoSpacing);

  glm::dvec3 first;
  for (std::size_t i = 0; i < 3; ++i) {
    first[static_cast<int>(i)] = static_cast<double>(extent.low[i]) + (d.array.of_cells ? 0.5 : 0);
    spacing[i] =
        SLF_TRY(spacing_or(options, i, spacing[i], path, std::string("Spacing along ") + "xyz"[i]));
  }
  volume.dims = SLF_TRY(check_dims(path, sizes_of(extent)));
  for (std::size_t axis = 0; axis < 3; ++axis)
    for (std::size_t row = 0; row < 3; ++row)  // the matrix is written row by row
      volume.axes[static_cast<int>(axis)][static_cast<int>(row)] =
          direction[3 * row + axis] * spacing[axis];
  SLF_TRY(place(options, volume));
  volume.origin = glm::dvec3(origin[0], origin[1], origin[2]) + volume.axes * first;
  return check_axes(volume);
}

/// The voxels of a part of the image.
struct Part {
  Extent extent;
  std::vector<std::byte> voxels;
};

/// Reads one component of a piece's array.
Result<Part> read_part(const VtiDocument& d, const VtiPiece& piece, const VtiArray& expected,
                       ScalarType type, std::uint32_t component) {
  const VtiArray& array = piece.array;
  if (!array.found || array.of_cells != expected.of_cells || array.type != expected.type ||
      array.components != expected.components)
    return bad_file(d.path, "the piece of extent ", in_quotes(piece.extent), " lacks the array ",
                    in_quotes(expected.name), " as ", in_quotes(expected.type), " with ",
                    expected.components, " components");
  const auto extent =
      SLF_TRY(parse_extent(d.path, piece.extent.empty() ? d.extent : piece.extent, array.of_cells));
  const std::size_t width = bytes_per_voxel(type);
  std::uint64_t kept = width, needed = 0;
  for (const auto size : sizes_of(extent))
    if (__builtin_mul_overflow(kept, size, &kept))
      return bad_file(d.path, "absurd extent ", in_quotes(piece.extent));
  if (__builtin_mul_overflow(kept, array.components, &needed))
    return bad_file(d.path, "absurd extent and components");
  auto bytes = SLF_TRY(read_vti_data(d, array, type, needed));
  for (std::size_t from = component * width, to = 0; array.components > 1 && from < bytes.size();
       from += width * array.components, to += width)
    std::memmove(&bytes[to], &bytes[from], width);
  bytes.resize(kept);
  return Part{extent, std::move(bytes)};
}

/// Reads the pieces of a document, and those in other files that it names.
Result<std::vector<Part>> read_parts(const VtiDocument& d, ScalarType type, std::uint32_t component,
                                     Volume& volume) {
  std::vector<Part> parts;
  for (const VtiPiece& piece : d.pieces) {
    if (d.type == "ImageData") {
      auto part = SLF_TRY(read_part(d, piece, d.array, type, component));
      parts.push_back(std::move(part));
      continue;
    }
    const std::string file = beside(d.path, piece.source);
    const auto in_file = read_vti_document(file, d.array.name);
    if (!in_file)
      return fail_in(in_file.error(), d.path, ": its piece ", parts.size() + 1, " of ",
                     d.pieces.size(), " cannot be read: ");
    if (in_file->type != "ImageData" || in_file->pieces.size() != 1)
      return bad_file(file, "a VTK file of ", in_quotes(in_file->type), " with ",
                      in_file->pieces.size(), " pieces, expected one piece of ImageData");
    auto part = SLF_TRY(read_part(*in_file, in_file->pieces.front(), d.array, type, component));
    parts.push_back(std::move(part));
    volume.files.push_back(file);
  }
  return parts;
}

/// Joins parts, which may overlap, to an image of this extent.
Result<void> join(const std::vector<Part>& parts, const Extent& extent, Volume& volume) {
  const std::size_t width = bytes_per_voxel(volume.type);
  std::uint64_t held = 0;
  for (const Part& part : parts) {
    held += part.voxels.size() / width;
    for (std::size_t i = 0; i < 3; ++i)
      if (part.extent.low[i] < extent.low[i] || part.extent.high[i] > extent.high[i])
        return bad_file(volume.source, "a piece from ", part.extent.low[i], " to ",
                        part.extent.high[i], " along ", "xyz"[i],
                        " is outside of the image, which goes from ", extent.low[i], " to ",
                        extent.high[i]);
  }
  const auto incomplete = [&] {
    return bad_file(volume.source, "its ", parts.size(),
                    " pieces do not cover its extent: some are missing");
  };
  if (held < volume.voxel_count()) return incomplete();
  volume.voxels.resize(voxel_bytes(volume));
  std::vector<bool> covered(volume.voxel_count());
  for (const Part& part : parts) {
    const auto sizes = sizes_of(part.extent);
    const std::byte* row = part.voxels.data();
    std::array<std::uint64_t, 3> first{};
    for (std::size_t i = 0; i < 3; ++i)
      first[i] = static_cast<std::uint64_t>(part.extent.low[i] - extent.low[i]);
    for (std::uint64_t z = 0; z < sizes[2]; ++z)
      for (std::uint64_t y = 0; y < sizes[1]; ++y, row += sizes[0] * width) {
        const std::uint64_t at =
            ((z + first[2]) * volume.dims[1] + y + first[1]) * volume.dims[0] + first[0];
        std::memcpy(&volume.voxels[at * width], row, sizes[0] * width);
        std::fill_n(covered.begin() + static_cast<std::ptrdiff_t>(at), sizes[0], true);
      }
  }
  if (std::ranges::find(covered, false) != covered.end()) return incomplete();
  return {};
}

/// "'a', 'b'", of untrusted names.
std::string list(const std::vector<std::string>& names) {
  constexpr std::size_t kMost = 16;
  return joined(std::span(names).first(std::min(names.size(), kMost)), ", ", in_quotes) +
         (names.size() > kMost ? " and more" : "");
}

}  // namespace

bool looks_like_vti(std::string_view head) { return head.find("<VTKFile") < 4096; }

Result<Volume> read_vti(const std::string& path, std::string_view, const VolumeOptions& options) {
  const auto d = SLF_TRY(read_vti_document(path, options.array));
  Volume volume{.source = path};
  if (d.type != "ImageData" && d.type != "PImageData")
    return unsupported(path, "a VTK file of ", in_quotes(d.type), ", expected ImageData: ",
                       d.type == "Collection" ? "give one of the files that it lists"
                       : d.type == "PolyData" ? "convert it to PLY, e.g. with ParaView"
                                              : "resample it to an image");
  if (!d.array.found && options.array && !d.names.empty())
    return misuse(path, "no array ", in_quotes(*options.array), "; there are ", list(d.names));
  if (!d.array.found || d.pieces.empty()) return bad_file(path, "it holds no array of data");
  const auto type = parse_scalar_type(d.array.type);
  if (!type)
    return bad_file(path, "the array ", in_quotes(d.array.name), " has type ",
                    in_quotes(d.array.type), ", expected Int8 to UInt64, Float32 or Float64");
  volume.type = *type;
  if (d.names.size() > 1 && !options.array)
    volume.notes.push_back(concat("of its ", d.names.size(), " arrays (", list(d.names), "), ",
                                  in_quotes(d.array.name), " is read"));
  // A single piece may be a part of the whole.
  const bool single = d.type == "ImageData" && d.pieces.size() == 1;
  const auto extent = SLF_TRY(parse_extent(
      path, single && !d.pieces.front().extent.empty() ? d.pieces.front().extent : d.extent,
      d.array.of_cells));
  SLF_TRY(set_position(d, extent, options, volume));
  const auto component = SLF_TRY(choose(path, options.component, d.array.components, "component"));
  SLF_TRY(choose(path, options.time, 1, "time point"));
  auto parts = SLF_TRY(read_parts(d, *type, component, volume));
  if (single)
    volume.voxels = std::move(parts.front().voxels);
  else
    SLF_TRY(join(parts, extent, volume));
  return volume;
}

}  // namespace slf::volume_io

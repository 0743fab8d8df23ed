// VTK ImageData (.vti), https://docs.vtk.org/en/latest/design_documents/VTKFileFormats.html.
//
// Why not VTK's own reader? It allocates by extents that it does not check, and reports on stderr.
#include <cmath>
#include <cstring>

#include "field/volume/io.h"
#include "field/volume/vti_file.h"

namespace slf::volume_io {
namespace {

Result<std::vector<double>> numbers(const std::string& path, const char* what,
                                    const std::string& text, std::size_t count, double otherwise) {
  if (text.empty()) return std::vector<double>(count, otherwise);
  std::vector<double> result;
  for (const auto word : words(text)) {
    const auto value = parse_number(word);
    if (!value || !std::isfinite(*value) || result.size() == count)
      return fail(ErrorCode::bad_file, path, ": ", what, " is ", in_quotes(text), ", expected ",
                  count, " numbers");
    result.push_back(*value);
  }
  if (result.size() != count)
    return fail(ErrorCode::bad_file, path, ": ", what, " is ", in_quotes(text), ", expected ",
                count, " numbers");
  return result;
}

/// Sets dims and position from the extent of the one piece.
Result<void> set_position(const VtiDocument& d, Volume& volume) {
  const std::string& path = volume.source;
  const auto extent =
      numbers(path, "Extent", d.piece_extent.empty() ? d.extent : d.piece_extent, 6, 0);
  if (!extent) return tl::unexpected(extent.error());
  const auto origin = numbers(path, "Origin", d.origin, 3, 0);
  if (!origin) return tl::unexpected(origin.error());
  const auto spacing = numbers(path, "Spacing", d.spacing, 3, 1);
  if (!spacing) return tl::unexpected(spacing.error());
  auto direction = numbers(path, "Direction", d.direction, 9, 0);
  if (!direction) return tl::unexpected(direction.error());
  if (d.direction.empty())
    for (const std::size_t i : {0, 4, 8}) (*direction)[i] = 1;

  std::vector<std::uint64_t> sizes;
  glm::dvec3 first;
  for (std::size_t i = 0; i < 3; ++i) {
    const double low = (*extent)[2 * i], high = (*extent)[2 * i + 1];
    const double size = high - low + (d.of_cells ? 0 : 1);
    if (!(std::abs(low) < 0x1p31) || !(std::abs(high) < 0x1p31) || !(size >= 1))
      return fail(ErrorCode::bad_file, path, ": Extent ", low, " to ", high, " along ", "xyz"[i],
                  " holds no voxels");
    sizes.push_back(static_cast<std::uint64_t>(size));
    first[static_cast<int>(i)] = low + (d.of_cells ? 0.5 : 0);
    if (!((*spacing)[i] > 0))
      return fail(ErrorCode::bad_file, path, ": Spacing ", (*spacing)[i], " along ", "xyz"[i],
                  ", expected a positive number");
  }
  const auto dims = check_dims(path, sizes);
  if (!dims) return tl::unexpected(dims.error());
  volume.dims = *dims;
  for (std::size_t axis = 0; axis < 3; ++axis)
    for (std::size_t row = 0; row < 3; ++row)  // the matrix is written row by row
      volume.axes[static_cast<int>(axis)][static_cast<int>(row)] =
          (*direction)[3 * row + axis] * (*spacing)[axis];
  volume.origin = glm::dvec3((*origin)[0], (*origin)[1], (*origin)[2]) + volume.axes * first;
  return check_axes(volume);
}

}  // namespace

bool looks_like_vti(std::string_view head) { return head.find("<VTKFile") < 4096; }

Result<Volume> read_vti(const std::string& path, const VolumeOptions& options) {
  const auto document = read_vti_document(path);
  if (!document) return tl::unexpected(document.error());
  const VtiDocument& d = *document;
  Volume volume;
  volume.source = path;
  if (d.type != "ImageData")
    return fail(ErrorCode::unsupported, path, ": a VTK file of ", in_quotes(d.type),
                ", expected ImageData: resample it to an image");
  if (d.pieces > 1)
    return fail(ErrorCode::unsupported, path, ": ", d.pieces,
                " pieces, expected one: save it in one piece");
  if (!d.compressor.empty() && d.compressor != "vtkZLibDataCompressor")
    return fail(ErrorCode::unsupported, path, ": packed by ", in_quotes(d.compressor),
                ", expected vtkZLibDataCompressor or none: save it with ZLib or without "
                "compression");
  if (!d.array.found) return fail(ErrorCode::bad_file, path, ": it holds no array of data");
  const auto type = parse_scalar_type(d.array.type);
  if (!type)
    return fail(ErrorCode::bad_file, path, ": the array ", in_quotes(d.array.name), " has type ",
                in_quotes(d.array.type), ", expected Int8 to UInt64, Float32 or Float64");
  volume.type = *type;
  if (d.others > 0)
    volume.notes.push_back("of its " + std::to_string(d.others + 1) + " arrays, " +
                           in_quotes(d.array.name) + " is read");
  if (auto done = set_position(d, volume); !done) return tl::unexpected(done.error());
  const auto component = choose(path, options.component, d.array.components, "component");
  if (!component) return tl::unexpected(component.error());
  if (const auto ok = choose(path, options.time, 1, "time point"); !ok)
    return tl::unexpected(ok.error());
  const std::size_t width = bytes_per_voxel(*type);
  std::uint64_t needed = 0;
  if (__builtin_mul_overflow(voxel_bytes(volume), d.array.components, &needed))
    return fail(ErrorCode::bad_file, path, ": absurd extent and components");
  auto bytes = read_vti_data(d, volume, needed);
  if (!bytes) return tl::unexpected(bytes.error());
  for (std::size_t from = *component * width, to = 0;
       d.array.components > 1 && from < bytes->size();
       from += width * d.array.components, to += width)
    std::memmove(&(*bytes)[to], &(*bytes)[from], width);
  bytes->resize(voxel_bytes(volume));
  volume.voxels = std::move(*bytes);
  return volume;
}

}  // namespace slf::volume_io

// NRRD (.nrrd, or .nhdr with its data file), https://teem.sourceforge.net/nrrd/format.html.
//
// Why our own reader, not ITK or teem? Every size must be checked against the file before memory is
// allocated. That requires parsing the header, and the rest is only voxels, raw or deflated.
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "field/volume/io.h"

namespace slf::volume_io {

namespace {

constexpr double kUnset = std::numeric_limits<double>::quiet_NaN();

struct Axis {
  std::uint64_t size = 0;
  double spacing = kUnset;
  double min = kUnset;
  std::string kind;
  std::string centering;
  std::optional<glm::dvec3> direction;  // unset: "none", or no directions at all
};

using FieldMap = std::map<std::string, std::string, std::less<>>;

struct Header {
  FieldMap fields;
  std::size_t bytes = 0;  // up to and including the blank line
};

Result<Header> parse_lines(const std::string& path, std::string_view head) {
  Header header;
  std::size_t at = std::min(head.find('\n'), head.size() - 1) + 1;  // after the magic
  for (int number = 2; at < head.size(); ++number) {
    const auto line = next_line(head, at);
    if (line.empty()) break;
    const auto colon = line.find(':');
    if (line.starts_with('#') || line.substr(0, line.find(":=")).size() < line.size()) continue;
    if (colon == std::string_view::npos)
      return fail(ErrorCode::bad_file, path, ": line ", number, " of the NRRD header is ",
                  in_quotes(line), ", expected 'field: value'");
    std::string field = lower(trim(line.substr(0, colon)));
    std::erase(field, ' ');
    header.fields[field] = trim(line.substr(colon + 1));
  }
  header.bytes = at;
  return header;
}

Result<std::string> required(const std::string& path, const FieldMap& fields,
                             std::string_view field) {
  const auto found = fields.find(field);
  if (found == fields.end())
    return fail(ErrorCode::bad_file, path, ": the NRRD header has no '", field, ":' line");
  return found->second;
}

/// The words of a per-axis field, one per axis. Empty if the field is missing.
Result<std::vector<std::string_view>> per_axis(const std::string& path, const FieldMap& fields,
                                               std::string_view field, std::size_t axes) {
  const auto found = fields.find(field);
  if (found == fields.end()) return std::vector<std::string_view>{};
  auto result = words(found->second);
  if (result.size() != axes)
    return fail(ErrorCode::bad_file, path, ": '", field, ": ", in_quotes(found->second), "' has ",
                result.size(), " values, expected one for each of the ", axes, " axes");
  return result;
}

/// Parses "(x,y,z)". Drops a fourth component, which is time.
std::optional<glm::dvec3> parse_vector(std::string_view text) {
  if (!text.starts_with('(') || !text.ends_with(')')) return std::nullopt;
  text = text.substr(1, text.size() - 2);
  glm::dvec3 result(0.0);
  int count = 0;
  for (bool more = true; more; ++count) {
    const auto comma = text.find(',');
    more = comma != std::string_view::npos;
    const auto value = parse_number(text.substr(0, comma));
    if (!value || count >= 4) return std::nullopt;
    if (count < 3) result[count] = *value;
    if (more) text.remove_prefix(comma + 1);
  }
  if (count < 3) return std::nullopt;
  return result;
}

/// Splits "(1, 0,0) none (0,1,0)" into its parts.
std::vector<std::string_view> vectors_of(std::string_view text) {
  std::vector<std::string_view> result;
  for (text = trim(text); !text.empty(); text = trim(text)) {
    auto end = text.starts_with('(') ? text.find(')') : text.find_first_of(" \t(");
    if (end != std::string_view::npos && text[end] == ')') ++end;
    result.push_back(text.substr(0, end));
    text.remove_prefix(result.back().size());
  }
  return result;
}

Result<void> parse_directions(const std::string& path, const std::string& text,
                              std::vector<Axis>& axes) {
  const auto parts = vectors_of(text);
  if (parts.size() != axes.size())
    return fail(ErrorCode::bad_file, path, ": 'space directions' has ", parts.size(),
                " vectors, expected one for each of the ", axes.size(), " axes");
  for (std::size_t i = 0; i < axes.size(); ++i) {
    if (lower(parts[i]) == "none") continue;
    axes[i].direction = parse_vector(parts[i]);
    if (!axes[i].direction)
      return fail(ErrorCode::bad_file, path, ": 'space directions' ", i, " is ",
                  in_quotes(parts[i]), ", expected a vector as (x,y,z)");
  }
  return {};
}

Result<void> parse_numbers(const std::string& path, const FieldMap& fields, std::string_view field,
                           std::vector<Axis>& axes, double Axis::*to) {
  const auto values = per_axis(path, fields, field, axes.size());
  if (!values) return tl::unexpected(values.error());
  for (std::size_t i = 0; i < values->size(); ++i) {
    const auto value = parse_number((*values)[i]);
    if (!value)
      return fail(ErrorCode::bad_file, path, ": '", field, "' ", i, " is ", in_quotes((*values)[i]),
                  ", expected a number");
    axes[i].*to = *value;
  }
  return {};
}

/// Whether an axis is one of components, not of space (teem's range kinds).
bool is_range(const Axis& axis) {
  const auto& k = axis.kind;
  return !(k.empty() || k == "none" || k == "???" || k == "domain" || k == "space" || k == "time");
}

Result<std::vector<Axis>> parse_axes(const std::string& path, const FieldMap& fields) {
  const auto dimension = required(path, fields, "dimension");
  if (!dimension) return tl::unexpected(dimension.error());
  const auto rank = parse_integer(*dimension);
  if (!rank || *rank < 1 || *rank > 16)
    return fail(ErrorCode::bad_file, path, ": 'dimension' is ", in_quotes(*dimension),
                ", expected 1 to 16");
  std::vector<Axis> axes(static_cast<std::size_t>(*rank));
  if (auto text = required(path, fields, "sizes"); !text) return tl::unexpected(text.error());
  const auto sizes = per_axis(path, fields, "sizes", axes.size());
  if (!sizes) return tl::unexpected(sizes.error());
  for (std::size_t i = 0; i < axes.size(); ++i) {
    const auto size = parse_integer((*sizes)[i]);
    if (!size || *size < 1)
      return fail(ErrorCode::bad_file, path, ": 'sizes' ", i, " is ", in_quotes((*sizes)[i]),
                  ", expected a positive integer");
    axes[i].size = static_cast<std::uint64_t>(*size);
  }
  if (auto r = parse_numbers(path, fields, "spacings", axes, &Axis::spacing); !r)
    return tl::unexpected(r.error());
  if (auto r = parse_numbers(path, fields, "axismins", axes, &Axis::min); !r)
    return tl::unexpected(r.error());
  const auto kinds = per_axis(path, fields, "kinds", axes.size());
  if (!kinds) return tl::unexpected(kinds.error());
  for (std::size_t i = 0; i < kinds->size(); ++i) axes[i].kind = lower((*kinds)[i]);
  for (const auto* field : {"centerings", "centers"}) {
    const auto centerings = per_axis(path, fields, field, axes.size());
    if (!centerings) return tl::unexpected(centerings.error());
    for (std::size_t i = 0; i < centerings->size(); ++i)
      axes[i].centering = lower((*centerings)[i]);
  }
  if (const auto found = fields.find("spacedirections"); found != fields.end())
    if (auto r = parse_directions(path, found->second, axes); !r) return tl::unexpected(r.error());
  return axes;
}

/// The extents of the axes that are not of space: components before these, time points after.
struct OtherExtents {
  std::uint64_t components = 1, times = 1;
};

/// Keeps the three axes of space. Drops axes of extent 1 beyond three, those of components first.
Result<OtherExtents> keep_space(const std::string& path, bool directed, std::vector<Axis>& axes) {
  const auto beyond = [&](const Axis& a) { return is_range(a) || (directed && !a.direction); };
  std::erase_if(axes, [&](const Axis& a) { return a.size == 1 && beyond(a); });
  for (std::size_t i = axes.size(); i-- > 0 && axes.size() > 3;)
    if (axes[i].size == 1) axes.erase(axes.begin() + static_cast<std::ptrdiff_t>(i));
  const std::vector<Axis> all = axes;
  OtherExtents others;
  if (axes.size() > 3 && beyond(axes.front())) {
    others.components = axes.front().size;
    axes.erase(axes.begin());
  }
  if (axes.size() == 4 && (beyond(axes.back()) || std::none_of(axes.begin(), axes.end(), beyond))) {
    others.times = axes.back().size;
    axes.pop_back();
  }
  if (axes.size() <= 3 && std::none_of(axes.begin(), axes.end(), beyond)) return others;
  std::string found;
  for (const Axis& axis : all)
    found.append(found.empty() ? "" : "x")
        .append(std::to_string(axis.size))
        .append(axis.kind.empty() ? "" : " (" + in_quotes(axis.kind) + ")");
  return fail(ErrorCode::unsupported, path, ": sizes ", found,
              ", expected 3 axes of space, with components before and time after them: extract one "
              "volume, e.g. `unu slice -a AXIS -p INDEX -i IN -o OUT.nrrd`");
}

/// Converts from the header's space to LPS. Other spaces do not change, as in ITK.
glm::dvec3 to_lps(const FieldMap& fields) {
  const auto found = fields.find("space");
  std::string space = found == fields.end() ? "" : lower(found->second);
  if (space.ends_with("-time"))
    space.resize(space.size() - 5);
  else if (space.size() == 4 && space.ends_with('t'))
    space.resize(3);
  if (space == "ras" || space == "right-anterior-superior") return {-1, -1, 1};
  if (space == "las" || space == "left-anterior-superior") return {1, -1, 1};
  return {1, 1, 1};
}

Result<void> place_directed(const FieldMap& fields, const std::vector<Axis>& axes, Volume& volume) {
  const glm::dvec3 flip = to_lps(fields);
  for (int i = 0; i < 3; ++i)
    volume.axes[i] = flip * *axes[static_cast<std::size_t>(i)].direction + 0.0;
  if (const auto found = fields.find("spaceorigin"); found != fields.end()) {
    const auto origin = parse_vector(found->second);
    if (!origin)
      return fail(ErrorCode::bad_file, volume.source, ": 'space origin' is ",
                  in_quotes(found->second), ", expected a vector as (x,y,z)");
    volume.origin = flip * *origin + 0.0;
  }
  return check_axes(volume);
}

// Without a space, uses the grid's own axes. The axis mins give the origin if all are known. A min
// is the edge of the first voxel, unless the samples are at nodes.
Result<void> place_by_spacing(const FieldMap& fields, const std::vector<Axis>& axes,
                              Volume& volume) {
  const bool has_spacing = fields.contains("spacings");
  bool has_mins = true;
  for (int i = 0; i < 3; ++i) {
    const Axis& axis = axes[static_cast<std::size_t>(i)];
    const double spacing = has_spacing ? axis.spacing : 1;
    if (!(spacing > 0) || !std::isfinite(spacing))
      return fail(ErrorCode::bad_file, volume.source, ": 'spacings' ", i, " is ", spacing,
                  ", expected a positive number");
    volume.axes[i][i] = spacing;
    volume.origin[i] = axis.min + (axis.centering == "node" ? 0 : spacing / 2);
    has_mins = has_mins && std::isfinite(axis.min);
  }
  if (!has_mins) volume.origin = glm::dvec3(0.0);
  return check_axes(volume);
}

Result<std::uint64_t> parse_skip(const std::string& path, const FieldMap& fields,
                                 std::string_view field, std::int64_t min) {
  const auto found = fields.find(field);
  if (found == fields.end()) return 0;
  const auto value = parse_integer(found->second);
  if (!value || *value < min || *value > (std::int64_t{1} << 53))
    return fail(ErrorCode::bad_file, path, ": '", field, "' is ", in_quotes(found->second),
                ", expected a count");
  return static_cast<std::uint64_t>(*value);  // -1, the end of the file, becomes the largest
}

Result<std::uint64_t> offset_after_lines(const std::string& path, std::uint64_t from,
                                         std::uint64_t lines) {
  std::ifstream file(path, std::ios::binary);
  file.seekg(static_cast<std::streamoff>(from));
  for (std::uint64_t line = 0; line < lines; ++line) {
    file.ignore(std::numeric_limits<std::streamsize>::max(), '\n');
    if (!file) return fail(ErrorCode::bad_file, path, ": 'line skip' is ", lines, ", found ", line);
  }
  return static_cast<std::uint64_t>(file.tellg());
}

Result<bool> parse_packed(const std::string& path, const FieldMap& fields) {
  const auto text = required(path, fields, "encoding");
  if (!text) return tl::unexpected(text.error());
  const std::string encoding = lower(*text);
  if (encoding == "raw") return false;
  if (encoding == "gzip" || encoding == "gz") return true;
  for (const auto* known : {"txt", "text", "ascii", "hex", "bz2", "bzip2", "zrl"})
    if (encoding == known)
      return fail(ErrorCode::unsupported, path, ": encoding ", known,
                  ", expected raw or gzip: `unu save -e gzip -f nrrd -i IN -o OUT.nrrd`");
  return fail(ErrorCode::bad_file, path, ": 'encoding' is ", in_quotes(*text),
              ", expected raw or gzip");
}

Result<bool> parse_big_endian(const std::string& path, const FieldMap& fields, ScalarType type) {
  const auto found = fields.find("endian");
  const std::string endian = found == fields.end() ? "" : lower(found->second);
  if (endian == "little" || endian == "big") return endian == "big";
  if (bytes_per_voxel(type) == 1) return false;
  return fail(ErrorCode::bad_file, path, ": 'endian' is ", in_quotes(endian),
              ", expected 'endian: little' or 'endian: big'");
}

/// Finds the voxels. The file holds `copies` times the volume's bytes: components × time points.
Result<VoxelData> locate(const std::string& path, const Header& header, const Volume& volume,
                         std::uint64_t copies) {
  const auto& fields = header.fields;
  VoxelData data{.path = path, .offset = header.bytes};
  if (const auto found = fields.find("datafile"); found != fields.end()) {
    if (found->second.starts_with("LIST") || found->second.find('%') != std::string::npos)
      return fail(ErrorCode::unsupported, path, ": voxels spread over several data files (",
                  in_quotes(found->second), "): join them, `unu save -f nrrd -i IN -o OUT.nrrd`");
    data.path = beside(path, found->second);
    data.offset = 0;
  }
  const auto packed = parse_packed(path, fields);
  if (!packed) return tl::unexpected(packed.error());
  data.packed = *packed;
  const auto big_endian = parse_big_endian(path, fields, volume.type);
  if (!big_endian) return tl::unexpected(big_endian.error());
  data.big_endian = *big_endian;
  const auto size = file_size(data.path);
  if (!size)
    return fail(size.error().code, path, ": its data file cannot be read: ", size.error().message);
  const auto lines = parse_skip(path, fields, "lineskip", 0);
  if (!lines) return tl::unexpected(lines.error());
  const auto offset = offset_after_lines(data.path, data.offset, *lines);
  if (!offset) return tl::unexpected(offset.error());
  data.offset = *offset;
  const auto skip = parse_skip(path, fields, "byteskip", data.packed ? 0 : -1);
  if (!skip) return tl::unexpected(skip.error());
  data.skip = *skip;
  if (static_cast<std::int64_t>(data.skip) == -1) {  // the voxels are at the end of the file
    data.skip = 0;
    std::uint64_t bytes = 0;
    if (!__builtin_mul_overflow(voxel_bytes(volume), copies, &bytes) && *size >= bytes)
      data.offset = *size - bytes;
  }
  return data;
}

}  // namespace

Result<Volume> read_nrrd(const std::string& path, std::string_view head,
                         const VolumeOptions& options) {
  const auto header = parse_lines(path, head);
  if (!header) return tl::unexpected(header.error());
  const FieldMap& fields = header->fields;
  Volume volume;
  volume.source = path;

  const auto type_name = required(path, fields, "type");
  if (!type_name) return tl::unexpected(type_name.error());
  const auto type = parse_scalar_type(*type_name);
  if (!type)
    return fail(ErrorCode::bad_file, path, ": 'type' is ", in_quotes(*type_name),
                ", expected one number, 8 to 64 bits wide");
  volume.type = *type;

  auto axes = parse_axes(path, fields);
  if (!axes) return tl::unexpected(axes.error());
  const bool directed = fields.contains("spacedirections");
  const auto others = keep_space(path, directed, *axes);
  if (!others) return tl::unexpected(others.error());
  if (others->components > 4096)
    return fail(ErrorCode::unsupported, path, ": ", others->components,
                " components a voxel, expected at most 4096");
  std::vector<std::uint64_t> sizes;
  for (const Axis& axis : *axes) sizes.push_back(axis.size);
  const auto dims = check_dims(path, sizes);
  if (!dims) return tl::unexpected(dims.error());
  volume.dims = *dims;
  const auto placed =
      directed ? place_directed(fields, *axes, volume) : place_by_spacing(fields, *axes, volume);
  if (!placed) return tl::unexpected(placed.error());

  const auto time = choose(path, options.time, others->times, "time point");
  if (!time) return tl::unexpected(time.error());
  auto data = locate(path, *header, volume, others->components * others->times);
  if (!data) return tl::unexpected(data.error());
  data->components = static_cast<std::uint32_t>(others->components);
  const auto component = choose(path, options.component, data->components, "component");
  if (!component) return tl::unexpected(component.error());
  data->component = *component;
  if (auto ok = skip_volumes(*time, volume, *data); !ok) return tl::unexpected(ok.error());
  if (auto read = read_voxels(*data, volume); !read) return tl::unexpected(read.error());
  return volume;
}

}  // namespace slf::volume_io

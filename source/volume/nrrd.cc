// NRRD (.nrrd, or .nhdr with its data file), https://teem.sourceforge.net/nrrd/format.html.
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <set>

#include "base/try.h"
#include "source/volume/io.h"
#include "source/volume/units.h"

namespace slf::volume_io {

namespace {

constexpr double kUnset = std::numeric_limits<double>::quiet_NaN();

/// What an index along an axis chooses.
enum class Role : std::uint8_t { space, component, time };

struct Axis {
  std::uint64_t size = 0;
  double spacing = kUnset, thickness = kUnset;
  double min = kUnset, max = kUnset;
  std::string kind;
  std::string centering;
  std::optional<glm::dvec3> direction;  // unset: "none", or no directions at all
  Role role = Role::space;              // see assign_roles()

  [[nodiscard]] double intervals() const {
    return centering == "node" ? double(size) - 1 : static_cast<double>(size);
  }
};

Result<TextHeader> parse_nrrd_lines(const std::string& path, std::string_view head) {
  TextHeader header{.path = path};
  std::string_view rest = head;
  next_line(rest);  // the magic
  for (int number = 2; !rest.empty(); ++number) {
    const auto line = next_line(rest);
    if (line.empty()) break;
    const auto colon = line.find(':');
    if (line.starts_with('#') || line.find(":=") != std::string_view::npos) continue;
    if (colon == std::string_view::npos)
      return bad_file(path, "line ", number, " of the NRRD header is ", in_quotes(line),
                      ", expected 'field: value'");
    std::string field = lower_case(trim(line.substr(0, colon)));
    std::erase(field, ' ');
    header.fields[field] = trim(line.substr(colon + 1));
    if (field == "datafile" && header.fields[field].starts_with("LIST")) {
      header.list(rest);
      rest = {};
    }
  }
  header.bytes = head.size() - rest.size();
  return header;
}

/// Parses "(x,y,z)"; NaNs stand for "none". Drops a fourth component, which is time.
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
    return bad_file(path, "'space directions' has ", parts.size(),
                    " vectors, expected one for each of the ", axes.size(), " axes");
  for (std::size_t i = 0; i < axes.size(); ++i) {
    if (lower_case(parts[i]) == "none") continue;
    axes[i].direction = parse_vector(parts[i]);
    if (axes[i].direction && std::isnan(axes[i].direction->x + axes[i].direction->y)) {
      axes[i].direction.reset();
      continue;
    }
    if (!axes[i].direction)
      return bad_file(path, "'space directions' ", i, " is ", in_quotes(parts[i]),
                      ", expected a vector as (x,y,z)");
  }
  return {};
}

/// Whether an axis is one of components, not of space (teem's range kinds).
bool is_range(const Axis& axis) {
  const auto& k = axis.kind;
  return !(k.empty() || k == "none" || k == "???" || k == "domain" || k == "space" || k == "time");
}

Result<std::vector<Axis>> parse_axes(const TextHeader& header) {
  const auto rank = SLF_TRY(header.integer("dimension", 1, 16));
  std::vector<Axis> axes(static_cast<std::size_t>(rank));
  const auto sizes = SLF_TRY(header.sizes("sizes", axes.size()));
  std::uint64_t voxels = 1;
  for (std::size_t i = 0; i < axes.size(); ++i) {
    axes[i].size = sizes[i];
    if (__builtin_mul_overflow(voxels, sizes[i], &voxels))
      return bad_file(header.path, "absurd 'sizes'");
  }
  for (const auto& [field, to] :
       {std::pair{"spacings", &Axis::spacing}, std::pair{"thicknesses", &Axis::thickness},
        std::pair{"axismins", &Axis::min}, std::pair{"axismaxs", &Axis::max}}) {
    const auto numbers = SLF_TRY(header.numbers(field, axes.size()));
    for (std::size_t i = 0; i < numbers.size(); ++i) axes[i].*to = numbers[i];
  }
  for (const auto& [field, to] :
       {std::pair{"kinds", &Axis::kind}, std::pair{"centerings", &Axis::centering},
        std::pair{"centers", &Axis::centering}}) {
    const auto parts = SLF_TRY(header.parts(field, axes.size()));
    for (std::size_t i = 0; i < parts.size(); ++i) axes[i].*to = lower_case(parts[i]);
  }
  if (const auto* text = header.find("spacedirections"))
    SLF_TRY(parse_directions(header.path, *text, axes));
  return axes;
}

/// The lines of a header, in lower case.
std::vector<std::string> header_lines(std::string_view head) {
  std::vector<std::string> lines;
  while (!head.empty()) {
    lines.push_back(lower_case(trim(next_line(head))));
    if (lines.back().empty()) break;  // voxels follow
  }
  return lines;
}

/// Whether 3D Slicer wrote it as a sequence or a MultiVolume, whose list is one of time points.
bool is_sequence(const std::vector<std::string>& lines) {
  return std::ranges::any_of(lines, [](const std::string& line) {
    return line.starts_with("multivolume.") ||
           (line.starts_with("labels:") && line.find("\"frame\"") != line.npos) ||
           (line.starts_with("axis ") && line.find(" index ") != line.npos);
  });
}

/// Makes the first axis of a MultiVolume a list, which may be called a vector, or nothing.
void name_list_of_frames(const std::vector<std::string>& lines, Axis& first) {
  constexpr std::string_view kFrames = "multivolume.numberofframes:=";
  const bool open = first.kind == "vector" || first.kind == "none" || first.kind == "???";
  for (const std::string_view line : lines)
    if (line.starts_with(kFrames) && (open || first.kind.empty()) &&
        trim(line.substr(kFrames.size())) == std::to_string(first.size))
      first.kind = "list";
}

/// Gives each axis its role by its kind or, without one, by its place among the others: three are
/// of space, and at most one each of components and time. Drops axes of extent 1 beyond three,
/// those that are not of space first. `directed`: the header has directions, which other axes lack.
/// `sequence`: lists are of time points.
Result<void> assign_roles(const std::string& path, bool directed, bool sequence,
                          std::vector<Axis>& axes) {
  const auto is_other = [&](const Axis& a) {
    return is_range(a) || a.kind == "time" || (directed && !a.direction);
  };
  std::erase_if(axes, [&](const Axis& a) { return a.size == 1 && is_other(a); });
  for (std::size_t i = axes.size(); i-- > 0 && axes.size() > 3;)
    if (axes[i].size == 1) axes.erase(axes.begin() + static_cast<std::ptrdiff_t>(i));
  // Without kinds, the axis after three of space is time.
  const std::ptrdiff_t before = axes.size() == 5 && is_other(axes.front()) ? 1 : 0;
  const bool unnamed =
      std::ssize(axes) == before + 4 && std::none_of(axes.begin() + before, axes.end(), is_other);
  for (Axis& axis : axes) {
    const bool last = &axis == &axes.back();
    if (!is_other(axis) && !(last && unnamed)) continue;
    // Lists and axes without a kind are components before those of space, times after them.
    const bool open = !is_range(axis) || axis.kind == "list";
    const bool time = axis.kind == "time" || (sequence && axis.kind == "list");
    axis.role = time || (open && last) ? Role::time : Role::component;
  }
  const auto count = [&](Role role) { return std::ranges::count(axes, role, &Axis::role); };
  if (count(Role::space) == 3 && count(Role::component) <= 1 && count(Role::time) <= 1) return {};
  const std::string found = joined(axes, "x", [](const Axis& axis) {
    return concat(axis.size, axis.kind.empty() ? "" : " (" + in_quotes(axis.kind) + ")");
  });
  return unsupported(path, "sizes ", found,
                     ", expected 3 axes of space, one of components and one of time: extract one "
                     "volume, e.g. `unu slice -a AXIS -p INDEX -i IN -o OUT.nrrd`");
}

/// Chooses a component and a time point. Those behind all axes of space number whole volumes;
/// others are components of a voxel, which may be stored in runs.
Result<void> choose_in_axes(const std::string& path, const std::vector<Axis>& axes,
                            const VolumeOptions& options, VoxelData& data) {
  const auto chosen = [&](Role role) -> Result<std::uint32_t> {
    const auto axis = std::ranges::find(axes, role, &Axis::role);
    const bool time = role == Role::time;
    return choose(path, time ? options.time : options.component,
                  axis == axes.end() ? 1 : axis->size, time ? "time point" : "component");
  };
  const std::uint64_t time = SLF_TRY(chosen(Role::time));
  const std::uint64_t component = SLF_TRY(chosen(Role::component));
  std::size_t in_volume = axes.size();  // axes before those that number volumes
  while (axes[in_volume - 1].role != Role::space) --in_volume;
  std::uint64_t components = 1, own = 0, end = 0;  // where the runs of all components end
  data.volumes = 1;
  for (std::size_t i = 0, run = 1; i < axes.size(); run *= axes[i++].size) {
    if (axes[i].role == Role::space) continue;
    const std::uint64_t index = axes[i].role == Role::time ? time : component;
    if (i >= in_volume) {
      data.index += index * data.volumes;
      data.volumes *= axes[i].size;
      continue;
    }
    if (end == 0) data.run = run;
    if (end != 0 && end != run)
      return unsupported(path,
                         "its axes of components and time have one of space between them: permute "
                         "them, e.g. `unu permute`");
    own += index * components;
    components *= axes[i].size;
    end = run * axes[i].size;
  }
  if (components > std::numeric_limits<std::uint32_t>::max())
    return bad_file(path, "absurd 'sizes': ", components, " components");
  data.components = static_cast<std::uint32_t>(components);
  data.component = static_cast<std::uint32_t>(own);
  return {};
}

/// Converts from the header's space to LPS; none if that is not a patient's.
std::optional<glm::dvec3> to_lps(const TextHeader& header) {
  const auto* text = header.find("space");
  std::string space = text ? lower_case(*text) : "";
  if (space.ends_with("-time"))
    space.resize(space.size() - 5);
  else if (space.size() == 4 && space.ends_with('t'))
    space.resize(3);
  if (space == "ras" || space == "right-anterior-superior") return glm::dvec3(-1, -1, 1);
  if (space == "las" || space == "left-anterior-superior") return glm::dvec3(1, -1, 1);
  if (space == "lps" || space == "left-posterior-superior") return glm::dvec3(1, 1, 1);
  return std::nullopt;
}

Result<void> place_directed(const TextHeader& header, const std::vector<Axis>& axes,
                            Volume& volume) {
  const auto patient = to_lps(header);
  volume.patient_axes = patient.has_value();
  const glm::dvec3 flip = patient.value_or(glm::dvec3(1));  // other spaces stay, as in ITK
  for (int i = 0; i < 3; ++i)
    volume.axes[i] = flip * *axes[static_cast<std::size_t>(i)].direction + 0.0;
  if (const auto* text = header.find("spaceorigin")) {
    const auto origin = parse_vector(*text);
    if (!origin)
      return bad_file(volume.source, "'space origin' is ", in_quotes(*text),
                      ", expected a vector as (x,y,z)");
    volume.origin = flip * *origin + 0.0;
  }
  return {};
}

/// The distance between two samples that an axis states, by itself or by its ends; NaN: none. As in
/// Teem, the ends are those of the cells around the samples, unless the samples are at nodes.
double spacing_of(const Axis& axis) {
  if (!std::isnan(axis.spacing)) return axis.spacing;
  return (axis.max - axis.min) / axis.intervals();
}

/// Without a space, uses the grid's own axes. The ends of the axes give the origin if all are
/// known.
Result<void> place_by_spacing(const std::vector<Axis>& axes, const VolumeOptions& options,
                              Volume& volume) {
  std::string unknown, by_thickness;
  bool has_origin = true;
  for (std::size_t i = 0; i < 3; ++i) {
    const Axis& axis = axes[i];
    double stated = spacing_of(axis);
    if (!options.spacing && std::isnan(stated)) {
      stated = 1;
      unknown += "xyz"[i];
      if (axis.thickness > 0) by_thickness += "xyz"[i];
    }
    // Only axes that state their ends may run backwards.
    const double sign = axis.max < axis.min && std::isnan(axis.spacing) ? -1 : 1;
    const double length = SLF_TRY(
        spacing_or(options, i, sign * stated, volume.source, "'spacings' " + std::to_string(i)));
    const double spacing = sign * length;
    const int k = static_cast<int>(i);
    volume.axes[k][k] = spacing;
    const double from_end = axis.centering == "node" ? 0 : spacing / 2;
    volume.origin[k] = axis.min + from_end;
    if (std::isnan(axis.min)) volume.origin[k] = axis.max + from_end - spacing * axis.intervals();
    has_origin = has_origin && std::isfinite(volume.origin[k]);
  }
  if (!has_origin) volume.origin = glm::dvec3(0.0);
  if (unknown == "xyz" && by_thickness.empty())
    volume.notes.emplace_back(kNoSpacing);
  else if (!unknown.empty())
    volume.notes.push_back(
        "it states no spacing along " + unknown + ": taken as 1" +
        (by_thickness.empty() ? "" : "; the thickness of its samples need not be their distance"));
  return {};
}

Result<std::uint64_t> offset_after_lines(const std::string& path, std::uint64_t from,
                                         std::uint64_t lines) {
  auto file = SLF_TRY(open_regular(path));
  file.seekg(static_cast<std::streamoff>(from));
  for (std::uint64_t line = 0; line < lines; ++line) {
    file.ignore(std::numeric_limits<std::streamsize>::max(), '\n');
    if (!file) return bad_file(path, "'line skip' is ", lines, ", found ", line);
  }
  return static_cast<std::uint64_t>(file.tellg());
}

Result<Packing> parse_packing(const TextHeader& header) {
  const std::string& path = header.path;
  const auto text = SLF_TRY(header.required("encoding"));
  const std::string encoding = lower_case(text);
  if (encoding == "raw") return Packing::none;
  if (encoding == "gzip" || encoding == "gz") return Packing::gzip;
  if (encoding == "bzip2" || encoding == "bz2") return Packing::bzip2;
  for (const auto* known : {"txt", "text", "ascii", "hex", "zrl"})
    if (encoding == known)
      return unsupported(
          path, "encoding ", known,
          ", expected raw, gzip or bzip2: `unu save -e gzip -f nrrd -i IN -o OUT.nrrd`");
  return bad_file(path, "'encoding' is ", in_quotes(text), ", expected raw, gzip or bzip2");
}

Result<bool> parse_big_endian(const TextHeader& header, ScalarType type) {
  const auto* text = header.find("endian");
  const std::string endian = text ? lower_case(*text) : "";
  if (endian == "little" || endian == "big") return endian == "big";
  if (bytes_per_voxel(type) == 1) return false;
  return bad_file(header.path, "'endian' is ", in_quotes(endian),
                  ", expected 'endian: little' or 'endian: big'");
}

/// The names of several data files, in order: `LIST [SUBDIM]`, or `PATTERN MIN MAX STEP [SUBDIM]`.
/// Else it names one file.
Result<std::vector<std::string>> data_files(const TextHeader& header, const std::string& text,
                                            const std::vector<Axis>& axes) {
  const std::string& path = header.path;
  const auto parts = words(text);
  const bool list = text.starts_with("LIST");
  if (!list && (text.find('%') == std::string::npos || parts.size() < 4)) return std::vector{text};
  std::vector<std::int64_t> given;
  for (std::size_t i = 1; i < parts.size(); ++i) {
    const auto value = parse_integer(parts[i]);
    if (!value || i > (list ? 1 : 4))
      return bad_file(path, "'data file' is ", in_quotes(text),
                      ", expected 'LIST' or 'PATTERN MIN MAX STEP', and the dimension of a file");
    given.push_back(*value);
  }
  std::vector<std::string> files;
  if (list)
    files = header.listed;
  else
    files = SLF_TRY(numbered_files(path, parts.front(), given[0], given[1], given[2]));
  // Files of as many dimensions as there are share the last axis, in any number of equal parts.
  const auto rank = static_cast<std::int64_t>(axes.size());
  const std::int64_t of_file = given.size() == (list ? 1 : 4) ? given.back() : rank - 1;
  if (of_file < 1 || of_file > rank)
    return bad_file(path, "'data file' is ", in_quotes(text), ", expected files of 1 to ", rank,
                    " dimensions");
  std::uint64_t count = 1;
  for (auto i = static_cast<std::size_t>(of_file); i < axes.size(); ++i) count *= axes[i].size;
  if (files.empty() || (of_file < rank && files.size() != count))
    return bad_file(path, "it names ", files.size(), " data files, but its 'sizes' need ", count,
                    ", each of ", of_file, " dimensions");
  return files;
}

/// Finds the voxels. `axes`: all of them, as in the header.
Result<void> find_voxels(const TextHeader& header, const std::vector<Axis>& axes, Volume& volume,
                         VoxelData& data) {
  data.files = {header.path};
  data.offset = header.bytes;
  if (const auto* text = header.find("datafile")) {
    data.files = header.find_files(SLF_TRY(data_files(header, *text, axes)), volume.notes);
    data.offset = 0;
  }
  data.packing = SLF_TRY(parse_packing(header));
  data.packed = data.packing != Packing::none;
  data.big_endian = SLF_TRY(parse_big_endian(header, volume.type));
  SLF_TRY(header.check_data_file(data.files.front()));
  const auto lines = SLF_TRY(header.integer("lineskip", 0, kMaxSkip, 0));
  if (lines > 0 && data.files.size() > 1)
    return unsupported(header.path, "'line skip' in several data files, expected 'byte skip'");
  data.offset = SLF_TRY(
      offset_after_lines(data.files.front(), data.offset, static_cast<std::uint64_t>(lines)));
  const auto skip = SLF_TRY(header.integer("byteskip", data.packed ? 0 : -1, kMaxSkip, 0));
  data.at_end = skip == -1;
  data.skip = data.at_end ? 0 : static_cast<std::uint64_t>(skip);
  return {};
}

}  // namespace

bool looks_like_nrrd(std::string_view head) {
  return without_byte_order_mark(head).starts_with("NRRD000");
}

bool nrrd_names_files(std::string_view head) {
  return std::ranges::any_of(header_lines(head), [](const std::string& line) {
    return line.starts_with("data file:") || line.starts_with("datafile:");
  });
}

Result<Volume> read_nrrd(const std::string& path, std::string_view head,
                         const VolumeOptions& options) {
  const auto header = SLF_TRY(parse_nrrd_lines(path, head));
  Volume volume{.source = path};

  const auto type_name = SLF_TRY(header.required("type"));
  const auto type = parse_scalar_type(type_name);
  if (!type)
    return bad_file(path, "'type' is ", in_quotes(type_name),
                    ", expected one number, 8 to 64 bits wide");
  volume.type = *type;

  const auto all_axes = SLF_TRY(parse_axes(header));
  auto axes = all_axes;
  const auto lines = header_lines(head);
  name_list_of_frames(lines, axes.front());
  const bool directed = header.find("spacedirections") != nullptr;
  SLF_TRY(assign_roles(path, directed, is_sequence(lines), axes));
  VoxelData data;
  SLF_TRY(choose_in_axes(path, axes, options, data));
  std::erase_if(axes, [](const Axis& axis) { return axis.role != Role::space; });
  std::vector<std::uint64_t> sizes(axes.size());
  std::ranges::transform(axes, sizes.begin(), &Axis::size);
  volume.dims = SLF_TRY(check_dims(path, sizes));
  SLF_TRY(directed ? place_directed(header, axes, volume)
                   : place_by_spacing(axes, options, volume));

  // With a space its units count, else those of the axes.
  const std::string* units = header.find("spaceunits");
  if (!units) units = header.find("units");
  std::set<std::string> names;
  for (const auto word : words(units ? std::string_view(*units) : ""))
    names.emplace(trim(word, "\""));
  if (names.size() == 1 && micrometres(*names.begin())) volume.unit = *names.begin();

  if (const auto* unit = header.find("sampleunits")) volume.value_unit = trim(*unit, " \"");

  SLF_TRY(find_voxels(header, all_axes, volume, data));
  SLF_TRY(read_voxels(data, volume));
  return volume;
}

}  // namespace slf::volume_io

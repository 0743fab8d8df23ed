// MetaImage (.mha, or .mhd with its data file), https://itk.org/Wiki/MetaIO/Documentation.
//
// World coordinates are LPS, as in ITK. As in ITK, AnatomicalOrientation does not transform them.
#include <algorithm>
#include <cmath>
#include <map>

#include "base/try.h"
#include "source/volume/io.h"
#include "source/volume/units.h"

namespace slf::volume_io {

namespace {

/// Other names of fields.
constexpr std::pair<std::string_view, const char*> kAliases[] = {
    {"ElementSize", "ElementSpacing"},
    {"Position", "Offset"},
    {"Origin", "Offset"},
    {"Rotation", "TransformMatrix"},
    {"Orientation", "TransformMatrix"},
    {"ElementByteOrderMSB", "BinaryDataByteOrderMSB"}};

Result<TextHeader> parse_meta_lines(const std::string& path, std::string_view head) {
  TextHeader header{.path = path};
  std::string_view rest = without_byte_order_mark(head);
  for (int number = 1; !rest.empty(); ++number) {
    const auto line = next_line(rest);
    header.bytes = head.size() - rest.size();
    if (trim(line).empty()) continue;
    const auto equals = line.find('=');
    if (equals == std::string_view::npos)
      return bad_file(path, "line ", number, " of the MetaImage header is ", in_quotes(line),
                      ", expected 'Field = value'");
    const std::string field(trim(line.substr(0, equals)));
    const auto value = trim(line.substr(equals + 1));
    header.fields[field] = value;
    for (const auto& [alias, name] : kAliases)
      if (field == alias) header.fields.try_emplace(name, value);
    if (field == "ObjectType" && lower_case(value) != "image")
      return unsupported(path, "a MetaIO ", in_quotes(value), ", expected ObjectType = Image");
    if (field != "ElementDataFile") continue;
    if (value.starts_with("LIST")) header.list(rest);
    return header;
  }
  return bad_file(path, "the MetaImage header has no 'ElementDataFile' line");
}

Result<bool> flag(const TextHeader& header, std::string_view field, bool otherwise) {
  const auto* text = header.find(field);
  if (!text) return otherwise;
  const auto value = lower_case(*text);
  if (value == "true" || value == "1" || value == "t") return true;
  if (value == "false" || value == "0" || value == "f") return false;
  return bad_file(header.path, "'", field, "' is ", in_quotes(*text), ", expected True or False");
}

Result<ScalarType> scalar_type(const TextHeader& header) {
  const auto text = SLF_TRY(header.required("ElementType"));
  // MET_LONG has 32 bits in MetaIO, on every machine.
  static const std::map<std::string_view, ScalarType> kTypes = {
      {"MET_UCHAR", ScalarType::u8},      {"MET_CHAR", ScalarType::i8},
      {"MET_ASCII_CHAR", ScalarType::i8}, {"MET_USHORT", ScalarType::u16},
      {"MET_SHORT", ScalarType::i16},     {"MET_UINT", ScalarType::u32},
      {"MET_INT", ScalarType::i32},       {"MET_ULONG", ScalarType::u32},
      {"MET_LONG", ScalarType::i32},      {"MET_ULONG_LONG", ScalarType::u64},
      {"MET_LONG_LONG", ScalarType::i64}, {"MET_FLOAT", ScalarType::f32},
      {"MET_DOUBLE", ScalarType::f64}};
  // The number of channels says how many; in old files the type says that there are several.
  const auto found = kTypes.find(text.substr(0, text.find("_ARRAY")));
  if (found != kTypes.end()) return found->second;
  return bad_file(header.path, "ElementType ", in_quotes(text),
                  ", expected MET_UCHAR, MET_SHORT, MET_FLOAT or the like");
}

Result<void> set_position(const TextHeader& header, std::size_t rank, const VolumeOptions& options,
                          Volume& volume) {
  const std::string& path = volume.source;
  std::vector<double> spacing(rank, 1), origin(rank, 0), matrix(rank * rank, 0);
  for (std::size_t i = 0; i < rank; ++i) matrix[i * rank + i] = 1;
  for (const auto& [field, to] :
       {std::pair{"ElementSpacing", &spacing}, {"Offset", &origin}, {"TransformMatrix", &matrix}}) {
    if (to == &spacing && options.spacing) continue;
    const auto numbers = SLF_TRY(header.numbers(field, to->size()));
    if (!numbers.empty()) *to = numbers;
  }
  const auto* anatomy = header.find("AnatomicalOrientation");
  volume.patient_axes = anatomy && anatomy->size() >= 3 &&
                        anatomy->substr(0, 3).find_first_not_of("RLAPIS") == std::string::npos;
  if (const auto* unit = header.find("DistanceUnits"); unit && micrometres(*unit))
    volume.unit = *unit;
  if (!options.spacing && !header.find("ElementSpacing")) volume.notes.emplace_back(kNoSpacing);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    spacing[axis] = SLF_TRY(
        spacing_or(options, axis, spacing[axis], path, "'ElementSpacing' " + std::to_string(axis)));
    // A row of the matrix, as written, is the direction of an axis.
    const auto* row = matrix.data() + axis * rank;
    volume.axes[static_cast<int>(axis)] = glm::dvec3(row[0], row[1], row[2]) * spacing[axis];
    volume.origin[static_cast<int>(axis)] = origin[axis];
  }
  return {};
}

Result<void> read_scale(const TextHeader& header, Volume& volume) {
  for (const auto& [field, to] :
       {std::pair{"ElementToIntensityFunctionSlope", &volume.slope},
        std::pair{"ElementToIntensityFunctionOffset", &volume.intercept}}) {
    const auto number = SLF_TRY(header.numbers(field, 1));
    if (number.empty()) continue;
    *to = number.front();
    if (!std::isfinite(*to) || volume.slope == 0)
      return bad_file(volume.source, "'", field, "' is ", *to,
                      ", expected a finite number, and a slope that is not 0");
  }
  return {};
}

/// The names of several data files, in order: a list, or a pattern with numbers; or one file.
Result<std::vector<std::string>> data_files(const TextHeader& header,
                                            const std::vector<std::uint64_t>& sizes) {
  const std::string& path = header.path;
  const std::string& text = *header.find("ElementDataFile");
  const auto parts = words(text);
  // As in MetaIO: `LIST [DIMENSIONS OF A FILE]`, or `PATTERN [FIRST [LAST [STEP]]]`.
  std::vector<std::int64_t> given;
  const bool list = text.starts_with("LIST");
  if (!list && text.find('%') == std::string::npos) return std::vector{text};
  for (std::size_t i = 1; i < parts.size(); ++i) {
    auto word = parts[i];
    if (list && (word.ends_with('D') || word.ends_with('d'))) word.remove_suffix(1);
    const auto value = parse_integer(word);
    if (!value || !is_file_number(*value) || i > (list ? 1 : 3))
      return bad_file(path, "'ElementDataFile' is ", in_quotes(text),
                      ", expected a file, 'LIST', or a pattern with its first and last number");
    given.push_back(*value);
  }
  const auto rank = static_cast<std::int64_t>(sizes.size());
  const auto of_file = list && !given.empty() && given[0] > 0 && given[0] <= rank
                           ? static_cast<std::size_t>(given[0])
                           : sizes.size() - 1;
  std::uint64_t count = 1;
  for (std::size_t i = of_file; i < sizes.size(); ++i)
    if (__builtin_mul_overflow(count, sizes[i], &count)) return bad_file(path, "absurd 'DimSize'");
  std::vector<std::string> files;
  if (list) {
    // Whatever follows the names is not part of the list.
    for (const auto& name : header.listed)
      if (files.size() < count) files.push_back(name);
  } else {
    const std::int64_t first = given.empty() ? 1 : given[0];
    const auto slices = static_cast<std::int64_t>(std::min<std::uint64_t>(count, 1 << 21));
    const std::int64_t last = given.size() > 1 ? given[1] : first + slices - 1;
    const std::int64_t step = given.size() > 2 ? given[2]
                              : slices > 1     ? (last - first) / (slices - 1)
                                               : 1;
    files = SLF_TRY(numbered_files(path, parts.front(), first, last, step));
  }
  if (files.size() != count)
    return bad_file(path, "it names ", files.size(), " data files, but its 'DimSize' needs ", count,
                    ", each of ", of_file, " dimensions");
  return files;
}

/// Sets where the voxels are.
Result<void> find_voxels(const TextHeader& header, const std::vector<std::uint64_t>& sizes,
                         Volume& volume, VoxelData& data) {
  const std::string& path = header.path;
  const auto binary = SLF_TRY(flag(header, "BinaryData", true));
  if (!binary)
    return unsupported(path, "voxels as text (BinaryData = False): save the volume as binary");
  data.packed = SLF_TRY(flag(header, "CompressedData", false));
  data.big_endian = SLF_TRY(flag(header, "BinaryDataByteOrderMSB", false));
  const bool local = lower_case(*header.find("ElementDataFile")) == "local";
  data.files = {path};
  if (!local) data.files = header.find_files(SLF_TRY(data_files(header, sizes)), volume.notes);
  data.offset = local ? header.bytes : 0;
  SLF_TRY(header.check_data_file(data.files.front()));
  const auto skip = SLF_TRY(header.integer("HeaderSize", -1, kMaxSkip, 0));
  if (header.find("HeaderSize") && !local) {
    data.at_end = skip < 0 && !data.packed;
    data.offset = static_cast<std::uint64_t>(std::max<std::int64_t>(skip, 0));
  }
  return {};
}

}  // namespace

bool looks_like_meta(std::string_view head) {
  head = without_byte_order_mark(head);
  const auto line = next_line(head);
  const auto equals = line.find('=');
  if (equals == std::string_view::npos) return false;
  const auto field = trim(line.substr(0, equals));
  for (const auto* known : {"ObjectType", "NDims", "DimSize", "Comment", "ObjectSubType",
                            "TransformType", "ElementType", "BinaryData", "ID", "Name"})
    if (field == known) return true;
  return false;
}

bool meta_names_files(std::string_view head) {
  while (!head.empty()) {
    const std::string line = lower_case(trim(next_line(head)));
    if (line.starts_with("elementdatafile"))
      return trim(std::string_view(line).substr(line.find('=') + 1)) != "local";
  }
  return false;
}

Result<Volume> read_meta(const std::string& path, std::string_view head,
                         const VolumeOptions& options) {
  const auto header = SLF_TRY(parse_meta_lines(path, head));
  Volume volume{.source = path};
  const auto channels = SLF_TRY(header.integer("ElementNumberOfChannels", 1, 4096, 1));
  volume.type = SLF_TRY(scalar_type(header));
  const auto rank = SLF_TRY(header.integer("NDims", 1, 10));
  const auto sizes = SLF_TRY(header.sizes("DimSize", static_cast<std::size_t>(rank)));
  auto data = SLF_TRY(choose_volume(sizes, static_cast<std::uint32_t>(channels), options, volume));
  SLF_TRY(set_position(header, sizes.size(), options, volume));
  SLF_TRY(read_scale(header, volume));
  SLF_TRY(find_voxels(header, sizes, volume, data));
  SLF_TRY(read_voxels(data, volume));
  return volume;
}

}  // namespace slf::volume_io

// MetaImage (.mha, or .mhd with its data file), https://itk.org/Wiki/MetaIO/Documentation.
//
// Not read through ITK, for the reason given in nrrd.cc. World coordinates are LPS, as in ITK. As
// in ITK, AnatomicalOrientation does not transform them.
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <map>

#include "base/try.h"
#include "field/volume/io.h"

namespace slf::volume_io {

namespace {

struct MetaHeader {
  std::map<std::string, std::string, std::less<>> fields;
  std::size_t bytes = 0;            // up to and including the last line, ElementDataFile
  std::vector<std::string> listed;  // the lines after `ElementDataFile = LIST`

  /// The value of a field, under the first of several names that the header has.
  const std::string* find(const std::vector<std::string_view>& names) const {
    for (const auto name : names)
      if (const auto found = fields.find(name); found != fields.end()) return &found->second;
    return nullptr;
  }
};

Result<MetaHeader> parse_meta_lines(const std::string& path, std::string_view head) {
  MetaHeader header;
  for (int number = 1; header.bytes < head.size(); ++number) {
    const auto line = next_line(head, header.bytes);
    if (trim(line).empty()) continue;
    const auto equals = line.find('=');
    if (equals == std::string_view::npos)
      return fail(ErrorCode::bad_file, path, ": line ", number, " of the MetaImage header is ",
                  in_quotes(line), ", expected 'Field = value'");
    const std::string field(trim(line.substr(0, equals)));
    header.fields[field] = trim(line.substr(equals + 1));
    if (field == "ObjectType" && lower(header.fields[field]) != "image")
      return fail(ErrorCode::unsupported, path, ": a MetaIO ", in_quotes(header.fields[field]),
                  ", expected ObjectType = Image");
    if (field != "ElementDataFile") continue;
    if (header.fields[field].starts_with("LIST"))
      for (std::size_t at = header.bytes; at < head.size();)
        if (const auto name = trim(next_line(head, at)); !name.empty())
          header.listed.emplace_back(name);
    return header;
  }
  return fail(ErrorCode::bad_file, path, ": the MetaImage header has no 'ElementDataFile' line");
}

Result<std::vector<double>> numbers(const std::string& path, std::string_view field,
                                    const std::string& text, std::size_t count) {
  std::vector<double> result;
  for (const auto word : words(text)) {
    const auto value = parse_number(word);
    if (!value)
      return fail(ErrorCode::bad_file, path, ": '", field, "' holds ", in_quotes(word),
                  ", expected a number");
    result.push_back(*value);
  }
  if (result.size() != count)
    return fail(ErrorCode::bad_file, path, ": '", field, "' has ", result.size(),
                " values, expected ", count);
  return result;
}

Result<bool> flag(const std::string& path, const MetaHeader& header,
                  const std::vector<std::string_view>& names, bool otherwise) {
  const auto* text = header.find(names);
  if (!text) return otherwise;
  const auto value = lower(*text);
  if (value == "true" || value == "1" || value == "t") return true;
  if (value == "false" || value == "0" || value == "f") return false;
  return fail(ErrorCode::bad_file, path, ": '", names.front(), "' is ", in_quotes(*text),
              ", expected True or False");
}

Result<ScalarType> scalar_type(const std::string& path, const MetaHeader& header) {
  const auto* text = header.find({"ElementType"});
  if (!text) return fail(ErrorCode::bad_file, path, ": the header has no 'ElementType' line");
  if (text->ends_with("_ARRAY"))
    return fail(ErrorCode::unsupported, path, ": ElementType ", in_quotes(*text),
                ", expected one number a voxel: extract one component");
  // MET_LONG has 32 bits in MetaIO, on every machine.
  static const std::map<std::string_view, ScalarType> kTypes = {
      {"MET_UCHAR", ScalarType::u8},      {"MET_CHAR", ScalarType::i8},
      {"MET_ASCII_CHAR", ScalarType::i8}, {"MET_USHORT", ScalarType::u16},
      {"MET_SHORT", ScalarType::i16},     {"MET_UINT", ScalarType::u32},
      {"MET_INT", ScalarType::i32},       {"MET_ULONG", ScalarType::u32},
      {"MET_LONG", ScalarType::i32},      {"MET_ULONG_LONG", ScalarType::u64},
      {"MET_LONG_LONG", ScalarType::i64}, {"MET_FLOAT", ScalarType::f32},
      {"MET_DOUBLE", ScalarType::f64}};
  const auto found = kTypes.find(*text);
  if (found != kTypes.end()) return found->second;
  return fail(ErrorCode::bad_file, path, ": ElementType ", in_quotes(*text),
              ", expected MET_UCHAR, MET_SHORT, MET_FLOAT or the like");
}

Result<std::vector<std::uint64_t>> sizes_of(const std::string& path, const MetaHeader& header) {
  const auto* rank_text = header.find({"NDims"});
  const auto* size_text = header.find({"DimSize"});
  if (!rank_text || !size_text)
    return fail(ErrorCode::bad_file, path, ": the header has no '", rank_text ? "DimSize" : "NDims",
                "' line");
  const auto rank = parse_integer(*rank_text);
  if (!rank || *rank < 1 || *rank > 10)
    return fail(ErrorCode::bad_file, path, ": 'NDims' is ", in_quotes(*rank_text),
                ", expected 1 to 10");
  std::vector<std::uint64_t> sizes;
  for (const auto word : words(*size_text)) {
    const auto size = parse_integer(word);
    if (!size || *size < 1)
      return fail(ErrorCode::bad_file, path, ": 'DimSize' holds ", in_quotes(word),
                  ", expected positive integers");
    sizes.push_back(static_cast<std::uint64_t>(*size));
  }
  if (sizes.size() != static_cast<std::size_t>(*rank))
    return fail(ErrorCode::bad_file, path, ": 'DimSize' has ", sizes.size(),
                " values, expected NDims = ", *rank);
  return sizes;
}

Result<void> set_position(const MetaHeader& header, std::size_t rank, const VolumeOptions& options,
                          Volume& volume) {
  const std::string& path = volume.source;
  std::vector<double> spacing(rank, 1), origin(rank, 0), matrix(rank * rank, 0);
  for (std::size_t i = 0; i < rank; ++i) matrix[i * rank + i] = 1;
  struct Part {
    std::vector<std::string_view> names;
    std::vector<double>* to;
  };
  for (const auto& [names, to] : {Part{{"ElementSpacing", "ElementSize"}, &spacing},
                                  Part{{"Offset", "Position", "Origin"}, &origin},
                                  Part{{"TransformMatrix", "Rotation", "Orientation"}, &matrix}})
    if (const auto* text = to == &spacing && options.spacing ? nullptr : header.find(names)) {
      auto values = SLF_TRY(numbers(path, names.front(), *text, to->size()));
      *to = values;
    }
  if (!options.spacing && !header.find({"ElementSpacing", "ElementSize"}))
    volume.notes.emplace_back(kNoSpacing);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    spacing[axis] = spacing_or(options, axis, spacing[axis]);
    if (!(spacing[axis] > 0) || !std::isfinite(spacing[axis]))
      return fail_without("spacing", ErrorCode::bad_file, path, ": 'ElementSpacing' ", axis, " is ",
                          spacing[axis], ", expected a positive number: choose the spacing");
    // A row of the matrix, as written, is the direction of an axis.
    const auto* row = matrix.data() + axis * rank;
    volume.axes[static_cast<int>(axis)] = glm::dvec3(row[0], row[1], row[2]) * spacing[axis];
    volume.origin[static_cast<int>(axis)] = origin[axis];
  }
  return {};
}

Result<void> read_scale(const MetaHeader& header, Volume& volume) {
  struct Part {
    std::string_view name;
    double* to;
  };
  for (const auto& [name, to] : {Part{"ElementToIntensityFunctionSlope", &volume.slope},
                                 Part{"ElementToIntensityFunctionOffset", &volume.intercept}})
    if (const auto* text = header.find({name})) {
      const auto value = parse_number(*text);
      if (!value || !std::isfinite(*value) || (to == &volume.slope && *value == 0))
        return fail(ErrorCode::bad_file, volume.source, ": '", name, "' is ", in_quotes(*text),
                    ", expected a finite number, and a slope that is not 0");
      *to = *value;
    }
  return {};
}

/// The paths of several data files, in order: a list, or a pattern with numbers. Empty: one file.
Result<std::vector<std::string>> data_files(const std::string& path, const MetaHeader& header,
                                            const std::vector<std::uint64_t>& sizes) {
  const std::string& text = *header.find({"ElementDataFile"});
  const auto parts = words(text);
  // As in MetaIO: `LIST [DIMENSIONS OF A FILE]`, or `PATTERN [FIRST [LAST [STEP]]]`.
  std::vector<std::int64_t> given;
  const bool list = text.starts_with("LIST");
  if (!list && text.find('%') == std::string::npos) return std::vector<std::string>{};
  for (std::size_t i = 1; i < parts.size(); ++i) {
    auto word = parts[i];
    if (list && (word.ends_with('D') || word.ends_with('d'))) word.remove_suffix(1);
    const auto value = parse_integer(word);
    if (!value || !is_file_number(*value) || i > (list ? 1 : 3))
      return fail(ErrorCode::bad_file, path, ": 'ElementDataFile' is ", in_quotes(text),
                  ", expected a file, 'LIST', or a pattern with its first and last number");
    given.push_back(*value);
  }
  const auto rank = static_cast<std::int64_t>(sizes.size());
  const auto of_file = list && !given.empty() && given[0] > 0 && given[0] <= rank
                           ? static_cast<std::size_t>(given[0])
                           : sizes.size() - 1;
  std::uint64_t count = 1;
  for (std::size_t i = of_file; i < sizes.size(); ++i)
    if (__builtin_mul_overflow(count, sizes[i], &count))
      return fail(ErrorCode::bad_file, path, ": absurd 'DimSize'");
  std::vector<std::string> files;
  if (list) {
    // Whatever follows the names is not part of the list.
    for (const auto& name : header.listed)
      if (files.size() < count) files.push_back(beside(path, name));
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
    return fail(ErrorCode::bad_file, path, ": it names ", files.size(),
                " data files, but its 'DimSize' needs ", count, ", each of ", of_file,
                " dimensions");
  return files;
}

/// Finds the voxels.
Result<VoxelData> locate(const MetaHeader& header, const Volume& volume,
                         const std::vector<std::uint64_t>& sizes) {
  const std::string& path = volume.source;
  const auto binary = flag(path, header, {"BinaryData"}, true);
  const auto packed = flag(path, header, {"CompressedData"}, false);
  const auto big = flag(path, header, {"BinaryDataByteOrderMSB", "ElementByteOrderMSB"}, false);
  for (const auto* result : {&binary, &packed, &big})
    if (!*result) return tl::unexpected(result->error());
  if (!*binary)
    return fail(ErrorCode::unsupported, path,
                ": voxels as text (BinaryData = False): save the "
                "volume as binary");
  VoxelData data{.path = path, .offset = header.bytes, .packed = *packed, .big_endian = *big};
  const std::string& file = *header.find({"ElementDataFile"});
  auto files = SLF_TRY(data_files(path, header, sizes));
  if (!files.empty()) {
    data.path = files.front();
    data.offset = 0;
    data.parts = std::move(files);
  } else if (lower(file) != "local") {
    data.path = beside(path, file);
    data.offset = 0;
  }
  const auto size = file_size(data.path);
  if (!size)
    return fail(size.error().code, path, ": its data file cannot be read: ", size.error().message);
  if (const auto* text = header.find({"HeaderSize"}); text && data.path != path) {
    const auto skip = parse_integer(*text);
    if (!skip || *skip < -1 || *skip > (std::int64_t{1} << 53))
      return fail(ErrorCode::bad_file, path, ": 'HeaderSize' is ", in_quotes(*text),
                  ", expected a count of bytes, or -1");
    data.at_end = *skip < 0 && !data.packed;
    data.offset = static_cast<std::uint64_t>(std::max<std::int64_t>(*skip, 0));
  }
  return data;
}

}  // namespace

bool looks_like_meta(std::string_view head) {
  std::size_t at = 0;
  const auto line = next_line(head, at);
  const auto equals = line.find('=');
  if (equals == std::string_view::npos) return false;
  const auto field = trim(line.substr(0, equals));
  for (const auto* known : {"ObjectType", "NDims", "DimSize", "Comment", "ObjectSubType",
                            "TransformType", "ElementType", "BinaryData", "ID", "Name"})
    if (field == known) return true;
  return false;
}

bool meta_names_files(std::string_view head) {
  for (std::size_t at = 0; at < head.size();) {
    const std::string line = lower(trim(next_line(head, at)));
    if (line.starts_with("elementdatafile"))
      return trim(std::string_view(line).substr(line.find('=') + 1)) != "local";
  }
  return false;
}

Result<Volume> read_meta(const std::string& path, std::string_view head,
                         const VolumeOptions& options) {
  const auto header = SLF_TRY(parse_meta_lines(path, head));
  Volume volume;
  volume.source = path;
  const auto* channels = header.find({"ElementNumberOfChannels"});
  const auto count = channels ? parse_integer(*channels) : 1;
  if (!count || *count < 1 || *count > 4096)
    return fail(ErrorCode::bad_file, path, ": 'ElementNumberOfChannels' is ", in_quotes(*channels),
                ", expected 1 to 4096");
  volume.type = SLF_TRY(scalar_type(path, header));
  const auto sizes = SLF_TRY(sizes_of(path, header));
  const auto chosen = SLF_TRY(choose_volume(path, sizes, options));
  volume.dims = chosen.dims;
  SLF_TRY(set_position(header, sizes.size(), options, volume));
  SLF_TRY(read_scale(header, volume));
  auto data = SLF_TRY(locate(header, volume, sizes));
  data.components = static_cast<std::uint32_t>(*count);
  if (*count > 1 || !chosen.by_component) {
    data.component = SLF_TRY(choose(path, options.component, data.components, "component"));
  }
  data.index = chosen.index;
  data.volumes = chosen.count;
  SLF_TRY(read_voxels(data, volume));
  return volume;
}

}  // namespace slf::volume_io

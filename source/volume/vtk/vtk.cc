// Legacy VTK files (.vtk) of structured points, as text or binary.
// https://docs.vtk.org/en/latest/vtk_file_formats/vtk_legacy_file_format.html
//
// The list of arrays is read first, without their numbers; then the numbers of one.
#include <algorithm>
#include <array>
#include <cmath>

#include "base/try.h"
#include "source/volume/io.h"

namespace slf::volume_io {

namespace {

constexpr std::size_t kMaxLine = 4096;

struct Array {
  std::string name;
  ScalarType type = ScalarType::u8;
  std::uint64_t components = 1;
  std::uint64_t tuples = 0;
  std::uint64_t offset = 0;  ///< of its numbers
  bool of_cells = false;
  bool fractions = false;  ///< text from 0 to 1 that stands for bytes
};

struct Document {
  bool ascii = false;
  std::vector<std::uint64_t> dims;
  glm::dvec3 origin{0.0}, spacing{1.0};
  std::vector<Array> arrays;
};

/// The types of an array, by the names that only this format has.
std::optional<ScalarType> scalar_type(std::string text) {
  text = lower_case(text);
  if (text == "long" || text == "vtktypeint64") return ScalarType::i64;
  if (text == "unsigned_long" || text == "vtktypeuint64") return ScalarType::u64;
  if (text == "vtkidtype") return ScalarType::i32;
  std::ranges::replace(text, '_', ' ');
  const auto type = parse_scalar_type(text);
  return type ? std::optional(*type) : std::nullopt;
}

/// A file of lines and words, with binary numbers in between.
class TextFile {
 public:
  explicit TextFile(const std::string& path) {
    buffer_.open(path, std::ios::in | std::ios::binary);
  }

  bool at_end() { return buffer_.sgetc() == EOF; }
  std::uint64_t tell() {
    return static_cast<std::uint64_t>(
        std::streamoff(buffer_.pubseekoff(0, std::ios::cur, std::ios::in)));
  }
  void seek(std::uint64_t to) { buffer_.pubseekpos(static_cast<std::streamoff>(to), std::ios::in); }
  /// The next line, or as much of it as makes sense.
  std::string line() {
    std::string text;
    for (int c = 0; text.size() < kMaxLine && (c = buffer_.sbumpc()) != EOF && c != '\n';)
      text += static_cast<char>(c);
    return text;
  }
  /// The next word and one blank after it. Empty at the end, and if it is too long for a number.
  std::string_view word() {
    const auto is_blank = [](int c) { return c == ' ' || (c >= '\t' && c <= '\r'); };
    std::size_t length = 0;
    int c = buffer_.sbumpc();
    while (is_blank(c)) c = buffer_.sbumpc();
    for (; c != EOF && !is_blank(c); c = buffer_.sbumpc()) {
      if (length == word_.size()) return {};
      word_[length++] = static_cast<char>(c);
    }
    return {word_.data(), length};
  }

 private:
  std::filebuf buffer_;
  std::array<char, 64> word_{};
};

class VtkParser {
 public:
  VtkParser(const std::string& path, std::uint64_t size) : path_(path), size_(size), file_(path) {}

  Result<Document> parse() {
    file_.line();
    file_.line();  // the title
    const std::string encoding = lower_case(trim(file_.line()));
    if (encoding != "ascii" && encoding != "binary")
      return bad_file(path_, "its third line is ", in_quotes(encoding),
                      ", expected ASCII or BINARY");
    d_.ascii = encoding == "ascii";
    while (!file_.at_end()) {
      const std::string text = file_.line();
      const auto parts = words(text);
      if (parts.empty()) continue;
      SLF_TRY(statement(lower_case(parts[0]), parts));
    }
    return std::move(d_);
  }

 private:
  using Words = std::vector<std::string_view>;

  tl::unexpected<Error> expected(std::string_view what, std::string_view found) const {
    return bad_file(path_, "expected ", what, ", found ", in_quotes(found));
  }

  Result<void> statement(const std::string& keyword, const Words& parts) {
    const auto argument = [&](std::size_t i) {
      return i < parts.size() ? std::string(parts[i]) : std::string();
    };
    if (keyword == "dataset") {
      if (lower_case(argument(1)) == "structured_points") return {};
      return unsupported(path_, "a VTK file of ", in_quotes(argument(1)),
                         ", expected STRUCTURED_POINTS: resample it to an image");
    }
    if (keyword == "dimensions") {
      for (std::size_t i = 1; i <= 3; ++i) {
        const auto extent = parse_integer(argument(i));
        if (!extent || *extent < 1) return expected("three extents as DIMENSIONS", argument(i));
        d_.dims.push_back(static_cast<std::uint64_t>(*extent));
      }
      return {};
    }
    if (keyword == "origin") return vector(parts, d_.origin);
    if (keyword == "spacing" || keyword == "aspect_ratio") return vector(parts, d_.spacing);
    if (keyword == "point_data" || keyword == "cell_data") {
      const auto count = parse_integer(argument(1));
      if (!count || *count < 0) return expected("the count of points or cells", argument(1));
      tuples_ = static_cast<std::uint64_t>(*count);
      of_cells_ = keyword == "cell_data";
      return {};
    }
    if (keyword == "metadata") {
      skip_metadata();
      return {};
    }
    if (keyword == "field") return field(argument(2));
    if (keyword == "lookup_table") {  // of colours, each 4 bytes
      const auto count = parse_integer(argument(2));
      if (!count || *count < 0) return expected("the size of a lookup table", argument(2));
      Array table;
      table.components = 4;
      table.tuples = static_cast<std::uint64_t>(*count);
      return skip(table);
    }
    if (keyword == "color_scalars")
      return array(argument(1), "unsigned_char", argument(2), d_.ascii);
    if (keyword == "scalars") {
      const std::string components = parts.size() > 3 ? argument(3) : "1";
      const auto at = file_.tell();
      if (!lower_case(trim(file_.line())).starts_with("lookup_table")) file_.seek(at);
      return array(argument(1), argument(2), components);
    }
    if (keyword == "vectors" || keyword == "normals") return array(argument(1), argument(2), "3");
    if (keyword == "tensors" || keyword == "tensors6")
      return array(argument(1), argument(2), keyword == "tensors" ? "9" : "6");
    if (keyword == "texture_coordinates") return array(argument(1), argument(3), argument(2));
    if (keyword == "global_ids" || keyword == "pedigree_ids")
      return array(argument(1), argument(2), "1");
    return expected("a keyword of a legacy VTK file", parts[0]);
  }

  /// They end with an empty line.
  void skip_metadata() {
    while (!file_.at_end() && !trim(file_.line()).empty()) continue;
  }

  Result<void> vector(const Words& parts, glm::dvec3& to) const {
    for (int i = 0; i < 3; ++i) {
      const auto at = static_cast<std::size_t>(i) + 1;
      const auto value = at < parts.size() ? parse_number(parts[at]) : std::nullopt;
      if (!value || !std::isfinite(*value))
        return expected("three numbers after " + std::string(parts[0]),
                        at < parts.size() ? parts[at] : "");
      to[i] = *value;
    }
    return {};
  }

  /// The arrays of a field, which may stand before the points as well.
  Result<void> field(const std::string& count) {
    const auto arrays = parse_integer(count);
    if (!arrays || *arrays < 0) return expected("the count of a field's arrays", count);
    for (std::int64_t i = 0; i < *arrays; ++i) {
      std::string text;
      while (!file_.at_end() && trim(text = file_.line()).empty()) continue;
      const auto parts = words(text);
      if (!parts.empty() && lower_case(parts[0]) == "metadata") {
        skip_metadata();
        --i;
        continue;
      }
      const auto tuples = parts.size() == 4 ? parse_integer(parts[2]) : std::nullopt;
      if (!tuples || *tuples < 0)
        return expected("an array's name, components, tuples and type", text);
      const auto counted = tuples_;
      tuples_ = static_cast<std::uint64_t>(*tuples);
      const bool here = counted == tuples_ && counted > 0;
      auto ok = array(std::string(parts[0]), std::string(parts[3]), std::string(parts[1]));
      if (ok && !here) d_.arrays.pop_back();
      tuples_ = counted;
      if (!ok) return ok;
    }
    return {};
  }

  Result<void> array(const std::string& array_name, const std::string& type,
                     const std::string& components, bool fractions = false) {
    const auto known = scalar_type(type);
    if (!known)
      return unsupported(path_, "the array ", in_quotes(array_name), " has type ", in_quotes(type),
                         ", expected char to double: save it as numbers");
    const auto count = parse_integer(components);
    if (!count || *count < 1 || *count > 4096)
      return expected("1 to 4096 components of the array " + in_quotes(array_name), components);
    d_.arrays.push_back({.name = array_name,
                         .type = *known,
                         .components = static_cast<std::uint64_t>(*count),
                         .tuples = tuples_,
                         .offset = file_.tell(),
                         .of_cells = of_cells_,
                         .fractions = fractions});
    return skip(d_.arrays.back());
  }

  Result<void> skip(const Array& skipped) {
    const auto cut = [&] {
      return bad_file(path_, skipped.tuples, " times ", skipped.components,
                      " numbers of the array ", in_quotes(skipped.name),
                      " do not fit the file: it is truncated, or its header is wrong");
    };
    std::uint64_t numbers = 0, bytes = 0;
    if (__builtin_mul_overflow(skipped.tuples, skipped.components, &numbers) ||
        __builtin_mul_overflow(numbers, bytes_per_voxel(skipped.type), &bytes))
      return cut();
    const auto at = file_.tell();
    if (!d_.ascii) {
      if (bytes > size_ - std::min(at, size_)) return cut();
      file_.seek(at + bytes);
      return {};
    }
    if (numbers > size_) return cut();
    for (; numbers > 0; --numbers)
      if (file_.word().empty()) return cut();
    return {};
  }

  const std::string& path_;
  std::uint64_t size_;
  TextFile file_;
  Document d_;
  std::uint64_t tuples_ = 0;
  bool of_cells_ = false;
};

/// Sets dims and position from those of the points. Cells lie between them.
Result<void> set_position(const Document& d, bool of_cells, const VolumeOptions& options,
                          Volume& volume) {
  if (d.dims.size() != 3)
    return bad_file(volume.source, d.dims.empty() ? "no" : "several",
                    " DIMENSIONS, expected three extents");
  std::vector<std::uint64_t> sizes = d.dims;
  if (of_cells)
    for (auto& size : sizes) --size;
  volume.dims = SLF_TRY(check_dims(volume.source, sizes));
  for (int i = 0; i < 3; ++i) {
    volume.axes[i][i] =
        SLF_TRY(spacing_or(options, static_cast<std::size_t>(i), d.spacing[i], volume.source,
                           std::string("SPACING along ") + "xyz"[i]));
  }
  volume.origin = d.origin + volume.axes * glm::dvec3(of_cells ? 0.5 : 0.0);
  return place(options, volume);
}

/// Reads one component of an array that is text.
Result<void> read_text(const Array& array, std::uint32_t component, Volume& volume) {
  TextFile file(volume.source);
  file.seek(array.offset);
  for (std::uint64_t i = 0; i < array.tuples; ++i)
    for (std::uint64_t c = 0; c < array.components; ++c) {
      const auto word = file.word();
      if (c != component) continue;
      bool ok = false;
      if (array.fractions) {
        const auto value = parse_number(word);
        ok = value && *value >= 0 && *value <= 1;
        if (ok) volume.voxels.push_back(static_cast<std::byte>(std::lround(*value * 255)));
      } else {
        ok = append_number(word, array.type, volume.voxels);
      }
      if (!ok)
        return bad_file(volume.source, "the array ", in_quotes(array.name), " holds ",
                        in_quotes(word), ", expected numbers ",
                        array.fractions ? "from 0 to 1" : "of type ",
                        array.fractions ? "" : name(array.type));
    }
  return {};
}

}  // namespace

bool looks_like_vtk(std::string_view head) {
  return lower_case(without_byte_order_mark(head).substr(0, 32))
      .starts_with("# vtk datafile version");
}

Result<Volume> read_vtk(const std::string& path, std::string_view, const VolumeOptions& options) {
  const auto size = SLF_TRY(file_size(path));
  const auto document = SLF_TRY(VtkParser(path, size).parse());
  if (document.arrays.empty()) return bad_file(path, "it holds no array of points or cells");
  const std::string names =
      joined(document.arrays, ", ", [](auto& a) { return in_quotes(a.name); });
  const auto chosen = std::ranges::find_if(document.arrays, [&](const Array& array) {
    return !options.array || *options.array == array.name;
  });
  if (chosen == document.arrays.end())
    return misuse(path, "no array ", in_quotes(*options.array), "; there are ", names);
  const Array& array = *chosen;
  Volume volume{.type = array.type, .source = path};
  if (document.arrays.size() > 1 && !options.array)
    volume.notes.push_back(concat("of its ", document.arrays.size(), " arrays (", names, "), ",
                                  in_quotes(array.name), " is read"));
  SLF_TRY(set_position(document, array.of_cells, options, volume));
  if (volume.voxel_count() != array.tuples)
    return bad_file(path, "the array ", in_quotes(array.name), " has ", array.tuples,
                    " tuples, but the dimensions are ", joined(volume.dims, "x"));
  SLF_TRY(choose(path, options.time, 1, "time point"));
  const auto component = SLF_TRY(choose(path, options.component, array.components, "component"));
  const VoxelData data{.files = {path},
                       .offset = array.offset,
                       .big_endian = true,
                       .components = static_cast<std::uint32_t>(array.components),
                       .component = component};
  SLF_TRY(document.ascii ? read_text(array, component, volume) : read_voxels(data, volume));
  return volume;
}

}  // namespace slf::volume_io

// Arrays of NumPy: .npy, and .npz with one volume in it.
// https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html
//
// An array has no names for its axes. As in ITK, tifffile and napari, its last three are z, y and
// x, in whichever order its memory is; another one before them is time, and a last one of 2 to 4 is
// colour.
#include <minizip/unzip.h>

#include <algorithm>
#include <array>
#include <memory>

#include "base/try.h"
#include "source/volume/fields.h"
#include "source/volume/io.h"

namespace slf::volume_io {

namespace {

struct ZipMember {
  std::string name;
  std::uint64_t offset = 0;  ///< of its data
  bool packed = false;       ///< deflate, without a header
};

using namespace std::string_view_literals;

constexpr std::size_t kMaxMembers = 1024;

tl::unexpected<Error> damaged(const std::string& path, std::string_view what) {
  return bad_file(path, "a ZIP file whose ", what, ": it is truncated or damaged, copy it again");
}

/// The name of the first member, by the first bytes of the file; empty if it is no ZIP.
std::string_view first_zip_member(std::string_view head) {
  if (!head.starts_with("PK\3\4"sv) || head.size() < 30) return {};
  return head.substr(30, Fields{head, false}.get<std::uint16_t>(26));
}

/// The members of a ZIP file, as NumPy and others use it: stored or deflated, also larger than 4
/// GiB. bad_file: damaged or truncated. unsupported: encrypted, or packed in another way.
Result<std::vector<ZipMember>> read_zip_members(const std::string& path) {
  // minizip does not notice that the record at the end is cut.
  constexpr std::uint64_t kRecord = 22, kMaxTail = kRecord + 0xffff;
  const std::uint64_t size = SLF_TRY(file_size(path));
  auto reader = SLF_TRY(ByteReader::open(path, size - std::min(size, kMaxTail), false));
  const auto tail = SLF_TRY(reader.read_text(kMaxTail));
  const bool ends = tail.size() - std::min(tail.rfind("PK\5\6"sv), tail.size()) >= kRecord;
  const std::unique_ptr<void, decltype(&unzClose)> zip(unzOpen64(path.c_str()), &unzClose);
  if (!zip || !ends) return damaged(path, "directory cannot be found");
  std::vector<ZipMember> members;
  int at = unzGoToFirstFile(zip.get());
  for (; at == UNZ_OK; at = unzGoToNextFile(zip.get())) {
    std::array<char, 1024> name{};
    unz_file_info64 info{};
    if (unzGetCurrentFileInfo64(zip.get(), &info, name.data(), name.size() - 1, nullptr, 0, nullptr,
                                0) != UNZ_OK)
      return damaged(path, "directory ends early");
    ZipMember member{.name = name.data(), .packed = info.compression_method == Z_DEFLATED};
    if ((info.flag & 1) != 0 || (info.compression_method != 0 && !member.packed))
      return unsupported(path, "its member ", in_quotes(member.name),
                         " is encrypted, or packed by another method than deflate: unpack it, and "
                         "give the file in it");
    // Not to read it, but to find its data.
    if (unzOpenCurrentFile2(zip.get(), nullptr, nullptr, /*raw=*/1) != UNZ_OK)
      return damaged(path, "member " + in_quotes(member.name) + " is not where it should be");
    member.offset = unzGetCurrentFileZStreamPos64(zip.get());
    unzCloseCurrentFile(zip.get());
    if (members.size() == kMaxMembers)
      return unsupported(path, "more than ", kMaxMembers,
                         " members: unpack it, and give the file in it");
    members.push_back(std::move(member));
  }
  if (at != UNZ_END_OF_LIST_OF_FILE) return damaged(path, "directory holds something else");
  return members;
}

constexpr std::string_view kMagic{"\x93NUMPY"};
constexpr std::size_t kMaxHeader = std::size_t{1} << 16;

struct NpyHeader {
  ScalarType type = ScalarType::u8;
  bool half = false;
  bool complex = false;
  bool big_endian = false;
  bool fortran_order = false;
  std::vector<std::uint64_t> shape;
  std::size_t bytes = 0;  ///< before the voxels
};

/// The value of a key in the header's literal of a dictionary: up to the end of the literal.
std::string_view value_of(std::string_view dictionary, std::string_view key) {
  for (const char quote : {'\'', '"'}) {
    const auto quoted = quote + std::string(key) + quote;
    const auto at = dictionary.find(quoted);
    if (at == std::string_view::npos) continue;
    const auto rest = trim(dictionary.substr(at + quoted.size()));
    if (rest.starts_with(':')) return trim(rest.substr(1));
  }
  return {};
}

Result<void> set_type(const std::string& path, std::string_view descr, NpyHeader& header) {
  std::string_view code = descr.substr(0, descr.find('}'));
  const auto refuse = [&](std::string_view what) {
    return unsupported(
        path, "an array of ", what, " (descr ", in_quotes(code),
        "), expected numbers of 8, 16, 32 or 64 bits: convert it, `array.astype(...)`");
  };
  if (descr.starts_with('[')) return refuse("records");
  if (descr.empty() || (descr[0] != '\'' && descr[0] != '"'))
    return bad_file(path, "'descr' is ", in_quotes(descr), ", expected a type such as '<f4'");
  code = descr.substr(1, descr.find(descr[0], 1) - 1);
  if (code.size() < 2)
    return bad_file(path, "'descr' is ", in_quotes(code), ", expected a type such as '<f4'");
  header.big_endian = code[0] == '>';
  const auto kind = code.substr(1);
  // Letters, and bytes: a bool is read as u8, a complex number as two floats, a half float as its
  // bits.
  header.half = kind == "f2";
  header.complex = kind == "c8" || kind == "c16";
  const char letter = kind == "b1" || header.half ? 'u' : header.complex ? 'f' : kind[0];
  const auto bits = 8 * std::clamp<std::int64_t>(parse_integer(kind.substr(1)).value_or(0), 0, 16);
  if (letter == 'u' || letter == 'i' || letter == 'f')
    if (const auto type =
            parse_scalar_type(letter + std::to_string(header.complex ? bits / 2 : bits))) {
      header.type = *type;
      return {};
    }
  return refuse(kind.starts_with('O')   ? "Python objects"
                : kind.starts_with('U') ? "texts"
                                        : "another type");
}

Result<NpyHeader> parse(const std::string& path, std::string_view head) {
  NpyHeader header;
  const auto cut = [&] { return bad_file(path, "its NumPy header ends early: it is truncated"); };
  if (head.size() < 12) return cut();
  const Fields fields{head, false};
  const bool wide = head[6] >= 2;
  const std::size_t length = wide ? fields.get<std::uint32_t>(8) : fields.get<std::uint16_t>(8);
  const std::size_t from = wide ? 12 : 10;
  header.bytes = from + length;
  if (header.bytes > head.size()) return cut();
  const auto dictionary = head.substr(from, length);
  SLF_TRY(set_type(path, value_of(dictionary, "descr"), header));
  const auto order = value_of(dictionary, "fortran_order");
  header.fortran_order = order.starts_with("True");
  if (!header.fortran_order && !order.starts_with("False"))
    return bad_file(path, "'fortran_order' is ", in_quotes(order), ", expected True or False");
  auto shape = value_of(dictionary, "shape");
  const auto end = shape.find(')');
  if (!shape.starts_with('(') || end == std::string_view::npos)
    return bad_file(path, "'shape' is ", in_quotes(shape), ", expected extents, as (3, 4, 5)");
  for (shape = trim(shape.substr(1, end - 1)); !shape.empty();) {
    const auto comma = shape.find(',');
    const auto extent = parse_integer(shape.substr(0, comma));
    if (!extent || *extent < 0 || header.shape.size() == 32)
      return bad_file(path, "'shape' holds ", in_quotes(shape), ", expected extents, as (3, 4, 5)");
    header.shape.push_back(static_cast<std::uint64_t>(*extent));
    shape = comma == std::string_view::npos ? "" : trim(shape.substr(comma + 1));
  }
  return header;
}

std::string describe_shape(const std::vector<std::uint64_t>& shape) {
  return "(" + joined(shape) + ")";
}

/// Reverses the order of the axes: z, which was fastest, becomes slowest.
void transpose(Volume& volume) {
  const auto [nz, ny, nx] = volume.dims;
  const std::size_t width = bytes_per_voxel(volume.type);
  std::vector<std::byte> voxels(volume.voxels.size());
  std::byte* to = voxels.data();
  for (std::size_t z = 0; z < nz; ++z)
    for (std::size_t y = 0; y < ny; ++y)
      for (std::size_t x = 0; x < nx; ++x, to += width)
        std::copy_n(&volume.voxels[((x * ny + y) * nz + z) * width], width, to);
  volume.voxels = std::move(voxels);
  volume.dims = {nx, ny, nz};
}

Result<Volume> read_array(const NpyHeader& header, VoxelData data, const VolumeOptions& options) {
  const std::string path = data.files.front();
  std::vector<std::uint64_t> space = header.shape;
  std::uint64_t colours = 1, times = 1;
  if (space.size() > 3 && space.back() >= 1 && space.back() <= 4) {
    colours = space.back();
    space.pop_back();
  }
  while (space.size() > 3 && space.front() == 1) space.erase(space.begin());
  if (space.size() == 4) {
    times = space.front();
    space.erase(space.begin());
  }
  if (header.complex && colours > 1)
    return unsupported(path, "complex numbers with ", colours,
                       " components: save the part that you want, such as `abs(array)`");
  if (space.size() > 3)
    return unsupported(path, "an array of shape ", describe_shape(header.shape),
                       ", expected z, y, x with time before them and colour after: save the part "
                       "that you want as an array of its own");
  Volume volume{.type = header.type, .source = path};
  if (!header.fortran_order) std::ranges::reverse(space);
  volume.dims = SLF_TRY(check_dims(path, space));
  const auto time = SLF_TRY(choose(path, options.time, times, "time point"));
  const std::uint64_t parts = header.complex ? 2 : colours;
  const auto component = SLF_TRY(choose(path, options.component, parts, "component"));

  // In Fortran's order time is the fastest axis and colour the slowest.
  const bool time_inside = header.fortran_order && !header.complex;
  if (header.fortran_order && header.complex && times > 1)
    return unsupported(
        path, "complex time points in Fortran's order: save `numpy.ascontiguousarray(array)`");
  data.components = static_cast<std::uint32_t>(time_inside ? times : parts);
  data.component = time_inside ? time : component;
  if ((time_inside ? times : parts) > std::numeric_limits<std::uint32_t>::max())
    return bad_file(path, "absurd shape ", describe_shape(header.shape));
  data.skip += header.bytes;
  data.big_endian = header.big_endian;
  data.index = time_inside ? component : time;
  data.volumes = time_inside ? parts : times;
  SLF_TRY(read_voxels(data, volume));
  if (header.fortran_order) transpose(volume);
  if (header.half) widen_half_floats(volume);
  if (!options.spacing) volume.notes.emplace_back(kNoSpacing);
  volume.notes.push_back("its axes " + describe_shape(header.shape) + " are taken as " +
                         (times > 1 ? "t, " : "") + "z, y, x" + (colours > 1 ? ", colour" : "") +
                         "; transpose the array if they are others");
  return volume;
}

}  // namespace

bool looks_like_npy(std::string_view head) { return head.starts_with(kMagic); }

Result<Volume> read_npy(const std::string& path, std::string_view head,
                        const VolumeOptions& options) {
  const auto header = SLF_TRY(parse(path, head));
  return read_array(header, {.files = {path}, .packed = packing_of_file(path) != Packing::none},
                    options);
}

bool looks_like_npz(std::string_view head) { return first_zip_member(head).ends_with(".npy"); }

Result<Volume> read_npz(const std::string& path, std::string_view, const VolumeOptions& options) {
  const auto members = SLF_TRY(read_zip_members(path));
  std::string arrays;
  std::size_t volumes = 0;
  std::optional<Error> problem;
  NpyHeader header;
  VoxelData data;
  for (const auto& member : members) {
    if (!member.name.ends_with(".npy")) continue;
    auto reader = SLF_TRY(ByteReader::open(path, member.offset, member.packed, Packing::deflate));
    const auto head = SLF_TRY(reader.read_text(kMaxHeader));
    auto array = parse(path, head);
    if (!array) {  // texts, say, beside the volume
      problem = array.error();
      continue;
    }
    const std::string array_name = member.name.substr(0, member.name.size() - 4);
    arrays +=
        (arrays.empty() ? "" : ", ") + in_quotes(array_name) + " " + describe_shape(array->shape);
    if (options.array ? *options.array != array_name : array->shape.size() < 3) continue;
    ++volumes;
    header = std::move(*array);
    data = {.files = {path},
            .offset = member.offset,
            .packed = member.packed,
            .packing = Packing::deflate};
  }
  if (volumes == 0 && problem) return tl::unexpected(std::move(*problem));
  if (volumes != 1 && options.array)
    return misuse(path, "array ", in_quotes(*options.array), " was chosen, but it has ", arrays);
  if (volumes != 1)
    return fail_without("array", ErrorCode::unsupported, path, ": ", volumes, " of its arrays (",
                        arrays,
                        ") have three axes or more, expected one: choose array by its name");
  return read_array(header, data, options);
}

}  // namespace slf::volume_io

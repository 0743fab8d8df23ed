// TIFF stacks: plain pages, OME-TIFF and ImageJ's, BigTIFF too.
#include <algorithm>
#include <array>
#include <limits>
#include <set>

#include "base/try.h"
#include "image/tiff_file.h"
#include "source/volume/stack.h"
#include "source/volume/tiff/tiff_description.h"

namespace slf::volume_io {

namespace {

using image_formats::check_compression;
using image_formats::has_planes;
using image_formats::TiffFile;

/// Whether samples without sign of so many bits are packed.
constexpr bool is_packed(unsigned bits) { return bits > 0 && bits < 16 && bits != 8; }

Result<SliceKind> kind_of(const TiffFile& file) {
  SliceKind kind{.width = file.tag<std::uint32_t>(TIFFTAG_IMAGEWIDTH, 0),
                 .height = file.tag<std::uint32_t>(TIFFTAG_IMAGELENGTH, 0),
                 .components = file.tag<std::uint16_t>(TIFFTAG_SAMPLESPERPIXEL, 1)};
  if (kind.width == 0 || kind.height == 0 || kind.components == 0)
    return bad_file(file.path, "page ", file.page, " has no pixels");
  const auto bits = file.tag<std::uint16_t>(TIFFTAG_BITSPERSAMPLE, 1);
  const auto format = file.tag<std::uint16_t>(TIFFTAG_SAMPLEFORMAT, SAMPLEFORMAT_UINT);
  const char letter = format == SAMPLEFORMAT_IEEEFP ? 'f' : format == SAMPLEFORMAT_INT ? 'i' : 'u';
  const bool half = letter == 'f' && bits == 16, packed = letter == 'u' && is_packed(bits);
  const auto type = parse_scalar_type(half     ? "f32"
                                      : packed ? bits < 8 ? "u8" : "u16"
                                               : letter + std::to_string(bits));
  if (!type || (letter == 'u' && format != SAMPLEFORMAT_UINT && format != SAMPLEFORMAT_VOID))
    return unsupported(file.path, "samples of ", bits, " bits, format ", format,
                       ", expected 1 to 16, 32 or 64 bits");
  if (packed && TIFFIsTiled(file.tiff.get()))
    return unsupported(file.path, "samples of ", bits, " bits in tiles");
  kind.type = *type;
  std::uint16_t extra = 0;
  std::uint16_t* meanings = nullptr;
  if (TIFFGetField(file.tiff.get(), TIFFTAG_EXTRASAMPLES, &extra, &meanings) && extra == 1)
    kind.alpha = meanings[0] != EXTRASAMPLE_UNSPECIFIED && kind.components > 1;
  SLF_TRY(check_compression(file));
  return kind;
}

/// Calls `take` with the rows of a plane of this page. A pixel has this number of samples. Half
/// floats become floats, and samples of fewer bits bytes or, of more than 8, words.
Result<void> read_rows(TiffFile& file, const SliceKind& kind, std::uint32_t samples,
                       std::uint32_t plane, const image_formats::TakeRows& take) {
  const auto bits = file.tag<std::uint16_t>(TIFFTAG_BITSPERSAMPLE, 1);
  if (is_packed(bits)) {
    const std::uint64_t values = std::uint64_t{kind.width} * samples, row = (values * bits + 7) / 8;
    if (row > 1U << 31) return file.damaged();
    return image_formats::read_rows(
        file, {static_cast<std::uint32_t>(row), kind.height, 1}, plane,
        [&](std::span<const std::byte> rows) {
          std::vector<std::byte> bytes;
          for (; rows.size() >= row; rows = rows.subspan(row))
            for (std::uint64_t x = 0, at = 0; x < values; ++x) {
              unsigned value = 0;
              for (unsigned k = 0; k < bits; ++k, ++at)
                value = value << 1 | (std::to_integer<unsigned>(rows[at / 8]) >> (7 - at % 8) & 1);
              bytes.push_back(static_cast<std::byte>(value));
              if (bits > 8) bytes.push_back(static_cast<std::byte>(value >> 8));
            }
          return take(bytes);
        });
  }
  if (bits == 16 && kind.type == ScalarType::f32)
    return image_formats::read_rows(
        file, {kind.width, kind.height, std::uint64_t{2} * samples}, plane,
        [&](std::span<const std::byte> rows) { return take(floats_of_halves(rows)); });
  const std::uint64_t pixel = samples * std::uint64_t{bytes_per_voxel(kind.type)};
  return image_formats::read_rows(file, {kind.width, kind.height, pixel}, plane, take);
}

/// Appends a component of this page.
Result<void> append_page(TiffFile& file, const SliceKind& kind, const ComponentSelector& selector,
                         std::vector<std::byte>& voxels) {
  if (!has_planes(file))
    return read_rows(file, kind, kind.components, 0,
                     [&](auto samples) { return selector.append(samples, voxels); });
  const std::size_t begin = voxels.size();
  const auto append = [&](std::span<const std::byte> samples) -> Result<void> {
    voxels.insert(voxels.end(), samples.begin(), samples.end());
    return {};
  };
  SLF_TRY(read_rows(file, kind, 1, selector.component(), append));
  for (std::uint32_t plane = 1; plane < selector.equal(); ++plane) {
    std::size_t at = begin;
    const auto compare = [&](std::span<const std::byte> samples) -> Result<void> {
      if (!std::equal(samples.begin(), samples.end(), voxels.begin() + std::ptrdiff_t(at)))
        return selector.differ();
      at += samples.size();
      return {};
    };
    SLF_TRY(read_rows(file, kind, 1, plane, compare));
  }
  return {};
}

/// Appends all components of this page, one after the other.
Result<void> append_components(TiffFile& file, const SliceKind& kind,
                               std::vector<std::byte>& voxels) {
  const auto append_to = [](std::vector<std::byte>& all) {
    return [&all](std::span<const std::byte> samples) -> Result<void> {
      all.insert(all.end(), samples.begin(), samples.end());
      return {};
    };
  };
  if (has_planes(file)) {
    for (std::uint32_t plane = 0; plane < kind.components; ++plane)
      SLF_TRY(read_rows(file, kind, 1, plane, append_to(voxels)));
    return {};
  }
  std::vector<std::byte> samples;
  SLF_TRY(read_rows(file, kind, kind.components, 0, append_to(samples)));
  const std::size_t bytes = bytes_per_voxel(kind.type), pixel = bytes * kind.components;
  voxels.reserve(samples.size());
  for (std::size_t first = 0; first < pixel; first += bytes)
    for (std::size_t at = first; at < samples.size(); at += pixel)
      voxels.insert(voxels.end(), &samples[at], &samples[at] + bytes);
  return {};
}

Result<TiffDescription> describe_pages(const TiffFile& file, const SliceKind& kind,
                                       const VolumeOptions& options) {
  const std::string text = file.text(TIFFTAG_IMAGEDESCRIPTION);
  if (looks_like_ome(text)) return parse_ome(text, file.path, kind.components, options.array);
  if (options.array)
    return misuse(file.path, "array ", in_quotes(*options.array),
                  " was chosen, but the file names none");
  if (looks_like_imagej(text))
    return parse_imagej(text,
                        {.pixels = {file.tag<float>(TIFFTAG_XRESOLUTION, 0),
                                    file.tag<float>(TIFFTAG_YRESOLUTION, 0)},
                         .unit = file.tag<std::uint16_t>(TIFFTAG_RESOLUTIONUNIT, RESUNIT_INCH)});
  if (looks_like_shape(text)) return parse_shape(text, kind.components);
  return TiffDescription{};
}

/// What the pages of a file are, thumbnails left out.
struct TiffStack {
  std::unique_ptr<TiffFile> file;  ///< at the first page of the stack
  SliceKind kind;
  TiffDescription d;
  std::uint64_t pages = 0;
  std::uint64_t first = 0;  ///< 1 if the first page is a thumbnail that is not marked as such
};

Result<TiffStack> survey(const std::string& path, const VolumeOptions& options) {
  TiffStack stack;
  stack.file = SLF_TRY(TiffFile::open(path));
  TiffFile& file = *stack.file;
  // Some writers put a thumbnail first and do not mark it: it is smaller than all others.
  std::optional<SliceKind> rest;
  std::array<std::uint64_t, 2> offsets{};  // of the first two pages
  bool alike = true;
  for (bool more = true; more;) {
    if (!file.is_thumbnail()) {
      if (stack.pages < offsets.size())
        offsets[stack.pages] = TIFFCurrentDirOffset(file.tiff.get());
      const auto kind = alike ? kind_of(file) : Result<SliceKind>(stack.kind);
      if (stack.pages++ == 0) {
        if (!kind) return tl::unexpected(kind.error());
        stack.kind = *kind;
        auto d = SLF_TRY(describe_pages(file, *kind, options));
        stack.d = std::move(d);
      } else {
        if (kind && !rest) rest = *kind;
        alike = alike && kind && *kind == *rest;
      }
    }
    more = SLF_TRY(file.next());
  }
  if (stack.pages == 0)
    return unsupported(path,
                       "holds nothing but reduced copies and masks of pages that it lacks: give "
                       "the file of the whole stack");
  if (alike && stack.pages > 2 && stack.d.origin.empty() && rest->width > stack.kind.width &&
      rest->height > stack.kind.height) {
    stack.first = 1;
    --stack.pages;
    stack.kind = *rest;
  }
  SLF_TRY(file.go_to(offsets[stack.first]));
  return stack;
}

/// The pages of one or more files, in ascending order. So the work grows with the files, whatever a
/// description says of them.
class PageReader {
 public:
  /// The file at that page. Valid until the next call. bad_file: it has no such page, or the page
  /// was that of the call before.
  Result<TiffFile*> at(const TiffPlace& place) {
    if (!file_ || file_->path != place.path) {
      file_ = SLF_TRY(TiffFile::open(place.path));
      passed_ = 0;
    } else if (place == last_) {
      return bad_file(place.path, "page ", place.page,
                      " is that of two slices in its OME metadata");
    }
    last_ = place;
    while (true) {
      const bool counts = !file_->is_thumbnail();
      if (counts && passed_ == place.page) return file_.get();
      passed_ += counts ? 1 : 0;
      const auto more = SLF_TRY(file_->next());
      if (!more)
        return bad_file(place.path, "has ", passed_, " pages, but page ", place.page,
                        " is part of the volume");
    }
  }

 private:
  std::unique_ptr<TiffFile> file_;
  TiffPlace last_;
  std::uint64_t passed_ = 0;  ///< pages before the one that the file is at, without thumbnails
};

/// A slice's component: of a channel, or of the pixels within one.
struct ChosenChannel {
  std::uint32_t channel = 0;
  VolumeOptions of_page;
};

/// Channels are components, each with those of its pixels.
Result<ChosenChannel> choose_channel(const std::string& path, const TiffStack& stack,
                                     const VolumeOptions& options) {
  ChosenChannel chosen{0, options};
  if (stack.d.channels == 1) return chosen;
  const std::uint64_t of_pixel = stack.kind.components;
  const auto component =
      SLF_TRY(choose(path, options.component, stack.d.channels * of_pixel, "component"));
  chosen.channel = static_cast<std::uint32_t>(component / of_pixel);
  chosen.of_page.component = static_cast<std::uint32_t>(component % of_pixel);
  return chosen;
}

bool has_counted_pages(const TiffStack& stack) {
  const TiffDescription& d = stack.d;
  return double(stack.pages) == double(d.z) * double(d.channels) * double(d.times);
}

/// Appends slices of one channel and time, wherever they are. Adds the files to `files`.
Result<void> append_slices(const std::string& path, const TiffStack& stack,
                           const ChosenChannel& channel, std::uint32_t time,
                           std::vector<std::string>& files, std::vector<std::byte>& voxels) {
  constexpr std::uint64_t kMaxSlices = 1 << 20;
  const TiffDescription& d = stack.d;
  if (d.z > kMaxSlices) return unsupported(path, d.z, " slices; up to ", kMaxSlices, " are read");
  const auto selector = SLF_TRY(ComponentSelector::make(path, stack.kind, channel.of_page));
  // A file that has all pictures may have been renamed since, and its metadata may place none.
  const bool own = has_counted_pages(stack) && !d.of_several;
  const bool placed = !own || d.places_pages(stack.pages);
  std::vector<std::pair<TiffPlace, std::uint64_t>> slices;
  for (std::uint64_t z = 0; z < d.z; ++z) {
    TiffPlace place{path, page_of(d, z, channel.channel, time) + stack.first};
    if (placed) place = SLF_TRY(d.place_of(place.page, path));
    if (own) place.path = path;
    slices.emplace_back(std::move(place), z);
  }
  // Pages are read as files have them, whatever their order is in the volume.
  const bool in_order = std::ranges::is_sorted(slices);
  std::ranges::sort(slices);
  PageReader reader;
  const std::size_t before = voxels.size();
  for (const auto& [place, z] : slices) {
    if (files.empty() || files.back() != place.path) files.push_back(place.path);
    const auto page = SLF_TRY(reader.at(place));
    const auto here = SLF_TRY(kind_of(*page));
    if (here != stack.kind)
      return unsupported(place.path, "page ", place.page, " is ", describe(here),
                         ", unlike the first (", describe(stack.kind), ")");
    SLF_TRY(append_page(*page, stack.kind, selector, voxels));
  }
  if (in_order) return {};
  const std::vector<std::byte> read(voxels.begin() + std::ptrdiff_t(before), voxels.end());
  const std::size_t bytes = read.size() / slices.size();
  for (std::size_t k = 0; k < slices.size(); ++k)
    std::copy_n(&read[k * bytes], bytes, &voxels[before + slices[k].second * bytes]);
  return {};
}

tl::unexpected<Error> wrong_count(const std::string& path, const TiffStack& stack) {
  const TiffDescription& d = stack.d;
  return bad_file(path, stack.pages, " pages, but its ", d.origin, " metadata say ", d.z,
                  " slices, ", d.channels, " channels, ", d.times,
                  " time points: it is truncated, or one of a set of files that it does not name; "
                  "save the set as one file, e.g. with bfconvert or ImageJ");
}

void set_spacing(const TiffDescription& d, const VolumeOptions& options, Volume& volume) {
  for (int i = 0; i < 3; ++i) volume.axes[i][i] = d.spacing[i] > 0 ? d.spacing[i] : 1;
  if (d.spacing.x > 0 && d.spacing.y > 0 && d.spacing.z > 0) {
    volume.placement = d.origin + " metadata, in " +
                       (d.has_unit ? "micrometres" : "a unit that they do not state");
    if (d.has_unit) volume.unit = "µm";
    return;
  }
  if (options.spacing) return;
  if (d.spacing == glm::dvec3(0.0))
    volume.notes.emplace_back(kNoSpacing);
  else
    volume.notes.emplace_back(
        "its " + d.origin + " metadata state only some of the spacings: the others are taken as 1");
}

/// Reads ImageJ's stacks beyond 4 GiB: one page, whose pixels are followed by those of the other
/// pictures, without headers. `first`: the number of the first slice's picture.
Result<Volume> read_raw_stack(const TiffFile& file, const SliceKind& kind, const TiffDescription& d,
                              std::uint64_t first, Volume volume) {
  std::uint64_t* offsets = nullptr;
  if (kind.components != 1 ||
      file.tag<std::uint16_t>(TIFFTAG_COMPRESSION, COMPRESSION_NONE) != COMPRESSION_NONE ||
      !TIFFGetField(file.tiff.get(), TIFFTAG_STRIPOFFSETS, &offsets) || !offsets)
    return unsupported(file.path, "one page for ", d.z * d.channels * d.times,
                       " pictures: save it as a TIFF with a page each");
  // Pictures between two slices are taken as components of a voxel that are stored in runs.
  const std::uint64_t step = page_of(d, 1, 0, 0), pixels = std::uint64_t{kind.width} * kind.height;
  VoxelData data{.files = {file.path}, .offset = offsets[0]};
  data.big_endian = TIFFIsBigEndian(file.tiff.get()) != 0;
  data.components = static_cast<std::uint32_t>(step);
  data.component = static_cast<std::uint32_t>(first % step);
  if (step > 1) data.run = pixels;
  if (step > std::numeric_limits<std::uint32_t>::max() ||
      __builtin_mul_overflow(first / step * step, pixels * bytes_per_voxel(kind.type), &data.skip))
    return bad_file(file.path, "absurd counts of pictures");
  SLF_TRY(read_voxels(data, volume));
  return volume;
}

}  // namespace

bool looks_like_tiff(std::string_view head) { return image_formats::looks_like_tiff(head); }

Result<std::set<std::string>> files_of_tiff_set(const std::string& path) {
  const auto file = SLF_TRY(TiffFile::open(path));
  SLF_TRY(file->skip_thumbnails());
  const std::string text = file->text(TIFFTAG_IMAGEDESCRIPTION);
  if (!looks_like_ome(text)) return std::set<std::string>{};
  return files_of_ome(text, path);
}

Result<std::uint64_t> append_tiff(const std::string& path, const VolumeOptions& options,
                                  std::optional<SliceKind>& kind, std::vector<std::byte>& voxels) {
  auto stack = SLF_TRY(survey(path, options));
  SliceKind own = stack.kind;
  own.slope = stack.d.slope, own.intercept = stack.d.intercept;
  SLF_TRY(same_kind(path, own, kind));
  if (stack.d.z == 0) stack.d.z = stack.pages;
  if (!has_counted_pages(stack) && !stack.d.of_several) return wrong_count(path, stack);
  const auto time = SLF_TRY(choose(path, options.time, stack.d.times, "time point"));
  const auto channel = SLF_TRY(choose_channel(path, stack, options));
  std::vector<std::string> files;
  SLF_TRY(append_slices(path, stack, channel, time, files, voxels));
  return stack.d.z;
}

Result<Volume> read_tiff(const std::string& path, std::string_view, const VolumeOptions& options) {
  auto stack = SLF_TRY(survey(path, options));
  TiffDescription& d = stack.d;
  Volume volume{
      .type = stack.kind.type, .slope = d.slope, .intercept = d.intercept, .source = path};
  if (stack.first > 0)
    volume.notes.emplace_back("its first page is smaller than all others: left out as a thumbnail");
  if (stack.file->tag<std::uint16_t>(TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_MINISBLACK) ==
      PHOTOMETRIC_MINISWHITE)
    volume.notes.emplace_back(
        "WhiteIsZero: pictures show the least values white; here values stay as they are");
  if (d.z == 0) d.z = stack.pages;
  // Many stacks along z are saved as times, or as more channels than there are colours.
  constexpr std::uint64_t kMaxColors = 4;
  const bool as_times = d.z == 1 && d.times > 1 && !options.time;
  const bool as_channels = d.z == 1 && d.times == 1 && d.channels > kMaxColors &&
                           options.component.value_or(0) < stack.kind.components;
  if (as_times || as_channels) {
    const char other = as_times ? 'T' : 'C';
    std::swap(d.z, as_times ? d.times : d.channels);
    for (char& axis : d.order) axis = axis == 'Z' ? other : axis == other ? 'Z' : axis;
    volume.notes.push_back("its " + d.origin + " metadata call its slices " +
                           (as_times ? "time points" : "channels"));
  }
  if (stack.pages == 1 && d.z == 1 && d.times == 1 && d.channels == 1 && !options.component &&
      stack.kind.components > kMaxColors) {
    volume.dims =
        SLF_TRY(check_dims(path, {stack.kind.width, stack.kind.height, stack.kind.components}));
    volume.notes.emplace_back("its pixels have more components than colours: they are its slices");
    set_spacing(d, options, volume);
    volume.files = {path};
    SLF_TRY(append_components(*stack.file, stack.kind, volume.voxels));
    return volume;
  }
  const bool counted = has_counted_pages(stack);
  const bool raw_stack = !counted && stack.pages == 1 && d.origin == "ImageJ";
  const bool in_set = d.of_several || (!counted && d.names_files());
  if (!raw_stack && !in_set && !counted) return wrong_count(path, stack);
  volume.dims = SLF_TRY(check_dims(path, {stack.kind.width, stack.kind.height, d.z}));
  const auto time = SLF_TRY(choose(path, options.time, d.times, "time point"));
  const auto channel = SLF_TRY(choose_channel(path, stack, options));
  set_spacing(d, options, volume);
  if (raw_stack)
    return read_raw_stack(*stack.file, stack.kind, d, page_of(d, 0, channel.channel, time),
                          std::move(volume));
  SLF_TRY(append_slices(path, stack, channel, time, volume.files, volume.voxels));
  return volume;
}

}  // namespace slf::volume_io

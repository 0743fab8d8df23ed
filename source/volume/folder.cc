// A folder as a volume: a DICOM series, or pictures in the order of their names.
#include <algorithm>
#include <array>
#include <cctype>
#include <cstring>
#include <filesystem>
#include <set>

#include "base/try.h"
#include "source/volume/formats.h"
#include "source/volume/stack.h"

namespace slf::volume_io {

namespace {

bool is_digit(char c) { return std::isdigit(static_cast<unsigned char>(c)) != 0; }

/// Orders names as people do: numbers in them by value.
bool natural_less(const std::string& a, const std::string& b) {
  std::size_t i = 0, j = 0;
  while (i < a.size() && j < b.size()) {
    if (!is_digit(a[i]) || !is_digit(b[j])) {
      if (a[i] != b[j]) return a[i] < b[j];
      ++i, ++j;
      continue;
    }
    const auto number = [](const std::string& text, std::size_t& at) {
      while (at < text.size() && text[at] == '0') ++at;
      const std::size_t first = at;
      while (at < text.size() && is_digit(text[at])) ++at;
      return std::string_view(text).substr(first, at - first);
    };
    const auto x = number(a, i), y = number(b, j);
    if (x.size() != y.size()) return x.size() < y.size();
    if (x != y) return x < y;
  }
  return a.size() - i != b.size() - j ? a.size() - i < b.size() - j : a < b;
}

/// A kind of pictures that folders may hold.
struct PictureFormat {
  const char* plural;
  bool (*looks_like)(std::string_view head);
  SliceReader* append;
};

constexpr std::array<PictureFormat, 3> kFormats = {{{"PNGs", looks_like_png, append_png},
                                                    {"JPEGs", looks_like_jpeg, append_jpeg},
                                                    {"TIFFs", looks_like_tiff, append_tiff}}};

Result<Volume> stack(const std::string& path, std::vector<std::string> files,
                     const PictureFormat& format, const VolumeOptions& options) {
  Volume volume{.source = path};
  SLF_TRY(check_numbering(path, files, volume.notes));
  const bool may_have_times = format.append == append_tiff;
  SLF_TRY(choose(path, may_have_times ? std::nullopt : options.time, 1, "time point"));
  // Strays, or what a scanner broke off, are first or last: the one in the middle says what slices
  // are like. In between, a slice that is left out would shift others.
  std::optional<SliceKind> kind;
  std::vector<std::byte> middle;
  SLF_TRY(format.append(files[files.size() / 2], options, kind, middle));
  std::uint64_t slices = 0;
  std::vector<std::string> used;
  std::optional<Error> broken;
  std::size_t left_out = 0;
  bool ended = false;
  for (const auto& file : files) {
    const std::size_t before = volume.voxels.size();
    auto appended = format.append(file, options, kind, volume.voxels);
    if (appended && !ended) {
      slices += *appended;
      used.push_back(file);
      continue;
    }
    volume.voxels.resize(before);
    ended = !used.empty();
    if (!broken || !appended) broken = std::move(appended.error());
    const bool stray =
        broken->code == ErrorCode::bad_file || broken->code == ErrorCode::unsupported;
    if (appended || !stray || !are_strays(++left_out, files.size())) return tl::unexpected(*broken);
  }
  if (broken)
    volume.notes.push_back(
        concat("left out ", left_out, " of ", files.size(), " pictures: ", broken->message));
  volume.type = kind->type;
  volume.files = std::move(used);
  volume.dims = SLF_TRY(check_dims(path, {kind->width, kind->height, slices}));
  if (!options.spacing)
    volume.notes.emplace_back("pictures state no spacing: voxels are taken as 1x1x1");
  return volume;
}

/// Reads the set of files that OME metadata describe. `files`: TIFFs of the folder. nullopt: their
/// metadata describe none.
Result<std::optional<Volume>> read_set(const std::vector<std::string>& files,
                                       const VolumeOptions& options) {
  const auto name_of = [](const std::string& file) {
    return std::filesystem::path(file).filename().string();
  };
  for (const std::string& file : {files.front(), files.back()}) {
    const auto described = SLF_TRY(files_of_tiff_set(file));
    if (described.empty() || described == std::set<std::string>{name_of(file)}) continue;
    auto volume = SLF_TRY(read_tiff(file, {}, options));
    const auto strays = std::ranges::count_if(
        files, [&](const std::string& other) { return !described.contains(name_of(other)); });
    if (strays > 0)
      volume.notes.push_back(concat("left out ", strays, " of ", files.size(),
                                    " TIFFs, which the OME metadata of ", name_of(file),
                                    " do not name"));
    return std::optional<Volume>(std::move(volume));
  }
  return std::nullopt;
}

}  // namespace

std::string describe(const SliceKind& kind) {
  return concat(kind.width, "x", kind.height, " ", name(kind.type),
                kind.components > 1 ? concat(", ", kind.components, " components") : "",
                kind.alpha ? " with opacity" : "");
}

Result<void> same_kind(const std::string& source, const SliceKind& here,
                       std::optional<SliceKind>& kind) {
  if (!kind) kind = here;
  if (*kind == here) return {};
  return unsupported(source, describe(here), ", unlike the other slices (", describe(*kind), ")");
}

Result<ComponentSelector> ComponentSelector::make(const std::string& source, const SliceKind& kind,
                                                  const VolumeOptions& options) {
  ComponentSelector selector;
  selector.source_ = source;
  selector.components_ = kind.components;
  selector.width_ = bytes_per_voxel(kind.type);
  if (!options.component && kind.components >= 2 && kind.components <= 4) {
    selector.equal_ = kind.components - (kind.alpha ? 1 : 0);
    return selector;
  }
  selector.component_ = SLF_TRY(choose(source, options.component, kind.components, "component"));
  return selector;
}

Result<void> ComponentSelector::differ() const {
  const auto error = choose(source_, {}, components_, "component");
  return tl::unexpected(error.error());
}

Result<void> ComponentSelector::append(std::span<const std::byte> samples,
                                       std::vector<std::byte>& voxels) const {
  if (components_ == 1) {
    voxels.insert(voxels.end(), samples.begin(), samples.end());
    return {};
  }
  const std::size_t stride = width_ * components_;
  for (std::size_t at = 0; at + stride <= samples.size(); at += stride) {
    const auto* voxel = &samples[at];
    for (std::size_t c = 1; c < equal_; ++c)
      if (std::memcmp(voxel, voxel + c * width_, width_) != 0) return differ();
    const auto* from = voxel + component_ * width_;
    voxels.insert(voxels.end(), from, from + width_);
  }
  return {};
}

Result<Volume> read_folder(const std::string& path, const VolumeOptions& options) {
  std::array<std::vector<std::string>, kFormats.size()> files;
  bool any_dicom = false, any_picture = false;
  std::error_code code;
  auto it = std::filesystem::directory_iterator(path, code);
  for (; !code && it != std::filesystem::directory_iterator(); it.increment(code)) {
    std::error_code ignored;
    if (!it->is_regular_file(ignored)) continue;
    const auto file = it->path().string();
    const auto head = read_head(file, 1024);
    if (!head) continue;
    const bool packed = packing_of_file(file) != Packing::none;
    for (std::size_t i = 0; !packed && i < kFormats.size(); ++i)
      if (kFormats[i].looks_like(*head)) files[i].push_back(file), any_picture = true;
    any_dicom = any_dicom || looks_like_dicom(*head);
  }
  if (code) return fail(ErrorCode::io, path, ": ", code.message());
  if (!any_dicom && !any_picture) return refuse_folder(path);
  if (any_dicom) return read_dicom_folder(path, options);
  SLF_TRY(refuse_series(path, options));
  std::string found;
  std::size_t all = 0, format = 0;
  for (std::size_t i = 0; i < kFormats.size(); ++i) {
    if (files[i].empty()) continue;
    found += concat(all > 0 ? " and " : "", files[i].size(), " ", kFormats[i].plural);
    all += files[i].size();
    if (files[i].size() > files[format].size()) format = i;
  }
  const std::size_t strays = all - files[format].size();
  if (strays > 0 && !are_strays(strays, all))
    return unsupported(path, found,
                       ", expected one kind: move the others to a folder of their own");
  std::ranges::sort(files[format], natural_less);
  if (kFormats[format].append == append_tiff) {
    auto set = SLF_TRY(read_set(files[format], options));
    if (set) return std::move(*set);
  }
  auto volume = stack(path, files[format], kFormats[format], options);
  if (volume && strays > 0)
    volume->notes.push_back("of " + found + ", only the " + kFormats[format].plural + " are read");
  return volume;
}

}  // namespace slf::volume_io

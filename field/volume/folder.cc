// A folder as a volume: a DICOM series, or pictures in the order of their names.
#include <algorithm>
#include <cctype>
#include <cstring>
#include <filesystem>

#include "field/volume/stack.h"

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

Result<Volume> stack(const std::string& path, const std::vector<std::string>& files, bool png,
                     const VolumeOptions& options) {
  Volume volume;
  volume.source = path;
  if (const auto ok = choose(path, options.time, 1, "time point"); !ok)
    return tl::unexpected(ok.error());
  std::optional<SliceKind> kind;
  std::uint64_t slices = 0;
  for (const auto& file : files) {
    if (png) {
      if (auto ok = append_png(file, options, kind, volume.voxels); !ok)
        return tl::unexpected(ok.error());
      ++slices;
    } else {
      const auto pages = append_tiff(file, options, kind, volume.voxels);
      if (!pages) return tl::unexpected(pages.error());
      slices += *pages;
    }
  }
  volume.type = kind->type;
  volume.files = files;
  const auto dims =
      check_dims(path, std::array<std::uint64_t, 3>{kind->width, kind->height, slices});
  if (!dims) return tl::unexpected(dims.error());
  volume.dims = *dims;
  if (!options.spacing)
    volume.notes.emplace_back("pictures state no spacing: voxels are taken as 1x1x1");
  return volume;
}

}  // namespace

std::string describe(const SliceKind& kind) {
  return std::to_string(kind.width) + "x" + std::to_string(kind.height) + " " + name(kind.type) +
         (kind.components > 1 ? ", " + std::to_string(kind.components) + " components" : "");
}

Result<ComponentSelector> ComponentSelector::make(const std::string& source, const SliceKind& kind,
                                                  const VolumeOptions& options) {
  ComponentSelector selector;
  selector.source_ = source;
  selector.components_ = kind.components;
  selector.width_ = bytes_per_voxel(kind.type);
  const bool implicit = !options.component && kind.components >= 2 && kind.components <= 4;
  selector.require_grey_ = implicit && kind.components >= 3;
  if (implicit) return selector;
  const auto component = choose(source, options.component, kind.components, "component");
  if (!component) return tl::unexpected(component.error());
  selector.component_ = *component;
  return selector;
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
    if (require_grey_ && (std::memcmp(voxel, voxel + width_, width_) != 0 ||
                          std::memcmp(voxel, voxel + 2 * width_, width_) != 0)) {
      const auto error = choose(source_, {}, components_, "component");
      return tl::unexpected(error.error());
    }
    const auto* from = voxel + component_ * width_;
    voxels.insert(voxels.end(), from, from + width_);
  }
  return {};
}

Result<Volume> read_folder(const std::string& path, const VolumeOptions& options) {
  std::vector<std::string> pngs, tiffs;
  bool any_dicom = false;
  std::error_code code;
  auto it = std::filesystem::directory_iterator(path, code);
  for (; !code && it != std::filesystem::directory_iterator(); it.increment(code)) {
    std::error_code ignored;
    if (!it->is_regular_file(ignored)) continue;
    const auto file = it->path().string();
    const auto head = read_head(file, 1024);
    if (!head) continue;
    if (looks_like_png(*head)) pngs.push_back(file);
    if (looks_like_tiff(*head)) tiffs.push_back(file);
    any_dicom = any_dicom || looks_like_dicom(*head);
  }
  if (code) return fail(ErrorCode::io, path, ": ", code.message());
  if (any_dicom || (pngs.empty() && tiffs.empty())) return read_dicom_folder(path, options);
  if (!pngs.empty() && !tiffs.empty())
    return fail(ErrorCode::unsupported, path, ": ", pngs.size(), " PNGs and ", tiffs.size(),
                " TIFFs, expected one kind: move one of them to a folder of its own");
  auto& files = pngs.empty() ? tiffs : pngs;
  std::sort(files.begin(), files.end(), natural_less);
  return stack(path, files, !pngs.empty(), options);
}

}  // namespace slf::volume_io

// Presets by reference: built in, in a file, or one of several in a file.
#include <algorithm>
#include <filesystem>

#include "base/try.h"
#include "base/utf8.h"
#include "source/transfer/transfer_formats.h"
#include "source/volume/io.h"

namespace slf {

using namespace transfer_formats;
using volume_io::in_quotes;

namespace {

const TransferPreset* find_built_in(const std::string& name) {
  for (const auto& preset : built_in_transfers())
    if (preset.function.name == lower_case(name)) return &preset;
  return nullptr;
}

/// Some names of presets, for a message. Names that contain `like` come first.
std::string some_names(std::span<const TransferPreset> presets, const std::string& like) {
  std::vector<std::string> names;
  for (const auto& preset : presets) names.push_back(preset.function.name);
  std::stable_partition(names.begin(), names.end(), [&](const std::string& name) {
    return !like.empty() && lower_case(name).find(lower_case(like)) != std::string::npos;
  });
  constexpr std::size_t kSome = 16;
  const std::string list = joined(std::span(names).first(std::min(kSome, names.size())));
  return names.size() > kSome ? concat(list, ", and ", names.size() - kSome, " more") : list;
}

}  // namespace

Result<std::vector<TransferPreset>> parse_transfers(const std::string& bytes,
                                                    const std::string& source) try {
  std::string made;
  const std::string_view text = as_utf8(bytes, made);
  auto presets = looks_like_clut(text)  ? parse_clut(text, source)
                 : looks_like_xml(text) ? parse_xml(bytes, source)  // which knows its encoding
                 : looks_like_vp(text)  ? parse_vp(text, source)
                 : trim(text).find_first_of("[{") == 0
                     ? parse_json(std::string(text), source)
                     : Presets(bad_file(source,
                                        "expected a transfer function of ParaView (JSON, XML), 3D "
                                        "Slicer (.vp) or MRIcroGL (.clut), found ",
                                        in_quotes(trim(text))));
  if (presets)
    for (auto& preset : *presets)
      if (preset.function.name.empty())
        preset.function.name = std::filesystem::path(source).stem().string();
  return presets;
} catch (...) {
  return tl::unexpected(error_of_exception());
}

Result<std::vector<TransferPreset>> read_transfers(const std::string& path) try {
  constexpr std::uint64_t kMaxBytes = std::uint64_t{64} << 20;
  const auto bytes = SLF_TRY(read_file(path, kMaxBytes));
  return parse_transfers(std::string(chars_of(bytes)), path);
} catch (...) {
  return tl::unexpected(error_of_exception());
}

std::string transfer_file(const std::string& reference) {
  if (find_built_in(reference) != nullptr || reference.starts_with('{')) return {};
  // A path may itself contain '#': use the longest prefix that is a file.
  std::string path = reference;
  std::error_code ignored;
  while (!std::filesystem::exists(path, ignored)) {
    const auto hash = path.rfind('#');
    if (hash == std::string::npos) break;
    path.resize(hash);
  }
  return path;
}

Result<TransferPreset> read_transfer(const std::string& reference) try {
  if (const auto* found = find_built_in(reference)) return *found;
  if (reference.starts_with('{')) {
    auto presets = SLF_TRY(parse_transfers(reference, "transfer function"));
    return std::move(presets.front());
  }
  const std::string path = transfer_file(reference);
  std::error_code ignored;
  if (!std::filesystem::exists(path, ignored) &&
      reference.find_first_of("/.#") == std::string::npos)
    return fail(ErrorCode::usage, in_quotes(reference),
                ": no such file, and no built-in transfer function; there are ",
                some_names(built_in_transfers(), reference));
  auto presets = SLF_TRY(read_transfers(path));
  if (path.size() == reference.size()) return std::move(presets.front());
  const std::string name = reference.substr(path.size() + 1);
  for (const bool exact : {true, false})
    for (auto& preset : presets)
      if (exact ? preset.function.name == name
                : lower_case(preset.function.name) == lower_case(name))
        return std::move(preset);
  return misuse(path, "no preset ", in_quotes(name), "; there are ", some_names(presets, name));
} catch (...) {
  return tl::unexpected(error_of_exception());
}

}  // namespace slf

#include "base/file_finder.h"

#include <algorithm>

#include "base/ascii.h"

namespace slf {

namespace fs = std::filesystem;

fs::path FileFinder::entry(const fs::path& folder, const std::string& name) {
  std::error_code error;
  if (fs::exists(folder / name, error)) return folder / name;
  const auto [found, is_new] = entries_.try_emplace(folder.string());
  if (is_new) {
    auto it = fs::directory_iterator(folder.empty() ? "." : folder, error);
    for (; !error && it != fs::directory_iterator(); it.increment(error)) {
      std::string there = it->path().filename().string();
      std::string key = lower_case(there);
      found->second.emplace(std::move(key), std::move(there));
    }
  }
  const auto entry = found->second.find(lower_case(name));
  return folder / (entry == found->second.end() ? name : entry->second);
}

fs::path FileFinder::folder_like(const fs::path& path) {
  std::error_code ignored;
  if (path.empty() || !path.has_relative_path() || fs::is_directory(path, ignored)) return path;
  return entry(folder_like(path.parent_path()), path.filename().string());
}

std::optional<std::string> FileFinder::find(const std::string& stated, const std::string& below) {
  std::error_code ignored;
  const auto is_file = [&](const fs::path& path) { return fs::is_regular_file(path, ignored); };
  const auto may_be = [&](const fs::path& path) {
    return !allowed_ || allowed_((below / path).lexically_normal());
  };
  const fs::path from = folder_ / below, path = (from / stated).lexically_normal();
  if (may_be(stated) && is_file(path)) return path.string();
  std::string slashes = stated;
  std::ranges::replace(slashes, '\\', '/');
  fs::path rest = slashes;
  for (bool whole = true; !rest.empty(); whole = false) {
    if (may_be(rest)) {
      const fs::path other = (from / rest).lexically_normal();
      const fs::path folder = folder_like(other.parent_path());
      for (std::size_t k = 0; k <= endings_.size(); ++k) {
        const std::string ending = k == 0 ? "" : endings_[k - 1];
        const fs::path file = entry(folder, other.filename().string() + ending);
        if (!is_file(file)) continue;
        moved_ += whole ? 0 : 1;
        return file.string();
      }
    }
    fs::path shorter;
    for (auto part = std::next(rest.begin()); part != rest.end(); ++part) shorter /= *part;
    rest = shorter;
  }
  return std::nullopt;
}

}  // namespace slf

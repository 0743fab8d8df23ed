// Finding the files that other files name: whatever program wrote the names, and wherever the files
// were at that time.
#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace slf {

class FileFinder {
 public:
  /// Whether a path, relative to the folder and normal, may be looked for.
  using Allowed = bool(const std::filesystem::path& path);

  /// Names are relative to `folder`. `endings`: what may follow a name, such as ".png".
  explicit FileFinder(std::filesystem::path folder, std::vector<std::string> endings = {},
                      Allowed* allowed = nullptr)
      : folder_(std::move(folder)), endings_(std::move(endings)), allowed_(allowed) {}

  /// The path as stated. If there is no regular file: with slashes for backslashes, upper for lower
  /// case or the reverse, or an ending. If there is none either: by the last folders of the path,
  /// as many as there are, since sets of files are moved to other places. nullopt: none.
  /// `below`: a folder in the folder, which names are relative to instead.
  [[nodiscard]] std::optional<std::string> find(const std::string& stated,
                                                const std::string& below = "");

  /// The number of files that were found by their last folders only.
  [[nodiscard]] std::size_t moved() const { return moved_; }

 private:
  /// The entry of a folder with this name, whatever its case.
  std::filesystem::path entry(const std::filesystem::path& folder, const std::string& name);
  std::filesystem::path folder_like(const std::filesystem::path& path);

  std::filesystem::path folder_;
  std::vector<std::string> endings_;
  Allowed* allowed_;
  std::size_t moved_ = 0;
  std::map<std::string, std::map<std::string, std::string>> entries_;  ///< by lower-case name
};

}  // namespace slf

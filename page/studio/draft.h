// Draft: the recipe that a studio makes, and the files in which it keeps that beside the output.
#pragma once

#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <string_view>

#include "base/bytes.h"
#include "page/studio/studio.h"
#include "slf/recipe.h"

namespace slf::page {

/// Thread-safety: none.
class Draft {
 public:
  /// Begins with a recipe, or with what another run kept. usage: that is damaged.
  [[nodiscard]] static Result<Draft> open(const Recipe& recipe, const StudioOptions& options);

  /// The recipe of what a page states, of the input that the studio was given. Untrusted: usage, if
  /// it names a file that neither the recipe of open() nor take() named.
  [[nodiscard]] Result<Recipe> parse(const nlohmann::json& stated) const;
  /// `document`, to build it.
  [[nodiscard]] Result<Recipe> whole() const;

  /// Writes what is not saved, to go on from there.
  Result<void> keep();
  /// Writes the recipe, with paths that are relative to it, and what --views takes. usage: another
  /// program wrote a file of that name.
  Result<void> save();
  /// Takes the next bytes of a picture of surroundings, from `first` on, of `size`. Returns the
  /// path of the file that it keeps them in, once all have come; empty: not yet. Untrusted.
  Result<std::string> take(std::uint64_t first, std::uint64_t size, ByteSpan bytes);
  /// Removes files of take() that no recipe names.
  void tidy() const;
  [[nodiscard]] bool saved() const;
  /// Whether there is such a file, which this studio did not begin with and did not write.
  [[nodiscard]] bool is_of_another(const std::string& path) const;

  Recipe base;
  nlohmann::json document, shown;  ///< the recipe, with states; and what is shown of it
  nlohmann::json views = nlohmann::json::object();  ///< saved views, notes, what a page says
  std::string recipe_path, views_path;
  bool kept = true;       ///< all of it is in a file
  bool restored = false;  ///< it began with what another run kept

 private:
  [[nodiscard]] Result<void> check_files(const nlohmann::json& stated) const;
  /// Whether take() gives files such a path.
  [[nodiscard]] bool is_taken(std::string_view path) const;

  std::string stem_, path_;
  std::set<std::string> files_;  ///< that a recipe may name
  std::set<std::string> owned_;  ///< that this studio, or one before it, wrote
  std::set<std::string> loose_;  ///< of take(), that no saved recipe names
  Bytes incoming_;               ///< of take()
};

}  // namespace slf::page

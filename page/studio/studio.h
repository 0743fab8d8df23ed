// Studio: a page on which a recipe is made by looking (doc/studio.md). It answers the requests of
// that page; a page::Server passes them on.
//
//   GET  ""            the page; also studio.js and studio.css
//   GET  "state"       JSON: the recipe, what it is of, presets, notes, how far a build is
//   POST "recipe"      {"page", "revision", "shown", "recipe", "views"}: shows and keeps others
//   POST "look"        a camera; answered by the next better picture, or that of a newer recipe
//   POST "point"       a pixel; answered by the place and the value that it shows
//   GET  "preset/N"    a small picture of the N-th preset
//   POST "presets"     {"name", "text"}: a file of transfer functions; answered by those
//   POST "environment" bytes of a picture of surroundings, Slf-First on of Slf-Size; answered by
//                      the path at which all of them are. GET: a small picture of it
//   POST "forecast"    answered by what a build would take (BuildForecast), once that is known
//   POST "save"        writes the recipe, and what --views takes
//   POST "build"       saves, and builds the field; "stop" ends that
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "page/http.h"
#include "slf/error.h"
#include "slf/recipe.h"

namespace slf::page {

struct StudioOptions {
  std::string output;    ///< the field that is to be built
  std::string save{};    ///< path of the recipe; empty: NAME.recipe.json beside the output
  std::string opened{};  ///< the recipe that the studio begins with, and may replace by a save
  unsigned threads = 0;  ///< 0: all
  /// Shows a finished field, and returns its folder beside that of the studio.
  std::function<Result<std::string>(const std::string& field)> show{};
};

/// Thread-safety: none, but for threads of its own.
class Studio {
 public:
  /// Begins with a recipe, or with the draft that another run left beside the output. Errors as
  /// those of the reader of volumes, or of sets of pictures; others come with the first picture.
  [[nodiscard]] static Result<std::unique_ptr<Studio>> make(const Recipe& recipe,
                                                            StudioOptions options);
  ~Studio();

  /// The answer to a request, `rest` of whose path follows the studio's folder; none: not yet.
  /// Requests are untrusted.
  [[nodiscard]] std::optional<Response> answer(const Request& request, std::string_view rest);

 private:
  struct State;
  explicit Studio(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace slf::page

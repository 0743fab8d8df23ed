// The options of a recipe: the one place where each has its name, its values, the sources that it
// applies to, its default and its help. From options() follow the command line, the JSON of recipes
// and states, schemas/recipe.json, slf.Settings of Python, and what is refused. Internal.
#pragma once

#include <functional>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "slf/recipe.h"

namespace slf::recipe {

/// Numbers from outside have bounds, so that no product of them overflows and no loop over them
/// seems endless. Lengths are in units of the world.
inline constexpr double kMinLength = 1e-12, kMaxLength = 1e12;

/// What the input is; also as a set.
enum Kind : unsigned { kVolume = 1, kMesh = 2, kPictures = 4, kAnalytic = 8, kAny = 15 };
[[nodiscard]] Kind kind_of(const Recipe& recipe);

/// What an option is for.
enum class Use {
  input,    ///< what is shown
  reading,  ///< how the files of the input are read
  data,     ///< what else is read or made of it; a field does not hold it, so who compares names it
  view,     ///< rays and light, which a field records
  cost,     ///< memory and files that keep work for later; no ray changes by it
  truth,    ///< pictures to compare with
  frame,    ///< the sphere and the states of the field to build
  field,    ///< what else it is, which the field says itself
};

/// A value, as JSON, as text on the command line, and as words of messages.
struct Type {
  enum class Form {
    flag,
    whole,  ///< a number without fraction
    number,
    bytes,  ///< a number, or text as "64MiB"
    text,
    file,     ///< a path relative to the recipe, or the JSON object that such a file holds
    choice,   ///< one of `names`
    numbers,  ///< `count` of them
    wholes,   ///< `count` of them; 0: any number
    planes,   ///< [[x, y, z, nx, ny, nz], ...]
    box,      ///< "X0:X1,Y0:Y1,Z0:Z1", or [[x0, x1], ...] with null for an end of the volume
  } form = Form::text;
  const char* shown = "TEXT";  ///< in --help
  double low = std::numeric_limits<double>::lowest(), high = std::numeric_limits<double>::max();
  bool above = false;  ///< `low` itself is too low
  unsigned count = 1;
  char delimiter = ',';  ///< between numbers in text
  std::vector<const char*> names{};
};

struct Option {
  const char* name;  ///< in JSON and Python: "label_table"; --label-table on the command line
  const char* group;
  unsigned kinds;  ///< those of Kind to which it applies
  Use use;
  Type type;
  std::string help;  ///< in which {NAME} stands for an option
  /// REQUIRES: a checked value, or null for the default.
  std::function<void(Recipe&, const nlohmann::json&)> set;
  std::function<nlohmann::json(const Recipe&)> get;  ///< null: by default
  std::optional<std::string> otherwise{};            ///< the default, if get() cannot say it
  const char* needs = nullptr;     ///< another option, without which it has no sense
  const char* excludes = nullptr;  ///< another option, instead of which it stands
  const char* former = nullptr;    ///< another name of it, from before
  bool rare = false;               ///< left out of the short help
  bool in_memory = false;          ///< a program may pass a volume instead
  const char* negative = nullptr;  ///< of a flag that is on: the command line's name to put it off
};

/// All of them, in the order of --help. Static lifetime.
[[nodiscard]] std::span<const Option> options();
/// The same, for a test to add a row before anything reads it.
[[nodiscard]] std::vector<Option>& table();
/// The option of this name; null: none.
[[nodiscard]] const Option* find(std::string_view name);

/// The value that a text of the command line stands for. usage: "TEXT: expected ...".
[[nodiscard]] Result<nlohmann::json> parse(const Type& type, const std::string& text);
/// The value as parse() reads it.
[[nodiscard]] std::string text_of(const Type& type, const nlohmann::json& value);

/// Whether the text of an option of Form::file names one, and not something built in.
[[nodiscard]] bool names_file(std::string_view option, const std::string& text);

/// Sets an option of the recipe, and notes it as stated. Text stands for what parse() makes of it,
/// null for its default, and a relative path is one from `folder`. usage: no such option, another
/// type of value, or out of range; the message and Error::choice name it.
[[nodiscard]] Result<void> set(Recipe& recipe, std::string_view name, const nlohmann::json& value,
                               const std::string& folder = {});

/// One of the options that are `stated`, in whose place this one stands; null: none.
[[nodiscard]] const Option* rival_of(const Option& option,
                                     const std::set<std::string, std::less<>>& stated);

/// usage: an option is stated that does not apply to this kind of source, or lacks another.
[[nodiscard]] Result<void> check_applies(const Recipe& recipe);

/// Adds states, as a recipe states them: [{"name": TEXT, OPTION: VALUE, ...}, ...]. `file` stated
/// them, in whose folder their paths begin; empty: none.
[[nodiscard]] Result<void> add_states(Recipe& to, const nlohmann::json& states,
                                      const std::string& file);

/// What is stated of the source, as JSON that read_recipe() reads: without folders, and without
/// what a field says itself.
[[nodiscard]] nlohmann::json to_json(const Recipe& recipe);

/// The same as text, for what is published: without the names of DICOM files, which are often those
/// of patients, and of series. `light_from`: of a state.
[[nodiscard]] std::string published(const Recipe& recipe, const Scene& scene,
                                    const std::string& light_from = {});

/// A help with the names of options as they are written: on the command line, or as they are.
[[nodiscard]] std::string help_of(const Option& option, bool command_line);

/// What is made of the table: schemas/recipe.json, and Python's slf/_settings.py.
[[nodiscard]] nlohmann::json schema(std::span<const Option> options);
[[nodiscard]] std::string python_settings(std::span<const Option> options);

}  // namespace slf::recipe

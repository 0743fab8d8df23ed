#include "page/studio/draft.h"

#include <algorithm>
#include <filesystem>
#include <functional>
#include <iterator>

#include "base/ascii.h"
#include "base/file.h"
#include "base/try.h"
#include "image/formats.h"
#include "page/views.h"
#include "source/recipe/options.h"
#include "source/recipe/scenes.h"

namespace slf::page {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr std::string_view kTaken = ".environment";  // after the output's name, of take()
constexpr std::size_t kMaxSurroundings = 256 << 20;  // bytes of a picture

/// Whether an option names a file, and not something built in.
bool names_file(const std::string& name, const json& value) {
  const recipe::Option* const option = recipe::find(name);
  return option && option->type.form == recipe::Type::Form::file && value.is_string() &&
         recipe::names_file(option->name, value.get<std::string>());
}

/// Options of a recipe, and of its states, after `change` of each path in them.
json with_paths(json options, const std::function<fs::path(const fs::path&)>& change) {
  for (auto& [name, value] : options.items()) {
    if (name == "states" && value.is_array())
      for (json& state : value) state = with_paths(state, change);
    if (!names_file(name, value)) continue;
    const auto text = value.get<std::string>();
    const bool pictures = name == "input" && text.starts_with(recipe::kPicturesPrefix);
    const std::size_t prefix = pictures ? recipe::kPicturesPrefix.size() : 0;
    value = text.substr(0, prefix) + change(text.substr(prefix)).string();
  }
  return options;
}

std::set<std::string> files_of(const json& options) {
  std::set<std::string> files;
  with_paths(options, [&](const fs::path& path) {
    files.insert(path.string());
    return path;
  });
  return files;
}

}  // namespace

Result<Draft> Draft::open(const Recipe& recipe, const StudioOptions& options) {
  Draft draft;
  draft.base = recipe;
  const fs::path output = options.save.empty() ? options.output : options.save;
  draft.stem_ = (output.parent_path() / output.stem()).string();
  if (draft.stem_.ends_with(".recipe")) draft.stem_.resize(draft.stem_.size() - 7);
  draft.recipe_path = options.save.empty() ? draft.stem_ + ".recipe.json" : options.save;
  draft.views_path = draft.stem_ + ".views.json";
  draft.path_ = draft.recipe_path + ".draft";
  std::error_code ignored;
  if (!options.opened.empty() && fs::equivalent(options.opened, draft.recipe_path, ignored)) {
    draft.owned_.insert(draft.recipe_path);
    if (fs::exists(draft.views_path, ignored)) {
      const auto file = SLF_TRY(read_views(draft.views_path));
      SLF_TRY(parse_views(file, {}));
      draft.views = json::parse(file.text);
      draft.owned_.insert(draft.views_path);
    }
  }
  json first = json::object();
  for (const recipe::Option& option : recipe::options())
    if (recipe.stated.contains(option.name) && option.name != std::string_view("input"))
      first[option.name] = option.get(recipe);
  draft.document = draft.shown = first;
  for (const RecipeState& given : recipe.states) {
    json one = with_paths(json::parse(given.options), [&](const fs::path& path) {
      return fs::path(given.file).parent_path() / path;
    });
    one["name"] = given.name;
    if (!given.light_from.empty()) one["light_from"] = given.light_from;
    draft.document["states"].push_back(std::move(one));
  }
  draft.files_ = files_of(draft.document);
  if (!fs::is_regular_file(draft.path_, ignored)) return draft;
  const auto bytes = SLF_TRY(read_file(draft.path_, 16 << 20));
  const json last = json::parse(chars_of(bytes), nullptr, /*allow_exceptions=*/false);
  if (!last.is_object() || !last.contains("shown"))
    return fail(ErrorCode::usage, draft.path_,
                ": is no draft of a studio, which would be kept there; move it");
  const auto had = last.value("owns", std::set<std::string>());
  // Whoever wrote the draft, it opens and removes no other files than those of take().
  const auto is_taken = [&](const std::string& path) { return draft.is_taken(path); };
  std::ranges::copy_if(had, std::inserter(draft.files_, draft.files_.end()), is_taken);
  if (!draft.parse(last["shown"])) return draft;
  draft.shown = last["shown"];
  draft.document = last.value("recipe", draft.shown);
  draft.views = last.value("views", draft.views);
  draft.owned_.insert(had.begin(), had.end());
  std::ranges::copy_if(last.value("loose", std::set<std::string>()),
                       std::inserter(draft.loose_, draft.loose_.end()), is_taken);
  draft.restored = true;
  return draft;
}

bool Draft::is_of_another(const std::string& path) const {
  std::error_code ignored;
  return !owned_.contains(path) && fs::exists(path, ignored);
}

/// A page reads no other file than those that are known.
Result<void> Draft::check_files(const json& stated) const {
  for (const auto& [name, value] : stated.items())
    if (names_file(name, value) && !files_.contains(value.get<std::string>()))
      return fail(ErrorCode::usage, name, ": files are named on the command line");
  return {};
}

Result<Recipe> Draft::parse(const json& stated) const {
  if (!stated.is_object()) return fail(ErrorCode::usage, "expected an object");
  SLF_TRY(check_files(stated));
  Recipe made;
  made.input = base.input;
  made.volume = base.volume;
  if (!base.volume) made.stated.insert("input");
  for (const auto& [name, value] : stated.items()) SLF_TRY(recipe::set(made, name, value));
  SLF_TRY(recipe::check_applies(made));
  return made;
}

Result<Recipe> Draft::whole() const {
  json stated = document;
  const json states = stated.value("states", json());
  stated.erase("states");
  Recipe recipe = SLF_TRY(parse(stated));
  if (states.is_array())
    for (const json& state : states) SLF_TRY(check_files(state));
  if (!states.is_null()) SLF_TRY(recipe::add_states(recipe, states, {}));
  return recipe;
}

Result<void> Draft::keep() {
  kept = true;
  const json draft{{"recipe", document},
                   {"shown", shown},
                   {"views", views},
                   {"owns", owned_},
                   {"loose", loose_}};
  return write_file(path_, bytes_of(draft.dump()));
}

Result<void> Draft::save() {
  std::error_code ignored;
  std::vector<std::string> written{recipe_path};
  const auto says = [](const json& part) { return !part.empty(); };
  const bool has_views = std::ranges::any_of(views, says);
  if (has_views) written.push_back(views_path);
  for (const std::string& path : written)
    if (is_of_another(path))
      return fail(
          ErrorCode::usage, path,
          ": exists, and this studio did not begin with it; move it, or name another recipe "
          "by --save, another output by -o");
  SLF_TRY(whole());
  const fs::path where = fs::absolute(recipe_path).parent_path();
  json out = document;
  if (!base.volume) out["input"] = base.input;
  out = with_paths(out,
                   [&](const fs::path& path) { return fs::proximate(fs::absolute(path), where); });
  SLF_TRY(write_file(recipe_path, bytes_of(out.dump(2) + "\n")));
  owned_.insert(written.begin(), written.end());
  if (has_views) SLF_TRY(write_file(views_path, bytes_of(views.dump(2) + "\n")));
  for (const std::string& path : files_of(document)) loose_.erase(path);
  fs::remove(path_, ignored);
  kept = true;
  return {};
}

Result<std::string> Draft::take(std::uint64_t first, std::uint64_t size, ByteSpan bytes) {
  if (first > incoming_.size() || size > kMaxSurroundings || first + bytes.size() > size)
    return fail(ErrorCode::usage, "it did not come whole, or has more than 256 MiB; drop it again");
  incoming_.resize(first);
  incoming_.insert(incoming_.end(), bytes.begin(), bytes.end());
  if (incoming_.size() < size) return std::string();
  const bool exr = chars_of(incoming_).starts_with("\x76\x2f\x31\x01");
  if (!exr && !chars_of(incoming_).starts_with("#?"))
    return fail(ErrorCode::usage, "expected a picture in OpenEXR or Radiance HDR");
  SLF_TRY(image_formats::decode("picture", incoming_));
  std::string path;
  std::error_code ignored;
  for (int k = 1; path.empty() || fs::exists(path, ignored); ++k)
    path = concat(stem_, kTaken, k > 1 ? concat("-", k) : "", exr ? ".exr" : ".hdr");
  SLF_TRY(write_file(path, std::exchange(incoming_, {})));
  for (auto* const names : {&files_, &owned_, &loose_}) names->insert(path);
  return path;
}

bool Draft::is_taken(std::string_view path) const {
  const std::string begin = concat(stem_, kTaken);
  if (!path.starts_with(begin) || !(path.ends_with(".exr") || path.ends_with(".hdr"))) return false;
  const std::string_view number = path.substr(begin.size(), path.size() - begin.size() - 4);
  return number.empty() || (number[0] == '-' && parse_number<unsigned>(number.substr(1)));
}

void Draft::tidy() const {
  auto named = files_of(document);
  named.merge(files_of(shown));
  std::error_code ignored;
  for (const std::string& path : loose_)
    if (!named.contains(path)) fs::remove(path, ignored);
}

bool Draft::saved() const {
  std::error_code ignored;
  return owned_.contains(recipe_path) && kept && !fs::exists(path_, ignored);
}

}  // namespace slf::page

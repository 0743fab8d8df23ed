#include "page/studio/studio.h"

#include <chrono>
#include <cmath>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <set>

#include "base/file.h"
#include "base/guarded.h"
#include "base/join.h"
#include "base/nesting.h"
#include "base/report.h"
#include "base/try.h"
#include "page/page.h"
#include "page/studio/caster.h"
#include "page/studio/subject.h"
#include "page/studio/task.h"
#include "page/views.h"
#include "slf/build.h"
#include "slf/transfer.h"
#include "source/recipe/options.h"

namespace slf::page {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using Clock = std::chrono::steady_clock;

constexpr std::uint32_t kMaxSide = 4096;  // of pictures
constexpr std::chrono::seconds kDraftEvery(1);

/// Whether an option names a file, and not something built in.
bool names_file(const std::string& name, const json& value) {
  const recipe::Option* const option = recipe::find(name);
  return option && option->type.form == recipe::Type::Form::file && value.is_string() &&
         recipe::names_file(option->name, value.get<std::string>());
}

/// Options of a recipe, or of one of its states, after `change` of each path in them.
json with_paths(json options, const std::function<fs::path(const fs::path&)>& change) {
  for (auto& [name, value] : options.items()) {
    if (!names_file(name, value)) continue;
    const auto text = value.get<std::string>();
    const bool pictures = name == "input" && text.starts_with(recipe::kPicturesPrefix);
    const std::size_t prefix = pictures ? recipe::kPicturesPrefix.size() : 0;
    value = text.substr(0, prefix) + change(text.substr(prefix)).string();
  }
  return options;
}

Response text(int status, std::string_view type, std::string body) {
  Response response;
  response.status = status;
  response.set("Content-Type", type);
  response.body = {{std::move(body)}};
  return response;
}
Response reply(const json& value, int status = 200) {
  return text(status, "application/json",
              value.dump(-1, ' ', false, json::error_handler_t::replace));
}
Response refusal(const std::string& message, int status = 422) {
  return reply({{"error", message}}, status);
}

/// A function as recipes state it.
json stated(const TransferFunction& function) { return json::parse(to_json(function)).at(0); }

template <std::size_t N>
std::optional<std::array<double, N>> numbers(const json& from, const char* name) {
  const auto found = from.find(name);
  std::array<double, N> out;
  if (found == from.end() || !found->is_array() || found->size() != N) return std::nullopt;
  for (std::size_t k = 0; k < N; ++k) {
    if (!(*found)[k].is_number()) return std::nullopt;
    out[k] = (*found)[k].template get<double>();
    if (!std::isfinite(out[k])) return std::nullopt;
  }
  return out;
}

std::optional<Look> look_of(const json& from) {
  Look look;
  const auto orbit = numbers<6>(from, "orbit");
  const auto size = numbers<2>(from, "size");
  if (!orbit || !size || !((*orbit)[2] > 0 && (*orbit)[2] <= kMaxOrbit)) return std::nullopt;
  for (const double side : *size)
    if (!(side >= 1 && side <= kMaxSide)) return std::nullopt;
  look.orbit = *orbit;
  look.width = static_cast<std::uint32_t>((*size)[0]);
  look.height = static_cast<std::uint32_t>((*size)[1]);
  if (const auto sphere = numbers<4>(from, "sphere"); sphere && (*sphere)[3] > 0)
    look.sphere = {{(*sphere)[0], (*sphere)[1], (*sphere)[2]}, (*sphere)[3]};
  look.serial = from.value("serial", std::uint64_t{1});
  look.moving = from.value("moving", false);
  return look;
}

}  // namespace

struct Studio::State {
  State(Recipe recipe, StudioOptions given)
      : base(std::move(recipe)), options(std::move(given)), caster(options.threads) {}
  ~State() {
    if (!kept) (void)guarded([&] { return keep(); });
  }

  /// A page reads no file but those that the maker named when the studio began.
  Result<void> check_files(const json& stated) const {
    for (const auto& [name, value] : stated.items())
      if (names_file(name, value) && !files.contains(value.get<std::string>()))
        return fail(ErrorCode::usage, name, ": files are named on the command line");
    return {};
  }

  /// The recipe of this JSON: what the page states, of the input that it is given.
  Result<Recipe> parse(const json& stated) const {
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

  Result<void> show(const json& stated) {
    auto made = SLF_TRY(parse(stated));
    shown = stated;
    revision = caster.show(std::move(made));
    return {};
  }

  /// Writes the draft.
  Result<void> keep() {
    kept = true;
    kept_at = Clock::now();
    const json draft{{"recipe", document}, {"shown", shown}, {"views", views}, {"owns", owned}};
    return write_file(draft_path, bytes_of(draft.dump()));
  }

  Result<void> save();
  [[nodiscard]] Result<Recipe> whole() const;
  template <class T, class Work>
  void begin(Task<T>& task, const Work& work);
  void build(bool replace);
  json progress();
  std::optional<Response> forecast();
  json state();
  std::optional<Response> picture(const json& body);
  Response point(const json& body);
  std::optional<Response> preset(std::string_view number);
  Response presets(const json& body);
  std::optional<Response> act(const Request& request, std::string_view rest);

  const Recipe base;
  const StudioOptions options;
  std::set<std::string> files;  ///< that were named when the studio began
  json document, shown;         ///< the recipe, with states; and what is shown of it
  json views = json::object();  ///< what --views takes: saved views, notes, what a page says
  std::string recipe_path, views_path, draft_path;
  std::set<std::string> owned;  ///< of these, those that this studio, or one before it, wrote
  bool kept = true, restored = false;
  Clock::time_point kept_at{};
  std::uint64_t revision = 0;
  std::vector<TransferPreset> known;
  std::vector<std::string> fitted;  ///< JSON of presets for this volume
  json histogram;
  std::shared_ptr<const Volume> measured;  ///< that `histogram` and `fitted` are of

  std::string folder;           ///< of the field that was built
  std::uint64_t forecast_of{};  ///< the revision
  Caster caster;
  Task<BuildForecast> forecaster;
  Task<BuildReport> builder;
};

/// Writes the recipe with paths that are relative to it.
Result<void> Studio::State::save() {
  std::error_code ignored;
  std::vector<std::string> written{recipe_path};
  const auto says = [](const json& part) { return !part.empty(); };
  const bool has_views = std::ranges::any_of(views, says);
  if (has_views) written.push_back(views_path);
  for (const std::string& path : written)
    if (!owned.contains(path) && fs::exists(path, ignored))
      return fail(ErrorCode::usage, path,
                  ": exists, and was not saved by this studio; move it, or name another recipe by "
                  "--save, another output by -o");
  SLF_TRY(whole());
  const fs::path where = fs::absolute(recipe_path).parent_path();
  const auto from_there = [&](const fs::path& path) {
    return fs::proximate(fs::absolute(path), where);
  };
  json out = document;
  if (!base.volume) out["input"] = base.input;
  out = with_paths(out, from_there);
  if (out.contains("states"))
    for (json& state : out["states"]) state = with_paths(state, from_there);
  SLF_TRY(write_file(recipe_path, bytes_of(out.dump(2) + "\n")));
  owned.insert(written.begin(), written.end());
  if (has_views) SLF_TRY(write_file(views_path, bytes_of(views.dump(2) + "\n")));
  fs::remove(draft_path, ignored);
  kept = true;
  return {};
}

/// The recipe with its states, to build it.
Result<Recipe> Studio::State::whole() const {
  json stated = document;
  const json states = stated.value("states", json());
  stated.erase("states");
  Recipe recipe = SLF_TRY(parse(stated));
  if (states.is_array())
    for (const json& state : states) SLF_TRY(check_files(state));
  if (!states.is_null()) SLF_TRY(recipe::add_states(recipe, states, {}));
  recipe.raycast.lighting.linear = recipe.field.half;
  recipe.light_volume.threads = recipe.field.threads = options.threads;
  return recipe;
}

/// Works on what the recipe makes: its states, and how they are to be built.
template <class T, class Work>
void Studio::State::begin(Task<T>& task, const Work& work) {
  task.start([recipe = whole(), work](const ProgressCallback& progress) -> Result<T> {
    if (!recipe) return tl::unexpected(recipe.error());
    Recipe made = *recipe;
    made.light_volume.progress = progress;
    const auto scenes = SLF_TRY(make_scenes(made));
    const auto states = field_states(scenes);
    const auto field = SLF_TRY(field_options(made, states));
    return work(states, field, progress);
  });
}

void Studio::State::build(bool replace) {
  caster.pause(true);
  forecaster.stop();
  begin(builder, [this, replace](const auto& states, BuildOptions field, const auto& progress) {
    field.replace = replace;
    return build_field(states, options.output, field, progress);
  });
}

json Studio::State::progress() {
  if (!builder.started()) return nullptr;
  const Progress done = builder.progress();
  json out{{"done", done.done - done.skipped},
           {"total", done.total - done.skipped},
           {"seconds", builder.seconds()}};
  const auto outcome = builder.outcome();
  if (!outcome) return out;
  if (*outcome && folder.empty()) {
    auto added = options.show(options.output);
    if (added) folder = *added;
  }
  if (!*outcome)
    out["error"] = outcome->error().message;
  else
    out["field"] = folder;
  caster.pause(false);
  return out;
}

/// What a build would take, of the newest recipe; none: not yet. Without content: it was stopped,
/// for what matters more.
std::optional<Response> Studio::State::forecast() {
  const auto outcome = forecaster.outcome();
  const bool stopped = outcome && !*outcome && outcome->error().code == ErrorCode::cancelled;
  if (builder.runs() || (stopped && forecast_of != 0)) {
    forecast_of = 0;
    return text(204, "text/plain", "");
  }
  if (forecast_of == revision) {
    if (!outcome) return std::nullopt;
    return *outcome ? reply(report::json_of(**outcome)) : refusal(outcome->error().message);
  }
  forecaster.stop();
  forecast_of = 0;
  if (forecaster.runs()) return std::nullopt;
  forecast_of = revision;
  begin(forecaster, [](const auto& states, const BuildOptions& field, const auto& progress) {
    return forecast_build(states, field, progress);
  });
  return std::nullopt;
}

json Studio::State::state() {
  const auto volume = caster.volume();
  if (volume && measured != volume && !volume->labels) {
    measured = volume;
    histogram = histogram_of(*volume);
    fitted.clear();
    known.assign(built_in_transfers().begin(), built_in_transfers().end());
  }
  json all{{"name", fs::path(base.input).filename().string()},
           {"kind", recipe::kind_of(base)},
           {"revision", revision},
           {"recipe", document},
           {"shown", shown},
           {"views", views},
           {"restored", restored},
           {"notes", caster.notes()},
           {"output", options.output},
           {"save", recipe_path},
           {"saved", owned.contains(recipe_path) && kept && !fs::exists(draft_path)},
           {"build", progress()}};
  if (!volume) return all;
  all.update(place_of(*volume));
  if (volume->labels) {
    const auto made = parse(shown);
    all["labels"] = labels_of(*volume, made ? made->label_table : "");
    return all;
  }
  all["histogram"] = histogram;
  if (fitted.empty())
    for (const TransferPreset& preset : known) fitted.push_back(stated(preset.fit(*volume)).dump());
  json presets = json::array();
  for (std::size_t k = 0; k < known.size(); ++k)
    presets.push_back({{"name", known[k].function.name},
                       {"description", known[k].description},
                       {"function", json::parse(fitted[k])}});
  all["presets"] = std::move(presets);
  auto recipe = parse(shown);
  const std::string transfer = recipe ? recipe->transfer : "";
  const auto preset =
      transfer.empty()
          ? Result<TransferPreset>(TransferPreset{.function = default_transfer(*volume)})
          : read_transfer(transfer);
  if (preset)
    all["function"] =
        stated(transfer.empty() ? preset->function : preset->fit(*volume, recipe->range));
  return all;
}

std::optional<Response> Studio::State::picture(const json& body) {
  const auto look = look_of(body);
  if (!look) return refusal("a camera was expected", 400);
  if (look->moving) forecaster.stop();
  const auto seen = static_cast<Stage>(std::clamp(body.value("seen", 0), 0, 4));
  const auto drawn = caster.picture(body.value("page", std::uint64_t{0}), *look, seen);
  if (!drawn) return std::nullopt;
  if (!drawn->error.empty()) return refusal(drawn->error);
  if (drawn->bytes.empty()) return text(204, "text/plain", "");
  Response response = text(200, drawn->png ? "image/png" : "image/jpeg", drawn->bytes);
  const Sphere& sphere = drawn->sphere;
  response.set("Slf-Stage", std::to_string(static_cast<int>(drawn->stage)));
  response.set("Slf-Last", drawn->last ? "1" : "0");
  response.set("Slf-Revision", std::to_string(drawn->revision));
  response.set("Slf-Sphere",
               json{sphere.center.x, sphere.center.y, sphere.center.z, sphere.radius}.dump());
  return response;
}

Response Studio::State::point(const json& body) {
  const auto look = look_of(body);
  const auto at = numbers<2>(body, "at");
  if (!look || !at) return refusal("a camera and a pixel were expected", 400);
  const auto world = caster.meet(*look, (*at)[0], (*at)[1]);
  if (!world) return reply(json::object());
  json out{{"position", {world->x, world->y, world->z}}};
  if (const auto volume = caster.volume()) out["value"] = value_at(*volume, *world);
  return reply(out);
}

std::optional<Response> Studio::State::preset(std::string_view number) {
  std::size_t k = 0;
  for (const char c : number)
    k = c >= '0' && c <= '9' && k < 1000 ? 10 * k + (c - '0') : fitted.size();
  if (number.empty() || k >= fitted.size()) return refusal("no such preset", 404);
  const auto drawn = caster.thumbnail(fitted[k]);
  if (!drawn) return std::nullopt;
  if (drawn->bytes.empty()) return refusal(drawn->error, 404);
  return text(200, "image/jpeg", drawn->bytes);
}

Response Studio::State::presets(const json& body) {
  if (!measured) return refusal("the volume has no values to colour");
  auto read = parse_transfers(body.value("text", ""), body.value("name", "the file"));
  if (!read) return refusal(read.error().message);
  for (TransferPreset& preset : *read) {
    fitted.push_back(stated(preset.fit(*measured)).dump());
    known.push_back(std::move(preset));
  }
  return reply({{"first", known.size() - read->size()}});
}

std::optional<Response> Studio::State::act(const Request& request, std::string_view rest) {
  const json body = request.body.empty()
                        ? json::object()
                        : json::parse(request.body, limit_nesting, /*allow_exceptions=*/false);
  if (!body.is_object()) return refusal("JSON was expected", 400);
  if (rest == "look") return picture(body);
  if (rest == "point") return point(body);
  if (rest == "presets") return presets(body);
  if (rest == "forecast") return forecast();
  if (rest == "stop") {
    builder.stop();
    return reply(json::object());
  }
  if (rest == "recipe") {
    if (body.value("revision", std::uint64_t{0}) != revision)
      return refusal("the recipe was changed on another page", 409);
    const json said = body.value("views", views);
    if (const auto read = parse_views({views_path, said.dump()}, {}); !read && !said.empty())
      return refusal(read.error().message);
    if (const auto done_so = show(body.value("shown", json())); !done_so)
      return refusal(done_so.error().message);
    document = body.value("recipe", shown);
    views = said;
    kept = false;
    if (Clock::now() - kept_at > kDraftEvery)
      if (const auto written = keep(); !written) return refusal(written.error().message);
    return reply({{"revision", revision}});
  }
  if (rest == "save" || rest == "build") {
    if (rest == "build" && builder.runs()) return refusal("the build is running already", 409);
    if (const auto saved = save(); !saved) return refusal(saved.error().message);
    if (rest == "build") build(body.value("replace", false));
    return reply({{"save", recipe_path},
                  {"command", concat("slf build ", recipe_path, " -o ", options.output)}});
  }
  return refusal("not here", 404);
}

Studio::Studio(std::unique_ptr<State> state) : state_(std::move(state)) {}
Studio::~Studio() = default;

Result<std::unique_ptr<Studio>> Studio::make(Recipe recipe, StudioOptions options) {
  auto state = std::make_unique<State>(std::move(recipe), std::move(options));
  State& s = *state;
  SLF_TRY(s.caster.read(s.base));
  const fs::path output = s.options.output;
  const fs::path stem = output.parent_path() / output.stem();
  s.recipe_path = s.options.save.empty() ? stem.string() + ".recipe.json" : s.options.save;
  s.views_path = stem.string() + ".views.json";
  s.draft_path = s.recipe_path + ".draft";
  std::error_code ignored;
  if (!s.options.opened.empty() && fs::equivalent(s.options.opened, s.recipe_path, ignored)) {
    s.owned.insert(s.recipe_path);
    if (fs::exists(s.views_path, ignored)) {
      const auto file = SLF_TRY(read_views(s.views_path));
      SLF_TRY(parse_views(file, {}));
      s.views = json::parse(file.text);
      s.owned.insert(s.views_path);
    }
  }
  json first = json::object();
  for (const recipe::Option& option : recipe::options())
    if (s.base.stated.contains(option.name) && option.name != std::string_view("input"))
      first[option.name] = option.get(s.base);
  s.document = s.shown = first;
  for (const RecipeState& given : s.base.states) {
    json one = with_paths(json::parse(given.options), [&](const fs::path& path) {
      return fs::path(given.file).parent_path() / path;
    });
    one["name"] = given.name;
    if (!given.light_from.empty()) one["light_from"] = given.light_from;
    s.document["states"].push_back(std::move(one));
  }
  const auto add_files = [&](const json& stated) {
    for (const auto& [name, value] : stated.items())
      if (names_file(name, value)) s.files.insert(value.get<std::string>());
  };
  add_files(first);
  for (const json& one : s.document.value("states", json::array())) add_files(one);
  if (fs::is_regular_file(s.draft_path, ignored)) {
    const auto bytes = SLF_TRY(read_file(s.draft_path, 16 << 20));
    const json draft = json::parse(chars_of(bytes), nullptr, /*allow_exceptions=*/false);
    if (!draft.is_object() || !draft.contains("shown"))
      return fail(ErrorCode::usage, s.draft_path,
                  ": is no draft of a studio, which would be kept there; move it");
    if (s.show(draft["shown"])) {
      s.document = draft.value("recipe", s.shown);
      s.views = draft.value("views", s.views);
      s.owned.merge(draft.value("owns", std::set<std::string>()));
      s.restored = true;
    }
  }
  if (s.revision == 0) SLF_TRY(s.show(first));
  return std::unique_ptr<Studio>(new Studio(std::move(state)));
}

std::optional<Response> Studio::answer(const Request& request, std::string_view rest) {
  auto made = guarded([&]() -> Result<std::optional<Response>> {
    if (!state_->kept && Clock::now() - state_->kept_at > kDraftEvery) SLF_TRY(state_->keep());
    if (request.method == "POST") return state_->act(request, rest);
    if (request.method != "GET" && request.method != "HEAD")
      return refusal("only GET, HEAD and POST work here", 405);
    if (rest == "state") return reply(state_->state());
    if (rest.starts_with("preset/")) return state_->preset(rest.substr(7));
    for (const PageFile& file : studio_files())
      if (rest == file.name || (rest.empty() && file.name == "studio.html"))
        return text(200, file.type, std::string(file.bytes));
    return refusal("not here", 404);
  });
  if (!made) return refusal(made.error().message, 500);
  return std::move(*made);
}

}  // namespace slf::page

#include "page/studio/studio.h"

#include <chrono>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "base/ascii.h"
#include "base/bytes.h"
#include "base/guarded.h"
#include "base/join.h"
#include "base/nesting.h"
#include "base/report.h"
#include "base/try.h"
#include "page/page.h"
#include "page/studio/caster.h"
#include "page/studio/draft.h"
#include "page/studio/subject.h"
#include "page/studio/task.h"
#include "page/views.h"
#include "slf/build.h"
#include "slf/image.h"
#include "slf/transfer.h"
#include "source/recipe/options.h"

namespace slf::page {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using Clock = std::chrono::steady_clock;

constexpr std::uint32_t kMaxSide = 4096;  // of pictures
constexpr std::chrono::seconds kDraftEvery(1);

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

/// A text as one word of a command line.
std::string word(const std::string& text) {
  const auto is_plain = [](char c) {
    return std::isalnum(static_cast<unsigned char>(c)) != 0 || std::strchr("./_-", c) != nullptr;
  };
  if (std::ranges::all_of(text, is_plain)) return text;
  std::string quoted = "'";
  for (const char c : text) quoted += c == '\'' ? "'\\''" : std::string(1, c);
  return quoted + "'";
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
  State(Draft begun, StudioOptions given)
      : draft(std::move(begun)), options(std::move(given)), caster(options.threads) {}
  ~State() {
    if (!draft.kept) (void)guarded([&] { return draft.keep(); });
    (void)guarded([&] { draft.tidy(); });
  }

  /// Keeps the draft, at most once in a while.
  Result<void> keep() {
    if (draft.kept || Clock::now() - kept_at < kDraftEvery) return {};
    kept_at = Clock::now();
    return draft.keep();
  }

  template <class T, class Work>
  void begin(Task<T>& task, const Work& work);
  void build(bool replace);
  json progress();
  [[nodiscard]] std::string publish() const;
  std::optional<Response> forecast();
  json state();
  std::optional<Response> picture(const json& body);
  Response point(const json& body);
  Response change(const json& body);
  std::optional<Response> preset(std::string_view number);
  Response presets(const json& body);
  Response take(const Request& request);
  Response surroundings();
  std::optional<Response> act(const Request& request, std::string_view rest);

  Draft draft;
  const StudioOptions options;
  Clock::time_point kept_at{};
  std::uint64_t revision = 0;
  json author;  ///< the page that made this revision
  std::vector<TransferPreset> known{TransferPreset()};
  std::vector<std::string> fitted;  ///< JSON of presets for this volume
  json histogram;
  std::shared_ptr<const Volume> measured;  ///< that `histogram` and `fitted` are of
  std::string pictured, small_picture;     ///< surroundings, and a picture of them

  std::string folder;           ///< of the field that was built
  std::uint64_t forecast_of{};  ///< the revision
  Caster caster;
  Task<BuildForecast> forecaster;
  Task<BuildReport> builder;
};

/// Works on what the recipe makes: its states, and how they are to be built.
template <class T, class Work>
void Studio::State::begin(Task<T>& task, const Work& work) {
  task.start([&task, recipe = draft.whole(), read = caster.readings(), threads = options.threads,
              work](const ProgressCallback& progress) -> Result<T> {
    if (!recipe) return tl::unexpected(recipe.error());
    Recipe made = *recipe;
    made.read = read;
    made.raycast.lighting.linear = made.field.half;
    made.light_volume.threads = made.field.threads = threads;
    const auto of = [&](const char* phase) {
      return [&, phase](const Progress& done) {
        task.enter(phase);
        return progress(done);
      };
    };
    made.light_volume.progress = of("Computing light");
    const auto scenes = SLF_TRY(make_scenes(made));
    const auto states = field_states(scenes);
    const auto field = SLF_TRY(field_options(made, states));
    return work(states, field, of("Tracing rays"));
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

/// The command that makes a page of the field.
std::string Studio::State::publish() const {
  const std::filesystem::path output = options.output;
  std::error_code ignored;
  const bool has_views = std::filesystem::exists(draft.views_path, ignored);
  return concat("slf export ", word(output.string()), " -o ",
                word((output.parent_path() / output.stem()).string() + "-page"),
                has_views ? " --views " + word(draft.views_path) : "");
}

json Studio::State::progress() {
  if (!builder.started()) return nullptr;
  const Progress done = builder.progress();
  json out{{"done", done.done - done.skipped},
           {"total", done.total - done.skipped},
           {"phase", builder.phase()},
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
    out.update({{"field", folder}, {"publish", publish()}});
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
    if (known.size() == 1)
      known.insert(known.end(), built_in_transfers().begin(), built_in_transfers().end());
    known[0] = {.function = default_transfer(*volume), .description = "What a volume begins with"};
    known[0].function.name = "automatic";
  }
  auto notes = caster.notes();
  if (draft.is_of_another(draft.recipe_path))
    notes.push_back(concat(draft.recipe_path, " is there from another time: slf view ",
                           word(draft.recipe_path), " goes on with it."));
  json all{{"name", fs::path(draft.base.input).filename().string()},
           {"kind", recipe::kind_of(draft.base)},
           {"revision", revision},
           {"recipe", draft.document},
           {"shown", draft.shown},
           {"views", draft.views},
           {"restored", draft.restored},
           {"notes", notes},
           {"output", options.output},
           {"save", draft.recipe_path},
           {"saved", draft.saved()},
           {"build", progress()}};
  if (!volume) return all;
  all.update(place_of(*volume));
  if (volume->labels) {
    const auto made = draft.parse(draft.shown);
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
  auto recipe = draft.parse(draft.shown);
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
  if (!builder.runs()) caster.pause(false);
  const bool same = body.value("revision", std::uint64_t{0}) == revision;
  const auto seen = static_cast<Stage>(same ? std::clamp(body.value("seen", 0), 0, 5) : 0);
  const auto drawn = caster.picture(body.value("page", std::uint64_t{0}), *look, seen);
  if (!drawn) return std::nullopt;
  if (drawn->bytes.empty() && drawn->error.empty()) return text(204, "text/plain", "");
  Response response = drawn->error.empty()
                          ? text(200, drawn->png ? "image/png" : "image/jpeg", drawn->bytes)
                          : refusal(drawn->error);
  const Sphere& sphere = drawn->sphere;
  response.set("Slf-Stage", std::to_string(static_cast<int>(drawn->stage)));
  response.set("Slf-Last", drawn->last ? "1" : "0");
  response.set("Slf-Revision", std::to_string(drawn->revision));
  response.set("Slf-Prepared", std::to_string(1000 * drawn->prepared));
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

/// Another recipe, from a page that knows the newest one: of those that know an older one, from
/// the page that made the newest, because its answer may have been lost.
Response Studio::State::change(const json& body) {
  const json page = body.value("page", json());
  if (body.value("revision", std::uint64_t{0}) != revision && (page.is_null() || page != author))
    return refusal("the recipe was changed on another page", 409);
  const json views = body.value("views", draft.views), shown = body.value("shown", json());
  if (const auto read = parse_views({draft.views_path, views.dump()}, {}); !read && !views.empty())
    return refusal(read.error().message);
  auto made = draft.parse(shown);
  if (!made) return refusal(made.error().message);
  revision = caster.show(std::move(*made));
  author = page;
  draft.shown = shown;
  draft.document = body.value("recipe", shown);
  draft.views = views;
  draft.kept = false;
  if (const auto written = keep(); !written) return refusal(written.error().message);
  return reply({{"revision", revision}});
}

/// A piece of a picture of surroundings.
Response Studio::State::take(const Request& request) {
  const auto number = [&](std::string_view header) {
    return parse_number<std::uint64_t>(request.header(header)).value_or(0);
  };
  const auto taken = draft.take(number("slf-first"), number("slf-size"), bytes_of(request.body));
  if (!taken) return refusal(taken.error().message);
  return reply({{"environment", *taken}});
}

/// A small picture of the surroundings that are shown.
Response Studio::State::surroundings() {
  const auto recipe = draft.parse(draft.shown);
  if (!recipe || recipe->environment.empty()) return refusal("no surroundings", 404);
  if (pictured != recipe->environment) {
    const auto picture = read_image(recipe->environment);
    if (!picture) return refusal(picture.error().message);
    const auto bytes = encode_image("environment.jpg", small_picture_of(*picture));
    if (!bytes) return refusal(bytes.error().message);
    small_picture = chars_of(*bytes);
    pictured = recipe->environment;
  }
  return text(200, "image/jpeg", small_picture);
}

std::optional<Response> Studio::State::act(const Request& request, std::string_view rest) {
  if (rest == "environment") return take(request);
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
  if (rest == "recipe") return change(body);
  if (rest == "save" || rest == "build") {
    if (rest == "build" && builder.runs()) return refusal("the build is running already", 409);
    if (const auto saved = draft.save(); !saved) return refusal(saved.error().message);
    if (rest == "build") build(body.value("replace", false));
    return reply(
        {{"save", draft.recipe_path},
         {"command", concat("slf build ", word(draft.recipe_path), " -o ", word(options.output))}});
  }
  return refusal("not here", 404);
}

Studio::Studio(std::unique_ptr<State> state) : state_(std::move(state)) {}
Studio::~Studio() = default;

Result<std::unique_ptr<Studio>> Studio::make(const Recipe& recipe, StudioOptions options) {
  auto draft = SLF_TRY(Draft::open(recipe, options));
  auto state = std::make_unique<State>(std::move(draft), std::move(options));
  SLF_TRY(state->caster.read(recipe));
  state->revision = state->caster.show(SLF_TRY(state->draft.parse(state->draft.shown)));
  return std::unique_ptr<Studio>(new Studio(std::move(state)));
}

std::optional<Response> Studio::answer(const Request& request, std::string_view rest) {
  auto made = guarded([&]() -> Result<std::optional<Response>> {
    SLF_TRY(state_->keep());
    if (request.method == "POST") return state_->act(request, rest);
    if (request.method != "GET" && request.method != "HEAD")
      return refusal("only GET, HEAD and POST work here", 405);
    if (rest == "state") return reply(state_->state());
    if (rest == "environment") return state_->surroundings();
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

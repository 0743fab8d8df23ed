#include "field/measure.h"

#include <fmt/format.h>

#include <cmath>

#include "cli/command.h"

namespace slf::cli {
namespace {

/// The random views that measure and evaluate share.
struct ViewsArguments {
  std::uint32_t views = 8;
  std::uint64_t seed = 1;
  double distance = 3;
  std::string size;

  void add_to(CLI::App& command, const char* default_size) {
    size = default_size;
    command.add_option("--views", views, "How many random views")->capture_default_str();
    command.add_option("--seed", seed, "Which random views")->capture_default_str();
    command.add_option("--distance", distance, "Eye's distance from the centre, in sphere radii")
        ->capture_default_str();
    command.add_option("--size", size, "Picture size in pixels, WIDTHxHEIGHT")
        ->capture_default_str();
  }
  [[nodiscard]] Result<std::vector<Camera>> cameras(const Sphere& sphere) const {
    const auto pixels = parse_size(size);
    if (!pixels) return tl::unexpected(pixels.error());
    if (!(distance > 1))
      return fail(ErrorCode::usage, "--distance ", distance, ": expected above 1 sphere radius");
    if (views == 0 || views > 100000)
      return fail(ErrorCode::usage, "--views ", views, ": expected 1 to 100000");
    return random_cameras(sphere, distance, views, seed, pixels->first, pixels->second);
  }
};

nlohmann::json spread_json(const Spread& s) { return {{"mean", s.mean}, {"max", s.max}}; }

nlohmann::json level_json(const LevelMeasure& m) {
  return {{"tiles", m.tiles},
          {"tiles_touched", spread_json(m.tiles_touched)},
          {"pairs_crossed", spread_json(m.pairs_crossed)},
          {"compressed_bytes", spread_json(m.compressed_bytes)},
          {"map_pages", spread_json(m.map_pages)},
          {"decoded_peak_bytes", spread_json(m.decoded_peak_bytes)},
          {"fraction", spread_json(m.fraction)},
          {"pair_fraction", spread_json(m.pair_fraction)}};
}

struct MeasureArguments {
  std::string field;
  ViewsArguments views;
  DrawArguments draw;
  bool json = false;
};

Result<void> run_measure(const MeasureArguments& a) {
  const auto renderer = a.draw.renderer();
  if (!renderer) return tl::unexpected(renderer.error());
  const auto field = Field::open(a.field);
  if (!field) return tl::unexpected(field.error());
  const auto cameras = a.views.cameras((*field)->shape().sphere);
  if (!cameras) return tl::unexpected(cameras.error());
  DrawArguments draw = a.draw;
  const bool all = draw.level == "all";
  if (all) draw.level = "finest";
  const auto view = draw.view(**field);
  if (!view) return tl::unexpected(view.error());

  MeasureOptions options{*cameras, view->mode, {}, *renderer};
  if (!all) options.levels = {view->level};
  const auto m = measure_views(**field, options);
  if (!m) return tl::unexpected(m.error());
  if (a.json) {
    nlohmann::json levels = nlohmann::json::array();
    for (const LevelMeasure& level : m->levels) {
      levels.push_back(level_json(level));
      levels.back()["level"] = level.level;
    }
    print_json({{"views", a.views.views},
                {"mode", name(view->mode)},
                {"size", a.views.size},
                {"distance", a.views.distance},
                {"levels", levels},
                {"total", level_json(m->total)},
                {"rss_anon_peak", m->rss_anon_peak},
                {"rss_file_peak", m->rss_file_peak}});
    return {};
  }
  fmt::print("Memory per view: {} random views, {} pixels, eye at {} R, mode {}; mean (max)\n",
             a.views.views, a.views.size, a.views.distance, name(view->mode));
  std::vector<std::vector<std::string>> rows{{"level", "pairs crossed", "tiles touched", "of field",
                                              "compressed", "map pages", "decoded peak"}};
  const auto add = [&](const std::string& title, const LevelMeasure& l) {
    const auto bytes = [](const Spread& s) {
      return fmt::format("{} ({})", human_bytes(s.mean), human_bytes(s.max));
    };
    rows.push_back(
        {title, fmt::format("{:.2f} %", 100 * l.pair_fraction.mean),
         fmt::format("{:.1f} ({:.0f}) of {}", l.tiles_touched.mean, l.tiles_touched.max, l.tiles),
         fmt::format("{:.2f} %", 100 * l.fraction.mean), bytes(l.compressed_bytes),
         fmt::format("{:.0f} ({:.0f})", l.map_pages.mean, l.map_pages.max),
         bytes(l.decoded_peak_bytes)});
  };
  for (const LevelMeasure& level : m->levels) add(fmt::format("{}", level.level), level);
  if (all) add("total", m->total);
  print_table(rows);
  fmt::print("process peak: {} anonymous, {} mapped files\n",
             human_bytes(static_cast<double>(m->rss_anon_peak)),
             human_bytes(static_cast<double>(m->rss_file_peak)));
  return {};
}

struct EvaluateArguments {
  std::string field;
  SourceArguments source;
  ViewsArguments views;
  DrawArguments draw;
  bool json = false;
};

/// Says so when the field was built from something else than it is compared with.
void warn_of_other_source(const Field& field, const Scene& scene) {
  nlohmann::json built = field.manifest().provenance, now = scene.provenance();
  for (auto* json : {&built, &now})
    if (json->is_object()) json->erase("source");
  const auto differences = nlohmann::json::diff(built, now);
  if (!differences.empty())
    note(fmt::format("note: {} was built from another source ({}); the figures include that",
                     field.path(), text_of(differences[0], "path", "/")));
}

Result<void> run_evaluate(const EvaluateArguments& a) {
  const auto renderer = a.draw.renderer();
  if (!renderer) return tl::unexpected(renderer.error());
  const auto field = Field::open(a.field);
  if (!field) return tl::unexpected(field.error());
  const auto view = a.draw.view(**field);
  if (!view) return tl::unexpected(view.error());
  const auto cameras = a.views.cameras((*field)->shape().sphere);
  if (!cameras) return tl::unexpected(cameras.error());
  const auto scene = a.source.scene(&(*field)->manifest().provenance);
  if (!scene) return tl::unexpected(scene.error());
  warn_of_other_source(**field, **scene);
  const auto evaluation = evaluate_views(**field, **scene, *cameras, *view, *renderer);
  if (!evaluation) return tl::unexpected(evaluation.error());

  const std::uint64_t bytes = (*field)->store().file_bytes();
  const auto finite = [](double v) {
    return std::isfinite(v) ? nlohmann::json(v) : nlohmann::json();
  };
  if (a.json) {
    nlohmann::json per_view = nlohmann::json::array();
    for (const ViewQuality& v : evaluation->views)
      per_view.push_back({{"psnr", finite(v.psnr)}, {"ssim", v.ssim}});
    print_json({{"views", a.views.views},
                {"mode", name(view->mode)},
                {"level", view->level},
                {"size", a.views.size},
                {"seed", a.views.seed},
                {"psnr", finite(evaluation->psnr)},
                {"ssim", evaluation->ssim},
                {"per_view", per_view},
                {"file_bytes", bytes}});
  } else {
    fmt::print("{}: mode {}, level {}: PSNR {:.2f} dB, SSIM {:.4f} (mean of {} views), {}\n",
               a.field, name(view->mode), view->level, evaluation->psnr, evaluation->ssim,
               a.views.views, human_bytes(static_cast<double>(bytes)));
  }
  return {};
}

}  // namespace

void add_measure(CLI::App& app, Run& run) {
  auto* command = app.add_subcommand("measure", "Memory per view: tiles, bytes, pages, peaks");
  auto a = std::make_shared<MeasureArguments>();
  command->add_option("FIELD", a->field, "Field, .slf")->required();
  a->draw.level = "all";
  a->views.add_to(*command, "512x512");
  a->draw.add_to(*command);
  command->add_flag("--json", a->json, "JSON on stdout");
  command->callback([a, &run] { run = [a] { return run_measure(*a); }; });
}

void add_evaluate(CLI::App& app, Run& run) {
  auto* command = app.add_subcommand(
      "evaluate", "Quality: PSNR and SSIM of random views against the ray-cast truth");
  auto a = std::make_shared<EvaluateArguments>();
  command->add_option("FIELD", a->field, "Field, .slf")->required();
  a->source.add_volume_to(*command, "--volume");
  a->views.add_to(*command, "256x256");
  a->draw.add_to(*command);
  command->add_flag("--json", a->json, "JSON on stdout");
  command->callback([a, &run] { run = [a] { return run_evaluate(*a); }; });
}

}  // namespace slf::cli

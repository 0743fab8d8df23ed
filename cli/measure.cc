#include "slf/measure.h"

#include <fmt/format.h>

#include <cmath>
#include <fstream>

#include "cli/command.h"
#include "cli/drawing.h"

namespace slf::cli {
namespace {

/// The random views that measure and evaluate share.
struct ViewsArguments {
  std::uint32_t views = 8;
  std::uint64_t seed = 1;

  void add_to(CLI::App& command) {
    command.add_option("--views", views, "How many random views")->capture_default_str();
    command.add_option("--seed", seed, "Which random views")->capture_default_str();
  }
  [[nodiscard]] Result<std::vector<Camera>> cameras(const Sphere& sphere, double distance,
                                                    const std::string& size) const {
    const auto pixels = parse_size(size);
    if (!pixels) return tl::unexpected(pixels.error());
    if (!(distance > 1))
      return fail(ErrorCode::usage, "--distance ", distance, ": expected above 1 sphere radius");
    if (views == 0 || views > 100000)
      return fail(ErrorCode::usage, "--views ", views, ": expected 1 to 100000");
    return random_cameras(sphere, distance, views, seed, pixels->first, pixels->second);
  }
};

constexpr const char* kDistanceHelp = "Eye's distance from the centre, in sphere radii";
constexpr const char* kSizeHelp = "Picture size in pixels, WIDTHxHEIGHT";

nlohmann::json mean_and_max_json(const MeanAndMax& s) { return {{"mean", s.mean}, {"max", s.max}}; }

nlohmann::json level_json(const LevelMeasure& m) {
  return {{"tiles", m.tiles},
          {"tiles_touched", mean_and_max_json(m.tiles_touched)},
          {"pairs_crossed", mean_and_max_json(m.pairs_crossed)},
          {"compressed_bytes", mean_and_max_json(m.compressed_bytes)},
          {"map_pages", mean_and_max_json(m.map_pages)},
          {"cached_pages", mean_and_max_json(m.cached_pages)},
          {"mapped_pages", mean_and_max_json(m.mapped_pages)},
          {"decoded_peak_bytes", mean_and_max_json(m.decoded_peak_bytes)},
          {"fraction", mean_and_max_json(m.fraction)},
          {"pair_fraction", mean_and_max_json(m.pair_fraction)}};
}

struct MeasureArguments {
  std::vector<std::string> fields;
  ViewsArguments views;
  std::vector<std::string> modes, sizes{"512x512"};
  std::vector<double> distances{3};
  DrawArguments draw;
  std::string picture, plot;
  bool force = false, json = false;
};

/// What one line of the table is about.
struct Setting {
  std::string field, codec, size;
  double distance = 0;
  RenderMode mode{};

  /// A setting's name, of what differs between settings.
  [[nodiscard]] std::string name(const MeasureArguments& a) const {
    std::string text = slf::name(mode);
    if (a.distances.size() > 1) text += fmt::format(" {} R", distance);
    if (a.sizes.size() > 1) text += " " + size;
    if (a.fields.size() > 1) text += " " + field;
    return text;
  }
};

std::string codecs_of(const Field& field) {
  std::string text;
  for (const Layer& layer : field.layers()) text += (text.empty() ? "" : "+") + layer.codec;
  return text;
}

nlohmann::json setting_json(const Setting& s, const Measurement& m, std::uint32_t views) {
  nlohmann::json levels = nlohmann::json::array();
  for (const LevelMeasure& level : m.levels) {
    levels.push_back(level_json(level));
    levels.back()["level"] = level.level;
  }
  return {{"field", s.field},
          {"codec", s.codec},
          {"views", views},
          {"mode", name(s.mode)},
          {"size", s.size},
          {"distance", s.distance},
          {"levels", levels},
          {"total", level_json(m.total)},
          {"kernel_counted", m.kernel_counted},
          {"rss_anon_peak", m.rss_anon_peak},
          {"rss_file_peak", m.rss_file_peak}};
}

void print_measurement(const Setting& s, const Measurement& m, std::uint32_t views) {
  fmt::print("{} ({}): {} random views, {} pixels, eye at {} R, mode {}; mean (max)\n", s.field,
             s.codec, views, s.size, s.distance, name(s.mode));
  std::vector<std::vector<std::string>> rows{{"level", "pairs crossed", "tiles touched", "of field",
                                              "compressed", "pages", "kernel", "mapped",
                                              "decoded peak"}};
  const auto add = [&](const std::string& title, const LevelMeasure& l) {
    const auto bytes = [](const MeanAndMax& spread) {
      return fmt::format("{} ({})", human_bytes(spread.mean), human_bytes(spread.max));
    };
    const auto pages = [&](const MeanAndMax& spread) {
      return m.kernel_counted ? fmt::format("{:.0f}", spread.mean) : "-";
    };
    rows.push_back(
        {title, fmt::format("{:.2f} %", 100 * l.pair_fraction.mean),
         fmt::format("{:.1f} ({:.0f}) of {}", l.tiles_touched.mean, l.tiles_touched.max, l.tiles),
         fmt::format("{:.2f} %", 100 * l.fraction.mean), bytes(l.compressed_bytes),
         fmt::format("{:.0f} ({:.0f})", l.map_pages.mean, l.map_pages.max), pages(l.cached_pages),
         pages(l.mapped_pages), bytes(l.decoded_peak_bytes)});
  };
  for (const LevelMeasure& level : m.levels) add(fmt::format("{}", level.level), level);
  if (m.levels.size() > 1) add("total", m.total);
  print_table(rows);
  fmt::print("process peak: {} anonymous, {} mapped files\n",
             human_bytes(static_cast<double>(m.rss_anon_peak)),
             human_bytes(static_cast<double>(m.rss_file_peak)));
}

Result<void> write_text(const std::string& path, bool force, const std::string& text) {
  if (auto ok = refuse_overwrite(path, force); !ok) return ok;
  std::ofstream file(path, std::ios::binary);
  if (file << text && file.flush()) return {};
  return fail(ErrorCode::io, path, ": cannot write");
}

/// The sections that the first view touches at the finest level that was measured.
Result<void> write_picture(const MeasureArguments& a, const Field& field, const Camera& camera,
                           const MeasureOptions& options, unsigned level) {
  Renderer renderer(field, options.renderer);
  ViewStatistics statistics;
  if (auto image = renderer.render(camera, {options.mode, level}, &statistics); !image)
    return tl::unexpected(image.error());
  return write_text(a.picture, a.force,
                    draw_sections(field.shape(), camera, level, statistics.tiles));
}

Result<void> run_measure(const MeasureArguments& a) {
  const auto renderer = a.draw.renderer();
  if (!renderer) return tl::unexpected(renderer.error());
  nlohmann::json runs = nlohmann::json::array();
  std::vector<Series> series;
  for (const std::string& path : a.fields) {
    const auto field = Field::open(path);
    if (!field) return tl::unexpected(field.error());
    const FieldShape& shape = field->shape();
    for (const std::string& mode : a.modes.empty() ? std::vector<std::string>{""} : a.modes)
      for (const double distance : a.distances)
        for (const std::string& size : a.sizes) {
          const auto cameras = a.views.cameras(shape.sphere, distance, size);
          if (!cameras) return tl::unexpected(cameras.error());
          DrawArguments draw = a.draw;
          draw.mode = mode;
          const bool all = draw.level == "all";
          if (all) draw.level = "finest";
          const auto view = draw.view(*field, cameras->front());
          if (!view) return tl::unexpected(view.error());
          MeasureOptions options{*cameras, view->mode, {}, *renderer};
          if (!all) options.levels = {view->level};
          const auto m = measure_views(*field, options);
          if (!m) return tl::unexpected(m.error());

          const Setting setting{path, codecs_of(*field), size, distance, view->mode};
          if (!a.json) print_measurement(setting, *m, a.views.views);
          runs.push_back(setting_json(setting, *m, a.views.views));
          Series touched{setting.name(a) + ", tiles touched", {}};
          Series crossed{setting.name(a) + ", pairs crossed", {}};
          for (const LevelMeasure& level : m->levels) {
            touched.points.emplace_back(level.level, level.fraction.mean);
            crossed.points.emplace_back(level.level, level.pair_fraction.mean);
          }
          series.push_back(std::move(touched));
          if (runs.size() == 1) series.push_back(std::move(crossed));
          if (a.picture.empty() || runs.size() > 1) continue;
          if (auto ok = write_picture(a, *field, cameras->front(), options, view->level); !ok)
            return ok;
        }
  }
  if (a.json) print_json({{"runs", runs}});
  if (a.plot.empty()) return {};
  return write_text(
      a.plot, a.force,
      draw_plot("Share of a level that a view touches", "level", "share of tiles", series));
}

struct EvaluateArguments {
  std::string field;
  SourceArguments source;
  ViewsArguments views;
  std::string size = "256x256";
  double distance = 3;
  std::uint32_t supersample = 1;
  DrawArguments draw;
  bool json = false;
};

/// Says so when the field was built from something else than it is compared with.
void warn_of_other_source(const Field& field, const Scene& scene) {
  nlohmann::json built = nlohmann::json::parse(field.provenance()),
                 now = nlohmann::json::parse(scene.provenance());
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
  const auto cameras = a.views.cameras(field->shape().sphere, a.distance, a.size);
  if (!cameras) return tl::unexpected(cameras.error());
  const auto view = a.draw.view(*field, cameras->front());
  if (!view) return tl::unexpected(view.error());
  const auto scene = a.source.scene(field->provenance());
  if (!scene) return tl::unexpected(scene.error());
  warn_of_other_source(*field, **scene);
  const auto evaluation =
      evaluate_views(*field, **scene, *cameras, *view, *renderer, a.supersample);
  if (!evaluation) return tl::unexpected(evaluation.error());

  const std::uint64_t bytes = field->file_bytes();
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
                {"size", a.size},
                {"seed", a.views.seed},
                {"supersample", a.supersample},
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
  auto* command = app.add_subcommand(
      "measure", "Memory per view: tiles, bytes, pages, the kernel's own count, peaks");
  auto a = std::make_shared<MeasureArguments>();
  command->add_option("FIELD", a->fields, "Fields; several are measured one by one")
      ->type_name(kFieldFile)
      ->required();
  a->draw.level = "all";
  a->views.add_to(*command);
  command->add_option("--distance", a->distances, std::string(kDistanceHelp) + "; or several")
      ->delimiter(',')
      ->capture_default_str();
  command->add_option("--size", a->sizes, std::string(kSizeHelp) + "; or several")
      ->delimiter(',')
      ->capture_default_str();
  a->draw.add_to(*command);
  command->get_option("--level")->description(
      "all; one of the tile pyramid, 0 the coarsest; finest; auto: what the pixels\n"
      "of these cameras can show");
  command->remove_option(command->get_option("--mode"));
  command->add_option("--mode", a->modes, "As for render; or several")
      ->check(CLI::IsMember(kRenderModes))
      ->delimiter(',')
      ->group("Drawing");
  command
      ->add_option("--picture", a->picture,
                   "Write an SVG: the sections of the sphere that the first view touches")
      ->type_name("FILE.svg");
  command->add_option("--plot", a->plot, "Write an SVG: share of the tiles touched, by level")
      ->type_name("FILE.svg");
  command->add_flag("-f,--force", a->force, "Overwrite drawings");
  command->add_flag("--json", a->json, "JSON on stdout");
  command->footer(
      "Levels are drawn one by one, from a file that the kernel was asked to forget. pages: the\n"
      "engine's count of 4 KiB pages of the file, with those of the search tree; kernel: pages "
      "that\n"
      "came into memory (mincore); mapped: pages this process mapped (smaps); - where the kernel\n"
      "does not forget, as for a file in memory or in use by others.");
  command->callback([a, &run] { run = [a] { return run_measure(*a); }; });
}

void add_evaluate(CLI::App& app, Run& run) {
  auto* command = app.add_subcommand(
      "evaluate", "Quality: PSNR and SSIM of random views against the ray-cast truth");
  auto a = std::make_shared<EvaluateArguments>();
  command->add_option("FIELD", a->field, "Field to evaluate")->type_name(kFieldFile)->required();
  a->source.add_volume_to(*command, "--volume");
  command->get_option("--transfer")
      ->description(
          "Transfer function, ParaView preset JSON; default: what the field was built with");
  a->views.add_to(*command);
  command->add_option("--distance", a->distance, kDistanceHelp)->capture_default_str();
  command->add_option("--size", a->size, kSizeHelp)->capture_default_str();
  command
      ->add_option(
          "--supersample", a->supersample,
          "Rays along a pixel's edge in the truth: above 1 it has no aliasing, which small "
          "and distant views are to be compared with")
      ->check(CLI::Range(1, 16))
      ->capture_default_str();
  a->draw.add_to(*command);
  command->add_flag("--json", a->json, "JSON on stdout");
  command->callback([a, &run] { run = [a] { return run_evaluate(*a); }; });
}

}  // namespace slf::cli

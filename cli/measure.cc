#include "slf/measure.h"

#include <filesystem>

#include "base/try.h"
#include "cli/command.h"

namespace slf::cli {
namespace {

/// The options of random views, which measure and evaluate share.
struct ViewsArguments {
  std::uint32_t views = 8;
  std::uint64_t seed = 1;

  void add_to(CLI::App& command) {
    add_number(command, "--views", views, "Number of random views", from_to(1, 100000));
    command.add_option("--seed", seed, "Random seed of the views");
  }
  [[nodiscard]] std::vector<Camera> cameras(const Sphere& sphere, double distance,
                                            const PixelSize& size) const {
    return random_cameras(sphere, distance, views, seed, size.width, size.height);
  }
};

constexpr const char* kPositive = R"("minimum": 1)";
constexpr unsigned kAllLevels = DrawArguments::kFinest - 1;
const CLI::Validator kDistance = above(1, 1e6);
constexpr const char* kDistanceHelp = "Eye's distance from the centre, in sphere radii";

struct MeasureArguments {
  std::vector<std::string> fields;
  std::string state;
  ViewsArguments views;
  std::vector<RenderMode> modes;  // empty: the field's default
  std::vector<PixelSize> sizes{{512, 512}};
  std::vector<double> distances{3};
  DrawArguments draw;
  bool json = false;
};

/// What views drawn in one way needed.
struct MeasuredRun {
  std::string field{}, codec{}, mode{};
  std::uint32_t views = 0, width_pixels = 0, height_pixels = 0;
  double distance_radii = 0;
  Measurement measured{};

  void describe(auto& member) const {
    member("field", field, "path");
    member("codec", codec, "of the field");
    member("views", views, "random views", kPositive);
    member("mode", mode, "of drawing");
    member("width_pixels", width_pixels, "of the pictures", kPositive);
    member("height_pixels", height_pixels, "of the pictures", kPositive);
    member("distance_radii", distance_radii, "of the eye from the centre", R"("minimum": 0)");
    measured.describe(member);
  }
};
struct Measured {
  std::vector<MeasuredRun> runs{};

  void describe(auto& member) const { member("runs", runs, "one for each setting"); }
};

void print_measurement(const Measurement& m) {
  std::vector<std::string> rows{
      "level\tpairs crossed\ttiles touched\tof field\tcompressed\tpages\tkernel\tmapped\t"
      "decoded peak"};
  const auto add = [&](const std::string& title, const LevelMeasure& l) {
    const auto bytes = [](const MeanAndMax& spread) {
      return fmt::format("{} ({})", human_bytes(spread.mean), human_bytes(spread.max));
    };
    const auto pages = [&](const MeanAndMax& spread) {
      return m.kernel_counted ? fmt::format("{:.0f}", spread.mean) : "-";
    };
    rows.push_back(fmt::format(
        "{}\t{:.2f} %\t{:.1f} ({:.0f}) of {}\t{:.2f} %\t{}\t{:.0f} ({:.0f})\t{}\t{}\t{}", title,
        100 * l.pair_fraction.mean, l.tiles_touched.mean, l.tiles_touched.max, l.tiles,
        100 * l.fraction.mean, bytes(l.compressed_bytes), l.map_pages.mean, l.map_pages.max,
        pages(l.cached_pages), pages(l.mapped_pages), bytes(l.decoded_peak_bytes)));
  };
  for (const LevelMeasure& level : m.levels) add(fmt::format("{}", *level.level), level);
  if (m.levels.size() > 1) add("total", m.total);
  print_table(rows);
  print("process peak: {} anonymous, {} mapped files\n", human_bytes(m.rss_anon_peak),
        human_bytes(m.rss_file_peak));
}

Result<void> run_measure(const MeasureArguments& a) {
  Measured measured;
  for (const std::string& path : a.fields) {
    const auto field = SLF_TRY(a.draw.open({path, a.state}));
    const std::vector<RenderMode> modes =
        a.modes.empty() ? std::vector{default_mode(field)} : a.modes;
    for (const RenderMode mode : modes)
      for (const double distance : a.distances)
        for (const PixelSize& size : a.sizes) {
          const auto cameras = a.views.cameras(field.shape().sphere, distance, size);
          DrawArguments draw = a.draw;
          draw.mode = mode;
          const bool all = draw.level == kAllLevels;
          if (all) draw.level = DrawArguments::kFinest;
          const auto view = SLF_TRY(draw.view(field, cameras.front()));
          MeasureOptions options{cameras, view.mode, {}, draw.renderer(view), view.clip, view.cap};
          if (!all) options.levels = {view.level};
          const auto m = SLF_TRY(
              measure_views(field, options, progress_bar("measure", "views", OnSignal::end)));

          measured.runs.push_back({path, field.codec(), name(view.mode), a.views.views, size.width,
                                   size.height, distance, m});
          if (a.json) continue;
          print("{} ({}): {} random views, {} pixels, eye at {} R, mode {}; mean (max)\n", path,
                field.codec(), a.views.views, to_string(size), distance, name(view.mode));
          print_measurement(m);
          std::fflush(stdout);  // a signal ends the next one
        }
  }
  if (a.json) print_json(measured);
  return {};
}

struct EvaluateArguments {
  FieldArguments field;
  SourceArguments source;
  ViewsArguments views;
  PixelSize size{256, 256};
  double distance = 3;
  std::uint32_t supersample = 1;
  std::string pictures;  // empty: compare with the volume, or with pictures that were held out
  DrawArguments draw;
  bool json = false;
};

/// Views of a field beside those of its scene.
struct EvaluatedViews {
  ViewOptions view{};
  std::uint32_t views = 0, width_pixels = 0, height_pixels = 0, supersample = 0;
  std::uint64_t seed = 0, file_bytes = 0;
  Evaluation evaluation{};

  void describe(auto& member) const {
    member("views", views, "random views", kPositive);
    member("mode", name(view.mode), "of drawing");
    member("level", view.level, "drawn");
    member("width_pixels", width_pixels, "of the pictures", kPositive);
    member("height_pixels", height_pixels, "of the pictures", kPositive);
    member("seed", seed, "of the views");
    member("supersample", supersample, "rays along a pixel's edge in the truth", kPositive);
    evaluation.describe(member);
    member("file_bytes", file_bytes, "of the field");
  }
};

/// Views of a field beside pictures.
struct EvaluatedPictures {
  ViewOptions view{};
  std::vector<PictureQuality> pictures{};
  PictureQuality mean{};
  std::uint64_t file_bytes = 0;

  void describe(auto& member) const {
    member("pictures", pictures.size(), "how many", kPositive);
    member("mode", name(view.mode), "of drawing");
    member("level", view.level, "drawn");
    mean.describe_means(member);
    member("per_view", pictures, "in the order of the pictures");
    member("file_bytes", file_bytes, "of the field");
  }
};

/// The pictures that the option names; of those that the field was built from, the ones held out.
Result<std::vector<Picture>> pictures_of(const EvaluateArguments& a, const Field& field) {
  const auto built = nlohmann::json::parse(field.provenance(), nullptr, false);
  const bool from_pictures = text_of(built, "kind", "") == "pictures";
  const auto told = from_pictures ? built.value("holdout", nlohmann::json()) : nlohmann::json();
  const unsigned holdout = told.is_number_unsigned() ? told.get<unsigned>() : 0;
  if (a.pictures.empty())
    return misuse(field.path(), "nothing to compare with: expected --volume or --pictures",
                  holdout > 0 ? "; a field keeps no path of its pictures: name them again" : "");
  auto set = SLF_TRY(read_pictures(a.pictures));
  const std::string source = std::filesystem::path(text_of(built, "source", "")).filename();
  if (holdout == 0 || std::filesystem::path(set.source).filename() != source)
    return std::move(set.pictures);
  note(fmt::format("of {}, compares with those that --holdout {} left out", set.source, holdout));
  std::vector<Picture> held_out;
  for (std::size_t k = 0; k < set.pictures.size(); ++k)
    if (is_held_out(k, holdout)) held_out.push_back(set.pictures[k]);
  return held_out;
}

Result<void> evaluate_with_pictures(const EvaluateArguments& a, const Field& field) {
  const auto pictures = SLF_TRY(pictures_of(a, field));
  const auto view = SLF_TRY(a.draw.view(field));
  const auto qualities =
      SLF_TRY(evaluate_pictures(field, pictures, view, a.draw.renderer(view),
                                progress_bar("evaluate", "pictures", OnSignal::end)));
  EvaluatedPictures all{view, qualities, {}, field.file_bytes()};
  auto& [unnamed, whole, inside] = all.mean;
  std::vector<std::string> rows{"picture\tPSNR\tSSIM\tPSNR inside\tSSIM inside"};
  const auto count = static_cast<double>(qualities.size());
  for (const PictureQuality& q : qualities) {
    whole.psnr += q.whole.psnr / count;
    whole.ssim += q.whole.ssim / count;
    inside.psnr += q.inside.psnr / count;
    inside.ssim += q.inside.ssim / count;
    rows.push_back(fmt::format("{}\t{:.2f}\t{:.4f}\t{:.2f}\t{:.4f}", q.name, q.whole.psnr,
                               q.whole.ssim, q.inside.psnr, q.inside.ssim));
  }
  if (a.json) {
    print_json(all);
    return {};
  }
  print_table(rows);
  print(
      "{}: mode {}, level {}: PSNR {:.2f} dB, SSIM {:.4f}; inside the sphere {:.2f} dB, {:.4f} "
      "(mean of {} pictures), {}\n",
      a.field.path, name(view.mode), view.level, whole.psnr, whole.ssim, inside.psnr, inside.ssim,
      qualities.size(), human_bytes(field.file_bytes()));
  return {};
}

Result<void> run_evaluate(const EvaluateArguments& a) {
  const auto field = SLF_TRY(a.draw.open(a.field));
  if (a.source.input.empty()) return evaluate_with_pictures(a, field);
  const auto cameras = a.views.cameras(field.shape().sphere, a.distance, a.size);
  const auto view = SLF_TRY(a.draw.view(field, cameras.front()));
  SourceArguments source = a.source;
  source.truth_of = field.provenance();
  source.raycast.clip = a.draw.cut.raycast.clip;
  SLF_TRY(source.finish(a.draw.threads, OnSignal::end));
  const auto scene = SLF_TRY(hinted(make_scene(source)));
  if (const auto light = field.light(); !light)
    note(light.error().message + "; computing the light again");
  const auto evaluation =
      SLF_TRY(evaluate_views(field, *scene, {cameras, view, a.draw.renderer(view), a.supersample},
                             progress_bar("evaluate", "rows", OnSignal::end)));
  if (!evaluation.differs.empty())
    message(
        fmt::format("slf: warning: {} was built from another source ({} differs): the figures "
                    "compare two different objects",
                    field.path(), evaluation.differs));

  if (a.json) {
    print_json(EvaluatedViews{view, a.views.views, a.size.width, a.size.height, a.supersample,
                              a.views.seed, field.file_bytes(), evaluation});
  } else {
    print("{}: mode {}, level {}: PSNR {:.2f} dB, SSIM {:.4f} (mean of {} views), {}\n",
          a.field.path, name(view.mode), view.level, evaluation.psnr, evaluation.ssim,
          a.views.views, human_bytes(field.file_bytes()));
  }
  return {};
}

}  // namespace

void add_measure(CLI::App& app, Run& run) {
  const auto [command, a] = add_command(
      app, run, "measure", "Memory per view: tiles, bytes, pages, the kernel's own count, peaks",
      run_measure);
  add_file(*command, "FIELD", a->fields, "Fields; several are measured one by one", kFieldFile)
      ->required();
  add_state(*command, "--state", a->state, "The state of the fields to show: its name or number");
  a->views.add_to(*command);
  add_number(*command, "--distance", a->distances, std::string(kDistanceHelp) + "; or several",
             kDistance)
      ->delimiter(',')
      ->default_str("3");
  of_pixels(command->add_option("--size", a->sizes,
                                "Picture size in pixels; one number for a square; or several"))
      ->delimiter(',')
      ->default_str("512x512");
  add_json<Measured>(*command, a->json);
  const OptionGroup group(*command, "Drawing");
  choose(command->add_option("--mode", a->modes, "As for render; or several"), kRenderModes)
      ->delimiter(',');
  a->draw.level = kAllLevels;
  command
      ->add_option("--level", a->draw.level,
                   "all; one of the tile pyramid, 0 the coarsest; finest; auto: what the pixels\n"
                   "of these cameras can show")
      ->transform(
          CLI::Transformer(std::map<std::string, unsigned>{{"all", kAllLevels},
                                                           {"finest", DrawArguments::kFinest},
                                                           {"auto", kMatchingLevel}})
              .description(""))
      ->type_name("LEVEL")
      ->default_str("all");
  a->draw.add_resources_to(*command);
  command->footer(
      "Levels are drawn one by one, each from a cold file. pages: the engine's count of 4 KiB\n"
      "pages of the file, including the search tree; kernel: pages read into memory (mincore);\n"
      "mapped: pages that this process mapped (smaps); - if the kernel keeps the file cached, as\n"
      "for a file in memory or in use by others.");
}

void add_evaluate(CLI::App& app, Run& run) {
  auto* command = app.add_subcommand(
      "evaluate",
      "Quality: PSNR and SSIM of views against the ray-cast truth, or against pictures");
  auto a = std::make_shared<EvaluateArguments>();
  a->field.add_to(*command, "Field to evaluate");
  a->source.add_input_to(*command, "--volume");
  command->get_option("--volume")->required(false);
  add_file(*command, "--pictures", a->pictures,
           "Compare with pictures instead of a volume: transforms.json or a folder, as for\n"
           "`slf build pictures:FOLDER`; of the field's own, with those that --holdout left out")
      ->excludes("--volume");
  a->source.add_to(*command, [](const recipe::Option& option) {
    using recipe::Use;
    return (option.use == Use::reading || option.use == Use::data || option.use == Use::cost ||
            option.use == Use::truth) &&
           option.name != std::string_view("clip");  // of DrawArguments
  });
  command->get_option("--transfer")
      ->description(
          "Transfer function, ParaView preset JSON; default: what the field was built with");
  command->get_option("--reference")
      ->description(
          "Compare with path tracing, which is unbiased, and slow: minutes; with 2 views\n"
          "of 192 pixels and 192 paths, unless others are named");
  a->views.add_to(*command);
  add_number(*command, "--distance", a->distance, kDistanceHelp, kDistance);
  add_size(*command, a->size);
  add_number(*command, "--supersample", a->supersample,
             "Rays along a pixel's edge in the ground truth; above 1 it is anti-aliased, as\n"
             "small and distant views need it",
             from_to(1, 16));
  a->draw.add_to(*command);
  add_json<EvaluatedViews, EvaluatedPictures>(*command, a->json);
  command->callback([a, command, &run] {
    const auto unless_named = [&](const char* option, auto& value, const auto& otherwise) {
      if (a->source.reference && command->count(option) == 0) value = otherwise;
    };
    unless_named("--views", a->views.views, 2);
    unless_named("--size", a->size, PixelSize{192, 192});
    unless_named("--samples", a->source.paths.samples, 192);
    run = [a] { return run_evaluate(*a); };
  });
}

}  // namespace slf::cli

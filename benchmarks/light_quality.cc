// How good a light volume is, and what it takes: beside path tracing, and beside itself.
//
//   light_quality VOLUME --transfer T [--crop X:X,Y:Y,Z:Z] [--rig NAME] [--size N] [--views N]
//                 [--reference N] [--node-spacing S,...] [--samples N,...] [--seeds N]
//                 [--difference OUT.png] [--field F.slf] [--keep PREFIX]
//
// Prints JSON. For each spacing and number of samples: seconds that the light volume takes; its
// noise, which is the standard deviation over the seeds (2) divided by the mean of radiance, over
// the pixels that show something; PSNR and SSIM of views (neutral tone mapping) of the first seed
// against the reference; and slabs per second with it and with direct light. With a field of the
// same volume and light: its PSNR, the time of a view from it, and how long path tracing takes to
// the same PSNR. All seconds are of the processor, on all threads: N cores take an Nth of them.
//
// The reference is noisy, too. It is rendered twice, as A and B, and the mean squared error of a
// picture P is estimated as that of (P - A)(P - B), in which the noise of A and B cancels.
// --keep writes these pictures to PREFIX-*.exr; the next run reads them instead of tracing paths.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <random>
#include <span>

#include "benchmarks/storage/expect.h"
#include "benchmarks/timing.h"
#include "cli/command.h"
#include "slf/camera.h"
#include "slf/path_tracer.h"
#include "slf/raycaster.h"
#include "slf/render.h"

namespace {

using namespace slf;
using bench::expect;

/// Of the processor, on all threads.
double seconds_of(const auto& work) {
  const double start = bench::seconds_of(CLOCK_PROCESS_CPUTIME_ID);
  work();
  return bench::seconds_of(CLOCK_PROCESS_CPUTIME_ID) - start;
}

/// RGB over black from 0 to 255, not rounded.
std::vector<double> shown(const Image& image, const ToneMapper& map = ToneMapper(ToneMapping{})) {
  std::vector<double> values;
  for (const glm::vec4& pixel : image.rgba) {
    const glm::vec4 color = map(pixel);
    for (int c = 0; c < 3; ++c) values.push_back(255.0 * std::clamp(color[c], 0.f, 1.f));
  }
  return values;
}

double squared_error(const Image& picture, const Image& a, const Image& b) {
  const auto p = shown(picture), x = shown(a), y = shown(b);
  double sum = 0;
  for (std::size_t k = 0; k < p.size(); ++k) sum += (p[k] - x[k]) * (p[k] - y[k]);
  return sum / static_cast<double>(p.size());
}

/// The part of one picture's mean squared error that is its noise; both have equally many paths.
double noise_error(const Image& a, const Image& b) {
  const auto x = shown(a), y = shown(b);
  double sum = 0;
  for (std::size_t k = 0; k < x.size(); ++k) sum += (x[k] - y[k]) * (x[k] - y[k]) / 2;
  return sum / static_cast<double>(x.size());
}

/// The picture's similarity to the mean of two, tone-mapped.
double similarity(const Image& picture, const Image& a, const Image& b) {
  const ToneMapper map{ToneMapping{}};
  Image shown = picture, mean = a;
  for (std::size_t k = 0; k < a.rgba.size(); ++k) {
    shown.rgba[k] = map(picture.rgba[k]);
    mean.rgba[k] = map(0.5f * (a.rgba[k] + b.rgba[k]));
  }
  return compare(shown, mean).ssim;
}

double psnr(double squared) { return 10 * std::log10(255.0 * 255.0 / std::max(squared, 1e-9)); }

struct Noise {
  double squares = 0, sum = 0;
  std::size_t count = 0;

  /// Adds a view, as several seeds show it.
  void add(std::span<const Image> seeds) {
    const auto n = static_cast<double>(seeds.size());
    for (std::size_t k = 0; k < seeds[0].rgba.size(); ++k) {
      if (seeds[0].rgba[k].a < 0.5f) continue;
      double mean = 0;
      for (const Image& image : seeds) mean += image.rgba[k].g / n;
      for (const Image& image : seeds)
        squares += (image.rgba[k].g - mean) * (image.rgba[k].g - mean) / (n - 1);
      sum += mean;
      ++count;
    }
  }
  [[nodiscard]] double relative() const {
    const auto n = static_cast<double>(count);
    return std::sqrt(squares / n) / (sum / n);
  }
};

/// Slabs per second on one thread: rays from points on the sphere to patches of it.
double slab_rate(const Raycaster& caster) {
  constexpr std::size_t kRow = 561;
  std::mt19937_64 random(1);
  std::normal_distribution<double> normal;
  const Sphere s = caster.bounds();
  const auto point = [&] {
    return glm::normalize(glm::dvec3(normal(random), normal(random), normal(random)));
  };
  std::vector<Segment> rays;
  for (int tile = 0; tile < 100; ++tile) {
    const glm::dvec3 entry = point(), exit = point();
    for (std::size_t k = 0; k < kRow; ++k)
      rays.push_back({s.center + s.radius * entry,
                      s.center + s.radius * glm::normalize(exit + 0.2 * point())});
  }
  std::vector<RaySample> samples(kRow);
  double best = 1e30;
  for (int turn = 0; turn < 5; ++turn)
    best = std::min(best, seconds_of([&] {
                      for (std::size_t begin = 0; begin < rays.size(); begin += kRow)
                        caster.trace_many(std::span(rays).subspan(begin, kRow), samples);
                    }));
  return static_cast<double>(rays.size()) / best;
}

/// What the command line says.
struct Arguments {
  cli::SourceArguments source;
  std::string rig = "studio", difference, field, keep;
  std::uint32_t size = 192, views = 2, reference = 256, seeds = 2;
  std::vector<double> spacings{1};
  std::vector<std::uint32_t> samples{LightOptions{}.samples};
  double step = RaycastOptions{}.step;
  std::uint32_t bounces = LightOptions{}.bounces;

  void add_to(CLI::App& app) {
    source.add_input_to(app, "VOLUME");
    source.add_to(app, [](const auto& option) {
      return option.use == recipe::Use::reading || option.name == std::string_view("transfer");
    });
    app.add_option("--rig", rig)->capture_default_str();
    app.add_option("--size", size)->capture_default_str();
    app.add_option("--views", views)->capture_default_str();
    app.add_option("--reference", reference, "Paths per pixel, 0: no reference")
        ->capture_default_str();
    app.add_option("--node-spacing", spacings)->delimiter(',');
    app.add_option("--samples", samples)->delimiter(',');
    app.add_option("--seeds", seeds, "Light volumes that noise is measured over")
        ->check(CLI::Range(2, 1000))
        ->capture_default_str();
    app.add_option("--step", step)->capture_default_str();
    app.add_option("--bounces", bounces)->capture_default_str();
    app.add_option("--difference", difference, "Picture of 8 times the error of the first view");
    app.add_option("--field", field);
    app.add_option("--keep", keep, "Where the reference's pictures are kept");
  }
};

/// What is drawn.
struct Subject {
  Volume volume;
  TransferFunction transfer;
  RaycastOptions options;  ///< with light from all directions
  Sphere sphere;
  std::vector<Camera> cameras;
};

/// The views by path tracing, twice, with different noise. Empty without a reference.
struct Reference {
  std::vector<Image> a, b;
  double seconds = 0;
};

/// Traces the reference's views, or reads those that an earlier run kept.
Reference make_reference(const Arguments& arguments, const Subject& subject) {
  Reference reference;
  for (std::uint64_t seed = 1; seed <= 2 && arguments.reference > 0; ++seed) {
    const auto tracer = expect(PathTracer::make(subject.volume, subject.transfer, subject.options,
                                                {arguments.reference / 2, seed}));
    for (std::size_t v = 0; v < subject.cameras.size(); ++v) {
      const std::string file =
          arguments.keep + "-" + std::to_string(v) + "-" + std::to_string(seed) + ".exr";
      const bool kept = !arguments.keep.empty() && std::filesystem::exists(file);
      Image image;
      reference.seconds += seconds_of([&] {
        image = expect(kept ? read_image(file)
                            : trace_view(*tracer, subject.sphere, subject.cameras[v]));
      });
      if (!arguments.keep.empty() && !kept) expect(write_image(file, image));
      (seed == 1 ? reference.a : reference.b).push_back(std::move(image));
    }
  }
  return reference;
}

/// Writes 8 times the difference of a picture from the mean of two.
void write_difference(const std::string& path, const Image& picture, const Image& a,
                      const Image& b) {
  Image difference = picture;
  const auto p = shown(picture), x = shown(a), y = shown(b);
  for (std::size_t k = 0; k < p.size(); ++k)
    difference.rgba[k / 3][static_cast<int>(k % 3)] =
        static_cast<float>(8 * std::abs(p[k] - (x[k] + y[k]) / 2) / 255);
  for (glm::vec4& pixel : difference.rgba) pixel.a = 1;
  expect(write_image(path, difference));
}

/// One light volume: what it takes, its noise, and its error against the reference.
nlohmann::json measure_light(const Arguments& arguments, const Subject& subject,
                             const Reference& reference, double spacing, std::uint32_t samples,
                             const Raycaster& direct) {
  RaycastOptions options = subject.options;
  options.lighting.spacing = spacing;
  options.lighting.samples = samples;
  std::vector<std::vector<Image>> views(subject.cameras.size());
  double seconds = 0, rate = 0;
  for (options.lighting.seed = 1; options.lighting.seed <= arguments.seeds;
       ++options.lighting.seed) {
    std::unique_ptr<Raycaster> caster;
    seconds += seconds_of(
        [&] { caster = expect(Raycaster::make(subject.volume, subject.transfer, options)); });
    for (std::size_t v = 0; v < views.size(); ++v)
      views[v].push_back(expect(trace_view(*caster, subject.sphere, subject.cameras[v])));
    if (options.lighting.seed == 1) rate = slab_rate(*caster);
  }
  Noise noise;
  double error = 0, ssim = 0;
  for (std::size_t v = 0; v < views.size(); ++v) {
    const Image& one = views[v].front();
    noise.add(views[v]);
    if (arguments.reference == 0) continue;
    error += squared_error(one, reference.a[v], reference.b[v]) /
             static_cast<double>(subject.cameras.size());
    ssim += similarity(one, reference.a[v], reference.b[v]) /
            static_cast<double>(subject.cameras.size());
    if (v == 0 && !arguments.difference.empty())
      write_difference(arguments.difference, one, reference.a[v], reference.b[v]);
  }
  nlohmann::json row{{"spacing", spacing},
                     {"samples", samples},
                     {"seconds", seconds / arguments.seeds},
                     {"noise", noise.relative()},
                     {"seeds", arguments.seeds},
                     {"slabs_per_second", rate},
                     {"slabs_per_second_direct", slab_rate(direct)}};
  if (arguments.reference > 0) row["psnr"] = psnr(error), row["ssim"] = ssim;
  return row;
}

/// Views of a field beside the reference: what it takes each to show the same error.
nlohmann::json compare_field(const std::string& path, const std::vector<Camera>& cameras,
                             const Reference& reference) {
  const auto field = expect(Field::open(path));
  const LightOptions lighting = raycast_options(field.provenance()).lighting;
  const ToneMapper map(lighting.linear ? ToneMapping{} : ToneMapping{0, ToneCurve::none});
  Renderer renderer(field, {});
  const ViewOptions options{default_mode(field), field.shape().finest_level};
  double error = 0, noise = 0, seconds = 0;
  const auto share = 1 / static_cast<double>(cameras.size());
  for (std::size_t v = 0; v < cameras.size(); ++v) {
    const Image image = expect(renderer.render(cameras[v], options));  // and the tiles are loaded
    seconds += share * seconds_of([&] { expect(renderer.render(cameras[v], options)); });
    const auto p = shown(image, map), x = shown(reference.a[v]), y = shown(reference.b[v]);
    for (std::size_t k = 0; k < p.size(); ++k)
      error += share * (p[k] - x[k]) * (p[k] - y[k]) / static_cast<double>(p.size());
    noise += share * noise_error(reference.a[v], reference.b[v]);
  }
  // Of one of the two pictures of a view.
  const double reference_seconds = reference.seconds * share / 2;
  const double path_seconds = reference_seconds * noise / error;
  return {{"psnr", psnr(error)},
          {"view_seconds", seconds},
          {"path_tracing_seconds", path_seconds},
          {"ratio", path_seconds / seconds}};
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"How good a light volume is, and what it takes"};
  Arguments arguments;
  arguments.add_to(app);
  CLI11_PARSE(app, argc, argv);

  Subject subject;
  expect(arguments.source.finish(0, cli::OnSignal::end));
  subject.volume = expect(read_volume(arguments.source));
  subject.transfer = expect(read_transfer(arguments.source.transfer)).fit(subject.volume);
  subject.options.step = arguments.step;
  const auto direct = expect(Raycaster::make(subject.volume, subject.transfer, subject.options));
  subject.options.lighting.mode = Lighting::global;
  subject.options.lighting.linear = true;
  subject.options.lighting.bounces = arguments.bounces;
  subject.options.lighting.rig = expect(read_rig(arguments.rig));
  subject.sphere = direct->bounds();
  subject.cameras =
      random_cameras(subject.sphere, 3, arguments.views, 1, arguments.size, arguments.size);

  const Reference reference = make_reference(arguments, subject);
  nlohmann::json rows = nlohmann::json::array();
  for (const double spacing : arguments.spacings)
    for (const std::uint32_t samples : arguments.samples) {
      rows.push_back(measure_light(arguments, subject, reference, spacing, samples, *direct));
      std::fprintf(stderr, "%s\n", rows.back().dump().c_str());
    }
  nlohmann::json from_field;
  if (!arguments.field.empty() && arguments.reference > 0)
    from_field = compare_field(arguments.field, subject.cameras, reference);
  std::printf("%s\n",
              nlohmann::json{{"volume", arguments.source.input},
                             {"transfer", arguments.source.transfer},
                             {"rig", arguments.rig},
                             {"views", arguments.views},
                             {"size", arguments.size},
                             {"reference_paths", arguments.reference},
                             {"reference_seconds_per_view", reference.seconds / arguments.views},
                             {"light", rows},
                             {"field", from_field}}
                  .dump(1)
                  .c_str());
}

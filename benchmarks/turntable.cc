// Draws a volume as it turns, by ray-casting and from its field, and compares the pictures.
//
//   turntable VOLUME --field F.slf [--frames N] [--turn DEGREES] [--size N] [--out PREFIX]
//
// Prints the PSNR and SSIM of every frame as JSON, in the field's default mode, and the PSNR of its
// change: its difference from the frame before, beside that of the truth. A picture that flickers
// changes otherwise than the truth. The camera circles at an elevation of 20 degrees, DEGREES from
// frame to frame (default: once around). With --out, writes PREFIX-truth-00.png,
// PREFIX-field-00.png and so on.
#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "benchmarks/storage/expect.h"
#include "cli/command.h"
#include "slf/scene.h"

namespace {

using namespace slf;
using bench::expect;

struct Frame {
  Image truth, drawn;
};

/// PSNR of what a frame differs from the one before, over black.
double change_psnr(const Frame& before, const Frame& now) {
  double sum = 0;
  for (std::size_t i = 0; i < now.truth.pixels(); ++i) {
    const glm::dvec3 error(now.drawn.rgba[i] - before.drawn.rgba[i] -
                           (now.truth.rgba[i] - before.truth.rgba[i]));
    sum += glm::dot(error, error);
  }
  return -10 * std::log10(sum / (3 * static_cast<double>(now.truth.pixels())));
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"A volume turned around, ray-cast and from its field"};
  cli::SourceArguments source;
  std::string field_path, out;
  std::uint32_t frames = 12, size = 256;
  double turn = 0;
  source.add_input_to(app, "VOLUME");
  source.add_to(app, [](const auto& option) { return option.use != recipe::Use::field; });
  app.add_option("--field", field_path)->required();
  app.add_option("--frames", frames)->capture_default_str()->check(CLI::Range(1, 1000));
  app.add_option("--turn", turn, "Degrees between frames; default: once around");
  app.add_option("--size", size)->capture_default_str();
  app.add_option("--out", out, "Prefix of the pictures");
  CLI11_PARSE(app, argc, argv);

  expect(source.finish(0, cli::OnSignal::end));
  const auto scene = expect(make_scene(source));
  const auto field = expect(Field::open(field_path));
  const Sphere& sphere = field.shape().sphere;
  const ViewOptions view{default_mode(field), field.shape().finest_level};
  if (turn == 0) turn = 360.0 / frames;
  Renderer renderer(field);
  nlohmann::json numbers = nlohmann::json::array();
  Frame before;
  for (std::uint32_t k = 0; k < frames; ++k) {
    const Camera camera = orbit_camera(sphere, turn * k, 20, 3, size, size);
    Frame now{expect(trace_view(*scene, sphere, camera)), expect(renderer.render(camera, view))};
    const ImageDifference difference = compare(now.truth, now.drawn);
    numbers.push_back({{"psnr", difference.psnr}, {"ssim", difference.ssim}});
    if (k > 0) numbers.back()["change_psnr"] = change_psnr(before, now);
    if (!out.empty()) {
      char name[32];
      std::snprintf(name, sizeof name, "-%02u.png", k);
      expect(write_image(out + "-truth" + name, now.truth));
      expect(write_image(out + "-field" + name, now.drawn));
    }
    before = std::move(now);
  }
  std::printf("%s\n", numbers.dump(2).c_str());
  return 0;
}

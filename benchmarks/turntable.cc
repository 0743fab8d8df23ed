// Draws a volume as it turns, by ray-casting and from its field, and compares the pictures.
//
//   turntable VOLUME --field F.slf --frames N --size N --out PREFIX [--transfer TF.json]
//
// Writes PREFIX-truth-00.png, PREFIX-field-00.png and so on, and prints the PSNR and SSIM of every
// frame as JSON, in the field's default mode. The camera circles at an elevation of 20 degrees.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "benchmarks/storage/expect.h"
#include "cli/command.h"
#include "slf/scene.h"

int main(int argc, char** argv) {
  using namespace slf;
  using bench::expect;
  CLI::App app{"A volume turned around, ray-cast and from its field"};
  cli::SourceArguments source;
  std::string field_path, out;
  std::uint32_t frames = 12, size = 256;
  source.add_volume_to(app, "VOLUME");
  source.add_light_to(app);
  app.add_option("--field", field_path)->required();
  app.add_option("--frames", frames)->capture_default_str()->check(CLI::Range(1, 1000));
  app.add_option("--size", size)->capture_default_str();
  app.add_option("--out", out, "Prefix of the pictures")->required();
  CLI11_PARSE(app, argc, argv);

  const auto scene = expect(source.scene({}));
  const auto field = expect(Field::open(field_path));
  const Sphere& sphere = field.shape().sphere;
  const ViewOptions view{default_mode(field), field.shape().levels};
  Renderer renderer(field);
  nlohmann::json numbers = nlohmann::json::array();
  for (std::uint32_t k = 0; k < frames; ++k) {
    const Camera camera = orbit_camera(sphere, 360.0 * k / frames, 20, 3, size, size);
    const Image truth = expect(trace_view(*scene, sphere, camera));
    const Image drawn = expect(renderer.render(camera, view));
    const ImageDifference difference = compare(truth, drawn);
    numbers.push_back({{"psnr", difference.psnr}, {"ssim", difference.ssim}});
    char name[32];
    std::snprintf(name, sizeof name, "-%02u.png", k);
    expect(write_image(out + "-truth" + name, truth));
    expect(write_image(out + "-field" + name, drawn));
  }
  std::printf("%s\n", numbers.dump(2).c_str());
  return 0;
}

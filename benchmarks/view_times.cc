// Measures the time to open a field and to draw a view from it, cold and warm.
//
//   view_times FIELD.slf [--views N] [--size N] [--memory SIZE] [--mode MODE]
//
// Cold: each time, the kernel drops the file from its cache, the field is opened anew with an empty
// cache of tiles, and one random view from 3 radii is drawn. Warm: the same view again.
// Prints JSON: medians over N views of the time to open, cold and warm (µs), and to draw, cold and
// warm (ms); and the mean numbers of payload bytes and of file pages that a view needs.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "benchmarks/storage/expect.h"
#include "benchmarks/storage/page_cache.h"
#include "benchmarks/timing.h"
#include "cli/command.h"
#include "field/field_file.h"
#include "slf/measure.h"

int main(int argc, char** argv) {
  using namespace slf;
  using bench::expect;
  CLI::App app{"What opening a field and drawing from it take"};
  std::string path, mode;
  RendererOptions options;
  std::uint32_t views = 8, size = 512;
  app.add_option("field", path)->required();
  app.add_option("--views", views)->capture_default_str();
  app.add_option("--size", size)->capture_default_str();
  cli::add_bytes(app, "--memory", options.memory, "Bytes of decoded tiles and scratch");
  app.add_option("--mode", mode, "Default: the one the field is made for");
  CLI11_PARSE(app, argc, argv);

  const auto opened = [&] { return expect(Field::open(path)); };
  MeasureOptions measuring;
  {
    const auto field = opened();
    measuring.cameras = random_cameras(field.shape().sphere, 3, views, 1, size, size);
    measuring.mode = mode.empty() ? default_mode(field) : expect(parse_render_mode(mode));
    measuring.levels = {field.shape().finest_level};
    measuring.renderer = options;
  }
  bench::Times open_cold, open_warm, view_cold, view_warm;
  Image image;
  std::uint64_t stayed = 0;
  for (const Camera& camera : measuring.cameras) {
    stayed += bench::drop_from_cache(path);
    std::optional<Field> field;
    open_cold.run([&] { field = opened(); });
    {
      Renderer renderer(*field, options);
      const ViewOptions view{measuring.mode, field->shape().finest_level};
      view_cold.run([&] { expect(renderer.render(camera, view, image)); });
      view_warm.run([&] { expect(renderer.render(camera, view, image)); });
    }
    field.reset();
    open_warm.run([&] { field = opened(); });
  }
  const auto field = opened();
  const LevelMeasure level = expect(measure_views(field, measuring)).levels.front();
  std::printf("%s\n", nlohmann::json{{"file_bytes", field.file_bytes()},
                                     {"open_cold_us", 1e6 * open_cold.median_wall()},
                                     {"open_warm_us", 1e6 * open_warm.median_wall()},
                                     {"view_cold_ms", 1e3 * view_cold.median_wall()},
                                     {"view_warm_ms", 1e3 * view_warm.median_wall()},
                                     {"pages_not_dropped", stayed},
                                     {"compressed_bytes", level.compressed_bytes.mean},
                                     {"map_pages", level.map_pages.mean},
                                     {"decoded_peak_bytes", level.decoded_peak_bytes.mean},
                                     {"fraction", level.fraction.mean}}
                          .dump(2)
                          .c_str());
  return 0;
}

// Measures the systems of the paper's Table 1 on the same views: ray-casting, the light field
// between planes, the sphere light field.
//
//   systems VOLUME --field F.slf [--field SMALLER.slf]... [--transfer TF.json]
//           [--planes A:B:NA:NB]... [--views N] [--size N]... [--repeats N] [--raycast-once]
//           [--threads N] [--json]
//
// For each size and each of N random views from 3 radii, REPEATS times in turn, draws with: our
// ray-caster; a field between planes for each --planes (heights in radii and nodes along an edge;
// without NA and NB, as many slabs as the first sphere has); each sphere's field in mode bitri and,
// if it has depth, in mode depth. With several fields, the cells an edge of all but the first are
// part of their names. Everything is warm: a first turn, which is not counted, decodes tiles.
// But the ray-caster displaces most of what they read from the CPU's caches. With --raycast-once it
// draws each view only once, and the others find there what they read in the turn before.
// Reported: median wall time and processor time of all threads, in ms, as means over the views;
// PSNR against the ray-caster's picture.
#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "base/parallel.h"
#include "benchmarks/plane/plane_field.h"
#include "benchmarks/storage/expect.h"
#include "benchmarks/timing.h"
#include "cli/command.h"
#include "field/field_file.h"
#include "slf/scene.h"

namespace {

using namespace slf;
using bench::expect;

struct Arguments {
  cli::SourceArguments source;
  std::vector<std::string> fields;
  std::vector<std::string> planes;
  std::vector<std::uint32_t> sizes{512};
  std::uint32_t views = 4;
  std::uint64_t seed = 1;
  int repeats = 5;
  bool raycast_once = false;
  unsigned threads = 0;
  bool json = false;
};

bench::PlaneShape plane_shape(const std::string& text, double slabs) {
  bench::PlaneShape shape;
  double n[4] = {-1, 1, 0, 0};
  const int count = std::sscanf(text.c_str(), "%lf:%lf:%lf:%lf", n, n + 1, n + 2, n + 3);
  if (count != 2 && count != 4) bench::stop("--planes " + text + ": expected A:B or A:B:NA:NB");
  if (count == 2) n[2] = n[3] = std::pow(slabs / 6, 0.25);
  shape = {n[0], n[1], static_cast<std::int32_t>(std::lround(n[2])),
           static_cast<std::int32_t>(std::lround(n[3]))};
  if (!(shape.second > shape.first) || shape.first_nodes < 2 || shape.second_nodes < 2)
    bench::stop("--planes " + text + ": expected A below B and at least 2 nodes");
  return shape;
}

/// One way to draw a view.
struct System {
  std::string name;
  double slabs = 0;
  std::function<void(const Camera&, Image&)> draw;  ///< into a picture that is reused
};

/// Of the finest level.
double slabs(const Field& field) {
  return static_cast<double>(expect(field.content()).levels.back().slabs);
}

/// The sphere's field in each mode that it has.
void add_sphere(const Field& field, unsigned threads, bool first, std::vector<System>& systems) {
  const FieldShape& shape = field.shape();
  const unsigned level = shape.finest_level;
  const auto renderer = std::make_shared<Renderer>(field, RendererOptions{4ull << 30, threads});
  const std::string cells = first ? ""
                                  : ":" + std::to_string(shape.entry_side << level) + "/" +
                                        std::to_string(shape.exit_side << level);
  for (const RenderMode mode : {RenderMode::bitri, RenderMode::depth})
    if (mode != RenderMode::depth || field.has_depth())
      systems.push_back({std::string(name(mode)) + cells, slabs(field),
                         [renderer, mode, level](const Camera& c, Image& image) {
                           expect(renderer->render(c, {mode, level}, image));
                         }});
}

nlohmann::json measure(const Arguments& a) {
  std::vector<Field> fields;
  for (const std::string& path : a.fields) fields.push_back(expect(Field::open(path)));
  const auto scene = expect(make_scene(a.source));
  const Sphere& sphere = fields[0].shape().sphere;
  const unsigned threads = thread_count(a.threads);

  std::vector<System> systems{{"raycast", 0, [&](const Camera& c, Image& image) {
                                 image = expect(trace_view(*scene, sphere, c, threads));
                               }}};
  std::vector<std::unique_ptr<bench::PlaneField>> planes;
  for (const std::string& text : a.planes) {
    planes.push_back(
        std::make_unique<bench::PlaneField>(*scene, sphere, plane_shape(text, slabs(fields[0]))));
    const auto* plane = planes.back().get();
    const auto& s = plane->shape();
    char name[96];
    std::snprintf(name, sizeof name, "planes:%g:%g:%d:%d", s.first, s.second, s.first_nodes,
                  s.second_nodes);
    systems.push_back({name, s.nominal_slabs(),
                       [=](const Camera& c, Image& image) { plane->render(c, threads, image); }});
  }
  for (const Field& field : fields) add_sphere(field, threads, &field == &fields.front(), systems);

  nlohmann::json rows = nlohmann::json::array();
  for (const std::uint32_t size : a.sizes) {
    struct Sum {
      double wall = 0, cpu = 0, psnr = 0;
    };
    std::vector<Sum> sums(systems.size());
    for (const Camera& camera : random_cameras(sphere, 3, a.views, a.seed, size, size)) {
      for (auto& plane : planes) plane->prepare(camera);
      std::vector<bench::Times> times(systems.size());
      std::vector<Image> images(systems.size());
      for (int k = 0; k <= a.repeats; ++k)
        for (std::size_t s = 0; s < systems.size(); ++s) {
          if (k > 0 && s == 0 && a.raycast_once) continue;
          if (k == 1) times[s] = {};
          times[s].run([&] { systems[s].draw(camera, images[s]); });
        }
      for (std::size_t s = 0; s < systems.size(); ++s) {
        sums[s].wall += 1e3 * times[s].median_wall() / a.views;
        sums[s].cpu += 1e3 * times[s].median_cpu() / a.views;
        if (s > 0) sums[s].psnr += compare(images[0], images[s]).psnr / a.views;
      }
    }
    for (std::size_t s = 0; s < systems.size(); ++s) {
      nlohmann::json row{{"size", size},
                         {"system", systems[s].name},
                         {"slabs", systems[s].slabs},
                         {"wall_ms", sums[s].wall},
                         {"cpu_ms", sums[s].cpu}};
      if (s > 0) row["psnr"] = sums[s].psnr;
      rows.push_back(row);
    }
  }
  nlohmann::json traced = nlohmann::json::array();
  for (const auto& plane : planes) traced.push_back({plane->tiles(), plane->all_tiles()});
  return {{"threads", threads},
          {"views", a.views},
          {"repeats", a.repeats},
          {"plane_tiles_traced_of_all", traced},
          {"rows", rows}};
}

void print(const nlohmann::json& result) {
  std::printf("%6s %-28s %10s %10s %10s %8s\n", "size", "system", "M slabs", "wall ms", "cpu ms",
              "PSNR");
  for (const auto& row : result["rows"])
    std::printf("%6u %-28s %10.1f %10.2f %10.2f %8s\n", row["size"].get<unsigned>(),
                row["system"].get<std::string>().c_str(), row["slabs"].get<double>() / 1e6,
                row["wall_ms"].get<double>(), row["cpu_ms"].get<double>(),
                row.contains("psnr")
                    ? std::to_string(row["psnr"].get<double>()).substr(0, 5).c_str()
                    : "truth");
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"Ray-casting, light field between planes, sphere light field, on the same views"};
  Arguments a;
  a.source.add_input_to(app, "VOLUME");
  a.source.add_to(app, [](const auto& option) { return option.use != recipe::Use::field; });
  app.add_option("--field", a.fields, "Sphere light fields of the same volume")->required();
  app.add_option("--planes", a.planes, "A:B or A:B:NA:NB");
  app.add_option("--views", a.views)->capture_default_str();
  app.add_option("--seed", a.seed)->capture_default_str();
  app.add_option("--size", a.sizes, "Edges of the pictures")->capture_default_str();
  app.add_option("--repeats", a.repeats)->capture_default_str();
  app.add_flag("--raycast-once", a.raycast_once, "The ray-caster draws each view only once");
  app.add_option("-j,--threads", a.threads, "0: all cores")->capture_default_str();
  app.add_flag("--json", a.json);
  CLI11_PARSE(app, argc, argv);
  expect(a.source.finish(a.threads, cli::OnSignal::end));
  const nlohmann::json result = measure(a);
  if (a.json)
    std::printf("%s\n", result.dump(2).c_str());
  else
    print(result);
  return 0;
}

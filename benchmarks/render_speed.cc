// Measures how fast views are drawn from decoded tiles, and how close that is to memory's limit.
//
//   render_speed FIELD [SIZE [REPEATS [MODE [STEP]]]]
//
// Workload: REPEATS views (9) of SIZE × SIZE pixels (1024), which the sphere fills, are drawn into
// the same picture, in MODE or in every mode of the field, on one thread and on two. All tiles are
// decoded before. The camera turns by STEP degrees (0) from view to view. Reported: medians over
// the repeats, in ns per pixel whose ray crosses the sphere: processor time on one thread, from
// which ratios are computed, and wall time on one thread and on two.
//   gathers  the memory limit of mode bitri: a loop that only loads the same nine samples of the
//            same rays in the same order, at addresses that it reads from a list
// The environment variable SLF_TARGETS, a mask of Highway targets, limits the instruction sets.

#include <hwy/targets.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "field/field_file.h"
#include "field/geometry/level_geometry.h"
#include "field/tiles/tile_cache.h"
#include "slf/camera.h"
#include "slf/render.h"

namespace {

using namespace slf;

constexpr std::uint64_t kMemory = 2ull << 30;
constexpr std::uint32_t kBlock = 32;  // rays are listed in blocks, as the renderer draws them

/// Nanoseconds.
struct Time {
  double wall = 0;
  double cpu = 0;  ///< of all threads
};

double now(clockid_t clock) {
  timespec time{};
  clock_gettime(clock, &time);
  return 1e9 * static_cast<double>(time.tv_sec) + static_cast<double>(time.tv_nsec);
}

/// Median times of a call.
template <class F>
Time median_time(int repeats, const F& f) {
  std::vector<double> wall, cpu;
  for (int k = 0; k < repeats; ++k) {
    const double wall_start = now(CLOCK_MONOTONIC), cpu_start = now(CLOCK_PROCESS_CPUTIME_ID);
    f();
    cpu.push_back(now(CLOCK_PROCESS_CPUTIME_ID) - cpu_start);
    wall.push_back(now(CLOCK_MONOTONIC) - wall_start);
  }
  std::sort(wall.begin(), wall.end());
  std::sort(cpu.begin(), cpu.end());
  return {wall[wall.size() / 2], cpu[cpu.size() / 2]};
}

/// The samples of mode bitri, as three rows and three columns for each ray.
class GatherList {
 public:
  GatherList(const Field& field, unsigned level, const Camera& camera)
      : field_(field), geometry_(field.file().geometry(level)), cache_(field.file(), kMemory) {
    const auto rays = *RayGenerator::make(camera);
    const std::uint32_t across = (camera.width + kBlock - 1) / kBlock;
    for (std::uint32_t block = 0; block < across * across; ++block)
      for (std::uint32_t k = 0; k < kBlock * kBlock; ++k) {
        const std::uint32_t x = block % across * kBlock + k % kBlock;
        const std::uint32_t y = block / across * kBlock + k / kBlock;
        if (x < camera.width && y < camera.height) add(rays.ray(x, y));
      }
  }

  [[nodiscard]] std::uint32_t gather() const {
    std::uint32_t sum = 0;
    for (const RaySamples& ray : rays_)
      for (const std::uint32_t row : ray.rows)
        for (const std::uint32_t column : ray.columns) sum += samples_[row + column];
    return sum;
  }

 private:
  struct RaySamples {
    std::array<std::uint32_t, 3> rows, columns;
  };

  void add(const PixelRay& pixel) {
    const Sphere& sphere = field_.shape().sphere;
    const Chord chord = intersect(sphere, pixel.origin, pixel.direction);
    if (!chord.hit || chord.leave <= 0) return;
    const auto at = [&](double t) { return pixel.origin + t * pixel.direction - sphere.center; };
    const Cell enter = locate(at(chord.enter), geometry_.entry_resolution());
    const auto exit = geometry_.exit_cell(locate(at(chord.leave), geometry_.exit_resolution()));
    RaySamples ray{{}, exit.columns};
    for (std::size_t c = 0; c < 3; ++c) {
      const EntryRow row = geometry_.entry_row(enter.octant, enter.corners()[c]);
      ray.rows[c] =
          tile(row.section, exit.section) + row.row * triangle_size(geometry_.exit_side());
    }
    rays_.push_back(ray);
  }

  /// The index of a tile's first sample. Appends the samples the first time; an empty tile's are 0.
  std::uint32_t tile(std::uint32_t entry, std::uint32_t exit) {
    const auto [found, is_new] =
        tiles_.try_emplace({entry, exit}, static_cast<std::uint32_t>(samples_.size()));
    if (!is_new) return found->second;
    const TileShape shape = geometry_.tile(entry, codec::SampleFormat::rgba8);
    samples_.resize(samples_.size() + shape.bytes() / 4);
    const auto pin =
        cache_.load(tile_key({geometry_.entry_section(entry), geometry_.exit_section(exit)}));
    if (pin && !pin->samples().empty())
      std::memcpy(samples_.data() + found->second, pin->samples().data(), shape.bytes());
    return found->second;
  }

  const Field& field_;
  const LevelGeometry& geometry_;
  TileCache cache_;
  std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> tiles_;
  std::vector<std::uint32_t> samples_;
  std::vector<RaySamples> rays_;
};

/// The median time of the views. Exits if one cannot be drawn.
Time view_time(const Field& field, std::span<const Camera> cameras, const ViewOptions& view,
               unsigned threads, std::uint64_t& hit) {
  Renderer renderer(field, {kMemory, threads});
  ViewStatistics statistics;
  Image image;
  const auto draw = [&](const Camera& camera) {
    if (const auto ok = renderer.render(camera, view, image, &statistics); !ok) {
      std::fprintf(stderr, "%s\n", ok.error().message.c_str());
      std::exit(1);
    }
  };
  for (const Camera& camera : cameras) draw(camera);
  hit = statistics.pixels_hit;
  auto next = cameras.begin();
  return median_time(static_cast<int>(cameras.size()), [&] { draw(*next++); });
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2) {
    std::fprintf(stderr, "usage: render_speed FIELD [SIZE [REPEATS [MODE [STEP]]]]\n");
    return 1;
  }
  const auto field = Field::open(argv[1]);
  if (!field) {
    std::fprintf(stderr, "%s\n", field.error().message.c_str());
    return 1;
  }
  const auto size = static_cast<std::uint32_t>(argc > 2 ? std::atoi(argv[2]) : 1024);
  const int repeats = argc > 3 ? std::max(1, std::atoi(argv[3])) : 9;
  const unsigned level = field->shape().finest_level;
  const double step = argc > 5 ? std::atof(argv[5]) : 0;
  std::vector<Camera> cameras;
  for (int k = 0; k < repeats; ++k)
    cameras.push_back(orbit_camera(field->shape().sphere, 30 + step * k, 20, 3, size, size));

  if (const char* targets = std::getenv("SLF_TARGETS"))
    hwy::SetSupportedTargetsForTest(std::strtoll(targets, nullptr, 0));

  Time gathers, bitri;
  std::uint64_t hit = 1;
  if (!is_half(field->format())) {
    const GatherList list(*field, level, cameras.front());
    std::uint32_t sum = 0;
    gathers = median_time(repeats, [&] { sum += list.gather(); });
    volatile std::uint32_t keep = sum;
    (void)keep;
  }
  std::printf("%s, level %u, %ux%u, median of %d\n", argv[1], level, size, size, repeats);
  std::printf("%-8s %9s %9s %9s %8s %9s %8s\n", "mode", "cpu (1)", "wall (1)", "wall (2)",
              "speedup", "/gathers", "/bitri");
  for (const RenderMode mode : {RenderMode::bitri, RenderMode::nearest, RenderMode::uv,
                                RenderMode::st, RenderMode::depth}) {
    if (argc > 4 && std::string_view(argv[4]) != name(mode)) continue;
    if (mode == RenderMode::depth && !field->has_depth()) continue;
    const Time one = view_time(*field, cameras, {mode, level, false}, 1, hit);
    const Time two = view_time(*field, cameras, {mode, level, false}, 2, hit);
    if (mode == RenderMode::bitri) bitri = one;
    const auto pixels = static_cast<double>(hit);
    std::printf("%-8s %9.2f %9.2f %9.2f %8.2f %9.2f %8.2f\n", name(mode), one.cpu / pixels,
                one.wall / pixels, two.wall / pixels, one.wall / two.wall,
                gathers.cpu > 0 ? one.cpu / gathers.cpu : 0.0, one.cpu / bitri.cpu);
  }
  const auto pixels = static_cast<double>(hit);
  std::printf("%-8s %9.2f %9.2f\n", "gathers", gathers.cpu / pixels, gathers.wall / pixels);
  return 0;
}

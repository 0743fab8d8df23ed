// Measures how fast the ray-caster fills a field, and how close that is to the machine's limits.
//
//   raycast_speed VOLUME TRANSFER.json [MESH] [--benchmark_...]
//
// Workload: the slabs of random tiles (entry vertex × a patch of exit vertices, as the builder
// traces them). Reported, one thread:
//   Trace        slabs/s, and per slab: positions visited, values interpolated, samples shaded
//   TraceLit     the same with global light that is known; Trace has direct light
//   ShadeLimit   the arithmetic limit: the same code shades as many samples of a volume so small
//                that it stays in the first-level cache, without empty space
//   GatherLimit  the memory limit: only loads the voxel rows of as many samples, in the volume
//                itself, around the depths where slabs are opaque
//   TraceMesh    the same tiles of the mesh: with direct light, and with global light that is known
// Trace can be at most as fast as the slower of the two limits; all three report slabs/s.

#include <benchmark/benchmark.h>

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <functional>
#include <memory>
#include <random>
#include <vector>

#include "slf/mesh.h"
#include "slf/raycaster.h"

namespace {

using namespace slf;

constexpr std::size_t kRow = 561;
std::unique_ptr<Raycaster> caster;
std::vector<Segment> segments;
std::vector<RaySample> samples;
Volume volume;  // the one that the ray-caster was made from
TransferFunction transfer;

std::vector<Segment> make_segments(const Sphere& s) {
  std::vector<Segment> segments;
  std::mt19937_64 random(1);
  std::normal_distribution<double> normal;
  const auto direction = [&] {
    return glm::normalize(glm::dvec3(normal(random), normal(random), normal(random)));
  };
  for (int tile = 0; tile < 400; ++tile) {
    const glm::dvec3 entry = direction(), exit = direction();
    const glm::dvec3 across = glm::normalize(glm::cross(exit, entry));
    const glm::dvec3 down = glm::cross(exit, across);
    for (std::size_t k = 0; k < kRow; ++k) {  // a section of the sphere at level 2, 33 × 17 exits
      const glm::dvec3 at = glm::normalize(exit + 0.4 * (static_cast<double>(k % 33) / 33 * across +
                                                         static_cast<double>(k / 33) / 17 * down));
      segments.push_back({s.center + s.radius * entry, s.center + s.radius * at});
    }
  }
  return segments;
}

void count_slabs(benchmark::State& state) {
  state.counters["slabs"] = benchmark::Counter(static_cast<double>(segments.size()),
                                               benchmark::Counter::kIsIterationInvariantRate);
}

RayCounts trace_all(const Raycaster& caster) {
  RayCounts all;
  for (std::size_t begin = 0; begin < segments.size(); begin += kRow) {
    const RayCounts row = caster.trace_counted(std::span(segments).subspan(begin, kRow),
                                               std::span(samples).subspan(begin, kRow));
    all.steps += row.steps;
    all.samples += row.samples;
    all.visible += row.visible;
  }
  return all;
}

void trace(benchmark::State& state, const Raycaster& caster) {
  RayCounts counts;
  for (auto _ : state) {
    counts = trace_all(caster);
    benchmark::DoNotOptimize(samples.data());
    benchmark::ClobberMemory();
  }
  const auto slabs = static_cast<double>(segments.size());
  count_slabs(state);
  state.counters["steps/slab"] = static_cast<double>(counts.steps) / slabs;
  state.counters["values/slab"] = static_cast<double>(counts.samples) / slabs;
  state.counters["shaded/slab"] = static_cast<double>(counts.visible) / slabs;
}

void Trace(benchmark::State& state) { trace(state, *caster); }
BENCHMARK(Trace)->Unit(benchmark::kMillisecond);

void TraceLit(benchmark::State& state) {
  static const std::unique_ptr<Raycaster> lit = [] {
    RaycastOptions options;
    options.lighting.mode = Lighting::global;
    auto made = Raycaster::make(volume, transfer, options);
    return made ? std::move(*made) : nullptr;
  }();
  if (!lit) return state.SkipWithError("no light");
  trace(state, *lit);
}
BENCHMARK(TraceLit)->Unit(benchmark::kMillisecond);

void trace_mesh(benchmark::State& state, const Scene& mesh) {
  const std::vector<Segment> rays = make_segments(mesh.bounds());
  std::vector<RaySample> seen(rays.size());
  mesh.trace_many(rays, seen);  // computes the light
  for (auto _ : state) {
    mesh.trace_many(rays, seen);
    benchmark::DoNotOptimize(seen.data());
    benchmark::ClobberMemory();
  }
  count_slabs(state);
  state.counters["visible"] =
      static_cast<double>(std::count_if(seen.begin(), seen.end(),
                                        [](const RaySample& s) { return s.rgba.a > 0; })) /
      static_cast<double>(seen.size());
}

/// 24³ voxels, faint: every sample is visible, and no ray ends early.
std::unique_ptr<Raycaster> small_cube() {
  Volume cube;
  cube.dims = {24, 24, 24};
  for (int k = 0; k < 24 * 24 * 24; ++k) cube.voxels.push_back(std::byte(100 + k % 24));
  TransferFunction faint;
  faint.colors = {{0, {1, 1, 1}}};
  faint.opacities = {{0, 1e-4, 0.5, 0}};
  auto made = Raycaster::make(std::move(cube), faint);
  return made ? std::move(*made) : nullptr;
}

void ShadeLimit(benchmark::State& state) {
  const std::uint64_t wanted = trace_all(*caster).visible;
  const auto cube = small_cube();
  std::vector<Segment> rays;  // away from the faces, where the ray-caster copies voxels first
  for (std::size_t k = 0; k < kRow; ++k)
    rays.push_back({glm::dvec3(2 + k % 19, 2 + k / 33, 2), glm::dvec3(2 + k % 18, 3 + k / 35, 21)});
  std::vector<RaySample> seen(kRow);
  for (auto _ : state)
    for (std::uint64_t shaded = 0; shaded < wanted;)
      shaded += cube->trace_counted(rays, seen).visible;
  count_slabs(state);
}
BENCHMARK(ShadeLimit)->Unit(benchmark::kMillisecond);

void GatherLimit(benchmark::State& state) {
  const auto counts = trace_all(*caster);
  const auto [nx, ny, nz] = volume.dims;
  const std::size_t bytes = bytes_per_voxel(volume.type);
  const std::size_t stride_y = nx * bytes, stride_z = stride_y * ny;
  // Offsets of the first voxel of the 4×4×4, at successive samples around each slab's depth.
  const glm::dmat3 to_index = glm::inverse(volume.axes);
  std::vector<std::size_t> places;
  std::size_t seen = 0;
  for (const RaySample& s : samples) seen += s.rgba.a > 0;
  const double per_ray = static_cast<double>(counts.visible) / static_cast<double>(seen);
  for (std::size_t k = 0; k < segments.size(); ++k) {
    if (samples[k].rgba.a <= 0) continue;
    const auto& [from, to] = segments[k];
    const glm::dvec3 middle = to_index * (glm::mix(from, to, samples[k].depth) - volume.origin);
    const glm::dvec3 step = 0.7 * glm::normalize(to_index * (to - from));
    for (double s = -per_ray / 2; s < per_ray / 2; ++s) {
      const glm::dvec3 at =
          glm::clamp(middle + s * step - 1.0, glm::dvec3(0), glm::dvec3(nx, ny, nz) - 4.0);
      places.push_back(static_cast<std::size_t>(at.z) * stride_z +
                       static_cast<std::size_t>(at.y) * stride_y +
                       static_cast<std::size_t>(at.x) * bytes);
    }
  }
  constexpr int kY[12] = {1, 2, 1, 2, 0, 0, 3, 3, 1, 2, 1, 2};
  constexpr int kZ[12] = {1, 1, 2, 2, 1, 2, 1, 2, 0, 0, 3, 3};
  for (auto _ : state) {
    std::uint32_t sum = 0;
    for (const std::size_t place : places)
      for (int r = 0; r < 12; ++r) {
        std::uint32_t row;
        std::memcpy(&row, volume.voxels.data() + place + kZ[r] * stride_z + kY[r] * stride_y, 4);
        sum += row;
      }
    benchmark::DoNotOptimize(sum);
  }
  count_slabs(state);
}
BENCHMARK(GatherLimit)->Unit(benchmark::kMillisecond);

}  // namespace

int main(int argc, char** argv) {
  if (argc < 3) {
    std::fprintf(stderr, "usage: raycast_speed VOLUME TRANSFER.json [MESH] [--benchmark_...]\n");
    return 1;
  }
  auto read = read_volume(argv[1]);
  const auto preset = read_transfer(argv[2]);
  if (!read || !preset) {
    std::fprintf(stderr, "%s\n", (!read ? read.error() : preset.error()).message.c_str());
    return 1;
  }
  volume = std::move(*read);
  transfer = preset->fit(volume);
  auto made = Raycaster::make(volume, transfer);
  if (!made) {
    std::fprintf(stderr, "%s\n", made.error().message.c_str());
    return 1;
  }
  caster = std::move(*made);
  segments = make_segments(caster->bounds());
  samples.resize(segments.size());
  std::vector<std::unique_ptr<MeshScene>> meshes;
  const int files = argc > 3 && argv[3][0] != '-' ? 3 : 2;
  if (files == 3)
    for (const auto& [name, mode] : {std::pair{"TraceMesh/direct", Lighting::direct},
                                     {"TraceMesh/global", Lighting::global}}) {
      MeshOptions options;
      options.lighting.mode = mode;
      auto scene = read_mesh(argv[3]).and_then(
          [&](Mesh mesh) { return MeshScene::make(std::move(mesh), options); });
      if (!scene) {
        std::fprintf(stderr, "%s\n", scene.error().message.c_str());
        return 1;
      }
      meshes.push_back(std::move(*scene));
      benchmark::RegisterBenchmark(name, trace_mesh, std::cref(*meshes.back()))
          ->Unit(benchmark::kMillisecond);
    }
  argc -= files;
  argv[files] = argv[0];
  argv += files;
  benchmark::Initialize(&argc, argv);
  benchmark::RunSpecifiedBenchmarks();
  return 0;
}

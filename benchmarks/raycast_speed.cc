// How fast the ray-caster fills a field, and how far that is from what the machine allows.
//
//   raycast_speed VOLUME TRANSFER.json [--benchmark_...]
//
// Workload: the slabs of random tiles (entry vertex × a patch of exit vertices, as the builder
// traces them). Reported, one thread:
//   Trace        slabs/s, and ns per shaded sample
//   ShadeLimit   the arithmetic limit: as many shaded samples, all from one cached place
//   GatherLimit  the memory limit: only the voxel rows of as many samples, from the same places
// Trace can be at most as fast as the slower of the two limits.

#include <benchmark/benchmark.h>

#include <cstdio>
#include <random>
#include <vector>

#include "field/raycaster.h"

namespace {

using namespace slf;

constexpr std::size_t kRow = 561;
std::unique_ptr<Raycaster> caster;
std::vector<Segment> segments;

void make_segments() {
  const Sphere s = caster->bounds();
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
}

void Trace(benchmark::State& state) {
  double opacity = 0;
  std::vector<RaySample> samples(kRow);
  for (auto _ : state) {
    opacity = 0;
    for (std::size_t begin = 0; begin < segments.size(); begin += kRow) {
      caster->trace_many(std::span(segments).subspan(begin, kRow), samples);
      for (const RaySample& sample : samples) opacity += sample.rgba.a;
    }
    benchmark::DoNotOptimize(opacity);
  }
  state.counters["slabs"] = benchmark::Counter(static_cast<double>(segments.size()),
                                               benchmark::Counter::kIsIterationInvariantRate);
  state.counters["mean opacity"] = opacity / static_cast<double>(segments.size());
}
BENCHMARK(Trace)->Unit(benchmark::kMillisecond);

}  // namespace

int main(int argc, char** argv) {
  if (argc < 3) {
    std::fprintf(stderr, "usage: raycast_speed VOLUME TRANSFER.json [--benchmark_...]\n");
    return 1;
  }
  auto volume = read_volume(argv[1]);
  auto transfer = read_transfer(argv[2]);
  if (!volume || !transfer) {
    std::fprintf(stderr, "%s\n", (!volume ? volume.error() : transfer.error()).message.c_str());
    return 1;
  }
  auto made = Raycaster::make(std::move(*volume), *transfer);
  if (!made) {
    std::fprintf(stderr, "%s\n", made.error().message.c_str());
    return 1;
  }
  caster = std::move(*made);
  make_segments();
  argc -= 2;
  argv[2] = argv[0];
  argv += 2;
  benchmark::Initialize(&argc, argv);
  benchmark::RunSpecifiedBenchmarks();
  return 0;
}

#include "field/scene/light_volume.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "base/parallel.h"
#include "field/scene/light_depth.h"

namespace slf {
namespace {

constexpr int kPoints = 16;
/// Bytes per node that computing takes: depth, index, and the result; about half of the nodes of a
/// grid are near a surface at most, with a NodeLight each.
constexpr std::uint64_t kBytesPerNode = 4 + 4 + 4 + 28;

double fraction(double v) { return v - std::floor(v); }

/// Element i of the d-th of Roberts' additive sequences for three dimensions.
double r3(std::uint64_t i, int d) {
  constexpr double kAlpha[3] = {0.8191725133961645, 0.6710436067037893, 0.5497004779019703};
  return fraction(static_cast<double>(i) * kAlpha[d]);
}

/// The light at one node, and what the filter needs to know of it.
struct NodeLight {
  glm::vec3 direct{0};    // from lights
  glm::vec3 indirect{0};  // from the surroundings, and scattered
  glm::vec3 normal{0};    // mean, times the share of the surface
  float depth = 0;        // optical, below what can be seen from outside
  bool lit = false;       // there is matter
};

/// The grid that covers the visible box within the options' memory.
LightGrid plan_grid(const RayGrid& grid, const LightOptions& options) {
  const glm::dvec3 box = grid.visible_high - grid.visible_low;
  const double most = static_cast<double>(options.memory / kBytesPerNode);
  LightGrid light;
  light.low = grid.visible_low;
  const auto dims_at = [&](double spacing) {
    return glm::dvec3(glm::ceil(box / spacing - 1e-9) + 1.0);
  };
  light.spacing = options.spacing;
  for (glm::dvec3 d = dims_at(light.spacing); d.x * d.y * d.z > most; d = dims_at(light.spacing))
    light.spacing *= 1.02;
  const glm::dvec3 dims = dims_at(light.spacing);
  for (int axis = 0; axis < 3; ++axis)
    light.dims[static_cast<std::size_t>(axis)] = static_cast<std::int32_t>(dims[axis]);
  return light;
}

glm::ivec3 node_at(const LightGrid& light, std::size_t number) {
  const auto nx = static_cast<std::size_t>(light.dims[0]),
             ny = static_cast<std::size_t>(light.dims[1]);
  return {number % nx, number / nx % ny, number / (nx * ny)};
}

/// Calls f(number, offset) for the node itself and its neighbours in the grid.
template <class F>
void for_each_neighbour(const LightGrid& light, std::size_t number, const F& f) {
  const glm::ivec3 at = node_at(light, number);
  const glm::ivec3 dims(light.dims[0], light.dims[1], light.dims[2]);
  for (int z = -1; z <= 1; ++z)
    for (int y = -1; y <= 1; ++y)
      for (int x = -1; x <= 1; ++x) {
        const glm::ivec3 offset(x, y, z), to = at + offset;
        if (glm::any(glm::lessThan(to, glm::ivec3(0))) || glm::any(glm::greaterThanEqual(to, dims)))
          continue;
        f((static_cast<std::size_t>(to.z) * dims.y + to.y) * dims.x + to.x, offset);
      }
}

/// Whether a view can show matter between a node and its neighbours.
bool shows(const LightGrid& light, const std::vector<float>& depth, std::size_t number) {
  bool any = false;
  for_each_neighbour(light, number,
                     [&](std::size_t other, glm::ivec3) { any |= depth[other] < kHidden; });
  return any;
}

/// Solves single nodes. Thread-safety: immutable.
class LightSolver {
 public:
  LightSolver(const Medium& medium, const Illumination& illumination, const LightOptions& options,
              const LightGrid& light, const std::vector<float>& depth)
      : medium_(medium), shine_(illumination), options_(options), light_(light), depth_(depth) {}

  [[nodiscard]] NodeLight solve(std::size_t number) const {
    Random random(mix((options_.seed - 1) * kMixStep + number));
    const Points points = find_points(number, random);
    NodeLight node;
    if (points.count == 0) return node;
    node.lit = true;
    for (int k = 0; k < points.count; ++k) {
      const auto share = static_cast<float>(points.weight[k] / points.total);
      const Matter& matter = points.matter[k];
      node.normal += share * matter.surface * glm::vec3(matter.normal);
      node.depth += share * static_cast<float>(points.depth[k]);
      if (share > 1e-3f) node.direct += share * tint(matter) * direct(matter, k, random);
    }
    node.indirect = indirect(points, random);
    return node;
  }

 private:
  struct Points {
    int count = 0;
    std::array<Matter, kPoints> matter;
    std::array<double, kPoints> weight{}, depth{};
    double total = 0;   // of the weights
    double effort = 0;  // share of all points and paths that the node deserves
  };

  /// Points in the cube of one spacing to each side of a node, weighted as trilinear interpolation
  /// will weight the node there, by extinction, and by how visible they are from outside.
  [[nodiscard]] Points find_points(std::size_t number, Random& random) const {
    const glm::dvec3 node(node_at(light_, number));
    const glm::dvec3 shift(random(), random(), random());
    std::array<glm::dvec3, kPoints> at;
    std::array<double, kPoints> depth{}, weight{};
    double least_depth = kHidden;
    for (int k = 0; k < kPoints; ++k) {
      for (int d = 0; d < 3; ++d) {  // a tent over ±1
        const double u = 2 * fraction(r3(static_cast<std::uint64_t>(k), d) + shift[d]) - 1;
        at[k][d] = node[d] + (u < 0 ? std::sqrt(1 + u) - 1 : 1 - std::sqrt(1 - u));
      }
      const double extinction = medium_.extinction(light_.low + light_.spacing * at[k]);
      if (!(extinction > 0)) continue;
      depth[k] = interpolate(light_, depth_, at[k]);
      weight[k] = extinction * std::exp(-depth[k]);
      least_depth = std::min(least_depth, depth[k]);
    }
    Points points;
    points.effort = std::exp(-0.5 * least_depth);
    const int most = static_cast<int>(std::ceil(kPoints * points.effort));
    for (int k = 0; k < kPoints && points.count < most; ++k) {
      if (!(weight[k] > 0)) continue;
      points.matter[points.count] = medium_.matter(light_.low + light_.spacing * at[k]);
      points.depth[points.count] = depth[k];
      points.weight[points.count] = weight[k];
      points.total += weight[k];
      ++points.count;
    }
    return points;
  }

  /// Rays multiply light by the colour; this makes it the albedo.
  static glm::vec3 tint(const Matter& matter) {
    return matter.albedo / glm::max(matter.color, glm::vec3(1e-4f));
  }

  /// What all lights send to a point.
  [[nodiscard]] glm::vec3 direct(const Matter& matter, int k, Random& random) const {
    glm::vec3 sum(0);
    const glm::dvec3 here = medium_.world(matter.start);
    for (std::size_t l = 0; l < shine_.lights.size(); ++l) {
      const auto i = static_cast<std::uint64_t>(k) + kPoints * l;  // other points for each light
      const Arrival arrival = shine_.lights[l].arrival(here, r3(i, 0), r3(i, 1));
      const double kernel = matter.kernel(arrival.direction);
      if (!(kernel > 0)) continue;
      const double depth = medium_.optical_depth(matter.start, medium_.per_world(arrival.direction),
                                                 arrival.distance, random());
      if (depth < Medium::kDark)
        sum += static_cast<float>(kernel * std::exp(-depth)) * arrival.irradiance;
    }
    return sum;
  }

  /// What comes from the surroundings, and from matter that is lit.
  [[nodiscard]] glm::vec3 indirect(const Points& points, Random& random) const {
    const int paths = static_cast<int>(std::ceil(options_.samples * points.effort));
    glm::vec3 sum(0);
    const glm::dvec3 shift(random(), random(), random());
    const double first = random();
    double passed = points.weight[0];  // systematic resampling of the points by weight
    int k = 0;
    for (int i = 0; i < paths; ++i) {
      while (passed < (i + first) / paths * points.total && k + 1 < points.count)
        passed += points.weight[++k];
      const auto at = static_cast<std::uint64_t>(i);
      sum += tint(points.matter[k]) *
             path(points.matter[k],
                  {fraction(r3(at, 0) + shift[0]), fraction(r3(at, 1) + shift[1]),
                   fraction(r3(at, 2) + shift[2])},
                  random);
    }
    return sum / static_cast<float>(paths);
  }

  /// One path of light, traced backwards from a point, whose first direction comes from `u`.
  [[nodiscard]] glm::vec3 path(Matter matter, glm::dvec3 u, Random& random) const {
    const bool global = options_.mode == Lighting::global;
    const std::uint32_t bounces = global ? options_.bounces : 0;
    const bool find_sky = shine_.environment.peaked();
    glm::vec3 throughput(1), sum(0);
    for (std::uint32_t bounce = 0;; ++bounce) {
      if (find_sky) sum += throughput * sky(matter, random);
      if (bounce > 0) sum += throughput * one_light(matter, random);
      const glm::dvec3 direction = matter.sample(u[0], u[1], u[2]);
      const glm::dvec3 along = medium_.per_world(direction);
      const auto t =
          medium_.fly(matter.start, along, std::numeric_limits<double>::infinity(), random);
      if (!t) {
        if (shine_.environment.dark()) return sum;
        const double kernel = matter.kernel(direction);
        const double weight =
            find_sky ? kernel / (kernel + shine_.environment.density(direction)) : 1;
        return sum +
               static_cast<float>(weight) * throughput * shine_.environment.radiance(direction);
      }
      if (bounce >= bounces) return sum;
      matter = medium_.matter(matter.start + *t * along);
      throughput *= matter.albedo;
      // Russian roulette, once less than half of the light is left.
      const double survival =
          std::min(1.0, 2.0 * std::max({throughput.r, throughput.g, throughput.b}));
      if (random() >= survival) return sum;
      throughput /= static_cast<float>(survival);
      u = {random(), random(), random()};
    }
  }

  /// Next-event estimation towards the environment; its share by the balance heuristic.
  [[nodiscard]] glm::vec3 sky(const Matter& matter, Random& random) const {
    const double choice = random(), u = random(), v = random();
    const Environment::Sample s = shine_.environment.sample(choice, u, v);
    const double kernel = matter.kernel(s.direction);
    if (!(kernel > 0) ||
        !reaches(matter, s.direction, std::numeric_limits<double>::infinity(), random))
      return glm::vec3(0);
    return static_cast<float>(kernel / (kernel + s.density)) * s.radiance;
  }

  /// Next-event estimation towards one of the lights.
  [[nodiscard]] glm::vec3 one_light(const Matter& matter, Random& random) const {
    const std::size_t count = shine_.lights.size();
    if (count == 0) return glm::vec3(0);
    const auto l = static_cast<std::size_t>(random() * static_cast<double>(count));
    const double u = random(), v = random();
    const Arrival arrival = shine_.lights[l].arrival(medium_.world(matter.start), u, v);
    const double kernel = matter.kernel(arrival.direction);
    if (!(kernel > 0) || !reaches(matter, arrival.direction, arrival.distance, random))
      return glm::vec3(0);
    return static_cast<float>(kernel * static_cast<double>(count)) * arrival.irradiance;
  }

  [[nodiscard]] bool reaches(const Matter& matter, const glm::dvec3& direction, double distance,
                             Random& random) const {
    return !medium_.fly(matter.start, medium_.per_world(direction), distance, random);
  }

  const Medium& medium_;
  const Illumination& shine_;
  const LightOptions& options_;
  const LightGrid& light_;
  const std::vector<float>& depth_;
};

/// The nodes of `numbers`, in that order.
Result<std::vector<NodeLight>> solve_all(const LightSolver& solver,
                                         const std::vector<std::size_t>& numbers,
                                         std::uint32_t samples, unsigned threads,
                                         const ProgressCallback& progress) {
  constexpr std::size_t kBatch = 512;
  using Batch = std::vector<NodeLight>;
  const std::size_t batches = (numbers.size() + kBatch - 1) / kBatch;
  const unsigned workers = thread_count(threads);
  OrderedPipeline<Batch> pipeline(batches, workers, 4 * workers, [&] {
    return [&](std::uint64_t batch) -> Result<Batch> {
      Batch nodes;
      const std::size_t begin = batch * kBatch, end = std::min(begin + kBatch, numbers.size());
      for (std::size_t k = begin; k < end; ++k) nodes.push_back(solver.solve(numbers[k]));
      return nodes;
    };
  });
  std::vector<NodeLight> all;
  all.reserve(numbers.size());
  for (std::size_t batch = 0; batch < batches; ++batch) {
    auto nodes = pipeline.take();
    if (!nodes) return tl::unexpected(nodes.error());
    all.insert(all.end(), nodes->begin(), nodes->end());
    if (progress && !progress({all.size() * samples, numbers.size() * samples, 0}))
      return fail(ErrorCode::failed, "stopped while the light volume was computed");
  }
  return all;
}

constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

/// The indirect light of a node, averaged with that of its neighbours.
glm::vec3 filtered(const LightGrid& light, const std::vector<std::uint32_t>& index,
                   const std::vector<NodeLight>& nodes, std::size_t number) {
  const NodeLight& center = nodes[index[number]];
  glm::vec3 sum(0);
  float total = 0;
  for_each_neighbour(light, number, [&](std::size_t other, glm::ivec3 offset) {
    if (index[other] == kNone || !nodes[index[other]].lit) return;
    const NodeLight& node = nodes[index[other]];
    // 1 in the middle, 1/2, 1/4, 1/8 at faces, edges and corners.
    const int steps = std::abs(offset.x) + std::abs(offset.y) + std::abs(offset.z);
    const glm::vec3 turn = node.normal - center.normal;
    const float deeper = node.depth - center.depth;
    const float weight = std::exp2(static_cast<float>(-steps)) *
                         std::exp(-4 * glm::dot(turn, turn) - 2 * deeper * deeper);
    sum += weight * node.indirect;
    total += weight;
  });
  return sum / total;
}

/// For a node without matter of its own: the mean of its lit neighbours, since rays near them
/// interpolate between both.
glm::vec3 mean_around(const LightGrid& light, const std::vector<std::uint32_t>& index,
                      const std::vector<NodeLight>& nodes, const std::vector<glm::vec3>& values,
                      std::size_t number) {
  glm::vec4 sum(0);
  for_each_neighbour(light, number, [&](std::size_t other, glm::ivec3) {
    if (index[other] != kNone && nodes[index[other]].lit) sum += glm::vec4(values[index[other]], 1);
  });
  return sum.w > 0 ? glm::vec3(sum) / sum.w : glm::vec3(0);
}

}  // namespace

Result<LightGrid> compute_light(const Medium& medium, const Illumination& illumination,
                                const LightOptions& options, unsigned threads,
                                const ProgressCallback& progress) {
  LightGrid light = plan_grid(medium.grid(), options);
  const std::vector<float> depth = depth_from_outside(medium, light);
  std::vector<std::size_t> numbers;
  std::vector<std::uint32_t> index(light.size(), kNone);
  for (std::size_t number = 0; number < light.size(); ++number)
    if (shows(light, depth, number) && near_matter(medium.grid(), light, node_at(light, number))) {
      index[number] = static_cast<std::uint32_t>(numbers.size());
      numbers.push_back(number);
    }
  const LightSolver solver(medium, illumination, options, light, depth);
  const auto nodes = solve_all(solver, numbers, options.samples, threads, progress);
  if (!nodes) return tl::unexpected(nodes.error());

  std::vector<glm::vec3> values(numbers.size());
  auto done = parallel_for(numbers.size(), threads, [&](std::uint64_t k) {
    const NodeLight& node = (*nodes)[k];
    if (node.lit) values[k] = node.direct + filtered(light, index, *nodes, numbers[k]);
  });
  if (!done) return tl::unexpected(done.error());
  light.nodes.assign(light.size(), 0);
  for (std::size_t k = 0; k < numbers.size(); ++k)
    light.nodes[numbers[k]] = pack_light(
        (*nodes)[k].lit ? values[k] : mean_around(light, index, *nodes, values, numbers[k]));
  return light;
}

}  // namespace slf

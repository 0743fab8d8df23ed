// LightSolver solves single nodes: points around a node, what lights them, and paths from them.
// LightComputer, below, decides which nodes are solved, in which passes, and has them filtered.
#include "source/light/light_volume.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <numeric>
#include <span>

#include "base/parallel.h"
#include "base/reporter.h"
#include "base/try.h"
#include "source/light/light_depth.h"
#include "source/light/light_filter.h"

namespace slf {
namespace {

constexpr int kPoints = 32;     // around a node, at most
constexpr double kReach = 0.5;  // how far from it, in spacings
constexpr int kMarched = 4;     // of these, towards each light
/// Bytes per node that computing takes: its depth, two indices and two results, and, at most for
/// half of the nodes, those near a surface, its number, a NodeLight and twice its light.
constexpr std::uint64_t kBytesPerNode =
    4 + 8 + 2 * LightGrid::kNodeBytes + (8 + sizeof(NodeLight) + 2 * sizeof(ArrivingLight)) / 2;

/// REQUIRES: 0 <= v < 2^31.
double fraction(double v) { return v - static_cast<int>(v); }

/// Element i of the d-th of Roberts' additive sequences for three dimensions.
double r3(std::uint64_t i, int d) {
  constexpr double kAlpha[3] = {0.8191725133961645, 0.6710436067037893, 0.5497004779019703};
  return fraction(static_cast<double>(i) * kAlpha[d]);
}

/// Whether a view can show matter between a node and its neighbours.
bool can_be_seen(const LightGrid& light, const std::vector<float>& depth, std::size_t number) {
  bool any = false;
  for_each_neighbour(light, number,
                     [&](std::size_t other, glm::ivec3) { any |= depth[other] < kHidden; });
  return any;
}

using Pass = LightComputer::Pass;

/// The time that a pass takes per node, in paths.
std::uint64_t cost(const Pass& pass) {
  constexpr std::uint64_t kFindPoints = 4, kDirect = 12;
  return pass.paths + kFindPoints + (pass.estimate ? 0 : kDirect);
}

/// Solves single nodes. Thread-safety: immutable.
class LightSolver {
 public:
  LightSolver(const Medium& medium, const Illumination& illumination, const LightOptions& options,
              const LightGrid& light, const std::vector<float>& depth)
      : medium_(medium),
        illumination_(illumination),
        options_(options),
        light_(light),
        depth_(depth),
        far_(kFarNodes * light.spacing * medium.smallest_spacing()) {}

  /// The light at a node; with an estimate, only its indirect part. That is not a number if paths
  /// missed nodes of the estimate.
  [[nodiscard]] NodeLight solve(std::size_t number, const Pass& pass) const {
    Random random(mix((2 * options_.seed + (pass.estimate ? 1 : 0)) * kMixStep + number));
    const int tries = static_cast<int>(
        pass.estimate ? std::clamp<std::uint32_t>(pass.paths, kPoints / 4, kPoints) : kPoints);
    const Points points = find_points(number, tries, random);
    NodeLight node;
    if (points.count == 0) return node;
    node.lit = true;
    node.seen = static_cast<float>(points.total / tries);
    node.indirect[pass.number()] = indirect_light(points, pass, random);
    if (!pass.estimate) {
      find_look_ups(number, points, node);
      add_direct(points, random, node);
    }
    return node;
  }

 private:
  struct Points {
    int count = 0;
    std::array<Matter, kPoints> matter;
    std::array<double, kPoints> weight{}, depth{};
    std::array<double, kPoints> shown{};  // weights times what the matter reflects
    double total = 0, total_shown = 0;
    double effort = 0;  // share of all paths that the node deserves
  };

  /// Points around a node, of `tries` that may lie beside the matter, close ones more often,
  /// weighted by extinction and by how visible they are from outside.
  [[nodiscard]] Points find_points(std::size_t number, int tries, Random& random) const {
    const glm::ivec3 node = node_at(light_, number);
    const glm::dvec3 shift(random(), random(), random());
    std::array<Matter, kPoints> matter;
    std::array<double, kPoints> depth{}, weight{};
    double min_depth = kHidden, total = 0;
    for (int k = 0; k < tries; ++k) {
      glm::dvec3 at;
      for (int d = 0; d < 3; ++d) {
        const double u = 2 * fraction(r3(static_cast<std::uint64_t>(k), d) + shift[d]) - 1;
        const double tent = u < 0 ? std::sqrt(1 + u) - 1 : 1 - std::sqrt(1 - u);  // over ±1
        at[d] = node[d] + kReach * tent;
      }
      // There is no matter beyond faces. Where they cut matter, they are what is visible.
      matter[k] = medium_.matter(medium_.nearest_inside(light_.low + light_.spacing * at));
      if (!(matter[k].extinction > 0)) continue;
      depth[k] = depth_of(matter[k]);
      weight[k] = matter[k].extinction * std::exp(-depth[k]);
      total += weight[k];
      min_depth = std::min(min_depth, depth[k]);
    }
    Points points;
    points.effort = std::exp(-0.5 * min_depth);
    // Russian roulette among those that weigh little.
    const double min_weight = total / (tries * (1 + 3 * points.effort));
    std::array<int, kPoints> order{};
    std::iota(order.begin(), order.end(), 0);
    std::sort(order.begin(), order.begin() + tries,
              [&](int a, int b) { return depth[a] < depth[b]; });
    for (const int k : std::span(order).first(static_cast<std::size_t>(tries))) {
      if (!(weight[k] > 0) || (weight[k] < min_weight && random() * min_weight >= weight[k]))
        continue;
      points.matter[points.count] = matter[k];
      points.depth[points.count] = depth[k];
      points.weight[points.count] = std::max(weight[k], min_weight);
      points.total += points.weight[points.count];
      points.shown[points.count] =
          points.weight[points.count] * (1e-3 + glm::dot(kLuminance, matter[k].albedo));
      points.total_shown += points.shown[points.count];
      ++points.count;
    }
    return points;
  }

  /// The optical depth of matter below what can be seen. Nodes are too far apart to tell it of
  /// surfaces, so there it is measured, along the normal. Faces of the box show what they cut.
  [[nodiscard]] double depth_of(const Matter& matter) const {
    const double known = interpolate(light_, depth_, node_of(matter.at));
    if (!(matter.surface > 0)) return known;
    const double length = light_.spacing * medium_.smallest_spacing();
    const glm::dvec3 along = medium_.per_world(matter.normal);
    const double measured = medium_.optical_depth(matter.at, along, length, 0.5) +
                            interpolate(light_, depth_, node_of(matter.at + length * along));
    const double below_face =
        matter.extinction * medium_.smallest_spacing() *
        std::max(0.0, std::min(medium_.below_box(matter.at), medium_.below_clip(matter.at)));
    return std::min(below_face,
                    glm::mix(std::min(known, measured), measured, double{matter.surface}));
  }

  [[nodiscard]] glm::dvec3 node_of(const glm::dvec3& at) const {
    return (at - light_.low) / light_.spacing;
  }

  /// The place, in nodes, where rays look up the light of matter.
  [[nodiscard]] glm::dvec3 look_up_place(const Matter& matter) const {
    const glm::dvec3 normal = medium_.per_world(matter.normal);
    const double length = std::max(glm::length(normal), 1e-30);
    return node_of(matter.at) + double{kLookUpBeside * matter.surface} / length * normal;
  }

  /// Sets where rays look up the light of the matter that a node stands for.
  void find_look_ups(std::size_t number, const Points& points, NodeLight& node) const {
    const glm::dvec3 center(node_at(light_, number));
    std::array<double, 27> weights{};
    for (int k = 0; k < points.count; ++k) {
      const glm::dvec3 place = look_up_place(points.matter[k]) - center;
      const glm::ivec3 first = glm::clamp(glm::ivec3(glm::floor(place)), -1, 0);
      const glm::dvec3 within = glm::clamp(place - glm::dvec3(first), 0.0, 1.0);
      for (int corner = 0; corner < 8; ++corner) {
        const glm::ivec3 step(corner & 1, corner >> 1 & 1, corner >> 2);
        const glm::dvec3 share = glm::mix(1.0 - within, within, glm::dvec3(step));
        weights[neighbour_number(first + step)] += points.weight[k] * share.x * share.y * share.z;
      }
    }
    const double most = *std::max_element(weights.begin(), weights.end());
    for (int n = 0; n < 27; ++n)
      node.look_ups[n] = static_cast<std::uint8_t>(std::lround(255 * weights[n] / most));
  }

  /// Adds what the filter compares, and the light that comes straight from the lights.
  void add_direct(const Points& points, Random& random, NodeLight& node) const {
    const double across = light_.spacing * medium_.smallest_spacing();
    for (int k = 0; k < points.count; ++k) {
      const Matter& matter = points.matter[k];
      const auto share = static_cast<float>(points.weight[k] / points.total);
      node.normal += share * matter.surface * glm::vec3(matter.normal);
      node.opacity -= share * static_cast<float>(std::expm1(-matter.extinction * across));
      node.depth += share * static_cast<float>(points.depth[k]);
    }
    for (std::size_t l = 0; l < light_.lights.size(); ++l) add_light(points, l, random, node);
  }

  /// The light of one light that the points scatter, white: of all of them without shadows, times
  /// the mean transmittance to a few, chosen in proportion to their light.
  void add_light(const Points& points, std::size_t light, Random& random, NodeLight& node) const {
    const auto& matter = points.matter;
    std::array<IncidentLight, kPoints> arrivals;
    std::array<float, kPoints> bright{};  // as the points scatter it
    double total = 0;
    const double shift[2] = {random(), random()};
    for (int k = 0; k < points.count; ++k) {
      const auto i = static_cast<std::uint64_t>(k);
      arrivals[k] = illumination_.lights[light].incident_light(medium_.world(matter[k].start),
                                                               fraction(r3(i, 0) + shift[0]),
                                                               fraction(r3(i, 1) + shift[1]));
      bright[k] = static_cast<float>(points.shown[k] / points.total_shown *
                                     matter[k].kernel(arrivals[k].direction));
      total += bright[k];
    }
    if (!(total > 0)) return;
    const auto l = static_cast<int>(light);
    node.unshadowed[l] = static_cast<float>(total);
    const int marched = static_cast<int>(std::ceil(kMarched * points.effort));
    const double first = random();
    double passed = 0;
    for (int k = 0, taken = 0; k < points.count; ++k) {
      passed += bright[k];
      for (; taken < marched && (taken + first) * total < passed * marched; ++taken)
        node.direct[l] +=
            transmittance(matter[k], arrivals[k], random()) * static_cast<float>(total / marched);
    }
  }

  /// The light from the surroundings and from lit matter.
  [[nodiscard]] ArrivingLight indirect_light(const Points& points, const Pass& pass,
                                             Random& random) const {
    const int paths = static_cast<int>(std::ceil(pass.paths * points.effort));
    ArrivingLight sum;
    const glm::dvec3 shift(random(), random(), random());
    const double first = random();
    double passed = points.shown[0];  // systematic resampling of the points by what they show
    int k = 0;
    for (int i = 0; i < paths; ++i) {
      while (passed < (i + first) / paths * points.total_shown && k + 1 < points.count)
        passed += points.shown[++k];
      const auto at = static_cast<std::uint64_t>(i);
      const Matter& matter = points.matter[k];
      if (illumination_.environment.peaked())
        sum += arriving(matter, light_from_sky(matter, random));
      sum += arriving(matter, light_from_one(matter, light_.lights.size(), random));
      sum += arriving(matter,
                      trace_path(matter,
                                 {fraction(r3(at, 0) + shift[0]), fraction(r3(at, 1) + shift[1]),
                                  fraction(r3(at, 2) + shift[2])},
                                 pass, random));
    }
    return 1.f / static_cast<float>(paths) * sum;
  }

  /// Light from one direction, times the kernel and divided by the density of directions.
  struct Scattered {
    glm::dvec3 direction{0.0};
    glm::vec3 light{0};
  };

  /// How the light from a direction changes with the normal, a rotational gradient of irradiance
  /// (Ward, Heckbert 1992): linear, and exact at the matter's own normal.
  static ArrivingLight arriving(const Matter& matter, const Scattered& from) {
    if (from.light == glm::vec3(0)) return {};
    constexpr double kInversePi = 1 / std::numbers::pi, kRare = 0.05;
    // Grazing directions are rare and bright: bounded, they make less noise in the change.
    const double inverse = 1 / std::max(matter.kernel(from.direction), kRare);
    glm::dvec3 change(0);
    if (matter.surface > 0) {
      // A surface sends few paths below itself, or none. As far as these are missing, those above
      // stand for them, as far as matter reflects: `known` of both halves is found, bounded.
      const double flat = (1 - matter.surface) * kInversePi / 4;  // the kernel below
      const double missed = std::max(0.0, kRare - flat);
      const double known[2] = {std::min(1.0, flat / kRare),
                               1 - missed * missed / (2 * kRare * kInversePi * matter.surface)};
      const bool above = glm::dot(matter.normal, from.direction) > 0;
      if (above) change = kInversePi * from.direction;
      const double reflected = (1 - known[0]) * glm::dot(kLuminance, matter.albedo);
      change -= (above ? (1 + reflected) / known[1] : 1) * kInversePi / 4 * matter.normal;
      change *= inverse;
    }
    const double mean = 1 - matter.surface * glm::dot(change, matter.normal);
    return {static_cast<float>(mean) * from.light,
            glm::dot(kLuminance, from.light) * glm::vec3(change),
            static_cast<float>(1 - mean) * from.light, glm::vec3(0)};
  }

  /// One path of light, traced backwards from a point, whose first direction comes from `u`. Its
  /// light, except that which arrives at the point straight from lights and a peaked environment.
  [[nodiscard]] Scattered trace_path(Matter matter, glm::dvec3 u, const Pass& pass,
                                     Random& random) const {
    double traveled = 0;
    const bool sample_sky = illumination_.environment.peaked();
    Scattered result;
    glm::vec3 throughput(1);
    for (std::uint32_t bounce = 0;; ++bounce) {
      if (bounce > 0) {
        if (sample_sky) result.light += throughput * light_from_sky(matter, random).light;
        result.light += throughput * light_from_one(matter, 0, random).light;
      }
      const glm::dvec3 direction = matter.sample(u[0], u[1], u[2]);
      if (bounce == 0) result.direction = direction;
      const glm::dvec3 along = medium_.per_world(direction);
      const auto t =
          medium_.fly(matter.start, along, std::numeric_limits<double>::infinity(), random);
      if (!t) {
        if (illumination_.environment.dark()) return result;
        const double kernel = matter.kernel(direction);
        const double weight =
            sample_sky ? kernel / (kernel + illumination_.environment.density(direction)) : 1;
        result.light +=
            static_cast<float>(weight) * throughput * illumination_.environment.radiance(direction);
        return result;
      }
      if (bounce >= pass.bounces) return result;
      traveled += *t;
      const glm::dvec3 at = matter.start + *t * along;
      matter = medium_.matter(at);
      throughput *= matter.albedo;
      if (pass.estimate && traveled > far_)
        if (const auto known = look_up(*pass.estimate, look_up_place(matter))) {
          result.light += throughput * light_at(matter, *known);
          return result;
        }
      // Russian roulette, once less than half of the light is left.
      const double survival =
          std::min(1.0, 2.0 * std::max({throughput.r, throughput.g, throughput.b}));
      if (random() >= survival) return result;
      throughput /= static_cast<float>(survival);
      u = {random(), random(), random()};
    }
  }

  /// The light that white matter scatters, as rays compute it.
  [[nodiscard]] glm::vec3 light_at(const Matter& matter, const ArrivingLight& arriving) const {
    glm::vec3 sum = surrounding_light(arriving, matter.surface * glm::vec3(matter.normal));
    for (std::size_t l = 0; l < light_.lights.size(); ++l) {
      const IncidentLight arrival =
          illumination_.lights[l].incident_light(medium_.world(matter.at), 0, 0);
      sum += arriving.arrives[static_cast<int>(l)] *
             static_cast<float>(matter.kernel(arrival.direction)) * arrival.irradiance;
    }
    return sum;
  }

  /// Next-event estimation towards the environment; its share by the balance heuristic.
  [[nodiscard]] Scattered light_from_sky(const Matter& matter, Random& random) const {
    const double choice = random(), u = random(), v = random();
    const Environment::Sample s = illumination_.environment.sample(choice, u, v);
    const double kernel = matter.kernel(s.direction);
    if (!(kernel > 0) || medium_.fly(matter.start, medium_.per_world(s.direction),
                                     std::numeric_limits<double>::infinity(), random))
      return {};
    return {s.direction, static_cast<float>(kernel / (kernel + s.density)) * s.radiance};
  }

  /// Next-event estimation towards one of the lights from number `first` on.
  [[nodiscard]] Scattered light_from_one(const Matter& matter, std::size_t first,
                                         Random& random) const {
    if (first >= illumination_.lights.size()) return {};
    const std::size_t count = illumination_.lights.size() - first;
    const auto l = first + static_cast<std::size_t>(random() * static_cast<double>(count));
    const double u = random(), v = random();
    const IncidentLight arrival =
        illumination_.lights[l].incident_light(medium_.world(matter.start), u, v);
    const double kernel = matter.kernel(arrival.direction);
    if (!(kernel > 0)) return {};
    return {arrival.direction, transmittance(matter, arrival, random()) *
                                   static_cast<float>(kernel * static_cast<double>(count)) *
                                   arrival.irradiance};
  }

  /// The share of a light that arrives at a place, from samples shifted by `shift` (0 to 1).
  [[nodiscard]] float transmittance(const Matter& at, const IncidentLight& arrival,
                                    double shift) const {
    const double depth = medium_.optical_depth(at.start, medium_.per_world(arrival.direction),
                                               arrival.distance, shift);
    return depth < Medium::kDark ? static_cast<float>(std::exp(-depth)) : 0;
  }

  const Medium& medium_;
  const Illumination& illumination_;
  const LightOptions& options_;
  const LightGrid& light_;
  const std::vector<float>& depth_;
  /// Paths may end with the estimate from this distance on: nearer, it is that of the node itself.
  static constexpr double kFarNodes = 2;
  double far_;  // the same in world units
};

/// A number that has no divisor in common with `count`, close to the golden section of it: steps of
/// this length around a circle of `count` places visit all of them, evenly from the beginning on.
std::size_t even_step(std::size_t count) {
  auto step = static_cast<std::size_t>(static_cast<double>(count) / std::numbers::phi);
  while (std::gcd(step, count) != 1) ++step;
  return step;
}

/// Solves the nodes of `numbers` and gives each with its place there to `keep`. The order is such
/// that the time for the first nodes foretells that for the others.
template <class F>
Result<void> solve_all(const LightSolver& solver, const std::vector<std::size_t>& numbers,
                       const Pass& pass, unsigned threads, Reporter& progress, const F& keep) {
  // Between two reports.
  const std::size_t batch_size = std::clamp<std::size_t>(8192 / pass.paths, 1, 256);
  using Batch = std::vector<NodeLight>;
  const std::size_t batches = (numbers.size() + batch_size - 1) / batch_size;
  if (batches == 0) return {};
  const std::size_t step = even_step(batches);
  const auto begin_of = [&](std::uint64_t item) { return item * step % batches * batch_size; };
  const unsigned workers = thread_count(threads);
  const auto solve = [&](std::uint64_t item) -> Result<Batch> {
    Batch nodes;
    const std::size_t begin = begin_of(item), end = std::min(begin + batch_size, numbers.size());
    for (std::size_t k = begin; k < end; ++k) nodes.push_back(solver.solve(numbers[k], pass));
    return nodes;
  };
  const auto keep_all = [&](std::uint64_t item, const Batch& nodes) {
    std::size_t k = begin_of(item);
    for (const NodeLight& node : nodes) keep(k++, node);
    return progress.add(nodes.size() * cost(pass));
  };
  return make_in_order(
      batches, workers, 4 * workers, [&] { return solve; }, keep_all);
}

}  // namespace

LightGrid plan_light(const RayGrid& grid, const Illumination& illumination,
                     const LightOptions& options) {
  const glm::dvec3 box = grid.visible_high - grid.visible_low;
  const std::uint64_t nodes = options.memory / kBytesPerNode;
  const auto max_nodes = static_cast<double>(nodes);
  LightGrid light;
  light.low = grid.visible_low;
  const auto dims_at = [&](double spacing) {
    return glm::dvec3(glm::ceil(box / spacing - 1e-9) + 1.0);
  };
  light.spacing = options.spacing;
  for (glm::dvec3 d = dims_at(light.spacing); d.x * d.y * d.z > max_nodes;
       d = dims_at(light.spacing))
    light.spacing *= 1.02;
  const glm::dvec3 dims = dims_at(light.spacing);
  for (int axis = 0; axis < 3; ++axis)
    light.dims[static_cast<std::size_t>(axis)] = static_cast<std::int32_t>(dims[axis]);
  for (const PlacedLight& placed : illumination.lights)
    if (light.lights.size() < kGridLights) light.lights.push_back(placed.seen_from(grid.origin));
  return light;
}

LightComputer::LightComputer(const Medium& medium, const Illumination& illumination,
                             const LightOptions& options, LightGrid plan, unsigned threads)
    : medium_(medium),
      illumination_(illumination),
      options_(options),
      threads_(threads),
      blank_(std::move(plan)) {}

Result<void> LightComputer::prepare() {
  const auto extinction = SLF_TRY(node_extinctions(medium_, blank_, threads_));
  depth_ = depth_from_outside(medium_, blank_, extinction);
  index_.assign(blank_.size(), kNoNode);
  near_ = index_;
  blank_.nodes.assign(blank_.node_bytes(), 0);
  for (std::size_t number = 0; number < blank_.size(); ++number)
    if (can_be_seen(blank_, depth_, number) &&
        near_matter(medium_.grid(), blank_, node_at(blank_, number))) {
      index_[number] = static_cast<std::uint32_t>(numbers_.size());
      numbers_.push_back(number);
      blank_.node(number)[kChannels] = kMissingNode;
    }
  nodes_.resize(numbers_.size());
  passes_ = {{options_.samples, 0, nullptr}};
  if (options_.mode == Lighting::global && options_.bounces > 0) {
    estimate_ = blank_;
    estimate_.missed = &missed_.emplace(blank_.size());
    passes_ = {{(options_.samples + 15) / 16, options_.bounces - 1, nullptr},
               {options_.samples, options_.bounces, &estimate_}};
  }
  return {};
}

Result<void> LightComputer::compute(LightGrid& light, const std::vector<std::size_t>& wanted,
                                    const ProgressCallback& progress) {
  const std::size_t nodes = spread(wanted, kFilterReach).size();
  Progress all;
  for (const Pass& pass : passes_) all.total += nodes * cost(pass);
  Reporter reporter(progress, all, "stopped while the light volume was computed");
  SLF_TRY(reporter.add(0));
  return fill(light, passes_.back(), wanted, reporter);
}

std::vector<std::size_t> LightComputer::spread(std::vector<std::size_t> numbers, int reach) const {
  if (numbers.size() == numbers_.size()) return numbers;
  std::vector<bool> found(index_.size());
  for (const std::size_t number : numbers) found[number] = true;
  for (std::size_t begin = 0, end = numbers.size(); reach > 0;
       begin = end, end = numbers.size(), --reach)
    for (std::size_t k = begin; k < end; ++k)
      for_each_neighbour(blank_, numbers[k], [&](std::size_t other, glm::ivec3) {
        if (found[other] || index_[other] == kNoNode) return;
        found[other] = true;
        numbers.push_back(other);
      });
  return numbers;
}

Result<void> LightComputer::fill(LightGrid& light, const Pass& pass,
                                 std::vector<std::size_t> wanted, Reporter& progress) {
  std::erase_if(wanted,
                [&](std::size_t number) { return light.node(number)[kChannels] != kMissingNode; });
  if (wanted.empty()) return {};
  const auto around = spread(wanted, kFilterReach);
  SLF_TRY(solve(around, pass, progress));
  std::vector<const NodeLight*> nodes;
  for (const std::size_t number : around) {
    near_[number] = static_cast<std::uint32_t>(nodes.size());
    nodes.push_back(&nodes_[index_[number]]);
  }
  auto done =
      filter_light(medium_, light, near_, around, wanted, nodes, pass.number(), threads_, progress);
  for (const std::size_t number : around) near_[number] = kNoNode;
  return done;
}

Result<void> LightComputer::solve(std::vector<std::size_t> numbers, const Pass& pass,
                                  Reporter& progress) {
  const std::size_t p = pass.number();
  if (pass.estimate) SLF_TRY(fill(estimate_, passes_.front(), numbers, progress));
  const LightSolver solver(medium_, illumination_, options_, blank_, depth_);
  std::erase_if(numbers, [&](std::size_t number) { return nodes_[index_[number]].solved[p]; });
  while (!numbers.empty()) {
    std::vector<std::size_t> again;
    SLF_TRY(solve_all(solver, numbers, pass, threads_, progress,
                      [&](std::size_t k, const NodeLight& node) {
                        NodeLight& to = nodes_[index_[numbers[k]]];
                        if (!pass.estimate)
                          to = node;
                        else if (std::isnan(node.indirect[1].mean.x))
                          return again.push_back(numbers[k]);
                        else  // other points, which may all lie beside the matter
                          to.indirect[1] = node.lit ? node.indirect[1] : to.indirect[0];
                        to.solved[p] = true;
                      }));
    numbers = std::move(again);
    if (!numbers.empty()) SLF_TRY(fill(estimate_, passes_.front(), missed_->take(), progress));
  }
  return {};
}

Result<LightGrid> compute_light(const Medium& medium, const Illumination& illumination,
                                const LightOptions& options, unsigned threads,
                                const ProgressCallback& progress) {
  LightComputer computer(medium, illumination, options,
                         plan_light(medium.grid(), illumination, options), threads);
  SLF_TRY(computer.prepare());
  LightGrid light = computer.blank();
  SLF_TRY(computer.compute(light, computer.nodes(), progress));
  return light;
}

}  // namespace slf

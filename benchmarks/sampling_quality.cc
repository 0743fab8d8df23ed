// Compares parameterisations of rays alone, by the PSNR of views that are interpolated directly
// from traced samples, without storage or compression.
//
//   sampling_quality VOLUME [--transfer TF.json] --system SPEC... [--views N] [--size N] [--json]
//
// SPEC is one of
//   gnomonic:NE:NX      the paper's lattice, NE cells an octsphere's edge on entry, NX on exit
//   equal-angle:NE:NX   the octsphere's edges divided into equal angles, sin(u π/2) and so on
//   equal-area:NE:NX    cells of equal area (Clarberg 2008, on each octsphere)
//   planes:A:B:NA:NB    six pairs of planes at heights A and B (radii; the sphere is 1), NA × NA
//                       and NB × NB nodes
// Each sample that a view needs is traced once, by the ray-caster that also draws the reference.
// Spheres are interpolated bi-triangularly and then corrected by depth, twice, in a way that is
// simpler than slf's; planes are interpolated quadrilinearly. Samples are floats.
#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdio>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <numbers>
#include <unordered_map>

#include "base/parallel.h"
#include "benchmarks/plane/slabs.h"
#include "benchmarks/storage/expect.h"
#include "cli/command.h"
#include "field/geometry/lattice.h"
#include "slf/scene.h"

namespace {

using namespace slf;
using bench::expect;

// ---- samples, traced on first use ----------------------------------------------------------

class Samples {
 public:
  Samples(const Scene& scene, const Sphere& sphere) : scene_(scene), sphere_(sphere) {}

  /// The number of the sample of the line through two points (of the unit sphere's space).
  std::uint32_t number(std::uint64_t key, const glm::dvec3& from, const glm::dvec3& to) {
    const auto [at, is_new] = numbers_.try_emplace(key, static_cast<std::uint32_t>(lines_.size()));
    if (is_new) lines_.push_back({from, to});
    return at->second;
  }

  /// Traces the samples that number() was called for since the last call.
  void trace() {
    const std::size_t begin = samples_.size();
    samples_.resize(lines_.size());
    constexpr std::size_t kChunk = 512;
    expect(parallel_for((lines_.size() - begin + kChunk - 1) / kChunk, 0, [&](std::uint64_t chunk) {
      const std::size_t first = begin + chunk * kChunk;
      std::vector<Segment> segments;
      std::vector<std::size_t> which;
      for (std::size_t k = first; k < std::min(first + kChunk, lines_.size()); ++k) {
        const auto& [from, to] = lines_[k];
        const Chord chord = intersect({}, from, to - from);
        if (!chord.hit) continue;
        segments.push_back(
            {world(from + chord.enter * (to - from)), world(from + chord.leave * (to - from))});
        which.push_back(k);
      }
      std::vector<RaySample> out(segments.size());
      scene_.trace_many(segments, out);
      for (std::size_t k = 0; k < which.size(); ++k) samples_[which[k]] = out[k];
    }));
  }

  const RaySample& operator[](std::uint32_t number) const { return samples_[number]; }
  [[nodiscard]] std::size_t traced() const { return samples_.size(); }

 private:
  [[nodiscard]] glm::dvec3 world(const glm::dvec3& p) const {
    return sphere_.center + sphere_.radius * p;
  }

  const Scene& scene_;
  Sphere sphere_;
  std::unordered_map<std::uint64_t, std::uint32_t> numbers_;
  std::vector<Segment> lines_;
  std::vector<RaySample> samples_;
};

/// A pixel's ray as it crosses the unit sphere.
struct Ray {
  std::size_t pixel;
  glm::dvec3 enter, leave;
};

// ---- spheres -------------------------------------------------------------------------------

/// Maps the triangle of an octant to the sphere: barycentric coordinates, with the signs of the
/// octant, to a direction, and back.
struct SphereMapping {
  std::function<glm::dvec3(const glm::dvec3&)> to_direction, to_barycentric;
};

glm::dvec3 with_signs(const glm::dvec3& v, const glm::dvec3& signs) {
  return {std::copysign(v.x, signs.x), std::copysign(v.y, signs.y), std::copysign(v.z, signs.z)};
}

SphereMapping gnomonic() {
  return {[](const glm::dvec3& b) { return glm::normalize(b); },
          [](const glm::dvec3& d) { return d; }};  // locate() divides by the sum
}

SphereMapping equal_angle() {
  constexpr double kQuarter = std::numbers::pi / 2;
  return {[](const glm::dvec3& b) { return glm::normalize(glm::sin(b * kQuarter)); },
          [](const glm::dvec3& d) {
            // Find the scale at which the arcs of the three sines add up to a right angle.
            const glm::dvec3 a = glm::abs(glm::normalize(d));
            double low = 0, high = 1 / std::max({a.x, a.y, a.z});
            for (int k = 0; k < 48; ++k) {
              const double middle = (low + high) / 2;
              const glm::dvec3 arcs = glm::asin(glm::min(a * middle, glm::dvec3(1)));
              (arcs.x + arcs.y + arcs.z < kQuarter ? low : high) = middle;
            }
            return with_signs(glm::asin(glm::min(a * low, glm::dvec3(1))) / kQuarter, d);
          }};
}

SphereMapping equal_area() {
  constexpr double kQuarter = std::numbers::pi / 2;
  return {[](const glm::dvec3& b) {
            const glm::dvec3 a = glm::abs(b);
            const double r = a.x + a.y, angle = r > 0 ? kQuarter * a.y / r : 0;
            const double side = r * std::sqrt(std::max(0.0, 2 - r * r));
            return with_signs({side * std::cos(angle), side * std::sin(angle), 1 - r * r}, b);
          },
          [](const glm::dvec3& d) {
            const glm::dvec3 a = glm::abs(glm::normalize(d));
            const double r = std::sqrt(std::max(0.0, 1 - a.z));
            const double share = std::atan2(a.y, a.x) / kQuarter;
            return with_signs({r * (1 - share), r * share, 1 - r}, d);
          }};
}

/// The vertices of one side of the sphere. Locates points among them.
class Side {
 public:
  Side(const SphereMapping& mapping, std::int32_t resolution)
      : mapping_(mapping), resolution_(resolution) {}

  struct Corners {
    std::array<std::uint64_t, 3> key;
    std::array<glm::dvec3, 3> point;
    std::array<double, 3> weight;
  };
  [[nodiscard]] Corners locate(const glm::dvec3& p) const {
    const Cell cell = slf::locate(mapping_.to_barycentric(p), resolution_);
    Corners out{{}, {}, cell.weights};
    for (std::size_t c = 0; c < 3; ++c) {
      const LatticeVertex v = to_vertex(cell.octant, cell.corners()[c], resolution_);
      const auto side = static_cast<std::uint64_t>(2 * resolution_ + 1);
      out.key[c] = (static_cast<std::uint64_t>(v.i + resolution_) * side +
                    static_cast<std::uint64_t>(v.j + resolution_)) *
                       2 +
                   (v.k < 0);
      out.point[c] = mapping_.to_direction(glm::dvec3(v.i, v.j, v.k) / double(resolution_));
    }
    return out;
  }
  [[nodiscard]] double vertices() const { return static_cast<double>(vertex_count(resolution_)); }

 private:
  SphereMapping mapping_;
  std::int32_t resolution_;
};

/// Where the chord from p through x leaves the unit sphere.
glm::dvec3 far_end(const glm::dvec3& p, const glm::dvec3& x) {
  const glm::dvec3 along = x - p;
  const double length2 = glm::dot(along, along);
  return length2 > 1e-12 ? p - 2 * glm::dot(p, along) / length2 * along : p;
}

/// Pictures of one view: by bi-triangle interpolation, then after each of `passes` corrections.
std::vector<Image> draw_sphere(const Side& entry, const Side& exit, Samples& samples,
                               const std::vector<Ray>& rays, const Image& blank, int passes) {
  struct Tap {
    std::uint32_t sample;
    double weight;
  };
  std::vector<std::array<Tap, 9>> taps(rays.size());
  std::vector<double> depth(rays.size());
  std::vector<Image> images(static_cast<std::size_t>(passes) + 1, blank);
  for (std::size_t pass = 0; pass < images.size(); ++pass) {
    const auto aim = [&](const Ray& ray, std::size_t k, const glm::dvec3& p) {
      return pass == 0 ? ray.leave : far_end(p, ray.enter + depth[k] * (ray.leave - ray.enter));
    };
    for (std::size_t k = 0; k < rays.size(); ++k) {
      const auto from = entry.locate(rays[k].enter);
      for (std::size_t c = 0; c < 3; ++c) {
        const auto to = exit.locate(aim(rays[k], k, from.point[c]));
        for (std::size_t e = 0; e < 3; ++e)
          taps[k][3 * c + e] = {
              samples.number(from.key[c] << 32 | to.key[e], from.point[c], to.point[e]),
              from.weight[c] * to.weight[e]};
      }
    }
    samples.trace();
    expect(parallel_for(rays.size(), 0, [&](std::uint64_t k) {
      const Ray& ray = rays[k];
      const glm::dvec3 along = ray.leave - ray.enter;
      const auto from = entry.locate(ray.enter);
      glm::dvec4 color(0);
      double place = 0, opacity = 0;
      for (std::size_t c = 0; c < 3; ++c) {
        const glm::dvec3 line = aim(ray, k, from.point[c]) - from.point[c];
        for (std::size_t e = 0; e < 3; ++e) {
          const auto& [number, weight] = taps[k][3 * c + e];
          const RaySample& s = samples[number];
          color += weight * glm::dvec4(s.rgba);
          const double visible = weight * double{s.rgba.a};
          opacity += visible;
          place += visible * glm::dot(from.point[c] + double{s.depth} * line - ray.enter, along);
        }
      }
      if (opacity > 0) depth[k] = std::clamp(place / (opacity * glm::dot(along, along)), 0.0, 1.0);
      images[pass].rgba[ray.pixel] = glm::vec4(color);
    }));
  }
  return images;
}

// ---- planes --------------------------------------------------------------------------------

Image draw_planes(const bench::PlaneShape& shape, Samples& samples, const std::vector<Ray>& rays,
                  const Image& blank) {
  struct Axis {
    std::int32_t node;
    double part;
  };
  const auto axis = [](double height, std::int32_t nodes, double x) {
    const double at = (x / bench::PlaneShape::extent(height) + 1) / 2 * (nodes - 1);
    const auto node = std::clamp(static_cast<std::int32_t>(std::floor(at)), 0, nodes - 2);
    return Axis{node, std::clamp(at - node, 0.0, 1.0)};
  };
  struct Tap {
    std::uint32_t sample;
    double weight;
  };
  std::vector<std::array<Tap, 16>> taps(rays.size());
  for (std::size_t k = 0; k < rays.size(); ++k) {
    const glm::dvec3 direction = rays[k].leave - rays[k].enter;
    const unsigned pair = bench::pair_of(direction);
    const glm::dvec3 p = bench::to_pair(pair, rays[k].enter), d = bench::to_pair(pair, direction);
    const glm::dvec3 a = p + (shape.first - p.z) / d.z * d, b = p + (shape.second - p.z) / d.z * d;
    const Axis axes[] = {
        axis(shape.first, shape.first_nodes, a.x), axis(shape.first, shape.first_nodes, a.y),
        axis(shape.second, shape.second_nodes, b.x), axis(shape.second, shape.second_nodes, b.y)};
    for (unsigned corner = 0; corner < 16; ++corner) {
      double weight = 1;
      std::int32_t node[4];
      std::uint64_t key = pair;
      for (unsigned n = 0; n < 4; ++n) {
        const bool up = corner >> n & 1;
        node[n] = axes[n].node + up;
        weight *= up ? axes[n].part : 1 - axes[n].part;
        key = key << 12 | static_cast<std::uint64_t>(node[n]);
      }
      const auto at = [&](double height, std::int32_t nodes, const std::int32_t* n) {
        return bench::from_pair(pair, {bench::node_at(height, nodes, n[0]),
                                       bench::node_at(height, nodes, n[1]), height});
      };
      taps[k][corner] = {samples.number(key, at(shape.first, shape.first_nodes, node),
                                        at(shape.second, shape.second_nodes, node + 2)),
                         weight};
    }
  }
  samples.trace();
  Image image = blank;
  expect(parallel_for(rays.size(), 0, [&](std::uint64_t k) {
    glm::dvec4 color(0);
    for (const Tap& tap : taps[k]) color += tap.weight * glm::dvec4(samples[tap.sample].rgba);
    image.rgba[rays[k].pixel] = glm::vec4(color);
  }));
  return image;
}

// ---- systems -------------------------------------------------------------------------------

/// A parameterisation; draws a view once for each of its modes.
struct System {
  std::string spec;
  double slabs = 0;
  std::vector<std::string> modes;
  std::function<std::vector<Image>(Samples&, const std::vector<Ray>&, const Image&)> draw;
};

std::vector<double> numbers_after(const std::string& spec, std::size_t count) {
  std::vector<double> numbers;
  for (std::size_t at = spec.find(':'); at != std::string::npos; at = spec.find(':', at + 1))
    numbers.push_back(std::atof(spec.c_str() + at + 1));
  if (numbers.size() != count)
    bench::stop(spec + ": expected " + std::to_string(count) + " numbers");
  return numbers;
}

System make_system(const std::string& spec) {
  if (spec.starts_with("planes:")) {
    const auto n = numbers_after(spec, 4);
    const bench::PlaneShape shape{n[0], n[1], static_cast<std::int32_t>(n[2]),
                                  static_cast<std::int32_t>(n[3])};
    return {spec,
            shape.nominal_slabs(),
            {"quadrilinear"},
            [shape](Samples& samples, const std::vector<Ray>& rays, const Image& blank) {
              return std::vector{draw_planes(shape, samples, rays, blank)};
            }};
  }
  const std::string kind = spec.substr(0, spec.find(':'));
  if (kind != "gnomonic" && kind != "equal-angle" && kind != "equal-area")
    bench::stop(spec + ": expected gnomonic, equal-angle, equal-area or planes");
  const SphereMapping mapping = kind == "gnomonic"      ? gnomonic()
                                : kind == "equal-angle" ? equal_angle()
                                                        : equal_area();
  const auto n = numbers_after(spec, 2);
  const Side entry(mapping, static_cast<std::int32_t>(n[0]));
  const Side exit(mapping, static_cast<std::int32_t>(n[1]));
  return {spec,
          entry.vertices() * exit.vertices(),
          {"bitri", "depth"},
          [=](Samples& samples, const std::vector<Ray>& rays, const Image& blank) {
            auto images = draw_sphere(entry, exit, samples, rays, blank, 2);
            return std::vector{images.front(), images.back()};
          }};
}

std::vector<Ray> rays_of(const Camera& camera, const Sphere& sphere) {
  const auto generator = expect(RayGenerator::make(camera));
  std::vector<Ray> rays;
  for (std::uint32_t y = 0; y < camera.height; ++y)
    for (std::uint32_t x = 0; x < camera.width; ++x) {
      const PixelRay ray = generator.ray(x, y);
      const Chord chord = intersect(sphere, ray.origin, ray.direction);
      if (!chord.hit || chord.leave <= 0) continue;
      const auto at = [&](double t) {
        return (ray.origin + t * ray.direction - sphere.center) / sphere.radius;
      };
      rays.push_back({std::size_t{y} * camera.width + x, at(chord.enter), at(chord.leave)});
    }
  return rays;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"PSNR of parameterisations of rays, straight from traced samples"};
  cli::SourceArguments source;
  std::vector<std::string> specs;
  std::uint32_t views = 4, size = 256;
  std::uint64_t seed = 1;
  double distance = 3;
  bool json = false;
  source.add_input_to(app, "VOLUME");
  source.add_to(app, [](const auto& option) { return option.use != recipe::Use::field; });
  app.add_option("--system", specs, "Parameterisations, as in the heading")->required();
  app.add_option("--views", views)->capture_default_str();
  app.add_option("--seed", seed)->capture_default_str();
  app.add_option("--size", size)->capture_default_str();
  app.add_option("--distance", distance)->capture_default_str();
  app.add_flag("--json", json);
  CLI11_PARSE(app, argc, argv);

  expect(source.finish(0, cli::OnSignal::end));
  const auto scene = expect(make_scene(source));
  const Sphere sphere = scene->bounds();
  const auto cameras = random_cameras(sphere, distance, views, seed, size, size);
  std::vector<Image> truths;
  for (const Camera& camera : cameras) truths.push_back(expect(trace_view(*scene, sphere, camera)));
  Image blank;
  blank.width = blank.height = size;
  blank.rgba.assign(std::size_t{size} * size, glm::vec4(0));

  nlohmann::json results = nlohmann::json::array();
  for (const std::string& spec : specs) {
    const System system = make_system(spec);
    Samples samples(*scene, sphere);
    std::vector<std::vector<double>> psnr(system.modes.size());
    for (std::size_t v = 0; v < cameras.size(); ++v) {
      const auto images = system.draw(samples, rays_of(cameras[v], sphere), blank);
      for (std::size_t m = 0; m < images.size(); ++m)
        psnr[m].push_back(compare(truths[v], images[m]).psnr);
    }
    nlohmann::json result{{"system", spec}, {"slabs", system.slabs}, {"traced", samples.traced()}};
    for (std::size_t m = 0; m < system.modes.size(); ++m) {
      double sum = 0;
      for (const double value : psnr[m]) sum += value;
      result["psnr"][system.modes[m]] = sum / static_cast<double>(psnr[m].size());
      result["per_view"][system.modes[m]] = psnr[m];
    }
    results.push_back(result);
    if (!json)
      std::printf("%-28s %7.1f M slabs  %s\n", spec.c_str(), system.slabs / 1e6,
                  result["psnr"].dump().c_str());
  }
  if (json) std::printf("%s\n", results.dump(2).c_str());
  return 0;
}

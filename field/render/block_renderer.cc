#include "field/render/block_renderer.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "field/render/ray_kernel.h"
#include "field/render/sample_kernel.h"

namespace slf {
namespace {

/// Rays are followed until their aims move, along the chord, by less than the entry lattice's
/// resolution times this (the closer the vertices, the less they see of it), or for so many rounds.
constexpr float kRest = 1.f / 2048;
constexpr int kRounds = 3;

/// Pass::spread in steps of the exit lattice: on slanted surfaces neighbours differ in depth, too.
constexpr float kSpread = 6.4f;

glm::dvec3 point(const PointArrays& points, std::size_t k) {
  return {points.x[k], points.y[k], points.z[k]};
}

void copy_ray(const RayBlock& from, std::size_t k, RayBlock& to, std::size_t n) {
  to.enter.x[n] = from.enter.x[k], to.enter.y[n] = from.enter.y[k], to.enter.z[n] = from.enter.z[k];
  to.leave.x[n] = from.leave.x[k], to.leave.y[n] = from.leave.y[k], to.leave.z[n] = from.leave.z[k];
  to.pixel[n] = from.pixel[k];
}

}  // namespace

BlockRenderer::BlockRenderer(const FieldFile& field, TileCache& cache, std::uint64_t pin_bytes,
                             const ViewOptions& options, const glm::dvec3& eye, Image& image,
                             Kept earlier)
    : field_(field),
      options_(options),
      eye_(eye),
      image_(image),
      cache_(cache),
      pin_bytes_(pin_bytes),
      earlier_(std::move(earlier)),
      gatherers_(options.level + 1) {
  earlier_.resize(gatherers_.size());
}

RayBlock& BlockRenderer::rays(std::size_t most_rays) {
  if (t_.size() < most_rays + kRayPadding) {
    for (auto& gatherer : gatherers_) gatherer.reset();
    most_rays_ = most_rays;
    rays_.resize(most_rays);
    missing_.resize(most_rays);
    entries_.resize(most_rays);
    const bool follow = options_.mode == RenderMode::depth;
    for (auto& aim : aims_) aim.resize(follow ? most_rays + kRayPadding : 0);
    for (auto& exit : exits_) exit.resize(most_rays);
    t_.resize(most_rays + kRayPadding);
  }
  return rays_;
}

TapGatherer& BlockRenderer::gatherer(unsigned level) {
  std::optional<TapGatherer>& place = gatherers_[level];
  if (!place) {
    // Half of the pins for the finest level, half of the rest for the next...
    const std::uint64_t share = pin_bytes_ >> (gatherers_.size() - level);
    place.emplace(field_, cache_, share, options_.needs_depth(), waits(level),
                  std::exchange(earlier_[level], {}));
    place->resize(most_rays_);
  }
  return *place;
}

void BlockRenderer::add_tiles_to(std::vector<TileKey>& touched, std::vector<TileKey>& wanted) {
  for (auto& gatherer : gatherers_) {
    if (!gatherer) continue;
    touched.insert(touched.end(), gatherer->touched().begin(), gatherer->touched().end());
    wanted.insert(wanted.end(), gatherer->wanted().begin(), gatherer->wanted().end());
  }
}

BlockRenderer::Kept BlockRenderer::keep() && {
  Kept kept(gatherers_.size());
  for (unsigned level = 0; level < kept.size(); ++level)
    if (gatherers_[level] && !waits(level)) kept[level] = std::move(*gatherers_[level]).keep();
  return kept;
}

Result<void> BlockRenderer::draw(std::vector<std::uint64_t>& level_pixels) {
  for (unsigned level = options_.level + 1; level-- > 0 && rays_.count > 0;) {
    missing_.count = 0;
    const std::size_t rays = rays_.count;
    gatherer_ = &gatherer(level);
    if (auto ok = draw_level(field_.geometry(level)); !ok) return ok;
    level_pixels[level] += rays - missing_.count;
    std::swap(rays_, missing_);
  }
  for (std::size_t k = 0; k < rays_.count; ++k) {  // not even level 0 has what they need
    image_.rgba[rays_.pixel[k]] = glm::vec4(0);
    if (options_.with_depth) image_.depth[rays_.pixel[k]] = std::numeric_limits<float>::infinity();
  }
  return {};
}

Result<void> BlockRenderer::draw_level(const LevelGeometry& geometry) {
  const RenderMode mode = options_.mode;
  Pass pass;
  pass.entries = mode == RenderMode::nearest || mode == RenderMode::st ? 1 : 3;
  pass.with_depth = options_.needs_depth();
  pass.preview = mode == RenderMode::depth;
  gatherer_->forget_missing();
  aim_where_rays_leave(geometry, pass);
  if (auto ok = look(geometry, pass); !ok || mode != RenderMode::depth) return ok;
  pass.spread = kSpread / static_cast<float>(geometry.exit_resolution());
  for (int round = 0; round < kRounds; ++round) {
    keep_moving(geometry);
    if (rays_.count == 0) break;
    aim_at_what_was_seen(geometry, pass);
    if (auto ok = look(geometry, pass); !ok) return ok;
  }
  return {};
}

void BlockRenderer::aim_where_rays_leave(const LevelGeometry& geometry, Pass& pass) {
  find_entries(geometry, rays_, pass.entries == 1, pass.with_depth, entries_);
  find_exits(geometry, rays_.leave, rays_.count,
             options_.mode == RenderMode::nearest || options_.mode == RenderMode::uv, exits_[0]);
  pass.aim.fill(&rays_.leave);
  pass.exit.fill(&exits_[0]);
}

void BlockRenderer::aim_at_what_was_seen(const LevelGeometry& geometry, Pass& pass) {
  aim_at_depth(rays_, entries_, aims_);
  for (std::size_t c = 0; c < 3; ++c) {
    find_exits(geometry, aims_[c], rays_.count, false, exits_[c]);
    pass.aim[c] = &aims_[c];
    pass.exit[c] = &exits_[c];
  }
}

/// Gathers what was aimed at and draws it.
Result<void> BlockRenderer::look(const LevelGeometry& geometry, const Pass& pass) {
  if (auto ok = gatherer_->gather(geometry, rays_.count, entries_, pass); !ok) return ok;
  blend(pass, rays_, entries_, gatherer_->samples(), gatherer_->half_floats(), image_.rgba.data(),
        t_.data());
  finish();
  return {};
}

/// Closes the ranks of the rays whose aims still move.
void BlockRenderer::keep_moving(const LevelGeometry& geometry) {
  if (gatherer_->any_missing())
    for (std::size_t k = 0; k < rays_.count; ++k)
      if (gatherer_->missing(k)) entries_.step[k] = 0;
  gatherer_->forget_missing();
  const std::size_t before = rays_.count;
  const float rest = kRest * static_cast<float>(geometry.entry_resolution());
  slf::keep_moving(rest, rays_, entries_, t_.data());
  if (rays_.count < before) find_entries(geometry, rays_, false, true, entries_);
}

/// What a pass leaves to do beside its colours: distances, and rays for a coarser level.
void BlockRenderer::finish() {
  if (!options_.with_depth && !gatherer_->any_missing()) return;
  for (std::size_t k = 0; k < rays_.count; ++k) {
    if (options_.with_depth) {
      const Sphere& sphere = field_.shape().sphere;
      const glm::dvec3 enter = point(rays_.enter, k), leave = point(rays_.leave, k);
      const glm::dvec3 seen =
          sphere.center + sphere.radius * (enter + double{t_[k]} * (leave - enter));
      const std::uint32_t pixel = rays_.pixel[k];
      image_.depth[pixel] = image_.rgba[pixel].a > 0 ? static_cast<float>(glm::distance(eye_, seen))
                                                     : std::numeric_limits<float>::infinity();
    }
    if (gatherer_->missing(k)) copy_ray(rays_, k, missing_, missing_.count++);
  }
}

}  // namespace slf

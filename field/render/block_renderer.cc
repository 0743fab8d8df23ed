#include "field/render/block_renderer.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>
#include <utility>

#include "base/try.h"
#include "field/render/blend_kernel.h"

namespace slf {
namespace {

constexpr float kNoDistance = std::numeric_limits<float>::infinity();

glm::dvec3 point(const PointArrays& points, std::size_t k) {
  return {points.x[k], points.y[k], points.z[k]};
}

void append_ray(const RayBlock& from, std::size_t k, RayBlock& to) {
  const std::size_t n = to.count++;
  to.enter.x[n] = from.enter.x[k], to.enter.y[n] = from.enter.y[k], to.enter.z[n] = from.enter.z[k];
  to.leave.x[n] = from.leave.x[k], to.leave.y[n] = from.leave.y[k], to.leave.z[n] = from.leave.z[k];
  to.pixel[n] = from.pixel[k];
}

}  // namespace

BlockRenderer::BlockRenderer(const FieldFile& field, TileCache& cache, std::uint64_t pin_bytes)
    : field_(field), gatherer_(field, cache, pin_bytes) {}

void BlockRenderer::begin(std::atomic<std::uint32_t>& frame, const ViewOptions& options,
                          const glm::dvec3& eye, Image& image) {
  options_ = options;
  eye_ = eye;
  image_ = &image;
  kept_ = KeptSpace(options.clip, field_.shape().sphere, eye);
  gatherer_.begin(frame, options.needs_depth());
  counts_.hit = 0;
  counts_.level.assign(options.level + 1, 0);
}

Result<void> BlockRenderer::draw(const CameraBasis& basis, const PixelBlock& block) {
  prefetch(block);
  cast_rays(basis, block, rays_);
  if (rays_.count < std::size_t{block.x1 - block.x0} * (block.y1 - block.y0)) clear(block);
  counts_.hit += rays_.count;
  cut_.count = 0;
  if (!kept_.all()) separate_cut_rays();
  for (unsigned level = options_.level + 1; level-- > 0 && rays_.count > 0;) {
    unavailable_.count = 0;
    const std::size_t rays = rays_.count;
    SLF_TRY(draw_level(field_.geometry(level)));
    counts_.level[level] += rays - unavailable_.count;
    std::swap(rays_, unavailable_);
  }
  for (std::size_t k = 0; k < rays_.count; ++k)  // rays that lack a tile even at level 0
    set_empty(rays_.pixel[k]);
  if (cut_.count > 0) trace_cut_rays();
  return {};
}

void BlockRenderer::set_empty(std::uint32_t pixel) {
  image_->rgba[pixel] = glm::vec4(0);
  if (options_.with_depth) image_->depth[pixel] = kNoDistance;
}

void BlockRenderer::separate_cut_rays() {
  const std::size_t count = std::exchange(rays_.count, 0);
  for (std::size_t k = 0; k < count; ++k) {
    const auto [begin, end] = kept_.of(point(rays_.enter, k), point(rays_.leave, k));
    if (begin < end && !(begin > 0 && options_.cap)) {
      append_ray(rays_, k, rays_);
      continue;
    }
    if (begin < end)
      append_ray(rays_, k, cut_);
    else
      set_empty(rays_.pixel[k]);
    ++counts_.level[options_.level];
  }
}

void BlockRenderer::trace_cut_rays() {
  const Sphere& sphere = field_.shape().sphere;
  std::array<Segment, kBlockRays> rays;
  std::array<RaySample, kBlockRays> samples;
  for (std::size_t k = 0; k < cut_.count; ++k)
    rays[k] = {kept_.eye_inside ? eye_ : sphere.center + sphere.radius * point(cut_.enter, k),
               sphere.center + sphere.radius * point(cut_.leave, k)};
  const std::size_t count = cut_.count;
  options_.cap->trace_many(std::span(rays).first(count), std::span(samples).first(count));
  for (std::size_t k = 0; k < count; ++k) {
    const auto& [from, to] = rays[k];
    const std::uint32_t pixel = cut_.pixel[k];
    set_empty(pixel);
    image_->rgba[pixel] = samples[k].rgba;
    if (options_.with_depth && samples[k].rgba.a > 0)
      image_->depth[pixel] =
          static_cast<float>(glm::distance(eye_, from + double{samples[k].depth} * (to - from)));
  }
}

/// Prefetches the cache lines of the pixels: pictures are larger than caches.
void BlockRenderer::prefetch(const PixelBlock& block) {
  constexpr std::uint32_t kLine = 64 / sizeof(glm::vec4);
  for (std::uint32_t y = block.y0; y < block.y1; ++y)
    for (std::uint32_t x = block.x0; x < block.x1; x += kLine)
      __builtin_prefetch(&image_->rgba[std::size_t{y} * image_->width + x], 1);
}

void BlockRenderer::clear(const PixelBlock& block) {
  for (std::uint32_t y = block.y0; y < block.y1; ++y) {
    const std::size_t row = std::size_t{y} * image_->width;
    std::memset(&image_->rgba[row + block.x0], 0, (block.x1 - block.x0) * sizeof(glm::vec4));
    if (options_.with_depth)
      std::fill(&image_->depth[row + block.x0], &image_->depth[row + block.x1 - 1] + 1,
                kNoDistance);
  }
}

Result<void> BlockRenderer::draw_level(const LevelGeometry& geometry) {
  const RenderMode mode = options_.mode;
  Pass pass;
  pass.entries = mode == RenderMode::nearest || mode == RenderMode::st ? 1 : 3;
  pass.with_depth = options_.needs_depth();
  pass.first_of_more = mode == RenderMode::depth;
  pass.exit_point.fill(&rays_.leave);
  pass.exit.fill(&exits_);
  locate_entries(geometry, rays_, pass.entries == 1, pass.with_depth, entries_);
  locate_exits(
      geometry, rays_.leave, rays_.count,
      mode == RenderMode::nearest || mode == RenderMode::uv ? ExitUse::nearest : ExitUse::all,
      exits_);
  SLF_TRY(gather_and_blend(geometry, pass));
  if (mode != RenderMode::depth) return {};
  refinement_.begin(geometry, pass);
  while (refinement_.next_pass(geometry, rays_, entries_, pass))
    SLF_TRY(gather_and_blend(geometry, pass));
  return {};
}

Result<void> BlockRenderer::gather_and_blend(const LevelGeometry& geometry, const Pass& pass) {
  const bool wait = options_.wait || geometry.level() == 0;
  SLF_TRY(gatherer_.gather(geometry, wait, rays_.count, entries_, pass));
  BlockSamples& samples = gatherer_.samples();
  const bool half_floats = gatherer_.half_floats();
  DepthEstimates& estimates = refinement_.estimates();
  glm::vec4* const picture = image_->rgba.data();
  const bool cuts = !kept_.all() && !pass.cubic;
  if (cuts) cut_samples(pass, rays_, entries_, kept_, half_floats, samples, became_);
  if (pass.cubic)
    add_cubic(pass, rays_, entries_, samples, half_floats, estimates, picture);
  else
    blend(pass, rays_, entries_, samples, half_floats, picture, estimates);
  if (options_.with_depth) write_distances();
  for (std::size_t k = 0; cuts && k < rays_.count; ++k) {
    const auto became = static_cast<CutRay>(became_[k]);
    if (became == CutRay::whole) continue;
    estimates.contrast[k] = 0;  // a cubic needs all samples
    if (became == CutRay::cut || !options_.cap || gatherer_.unavailable(k)) continue;
    append_ray(rays_, k, cut_);
    estimates.step[k] = 0;  // no further passes
  }
  if (gatherer_.any_unavailable())
    for (std::size_t k = 0; k < rays_.count; ++k)
      if (gatherer_.unavailable(k)) {
        append_ray(rays_, k, unavailable_);
        if (!pass.with_depth) continue;
        estimates.step[k] = estimates.contrast[k] = 0;  // no further passes here
      }
  return {};
}

void BlockRenderer::write_distances() {
  const Sphere& sphere = field_.shape().sphere;
  const RayArray<float>& t = refinement_.estimates().t;
  for (std::size_t k = 0; k < rays_.count; ++k) {
    const glm::dvec3 enter = point(rays_.enter, k), leave = point(rays_.leave, k);
    const glm::dvec3 seen =
        sphere.center + sphere.radius * (enter + double{t[k]} * (leave - enter));
    const std::uint32_t pixel = rays_.pixel[k];
    image_->depth[pixel] =
        image_->rgba[pixel].a > 0 ? static_cast<float>(glm::distance(eye_, seen)) : kNoDistance;
  }
}

}  // namespace slf

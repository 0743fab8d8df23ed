#include "benchmarks/plane/plane_field.h"

#include <algorithm>
#include <cmath>

#include "base/parallel.h"
#include "benchmarks/storage/expect.h"
#include "field/render/ray_block.h"

namespace slf::bench {
namespace {

std::uint32_t to_rgba8(const glm::vec4& v) {
  std::uint32_t packed = 0;
  for (int c = 0; c < 4; ++c)
    packed |= static_cast<std::uint32_t>(std::lround(std::clamp(v[c], 0.f, 1.f) * 255)) << 8 * c;
  return packed;
}

/// Calls f(x0, x1, y0, y1) for each block of a picture. Blocks have the size of slf's renderer.
template <class F>
void for_blocks(const Camera& camera, unsigned threads, const F& f) {
  const std::uint32_t across = (camera.width + kBlockWidth - 1) / kBlockWidth;
  const std::uint32_t down = (camera.height + kBlockHeight - 1) / kBlockHeight;
  expect(parallel_for(across * down, threads, [&](std::uint64_t block) {
    const auto x = static_cast<std::uint32_t>(block % across) * kBlockWidth;
    const auto y = static_cast<std::uint32_t>(block / across) * kBlockHeight;
    f(x, std::min(x + kBlockWidth, camera.width), y, std::min(y + kBlockHeight, camera.height));
  }));
}

}  // namespace

PlaneBasis PlaneField::basis(const Camera& camera) const {
  const auto rays = expect(RayGenerator::make(camera));
  const double scale = 1 / sphere_.radius;
  return {glm::vec3((rays.eye() - sphere_.center) * scale), glm::vec3(rays.corner() * scale),
          glm::vec3(rays.across() * scale), glm::vec3(rays.down() * scale), camera.width};
}

void PlaneField::prepare(const Camera& camera) {
  const PlaneBasis rays_basis = basis(camera);
  PlaneRays rays;
  rays.resize(kBlockRays);
  std::vector<std::size_t> wanted;
  for_blocks(camera, 1, [&](auto x0, auto x1, auto y0, auto y1) {
    locate_samples(shape_, rays_basis, x0, x1, y0, y1, rays);
    for (const auto& tiles : rays.tile)
      for (std::size_t k = 0; k < rays.count; ++k)
        if (std::uint32_t& at = tiles_[tiles[k]]; at == kUnknown) {
          at = static_cast<std::uint32_t>(samples_.size() / kTileSamples + wanted.size());
          wanted.push_back(tiles[k]);
        }
  });
  const std::size_t begin = samples_.size();
  samples_.resize(begin + wanted.size() * kTileSamples);
  expect(parallel_for(wanted.size(), 0, [&](std::uint64_t k) {
    trace(wanted[k], samples_.data() + begin + k * kTileSamples);
  }));
}

/// Slabs that miss the sphere are clear.
void PlaneField::trace(std::size_t tile, std::uint32_t* samples) const {
  const auto columns = static_cast<std::size_t>(grid_.column_blocks);
  const auto rows = static_cast<std::size_t>(grid_.row_blocks);
  const auto first_s = static_cast<std::int32_t>(tile % columns) << kColumnShift;
  const auto first_t = static_cast<std::int32_t>(tile / columns % columns) << kColumnShift;
  const std::size_t block = tile / (columns * columns);
  const auto first_u = static_cast<std::int32_t>(block % rows) << kRowShift;
  const auto first_v = static_cast<std::int32_t>(block / rows % rows) << kRowShift;
  const auto pair = static_cast<unsigned>(block / (rows * rows));

  std::vector<Segment> segments;
  std::vector<std::uint32_t*> to;
  for (std::int32_t row = 0; row < kTileRows; ++row)
    for (std::int32_t column = 0; column < kTileColumns; ++column) {
      const glm::dvec3 a =
          from_pair(pair, {node_at(shape_.first, shape_.first_nodes, first_u + row % kRowEdge),
                           node_at(shape_.first, shape_.first_nodes, first_v + row / kRowEdge),
                           shape_.first});
      const glm::dvec3 b = from_pair(
          pair, {node_at(shape_.second, shape_.second_nodes, first_s + column % kColumnEdge),
                 node_at(shape_.second, shape_.second_nodes, first_t + column / kColumnEdge),
                 shape_.second});
      const Chord chord = intersect({}, a, b - a);
      if (!chord.hit) continue;
      const auto world = [&](double t) {
        return sphere_.center + sphere_.radius * (a + t * (b - a));
      };
      segments.push_back({world(chord.enter), world(chord.leave)});
      to.push_back(samples + row * kTileColumns + column);
    }
  std::vector<RaySample> out(segments.size());
  scene_.trace_many(segments, out);
  for (std::size_t k = 0; k < out.size(); ++k) *to[k] = to_rgba8(out[k].rgba);
}

void PlaneField::render(const Camera& camera, unsigned threads, Image& image) const {
  image.width = camera.width, image.height = camera.height;
  image.rgba.resize(std::size_t{camera.width} * camera.height);
  const PlaneBasis rays_basis = basis(camera);
  for_blocks(camera, threads, [&](auto x0, auto x1, auto y0, auto y1) {
    thread_local PlaneRays rays;
    thread_local std::vector<glm::vec4> colors;
    rays.resize(kBlockRays);
    colors.resize(kBlockRays + kPadding);
    locate_samples(shape_, rays_basis, x0, x1, y0, y1, rays);
    if (rays.count < std::size_t{x1 - x0} * (y1 - y0))
      for (std::uint32_t y = y0; y < y1; ++y) {
        glm::vec4* row = image.rgba.data() + std::size_t{y} * camera.width;
        std::fill(row + x0, row + x1, glm::vec4(0));
      }
    blend(rays, tiles_.data(), samples_.data(), colors.data());
    for (std::size_t k = 0; k < rays.count; ++k) image.rgba[rays.pixel[k]] = colors[k];
  });
}

}  // namespace slf::bench

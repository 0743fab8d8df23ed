#include "source/mesh/surface.h"

#include <embree3/rtcore.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "base/try.h"
#include "slf/tone.h"
#include "source/mesh/normals.h"

namespace slf {
namespace {

constexpr double kMaxCoordinate = 1e12, kMinRadius = 1e-12;

const std::array<float, 256>& linear_of_byte() {
  static const auto table = [] {
    std::array<float, 256> t{};
    for (std::size_t k = 0; k < t.size(); ++k) t[k] = linear_from_srgb(static_cast<float>(k) / 255);
    return t;
  }();
  return table;
}

glm::vec4 linear(const glm::u8vec4& c) {
  const auto& t = linear_of_byte();
  return {t[c.r], t[c.g], t[c.b], static_cast<float>(c.a) / 255};
}

/// Bilinear, premultiplied by alpha, which opaque materials ignore.
glm::vec4 sample(const MeshTexture& texture, const MeshMaterial& material, const glm::vec2& uv) {
  const auto place = [](float coordinate, std::uint32_t size, MeshWrap wrap, std::int64_t(&k)[2]) {
    // A mesh may have any coordinates, and the sum of large ones overflows.
    double at = std::isfinite(coordinate) ? coordinate : 0.0;
    if (wrap == MeshWrap::repeat) at -= std::floor(at);
    if (wrap == MeshWrap::mirror) at = 1 - std::abs(at - 2 * std::floor(at / 2) - 1);
    const double x = std::clamp(at, 0.0, 1.0) * size - 0.5;
    const auto low = static_cast<std::int64_t>(std::floor(x));
    for (int side = 0; side < 2; ++side) {
      const std::int64_t n = size;
      k[side] = wrap == MeshWrap::repeat ? (low + side + n) % n
                                         : std::clamp<std::int64_t>(low + side, 0, n - 1);
    }
    return static_cast<float>(x - static_cast<double>(low));
  };
  std::int64_t x[2], y[2];
  const float u = place(uv.x, texture.width, material.wrap_u, x);
  const float v = place(uv.y, texture.height, material.wrap_v, y);
  const auto texel = [&](int column, int row) {
    const glm::vec4 color =
        linear(texture.texels[static_cast<std::size_t>(y[row] * texture.width + x[column])]);
    const float alpha = material.opacity == MeshOpacity::opaque ? 1 : color.a;
    return glm::vec4(alpha * glm::vec3(color), alpha);
  };
  return glm::mix(glm::mix(texel(0, 0), texel(1, 0), u), glm::mix(texel(0, 1), texel(1, 1), u), v);
}

/// From here on, what is translucent shows.
float least_alpha(const MeshMaterial& material) {
  return material.opacity == MeshOpacity::cutout ? material.cutoff : 1.f / 512;
}
/// From here on, what is translucent casts shadows.
float least_blocking_alpha(const MeshMaterial& material) {
  return material.opacity == MeshOpacity::cutout ? material.cutoff : 0.5f;
}

/// The corners of a triangle.
std::array<glm::dvec3, 3> corners_of(const Mesh& mesh, const glm::uvec3& t) {
  return {glm::dvec3(mesh.positions[t[0]]), glm::dvec3(mesh.positions[t[1]]),
          glm::dvec3(mesh.positions[t[2]])};
}

/// Its normal, twice as long as its area.
glm::dvec3 normal_of(const Mesh& mesh, const glm::uvec3& t) {
  const auto [a, b, c] = corners_of(mesh, t);
  return glm::cross(b - a, c - a);
}

template <class T>
T interpolate(const T& a, const T& b, const T& c, const glm::vec2& at) {
  return (1 - at.x - at.y) * a + at.x * b + at.y * c;
}

RTCRay make_ray(const glm::dvec3& from, const glm::dvec3& direction, double near, double far) {
  const glm::vec3 o(from), d(direction);
  return {o.x, o.y, o.z, static_cast<float>(near), d.x, d.y, d.z, 0, static_cast<float>(far),
          ~0u, 0,   0};
}

}  // namespace

Result<void> check_mesh(const Mesh& mesh) {
  const auto wrong = [&](const auto&... what) { return misuse(mesh.source, "mesh: ", what...); };
  const std::size_t vertices = mesh.positions.size();
  const auto fits = [&](std::size_t size) { return size == 0 || size == vertices; };
  if (mesh.triangles.empty()) return wrong("no triangles");
  if (mesh.triangles.size() > std::uint64_t{1} << 28) return wrong("more than 2^28 triangles");
  if (!fits(mesh.normals.size()) || !fits(mesh.uvs.size()) || !fits(mesh.colors.size()))
    return wrong(vertices, " positions, ", mesh.normals.size(), " normals, ", mesh.uvs.size(),
                 " uvs and ", mesh.colors.size(), " colors; expected as many, or none");
  for (std::size_t k = 0; k < vertices; ++k)
    for (int axis = 0; axis < 3; ++axis)
      if (!std::isfinite(mesh.positions[k][axis]))
        return bad_file(mesh.source, "vertex ", k, " is not finite");
  for (std::size_t k = 0; k < mesh.triangles.size(); ++k)
    for (int c = 0; c < 3; ++c)
      if (mesh.triangles[k][c] >= vertices)
        return wrong("triangle ", k, " has vertex ", mesh.triangles[k][c], " of ", vertices);
  if (!mesh.material_of.empty() && mesh.material_of.size() != mesh.triangles.size())
    return wrong(mesh.triangles.size(), " triangles have ", mesh.material_of.size(), " materials");
  for (const std::uint32_t m : mesh.material_of)
    if (m >= mesh.materials.size()) return wrong("material ", m, " of ", mesh.materials.size());
  for (const MeshMaterial& m : mesh.materials)
    if (m.texture && *m.texture >= mesh.textures.size())
      return wrong("material '", m.name, "' has texture ", *m.texture, " of ",
                   mesh.textures.size());
  for (const MeshTexture& t : mesh.textures)
    if (t.texels.empty() || t.texels.size() != std::size_t{t.width} * t.height)
      return wrong("texture '", t.name, "' of ", t.width, "x", t.height, " pixels has ",
                   t.texels.size());
  return {};
}

bool can_be_seen(const Mesh& mesh) {
  std::vector<float> most;  // alpha of each material with its texture
  for (const MeshMaterial& m : mesh.materials) {
    unsigned texel = m.texture ? 0 : 255;
    if (m.texture)
      for (const glm::u8vec4& t : mesh.textures[*m.texture].texels)
        texel = std::max<unsigned>(texel, t.a);
    most.push_back(m.color.a * static_cast<float>(texel) / 255);
  }
  for (std::size_t k = 0; k < mesh.triangles.size(); ++k) {
    const std::size_t index = mesh.material_of.empty() ? 0 : mesh.material_of[k];
    const MeshMaterial& m = mesh.materials[index];
    unsigned vertex = mesh.colors.empty() ? 255 : 0;
    for (int c = 0; c < 3 && !mesh.colors.empty(); ++c)
      vertex = std::max<unsigned>(vertex, mesh.colors[mesh.triangles[k][c]].a);
    if (m.opacity == MeshOpacity::opaque ||
        most[index] * static_cast<float>(vertex) / 255 >= least_alpha(m))
      return true;
  }
  return false;
}

/// Embree asks these whether a hit in a material that is not opaque counts.
struct MeshSurface::Filters {
  template <float (*least)(const MeshMaterial&)>
  static void from_alpha(const RTCFilterFunctionNArguments* a) {
    const MeshSurface& surface = *static_cast<const MeshSurface*>(a->geometryUserPtr);
    const auto& hit = *reinterpret_cast<const RTCHit*>(a->hit);
    const std::uint32_t triangle = static_cast<std::uint32_t>(surface.opaque_) + hit.primID;
    if (surface.raw_color(triangle, {hit.u, hit.v}).a < least(surface.material(triangle)))
      a->valid[0] = 0;
  }
};

Result<std::unique_ptr<MeshSurface>> MeshSurface::make(Mesh mesh) {
  if (mesh.materials.empty()) mesh.materials.emplace_back();
  SLF_TRY(check_mesh(mesh));
  if (!can_be_seen(mesh))
    return bad_file(mesh.source, "nothing can be seen: all of its materials are transparent");
  std::unique_ptr<MeshSurface> surface(new MeshSurface(std::move(mesh)));
  SLF_TRY(surface->place());
  surface->put_holes_last();
  surface->normals_ = corner_normals(surface->mesh_);
  surface->mesh_.normals = {};
  SLF_TRY(surface->make_tree());
  return surface;
}

MeshSurface::~MeshSurface() {
  if (tree_) rtcReleaseScene(tree_);
  if (device_) rtcReleaseDevice(device_);
}

Result<void> MeshSurface::place() {
  glm::dvec3 low(std::numeric_limits<double>::infinity()), high = -low;
  for (const glm::uvec3& t : mesh_.triangles)
    for (const glm::dvec3& p : corners_of(mesh_, t))
      low = glm::min(low, p), high = glm::max(high, p);
  for (int axis = 0; axis < 3; ++axis)
    if (const double most = std::max(-low[axis], high[axis]) + std::abs(mesh_.origin[axis]);
        most > kMaxCoordinate)
      return unsupported(mesh_.source, "coordinates reach ", most, "; expected up to ",
                         kMaxCoordinate, "; use larger units");
  const glm::dvec3 middle = (low + high) / 2.0;
  center_ = mesh_.origin + middle;
  double radius2 = 0;
  for (const glm::uvec3& t : mesh_.triangles)
    for (const glm::dvec3& p : corners_of(mesh_, t))
      radius2 = std::max(radius2, glm::dot(p - middle, p - middle));
  const double radius = std::sqrt(radius2);
  if (radius < kMinRadius)
    return unsupported(mesh_.source, "all triangles lie within ", radius,
                       " of one point; expected at least ", kMinRadius, "; use smaller units");
  bounds_ = {center_, 1.001 * radius};  // rays must not start in a triangle
  // A power of 2: only the subtraction rounds.
  unit_ = std::exp2(std::ceil(std::log2(radius)));
  for (glm::vec3& p : mesh_.positions) p = glm::vec3((glm::dvec3(p) - middle) / unit_);
  for (const glm::uvec3& t : mesh_.triangles) {
    const glm::dvec3 n = normal_of(mesh_, t);
    if (glm::dot(n, n) > 0) return {};
  }
  return bad_file(mesh_.source, "none of its ", mesh_.triangles.size(), " triangles has an area");
}

void MeshSurface::put_holes_last() {
  const std::size_t count = mesh_.triangles.size();
  if (mesh_.material_of.empty()) mesh_.material_of.assign(count, 0);
  const auto opaque = [&](std::uint32_t material) {
    return mesh_.materials[material].opacity == MeshOpacity::opaque;
  };
  std::vector<glm::uvec3> triangles;
  std::vector<std::uint32_t> materials;
  const bool holes = !std::ranges::all_of(mesh_.material_of, opaque);
  opaque_ = count;
  if (!holes) return;
  for (const bool wanted : {true, false}) {
    for (std::size_t k = 0; k < count; ++k)
      if (opaque(mesh_.material_of[k]) == wanted) {
        triangles.push_back(mesh_.triangles[k]);
        materials.push_back(mesh_.material_of[k]);
      }
    if (wanted) opaque_ = triangles.size();
  }
  mesh_.triangles = std::move(triangles);
  mesh_.material_of = std::move(materials);
}

Result<void> MeshSurface::make_tree() {
  // On one thread: its tree, and with it which of two triangles a ray meets on their common edge,
  // must not depend on the order in which threads finish.
  device_ = rtcNewDevice("threads=1");
  if (!device_)
    return fail(ErrorCode::failed, "Embree does not start (error ",
                static_cast<int>(rtcGetDeviceError(nullptr)), ")");
  tree_ = rtcNewScene(device_);
  rtcSetSceneFlags(tree_,
                   static_cast<RTCSceneFlags>(RTC_SCENE_FLAG_COMPACT | RTC_SCENE_FLAG_ROBUST));
  mesh_.positions.emplace_back(0);  // Embree reads 16 bytes of each
  const std::size_t count = mesh_.triangles.size();
  for (const bool holes : {false, true}) {
    const std::size_t first = holes ? opaque_ : 0, end = holes ? count : opaque_;
    if (first == end) continue;
    RTCGeometry part = rtcNewGeometry(device_, RTC_GEOMETRY_TYPE_TRIANGLE);
    rtcSetSharedGeometryBuffer(part, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                               mesh_.positions.data(), 0, sizeof(glm::vec3),
                               mesh_.positions.size() - 1);
    rtcSetSharedGeometryBuffer(part, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                               mesh_.triangles.data(), first * sizeof(glm::uvec3),
                               sizeof(glm::uvec3), end - first);
    if (holes) {
      rtcSetGeometryUserData(part, this);
      rtcSetGeometryIntersectFilterFunction(part, Filters::from_alpha<least_alpha>);
      rtcSetGeometryOccludedFilterFunction(part, Filters::from_alpha<least_blocking_alpha>);
    }
    rtcCommitGeometry(part);
    rtcAttachGeometryByID(tree_, part, holes ? 1 : 0);
    rtcReleaseGeometry(part);
  }
  rtcCommitScene(tree_);
  if (const RTCError error = rtcGetDeviceError(device_); error != RTC_ERROR_NONE)
    return fail(ErrorCode::failed, mesh_.source,
                ": Embree: ", error == RTC_ERROR_OUT_OF_MEMORY ? "out of memory" : "error ",
                error == RTC_ERROR_OUT_OF_MEMORY ? "" : std::to_string(error));
  return {};
}

std::optional<SurfacePoint> MeshSurface::first(const glm::dvec3& from, const glm::dvec3& direction,
                                               double near, double far) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  RTCRayHit found{};
  found.ray = make_ray(from, direction, near, far);
  found.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  rtcIntersect1(tree_, &context, &found);
  if (found.hit.geomID == RTC_INVALID_GEOMETRY_ID) return {};
  SurfacePoint point;
  point.triangle =
      found.hit.primID + (found.hit.geomID == 1 ? static_cast<std::uint32_t>(opaque_) : 0);
  // Where the ray crosses the triangle's plane, exactly (Möller, Trumbore 1997).
  const auto [p, b, c] = corners_of(mesh_, mesh_.triangles[point.triangle]);
  const glm::dvec3 e1 = b - p, e2 = c - p;
  const glm::dvec3 across = glm::cross(direction, e2);
  const double determinant = glm::dot(e1, across);
  point.back = determinant < 0;
  point.distance = found.ray.tfar;
  point.at = {found.hit.u, found.hit.v};
  if (determinant != 0) {
    const glm::dvec3 s = from - p, q = glm::cross(s, e1);
    const double distance = glm::dot(e2, q) / determinant;
    // Edge-on, the division has no digits left.
    if (std::abs(distance - point.distance) < 1e-4) {
      point.distance = distance;
      point.at = {glm::dot(s, across) / determinant, glm::dot(direction, q) / determinant};
    }
  }
  point.at = glm::clamp(point.at, 0.0, 1.0);
  if (const double sum = point.at.x + point.at.y; sum > 1) point.at /= sum;
  point.distance = std::clamp(point.distance, near, far);
  return point;
}

bool MeshSurface::blocked(const glm::dvec3& from, const glm::dvec3& direction, double far) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  RTCRay ray = make_ray(from, direction, 0, far);
  rtcOccluded1(tree_, &context, &ray);
  return ray.tfar < 0;
}

const MeshMaterial& MeshSurface::material(std::uint32_t triangle) const {
  return mesh_.materials[mesh_.material_of[triangle]];
}

glm::vec4 MeshSurface::raw_color(std::uint32_t triangle, const glm::vec2& at) const {
  const MeshMaterial& m = material(triangle);
  const glm::uvec3& t = mesh_.triangles[triangle];
  glm::vec4 color = m.color;
  if (!mesh_.colors.empty())
    color *= interpolate(linear(mesh_.colors[t[0]]), linear(mesh_.colors[t[1]]),
                         linear(mesh_.colors[t[2]]), at);
  if (m.texture && !mesh_.uvs.empty()) {
    const glm::vec2 uv = interpolate(mesh_.uvs[t[0]], mesh_.uvs[t[1]], mesh_.uvs[t[2]], at);
    const glm::vec4 texel = sample(mesh_.textures[*m.texture], m, uv);
    color.a *= texel.a;
    for (int c = 0; c < 3; ++c) color[c] *= texel.a > 0 ? texel[c] / texel.a : 0.f;
  }
  return color;
}

glm::vec4 MeshSurface::color(const SurfacePoint& point) const {
  glm::vec4 color = raw_color(point.triangle, glm::vec2(point.at));
  color.a = material(point.triangle).opacity == MeshOpacity::blend ? std::min(color.a, 1.f) : 1.f;
  return color;
}

glm::dvec3 MeshSurface::position(const SurfacePoint& point) const {
  const auto [a, b, c] = corners_of(mesh_, mesh_.triangles[point.triangle]);
  return a + point.at.x * (b - a) + point.at.y * (c - a);
}

glm::vec3 MeshSurface::normal(const SurfacePoint& point) const {
  const std::uint32_t* corners = normals_.data() + std::size_t{3} * point.triangle;
  const glm::vec3 n = interpolate(unpack_normal(corners[0]), unpack_normal(corners[1]),
                                  unpack_normal(corners[2]), glm::vec2(point.at));
  const float length = glm::length(n);
  if (!(length > 1e-6f)) return face_normal(point);
  return (point.back ? -1.f : 1.f) / length * n;
}

glm::vec3 MeshSurface::face_normal(const SurfacePoint& point) const {
  const glm::dvec3 n = normal_of(mesh_, mesh_.triangles[point.triangle]);
  const double length = glm::length(n);
  if (!(length > 0)) return {0, 0, 1};
  return glm::vec3((point.back ? -1.0 : 1.0) / length * n);
}

}  // namespace slf

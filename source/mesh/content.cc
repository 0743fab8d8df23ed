#include "base/content_hash.h"
#include "slf/mesh.h"

namespace slf {
namespace {

/// Adds a list with its length, so that no two series of lists look the same.
template <class T>
void add(ContentHash& hash, const std::vector<T>& values) {
  const std::uint64_t count = values.size();
  hash.add(std::as_bytes(std::span(&count, 1)));
  hash.add(std::as_bytes(std::span(values)));
}

void add(ContentHash& hash, std::initializer_list<double> numbers) {
  add(hash, std::vector<double>(numbers));
}

}  // namespace

std::string content_hash(const Mesh& mesh) {
  ContentHash hash;
  if (mesh.origin != glm::dvec3(0)) add(hash, {mesh.origin.x, mesh.origin.y, mesh.origin.z});
  add(hash, mesh.positions);
  add(hash, mesh.normals);
  add(hash, mesh.uvs);
  add(hash, mesh.colors);
  add(hash, mesh.triangles);
  add(hash, mesh.material_of);
  for (const MeshMaterial& m : mesh.materials)
    add(hash, {m.color.r, m.color.g, m.color.b, m.color.a,
               m.texture ? static_cast<double>(*m.texture) : -1.0, static_cast<double>(m.wrap_u),
               static_cast<double>(m.wrap_v), static_cast<double>(m.opacity), m.cutoff});
  for (const MeshTexture& t : mesh.textures) {
    add(hash, {static_cast<double>(t.width), static_cast<double>(t.height)});
    add(hash, t.texels);
  }
  return hash.text();
}

}  // namespace slf

#include <xxhash.h>

#include <memory>
#include <span>

#include "base/bytes.h"
#include "slf/mesh.h"

namespace slf {
namespace {

class Hash {
 public:
  Hash() : state_(XXH3_createState(), XXH3_freeState) { XXH3_128bits_reset(state_.get()); }

  /// Adds a list with its length, so that no two series of lists look the same.
  template <class T>
  void add(const std::vector<T>& values) {
    const std::uint64_t count = values.size();
    XXH3_128bits_update(state_.get(), &count, sizeof count);
    XXH3_128bits_update(state_.get(), values.data(), values.size() * sizeof(T));
  }
  void add(std::initializer_list<double> numbers) { add(std::vector<double>(numbers)); }

  [[nodiscard]] std::string text() const {
    XXH128_canonical_t canonical;
    XXH128_canonicalFromHash(&canonical, XXH3_128bits_digest(state_.get()));
    std::string hash = "xxh3-128:";
    for (const unsigned char byte : canonical.digest) {
      hash += "0123456789abcdef"[byte >> 4];
      hash += "0123456789abcdef"[byte & 15];
    }
    return hash;
  }

 private:
  std::unique_ptr<XXH3_state_t, XXH_errorcode (*)(XXH3_state_t*)> state_;
};

}  // namespace

std::string content_hash(const Mesh& mesh) {
  Hash hash;
  hash.add(mesh.positions);
  hash.add(mesh.normals);
  hash.add(mesh.uvs);
  hash.add(mesh.colors);
  hash.add(mesh.triangles);
  hash.add(mesh.material_of);
  for (const MeshMaterial& m : mesh.materials)
    hash.add({m.color.r, m.color.g, m.color.b, m.color.a,
              m.texture ? static_cast<double>(*m.texture) : -1.0, m.repeat_u ? 1.0 : 0.0,
              m.repeat_v ? 1.0 : 0.0, static_cast<double>(m.opacity), m.cutoff});
  for (const MeshTexture& t : mesh.textures) {
    hash.add({static_cast<double>(t.width), static_cast<double>(t.height)});
    hash.add(t.texels);
  }
  return hash.text();
}

}  // namespace slf

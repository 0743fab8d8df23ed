// The file of a light volume: a 16-byte head, the lengths and the numbers below in little-endian,
// the key, the nodes, and a hash of everything before it. A cache: no other version reads it.

#include <xxhash.h>

#include <bit>
#include <cstring>
#include <string_view>

#include "base/bytes.h"
#include "base/file.h"
#include "field/scene/light_volume.h"

namespace slf {
namespace {

constexpr std::string_view kMagic = "slf light v";  // of every version
constexpr std::string_view kHead = "slf light v5\n\0\0\0";
static_assert(std::endian::native == std::endian::little);

template <class T>
void append(Bytes& bytes, const T* from, std::size_t count) {
  const auto* begin = reinterpret_cast<const std::byte*>(from);
  bytes.insert(bytes.end(), begin, begin + count * sizeof(T));
}

/// Reads parts of bytes in sequence. False: too few bytes are left.
class Reader {
 public:
  explicit Reader(ByteSpan bytes) : bytes_(bytes) {}
  template <class T>
  bool take(T* to, std::size_t count) {
    if (bytes_.size() / sizeof(T) < count) return false;
    std::memcpy(to, bytes_.data(), count * sizeof(T));
    bytes_ = bytes_.subspan(count * sizeof(T));
    return true;
  }
  [[nodiscard]] std::size_t left() const { return bytes_.size(); }

 private:
  ByteSpan bytes_;
};

}  // namespace

Result<void> check_light_file(const std::string& path) {
  return check_own_file(resolve_links(path), kMagic, "a light volume");
}

Result<void> save_light(const std::string& path, const std::string& key, const LightGrid& light) {
  if (auto ok = check_light_file(path); !ok) return ok;
  Bytes bytes;
  const std::uint64_t key_size = key.size();
  append(bytes, kHead.data(), kHead.size());
  append(bytes, &key_size, 1);
  append(bytes, light.dims.data(), 3);
  append(bytes, &light.low.x, 3);
  append(bytes, &light.spacing, 1);
  append(bytes, key.data(), key.size());
  append(bytes, light.nodes.data(), light.nodes.size());
  const XXH64_hash_t hash = XXH3_64bits(bytes.data(), bytes.size());
  append(bytes, &hash, 1);
  return write_file(path, bytes);
}

std::optional<LightGrid> load_light(const std::string& path, const std::string& key) {
  constexpr std::uint64_t kMaxBytes = std::uint64_t{1} << 40;
  const auto take_head = [&key](Reader& in) {
    std::string head(kHead.size(), '\0');
    std::uint64_t key_size = 0;
    return in.take(head.data(), head.size()) && head == kHead && in.take(&key_size, 1) &&
           key_size == key.size();
  };
  // Not a byte more of a file that is something else: it may be large.
  const auto bytes = read_file(path, kMaxBytes, [&](ByteSpan start) -> Result<void> {
    Reader in(start);
    if (take_head(in)) return {};
    return fail(ErrorCode::bad_file, path, ": is not this light volume");
  });
  if (!bytes || bytes->size() < sizeof(XXH64_hash_t)) return std::nullopt;
  XXH64_hash_t hash = 0;
  const ByteSpan body = ByteSpan(*bytes).first(bytes->size() - sizeof hash);
  std::memcpy(&hash, body.data() + body.size(), sizeof hash);
  if (hash != XXH3_64bits(body.data(), body.size())) return std::nullopt;

  Reader in(body);
  std::string found_key(key.size(), '\0');
  LightGrid light;
  if (!take_head(in) || !in.take(light.dims.data(), 3) || !in.take(&light.low.x, 3) ||
      !in.take(&light.spacing, 1) || !in.take(found_key.data(), key.size()) || found_key != key)
    return std::nullopt;
  for (const std::int32_t side : light.dims)
    if (side < 1 || side > 65536) return std::nullopt;
  if (in.left() != light.size() * sizeof(std::uint32_t)) return std::nullopt;
  light.nodes.resize(light.size());
  if (!in.take(light.nodes.data(), light.nodes.size())) return std::nullopt;
  return light;
}

}  // namespace slf

#include "field/mesh/declared.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>
#include <string_view>
#include <vector>

#include "base/bytes.h"
#include "base/lower_case.h"
#include "base/try.h"

namespace slf {
namespace {

using nlohmann::json;

/// Elements of accessors that no bytes stand behind: zeros, or compressed.
constexpr std::uint64_t kMaxBareElements = std::uint64_t{1} << 27;
constexpr std::uint64_t kMaxJson = std::uint64_t{512} << 20;
constexpr std::size_t kMaxDepth = 500;  // of nodes: Assimp recurses

std::optional<std::uint64_t> count_of(const json& object, const char* member,
                                      std::optional<std::uint64_t> otherwise = {}) {
  const auto found = object.is_object() ? object.find(member) : object.end();
  if (!object.is_object() || found == object.end()) return otherwise;
  if (!found->is_number_unsigned()) return {};
  return found->get<std::uint64_t>();
}

/// The member, or an empty list.
const json& list_of(const json& object, const char* member) {
  static const json kEmpty = json::array();
  const auto found = object.is_object() ? object.find(member) : object.end();
  return object.is_object() && found != object.end() && found->is_array() ? *found : kEmpty;
}

class GltfCheck {
 public:
  GltfCheck(const std::string& path, const json& gltf, std::uint64_t file_bytes)
      : path_(path), gltf_(gltf), file_bytes_(file_bytes) {}

  Result<void> check() const {
    const json asset = gltf_.is_object() ? gltf_.value("asset", json()) : json();
    const json version = asset.is_object() ? asset.value("version", json()) : json();
    if (!version.is_string()) return wrong("no asset.version: not a glTF file");
    if (version.get<std::string>().substr(0, 2) != "2.")
      return fail(ErrorCode::unsupported, path_, ": glTF ", version.get<std::string>(),
                  "; glTF 2 is read");
    for (const auto check :
         {&GltfCheck::extensions, &GltfCheck::nodes, &GltfCheck::views, &GltfCheck::accessors})
      SLF_TRY((this->*check)());
    return {};
  }

 private:
  template <class... Parts>
  tl::unexpected<Error> wrong(const Parts&... parts) const {
    return fail(ErrorCode::bad_file, path_, ": glTF: ", parts...);
  }

  Result<void> extensions() const {
    for (const json& name : list_of(gltf_, "extensionsRequired")) {
      const std::string text = name.is_string() ? name.get<std::string>() : "?";
      if (!text.starts_with("KHR_materials_") && text != "KHR_texture_transform" &&
          text != "KHR_lights_punctual" && text != "KHR_draco_mesh_compression")
        return fail(ErrorCode::unsupported, path_, ": requires the glTF extension ", text,
                    ", which is not read; export it without");
    }
    return {};
  }

  Result<void> nodes() const {
    const json& all = list_of(gltf_, "nodes");
    std::vector<std::size_t> parents(all.size(), all.size());
    for (std::size_t k = 0; k < all.size(); ++k)
      for (const json& child : list_of(all[k], "children")) {
        const bool known = child.is_number_unsigned() && child.get<std::uint64_t>() < all.size();
        if (!known) return wrong("node ", k, " has a child that is no node");
        std::size_t& parent = parents[child.get<std::size_t>()];
        if (parent != all.size())
          return wrong("node ", child.get<std::size_t>(), " has two parents, ", parent, " and ", k);
        parent = k;
      }
    // Depth from the roots; nodes in a cycle never get one.
    std::vector<std::size_t> level;
    for (std::size_t k = 0; k < all.size(); ++k)
      if (parents[k] == all.size()) level.push_back(k);
    std::size_t reached = level.size();
    for (std::size_t depth = 1; !level.empty(); ++depth) {
      if (depth > kMaxDepth)
        return fail(ErrorCode::unsupported, path_, ": glTF: nodes are nested more than ", kMaxDepth,
                    " deep");
      std::vector<std::size_t> next;
      for (const std::size_t k : level)
        for (const json& child : list_of(all[k], "children"))
          next.push_back(child.get<std::size_t>());
      reached += next.size();
      level = std::move(next);
    }
    if (reached < all.size()) return wrong("a node is its own ancestor");
    return {};
  }

  Result<void> views() const {
    const json& buffers = list_of(gltf_, "buffers");
    const json& all = list_of(gltf_, "bufferViews");
    for (std::size_t k = 0; k < buffers.size(); ++k) {
      const auto bytes = count_of(buffers[k], "byteLength");
      if (!bytes) return wrong("buffer ", k, " has no byteLength");
      if (!buffers[k].contains("uri") && *bytes > file_bytes_)
        return wrong("buffer ", k, " has ", *bytes, " bytes, the file ", file_bytes_,
                     ": truncated");
    }
    for (std::size_t k = 0; k < all.size(); ++k) {
      const auto buffer = count_of(all[k], "buffer"), offset = count_of(all[k], "byteOffset", 0),
                 bytes = count_of(all[k], "byteLength");
      if (!buffer || *buffer >= buffers.size() || !offset || !bytes)
        return wrong("bufferView ", k, " is not a part of a buffer");
      const std::uint64_t whole = *count_of(buffers[*buffer], "byteLength");
      if (*offset > whole || *bytes > whole - *offset)
        return wrong("bufferView ", k, " extends beyond its buffer");
    }
    return {};
  }

  Result<void> accessors() const {
    const json& views = list_of(gltf_, "bufferViews");
    const json& all = list_of(gltf_, "accessors");
    std::uint64_t bare = 0;
    for (std::size_t k = 0; k < all.size(); ++k) {
      const auto count = count_of(all[k], "count"), offset = count_of(all[k], "byteOffset", 0),
                 type = count_of(all[k], "componentType");
      const json name = all[k].is_object() ? all[k].value("type", json()) : json();
      std::uint64_t size = 0;
      for (const auto& [text, components] : kTypes)
        if (name == text) size = components;
      if (!count || !offset || !type || size == 0) return wrong("accessor ", k, " is malformed");
      size *= *type == 5120 || *type == 5121 ? 1 : *type == 5122 || *type == 5123 ? 2 : 4;
      if (!all[k].contains("bufferView")) {
        bare += std::min(*count, kMaxBareElements + 1);
        continue;
      }
      const auto view = count_of(all[k], "bufferView");
      if (!view || *view >= views.size()) return wrong("accessor ", k, " has no such bufferView");
      const std::uint64_t whole = *count_of(views[*view], "byteLength");
      const std::uint64_t step = count_of(views[*view], "byteStride", size).value_or(size);
      if (*count == 0 || *count > whole || *offset > whole || step > 255 ||
          *offset + step * (*count - 1) + size > whole)
        return wrong("accessor ", k, ", ", *count, " elements of ", size,
                     " bytes, extends beyond its bufferView of ", whole, " bytes");
    }
    if (bare > kMaxBareElements)
      return fail(ErrorCode::unsupported, path_, ": glTF: more than ", kMaxBareElements,
                  " elements of accessors without data");
    return {};
  }

  static constexpr std::array<std::pair<std::string_view, std::uint64_t>, 7> kTypes{{{"SCALAR", 1},
                                                                                     {"VEC2", 2},
                                                                                     {"VEC3", 3},
                                                                                     {"VEC4", 4},
                                                                                     {"MAT2", 4},
                                                                                     {"MAT3", 9},
                                                                                     {"MAT4", 16}}};
  const std::string& path_;
  const json& gltf_;
  std::uint64_t file_bytes_;
};

Result<void> check_gltf(const std::string& path, std::istream& file, std::uint64_t bytes,
                        bool binary) {
  std::uint64_t size = bytes;
  if (binary) {
    std::array<char, 20> head{};
    file.read(head.data(), head.size());
    const auto word = [&](std::size_t k) {
      return load_le<std::uint32_t>(reinterpret_cast<const std::byte*>(head.data()) + 4 * k);
    };
    if (file.gcount() < 20) return fail(ErrorCode::bad_file, path, ": truncated in its header");
    if (word(2) > bytes)
      return fail(ErrorCode::bad_file, path, ": its header says ", word(2), " bytes, it has ",
                  bytes, ": truncated; copy it again");
    size = word(3);
    if (size > bytes - 20 || word(4) != 0x4E4F534A)
      return fail(ErrorCode::bad_file, path, ": glTF: the first chunk is not JSON");
  }
  if (size > kMaxJson)
    return fail(ErrorCode::unsupported, path, ": has ", size, " bytes of JSON; up to ", kMaxJson,
                " are read; export it as .glb");
  std::string text(size, '\0');
  file.read(text.data(), static_cast<std::streamsize>(size));
  const json gltf = json::parse(text, nullptr, /*allow_exceptions=*/false);
  if (gltf.is_discarded())
    return fail(ErrorCode::bad_file, path, ": glTF: its JSON is damaged or truncated");
  return GltfCheck(path, gltf, bytes).check();
}

/// Checks that a PLY file has at least the bytes that its elements need.
Result<void> check_ply(const std::string& path, std::istream& file, std::uint64_t bytes) {
  const auto size_of = [](const std::string& type) -> std::uint64_t {
    if (type == "char" || type == "uchar" || type == "int8" || type == "uint8") return 1;
    if (type == "short" || type == "ushort" || type == "int16" || type == "uint16") return 2;
    return type == "double" || type == "float64" ? 8 : 4;
  };
  bool ascii = true;
  std::uint64_t needed = 0, count = 0, header = 0;
  std::string line;
  while (std::getline(file, line) && header < (1 << 20)) {
    header += line.size() + 1;
    std::istringstream words(line);
    std::string word, type;
    words >> word >> type;
    if (word == "format") ascii = type == "ascii";
    if (word == "element") {
      count = 0;
      if (!(words >> count) || count > bytes)
        return fail(ErrorCode::bad_file, path, ": says that it has ", count, " elements '", type,
                    "', but it has only ", bytes, " bytes: damaged or truncated");
    }
    if (word == "property") {
      std::string length;
      if (type == "list") words >> length;
      // A number and a space or line feed, or, of a list, at least its length.
      needed += count * (ascii ? 2 : size_of(type == "list" ? length : type));
    }
    // Assimp does not return from a header whose end it does not find.
    if (line.substr(0, line.find_last_not_of(" \t\r") + 1) == "end_header" && !file.eof()) {
      if (needed == 0 || header + needed <= bytes + 1) return {};
      return fail(ErrorCode::bad_file, path, ": its elements need at least ", needed,
                  " bytes after the header, but there are ", bytes - std::min(bytes, header),
                  ": truncated; copy it again");
    }
  }
  return fail(ErrorCode::bad_file, path, ": PLY: its header does not end");
}

Result<void> check_stl(const std::string& path, std::istream& file, std::uint64_t bytes) {
  std::array<char, 84> head{};
  file.read(head.data(), head.size());
  const auto count = load_le<std::uint32_t>(reinterpret_cast<const std::byte*>(head.data()) + 80);
  const std::uint64_t expected = 84 + std::uint64_t{50} * count;
  if (expected == bytes) return {};
  if (std::string_view(head.data(), 5) != "solid") {
    if (bytes >= 84 && bytes > expected) return {};  // some programs append their own data
    return fail(ErrorCode::bad_file, path, ": STL: says ", count, " triangles, which need ",
                expected, " bytes, but it has ", bytes, ": truncated; copy it again");
  }
  file.clear();
  file.seekg(-static_cast<std::streamoff>(std::min<std::uint64_t>(bytes, 4096)), std::ios::end);
  const std::string end(std::istreambuf_iterator<char>(file), {});
  if (end.find("endsolid") != std::string::npos) return {};
  return fail(ErrorCode::bad_file, path, ": STL: does not end with 'endsolid': truncated");
}

}  // namespace

Result<void> check_declared(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::error_code error;
  const std::uint64_t bytes = std::filesystem::file_size(path, error);
  std::array<char, 4> magic{};
  file.read(magic.data(), magic.size());
  if (!file && !file.eof()) return fail(ErrorCode::io, path, ": cannot be read");
  if (bytes == 0) return fail(ErrorCode::bad_file, path, ": is empty (0 bytes)");
  file.clear();
  file.seekg(0);
  const std::string extension = lower_case(std::filesystem::path(path).extension());
  const std::string_view start(magic.data(), magic.size());
  if (start == "glTF" || extension == ".glb" || extension == ".gltf")
    return check_gltf(path, file, bytes, start == "glTF");
  // Assimp accepts any case, and does not end if such a header does not.
  if (lower_case(std::string(start.substr(0, 3))) == "ply" || extension == ".ply")
    return check_ply(path, file, bytes);
  if (extension == ".stl") return check_stl(path, file, bytes);
  return {};
}

}  // namespace slf

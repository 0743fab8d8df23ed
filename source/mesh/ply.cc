// PLY, as text and in both byte orders.
#include <algorithm>
#include <array>

#include "base/ascii.h"
#include "base/try.h"
#include "source/mesh/builder.h"
#include "source/volume/fields.h"
#include "source/volume/io.h"

namespace slf {
namespace {

using volume_io::parse_number;

struct Property {
  std::string name;
  ScalarType type = ScalarType::f32;
  std::optional<ScalarType> length{};  // of a list
};

struct Element {
  std::string name;
  std::uint64_t count = 0;
  std::vector<Property> properties{};

  /// The first property with one of these names, or -1.
  [[nodiscard]] int find(std::initializer_list<std::string_view> names) const {
    for (const std::string_view wanted : names)
      for (std::size_t k = 0; k < properties.size(); ++k)
        if (properties[k].name == wanted) return static_cast<int>(k);
    return -1;
  }
};

/// The largest numbers of colours and of alpha, see color_scale().
struct ColorScales {
  double color = 1, alpha = 1;
};

/// The places of red, green, blue and alpha in an element, or -1.
std::array<int, 4> find_color(const Element& element) {
  std::array<int, 4> places{element.find({"red", "diffuse_red", "r"}),
                            element.find({"green", "diffuse_green", "g"}),
                            element.find({"blue", "diffuse_blue", "b"}), element.find({"alpha"})};
  if (places[0] < 0 || places[1] < 0 || places[2] < 0) places.fill(-1);
  return places;
}

class PlyReader {
 public:
  PlyReader(ByteSpan bytes, MeshBuilder& to) : rest_(chars_of(bytes)), to_(to) {}

  Result<void> read() {
    SLF_TRY(read_header());
    const auto faces = std::ranges::count_if(elements_, [](const Element& e) {
      return e.count > 0 && (e.name == "face" || e.name == "tristrips");
    });
    const auto points =
        std::ranges::find_if(elements_, [](const Element& e) { return e.name == "vertex"; });
    if (points == elements_.end() || points->count == 0) return to_.wrong("PLY: has no vertices");
    for (const Element& e : elements_) SLF_TRY(check_size(e));
    if (faces == 0) {
      const bool splats = points->find({"f_dc_0"}) >= 0 && points->find({"scale_0"}) >= 0;
      return to_.error(ErrorCode::unsupported, "holds ", points->count,
                       splats
                           ? " Gaussian splats, which are not read"
                           : " points and no faces; only faces are shown: make a surface of them "
                             "first");
    }
    bool mapped = points->find({"s", "u", "texture_u"}) >= 0;
    SLF_TRY(read_wedges());
    for (const Element& e : elements_) {
      const bool known = e.name == "vertex" || e.name == "face" || e.name == "tristrips" ||
                         e.name.starts_with("multi_texture_");
      if (!known && e.count > 0) to_.note("its elements '" + e.name + "' are not read");
      const bool own = e.name == "face" && (e.find({"texcoord"}) >= 0 || !wedges_.empty());
      mapped = mapped || own;
      const bool painted = e.name == "face" && find_color(e)[0] >= 0;
      if (painted && find_color(*points)[0] >= 0)
        to_.note("colours of faces are left out: vertices have others");
      faces_own_ = faces_own_ || own || painted;
    }
    SLF_TRY(read_materials(mapped));
    for (const Element& element : elements_) SLF_TRY(read_element(element));
    Mesh& mesh = to_.mesh();
    const auto plain = static_cast<std::uint32_t>(mesh.materials.size() - 1);
    if (plain > 0 && std::ranges::find(mesh.material_of, plain) == mesh.material_of.end())
      mesh.materials.pop_back();
    for (MeshMaterial& m : mesh.materials)
      if (mesh.textures.empty() && mesh.colors.empty())
        m.color = glm::vec4(glm::vec3(kPlainColor), 1);
    return {};
  }

 private:
  Result<void> read_header() {
    const bool only_cr = rest_.find_first_of("\r\n") < rest_.size() &&
                         rest_[rest_.find_first_of("\r\n")] == '\r' &&
                         !rest_.substr(rest_.find('\r')).starts_with("\r\n");
    bool known = false;
    for (int number = 0; !rest_.empty(); ++number) {
      // In a binary file the first byte of data may be a line feed.
      const std::size_t end = rest_.find(only_cr ? '\r' : '\n');
      if (end == rest_.npos) break;
      std::string_view words = trim(rest_.substr(0, end));
      rest_.remove_prefix(end + 1);
      const std::string line(words);
      const std::string word(next_word(words));
      const auto malformed = [&] { return to_.wrong("PLY: malformed header line '", line, "'"); };
      if (word == "format") {
        const std::string_view name = next_word(words);
        known = true;
        ascii_ = name == "ascii";
        big_endian_ = name == "binary_big_endian";
        if (!ascii_ && !big_endian_ && name != "binary_little_endian") return malformed();
      } else if (word == "comment") {
        if (lower_case(next_word(words)) == "texturefile") textures_.emplace_back(trim(words));
      } else if (word == "element") {
        const std::string_view name = next_word(words);
        const auto count = parse_number(next_word(words));
        if (!count || !(*count >= 0 && *count < 1e15)) return malformed();
        elements_.push_back({std::string(name), static_cast<std::uint64_t>(*count)});
      } else if (word == "property") {
        std::string_view type = next_word(words);
        std::optional<ScalarType> length;
        if (type == "list") {
          const auto stated = parse_scalar_type(next_word(words));
          if (!stated) return malformed();
          length = *stated;
          type = next_word(words);
        }
        const auto own = parse_scalar_type(type);
        if (!own || elements_.empty()) return malformed();
        elements_.back().properties.push_back({lower_case(next_word(words)), *own, length});
      } else if (word == "end_header") {
        return known ? Result<void>() : to_.wrong("PLY: its header has no format");
      } else if (number > 0 && !word.empty() && word != "obj_info") {
        return malformed();
      }
    }
    return to_.wrong("PLY: its header does not end");
  }

  /// Whether there are as many bytes as the elements need at least.
  [[nodiscard]] Result<void> check_size(const Element& element) const {
    std::uint64_t least = 0;
    for (const Property& p : element.properties)
      least += ascii_ ? 2 : bytes_per_voxel(p.length.value_or(p.type));
    if (element.count * least > rest_.size() + 1)
      return to_.wrong("says that it has ", element.count, " elements '", element.name,
                       "', but it has only ", rest_.size(),
                       " bytes after its header: truncated, or damaged; copy it again");
    return {};
  }

  Result<void> read_materials(bool mapped) {
    if (!textures_.empty() && !mapped)
      to_.note("its texture " + textures_.front() +
               " is not used: neither vertices nor faces have texture coordinates");
    if (textures_.empty() && mapped)
      to_.note("it has texture coordinates, but no comment 'TextureFile' that names a texture");
    if (!mapped) textures_.clear();
    textures_.emplace_back();  // of faces without one
    for (const std::string& name : textures_) {
      MeshMaterial to;
      if (!name.empty()) to.texture = SLF_TRY(to_.texture(name));
      to_.mesh().materials.push_back(to);
    }
    return {};
  }

  /// One number of the data. False: there is none.
  bool take(ScalarType type, double& value) {
    if (ascii_) {
      const auto number = parse_number(next_word(rest_));
      value = number.value_or(0);
      return number.has_value();
    }
    const std::size_t size = bytes_per_voxel(type);
    if (rest_.size() < size) return false;
    value = volume_io::Fields{rest_, big_endian_}.number(type, 0);
    rest_.remove_prefix(size);
    return true;
  }

  /// The numbers of an element, by property.
  struct Row {
    std::vector<double> values;
    std::vector<std::vector<double>> lists;
    [[nodiscard]] double value(int k) const {
      return k < 0 ? 0 : values[static_cast<std::size_t>(k)];
    }
    [[nodiscard]] const std::vector<double>& list(int k) const {
      static const std::vector<double> kEmpty;
      return k < 0 ? kEmpty : lists[static_cast<std::size_t>(k)];
    }
  };

  /// Calls visit(number, row) for each of its kind, which returns a Result<void>.
  template <class Visit>
  Result<void> read_rows(const Element& element, const Visit& visit) {
    const std::size_t width = element.properties.size();
    Row row{std::vector<double>(width), std::vector<std::vector<double>>(width)};
    for (std::uint64_t k = 0; width > 0 && k < element.count && !to_.full(); ++k) {
      for (std::size_t p = 0; p < width; ++p) {
        const Property& property = element.properties[p];
        double length = 0;
        bool good =
            property.length ? take(*property.length, length) : take(property.type, row.values[p]);
        // In text a number takes two characters.
        if (!(length >= 0 && length <= static_cast<double>(rest_.size()))) good = false;
        row.lists[p].clear();
        for (std::size_t i = 0; good && i < static_cast<std::size_t>(length); ++i)
          good = take(property.type, row.lists[p].emplace_back());
        if (!good)
          return to_.wrong("PLY: element '", element.name, "' ", k, ", property '", property.name,
                           "': ", rest_.empty() ? "truncated; copy the file again" : "malformed");
      }
      SLF_TRY(visit(k, row));
    }
    return {};
  }

  /// Texture coordinates as Artec's programs write them, in elements of their own, which may stand
  /// behind the faces.
  Result<void> read_wedges() {
    if (std::ranges::find(elements_, "multi_texture_face", &Element::name) == elements_.end())
      return {};
    const std::string_view data = rest_;
    std::vector<glm::dvec2> places;
    const auto face_element = std::ranges::find(elements_, "face", &Element::name);
    const std::uint64_t faces = face_element == elements_.end() ? 0 : face_element->count;
    for (const Element& element : elements_) {
      const int u = element.find({"u"}), v = element.find({"v"}), face = element.find({"tn"}),
                texture = element.find({"tx"}), indices = element.find({"texture_vertex_indices"});
      SLF_TRY(read_rows(element, [&](std::uint64_t k, const Row& row) -> Result<void> {
        if (element.name == "multi_texture_vertex") places.emplace_back(row.value(u), row.value(v));
        if (element.name != "multi_texture_face") return {};
        const double number = face < 0 ? static_cast<double>(k) : row.value(face);
        if (!(number >= 0 && number < static_cast<double>(faces)))
          return to_.wrong("PLY: texture coordinates are of face ", number, " of ", faces);
        wedges_.resize(faces);
        Wedges& to = wedges_[static_cast<std::size_t>(number)];
        to = {{}, row.value(texture)};
        for (const double index : row.list(indices)) {
          if (!(index >= 0 && index < static_cast<double>(places.size())))
            return to_.wrong("PLY: face ", number, " has texture coordinate ", index, " of ",
                             places.size());
          const glm::dvec2& at = places[static_cast<std::size_t>(index)];
          to.uvs.insert(to.uvs.end(), {at.x, at.y});
        }
        return {};
      }));
    }
    rest_ = data;
    return {};
  }

  /// What the colours of an element run to. Only bytes tell by their type.
  Result<ColorScales> color_scales(const Element& element, const std::array<int, 4>& color) {
    const auto is_byte = [&](int k) {
      return k < 0 || bytes_per_voxel(element.properties[static_cast<std::size_t>(k)].type) == 1;
    };
    const auto is_float = [&](int k) {
      return k >= 0 && element.properties[static_cast<std::size_t>(k)].type >= ScalarType::f32;
    };
    ColorScales largest{is_float(color[0]) ? 0.0 : 255.0, is_float(color[3]) ? 0.0 : 255.0};
    if (!std::ranges::all_of(color, is_byte)) {
      const std::string_view data = rest_;
      SLF_TRY(read_rows(element, [&](std::uint64_t, const Row& row) -> Result<void> {
        for (std::size_t c = 0; c < 3; ++c)
          largest.color = std::max(largest.color, row.value(color[c]));
        largest.alpha = std::max(largest.alpha, row.value(color[3]));
        return {};
      }));
      rest_ = data;
    }
    return ColorScales{color_scale(largest.color), color_scale(largest.alpha)};
  }

  Result<void> read_element(const Element& element) {
    const bool vertex = element.name == "vertex", face = element.name == "face",
               strips = element.name == "tristrips";
    const std::array<int, 3> position{element.find({"x"}), element.find({"y"}),
                                      element.find({"z"})};
    if (vertex && *std::ranges::min_element(position) < 0)
      return to_.wrong("PLY: its vertices have no x, y and z");
    const std::array<int, 3> normal{element.find({"nx"}), element.find({"ny"}),
                                    element.find({"nz"})};
    const std::array<int, 2> uv{element.find({"s", "u", "texture_u"}),
                                element.find({"t", "v", "texture_v"})};
    const std::array<int, 4> color = find_color(element);
    const int indices = element.find({"vertex_indices", "vertex_index"}),
              coordinates = element.find({"texcoord"}), texture = element.find({"texnumber"});
    const ColorScales scales = SLF_TRY(color_scales(element, color));
    const auto color_of = [&](const Row& row) -> std::optional<glm::u8vec4> {
      if (color[0] < 0) return {};
      glm::dvec4 rgba(row.value(color[0]), row.value(color[1]), row.value(color[2]), scales.alpha);
      if (color[3] >= 0) rgba.a = row.value(color[3]);
      return color_bytes(rgba / glm::dvec4(scales.color, scales.color, scales.color, scales.alpha),
                         false);
    };
    return read_rows(element, [&](std::uint64_t k, const Row& row) -> Result<void> {
      const auto value = [&](int place) { return row.value(place); };
      if (vertex) {
        MeshVertex v{{value(position[0]), value(position[1]), value(position[2])}};
        if (normal[0] >= 0 && normal[1] >= 0 && normal[2] >= 0)
          v.normal = glm::vec3(value(normal[0]), value(normal[1]), value(normal[2]));
        if (uv[0] >= 0 && uv[1] >= 0) v.uv = glm::vec2(value(uv[0]), 1 - value(uv[1]));
        v.color = color_of(row);
        colored_ = color[0] >= 0;
        if (faces_own_)
          vertices_.push_back(v);
        else
          to_.add(v);
      } else if (face) {
        const Wedges* wedges = k < wedges_.size() ? &wedges_[k] : nullptr;
        const double number = wedges ? wedges->texture : value(texture);
        const double last = static_cast<double>(textures_.size()) - 1;
        const bool known = number >= 0 && number < last;
        if (number >= std::max(last, 1.0))
          to_.note(concat("a face has texture ", number, " of ", last, ", counted from 0"));
        SLF_TRY(add_face(k, row.list(indices), wedges ? wedges->uvs : row.list(coordinates),
                         color_of(row), static_cast<std::uint32_t>(known ? number : last)));
      } else if (strips) {
        SLF_TRY(add_strips(row.list(indices)));
      }
      return {};
    });
  }

  [[nodiscard]] Result<std::uint32_t> vertex_at(double index) const {
    const std::size_t count = faces_own_ ? vertices_.size() : to_.vertices();
    if (index >= 0 && index < static_cast<double>(count)) return static_cast<std::uint32_t>(index);
    return to_.wrong("PLY: a face has vertex ", index, " of ", count);
  }

  Result<void> add_face(std::uint64_t number, const std::vector<double>& indices,
                        const std::vector<double>& uvs, const std::optional<glm::u8vec4>& color,
                        std::uint32_t material) {
    if (!uvs.empty() && uvs.size() != 2 * indices.size())
      return to_.wrong("PLY: face ", number, " has ", indices.size(), " corners and ", uvs.size(),
                       " texture coordinates");
    corners_.clear();
    for (std::size_t k = 0; k < indices.size(); ++k) {
      const std::uint32_t at = SLF_TRY(vertex_at(indices[k]));
      if (!faces_own_) {
        corners_.push_back(at);
        continue;
      }
      MeshVertex vertex = vertices_[at];
      if (color && !colored_) vertex.color = color;
      if (!uvs.empty()) vertex.uv = glm::vec2(uvs[2 * k], 1 - uvs[2 * k + 1]);
      corners_.push_back(to_.add(vertex));
    }
    if (!to_.full()) to_.add(corners_, material);
    return {};
  }

  /// Triangles between each three successive vertices; -1 begins another strip.
  Result<void> add_strips(const std::vector<double>& indices) {
    for (std::size_t k = 0, start = 0; k < indices.size(); ++k) {
      if (indices[k] < 0) start = k + 1;
      if (indices[k] < 0 || k < start + 2) continue;
      std::vector<double> face{indices[k - 2], indices[k - 1], indices[k]};
      if ((k - start) % 2 == 1) std::swap(face[0], face[1]);
      if (face[0] == face[1] || face[1] == face[2] || face[0] == face[2]) continue;
      SLF_TRY(add_face(k, face, {}, std::nullopt, 0));
    }
    return {};
  }

  std::string_view rest_;
  MeshBuilder& to_;
  bool ascii_ = false, big_endian_ = false;
  std::vector<Element> elements_;
  std::vector<std::string> textures_;
  // Where faces have colours or texture coordinates, each has vertices of its own: copies of these.
  bool faces_own_ = false, colored_ = false;
  std::vector<MeshVertex> vertices_;
  struct Wedges {
    std::vector<double> uvs;
    double texture = 0;
  };
  std::vector<Wedges> wedges_;          // of each face, if they are in elements of their own
  std::vector<std::uint32_t> corners_;  // of a face
};

}  // namespace

Result<void> read_ply(ByteSpan bytes, MeshBuilder& to) { return PlyReader(bytes, to).read(); }

}  // namespace slf

// Wavefront OBJ, with its material files.
#include <algorithm>
#include <array>
#include <filesystem>
#include <map>
#include <set>

#include "base/ascii.h"
#include "base/try.h"
#include "base/utf8.h"
#include "slf/tone.h"
#include "source/mesh/builder.h"
#include "source/mesh/surface.h"
#include "source/volume/io.h"

namespace slf {
namespace {

using volume_io::parse_number;

namespace fs = std::filesystem;

/// Vertices at one position that are compared with a new one.
constexpr int kMaxNeighbours = 16;
constexpr std::size_t kMaxMaterials = 1 << 16;

/// Lines without comments and blanks around; a backslash at its end continues a line.
class Lines {
 public:
  explicit Lines(std::string_view text) : text_(text) {}
  bool next() {
    if (text_.empty()) return false;
    joined_.clear();
    for (bool more = true; more;) {
      line_ = trim(next_line(text_));
      ++number_;
      more = line_.ends_with('\\') && !line_.starts_with('#') && !text_.empty();
      if (more) joined_.append(line_.substr(0, line_.size() - 1)).append(" ");
    }
    if (!joined_.empty()) line_ = joined_.append(line_);
    return true;
  }
  [[nodiscard]] std::string_view line() const { return line_; }
  [[nodiscard]] std::size_t number() const { return number_; }

 private:
  std::string_view text_, line_;
  std::string joined_;
  std::size_t number_ = 0;
};

std::string_view without_quotes(std::string_view text) {
  const bool quoted = text.size() > 1 && text.starts_with('"') && text.ends_with('"');
  return quoted ? text.substr(1, text.size() - 2) : text;
}

std::string_view without_comment(std::string_view text) { return text.substr(0, text.find('#')); }

/// What a statement of a material says about a texture.
struct Map {
  std::string file;
  glm::vec2 scale{1}, offset{0};
  bool clamp = false;
};

Map map_of(std::string_view text) {
  Map map;
  while (text.starts_with('-')) {
    std::string_view rest = text;
    const std::string_view option = next_word(rest);
    // Each has one word, but for those with numbers, of which the last may be left out.
    constexpr std::array<std::pair<std::string_view, int>, 4> kNumbers{
        {{"-s", 3}, {"-o", 3}, {"-t", 3}, {"-mm", 2}}};
    const auto* known =
        std::ranges::find_if(kNumbers, [&](const auto& entry) { return entry.first == option; });
    std::vector<double> numbers;
    if (known == kNumbers.end()) {
      const std::string_view value = next_word(rest);
      if (option == "-clamp") map.clamp = value == "on";
    }
    while (known != kNumbers.end() && std::ssize(numbers) < known->second) {
      std::string_view after = rest;
      const auto number = parse_number(next_word(after));
      if (!number || trim(after).empty()) break;  // a file may have a number for its name
      numbers.push_back(*number);
      rest = after;
    }
    for (std::size_t k = 0; k < std::min<std::size_t>(numbers.size(), 2); ++k) {
      const auto axis = static_cast<int>(k);
      if (option == "-s") map.scale[axis] = static_cast<float>(numbers[k]);
      if (option == "-o") map.offset[axis] = static_cast<float>(numbers[k]);
    }
    text = trim(rest);
  }
  map.file = without_quotes(text);
  return map;
}

struct Material {
  std::string name, folder;  // of its file, relative to the mesh's
  std::optional<glm::vec3> color{}, emission{};
  std::optional<float> dissolve{}, transparency{};
  Map color_map{}, ambient_map{}, emission_map{}, opacity_map{};

  /// The colour and the map that count: what glows alone, the ambient map if it is the only one,
  /// and maps as Maya writes them, beside black.
  void settle(MeshBuilder& to) {
    constexpr glm::vec3 kBlack(0), kWhite(1);
    const bool glows = !emission_map.file.empty() || emission.value_or(kBlack) != kBlack;
    const bool dark = color_map.file.empty() && color.value_or(kBlack) == kBlack;
    if (glows) to.note_emission(dark);
    if (glows && dark) color = emission, color_map = emission_map;
    if (color_map.file.empty()) color_map = ambient_map;
    if (!color_map.file.empty() && color.value_or(kBlack) == kBlack) color = kWhite;
  }
  /// What places the texture coordinates.
  [[nodiscard]] const Map& map() const { return color_map.file.empty() ? opacity_map : color_map; }
};

class ObjReader {
 public:
  ObjReader(ByteSpan bytes, MeshBuilder& to) : text_(as_utf8(chars_of(bytes), made_)), to_(to) {}

  Result<void> read() {
    SLF_TRY(read_vertices());
    materials_.emplace_back();  // of faces without one
    for (Material& m : materials_) {
      m.settle(to_);
      moves_.emplace_back(m.map().scale, m.map().offset);
    }
    SLF_TRY(read_faces());
    std::vector<bool> used(materials_.size());
    for (const std::uint32_t m : to_.mesh().material_of) used[m] = true;
    if (!used.back() && materials_.size() > 1) materials_.pop_back();
    for (std::size_t k = 0; k < materials_.size(); ++k) {
      to_.at("material '" + materials_[k].name + "': ");
      SLF_TRY(add_material(materials_[k], used[k]));
    }
    to_.at("");
    if (to_.mesh().triangles.empty() && !positions_.empty())
      return to_.error(ErrorCode::unsupported, "has ", positions_.size(),
                       " points and no faces; only faces are shown: make a surface of them first");
    finish_materials();
    return {};
  }

 private:
  template <class... Parts>
  tl::unexpected<Error> wrong(const Lines& at, const Parts&... parts) const {
    return to_.wrong("line ", at.number(), ": ", parts...);
  }

  /// Positions, texture coordinates, normals, and names of material files, which may stand after
  /// the faces that use them.
  Result<void> read_vertices() {
    for (Lines lines(text_); lines.next();) {
      std::string_view rest = lines.line();
      const std::string_view word = next_word(rest);
      if (word == "mtllib") {
        SLF_TRY(read_library(std::string(without_quotes(trim(rest)))));
      } else if (word == "v" || word == "vt" || word == "vn") {
        std::array<double, 7> numbers{};
        std::size_t count = 0;
        for (rest = without_comment(rest); count < numbers.size(); ++count) {
          const auto number = parse_number(next_word(rest));
          if (!number) break;
          numbers[count] = *number;
        }
        const auto float_at = [&](std::size_t k) { return static_cast<float>(numbers[k]); };
        if (word == "v") {
          if (count < 3) return wrong(lines, "a vertex needs three numbers");
          positions_.emplace_back(numbers[0], numbers[1], numbers[2]);
          // x y z r g b, perhaps with an alpha, or x y z w r g b.
          if (count >= 6) {
            colors_.resize(positions_.size() - 1, glm::vec4(kNoColor));
            colors_.emplace_back(float_at(3), float_at(4), float_at(5),
                                 count == 7 ? float_at(6) : kNoColor);
          }
        } else if (word == "vt") {
          uvs_.emplace_back(float_at(0), float_at(1));
        } else {
          normals_.emplace_back(float_at(0), float_at(1), float_at(2));
        }
      } else if (word == "#MRGB") {  // ZBrush: a mask and a colour in hexadecimal, vertex by vertex
        for (rest = trim(rest); rest.size() >= 8; rest.remove_prefix(8)) {
          const auto bits = slf::parse_number<std::uint32_t>(rest.substr(0, 8), 16).value_or(~0U);
          painted_.emplace_back(bits >> 16U & 255U, bits >> 8U & 255U, bits & 255U, 255);
        }
      }
    }
    const auto all = [&](int channel) {
      return std::ranges::all_of(colors_, [&](const auto& c) { return c[channel] == 1; });
    };
    if (all(0) && !all(3))
      for (glm::vec4& c : colors_)
        if (c.a != kNoColor) c = {c.y, c.z, c.w, 1};
    if (colors_.empty()) colors_ = std::move(painted_);
    for (const glm::vec4& c : colors_) most_ = std::max({most_, c.x, c.y, c.z});
    if (!colors_.empty()) colors_.resize(positions_.size(), glm::vec4(kNoColor));
    most_ = static_cast<float>(color_scale(most_));
    heads_.assign(positions_.size(), kNone);
    return {};
  }

  /// One name, which may have blanks, or several.
  Result<void> read_library(const std::string& names) {
    if (const auto found = to_.find_file(names)) return read_materials(*found);
    std::string_view rest = names;
    for (std::string_view name = next_word(rest); !name.empty(); name = next_word(rest))
      if (const auto found = to_.find_file(std::string(name)))
        SLF_TRY(read_materials(*found));
      else
        to_.note("its material file " + std::string(name) + " is missing");
    return {};
  }

  Result<void> read_materials(const std::string& file) {
    if (!libraries_.insert(file).second) return {};
    const Bytes bytes = SLF_TRY(to_.read(file));
    const std::string folder =
        fs::path(file).parent_path().lexically_relative(fs::path(to_.path()).parent_path());
    Material* to = nullptr;
    std::string made;
    for (Lines lines(as_utf8(chars_of(bytes), made)); lines.next();) {
      std::string_view rest = lines.line();
      const std::string word = lower_case(next_word(rest));
      if (word == "newmtl") {
        const auto [entry, added] = names_.try_emplace(
            std::string(trim(rest)), static_cast<std::uint32_t>(materials_.size()));
        if (added) materials_.emplace_back();
        if (materials_.size() > kMaxMaterials)
          return to_.error(ErrorCode::unsupported, "has more than ", kMaxMaterials, " materials");
        to = &materials_[entry->second];
        *to = {.name = entry->first, .folder = folder};  // the last one of a name counts
      }
      if (!to) continue;
      const auto number = [&]() -> std::optional<float> {
        std::string_view words = without_comment(rest);
        std::string_view first = next_word(words);
        if (first == "-halo") first = next_word(words);
        const auto value = parse_number(first);
        return value ? std::optional(static_cast<float>(*value)) : std::nullopt;
      };
      if (word == "kd" || word == "ke") {
        std::string_view words = without_comment(rest);
        glm::vec3 color(0);
        for (int c = 0; c < 3; ++c) {
          const auto value = parse_number(next_word(words));
          color[c] = value ? static_cast<float>(*value) : c > 0 ? color[c - 1] : 1.f;
        }
        if (std::max({color.x, color.y, color.z}) > 1)
          to_.note("a colour of its materials is above 1: cut to 1");
        (word == "kd" ? to->color : to->emission) = color;
      } else if (word == "d") {
        to->dissolve = number();
      } else if (word == "tr") {
        to->transparency = number();
      } else if (word == "map_kd") {
        to->color_map = map_of(trim(rest));
      } else if (word == "map_ka") {
        to->ambient_map = map_of(trim(rest));
      } else if (word == "map_ke") {
        to->emission_map = map_of(trim(rest));
      } else if (word == "map_d") {
        to->opacity_map = map_of(trim(rest));
      }
    }
    return {};
  }

  Result<void> add_material(const Material& from, bool used) {
    MeshMaterial to;
    to.name = from.name;
    const glm::vec3 color = glm::clamp(from.color.value_or(glm::vec3(1)), 0.f, 1.f);
    for (int c = 0; c < 3; ++c) to.color[c] = linear_from_srgb(color[c]);
    float opacity = from.dissolve.value_or(1 - from.transparency.value_or(0));
    if (!from.dissolve && opacity == 0) {  // nobody makes faces that nobody can see
      opacity = 1;
      if (used) to_.note("'Tr 1' is taken for opaque, as old MeshLab and OpenMVS write it");
    }
    to.color.a = std::clamp(opacity == opacity ? opacity : 1.f, 0.f, 1.f);
    if (to.color.a < 1) to.opacity = MeshOpacity::blend;
    if (used && !from.color_map.file.empty())
      to.texture = SLF_TRY(to_.texture(from.color_map.file, from.folder));
    if (used && !from.opacity_map.file.empty()) SLF_TRY(cut(from, to));
    if (from.map().clamp) to.wrap_u = to.wrap_v = MeshWrap::clamp;
    to_.mesh().materials.push_back(std::move(to));
    return {};
  }

  /// map_d names a picture whose alpha, or whose grey if it is opaque, cuts holes.
  Result<void> cut(const Material& from, MeshMaterial& to) {
    std::vector<MeshTexture>& textures = to_.mesh().textures;
    const std::size_t found = SLF_TRY(to_.texture(from.opacity_map.file, from.folder));
    to.opacity = MeshOpacity::cutout;
    if (found == to.texture) return {};
    const MeshTexture& mask = textures[found];
    MeshTexture made = textures[to.texture.value_or(found)];
    if (!to.texture) std::ranges::fill(made.texels, glm::u8vec4(255));
    if (mask.width != made.width || mask.height != made.height)
      return to_.error(ErrorCode::unsupported, "its textures ", made.name, " and ", mask.name,
                       " differ in size (", made.width, "x", made.height, ", ", mask.width, "x",
                       mask.height, "); scale one of them");
    const bool opaque =
        std::ranges::all_of(mask.texels, [](const glm::u8vec4& t) { return t.a == 255; });
    for (std::size_t k = 0; k < made.texels.size(); ++k) {
      const unsigned share = opaque ? mask.texels[k].g : mask.texels[k].a;
      made.texels[k].a = static_cast<std::uint8_t>((made.texels[k].a * share + 127U) / 255U);
    }
    to_.use(made.texels.size() * sizeof(glm::u8vec4));
    textures.push_back(std::move(made));
    to.texture = textures.size() - 1;
    return {};
  }

  Result<void> read_faces() {
    const auto none = static_cast<std::uint32_t>(materials_.size() - 1);
    std::uint32_t material = none;
    std::array<std::size_t, 3> before{};  // positions, texture coordinates, normals up to here
    std::vector<std::uint32_t> corners;
    for (Lines lines(text_); lines.next() && !to_.full();) {
      std::string_view rest = lines.line();
      const std::string_view word = next_word(rest);
      if (word == "v") {
        ++before[0];
      } else if (word == "vt") {
        ++before[1];
      } else if (word == "vn") {
        ++before[2];
      } else if (word == "usemtl") {
        const auto known = names_.find(std::string(trim(rest)));
        if (known == names_.end() && !trim(rest).empty())
          to_.note("its material '" + std::string(trim(rest)) +
                   "' is in none of its material files");
        material = known == names_.end() ? none : known->second;
      } else if (word == "l" || word == "p") {
        to_.leave_out();
      } else if (word == "f" || word == "fo") {
        corners.clear();
        rest = without_comment(rest);
        for (std::string_view text = next_word(rest); !text.empty(); text = next_word(rest)) {
          auto corner = corner_of(text, before);
          if (!corner) return wrong(lines, corner.error().message);
          corners.push_back(vertex_of(*corner, material));
        }
        to_.add(corners, material);
      }
    }
    return {};
  }

  /// Indices from 0; kNone: it has none.
  static constexpr std::uint32_t kNone = ~0U;
  using Corner = std::array<std::uint32_t, 3>;

  Result<Corner> corner_of(std::string_view text, const std::array<std::size_t, 3>& before) const {
    const std::array<std::size_t, 3> counts{positions_.size(), uvs_.size(), normals_.size()};
    Corner corner{kNone, kNone, kNone};
    std::string_view rest = text;
    for (std::size_t k = 0; k < 3 && !rest.empty(); ++k) {
      const std::string_view part = rest.substr(0, rest.find('/'));
      rest.remove_prefix(std::min(part.size() + 1, rest.size()));
      const auto number = parse_number(part);
      if (!number && k > 0) continue;
      const double index = number.value_or(0) < 0 ? static_cast<double>(before[k]) + *number
                                                  : number.value_or(0) - 1;
      const bool known = index >= 0 && index < static_cast<double>(counts[k]);
      if (known) corner[k] = static_cast<std::uint32_t>(index);
      if (!known && k == 0)
        return fail(ErrorCode::bad_file, "a face has vertex '", text, "' of ", counts[0]);
    }
    return corner;
  }

  std::uint32_t vertex_of(const Corner& corner, std::uint32_t material) {
    const std::array<std::uint32_t, 3> own{corner[1], corner[2], material};
    std::uint32_t at = heads_[corner[0]];
    for (int k = 0; k < kMaxNeighbours && at != kNone; ++k, at = nexts_[at])
      if (owns_[at] == own) return at;
    MeshVertex vertex{positions_[corner[0]]};
    if (corner[1] != kNone) {
      const glm::vec2 uv = moves_[material].first * uvs_[corner[1]] + moves_[material].second;
      vertex.uv = glm::vec2(uv.x, 1 - uv.y);
    }
    if (corner[2] != kNone) vertex.normal = normals_[corner[2]];
    if (!colors_.empty() && colors_[corner[0]].x != kNoColor)
      vertex.color = color_bytes(glm::vec4(glm::vec3(colors_[corner[0]]) / most_, 1), false);
    at = to_.add(vertex);
    if (to_.full()) return 0;
    owns_.push_back(own);
    nexts_.push_back(heads_[corner[0]]);
    return heads_[corner[0]] = at;
  }

  void finish_materials() {
    Mesh& mesh = to_.mesh();
    // Without any colour, a light grey.
    const bool colored = !mesh.colors.empty();
    for (std::size_t k = 0; k < materials_.size(); ++k) {
      MeshMaterial& to = mesh.materials[k];
      if (!materials_[k].color && !to.texture && !colored)
        to.color = {glm::vec3(kPlainColor), to.color.a};
    }
  }

  std::string made_;
  const std::string_view text_;
  MeshBuilder& to_;
  std::vector<glm::dvec3> positions_;
  std::vector<glm::vec2> uvs_;
  std::vector<glm::vec3> normals_;
  static constexpr float kNoColor = -1;
  std::vector<glm::vec4> colors_, painted_;  // kNoColor: none
  float most_ = 0;                           // that they run to
  std::set<std::string> libraries_;
  std::map<std::string, std::uint32_t> names_;  // of materials
  std::vector<Material> materials_;
  std::vector<std::pair<glm::vec2, glm::vec2>> moves_;  // of texture coordinates, by material
  // The vertices that were made at each position: the last one, and the one before each.
  std::vector<std::uint32_t> heads_, nexts_;
  std::vector<std::array<std::uint32_t, 3>> owns_;  // texture coordinate, normal, material
};

}  // namespace

Result<void> read_obj(ByteSpan bytes, MeshBuilder& to) { return ObjReader(bytes, to).read(); }

}  // namespace slf

// glTF 2, text and binary.
#include <algorithm>
#include <array>
#include <cmath>
#include <glm/gtc/quaternion.hpp>
#include <glm/gtc/type_ptr.hpp>
#include <map>

#include "base/base64.h"
#include "base/try.h"
#include "base/utf8.h"
#include "source/mesh/builder.h"
#include "source/mesh/compact_json.h"
#include "source/volume/fields.h"

namespace slf {
namespace {

constexpr std::uint64_t kMaxJson = std::uint64_t{512} << 20;
constexpr std::size_t kMaxItems = std::size_t{1} << 20;  // of each kind: nodes take most memory
/// Numbers that may be decoded, whatever the file holds, and for each of its bytes: instances,
/// targets of morphs and sets of joints can use the same bytes again and again.
constexpr std::uint64_t kMaxDecoded = std::uint64_t{1} << 30, kDecodedPerByte = 256;

constexpr const char* kTransform = "KHR_texture_transform";
constexpr const char* kSpecular = "KHR_materials_pbrSpecularGlossiness";

/// What these extensions add does not show here, or is read.
bool is_read(std::string_view extension) {
  return extension.starts_with("KHR_materials_") || extension == kTransform ||
         extension == "KHR_mesh_quantization" || extension == "KHR_lights_punctual";
}

/// The types of components, by their numbers from 5120 on, and what stands for 1 if normalized.
constexpr std::uint64_t kFirstType = 5120;
constexpr ScalarType kTypes[] = {ScalarType::i8,  ScalarType::u8,  ScalarType::i16, ScalarType::u16,
                                 ScalarType::u32, ScalarType::u32, ScalarType::f32};
constexpr double kOnes[] = {127, 255, 32767, 65535, 1, 4294967295, 1};

bool is_unsigned(std::uint64_t component) {
  return component == 5121 || component == 5123 || component == 5125;
}

/// So many numbers.
template <std::size_t N>
std::optional<std::array<double, N>> numbers_of(const JsonValue& value) {
  const auto items = value.items();
  std::array<double, N> numbers{};
  if (items.size() != N) return {};
  for (std::size_t k = 0; k < N; ++k) {
    const auto number = items[k].number();
    if (!number) return {};
    numbers[k] = *number;
  }
  return numbers;
}
template <int N>
std::optional<glm::vec<N, double>> vector_of(const JsonValue& value) {
  const auto numbers = numbers_of<N>(value);
  if (!numbers) return {};
  glm::vec<N, double> vector;
  std::ranges::copy(*numbers, &vector[0]);
  return vector;
}

std::string name_of(const JsonValue& value, std::size_t index) {
  const std::string_view name = value["name"].text();
  return name.empty() ? std::to_string(index) : std::string(name);
}

/// The numbers of an accessor, `width` for each element; none: width is 0.
template <class T>
struct Elements {
  std::size_t width = 0;
  std::vector<T> values;
  [[nodiscard]] std::size_t count() const { return width == 0 ? 0 : values.size() / width; }
  [[nodiscard]] const T* at(std::size_t k) const { return values.data() + k * width; }
};

class GltfReader {
 public:
  GltfReader(ByteSpan bytes, MeshBuilder& to)
      : bytes_(bytes), to_(to), left_(kMaxDecoded + kDecodedPerByte * bytes.size()) {}

  Result<void> read() {
    SLF_TRY(open());
    const std::string_view version = root_["asset"]["version"].text();
    if (version.empty()) return wrong("no asset.version: not a glTF file");
    if (!version.starts_with("2."))
      return to_.error(ErrorCode::unsupported, "glTF ", version, "; glTF 2 is read");
    for (const JsonValue& name : root_["extensionsRequired"].items())
      if (!is_read(name.text())) return not_read(name.text());
    for (const JsonValue& name : root_["extensionsUsed"].items())
      if (!is_read(name.text()) || name.text() == "KHR_materials_transmission")
        to_.note("the glTF extension " + std::string(name.text()) + " is not read");
    for (const auto& [list, name] : {std::pair{&buffers_, "buffers"},
                                     {&views_, "bufferViews"},
                                     {&accessors_, "accessors"},
                                     {&materials_, "materials"},
                                     {&textures_, "textures"},
                                     {&images_, "images"},
                                     {&samplers_, "samplers"},
                                     {&meshes_, "meshes"},
                                     {&nodes_, "nodes"},
                                     {&skins_, "skins"}}) {
      *list = root_[name].items();
      if (list->size() > kMaxItems)
        return to_.error(ErrorCode::unsupported, "glTF: has ", list->size(), " ", name, "; up to ",
                         kMaxItems, " are read");
    }
    SLF_TRY(read_materials());
    SLF_TRY(place_nodes());
    for (const std::size_t k : shown_) SLF_TRY(add_node(k));
    return {};
  }

 private:
  struct Paint {
    std::uint32_t material = 0;
    std::size_t set = 0;  // of texture coordinates
    glm::dmat3x2 transform{1};
  };

  template <class... Parts>
  tl::unexpected<Error> wrong(const Parts&... parts) const {
    return to_.wrong("glTF: ", parts...);
  }
  tl::unexpected<Error> not_read(std::string_view extension) const {
    return to_.error(ErrorCode::unsupported, "requires the glTF extension ", extension,
                     ", which is not read; export it without");
  }

  /// The index of one of `count` items; `what` is wrong if it is none.
  template <class... Parts>
  Result<std::size_t> index_in(std::size_t count, const JsonValue& value,
                               const Parts&... what) const {
    const auto index = value.index();
    if (index && *index < count) return *index;
    return wrong(what...);
  }

  // The document, and the bytes that it names.

  Result<void> open() {
    ByteSpan json = bytes_;
    if (chars_of(bytes_).starts_with("glTF")) {
      constexpr std::size_t kHeader = 12, kChunk = 8;
      if (bytes_.size() < kHeader + kChunk) return to_.wrong("truncated in its header");
      const std::uint32_t version = load_le<std::uint32_t>(&bytes_[4]);
      if (version != 2)
        return to_.error(ErrorCode::unsupported, "glTF ", version, "; glTF 2 is read");
      const auto chunk = [&](std::size_t at) -> std::optional<ByteSpan> {
        const std::size_t size = load_le<std::uint32_t>(&bytes_[at]);
        if (size > bytes_.size() - at - kChunk) return {};
        return bytes_.subspan(at + kChunk, size);
      };
      const auto first = chunk(kHeader);
      if (!first) return to_.wrong("truncated: its JSON is incomplete; copy it again");
      json = *first;
      if (std::size_t at = kHeader + kChunk + (json.size() + 3) / 4 * 4;
          at + kChunk <= bytes_.size()) {
        const auto second = chunk(at);
        if (!second) return to_.wrong("truncated: its data are incomplete; copy it again");
        held_ = *second;
      }
    }
    if (json.size() > kMaxJson)
      return to_.error(ErrorCode::unsupported, "has ", json.size(),
                       " bytes of JSON; glTF files with up to ", kMaxJson,
                       " are read; export it as .glb");
    std::string made;
    std::string_view json_text = as_utf8(chars_of(json), made);
    json_text = json_text.substr(0, json_text.find_last_not_of('\0') + 1);
    json_ = CompactJson::parse(json_text);
    if (!json_) return wrong("its JSON is damaged or truncated");
    root_ = json_->root();
    return {};
  }

  /// The bytes of a URI: data, or a file.
  Result<Bytes> fetch(std::string_view uri, const std::string& what) {
    if (!uri.starts_with("data:")) return to_.read(what, std::string(uri));
    const std::size_t comma = std::min(uri.find(','), uri.size() - 1);
    const std::string text = decode_percent(uri.substr(comma + 1));
    if (!uri.substr(0, comma).ends_with(";base64")) {
      const ByteSpan plain = bytes_of(text);
      return Bytes(plain.begin(), plain.end());
    }
    std::string_view rest = text;
    auto bytes = decode_base64(rest, false);
    if (!rest.empty()) return wrong(what, ": its base64 is damaged");
    return bytes;
  }

  Result<ByteSpan> buffer(std::size_t k) {
    const JsonValue uri = buffers_[k]["uri"];
    const auto size = buffers_[k]["byteLength"].index();
    if (!size) return wrong("buffer ", k, " has no byteLength");
    if (uri && loaded_.count(uri.text()) == 0) {
      Bytes file = SLF_TRY(fetch(uri.text(), "buffer"));
      loaded_.emplace(uri.text(), std::move(file));
    }
    const ByteSpan bytes = uri ? ByteSpan(loaded_[uri.text()]) : k == 0 ? held_ : ByteSpan();
    if (buffers_[k]["extensions"]["EXT_meshopt_compression"] && bytes.empty())
      return not_read("EXT_meshopt_compression");
    if (bytes.size() < *size)
      return wrong("buffer ", k, " has ", *size, " bytes, but only ", bytes.size(),
                   " are there: truncated");
    return bytes.first(*size);
  }

  Result<ByteSpan> view(const JsonValue& index) {
    const auto k = SLF_TRY(index_in(views_.size(), index, "there is no such bufferView"));
    const auto from = views_[k]["buffer"].index(), size = views_[k]["byteLength"].index();
    const JsonValue start = views_[k]["byteOffset"];
    const auto offset = start ? start.index() : 0;
    if (!from || *from >= buffers_.size() || !offset || !size)
      return wrong("bufferView ", k, " is not a part of a buffer");
    const ByteSpan whole = SLF_TRY(buffer(*from));
    if (*offset > whole.size() || *size > whole.size() - *offset)
      return wrong("bufferView ", k, " extends beyond its buffer");
    return whole.subspan(*offset, *size);
  }

  // Numbers: accessors of these bytes.

  /// Copies numbers, `width` for each of `count` elements, out of a buffer view.
  template <class T>
  Result<void> copy(const JsonValue& from, std::uint64_t type, bool normalized, std::size_t width,
                    std::uint64_t count, std::vector<T>& to) {
    const ByteSpan bytes = SLF_TRY(view(from["bufferView"]));
    const std::uint64_t each = bytes_per_voxel(kTypes[type - kFirstType]), size = each * width;
    const JsonValue start = from["byteOffset"],
                    stated = views_[*from["bufferView"].index()]["byteStride"];
    const auto offset = start ? start.index() : 0;
    const std::uint64_t step = std::max(stated.index().value_or(0), size);
    if (!offset || *offset > bytes.size() || step > 4096 ||
        (count > 0 && (count > bytes.size() || *offset + step * (count - 1) + size > bytes.size())))
      return wrong("an accessor, ", count, " elements of ", size,
                   " bytes, extends beyond its bufferView of ", bytes.size(), " bytes");
    to.resize(count * width);
    const volume_io::Fields fields{chars_of(bytes), false};
    const ScalarType scalar = kTypes[type - kFirstType];
    const double one = kOnes[type - kFirstType];
    normalized = normalized && scalar != ScalarType::f32;
    for (std::size_t k = 0, i = 0; k < count; ++k)
      for (std::size_t c = 0; c < width; ++c, ++i) {
        const double number = fields.number(scalar, *offset + step * k + each * c);
        to[i] = static_cast<T>(normalized ? std::max(number / one, -1.0) : number);
      }
    return {};
  }

  Result<void> charge(std::uint64_t numbers) {
    if (numbers > left_)
      return to_.error(ErrorCode::unsupported,
                       "glTF: its meshes ask for much more than the file holds");
    left_ -= numbers;
    return {};
  }

  template <class T>
  Result<Elements<T>> elements(const JsonValue& index) {
    const auto k = SLF_TRY(index_in(accessors_.size(), index, "there is no such accessor"));
    const JsonValue& accessor = accessors_[k];
    const auto count = accessor["count"].index(), type = accessor["componentType"].index();
    Elements<T> out;
    for (const auto& [name, width] :
         {std::pair{"SCALAR", 1}, {"VEC2", 2}, {"VEC3", 3}, {"VEC4", 4}, {"MAT4", 16}})
      if (accessor["type"].text() == name) out.width = static_cast<std::size_t>(width);
    const bool known = type && *type >= 5120 && *type <= 5126 && *type != 5124;
    if (!count || !known || out.width == 0 || (std::is_integral_v<T> && !is_unsigned(*type)))
      return wrong("accessor ", k, " is malformed");
    const bool normalized = accessor["normalized"].is_true();
    const std::uint64_t numbers = *count * out.width;
    SLF_TRY(charge(numbers));
    if (accessor["bufferView"]) {
      SLF_TRY(copy(accessor, *type, normalized, out.width, *count, out.values));
    } else {
      to_.use(numbers * sizeof(T));
      if (to_.full())
        return to_.error(ErrorCode::unsupported, "glTF: accessor ", k, " has ", *count,
                         " elements without data");
      out.values.resize(numbers);
    }
    if (const JsonValue sparse = accessor["sparse"]) {
      const auto changes = sparse["count"].index(),
                 index_type = sparse["indices"]["componentType"].index();
      if (!changes || *changes > *count || !index_type || !is_unsigned(*index_type))
        return wrong("accessor ", k, ": its sparse part is malformed");
      std::vector<std::uint32_t> places;
      std::vector<T> values;
      SLF_TRY(copy(sparse["indices"], *index_type, false, 1, *changes, places));
      SLF_TRY(copy(sparse["values"], *type, normalized, out.width, *changes, values));
      for (std::size_t i = 0; i < places.size(); ++i) {
        if (places[i] >= *count) return wrong("accessor ", k, " changes an element beyond its end");
        std::copy_n(&values[i * out.width], out.width, &out.values[places[i] * out.width]);
      }
    }
    return out;
  }

  // Materials, and their textures.

  Result<void> read_materials() {
    for (const JsonValue& from : materials_) {
      MeshMaterial to;
      Paint paint;
      paint.material = static_cast<std::uint32_t>(paints_.size());
      to.name = from["name"].text();
      const JsonValue specular = from["extensions"][kSpecular],
                      metal = from["pbrMetallicRoughness"];
      const JsonValue color = specular ? specular["diffuseFactor"] : metal["baseColorFactor"];
      JsonValue texture = specular ? specular["diffuseTexture"] : metal["baseColorTexture"];
      if (color) {
        const auto factor = vector_of<4>(color);
        if (!factor) return wrong("material '", to.name, "': its colour is malformed");
        to.color = glm::clamp(glm::vec4(*factor), 0.f, 1.f);
      }
      const auto emission = vector_of<3>(from["emissiveFactor"]);
      if (emission && *emission != glm::dvec3(0)) {
        const bool dark = glm::vec3(to.color) == glm::vec3(0);
        to_.note_emission(dark);
        if (dark) {
          to.color = glm::vec4(glm::clamp(glm::vec3(*emission), 0.f, 1.f), to.color.a);
          texture = from["emissiveTexture"];
        }
      }
      if (from["extensions"]["KHR_materials_unlit"])
        to_.note("materials without light are lit like others, unless shading is off");
      const std::string_view mode = from["alphaMode"].text();
      to.cutoff = static_cast<float>(from["alphaCutoff"].number().value_or(0.5));
      to.opacity = mode == "MASK" && to.cutoff > 0 ? MeshOpacity::cutout
                   : mode == "BLEND"               ? MeshOpacity::blend
                                                   : MeshOpacity::opaque;
      if (texture) {
        to_.at("material '" + to.name + "': ");
        SLF_TRY(add_texture(texture, to, paint));
        to_.at("");
      }
      to_.mesh().materials.push_back(std::move(to));
      paints_.push_back(paint);
    }
    return {};
  }

  Result<void> add_texture(const JsonValue& reference, MeshMaterial& to, Paint& paint) {
    const auto item = [](const std::vector<JsonValue>& list, const JsonValue& index) {
      const auto k = index.index();
      return k && *k < list.size() ? list[*k] : JsonValue();
    };
    const JsonValue texture = item(textures_, reference["index"]), source = texture["source"];
    if (!texture) return wrong("it has no such texture");
    if (!source)
      for (const char* other :
           {"KHR_texture_basisu", "EXT_texture_webp", "EXT_texture_avif", "MSFT_texture_dds"})
        if (texture["extensions"][other]) return not_read(other);
    const JsonValue image = item(images_, source);
    if (!image) return wrong("its texture has no such image");
    const JsonValue sampler = item(samplers_, texture["sampler"]);
    const auto wrap = [&](const char* name) {
      const auto mode = sampler[name].index();
      return mode == 33071 ? MeshWrap::clamp : mode == 33648 ? MeshWrap::mirror : MeshWrap::repeat;
    };
    to.wrap_u = wrap("wrapS");
    to.wrap_v = wrap("wrapT");
    paint.set = reference["texCoord"].index().value_or(0);
    if (const JsonValue moved = reference["extensions"][kTransform]) {
      paint.set = moved["texCoord"].index().value_or(paint.set);
      const double angle = moved["rotation"].number().value_or(0), c = std::cos(angle),
                   s = std::sin(angle);
      const auto scale = vector_of<2>(moved["scale"]).value_or(glm::dvec2(1));
      paint.transform = {scale.x * glm::dvec2(c, -s), scale.y * glm::dvec2(s, c),
                         vector_of<2>(moved["offset"]).value_or(glm::dvec2(0))};
    }
    const std::string_view uri = image["uri"].text();
    if (!uri.empty() && !uri.starts_with("data:")) {
      to.texture = SLF_TRY(to_.texture(std::string(uri)));
      return {};
    }
    const std::string name = "image " + std::to_string(*source.index());
    Bytes decoded;
    if (!uri.empty()) decoded = SLF_TRY(fetch(uri, name));
    ByteSpan bytes = decoded;
    if (uri.empty()) bytes = SLF_TRY(view(image["bufferView"]));
    to.texture = SLF_TRY(to_.texture(name, bytes));
    return {};
  }

  // Nodes, and the joints of skins.

  /// Computes where nodes are, and which of them the scene shows.
  Result<void> place_nodes() {
    std::vector<std::size_t> parents(nodes_.size(), nodes_.size());
    std::vector<std::vector<std::size_t>> children(nodes_.size());
    for (std::size_t k = 0; k < nodes_.size(); ++k)
      for (const JsonValue& child : nodes_[k]["children"].items()) {
        const auto c =
            SLF_TRY(index_in(nodes_.size(), child, "node ", k, " has a child that is no node"));
        if (parents[c] != nodes_.size())
          return wrong("node ", c, " has two parents, ", parents[c], " and ", k);
        parents[c] = k;
        children[k].push_back(c);
      }
    world_.resize(nodes_.size());
    std::vector<std::size_t> order;
    for (std::size_t k = 0; k < nodes_.size(); ++k)
      if (parents[k] == nodes_.size()) order.push_back(k);
    const std::size_t roots = order.size();
    for (std::size_t i = 0; i < order.size(); ++i) {
      const std::size_t k = order[i];
      const glm::dmat4 own = SLF_TRY(transform_of(k));
      world_[k] = i < roots ? own : world_[parents[k]] * own;
      order.insert(order.end(), children[k].begin(), children[k].end());
    }
    if (order.size() < nodes_.size()) return wrong("a node is its own ancestor");
    const auto scenes = root_["scenes"].items();
    const std::uint64_t scene = root_["scene"].index().value_or(0);
    order.resize(roots);
    if (scene < scenes.size()) {
      order.clear();
      for (const JsonValue& node : scenes[scene]["nodes"].items())
        if (const auto k = node.index(); k && *k < nodes_.size()) order.push_back(*k);
    }
    // In the order of the file: a node, then what is below it.
    std::vector<bool> seen(nodes_.size());
    for (std::vector<std::size_t> stack(order.rbegin(), order.rend()); !stack.empty();) {
      const std::size_t k = stack.back();
      stack.pop_back();
      if (seen[k]) continue;
      seen[k] = true;
      shown_.push_back(k);
      stack.insert(stack.end(), children[k].rbegin(), children[k].rend());
    }
    return {};
  }

  Result<glm::dmat4> transform_of(std::size_t k) const {
    const JsonValue& node = nodes_[k];
    if (const JsonValue given = node["matrix"]) {
      const auto numbers = numbers_of<16>(given);
      if (!numbers) return wrong("node ", k, ": its matrix is malformed");
      return glm::make_mat4(numbers->data());
    }
    glm::dmat4 matrix(1);
    if (const auto q = vector_of<4>(node["rotation"]); q && glm::length(*q) > 0) {
      const glm::dvec4 u = glm::normalize(*q);
      matrix = glm::mat4_cast(glm::dquat(u.w, u.x, u.y, u.z));
    }
    const auto scale = vector_of<3>(node["scale"]).value_or(glm::dvec3(1));
    for (int c = 0; c < 3; ++c) matrix[c] *= scale[c];
    matrix[3] = glm::dvec4(vector_of<3>(node["translation"]).value_or(glm::dvec3(0)), 1);
    return matrix;
  }

  /// What moves vertices: the node, or where these have joints, the joints of its skin.
  Result<const std::vector<glm::dmat4>*> joints_of(const JsonValue& index) {
    static const std::vector<glm::dmat4> kNone;
    if (!index) return &kNone;
    const auto k = SLF_TRY(index_in(skins_.size(), index, "there is no such skin"));
    if (const auto known = joints_.find(k); known != joints_.end()) return &known->second;
    std::vector<glm::dmat4>& joints = joints_[k];
    const auto nodes = skins_[k]["joints"].items();
    to_.use(nodes.size() * sizeof(glm::dmat4));
    if (to_.full()) return &kNone;
    for (const JsonValue& joint : nodes) {
      const auto node =
          SLF_TRY(index_in(nodes_.size(), joint, "skin ", k, " has a joint that is no node"));
      joints.push_back(world_[node]);
    }
    if (const JsonValue inverse = skins_[k]["inverseBindMatrices"]) {
      const auto matrices = SLF_TRY(elements<float>(inverse));
      if (matrices.width != 16 || matrices.count() < joints.size())
        return wrong("skin ", k, " has ", joints.size(), " joints and ", matrices.count(),
                     " matrices");
      for (std::size_t j = 0; j < joints.size(); ++j)
        joints[j] = joints[j] * glm::dmat4(glm::make_mat4(matrices.at(j)));
    }
    return &joints;
  }

  // Meshes.

  Result<void> add_node(std::size_t k) {
    if (!nodes_[k]["mesh"]) return {};
    const auto m = SLF_TRY(
        index_in(meshes_.size(), nodes_[k]["mesh"], "node ", k, " has a mesh that is none"));
    const auto* joints = SLF_TRY(joints_of(nodes_[k]["skin"]));
    const JsonValue own = nodes_[k]["weights"];
    std::vector<double> weights;
    for (const JsonValue& weight : (own ? own : meshes_[m]["weights"]).items())
      weights.push_back(weight.number().value_or(0));
    const auto primitives = meshes_[m]["primitives"].items();
    SLF_TRY(charge(weights.size() * (1 + primitives.size()) + primitives.size()));
    to_.at("mesh '" + name_of(meshes_[m], m) + "': ");
    for (const JsonValue& primitive : primitives)
      if (!to_.full()) SLF_TRY(add_primitive(primitive, world_[k], *joints, weights));
    to_.at("");
    return {};
  }

  /// An attribute, with what targets of morphs add.
  Result<Elements<float>> attribute(const JsonValue& primitive, const std::string& name,
                                    const std::vector<double>& weights) {
    Elements<float> out;
    if (const JsonValue base = primitive["attributes"][name]) out = SLF_TRY(elements<float>(base));
    const auto targets = primitive["targets"].items();
    SLF_TRY(charge(targets.size()));
    for (std::size_t t = 0; t < std::min(targets.size(), weights.size()); ++t) {
      const JsonValue target = targets[t][name];
      if (!target || weights[t] == 0) continue;
      const auto added = SLF_TRY(elements<float>(target));
      if (added.count() != out.count() || added.width > out.width)
        return wrong("target ", t, " has ", added.count(), " ", name, ", the mesh ", out.count());
      for (std::size_t k = 0; k < out.count(); ++k)
        for (std::size_t c = 0; c < added.width; ++c)
          out.values[k * out.width + c] += static_cast<float>(weights[t]) * added.at(k)[c];
    }
    return out;
  }

  /// Where vertices with joints are: the mean of what their joints would do.
  Result<std::vector<glm::dmat4>> blend(const JsonValue& primitive, std::size_t count,
                                        const std::vector<glm::dmat4>& joints,
                                        const glm::dmat4& otherwise) {
    std::vector<glm::dmat4> sums(count, glm::dmat4(0));
    std::vector<double> totals(count, 0);
    for (int set = 0;; ++set) {
      const std::string number = std::to_string(set);
      const JsonValue places = primitive["attributes"]["JOINTS_" + number],
                      shares = primitive["attributes"]["WEIGHTS_" + number];
      if (!places || !shares) break;
      const auto indices = SLF_TRY(elements<std::uint32_t>(places));
      const auto weights = SLF_TRY(elements<float>(shares));
      if (indices.count() != count || weights.count() != count || indices.width != weights.width)
        return wrong(count, " vertices have ", indices.count(), " joints and ", weights.count(),
                     " weights");
      for (std::size_t i = 0; i < indices.values.size(); ++i) {
        const double weight = weights.values[i];
        if (weight == 0) continue;
        if (indices.values[i] >= joints.size())
          return wrong("vertex ", i / indices.width, " has joint ", indices.values[i], " of ",
                       joints.size());
        sums[i / indices.width] += weight * joints[indices.values[i]];
        totals[i / indices.width] += weight;
      }
    }
    for (std::size_t k = 0; k < count; ++k)
      sums[k] = totals[k] > 0 ? sums[k] / totals[k] : otherwise;
    return sums;
  }

  Result<void> add_primitive(const JsonValue& primitive, const glm::dmat4& world,
                             const std::vector<glm::dmat4>& joints,
                             const std::vector<double>& weights) {
    constexpr std::uint64_t kTriangles = 4, kStrip = 5, kFan = 6;
    const std::uint64_t mode =
        primitive["mode"] ? primitive["mode"].index().value_or(7) : kTriangles;
    if (mode > kFan) return wrong("a primitive has mode ", mode);
    if (mode < kTriangles || !primitive["attributes"]["POSITION"]) {
      to_.leave_out();
      return {};
    }
    if (const auto k = primitive["attributes"]["POSITION"].index();
        primitive["extensions"]["KHR_draco_mesh_compression"] && k && *k < accessors_.size() &&
        !accessors_[*k]["bufferView"])
      return not_read("KHR_draco_mesh_compression");
    const Paint paint = SLF_TRY(paint_of(primitive["material"]));
    const auto positions = SLF_TRY(attribute(primitive, "POSITION", weights));
    const auto normals = SLF_TRY(attribute(primitive, "NORMAL", weights));
    const auto uvs =
        SLF_TRY(attribute(primitive, "TEXCOORD_" + std::to_string(paint.set), weights));
    const auto colors = SLF_TRY(attribute(primitive, "COLOR_0", weights));
    const std::size_t count = positions.count();
    for (const auto& [list, what, width] : {std::tuple{&positions, "positions", 3U},
                                            {&normals, "normals", 3U},
                                            {&uvs, "texture coordinates", 2U},
                                            {&colors, "colours", 3U}})
      if (list->width != 0 && (list->width < width || list->count() != count))
        return wrong(count, " vertices have ", list->count(), " ", what, " of ", list->width,
                     " numbers");
    std::vector<glm::dmat4> moved;
    if (!joints.empty() && primitive["attributes"]["JOINTS_0"])
      moved = SLF_TRY(blend(primitive, count, joints, world));
    const std::size_t first = to_.vertices();
    for (std::size_t k = 0; k < count; ++k) {
      const glm::dmat4& matrix = moved.empty() ? world : moved[k];
      const auto vec3 = [&](const Elements<float>& list) {
        return glm::dvec3(list.at(k)[0], list.at(k)[1], list.at(k)[2]);
      };
      MeshVertex vertex{glm::dvec3(matrix * glm::dvec4(vec3(positions), 1))};
      if (normals.width > 0) {
        // Cofactors: unlike the inverse, they exist for singular matrices, too.
        const glm::dmat3 m(matrix);
        const glm::dvec3 n =
            glm::dmat3(glm::cross(m[1], m[2]), glm::cross(m[2], m[0]), glm::cross(m[0], m[1])) *
            vec3(normals);
        const double length = glm::length(n);
        vertex.normal = glm::vec3(length > 0 ? n / length : glm::dvec3(0));
      }
      if (uvs.width > 0)
        vertex.uv = glm::vec2(paint.transform * glm::dvec3(uvs.at(k)[0], uvs.at(k)[1], 1));
      if (colors.width > 0)
        vertex.color = color_bytes(
            glm::vec4(glm::vec3(vec3(colors)), colors.width > 3 ? colors.at(k)[3] : 1), true);
      to_.add(vertex);
    }
    Elements<std::uint32_t> indices;
    if (const JsonValue given = primitive["indices"])
      indices = SLF_TRY(elements<std::uint32_t>(given));
    const std::size_t corners = indices.width > 0 ? indices.values.size() : count;
    const auto corner = [&](std::size_t k) {
      return indices.width > 0 ? indices.values[k] : static_cast<std::uint32_t>(k);
    };
    for (std::size_t k = 2; k < corners && !to_.full(); k += mode == kTriangles ? 3 : 1) {
      const bool odd = mode == kStrip && k % 2 == 1;
      glm::uvec3 triangle(corner(mode == kFan ? 0 : k - 2), corner(k - 1), corner(k));
      if (odd) std::swap(triangle.x, triangle.y);
      for (int c = 0; c < 3; ++c)
        if (triangle[c] >= count)
          return wrong("triangle ", mode == kTriangles ? k / 3 : k - 2, " has vertex ", triangle[c],
                       " of ", count);
      to_.add(triangle + static_cast<std::uint32_t>(first), paint.material);
    }
    return {};
  }

  Result<Paint> paint_of(const JsonValue& material) {
    if (material) {
      const auto k = SLF_TRY(index_in(paints_.size(), material, "there is no such material"));
      return paints_[k];
    }
    if (!plain_) {
      plain_ = Paint{.material = static_cast<std::uint32_t>(to_.mesh().materials.size())};
      to_.mesh().materials.emplace_back();
    }
    return *plain_;
  }

  const ByteSpan bytes_;
  MeshBuilder& to_;
  std::uint64_t left_;  // numbers that may still be decoded
  ByteSpan held_;       // the data in a .glb
  std::optional<CompactJson> json_;
  JsonValue root_;
  std::vector<JsonValue> buffers_, views_, accessors_, materials_, textures_, images_, samplers_,
      meshes_, nodes_, skins_;
  std::map<std::string_view, Bytes> loaded_;  // buffers that are not in the file, by URI
  std::vector<Paint> paints_;                 // of each material
  std::optional<Paint> plain_;
  std::vector<glm::dmat4> world_;                            // of each node
  std::vector<std::size_t> shown_;                           // nodes
  std::map<std::uint64_t, std::vector<glm::dmat4>> joints_;  // of each skin
};

}  // namespace

Result<void> read_gltf(ByteSpan bytes, MeshBuilder& to) { return GltfReader(bytes, to).read(); }

}  // namespace slf

// The table of options.
#include "source/recipe/options.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <functional>
#include <tuple>

#include "base/join.h"
#include "slf/reveal.h"
#include "source/raycast/provenance.h"

namespace slf::recipe {
namespace {

using nlohmann::json;
using Form = Type::Form;

// ---- members as JSON ----------------------------------------------------------------------------

template <class T>
requires std::is_arithmetic_v<T>
void put(T& to, const json& value) { to = value.get<T>(); }
void put(std::string& to, const json& value) {
  to = value.is_object() ? value.dump() : value.get<std::string>();
}
void put(VolumeSource& to, const json& value) { to.path = value.get<std::string>(); }
void put(ScalarType& to, const json& value) { to = *parse_scalar_type(value.get<std::string>()); }
void put(glm::dvec3& to, const json& value) {
  for (int k = 0; k < 3; ++k) to[k] = value[static_cast<std::size_t>(k)].get<double>();
}
void put(ClipPlane& to, const json& value) {
  for (int k = 0; k < 3; ++k) {
    to.point[k] = value[static_cast<std::size_t>(k)].get<double>();
    to.normal[k] = value[static_cast<std::size_t>(k) + 3].get<double>();
  }
}
void put(VoxelBox& to, const json& value) {
  for (std::size_t k = 0; k < 3; ++k) {
    to.begin[k] = value[k][0].is_null() ? 0 : value[k][0].get<std::uint32_t>();
    to.end[k] = value[k][1].is_null() ? 0 : value[k][1].get<std::uint32_t>();
  }
}
template <class T, std::size_t N>
void put(std::array<T, N>& to, const json& value) {
  for (std::size_t k = 0; k < N; ++k) put(to[k], value[k]);
}
template <class T>
void put(std::vector<T>& to, const json& value) {
  to.clear();
  for (const json& one : value) put(to.emplace_back(), one);
}
template <class T>
void put(std::optional<T>& to, const json& value) {
  put(to.emplace(), value);
}

json value_of(const std::string& text) {
  if (text.empty()) return {};
  return text.starts_with('{') ? json::parse(text, nullptr, /*allow_exceptions=*/false)
                               : json(text);
}
json value_of(const VolumeSource& source) { return value_of(source.path); }
json value_of(ScalarType type) { return name(type); }
json value_of(const glm::dvec3& v) { return {v.x, v.y, v.z}; }
json value_of(const ClipPlane& plane) {
  const auto& [p, n] = plane;
  return {p.x, p.y, p.z, n.x, n.y, n.z};
}
json value_of(const VoxelBox& box) {
  json value = json::array();
  for (std::size_t k = 0; k < 3; ++k)
    value.push_back({box.begin[k], box.end[k] == 0 ? json() : json(box.end[k])});
  return value;
}
/// The shortest decimal number that is this float, as 0.3.
json value_of(float number) {
  std::array<char, 32> text{};
  std::to_chars(text.data(), text.data() + text.size(), number);
  return std::strtod(text.data(), nullptr);
}
template <class T>
requires std::is_arithmetic_v<T> json value_of(T number) { return number; }
template <class T, std::size_t N>
json value_of(const std::array<T, N>& values) {
  return values == std::array<T, N>{} ? json() : json(values);
}
template <class T>
json value_of(const std::vector<T>& values) {
  if (values.empty()) return {};
  json list = json::array();
  for (const T& one : values) list.push_back(value_of(one));
  return list;
}
template <class T>
json value_of(const std::optional<T>& value) {
  return value ? value_of(*value) : json();
}

// ---- rows ---------------------------------------------------------------------------------------

/// The heading, sources and use that the options of a group have.
struct Group {
  const char* name;
  unsigned kinds;
  Use use;
};

/// Gives a member its default.
template <class Member>
void reset(Recipe& recipe, const Member& member) {
  const Recipe defaults;
  std::invoke(member, recipe) = std::invoke(member, defaults);
}

template <class Member>
Option row(const char* name, const Group& group, Type type, std::string help, Member member) {
  return {name,
          group.name,
          group.kinds,
          group.use,
          std::move(type),
          std::move(help),
          [=](Recipe& recipe, const json& value) {
            if (value.is_null())
              reset(recipe, member);
            else
              put(std::invoke(member, recipe), value);
          },
          [=](const Recipe& recipe) { return value_of(std::invoke(member, recipe)); }};
}

template <class T>
using Choices = std::vector<std::pair<const char*, T>>;

template <class T, class Member>
Option choice(const char* name, const Group& group, const Choices<T>& choices, std::string help,
              Member member) {
  Type type{Form::choice};
  for (const auto& [text, value] : choices) type.names.push_back(text);
  const auto set = [=](Recipe& recipe, const json& value) {
    if (value.is_null()) return reset(recipe, member);
    for (const auto& [text, one] : choices)
      if (value == text) std::invoke(member, recipe) = one;
  };
  const auto get = [=](const Recipe& recipe) {
    for (const auto& [text, value] : choices)
      if (std::invoke(member, recipe) == value) return json(text);
    return json();
  };
  return {name, group.name, group.kinds, group.use, std::move(type), std::move(help), set, get};
}

Option flag(const char* name, const Group& group, std::string help, auto member) {
  return row(name, group, {Form::flag}, std::move(help), member);
}

Type number(double low, double high) { return {Form::number, "NUMBER", low, high}; }
Type above(double low, double high) { return {Form::number, "NUMBER", low, high, true}; }
Type whole(double low, double high) { return {Form::whole, "N", low, high}; }
Type numbers(const char* shown, unsigned count, double low, double high, char delimiter = ',') {
  return {Form::numbers, shown, low, high, false, count, delimiter};
}
const Type kFile{Form::file, "FILE"}, kBytes{Form::bytes, "SIZE", 0, 0x1p63};

constexpr double kMaxCount = UINT32_MAX;
const Type kPosition = numbers("X,Y,Z", 3, -kMaxLength, kMaxLength);

std::vector<Option> make_options() {
  constexpr Group kData{"Volume", kVolume, Use::data}, kReading{"Volume", kVolume, Use::reading},
      kMeshes{"Mesh", kMesh, Use::reading}, kRays{"Light", kVolume, Use::view},
      kLight{"Light", kVolume | kMesh, Use::view}, kLightData{"Light", kVolume | kMesh, Use::data},
      kOfPictures{"Pictures", kPictures, Use::data}, kPictureCost{"Pictures", kPictures, Use::cost},
      kLightCost{"Light", kVolume, Use::cost}, kTruth{"Reference", kVolume, Use::truth},
      kField{"Field", kAny, Use::field}, kFrame{"Field", kAny, Use::frame},
      kStates{"Field", kVolume, Use::frame}, kReveal{"Field", kVolume, Use::field};
  Type ids{Form::wholes, "ID,...", -0x1p63, 0x1p63, false, 0};
  Type box{Form::box, "X:X,Y:Y,Z:Z"};
  Type planes{Form::planes, "X,Y,Z,NX,NY,NZ", -kMaxLength, kMaxLength};
  Type scalar{Form::choice, "TYPE"};
  for (int k = 0; k <= static_cast<int>(ScalarType::f64); ++k)
    scalar.names.push_back(name(static_cast<ScalarType>(k)));
  std::vector<Option> all;
  const auto inside = [](auto outer) {  // accessors of the members of a member
    return [=](auto member) {
      return [=](auto& r) -> auto& { return std::invoke(member, std::invoke(outer, r)); };
    };
  };
  const auto reading = inside(&Recipe::reading);
  const auto raw = inside(&Recipe::raw);
  const auto raycast = inside(&Recipe::raycast);
  const auto lighting = inside(raycast(&RaycastOptions::lighting));
  const auto tone = inside(lighting(&LightOptions::tone));
  const auto pictures = inside(&Recipe::pictures);
  const auto field = inside(&Recipe::field);
  const auto shape = inside(field(&BuildOptions::shape));
  const auto add = [&](Option option) -> Option& { return all.emplace_back(std::move(option)); };
  const auto add_rare = [&](Option option) -> Option& {
    option.rare = true;
    return add(std::move(option));
  };

  add(row("input", {"Input", kAny, Use::input}, kFile,
          "A volume, a DICOM folder, a mesh, pictures:FOLDER, pictures:JSON or scene:NAME",
          &Recipe::input));

  // Volumes.
  add(row(
      "transfer", kData, kFile,
      "Transfer function: a built-in name (see `slf transfer`), or a file of ParaView, 3D Slicer "
      "or MRIcroGL; FILE#NAME for one of several; default: made from the histogram",
      &Recipe::transfer));
  add(row("range", kData, numbers("LO,HI", 2, -1e300, 1e300),
          "Stretch the transfer function to these values of the volume", &Recipe::range));
  add(row(
      "labels_volume", kData, kFile,
      "Label volume: each label gets a colour; on another grid it is resampled by world position "
      "(nearest voxel)",
      &Recipe::labels_volume));
  add(row(
      "label_table", kData, kFile,
      "Colour and opacity by id: a table of ITK-SNAP, 3D Slicer (.ctbl, .csv) or FreeSurfer, or "
      "JSON; for {labels_volume} or {labels}",
      &Recipe::label_table));
  add_rare(row("only_labels", kData, ids,
               "Show these labels alone, by id; what is hidden keeps its shadows",
               &Recipe::only_labels));
  add(row("mask", kData, kFile, "Show the volume only where this mask is not 0", &Recipe::mask));
  add(row(
      "clip", kData, planes,
      "Remove what lies beyond a plane (world): on the side of X,Y,Z that the normal points to; "
      "may be repeated",
      raycast(&RaycastOptions::clip)));
  add(flag("labels", kReading, "Voxels are labels: nearest sampling, a colour for each label",
           reading(&VolumeOptions::labels)))
      .in_memory = true;
  add(row("dims", kReading, {Form::wholes, "NXxNYxNZ", 1, kMaxCount, false, 3, 'x'},
          "Raw files: voxels along x, y, z, as 128x128x84", raw(&RawLayout::dims)));
  add_rare(row("type", kReading, scalar, "Raw files: type of a voxel", raw(&RawLayout::type)))
      .needs = "dims";
  add_rare(row("spacing", kReading, numbers("DXxDYxDZ", 3, kMinLength, kMaxLength, 'x'),
               "Distance between voxels; default: what the file says, or 1",
               reading(&VolumeOptions::spacing)));
  add_rare(row("component", kReading, whole(0, kMaxCount),
               "Component of each voxel (RGB, channels) to read, from 0",
               reading(&VolumeOptions::component)));
  add_rare(row("time", kReading, whole(0, kMaxCount),
               "Time point of a file or series to read, from 0", reading(&VolumeOptions::time)));
  add_rare(row("array", kReading, {Form::text, "NAME"},
               "Array of a VTI file, or image of an OME-TIFF, to read: its name",
               reading(&VolumeOptions::array)));
  add_rare(row("series", kReading, {Form::text, "ID"},
               "DICOM series of a folder to read: its number or UID, as `slf info` lists them",
               reading(&VolumeOptions::series)));
  add_rare(flag("resample", kReading,
                "Resample DICOM slices that are not evenly spaced, to the smallest distance",
                reading(&VolumeOptions::resample)));
  add_rare(row("crop", kReading, box, "Keep these voxels only: half-open ranges, as 10:200,:,50:",
               reading(&VolumeOptions::crop)));
  add_rare(choice<bool>("endian", kReading, {{"little", false}, {"big", true}},
                        "Raw files: order of a voxel's bytes", raw(&RawLayout::big_endian)))
      .needs = "dims";
  add_rare(row("offset", kReading, whole(0, 0x1p53), "Raw files: bytes before the first voxel",
               raw(&RawLayout::offset)))
      .needs = "dims";

  // Meshes.
  add(choice<UpAxis>(
      "up_axis", kMeshes, {{"y", UpAxis::y}, {"z", UpAxis::z}},
      "Axis of a mesh's file that becomes +z, up; the y axis is the default for glTF "
      "and OBJ, z for PLY and STL",
      &Recipe::up_axis));

  // Rays and light.
  add_rare(row(
      "step", kRays, above(0.01, 100),
      "Longest part of a ray that is one sample, in smallest voxel spacings; at most one cell of "
      "the volume",
      raycast(&RaycastOptions::step)));
  add_rare(choice<Projection>(
               "projection", kRays, {std::begin(kProjections), std::end(kProjections)},
               "Show one value of each ray, unlit: the greatest (mip), the least (minip) or "
               "the mean of those with opacity",
               raycast(&RaycastOptions::projection)))
      .excludes = "lighting";
  add_rare(row(
      "light", kLight, kPosition,
      "World direction towards the light (LPS); default: above, in front, to the patient's right",
      &Recipe::light));
  add_rare(row("ambient", kLight, number(0, 1),
               "Ambient share of the shading, 0 to 1; implies {lighting} direct", &Recipe::ambient))
      .otherwise = "0.3";
  add_rare(flag("shade", kLight,
                "Colours as in the transfer function, unlit; implies {lighting} direct",
                raycast(&RaycastOptions::shade)))
      .negative = "--no-shade";
  Option& mode = add(choice<std::optional<Lighting>>(
      "lighting", kLight, {std::begin(kLightings), std::end(kLightings)},
      "global: a rig of lights and its surroundings, with shadows and scattered light; shadowed: "
      "without scattered light; direct: one light without shadows, which needs no light volume",
      &Recipe::lighting));
  mode.otherwise = "global";
  mode.excludes = "projection";
  add(row("light_rig", kLight, kFile,
          "Lights and sky of shadowed and global light: " +
              joined(built_in_rigs(), ", ", &LightRig::name) + ", or a JSON file",
          &Recipe::light_rig))
      .otherwise = built_in_rigs().front().name;
  add_rare(row(
      "environment", kLightData, kFile,
      "Picture that surrounds the volume instead of the rig's sky: latitude-longitude OpenEXR or "
      "Radiance HDR, up being +z and the middle the front",
      &Recipe::environment));
  add_rare(row("environment_gain", kLight, number(0, 1e6),
               "Factor of the environment picture's radiance",
               lighting(&LightOptions::environment_gain)));
  add_rare(row("light_samples", kLight, whole(1, 65536),
               "Paths of light per node of the light volume: more take longer and leave less noise",
               lighting(&LightOptions::samples)));
  add_rare(row("light_bounces", kLight, whole(0, 1000),
               "Maximum number of scattering events of a path (global)",
               lighting(&LightOptions::bounces)));
  add_rare(row("light_spacing", kLight, number(0.5, 16),
               "Distance between nodes of the light volume, in voxels",
               lighting(&LightOptions::spacing)));
  add_rare(
      row("light_memory", kLight, kBytes,
          "Memory limit for computing the light volume; if it does not suffice, nodes are further "
          "apart",
          lighting(&LightOptions::memory)));
  add_rare(
      row("light_seed", kLight, whole(0, 0x1p63), "Random seed", lighting(&LightOptions::seed)));
  add_rare(row("light_file", kLightCost, kFile,
               "Keep the light volume in this file, and read it from there if it is the "
               "same; of states, {state} in its name stands for theirs",
               inside(&Recipe::light_volume)(&LightVolumeOptions::file)));
  add(row("exposure", kLight, number(-20, 20),
          "Exposure of shadowed or global light, in photographic stops",
          tone(&ToneMapping::exposure)));
  add_rare(choice<ToneCurve>(
      "tonemap", kLight, {std::begin(kToneCurves), std::end(kToneCurves)},
      "Tone curve from radiance to colours: neutral compresses highlights, srgb clips them, none "
      "keeps linear radiance",
      tone(&ToneMapping::curve)));
  add(flag("reference", kTruth, "Path tracing instead of the light volume: unbiased, slow",
           &Recipe::reference));
  add_rare(row("samples", kTruth, whole(1, 1 << 24), "Paths per ray",
               inside(&Recipe::paths)(&PathTraceOptions::samples)))
      .needs = "reference";

  // Pictures.
  add(choice<DepthKind>(
      "depth_kind", kOfPictures,
      {{"z", DepthKind::z},
       {"ray", DepthKind::ray},
       {"inverse", DepthKind::inverse},
       {"none", DepthKind::none}},
      "What the pictures' depths mean: distance along the axis (z) or from the eye "
      "(ray), or 1/z (inverse); none: neither use nor estimate depths; default: z "
      "or ray, found by comparing pictures",
      pictures(&PictureSceneOptions::depth)));
  add_rare(row("depth_scale", kOfPictures, number(kMinLength, kMaxLength),
               "World units of one unit in depth pictures, as 0.001",
               pictures(&PictureSceneOptions::depth_scale)));
  add_rare(row("holdout", kOfPictures, whole(2, 1000000),
               "Leave out every N-th picture, from the first on, for `slf evaluate`",
               pictures(&PictureSceneOptions::holdout)))
      .otherwise = "";
  add_rare(row("voxels", kOfPictures, whole(32, 768),
               "Voxels along an edge of the grid that holds the object's surface",
               pictures(&PictureSceneOptions::voxels)));
  add_rare(row("picture_memory", kPictureCost, kBytes, "Memory limit for decoded pictures",
               pictures(&PictureSceneOptions::memory)));
  add_rare(
      choice<bool>("background_model", kOfPictures, {{"keep", true}, {"drop", false}},
                   "Of pictures without alpha or masks: drop what lies outside the sphere, or keep "
                   "it, as if painted on the sphere's far side; default: drop",
                   pictures(&PictureSceneOptions::keep_background)));
  add_rare(row(
      "depth_cache", kPictureCost, kFile,
      "File that keeps estimated depths for the next run, or none; default: beside the pictures, "
      "as *.slf-depths",
      &Recipe::depth_cache));

  // The field.
  add(flag("each_label", kStates,
           "Build a state of each structure of a label volume (doc/structures.md)",
           &Recipe::each_label));
  add_rare(flag("each_time", kStates, "Build a state of each time point of a file or series",
                &Recipe::each_time))
      .excludes = "each_label";
  add(choice<std::tuple<unsigned, unsigned, unsigned>>(
      "quality", kField, {{"draft", {8, 32, 1}}, {"normal", {8, 32, 2}}, {"fine", {16, 32, 2}}},
      "Lattices and levels: draft, {finest_level} 1, a sixteenth of the rays; normal; or fine, "
      "{entry} 16, four times the rays; instead of {entry}, {exit} and {finest_level}",
      [](auto& r) {
        auto& of = r.field.shape;
        return std::tie(of.entry_side, of.exit_side, of.finest_level);
      }));
  add_rare(row("entry", kField, whole(1, FieldShape::kMaxSide),
               "Entry lattice at level 0: cells along an octsphere's edge",
               shape(&FieldShape::entry_side)))
      .excludes = "quality";
  add_rare(row("exit", kField, whole(1, FieldShape::kMaxSide), "Exit lattice at level 0",
               shape(&FieldShape::exit_side)))
      .excludes = "quality";
  Option& finest = add(row("finest_level", kField, whole(0, 10),
                           "Tiles at levels 0 to this; each level doubles both lattices",
                           shape(&FieldShape::finest_level)));
  finest.former = "levels";
  finest.excludes = "quality";
  add_rare(row("entry_extra_levels", kField, whole(0, 10),
               "How many levels further than the exit side the entry side is split into tiles",
               shape(&FieldShape::entry_extra_levels)))
      .former = "entry_depth";
  add(row("codec", kField, {Form::text, "CODEC"},
          "predictive:QUALITY, predictive:lossless, jpeg:QUALITY[:444], zstd[:LEVEL] or raw",
          field(&BuildOptions::codec)));
  add_rare(flag("depth", kField, "Colours alone, without depths; not with predictive",
                field(&BuildOptions::depth)))
      .negative = "--no-depth";
  add_rare(choice<bool>("color_type", kField, {{"u8", false}, {"half", true}},
                        "u8, or half: HDR colour, which JPEG cannot store",
                        field(&BuildOptions::half)));
  add_rare(flag(
      "keep_light", kStates,
      "Keep the light volume in the field, so that evaluate and a resumed build need not compute "
      "it",
      field(&BuildOptions::keep_light)));
  add_rare(row("center", kFrame, kPosition,
               "Centre of the sphere in world coordinates; default: around what is visible",
               &Recipe::center));
  add_rare(row("radius", kFrame, number(kMinLength, kMaxLength),
               "Radius of the sphere in world units; default: around what is visible",
               &Recipe::radius));
  add(row(
      "reveal", kReveal, whole(16, Reveal::kMaxSide),
      "Keep a small copy of the volume in the field, 8 bits a voxel, its longest side this: cuts "
      "through the field then show the inside. It publishes the scan (doc/cut.md)",
      &Recipe::reveal));
  add_rare(row("reveal_window", kReveal, {Form::text, "LO,HI"},
               "Values of the volume that the copy keeps, all of them; visible: leave out voxels "
               "that touch nothing visible",
               &Recipe::reveal_window))
      .needs = "reveal";
  add_rare(row(
               "reveal_loss", kReveal, whole(0, Reveal::kMaxLoss),
               "By how much the copy's bytes may be off, of 255; with 4, it takes less than half",
               [](auto& r) -> auto& { return r.reveal_loss; }))
      .needs = "reveal";
  return all;
}

}  // namespace

std::vector<Option>& table() {
  static std::vector<Option> all = make_options();
  return all;
}

std::span<const Option> options() { return table(); }

const Option* find(std::string_view name) {
  const auto found = std::ranges::find(options(), name, &Option::name);
  return found == options().end() ? nullptr : &*found;
}

}  // namespace slf::recipe

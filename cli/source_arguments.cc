// Options of the source of rays: a volume with its transfer function, structures and light, a mesh,
// or an analytic scene.
#include <algorithm>
#include <cmath>
#include <tuple>

#include "base/try.h"
#include "cli/command.h"
#include "slf/mesh.h"
#include "slf/path_tracer.h"
#include "slf/scene.h"
#include "slf/structures.h"
#include "slf/transfer.h"

namespace slf::cli {
namespace {

constexpr std::string_view kScenePrefix = "scene:";
constexpr std::string_view kPicturesPrefix = "pictures:";
/// In the error of a file that is in no known format.

const Choices<ScalarType> kScalarTypes{{"u8", ScalarType::u8},   {"i8", ScalarType::i8},
                                       {"u16", ScalarType::u16}, {"i16", ScalarType::i16},
                                       {"u32", ScalarType::u32}, {"i32", ScalarType::i32},
                                       {"u64", ScalarType::u64}, {"i64", ScalarType::i64},
                                       {"f32", ScalarType::f32}, {"f64", ScalarType::f64}};

/// Replaces any usual name of a type, such as "uint16" or "float", by the short one.
std::string shorten_type(std::string& text) {
  if (const auto type = parse_scalar_type(text)) text = name(*type);
  return "";
}

/// Parses "10:200,:,50:", half-open ranges. An empty start or end is that of the volume.
Result<VoxelBox> parse_crop(const std::string& text) {
  VoxelBox box;
  const auto parts = CLI::detail::split(text, ',');
  bool ok = parts.size() == 3;
  for (std::size_t i = 0; ok && i < 3; ++i) {
    const auto colon = parts[i].find(':');
    ok = colon != std::string::npos;
    for (const bool first : {true, false}) {
      if (!ok) break;
      const std::string end = first ? parts[i].substr(0, colon) : parts[i].substr(colon + 1);
      if (end.empty()) continue;
      std::uint32_t& value = (first ? box.begin : box.end)[i];
      ok = end.find_first_not_of("0123456789") == std::string::npos &&
           CLI::detail::lexical_cast(end, value) && (first || value > 0);
    }
  }
  if (!ok)
    return fail(ErrorCode::usage, "--crop ", text, ": expected X0:X1,Y0:Y1,Z0:Z1, as 10:200,:,50:");
  return box;
}

}  // namespace

void SourceArguments::add_volume_to(CLI::App& command, const char* name) {
  command
      .add_option(name, input,
                  std::string(kVolumeHelp) + ", or\n" + kMeshHelp + ", or\n" +
                      "pictures:FOLDER or pictures:JSON, with cameras (doc/pictures.md), or\n"
                      "scene:balls, scene:globe, scene:fog")
      ->type_name(kAnyFile)
      ->required();
  command
      .add_option("--transfer", transfer,
                  std::string(kTransferHelp) + "; default: made from the histogram")
      ->type_name(kAnyFile)
      ->group(kVolumeGroup);
  command
      .add_option("--range", range, "Stretch the transfer function to these values of the volume")
      ->delimiter(',')
      ->type_size(2)
      ->expected(1)
      ->type_name("LO,HI")
      ->group(kVolumeGroup);
  auto* parts =
      command
          .add_option("--labels-volume", labels_volume,
                      "Label volume: each label gets a colour; on another grid it is resampled\n"
                      "by world position (nearest voxel)")
          ->type_name(kAnyFile)
          ->group(kVolumeGroup);
  command
      .add_option("--label-table", label_table,
                  "Colour and opacity by id: a table of ITK-SNAP, 3D Slicer (.ctbl, .csv) or\n"
                  "FreeSurfer, or JSON")
      ->type_name(kAnyFile)
      ->needs(parts)
      ->group(kVolumeGroup);
  command.add_option("--mask", mask, "Show the volume only where this mask is not 0")
      ->type_name(kAnyFile)
      ->group(kVolumeGroup);
  add_raw_to(command);
  add_mesh_to(command);
}

void SourceArguments::add_mesh_to(CLI::App& command) {
  choose(command.add_option("--up-axis", up_axis,
                            "Axis of a mesh's file that becomes +z, up; the y axis is the default\n"
                            "for glTF and OBJ, z for PLY and STL"),
         Choices<UpAxis>{{"y", UpAxis::y}, {"z", UpAxis::z}})
      ->type_name("TEXT")
      ->group("Mesh");
}

void SourceArguments::add_pictures_to(CLI::App& command) {
  const char* group = "Pictures";
  choose(
      command.add_option("--depth", pictures.depth,
                         "What the pictures' depths mean: distance along the axis (z) or from the\n"
                         "eye (ray), or 1/z (inverse); none: neither use nor estimate depths;\n"
                         "default: z or ray, found by comparing pictures"),
      Choices<DepthKind>{{"z", DepthKind::z},
                         {"ray", DepthKind::ray},
                         {"inverse", DepthKind::inverse},
                         {"none", DepthKind::none}})
      ->type_name("TEXT")
      ->group(group);
  command
      .add_option("--depth-scale", pictures.depth_scale,
                  "World units of one unit in depth pictures, as 0.001")
      ->check(kLength)
      ->group(group)
      ->capture_default_str();
  command
      .add_option("--holdout", pictures.holdout,
                  "Leave out every N-th picture, from the first on, for `slf evaluate`")
      ->check(CLI::Range(2, 1000000).description(""))
      ->type_name("N")
      ->group(group);
  command
      .add_option("--voxels", pictures.voxels,
                  "Voxels along an edge of the grid that holds the object's surface")
      ->check(CLI::Range(32, 768).description(""))
      ->group(group)
      ->capture_default_str();
  add_bytes(command, "--picture-memory", pictures.memory, "Memory limit for decoded pictures")
      ->group(group);
  choose(
      command.add_option("--background-model", pictures.keep_background,
                         "Of pictures without alpha or masks: drop what lies outside the sphere, "
                         "or\nkeep it, as if painted on the sphere's far side; default: drop"),
      Choices<bool>{{"keep", true}, {"drop", false}})
      ->type_name("TEXT")
      ->group(group);
  depth_cache = "";
  command
      .add_option("--depth-cache", depth_cache,
                  "File that keeps estimated depths for the next run, or none; default: beside\n"
                  "the pictures, as *.slf-depths")
      ->type_name(kAnyFile)
      ->group(group);
}

bool SourceArguments::is_pictures() const { return input.starts_with(kPicturesPrefix); }

Result<PictureSet> SourceArguments::read_picture_set() const {
  auto set = read_pictures(input.substr(kPicturesPrefix.size()));
  if (set)
    for (const std::string& remark : set->notes) note(set->source + ": " + remark);
  return set;
}

PictureSceneOptions SourceArguments::picture_options(const PictureSet& set,
                                                     unsigned threads) const {
  PictureSceneOptions options = pictures;
  options.threads = threads;
  options.progress = late_progress_bar("pictures", "pictures", OnSignal::end);
  options.on_note = [source = set.source](const std::string& text) {
    note(source + ": " + text + "; --depth-cache names another place");
  };
  if (depth_cache && *depth_cache != "none")
    options.depth_cache = depth_cache->empty() ? depth_cache_of(set) : *depth_cache;
  return options;
}

void SourceArguments::add_raw_to(CLI::App& command) {
  const char* group = kVolumeGroup;
  command
      .add_flag("--labels", labels, "Voxels are labels: nearest sampling, a colour for each label")
      ->group(group);
  auto* raw = command.add_option("--dims", dims, "Raw files: voxels along x, y, z, as 128x128x84")
                  ->delimiter('x')
                  ->type_size(3)
                  ->expected(1)
                  ->check(from_to(1, UINT32_MAX))
                  ->type_name("NXxNYxNZ")
                  ->group(group);
  choose(command.add_option("--type", type, "Raw files: type of a voxel"), kScalarTypes)
      ->transform(CLI::Validator(shorten_type, ""))
      ->type_name("TYPE")
      ->needs(raw)
      ->group(group)
      ->default_str("u8");
  command
      .add_option("--spacing", spacing,
                  "Distance between voxels; default: what the file says, or 1")
      ->delimiter('x')
      ->type_size(3)
      ->expected(1)
      ->check(kLength)
      ->type_name("DXxDYxDZ")
      ->group(group);
  command
      .add_option("--component", component,
                  "Component of each voxel (RGB, channels) to read, from 0")
      ->check(kNotNegative)
      ->type_name("N")
      ->group(group);
  command.add_option("--time", time, "Time point of a file or series to read, from 0")
      ->check(kNotNegative)
      ->type_name("N")
      ->group(group);
  command
      .add_option("--array", array,
                  "Array of a VTI file, or image of an OME-TIFF, to read: its name")
      ->type_name("NAME")
      ->group(group);
  command
      .add_option("--series", series,
                  "DICOM series of a folder to read: its number or UID, as `slf info` lists them")
      ->type_name("ID")
      ->group(group);
  command
      .add_flag("--resample", resample,
                "Resample DICOM slices that are not evenly spaced, to the smallest distance")
      ->group(group);
  command.add_option("--crop", crop, "Keep these voxels only: half-open ranges, as 10:200,:,50:")
      ->type_name("X:X,Y:Y,Z:Z")
      ->group(group);
  choose(command.add_option("--endian", big_endian, "Raw files: order of a voxel's bytes"),
         Choices<bool>{{"little", false}, {"big", true}})
      ->type_name("TEXT")
      ->needs(raw)
      ->group(group)
      ->default_str("little");
  command.add_option("--offset", offset, "Raw files: bytes before the first voxel")
      ->check(kNotNegative)
      ->needs(raw)
      ->group(group)
      ->capture_default_str();
}

void SourceArguments::add_light_to(CLI::App& command) {
  const char* group = "Light";
  command
      .add_option("--step", raycast.step,
                  "Longest part of a ray that is one sample, in smallest voxel spacings; at most\n"
                  "one cell of the volume")
      ->check(above(0.01, 100))
      ->group(group)
      ->capture_default_str();
  auto* projection =
      choose(command.add_option("--projection", raycast.projection,
                                "Show one value of each ray, unlit: the greatest (mip), the least\n"
                                "(minip) or the mean of those with opacity"),
             Choices<Projection>{{"mip", Projection::maximum},
                                 {"minip", Projection::minimum},
                                 {"mean", Projection::mean}})
          ->type_name("TEXT")
          ->group(group);
  add_vector(command, "--light", light,
             "World direction towards the light (LPS); "
             "default: above, in front, to the patient's right")
      ->group(group);
  command
      .add_option("--ambient", ambient,
                  "Ambient share of the shading, 0 to 1; implies --lighting direct")
      ->check(from_to(0, 1))
      ->group(group)
      ->default_str(fmt::format("{:g}", raycast.ambient));
  command
      .add_flag("--no-shade", no_shade,
                "Colours as in the transfer function, unlit; implies --lighting direct")
      ->group(group);
  LightOptions& lighting = raycast.lighting;
  lighting.mode = Lighting::global;
  auto* mode =
      choose(command.add_option(
                 "--lighting", chosen_lighting,
                 "global: a rig of lights and its surroundings, with shadows and scattered\n"
                 "light; shadowed: without scattered light; direct: one light without\n"
                 "shadows, which needs no light volume"),
             Choices<Lighting>{{"direct", Lighting::direct},
                               {"shadowed", Lighting::shadowed},
                               {"global", Lighting::global}})
          ->type_name("TEXT")
          ->group(group)
          ->default_str("global");
  mode->excludes(projection);
  std::string names;
  for (const LightRig& rig : built_in_rigs()) names += (names.empty() ? "" : ", ") + rig.name;
  command
      .add_option("--light-rig", light_rig,
                  "Lights and sky of shadowed and global light: " + names + ",\nor a JSON file")
      ->type_name(kAnyFile)
      ->group(group)
      ->default_str(built_in_rigs().front().name);
  add_environment_to(command);
  command
      .add_option("--environment-gain", lighting.environment_gain,
                  "Factor of the environment picture's radiance")
      ->check(from_to(0, 1e6))
      ->group(group)
      ->capture_default_str();
  command
      .add_option("--light-samples", lighting.samples,
                  "Paths of light per node of the light volume: more take longer and leave\n"
                  "less noise")
      ->check(CLI::Range(1, 65536).description(""))
      ->group(group)
      ->capture_default_str();
  command
      .add_option("--light-bounces", lighting.bounces,
                  "Maximum number of scattering events of a path (global)")
      ->check(CLI::Range(0, 1000).description(""))
      ->group(group)
      ->capture_default_str();
  command
      .add_option("--light-spacing", lighting.spacing,
                  "Distance between nodes of the light volume, in voxels")
      ->check(from_to(0.5, 16))
      ->group(group)
      ->capture_default_str();
  add_bytes(command, "--light-memory", lighting.memory,
            "Memory limit for computing the light volume; if it does not suffice,\n"
            "nodes are further apart")
      ->group(group);
  command.add_option("--light-seed", lighting.seed, "Random seed")
      ->group(group)
      ->capture_default_str();
  add_light_file_to(command);
  add_tone(command, lighting.tone, group);
}

void SourceArguments::add_light_file_to(CLI::App& command) {
  command
      .add_option("--light-file", light_file,
                  "Keep the light volume in this file, and read it from there if it is the same")
      ->type_name(kAnyFile)
      ->group("Light");
}

void SourceArguments::add_environment_to(CLI::App& command) {
  command
      .add_option("--environment", environment,
                  "Picture that surrounds the volume instead of the rig's sky: latitude-longitude\n"
                  "OpenEXR or Radiance HDR, up being +z and the middle the front")
      ->type_name(kAnyFile)
      ->group("Light");
}

void SourceArguments::add_reference_to(CLI::App& command) {
  auto* flag = command.add_flag("--reference", reference,
                                "Path tracing instead of the light volume: unbiased, slow");
  command.add_option("--samples", paths.samples, "Paths per ray")
      ->check(CLI::Range(1, 1 << 24).description(""))
      ->needs(flag)
      ->capture_default_str();
}

Result<void> SourceArguments::set_light(RaycastOptions& options) const {
  if (!light_rig.empty()) {
    options.lighting.rig = SLF_TRY(read_rig(light_rig));
  }
  if (!light.empty()) {
    options.light = to_vector(light);
    if (auto& lights = options.lighting.rig.lights; !lights.empty())
      lights.front().direction = options.light;
  }
  if (!environment.empty()) {
    auto picture = SLF_TRY(read_image(environment));
    options.lighting.environment = std::make_shared<const Image>(std::move(picture));
  }
  return {};
}

std::vector<std::string> SourceArguments::files() const {
  return {input, transfer, labels_volume, label_table, mask, light_rig, environment, light_file};
}

Result<Volume> SourceArguments::volume() const { return read(input, labels); }

Result<Volume> SourceArguments::read(const std::string& path, bool ids) const {
  VolumeOptions options;
  options.labels = ids;
  options.component = component;
  options.time = time;
  if (!array.empty() && path == input) options.array = array;  // labels have their own file
  options.resample = resample;
  if (path == input) options.series = series;
  if (!crop.empty()) {
    options.crop = SLF_TRY(parse_crop(crop));
  }
  if (!spacing.empty()) options.spacing = to_vector(spacing);
  if (!dims.empty()) {
    RawLayout layout;
    for (std::size_t axis = 0; axis < 3; ++axis) layout.dims[axis] = dims[axis];
    layout.spacing = options.spacing.value_or(layout.spacing);
    layout.type = type;
    layout.big_endian = big_endian;
    layout.offset = offset;
    options.raw = layout;
  }
  auto volume = read_volume(path, options);
  if (volume) return volume;
  const Error& error = volume.error();
  if (!error.choice) return volume;
  if (std::string_view(error.choice) != "raw")
    return with_hint(error, std::string("see --") + error.choice);
  return with_hint(error, options.raw ? "see --dims, --type, --spacing and --offset"
                                      : "for example `--dims 128x128x84 --type u8 "
                                        "--spacing 1x1x1.5 --offset 62`");
}

Result<Volume> SourceArguments::structure(const std::string& path) const {
  // Structures are placed by position, so --crop does not concern them. They mostly have a header
  // and one number a voxel, also where the volume does not.
  SourceArguments own = *this;
  own.crop.clear();
  own.component.reset();
  own.time.reset();
  own.dims.clear();
  if (!dims.empty()) own.spacing.clear();
  auto volume = own.read(path, true);
  if (volume) return volume;
  const std::string_view choice = volume.error().choice ? volume.error().choice : "";
  if (choice == "raw" && !dims.empty()) {
    own.dims = dims;
    own.spacing = spacing;
  } else if ((choice == "component" || choice == "time") && (component || time)) {
    own.component = component;
    own.time = time;
  } else {
    return volume;
  }
  return own.read(path, true);
}

Result<void> SourceArguments::set_structures(RaycastOptions& options) const {
  Structures& parts = options.structures;
  if (!label_table.empty()) {
    parts.styles = SLF_TRY(read_label_table(label_table));
  }
  const auto set = [&](const std::string& path, std::shared_ptr<const Volume>& to) -> Result<void> {
    if (path.empty()) return {};
    auto volume = SLF_TRY(structure(path));
    for (const std::string& remark : volume.notes) note(path + ": " + remark);
    if (label_table.empty() && path == labels_volume) parts.styles = volume.label_styles;
    to = std::make_shared<const Volume>(std::move(volume));
    return {};
  };
  SLF_TRY(set(labels_volume, parts.labels));
  return set(mask, parts.mask);
}

RaycastOptions SourceArguments::stated_options() const {
  RaycastOptions options = raycast;
  options.shade = !no_shade && options.projection == Projection::none;
  options.ambient = ambient.value_or(options.ambient);
  const bool direct = !options.shade || ambient;
  options.lighting.mode =
      chosen_lighting.value_or(direct ? Lighting::direct : options.lighting.mode);
  return options;
}

Result<Mesh> SourceArguments::mesh() const {
  auto mesh = read_mesh(input, up_axis);
  if (mesh)
    for (const std::string& remark : mesh->notes) note(input + ": " + remark);
  return mesh;
}

Result<std::unique_ptr<Scene>> SourceArguments::mesh_scene(const nlohmann::json& built) const {
  for (const auto& [option, given] : {std::pair{"--transfer", !transfer.empty()},
                                      {"--range", !range.empty()},
                                      {"--labels-volume", !labels_volume.empty()},
                                      {"--mask", !mask.empty()},
                                      {"--labels", labels},
                                      {"--crop", !crop.empty()},
                                      {"--dims", !dims.empty()},
                                      {"--projection", raycast.projection != Projection::none},
                                      {"--light-file", !light_file.empty()},
                                      {"--reference", reference}})
    if (given) return fail(ErrorCode::usage, option, ": only for volumes; ", input, " is a mesh");
  RaycastOptions options = stated_options();
  if (text_of(built, "kind", "") == "mesh") {
    options = raycast_options(built.dump());
    SLF_TRY(check_environment(built));
  }
  SLF_TRY(set_light(options));
  return MeshScene::make(SLF_TRY(mesh()),
                         {options.shade, options.light, options.ambient, options.lighting});
}

Result<void> SourceArguments::check_environment(const nlohmann::json& built) const {
  if (built.contains("lighting") && built["lighting"].contains("environment") &&
      environment.empty())
    return fail(ErrorCode::usage,
                "the field was lit by an environment picture; pass it with --environment");
  return {};
}

Result<std::unique_ptr<Scene>> SourceArguments::scene(
    const LightVolumeOptions& light_volume, const std::optional<std::string>& provenance) const {
  if (input.starts_with(kScenePrefix))
    return make_analytic_scene(std::string_view(input).substr(kScenePrefix.size()));
  if (is_pictures()) {
    auto set = SLF_TRY(read_picture_set());
    const auto options = picture_options(set, light_volume.threads);
    auto made = make_picture_scene(std::move(set), options);
    if (!made && made.error().message.find("state what they are") != std::string::npos)
      return with_hint(made.error(), "see --depth and --depth-scale");
    if (!made && made.error().message.find("radius") != std::string::npos)
      return with_hint(made.error(), "see --center and --radius");
    return made;
  }
  const auto built = provenance ? nlohmann::json::parse(*provenance) : nlohmann::json::object();
  if (is_mesh_name(input)) return mesh_scene(built);
  RaycastOptions options = stated_options();
  std::optional<TransferPreset> preset;
  if (text_of(built, "kind", "") == "volume") {
    options = raycast_options(*provenance);
    auto parsed = SLF_TRY(parse_transfer(built.value("transfer", nlohmann::json()).dump(),
                                         "the field's transfer function"));
    preset = TransferPreset{.function = std::move(parsed)};
    SLF_TRY(check_environment(built));
    const auto parts = built.value("structures", nlohmann::json::object());
    for (const auto& [member, path, option] :
         {std::tuple{"labels", &labels_volume, "--labels-volume"}, {"mask", &mask, "--mask"}})
      if (parts.contains(member) && path->empty())
        return fail(ErrorCode::usage, "the field was built with ", option, "; pass the same file");
  }
  options.step = std::min(options.step, longest_step);
  SLF_TRY(set_light(options));
  // Read the small file first, so that an error in it is found before a large volume is read.
  if (!transfer.empty()) {
    preset = SLF_TRY(read_transfer(transfer));
  }
  std::optional<std::array<double, 2>> stretched;
  if (!range.empty()) {
    if (!(range[0] < range[1]) || !std::isfinite(range[1] - range[0]))
      return fail(ErrorCode::usage, "--range ", range[0], ",", range[1],
                  ": expected two ascending numbers, LO,HI");
    stretched = {range[0], range[1]};
  }
  SLF_TRY(set_structures(options));
  auto volume = SLF_TRY(this->volume());
  for (const std::string& remark : volume.notes) note(volume.source + ": " + remark);
  for (const auto& part : {options.structures.labels, options.structures.mask})
    if (part && !same_grid(*part, volume))
      note(
          fmt::format("{}: {}x{}x{} voxels on another grid than {}: resampled, nearest, by world "
                      "position",
                      part->source, part->dims[0], part->dims[1], part->dims[2], volume.source));
  if (!labels && looks_like_labels(volume)) note(volume.source + ": " + kLabelsHint);
  // A transfer function from the histogram or from a field is already fitted to the volume.
  if (!preset) preset = TransferPreset{.function = default_transfer(volume)};
  const TransferFunction function =
      transfer.empty() && !stretched ? preset->function : preset->fit(volume, stretched);
  Result<std::unique_ptr<Scene>> made = fail(ErrorCode::failed, "");
  if (reference)
    made = PathTracer::make(std::move(volume), function, options, paths);
  else
    made = Raycaster::make(std::move(volume), function, options, light_volume);
  if (!made && made.error().code == ErrorCode::failed && stop_signal() == 0)
    return with_hint(
        made.error(),
        fmt::format("it runs from {:g} to {:g}: choose another --transfer, or stretch it "
                    "by --range",
                    function.colors.front().value, function.colors.back().value));
  return made;
}

}  // namespace slf::cli

// The options that describe a scene, and what they need beside their values: hints and progress.
#include <algorithm>

#include "base/join.h"
#include "cli/command.h"

namespace slf::cli {
namespace {

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
VoxelBox parse_crop(const std::string& text) {
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
  if (ok) return box;
  throw CLI::ValidationError("--crop", text + ": expected X0:X1,Y0:Y1,Z0:Z1, as 10:200,:,50:");
}

}  // namespace

SourceArguments::SourceArguments() {
  on_note = [](const std::string& text, const char* choice) {
    note(choice ? text + "; " + hint_of(choice) : text);
  };
}

void SourceArguments::finish(unsigned threads, OnSignal on_signal) {
  if (raw.dims[0] > 0) reading.raw = raw;
  if (depth_cache == "none") depth_cache.reset();
  light_volume.threads = threads;
  light_volume.progress = light_progress(on_signal);
  pictures.progress = late_progress_bar("pictures", "pictures", OnSignal::end);
}

std::string hint_of(std::string_view choice) {
  static const std::map<std::string_view, const char*> others{
      {"raw", "for example `--dims 128x128x84 --type u8 --spacing 1x1x1.5 --offset 62`"},
      {"layout", "see --dims, --type, --spacing and --offset"},
      {"transfer", "see --transfer and --range"},
      {"sphere", "see --center and --radius"},
      {"center", "see --center and --radius"},
      {"depth", "see --depth-kind and --depth-scale"},
      {"tone", "see --color-type and --lighting of `slf build`"}};
  if (const auto found = others.find(choice); found != others.end()) return found->second;
  std::string option(choice);
  std::ranges::replace(option, '_', '-');
  return "see --" + option;
}

void SourceArguments::add_volume_to(CLI::App& command, const char* name) {
  add_file(command, name, input,
           kVolumeHelp + ", or\n" + kMeshHelp + ", or\n" +
               "pictures:FOLDER or pictures:JSON, with cameras (doc/pictures.md), or\n"
               "scene:balls, scene:globe, scene:fog")
      ->required();
  const OptionGroup group(command, kVolumeGroup);
  add_file(command, "--transfer", transfer,
           std::string(kTransferHelp) + "; default: made from the histogram");
  of_numbers(command.add_option_function<std::vector<double>>(
                 "--range",
                 [this](const auto& ends) {
                   range = {ends[0], ends[1]};
                 },
                 "Stretch the transfer function to these values of the volume"),
             2)
      ->type_name("LO,HI");
  add_file(command, "--labels-volume", labels_volume.path,
           "Label volume: each label gets a colour; on another grid it is resampled\n"
           "by world position (nearest voxel)");
  add_file(command, "--label-table", label_table,
           "Colour and opacity by id: a table of ITK-SNAP, 3D Slicer (.ctbl, .csv) or\n"
           "FreeSurfer, or JSON; for --labels-volume or --labels");
  command
      .add_option("--only-labels", only_labels,
                  "Show these labels alone, by id; what is hidden keeps its shadows")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->type_name("ID,...");
  add_file(command, "--mask", mask.path, "Show the volume only where this mask is not 0");
  add_clip(command, raycast.clip);
  add_raw_to(command);
  add_mesh_to(command);
}

void SourceArguments::add_mesh_to(CLI::App& command) {
  const OptionGroup group(command, "Mesh");
  choose(command.add_option("--up-axis", up_axis,
                            "Axis of a mesh's file that becomes +z, up; the y axis is the default\n"
                            "for glTF and OBJ, z for PLY and STL"),
         Choices<UpAxis>{{"y", UpAxis::y}, {"z", UpAxis::z}});
}

void SourceArguments::add_pictures_to(CLI::App& command) {
  const OptionGroup group(command, "Pictures");
  choose(
      command.add_option("--depth-kind", pictures.depth,
                         "What the pictures' depths mean: distance along the axis (z) or from the\n"
                         "eye (ray), or 1/z (inverse); none: neither use nor estimate depths;\n"
                         "default: z or ray, found by comparing pictures"),
      Choices<DepthKind>{{"z", DepthKind::z},
                         {"ray", DepthKind::ray},
                         {"inverse", DepthKind::inverse},
                         {"none", DepthKind::none}});
  add_number(command, "--depth-scale", pictures.depth_scale,
             "World units of one unit in depth pictures, as 0.001", kLength);
  add_number(command, "--holdout", pictures.holdout,
             "Leave out every N-th picture, from the first on, for `slf evaluate`",
             from_to(2, 1000000))
      ->type_name("N")
      ->default_str("");
  add_number(command, "--voxels", pictures.voxels,
             "Voxels along an edge of the grid that holds the object's surface", from_to(32, 768));
  add_bytes(command, "--picture-memory", pictures.memory, "Memory limit for decoded pictures");
  choose(
      command.add_option("--background-model", pictures.keep_background,
                         "Of pictures without alpha or masks: drop what lies outside the sphere, "
                         "or\nkeep it, as if painted on the sphere's far side; default: drop"),
      Choices<bool>{{"keep", true}, {"drop", false}});
  depth_cache = "";
  add_file(command, "--depth-cache", depth_cache,
           "File that keeps estimated depths for the next run, or none; default: beside\n"
           "the pictures, as *.slf-depths");
}

void SourceArguments::add_raw_to(CLI::App& command) {
  const OptionGroup group(command, kVolumeGroup);
  command.add_flag("--labels", reading.labels,
                   "Voxels are labels: nearest sampling, a colour for each label");
  auto* dims =
      of_numbers(
          command.add_option_function<std::vector<std::uint32_t>>(
              "--dims", [this](const auto& sides) { std::ranges::copy(sides, raw.dims.begin()); },
              "Raw files: voxels along x, y, z, as 128x128x84"),
          3, 'x')
          ->check(from_to(1, UINT32_MAX))
          ->type_name("NXxNYxNZ");
  choose(command.add_option("--type", raw.type, "Raw files: type of a voxel"), kScalarTypes)
      ->transform(CLI::Validator(shorten_type, ""))
      ->type_name("TYPE")
      ->needs(dims)
      ->default_str("u8");
  of_numbers(command.add_option_function<std::vector<double>>(
                 "--spacing", [this](const auto& lengths) { reading.spacing = to_vector(lengths); },
                 "Distance between voxels; default: what the file says, or 1"),
             3, 'x')
      ->check(kLength)
      ->type_name("DXxDYxDZ");
  add_number(command, "--component", reading.component,
             "Component of each voxel (RGB, channels) to read, from 0", kNotNegative)
      ->type_name("N");
  add_number(command, "--time", reading.time, "Time point of a file or series to read, from 0",
             kNotNegative)
      ->type_name("N");
  command
      .add_option("--array", reading.array,
                  "Array of a VTI file, or image of an OME-TIFF, to read: its name")
      ->type_name("NAME");
  command
      .add_option("--series", reading.series,
                  "DICOM series of a folder to read: its number or UID, as `slf info` lists them")
      ->type_name("ID");
  command.add_flag("--resample", reading.resample,
                   "Resample DICOM slices that are not evenly spaced, to the smallest distance");
  command
      .add_option_function<std::string>(
          "--crop", [this](const std::string& text) { reading.crop = parse_crop(text); },
          "Keep these voxels only: half-open ranges, as 10:200,:,50:")
      ->type_name("X:X,Y:Y,Z:Z");
  choose(command.add_option("--endian", raw.big_endian, "Raw files: order of a voxel's bytes"),
         Choices<bool>{{"little", false}, {"big", true}})
      ->needs(dims)
      ->default_str("little");
  add_number(command, "--offset", raw.offset, "Raw files: bytes before the first voxel",
             kNotNegative)
      ->needs(dims);
}

void SourceArguments::add_light_to(CLI::App& command) {
  const OptionGroup group(command, "Light");
  add_number(command, "--step", raycast.step,
             "Longest part of a ray that is one sample, in smallest voxel spacings; at most\n"
             "one cell of the volume",
             above(0.01, 100));
  auto* projection =
      choose(command.add_option("--projection", raycast.projection,
                                "Show one value of each ray, unlit: the greatest (mip), the least\n"
                                "(minip) or the mean of those with opacity"),
             Choices<Projection>{{"mip", Projection::maximum},
                                 {"minip", Projection::minimum},
                                 {"mean", Projection::mean}});
  of_numbers(command.add_option_function<std::vector<double>>(
                 "--light", [this](const auto& toward) { light = to_vector(toward); },
                 "World direction towards the light (LPS); "
                 "default: above, in front, to the patient's right"),
             3)
      ->check(kPlace)
      ->type_name(kVector);
  add_number(command, "--ambient", ambient,
             "Ambient share of the shading, 0 to 1; implies --lighting direct", from_to(0, 1))
      ->default_str(fmt::format("{:g}", raycast.ambient));
  command.add_flag_callback(
      "--no-shade", [this] { raycast.shade = false; },
      "Colours as in the transfer function, unlit; implies --lighting direct");
  LightOptions& options = raycast.lighting;
  auto* mode =
      choose(command.add_option(
                 "--lighting", lighting,
                 "global: a rig of lights and its surroundings, with shadows and scattered\n"
                 "light; shadowed: without scattered light; direct: one light without\n"
                 "shadows, which needs no light volume"),
             Choices<Lighting>{{"direct", Lighting::direct},
                               {"shadowed", Lighting::shadowed},
                               {"global", Lighting::global}})
          ->default_str("global");
  mode->excludes(projection);
  add_file(command, "--light-rig", light_rig,
           "Lights and sky of shadowed and global light: " +
               joined(built_in_rigs(), ", ", &LightRig::name) + ",\nor a JSON file")
      ->default_str(built_in_rigs().front().name);
  add_environment_to(command);
  add_number(command, "--environment-gain", options.environment_gain,
             "Factor of the environment picture's radiance", from_to(0, 1e6));
  add_number(command, "--light-samples", options.samples,
             "Paths of light per node of the light volume: more take longer and leave\n"
             "less noise",
             from_to(1, 65536));
  add_number(command, "--light-bounces", options.bounces,
             "Maximum number of scattering events of a path (global)", from_to(0, 1000));
  add_number(command, "--light-spacing", options.spacing,
             "Distance between nodes of the light volume, in voxels", from_to(0.5, 16));
  add_bytes(command, "--light-memory", options.memory,
            "Memory limit for computing the light volume; if it does not suffice,\n"
            "nodes are further apart");
  command.add_option("--light-seed", options.seed, "Random seed");
  add_light_file_to(command);
  add_tone(command, options.tone, "Light");
}

void SourceArguments::add_light_file_to(CLI::App& command) {
  const OptionGroup group(command, "Light");
  add_file(command, "--light-file", light_volume.file,
           "Keep the light volume in this file, and read it from there if it is the same");
}

void SourceArguments::add_environment_to(CLI::App& command) {
  const OptionGroup group(command, "Light");
  add_file(command, "--environment", environment,
           "Picture that surrounds the volume instead of the rig's sky: latitude-longitude\n"
           "OpenEXR or Radiance HDR, up being +z and the middle the front");
}

void SourceArguments::add_reference_to(CLI::App& command) {
  auto* flag = command.add_flag("--reference", reference,
                                "Path tracing instead of the light volume: unbiased, slow");
  add_number(command, "--samples", paths.samples, "Paths per ray", from_to(1, 1 << 24))
      ->needs(flag);
}

}  // namespace slf::cli

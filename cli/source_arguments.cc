// The source of rays that options state: a volume with its transfer function, structures and light,
// a mesh, pictures, or an analytic scene.
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
  return {
      input,      transfer_file(transfer), labels_volume, label_table, mask, light_rig, environment,
      light_file, depth_cache.value_or("")};
}

Result<void> SourceArguments::check_files(std::vector<std::string>& read) const {
  const std::vector<std::string> named = files();
  read.insert(read.end(), named.begin(), named.end());
  return check ? check(read) : Result<void>();
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
                                      {"--clip", !clip.empty()},
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
  auto mesh = SLF_TRY(this->mesh());
  SLF_TRY(check_files(mesh.files));
  return MeshScene::make(std::move(mesh),
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
  if (check) SLF_TRY(check(files()));
  if (input.starts_with(kScenePrefix))
    return make_analytic_scene(std::string_view(input).substr(kScenePrefix.size()));
  if (is_pictures()) {
    auto set = SLF_TRY(read_picture_set());
    auto read = set.files();
    SLF_TRY(check_files(read));
    const auto options = picture_options(set, light_volume.threads);
    auto made = make_picture_scene(std::move(set), options);
    if (made || !made.error().choice) return made;
    return with_hint(made.error(), std::string_view(made.error().choice) == "sphere"
                                       ? "see --center and --radius"
                                       : "see --depth and --depth-scale");
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
  if (!clip.empty()) options.clip.assign(clip.begin(), clip.end());
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
  for (const auto& part : {options.structures.labels, options.structures.mask})
    if (part) volume.files.insert(volume.files.end(), part->files.begin(), part->files.end());
  SLF_TRY(check_files(volume.files));
  if (!labels && looks_like_labels(volume)) note(volume.source + ": " + kLabelsHint);
  // A transfer function from the histogram or from a field is already fitted to the volume.
  if (!preset) preset = TransferPreset{.function = default_transfer(volume)};
  const TransferFunction function =
      transfer.empty() && !stretched ? preset->function : preset->fit(volume, stretched);
  Result<std::unique_ptr<Scene>> made = fail(ErrorCode::failed, "");
  if (reference)
    made = PathTracer::make(std::move(volume), function, options,
                            {paths.samples, options.lighting.seed});
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

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <tuple>
#include <utility>

#include "base/join.h"
#include "base/try.h"
#include "slf/image.h"
#include "slf/recipe.h"
#include "source/raycast/provenance.h"
#include "source/recipe/options.h"
#include "source/volume/units.h"

namespace slf {
namespace {

using nlohmann::json;

constexpr std::string_view kScenePrefix = "scene:", kPicturesPrefix = "pictures:";
constexpr double kTruthStep = 0.5;  // finer than fields need

void note(const Recipe& d, const std::string& text, const char* choice = nullptr) {
  if (d.on_note) d.on_note(text, choice);
}

void note_all(const Recipe& d, const std::string& source,
              const std::vector<std::string>& notes) {
  for (const std::string& text : notes) note(d, std::string(source).append(": ").append(text));
}

/// Adds the files that the description names to those that were `read`, and checks them.
Result<void> check_files(const Recipe& d, std::vector<std::string>& read) {
  const std::vector<std::string> named = d.files();
  read.insert(read.end(), named.begin(), named.end());
  return d.check ? d.check(read) : Result<void>();
}

/// The provenance of the field to compare with, if it is of this kind.
json recorded(const Recipe& d, const char* kind) {
  json built = json::parse(d.truth_of, nullptr, /*allow_exceptions=*/false);
  if (!built.is_object() || built.value("kind", json()) != kind) return json::object();
  if (const auto parts = built.find("structures"); parts != built.end() && !parts->is_object())
    built.erase(parts);
  return built;
}

/// The options of rays, with light, but without structures.
Result<RaycastOptions> rays_of(const Recipe& d, const json& built) {
  RaycastOptions options = d.raycast;
  if (built.empty()) {
    options.shade = options.shade && options.projection == Projection::none;
    const bool direct = !options.shade || d.ambient;
    options.lighting.mode = d.lighting.value_or(direct ? Lighting::direct : Lighting::global);
  } else {
    options = raycast_options(built.dump());
    if (!d.raycast.clip.empty()) options.clip = d.raycast.clip;
    if (d.environment.empty() && built.contains("/lighting/environment"_json_pointer))
      return fail_without("environment", ErrorCode::usage,
                          "the field was lit by an environment picture: name the same file");
  }
  options.ambient = d.ambient.value_or(options.ambient);
  if (!d.truth_of.empty()) options.step = std::min(options.step, kTruthStep);
  if (!d.light_rig.empty()) options.lighting.rig = SLF_TRY(read_rig(d.light_rig));
  if (d.light) {
    options.light = *d.light;
    if (auto& lights = options.lighting.rig.lights; !lights.empty())
      lights.front().direction = *d.light;
  }
  if (!d.environment.empty()) {
    auto picture = SLF_TRY(read_image(d.environment));
    options.lighting.environment = std::make_shared<const Image>(std::move(picture));
  }
  return options;
}

Result<std::unique_ptr<Scene>> picture_scene(const Recipe& d) {
  auto set = SLF_TRY(read_pictures(d));
  auto read = set.files();
  SLF_TRY(check_files(d, read));
  const auto options = picture_options(d, set);
  return make_picture_scene(std::move(set), options);
}

Result<std::unique_ptr<Scene>> mesh_scene(const Recipe& d) {
  const auto options = SLF_TRY(rays_of(d, recorded(d, "mesh")));
  auto mesh = SLF_TRY(read_mesh(d.input, d.up_axis));
  note_all(d, d.input, mesh.notes);
  SLF_TRY(check_files(d, mesh.files));
  return MeshScene::make(std::move(mesh),
                         {options.shade, options.light, options.ambient, options.lighting});
}

/// A volume that was read, for states that name it again.
struct Reading {
  std::string path;
  VolumeOptions options;
  Volume volume;  // whose copies share the voxels
};
using Readings = std::vector<Reading>;

/// `kept`: null: none.
Result<Volume> read_once(const std::string& path, const VolumeOptions& options, Readings* kept) {
  if (kept == nullptr) return read_volume(path, options);
  for (const Reading& before : *kept)
    if (before.path == path && before.options == options) return before.volume;
  auto volume = SLF_TRY(read_volume(path, options));
  volume.share();
  kept->push_back({path, options, std::move(volume)});
  return kept->back().volume;
}

VolumeOptions reading_of(const Recipe& d) {
  VolumeOptions reading = d.reading;
  if (d.raw.dims[0] > 0) reading.raw = d.raw;
  return reading;
}

/// Reads a label volume or a mask.
Result<Volume> read_structure(const Recipe& d, const std::string& path, Readings* kept) {
  // Parts are placed by position, so a crop does not concern them. They mostly have a header
  // and one number a voxel, also where the volume does not.
  VolumeOptions options;
  options.labels = true;
  options.resample = d.reading.resample;
  const auto reading = reading_of(d);
  if (!reading.raw) options.spacing = d.reading.spacing;
  auto volume = read_once(path, options, kept);
  if (volume) return volume;
  const std::string_view choice = volume.error().choice ? volume.error().choice : "";
  if (choice == "raw" && reading.raw) {
    options.raw = reading.raw;
    options.spacing = d.reading.spacing;
  } else if ((choice == "component" || choice == "time") &&
             (d.reading.component || d.reading.time)) {
    options.component = d.reading.component;
    options.time = d.reading.time;
  } else {
    return volume;
  }
  return read_once(path, options, kept);
}

/// A part of a volume in the volume's unit, if both state theirs.
std::shared_ptr<const Volume> in_unit_of(const Volume& volume, std::shared_ptr<const Volume> part) {
  const auto from = volume_io::micrometres(part->unit), to = volume_io::micrometres(volume.unit);
  if (!from || !to || *from == *to) return part;
  auto scaled = std::make_shared<Volume>(*part);
  scaled->axes *= *from / *to;
  scaled->origin *= *from / *to;
  scaled->unit = volume.unit;
  return scaled;
}

/// The volume that the description is of.
Result<Volume> volume_of(const Recipe& d, Readings* kept) {
  if (d.volume) return *d.volume;
  const auto reading = reading_of(d);
  auto volume = read_once(d.input, reading, kept);
  if (volume || volume.error().code == ErrorCode::not_found) return volume;
  std::error_code ignored;
  const bool may_have_cameras = d.input.ends_with(".json") || d.input.ends_with(".csv") ||
                                std::filesystem::is_directory(d.input, ignored);
  if (may_have_cameras && read_pictures(d.input))
    return bad_file(d.input, "has pictures with cameras, not a volume: name it ", kPicturesPrefix,
                    d.input);
  if (reading.raw && volume.error().choice && std::string_view(volume.error().choice) == "raw")
    volume.error().choice = "layout";
  return volume;
}

Result<LabelTable> styles_of(const Recipe& d, const Volume& labels) {
  if (!d.label_table.empty()) return read_label_table(d.label_table);
  return labels.label_styles;
}

Result<VolumeParts> read_parts(const Recipe& d, const json& built, Readings* kept) {
  VolumeParts parts;
  const json recorded = built.value("structures", json::object());
  for (const auto& [member, choice, source, to] :
       {std::tuple{"labels", "labels_volume", &d.labels_volume, &parts.labels},
        {"mask", "mask", &d.mask, &parts.mask}}) {
    *to = source->volume;
    if (!*source && recorded.contains(member))
      return fail_without(choice, ErrorCode::usage,
                          "the field was built with one: name the same file");
    if (*to || !*source) continue;
    auto volume = SLF_TRY(read_structure(d, source->path, kept));
    note_all(d, source->path, volume.notes);
    *to = std::make_shared<const Volume>(std::move(volume));
  }
  if (parts.labels) parts.styles = SLF_TRY(styles_of(d, *parts.labels));
  const json only = recorded.value("only", json());
  for (const json& id : only.is_array() ? only : json::array())
    if (id.is_number_integer()) parts.only.insert(id.get<std::int64_t>());
  if (!d.only_labels.empty()) parts.only = {d.only_labels.begin(), d.only_labels.end()};
  return parts;
}

Result<std::unique_ptr<Scene>> volume_scene(const Recipe& d, Readings* kept) {
  const json built = recorded(d, "volume");
  auto options = SLF_TRY(rays_of(d, built));
  // Read the small files first, so that an error in one is found before a large volume is read.
  std::optional<TransferPreset> preset;
  if (!d.transfer.empty()) {
    preset = SLF_TRY(read_transfer(d.transfer));
  } else if (!built.empty() && !d.make_transfer) {
    preset.emplace();
    preset->function = SLF_TRY(
        parse_transfer(built.value("transfer", json()).dump(), "the field's transfer function"));
  }
  if (d.range &&
      (!((*d.range)[0] < (*d.range)[1]) || !std::isfinite((*d.range)[1] - (*d.range)[0])))
    return fail_without("range", ErrorCode::usage, "range ", (*d.range)[0], ",", (*d.range)[1],
                        ": expected two ascending numbers");
  options.parts = SLF_TRY(read_parts(d, built, kept));
  auto volume = SLF_TRY(volume_of(d, kept));
  note_all(d, volume.source, volume.notes);
  if (volume.labels) volume.label_styles = SLF_TRY(styles_of(d, volume));
  if (!d.label_table.empty() && !volume.labels && !options.parts.labels)
    return fail_without("labels_volume", ErrorCode::usage, volume.source,
                        ": has no labels, which a table of labels needs");
  for (auto* const place : {&options.parts.labels, &options.parts.mask}) {
    if (!*place) continue;
    *place = in_unit_of(volume, *place);
    const auto& part = *place;
    volume.files.insert(volume.files.end(), part->files.begin(), part->files.end());
    if (same_grid(*part, volume)) continue;
    note(d, concat(part->source, ": ", joined(part->dims, "x"), " voxels on another grid than ",
                   volume.source, ": resampled, nearest, by world position"));
  }
  SLF_TRY(check_files(d, volume.files));
  if (!volume.labels && looks_like_labels(volume))
    note(d, volume.source + ": " + kLabelsHint, "labels");
  // A function that was made for this volume, or comes from a field, is already fitted to it.
  if (!preset) {
    preset.emplace();
    if (d.make_transfer)
      preset->function = SLF_TRY(d.make_transfer(volume));
    else
      preset->function = default_transfer(volume);
  }
  const TransferFunction function =
      d.transfer.empty() && !d.range ? preset->function : preset->fit(volume, d.range);
  const json light_of = d.reference ? json() : built.value("light_of", json());
  std::shared_ptr<const Scene> light_from;
  if (light_of.is_object()) {  // the members that the provenance of the other scene has otherwise
    volume.share();
    Recipe other = d;
    other.volume = std::make_shared<const Volume>(volume);
    json patched = built;
    patched.update(light_of);
    patched.erase("light_of");
    other.truth_of = patched.dump();
    const json parts = patched.value("structures", json::object());
    if (!parts.contains("mask")) other.mask = {};
    if (!parts.contains("labels") && other.labels_volume) {
      other.labels_volume = {};
      other.label_table.clear();
    }
    other.raycast.clip.clear();
    other.only_labels.clear();
    other.on_note = {};
    light_from = SLF_TRY(make_scene(other));
  }
  Result<std::unique_ptr<Scene>> made = fail(ErrorCode::failed, "");
  if (d.reference)
    made = PathTracer::make(std::move(volume), function, options,
                            {d.paths.samples, options.lighting.seed});
  else
    made = Raycaster::make(std::move(volume), function, options, d.light_volume);
  if (made && light_from) SLF_TRY((*made)->share_light(std::move(light_from)));
  if (made || made.error().code != ErrorCode::failed || made.error().choice) return made;
  return fail_without("transfer", ErrorCode::failed, made.error().message, "; it runs from ",
                      function.colors.front().value, " to ", function.colors.back().value,
                      ": choose another, or stretch it to a range");
}

Result<std::unique_ptr<Scene>> scene_of(const Recipe& d, Readings* kept) {
  SLF_TRY(recipe::check_applies(d));
  if (d.check) SLF_TRY(d.check(d.files()));
  switch (recipe::kind_of(d)) {
    case recipe::kAnalytic:
      return make_analytic_scene(std::string_view(d.input).substr(kScenePrefix.size()));
    case recipe::kPictures: return picture_scene(d);
    case recipe::kMesh: return mesh_scene(d);
    default: return volume_scene(d, kept);
  }
}

/// Labels that are one structure.
struct LabelGroup {
  std::string name;
  std::vector<std::int64_t> ids;
};

Result<std::vector<LabelGroup>> label_groups(const Recipe& d, Readings* kept) {
  const VolumeSource& parts = d.labels_volume;
  const auto labels = SLF_TRY(parts.volume          ? Result<Volume>(*parts.volume)
                              : !parts.path.empty() ? read_structure(d, parts.path, kept)
                                                    : volume_of(d, kept));
  if (!labels.labels)
    return fail_without("labels", ErrorCode::usage, labels.source,
                        ": holds amounts, not labels of structures");
  const auto styles = SLF_TRY(styles_of(d, labels));
  const auto& only = d.only_labels;
  std::vector<LabelGroup> groups;
  for (const std::int64_t id : label_ids(labels)) {
    const auto style = styles.find(id);
    if (id == 0 || (style != styles.end() && style->second.opacity == 0)) continue;
    if (!only.empty() && std::ranges::find(only, id) == only.end()) continue;
    std::string name = style != styles.end() ? style->second.name : "";
    if (name.empty()) name = "label " + std::to_string(id);
    const auto same = std::ranges::find(groups, name, &LabelGroup::name);
    (same != groups.end() ? *same : groups.emplace_back(LabelGroup{name, {}})).ids.push_back(id);
  }
  if (groups.empty())
    return fail_without("label_table", ErrorCode::usage, labels.source, ": has no visible label");
  return groups;
}

}  // namespace

bool Recipe::is_pictures() const { return input.starts_with(kPicturesPrefix); }

std::vector<std::string> Recipe::files() const {
  return {input,
          transfer_file(transfer),
          labels_volume.path,
          label_table,
          mask.path,
          light_rig,
          environment,
          light_volume.file,
          depth_cache == "none" ? "" : depth_cache};
}

Result<Volume> read_volume(const Recipe& d) { return volume_of(d, nullptr); }

Result<PictureSet> read_pictures(const Recipe& d) {
  auto set = SLF_TRY(read_pictures(d.input.substr(kPicturesPrefix.size())));
  note_all(d, set.source, set.notes);
  return set;
}

PictureSceneOptions picture_options(const Recipe& d, const PictureSet& set) {
  PictureSceneOptions options = d.pictures;
  if (d.center && d.radius) options.sphere = Sphere{*d.center, *d.radius};
  if (options.threads == 0) options.threads = d.light_volume.threads;
  if (!options.progress) options.progress = d.light_volume.progress;
  if (d.on_note)
    options.on_note = [on_note = d.on_note, source = set.source](const std::string& text) {
      on_note(source + ": " + text, "depth_cache");
    };
  // A comparison leaves no file behind, unless it is asked to.
  if (d.depth_cache != "none" && (d.truth_of.empty() || !d.depth_cache.empty()))
    options.depth_cache = d.depth_cache.empty() ? depth_cache_of(set) : d.depth_cache;
  return options;
}

Result<std::unique_ptr<Scene>> make_scene(const Recipe& d) {
  return scene_of(d, nullptr);
}

std::string name_of_state(std::string path, std::string state) {
  constexpr std::string_view kState = "{state}";
  std::ranges::replace_if(
      state, [](unsigned char c) { return c == '/' || c < ' '; }, '_');
  for (std::size_t at = 0; (at = path.find(kState, at)) != std::string::npos; at += state.size())
    path.replace(at, kState.size(), state);
  return path;
}

/// What the scenes have in common, and what is known of them.
struct StateScenes::Shared {
  Readings readings{};
  std::shared_ptr<SharedScenes> scenes = share_scenes();
  std::shared_ptr<std::set<std::string>> noted = std::make_shared<std::set<std::string>>();
  std::map<std::string, std::pair<std::string, std::string>> lights{};  // by file: state and key

  Result<std::unique_ptr<Scene>> make(Recipe d) {
    d.raycast.shared = scenes;
    if (d.on_note)
      d.on_note = [once = noted, on_note = d.on_note](const std::string& text, const char* choice) {
        if (once->insert(text).second) on_note(text, choice);
      };
    return scene_of(d, &readings);
  }
};

StateScenes::StateScenes() : shared_(std::make_unique<Shared>()) {}
StateScenes::~StateScenes() = default;

Result<void> StateScenes::add(const std::string& name, Recipe d,
                              const std::string& light_from) {
  std::string& file = d.light_volume.file;
  file = name_of_state(file, name);
  std::shared_ptr<const Scene> scene = SLF_TRY(shared_->make(d));
  if (!light_from.empty()) {
    const auto from = std::ranges::find(made_, light_from, &NamedScene::name);
    if (from == made_.end())
      return fail(ErrorCode::usage, "no earlier state is named '", light_from,
                  "', whose light this one has");
    SLF_TRY(scene->share_light(from->scene).map_error([&](const Error& error) {
      return Error{error.code, concat("the light of '", light_from, "': ", error.message)};
    }));
  } else if (!file.empty() && json::parse(scene->provenance()).contains("lighting")) {
    const std::string key = light_key(scene->provenance());
    const auto& [other, others] = shared_->lights.try_emplace(file, name, key).first->second;
    if (others != key)
      return fail_without("light_file", ErrorCode::usage, file, ": has the light of state '", other,
                          "'; {state} in its name gives each its own");
  }
  std::string text = recipe::published(d, *scene, light_from);
  made_.push_back({name, std::move(scene), std::move(text)});
  return {};
}

Result<std::vector<NamedScene>> make_label_scenes(Recipe d) {
  SLF_TRY(recipe::check_applies(d));
  if (d.check) SLF_TRY(d.check(d.files()));
  StateScenes states;
  const auto groups = SLF_TRY(label_groups(d, &states.shared_->readings));
  const Recipe whole = d;
  for (const LabelGroup& group : groups) {
    d.only_labels = group.ids;
    auto visible = states.shared_->make(d);
    const char* const choice = visible ? nullptr : visible.error().choice;
    if (choice && std::string_view(choice) == "only_labels" &&
        (!states.made_.empty() || &group != &groups.back())) {
      note(d, group.name + ": no voxel of it is visible, so it is no state");
      continue;
    }
    std::shared_ptr<const Scene> scene = SLF_TRY(std::move(visible));
    states.made_.push_back({group.name, scene, recipe::published(whole, *scene)});
  }
  return std::move(states.made_);
}

}  // namespace slf

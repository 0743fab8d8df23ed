// The volumes of recipes: what is shown, and its parts; and their scenes.
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <tuple>
#include <utility>

#include "base/join.h"
#include "base/try.h"
#include "source/recipe/scenes.h"
#include "source/volume/units.h"

namespace slf::recipe {
namespace {

using nlohmann::json;

/// `kept`: null: none.
Result<Volume> read_once(const Recipe& d, const std::string& path, const VolumeOptions& options,
                         Readings* kept) {
  const auto before = [&](const Readings* from) -> const Reading* {
    if (from == nullptr) return nullptr;
    for (const Reading& one : from->volumes)
      if (one.path == path && one.options == options) return &one;
    return nullptr;
  };
  if (const Reading* found = before(kept)) return found->volume;
  const Reading* found = before(d.read.get());
  Reading reading = found ? *found : Reading{path, options, SLF_TRY(read_volume(path, options))};
  if (kept == nullptr) return std::move(reading.volume);
  reading.volume.share();
  kept->volumes.push_back(std::move(reading));
  return kept->volumes.back().volume;
}

/// looks_like_labels(), once for each volume that is kept.
bool look_for_labels(const Volume& volume, Readings* kept) {
  if (kept != nullptr)
    for (Reading& one : kept->volumes)
      if (one.volume.borrowed == volume.borrowed) {
        if (!one.looks_like_labels) one.looks_like_labels = looks_like_labels(volume);
        return *one.looks_like_labels;
      }
  return looks_like_labels(volume);
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
  auto volume = read_once(d, path, options, kept);
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
  return read_once(d, path, options, kept);
}

/// How many of the units `to` one unit `from` is; 1 if either is not known.
double ratio_of_units(const std::string& from, const std::string& to) {
  const auto small = volume_io::micrometres(from), large = volume_io::micrometres(to);
  return small && large ? *small / *large : 1;
}

/// Does nothing if either unit is not known.
void convert_to(const std::string& unit, Volume& volume) {
  const double ratio = ratio_of_units(volume.unit, unit);
  if (ratio == 1) return;
  volume.axes *= ratio;
  volume.origin *= ratio;
  volume.unit = unit;
}

/// How much of the larger one of the boxes around two volumes is in both, 0 to 1. `scale`: of `b`.
double overlap(const Volume& a, const Volume& b, double scale) {
  const auto box = [](const Volume& v, double by) {
    std::array<glm::dvec3, 2> ends{v.origin, v.origin};
    for (int corner = 1; corner < 8; ++corner) {
      const glm::dvec3 of(corner & 1, corner >> 1 & 1, corner >> 2);
      const glm::dvec3 at = v.origin + v.axes * (of * glm::dvec3(v.dims[0], v.dims[1], v.dims[2]));
      ends = {glm::min(ends[0], at), glm::max(ends[1], at)};
    }
    return std::array{ends[0] * by, ends[1] * by};
  };
  const auto size = [](const std::array<glm::dvec3, 2>& of) {
    const glm::dvec3 edges = glm::max(of[1] - of[0], 0.0);
    return edges.x * edges.y * edges.z;
  };
  const auto one = box(a, 1), other = box(b, scale);
  const std::array both{glm::max(one[0], other[0]), glm::min(one[1], other[1])};
  return size(both) / std::max(size(one), size(other));
}

/// A part of a volume in the volume's unit. Most files that state none are in millimetres.
std::shared_ptr<const Volume> in_unit_of(const Volume& volume, std::shared_ptr<const Volume> part,
                                         const Recipe& d) {
  const bool unstated = part->unit.empty();
  const double ratio = ratio_of_units(unstated ? "mm" : part->unit, volume.unit);
  if (ratio == 1 || (unstated && overlap(volume, *part, ratio) <= overlap(volume, *part, 1)))
    return part;
  if (unstated)
    note(d, concat(part->source, ": states no unit: taken as millimetres, as it fits ",
                   volume.source, " then"));
  auto converted = std::make_shared<Volume>(*part);
  converted->unit = unstated ? "mm" : part->unit;
  convert_to(volume.unit, *converted);
  return converted;
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

/// The transfer function that is stated, or that of the field to compare with; none: it is made for
/// the volume.
Result<std::optional<TransferPreset>> preset_of(const Recipe& d, const json& built) {
  std::optional<TransferPreset> preset;
  if (!d.transfer.empty()) {
    preset = SLF_TRY(read_transfer(d.transfer));
  } else if (!built.empty() && !d.make_transfer) {
    preset.emplace();
    preset->function = SLF_TRY(
        parse_transfer(built.value("transfer", json()).dump(), "the field's transfer function"));
  }
  return preset;
}

/// The transfer function, fitted to the volume.
Result<TransferFunction> colors_of(const Recipe& d, const std::optional<TransferPreset>& preset,
                                   const Volume& volume) {
  if (!d.transfer.empty()) return preset->fit(volume, d.range);
  // One that was made for this volume, or comes from a field, is already fitted to it.
  TransferPreset made;
  if (preset)
    made = *preset;
  else
    made.function = d.make_transfer ? SLF_TRY(d.make_transfer(volume)) : default_transfer(volume);
  return d.range ? made.fit(volume, d.range) : made.function;
}

/// Converts parts to the volume's unit, and adds their files to its own.
void join_parts(const Recipe& d, VolumeParts& of, Volume& volume) {
  for (auto* const place : {&of.labels, &of.mask}) {
    if (!*place) continue;
    *place = in_unit_of(volume, *place, d);
    const auto& part = *place;
    volume.files.insert(volume.files.end(), part->files.begin(), part->files.end());
    if (same_grid(*part, volume)) continue;
    note(d, concat(part->source, ": ", joined(part->dims, "x"), " voxels on another grid than ",
                   volume.source, ": resampled, nearest, by world position"));
  }
}

/// The scene whose light that of the field to compare with has; null: its own.
Result<std::shared_ptr<const Scene>> light_scene(const Recipe& d, const json& built,
                                                 Volume& volume) {
  const json light_of = d.reference ? json() : built.value("light_of", json());
  if (!light_of.is_object()) return std::shared_ptr<const Scene>();
  // The members that the provenance of the other scene has otherwise.
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
  std::shared_ptr<const Scene> scene = SLF_TRY(make_scene(other));
  return scene;
}

}  // namespace

Result<Volume> volume_of(const Recipe& d, Readings* kept) {
  if (d.volume) return *d.volume;
  const auto reading = reading_of(d);
  auto volume = read_once(d, d.input, reading, kept);
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

Result<Volume> labels_of(const Recipe& d, Readings* kept) {
  const VolumeSource& parts = d.labels_volume;
  if (parts.volume) return *parts.volume;
  return parts.path.empty() ? volume_of(d, kept) : read_structure(d, parts.path, kept);
}

Result<LabelTable> styles_of(const Recipe& d, const Volume& labels) {
  if (!d.label_table.empty()) return read_label_table(d.label_table);
  return labels.label_styles;
}
Result<std::unique_ptr<Scene>> volume_scene(const Recipe& d, Readings* kept) {
  const json built = recorded(d, "volume");
  auto options = SLF_TRY(rays_of(d, built));
  // Read the small files first, so that an error in one is found before a large volume is read.
  const auto preset = SLF_TRY(preset_of(d, built));
  if (d.range &&
      (!((*d.range)[0] < (*d.range)[1]) || !std::isfinite((*d.range)[1] - (*d.range)[0])))
    return fail_without("range", ErrorCode::usage, "range ", (*d.range)[0], ",", (*d.range)[1],
                        ": expected two ascending numbers");
  options.parts = SLF_TRY(read_parts(d, built, kept));
  auto volume = SLF_TRY(volume_of(d, kept));
  note_all(d, volume.source, volume.notes);
  const json unit = built.value("unit", json(kept ? kept->unit : ""));
  if (unit.is_string()) convert_to(unit.get<std::string>(), volume);
  if (kept && kept->unit.empty()) kept->unit = volume.unit;
  if (volume.labels) volume.label_styles = SLF_TRY(styles_of(d, volume));
  if (!d.label_table.empty() && !volume.labels && !options.parts.labels)
    return fail_without("labels_volume", ErrorCode::usage, volume.source,
                        ": has no labels, which a table of labels needs");
  join_parts(d, options.parts, volume);
  SLF_TRY(check_files(d, volume.files));
  if (!volume.labels && look_for_labels(volume, kept))
    note(d, volume.source + ": " + kLabelsHint, "labels");
  const auto function = SLF_TRY(colors_of(d, preset, volume));
  const auto light_from = SLF_TRY(light_scene(d, built, volume));
  Result<std::unique_ptr<Scene>> made = fail(ErrorCode::failed, "");
  if (d.reference)
    made = PathTracer::make(std::move(volume), function, options,
                            {d.paths.samples, options.lighting.seed});
  else
    made = Raycaster::make(std::move(volume), function, options, d.light_volume);
  if (made && light_from) SLF_TRY((*made)->share_light(light_from));
  if (made || made.error().code != ErrorCode::failed || made.error().choice) return made;
  return fail_without("transfer", ErrorCode::failed, made.error().message, "; it runs from ",
                      function.colors.front().value, " to ", function.colors.back().value,
                      ": choose another, or stretch it to a range");
}

}  // namespace slf::recipe

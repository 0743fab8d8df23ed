#include <algorithm>
#include <nlohmann/json.hpp>

#include "base/guarded.h"
#include "base/join.h"
#include "base/try.h"
#include "slf/image.h"
#include "source/raycast/provenance.h"
#include "source/recipe/options.h"
#include "source/recipe/scenes.h"

namespace slf {
namespace {

using nlohmann::json;

constexpr double kTruthStep = 0.5;  // finer than fields need

Result<std::unique_ptr<Scene>> picture_scene(const Recipe& d) {
  auto set = SLF_TRY(read_pictures(d));
  auto read = set.files();
  SLF_TRY(recipe::check_files(d, read));
  const auto options = picture_options(d, set);
  return make_picture_scene(std::move(set), options);
}

Result<std::unique_ptr<Scene>> mesh_scene(const Recipe& d) {
  const auto options = SLF_TRY(recipe::rays_of(d, recipe::recorded(d, "mesh")));
  auto mesh = SLF_TRY(read_mesh(d.input, d.up_axis));
  recipe::note_all(d, d.input, mesh.notes);
  SLF_TRY(recipe::check_files(d, mesh.files));
  return MeshScene::make(std::move(mesh),
                         {options.shade, options.light, options.ambient, options.lighting});
}
}  // namespace

namespace recipe {

void note(const Recipe& d, const std::string& text, const char* choice) {
  if (d.on_note) d.on_note(text, choice);
}

void note_all(const Recipe& d, const std::string& source, const std::vector<std::string>& notes) {
  for (const std::string& text : notes) note(d, std::string(source).append(": ").append(text));
}

Result<void> check_files(const Recipe& d, std::vector<std::string>& read) {
  const std::vector<std::string> named = d.files();
  read.insert(read.end(), named.begin(), named.end());
  return d.check ? d.check(read) : Result<void>();
}

json recorded(const Recipe& d, const char* kind) {
  json built = json::parse(d.truth_of, nullptr, /*allow_exceptions=*/false);
  if (!built.is_object() || built.value("kind", json()) != kind) return json::object();
  if (const auto parts = built.find("structures"); parts != built.end() && !parts->is_object())
    built.erase(parts);
  return built;
}

Result<RaycastOptions> rays_of(const Recipe& d, const json& built) {
  RaycastOptions options = d.raycast;
  if (built.empty()) {
    options.shade = options.shade && options.projection == Projection::none;
    const bool direct = !options.shade || d.ambient;
    options.lighting.mode = d.lighting.value_or(direct ? Lighting::direct : Lighting::global);
  } else {
    options = raycast_options(built.dump());
    for (const ClipPlane& plane : d.raycast.clip)
      if (std::ranges::find(options.clip, plane) == options.clip.end())
        options.clip.push_back(plane);
    if (d.environment.empty() && built.contains("/lighting/environment"_json_pointer))
      return fail_without("environment", ErrorCode::usage,
                          "the field was lit by an environment picture: name the same file");
  }
  options.ambient = d.ambient.value_or(options.ambient);
  if (!d.truth_of.empty()) {
    options.step = std::min(options.step, kTruthStep);
    options.may_be_empty = true;
  }
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

Result<std::unique_ptr<Scene>> scene_of(const Recipe& d, Readings* kept) {
  if (!d.states.empty())
    return misuse(d.input, "the recipe has states, where one scene is expected: state it alone");
  SLF_TRY(recipe::check_applies(d));
  if (d.check) SLF_TRY(d.check(d.files()));
  switch (recipe::kind_of(d)) {
    case recipe::kAnalytic:
      return make_analytic_scene(std::string_view(d.input).substr(recipe::kScenePrefix.size()));
    case recipe::kPictures:
      return picture_scene(d);
    case recipe::kMesh:
      return mesh_scene(d);
    default:
      return volume_scene(d, kept);
  }
}

}  // namespace recipe

bool Recipe::is_pictures() const { return input.starts_with(recipe::kPicturesPrefix); }

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

Result<Volume> read_volume(const Recipe& d) {
  return guarded([&] { return recipe::volume_of(d, nullptr); });
}

Result<PictureSet> read_pictures(const Recipe& d) try {
  auto set = SLF_TRY(read_pictures(d.input.substr(recipe::kPicturesPrefix.size())));
  recipe::note_all(d, set.source, set.notes);
  return set;
} catch (...) {
  return tl::unexpected(error_of_exception());
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
  return guarded([&] { return recipe::scene_of(d, nullptr); });
}

}  // namespace slf

// Recipe: what is shown, and how, as people state it, with the defaults of everything that they
// leave out. make_scene() turns it into a Scene.
//
//   slf::Recipe recipe;
//   recipe.input = "head.nii.gz";
//   recipe.transfer = "ct-bone";
//   auto scene = slf::make_scene(recipe);
//
// read_recipe() reads one in JSON (schemas/recipe.json). Scene::provenance() records what was made,
// and `truth_of` reads such a record back.
#pragma once

#include <array>
#include <functional>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "slf/build.h"
#include "slf/cut.h"
#include "slf/error.h"
#include "slf/field.h"
#include "slf/mesh.h"
#include "slf/path_tracer.h"
#include "slf/pictures.h"
#include "slf/raycaster.h"
#include "slf/scene.h"
#include "slf/transfer.h"
#include "slf/volume.h"
#include "slf/volume_parts.h"

namespace slf {
namespace recipe {
struct Readings;  // source/recipe/scenes.h
}

/// A volume in memory, or else the path of one; neither: none.
struct VolumeSource {
  std::string path{};
  std::shared_ptr<const Volume> volume{};

  explicit operator bool() const { return volume || !path.empty(); }
};

/// A state of the object: a recipe that has all that it does not state from another one.
struct RecipeState {
  std::string name{};
  std::string options{};     ///< JSON, of those that differ
  std::string file{};        ///< that stated it, whose folder their paths begin in
  std::string light_from{};  ///< an earlier state, whose light it has; empty: its own
  bool each_time = false;    ///< a state of each time point: "NAME 0", "NAME 1", ...
};

/// Errors, and notes of on_note(), name an option as their choice.
struct Recipe {
  /// The path of a volume, or of a mesh if is_mesh_name() says so; "pictures:" and a path for
  /// read_pictures(); or "scene:" and the name of an analytic scene.
  std::string input{};
  std::set<std::string, std::less<>> stated{};  ///< options that were set by their names
  std::vector<RecipeState> states{};            ///< none: one, without a name
  bool each_label = false;                      ///< make_label_scenes() instead
  bool each_time = false;                       ///< a state of each time point of the input

  // Volumes.
  std::shared_ptr<const Volume> volume{};  ///< instead of a file at `input`
  VolumeOptions reading{};                 ///< but for `raw`
  RawLayout raw{};                         ///< dims of 0: the file states its layout
  std::string transfer{};                  ///< for read_transfer(); empty: default_transfer()
  /// Instead of `transfer`: makes the function for the volume that was read.
  std::function<Result<TransferFunction>(const Volume&)> make_transfer{};
  std::optional<std::array<double, 2>> range{};  ///< of values, to stretch the function to
  /// Parts of the volume, on any grid. A file is read as `reading` says, as far as it applies.
  VolumeSource labels_volume{}, mask{};
  std::shared_ptr<const recipe::Readings> read{};  ///< volumes of files, read before; or null
  std::string label_table{};  ///< for read_label_table(); empty: that of `labels_volume`
  std::vector<std::int64_t> only_labels{};  ///< VolumeParts::only

  // Rays and light, of volumes and meshes.
  RaycastOptions raycast{};            ///< but for what the members below state
  std::optional<Lighting> lighting{};  ///< none: global, but direct for rays that no light concerns
  std::optional<float> ambient{};      ///< implies direct light
  std::optional<glm::dvec3> light{};   ///< direction, also of the first light of a rig
  std::string light_rig{};             ///< for read_rig(); empty: the default
  std::string environment{};           ///< picture of surroundings; empty: the sky of the rig
  LightVolumeOptions light_volume{.deferred = true};
  bool reference = false;  ///< a PathTracer, instead of a light volume
  PathTraceOptions paths{};
  UpAxis up_axis = UpAxis::by_format;  ///< of meshes

  // Pictures. threads and progress are those of `light_volume`, unless stated.
  PictureSceneOptions pictures{};
  std::string depth_cache{};  ///< "none": no file; empty: depth_cache_of() the set

  // The field to build: see field_options().
  BuildOptions field{};
  std::optional<glm::dvec3> center{};
  std::optional<double> radius{};
  std::optional<std::uint32_t> reveal{};  ///< voxels of its longest side; none: no reveal
  std::uint32_t reveal_loss = 0;          ///< of its bytes, 0 to Reveal::kMaxLoss
  std::string reveal_window = "visible";  ///< or LO,HI: RevealOptions::window

  /// The provenance of a field to compare with. Rays and light are then those of the field, but for
  /// what `ambient` to `environment` state, and so is the transfer function, unless one is stated.
  /// The step is at most 0.5. Files must be named again.
  std::string truth_of{};

  /// Gets what people should know, and the option that would settle it, or null.
  std::function<void(const std::string& note, const char* choice)> on_note{};
  /// Gets the files that are read, before they are, and again with all that they name, before
  /// longer work. make_scene() returns its error.
  std::function<Result<void>(const std::vector<std::string>& files)> check{};

  [[nodiscard]] bool is_pictures() const;
  /// The files that members name. A name that is no file's, as scene:balls, does no harm.
  [[nodiscard]] std::vector<std::string> files() const;
};

/// Reads a recipe in JSON: what it states, but for what is stated already. Paths in it are relative
/// to it. Input is untrusted. bad_file: not JSON, an unknown option, a value of another type or out
/// of range; the message names the place. io: unreadable.
[[nodiscard]] Result<void> read_recipe(const std::string& path, Recipe& to);
/// Whether the input is a recipe by its name, which read_recipe() reads: it ends in .json.
[[nodiscard]] bool is_recipe(std::string_view input);

/// usage: the recipe has states; an option is out of range, does not apply to this kind of source,
/// or is missing though the field of `truth_of` was built with it. Else errors as those of the
/// readers, of Raycaster::make(), MeshScene::make(), make_picture_scene() and
/// make_analytic_scene().
[[nodiscard]] Result<std::unique_ptr<Scene>> make_scene(const Recipe& description);

/// The path with {state} replaced by the name of a state, whose slashes and control characters
/// become underscores.
[[nodiscard]] std::string name_of_state(std::string path, std::string state);

/// A scene, and the name of the state that it is of.
struct NamedScene {
  std::string name;
  std::shared_ptr<const Scene> scene;
  std::string recipe{};  ///< JSON of what the recipe states of it
};

/// Makes the scenes of states, which share what is equal: a volume that several name, with equal
/// options, is read once, and equal voxels and parts are in memory once. on_note() gets each note
/// once. The scenes are as make_scene() makes them, and may outlive this. Thread-safety: none.
class StateScenes {
 public:
  StateScenes();
  ~StateScenes();
  StateScenes(const StateScenes&) = delete;
  StateScenes& operator=(const StateScenes&) = delete;

  /// Adds a state. Its light is that of the earlier state `light_from`, but for what it lays open
  /// (Scene::share_light()), or, if that is empty, its own; {state} in the name of the light's file
  /// stands for `name`. usage: there is no such state; the file has another state's light, which
  /// differs. Else errors as make_scene() and Scene::share_light(). After an error all is as
  /// before.
  [[nodiscard]] Result<void> add(const std::string& name, Recipe description,
                                 const std::string& light_from = {});
  [[nodiscard]] const std::vector<NamedScene>& scenes() const { return made_; }

 private:
  struct Shared;
  std::unique_ptr<Shared> shared_;
  std::vector<NamedScene> made_;
  friend Result<std::vector<NamedScene>> make_label_scenes(Recipe description);
};

/// A scene for each visible structure of the labels, or of those in `only_labels`, by their least
/// ids: labels of one name, or one without a name. It shows the structure alone under the light of
/// all: what is hidden keeps its shadows. The first to prepare() computes that light, and any
/// set_light() sets it. usage: no structure is visible. Else errors as make_scene().
[[nodiscard]] Result<std::vector<NamedScene>> make_label_scenes(Recipe description);

/// The scenes of all states of a recipe, or one without a name. Errors as StateScenes::add(),
/// make_label_scenes() and make_scene(); the message names the state.
[[nodiscard]] Result<std::vector<NamedScene>> make_scenes(const Recipe& recipe);

/// For build_field(). They must not outlive the scenes.
[[nodiscard]] std::vector<FieldState> field_states(const std::vector<NamedScene>& scenes);
/// The sphere of a field: around what is `visible`, but for what the recipe states.
[[nodiscard]] Sphere sphere_of(const Recipe& recipe, const Sphere& visible);
/// Recipe::field with the sphere around what is visible in any state, and with the reveal that the
/// recipe asks for. Errors as make_reveal().
[[nodiscard]] Result<BuildOptions> field_options(const Recipe& recipe,
                                                 std::span<const FieldState> states);
/// Adds a reveal to a finished field. The recipe names the volume that it was built from, and what
/// `truth_of` needs. usage: it is another volume. Else errors as make_scene(), make_reveal() and
/// set_reveal().
[[nodiscard]] Result<void> add_reveal(const std::string& path, Recipe recipe);

/// The cap of this name, for views of the field through planes: "shaded"; "coarse", the same by a
/// tenth of the work on light; "slice", or "slice:LO,HI" with a window of values; "hollow": null;
/// or
/// "": shaded if the field has a reveal, else null. `resources`: threads, memory and progress.
/// usage: another name; the field has no reveal. Else errors as make_cap().
[[nodiscard]] Result<std::shared_ptr<const Scene>> named_cap(const Field& field,
                                                             std::span<const ClipPlane> clip,
                                                             const std::string& name,
                                                             CapOptions resources = {});

/// The volume at `input`. Errors as read_volume(path, options), and bad_file for what has cameras.
[[nodiscard]] Result<Volume> read_volume(const Recipe& description);
/// The cameras of pictures. REQUIRES: is_pictures().
[[nodiscard]] Result<PictureSet> read_pictures(const Recipe& description);
/// The options of make_picture_scene() for this set.
[[nodiscard]] PictureSceneOptions picture_options(const Recipe& description, const PictureSet& set);

/// What on_note() says of a volume for which looks_like_labels() holds.
inline constexpr const char* kLabelsHint =
    "its values look like labels (ids), which are blurred when interpolated, unless read as labels";

}  // namespace slf

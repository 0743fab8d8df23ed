// The parts of making the scenes of recipes. Internal.
#pragma once

#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "slf/recipe.h"

namespace slf::recipe {

/// What inputs begin with that are no files of volumes and meshes.
inline constexpr std::string_view kScenePrefix = "scene:", kPicturesPrefix = "pictures:";

/// A volume that was read, for states that name it again.
struct Reading {
  std::string path;
  VolumeOptions options;
  Volume volume;                            // whose copies share the voxels
  std::optional<bool> looks_like_labels{};  // none: nobody has looked yet
};
/// What the scenes of states have in common.
struct Readings {
  std::vector<Reading> volumes{};
  std::string unit{};  ///< of the first scene's world, which others are converted to
};

void note(const Recipe& d, const std::string& text, const char* choice = nullptr);
void note_all(const Recipe& d, const std::string& source, const std::vector<std::string>& notes);

/// Adds the files that the recipe names to those that were `read`, and checks them.
[[nodiscard]] Result<void> check_files(const Recipe& d, std::vector<std::string>& read);

/// The provenance of the field to compare with, if it is of this kind.
[[nodiscard]] nlohmann::json recorded(const Recipe& d, const char* kind);

/// The options of rays, with light, but without structures.
[[nodiscard]] Result<RaycastOptions> rays_of(const Recipe& d, const nlohmann::json& built);

/// The volume that the recipe is of. `kept`: null: none.
[[nodiscard]] Result<Volume> volume_of(const Recipe& d, Readings* kept);
/// The volume of labels: that of the recipe, or of its parts.
[[nodiscard]] Result<Volume> labels_of(const Recipe& d, Readings* kept);
[[nodiscard]] Result<LabelTable> styles_of(const Recipe& d, const Volume& labels);

[[nodiscard]] Result<std::unique_ptr<Scene>> volume_scene(const Recipe& d, Readings* kept);

/// make_scene(), with volumes that were read before.
[[nodiscard]] Result<std::unique_ptr<Scene>> scene_of(const Recipe& d, Readings* kept);

}  // namespace slf::recipe

// What the studio tells of the volume that it shows, in JSON, and of its surroundings.
// Thread-safety: any thread.
#pragma once

#include <glm/glm.hpp>
#include <nlohmann/json.hpp>
#include <string>

#include "slf/image.h"
#include "slf/volume.h"

namespace slf::page {

inline constexpr std::size_t kHistogramSteps = 256;

/// How many voxels have which value: counts of equal steps, with their ends.
[[nodiscard]] nlohmann::json histogram_of(const Volume& volume);

/// The value of the voxel nearest to a point in world coordinates; null: outside.
[[nodiscard]] nlohmann::json value_at(const Volume& volume, const glm::dvec3& world);

/// The unit of lengths, whether world axes are the patient's, and the box of voxels' centres: its
/// first corner and its size.
[[nodiscard]] nlohmann::json place_of(const Volume& volume);

/// The labels but 0, each with its name, colour and opacity: as a table has them
/// (read_label_table()), or if that is empty, as the volume.
[[nodiscard]] nlohmann::json labels_of(const Volume& volume, const std::string& table);

/// A small picture of surroundings, whose mean is grey.
[[nodiscard]] Image small_picture_of(const Image& surroundings);

}  // namespace slf::page

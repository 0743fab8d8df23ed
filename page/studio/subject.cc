#include "page/studio/subject.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "slf/volume_parts.h"
#include "source/transfer/transfer_color.h"
#include "source/volume/voxels.h"

namespace slf::page {

using nlohmann::json;

nlohmann::json histogram_of(const Volume& volume) {
  const auto range = volume.value_range();
  const double low = range[0], high = range[1];
  std::vector<std::uint64_t> counts(kHistogramSteps);
  const double scale = high > low ? kHistogramSteps / (high - low) : 0;
  visit_voxels(volume, [&](auto stored) {
    const std::size_t step = 1 + stored.size() / (1 << 22);
    for (std::size_t i = 0; i < stored.size(); i += step) {
      const double value = volume.slope * static_cast<double>(stored[i]) + volume.intercept;
      if (!std::isfinite(value)) continue;
      ++counts[std::min(kHistogramSteps - 1, static_cast<std::size_t>((value - low) * scale))];
    }
  });
  return {{"low", low}, {"high", high}, {"counts", counts}};
}

nlohmann::json value_at(const Volume& volume, const glm::dvec3& world) {
  const glm::dvec3 at = glm::round(glm::inverse(volume.axes) * (world - volume.origin));
  for (int k = 0; k < 3; ++k)
    if (!(at[k] >= 0 && at[k] < volume.dims[static_cast<std::size_t>(k)])) return {};
  const std::uint64_t index =
      static_cast<std::uint64_t>(at.x) +
      volume.dims[0] * (static_cast<std::uint64_t>(at.y) +
                        std::uint64_t{volume.dims[1]} * static_cast<std::uint64_t>(at.z));
  return visit_voxels(volume, [&](auto stored) {
    return volume.slope * static_cast<double>(stored[index]) + volume.intercept;
  });
}

nlohmann::json place_of(const Volume& volume) {
  const glm::dvec3 size =
      volume.axes * (glm::dvec3(volume.dims[0], volume.dims[1], volume.dims[2]) - 1.0);
  const glm::dvec3& at = volume.origin;
  return {{"unit", volume.unit},
          {"value_unit", volume.value_unit},
          {"patient", volume.patient_axes},
          {"box", {at.x, at.y, at.z, size.x, size.y, size.z}}};
}

nlohmann::json labels_of(const Volume& volume, const std::string& table) {
  const auto styles = table.empty() ? volume.label_styles : read_label_table(table);
  json labels = json::array();
  for (const std::int64_t id : label_ids(volume)) {
    if (id == 0) continue;
    const LabelStyle style = styles && styles->contains(id) ? styles->at(id) : LabelStyle();
    const glm::dvec3 color =
        style.color.value_or(transfer_color::of_label(static_cast<double>(id)));
    labels.push_back({{"id", id},
                      {"name", style.name.empty() ? std::to_string(id) : style.name},
                      {"color", {color.r, color.g, color.b}},
                      {"opacity", style.opacity}});
  }
  return labels;
}

Image small_picture_of(const Image& surroundings) {
  Image small{std::min(160U, surroundings.width), std::min(80U, surroundings.height), {}, {}};
  small.rgba.resize(std::size_t{small.width} * small.height);
  const std::size_t width = surroundings.width;
  float sum = 0;
  for (std::size_t k = 0; k < surroundings.rgba.size(); ++k) {
    const std::size_t x = k % width * small.width / width,
                      y = k / width * small.height / surroundings.height;
    const glm::vec3 color = glm::min(glm::vec3(surroundings.rgba[k]), 100.0F);
    small.rgba[y * small.width + x] += glm::vec4(color, 1);
    sum += (color.r + color.g + color.b) / 3;
  }
  const float mean = sum / static_cast<float>(surroundings.rgba.size());
  for (glm::vec4& pixel : small.rgba) {
    const glm::vec3 color = glm::vec3(pixel) / std::max(pixel.a * mean, 1e-9F);
    pixel = glm::vec4(glm::pow(color / (1.0F + color), glm::vec3(1 / 2.2F)), 1);
  }
  return small;
}

}  // namespace slf::page

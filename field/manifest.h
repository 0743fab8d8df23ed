// Manifest: everything needed to open a field, as JSON in the container (FORMAT.md).
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "slf/error.h"
#include "slf/field.h"
#include "slf/shape.h"

namespace slf {

struct Manifest {
  static constexpr int kMajor = 1;
  static constexpr int kMinor = 0;

  FieldShape shape;
  std::vector<Layer> layers;
  nlohmann::json provenance;  ///< of the scene; free form

  [[nodiscard]] nlohmann::json to_json() const;

  /// Parses untrusted text. bad_file: not a manifest, a value missing or out of range, named by
  /// its place. unsupported: a newer major version or an unknown required feature.
  [[nodiscard]] static Result<Manifest> parse(std::string_view text, const std::string& file);
};

}  // namespace slf

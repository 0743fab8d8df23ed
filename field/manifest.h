// Manifest: everything needed to open a field, as JSON in the container (FORMAT.md).
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "codec/codec.h"
#include "slf/error.h"
#include "slf/shape.h"

namespace slf {

/// A stored channel group of every tile.
struct Layer {
  std::string name;  ///< "color" or "depth"
  codec::SampleFormat format = codec::SampleFormat::rgba8;
  std::string codec;  ///< specification, e.g. "jpeg:75"
};

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

[[nodiscard]] const char* name(codec::SampleFormat format);

}  // namespace slf

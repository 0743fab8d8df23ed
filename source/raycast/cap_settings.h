// What a reveal is shown as beyond planes. Private to source/raycast and page/wasm.
#pragma once

#include <span>
#include <string>

#include "slf/cut.h"
#include "slf/raycaster.h"
#include "slf/transfer.h"

namespace slf {

/// The arguments of Raycaster::make(), as make_cap() passes them.
struct CapSettings {
  Volume volume;
  TransferFunction transfer;
  RaycastOptions options;
};

/// Errors as make_cap().
[[nodiscard]] Result<CapSettings> cap_settings(const Reveal& reveal, const std::string& provenance,
                                               std::span<const ClipPlane> clip,
                                               const CapOptions& asked);

}  // namespace slf

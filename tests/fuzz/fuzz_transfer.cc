// parse_transfer on any bytes: an error with a message, or a function that can be evaluated
// everywhere and survives a round trip.
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <string>

#include "slf/transfer.h"

namespace {

void require(bool condition) {
  if (!condition) std::abort();
}

void check_values(const slf::TransferFunction& transfer) {
  for (const auto& point : transfer.opacities)
    for (const double value : {point.value, std::nextafter(point.value, 1e308), 0.0, 1e300}) {
      const auto rgba = transfer(value);
      for (int i = 0; i < 4; ++i) require(rgba[i] >= 0 && rgba[i] <= 1);
    }
  for (const auto& point : transfer.colors) {
    const auto rgba = transfer(std::nextafter(point.value, 1e308));
    for (int i = 0; i < 4; ++i) require(rgba[i] >= 0 && rgba[i] <= 1);
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string text(reinterpret_cast<const char*>(data), size);
  const auto transfer = slf::parse_transfer(text, "input");
  if (!transfer) {
    require(transfer.error().message.starts_with("input"));
    return 0;
  }
  require(!transfer->colors.empty() && !transfer->opacities.empty());
  require(transfer->unit_distance > 0);
  check_values(*transfer);
  const auto again = slf::parse_transfer(slf::to_json(*transfer), "again");
  require(again.has_value() && slf::to_json(*again) == slf::to_json(*transfer));
  return 0;
}

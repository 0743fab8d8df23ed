// Any bytes as a reveal: an error, or one that encodes to what decodes to the same.
#include <cstdint>
#include <cstdlib>

#include "slf/reveal.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace slf;
  const auto bytes = std::as_bytes(std::span(data, size));
  const auto head = decode_reveal(bytes, RevealPart::head);
  // The largest volumes take long, and only their head is refused.
  if (head && head->dims[0] * std::uint64_t{head->dims[1]} * head->dims[2] > 1 << 20) return 0;
  auto reveal = decode_reveal(bytes, RevealPart::all, 1);
  if (reveal && !head) std::abort();
  if (!reveal) return 0;
  reveal->loss = 0;
  const auto code = encode(*reveal, 1);
  if (!code) std::abort();
  const auto again = decode_reveal(*code, RevealPart::all, 1);
  if (!again || again->voxels != reveal->voxels || again->parts != reveal->parts) std::abort();
  return 0;
}

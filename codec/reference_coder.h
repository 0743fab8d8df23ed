// The syntax of a tile's references (FORMAT.md, "References"), for encoder and decoder.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <vector>

#include "codec/prediction.h"
#include "codec/predictive_tables.h"
#include "slf/error.h"

namespace slf::codec {

/// Codes which candidates are used: with these a payload begins. `kinds`, below kReferenceKinds,
/// select the model: candidates of one kind are used about equally often.
template <class Coder, class Models>
void code_references(Coder& coder, Models& models, std::span<const std::uint8_t> kinds,
                     std::span<std::uint8_t> used) {
  bool last = false;
  for (std::size_t k = 0; k < used.size(); ++k) {
    last = coder.bit(models[kinds[k]][last ? 1 : 0], used[k] != 0);
    used[k] = last ? 1 : 0;
  }
}

/// Reads the references again, to get to what follows them: one bit for each candidate. bad_file:
/// they are others.
template <class Decoder>
[[nodiscard]] Result<void> pass_references(Decoder& decoder, const Predicted& from) {
  std::vector<std::uint8_t> used(from.kinds.size());
  decoder.references(from.kinds, used);
  if (std::equal(used.begin(), used.end(), from.used.begin(), from.used.end())) return {};
  return fail(ErrorCode::bad_file, "the payload is predicted from other tiles");
}

}  // namespace slf::codec

// The syntax of a tile's references (FORMAT.md, "References"), for encoder and decoder.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>

#include "codec/predictive_tables.h"

namespace slf::codec {

/// Codes which candidates are used. `kinds`, below kReferenceKinds, select the model: candidates of
/// one kind are used about equally often.
template <class Coder>
void code_references(Coder& coder, BitModel (&models)[kReferenceKinds][2],
                     std::span<const std::uint8_t> kinds, std::span<std::uint8_t> used) {
  bool last = false;
  for (std::size_t k = 0; k < used.size(); ++k) {
    last = coder.bit(models[kinds[k]][last ? 1 : 0], used[k] != 0);
    used[k] = last ? 1 : 0;
  }
}

/// Decodes the references, with which a payload begins; untrusted.
inline void decode_references(const PredictiveLevel& level, ByteSpan payload,
                              std::span<const std::uint8_t> kinds, std::span<std::uint8_t> used) {
  BitModel models[kReferenceKinds][2];
  std::copy_n(&level.models.used[0][0], kReferenceKinds * 2, &models[0][0]);
  RangeDecoder decoder(payload);
  code_references(decoder, models, kinds, used);
}

}  // namespace slf::codec

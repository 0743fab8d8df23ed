// The quantisation and Huffman tables that all JPEG tiles of a field share.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"

namespace slf::codec {

/// A Huffman table as a DHT segment states it: counts[i] codes of i + 1 bits, and their symbols in
/// order of code.
struct HuffmanTable {
  std::array<std::uint8_t, 16> counts{};
  std::vector<std::uint8_t> symbols;
};

/// [0] is for the only or the luma component, [1] for chroma.
struct JpegTables {
  std::array<std::array<std::uint8_t, 64>, 2> quantisation;  ///< steps 1..255 in zigzag order
  std::array<HuffmanTable, 2> dc;
  std::array<HuffmanTable, 2> ac;
};

/// The tables of ITU-T T.81 Annex K, the quantisation scaled to a quality of 1..100 as libjpeg
/// does.
[[nodiscard]] JpegTables standard_tables(int quality);

/// An abbreviated table-specification stream: SOI, one DQT and one DHT segment per table, EOI.
[[nodiscard]] Bytes to_bytes(const JpegTables& tables);

/// Reads what to_bytes wrote; untrusted.
/// bad_file: anything else, an impossible Huffman code, or a quantisation step of 0.
[[nodiscard]] Result<JpegTables> parse_tables(ByteSpan bytes);

}  // namespace slf::codec

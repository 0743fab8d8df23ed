// The quantisation and Huffman tables that the JPEG streams of all tiles share.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "base/bytes.h"
#include "slf/error.h"

namespace slf::codec {

/// A Huffman table as in a DHT segment: counts[i] codes of i + 1 bits, and their symbols in the
/// order of the codes.
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

/// How often each symbol occurs.
using SymbolCounts = std::array<std::uint64_t, 256>;

/// Whether a baseline encoder can need a symbol: the size of a DC difference, or run and size of
/// AC.
[[nodiscard]] bool is_dc_symbol(int symbol);
[[nodiscard]] bool is_ac_symbol(int symbol);

/// The optimal code of at most 16 bits for these counts (T.81 K.2). Every symbol that `can_occur`
/// gets a code, even if its count is 0.
[[nodiscard]] HuffmanTable optimal_huffman(const SymbolCounts& counts, bool (*can_occur)(int));

/// Whether every picture can be encoded with these tables.
[[nodiscard]] bool is_complete(const JpegTables& tables);

/// Flat quantisation for a quality of 1..100, and the Huffman tables of T.81 Annex K. Flat
/// quantisation gives the least squared error for its bytes, a little less than libjpeg's tables at
/// the same quality.
[[nodiscard]] JpegTables standard_tables(int quality);

/// An abbreviated table-specification stream: SOI, one DQT and one DHT segment per table, EOI.
[[nodiscard]] Bytes to_bytes(const JpegTables& tables);

/// Parses the output of to_bytes, untrusted, and removes it from the start of `bytes`.
/// bad_file: another structure, an invalid Huffman code, or a quantisation step of 0.
[[nodiscard]] Result<JpegTables> take_tables(ByteSpan& bytes);

}  // namespace slf::codec

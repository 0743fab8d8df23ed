// What the XML of a VTK ImageData file (.vti, .pvti) says, and the bytes of its arrays. Private to
// source/volume.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "slf/error.h"
#include "slf/volume.h"

namespace slf::volume_io {

struct VtiArray {
  bool found = false;
  bool of_cells = false;  ///< values belong to cells, else to points
  std::string name, type, format;
  std::uint32_t components = 1;
  std::uint64_t offset = 0;
  std::string text{};  ///< content of the element: numbers, or base64
};

/// A part of the image.
struct VtiPiece {
  std::string extent;
  std::string source;  ///< in a .pvti: the file that holds it
  VtiArray array{};    ///< the one to read
};

/// What the elements say. Texts are as they are in the file: untrusted, empty if absent.
struct VtiDocument {
  std::string path;
  std::string type, compressor;
  bool big_endian = false, wide_header = false;
  std::string extent, origin, spacing, direction;
  /// Of the whole image, in a .pvti, which has no data; else that of the first piece, without text.
  VtiArray array{};
  std::vector<std::string> names;  ///< of all arrays, those of the first piece
  std::vector<VtiPiece> pieces;
  bool appended_raw = false;
  std::uint64_t appended = 0;  ///< byte after the tag of the appended data; 0: none
};

/// Takes the array `wanted`; without, the one that the file calls its scalars, or the first, that
/// of points before that of cells.
/// io: the file cannot be read. bad_file: not well-formed XML, or an absurd array.
[[nodiscard]] Result<VtiDocument> read_vti_document(const std::string& path,
                                                    const std::optional<std::string>& wanted);

/// The numbers of a piece's array, `needed` bytes of this type in native order, components side by
/// side. io: the file cannot be read. bad_file: the array has another size, or its data are damaged
/// or cut off. unsupported: an unknown compressor.
[[nodiscard]] Result<std::vector<std::byte>> read_vti_data(const VtiDocument& document,
                                                           const VtiArray& array, ScalarType type,
                                                           std::uint64_t needed);

}  // namespace slf::volume_io

// What the XML of a VTK ImageData file (.vti) says, and the bytes of its array. Private to
// field/volume.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "slf/error.h"
#include "slf/volume.h"

namespace slf::volume_io {

/// The array of data that is read.
struct VtiArray {
  bool found = false;
  std::string name, type, format;
  std::uint32_t components = 1;
  std::uint64_t offset = 0;
  std::string text{};  ///< content of the element: numbers, or base64
};

/// What the elements say. Texts are as they are in the file: untrusted, empty if absent.
struct VtiDocument {
  std::string type, compressor;
  bool big_endian = false, wide_header = false;
  std::string extent, origin, spacing, direction;
  int pieces = 0;
  std::string piece_extent;
  std::string scalars;    ///< the array that the file calls its scalars
  bool of_cells = false;  ///< no point data: values belong to cells
  VtiArray array{};
  int others = 0;  ///< other arrays
  bool appended_raw = false;
  std::uint64_t appended = 0;  ///< byte after the tag of the appended data; 0: none
};

/// io: the file cannot be read. bad_file: not well-formed XML, or an absurd array.
[[nodiscard]] Result<VtiDocument> read_vti_document(const std::string& path);

/// The numbers of the array, `needed` bytes in native order, components side by side. `volume` has
/// its source and type. io: the file cannot be read. bad_file: the array has another size, or its
/// data are damaged or cut off.
[[nodiscard]] Result<std::vector<std::byte>> read_vti_data(const VtiDocument& document,
                                                           const Volume& volume,
                                                           std::uint64_t needed);

}  // namespace slf::volume_io

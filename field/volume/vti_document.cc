// The XML of a VTK ImageData file. Expat parses it; this file interprets it.
#include "field/volume/io.h"
#include "field/volume/vti_file.h"
#include "field/volume/xml.h"

namespace slf::volume_io {
namespace {

std::string get(const XmlAttributes& attributes, std::string_view key) {
  const auto found = attributes.find(key);
  return found == attributes.end() ? "" : found->second;
}

}  // namespace

Result<VtiDocument> read_vti_document(const std::string& path) {
  VtiDocument d;
  std::string inside;       // "PointData" or "CellData"
  bool collecting = false;  // the text of the chosen array
  std::string problem;
  const auto take_array = [&](const XmlAttributes& attributes) {
    const std::string name = get(attributes, "Name");
    const bool preferred = !d.scalars.empty() && name == d.scalars;
    if (inside.empty() || (d.array.found && !preferred)) {
      d.others += inside.empty() ? 0 : 1;
      return;
    }
    d.others += d.array.found ? 1 : 0;
    d.array = {.found = true,
               .name = name,
               .type = get(attributes, "type"),
               .format = lower(get(attributes, "format"))};
    d.of_cells = inside == "CellData";
    const auto components = attributes.contains("NumberOfComponents")
                                ? parse_integer(get(attributes, "NumberOfComponents"))
                                : 1;
    const auto offset =
        attributes.contains("offset") ? parse_integer(get(attributes, "offset")) : 0;
    if (!components || *components < 1 || *components > 4096 || !offset || *offset < 0)
      problem = "components or offset of the array " + in_quotes(name);
    d.array.components = static_cast<std::uint32_t>(components.value_or(1));
    d.array.offset = static_cast<std::uint64_t>(offset.value_or(0));
    collecting = true;
  };
  const XmlHandler handler{
      .start =
          [&](std::string_view name, const XmlAttributes& a) {
            if (name == "VTKFile") {
              d.type = get(a, "type");
              d.compressor = get(a, "compressor");
              d.big_endian = get(a, "byte_order") == "BigEndian";
              d.wide_header = get(a, "header_type") == "UInt64";
            } else if (name == "ImageData") {
              d.extent = get(a, "WholeExtent");
              d.origin = get(a, "Origin");
              d.spacing = get(a, "Spacing");
              d.direction = get(a, "Direction");
            } else if (name == "Piece") {
              ++d.pieces;
              d.piece_extent = get(a, "Extent");
            } else if (name == "PointData" || (name == "CellData" && !d.array.found)) {
              inside = name;
              d.scalars = get(a, "Scalars");
            } else if (name == "DataArray") {
              take_array(a);
            } else if (name == "AppendedData") {
              d.appended_raw = lower(get(a, "encoding")) == "raw";
              return false;  // what follows need not be XML
            }
            return true;
          },
      .end =
          [&](std::string_view name) {
            if (name == "PointData" || name == "CellData") inside.clear();
            if (name == "DataArray") collecting = false;
          },
      .text =
          [&](std::string_view text) {
            if (collecting) d.array.text += text;
          }};
  const auto end = read_xml(path, handler);
  if (!end) return tl::unexpected(end.error());
  if (!problem.empty()) return fail(ErrorCode::bad_file, path, ": absurd ", problem);
  d.appended = *end;
  return d;
}

}  // namespace slf::volume_io

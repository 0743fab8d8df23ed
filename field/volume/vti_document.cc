// The XML of a VTK ImageData file. Expat parses it; this file interprets it.
#include <limits>

#include "base/try.h"
#include "field/volume/io.h"
#include "field/volume/vti_file.h"
#include "field/volume/xml.h"

namespace slf::volume_io {
namespace {

std::string get(const XmlAttributes& attributes, std::string_view key) {
  const auto found = attributes.find(key);
  return found == attributes.end() ? "" : found->second;
}

/// Follows the elements of a document. Those of a .pvti have the same names with a P before them.
class VtiReader {
 public:
  VtiReader(const std::string& path, const std::optional<std::string>& wanted) : wanted_(wanted) {
    d_.path = path;
  }

  Result<VtiDocument> read() {
    const XmlHandler handler{
        .start = [this](std::string_view name,
                        const XmlAttributes& a) { return start(without_p(name), a); },
        .end = [this](std::string_view name) { end(without_p(name)); },
        .text =
            [this](std::string_view text) {
              if (collecting_) collecting_->text += text;
            }};
    const auto end = SLF_TRY(read_xml(d_.path, handler));
    if (!problem_.empty()) return fail(ErrorCode::bad_file, d_.path, ": absurd ", problem_);
    d_.appended = end;
    return std::move(d_);
  }

 private:
  static std::string_view without_p(std::string_view name) {
    for (const char* known : {"PImageData", "PPointData", "PCellData", "PDataArray"})
      if (name == known) return name.substr(1);
    return name;
  }

  bool start(std::string_view name, const XmlAttributes& a) {
    constexpr std::size_t kMaxPieces = 1 << 16;
    if (name == "VTKFile") {
      d_.type = get(a, "type");
      d_.compressor = get(a, "compressor");
      d_.big_endian = get(a, "byte_order") == "BigEndian";
      d_.wide_header = get(a, "header_type") == "UInt64";
    } else if (name == "ImageData") {
      d_.extent = get(a, "WholeExtent");
      d_.origin = get(a, "Origin");
      d_.spacing = get(a, "Spacing");
      d_.direction = get(a, "Direction");
    } else if (name == "Piece") {
      collecting_ = nullptr;
      if (d_.pieces.size() == kMaxPieces) problem_ = "number of pieces";
      if (!problem_.empty()) return false;
      d_.pieces.push_back({.extent = get(a, "Extent"), .source = get(a, "Source")});
    } else if (name == "PointData" || name == "CellData") {
      inside_ = name;
      scalars_ = get(a, "Scalars");
    } else if (name == "DataArray" && !inside_.empty()) {
      take_array(a);
    } else if (name == "AppendedData") {
      d_.appended_raw = lower(get(a, "encoding")) == "raw";
      return false;  // what follows need not be XML
    }
    return true;
  }

  void end(std::string_view name) {
    if (name == "PointData" || name == "CellData") inside_.clear();
    if (name == "DataArray") collecting_ = nullptr;
  }

  void take_array(const XmlAttributes& a) {
    constexpr std::size_t kMaxNames = 256;
    const std::string name = get(a, "Name");
    const bool of_cells = inside_ == "CellData";
    if (d_.pieces.size() <= 1 && d_.names.size() < kMaxNames) d_.names.push_back(name);
    VtiArray& array = d_.pieces.empty() ? d_.array : d_.pieces.back().array;
    // Points go before cells, and the scalars of either before other arrays.
    const bool first = !array.found || (array.of_cells && !of_cells);
    const bool preferred = !scalars_.empty() && name == scalars_ && array.of_cells == of_cells;
    if (wanted_ ? name != *wanted_ || !first : !first && !preferred) return;
    array = {.found = true,
             .of_cells = of_cells,
             .name = name,
             .type = get(a, "type"),
             .format = lower(get(a, "format"))};
    const auto number = [&](const char* key, std::int64_t least, std::int64_t most,
                            std::int64_t otherwise) {
      const auto value = a.contains(key) ? parse_integer(get(a, key)) : otherwise;
      if (!value || *value < least || *value > most)
        problem_ = std::string(key) + " of the array " + in_quotes(name);
      return value.value_or(otherwise);
    };
    array.components =
        static_cast<std::uint32_t>(number("NumberOfComponents", 1, kMaxComponents, 1));
    array.offset = static_cast<std::uint64_t>(
        number("offset", 0, std::numeric_limits<std::int64_t>::max(), 0));
    collecting_ = &array;
  }

  static constexpr std::int64_t kMaxComponents = 4096;

  const std::optional<std::string>& wanted_;
  VtiDocument d_;
  std::string inside_;   // "PointData" or "CellData"
  std::string scalars_;  // the array that it calls so
  VtiArray* collecting_ = nullptr;
  std::string problem_;
};

}  // namespace

Result<VtiDocument> read_vti_document(const std::string& path,
                                      const std::optional<std::string>& wanted) {
  auto document = VtiReader(path, wanted).read();
  if (document && !document->array.found && !document->pieces.empty()) {
    document->array = document->pieces.front().array;
    document->array.text.clear();
  }
  return document;
}

}  // namespace slf::volume_io

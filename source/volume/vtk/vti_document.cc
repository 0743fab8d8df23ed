// The XML of a VTK ImageData file.
#include <limits>

#include "base/try.h"
#include "base/xml.h"
#include "source/volume/io.h"
#include "source/volume/vtk/vti_file.h"

namespace slf::volume_io {
namespace {

/// Elements of a .pvti have the same names as those of a .vti, with a P before them.
std::string_view without_p(std::string_view name) {
  for (const char* known : {"PImageData", "PPointData", "PCellData", "PDataArray"})
    if (name == known) return name.substr(1);
  return name;
}

/// The XML of a file. What follows the tag of its appended data need not be XML: instead, the
/// elements are closed. `appended`: the byte after that tag, or the end of the file.
Result<std::string> read_markup(const std::string& path, std::uint64_t& appended) {
  constexpr std::size_t kChunk = std::size_t{1} << 16, kLongestTag = 256;
  auto reader = SLF_TRY(ByteReader::open(path, 0, false));
  std::string text;
  while (true) {
    const std::size_t from = text.size();
    const auto more = SLF_TRY(reader.read_text(kChunk));
    text += more;
    const auto tag = text.find("<AppendedData", from - std::min(from, kLongestTag));
    const auto end = text.find('>', tag);
    if (tag != std::string::npos && end != std::string::npos) {
      text.resize(appended = end + 1);
      return text + (text.ends_with("/>") ? "" : "</AppendedData>") + "</VTKFile>";
    }
    appended = text.size();
    if (more.empty()) return text;
  }
}

class VtiReader {
 public:
  VtiReader(const std::string& path, const std::optional<std::string>& wanted) : wanted_(wanted) {
    d_.path = path;
  }

  Result<VtiDocument> read() {
    constexpr std::size_t kMaxPieces = 1 << 16;
    const auto text = SLF_TRY(read_markup(d_.path, d_.appended));
    const auto xml = SLF_TRY(parse_xml(text, d_.path));
    for (const pugi::xml_node& element : elements_of(*xml)) {
      const auto name = without_p(name_of(element));
      if (name == "VTKFile") {
        d_.type = attribute(element, "type");
        d_.compressor = attribute(element, "compressor");
        d_.big_endian = attribute(element, "byte_order") == "BigEndian";
        d_.wide_header = attribute(element, "header_type") == "UInt64";
      } else if (name == "ImageData") {
        d_.extent = attribute(element, "WholeExtent");
        d_.origin = attribute(element, "Origin");
        d_.spacing = attribute(element, "Spacing");
        d_.direction = attribute(element, "Direction");
      } else if (name == "Piece") {
        if (d_.pieces.size() == kMaxPieces) problem_ = "number of pieces";
        if (!problem_.empty()) break;
        d_.pieces.push_back(
            {.extent = attribute(element, "Extent"), .source = attribute(element, "Source")});
      } else if (name == "DataArray") {
        take_array(element);
      } else if (name == "AppendedData") {
        d_.appended_raw = lower_case(attribute(element, "encoding")) == "raw";
      }
    }
    if (!problem_.empty()) return bad_file(d_.path, "absurd ", problem_);
    if (!d_.array.found && !d_.pieces.empty()) {
      d_.array = d_.pieces.front().array;
      d_.array.text.clear();
    }
    return std::move(d_);
  }

 private:
  void take_array(const pugi::xml_node& element) {
    constexpr std::size_t kMaxNames = 256;
    const auto owner = without_p(name_of(element.parent()));
    const bool of_cells = owner == "CellData";
    if (!of_cells && owner != "PointData") return;
    const std::string name = attribute(element, "Name"),
                      scalars = attribute(element.parent(), "Scalars");
    if (d_.pieces.size() <= 1 && d_.names.size() < kMaxNames) d_.names.push_back(name);
    VtiArray& array = d_.pieces.empty() ? d_.array : d_.pieces.back().array;
    // Points go before cells, and the scalars of either before other arrays.
    const bool first = !array.found || (array.of_cells && !of_cells);
    const bool preferred = !scalars.empty() && name == scalars && array.of_cells == of_cells;
    if (wanted_ ? name != *wanted_ || !first : !first && !preferred) return;
    array = {.found = true,
             .of_cells = of_cells,
             .name = name,
             .type = attribute(element, "type"),
             .format = lower_case(attribute(element, "format"))};
    const auto number = [&](const char* key, std::int64_t least, std::int64_t most,
                            std::int64_t otherwise) {
      const auto stated = element.attribute(key);
      const auto value = stated ? parse_integer(stated.value()) : otherwise;
      if (!value || *value < least || *value > most)
        problem_ = std::string(key) + " of the array " + in_quotes(name);
      return value.value_or(otherwise);
    };
    array.components = static_cast<std::uint32_t>(number("NumberOfComponents", 1, 4096, 1));
    array.offset = static_cast<std::uint64_t>(
        number("offset", 0, std::numeric_limits<std::int64_t>::max(), 0));
    for (const pugi::xml_node& text : element.children()) array.text += text.value();
  }

  const std::optional<std::string>& wanted_;
  VtiDocument d_;
  std::string problem_;
};

}  // namespace

Result<VtiDocument> read_vti_document(const std::string& path,
                                      const std::optional<std::string>& wanted) {
  return VtiReader(path, wanted).read();
}

}  // namespace slf::volume_io

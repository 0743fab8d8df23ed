// STL, as text and binary.
#include <array>

#include "base/ascii.h"
#include "base/try.h"
#include "base/utf8.h"
#include "source/mesh/builder.h"
#include "source/volume/io.h"

namespace slf {
namespace {

using volume_io::parse_number;

constexpr std::size_t kHeader = 84, kFacet = 50;

/// Many programs begin binary files with "solid", too. Text has no zeros, but for some at its end.
bool is_text(std::string_view bytes) {
  const std::string_view start = trim(without_byte_order_mark(bytes.substr(0, 4096)));
  const std::string small = lower_case(start);
  return start.find('\0') == start.npos &&
         (small.starts_with("solid") || small.find("facet") != small.npos);
}

Result<void> read_text(std::string_view text, MeshBuilder& to) {
  bool open = false;  // a solid that does not end yet
  std::vector<std::uint32_t> corners;
  while (!text.empty() && !to.full()) {
    std::string word = lower_case(next_word(text));
    if (word == "end") word += lower_case(next_word(text));  // in two words, as some write it
    if (word == "solid" || word == "endsolid") {
      open = word == "solid";
      next_line(text);  // its name
    } else if (word == "vertex") {
      glm::dvec3 p(0);
      for (int axis = 0; axis < 3; ++axis) {
        const auto number = parse_number(next_word(text));
        if (!number)
          return to.wrong("STL: triangle ", to.mesh().triangles.size(),
                          text.empty() ? ": truncated" : ": a vertex needs three numbers");
        p[axis] = *number;
      }
      corners.push_back(to.add({p}));
    } else if (word == "endloop") {
      if (!to.full()) to.add(corners, 0);
      corners.clear();
    }
  }
  if (open && !to.full()) return to.wrong("STL: does not end with 'endsolid': truncated");
  return {};
}

Result<void> read_binary(ByteSpan bytes, MeshBuilder& to) {
  if (bytes.size() < kHeader) return to.wrong("STL: truncated in its header");
  const std::uint64_t stated = load_le<std::uint32_t>(&bytes[kHeader - 4]),
                      there = (bytes.size() - kHeader) / kFacet;
  // Programs that cannot seek do not know it yet when they write it.
  const bool unset = stated == 0 || stated == 0xffffffff;
  const std::uint64_t count = unset ? there : stated;
  if (there > count)
    to.note(concat("has bytes of ", there - count, " more triangles than it says, left out"));
  if (there < count)
    return to.wrong("STL: says ", count, " triangles, which need ", kHeader + kFacet * count,
                    " bytes, but it has ", bytes.size(), ": truncated; copy it again");
  // Colours have 5 bits. With Magics' header bit 15 stands for the colour of the whole part, as do
  // attributes that are all 0; red is in the lowest bits. Without it bit 15 says that there is a
  // colour, and red is in the highest.
  const std::string_view header(reinterpret_cast<const char*>(bytes.data()), 80);
  const std::size_t magics = header.substr(0, 70).find("COLOR=");
  const auto part = [&](std::size_t k) {
    return static_cast<std::uint8_t>(header[magics + 6 + k]);
  };
  const auto attribute = [&](std::size_t facet) -> unsigned {
    return load_le<std::uint16_t>(&bytes[kHeader + kFacet * facet + 48]);
  };
  std::optional<glm::u8vec4> all;
  bool own = magics == header.npos;
  if (!own) all = glm::u8vec4(part(0), part(1), part(2), 255);
  for (std::size_t k = 0; k < count && !own; ++k) own = attribute(k) != 0;
  for (std::size_t k = 0; k < count && !to.full(); ++k) {
    const std::byte* facet = &bytes[kHeader + kFacet * k];
    const unsigned bits = attribute(k);
    std::optional<glm::u8vec4> color = all;
    if (own && ((bits & 0x8000U) != 0) != all.has_value()) {
      const auto five = [&](unsigned shift) {
        return static_cast<std::uint8_t>(((bits >> shift & 31U) * 255 + 15) / 31);
      };
      color = all ? glm::u8vec4(five(0), five(5), five(10), 255)
                  : glm::u8vec4(five(10), five(5), five(0), 255);
    }
    std::array<std::uint32_t, 3> corners{};
    for (std::size_t c = 0; c < 3; ++c) {
      const auto number = [&](std::size_t axis) {
        return std::bit_cast<float>(load_le<std::uint32_t>(facet + 12 * (c + 1) + 4 * axis));
      };
      corners[c] = to.add({.position = {number(0), number(1), number(2)}, .color = color});
    }
    if (!to.full()) to.add({corners[0], corners[1], corners[2]}, 0);
  }
  return {};
}

}  // namespace

Result<void> read_stl(ByteSpan bytes, MeshBuilder& to) {
  const std::string_view chars = chars_of(bytes);
  const bool wide = chars.starts_with("\xFF\xFE") || chars.starts_with("\xFE\xFF");
  std::string made;
  const std::string_view text =
      wide ? as_utf8(chars, made) : chars.substr(0, chars.find_last_not_of('\0') + 1);
  SLF_TRY(is_text(text) ? read_text(text, to) : read_binary(bytes, to));
  MeshMaterial material;
  if (to.mesh().colors.empty()) material.color = glm::vec4(glm::vec3(kPlainColor), 1);
  to.mesh().materials.push_back(material);
  return {};
}

}  // namespace slf

#include "field/structure_looks.h"

#include <fnmatch.h>

#include <algorithm>
#include <charconv>
#include <nlohmann/json.hpp>

#include "base/try.h"

namespace slf {
namespace {

/// Whether `text` is a number or #RRGGBB, which `look` then has.
bool parse_look(std::string_view text, StructureLook& look) {
  const char* const end = text.data() + text.size();
  float opacity = 0;
  unsigned color = 0;
  if (!text.starts_with('#')) {
    if (text.empty() || std::from_chars(text.data(), end, opacity).ptr != end) return false;
    look.opacity = opacity;
    return true;
  }
  if (text.size() != 7 || std::from_chars(text.data() + 1, end, color, 16).ptr != end) return false;
  for (const auto c : {0u, 1u, 2u})
    look.tint[c] = static_cast<float>(color >> (16 - 8 * c) & 255) / 255;
  return true;
}

}  // namespace

Result<StructureLook> parse_structure(std::string_view text) {
  StructureLook look;
  for (std::size_t at; (at = text.rfind(':')) != text.npos; text = text.substr(0, at)) {
    if (parse_look(text.substr(at + 1), look)) continue;
    if (text.substr(at + 1, 1) != "#") break;  // the colon is part of the name
    return fail(ErrorCode::usage, text.substr(at + 1), ": expected a colour as #RRGGBB");
  }
  look.name = text;
  return look;
}

bool has_structures(const Field& field) {
  const auto built = nlohmann::json::parse(field.provenance(), nullptr, false);
  const nlohmann::json none;
  const nlohmann::json parts = built.is_object() ? built.value("structures", none) : none;
  return field.states().size() > 1 && parts.is_object() && parts.contains("only");
}

Result<std::vector<Structure>> structures_of(const Field& field, std::span<const std::string> texts,
                                             std::vector<StructureLook>& others) {
  const std::vector<std::string> names = field.states();
  std::vector<StructureLook> looks(names.size(), {.name = "", .opacity = 0});
  for (const std::string& text : texts) {
    // A state's name may end as with an opacity or a colour.
    const bool named = std::find(names.begin(), names.end(), text) != names.end();
    const auto look = SLF_TRY(named ? StructureLook{.name = text} : parse_structure(text));
    bool found = false;
    for (std::size_t k = 0; k < names.size(); ++k)
      if (look.name == names[k] || ::fnmatch(look.name.c_str(), names[k].c_str(), 0) == 0)
        looks[k] = look, found = true;
    if (!found) others.push_back(look);
  }
  std::vector<Structure> shown;
  for (unsigned k = 0; k < looks.size(); ++k) {
    if (looks[k].opacity == 0) continue;
    const auto one = SLF_TRY(field.in_state(k));
    shown.push_back({one, looks[k].opacity, looks[k].tint});
  }
  return shown;
}

}  // namespace slf

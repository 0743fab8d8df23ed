#include "field/structure_looks.h"

#include <algorithm>
#include <cmath>
#include <iomanip>

#include "base/ascii.h"
#include "base/try.h"
#include "base/wildcard.h"
#include "field/field_file.h"

namespace slf {
namespace {

/// Whether `text` is a number or #RRGGBB, which `look` then has.
bool parse_look(std::string_view text, StructureLook& look) {
  if (!text.starts_with('#')) {
    const auto opacity = parse_number<float>(text);
    look.opacity = opacity.value_or(look.opacity);
    return opacity.has_value();
  }
  const auto color = parse_number<unsigned>(text.substr(1), 16);
  if (text.size() != 7 || !color) return false;
  for (const auto c : {0u, 1u, 2u})
    look.tint[c] = static_cast<float>(*color >> (16 - 8 * c) & 255) / 255;
  return true;
}

}  // namespace

Result<StructureLook> parse_structure(std::string_view text, std::span<const std::string> names) {
  StructureLook look;
  for (std::size_t at; !std::ranges::count(names, text) && (at = text.rfind(':')) != text.npos;
       text = text.substr(0, at)) {
    if (parse_look(text.substr(at + 1), look)) continue;
    if (text.substr(at + 1, 1) != "#") break;  // the colon is part of the name
    return fail(ErrorCode::usage, text.substr(at + 1), ": expected a colour as #RRGGBB");
  }
  look.name = text;
  return look;
}

Result<std::vector<StructureLook>> parse_structures(std::span<const std::string> texts,
                                                    std::span<const std::string> names) {
  std::vector<StructureLook> looks;
  for (const std::string& text : texts) {
    auto look = SLF_TRY(parse_structure(text, names));
    looks.push_back(std::move(look));
  }
  return looks;
}

std::string text_of(const StructureLook& look) {
  std::string text = look.name;
  if (look.opacity != 1) text += concat(':', look.opacity);
  if (look.tint == StructureLook().tint) return text;
  text += ":#";
  for (const float c : look.tint)
    text += concat(std::hex, std::setfill('0'), std::setw(2),
                   std::lround(std::clamp(c, 0.f, 1.f) * 255));
  return text;
}

bool has_structures(const Field& field) {
  const FieldFile& file = field.file();
  return file.manifest().states.size() > 1 &&
         file.manifest().provenance_at(field.state(), {"structures", "only"});
}

Result<std::vector<Structure>> structures_of(const Field& field,
                                             std::span<const StructureLook> looks,
                                             std::vector<StructureLook>& others) {
  const std::vector<std::string> names = field.states();
  std::vector<std::optional<StructureLook>> shown_as(names.size());
  for (const StructureLook& look : looks) {
    const bool named = std::ranges::count(names, look.name) > 0;
    bool found = false;
    for (std::size_t k = 0; k < names.size() && !look.field; ++k)
      if (named ? look.name == names[k] : fits_pattern(look.name, names[k]))
        shown_as[k] = look, found = true;
    if (!found) others.push_back(look);
  }
  std::vector<Structure> shown;
  for (unsigned k = 0; k < names.size(); ++k) {
    if (!shown_as[k] || shown_as[k]->opacity == 0) continue;
    const auto one = SLF_TRY(field.in_state(k));
    shown.push_back({one, shown_as[k]->opacity, shown_as[k]->tint});
  }
  return shown;
}

Result<Field> compose_looks(const Field& field, std::span<const StructureLook> looks,
                            const std::function<Result<Field>(const std::string&)>& open) {
  std::vector<StructureLook> others;
  auto shown = SLF_TRY(structures_of(field, looks, others));
  for (const StructureLook& other : others) {
    const bool is_state = !other.name.ends_with(".slf") && !field.states().empty();
    if (other.opacity == 0) {  // a file need not even exist, but what is said to be a state
      if (is_state && !other.field) SLF_TRY(field.in_state(other.name));
      continue;
    }
    auto one = other.field ? *other.field : open(other.name);
    if (!one && one.error().code == ErrorCode::not_found && is_state)
      one = field.in_state(other.name);  // names what there is
    const auto opened = SLF_TRY(std::move(one));
    shown.push_back({opened, other.opacity, other.tint});
  }
  return compose(field, std::move(shown));
}

Result<Field> all_structures(const Field& field) {
  if (!has_structures(field)) return field;
  return compose_looks(field, std::array{StructureLook{"*"}}, {});
}

}  // namespace slf

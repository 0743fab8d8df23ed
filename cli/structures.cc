// --structure: fields that are drawn together.
#include <charconv>

#include "base/try.h"
#include "cli/command.h"

namespace slf::cli {
namespace {

/// What --structure states.
struct Given {
  std::string name;
  float opacity = 1;
  std::array<float, 3> tint{1, 1, 1};
};

/// Whether `text` is a number or #RRGGBB, which `given` then has.
bool parse_look(std::string_view text, Given& given) {
  const char* const end = text.data() + text.size();
  float opacity = 0;
  unsigned color = 0;
  if (!text.starts_with('#')) {
    if (text.empty() || std::from_chars(text.data(), end, opacity).ptr != end) return false;
    given.opacity = opacity;
    return true;
  }
  if (text.size() != 7 || std::from_chars(text.data() + 1, end, color, 16).ptr != end) return false;
  for (const auto c : {0u, 1u, 2u})
    given.tint[c] = static_cast<float>(color >> (16 - 8 * c) & 255) / 255;
  return true;
}

Result<Given> parse_structure(std::string_view text) {
  Given given;
  for (std::size_t at; (at = text.rfind(':')) != text.npos; text = text.substr(0, at)) {
    if (parse_look(text.substr(at + 1), given)) continue;
    if (text.substr(at + 1, 1) != "#") break;  // the colon is part of the name
    return fail(ErrorCode::usage, "--structure: ", text.substr(at + 1),
                ": expected a colour as #RRGGBB");
  }
  given.name = text;
  return given;
}

}  // namespace

void DrawArguments::add_structures_to(CLI::App& command) {
  command
      .add_option("--structure", structures,
                  "Draw this field together with those of more such options, instead of FIELD,\n"
                  "whose sphere they must have; with an opacity from 0, hidden, to 1, and a\n"
                  "colour by which its own are multiplied")
      ->type_name("FILE.slf[:OPACITY][:#RRGGBB]")
      ->allow_extra_args(false)
      ->group("Drawing");
}

std::vector<std::string> DrawArguments::inputs(const std::string& field) const {
  std::vector<std::string> files{field};
  for (const std::string& text : structures)
    if (auto given = parse_structure(text)) files.push_back(std::move(given->name));
  return files;
}

Result<Field> DrawArguments::open(const std::string& path) const {
  const auto field = SLF_TRY(open_field(path));
  if (structures.empty()) return field;
  std::vector<Structure> drawn;
  for (const std::string& text : structures) {
    const auto given = SLF_TRY(parse_structure(text));
    if (given.opacity == 0) continue;  // a hidden one need not even exist
    const auto one = SLF_TRY(given.name == path ? Result<Field>(field) : open_field(given.name));
    drawn.push_back({one, given.opacity, given.tint});
  }
  return compose(field, std::move(drawn));
}

}  // namespace slf::cli

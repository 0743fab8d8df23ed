// --structure: fields, and states of one, that are drawn together.
#include <fnmatch.h>

#include <charconv>

#include "base/try.h"
#include "cli/command.h"

namespace slf::cli {
namespace {

/// What --structure states.
struct Given {
  std::string name{};
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

/// Whether the states of a field are structures of one volume.
bool has_parts(const Field& field) {
  const auto built = nlohmann::json::parse(field.provenance(), nullptr, false);
  const nlohmann::json none;
  const nlohmann::json parts = built.is_object() ? built.value("structures", none) : none;
  return field.states().size() > 1 && parts.is_object() && parts.contains("only");
}

}  // namespace

void DrawArguments::add_structures_to(CLI::App& command) {
  command
      .add_option(
          "--structure", structures,
          "Draw this together with what more such options name, instead of FIELD: states of\n"
          "FIELD, by names or patterns as 'left *', or other fields on its sphere; with an\n"
          "opacity from 0, hidden, to 1, and a colour by which its own are multiplied")
      ->type_name("NAME[:OPACITY][:#RRGGBB]")
      ->allow_extra_args(false)
      ->group("Drawing");
}

std::vector<std::string> DrawArguments::inputs(const FieldArguments& field) const {
  std::vector<std::string> files{field.path};
  for (const std::string& text : structures)
    if (auto given = parse_structure(text)) files.push_back(std::move(given->name));
  return files;
}

Result<Field> DrawArguments::open(const FieldArguments& arguments) const {
  const auto field = SLF_TRY(arguments.open());
  std::vector<std::string> texts = structures;
  if (texts.empty() && arguments.state.empty() && has_parts(field)) texts = {"*"};
  if (texts.empty()) return field;
  const std::vector<std::string> names = field.states();
  std::vector<Given> states(names.size(), {.opacity = 0}), files;
  for (const std::string& text : texts) {
    const auto given = SLF_TRY(parse_structure(text));
    bool found = false;
    for (std::size_t k = 0; k < names.size(); ++k)
      if (given.name == names[k] || ::fnmatch(given.name.c_str(), names[k].c_str(), 0) == 0)
        states[k] = given, found = true;
    if (!found && !is_field(given.name)) return field.in_state(given.name);  // names what there is
    if (!found) files.push_back(given);
  }
  std::vector<Structure> drawn;  // a hidden one need not even exist
  for (unsigned k = 0; k < states.size(); ++k) {
    if (states[k].opacity == 0) continue;
    const auto one = SLF_TRY(field.in_state(k));
    drawn.push_back({one, states[k].opacity, states[k].tint});
  }
  for (const Given& given : files) {
    if (given.opacity == 0) continue;
    const bool own = given.name == arguments.path;
    const auto one = SLF_TRY(own ? Result<Field>(field) : open_field(given.name));
    drawn.push_back({one, given.opacity, given.tint});
  }
  return compose(field, std::move(drawn));
}

}  // namespace slf::cli

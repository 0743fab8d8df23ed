// --structure: fields, and states of one, that are drawn together.
#include "base/try.h"
#include "cli/command.h"
#include "field/structure_looks.h"

namespace slf::cli {

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
  if (texts.empty() && arguments.state.empty() && has_structures(field)) texts = {"*"};
  if (texts.empty()) return field;
  std::vector<StructureLook> files;
  auto drawn = structures_of(field, texts, files);
  if (!drawn) return fail(drawn.error().code, "--structure: ", drawn.error().message);
  for (const StructureLook& file : files) {
    if (!is_field(file.name)) return field.in_state(file.name);  // names what there is
    if (file.opacity == 0) continue;                             // it need not even exist
    const auto one =
        SLF_TRY(file.name == arguments.path ? Result<Field>(field) : open_field(file.name));
    drawn->push_back({one, file.opacity, file.tint});
  }
  return compose(field, std::move(*drawn));
}

}  // namespace slf::cli

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
  if (structures.empty())
    return arguments.state.empty() ? all_structures(field) : Result<Field>(field);
  const auto looks = SLF_TRY(at_place(parse_structures(structures, field.states()), "--structure"));
  return compose_looks(field, looks, [&](const std::string& name) {
    return name == arguments.path ? Result<Field>(field) : open_field(name);
  });
}

}  // namespace slf::cli

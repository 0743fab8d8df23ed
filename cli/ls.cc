// slf ls: lists the tiles of a field, one per line, for other tools to read.
#include "base/try.h"
#include "cli/command.h"
#include "slf/inspect.h"

namespace slf::cli {
namespace {

struct LsArguments {
  FieldArguments field;
  std::optional<LevelRange> levels;
  Subfields subfields;
  TileFilter filter;
  bool json = false;
};

Result<void> run_ls(const LsArguments& a) {
  const auto field = SLF_TRY(a.field.open());
  TileFilter filter = a.filter;
  filter.subfields = a.subfields.numbers;
  if (a.levels) filter.first_level = a.levels->first, filter.last_level = a.levels->last;
  // Prints the array while tiles are read, so memory does not depend on its length.
  const char* before = "[\n";
  SLF_TRY(list_tiles(field, filter, [&](const ListedTile& tile) -> Result<void> {
    if (a.json) {
      print_text(before + report::line_of(tile));
      before = ",\n";
    } else {
      print("{}\t{}\t{}\t{}\t{}\t{}\n", to_string(tile.address), name(tile.state),
            tile.payload_bytes, tile.offset_bytes, tile.key.index, tile.subfield);
    }
    if (std::ferror(stdout) != 0) return fail(ErrorCode::io, "stdout: cannot write");
    return {};
  }));
  if (a.json) print_text(before[0] == '[' ? "[]\n" : "\n]\n");
  return {};
}

}  // namespace

void add_ls(CLI::App& app, Run& run) {
  const auto [command, a] =
      add_command(app, run, "ls", "List the tiles of a field, for other tools to read", run_ls);
  command->footer(R"(
A line has six columns, separated by tabs: LEVEL/ENTRY/EXIT, its state (stored, empty, missing, or
same: as in an earlier state of the object, whose payload it shares), the bytes of its payload, where
they begin in the file, the tile's index within the level, and its subfield. Lines are in the order
of levels and indexes.)");
  a->field.add_to(*command, "Field to list");
  add_levels(*command, "--level", a->levels, "Only tiles of these levels");
  add_subfields(*command, a->subfields, "Only tiles of these level-0 subfields");
  command->add_flag("--missing", a->filter.missing, "Also tiles that the field lacks");
  add_json<std::vector<ListedTile>>(*command, a->json);
}

}  // namespace slf::cli

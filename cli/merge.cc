// slf merge: joins parts of a field.
#include "slf/merge.h"

#include "cli/command.h"

namespace slf::cli {
namespace {

struct MergeArguments {
  std::vector<std::string> parts;
  std::string output;
  MergeOptions merge;
  bool json = false;
};

Result<void> run_merge(const MergeArguments& a) {
  bound_freed_memory(a.merge.memory);
  const auto report =
      merge_fields(a.parts, a.output, a.merge, progress_bar("merge", "tiles", OnSignal::stop));
  if (!report && report.error().choice && std::string_view(report.error().choice) == "part")
    return with_hint(report.error(), "build them, or let the output be a part with --part");
  if (!report) return hinted(Result<void>(tl::unexpected(report.error())));
  note_budget(a.output, a.merge.memory, report->memory);
  if (a.json)
    print_json(*report);
  else
    print("{}: {}, {} tiles of {} parts\n", a.output, human_bytes(report->file_bytes),
          report->tiles, a.parts.size());
  return {};
}

}  // namespace

void add_merge(CLI::App& app, Run& run) {
  const auto [command, a] =
      add_command(app, run, "merge", "Join parts of a field: shards, levels, subfields", run_merge);
  add_file(*command, "PARTS", a->parts, "Parts of one field, in any order; not touched", kFieldFile)
      ->required();
  add_file(*command, "-o,--output", a->output, "The field to write", kFieldFile)->required();
  command->add_flag("-f,--force", a->merge.replace,
                    "Replace the output, once the new field is complete");
  command->add_flag("--part", a->merge.part,
                    "The parts need not be all: the output may be a part, too");
  add_budget(*command, a->merge.memory);
  add_threads(*command, a->merge.threads);
  add_json<MergeReport>(*command, a->json);
}

}  // namespace slf::cli

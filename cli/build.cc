#include "slf/build.h"

#include "base/file.h"
#include "base/try.h"
#include "cli/command.h"

namespace slf::cli {
namespace {

struct BuildArguments {
  SourceArguments source;
  ShardArguments shard;
  std::string output;
  bool force = false;
};

Result<void> run_build(const BuildArguments& arguments) {
  SourceArguments source = arguments.source;
  BuildOptions& options = source.field;
  bound_freed_memory(options.memory);
  const auto shard = SLF_TRY(arguments.shard.options());
  options.shard = shard;
  const std::string output = name_of_part(arguments.output, shard);
  source.check = [&](std::vector<std::string> inputs) {
    inputs.insert(inputs.end(), {arguments.source.input, arguments.source.states_file});
    return check_output(output, inputs);
  };
  SLF_TRY(source.check({}));
  SLF_TRY(source.finish(options.threads, OnSignal::stop));
  source.raycast.lighting.linear = options.half;
  const auto made = SLF_TRY(hinted(make_scenes(source)));
  const auto states = field_states(made);
  options.shape.sphere = field_sphere(source, states);
  options.reveal = SLF_TRY(hinted(reveal_code(source, states)));
  options.replace = arguments.force;
  const auto report = SLF_TRY(
      hinted(build_field(states, output, options, progress_bar("build", "rays", OnSignal::stop))));
  note_budget(output, options.memory, report.memory);
  if (report.tiles == 0)
    note(fmt::format("{}: nothing is left to build", output));
  else if (report.resumed > 0)
    note(fmt::format("{}: resumed after {} tiles", output, report.resumed));
  const bool part = shard.count > 1 || shard.first_level || !shard.coarser.empty();
  note(part ? fmt::format("{}: complete; `slf merge` joins it with the other parts", output)
            : fmt::format("{}: complete; draw it with: slf render {} -o view.png", output, output));
  return {};
}

}  // namespace

void add_build(CLI::App& app, Run& run) {
  const auto [command, a] = add_command(
      app, run, "build", "Build a field from a volume, a mesh or pictures; resumes if interrupted",
      run_build);
  a->source.add_input_to(*command, "INPUT");
  add_file(*command, "-o,--output", a->output, "The field to write", kFieldFile)->required();
  command->add_flag("-f,--force", a->force, "Replace the output, once the new field is complete");
  a->source.add_states_to(*command);
  a->source.add_to(*command,
                   [](const recipe::Option& option) { return option.use != recipe::Use::truth; });
  command->get_option("--each-label")->excludes("--states");
  a->shard.add_to(*command);
  BuildOptions& options = a->source.field;
  add_budget(*command, options.memory);
  add_threads(*command, options.threads);
  add_number(*command, "--commit-every", options.commit_seconds,
             "Seconds between commits; killing the build loses at most this much work",
             kNotNegative);
  command->footer(R"(
Examples:
  slf build head.nii.gz -o head.slf --transfer ct-bone --finest-level 1
  slf build skull.glb -o skull.slf --light-rig rim
  slf build pictures:photos -o vase.slf --color-type u8
--help-all has all options; an input before --help leaves out those of other kinds of sources.
`slf --help` lists the exit codes.)");
}

}  // namespace slf::cli

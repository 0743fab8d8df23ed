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
  bool force = false, dry_run = false, json = false;
};

/// --dry-run: prints what the build would take.
Result<void> print_forecast(const BuildArguments& a, std::span<const FieldState> states,
                            const BuildOptions& options) {
  const auto forecast = SLF_TRY(
      hinted(forecast_build(states, options, progress_bar("forecast", "tiles", OnSignal::end))));
  if (a.json)
    print_json(forecast);
  else
    print(
        "would trace {} rays in about {}, and write {}, give or take {};\n"
        "{} of {} tiles were made to estimate it\n",
        human_count(forecast.rays), human_time(forecast.seconds), human_bytes(forecast.file_bytes),
        human_bytes(forecast.file_error_bytes), forecast.sampled, forecast.tiles);
  return {};
}

Result<void> run_build(const BuildArguments& arguments) {
  SourceArguments source = arguments.source;
  bound_freed_memory(source.field.memory);
  const auto shard = SLF_TRY(arguments.shard.options());
  if (arguments.output.empty() && !arguments.dry_run)
    return fail(ErrorCode::usage, "--output is required, or --dry-run");
  const std::string output = name_of_part(arguments.output, shard);
  source.check = [&](std::vector<std::string> inputs) {
    inputs.insert(inputs.end(), {arguments.source.input, arguments.source.states_file});
    return arguments.dry_run ? Result<void>() : check_output(output, inputs);
  };
  SLF_TRY(source.check({}));
  SLF_TRY(source.finish(source.field.threads, OnSignal::stop));
  source.raycast.lighting.linear = source.field.half;
  const auto made = SLF_TRY(hinted(make_scenes(source)));
  const auto states = field_states(made);
  auto options = SLF_TRY(hinted(field_options(source, states)));
  options.shard = shard;
  if (arguments.dry_run) return print_forecast(arguments, states, options);
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
  add_file(*command, "-o,--output", a->output, "The field to write", kFieldFile);
  command->add_flag("-f,--force", a->force, "Replace the output, once the new field is complete");
  command->add_flag("--dry-run", a->dry_run,
                    "Build nothing: estimate rays, time and size from a sample of the tiles");
  add_json<BuildForecast>(*command, a->json, "JSON on stdout, of --dry-run");
  command->get_option("--json")->needs("--dry-run");
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

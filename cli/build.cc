#include "slf/build.h"

#include "base/file.h"
#include "base/try.h"
#include "cli/command.h"

namespace slf::cli {
namespace {

struct BuildArguments {
  SourceArguments source;
  ShardArguments shard;
  std::string states, output;
  bool each_label = false;
  bool force = false;
  BuildOptions build;
  double radius = 0;
  std::vector<double> center;  // empty: the scene's bounds
};

Result<void> run_build(const BuildArguments& arguments) {
  BuildOptions options = arguments.build;
  bound_freed_memory(options.memory);
  const auto shard = SLF_TRY(arguments.shard.options());
  options.shard = shard;
  const std::string output = name_of_part(arguments.output, shard);
  SourceArguments source = arguments.source;
  source.finish(options.threads, OnSignal::stop);
  source.check = [&](const std::vector<std::string>& inputs) {
    return check_output(output, inputs);
  };
  source.raycast.lighting.linear = options.half;
  if (!arguments.center.empty() && arguments.radius != 0)
    source.pictures.sphere = Sphere{to_vector(arguments.center), arguments.radius};
  SLF_TRY(check_output(output, {&arguments.states, 1}));
  std::vector<NamedScene> made;
  if (arguments.each_label) {
    made = SLF_TRY(hinted(make_label_scenes(source)));
  } else if (arguments.states.empty()) {
    auto scene = SLF_TRY(hinted(make_scene(source)));
    made.push_back({"", std::move(scene)});
  } else {
    made = SLF_TRY(make_states(arguments.states, source));
  }
  const auto states = field_states(made);
  Sphere& sphere = options.shape.sphere;
  sphere = bounds_of(states);
  if (!arguments.center.empty()) sphere.center = to_vector(arguments.center);
  if (arguments.radius != 0) sphere.radius = arguments.radius;
  options.replace = arguments.force;
  const auto report = SLF_TRY(
      hinted(build_field(states, output, options, progress_bar("build", "rays", OnSignal::stop))));
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
  auto* command = app.add_subcommand(
      "build", "Build a field from a volume, a mesh or pictures; resumes if interrupted");
  auto a = std::make_shared<BuildArguments>();
  a->source.add_volume_to(*command, "INPUT");
  a->source.add_light_to(*command);
  a->source.add_pictures_to(*command);
  add_file(*command, "-o,--output", a->output, "The field to write", kFieldFile)->required();
  command->add_flag("-f,--force", a->force, "Replace the output, once the new field is complete");
  add_file(*command, "--states", a->states,
           "Build several states of the object into one field: a JSON file of their names\n"
           "and options, as {\"states\": [{\"name\": \"bone\", \"transfer\": \"ct-bone\"},\n"
           "{\"name\": \"skin\", \"transfer\": \"ct-skin\"}]}");
  command
      ->add_flag("--each-label", a->each_label,
                 "Build a state of each structure of a label volume, to be drawn together, or\n"
                 "some of them: labels of one name in --label-table are one structure. Light is\n"
                 "that of all: what is hidden keeps its shadows")
      ->excludes("--states");
  auto& shape = a->build.shape;
  const CLI::Option* extra = nullptr;
  {
    const OptionGroup group(*command, "Field");
    command->add_option("--entry", shape.entry_side,
                        "Entry lattice at level 0: cells along an octsphere's edge");
    command->add_option("--exit", shape.exit_side, "Exit lattice at level 0");
    command->add_option("--levels", shape.levels,
                        "Subdivisions: tiles at levels 0 to this; each\n"
                        "doubles both lattices");
    extra = command->add_option(
        "--entry-extra-levels", shape.entry_extra_levels,
        "How many levels further than the exit side the entry side is split into tiles");
    command
        ->add_option("--codec", a->build.codec,
                     "predictive:QUALITY, predictive:lossless, jpeg:QUALITY[:444],\n"
                     "zstd[:LEVEL] or raw")
        ->type_name(kCodec);
    add_no_depth(*command, a->build.depth, "Colours alone, without depths; not with predictive");
    choose(command->add_option("--color-type", a->build.half,
                               "u8, or half: HDR colour, which JPEG cannot store"),
           Choices<bool>{{"u8", false}, {"half", true}})
        ->default_str("u8");
    add_vector(*command, "--center", a->center,
               "Centre of the sphere in world coordinates;\n"
               "default: around what is visible");
    add_number(*command, "--radius", a->radius,
               "Radius of the sphere in world units; default: around\n"
               "what is visible",
               kLength);
  }
  // The option's name up to version 0.1. excludes() would leave its trace in --help: "Excludes:",
  // followed by the name of a hidden option, which is empty.
  auto* former = command->add_option("--entry-depth", shape.entry_extra_levels)->group("");
  a->shard.add_to(*command);
  add_bytes(*command, "--memory", a->build.memory, "Budget for tiles and records under way");
  add_threads(*command, a->build.threads);
  add_number(*command, "--commit-every", a->build.commit_seconds,
             "Seconds between commits; killing the build loses at most this much work",
             kNotNegative);
  command->callback([a, extra, former, &run] {
    if (extra->count() > 0 && former->count() > 0)
      throw CLI::ExcludesError("--entry-depth", extra->get_name());
    run = [a] { return run_build(*a); };
  });
}

}  // namespace slf::cli

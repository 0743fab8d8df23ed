#include "slf/repack.h"

#include <algorithm>
#include <map>

#include "base/try.h"
#include "cli/command.h"
#include "slf/remote.h"
#include "slf/verify.h"

namespace slf::cli {
namespace {

struct RepackArguments {
  std::vector<std::string> inputs;
  std::string output;
  std::vector<std::string> states;  // to keep; empty: all
  bool merge = false, split = false;
  Subfields subfields;
  RepackOptions repack;
  bool force = false, dry_run = false, no_light = false, no_reveal = false, json = false;
};

/// A file of --split-states.
struct SplitState {
  std::string state{}, output{};
  RepackReport report{};

  void describe(auto& member) const {
    member("state", state, "its name");
    member("output", output, "the file that was written");
    report.describe(member);
  }
};
/// --dry-run: prints the estimated size of the output.
Result<void> estimate(const RepackArguments& a, const Field& field, const RepackOptions& options) {
  const auto estimate =
      SLF_TRY(estimate_repack(field, options, progress_bar("estimate", "tiles", OnSignal::end)));
  if (a.json)
    print_json(estimate);
  else
    print("would write {}, give or take {} (now {}); {} of {} tiles encoded to estimate it\n",
          human_bytes(estimate.file_bytes), human_bytes(estimate.file_error_bytes),
          human_bytes(estimate.input_bytes), estimate.sampled, estimate.tiles);
  return {};
}

/// --split-states: a field for each state.
Result<void> split(const RepackArguments& a, std::span<const StateSource> states,
                   const RepackOptions& options) {
  if (a.output.find("{state}") == std::string::npos)
    return misuse(a.output, "--split-states needs {state} in the output's name");
  std::map<std::string, std::string> files;  // and the names of their states
  for (const StateSource& state : states)
    if (const auto [file, is_new] = files.emplace(name_of_state(a.output, state.name), state.name);
        !is_new)
      return misuse(file->first, "is the file of the state '", file->second, "', and of '",
                    state.name, "', too; choose one with --states");
  std::vector<SplitState> all;
  for (const StateSource& state : states) {
    const std::string path = name_of_state(a.output, state.name);
    const auto report = SLF_TRY(
        repack_field(state.field, path, options, progress_bar("repack", "tiles", OnSignal::stop)));
    if (!a.json) print("{}: {}\n", path, human_bytes(report.file_bytes));
    all.push_back({state.name, path, report});
  }
  if (a.json) print_json(all);
  return {};
}

/// Says that the light which a field keeps, that of its first state, is not that of a copy.
/// `first`: the first state of that copy, or of one of several.
void say_left_out_light(const RepackArguments& a, const Field& field, const Field& first) {
  const bool kept = first.path() == field.path() && first.state() == 0;
  if (kept || a.no_light || a.dry_run) return;
  if (const auto light = field.light(); light && !light->empty())
    note(field.path() +
         ": the light that it keeps is left out: it is not that of the copy's first "
         "state");
}

Result<void> run_repack(const RepackArguments& a) {
  bound_freed_memory(a.repack.memory);
  RepackOptions options = a.repack;
  options.light = !a.no_light;
  options.reveal = !a.no_reveal;
  options.subfields = a.subfields.numbers;
  options.replace = a.force;
  std::vector<StateSource> states;
  for (const std::string& input : a.inputs) {
    const auto field = SLF_TRY(open_field(input));
    const auto chosen = SLF_TRY(hinted(state_sources(field, join_names(field, a.states))));
    states.insert(states.end(), chosen.begin(), chosen.end());
    say_left_out_light(a, field, states.front().field);
  }
  if (a.inputs.size() > 1 && !a.merge)
    return fail(ErrorCode::usage, "several fields: --merge-states makes states of them");
  if (a.dry_run && states.size() > 1)
    return fail(ErrorCode::unsupported, "--dry-run: choose one state with --states");
  const Field& field = states.front().field;
  if (a.dry_run) return estimate(a, field, options);
  if (a.output.empty()) return fail(ErrorCode::usage, "--output is required, or --dry-run");
  if (a.split) return split(a, states, options);
  const auto bar = progress_bar("repack", "tiles", OnSignal::stop);
  const auto report = SLF_TRY(hinted(join_states(states, a.output, options, bar)));
  note_budget(a.output, a.repack.memory, report.memory);
  if (a.json)
    print_json(report);
  else
    print("{}: {} (was {}), {} tiles copied, {} recoded{}\n", a.output,
          human_bytes(report.file_bytes), human_bytes(report.input_bytes), report.copied,
          report.recoded,
          report.missing ? fmt::format(", {} missing as in the input", report.missing) : "");
  return {};
}

struct VerifyArguments {
  std::string field;
  VerifyOptions verify;
  bool json = false;
};

void print_report(const std::string& path, const VerifyReport& report) {
  for (const Finding& finding : report.findings)
    print("{} {}\n", id(finding.kind), finding.message);
  if (report.found > report.findings.size())
    print("... and {} more\n", report.found - report.findings.size());
  print("{}: {} tiles, {}: {}\n", path, report.tiles, human_bytes(report.payload_bytes),
        report.found == 0     ? "all good"
        : report.damaged == 0 ? "no damage, but incomplete"
                              : fmt::format("{} damaged", report.damaged));
}

Result<void> run_verify(const VerifyArguments& a) {
  bound_freed_memory(a.verify.memory);
  const auto bar = progress_bar("verify", "tiles", OnSignal::end);
  const auto report = SLF_TRY([&]() -> Result<VerifyReport> {
    if (!is_address(a.field)) return verify_field(a.field, a.verify, bar);
    const auto field = SLF_TRY(open_field(a.field));
    return verify_field(field, a.verify, bar);
  }());
  if (a.json)
    print_json(report);
  else
    print_report(a.field, report);
  if (report.dropped > 0)
    note(fmt::format("{}: dropped {} damaged; the build command that made the field refills them",
                     a.field, report.dropped));
  if (report.unfixed == 0) return {};
  if (a.verify.fix)
    return bad_file(a.field, report.unfixed,
                    " findings cannot be fixed in place; build it anew, or restore a copy");
  const bool droppable = std::ranges::none_of(report.findings, [](const Finding& finding) {
    return finding.kind == FindingKind::structure || finding.kind == FindingKind::manifest;
  });
  return bad_file(a.field, "damaged; ",
                  droppable ? "slf verify --fix drops damaged tiles"
                            : "it cannot be fixed in place: build it anew, or restore a copy");
}

}  // namespace

void add_repack(CLI::App& app, Run& run) {
  const auto [command, a] =
      add_command(app, run, "repack",
                  "Rewrite a field: another codec, quality, other levels; compact", run_repack);
  add_file(*command, "FIELD", a->inputs, "Field to read; not touched", kFieldFile)->required();
  auto* merge =
      command->add_flag("--merge-states", a->merge,
                        "Make a field whose states are several fields, named after their\n"
                        "files, and the states in them");
  command
      ->add_flag("--split-states", a->split,
                 "Write a field for each state; the output's name has {state} for its name")
      ->excludes(merge);
  command
      ->add_option("--states", a->states, "The states to keep, by names or numbers; default: all")
      ->delimiter(',')
      ->type_name("STATE,...");
  add_file(*command, "-o,--output", a->output, "The field to write", kFieldFile);
  command->add_flag("--dry-run", a->dry_run,
                    "Write nothing: estimate the output's size from a sample of the tiles");
  command->add_flag("-f,--force", a->force, "Replace the output, once the new field is complete");
  command
      ->add_option("--codec", a->repack.codec,
                   "predictive:QUALITY, predictive:lossless, jpeg:QUALITY[:444],\n"
                   "zstd[:LEVEL] or raw; default: as it is")
      ->type_name(kCodec);
  add_no_depth(*command, a->repack.depth, "Leave out depths; not with predictive");
  add_number(*command, "--finest-level,--levels", a->repack.finest_level,
             "The finest level to keep", kNotNegative);
  add_subfields(*command, a->subfields, "Level-0 subfields to keep");
  choose(command->add_option("--color-type", a->repack.half, "u8 or half"),
         Choices<bool>{{"u8", false}, {"half", true}});
  command->add_flag("--no-light", a->no_light,
                    "Leave out the light volume, which views do not need; evaluate then computes\n"
                    "it again");
  command->add_flag("--no-reveal", a->no_reveal,
                    "Leave out the copy of the volume that cuts show the inside of");
  add_budget(*command, a->repack.memory);
  add_threads(*command, a->repack.threads);
  add_json<RepackReport, RepackEstimate, std::vector<SplitState>>(*command, a->json);
}

void add_verify(CLI::App& app, Run& run) {
  const auto [command, a] = add_command(
      app, run, "verify", "Check structure, counts, every checksum, and that every tile decodes",
      run_verify);
  command->footer(R"(
Findings: S1 a page is damaged, M1 manifest or tables, L1 the light volume, V1 the reveal, R1 a
record, K1 a tile that should not be, T1 a checksum, T2 a tile does not decode, T3 a tile that it is
predicted from is lost, C1 tiles are missing.
Exit code 0 when all is good or only tiles are missing, 3 when something is damaged and, with
--fix, could not be dropped (S1, M1).)");
  add_file(*command, "FIELD", a->field, "Field to check", kFieldFile)->required();
  command->add_flag("--quick", a->verify.quick, "Structure and counts only");
  command->add_flag("--fix", a->verify.fix, "Drop damaged tiles, so that build can refill them");
  add_budget(*command, a->verify.memory);
  add_threads(*command, a->verify.threads);
  add_json<VerifyReport>(*command, a->json);
}

}  // namespace slf::cli

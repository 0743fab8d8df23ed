// slf diff: compares two fields, and prints where they differ.
#include "base/try.h"
#include "cli/command.h"
#include "slf/inspect.h"

namespace slf::cli {
namespace {

struct DiffArguments {
  FieldArguments a, b;
  std::optional<double> min_psnr;
  DiffOptions diff;
  bool json = false;
};

void print_difference(const FieldDifference& difference) {
  for (const std::string& place : difference.manifest) print("manifest: {} differs\n", place);
  if (!difference.comparable) print("tiles: not compared, because they sample other rays\n");
  for (const ChannelDifference& c : difference.channels) {
    print("{}: {} tiles compared, {} differ, {} have other bytes and the same samples\n", c.channel,
          c.compared, c.differing, c.recoded);
    if (c.only_in_a + c.only_in_b > 0)
      print("{}: {} tiles only in the first, {} only in the second\n", c.channel, c.only_in_a,
            c.only_in_b);
    if (c.differing > 0)
      print("{}: PSNR {:.2f} dB, {:.2f} dB in the worst tile, {}\n", c.channel, c.psnr,
            c.worst_psnr, *c.worst_name);
  }
}

Result<void> run_diff(const DiffArguments& arguments) {
  const auto a = SLF_TRY(arguments.a.open());
  const auto b = SLF_TRY(arguments.b.open());
  DiffOptions options = arguments.diff;
  options.all_states = arguments.a.state.empty() && arguments.b.state.empty();
  const auto difference =
      SLF_TRY(diff_fields(a, b, options, progress_bar("diff", "tiles", OnSignal::end)));
  if (arguments.json)
    print_json(difference);
  else
    print_difference(difference);
  const bool passed =
      arguments.min_psnr ? difference.alike(*arguments.min_psnr) : difference.equal();
  if (passed) return {};
  const std::string limit =
      arguments.min_psnr ? fmt::format("; --min-psnr {:g} is not met", *arguments.min_psnr) : "";
  return fail(ErrorCode::differs, arguments.a.path, " and ", arguments.b.path, ": differ", limit);
}

}  // namespace

void add_diff(CLI::App& app, Run& run) {
  const auto [command, a] =
      add_command(app, run, "diff", "Compare two fields: manifest, tiles, samples", run_diff);
  add_file(*command, "A", a->a.path, "Field", kFieldFile)->required();
  add_file(*command, "B", a->b.path, "Field", kFieldFile)->required();
  add_number(*command, "--min-psnr", a->min_psnr,
             "Exit with 0 if both have the same tiles, none below this PSNR, whatever\n"
             "their bytes and manifests; without it any difference ends with 7",
             kNotNegative);
  add_state(*command, "--state-a", a->a.state,
            "The state of A: its name or number, from 0; default:\nall, and all of B");
  add_state(*command, "--state-b", a->b.state, "The state of B");
  add_threads(*command, a->diff.threads);
  add_json<FieldDifference>(*command, a->json);
}

}  // namespace slf::cli

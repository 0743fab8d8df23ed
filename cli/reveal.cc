// slf reveal: adds to a finished field the small copy of its volume that cuts show the inside of.
#include "base/try.h"
#include "cli/command.h"
#include "field/field_file.h"
#include "slf/remote.h"

namespace slf::cli {
namespace {

struct RevealArguments {
  std::string field;
  SourceArguments source;
  unsigned threads = 0;
};

Result<void> run_reveal(const RevealArguments& a) {
  if (is_address(a.field)) return misuse(a.field, "is on a server, where nothing can be added");
  SourceArguments source = a.source;
  SLF_TRY(source.finish(a.threads, OnSignal::end));
  SLF_TRY(hinted(add_reveal(a.field, source)));
  const auto field = SLF_TRY(open_field(a.field));
  const auto code = SLF_TRY(field.file().reveal());
  const auto reveal = SLF_TRY(decode_reveal(code, RevealPart::head));
  print("{}: {}x{}x{} {}, {}\n", a.field, reveal.dims[0], reveal.dims[1], reveal.dims[2],
        reveal.ids.empty() ? "bytes" : "labels", human_bytes(code.size()));
  return {};
}

}  // namespace

void add_reveal(CLI::App& app, Run& run) {
  const auto [command, a] = add_command(
      app, run, "reveal",
      "Add to a field the small copy of its volume that cuts show the inside of", run_reveal);
  add_file(*command, "FIELD", a->field, "Field to add it to", kFieldFile)->required();
  a->source.add_input_to(*command, "--volume");
  a->source.add_to(*command, [](const recipe::Option& option) {
    const std::string_view name = option.name;
    return option.use == recipe::Use::reading || name == "labels_volume" || name == "mask" ||
           name == "environment" || name.starts_with("reveal");
  });
  add_threads(*command, a->threads);
  command->footer(
      "It publishes the scan, in 8 bits: by default, only voxels that touch visible ones\n"
      "(doc/cut.md). `slf repack --no-reveal` leaves it out.");
}

}  // namespace slf::cli

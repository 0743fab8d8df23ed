// --clip and --cap: planes through a field, and what they lay open.
#include "base/try.h"
#include "cli/command.h"

namespace slf::cli {

void DrawArguments::add_cut_to(CLI::App& command) {
  cut.add_to(command,
             [](const recipe::Option& option) { return option.name == std::string_view("clip"); });
  const OptionGroup group(command, "Volume");
  command
      .add_option(
          "--cap", cap,
          "What --clip lays open: shaded, under its own light; coarse, the same by a tenth\n"
          "of the work; slice, the scan's values in grey, from LO to HI; or hollow.\n"
          "All but hollow need a reveal (`slf reveal`); default: shaded, or else hollow")
      ->type_name("CAP[:LO,HI]");
}

Result<std::shared_ptr<const Scene>> DrawArguments::cap_of(const Field& field,
                                                           std::span<const ClipPlane> clip) const {
  CapOptions options;
  options.memory = memory_of_cap();
  options.threads = threads;
  options.progress = light_progress(OnSignal::end);
  const auto made = SLF_TRY(hinted(named_cap(field, clip, cap, options)));
  if (!made && cap.empty())
    note(field.path() + ": has no reveal, which `slf reveal` adds: the cut is hollow");
  return made;
}

}  // namespace slf::cli

// What the options of a scene need beside their values: hints, progress, and a field to compare
// with.
#include "cli/command.h"

namespace slf::cli {

SourceArguments::SourceArguments() {
  on_note = [](const std::string& text, const char* choice) {
    note(choice ? text + "; " + hint_of(choice) : text);
  };
}

void SourceArguments::finish(unsigned threads, OnSignal on_signal) {
  if (raw.dims[0] > 0) reading.raw = raw;
  if (depth_cache == "none") depth_cache.reset();
  light_volume.threads = threads;
  light_volume.progress = light_progress(on_signal);
  pictures.progress = late_progress_bar("pictures", "pictures", OnSignal::end);
}

std::string hint_of(std::string_view choice) {
  static const std::map<std::string_view, const char*> others{
      {"raw", "for example `--dims 128x128x84 --type u8 --spacing 1x1x1.5 --offset 62`"},
      {"layout", "see --dims, --type, --spacing and --offset"},
      {"transfer", "see --transfer and --range"},
      {"sphere", "see --center and --radius"},
      {"center", "see --center and --radius"},
      {"depth", "see --depth-kind and --depth-scale"},
      {"tone", "see --color-type and --lighting of `slf build`"}};
  if (const auto found = others.find(choice); found != others.end()) return found->second;
  std::string option(choice);
  std::ranges::replace(option, '_', '-');
  return "see --" + option;
}

}  // namespace slf::cli

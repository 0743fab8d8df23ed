#include "cli/command.h"

namespace slf::cli {
namespace {

constexpr const char* kFooter = R"(
A first field:
  slf build brain.nii.gz -o brain.slf --transfer brain.json
  slf render brain.slf -o brain.png --orbit 30,20,3

Exit codes: 0 done, 1 wrong arguments, 2 input or output failed (missing, permission, disk full),
3 a file is damaged or not what it claims, 4 failed at run time, 5 not supported, 7 differs.)";

}  // namespace

std::unique_ptr<CLI::App> make_app(Run& run) {
  auto app = std::make_unique<CLI::App>(
      "Builds, stores and renders sphere light fields: the colour of every ray through a sphere\n"
      "around a volume, so that any view is a look-up.",
      "slf");
  app->footer(kFooter);
  app->set_version_flag("--version", std::string("slf ") + SLF_VERSION);
  app->add_flag("-q,--quiet", quiet, "No progress and no notes");
  app->require_subcommand(1);
  app->fallthrough();

  add_build(*app, run);
  add_info(*app, run);
  add_render(*app, run);
  add_play(*app, run);
  add_raycast(*app, run);
  add_measure(*app, run);
  add_evaluate(*app, run);
  add_compare(*app, run);
  add_repack(*app, run);
  add_verify(*app, run);
  return app;
}

}  // namespace slf::cli

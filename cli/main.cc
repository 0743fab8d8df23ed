// slf: sphere light fields on the command line.

#include <fmt/format.h>

#include <exception>
#include <new>

#include "cli/command.h"

namespace {

constexpr const char* kFooter = R"(
A first field:
  slf build brain.nii.gz -o brain.slf --transfer brain.json
  slf render brain.slf -o brain.png --orbit 30,20,3

Exit codes: 0 done, 1 wrong arguments, 2 input or output failed (missing, permission, disk full),
3 a file is damaged or not what it claims, 4 failed at run time, 5 not supported, 7 differs.)";

int fail(const slf::Error& error) {
  fmt::print(stderr, "slf: {}\n", error.message);
  return static_cast<int>(error.code);
}

int run_command(int argc, char** argv) {
  CLI::App app(
      "Builds, stores and renders sphere light fields: the colour of every ray through a sphere\n"
      "around a volume, so that any view is a look-up.",
      "slf");
  app.footer(kFooter);
  app.set_version_flag("--version", std::string("slf ") + SLF_VERSION);
  app.add_flag("-q,--quiet", slf::cli::quiet, "No progress and no notes");
  app.require_subcommand(1);
  app.fallthrough();

  slf::cli::Run run;
  slf::cli::add_build(app, run);
  slf::cli::add_info(app, run);
  slf::cli::add_render(app, run);
  slf::cli::add_play(app, run);
  slf::cli::add_raycast(app, run);
  slf::cli::add_measure(app, run);
  slf::cli::add_evaluate(app, run);
  slf::cli::add_compare(app, run);
  slf::cli::add_repack(app, run);
  slf::cli::add_verify(app, run);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : static_cast<int>(slf::ErrorCode::usage);
  }
  slf::cli::watch_signals();
  const auto done = run();
  if (!done) return fail(done.error());
  if (std::fflush(stdout) != 0 || std::ferror(stdout))
    return fail({slf::ErrorCode::io, "stdout: cannot write"});
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return run_command(argc, argv);
  } catch (const std::bad_alloc&) {
    return fail(
        {slf::ErrorCode::failed, "out of memory; a smaller --memory, --size or volume may do"});
  } catch (const std::exception& error) {
    return fail({slf::ErrorCode::failed, std::string("unexpected: ") + error.what()});
  }
}

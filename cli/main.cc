// slf: sphere light fields on the command line.

#include <fmt/format.h>

#include <exception>
#include <new>

#include "cli/command.h"

namespace {

int fail(const slf::Error& error) {
  fmt::print(stderr, "slf: {}\n", error.message);
  return static_cast<int>(error.code);
}

int run_command(int argc, char** argv) {
  slf::cli::Run run;
  const auto app = slf::cli::make_app(run);
  try {
    app->parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app->exit(error) == 0 ? 0 : static_cast<int>(slf::ErrorCode::usage);
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

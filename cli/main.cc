// slf: sphere light fields on the command line.

#include <cxxabi.h>
#include <execinfo.h>
#include <unistd.h>

#include <csignal>
#include <cstdio>
#include <exception>
#include <iostream>
#include <new>
#include <typeinfo>

#include "base/try.h"
#include "cli/command.h"

namespace {

using slf::Error;
using slf::ErrorCode;
using slf::Result;

/// The last resort: memory ends in a function of a library that must not throw, before main(), or
/// while an error is reported.
[[noreturn]] void end_without_memory() {
  const std::type_info* const thrown = abi::__cxa_current_exception_type();
  if (thrown && *thrown != typeid(std::bad_alloc)) __gnu_cxx::__verbose_terminate_handler();
  constexpr std::string_view kMessage = "slf: out of memory\n";
  (void)!::write(STDERR_FILENO, kMessage.data(), kMessage.size());
  ::_exit(exit_code(ErrorCode::out_of_memory));
}

/// Runs before the constructors of libraries.
void prepare_for_the_end() { std::set_terminate(end_without_memory); }
[[gnu::section(".preinit_array"), gnu::used]] void (*const first_of_all)() = prepare_for_the_end;

int fail(const Error& error, slf::cli::Lines lines = slf::cli::Lines::indented) {
  slf::cli::message("slf: " + error.message +
                        (error.code == ErrorCode::out_of_memory
                             ? "; try fewer --threads, or a smaller --memory, --size or volume"
                             : ""),
                    lines);
  return exit_code(error.code);
}

/// Flushes stdout. io: output could not be written, so the command has failed.
Result<void> flush_output() {
  std::cout.flush();
  if (std::cout && std::fflush(stdout) == 0 && std::ferror(stdout) == 0) return {};
  return slf::fail(ErrorCode::io, "stdout: cannot write");
}

/// The arguments, in reverse as CLI11 takes them: --reveal may stand without its number.
std::vector<std::string> arguments_of(int argc, char** argv) {
  std::vector<std::string> words;
  for (int k = argc; --k > 0;) {
    const auto is_number = [](std::string_view word) {
      return !word.empty() && word.find_first_not_of("0123456789") == std::string_view::npos;
    };
    if (argv[k] == std::string_view("--reveal") && (words.empty() || !is_number(words.back())))
      words.push_back(std::to_string(slf::RevealOptions().side));
    words.emplace_back(argv[k]);
  }
  return words;
}

int run_command(int argc, char** argv) {
  slf::cli::Run run;
  const auto app = slf::cli::make_app(run);
  Result<void> done;
  if (argc > 1 && std::string_view(argv[1]) == "__complete") {
    slf::cli::complete(*app, {argv + 2, argv + argc});
    return 0;
  }
  try {
    app->parse(arguments_of(argc, argv));
    done = run();
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() != 0)
      return fail({ErrorCode::usage, slf::cli::usage_message(*app, error)}, slf::cli::Lines::any);
    (void)app->exit(error);  // --help, --version
  }
  const auto written = flush_output();
  if (!done) return fail(done.error());
  return written ? 0 : fail(written.error());
}

}  // namespace

int main(int argc, char** argv) {
  slf::cli::reserve_standard_streams();
  // The C library loads its unwinder when it first needs it, and aborts if there is no memory then.
  void* here = nullptr;
  (void)::backtrace(&here, 1);
  int code = 0;
  try {
    code = run_command(argc, argv);
  } catch (...) {
    code = fail(slf::error_of_exception());
  }
  // Die of the signal, so that a shell also ends a loop around the command. No exit code does that.
  if (const int signal = slf::cli::stop_signal(); signal != 0) {
    std::signal(signal, SIG_DFL);
    std::raise(signal);
  }
  return code;
}

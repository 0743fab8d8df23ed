// Writes the manual pages and the completion of `slf` to a folder:
//   slf_reference FOLDER      man/slf.1, man/slf-build.1, ...; completion/slf.bash, .zsh, .fish
#include <cstdio>
#include <filesystem>
#include <fstream>

#include "cli/command.h"
#include "cli/reference/model.h"

namespace {

namespace reference = slf::cli::reference;

void write(const std::filesystem::path& path, const std::string& text) {
  std::ofstream file(path, std::ios::binary);
  file << text;
  file.close();
  if (!file) throw std::runtime_error(path.string() + ": cannot write");
}

void write_all(const std::filesystem::path& folder) {
  slf::cli::Run run;
  const auto program = reference::describe(*slf::cli::make_app(run));
  std::filesystem::remove_all(folder / "man");  // remove the pages of commands that no longer exist
  std::filesystem::create_directories(folder / "man");
  std::filesystem::create_directories(folder / "completion");
  write(folder / "man/slf.1", reference::program_manual(program));
  for (const auto& command : program.commands)
    write(folder / "man" / ("slf-" + command.name + ".1"),
          reference::command_manual(program, command));
  write(folder / "completion/slf.bash", reference::bash_completion(program));
  write(folder / "completion/slf.zsh", reference::zsh_completion(program));
  write(folder / "completion/slf.fish", reference::fish_completion(program));
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fputs("usage: slf_reference FOLDER\n", stderr);
    return 1;
  }
  try {
    write_all(argv[1]);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "slf_reference: %s\n", error.what());
    return 4;
  }
  return 0;
}

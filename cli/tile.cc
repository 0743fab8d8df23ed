// slf tile: writes one tile, as a picture or as its samples.
#include <unistd.h>

#include "base/file.h"
#include "base/try.h"
#include "cli/command.h"
#include "slf/inspect.h"

namespace slf::cli {
namespace {

constexpr const char* kStdout = "-";

struct TileArguments {
  FieldArguments field;
  std::string tile, output, format;
  std::string channel = "color";
  bool force = false;
};

/// Parses "LEVEL/ENTRY/EXIT", or "LEVEL/INDEX", the form in which messages name tiles.
Result<TileKey> parse_tile(const Field& field, const std::string& text) {
  std::istringstream in(text);
  TileAddress address;
  char slash = 0, second = 0;
  // Only digits and slashes, because operator>> accepts a sign before unsigned numbers.
  if (text.find_first_not_of("0123456789/") == std::string::npos && in >> address.level >> slash &&
      slash == '/' && in >> address.entry) {
    if (in.peek() == std::istream::traits_type::eof())
      return find_tile(field, address.level, address.entry);
    if (in >> second >> address.exit && second == '/' && in.peek() == EOF)
      return find_tile(field, address);
  }
  return fail(ErrorCode::usage, "TILE '", text,
              "': expected LEVEL/ENTRY/EXIT as `slf ls` prints it, or LEVEL/INDEX as messages do");
}

Result<std::vector<std::byte>> encode(const Field& field, TileKey key, const TileArguments& a) {
  const TileReader tiles(field);
  const std::string format = !a.format.empty()            ? a.format
                             : a.output == kStdout        ? "raw"
                             : a.output.ends_with(".raw") ? "raw"
                                                          : "";
  if (format == "raw") {
    const auto set = SLF_TRY(read_tile(tiles, key, a.channel));
    note(fmt::format("{}: {} pictures of {} samples, {}{}", a.tile, set.entries.size(),
                     (set.side + 1) * (set.side + 2) / 2,
                     set.numbers == 1 ? "depth8"
                     : set.half       ? "rgba16f"
                                      : "rgba8",
                     set.empty ? "; empty: nothing is visible" : ""));
    return std::vector(set.samples.begin(), set.samples.end());
  }
  const auto picture = SLF_TRY(tile_picture(tiles, key, a.channel));
  ImageFileOptions options;
  options.transparent = true;
  return encode_image(format.empty() ? a.output : a.output + "." + format, picture, options);
}

Result<void> run_tile(const TileArguments& a) {
  const bool to_stdout = a.output == kStdout;
  if (to_stdout && isatty(STDOUT_FILENO) != 0)
    return fail(ErrorCode::usage, "-o -: is a terminal; redirect stdout to a file or a program");
  if (!to_stdout) SLF_TRY(refuse_overwrite(a.output, a.force, {a.field.path}));
  const auto field = SLF_TRY(a.field.open());
  const auto key = SLF_TRY(parse_tile(field, a.tile));
  const auto bytes = SLF_TRY(encode(field, key, a));
  if (!to_stdout) return write_file(a.output, bytes);
  std::fwrite(bytes.data(), 1, bytes.size(), stdout);  // main() checks stdout at the end
  return {};
}

}  // namespace

void add_tile(CLI::App& app, Run& run) {
  const auto [command, a] =
      add_command(app, run, "tile", "Write one tile, as a picture or as its samples", run_tile);
  command->footer(R"(
The picture shows the exit triangle of each entry vertex where that vertex lies among the others of
its section. .raw has the samples as FORMAT.md orders them: picture by picture, little-endian.)");
  a->field.add_to(*command, "Field to read");
  command->add_option("TILE", a->tile, "LEVEL/ENTRY/EXIT as `slf ls` prints it, or LEVEL/INDEX")
      ->type_name("TILE")
      ->required();
  command->add_option("--channel", a->channel, "color, or depth as gray")
      ->check(CLI::IsMember({"color", "depth"}));
  add_file(*command, "-o,--output", a->output,
           "File to write: .png, .exr or .raw; -: stdout, as --format says")
      ->required();
  command->add_option("--format", a->format, "Default: the ending of the output; raw on stdout")
      ->check(CLI::IsMember({"png", "exr", "raw"}));
  command->add_flag("-f,--force", a->force, "Overwrite the output");
}

}  // namespace slf::cli

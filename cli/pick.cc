// slf pick: the points of the surface that a picture shows.
#include <array>
#include <sstream>

#include "base/file.h"
#include "base/try.h"
#include "cli/command.h"
#include "slf/render.h"

namespace slf::cli {
namespace {

constexpr std::uint64_t kMaxPixelsFile = 64 << 20;

struct Arguments {
  FieldArguments field;
  std::string file;
  std::vector<std::array<double, 2>> pixels;
  CameraArguments camera;
  DrawArguments draw;
  bool json = false;
};

/// What a picture shows at a pixel.
struct Picked {
  std::array<double, 2> pixel{};
  std::optional<PickedPoint> found{};
  std::string unit{};

  void describe(auto& member) const {
    const auto of_point = [&](auto part) {
      return found ? std::optional((*found).*part) : std::nullopt;
    };
    member("pixel", pixel, "place in the picture, in pixels from its upper left corner");
    member("point", of_point(&PickedPoint::point),
           "what the picture shows there, in world units; null: it is less than half opaque");
    member("depth", of_point(&PickedPoint::depth),
           "distance of the point from the eye, in world units", R"("minimum": 0)");
    member("uncertainty", of_point(&PickedPoint::uncertainty),
           "standard deviation of the depth, in world units", R"("minimum": 0)");
    member("unit", unit.empty() ? nullptr : &unit,
           "of world coordinates, as mm; only if the file of the volume states it");
  }
};

/// Reads a file with one X,Y a line. bad_file: a line is something else.
Result<std::vector<std::array<double, 2>>> read_pixels(const std::string& path) {
  const auto bytes = SLF_TRY(read_file(path, kMaxPixelsFile));
  std::istringstream lines(std::string(chars_of(bytes)));
  std::vector<std::array<double, 2>> pixels;
  std::size_t number = 0;
  for (std::string line; std::getline(lines, line);) {
    ++number;
    if (line.ends_with('\r')) line.pop_back();
    if (line.find_first_not_of(" \t") == std::string::npos) continue;
    std::array<double, 2> pixel{};
    if (!CLI::detail::lexical_conversion<std::array<double, 2>, std::array<double, 2>>(
            CLI::detail::split(line, ','), pixel))
      return bad_file(path, "line ", number, ": '", line, "'; expected X,Y");
    pixels.push_back(pixel);
  }
  return pixels;
}

Result<void> run_pick(const Arguments& a) {
  std::vector<std::array<double, 2>> pixels = a.pixels;
  if (!a.file.empty()) pixels = SLF_TRY(read_pixels(a.file));
  if (pixels.empty()) return fail(ErrorCode::usage, "no pixels: expected X,Y or --pixels");
  const auto field = SLF_TRY(a.draw.open(a.field));
  const auto camera = SLF_TRY(a.camera.camera(field.shape().sphere));
  const auto provenance = nlohmann::json::parse(field.provenance());
  const std::string unit = text_of(provenance, "unit", "");
  const auto view = SLF_TRY(a.draw.view(field));
  Renderer renderer(field, a.draw.renderer(view));
  for (const auto& [x, y] : pixels) {
    const auto found = SLF_TRY(pick(renderer, camera, x, y, view));
    if (a.json)
      print("{}\n", report::json_of(Picked{{x, y}, found, unit}).dump());
    else if (found)
      print("{},{}: {:.6g},{:.6g},{:.6g}  depth {:.6g} ± {:.2g}{}{}\n", x, y, found->point.x,
            found->point.y, found->point.z, found->depth, found->uncertainty,
            unit.empty() ? "" : " ", unit);
    else
      print("{},{}: nothing\n", x, y);
  }
  return {};
}

}  // namespace

void add_pick(CLI::App& app, Run& run) {
  const auto [command, a] =
      add_command(app, run, "pick", "Print the points of the surface that a view shows", run_pick);
  a->field.add_to(*command, "Field to look at");
  auto* pixel = command
                    ->add_option("PIXEL", a->pixels,
                                 "Places in the picture, in pixels from its upper left corner")
                    ->delimiter(',')
                    ->type_name("X,Y");
  add_file(*command, "--pixels", a->file, "A file with one X,Y a line")->excludes(pixel);
  a->camera.add_to(*command);
  a->draw.add_resources_to(*command);
  add_json<Picked>(*command, a->json, "JSON on stdout, one object a line for each pixel");
  output_schemas["pick"].lines = true;
}

}  // namespace slf::cli

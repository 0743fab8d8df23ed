// slf render and slf raycast: draw a view of a field, or the same view of its source.
#include "slf/render.h"

#include <algorithm>
#include <filesystem>
#include <numeric>
#include <set>

#include "base/file.h"
#include "base/join.h"
#include "base/try.h"
#include "cli/command.h"
#include "slf/image.h"
#include "slf/measure.h"
#include "slf/scene.h"

namespace slf::cli {
namespace {

struct PictureOutput {
  std::string output;
  std::vector<double> background{0, 0, 0};
  bool transparent = false;
  bool force = false;

  void add_to(CLI::App& command) {
    add_file(command, "-o,--output", output,
             "Picture to write: .png, .jpg, or .exr (float RGBA, Z)")
        ->required();
    command.add_flag("-f,--force", force, "Overwrite the picture");
    of_numbers(
        command.add_option("--background", background, "Colour from 0 to 1 behind the picture"), 3)
        ->check(from_to(0, 1))
        ->type_name("R,G,B")
        ->default_str("0,0,0");
    command.add_flag("--transparent", transparent, "PNG with alpha instead of a background");
  }
  [[nodiscard]] bool is_exr() const { return output.ends_with(".exr"); }

  /// Checks the options before any work. usage: one is invalid.
  [[nodiscard]] Result<void> check(const std::vector<std::string>& inputs) const {
    if (transparent && (output.ends_with(".jpg") || output.ends_with(".jpeg")))
      return fail(ErrorCode::usage, "--transparent: ", output,
                  ": JPEG cannot hold transparency; use .png or .exr");
    return refuse_overwrite(output, force, inputs);
  }

  [[nodiscard]] Result<void> write(const Image& image) const {
    ImageFileOptions options;
    options.background = glm::vec3(to_vector(background));
    options.transparent = transparent;
    return write_image(output, image, options);
  }
};

struct RenderArguments {
  FieldArguments field;
  PictureOutput picture;
  CameraArguments camera;
  DrawArguments draw;
  SourceArguments shown;  // of which the tone counts
  bool stats = false, json = false;
};

/// The cost of a view.
struct ViewCost {
  std::string mode{};
  ViewStatistics view{};
  Footprint file{};

  void describe(auto& member) const {
    member("mode", mode, "of drawing");
    member("level", view.level_pixels.size() - 1, "finest level drawn");
    member("tiles_touched", view.tiles.size(), "tiles");
    member("tiles_stored", file.stored_tiles, "tiles of them with a payload");
    member("compressed_bytes", file.compressed_bytes,
           "payloads, also of tiles that those are predicted from");
    member("map_pages", file.pages.size(), "4 KiB pages of the file");
    member("decodes", view.decodes, "tiles decoded");
    member("decoded_peak_bytes", view.decoded_peak_bytes, "most decoded samples at a time");
    member("pixels_hit", view.pixels_hit, "pixels whose ray meets the sphere");
    member("pixels_from_coarser_levels", view.fallback_pixels(), "of them");
  }
};

/// As a table, with the traffic of a remote field.
void print_cost(const ViewCost& cost) {
  nlohmann::json json = report::json_of(cost);
  if (const auto sum = traffic()) {
    const nlohmann::json members = report::json_of(*sum);
    for (const auto& [key, value] : members.items()) json["http_" + key] = value;
  }
  std::vector<std::string> rows;
  for (const auto& [key, value] : json.items())
    rows.push_back(key + "\t" + (value.is_string() ? value.get<std::string>() : value.dump()));
  print_table(rows);
}

/// failed: nothing was drawn, because the field has no tiles.
Result<void> check_drawn(const Field& field, const ViewStatistics& statistics) {
  const auto& pixels = statistics.level_pixels;
  if (std::accumulate(pixels.begin(), pixels.end(), 0ull) > 0) return {};
  const auto content = SLF_TRY(field.content());
  for (const LevelContent& level : content.levels)
    if (level.stored + level.empty > 0) return {};
  return fail(
      ErrorCode::failed, field.path(),
      ": has no tiles yet: nothing can be drawn; the build command that made it resumes it");
}

Result<void> run_render(const RenderArguments& a) {
  SLF_TRY(a.picture.check(a.draw.inputs(a.field)));
  const auto field = SLF_TRY(a.draw.open(a.field));
  auto view = SLF_TRY(a.draw.view(field));
  view.with_depth = a.picture.is_exr() && field.has_depth();
  const auto camera = SLF_TRY(a.camera.camera(field.shape().sphere));

  Renderer renderer(field, a.draw.renderer(view));
  ViewStatistics statistics;
  auto image = SLF_TRY(renderer.render(camera, view, &statistics));
  SLF_TRY(check_drawn(field, statistics));
  const auto tone =
      a.shown.stated.empty() ? std::nullopt : std::optional(a.shown.raycast.lighting.tone);
  SLF_TRY(hinted(map_tones(field, tone, /*display=*/!a.picture.is_exr(), image)));
  SLF_TRY(a.picture.write(image));
  if (statistics.fallback_pixels() > 0)
    note(field.shape().subfields.empty()
             ? fmt::format("{}: incomplete at level {}: {} pixels drawn from coarser levels; the "
                           "build command that made it resumes it",
                           a.field.path, statistics.level_pixels.size() - 1,
                           statistics.fallback_pixels())
             : fmt::format("{}: {} pixels need subfields that were left out of this field",
                           a.field.path, statistics.fallback_pixels()));
  if (!a.json && !a.stats) return {};
  const auto file = SLF_TRY(footprint(field, statistics.tiles));
  const ViewCost cost{name(view.mode), statistics, file};
  if (a.json)
    print_json(cost);
  else
    print_cost(cost);
  return {};
}

struct RaycastArguments {
  SourceArguments source;
  PictureOutput picture;
  CameraArguments camera;
  std::string cameras;  // empty: one picture, by `camera`
  std::string state;    // of several, the one to draw
  unsigned threads = 0;
};

struct RaycastScene {
  std::shared_ptr<const Scene> scene;
  Sphere sphere;  // of a field of it, or of all states
};
Result<RaycastScene> scene_of(const RaycastArguments& a, const SourceArguments& source) {
  const auto made = SLF_TRY(hinted(make_scenes(source)));
  const Sphere sphere = sphere_of(source, bounds_of(field_states(made)));
  if (made.size() == 1 && a.state.empty()) return RaycastScene{made.front().scene, sphere};
  auto found = std::ranges::find(made, a.state, &NamedScene::name);
  for (std::size_t k = 0; found == made.end() && k < made.size(); ++k)
    if (std::to_string(k) == a.state) found = made.begin() + static_cast<std::ptrdiff_t>(k);
  if (found == made.end())
    return misuse(a.source.states_file.empty() ? a.source.input : a.source.states_file,
                  a.state.empty() ? "has several states: choose one by --state"
                                  : concat("has no state '", a.state, "'"));
  return RaycastScene{found->scene, sphere};
}

/// Names the pictures of cameras in the folder of their output. bad_file: two have one name, or one
/// leads out of the folder.
Result<void> name_pictures(const RaycastArguments& a, std::vector<Picture>& pictures) {
  namespace fs = std::filesystem;
  std::set<std::string> names;
  for (Picture& picture : pictures) {
    const fs::path name = fs::path(picture.name).relative_path().lexically_normal();
    if (!name.has_filename() || name == "." || *name.begin() == "..")
      return bad_file(a.cameras, picture.name, ": leads out of the folder");
    picture.file = (fs::path(a.picture.output) / name).replace_extension(".exr").string();
    if (!names.insert(picture.file).second)
      return bad_file(a.cameras, picture.name, ": another picture would be ", picture.file,
                      ", too");
  }
  return {};
}

/// Draws the pictures of a file of cameras: .exr, in a folder with its own transforms.json.
Result<void> raycast_cameras(const RaycastArguments& a) {
  auto set = SLF_TRY(read_cameras(a.cameras));
  for (const std::string& remark : set.notes) note(a.cameras + ": " + remark);
  SLF_TRY(name_pictures(a, set.pictures));
  const std::filesystem::path folder = a.picture.output;
  const std::string list = (folder / "transforms.json").string();
  SourceArguments source = a.source;
  SLF_TRY(source.finish(a.threads, OnSignal::end));
  source.check = [&](std::vector<std::string> inputs) -> Result<void> {
    inputs.push_back(a.cameras);
    SLF_TRY(refuse_overwrite(list, a.picture.force, inputs));
    for (const Picture& picture : set.pictures)
      SLF_TRY(refuse_overwrite(picture.file, a.picture.force, inputs));
    return {};
  };
  const auto [scene, sphere] = SLF_TRY(scene_of(a, source));
  const auto progress = progress_bar("raycast", "pictures", OnSignal::end);
  for (std::size_t k = 0; k < set.pictures.size(); ++k) {
    const Picture& picture = set.pictures[k];
    const auto camera = SLF_TRY(camera_of(picture));
    auto image = SLF_TRY(trace_view(*scene, sphere, camera, a.threads));
    std::error_code error;
    std::filesystem::create_directories(std::filesystem::path(picture.file).parent_path(), error);
    SLF_TRY(write_image(picture.file, through_lens(picture, camera, std::move(image))));
    if (progress) progress({k + 1, set.pictures.size(), 0});
  }
  const std::string text = transforms_json(set.pictures, folder.string());
  return write_file(list, bytes_of(text));
}

Result<void> run_raycast(const RaycastArguments& a) {
  if (!a.cameras.empty()) return raycast_cameras(a);
  SourceArguments source = a.source;
  SLF_TRY(source.finish(a.threads, OnSignal::end));
  source.check = [&](const std::vector<std::string>& inputs) { return a.picture.check(inputs); };
  source.raycast.lighting.linear = a.picture.is_exr();
  const auto [scene, sphere] = SLF_TRY(scene_of(a, source));
  const auto camera = SLF_TRY(a.camera.camera(sphere));
  const auto image = SLF_TRY(trace_view(*scene, sphere, camera, a.threads,
                                        progress_bar("raycast", "rows", OnSignal::end)));
  return a.picture.write(image);
}

}  // namespace

void add_render(CLI::App& app, Run& run) {
  const auto [command, a] = add_command(app, run, "render", "Draw a view of a field", run_render);
  a->field.add_to(*command, "Field to draw");
  a->picture.add_to(*command);
  a->camera.add_to(*command);
  a->draw.add_to(*command);
  command->add_flag("--stats", a->stats, "Print the cost of the view: tiles, bytes, pages, memory");
  add_json<ViewCost>(*command, a->json, "The same as JSON");
  a->shown.add_to(*command, [](const recipe::Option& option) {
    return option.name == std::string_view("exposure") ||
           option.name == std::string_view("tonemap");
  });
}

void add_raycast(CLI::App& app, Run& run) {
  const auto [command, a] = add_command(
      app, run, "raycast", "Draw the same view straight from the volume: the truth", run_raycast);
  a->source.add_input_to(*command, "INPUT");
  a->source.add_to(*command, [](const auto& o) { return o.use != recipe::Use::field; });
  a->source.add_states_to(*command);
  add_state(*command, "--state", a->state, "The state to draw, by its name or number");
  a->picture.add_to(*command);
  a->camera.add_to(*command);
  add_file(*command, "--cameras", a->cameras,
           "Draw the pictures of all cameras in a transforms.json, as .exr with depth (Z,\n"
           "from the eye), in the folder OUTPUT");
  for (const char* camera : {"--orbit", "--eye", "--look-at", "--up", "--fov", "--size"})
    command->get_option("--cameras")->excludes(camera);
  add_threads(*command, a->threads);
}

}  // namespace slf::cli

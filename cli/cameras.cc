// slf cameras: cameras around an object, for any renderer to fill in.
#include <filesystem>

#include "base/file.h"
#include "base/try.h"
#include "cli/command.h"

namespace slf::cli {
namespace {

struct CamerasArguments {
  SourceArguments source;
  std::vector<double> sphere;  // x, y, z, radius; empty: the input's
  std::uint32_t count = 100, test = 0;
  double distance = 3;
  PixelSize size{512, 512};
  std::string output;
  bool force = false;
};

/// `check` is given the files that the sphere is read from.
Result<Sphere> sphere_of(
    const CamerasArguments& a,
    const std::function<Result<void>(const std::vector<std::string>&)>& check) {
  SLF_TRY(check({a.source.input}));
  if (!a.sphere.empty()) {
    if (!(a.sphere[3] > 0))
      return fail(ErrorCode::usage, "--sphere: a radius of ", a.sphere[3], "; expected above 0");
    return Sphere{{a.sphere[0], a.sphere[1], a.sphere[2]}, a.sphere[3]};
  }
  if (a.source.input.empty())
    return fail(ErrorCode::usage,
                "no sphere: expected --sphere X,Y,Z,R, a field, a volume or a mesh");
  if (is_field(a.source.input)) {
    const auto field = SLF_TRY(open_field(a.source.input));
    return field.shape().sphere;
  }
  SourceArguments source = a.source;
  SLF_TRY(source.finish(0, OnSignal::end));
  source.check = check;
  const auto scene = SLF_TRY(hinted(make_scene(source)));
  return slf::sphere_of(source, scene->bounds());
}

Result<void> run_cameras(const CamerasArguments& a) {
  const std::filesystem::path path(a.output);
  const std::string test =
      (path.parent_path() / (path.stem().string() + "_test" + path.extension().string())).string();
  const auto check = [&](const std::vector<std::string>& inputs) -> Result<void> {
    SLF_TRY(refuse_overwrite(a.output, a.force, inputs));
    return a.test > 0 ? refuse_overwrite(test, a.force, inputs) : Result<void>();
  };
  const auto sphere = SLF_TRY(sphere_of(a, check));
  const auto write = [&](const std::string& output, std::uint32_t count, const char* folder) {
    auto cameras = spread_cameras(sphere, a.distance, count, a.size.width, a.size.height);
    for (Picture& camera : cameras) camera.name = folder + camera.name;
    const std::string text = transforms_json(cameras, "");
    return write_file(output, bytes_of(text));
  };
  SLF_TRY(write(a.output, a.count, "images/"));
  return a.test > 0 ? write(test, a.test, "images_test/") : Result<void>();
}

}  // namespace

void add_cameras(CLI::App& app, Run& run) {
  const auto [command, a] = add_command(
      app, run, "cameras",
      "Cameras around an object, as transforms.json, for any renderer to fill in", run_cameras);
  a->source.add_input_to(*command, "INPUT");
  a->source.add_to(*command, [](const recipe::Option& option) {
    return option.use == recipe::Use::reading || option.use == recipe::Use::data;
  });
  command->get_option("INPUT")->required(false)->description(
      "Field, volume or mesh to surround with cameras; or --sphere");
  of_numbers(command->add_option("--sphere", a->sphere, "Centre and radius, in world units"), 4)
      ->check(kPlace)
      ->type_name("X,Y,Z,R");
  add_number(*command, "--count", a->count, "Number of cameras, evenly spread", from_to(1, 100000));
  add_number(*command, "--test", a->test,
             "Also write this many cameras in other directions to *_test.json", from_to(0, 100000));
  add_number(*command, "--distance", a->distance, "Eyes' distance from the centre, in sphere radii",
             above(1, 1e6));
  add_size(*command, a->size);
  add_file(*command, "-o,--output", a->output, "The file to write, as transforms.json")->required();
  command->add_flag("-f,--force", a->force, "Overwrite the file");
}

}  // namespace slf::cli

#include <charconv>
#include <cmath>
#include <filesystem>

#include "cli/command.h"
#include "slf/scene.h"
#include "slf/transfer.h"

namespace slf::cli {
namespace {

constexpr std::string_view kScenePrefix = "scene:";

std::vector<std::string> split(const std::string& text, char at) {
  std::vector<std::string> parts(1);
  for (const char c : text) {
    if (c == at)
      parts.emplace_back();
    else
      parts.back() += c;
  }
  return parts;
}

/// Numbers separated by `at`, exactly `count` of them.
template <class T>
std::optional<std::vector<T>> parse_numbers(const std::string& text, char at, std::size_t count) {
  std::vector<T> numbers;
  for (const std::string& part : split(text, at)) {
    T value{};
    const char* end = part.data() + part.size();
    const char* begin = part.data() + (!part.empty() && part[0] == '+' ? 1 : 0);
    const auto [stop, error] = std::from_chars(begin, end, value);
    if (error != std::errc{} || stop != end) return std::nullopt;
    numbers.push_back(value);
  }
  if (numbers.size() != count) return std::nullopt;
  return numbers;
}

}  // namespace

Result<std::uint64_t> parse_bytes(const std::string& text, const char* option) {
  double value = 0;
  const auto [stop, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  const std::string unit(stop, text.data() + text.size());
  int shift = -1;
  const std::pair<const char*, int> units[] = {{"", 0},   {"B", 0},    {"K", 10}, {"KiB", 10},
                                               {"M", 20}, {"MiB", 20}, {"G", 30}, {"GiB", 30},
                                               {"T", 40}, {"TiB", 40}};
  for (const auto& [name, bits] : units)
    if (unit == name) shift = bits;
  const double bytes = shift < 0 ? -1 : std::ldexp(value, shift);
  if (error != std::errc{} || !(bytes >= 0 && bytes < 0x1p62))
    return fail(ErrorCode::usage, option, " ", text,
                ": expected a size such as 65536, 64MiB or 1.5GiB");
  return static_cast<std::uint64_t>(bytes);
}

Result<glm::dvec3> parse_vec3(const std::string& text, const char* option) {
  const auto v = parse_numbers<double>(text, ',', 3);
  if (!v) return fail(ErrorCode::usage, option, " ", text, ": expected three numbers, x,y,z");
  return glm::dvec3((*v)[0], (*v)[1], (*v)[2]);
}

Result<std::pair<std::uint32_t, std::uint32_t>> parse_size(const std::string& text) {
  const bool square = text.find('x') == std::string::npos;
  const auto v = parse_numbers<std::uint32_t>(square ? text + "x" + text : text, 'x', 2);
  if (!v || (*v)[0] == 0 || (*v)[1] == 0)
    return fail(ErrorCode::usage, "--size ", text, ": expected WIDTHxHEIGHT in pixels, as 512x512");
  return std::pair{(*v)[0], (*v)[1]};
}

Result<void> refuse_overwrite(const std::string& path, bool force) {
  std::error_code ignored;
  if (!force && std::filesystem::exists(path, ignored))
    return fail(ErrorCode::usage, path, ": exists; -f overwrites it");
  return {};
}

void SourceArguments::add_volume_to(CLI::App& command, const char* name) {
  command
      .add_option(name, input,
                  std::string(kVolumeHelp) + ", or\nscene:balls, scene:globe, scene:fog")
      ->type_name(kAnyFile)
      ->required();
  command
      .add_option("--transfer", transfer,
                  "Transfer function, ParaView preset JSON; without one, made from the histogram")
      ->type_name("FILE.json")
      ->group(kVolumeGroup);
  add_raw_to(command);
}

void SourceArguments::add_raw_to(CLI::App& command) {
  const char* group = kVolumeGroup;
  command.add_flag("--labels", labels, "Voxels are ids: nearest sampling, a colour per label")
      ->group(group);
  command.add_option("--dims", dims, "Raw files: voxels along x, y, z, as 128x128x84")
      ->group(group);
  command.add_option("--type", type, "Raw files: u8 i8 u16 i16 u32 i32 u64 i64 f32 f64")
      ->type_name(kVoxelType)
      ->group(group)
      ->capture_default_str();
  command.add_option("--spacing", spacing, "Raw files: distance between voxels, as 1x1x1.5")
      ->group(group)
      ->capture_default_str();
  command.add_option("--endian", endian, "Raw files: little or big")
      ->check(CLI::IsMember({"little", "big"}))
      ->group(group)
      ->capture_default_str();
  command.add_option("--offset", offset, "Raw files: bytes before the first voxel")
      ->group(group)
      ->capture_default_str();
}

void SourceArguments::add_light_to(CLI::App& command) {
  const char* group = "Light";
  command
      .add_option("--step", raycast.step, "Distance between samples, in smallest voxel spacings")
      ->group(group)
      ->capture_default_str();
  command
      .add_option("--light", light,
                  "World direction towards the light, x,y,z (LPS); "
                  "default: above, in front, to the patient's right")
      ->group(group);
  command.add_option("--ambient", raycast.ambient, "Share of a colour that needs no light, 0 to 1")
      ->group(group)
      ->capture_default_str();
  command.add_flag("--no-shade", no_shade, "Colours as in the transfer function, unlit")
      ->group(group);
}

Result<Volume> SourceArguments::volume() const {
  VolumeOptions options;
  options.labels = labels;
  if (!dims.empty()) {
    RawLayout layout;
    const auto n = parse_numbers<std::uint32_t>(dims, 'x', 3);
    if (!n)
      return fail(ErrorCode::usage, "--dims ", dims, ": expected three integers, as 128x128x84");
    const auto s = parse_numbers<double>(spacing, 'x', 3);
    if (!s)
      return fail(ErrorCode::usage, "--spacing ", spacing, ": expected three numbers, as 1x1x1.5");
    const auto scalar = parse_scalar_type(type);
    if (!scalar) return tl::unexpected(scalar.error());
    for (std::size_t axis = 0; axis < 3; ++axis) {
      layout.dims[axis] = (*n)[axis];
      layout.spacing[static_cast<int>(axis)] = (*s)[axis];
    }
    layout.type = *scalar;
    layout.big_endian = endian == "big";
    layout.offset = offset;
    options.raw = layout;
  }
  return read_volume(input, options);
}

Result<std::unique_ptr<Scene>> SourceArguments::scene(
    const std::optional<std::string>& provenance) const {
  if (input.starts_with(kScenePrefix))
    return make_analytic_scene(std::string_view(input).substr(kScenePrefix.size()));
  RaycastOptions options = raycast;
  options.shade = !no_shade;
  std::optional<TransferFunction> function;
  const auto built = provenance ? nlohmann::json::parse(*provenance) : nlohmann::json::object();
  if (text_of(built, "kind", "") == "volume") {
    options = raycast_options(*provenance);
    auto parsed = parse_transfer(built.value("transfer", nlohmann::json()).dump(),
                                 "the field's transfer function");
    if (!parsed) return tl::unexpected(parsed.error());
    function = std::move(*parsed);
  }
  if (!light.empty()) {
    const auto direction = parse_vec3(light, "--light");
    if (!direction) return tl::unexpected(direction.error());
    options.light = *direction;
  }
  // The small file first: its mistakes are found before a large one is read.
  if (!transfer.empty()) {
    auto read = read_transfer(transfer);
    if (!read) return tl::unexpected(read.error());
    function = std::move(*read);
  }
  auto volume = this->volume();
  if (!volume) return tl::unexpected(volume.error());
  if (!function) function = default_transfer(*volume);
  auto made = Raycaster::make(std::move(*volume), *function, options);
  if (!made) return tl::unexpected(made.error());
  return std::unique_ptr<Scene>(std::move(*made));
}

void CameraArguments::add_to(CLI::App& command) {
  const char* group = "Camera";
  command
      .add_option("--orbit", orbit,
                  "Azimuth and elevation in degrees, distance in sphere radii;\n"
                  "0,0,3 is the front (anterior), 90,0,3 the patient's left")
      ->group(group)
      ->capture_default_str();
  command.add_option("--eye", eye, "Eye in world coordinates, x,y,z, instead of --orbit")
      ->group(group);
  command.add_option("--look-at", look_at, "Point to look at; default: the sphere's centre")
      ->group(group);
  command.add_option("--up", up, "Direction that is up in the picture; default: 0,0,1")
      ->group(group);
  command.add_option("--fov", fov, "Vertical field of view in degrees; default: fits the sphere")
      ->group(group);
  command.add_option("--size", size, "Picture size in pixels, WIDTHxHEIGHT")
      ->group(group)
      ->capture_default_str();
}

Result<Camera> CameraArguments::camera(const Sphere& sphere) const {
  const auto pixels = parse_size(size);
  if (!pixels) return tl::unexpected(pixels.error());
  const auto [width, height] = *pixels;
  const auto angles = parse_vec3(orbit, "--orbit");
  if (!angles) return tl::unexpected(angles.error());
  Camera camera = orbit_camera(sphere, angles->x, angles->y, angles->z, width, height);
  const auto override_with = [](const std::string& text, const char* option,
                                glm::dvec3& value) -> Result<void> {
    if (text.empty()) return {};
    const auto parsed = parse_vec3(text, option);
    if (!parsed) return tl::unexpected(parsed.error());
    value = *parsed;
    return {};
  };
  if (auto ok = override_with(eye, "--eye", camera.eye); !ok) return tl::unexpected(ok.error());
  if (auto ok = override_with(look_at, "--look-at", camera.look_at); !ok)
    return tl::unexpected(ok.error());
  if (auto ok = override_with(up, "--up", camera.up); !ok) return tl::unexpected(ok.error());
  if (fov != 0) {
    camera.fov = fov;
  } else if (!eye.empty()) {
    const double distance = glm::distance(camera.eye, sphere.center);
    if (distance > sphere.radius) camera.fov = fitted_fov(sphere, distance, width, height);
  }
  return camera;
}

void DrawArguments::add_to(CLI::App& command) {
  const char* group = "Drawing";
  command
      .add_option("--mode", mode,
                  "How samples are interpolated; default: depth where the field has a depth\n"
                  "layer, else bitri")
      ->check(CLI::IsMember(kRenderModes))
      ->group(group);
  command
      .add_option("--level", level,
                  "Level of the tile pyramid, 0 the coarsest; finest; auto: what the pixels\n"
                  "of this camera can show")
      ->group(group)
      ->capture_default_str();
  command.add_option("--memory", memory, "Budget for decoded tiles and scratch")
      ->group(group)
      ->capture_default_str();
  command
      .add_option("--map-budget", map_budget,
                  "Resident bytes of the mapped file; default: as many as the kernel likes")
      ->group(group);
  command.add_option("-j,--threads", threads, "0: all cores")->group(group)->capture_default_str();
}

Result<RendererOptions> DrawArguments::renderer() const {
  const auto bytes = parse_bytes(memory, "--memory");
  if (!bytes) return tl::unexpected(bytes.error());
  RendererOptions options;
  options.memory = *bytes;
  options.threads = threads;
  if (map_budget.empty()) return options;
  const auto mapped = parse_bytes(map_budget, "--map-budget");
  if (!mapped) return tl::unexpected(mapped.error());
  options.map_budget = *mapped;
  return options;
}

Result<ViewOptions> DrawArguments::view(const Field& field, std::optional<Camera> camera) const {
  ViewOptions view;
  view.mode = default_mode(field);
  view.level = field.shape().levels;
  if (!mode.empty()) {
    const auto parsed = parse_render_mode(mode);
    if (!parsed) return tl::unexpected(parsed.error());
    view.mode = *parsed;
  }
  if (level == "auto") {
    view.level = camera ? matching_level(field.shape(), *camera, view.mode) : kMatchingLevel;
  } else if (level != "finest") {
    const auto parsed = parse_numbers<unsigned>(level, ',', 1);
    if (!parsed)
      return fail(ErrorCode::usage, "--level ", level, ": expected a number, 'finest' or 'auto'");
    view.level = parsed->front();
  }
  return view;
}

}  // namespace slf::cli

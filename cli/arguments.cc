#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <sstream>

#include "base/byte_count.h"
#include "base/file.h"
#include "base/try.h"
#include "cli/command.h"
#include "field/structure_looks.h"
#include "source/recipe/options.h"

namespace slf::cli {
namespace {

/// Accepts numbers for which `holds` is true. CLI11's own ranges accept NaN and print 309 digits.
CLI::Validator number(const std::function<bool(double)>& holds, const std::string& expected) {
  return CLI::Validator(
      [=](std::string& text) -> std::string {
        double value = 0;
        const bool good = CLI::detail::lexical_cast(text, value) && holds(value);
        return good ? "" : text + ": expected " + expected;
      },
      "");
}

/// Replaces "64MiB" or "1.5g" by a number of bytes. Returns an error message, or nothing.
std::string to_bytes(std::string& text) {
  const auto bytes = parse_byte_count(text);
  if (!bytes) return text + ": expected a number of bytes, or one as 64MiB or 1.5GiB";
  text = std::to_string(*bytes);
  return "";
}

/// Accepts what >> reads as a T. CLI11 itself says no more than that it cannot convert.
template <class T>
CLI::Validator reads(const std::string& expected) {
  return CLI::Validator(
      [=](std::string& text) {
        T value;
        return CLI::detail::lexical_cast(text, value) ? "" : text + ": expected " + expected;
      },
      "");
}

}  // namespace

CLI::Validator from_to(double low, double high) {
  return number([=](double v) { return v >= low && v <= high; },
                fmt::format("{:g} to {:g}", low, high));
}

CLI::Validator above(double low, double high) {
  return number([=](double v) { return v > low && v <= high; },
                fmt::format("above {:g}, at most {:g}", low, high));
}

const CLI::Validator kNotNegative =
    number([](double v) { return v >= 0 && std::isfinite(v); }, "0 or more");
const CLI::Validator kLength = from_to(recipe::kMinLength, recipe::kMaxLength);
const CLI::Validator kPlace = from_to(-recipe::kMaxLength, recipe::kMaxLength);

const Choices<RenderMode> kRenderModes{{"nearest", RenderMode::nearest},
                                       {"uv", RenderMode::uv},
                                       {"st", RenderMode::st},
                                       {"bitri", RenderMode::bitri},
                                       {"depth", RenderMode::depth}};

CLI::Option* add_bytes(CLI::App& command, const std::string& name, std::uint64_t& bytes,
                       const std::string& help) {
  const std::uint64_t mebibytes = bytes >> 20;
  return command.add_option(name, bytes, help + kBytesHelp)
      ->transform(CLI::Validator(to_bytes, ""))
      ->type_name("SIZE")
      ->default_str(fmt::format("{}MiB", mebibytes));
}

CLI::Option* add_budget(CLI::App& command, std::uint64_t& memory) {
  return add_bytes(command, "--memory", memory, "Budget for tiles and records under way")
      ->default_str(fmt::format("{}MiB", kDefaultBudget >> 20));
}

CLI::Option* add_threads(CLI::App& command, unsigned& threads) {
  return add_number(command, "-j,--threads", threads, "0: all cores", from_to(0, kMaxThreads));
}

CLI::Option* add_no_depth(CLI::App& command, bool& depth, const std::string& help) {
  return command.add_flag_callback(
      "--no-depth", [&depth] { depth = false; }, help);
}

CLI::Option* of_numbers(CLI::Option* option, int count, char delimiter) {
  return option->delimiter(delimiter)->type_size(count)->expected(1)->allow_extra_args(false);
}

CLI::Option* add_vector(CLI::App& command, const std::string& name, std::vector<double>& vector,
                        const std::string& help) {
  return of_numbers(command.add_option(name, vector, help), 3)->check(kPlace)->type_name(kVector);
}

glm::dvec3 to_vector(const std::vector<double>& numbers) {
  return {numbers[0], numbers[1], numbers[2]};
}

std::istream& operator>>(std::istream& in, PixelSize& size) {
  std::int64_t width = 0, height = 0;
  if (in >> width && !in.eof() && in.peek() == 'x')
    in.ignore() >> height;
  else
    height = width;
  const auto good = [](std::int64_t n) { return n > 0 && n <= kMaxPixels; };
  if (!good(width) || !good(height)) in.setstate(std::ios::failbit);
  size = {static_cast<std::uint32_t>(width), static_cast<std::uint32_t>(height)};
  return in;
}

CLI::Option* of_pixels(CLI::Option* option) {
  return option
      ->check(reads<PixelSize>(
          fmt::format("a width and a height of 1 to {} pixels, as 640x480, or one", kMaxPixels)))
      ->type_name("WIDTHxHEIGHT");
}

CLI::Option* add_size(CLI::App& command, PixelSize& size) {
  return of_pixels(
             command.add_option("--size", size, "Picture size in pixels; one number for a square"))
      ->default_str(to_string(size));
}

std::string to_string(const PixelSize& size) {
  return fmt::format("{}x{}", size.width, size.height);
}

std::istream& operator>>(std::istream& in, LevelRange& range) {
  std::int64_t first = 0, last = 0;
  if (in >> first && !in.eof() && in.peek() == '-')
    in.ignore() >> last;
  else
    last = first;
  if (first < 0 || last < first || last > UINT8_MAX) in.setstate(std::ios::failbit);
  range = {static_cast<unsigned>(first), static_cast<unsigned>(last)};
  return in;
}

CLI::Option* add_levels(CLI::App& command, const std::string& name,
                        std::optional<LevelRange>& levels, const std::string& help) {
  return command.add_option(name, levels, help + ", as 2 or 0-1")
      ->check(reads<LevelRange>("a level, or two with the lower one first, as 0-1"))
      ->type_name("LEVELS");
}

std::istream& operator>>(std::istream& in, Subfields& subfields) {
  std::array<bool, 64> chosen{};
  for (char comma = ','; comma == ',';) {
    unsigned first = 0, last = 0;
    if (!std::isdigit(in.peek()) || !(in >> first)) return in.setstate(std::ios::failbit), in;
    last = first;
    if (!in.eof() && in.peek() == '-')
      if (in.ignore(); !std::isdigit(in.peek()) || !(in >> last))
        return in.setstate(std::ios::failbit), in;
    if (first > last || last >= chosen.size()) return in.setstate(std::ios::failbit), in;
    for (unsigned k = first; k <= last; ++k) chosen[k] = true;
    comma = in.eof() || in.peek() != ',' ? ' ' : static_cast<char>(in.get());
  }
  subfields.numbers.clear();
  for (unsigned k = 0; k < chosen.size(); ++k)
    if (chosen[k]) subfields.numbers.push_back(static_cast<std::uint8_t>(k));
  return in;
}

CLI::Option* add_subfields(CLI::App& command, Subfields& subfields, const std::string& help) {
  return command
      .add_option("--subfields", subfields,
                  help + ": numbers from 0 to 63,\n8 x entry octant + exit octant, as 0-7,12")
      ->check(reads<Subfields>("numbers from 0 to 63, as 0-7,12"))
      ->type_name("NUMBERS");
}

tl::unexpected<Error> with_hint(const Error& error, const std::string& hint) {
  return tl::unexpected<Error>(Error{error.code, error.message + "; " + hint});
}

Result<void> with_force(Result<void> checked) {
  const std::string_view choice = checked || !checked.error().choice ? "" : checked.error().choice;
  if (!choice.starts_with("replace")) return checked;
  const bool folder = choice == "replace in";
  return with_hint(checked.error(), folder ? "-f overwrites files in it" : "-f overwrites it");
}

Result<void> refuse_overwrite(const std::string& path, bool force,
                              const std::vector<std::string>& inputs) {
  return with_force(check_output(path, inputs, force ? Existing::replace : Existing::keep));
}

CLI::Option* add_orbit(CLI::App& command, std::vector<double>& orbit, const std::string& help) {
  CLI::Validator distance = number([](double v) { return v > 0 && v <= kMaxOrbit; },
                                   "a distance above 0, at most 1e6, in sphere radii");
  distance.application_index(2);
  return of_numbers(command.add_option("--orbit", orbit, help), 3)
      ->check(distance)
      ->check(kPlace)
      ->type_name("AZ,EL,DIST")
      ->default_str(fmt::format("{}", fmt::join(orbit, ",")));
}

void CameraArguments::add_to(CLI::App& command) {
  const OptionGroup group(command, "Camera");
  auto* angles = add_orbit(command, orbit,
                           "Azimuth and elevation in degrees, distance in sphere radii;\n"
                           "0,0,3 is the front (anterior), 90,0,3 the patient's left");
  add_vector(command, "--eye", eye, "Eye in world coordinates, instead of --orbit")
      ->excludes(angles);
  add_vector(command, "--look-at", look_at, "Point to look at; default: the sphere's centre");
  add_vector(command, "--up", up, "Direction that is up in the picture; default: 0,0,1");
  add_number(command, "--fov", fov,
             "Vertical field of view in degrees; default: fits the sphere\n"
             "from 3 radii, or from --eye",
             number([](double v) { return v > 0 && v < 180; }, "degrees above 0 and below 180"));
  add_size(command, size);
}

Result<Camera> CameraArguments::camera(const Sphere& sphere) const {
  Camera camera = orbit_camera(sphere, orbit[0], orbit[1], orbit[2], size.width, size.height);
  if (!eye.empty()) camera.eye = to_vector(eye);
  if (!look_at.empty()) camera.look_at = to_vector(look_at);
  if (!up.empty()) camera.up = to_vector(up);
  const double distance = glm::distance(camera.eye, sphere.center);
  if (fov != 0)
    camera.fov = fov;
  else if (!eye.empty() && distance > sphere.radius)
    camera.fov = fitted_fov(sphere, distance, size.width, size.height);
  if (const auto rays = RayGenerator::make(camera); !rays)
    return with_hint(rays.error(), "see --eye, --look-at, --up and --size");
  return camera;
}

void DrawArguments::add_to(CLI::App& command) {
  const OptionGroup group(command, "Drawing");
  choose(command.add_option("--mode", mode,
                            "How samples are interpolated; default: depth where the field has a "
                            "depth,\nelse bitri"),
         kRenderModes);
  command
      .add_option("--level", level,
                  "Level of the tile pyramid, 0 the coarsest; finest; auto: what the pixels\n"
                  "of this camera can show")
      ->transform(CLI::Transformer(std::map<std::string, unsigned>{{"finest", kFinest},
                                                                   {"auto", kMatchingLevel}})
                      .description(""))
      ->type_name("LEVEL")
      ->default_str("finest");
  add_resources_to(command);
}

void DrawArguments::add_resources_to(CLI::App& command) {
  const OptionGroup group(command, "Drawing");
  add_bytes(command, "--memory", memory, "Budget for decoded tiles and scratch");
  add_threads(command, threads);
  add_structures_to(command);
  add_cut_to(command);
}

RendererOptions DrawArguments::renderer(const ViewOptions& view) const {
  RendererOptions options;
  options.memory = view.cap ? memory - memory_of_cap() : memory;
  options.threads = threads;
  return options;
}

Result<ViewOptions> DrawArguments::view(const Field& field, std::optional<Camera> camera) const {
  ViewOptions view;
  view.mode = mode.value_or(default_mode(field));
  view.level = level == kFinest ? field.shape().finest_level : level;
  if (level == kMatchingLevel && camera)
    view.level = matching_level(field.shape(), *camera, view.mode);
  const auto built = raycast_options(field.provenance()).clip;  // which may be named again
  for (const ClipPlane& plane : cut.raycast.clip)
    if (std::ranges::find(built, plane) == built.end()) view.clip.push_back(plane);
  if (auto ok = check_view(field, view); !ok)
    return with_hint(ok.error(), ok.error().choice ? "see --clip" : "see --mode and --level");
  if (!view.clip.empty()) view.cap = SLF_TRY(cap_of(field, view.clip));
  return view;
}

void DrawArguments::add_structures_to(CLI::App& command) {
  command
      .add_option(
          "--structure", structures,
          "Draw this together with what more such options name, instead of FIELD: states of\n"
          "FIELD, by names or patterns as 'left *', or other fields on its sphere; with an\n"
          "opacity from 0, hidden, to 1, and a colour by which its own are multiplied")
      ->type_name("NAME[:OPACITY][:#RRGGBB]")
      ->allow_extra_args(false)
      ->group("Drawing");
}

std::vector<std::string> DrawArguments::inputs(const FieldArguments& field) const {
  std::vector<std::string> files{field.path};
  for (const std::string& text : structures)
    if (auto given = parse_structure(text)) files.push_back(std::move(given->name));
  return files;
}

Result<Field> DrawArguments::open(const FieldArguments& arguments) const {
  const auto field = SLF_TRY(arguments.open());
  if (structures.empty())
    return arguments.state.empty() ? all_structures(field) : Result<Field>(field);
  const auto looks = SLF_TRY(at_place(parse_structures(structures, field.states()), "--structure"));
  return compose_looks(field, looks, [&](const std::string& name) {
    return name == arguments.path ? Result<Field>(field) : open_field(name);
  });
}

void DrawArguments::add_cut_to(CLI::App& command) {
  cut.add_to(command,
             [](const recipe::Option& option) { return option.name == std::string_view("clip"); });
  const OptionGroup group(command, "Volume");
  command
      .add_option(
          "--cap", cap,
          "What --clip lays open: shaded, under its own light; coarse, the same by a tenth\n"
          "of the work; slice, the scan's values in grey, from LO to HI; or hollow.\n"
          "All but hollow need a reveal (`slf reveal`); default: shaded, or else hollow")
      ->type_name("CAP[:LO,HI]");
}

Result<std::shared_ptr<const Scene>> DrawArguments::cap_of(const Field& field,
                                                           std::span<const ClipPlane> clip) const {
  CapOptions options;
  options.memory = memory_of_cap();
  options.threads = threads;
  options.progress = light_progress(OnSignal::end);
  const auto made = SLF_TRY(hinted(named_cap(field, clip, cap, options)));
  if (!made && cap.empty())
    note(field.path() + ": has no reveal, which `slf reveal` adds: the cut is hollow");
  return made;
}

}  // namespace slf::cli

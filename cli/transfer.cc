#include <fmt/format.h>

#include <cmath>

#include "base/file.h"
#include "base/try.h"
#include "cli/command.h"
#include "slf/image.h"
#include "slf/transfer.h"

namespace slf::cli {
namespace {

struct TransferArguments {
  std::string reference;
  std::string output;
  bool list = false, json = false, force = false;
};

const char* name_of(TransferPreset::Values values) {
  using Values = TransferPreset::Values;
  return values == Values::relative  ? "relative"
         : values == Values::indexed ? "indexed"
                                     : "absolute";
}

std::array<double, 2> extent(const TransferFunction& f) {
  if (f.colors.empty() || f.opacities.empty()) return {};
  return {std::min(f.colors.front().value, f.opacities.front().value),
          std::max(f.colors.back().value, f.opacities.back().value)};
}

/// A transfer function in a list.
struct Listed {
  TransferPreset preset{};

  void describe(auto& member) const {
    const auto [from, to] = extent(preset.function);
    member("name", preset.function.name, "of the function");
    member("values", name_of(preset.values), "what the values refer to",
           R"("enum": ["absolute", "relative", "indexed"])");
    member("from", from, "least value");
    member("to", to, "largest value");
    member("has_opacity", preset.has_opacity, "not only colours");
    member("description", preset.description, "may be empty");
    member("unit_distance", preset.has_unit_distance ? &preset.function.unit_distance : nullptr,
           "world units that an opacity refers to", R"("minimum": 0)");
  }
};

void print_list(std::span<const TransferPreset> presets, bool as_table) {
  if (!as_table) {
    std::vector<Listed> all;
    for (const auto& preset : presets) all.push_back({preset});
    return print_json(all);
  }
  for (const auto& preset : presets) {
    const auto [from, to] = extent(preset.function);
    print("{:<14}  {:<16}  {}\n", preset.function.name,
          preset.values == TransferPreset::Values::absolute ? fmt::format("{:g} to {:g}", from, to)
                                                            : name_of(preset.values),
          preset.has_opacity ? preset.description : "colours only");
  }
}

/// Draws a transfer function: above, its colours under the curve of opacity; below, a layer that is
/// ten unit distances thick, over a checkerboard.
Image picture_of(const TransferFunction& f) {
  constexpr std::uint32_t kWidth = 768, kCurve = 160, kGap = 8, kSlab = 40, kSquare = 10;
  constexpr double kDistances = 10;
  Image image;
  image.width = kWidth;
  image.height = kCurve + kGap + kSlab;
  image.rgba.assign(std::size_t{image.width} * image.height, glm::vec4(1));
  const auto [from, to] = extent(f);
  for (std::uint32_t x = 0; x < kWidth; ++x) {
    const glm::dvec4 rgba = f(std::lerp(from, to, (x + 0.5) / kWidth));
    const glm::vec3 color(rgba);
    const double top = kCurve * (1 - rgba.w);
    for (std::uint32_t y = 0; y < kCurve; ++y) {
      const double inside = std::clamp(y + 1 - top, 0.0, 1.0);
      image.rgba[std::size_t{y} * kWidth + x] =
          glm::vec4(glm::mix(glm::vec3(0.93f), color, static_cast<float>(inside)), 1);
    }
    const auto opacity = static_cast<float>(1 - std::pow(1 - rgba.w, kDistances));
    for (std::uint32_t y = 0; y < kSlab; ++y) {
      const bool dark = (x / kSquare + y / kSquare) % 2 == 1;
      image.rgba[std::size_t{kCurve + kGap + y} * kWidth + x] =
          glm::vec4(glm::mix(glm::vec3(dark ? 0.55f : 0.85f), color, opacity), 1);
    }
  }
  return image;
}

Result<void> write(const TransferPreset& preset, const std::string& path) {
  if (!path.ends_with(".json")) return write_image(path, picture_of(preset.function));
  const std::string json = to_json(preset.function);
  return write_file(path, bytes_of(json));
}

Result<void> run_transfer(const TransferArguments& a) {
  if (a.list) {
    if (a.reference.empty()) {
      print_list(built_in_transfers(), !a.json);
      return {};
    }
    const auto presets = SLF_TRY(read_transfers(a.reference));
    print_list(presets, !a.json);
    return {};
  }
  if (a.reference.empty())
    return fail(ErrorCode::usage, "a name or file is missing; --list lists the built-in names");
  const auto preset = SLF_TRY(read_transfer(a.reference));
  if (a.output.empty()) {
    if (a.json)
      print_json(Listed{preset});
    else
      print_list(std::span(&preset, 1), true);
    return {};
  }
  SLF_TRY(refuse_overwrite(a.output, a.force, {transfer_file(a.reference)}));
  return write(preset, a.output);
}

}  // namespace

void add_transfer(CLI::App& app, Run& run) {
  const auto [command, a] = add_command(
      app, run, "transfer", "Transfer functions: list them, draw one, convert", run_transfer);
  command->add_option("NAME", a->reference,
                      "A built-in name, or a file of ParaView, 3D Slicer or MRIcroGL; FILE#NAME\n"
                      "for one of several");
  command->add_flag("--list", a->list, "The built-in functions, or those of a file");
  add_file(*command, "-o,--output", a->output,
           "A picture of it (.png, .jpg, .exr), or ParaView's preset JSON (.json)");
  command->add_flag("-f,--force", a->force, "Overwrite the output");
  add_json<Listed, std::vector<Listed>>(*command, a->json);
}

}  // namespace slf::cli

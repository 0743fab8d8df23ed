// slf pictures: what is known of pictures, as a picture.
#include "base/try.h"
#include "cli/command.h"

namespace slf::cli {
namespace {

struct PicturesArguments {
  std::string what;
  SourceArguments source;
  std::vector<double> center;
  double radius = 0;
  std::uint32_t count = 24, cell = 160;
  std::string output;
  unsigned threads = 0;
  bool force = false;
};

Result<void> run_pictures(const PicturesArguments& a) {
  SourceArguments source = a.source;
  if (!source.is_pictures()) source.input = "pictures:" + source.input;
  if (a.center.empty() != (a.radius == 0))
    return fail(ErrorCode::usage, "--center and --radius: expected both, or none");
  if (a.radius != 0) source.pictures.sphere = Sphere{to_vector(a.center), a.radius};
  SLF_TRY(source.finish(a.threads, OnSignal::end));
  auto set = SLF_TRY(read_pictures(source));
  SLF_TRY(refuse_overwrite(a.output, a.force, set.files()));
  const auto options = picture_options(source, set);
  const auto sheet = SLF_TRY(make_depth_sheet(std::move(set), options, a.count, a.cell));
  SLF_TRY(write_image(a.output, sheet.image));
  if (sheet.source == "silhouettes") {
    print("depth      not used; the surface is that of the silhouettes\n");
    return {};
  }
  print("depth      {}, known for {:.0f} % of the pixels within the sphere\n",
        sheet.source == "estimated" ? sheet.source : "stated, as " + sheet.source,
        100 * sheet.known);
  print("confirmed  by {:.1f} of up to 8 other pictures (mean)\n", sheet.confirmed_by);
  return {};
}

}  // namespace

void add_pictures(CLI::App& app, Run& run) {
  const auto [command, a] =
      add_command(app, run, "pictures",
                  "Shows what is known of pictures with cameras, as a contact sheet", run_pictures);
  command->add_option("WHAT", a->what, "depth: depths, and how many other pictures confirm them")
      ->check(CLI::IsMember({"depth"}))
      ->required();
  add_file(*command, "INPUT", a->source.input,
           "Folder or JSON file with cameras, as of pictures:FOLDER")
      ->required();
  add_file(*command, "-o,--output", a->output, "Contact sheet to write: .png, .jpg or .exr")
      ->required();
  command->add_flag("-f,--force", a->force, "Overwrite the file");
  add_number(*command, "--count", a->count, "Pictures to show, at most, evenly chosen",
             from_to(1, 1000));
  add_number(*command, "--cell", a->cell, "Pixels along the longer side of each picture shown",
             from_to(16, 512));
  add_vector(*command, "--center", a->center, "Centre of the sphere; default: found");
  add_number(*command, "--radius", a->radius, "Radius of the sphere; default: found", kLength);
  a->source.add_to(*command, [](const auto& o) { return o.kinds == recipe::kPictures; });
  add_threads(*command, a->threads);
}

}  // namespace slf::cli

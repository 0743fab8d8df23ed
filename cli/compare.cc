// slf compare: PSNR and SSIM of two pictures.
#include <cmath>

#include "base/try.h"
#include "cli/command.h"
#include "slf/image.h"

namespace slf::cli {
namespace {

struct CompareArguments {
  std::string a, b, diff;
  float gain = 4;
  std::optional<double> min_psnr;
  bool force = false, json = false;
};

struct Compared {
  ImageDifference difference{};

  void describe(auto& member) const {
    difference.describe(member);
    member("equal", !std::isfinite(difference.psnr), "every pixel is the same");
  }
};

Result<void> run_compare(const CompareArguments& arguments) {
  if (!arguments.diff.empty())
    SLF_TRY(refuse_overwrite(arguments.diff, arguments.force, {arguments.a, arguments.b}));
  const auto a = SLF_TRY(read_image(arguments.a));
  const auto b = SLF_TRY(read_image(arguments.b));
  if (a.width != b.width || a.height != b.height)
    return fail(ErrorCode::usage, arguments.a, " is ", a.width, "x", a.height, ", ", arguments.b,
                " is ", b.width, "x", b.height, ": only pictures of one size can be compared");
  const ImageDifference d = compare(a, b);
  if (!arguments.diff.empty())
    SLF_TRY(write_image(arguments.diff, difference(a, b, arguments.gain)));
  if (arguments.json)
    print_json(Compared{d});
  else
    print("PSNR {:.2f} dB  SSIM {:.4f}\n", d.psnr, d.ssim);
  if (arguments.min_psnr && d.psnr < *arguments.min_psnr)
    return fail(ErrorCode::differs, arguments.a, " and ", arguments.b, ": PSNR ", d.psnr,
                " dB is below ", *arguments.min_psnr);
  return {};
}

}  // namespace

void add_compare(CLI::App& app, Run& run) {
  const auto [command, a] = add_command(
      app, run, "compare", "PSNR and SSIM of two pictures, and their difference", run_compare);
  command->footer("\nAn example:\n  slf compare view.png truth.png --diff difference.png\n" +
                  command->get_footer());
  add_file(*command, "A", a->a, "Picture")->required();
  add_file(*command, "B", a->b, "Picture of the same size")->required();
  add_file(*command, "--diff", a->diff, "Write the difference picture here");
  add_number(*command, "--gain", a->gain, "Factor of the differences in that picture",
             from_to(0, 1e6));
  add_number(*command, "--min-psnr", a->min_psnr, "Exit with 7 if the PSNR is below this",
             kNotNegative);
  command->add_flag("-f,--force", a->force, "Overwrite the difference picture");
  add_json<Compared>(*command, a->json);
}

}  // namespace slf::cli

// Cameras from any bytes, as transforms.json, as the table of a Cinema database and as COLMAP's
// files: an error, or cameras whose numbers are finite and whose lenses map places to directions.

#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <string>

#include "slf/image.h"
#include "source/pictures/cameras.h"
#include "tests/temporary_folder.h"

namespace {

void require(bool condition) {
  if (!condition) std::abort();
}

// A folder of this process with one picture, t.png.
struct Scratch : slf::testing::TemporaryFolder {
  Scratch() {
    require(!path().empty());
    const slf::Image picture{2, 2, std::vector<glm::vec4>(4, glm::vec4(0.5f)), {}};
    require(bool(slf::write_image(path() + "/t.png", picture)));
  }
};

void check(const slf::Result<slf::PictureSet>& set) {
  if (!set) {
    require(!set.error().message.empty());
    return;
  }
  for (const slf::Picture& picture : set->pictures) {
    for (int axis = 0; axis < 3; ++axis) {
      require(std::isfinite(picture.eye[axis]));
      require(std::abs(glm::length(picture.axes[axis]) - 1) < 1e-6);
    }
    require(picture.lens.fx > 0 && picture.lens.fy > 0);
    (void)picture.lens.project(picture.lens.direction({1, 1}));
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size < 3) return 0;
  const std::string text(reinterpret_cast<const char*>(data), size);
  static const Scratch scratch;
  check(slf::cameras::parse_transforms(text, "input", "/nonexistent"));
  check(slf::cameras::parse_cinema(text, "input", scratch.path()));
  // The first three bytes state the form and where the files begin.
  const std::size_t rest = size - 3, first = data[1] % (rest + 1),
                    second = first + data[2] % (rest - first + 1);
  const auto part = [&](std::size_t begin, std::size_t end) {
    const auto* bytes = reinterpret_cast<const std::byte*>(data) + 3;
    return slf::Bytes(bytes + begin, bytes + end);
  };
  check(slf::cameras::parse_colmap(
      {"input", (data[0] & 1) != 0, part(0, first), part(first, second), part(second, rest)}, ""));
  return 0;
}

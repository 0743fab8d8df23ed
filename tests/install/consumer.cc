// Uses the installed headers and libraries of slf: writes a picture and reads it back.
#include <cstdio>
#include <field/image.h>

int main(int argc, char** argv) {
  if (argc != 2) return 1;
  const slf::Image image{1, 1, {glm::vec4(1, 0, 0, 1)}, {}};
  if (const auto written = slf::write_image(argv[1], image); !written) {
    std::fputs(written.error().message.c_str(), stderr);
    return 1;
  }
  const auto read = slf::read_image(argv[1]);
  return read && slf::to_rgb8(*read) == slf::to_rgb8(image) ? 0 : 1;
}

// Draws a view of a field and prints its mean colour:
//   mean_color FIELD.slf
// Links slf::core alone, and with it no library for volumes, picture files or writing.
#include <cstdio>

#include "slf/camera.h"
#include "slf/field.h"
#include "slf/render.h"

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: mean_color FIELD.slf\n");
    return 1;
  }
  const auto field = slf::Field::open(argv[1]);
  if (!field) {
    std::fprintf(stderr, "mean_color: %s\n", field.error().message.c_str());
    return static_cast<int>(field.error().code);
  }
  slf::Renderer renderer(*field);
  const auto image = renderer.render(slf::orbit_camera(field->shape().sphere, 30, 20, 3, 256, 256),
                                     {slf::default_mode(*field), field->shape().finest_level});
  if (!image) {
    std::fprintf(stderr, "mean_color: %s\n", image.error().message.c_str());
    return static_cast<int>(image.error().code);
  }
  glm::vec4 sum(0);
  for (const glm::vec4& pixel : image->rgba) sum += pixel;
  sum /= static_cast<float>(image->pixels());
  std::printf("%.4f %.4f %.4f %.4f\n", sum.r, sum.g, sum.b, sum.a);
  return 0;
}

// Draws one view of a field:
//   picture FIELD.slf PICTURE.png
#include <slf/camera.h>
#include <slf/field.h>
#include <slf/image.h>
#include <slf/render.h>

#include <cstdio>

/// From the patient's left front, 30 degrees to the side and 20 up, at three radii of the sphere.
slf::Result<void> draw(const char* path, const char* picture) {
  const auto field = slf::Field::open(path);
  if (!field) return tl::unexpected(field.error());
  slf::RendererOptions options;
  options.memory = 64 << 20;  // bytes for decoded tiles, however large the field is
  slf::Renderer renderer(*field, options);
  slf::ViewOptions view;
  view.mode = slf::default_mode(*field);
  view.level = slf::kMatchingLevel;  // as fine as the pixels can show
  const auto camera = slf::orbit_camera(field->shape().sphere, 30, 20, 3, 512, 512);
  const auto image = renderer.render(camera, view);
  if (!image) return tl::unexpected(image.error());
  return slf::write_image(picture, *image);
}

int main(int argc, char** argv) {
  if (argc != 3) {
    std::fprintf(stderr, "usage: picture FIELD.slf PICTURE.png\n");
    return 1;
  }
  const auto drawn = draw(argv[1], argv[2]);
  if (drawn) return 0;
  std::fprintf(stderr, "picture: %s\n", drawn.error().message.c_str());
  return static_cast<int>(drawn.error().code);
}

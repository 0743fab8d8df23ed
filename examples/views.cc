// Opens a field, draws a view of it level by level, then flies around it:
//   views FIELD.slf PICTURE.png
#include <slf/camera.h>
#include <slf/field.h>
#include <slf/image.h>
#include <slf/player.h>
#include <slf/render.h>

#include <cstdio>

namespace {

int report(const slf::Error& error) {
  std::fprintf(stderr, "views: %s\n", error.message.c_str());
  return static_cast<int>(error.code);
}

/// Draws a view level by level, from coarse to fine, and shows each level when it is ready.
slf::Result<void> draw_progressively(const slf::Field& field, const char* path) {
  slf::RendererOptions options;
  options.memory = 64 << 20;  // bytes, however large the field is
  slf::Renderer renderer(field, options);
  const slf::Camera camera = slf::orbit_camera(field.shape().sphere, 30, 20, 3, 256, 256);
  slf::ViewOptions view;
  view.mode = slf::default_mode(field);
  const unsigned finest = slf::matching_level(field.shape(), camera, view.mode);

  slf::Image image;  // its memory is used again for each picture
  slf::ViewStatistics statistics;
  for (view.level = 0; view.level <= finest; ++view.level) {
    auto drawn = renderer.render(camera, view, image, &statistics);
    if (!drawn) return drawn;
    std::printf("level %u: %u x %u pixels\n", view.level, image.width, image.height);
  }
  std::printf("the view touches %zu tiles\n", statistics.tiles.size());
  return slf::write_image(path, image);
}

/// Draws frames that do not wait for tiles: a loading thread loads them, and coarser levels replace
/// those that are missing.
slf::Result<void> fly(const slf::Field& field) {
  slf::PlayOptions options;
  options.view.mode = slf::default_mode(field);
  options.view.level = field.shape().finest_level;
  auto player = slf::Player::make(field, options);
  if (!player) return tl::unexpected(player.error());
  const auto path = slf::CameraPath::orbit(field.shape().sphere, 0, 20, 3, 0.1, 1);
  if (!path) return tl::unexpected(path.error());

  slf::Image image;
  for (int frame = 0; frame < 10; ++frame) {
    slf::FrameReport report;
    const slf::Camera camera = path->at(frame / 10.0, 256, 256);
    if (auto ok = player->draw(camera, image, &report); !ok) return ok;
    std::printf("frame %d: %.0f %% at full level, %llu tiles loaded\n", frame,
                100 * report.full_share(), static_cast<unsigned long long>(report.loads));
    player->settle();  // a program on screen would wait for its next frame instead
  }
  return {};
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) {
    std::fprintf(stderr, "usage: views FIELD.slf PICTURE.png\n");
    return 1;
  }
  const auto field = slf::Field::open(argv[1]);
  if (!field) return report(field.error());
  if (const auto ok = draw_progressively(*field, argv[2]); !ok) return report(ok.error());
  if (const auto ok = fly(*field); !ok) return report(ok.error());
  return 0;
}

// Lights a volume, shadows and scattered light included, and draws a view of it:
//   lit VOLUME TRANSFER RIG PICTURE.exr
// TRANSFER and RIG are names that come with slf (ct-bone, studio) or files.
#include <slf/camera.h>
#include <slf/image.h>
#include <slf/raycaster.h>

#include <cstdio>

slf::Result<void> draw(const char* path, const char* transfer_name, const char* rig_name,
                       const char* picture) {
  auto volume = slf::read_volume(path);
  if (!volume) return tl::unexpected(volume.error());
  const auto transfer = slf::read_transfer(transfer_name);
  if (!transfer) return tl::unexpected(transfer.error());
  auto rig = slf::read_rig(rig_name);
  if (!rig) return tl::unexpected(rig.error());

  slf::RaycastOptions options;
  options.lighting.mode = slf::Lighting::global;
  options.lighting.rig = *rig;
  options.lighting.linear = true;        // radiance; false: colours for a screen
  slf::LightVolumeOptions light_volume;  // the light volume, computed before the first ray
  light_volume.progress = [](const slf::Progress& p) {
    std::fprintf(stderr, "\rlight %3.0f %%",
                 100.0 * static_cast<double>(p.done) / static_cast<double>(p.total));
    return true;
  };
  const slf::TransferFunction function = transfer->fit(*volume);
  const auto scene = slf::Raycaster::make(std::move(*volume), function, options, light_volume);
  if (!scene) return tl::unexpected(scene.error());
  std::fputc('\n', stderr);
  const auto sphere = (*scene)->bounds();
  const auto camera = slf::orbit_camera(sphere, 30, 20, 3, 512, 512);
  const auto image = slf::trace_view(**scene, sphere, camera);
  if (!image) return tl::unexpected(image.error());
  return slf::write_image(picture, *image);
}

int main(int argc, char** argv) {
  if (argc != 5) {
    std::fprintf(stderr, "usage: lit VOLUME TRANSFER RIG PICTURE.exr\n");
    return 1;
  }
  const auto drawn = draw(argv[1], argv[2], argv[3], argv[4]);
  if (drawn) return 0;
  std::fprintf(stderr, "lit: %s\n", drawn.error().message.c_str());
  return static_cast<int>(drawn.error().code);
}

// touched FIELD AZIMUTH ELEVATION DISTANCE SIZE: prints the bytes of the payloads that a view in
// the default mode takes at the finest level, with those of the tiles that its tiles are predicted
// from. What page_test.py compares the page's traffic with.

#include <cstdio>
#include <cstdlib>
#include <set>
#include <vector>

#include "field/field_file.h"
#include "slf/camera.h"
#include "slf/render.h"

int main(int argc, char** argv) {
  using namespace slf;
  if (argc != 6) return 1;
  const auto field = Field::open(argv[1]);
  if (!field) return 2;
  const auto size = static_cast<std::uint32_t>(std::atoi(argv[5]));
  const Camera camera = orbit_camera(field->shape().sphere, std::atof(argv[2]), std::atof(argv[3]),
                                     std::atof(argv[4]), size, size);
  Renderer renderer(*field);
  ViewStatistics statistics;
  if (!renderer.render(camera, {default_mode(*field), field->shape().levels}, &statistics))
    return 3;

  const FieldFile& file = field->file();
  std::set<TileKey> known(statistics.tiles.begin(), statistics.tiles.end());
  std::vector<TileKey> left = statistics.tiles;
  unsigned long long bytes = 0;
  while (!left.empty()) {
    const TileKey key = left.back();
    left.pop_back();
    for (storage::LayerId layer = 0; layer < field->layers().size(); ++layer) {
      const auto tile = file.store().find(layer, key);
      if (!tile || tile->state != storage::TileState::stored) continue;
      bytes += tile->payload.size();
      for (const TileKey reference : file.references(*tile))
        if (known.insert(reference).second) left.push_back(reference);
    }
  }
  std::printf("%llu\n", bytes);
  return 0;
}

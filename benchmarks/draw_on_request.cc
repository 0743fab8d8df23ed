// Draws one view of a field for every line that it reads, beside which python_render.py draws the
// same from Python.
//
//   draw_on_request FIELD SIZE
//
// Answers each line with the processor time of the view on all threads, in seconds.
#include <cstdio>
#include <cstdlib>
#include <string>

#include "benchmarks/storage/expect.h"
#include "benchmarks/timing.h"
#include "slf/camera.h"
#include "slf/render.h"

int main(int argc, char** argv) {
  using namespace slf;
  using bench::expect;
  if (argc != 3) return 1;
  const auto field = expect(Field::open(argv[1]));
  const auto size = static_cast<std::uint32_t>(std::atoi(argv[2]));
  Renderer renderer(field, {});
  const Camera camera = orbit_camera(field.shape().sphere, 30, 20, 3, size, size);
  const ViewOptions view{default_mode(field), field.shape().finest_level};
  while (std::getchar() != EOF) {
    bench::Times times;
    times.run([&] { expect(renderer.render(camera, view)); });
    std::printf("%.9f\n", times.median_cpu());
    std::fflush(stdout);
  }
  return 0;
}

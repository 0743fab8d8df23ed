// Stores, repacks, draws, checks and serves fields: links no source (tests/link/link_test.py).
#include "page/server.h"
#include "slf/field.h"
#include "slf/merge.h"
#include "slf/remote.h"
#include "slf/render.h"
#include "slf/repack.h"
#include "slf/verify.h"

int main(int argc, char** argv) {
  using namespace slf;
  if (argc < 3) return 1;
  const std::string place = argv[1], out = argv[2];
  const auto field = open_field(place, {});
  if (!field) return 2;
  if (!repack_field(*field, out, {}) || !verify_field(out, {}) || !merge_fields({out}, out, {}))
    return 3;
  Renderer renderer(*field);
  if (!renderer.render(orbit_camera(field->shape().sphere, 30, 20, 3, 64, 64), {})) return 4;
  const std::vector<std::string> served{out};
  auto server = page::Server::make(served, {});
  return server && server->run([] { return true; }) ? 0 : 5;
}

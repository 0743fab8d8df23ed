// Any bytes as a whole field: opening, counting, decoding, drawing and verifying neither crash nor
// hang, and a field without findings has tiles that all decode.
//
// Checksums would keep a fuzzer from the manifest and the tables, so the same bytes are also taken
// as those: byte 0 chooses, and for the parts of a field made here, the rest is one of them.
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <vector>

#include "field/field_file.h"
#include "field/tiles/tile_cache.h"
#include "slf/field.h"
#include "slf/render.h"
#include "slf/verify.h"
#include "storage/tile_writer.h"

namespace {

using namespace slf;

void require(bool promise) {
  if (!promise) std::abort();
}

constexpr std::uint64_t kMaxSamples = 1u << 16;  // larger tiles only cost time
constexpr std::uint64_t kMaxTiles = 256;

/// Decodes every tile that is stored; the number of those that do not.
std::uint64_t decode_all(const Field& field) {
  std::uint64_t bad = 0, tiles = 0;
  TileCache cache(field.file(), 64 << 20);
  (void)field.file().store().visit({0, 0}, {255, 0},
                                   [&](const storage::TileRef& tile) -> Result<void> {
                                     if (++tiles > kMaxTiles || !field.shape().has(tile.key) ||
                                         tile.state != storage::TileState::stored)
                                       return {};
                                     if (!cache.read(tile.key)) ++bad;
                                     return {};
                                   });
  return bad;
}

void draw(const Field& field) {
  Camera camera;
  const Sphere& sphere = field.shape().sphere;
  camera.look_at = sphere.center;
  camera.eye = sphere.center + 3.0 * sphere.radius * glm::dvec3(0.5, 0.7, 0.4);
  camera.width = camera.height = 16;
  RendererOptions options;
  options.threads = 1;
  options.memory = 1u << 20;
  Renderer renderer(field, options);
  ViewOptions view;
  view.level = field.shape().finest_level;
  for (const RenderMode mode : {RenderMode::nearest, default_mode(field), RenderMode::depth}) {
    view.mode = mode;
    (void)renderer.render(camera, view);
  }
}

void use(const std::string& path) {
  {
    const auto field = Field::open(path);
    if (!field) return;
    const FieldShape& shape = field->shape();
    if (shape.max_tile_samples() > kMaxSamples || shape.tiles(shape.finest_level) > 1u << 14 ||
        shape.entry_resolution(shape.finest_level) > 64 ||
        shape.exit_resolution(shape.finest_level) > 256)
      return;
    (void)field->content();
    std::uint64_t bad = decode_all(*field);
    draw(*field);
    for (unsigned state = 1; state < std::min<std::size_t>(field->states().size(), 4); ++state) {
      const auto other = field->in_state(state);
      require(other.has_value());
      bad += decode_all(*other);
      draw(*other);
    }
    VerifyOptions options;
    options.threads = 1;
    const auto whole = verify_field(path, options);
    if (whole && whole->found == 0) require(bad == 0 && whole->complete);
    options.quick = true;
    const auto quick = verify_field(path, options);
    require(!whole || !quick || quick->found <= whole->found);
  }
}

void use_bytes(ByteSpan bytes) {
  const int file = memfd_create("field", MFD_CLOEXEC);
  require(file >= 0 &&
          write(file, bytes.data(), bytes.size()) == static_cast<ssize_t>(bytes.size()));
  use("/proc/self/fd/" + std::to_string(file));
  close(file);
}

constexpr std::string_view kManifest =
    R"({"slf":{"major":2,"minor":0},"required":[],"sphere":{"center":[0,0,0],"radius":1},
"entry_side":1,"exit_side":2,"levels":0,"entry_depth":0,"subfields":[7],"provenance":{},
"format":"rgba8_depth8","codec":"jpeg:75"})";

/// The same of a field whose tiles are predicted.
constexpr std::string_view kPredictiveManifest =
    R"({"slf":{"major":2,"minor":0},"required":["predictive"],"sphere":{"center":[0,0,0],
"radius":1},"entry_side":1,"exit_side":2,"levels":1,"entry_depth":0,"filtered_levels":1,
"subfields":[7],"provenance":{},"format":"rgba8_depth8","codec":"predictive:80"})";

/// The same of two states.
constexpr std::string_view kStatesManifest =
    R"({"slf":{"major":2,"minor":0},"required":["predictive","states"],"sphere":{"center":[0,0,0],
"radius":1},"entry_side":1,"exit_side":2,"levels":1,"entry_depth":0,"filtered_levels":1,
"subfields":[7],"provenance":{},"format":"rgba8_depth8","codec":"predictive:80",
"states":[{"name":"a"},{"name":"b"}]})";

Bytes bytes_of(std::string_view text) {
  const ByteSpan bytes = as_bytes(std::span<const char>(text));
  return {bytes.begin(), bytes.end()};
}

/// A field of one tile, with one of its parts replaced.
void use_part(unsigned part, ByteSpan bytes) {
  const Bytes given(bytes.begin(), bytes.end());
  const bool predictive = part >= 3, states = part == 5;
  const std::string path =
      (std::filesystem::exists("/dev/shm") ? "/dev/shm/slf-fuzz-" : "/tmp/slf-fuzz-") +
      std::to_string(getpid());
  std::filesystem::remove(path);
  std::vector<std::pair<std::string, Bytes>> blobs{
      {kManifestBlob, part == 0 ? given
                                : bytes_of(states       ? kStatesManifest
                                           : predictive ? kPredictiveManifest
                                                        : kManifest)},
      {kTablesBlob, part == 1 || part == 3 ? given : Bytes{}}};
  {
    auto writer = storage::TileWriter::create(path, blobs);
    require(writer.has_value());
    for (const unsigned level : {0u, 1u})
      for (const unsigned state : {0u, 1u})
        if ((level == 0 || predictive) && (state == 0 || states))
          require(writer
                      ->append(in_state({static_cast<std::uint8_t>(level), 7u << 4 * level}, state),
                               given)
                      .has_value());
    require(writer->close().has_value());
  }
  use(path);
  std::filesystem::remove(path);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const ByteSpan bytes = std::as_bytes(std::span(data, size));
  if (data[0] >= '0' && data[0] <= '5')
    use_part(data[0] - '0', bytes.subspan(1));
  else
    use_bytes(bytes);
  return 0;
}

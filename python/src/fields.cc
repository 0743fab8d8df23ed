// Reading fields: what they hold, their pictures and their tiles.
#include "fields.h"

#include <unistd.h>

#include "arrays.h"
#include "base/try.h"
#include "calls.h"
#include "convert.h"
#include "module.h"
#include "slf/measure.h"
#include "slf/player.h"
#include "slf/remote.h"
#include "slf/verify.h"

namespace slf::python {
namespace {

using State = std::variant<unsigned, Text>;

std::unique_ptr<OpenField> in_state(const OpenField& open, const State& state) {
  auto field = std::visit([&](const auto& one) { return open.field().in_state(one); }, state);
  return open.with(value_of(std::move(field), open.field().path()));
}

std::unique_ptr<OpenField> open(const Text& path, std::uint64_t memory, unsigned threads,
                                const std::optional<State>& state, const Text& cache,
                                std::uint64_t cache_bytes, py::object progress) {
  LongCall call(std::move(progress));
  const RemoteOptions remote{.cache = cache, .cache_bytes = cache_bytes};
  auto field = call.value(path, [&] { return open_field(path, call.progress(), nullptr, remote); });
  auto opened = std::make_unique<OpenField>(std::move(field), RendererOptions{memory, threads});
  return state ? in_state(*opened, *state) : std::move(opened);
}

py::object content(const OpenField& open) {
  LongCall call;
  return python_of(call.value(open.field().path(), [&] { return open.field().content(); }));
}

/// `structures`: none for those that are shown if nothing is chosen.
std::unique_ptr<OpenField> compose(const OpenField& open,
                                   const std::optional<LookTuples>& structures) {
  const std::vector<StructureLook> looks =
      looks_of(structures.value_or(LookTuples()), open.field().states());
  LongCall call;
  auto composed = call.value(open.field().path(), [&] {
    return structures ? compose_looks(open.field(), looks,
                                      [&](const std::string& path) {
                                        return open_field(path, call.progress());
                                      })
                      : all_structures(open.field());
  });
  return open.with(std::move(composed));
}

/// The values of the small copy of the volume [z, y, x], and the columns of its affine.
py::object reveal(const OpenField& open) {
  LongCall call;
  const auto found = call.value(open.field().path(), [&] { return open.field().reveal(); });
  if (!found) return py::none();
  const Volume volume = volume_of(*found);
  const std::vector<py::ssize_t> shape{volume.dims[2], volume.dims[1], volume.dims[0]};
  py::array stored(volume.labels ? py::dtype("f8") : py::dtype("u1"), shape, volume.bytes().data());
  const auto column = [](const glm::dvec3& v) { return py::make_tuple(v.x, v.y, v.z); };
  return py::make_tuple(std::move(stored), volume.slope, volume.intercept, volume.labels,
                        py::make_tuple(column(volume.axes[0]), column(volume.axes[1]),
                                       column(volume.axes[2]), column(volume.origin)));
}

ViewOptions view_of(const Field& field, const std::optional<std::string>& mode,
                    std::optional<unsigned> level, bool with_depth) {
  ViewOptions view;
  view.mode = mode ? value_of(parse_render_mode(*mode)) : default_mode(field);
  view.level = level.value_or(kMatchingLevel);
  view.with_depth = with_depth;
  return view;
}

py::tuple render(OpenField& open, const CameraTuple& camera, const SizeTuple& size,
                 const py::kwargs& given) {
  std::optional<std::string> mode;
  std::optional<unsigned> level;
  std::optional<ToneTuple> tone;
  std::optional<std::uint64_t> memory;
  bool depth = false, display = false;
  PlaneTuples clip;
  std::string cap;
  read(given, "mode", mode, "level", level, "depth", depth, "tone", tone, "display", display,
       "memory", memory, "clip", clip, "cap", cap);
  ViewOptions view = view_of(open.field(), mode, level, depth);
  const Camera from = camera_of(open.field().shape().sphere, camera, size);
  open.renewed();
  LongCall call;
  const auto mapping = tone_of(tone);
  auto image = call.value(open.field().path(), [&]() -> Result<Image> {
    SLF_TRY(open.cut(view, planes_of(clip), cap));
    auto drawn = SLF_TRY(open.render(from, view, memory, call.progress()));
    SLF_TRY(map_tones(open.field(), mapping, display, drawn));
    return drawn;
  });
  const py::array colors = colors_of(image);
  return py::make_tuple(colors, depths_of(image));
}

py::object pick(OpenField& open, double x, double y, const CameraTuple& camera,
                const SizeTuple& size, const PlaneTuples& clip, const std::string& cap) {
  const Camera from = camera_of(open.field().shape().sphere, camera, size);
  open.renewed();
  LongCall call;
  const auto found = call.value(open.field().path(), [&]() -> Result<std::optional<PickedPoint>> {
    ViewOptions cut;
    SLF_TRY(open.cut(cut, planes_of(clip), cap));
    return open.drawn([&](Renderer& by) { return slf::pick(by, from, x, y, cut); });
  });
  return python_of(found);
}

/// A picture, rgba [height, width, 4], as a file.
py::bytes png(const py::array_t<float, py::array::c_style | py::array::forcecast>& rgba) {
  const auto* pixels = reinterpret_cast<const glm::vec4*>(rgba.data());
  const Image image{static_cast<std::uint32_t>(rgba.shape(1)),
                    static_cast<std::uint32_t>(rgba.shape(0)),
                    {pixels, pixels + rgba.size() / 4},
                    {}};
  const auto bytes = value_of(encode_image("picture.png", image));
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

// ---- tiles -------------------------------------------------------------------------------------

py::list tiles(const OpenField& open, unsigned first_level, std::optional<unsigned> last_level,
               bool missing) {
  const Field& field = open.field();
  TileFilter filter;
  filter.first_level = first_level;
  if (last_level) filter.last_level = *last_level;
  filter.missing = missing;
  std::vector<ListedTile> listed;
  LongCall call;
  call.value(field.path(), [&] {
    return list_tiles(field, filter, [&](const ListedTile& tile) -> Result<void> {
      listed.push_back(tile);
      return {};
    });
  });
  py::list out;
  for (const ListedTile& tile : listed) out.append(python_of(tile));
  return out;
}

/// The samples of a tile, which the array views.
py::array tile(OpenField& open, unsigned level, std::uint64_t entry, std::uint64_t exit,
               const std::string& channel) {
  const Field& field = open.renewed().field();
  LongCall call;
  auto set = call.value(field.path(), [&]() -> Result<TileSampleSet> {
    const auto key = find_tile(field, {level, entry, exit});
    if (!key) return tl::unexpected(key.error());
    const TileReader tiles = open.drawn([](Renderer& by) -> TileReader { return by.tiles(); });
    return read_tile(tiles, *key, channel);
  });
  const py::ssize_t entries = static_cast<py::ssize_t>(set.entries.size());
  const py::ssize_t columns = py::ssize_t{set.side + 1} * (set.side + 2) / 2;
  std::vector<py::ssize_t> shape{entries, columns};
  if (set.numbers > 1) shape.push_back(set.numbers);
  return array_over(set.samples, std::move(set.owner),
                    set.half ? py::dtype("<f2") : py::dtype("u1"), shape);
}

/// Where the rays of a tile begin, and where they end.
py::tuple rays(const OpenField& open, unsigned level, std::uint64_t entry, std::uint64_t exit) {
  const Field& field = open.field();
  auto [origins, targets] =
      tile_rays(field, value_of(find_tile(field, {level, entry, exit}), field.path()));
  const auto array = [](std::vector<glm::dvec3>& points) {
    const auto count = static_cast<py::ssize_t>(points.size());
    return array_of(std::move(points), py::dtype::of<double>(), {count, 3});
  };
  return py::make_tuple(array(origins), array(targets));
}

// ---- checks and measures -----------------------------------------------------------------------

py::object verify(const Text& path, const OpenField* open, py::object progress,
                  const py::kwargs& given) {
  VerifyOptions options;
  read(given, "quick", options.quick, "fix", options.fix, "memory", options.memory, "threads",
       options.threads);
  LongCall call(std::move(progress));
  const auto report = call.value(path, [&] {
    return open ? verify_field(open->field(), options, call.progress())
                : verify_field(path, options, call.progress());
  });
  return python_of(report);
}

py::object measure(OpenField& open, const CameraTuples& cameras, const SizeTuple& size,
                   double distance, const std::optional<std::string>& mode,
                   const std::vector<unsigned>& levels, const PlaneTuples& clip,
                   const std::string& cap, py::object progress) {
  MeasureOptions options;
  options.cameras = cameras_of(open.field().shape().sphere, cameras, size, distance);
  options.mode = view_of(open.field(), mode, {}, false).mode;
  options.levels = levels;
  options.renderer = open.options();
  LongCall call(std::move(progress));
  return python_of(call.value(open.field().path(), [&]() -> Result<Measurement> {
    ViewOptions cut;
    SLF_TRY(open.cut(cut, planes_of(clip), cap));
    options.clip = cut.clip, options.cap = cut.cap;
    return measure_views(open.field(), options, call.progress());
  }));
}

// ---- moving cameras ----------------------------------------------------------------------------

/// One frame is drawn at a time. Without a player: closed. A forked process leaves the player
/// alone, because the thread that it would wait for is missing there.
struct OpenPlayer {
  OpenPlayer(Player made, const Field& of)
      : player(std::make_unique<Player>(std::move(made))), field(of) {}
  ~OpenPlayer() {
    if (forked()) (void)player.release();
  }
  OpenPlayer(const OpenPlayer&) = delete;
  OpenPlayer& operator=(const OpenPlayer&) = delete;
  [[nodiscard]] bool forked() const { return getpid() != process; }

  std::unique_ptr<Player> player;
  std::optional<Field> field;
  std::mutex mutex;
  const pid_t process = getpid();
};

std::unique_ptr<OpenPlayer> make_player(OpenField& open, const std::optional<std::string>& mode,
                                        std::optional<unsigned> level, const std::string& loading,
                                        unsigned horizon, const PlaneTuples& clip,
                                        const std::string& cap) {
  PlayOptions options;
  options.renderer = open.options();
  options.view = view_of(open.field(), mode, level, false);
  options.loading = value_of(parse_loading(loading));
  options.horizon = horizon;
  LongCall call;
  auto player = call.value(open.field().path(), [&]() -> Result<Player> {
    SLF_TRY(open.cut(options.view, planes_of(clip), cap));
    return Player::make(open.field(), options);
  });
  return std::make_unique<OpenPlayer>(std::move(player), open.field());
}

py::tuple draw(OpenPlayer& open, const CameraTuple& camera, const SizeTuple& size,
               const std::optional<ToneTuple>& tone, bool display) {
  const auto mapping = tone_of(tone);
  Image image;
  FrameReport report;
  LongCall call;
  value_of(call.without_gil([&]() -> Result<void> {
    if (open.forked())
      return fail(ErrorCode::usage, "the player is of the process that this one was forked from");
    const std::lock_guard lock(open.mutex);
    if (!open.player) return fail(ErrorCode::usage, "the player is closed");
    SLF_TRY(open.player->draw(camera_of(open.field->shape().sphere, camera, size), image, &report));
    return map_tones(*open.field, mapping, display, image);
  }));
  return py::make_tuple(colors_of(image), python_of(report));
}

void settle(OpenPlayer& open) {
  if (open.forked()) return;
  LongCall call;
  call.without_gil([&] {
    const std::lock_guard lock(open.mutex);
    if (open.player) open.player->settle();
    return 0;
  });
}

void close(OpenPlayer& open) {
  if (open.forked()) return;
  const py::gil_scoped_release release;
  const std::lock_guard lock(open.mutex);
  open.player.reset();
  open.field.reset();
}

}  // namespace

std::vector<ClipPlane> planes_of(const PlaneTuples& planes) {
  std::vector<ClipPlane> clip;
  for (const auto& plane : planes) {
    if (const auto* pair = std::get_if<0>(&plane))
      clip.push_back({vector_of(pair->first), vector_of(pair->second)});
    else if (const auto& v = std::get<1>(plane); true)
      clip.push_back({{v[0], v[1], v[2]}, {v[3], v[4], v[5]}});
  }
  return clip;
}

std::vector<StructureLook> looks_of(const LookTuples& structures,
                                    std::span<const std::string> names) {
  std::vector<StructureLook> looks;
  for (const auto& structure : structures) {
    if (const auto* text = std::get_if<Text>(&structure)) {
      looks.push_back(value_of(parse_structure(std::string_view(*text), names)));
      continue;
    }
    const auto& [what, opacity, tint] = std::get<LookTuple>(structure);
    if (const auto* name = std::get_if<Text>(&what))
      looks.push_back({*name, opacity, tint});
    else if (const Field& field = std::get<const OpenField*>(what)->field(); true)
      looks.push_back({field.path(), opacity, tint, field});
  }
  return looks;
}

void bind_fields(py::module_& module) {
  py::class_<OpenField> type(module, "Field");
  const auto fact = [&](const char* name, auto get) {
    type.def_property_readonly(name, [get](const OpenField& open) { return get(open.field()); });
  };
  fact("path", [](const Field& f) { return Text(f.path()); });
  fact("shape", [](const Field& f) { return tuple_of(f.shape()); });
  fact("format", [](const Field& f) { return name(f.format()); });
  fact("codec", [](const Field& f) { return Text(f.codec()); });
  fact("has_depth", [](const Field& f) { return f.has_depth(); });
  fact("linear", [](const Field& f) { return f.linear(); });
  fact("manifest", [](const Field& f) { return Text(f.manifest()); });
  fact("provenance", [](const Field& f) { return Text(f.provenance()); });
  fact("file_bytes", [](const Field& f) { return f.file_bytes(); });
  fact("state", [](const Field& f) { return f.state(); });
  fact("states", [](const Field& f) {
    const auto names = f.states();
    return py::tuple(py::cast(Texts(names.begin(), names.end())));
  });
  type.def(py::init(&open), py::arg("path"), py::arg("memory"), py::arg("threads"),
           py::arg("state"), py::arg("cache") = Text(), py::arg("cache_size") = 1 << 30,
           py::arg("progress") = py::none())
      .def("in_state", in_state)
      .def("content", content)
      .def("compose", compose)
      .def("render", render)
      .def("pick", pick)
      .def("reveal", reveal)
      .def("tiles", tiles)
      .def("tile", tile)
      .def("rays", rays)
      .def("measure", measure)
      .def("camera", [](const OpenField& open, const CameraTuple& camera, const SizeTuple& size) {
        const Camera made = camera_of(open.field().shape().sphere, camera, size);
        return tuple_named("Camera", python_of(made.eye), python_of(made.look_at),
                           python_of(made.up), made.fov);
      });
  bind_closing(py::class_<OpenPlayer>(module, "Player"), close,
               "Ends the thread that loads tiles, and closes the file. A second call does nothing.")
      .def(py::init(&make_player))
      .def("drawn", draw)
      .def("settle", settle, "Waits until all tiles are loaded that are being loaded.");
  module.def("verify", verify);
  module.def("png", png);
}

}  // namespace slf::python

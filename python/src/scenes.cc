// Sources of rays: volumes from arrays and files, analytic scenes, functions of Python.
#include "scenes.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "arrays.h"
#include "convert.h"
#include "module.h"
#include "slf/raycaster.h"

namespace slf::python {
namespace {

// ---- rays of a function ------------------------------------------------------------------------

std::string text_of(const glm::dvec3& v) {
  return py::str("({:g}, {:g}, {:g})").format(v.x, v.y, v.z);
}
std::string text_of(const Segment& ray) {
  return "the ray from " + text_of(ray.from) + " to " + text_of(ray.to);
}

using Floats = py::array_t<float, py::array::c_style | py::array::forcecast>;

/// A result of the function as floats of an expected shape.
Floats checked(const py::handle& result, const char* what,
               const std::vector<py::ssize_t>& expected) {
  const Floats values = py::reinterpret_borrow<py::object>(result);
  if (!std::equal(expected.begin(), expected.end(), values.shape(), values.shape() + values.ndim()))
    throw py::value_error(std::string(what) + " has the shape " +
                          std::string(py::str(values.attr("shape"))) + ", expected " +
                          std::string(py::str(py::tuple(py::cast(expected)))));
  return values;
}

py::array_t<double> points(std::span<const Segment> rays, glm::dvec3 Segment::*end) {
  py::array_t<double> out({static_cast<py::ssize_t>(rays.size()), py::ssize_t{3}});
  auto rows = out.mutable_unchecked<2>();
  for (py::ssize_t k = 0; k < rows.shape(0); ++k)
    for (py::ssize_t axis = 0; axis < 3; ++axis)
      rows(k, axis) = (rays[static_cast<std::size_t>(k)].*end)[static_cast<int>(axis)];
  return out;
}

}  // namespace

void RayScene::call(std::span<const Segment> rays, std::span<RaySample> out) const {
  const auto give_up = [] { throw std::runtime_error("the function of rays failed"); };
  // Taken before the GIL, which the function may hand over while it runs.
  const auto turn = concurrent_ ? std::unique_lock<std::mutex>() : std::unique_lock(turns_);
  const py::gil_scoped_acquire acquire;
  if (raised_) give_up();
  try {
    try {
      ask(rays, out);
    } catch (const py::builtin_exception& error) {
      error.set_error();
      throw py::error_already_set();
    }
  } catch (py::error_already_set& error) {
    error.value().attr("add_note")("while tracing " + std::to_string(rays.size()) +
                                   " rays, the first of which is " + text_of(rays.front()));
    if (!raised_) raised_.emplace(error);
    give_up();
  }
}

void RayScene::ask(std::span<const Segment> rays, std::span<RaySample> out) const {
  const auto count = static_cast<py::ssize_t>(rays.size());
  const py::object result = fn_(points(rays, &Segment::from), points(rays, &Segment::to));
  py::object colors = result, depths = py::none();
  if (py::isinstance<py::tuple>(result)) {
    const py::tuple pair = result;
    if (pair.size() != 2)
      throw py::value_error("expected rgba or (rgba, depth), found a tuple of " +
                            std::to_string(pair.size()));
    colors = pair[0], depths = pair[1];
  }
  const Floats rgba = checked(colors, "rgba", {count, 4});
  const auto color = rgba.unchecked<2>();
  std::optional<Floats> depth;
  if (!depths.is_none()) depth = checked(depths, "depth", {count});
  for (py::ssize_t k = 0; k < count; ++k) {
    const auto at = static_cast<std::size_t>(k);
    RaySample& sample = out[at] = {};
    for (py::ssize_t c = 0; c < 4; ++c) {
      if (!std::isfinite(color(k, c)))
        throw py::value_error("rgba is not finite on " + text_of(rays[at]));
      sample.rgba[static_cast<int>(c)] = color(k, c);
    }
    if (!(sample.rgba.a > 0)) continue;
    sample.depth = depth ? depth->at(k) : 0.5f;
    if (!(sample.depth >= 0 && sample.depth <= 1))
      throw py::value_error("depth is " + std::to_string(sample.depth) + ", expected 0 to 1, on " +
                            text_of(rays[at]));
  }
}

void RayScene::trace_many(std::span<const Segment> rays, std::span<RaySample> out) const {
  std::vector<Segment> asked;
  std::vector<std::size_t> places;  // of `asked` in `rays`
  asked.reserve(rays.size());
  for (std::size_t k = 0; k < rays.size(); ++k) {
    out[k] = {};
    if (rays[k].from == rays[k].to) continue;
    asked.push_back(rays[k]);
    places.push_back(k);
  }
  std::vector<RaySample> seen(asked.size());
  for (std::size_t k = 0; k < asked.size(); k += batch_) {
    const std::size_t count = std::min(batch_, asked.size() - k);
    call(std::span(asked).subspan(k, count), std::span(seen).subspan(k, count));
  }
  for (std::size_t k = 0; k < asked.size(); ++k) out[places[k]] = seen[k];
}

RaySample RayScene::trace(const glm::dvec3& from, const glm::dvec3& to) const {
  const Segment ray{from, to};
  RaySample sample;
  trace_many({&ray, 1}, {&sample, 1});
  return sample;
}

void RayScene::rethrow() const {
  if (!raised_) return;
  const py::error_already_set error = std::move(*raised_);
  raised_.reset();
  throw error;
}

namespace {

// ---- volumes -----------------------------------------------------------------------------------

using VolumeHandle = std::shared_ptr<Volume>;

ScalarType scalar_type(const py::dtype& type) {
  const std::string name =
      std::string(1, type.kind() == 'b' ? 'u' : type.kind()) + std::to_string(8 * type.itemsize());
  return value_of(parse_scalar_type(name));
}

/// Borrows the memory of an array, in C order [z, y, x], in a type of volumes. It holds the array
/// as long as a volume needs it.
VolumeHandle volume_of(const py::array& array, const Triple& origin,
                       const std::array<Triple, 3>& axes, double slope, double intercept,
                       bool labels, const Text& source, const Texts& files) {
  if (array.ndim() != 3 || !(array.flags() & py::array::c_style))
    throw py::value_error("expected an array [z, y, x] in C order");
  auto volume = std::make_shared<Volume>();
  for (py::ssize_t axis = 0; axis < 3; ++axis) {
    const py::ssize_t size = array.shape(2 - axis);
    if (size < 2 || size > std::numeric_limits<std::int32_t>::max())
      throw py::value_error("an array of shape " + std::string(py::str(array.attr("shape"))) +
                            ": expected 2 to 2^31 voxels along each axis");
    volume->dims[static_cast<std::size_t>(axis)] = static_cast<std::uint32_t>(size);
    volume->axes[static_cast<int>(axis)] = vector_of(axes[static_cast<std::size_t>(axis)]);
  }
  volume->type = scalar_type(array.dtype());
  Py_INCREF(array.ptr());
  volume->borrowed = std::shared_ptr<const std::byte>(static_cast<const std::byte*>(array.data()),
                                                      [held = array.ptr()](const std::byte*) {
                                                        if (!Py_IsInitialized()) return;
                                                        const py::gil_scoped_acquire acquire;
                                                        Py_DECREF(held);
                                                      });
  volume->slope = slope;
  volume->intercept = intercept;
  volume->origin = vector_of(origin);
  volume->labels = labels;
  volume->source = source;
  volume->files.assign(files.begin(), files.end());
  return volume;
}

VolumeHandle read(const Text& path, bool labels, const std::optional<Triple>& spacing,
                  std::optional<std::uint32_t> component, std::optional<std::uint32_t> time,
                  const std::optional<std::string>& array, const std::optional<std::string>& series,
                  bool resample) {
  VolumeOptions options;
  options.labels = labels;
  if (spacing) options.spacing = vector_of(*spacing);
  options.component = component;
  options.time = time;
  options.array = array;
  options.series = series;
  options.resample = resample;
  LongCall call;
  return std::make_shared<Volume>(
      value_of(call.without_gil([&] { return read_volume(path, options); }), path));
}

// ---- the ray-caster ----------------------------------------------------------------------------

/// The transfer function for a volume: a preset by reference, the JSON of a function for this very
/// volume, or neither.
Result<TransferFunction> transfer_for(const Volume& volume, const std::string& reference,
                                      const std::string& json,
                                      const std::optional<std::array<double, 2>>& range) {
  if (!json.empty()) return parse_transfer(json, "transfer");
  if (reference.empty() && !range) return default_transfer(volume);
  if (reference.empty())
    return TransferPreset{.function = default_transfer(volume)}.fit(volume, range);
  const auto preset = read_transfer(reference);
  if (!preset) return tl::unexpected(preset.error());
  return preset->fit(volume, range);
}

using Style = std::tuple<std::string, std::optional<Triple>, double>;

LabelTable label_table(const std::map<std::int64_t, Style>& styles) {
  LabelTable table;
  for (const auto& [id, style] : styles) {
    const auto& [name, color, opacity] = style;
    table[id] = {name, {}, opacity};
    if (color) table[id].color = vector_of(*color);
  }
  return table;
}

SceneHandle raycaster(Volume volume, const std::string& settings, const Text& transfer,
                      const std::string& transfer_json,
                      const std::optional<std::array<double, 2>>& range, const Text& rig,
                      const Text& environment, const VolumeHandle& labels, const Text& table,
                      const std::optional<std::map<std::int64_t, Style>>& styles,
                      const VolumeHandle& mask, const Text& light_file, unsigned threads) {
  SceneHandle handle;
  LongCall call;
  const std::string source = volume.source;
  auto made = handle.trace(call, [&]() -> Result<std::unique_ptr<Raycaster>> {
    RaycastOptions options = raycast_options(settings);
    if (!rig.empty()) {
      auto read = read_rig(rig);
      if (!read) return tl::unexpected(read.error());
      options.lighting.rig = std::move(*read);
    }
    if (!environment.empty()) {
      auto picture = read_image(environment);
      if (!picture) return tl::unexpected(picture.error());
      options.lighting.environment = std::make_shared<const Image>(std::move(*picture));
    }
    options.structures.labels = labels;
    options.structures.mask = mask;
    if (!table.empty()) {
      auto read = read_label_table(table);
      if (!read) return tl::unexpected(read.error());
      options.structures.styles = std::move(*read);
    } else if (styles) {
      options.structures.styles = label_table(*styles);
    } else if (labels) {
      options.structures.styles = labels->label_styles;
    }
    const auto function = transfer_for(volume, transfer, transfer_json, range);
    if (!function) return tl::unexpected(function.error());
    for (const std::string& file : std::initializer_list<std::string>{
             transfer_file(transfer), rig, environment, table, light_file})
      volume.files.push_back(file);
    return Raycaster::make(std::move(volume), *function, options,
                           {threads, LightProgress::report, light_file, true});
  });
  handle.scene = value_of(std::move(made), source);
  return handle;
}

/// A picture of the scene's rays themselves.
py::tuple raycast(const SceneHandle& handle, const CameraTuple& camera, unsigned threads,
                  const std::optional<ToneTuple>& tone, py::object progress) {
  LongCall call(std::move(progress));
  auto image = value_of(handle.trace(call, [&]() -> Result<Image> {
    auto drawn = trace_view(*handle.scene, handle.scene->bounds(), camera_of(camera), threads,
                            call.progress());
    if (drawn && tone) map_tones(*tone, *drawn);
    return drawn;
  }));
  const py::array colors = colors_of(image);
  return py::make_tuple(colors, depths_of(image));
}

}  // namespace

void bind_scenes(py::module_& module) {
  py::class_<Volume, VolumeHandle>(module, "Volume")
      .def(py::init(&volume_of), py::arg("array"), py::arg("origin"), py::arg("axes"),
           py::arg("slope"), py::arg("intercept"), py::arg("labels"), py::arg("source"),
           py::arg("files"))
      .def_readonly("dims", &Volume::dims)
      .def_property_readonly("notes",
                             [](const Volume& v) { return Texts(v.notes.begin(), v.notes.end()); })
      .def_property_readonly("source", [](const Volume& v) { return Text(v.source); })
      .def_readonly("labels", &Volume::labels)
      .def_property_readonly("spacing", [](const Volume& v) { return triple_of(v.spacing()); })
      .def_property_readonly("value_range", &Volume::value_range)
      .def("looks_like_labels", [](const Volume& v) { return looks_like_labels(v); });
  module.def("read_volume", read, py::arg("path"), py::arg("labels"), py::arg("spacing"),
             py::arg("component"), py::arg("time"), py::arg("array"), py::arg("series"),
             py::arg("resample"));
  py::class_<SceneHandle>(module, "Scene")
      .def_property_readonly("bounds",
                             [](const SceneHandle& s) { return tuple_of(s.scene->bounds()); })
      .def_property_readonly("provenance",
                             [](const SceneHandle& s) { return Text(s.scene->provenance()); })
      .def("raycast", raycast, py::arg("camera"), py::arg("threads"), py::arg("tone"),
           py::arg("progress"));
  module.def("raycaster", raycaster, py::arg("volume"), py::arg("settings"), py::arg("transfer"),
             py::arg("transfer_json"), py::arg("range"), py::arg("rig"), py::arg("environment"),
             py::arg("labels"), py::arg("label_table"), py::arg("styles"), py::arg("mask"),
             py::arg("light_file"), py::arg("threads"));
  module.def("analytic_scene", [](const std::string& name) {
    SceneHandle handle;
    handle.scene = value_of(make_analytic_scene(name));
    return handle;
  });
  module.def(
      "ray_scene",
      [](py::object fn, const SphereTuple& sphere, const std::string& provenance, std::size_t batch,
         bool concurrent) {
        SceneHandle handle;
        auto scene = std::make_shared<const RayScene>(std::move(fn), sphere_of(sphere), provenance,
                                                      batch, concurrent);
        handle.rays = scene.get();
        handle.scene = std::move(scene);
        return handle;
      },
      py::arg("fn"), py::arg("sphere"), py::arg("provenance"), py::arg("batch"),
      py::arg("concurrent"));
}

}  // namespace slf::python

// Sources of rays: recipes, volumes from arrays, functions of Python.
#include "scenes.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "arrays.h"
#include "base/join.h"
#include "base/try.h"
#include "convert.h"
#include "module.h"
#include "slf/recipe.h"
#include "source/recipe/options.h"

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
                       bool labels, const Text& unit, bool patient_axes, const Text& source,
                       const Texts& files) {
  if (array.ndim() != 3 || !(array.flags() & py::array::c_style))
    throw py::value_error("expected an array [z, y, x] in C order");
  auto volume = std::make_shared<Volume>();
  for (py::ssize_t axis = 0; axis < 3; ++axis) {
    const py::ssize_t size = array.shape(2 - axis);
    if (size < 2 || size > std::numeric_limits<std::int32_t>::max())
      throw Failure(
          {ErrorCode::usage, "an array of shape " + std::string(py::str(array.attr("shape"))) +
                                 ": expected 2 to 2^31 voxels along each axis"},
          "");
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
  volume->unit = unit;
  volume->patient_axes = patient_axes;
  volume->source = source;
  volume->files.assign(files.begin(), files.end());
  return volume;
}

// ---- recipes -----------------------------------------------------------------------------------

using RecipeHandle = std::shared_ptr<Recipe>;

/// A value of Python as JSON, whose texts may have any bytes.
nlohmann::json json_of(const py::handle& value) {
  if (value.is_none()) return {};
  if (py::isinstance<py::bool_>(value)) return value.cast<bool>();
  if (py::isinstance<py::int_>(value)) return value.cast<std::int64_t>();
  if (py::isinstance<py::float_>(value)) return value.cast<double>();
  if (py::hasattr(value, "tolist")) return json_of(value.attr("tolist")());
  nlohmann::json json;
  if (py::isinstance<py::dict>(value)) {
    json = nlohmann::json::object();
    for (const auto& [name, member] : value.cast<py::dict>())
      json[std::string(py::str(name))] = json_of(member);
  } else if (py::isinstance<py::list>(value) || py::isinstance<py::tuple>(value)) {
    json = nlohmann::json::array();
    for (const py::handle one : value) json.push_back(json_of(one));
  } else {
    json = std::string(value.cast<Text>());
  }
  return json;
}

/// What a transfer function raised in this thread, which make() throws as it was.
thread_local std::optional<py::error_already_set> raised;

/// Sets an option, also to what JSON has not: a volume in memory, or a function from (low, high,
/// spacing) of a volume to the JSON of a transfer function.
void set(Recipe& recipe, const std::string& name, const py::object& value) {
  const bool is_volume = py::isinstance<Volume>(value);
  if (is_volume && name == "input") {
    recipe.volume = value.cast<VolumeHandle>();
  } else if (is_volume) {
    (name == "mask" ? recipe.mask : recipe.labels_volume).volume = value.cast<VolumeHandle>();
    recipe.stated.insert(name);
  } else if (py::isinstance<py::function>(value)) {
    recipe.make_transfer = [fn = py::function(value)](const Volume& v) -> Result<TransferFunction> {
      const py::gil_scoped_acquire acquire;
      try {
        const auto [low, high] = v.value_range();
        const glm::dvec3 spacing = v.spacing();
        return parse_transfer(
            fn(low, high, std::min({spacing.x, spacing.y, spacing.z})).cast<std::string>(),
            "transfer");
      } catch (py::error_already_set& error) {
        raised.emplace(error);
        return fail(ErrorCode::failed, "the transfer function raised");
      }
    };
    recipe.stated.insert(name);
  } else {
    nlohmann::json json;
    try {
      json = json_of(value);
    } catch (const py::cast_error&) {
      throw Failure(
          {ErrorCode::usage, name + ": unexpected value " + py::repr(value).cast<std::string>()},
          "");
    }
    const recipe::Option* const option = recipe::find(name);
    if (const auto* other = option ? recipe::rival_of(*option, recipe.stated) : nullptr)
      throw Failure({ErrorCode::usage, concat(name, ": not beside ", other->name)}, "");
    value_of(recipe::set(recipe, name, json));
  }
}

/// The scenes of a recipe, with their names. `states`: those to which it is added as `name`, with
/// the light of `light_from`; null: it is alone. `to_store`: for a field, whose colours may be
/// linear. `notes` gets what people should know.
std::vector<std::pair<Text, SceneHandle>> make(const Recipe& given, StateScenes* states,
                                               const Text& name, const Text& light_from,
                                               bool to_store, py::list notes, py::object progress) {
  Recipe recipe = given;
  if (states && (recipe.each_label || recipe.each_time || !recipe.states.empty()))
    throw Failure({ErrorCode::usage, concat(recipe.each_label  ? "each_label"
                                            : recipe.each_time ? "each_time"
                                                               : "the recipe",
                                            " makes states itself, without states=")},
                  "");
  recipe.raycast.lighting.linear = to_store && recipe.field.half;
  recipe.light_volume.progress = LightProgress::report;
  const auto found = std::make_shared<Texts>();
  recipe.on_note = [found](const std::string& note, const char* choice) {
    found->emplace_back(choice ? note + "; see the setting " + choice : note);
  };
  LongCall call(std::move(progress));
  auto result = SceneHandle{}.trace(call, [&]() -> Result<std::vector<NamedScene>> {
    if (!recipe.truth_of.empty()) {
      std::shared_ptr<const Scene> truth = SLF_TRY(make_scene(recipe));
      return std::vector{NamedScene{"", std::move(truth)}};
    }
    if (!states) return make_scenes(recipe);
    SLF_TRY(states->add(name, recipe, light_from));
    return std::vector{states->scenes().back()};
  });
  if (raised) throw *std::exchange(raised, std::nullopt);
  if (!result && result.error().choice && recipe::find(result.error().choice))
    result.error().message.append("; see the setting ").append(result.error().choice);
  auto made = value_of(std::move(result), recipe.input);
  for (const Text& note : *found) notes.append(note);
  std::vector<std::pair<Text, SceneHandle>> scenes;
  for (NamedScene& one : made)
    scenes.emplace_back(one.name,
                        SceneHandle{std::move(one.scene), nullptr, std::move(one.recipe)});
  return scenes;
}

/// A picture of the scene's rays themselves.
py::tuple raycast(const SceneHandle& handle, const SphereTuple& around, const CameraTuple& camera,
                  const SizeTuple& size, unsigned threads, py::object progress) {
  const Sphere sphere = sphere_of(around);
  const Camera from = camera_of(sphere, camera, size);
  LongCall call(std::move(progress));
  auto image = value_of(handle.trace(
      call, [&] { return trace_view(*handle.scene, sphere, from, threads, call.progress()); }));
  const py::array colors = colors_of(image);
  return py::make_tuple(colors, depths_of(image));
}

}  // namespace

void bind_scenes(py::module_& module) {
  py::class_<Volume, VolumeHandle>(module, "Volume").def(py::init(&volume_of));
  py::class_<SceneHandle>(module, "Scene")
      .def_property_readonly("bounds",
                             [](const SceneHandle& s) { return tuple_of(s.scene->bounds()); })
      .def_property_readonly("provenance",
                             [](const SceneHandle& s) { return Text(s.scene->provenance()); })
      .def("raycast", raycast);
  py::class_<StateScenes>(module, "StateScenes").def(py::init());
  py::class_<Recipe, RecipeHandle>(module, "Recipe")
      .def(py::init())
      .def("set", set)
      .def("read",
           [](Recipe& recipe, const Text& input) {
             if (is_recipe(input)) value_of(read_recipe(input, recipe));
           })
      .def("compare_with",
           [](Recipe& recipe, const std::string& provenance) { recipe.truth_of = provenance; })
      .def("use_threads", [](Recipe& recipe, unsigned n) { recipe.light_volume.threads = n; })
      .def("scenes", make);
  module.def("ray_scene", [](py::object fn, const SphereTuple& sphere,
                             const std::string& provenance, std::size_t batch, bool concurrent) {
    SceneHandle handle;
    auto scene = std::make_shared<const RayScene>(std::move(fn), sphere_of(sphere), provenance,
                                                  batch, concurrent);
    handle.rays = scene.get();
    handle.scene = std::move(scene);
    return handle;
  });
}

}  // namespace slf::python

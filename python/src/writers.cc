// Writing fields: builds, repacks and merges; and comparing them.
#include "arrays.h"
#include "base/try.h"
#include "convert.h"
#include "fields.h"
#include "module.h"
#include "scenes.h"
#include "slf/build.h"
#include "slf/measure.h"
#include "slf/merge.h"
#include "slf/recipe.h"
#include "slf/repack.h"

namespace slf::python {
namespace {

using Scenes = std::vector<std::pair<Text, SceneHandle>>;

std::vector<FieldState> states_of(const Scenes& scenes) {
  std::vector<FieldState> states;
  for (const auto& [name, handle] : scenes)
    states.push_back({name, handle.scene.get(), handle.recipe});
  return states;
}

py::object build(const Recipe& recipe, const Scenes& scenes, const Text& path, py::object progress,
                 const py::kwargs& given) {
  BuildOptions how;
  std::pair<std::uint32_t, std::uint32_t> shard(1, 1);
  std::array<std::optional<unsigned>, 2> levels;
  Text coarser;
  read(given, "memory", how.memory, "threads", how.threads, "commit_every", how.commit_seconds,
       "force", how.replace, "shard", shard, "only_levels", levels, "coarser", coarser);
  how.shard = {shard.first, shard.second, levels[0], levels[1], coarser};
  LongCall call(std::move(progress));
  const auto states = states_of(scenes);
  auto built = scenes.front().second.trace(call, [&]() -> Result<BuildReport> {
    auto options = SLF_TRY(field_options(recipe, states));
    options.memory = how.memory;
    options.threads = how.threads;
    options.commit_seconds = how.commit_seconds;
    options.replace = how.replace;
    options.shard = how.shard;
    return build_field(states, path, options, call.progress());
  });
  for (const auto& [name, handle] : scenes)
    if (handle.rays) handle.rays->rethrow();
  return python_of(value_of(std::move(built), path));
}

py::object repack(const std::vector<std::pair<const OpenField*, Texts>>& fields, const Text& path,
                  py::object progress, const py::kwargs& given) {
  RepackOptions options;
  read(given, "codec", options.codec, "depth", options.depth, "finest_level", options.finest_level,
       "subfields", options.subfields, "half", options.half, "light", options.light, "reveal",
       options.reveal, "memory", options.memory, "threads", options.threads, "force",
       options.replace);
  std::vector<StateSource> states;
  for (const auto& [open, names] : fields)
    for (StateSource& state : value_of(
             state_sources(open->field(), std::vector<std::string>(names.begin(), names.end()))))
      states.push_back(std::move(state));
  LongCall call(std::move(progress));
  return python_of(
      call.value(path, [&] { return join_states(states, path, options, call.progress()); }));
}

py::object merge(const Texts& parts, const Text& path, py::object progress,
                 const py::kwargs& given) {
  MergeOptions options;
  read(given, "memory", options.memory, "threads", options.threads, "part", options.part, "force",
       options.replace);
  LongCall call(std::move(progress));
  return python_of(call.value(path, [&] {
    return merge_fields({parts.begin(), parts.end()}, path, options, call.progress());
  }));
}

py::object diff(const OpenField& a, const OpenField& b, unsigned threads, bool all_states,
                py::object progress) {
  LongCall call(std::move(progress));
  return python_of(value_of(call.without_gil([&] {
    return diff_fields(a.field(), b.field(), {threads, all_states}, call.progress());
  })));
}

py::object evaluate(OpenField& open, const SceneHandle& handle, const CameraTuples& cameras,
                    const SizeTuple& size, double distance, const std::optional<std::string>& mode,
                    std::optional<unsigned> level, std::uint32_t supersample,
                    const PlaneTuples& clip, const std::string& cap, py::object progress) {
  EvaluateOptions options{cameras_of(open.field().shape().sphere, cameras, size, distance)};
  options.view.mode = mode ? value_of(parse_render_mode(*mode)) : default_mode(open.field());
  options.view.level = level.value_or(kMatchingLevel);
  options.renderer = open.options();
  options.supersample = supersample;
  LongCall call(std::move(progress));
  return python_of(value_of(handle.trace(call,
                                         [&]() -> Result<Evaluation> {
                                           SLF_TRY(open.cut(options.view, planes_of(clip), cap));
                                           return evaluate_views(open.field(), *handle.scene,
                                                                 options, call.progress());
                                         }),
                            open.field().path()));
}

}  // namespace

void bind_writers(py::module_& module) {
  module.def("build", build);
  module.def("add_reveal", [](const Text& path, const Recipe& recipe) {
    LongCall call;
    call.value(path, [&] { return add_reveal(path, recipe); });
  });
  module.def("sphere_of", [](const Recipe& recipe, const Scenes& scenes) {
    return tuple_of(sphere_of(recipe, bounds_of(states_of(scenes))));
  });
  module.def("repack", repack);
  module.def("merge", merge);
  module.def("diff", diff);
  module.def("evaluate", evaluate);
}

}  // namespace slf::python

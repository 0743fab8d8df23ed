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

using Levels = std::array<std::optional<unsigned>, 2>;

using Scenes = std::vector<std::pair<Text, SceneHandle>>;

std::vector<FieldState> states_of(const Scenes& scenes) {
  std::vector<FieldState> states;
  for (const auto& [name, handle] : scenes)
    states.push_back({name, handle.scene.get(), handle.recipe});
  return states;
}

py::object build(const Recipe& recipe, const Scenes& scenes, const Text& path, std::uint64_t memory,
                 unsigned threads, double commit_seconds, bool force,
                 const std::pair<std::uint32_t, std::uint32_t>& shard, const Levels& only_levels,
                 const Text& coarser, py::object progress) {
  LongCall call(std::move(progress));
  const auto states = states_of(scenes);
  auto built = scenes.front().second.trace(call, [&]() -> Result<BuildReport> {
    auto options = SLF_TRY(field_options(recipe, states));
    options.memory = memory;
    options.threads = threads;
    options.commit_seconds = commit_seconds;
    options.replace = force;
    options.shard = {shard.first, shard.second, only_levels[0], only_levels[1], coarser};
    return build_field(states, path, options, call.progress());
  });
  for (const auto& [name, handle] : scenes)
    if (handle.rays) handle.rays->rethrow();
  return python_of(value_of(std::move(built), path));
}

py::object repack(const std::vector<std::pair<const OpenField*, Texts>>& fields, const Text& path,
                  const std::string& codec, bool depth, std::optional<unsigned> levels,
                  const std::vector<std::uint8_t>& subfields, std::optional<bool> half, bool light,
                  bool reveal, std::uint64_t memory, unsigned threads, bool replace,
                  py::object progress) {
  const RepackOptions options{codec, depth,  levels, subfields, half,
                              light, reveal, memory, threads,   replace};
  std::vector<StateSource> states;
  for (const auto& [open, names] : fields)
    for (StateSource& state : value_of(
             state_sources(open->field(), std::vector<std::string>(names.begin(), names.end()))))
      states.push_back(std::move(state));
  LongCall call(std::move(progress));
  return python_of(
      call.value(path, [&] { return join_states(states, path, options, call.progress()); }));
}

py::object merge(const Texts& parts, const Text& path, bool part, std::uint64_t memory,
                 unsigned threads, bool replace, py::object progress) {
  const MergeOptions options{memory, threads, part, replace};
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

py::object evaluate(const OpenField& open, const SceneHandle& handle,
                    const std::vector<CameraTuple>& cameras, const std::optional<std::string>& mode,
                    std::optional<unsigned> level, std::uint32_t supersample, py::object progress) {
  EvaluateOptions options{cameras_of(cameras)};
  options.view.mode = mode ? value_of(parse_render_mode(*mode)) : default_mode(open.field());
  options.view.level = level.value_or(kMatchingLevel);
  options.renderer = open.options();
  options.supersample = supersample;
  LongCall call(std::move(progress));
  return python_of(value_of(handle.trace(call,
                                         [&] {
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
  module.def("bounds_of", [](const Scenes& s) { return tuple_of(bounds_of(states_of(s))); });
  module.def("repack", repack);
  module.def("merge", merge);
  module.def("diff", diff);
  module.def("evaluate", evaluate);
}

}  // namespace slf::python

#include "slf/raycaster.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>
#include <shared_mutex>
#include <stdexcept>
#include <string_view>
#include <vector>

#include "base/file.h"
#include "base/parallel.h"
#include "base/try.h"
#include "source/light/light_code.h"
#include "source/light/light_depth.h"
#include "source/light/light_volume.h"
#include "source/medium/visible_space.h"
#include "source/raycast/light_on_demand.h"
#include "source/raycast/prepared_volume.h"
#include "source/raycast/provenance.h"

namespace slf {

/// A scene with its light volume. It begins with a pending one and ends with a complete one, by
/// adopt(); under direct light it has neither. Legal are:
///
///            | pending | on_demand                     | light
///   direct   | none    | null                          | null
///   pending  | set     | null, or set by the first ray | null
///   complete | none    | null                          | all nodes
///
/// Light is computed of all of `scene`. If rays see a part of that, or it shares another light, it
/// is computed as a whole: `on_demand` is null.
struct LitScene {
  std::shared_ptr<PreparedVolume> scene;
  std::optional<LightVolumeOptions> pending;   // until the light volume is computed
  bool hidden;                                 // rays see parts of it alone: it serves the light
  std::mutex preparing{};                      // guards all, and shown->grid of scenes
  std::shared_ptr<LightGrid> light{};          // null: none, or pending
  std::unique_ptr<LightOnDemand> on_demand{};  // while pending, once rays need light
  std::shared_ptr<const Raycaster> from{};     // whose light this one shares; or null

  void adopt(LightGrid made, const Medium& medium) {
    assert(pending && !(on_demand && (hidden || from)));
    light = std::make_shared<LightGrid>(std::move(made));
    if (!hidden) {
      scene->grid.light_volume = light;
      scene->grid.table.albedos = medium.albedos();
    } else if (scene.use_count() == 1) {
      scene->grid = {};
    }
    pending.reset();
    on_demand.reset();
  }
};

struct Raycaster::State {
  std::shared_ptr<LitScene> lit;
  std::unique_ptr<PreparedVolume> shown;  // what of it rays see; null: all
  std::optional<ToneMapper> tone;         // none: samples are not mapped

  [[nodiscard]] const PreparedVolume& seen() const { return shown ? *shown : *lit->scene; }

  /// Null: the light volume is complete, or there is none.
  [[nodiscard]] Result<LightOnDemand*> light_on_demand() {
    if (!lit->pending) return nullptr;
    assert(!shown && !lit->from);
    const std::lock_guard lock(lit->preparing);
    if (lit->on_demand) return lit->on_demand.get();
    auto made = std::make_unique<LightOnDemand>(*lit->scene, lit->pending->threads);
    SLF_TRY(made->prepare());
    lit->on_demand = std::move(made);
    return lit->on_demand.get();
  }
};

namespace {

/// usage: `path` exists and is no light volume, so it must not be replaced by one.
Result<void> check_light_file(const std::string& path) {
  constexpr const char* kWhat = "a light volume";
  if (check_own_file(path, "slf light v", kWhat)) return {};  // of earlier versions
  return check_own_file(path, kLightMagic, kWhat);
}

/// The light volume in a file; nothing if there is none, or that of another scene.
std::optional<LightGrid> saved_light(const std::string& path, const std::string& key,
                                     LightGrid plan) {
  // Not a byte more of a file that is something else: it may be large.
  const auto is_light = [](ByteSpan start) -> Result<void> {
    if (chars_of(start).starts_with(kLightMagic)) return {};
    return fail(ErrorCode::bad_file, "no light volume");
  };
  const auto bytes = read_file(path, std::uint64_t{1} << 40, is_light);
  if (!bytes) return std::nullopt;
  return decode_light(*bytes, key, std::move(plan));
}

/// The light volume of a scene, read from options.file if that has it, else computed.
Result<LightGrid> light_of(const PreparedVolume& scene, const Medium& medium,
                           const LightVolumeOptions& options) {
  const std::string key = light_key(scene.provenance);
  if (!options.file.empty())
    if (auto saved = saved_light(options.file, key, plan_of(scene))) return std::move(*saved);
  auto light = compute_light(medium, illuminate(scene.lighting, scene.bounds), scene.lighting,
                             options.threads, options.progress);
  if (light && !options.file.empty()) {
    SLF_TRY(check_light_file(options.file));
    const Bytes coded = encode_light(key, *light);
    if (coded.empty())
      return fail(ErrorCode::out_of_memory, options.file, ": no memory to code it");
    SLF_TRY(write_file(options.file, coded));
  }
  return light;
}

using nlohmann::json;

/// What scenes with one light may differ by.
constexpr std::string_view kCuts[] = {"clip", "structures"};

/// What a provenance says of a cut. Not null if nothing: manifests store states as merge patches,
/// which would lose it.
json said_of(std::string_view cut, const json& provenance) {
  return provenance.value(std::string(cut), cut == "clip" ? json::array() : json::object());
}

/// A node has its own light, in part, from this difference of optical depths on, and whole from the
/// second one on.
constexpr float kOpened = 0.25f, kOpen = 1;
/// The same for how many times as much light reaches it straight from outside: a cavity with a
/// small hole is not deep, but dark. That much light reaches every node in other ways.
constexpr float kBrightened = 1.1f, kBright = 1.4f, kAnyway = 0.005f;

json without_cuts(const PreparedVolume& scene) {
  json key = json::parse(light_key(scene.provenance));
  for (const std::string_view cut : kCuts) key.erase(std::string(cut));
  return key;
}

/// Whether it has no light.
bool dark(const std::uint8_t* node) { return node[kChannels] == 0; }

void blend(std::uint8_t* node, const std::uint8_t* own, float share) {
  if (dark(own)) return;
  if (share >= 1 || dark(node))
    std::copy_n(own, LightGrid::kNodeBytes, node);
  else
    pack_light(((1 - share) * unpack_light(node)) += share * unpack_light(own), node);
}

/// usage: `scene` cannot have the light of `from`, because they differ by more than planes that
/// clip, structures, the step and the tone, or `scene` shows matter outside of the box of that
/// light.
Result<void> check_shared_light(const PreparedVolume& scene, const PreparedVolume& from) {
  const json difference = json::diff(without_cuts(from), without_cuts(scene));
  if (!difference.empty())
    return fail(ErrorCode::usage, "scenes of one light differ only by what is cut away, but ",
                difference[0]["path"].get<std::string>(), " differs");
  if (glm::any(glm::lessThan(scene.grid.visible_low, from.grid.visible_low)) ||
      glm::any(glm::greaterThan(scene.grid.visible_high, from.grid.visible_high)))
    return fail(ErrorCode::usage, "what is visible reaches out of the box of the other light");
  return {};
}

/// The provenance of a scene that has the light of another one: its member `light_of` has the
/// members that the provenance of the other has otherwise.
std::string with_light_of(const std::string& provenance, const std::string& from) {
  json own = json::parse(provenance);
  const json other = json::parse(from);
  json& members = own["light_of"] = json::object();
  for (const std::string_view cut : kCuts)
    if (const json theirs = said_of(cut, other); theirs != said_of(cut, own))
      members[std::string(cut)] = theirs;
  return own.dump();
}

/// `lit`, the light volume of `from`, for `scene`. Nodes that `scene` lays open, which lie less
/// deep below what can be seen than in `from`, get the light of `scene` itself: where that is not
/// so, they would be black. In between, both are blended. All others keep their bytes. REQUIRES:
/// check_shared_light(). Errors as LightComputer.
Result<LightGrid> shared_light(const LightGrid& lit, const PreparedVolume& from,
                               const PreparedVolume& scene, const Medium& medium, unsigned threads,
                               const ProgressCallback& progress) {
  const Illumination illumination = illuminate(from.lighting, from.bounds);
  LightComputer computer(medium, illumination, scene.lighting,
                         plan_light(from.grid, illumination, from.lighting), threads);
  SLF_TRY(computer.prepare());
  const Medium before(from.grid);
  const auto extinctions = SLF_TRY(node_extinctions(before, lit, threads));
  const auto depth = depth_from_outside(before, lit, extinctions);
  const auto open_before = openness(before, lit, extinctions);
  const auto extinctions_now = SLF_TRY(node_extinctions(medium, lit, threads));
  const auto open_now = openness(medium, lit, extinctions_now);
  const auto share = [&](std::size_t number) {
    const float opened = std::min(depth[number], kHidden) - computer.depth()[number];
    const float brighter = (open_now[number] + kAnyway) / (open_before[number] + kAnyway);
    return std::clamp(std::max((opened - kOpened) / (kOpen - kOpened),
                               (brighter - kBrightened) / (kBright - kBrightened)),
                      0.f, 1.f);
  };
  LightGrid light = lit, own = computer.blank();
  std::vector<std::size_t> open = computer.nodes();
  std::erase_if(open, [&](std::size_t number) { return share(number) == 0; });
  // Rays see nothing between nodes of which one is dark.
  open = computer.spread(std::move(open), 1);
  std::erase_if(
      open, [&](std::size_t number) { return share(number) == 0 && !dark(light.node(number)); });
  SLF_TRY(computer.compute(own, open, progress));
  for (const std::size_t number : open) blend(light.node(number), own.node(number), share(number));
  return light;
}

}  // namespace

Raycaster::Raycaster(std::unique_ptr<State> state) : state_(std::move(state)) {}
Raycaster::~Raycaster() = default;

Result<std::unique_ptr<Raycaster>> Raycaster::make(Volume volume, const TransferFunction& transfer,
                                                   const RaycastOptions& options,
                                                   const LightVolumeOptions& light_volume) try {
  const LightOptions& lighting = options.lighting;
  const bool lit = lighting.mode != Lighting::direct;
  if (lit && !light_volume.file.empty()) SLF_TRY(check_light_file(light_volume.file));
  std::unique_ptr<PreparedVolume> shown;
  RaycastOptions all = options;
  std::shared_ptr<LitScene> own;
  std::shared_ptr<LitScene>* scene = &own;
  if (!options.parts.only.empty()) {
    volume.share();
    shown = SLF_TRY(prepare_volume(volume, transfer, options, light_volume.threads));
    all.parts.only.clear();
    if (options.shared)
      scene = &options.shared->lit[describe(volume, transfer, all) + light_volume.file];
  }
  if (!*scene) {
    auto made = SLF_TRY(prepare_volume(std::move(volume), transfer, all, light_volume.threads));
    *scene = std::shared_ptr<LitScene>(new LitScene{
        std::move(made), lit ? std::optional(light_volume) : std::nullopt, shown != nullptr});
    if (!lit && shown) (*scene)->scene->grid = {};
  }
  auto caster = std::unique_ptr<Raycaster>(new Raycaster(std::unique_ptr<State>(new State{
      *scene, std::move(shown),
      lit && !lighting.linear ? std::optional<ToneMapper>(lighting.tone) : std::nullopt})));
  if (!light_volume.deferred) SLF_TRY(caster->prepare());
  return caster;
} catch (...) {
  return tl::unexpected(error_of_exception());
}

Result<void> Raycaster::prepare() const try {
  LitScene& lit = *state_->lit;
  const std::lock_guard lock(lit.preparing);
  if (lit.pending) {
    const LightVolumeOptions& options = *lit.pending;
    const Medium medium(lit.scene->grid, options.threads);
    if (lit.from) SLF_TRY(lit.from->prepare());
    auto light = SLF_TRY(lit.from ? shared_light(*lit.from->state_->lit->light,
                                                 *lit.from->state_->lit->scene, *lit.scene, medium,
                                                 options.threads, options.progress)
                                  : light_of(*lit.scene, medium, options));
    lit.adopt(std::move(light), medium);
  }
  if (PreparedVolume* shown = state_->shown.get(); shown && shown->grid.light_volume != lit.light) {
    shown->grid.table.albedos = Medium(shown->grid).albedos();
    shown->grid.light_volume = lit.light;
  }
  return {};
} catch (...) {
  return tl::unexpected(error_of_exception());
}

Result<void> Raycaster::share_light(std::shared_ptr<const Scene> from) const try {
  const std::shared_ptr<LitScene> lit = state_->lit;
  const std::lock_guard lock(lit->preparing);
  auto source = std::dynamic_pointer_cast<const Raycaster>(std::move(from));
  if (!lit->pending || !source || !(source->state_->lit->pending || source->state_->lit->light))
    return Scene::share_light(source);
  if (source->state_->lit->from)
    return fail(ErrorCode::usage, "the other scene has the light of a third: name that one");
  if (source->state_->shown)
    return fail(ErrorCode::usage, "the other scene shows just some labels");
  SLF_TRY(check_shared_light(*lit->scene, *source->state_->lit->scene));
  PreparedVolume* const shown = state_->shown.get();
  std::string& provenance = (shown ? shown : lit->scene.get())->provenance;
  provenance = with_light_of(provenance, source->provenance());
  // Scenes of other labels keep their light.
  if (shown) state_->lit.reset(new LitScene{lit->scene, lit->pending, true});
  state_->lit->from = std::move(source);
  return {};
} catch (...) {
  return tl::unexpected(error_of_exception());
}

std::vector<std::byte> Raycaster::light() const {
  const LitScene& lit = *state_->lit;
  if (lit.from) return lit.from->light();
  if (!lit.light) return {};
  return encode_light(light_key(lit.scene->provenance), *lit.light);
}

Result<void> Raycaster::prepare_for(const SomeRays& some_rays) const try {
  const auto& pending = state_->lit->pending;
  if (pending && (state_->shown || state_->lit->from || !pending->file.empty())) return prepare();
  LightOnDemand* light = SLF_TRY(state_->light_on_demand());
  if (light == nullptr) return {};
  const std::vector<Segment> rays = some_rays();
  constexpr std::size_t kRays = 256;
  SLF_TRY(parallel_for((rays.size() + kRays - 1) / kRays, pending->threads, [&](std::uint64_t k) {
    std::array<RaySample, kRays> samples;
    RayCounts counts;
    const std::size_t begin = k * kRays;
    const auto some = std::span(rays).subspan(begin, std::min(kRays, rays.size() - begin));
    light->trace(some, std::span(samples).first(some.size()), counts);
  }));
  return light->compute_missed(pending->progress);
} catch (...) {
  return tl::unexpected(error_of_exception());
}

bool Raycaster::set_light(std::span<const std::byte> light) const {
  LitScene& lit = *state_->lit;
  const std::lock_guard lock(lit.preparing);
  if (lit.from) return lit.from->set_light(light);
  if (!lit.pending) return false;
  auto decoded = decode_light(light, light_key(lit.scene->provenance), plan_of(*lit.scene));
  if (!decoded) return false;
  lit.adopt(std::move(*decoded), Medium(lit.scene->grid));
  return true;
}

Sphere Raycaster::bounds() const { return state_->lit->scene->bounds; }

double Raycaster::reach(const glm::dvec3& from) const {
  return find_reach(state_->lit->scene->volume, state_->seen().grid, from);
}

RaySample Raycaster::trace(const glm::dvec3& from, const glm::dvec3& to) const {
  const Segment ray{from, to};
  RaySample sample;
  trace_counted({&ray, 1}, {&sample, 1});
  return sample;
}

void Raycaster::trace_many(std::span<const Segment> rays, std::span<RaySample> out) const {
  trace_counted(rays, out);
}

RayCounts Raycaster::trace_counted(std::span<const Segment> rays, std::span<RaySample> out) const {
  assert(rays.size() == out.size());
  RayCounts counts;
  if (state_->shown || state_->lit->from)
    if (auto ok = prepare(); !ok) throw std::runtime_error(ok.error().message);
  const auto light = state_->light_on_demand();
  Result<void> ok = light ? Result<void>{} : tl::unexpected(light.error());
  if (ok && *light == nullptr)
    counts = trace_rays(state_->seen().grid, rays, out);
  else
    while (ok && !(*light)->trace(rays, out, counts)) ok = (*light)->compute_missed({});
  if (!ok) throw std::runtime_error(ok.error().message);
  if (state_->tone)
    for (RaySample& sample : out) sample.rgba = (*state_->tone)(sample.rgba);
  return counts;
}

const PreparedVolume& Raycaster::prepared() const { return state_->seen(); }
std::string Raycaster::provenance() const { return state_->seen().provenance; }
std::vector<std::string> Raycaster::files() const {
  std::vector<std::string> files = state_->lit->scene->volume.files;
  const std::lock_guard lock(state_->lit->preparing);
  if (state_->lit->pending) files.push_back(state_->lit->pending->file);  // it will be written
  return files;
}

}  // namespace slf

#include "slf/raycaster.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <mutex>
#include <optional>
#include <shared_mutex>
#include <stdexcept>
#include <string_view>

#include "base/file.h"
#include "base/parallel.h"
#include "base/try.h"
#include "field/scene/light_code.h"
#include "field/scene/light_volume.h"
#include "field/scene/provenance.h"
#include "field/scene/raycaster_space.h"
#include "field/scene/shared_light.h"
#include "field/scene/volume_scene.h"

namespace slf {

namespace {

LightGrid plan_of(const VolumeScene& scene) {
  return plan_light(scene.grid, illuminate(scene.lighting, scene.bounds), scene.lighting);
}

/// The light volume of a scene, of which nodes are computed when rays need them.
class LightOnDemand {
 public:
  LightOnDemand(VolumeScene& scene, unsigned threads)
      : scene_(scene),
        medium_(scene.grid),
        illumination_(illuminate(scene.lighting, scene.bounds)),
        computer_(medium_, illumination_, scene.lighting, plan_of(scene), threads) {}

  [[nodiscard]] Result<void> prepare() {
    SLF_TRY(computer_.prepare());
    missed_.emplace(computer_.blank().size());
    LightGrid light = computer_.blank();
    light.missed = &*missed_;
    scene_.grid.light_volume = std::move(light);
    scene_.grid.table.albedos = medium_.albedos();
    return {};
  }

  /// Whether the light of all these rays was known.
  bool trace(std::span<const Segment> rays, std::span<RaySample> out, RayCounts& counts) {
    const std::shared_lock lock(mutex_);
    counts = trace_rays(scene_.grid, rays, out);
    return !missed_->any();
  }

  /// Computes what rays missed, and the nodes around: near rays will need them.
  [[nodiscard]] Result<void> compute_missed(const ProgressCallback& progress) {
    const std::lock_guard lock(mutex_);
    if (!missed_->any()) return {};
    return computer_.compute(scene_.grid.light_volume, computer_.spread(missed_->take(), 1),
                             progress);
  }

 private:
  VolumeScene& scene_;
  const Medium medium_;
  const Illumination illumination_;
  LightComputer computer_;
  std::optional<MissedNodes> missed_;
  std::shared_mutex mutex_;  // of the light: read while rays are traced
};

}  // namespace

struct Raycaster::State {
  std::unique_ptr<VolumeScene> scene;  // with its light
  std::unique_ptr<VolumeScene> shown;  // what of it rays see; null: all
  ToneMapper tone;
  bool mapped;                                      // whether samples are tone-mapped
  std::optional<LightVolumeOptions> pending_light;  // until the light volume is computed
  std::mutex preparing{};                           // guards pending_light, and adopt()
  std::unique_ptr<LightOnDemand> on_demand{};       // while pending, once rays need light
  std::shared_ptr<const Raycaster> light_from{};    // whose light this scene shares; or null

  void adopt(LightGrid light, const Medium& medium) {
    traced().light_volume = std::move(light);
    traced().table.albedos = shown ? Medium(shown->grid).albedos() : medium.albedos();
    if (shown) scene->grid = {};  // served the light alone
    pending_light.reset();
    on_demand.reset();
  }

  [[nodiscard]] RayGrid& traced() const { return shown ? shown->grid : scene->grid; }

  /// Null: the light volume is complete, or there is none.
  [[nodiscard]] Result<LightOnDemand*> light_on_demand() {
    if (!pending_light) return nullptr;
    const std::lock_guard lock(preparing);
    if (on_demand) return on_demand.get();
    auto made = std::make_unique<LightOnDemand>(*scene, pending_light->threads);
    SLF_TRY(made->prepare());
    on_demand = std::move(made);
    return on_demand.get();
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
Result<LightGrid> light_of(const VolumeScene& scene, const Medium& medium,
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

}  // namespace

Raycaster::Raycaster(std::unique_ptr<State> state) : state_(std::move(state)) {}
Raycaster::~Raycaster() = default;

Result<std::unique_ptr<Raycaster>> Raycaster::make(Volume volume, const TransferFunction& transfer,
                                                   const RaycastOptions& options,
                                                   const LightVolumeOptions& light_volume) {
  const LightOptions& lighting = options.lighting;
  const bool lit = lighting.mode != Lighting::direct;
  if (lit && !light_volume.file.empty()) SLF_TRY(check_light_file(light_volume.file));
  std::unique_ptr<VolumeScene> shown;
  RaycastOptions all = options;
  if (!options.parts.only.empty()) {
    volume.share();
    shown = SLF_TRY(make_volume_scene(volume, transfer, options));
    all.parts.only.clear();
  }
  auto scene = SLF_TRY(make_volume_scene(std::move(volume), transfer, all));
  auto caster = std::unique_ptr<Raycaster>(new Raycaster(std::unique_ptr<State>(
      new State{std::move(scene), std::move(shown), ToneMapper(lighting.tone),
                lit && !lighting.linear, lit ? std::optional(light_volume) : std::nullopt})));
  if (!lit && caster->state_->shown) caster->state_->scene->grid = {};
  if (!light_volume.deferred) SLF_TRY(caster->prepare());
  return caster;
}

Result<void> Raycaster::prepare() const {
  const std::lock_guard lock(state_->preparing);
  if (!state_->pending_light) return {};
  const VolumeScene& scene = *state_->scene;
  const LightVolumeOptions& options = *state_->pending_light;
  const Medium medium(scene.grid);
  const Raycaster* from = state_->light_from.get();
  if (from) SLF_TRY(from->prepare());
  auto light =
      SLF_TRY(from ? shared_light(from->state_->traced().light_volume, *from->state_->scene, scene,
                                  medium, options.threads, options.progress)
                   : light_of(scene, medium, options));
  state_->adopt(std::move(light), medium);
  return {};
}

Result<void> Raycaster::share_light(std::shared_ptr<const Scene> from) const {
  const std::lock_guard lock(state_->preparing);
  auto source = std::dynamic_pointer_cast<const Raycaster>(std::move(from));
  const auto lit = [](const Raycaster& of) {
    return of.state_->pending_light || !of.state_->traced().light_volume.nodes.empty();
  };
  if (!state_->pending_light || !source || !lit(*source)) return Scene::share_light(source);
  if (source->state_->light_from)
    return fail(ErrorCode::usage, "the other scene has the light of a third: name that one");
  if (source->state_->shown)
    return fail(ErrorCode::usage, "the other scene shows just some labels");
  SLF_TRY(check_shared_light(*state_->scene, *source->state_->scene));
  std::string& provenance = (state_->shown ? state_->shown : state_->scene)->provenance;
  provenance = with_light_of(provenance, source->provenance());
  state_->light_from = std::move(source);
  return {};
}

std::vector<std::byte> Raycaster::light() const {
  if (state_->light_from) return state_->light_from->light();
  const VolumeScene& scene = *state_->scene;
  const LightGrid& light = state_->traced().light_volume;
  if (state_->pending_light || light.nodes.empty()) return {};
  return encode_light(light_key(scene.provenance), light);
}

Result<void> Raycaster::prepare_for(std::span<const Segment> rays) const {
  if (state_->pending_light &&
      (state_->shown || state_->light_from || !state_->pending_light->file.empty()))
    return prepare();
  LightOnDemand* light = SLF_TRY(state_->light_on_demand());
  if (light == nullptr) return {};
  constexpr std::size_t kRays = 256;
  const LightVolumeOptions& options = *state_->pending_light;
  SLF_TRY(parallel_for((rays.size() + kRays - 1) / kRays, options.threads, [&](std::uint64_t k) {
    std::array<RaySample, kRays> samples;
    RayCounts counts;
    const auto some = rays.subspan(k * kRays, std::min(kRays, rays.size() - k * kRays));
    light->trace(some, std::span(samples).first(some.size()), counts);
  }));
  return light->compute_missed(options.progress);
}

bool Raycaster::set_light(std::span<const std::byte> light) const {
  const std::lock_guard lock(state_->preparing);
  if (state_->light_from) return state_->light_from->set_light(light);
  if (!state_->pending_light) return false;
  const VolumeScene& scene = *state_->scene;
  auto decoded = decode_light(light, light_key(scene.provenance), plan_of(scene));
  if (!decoded) return false;
  state_->adopt(std::move(*decoded), Medium(scene.grid));
  return true;
}

Sphere Raycaster::bounds() const { return state_->scene->bounds; }

double Raycaster::reach(const glm::dvec3& from) const {
  return find_reach(state_->scene->volume, state_->scene->grid, from);
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
  if (state_->shown || state_->light_from)
    if (auto ok = prepare(); !ok) throw std::runtime_error(ok.error().message);
  const auto light = state_->light_on_demand();
  Result<void> ok = light ? Result<void>{} : tl::unexpected(light.error());
  if (ok && *light == nullptr)
    counts = trace_rays(state_->traced(), rays, out);
  else
    while (ok && !(*light)->trace(rays, out, counts)) ok = (*light)->compute_missed({});
  if (!ok) throw std::runtime_error(ok.error().message);
  if (state_->mapped)
    for (RaySample& sample : out) sample.rgba = state_->tone(sample.rgba);
  return counts;
}

std::string Raycaster::provenance() const {
  return (state_->shown ? state_->shown : state_->scene)->provenance;
}
std::vector<std::string> Raycaster::files() const { return state_->scene->volume.files; }

}  // namespace slf

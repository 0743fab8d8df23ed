#include "field/raycaster.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <type_traits>
#include <unordered_map>

#include "field/raycaster_kernel.h"

namespace slf {

struct Raycaster::State {
  Volume volume;
  RayGrid grid;
  Sphere bounds;
  nlohmann::json provenance;
};

namespace {

/// Calls f with a typed view of the voxels.
template <class F>
auto with_voxels(Volume& volume, const F& f) {
  const auto view = [&]<class T>(T) {
    return f(std::span<T>(reinterpret_cast<T*>(volume.voxels.data()), volume.voxel_count()));
  };
  switch (volume.type) {
    case ScalarType::u8:
      return view(std::uint8_t{});
    case ScalarType::i8:
      return view(std::int8_t{});
    case ScalarType::u16:
      return view(std::uint16_t{});
    case ScalarType::i16:
      return view(std::int16_t{});
    case ScalarType::u32:
      return view(std::uint32_t{});
    case ScalarType::i32:
      return view(std::int32_t{});
    case ScalarType::u64:
      return view(std::uint64_t{});
    case ScalarType::i64:
      return view(std::int64_t{});
    case ScalarType::f32:
      return view(float{});
    default:
      return view(double{});
  }
}

void convert_to_float(Volume& volume) {
  with_voxels(volume, [&](auto from) {
    std::vector<std::byte> converted(from.size() * sizeof(float));
    auto* to = reinterpret_cast<float*>(converted.data());
    for (std::size_t k = 0; k < from.size(); ++k) to[k] = static_cast<float>(from[k]);
    volume.voxels = std::move(converted);
  });
  volume.type = ScalarType::f32;
}

/// Gives each label of a volume of another type a 16-bit number; returns label by number.
Result<std::vector<double>> renumber_labels(Volume& volume) {
  std::vector<double> labels;
  const bool fits = with_voxels(volume, [&](auto from) {
    std::unordered_map<double, std::uint16_t> numbers;
    std::vector<std::byte> converted(from.size() * sizeof(std::uint16_t));
    auto* to = reinterpret_cast<std::uint16_t*>(converted.data());
    for (std::size_t k = 0; k < from.size(); ++k) {
      const auto label = static_cast<double>(from[k]);
      const auto [it, added] =
          numbers.try_emplace(label, static_cast<std::uint16_t>(numbers.size()));
      if (added && labels.size() == 65536) return false;
      if (added) labels.push_back(label);
      to[k] = it->second;
    }
    volume.voxels = std::move(converted);
    return true;
  });
  if (!fits)
    return fail(ErrorCode::unsupported, volume.source,
                ": more than 65536 different labels; is this a label volume?");
  volume.type = ScalarType::u16;
  return labels;
}

std::array<float, 2> stored_range(Volume& volume) {
  return with_voxels(volume, [](auto voxels) {
    float low = std::numeric_limits<float>::max();
    float high = std::numeric_limits<float>::lowest();
    for (const auto voxel : voxels) {
      const auto value = static_cast<float>(voxel);
      if (!std::isfinite(value)) continue;
      low = std::min(low, value);
      high = std::max(high, value);
    }
    return low <= high ? std::array{low, high} : std::array{0.f, 0.f};
  });
}

/// Not-a-number and infinities have no place in interpolation: they become the least value.
void replace_nonfinite(Volume& volume, float with) {
  if (volume.type != ScalarType::f32) return;
  with_voxels(volume, [&](auto voxels) {
    for (auto& voxel : voxels)
      if (!std::isfinite(static_cast<double>(voxel)))
        voxel = static_cast<std::remove_reference_t<decltype(voxel)>>(with);
  });
}

glm::vec4 table_entry(const TransferFunction& transfer, double value, double steps_per_unit) {
  glm::dvec4 entry = transfer(value);
  entry.a = 1 - std::pow(1 - std::clamp(entry.a, 0.0, 1.0), steps_per_unit);
  return glm::vec4(entry);
}

/// The least gap between neighbouring points of the function: what a table has to resolve.
double least_gap(const TransferFunction& transfer) {
  double gap = std::numeric_limits<double>::max();
  const auto measure = [&](const auto& points) {
    for (std::size_t k = 1; k < points.size(); ++k)
      if (const double g = points[k].value - points[k - 1].value; g > 0) gap = std::min(gap, g);
  };
  measure(transfer.colors);
  measure(transfer.opacities);
  return gap;
}

TransferTable make_table(const TransferFunction& transfer, const Volume& volume,
                         std::array<float, 2> range, double steps_per_unit) {
  constexpr int kMost = 1 << 16;
  TransferTable table;
  const auto [low, high] = range;
  table.low = low;
  const double width = std::max(double{high} - low, 1e-30);
  // Sixteen entries for the narrowest ramp, and at least four for each integer value.
  const double wanted = 16 * width * std::abs(volume.slope) / least_gap(transfer);
  const bool integers = volume.type != ScalarType::f32;
  const auto add = [&](double stored) {
    table.entries.push_back(
        table_entry(transfer, volume.slope * stored + volume.intercept, steps_per_unit));
  };
  if (integers || wanted <= kMost) {
    const int size = static_cast<int>(
        std::clamp(std::max(wanted, integers ? 4 * width : 0.0), 1024.0, double{kMost}));
    table.scale = static_cast<float>((size - 1) / width);
    for (int k = 0; k < size; ++k) add(low + width * k / (size - 1));
    return table;
  }
  table.logarithmic = true;
  table.low_key = ordered_bits(low);
  const std::int64_t keys = std::int64_t{ordered_bits(high)} - table.low_key;
  while ((keys >> table.shift) >= kMost) ++table.shift;
  for (std::int64_t k = 0; k <= keys >> table.shift; ++k) {
    const std::int64_t key =
        table.low_key +
        std::min(keys, (k << table.shift) + ((std::int64_t{1} << table.shift) >> 1));
    const auto ordered = static_cast<std::int32_t>(key);
    add(std::bit_cast<float>(ordered >= 0 ? ordered
                                          : std::numeric_limits<std::int32_t>::min() - ordered));
  }
  return table;
}

TransferTable make_label_table(const TransferFunction& transfer, const Volume& volume,
                               const std::vector<double>& labels, double steps_per_unit) {
  TransferTable table;
  for (const double label : labels)
    table.entries.push_back(
        table_entry(transfer, volume.slope * label + volume.intercept, steps_per_unit));
  return table;
}

/// Marks each brick whose cells can show something: 0 there, 255 elsewhere.
std::vector<std::uint8_t> find_visible_bricks(Volume& volume, const RayGrid& grid) {
  // nonzero[k]: how many of the first k entries are visible.
  std::vector<std::uint32_t> nonzero(grid.table.entries.size() + 1, 0);
  for (std::size_t k = 0; k < grid.table.entries.size(); ++k)
    nonzero[k + 1] = nonzero[k] + (grid.table.entries[k].a > 0 ? 1 : 0);
  const auto last = static_cast<std::int64_t>(grid.table.entries.size()) - 1;

  std::vector<std::uint8_t> bricks(
      static_cast<std::size_t>(grid.bricks[0]) * grid.bricks[1] * grid.bricks[2], 255);
  with_voxels(volume, [&](auto voxels) {
    using T = typename decltype(voxels)::value_type;
    std::size_t b = 0;
    for (int bz = 0; bz < grid.bricks[2]; ++bz)
      for (int by = 0; by < grid.bricks[1]; ++by)
        for (int bx = 0; bx < grid.bricks[0]; ++bx, ++b) {
          const int x0 = bx << kBrickShift, y0 = by << kBrickShift, z0 = bz << kBrickShift;
          const int x1 = std::min(x0 + kBrick, grid.dims[0] - 1);
          const int y1 = std::min(y0 + kBrick, grid.dims[1] - 1);
          const int z1 = std::min(z0 + kBrick, grid.dims[2] - 1);
          T low = std::numeric_limits<T>::max(), high = std::numeric_limits<T>::lowest();
          bool labelled = false;
          for (int z = z0; z <= z1; ++z)
            for (int y = y0; y <= y1; ++y)
              for (int x = x0; x <= x1; ++x) {
                const T v =
                    voxels[(static_cast<std::size_t>(z) * grid.dims[1] + y) * grid.dims[0] + x];
                low = std::min(low, v);
                high = std::max(high, v);
                if (grid.labels) {
                  const auto entry = static_cast<std::int64_t>(v);
                  labelled |=
                      entry <= last && grid.table.entries[static_cast<std::size_t>(entry)].a > 0;
                }
              }
          if (grid.labels) {
            if (labelled) bricks[b] = 0;
            continue;
          }
          const auto index = [&](T v) -> std::int64_t {
            const auto value = static_cast<float>(v);
            if (grid.table.logarithmic)
              return (std::int64_t{ordered_bits(value)} - grid.table.low_key) >> grid.table.shift;
            return static_cast<std::int64_t>((value - grid.table.low) * grid.table.scale + 0.5f);
          };
          // One entry wider on each side than rounding could ever reach.
          const std::int64_t from = std::clamp<std::int64_t>(index(low) - 1, 0, last);
          const std::int64_t to = std::clamp<std::int64_t>(index(high) + 1, 0, last);
          if (nonzero[static_cast<std::size_t>(to) + 1] > nonzero[static_cast<std::size_t>(from)])
            bricks[b] = 0;
        }
  });
  return bricks;
}

/// Chebyshev distance to the nearest brick that is 0, capped at 255: the separable maximum of
/// distances, found by two sweeps of the 3×3×3 neighbourhood.
void spread_distance(std::vector<std::uint8_t>& bricks, const std::array<std::int32_t, 3>& size) {
  const auto [nx, ny, nz] = size;
  const auto at = [&](int x, int y, int z) -> std::uint8_t& {
    return bricks[(static_cast<std::size_t>(z) * ny + y) * nx + x];
  };
  const auto relax = [&](int x, int y, int z, int sign) {
    int best = at(x, y, z);
    for (int k = 0; k < 13; ++k) {  // the half of the neighbourhood already swept
      const int dx = k % 3 - 1, dy = k / 3 % 3 - 1, dz = k / 9 - 1;
      const int qx = x + sign * dx, qy = y + sign * dy, qz = z + sign * dz;
      if (qx < 0 || qy < 0 || qz < 0 || qx >= nx || qy >= ny || qz >= nz) continue;
      best = std::min(best, at(qx, qy, qz) + 1);
    }
    at(x, y, z) = static_cast<std::uint8_t>(best);
  };
  for (int z = 0; z < nz; ++z)
    for (int y = 0; y < ny; ++y)
      for (int x = 0; x < nx; ++x) relax(x, y, z, 1);
  for (int z = nz; z-- > 0;)
    for (int y = ny; y-- > 0;)
      for (int x = nx; x-- > 0;) relax(x, y, z, -1);
}

/// The box of visible bricks, in voxel indices; false when there are none.
bool find_visible_box(RayGrid& grid) {
  glm::dvec3 low(std::numeric_limits<double>::max()), high(-1);
  std::size_t b = 0;
  for (int z = 0; z < grid.bricks[2]; ++z)
    for (int y = 0; y < grid.bricks[1]; ++y)
      for (int x = 0; x < grid.bricks[0]; ++x, ++b)
        if (grid.distance[b] == 0) {
          low = glm::min(low, glm::dvec3(x, y, z) * double{kBrick});
          high = glm::max(high, glm::dvec3(x + 1, y + 1, z + 1) * double{kBrick});
        }
  if (high.x < 0) return false;
  const glm::dvec3 end(grid.dims[0] - 1, grid.dims[1] - 1, grid.dims[2] - 1);
  grid.visible_low = low;
  grid.visible_high = glm::min(high, end);
  return true;
}

/// A sphere around the corners of all visible bricks: the centre of their box, then the farthest.
Sphere find_bounds(const RayGrid& grid, const Volume& volume) {
  const auto world = [&](const glm::dvec3& index) { return volume.origin + volume.axes * index; };
  Sphere sphere{world((grid.visible_low + grid.visible_high) / 2.0), 0};
  std::size_t b = 0;
  for (int z = 0; z < grid.bricks[2]; ++z)
    for (int y = 0; y < grid.bricks[1]; ++y)
      for (int x = 0; x < grid.bricks[0]; ++x, ++b) {
        if (grid.distance[b] != 0) continue;
        for (int corner = 0; corner < 8; ++corner) {
          const glm::dvec3 index =
              glm::dvec3(x + (corner & 1), y + (corner >> 1 & 1), z + (corner >> 2)) *
              double{kBrick};
          sphere.radius =
              std::max(sphere.radius,
                       glm::distance(sphere.center, world(glm::min(index, grid.visible_high))));
        }
      }
  sphere.radius *= 1.001;
  return sphere;
}

Result<void> check_options(const RaycastOptions& options) {
  if (!(options.step > 0.01 && options.step <= 100))
    return fail(ErrorCode::usage, "step ", options.step, ": expected 0.01 to 100 voxels");
  const double light = glm::length(options.light);
  if (!(light > 0) || !std::isfinite(light))
    return fail(ErrorCode::usage, "light: expected a direction, not zero and finite");
  if (!(options.ambient >= 0 && options.ambient <= 1))
    return fail(ErrorCode::usage, "ambient ", options.ambient, ": expected 0 to 1");
  return {};
}

nlohmann::json describe(const Volume& volume, const TransferFunction& transfer,
                        const RaycastOptions& options) {
  return {{"kind", "volume"},
          {"source", volume.source},
          {"dims", volume.dims},
          {"type", name(volume.type)},
          {"labels", volume.labels},
          {"origin", {volume.origin.x, volume.origin.y, volume.origin.z}},
          {"spacing", {volume.spacing().x, volume.spacing().y, volume.spacing().z}},
          {"transfer", nlohmann::json::parse(to_json(transfer))},
          {"step", options.step},
          {"shade", options.shade},
          {"light", {options.light.x, options.light.y, options.light.z}},
          {"ambient", options.ambient}};
}

}  // namespace

RaycastOptions raycast_options(const nlohmann::json& provenance) {
  RaycastOptions options;
  const auto number = [](const nlohmann::json& value, auto& to) {
    if (value.is_number()) to = value.get<std::remove_reference_t<decltype(to)>>();
  };
  number(provenance.value("step", nlohmann::json()), options.step);
  number(provenance.value("ambient", nlohmann::json()), options.ambient);
  const nlohmann::json shade = provenance.value("shade", nlohmann::json());
  if (shade.is_boolean()) options.shade = shade.get<bool>();
  const nlohmann::json light = provenance.value("light", nlohmann::json());
  for (int axis = 0; light.is_array() && light.size() == 3 && axis < 3; ++axis)
    number(light[static_cast<std::size_t>(axis)], options.light[axis]);
  return options;
}

Raycaster::Raycaster(std::unique_ptr<State> state) : state_(std::move(state)) {}
Raycaster::~Raycaster() = default;

Result<std::unique_ptr<Raycaster>> Raycaster::make(Volume volume, const TransferFunction& transfer,
                                                   const RaycastOptions& options) {
  if (auto ok = check_options(options); !ok) return tl::unexpected(ok.error());
  auto state = std::make_unique<State>();
  state->provenance = describe(volume, transfer, options);
  state->volume = std::move(volume);
  Volume& v = state->volume;
  RayGrid& grid = state->grid;

  const glm::dvec3 spacing = v.spacing();
  const double least_spacing = std::min({spacing.x, spacing.y, spacing.z});
  grid.step = options.step * least_spacing;
  const double steps_per_unit = grid.step / transfer.unit_distance;

  grid.labels = v.labels;
  float contrast = 1;  // what counts as a full-size change of value
  if (v.labels) {
    std::vector<double> labels;
    if (v.type == ScalarType::u8 || v.type == ScalarType::u16) {
      for (int id = 0; id < (v.type == ScalarType::u8 ? 256 : 65536); ++id) labels.push_back(id);
    } else {
      auto renumbered = renumber_labels(v);
      if (!renumbered) return tl::unexpected(renumbered.error());
      labels = std::move(*renumbered);
    }
    grid.table = make_label_table(transfer, v, labels, steps_per_unit);
  } else {
    if (bytes_per_voxel(v.type) > 2 && v.type != ScalarType::f32) convert_to_float(v);
    const auto range = stored_range(v);
    replace_nonfinite(v, range[0]);
    grid.table = make_table(transfer, v, range, steps_per_unit);
    contrast = std::max(range[1] - range[0], 1e-30f);
  }

  grid.voxels = v.voxels.data();
  grid.type = v.type;
  for (int axis = 0; axis < 3; ++axis) {
    grid.dims[axis] = static_cast<std::int32_t>(v.dims[axis]);
    if (grid.dims[axis] < 2)
      return fail(ErrorCode::unsupported, v.source, ": a volume needs at least 2 voxels along ",
                  "xyz"[axis], ", found ", v.dims[axis]);
    grid.bricks[axis] = (grid.dims[axis] - 1 + kBrick - 1) / kBrick;
  }
  grid.world_to_index = glm::inverse(v.axes);
  grid.origin = v.origin;
  // Values rise where the stored ones do only under a positive slope.
  const double sign = v.slope < 0 && !v.labels ? -1 : 1;
  const glm::mat3 gradient_to_world(sign * least_spacing * glm::transpose(grid.world_to_index));
  for (int axis = 0; axis < 3; ++axis)
    grid.gradient_to_world[static_cast<std::size_t>(axis)] = {gradient_to_world[axis], 0};
  grid.inverse_gradient_floor = 1 / (0.02f * contrast);
  grid.leap = options.leap;
  grid.shade = options.shade;
  grid.light = {glm::vec3(glm::normalize(options.light)), 0};
  grid.ambient = options.ambient;

  grid.distance = find_visible_bricks(v, grid);
  if (!find_visible_box(grid))
    return fail(ErrorCode::failed, v.source, ": the transfer function '", transfer.name,
                "' leaves nothing visible: its opacity is zero over all values of the volume (",
                v.value_range()[0], " to ", v.value_range()[1], "); try another --transfer");
  spread_distance(grid.distance, grid.bricks);
  state->bounds = find_bounds(grid, v);
  return std::unique_ptr<Raycaster>(new Raycaster(std::move(state)));
}

Sphere Raycaster::bounds() const { return state_->bounds; }

RaySample Raycaster::trace(const glm::dvec3& from, const glm::dvec3& to) const {
  return trace_ray(state_->grid, from, to);
}

nlohmann::json Raycaster::provenance() const { return state_->provenance; }

}  // namespace slf

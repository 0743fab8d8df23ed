// Types of voxels, and what a Volume says of its own.
#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>

#include "base/try.h"
#include "source/volume/io.h"
#include "source/volume/voxels.h"

namespace slf {

using namespace volume_io;

namespace {

using TypeNames = std::vector<std::string_view>;

/// The names of the types in their order, the short one of each first.
const std::array<TypeNames, 10>& type_names() {
  static const std::array<TypeNames, 10> kNames = {
      {{"u8", "uint8", "uint8_t", "uchar", "unsigned char"},
       {"i8", "int8", "int8_t", "char", "signed char"},
       {"u16", "uint16", "uint16_t", "ushort", "unsigned short", "unsigned short int"},
       {"i16", "int16", "int16_t", "short", "short int", "signed short", "signed short int"},
       {"u32", "uint32", "uint32_t", "uint", "unsigned int"},
       {"i32", "int32", "int32_t", "int", "signed int"},
       {"u64", "uint64", "uint64_t", "ulonglong", "unsigned long long", "unsigned long long int"},
       {"i64", "int64", "int64_t", "longlong", "long long", "long long int", "signed long long",
        "signed long long int"},
       {"f32", "float32", "float"},
       {"f64", "float64", "double"}}};
  return kNames;
}

}  // namespace

const char* name(ScalarType type) {
  return type_names()[static_cast<std::size_t>(type)].front().data();
}

std::size_t bytes_per_voxel(ScalarType type) {
  return with_type(type, []<class T>(T) { return sizeof(T); });
}

Result<ScalarType> parse_scalar_type(std::string_view text) try {
  const std::string wanted = lower_case(trim(text));
  const auto& all = type_names();
  for (std::size_t k = 0; k < all.size(); ++k)
    if (std::ranges::find(all[k], wanted) != all[k].end()) return static_cast<ScalarType>(k);
  return fail(ErrorCode::usage, "unknown voxel type ", in_quotes(text), ", expected one of ",
              joined(all, ", ", [](const TypeNames& names) { return names.front(); }));
} catch (...) {
  return tl::unexpected(error_of_exception());
}

std::span<const std::byte> Volume::bytes() const {
  if (!borrowed) return voxels;
  return {borrowed.get(), static_cast<std::size_t>(voxel_count()) * bytes_per_voxel(type)};
}

void Volume::share() {
  if (borrowed) return;
  const auto owned = std::make_shared<const std::vector<std::byte>>(std::move(voxels));
  voxels.clear();
  borrowed = {owned, owned->data()};
}

glm::dvec3 Volume::spacing() const {
  return {glm::length(axes[0]), glm::length(axes[1]), glm::length(axes[2])};
}

std::uint64_t Volume::voxel_count() const { return std::uint64_t{dims[0]} * dims[1] * dims[2]; }

std::array<double, 2> Volume::value_range() const {
  return visit_voxels(*this, [&](auto stored) -> std::array<double, 2> {
    using T = typename decltype(stored)::value_type;
    T min_voxel = std::numeric_limits<T>::max(), max_voxel = std::numeric_limits<T>::lowest();
    bool any = false;
    for (const T voxel : stored) {
      if constexpr (std::is_floating_point_v<T>)
        if (!std::isfinite(voxel)) continue;
      min_voxel = std::min(min_voxel, voxel);
      max_voxel = std::max(max_voxel, voxel);
      any = true;
    }
    if (!any) return {0, 0};
    const double a = slope * static_cast<double>(min_voxel) + intercept;
    const double b = slope * static_cast<double>(max_voxel) + intercept;
    return {std::min(a, b), std::max(a, b)};
  });
}

}  // namespace slf

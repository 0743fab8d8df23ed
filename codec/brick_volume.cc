#include "codec/brick_volume.h"

#include <algorithm>
#include <bit>
#include <memory>
#include <vector>

#include "base/parallel.h"
#include "base/try.h"
#include "codec/range_coder.h"
#include "codec/residual_coder.h"

namespace slf::codec {
namespace {

using Dims = std::array<std::uint32_t, 3>;

std::size_t count_of(const Dims& dims) { return std::size_t{dims[0]} * dims[1] * dims[2]; }
std::size_t number_of(const Dims& dims, const Dims& at) {
  return (std::size_t{at[2]} * dims[1] + at[1]) * dims[0] + at[0];
}
Dims divided(const Dims& dims, std::uint32_t by) {
  return {(dims[0] + by - 1) / by, (dims[1] + by - 1) / by, (dims[2] + by - 1) / by};
}
bool is_coarse(const Dims& at) {
  return at[0] % kCoarseStep == 0 && at[1] % kCoarseStep == 0 && at[2] % kCoarseStep == 0;
}

/// Calls visit(place) for each voxel from `begin` on, before `end`, x fastest.
template <class Visit>
void for_each_voxel(const Dims& begin, const Dims& end, const Visit& visit) {
  for (std::uint32_t z = begin[2]; z < end[2]; ++z)
    for (std::uint32_t y = begin[1]; y < end[1]; ++y)
      for (std::uint32_t x = begin[0]; x < end[0]; ++x) visit(Dims{x, y, z});
}

/// The voxels before one in its brick along the axes, and what they tell of it.
class Before {
 public:
  Before(const std::uint8_t* voxel, const Dims& dims, const Dims& begin, const Dims& at) {
    const std::array<std::size_t, 3> step{1, dims[0], std::size_t{dims[0]} * dims[1]};
    std::array<std::size_t, 3> back{};
    std::size_t axes = 0;
    for (std::size_t k = 0; k < 3; ++k)
      if (at[k] > begin[k]) back[axes++] = step[k];
    if (axes == 0) return;
    const auto value = [&](std::size_t by) { return int{*(voxel - by)}; };
    low_ = high_ = predicted_ = value(back[0]);
    for (std::size_t k = 1; k < axes; ++k) {
      low_ = std::min(low_, value(back[k]));
      high_ = std::max(high_, value(back[k]));
    }
    if (axes == 1) return;
    int plane = value(back[0]) + value(back[1]) - value(back[0] + back[1]);
    if (axes == 3)
      plane += value(back[2]) - value(back[0] + back[2]) - value(back[1] + back[2]) +
               value(back[0] + back[1] + back[2]);
    predicted_ = std::clamp(plane, low_, high_);
  }
  /// The plane through them, within their range.
  [[nodiscard]] int predicted() const { return predicted_; }
  /// The context of the residual, by that range: two for each octave.
  [[nodiscard]] std::size_t context() const {
    const auto range = static_cast<std::size_t>(high_ - low_);
    const auto digits = static_cast<std::size_t>(std::bit_width(range));
    return digits < 3 ? range : 2 * digits - 2 + (range >> (digits - 2) & 1);
  }

 private:
  int low_ = 0, high_ = 0, predicted_ = 0;
};

/// Codes the voxels of a brick in order, but for those of the coarse volume if they are `known`,
/// and sets them to what a decoder finds. Coder is RangeEncoder or RangeDecoder.
template <class Coder>
void code_brick(Coder coder, const Dims& dims, const Dims& begin, const Dims& end, bool known,
                int loss, std::uint8_t* voxels) {
  const int step = 2 * loss + 1;
  const auto models = std::make_unique<ResidualModels>();
  for_each_voxel(begin, end, [&](const Dims& at) {
    if (known && is_coarse(at)) return;
    std::uint8_t& voxel = voxels[number_of(dims, at)];
    const Before before(&voxel, dims, begin, at);
    const int difference = voxel - before.predicted();
    const int steps = (difference + (difference < 0 ? -loss : loss)) / step;
    const int coded = code_residual(coder, *models, before.context(), steps);
    voxel = static_cast<std::uint8_t>(std::clamp(before.predicted() + step * coded, 0, 255));
  });
  if constexpr (requires { coder.finish(); }) coder.finish();
}

/// Calls work(number, begin, end) for each brick of a volume, on several threads.
template <class Work>
Result<void> for_each_brick(const Dims& dims, unsigned threads, const Work& work) {
  const Dims bricks = divided(dims, kVolumeBrick);
  return parallel_for(count_of(bricks), threads, [&](std::uint64_t number) {
    const std::uint64_t row = number / bricks[0];
    const Dims brick{static_cast<std::uint32_t>(number % bricks[0]),
                     static_cast<std::uint32_t>(row % bricks[1]),
                     static_cast<std::uint32_t>(row / bricks[1])};
    Dims begin{}, end{};
    for (std::size_t k = 0; k < 3; ++k) {
      begin[k] = brick[k] * kVolumeBrick;
      end[k] = std::min(begin[k] + kVolumeBrick, dims[k]);
    }
    work(number, begin, end);
  });
}

/// The sizes of the bricks' codes, and the codes. Of a brick that has the value of its first voxel,
/// which is `known`, there is none.
Result<Bytes> encode_bricks(const Dims& dims, std::vector<std::uint8_t>& voxels, bool known,
                            int loss, unsigned threads) {
  std::vector<Bytes> codes(count_of(divided(dims, kVolumeBrick)));
  SLF_TRY(for_each_brick(dims, threads, [&](auto number, const Dims& begin, const Dims& end) {
    bool equal = known;
    for_each_voxel(begin, end, [&](const Dims& at) {
      equal = equal && voxels[number_of(dims, at)] == voxels[number_of(dims, begin)];
    });
    if (!equal)
      code_brick(RangeEncoder(codes[number]), dims, begin, end, known, loss, voxels.data());
  }));
  Bytes out;
  for (const Bytes& code : codes) append_le(out, static_cast<std::uint32_t>(code.size()));
  for (const Bytes& code : codes) out.insert(out.end(), code.begin(), code.end());
  return out;
}

/// Decodes them into `voxels`, and removes them from the front of `coded`.
Result<void> decode_bricks(const Dims& dims, ByteSpan& coded, bool known, int loss,
                           unsigned threads, std::uint8_t* voxels) {
  const std::size_t count = count_of(divided(dims, kVolumeBrick));
  const auto damaged = [] { return fail(ErrorCode::bad_file, "its bricks are damaged"); };
  if (coded.size() / 4 < count) return damaged();
  ByteSpan rest = coded.subspan(4 * count);
  std::vector<ByteSpan> codes(count);
  for (std::size_t k = 0; k < count; ++k) {
    const std::size_t size = load_le<std::uint32_t>(coded.data() + 4 * k);
    if (size > rest.size() || (size == 0 && !known)) return damaged();
    codes[k] = rest.first(size);
    rest = rest.subspan(size);
  }
  SLF_TRY(for_each_brick(dims, threads, [&](auto number, const Dims& begin, const Dims& end) {
    if (!codes[number].empty())
      return code_brick(RangeDecoder(codes[number]), dims, begin, end, known, loss, voxels);
    for_each_voxel(begin, end, [&](const Dims& at) {
      voxels[number_of(dims, at)] = voxels[number_of(dims, begin)];
    });
  }));
  coded = rest;
  return {};
}

/// Calls visit(number of a voxel of the coarse volume, number of that voxel in the volume).
template <class Visit>
void for_each_coarse(const Dims& dims, const Visit& visit) {
  const Dims coarse = divided(dims, kCoarseStep);
  for_each_voxel({}, coarse, [&](const Dims& at) {
    const auto [x, y, z] = at;
    visit(number_of(coarse, at),
          number_of(dims, {x * kCoarseStep, y * kCoarseStep, z * kCoarseStep}));
  });
}

}  // namespace

Result<Bytes> encode_volume(const Dims& dims, ByteSpan voxels, int loss, unsigned threads) {
  const auto* first = reinterpret_cast<const std::uint8_t*>(voxels.data());
  std::vector<std::uint8_t> all(first, first + voxels.size());
  const Dims coarse_dims = divided(dims, kCoarseStep);
  std::vector<std::uint8_t> coarse(count_of(coarse_dims));
  for_each_coarse(dims, [&](std::size_t to, std::size_t from) { coarse[to] = all[from]; });
  Bytes out = SLF_TRY(encode_bricks(coarse_dims, coarse, /*known=*/false, loss, threads));
  for_each_coarse(dims, [&](std::size_t from, std::size_t to) { all[to] = coarse[from]; });
  const Bytes fine = SLF_TRY(encode_bricks(dims, all, /*known=*/true, loss, threads));
  out.insert(out.end(), fine.begin(), fine.end());
  return out;
}

Result<Bytes> decode_volume(const Dims& dims, ByteSpan coded, int loss, unsigned threads) {
  const Dims coarse_dims = divided(dims, kCoarseStep);
  std::vector<std::uint8_t> coarse(count_of(coarse_dims));
  SLF_TRY(decode_bricks(coarse_dims, coded, /*known=*/false, loss, threads, coarse.data()));
  Bytes voxels(count_of(dims));
  auto* const first = reinterpret_cast<std::uint8_t*>(voxels.data());
  for_each_coarse(dims, [&](std::size_t from, std::size_t to) { first[to] = coarse[from]; });
  SLF_TRY(decode_bricks(dims, coded, /*known=*/true, loss, threads, first));
  if (!coded.empty()) return fail(ErrorCode::bad_file, "bytes follow its last brick");
  return voxels;
}

}  // namespace slf::codec

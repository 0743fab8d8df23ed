// Depth by plane sweep (Collins 1996): a picture is compared with its neighbours as they would see
// it if everything lay at one depth, for many depths. Costs are means over two windows, of the
// half of the neighbours that agree best (Kang, Szeliski, Chai 2001).
#include <algorithm>
#include <cmath>

#include "base/reporter.h"
#include "base/try.h"
#include "source/pictures/views.h"

namespace slf {
namespace {

constexpr std::size_t kNeighbors = 8;
constexpr std::size_t kMinDepths = 24, kMaxDepths = 160;
constexpr int kSmallWindow = 1, kLargeWindow = 4;  // pixels around the middle
constexpr float kMaxDifference = 60;               // of 8-bit colours; larger ones count as this
constexpr float kMaxCost = 30;                     // of a depth that is believed
// Another depth whose cost is below kAlike times that of the best, and kAlikeMore, is as likely.
constexpr float kAlike = 1.1f, kAlikeMore = 0.5f;
constexpr std::size_t kApart = 4;     // planes between depths that are not the same
constexpr double kAgreement = 0.012;  // relative, of depths in two views
constexpr int kMinConfirmed = 2;      // by other views

/// The views that see the object from the nearest directions, but not from the same place.
std::vector<std::size_t> neighbors_of(std::size_t view, const std::vector<SmallView>& views,
                                      const glm::dvec3& center) {
  const auto toward = [&](std::size_t k) { return glm::normalize(views[k].eye - center); };
  std::vector<std::pair<double, std::size_t>> near;
  for (std::size_t k = 0; k < views.size(); ++k) {
    const double cosine = glm::dot(toward(k), toward(view));
    if (k != view && cosine < 0.9992 && cosine > 0.5) near.emplace_back(-cosine, k);
  }
  std::ranges::sort(near);
  std::vector<std::size_t> chosen;
  for (std::size_t k = 0; k < std::min(kNeighbors, near.size()); ++k)
    chosen.push_back(near[k].second);
  return chosen;
}

/// Means over windows of (2 radius + 1)², by running sums.
void box_filter(const std::vector<float>& from, std::uint32_t width, std::uint32_t height,
                int radius, std::vector<float>& rows, std::vector<float>& to) {
  const auto w = static_cast<int>(width), h = static_cast<int>(height);
  for (int y = 0; y < h; ++y) {
    const float* in = &from[static_cast<std::size_t>(y) * width];
    float* out = &rows[static_cast<std::size_t>(y) * width];
    float sum = 0;
    for (int x = -radius; x < w; ++x) {
      if (x + radius < w) sum += in[x + radius];
      if (x - radius - 1 >= 0) sum -= in[x - radius - 1];
      if (x >= 0)
        out[x] =
            sum / static_cast<float>(std::min(x + radius, w - 1) - std::max(x - radius, 0) + 1);
    }
  }
  std::vector<float> sums(width, 0);
  for (int y = -radius; y < h; ++y) {
    const float* add =
        y + radius < h ? &rows[static_cast<std::size_t>(y + radius) * width] : nullptr;
    const float* drop =
        y - radius - 1 >= 0 ? &rows[static_cast<std::size_t>(y - radius - 1) * width] : nullptr;
    for (std::uint32_t x = 0; x < width; ++x) {
      if (add) sums[x] += add[x];
      if (drop) sums[x] -= drop[x];
    }
    if (y < 0) continue;
    const auto lines =
        static_cast<float>(std::min(y + radius, h - 1) - std::max(y - radius, 0) + 1);
    float* out = &to[static_cast<std::size_t>(y) * width];
    for (std::uint32_t x = 0; x < width; ++x) out[x] = sums[x] / lines;
  }
}

/// The part of a view that shows the object, with a margin as wide as a window.
struct Part {
  std::uint32_t left = 0, top = 0;
  SmallView view;
};

Part part_with_object(const SmallView& view) {
  std::uint32_t left = view.width, top = view.height, right = 0, bottom = 0;
  for (std::uint32_t y = 0; y < view.height; ++y)
    for (std::uint32_t x = 0; x < view.width; ++x)
      if (view.rgba[std::size_t{y} * view.width + x].a >= 128) {
        left = std::min(left, x), right = std::max(right, x + 1);
        top = std::min(top, y), bottom = std::max(bottom, y + 1);
      }
  Part part;
  if (left >= right) return part;
  part.left = left - std::min<std::uint32_t>(left, kLargeWindow);
  part.top = top - std::min<std::uint32_t>(top, kLargeWindow);
  SmallView& small = part.view;
  small.width = std::min(view.width, right + kLargeWindow) - part.left;
  small.height = std::min(view.height, bottom + kLargeWindow) - part.top;
  small.fx = view.fx, small.fy = view.fy;
  small.cx = view.cx - part.left, small.cy = view.cy - part.top;
  small.axes = view.axes;
  small.eye = view.eye;
  for (std::uint32_t y = 0; y < small.height; ++y) {
    const auto* row = &view.rgba[std::size_t{part.top + y} * view.width + part.left];
    small.rgba.insert(small.rgba.end(), row, row + small.width);
  }
  return part;
}

/// Sweeps one view. The result has 0 where nothing is found.
class Sweep {
 public:
  Sweep(const Sphere& sphere, const DistanceField* hull, const std::vector<SmallView>& views,
        std::size_t number)
      : sphere_(sphere),
        hull_(hull != nullptr),
        whole_(views[number]),
        part_(part_with_object(whole_)),
        view_(part_.view),
        pixels_(view_.rgba.size()),
        low_(pixels_, 0),
        high_(pixels_, 0) {
    for (const std::size_t k : neighbors_of(number, views, sphere.center))
      neighbors_.push_back(&views[k]);
    set_ranges(hull);
  }

  std::vector<float> depth() {
    std::vector<float> found(whole_.rgba.size(), 0);
    if (neighbors_.size() < 2 || !(nearest_ < farthest_)) return found;
    const std::vector<double> depths = planes();
    std::vector<std::vector<float>> costs(depths.size());
    for (std::size_t k = 0; k < costs.size(); ++k) costs[k] = cost(depths[k]);
    for (std::size_t p = 0; p < pixels_; ++p) {
      std::size_t best = depths.size();
      for (std::size_t k = 0; k < depths.size(); ++k) {
        if (depths[k] < low_[p] || depths[k] > high_[p]) continue;
        if (best == depths.size() || costs[k][p] < costs[best][p]) best = k;
      }
      if (best == depths.size() || costs[best][p] > kMaxCost) continue;
      // Without silhouettes, a doubtful depth is better than a hole.
      if (hull_ && is_ambiguous(depths, costs, p, best)) continue;
      // Between planes, by a parabola in 1 / z, in which they are even.
      double inverse = 1 / depths[best];
      if (best > 0 && best + 1 < depths.size()) {
        const double a = costs[best - 1][p], b = costs[best][p], c = costs[best + 1][p];
        const double bend = a - 2 * b + c;
        if (bend > 1e-6)
          inverse += std::clamp(0.5 * (a - c) / bend, -0.5, 0.5) *
                     (1 / depths[best + 1] - 1 / depths[best]);
      }
      const std::size_t x = part_.left + p % view_.width, y = part_.top + p / view_.width;
      found[y * whole_.width + x] = static_cast<float>(1 / inverse);
    }
    return found;
  }

 private:
  /// The depths at which each pixel's ray may meet the object.
  void set_ranges(const DistanceField* hull) {
    nearest_ = 1e300, farthest_ = 0;
    for (std::uint32_t y = 0; y < view_.height; ++y)
      for (std::uint32_t x = 0; x < view_.width; ++x) {
        const std::size_t p = std::size_t{y} * view_.width + x;
        if (view_.rgba[p].a < 128) continue;
        const glm::dvec3 way = view_.direction(x + 0.5, y + 0.5);
        const Chord chord = intersect(sphere_, view_.eye, way);
        if (!chord.hit || chord.leave <= 0) continue;
        double enter = std::max(chord.enter, 1e-3 * sphere_.radius), leave = chord.leave;
        if (hull) {
          const glm::dvec3 from = view_.eye + enter * way, to = view_.eye + leave * way;
          const auto front = hull->meet(from, to), back = hull->meet(to, from);
          if (front.kind == DistanceField::Meeting::Kind::none) continue;
          const double margin = 2 * hull->voxel();
          const double first = enter + front.t * (leave - enter) - margin,
                       last = leave - back.t * (leave - enter) + margin;
          enter = first, leave = last;
        }
        low_[p] = static_cast<float>(enter);
        high_[p] = static_cast<float>(leave);
        nearest_ = std::min(nearest_, enter);
        farthest_ = std::max(farthest_, leave);
      }
  }

  /// Whether a pixel is as likely to lie elsewhere, as on surfaces of one colour.
  [[nodiscard]] bool is_ambiguous(const std::vector<double>& depths,
                                  const std::vector<std::vector<float>>& costs, std::size_t p,
                                  std::size_t best) const {
    const float limit = costs[best][p] * kAlike + kAlikeMore;
    for (std::size_t k = 0; k < depths.size(); ++k) {
      if (depths[k] < low_[p] || depths[k] > high_[p]) continue;
      if ((k > best ? k - best : best - k) > kApart && costs[k][p] < limit) return true;
    }
    return false;
  }

  /// About a pixel apart in the neighbours, even in 1 / z.
  [[nodiscard]] std::vector<double> planes() const {
    double baseline = 0;
    for (const SmallView* n : neighbors_) baseline += glm::distance(n->eye, view_.eye);
    baseline /= static_cast<double>(neighbors_.size());
    const double span = 1 / nearest_ - 1 / farthest_;
    const auto count = static_cast<std::size_t>(
        std::clamp(view_.fx * baseline * span, double{kMinDepths}, double{kMaxDepths}));
    std::vector<double> depths;
    for (std::size_t k = 0; k < count; ++k)
      depths.push_back(
          1 / (1 / nearest_ - span * static_cast<double>(k) / static_cast<double>(count - 1)));
    return depths;
  }

  /// Differences from one neighbour if every pixel lay at depth z.
  void compare(const SmallView& other, double z, std::vector<float>& difference) const {
    const glm::dmat3 turn = glm::transpose(other.axes);
    const glm::dvec3 shift = turn * (view_.eye - other.eye);
    const glm::dvec3 across = turn * (view_.axes[0] / view_.fx) * z,
                     down = turn * (view_.axes[1] / view_.fy) * z;
    const glm::dvec3 corner = shift + turn * view_.direction(0.5, 0.5) * z;
    for (std::uint32_t y = 0; y < view_.height; ++y)
      for (std::uint32_t x = 0; x < view_.width; ++x) {
        const std::size_t p = std::size_t{y} * view_.width + x;
        // Pixels that cannot be at this depth hardly count for or against their neighbours.
        difference[p] = kMaxDifference / 3;
        if (!(z >= low_[p] && z <= high_[p])) continue;
        difference[p] = kMaxDifference;
        const glm::dvec3 v = corner + double(x) * across + double(y) * down;
        if (!(v.z > 0)) continue;
        const auto px = static_cast<float>(other.fx * v.x / v.z + other.cx - 0.5),
                   py = static_cast<float>(other.fy * v.y / v.z + other.cy - 0.5);
        if (!(px >= 0 && py >= 0 && px < static_cast<float>(other.width - 1) &&
              py < static_cast<float>(other.height - 1)))
          continue;
        const auto ix = static_cast<std::uint32_t>(px), iy = static_cast<std::uint32_t>(py);
        const float fx = px - static_cast<float>(ix), fy = py - static_cast<float>(iy);
        const glm::u8vec4* from = &other.rgba[std::size_t{iy} * other.width + ix];
        const glm::u8vec4& own = view_.rgba[p];
        float sum = 0;
        for (int c = 0; c < 3; ++c) {
          const float top =
              static_cast<float>(from[0][c]) + fx * static_cast<float>(from[1][c] - from[0][c]);
          const float bottom =
              static_cast<float>(from[other.width][c]) +
              fx * static_cast<float>(from[other.width + 1][c] - from[other.width][c]);
          sum += std::abs(top + fy * (bottom - top) - static_cast<float>(own[c]));
        }
        difference[p] = std::min(sum / 3 + (from[0].a < 128 ? 20.f : 0.f), kMaxDifference);
      }
  }

  [[nodiscard]] std::vector<float> cost(double z) const {
    std::vector<float> difference(pixels_), rows(pixels_), fine(pixels_), wide(pixels_);
    std::vector<std::vector<float>> all;
    for (const SmallView* other : neighbors_) {
      compare(*other, z, difference);
      box_filter(difference, view_.width, view_.height, kSmallWindow, rows, fine);
      box_filter(difference, view_.width, view_.height, kLargeWindow, rows, wide);
      for (std::size_t p = 0; p < pixels_; ++p) fine[p] = 0.5f * (fine[p] + wide[p]);
      all.push_back(fine);
    }
    const std::size_t half = (all.size() + 1) / 2;
    std::vector<float> result(pixels_, kMaxDifference);
    std::array<float, kNeighbors> sorted{};
    for (std::size_t p = 0; p < pixels_; ++p) {
      if (!(z >= low_[p] && z <= high_[p])) continue;
      for (std::size_t k = 0; k < all.size(); ++k) sorted[k] = all[k][p];
      std::sort(sorted.begin(), sorted.begin() + static_cast<std::ptrdiff_t>(all.size()));
      float sum = 0;
      for (std::size_t k = 0; k < half; ++k) sum += sorted[k];
      result[p] = sum / static_cast<float>(half);
    }
    return result;
  }

  const Sphere& sphere_;
  bool hull_;
  const SmallView& whole_;
  Part part_;
  const SmallView& view_;  ///< of part_
  std::size_t pixels_;
  std::vector<float> low_, high_;  // 0: the background
  double nearest_ = 0, farthest_ = 0;
  std::vector<const SmallView*> neighbors_;
};

/// How many other views confirm each depth of a view.
std::vector<std::uint8_t> confirmations(std::size_t number, const std::vector<SmallView>& views,
                                        const glm::dvec3& center) {
  const SmallView& view = views[number];
  const auto near = neighbors_of(number, views, center);
  std::vector<std::uint8_t> counts(view.depth.size(), 0);
  for (std::uint32_t y = 0; y < view.height; ++y)
    for (std::uint32_t x = 0; x < view.width; ++x) {
      const std::size_t p = std::size_t{y} * view.width + x;
      if (!(view.depth[p] > 0)) continue;
      const glm::dvec3 world = view.eye + double{view.depth[p]} * view.direction(x + 0.5, y + 0.5);
      for (const std::size_t k : near) {
        const glm::dvec3 at = views[k].project(world);
        const auto pixel = views[k].pixel_at(at);
        if (!pixel) continue;
        const float other = views[k].depth[*pixel];
        counts[p] += other > 0 && std::abs(other - at.z) < kAgreement * at.z;
      }
    }
  return counts;
}

/// The most bytes that the sweep of a view takes: costs of all planes, and of one by neighbour.
std::uint64_t sweep_bytes(const SmallView& view) {
  return view.rgba.size() * (kMaxDepths + kNeighbors + 8) * sizeof(float);
}

}  // namespace

Result<void> estimate_depth(const Sphere& sphere, const DistanceField* hull, unsigned threads,
                            std::uint64_t memory, const ProgressCallback& progress,
                            std::vector<SmallView>& views) {
  std::uint64_t largest = 1;
  for (const SmallView& view : views) largest = std::max(largest, sweep_bytes(view));
  threads =
      static_cast<unsigned>(std::clamp<std::uint64_t>(memory / largest, 1, thread_count(threads)));
  std::vector<std::vector<float>> depths(views.size());
  Reporter reporter(progress, {0, views.size(), 0}, "stopped while depth was estimated");
  SLF_TRY(parallel_for(views.size(), threads, reporter, [&](std::uint64_t k) {
    depths[k] = Sweep(sphere, hull, views, k).depth();
  }));
  for (std::size_t k = 0; k < views.size(); ++k) views[k].depth = std::move(depths[k]);
  SLF_TRY(count_confirmations(sphere.center, threads, views));
  for (SmallView& view : views)
    for (std::size_t p = 0; p < view.depth.size(); ++p)
      if (view.confirmed[p] < kMinConfirmed) view.depth[p] = 0, view.confirmed[p] = 0;
  return {};
}

Result<void> count_confirmations(const glm::dvec3& center, unsigned threads,
                                 std::vector<SmallView>& views) {
  return parallel_for(views.size(), threads, [&](std::uint64_t k) {
    views[k].confirmed = confirmations(k, views, center);
  });
}

}  // namespace slf

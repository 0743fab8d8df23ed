#include "page/fit.h"

#include <unistd.h>

#include <array>
#include <span>
#include <vector>

#include "base/try.h"

namespace slf::page {
namespace {

constexpr std::array kQualities = {90, 75, 60, 45};

/// What to try, the best first.
std::vector<RepackOptions> candidates(const Field& field, const RepackOptions& options) {
  const bool depth = field.has_depth() && options.depth;
  // jpeg holds no half floats.
  const bool fixed = !options.codec.empty() || (is_half(field.format()) && !depth);
  const unsigned finest = options.finest_level.value_or(field.shape().finest_level);
  const unsigned levels = options.finest_level ? 1 : finest + 1;
  std::vector<RepackOptions> all;
  all.reserve(levels * (1 + kQualities.size()));
  RepackOptions next = options;
  next.light = false;
  for (unsigned k = 0; k < levels; ++k) {
    next.finest_level = finest - k;
    next.codec = options.codec;  // if empty, the field's own
    if (k == 0 || fixed) all.push_back(next);
    if (fixed) continue;
    for (const int quality : kQualities) {
      next.codec = (depth ? "predictive:" : "jpeg:") + std::to_string(quality);
      all.push_back(next);
    }
  }
  return all;
}

}  // namespace

Result<RepackReport> repack_to_fit(std::span<const StateSource> states, const std::string& path,
                                   const RepackOptions& options, std::uint64_t max_bytes,
                                   const ProgressCallback& progress) {
  const Field& field = states.front().field;
  const std::vector<RepackOptions> all = candidates(field, options);
  for (const RepackOptions& candidate : std::span(all).first(all.size() - 1)) {
    // The first state is the least that all can take.
    const auto estimate = SLF_TRY(estimate_repack(field, candidate, progress));
    if (estimate.file_bytes > max_bytes + estimate.file_error_bytes) continue;
    auto report = join_states(states, path, candidate, progress);
    if (!report || report->file_bytes <= max_bytes) return report;
    ::unlink(path.c_str());
  }
  auto report = join_states(states, path, all.back(), progress);
  if (!report || report->file_bytes <= max_bytes) return report;
  ::unlink(path.c_str());
  return misuse(field.path(), "does not get smaller than ", report->file_bytes,
                " bytes; there is room for ", max_bytes);
}

}  // namespace slf::page

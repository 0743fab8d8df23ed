#include "view/fit.h"

#include <algorithm>
#include <array>
#include <vector>

namespace slf::view {
namespace {

constexpr std::array kQualities = {90, 75, 60, 45};

/// The codecs to try, the best first. An empty name stands for the field's own codec.
std::vector<std::string> codecs(const Field& field, const RepackOptions& options) {
  const auto& layers = field.layers();
  const bool half = std::any_of(layers.begin(), layers.end(), [](const Layer& layer) {
    return layer.format == SampleFormat::rgba16f;
  });
  if (half || !options.color_codec.empty() || !options.depth_codec.empty())
    return {options.color_codec};
  std::vector<std::string> specs;
  for (const int quality : kQualities)
    specs.push_back((field.has_depth() ? "predictive:" : "jpeg:") + std::to_string(quality));
  return specs;
}

}  // namespace

Result<RepackReport> repack_to_fit(const Field& field, const std::string& path,
                                   RepackOptions options, std::uint64_t most,
                                   const ProgressCallback& progress) {
  const std::vector<std::string> specs = codecs(field, options);
  const unsigned finest = options.levels.value_or(field.shape().levels);
  const unsigned coarsest = options.levels ? finest : 0;
  for (unsigned levels = finest;; --levels) {
    options.levels = levels;
    for (std::size_t k = 0; k < specs.size();) {
      options.color_codec = specs[k];
      options.replace = true;
      auto report = repack_field(field, path, options, progress);
      if (!report || report->file_bytes <= most) return report;
      const bool last = levels == coarsest && k + 1 == specs.size();
      if (last)
        return fail(ErrorCode::usage, field.path(), ": does not get smaller than ",
                    report->file_bytes, " bytes; there is room for ", most);
      // If the size is far above the limit, try only the lowest quality next.
      const std::size_t next = k + 1;
      k = report->file_bytes > 2 * most && next < specs.size() ? specs.size() - 1 : next;
    }
  }
}

}  // namespace slf::view

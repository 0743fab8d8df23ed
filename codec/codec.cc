#include "codec/codec.h"

#include <algorithm>
#include <cassert>
#include <optional>
#include <vector>

#include "base/ascii.h"
#include "base/try.h"
#include "codec/jpeg_codec.h"
#include "codec/predictive_codec.h"
#include "codec/zstd_codec.h"

namespace slf::codec {
namespace {

/// Stores the samples unchanged.
class RawCodec final : public Codec {
 public:
  std::string spec() const override { return "raw"; }
  bool lossless() const override { return true; }

  Result<void> encode(const TileShape& tile, ByteSpan samples, const Predicted*,
                      Bytes& payload) const override {
    assert(samples.size() == tile.bytes());
    (void)tile;
    payload.assign(samples.begin(), samples.end());
    return {};
  }

  Result<void> decode(const TileShape& tile, ByteSpan payload, const Predicted*,
                      std::span<std::byte> samples) const override {
    assert(samples.size() == tile.bytes());
    if (payload.size() != tile.bytes())
      return fail(ErrorCode::bad_file, "raw tile: expected ", tile.bytes(), " bytes, found ",
                  payload.size());
    std::copy(payload.begin(), payload.end(), samples.begin());
    return {};
  }
};

constexpr int kDefaultZstdLevel = 9;
constexpr int kDefaultJpegQuality = 75;
constexpr int kDefaultPredictiveQuality = 90;

std::vector<std::string_view> split(std::string_view text, char separator) {
  std::vector<std::string_view> parts;
  while (true) {
    const std::size_t end = text.find(separator);
    parts.push_back(text.substr(0, end));
    if (end == std::string_view::npos) return parts;
    text.remove_prefix(end + 1);
  }
}

// Parses an integer within low..high that takes up the whole text.
std::optional<int> parse_int(std::string_view text, int low, int high) {
  const auto value = parse_number<int>(text);
  return value && *value >= low && *value <= high ? value : std::nullopt;
}

// The first parameter, or `otherwise` if there is none.
std::optional<int> first_parameter(const std::vector<std::string_view>& parts, int otherwise,
                                   int high) {
  return parts.size() > 1 ? parse_int(parts[1], 1, high) : otherwise;
}

tl::unexpected<Error> bad_spec(std::string_view spec) {
  return fail(ErrorCode::usage, "codec \"", spec,
              "\": expected raw, zstd[:LEVEL] with a level of 1 to 22, or "
              "jpeg[:QUALITY[:420|:444]] or predictive[:QUALITY] with a quality of 1 to 100, or "
              "predictive:lossless");
}

Result<std::unique_ptr<Codec>> make_zstd(std::string_view spec, SampleFormat format,
                                         const std::vector<std::string_view>& parts) {
  const std::optional<int> level = first_parameter(parts, kDefaultZstdLevel, 22);
  if (!level || parts.size() > 2) return bad_spec(spec);
  return make_zstd_codec(format, *level);
}

Result<JpegOptions> jpeg_options(std::string_view spec, SampleFormat format,
                                 const std::vector<std::string_view>& parts) {
  const std::optional<int> quality = first_parameter(parts, kDefaultJpegQuality, 100);
  const std::string_view chroma = parts.size() > 2 ? parts[2] : "420";
  if (!quality || parts.size() > 3 || (chroma != "420" && chroma != "444")) return bad_spec(spec);
  if (is_half(format))
    return fail(ErrorCode::unsupported, "codec \"", spec,
                "\": JPEG cannot hold half floats; use zstd");
  return JpegOptions{*quality, chroma == "444" ? JpegColor::ycbcr_444 : JpegColor::ycbcr_420};
}

Result<std::unique_ptr<Codec>> make_jpeg(std::string_view spec, SampleFormat format,
                                         const std::vector<std::string_view>& parts,
                                         ByteSpan tables) {
  const JpegOptions options = SLF_TRY(jpeg_options(spec, format, parts));
  JpegTileTables shared = standard_tables(options);
  if (tables.empty()) return make_jpeg_codec(format, options, shared);
  shared.color = SLF_TRY(take_tables(tables));
  if (has_depth(format)) shared.depth = SLF_TRY(take_tables(tables));
  if (!tables.empty())
    return fail(ErrorCode::bad_file, "bytes after the shared JPEG tables: ", tables.size());
  return make_jpeg_codec(format, options, shared);
}

Result<PredictiveSettings> predictive_settings(std::string_view spec, SampleFormat format,
                                               const std::vector<std::string_view>& parts) {
  if (!has_depth(format))
    return fail(ErrorCode::unsupported, "codec \"", spec, "\": needs depths beside the colours");
  const std::optional<int> quality = parts.size() > 1 && parts[1] == "lossless"
                                         ? kLosslessQuality
                                         : first_parameter(parts, kDefaultPredictiveQuality, 100);
  if (!quality || parts.size() > 2) return bad_spec(spec);
  return PredictiveSettings{*quality, format};
}

Result<std::unique_ptr<Codec>> make_predictive(std::string_view spec, SampleFormat format,
                                               const std::vector<std::string_view>& parts,
                                               ByteSpan tables) {
  const PredictiveSettings settings = SLF_TRY(predictive_settings(spec, format, parts));
  if (tables.empty())
    return std::make_unique<PredictiveCodec>(settings, predictive_tables(settings, 0));
  auto shared = SLF_TRY(parse_predictive_tables(tables));
  const PredictiveModels& models = *shared.level(0).models;
  if (!settings.by_sample() && (models.alpha_sets == 0 || models.block_sets == 0))
    return fail(ErrorCode::bad_file, "shared tables of a predictive codec: no models of blocks");
  return std::make_unique<PredictiveCodec>(settings, std::move(shared));
}

}  // namespace

bool is_predictive(std::string_view spec) { return split(spec, ':')[0] == "predictive"; }

bool needs_training(std::string_view spec) { return split(spec, ':')[0] == "jpeg"; }

Result<std::unique_ptr<Codec>> make_codec(std::string_view spec, SampleFormat format,
                                          ByteSpan tables) {
  const std::vector<std::string_view> parts = split(spec, ':');
  if (is_predictive(spec)) return make_predictive(spec, format, parts, tables);
  if (parts[0] == "jpeg") return make_jpeg(spec, format, parts, tables);
  if (!tables.empty())
    return fail(ErrorCode::bad_file, "codec \"", spec, "\": has no shared tables, but ",
                tables.size(), " bytes of them were found");
  if (spec == "raw") return std::make_unique<RawCodec>();
  if (parts[0] == "zstd") return make_zstd(spec, format, parts);
  return bad_spec(spec);
}

Result<std::unique_ptr<Codec>> train_codec(std::string_view spec, SampleFormat format,
                                           std::span<const TrainingTile> sample, unsigned finest) {
  const std::vector<std::string_view> parts = split(spec, ':');
  if (is_predictive(spec)) {
    const PredictiveSettings settings = SLF_TRY(predictive_settings(spec, format, parts));
    return std::make_unique<PredictiveCodec>(settings, predictive_tables(settings, finest));
  }
  if (!needs_training(spec)) return make_codec(spec, format);
  const JpegOptions options = SLF_TRY(jpeg_options(spec, format, parts));
  return make_jpeg_codec(format, options, train_tables(format, options, sample));
}

}  // namespace slf::codec

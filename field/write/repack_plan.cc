#include "field/write/repack_plan.h"

#include "base/try.h"
#include "field/field_file.h"

namespace slf {
namespace {

Result<FieldShape> plan_shape(const FieldFile& field, const RepackOptions& options) {
  FieldShape shape = field.shape();
  if (options.levels && *options.levels > shape.levels)
    return misuse(field.path(), "has levels 0 to ", shape.levels, ", not ", *options.levels);
  if (options.levels) shape.levels = *options.levels;
  for (const std::uint8_t subfield : options.subfields)
    if (!field.shape().has({0, std::uint64_t{subfield} << (2 * shape.entry_extra_levels)}))
      return misuse(field.path(), "has no subfield ", int{subfield});
  if (!options.subfields.empty()) shape.subfields = options.subfields;
  SLF_TRY(shape.check());
  return shape;
}

/// The codec's specification.
Result<std::string> plan_codec(const FieldFile& field, SampleFormat format,
                               const RepackOptions& options) {
  const std::string codec = options.codec.empty() ? field.codec().spec() : options.codec;
  auto plain = codec::make_codec(codec, format);
  if (!plain && options.codec.empty() && is_half(format) && !is_half(field.format()))
    plain = codec::make_codec("zstd", format);  // JPEG stores no half floats
  return plain.map([](const auto& made) { return made->spec(); });
}

/// What fields must have in common to be states of one.
OwnedJson rays_of(const FieldFile& field) {
  Manifest rays;
  rays.shape = field.shape();
  rays.filtered_levels = field.manifest().filtered_levels;
  rays.format = field.format();
  return rays.to_json();
}

Result<void> check_joinable(std::span<const StateSource> states) {
  const FieldFile& first = states[0].field.file();
  for (const StateSource& state : states) {
    const FieldFile& field = state.field.file();
    if (rays_of(field) != rays_of(first))
      return misuse(field.path(), "has another sphere, lattice or format than ", first.path());
    if (field.manifest().part)
      return misuse(field.path(), "is a part of a field; merge the parts first");
  }
  return {};
}

/// Whether these are all states of one field, in its order.
bool are_one_field(std::span<const StateSource> states) {
  const FieldFile& first = states[0].field.file();
  for (std::size_t k = 0; k < states.size(); ++k)
    if (const FieldFile& file = states[k].field.file();
        states[k].field.structures() || file.path() != first.path() ||
        states[k].field.state() != k || file.store().transaction() != first.store().transaction())
      return false;
  return states.size() == first.manifest().states.size();
}

/// Whether payloads can be copied: one file has them, and the tiles that they are predicted from.
bool can_copy(std::span<const StateSource> states, const FieldShape& shape) {
  const FieldFile& first = states[0].field.file();
  const bool several = states.size() > 1;
  if (states[0].field.structures() || (several && !are_one_field(states))) return false;
  if (!first.predicts()) return true;
  const bool whole_levels = shape.subfields == first.shape().subfields;
  return whole_levels &&
         (several ? shape.levels == first.shape().levels : states[0].field.state() == 0);
}

/// The code of the first reveal of what one of the states shows: others are not to be published.
Result<ByteSpan> revealed(std::span<const StateSource> states) {
  for (const StateSource& state : states) {
    const auto reveal = SLF_TRY(state.field.reveal(RevealPart::head));
    if (reveal) return state.field.file().reveal();
  }
  return ByteSpan();
}

}  // namespace

TileCoder::Geometries RepackPlan::geometries() const {
  return [&first = first](unsigned level) -> const LevelGeometry& { return first.geometry(level); };
}

Result<std::unique_ptr<codec::Codec>> RepackPlan::codec(unsigned threads, const GoOn& go_on) const {
  if (copy) return codec::make_codec(manifest.codec, manifest.format, first.codec().tables());
  return train_codec(*source, geometries(), manifest, threads, go_on);
}

Result<RepackPlan> plan_repack(std::span<const StateSource> states, const RepackOptions& options,
                               std::uint64_t memory) {
  const Field& handle = states[0].field;
  RepackPlan plan{handle.file(), handle.file().manifest(), nullptr, false, {}};
  const FieldFile& first = plan.first;
  Manifest& manifest = plan.manifest;
  if (states.size() > 1) SLF_TRY(check_joinable(states));
  manifest.shape = SLF_TRY(plan_shape(first, options));
  manifest.format = sample_format(options.half.value_or(is_half(first.format())),
                                  options.depth && first.has_depth());
  manifest.codec = SLF_TRY(plan_codec(first, manifest.format, options));
  std::vector<std::pair<std::string, OwnedJson>> provenances;
  for (const StateSource& state : states)
    provenances.emplace_back(state.name, nlohmann::json::parse(state.field.provenance()));
  SLF_TRY(manifest.set_states(provenances));
  plan.copy = manifest.format == first.format() && manifest.codec == first.codec().spec() &&
              can_copy(states, manifest.shape);
  if (plan.copy) manifest.keeps_rays &= first.manifest().keeps_rays;
  const bool alone = states.size() == 1 && !first.manifest().states.empty();
  if (plan.copy && alone)
    plan.source = std::make_unique<StoredTiles>(first.store(), &first.coder(), handle.state());
  else if (plan.copy)
    plan.source = std::make_unique<StoredTiles>(first.store());
  else
    plan.source = std::make_unique<DecodedTiles>(states, manifest.format, memory);
  const auto keep = [&](const char* blob, const Result<ByteSpan>& bytes) -> Result<void> {
    if (!bytes)
      return fail(bytes.error().code, bytes.error().message, "; a copy can leave the ", blob,
                  " out");
    plan.kept[blob].assign(bytes->begin(), bytes->end());
    return {};
  };
  if (options.light && !handle.structures() && handle.state() == 0)
    SLF_TRY(keep(kLightBlob, first.light()));
  if (options.reveal) SLF_TRY(keep(kRevealBlob, revealed(states)));
  return plan;
}

}  // namespace slf

#include "slf/merge.h"

#include <algorithm>
#include <filesystem>
#include <optional>
#include <tuple>

#include "base/parallel.h"
#include "base/reporter.h"
#include "base/try.h"
#include "codec/codec.h"
#include "field/field_file.h"
#include "field/geometry/tile_order.h"
#include "field/geometry/tile_selection.h"
#include "field/write/write_tiles.h"

namespace slf {

namespace {

/// Consecutive tiles of the merged field that come from one part.
struct MergeSegment {
  NumberRange tiles;       ///< by their numbers in the merged field
  std::size_t source = 0;  ///< index of the part
};

/// Which tiles of a merged field come from which part.
struct MergePlan {
  Manifest manifest;                   ///< of the merged field
  Bytes tables;                        ///< of its codec
  KeptBlobs kept;                      ///< each of the first part that has it
  std::vector<std::uint64_t> commits;  ///< of each part: the number of the commit that was read
  std::vector<MergeSegment> segments;  ///< in key order, without gaps
};

constexpr std::size_t kMaxNamed = 10;  // ranges or files in a message

/// The data of a part that remain after it is closed.
struct Source {
  std::string path;
  Manifest manifest;
  Bytes tables;
  KeptBlobs kept;
  std::uint64_t commit = 0;
};

/// "tiles 1/0 to 1/1023".
std::string name_of(const TileOrder& order, NumberRange tiles) {
  return "tiles " + storage::name(order.key(tiles.begin)) + " to " +
         storage::name(order.key(tiles.end - 1));
}

tl::unexpected<Error> unfinished(const std::string& path, const std::string& what) {
  return fail(ErrorCode::failed, path, ": ", what,
              "; to complete it, run the command that builds it again");
}

/// What a field claims to hold, as positions in `order`, that of the merged field.
TileSelection coverage(const Manifest& manifest, const TileOrder& order) {
  const FieldShape& shape = manifest.shape;
  std::vector<std::uint8_t> subfields = shape.subfields;
  for (std::uint8_t k = 0; shape.subfields.empty() && k < 64; ++k) subfields.push_back(k);
  const TileRange part = manifest.part.value_or(all_keys(shape));
  TileSelection tiles;
  for (unsigned level = 0; level <= shape.finest_level; ++level) {
    const unsigned bits = 4 * level + 2 * shape.entry_extra_levels;
    for (const std::uint64_t subfield : subfields) {
      const auto l = static_cast<std::uint8_t>(level);
      const TileKey first{l, subfield << bits}, next{l, (subfield + 1) << bits};
      const TileKey begin = std::max(first, part.begin), end = std::min(next, part.end);
      if (begin < end) tiles.add({order.number(begin), order.number(end)});
    }
  }
  return tiles;
}

Result<Source> read_source(const std::string& path) {
  auto field = FieldFile::open(path);
  std::error_code ignored;
  if (!field && field.error().code == ErrorCode::not_found &&
      std::filesystem::exists(path + ".unfinished", ignored))
    return unfinished(path, "is not finished (" + path + ".unfinished)");
  if (!field) return tl::unexpected(field.error());
  const auto content = SLF_TRY((*field)->content());
  if (!content.complete)
    return unfinished(path, "some of its tiles were not built, or were dropped");
  KeptBlobs kept;
  for (const char* blob : {kLightBlob, kRevealBlob}) {
    const auto bytes = SLF_TRY((*field)->kept(blob));
    kept[blob].assign(bytes.begin(), bytes.end());
  }
  const ByteSpan tables = (*field)->codec().tables();
  return Source{path,
                (*field)->manifest(),
                {tables.begin(), tables.end()},
                std::move(kept),
                (*field)->store().transaction()};
}

/// usage: `other` is not a part of the same field as `first`.
Result<void> check_same(const Source& first, const Source& other) {
  const auto differ = [&](const std::string& what) {
    return misuse(other.path, "is not of the same field as ", first.path, ": ", what);
  };
  Manifest a = first.manifest, b = other.manifest;
  a.shape.finest_level = b.shape.finest_level =
      std::max(a.shape.finest_level, b.shape.finest_level);
  a.shape.subfields = b.shape.subfields = {};
  a.part = b.part = std::nullopt;
  if (first.manifest.filtered_levels != other.manifest.filtered_levels)
    return differ("/filtered_levels differs");
  if (const std::string place = first_difference(a, b); !place.empty())
    return differ(place.ends_with("/provenance/content") ? "it was built from other data"
                                                         : place + " differs");
  // A repack that leaves out subfields, or levels of several states, encodes predicted tiles again.
  // A shard's tiles were predicted from the original ones, not from those.
  const FieldShape &shape = first.manifest.shape, &other_shape = other.manifest.shape;
  const bool anew = shape.subfields != other_shape.subfields ||
                    (shape.states > 1 && shape.finest_level != other_shape.finest_level);
  if (codec::is_predictive(first.manifest.codec) && anew &&
      (first.manifest.part || other.manifest.part))
    return differ("one is a shard, the other was encoded anew by a repack; merge the shards first");
  if (first.tables != other.tables) return differ("the codec's tables differ");
  return {};
}

/// The shape of the merged field.
FieldShape joined_shape(const std::vector<Source>& sources) {
  FieldShape shape = sources.front().manifest.shape;
  std::vector<bool> selected(64, false);
  bool all = false;
  for (const Source& source : sources) {
    shape.finest_level = std::max(shape.finest_level, source.manifest.shape.finest_level);
    all = all || source.manifest.shape.subfields.empty();
    for (const std::uint8_t subfield : source.manifest.shape.subfields) selected[subfield] = true;
  }
  shape.subfields.clear();
  if (all || std::ranges::find(selected, false) == selected.end()) return shape;
  for (std::size_t k = 0; k < selected.size(); ++k)
    if (selected[k]) shape.subfields.push_back(static_cast<std::uint8_t>(k));
  return shape;
}

/// The segments of all parts, as positions in key order. usage: two overlap.
Result<std::vector<MergeSegment>> join(const std::vector<Source>& sources, const TileOrder& order) {
  std::vector<MergeSegment> segments;
  for (std::size_t k = 0; k < sources.size(); ++k) {
    const TileSelection covered = coverage(sources[k].manifest, order);
    for (const NumberRange& range : covered.ranges()) segments.push_back({range, k});
  }
  std::sort(segments.begin(), segments.end(), [](const MergeSegment& a, const MergeSegment& b) {
    return std::tie(a.tiles.begin, a.tiles.end, a.source) <
           std::tie(b.tiles.begin, b.tiles.end, b.source);
  });
  std::size_t furthest = 0;
  for (std::size_t k = 1; k < segments.size(); ++k) {
    const MergeSegment &before = segments[furthest], &now = segments[k];
    if (now.tiles.begin < before.tiles.end &&
        sources[before.source].path == sources[now.source].path)
      return misuse(sources[now.source].path, "is given twice");
    if (now.tiles.begin < before.tiles.end)
      return fail(ErrorCode::usage, sources[before.source].path, " and ", sources[now.source].path,
                  ": both hold ",
                  name_of(order, {now.tiles.begin, std::min(now.tiles.end, before.tiles.end)}),
                  "; leave one of them out");
    if (now.tiles.end > before.tiles.end) furthest = k;
  }
  return segments;
}

tl::unexpected<Error> missing(const std::vector<NumberRange>& ranges, const TileOrder& order) {
  std::string names;
  for (std::size_t k = 0; k < std::min(ranges.size(), kMaxNamed); ++k)
    names += (k == 0 ? "" : ", ") + name_of(order, ranges[k]);
  if (ranges.size() > kMaxNamed)
    names += ", and " + std::to_string(ranges.size() - kMaxNamed) + " more ranges";
  return fail_without("part", ErrorCode::usage, "no part holds ", names);
}

/// Opens the parts one after the other, and compares them. `part`: the merged field may be a part.
/// Errors as merge_fields().
Result<MergePlan> plan_merge(const std::vector<std::string>& paths, bool part) {
  if (paths.empty()) return fail(ErrorCode::usage, "no parts to merge");
  std::vector<Source> sources;
  for (const std::string& path : paths) {
    auto source = SLF_TRY(read_source(path));
    sources.push_back(std::move(source));
    SLF_TRY(check_same(sources.front(), sources.back()));
  }
  MergePlan plan;
  const FieldShape shape = joined_shape(sources);
  const TileOrder order(one_state(shape));
  const auto segments = SLF_TRY(join(sources, order));
  if (segments.empty()) return fail(ErrorCode::usage, "the parts hold no tiles");
  std::vector<NumberRange> positions(segments.size());
  std::ranges::transform(segments, positions.begin(), &MergeSegment::tiles);
  for_each_state(shape, positions, [&](std::size_t k, NumberRange tiles) {
    plan.segments.push_back({tiles, segments[k].source});
  });

  // The output must not depend on the order in which the parts are given.
  Source& first = sources[segments.front().source];
  plan.manifest = first.manifest;
  plan.manifest.shape = shape;
  plan.manifest.part.reset();
  for (const Source& source : sources) plan.manifest.keeps_rays |= source.manifest.keeps_rays;
  plan.tables = std::move(first.tables);
  for (const MergeSegment& segment : segments)
    for (const auto& [name, bytes] : sources[segment.source].kept)
      if (plan.kept[name].empty()) plan.kept[name] = bytes;
  for (const Source& source : sources) plan.commits.push_back(source.commit);

  TileSelection held, all;
  for (const NumberRange& tiles : positions) held.add(tiles);
  all.add({0, order.count()});
  const std::vector<NumberRange> left_out = all.without(held).ranges();
  if (left_out.empty()) return plan;
  const std::uint64_t begin = segments.front().tiles.begin, end = segments.back().tiles.end;
  const bool inside = std::ranges::any_of(
      left_out, [&](const NumberRange& gap) { return gap.begin > begin && gap.end < end; });
  if (!part || inside) return missing(left_out, order);
  plan.manifest.part = {order.key(begin), order.key_or_end(end)};
  return plan;
}

}  // namespace

Result<MergeReport> merge_fields(const std::vector<std::string>& parts, const std::string& path,
                                 const MergeOptions& options,
                                 const ProgressCallback& progress) try {
  const auto output =
      SLF_TRY(FieldOutput::at(path, options.replace ? Existing::replace : Existing::keep, parts));
  const auto plan = SLF_TRY(plan_merge(parts, options.part));
  const auto budget = SLF_TRY(WriteBudget::divide(
      options.memory, plan.manifest.shape, thread_count(options.threads), /*copies=*/true, path));
  Progress begin;
  for (const MergeSegment& segment : plan.segments) begin.total += segment.tiles.count();
  Reporter reporter(progress, begin, "merge interrupted; nothing was written");
  SLF_TRY(reporter.add(0));
  auto writer = SLF_TRY(FieldWriter::create(output, FieldWriter::Draft::discard, plan.manifest,
                                            plan.tables, plan.kept));
  MergeReport report{.parts = parts.size()};
  for (const MergeSegment& segment : plan.segments) {
    const std::string& part = parts[segment.source];
    const auto store = SLF_TRY(storage::TileStore::open(part));
    if (store.transaction() != plan.commits[segment.source])
      return fail(ErrorCode::failed, part, ": was changed while it was merged; merge again");
    TileSelection tiles;
    tiles.add(segment.tiles);
    const auto written = SLF_TRY(write_tiles(
        StoredTiles(store), {plan.manifest, budget, nullptr, tiles}, tiles, writer, reporter));
    if (written.missing > 0)
      return fail(ErrorCode::failed, part, ": ", written.missing, " of its tiles are missing");
    SLF_TRY(store.unchanged());
    report.tiles += written.tiles;
    report.payload_bytes += written.payload_bytes;
  }
  SLF_TRY(writer.finish([&] { return reporter.go_on(); }));
  report.file_bytes = file_size(output.target).value_or(0);
  report.memory = budget.memory;
  return report;
} catch (...) {
  return tl::unexpected(error_of_exception());
}

}  // namespace slf

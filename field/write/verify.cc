#include "slf/verify.h"

#include <algorithm>
#include <optional>

#include "base/guarded.h"
#include "base/parallel.h"
#include "base/reporter.h"
#include "base/try.h"
#include "field/tiles/tile_cache.h"
#include "field/write/field_writer.h"
#include "storage/tile_store.h"

namespace slf {
namespace {

using storage::TileRef;
using storage::TileState;

constexpr std::size_t kMaxFindings = 1000;
constexpr std::size_t kCheckedTogether = 256;

class Verifier {
 public:
  Verifier(const VerifyOptions& options, const ProgressCallback& progress)
      : options_(options), progress_(progress) {}

  Result<VerifyReport> run(const std::string& path) {
    SLF_TRY(check(path));
    if (options_.fix) SLF_TRY(drop(path));
    report_.unfixed = report_.damaged - report_.dropped;
    return std::move(report_);
  }

  Result<VerifyReport> run(const Field& field) {
    SLF_TRY(check_structure(field.file().store()));
    SLF_TRY(check_tiles(field.file()));
    report_.unfixed = report_.damaged;
    return std::move(report_);
  }

 private:
  void add(FindingKind kind, std::string message) {
    ++report_.found;
    // The tile is not damaged itself: it decodes again once its reference has been rebuilt.
    if (kind == FindingKind::reference) report_.complete = false;
    if (kind != FindingKind::missing && kind != FindingKind::reference) ++report_.damaged;
    if (report_.findings.size() < kMaxFindings)
      report_.findings.push_back({kind, std::move(message)});
  }
  /// Adds damage that the bytes prove, bad_file. Returns any other error, such as out_of_memory or
  /// io: it says nothing about the bytes, and ends the check. `repair`: what to drop, one tile or
  /// the record that ends with it.
  Result<void> add(FindingKind kind, const Error& error, std::optional<TileKey> repair = {}) {
    if (error.code != ErrorCode::bad_file) return tl::unexpected(error);
    add(kind, error.message);
    if (repair && options_.fix) repairs_.push_back(*repair);
    return {};
  }

  Result<void> check(const std::string& path) {
    auto store = storage::TileStore::open(path);
    if (!store) return add(FindingKind::structure, store.error());
    SLF_TRY(check_structure(*store));
    const auto field = FieldFile::open(*store);
    if (!field) return add(FindingKind::manifest, field.error());
    transaction_ = (*field)->store().transaction();
    return check_tiles(**field);
  }

  Result<void> check_structure(const storage::TileStore& store) {
    std::vector<Error> structural;
    store.check_structure(structural);
    for (const Error& error : structural) SLF_TRY(add(FindingKind::structure, error));
    return {};
  }

  /// Checks what views do not need.
  Result<void> check_kept(const FieldFile& field) {
    if (options_.quick) return {};
    const auto drop = [&](FindingKind kind, const char* blob, const Error& error) {
      if (options_.fix) drop_blobs_.emplace_back(blob);
      return add(kind, error);
    };
    if (const auto light = field.light(); !light)
      SLF_TRY(drop(FindingKind::light, kLightBlob, light.error()));
    const auto code = field.reveal();
    if (!code) return drop(FindingKind::reveal, kRevealBlob, code.error());
    const auto reveal =
        code->empty() ? Result<Reveal>() : decode_reveal(*code, RevealPart::all, options_.threads);
    if (reveal || reveal.error().code == ErrorCode::unsupported) return {};
    return drop(FindingKind::reveal, kRevealBlob,
                {reveal.error().code, field.path() + ": " + reveal.error().message});
  }

  Result<void> check_tiles(const FieldFile& field) {
    SLF_TRY(check_kept(field));
    Progress work;
    for (unsigned level = 0; level <= field.shape().finest_level; ++level)
      work.total += field.shape().tiles(level);
    Reporter reporter(progress_, work, field.path() + ": verify interrupted");
    report_.complete = true;
    TileCache tiles(field, options_.memory / 8);
    std::vector<std::uint64_t> found(field.shape().finest_level + 1);
    std::vector<TileRef> batch;
    Result<void> checked;
    const auto visited = field.store().visit(
        {0, 0}, {255, 0},
        [&](const TileRef& tile) -> Result<void> {
          SLF_TRY(checked);  // what damage met
          ++report_.tiles;
          report_.payload_bytes += tile.payload.size();
          if (!field.shape().has(tile.key))
            return add(
                FindingKind::key,
                {ErrorCode::bad_file, field.place(tile.key) + ": this field has no such tile"},
                tile.key);
          if (field.manifest().holds(tile.key)) ++found[tile.key.level];
          if (tile.state == TileState::stored) batch.push_back(tile);
          if (tile.state == TileState::same) checked = check_same(field, tile);
          if (checked && batch.size() == kCheckedTogether) checked = check_payloads(tiles, batch);
          if (checked) checked = reporter.add(1);
          return checked;
        },
        [&](const storage::Damage& damage) {
          if (auto ok = add(FindingKind::record, damage, damage.last); !ok) checked = ok;
        });
    SLF_TRY(std::move(checked));
    if (!visited) SLF_TRY(add(FindingKind::structure, visited.error()));
    SLF_TRY(check_payloads(tiles, batch));
    for (unsigned level = 0; level < found.size(); ++level)
      compare_count(field, level, found[level]);
    return {};
  }

  Result<void> check_same(const FieldFile& field, const TileRef& tile) {
    const auto found = field.store().find(tile.key);
    if (!found && found.error().code != ErrorCode::bad_file) return tl::unexpected(found.error());
    if (!found || found->state == TileState::missing)
      add(FindingKind::reference,
          field.place(tile.key) + ": tile " + storage::name(tile.source) +
              ", which it is the same as, is missing; build the field again");
    return {};
  }

  void compare_count(const FieldFile& field, unsigned level, std::uint64_t found) {
    const std::uint64_t expected = field.manifest().tiles(level);
    if (found == expected) return;
    report_.complete = false;
    add(FindingKind::missing, field.path() + ": level " + std::to_string(level) + ": " +
                                  std::to_string(found) + " of " + std::to_string(expected) +
                                  " tiles; the build command that made it fills it");
  }

  /// Checks and decodes tiles on all threads, and clears `tiles`.
  Result<void> check_payloads(TileCache& cache, std::vector<TileRef>& tiles) {
    if (!options_.quick) {
      std::vector<TileKey> keys(tiles.size());
      std::ranges::transform(tiles, keys.begin(), &TileRef::key);
      const FoundTiles found = cache.find(keys);
      std::vector<Fault> faults(tiles.size());
      auto checked = parallel_for(tiles.size(), options_.threads, [&](std::uint64_t k) {
        faults[k] = check_payload(cache, tiles[k], found);
      });
      cache.field().store().release(tiles);
      if (!checked) return checked;
      for (std::size_t k = 0; k < tiles.size(); ++k) {
        if (faults[k].kind == FindingKind::reference)
          add(FindingKind::reference, std::move(faults[k].error->message));
        else if (faults[k].error)
          SLF_TRY(add(faults[k].kind, *faults[k].error, tiles[k].key));
      }
    }
    tiles.clear();
    return {};
  }

  /// What is wrong with a tile, or what kept it from being checked.
  struct Fault {
    FindingKind kind = FindingKind::decode;
    std::optional<Error> error{};
  };
  static Fault check_payload(TileCache& tiles, const TileRef& tile, const FoundTiles& found) {
    const FieldFile& field = tiles.field();
    if (auto ok = field.store().check(tile); !ok) return {FindingKind::checksum, ok.error()};
    const auto read = tiles.read(tile.key, found);
    // In a part, the tiles that this one is predicted from may be in another file. Then only its
    // checksum can be checked.
    if (read || (field.manifest().part && read.error().code == ErrorCode::tile_missing)) return {};
    const auto references = references_decode(tiles, tile);
    if (!references) return {FindingKind::decode, references.error()};
    if (*references) return {FindingKind::decode, read.error()};
    return {FindingKind::reference,
            {{ErrorCode::bad_file, field.place(tile.key) + ": " + read.error().message}}};
  }

  /// Whether the tiles that a tile is predicted from decode. Errors that prove no damage.
  static Result<bool> references_decode(TileCache& tiles, const TileRef& tile) {
    const auto named = tiles.field().references(tile);
    if (!named && named.error().code == ErrorCode::bad_file) return true;  // the tile is wrong
    if (!named) return tl::unexpected(named.error());
    for (const TileKey reference : *named) {
      const auto pin = tiles.load(reference);
      if (!pin && pin.error().code != ErrorCode::bad_file) return tl::unexpected(pin.error());
      if (!pin || pin->state() == TileState::missing) return false;
    }
    return true;
  }

  /// Drops the tiles and records that the repairs name. Findings without a repair (S1, M1) remain.
  /// If the structure is damaged (S1), drops nothing.
  Result<void> drop(const std::string& path) {
    const bool sound =
        std::none_of(report_.findings.begin(), report_.findings.end(),
                     [](const Finding& finding) { return finding.kind == FindingKind::structure; });
    if ((repairs_.empty() && drop_blobs_.empty()) || !sound) return {};
    auto writer = SLF_TRY(FieldWriter::edit(path, transaction_));
    writer.set_pending_limit(options_.memory / 3);
    for (const TileKey repair : repairs_) {
      auto ok = writer.drop(repair);
      if (!ok && ok.error().code != ErrorCode::usage && ok.error().code != ErrorCode::bad_file)
        return ok;  // an error that concerns more than this tile
      if (ok) ++report_.dropped;
    }
    for (const std::string& blob : drop_blobs_) {
      SLF_TRY(writer.keep(blob, {}));
      ++report_.dropped;
    }
    if (!repairs_.empty()) report_.complete = false;
    return writer.finish();
  }

  const VerifyOptions& options_;
  const ProgressCallback& progress_;
  VerifyReport report_;
  std::vector<TileKey> repairs_;  ///< one for each finding that has one
  std::vector<std::string> drop_blobs_;
  std::uint64_t transaction_ = 0;  ///< the commit that was checked
};

}  // namespace

const char* id(FindingKind kind) {
  constexpr const char* kIds[] = {"S1", "M1", "L1", "V1", "R1", "K1", "T1", "T2", "T3", "C1"};
  return kIds[static_cast<int>(kind)];
}

Result<VerifyReport> verify_field(const std::string& path, const VerifyOptions& options,
                                  const ProgressCallback& progress) {
  return guarded([&] { return Verifier(options, progress).run(path); });
}

Result<VerifyReport> verify_field(const Field& field, const VerifyOptions& options,
                                  const ProgressCallback& progress) {
  if (options.fix) return misuse(field.path(), "only a file that is named can be fixed");
  return guarded([&] { return Verifier(options, progress).run(field); });
}

}  // namespace slf

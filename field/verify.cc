#include "field/verify.h"

#include <algorithm>
#include <mutex>

#include "field/field.h"
#include "field/parallel.h"
#include "storage/tile_store.h"

namespace slf {
namespace {

using storage::LayerId;
using storage::TileRef;
using storage::TileState;

constexpr std::size_t kMostFindings = 1000;
constexpr std::size_t kBatch = 256;

/// A tile that must go.
struct Damaged {
  LayerId layer;
  TileKey key;
};

class Verifier {
 public:
  Verifier(const VerifyOptions& options, const ProgressCallback& progress)
      : options_(options), progress_(progress) {}

  Result<VerifyReport> run(const std::string& path) {
    {
      const auto store = storage::TileStore::open(path);
      if (!store) {
        if (store.error().code != ErrorCode::bad_file) return tl::unexpected(store.error());
        add(FindingKind::structure, store.error().message);
        return std::move(report_);
      }
      std::vector<Error> structural;
      store->check_structure(structural);
      for (const Error& error : structural) add(FindingKind::structure, error.message);
      fixable_ = structural.empty();
    }
    auto field = Field::open(path);
    if (!field) {
      if (field.error().code == ErrorCode::unsupported) return tl::unexpected(field.error());
      add(FindingKind::manifest, field.error().message);
      return std::move(report_);
    }
    if (auto ok = check_tiles(**field); !ok) return tl::unexpected(ok.error());
    field->reset();
    if (options_.fix)
      if (auto ok = drop(path); !ok) return tl::unexpected(ok.error());
    return std::move(report_);
  }

 private:
  void add(FindingKind kind, std::string message) {
    const std::lock_guard lock(mutex_);
    ++report_.found;
    if (report_.findings.size() < kMostFindings)
      report_.findings.push_back({kind, std::move(message)});
  }
  void add_damaged(FindingKind kind, std::string message, LayerId layer, TileKey key) {
    add(kind, std::move(message));
    const std::lock_guard lock(mutex_);
    damaged_.push_back({layer, key});
  }

  Result<void> check_tiles(const Field& field) {
    Progress state;
    for (unsigned level = 0; level <= field.shape().levels; ++level)
      state.total += field.shape().tiles(level) * field.manifest().layers.size();
    bool stopped = false;
    report_.complete = true;
    for (LayerId layer = 0; layer < field.manifest().layers.size(); ++layer) {
      const std::string& name = field.manifest().layers[layer].name;
      std::vector<std::uint64_t> found(field.shape().levels + 1);
      std::vector<TileRef> batch;
      const auto flush = [&] {
        if (!options_.quick) check_payloads(field, batch);
        batch.clear();
      };
      const auto visited = field.store().visit(
          layer, {0, 0}, {255, 0},
          [&](const TileRef& tile) -> Result<void> {
            ++report_.tiles;
            report_.payload_bytes += tile.payload.size();
            if (!field.shape().has(tile.key)) {
              add(FindingKind::key, place(field, tile) + ": this field has no such tile");
              return {};
            }
            ++found[tile.key.level];
            if (tile.state == TileState::stored) batch.push_back(tile);
            if (layer > 0) compare_states(field, tile);
            if (batch.size() == kBatch) flush();
            ++state.done;
            if (progress_ && !progress_(state)) {
              stopped = true;
              return fail(ErrorCode::failed, field.path(), ": interrupted");
            }
            return {};
          },
          [&](const storage::Damage& damage) {
            add_damaged(FindingKind::record, damage.message, layer, damage.last);
          });
      flush();
      if (stopped) return tl::unexpected(visited.error());
      if (!visited) add(FindingKind::structure, visited.error().message);
      for (unsigned level = 0; level < found.size(); ++level)
        if (found[level] != field.shape().tiles(level)) {
          report_.complete = false;
          add(FindingKind::missing, field.path() + ": layer '" + name + "', level " +
                                        std::to_string(level) + ": " +
                                        std::to_string(found[level]) + " of " +
                                        std::to_string(field.shape().tiles(level)) +
                                        " tiles; the build command that made it fills it");
        }
    }
    return {};
  }

  static std::string place(const Field& field, const TileRef& tile) {
    return field.path() + ": layer '" + field.manifest().layers[tile.layer].name + "', tile " +
           std::to_string(tile.key.level) + "/" + std::to_string(tile.key.index);
  }

  void compare_states(const Field& field, const TileRef& tile) {
    const auto first = field.store().find(0, tile.key);
    if (first && first->state != TileState::missing && first->state != tile.state)
      add(FindingKind::mismatch,
          place(field, tile) + ": is " + (tile.state == TileState::empty ? "empty" : "stored") +
              ", but not so in layer '" + field.manifest().layers[0].name + "'");
  }

  void check_payloads(const Field& field, const std::vector<TileRef>& tiles) {
    field.store().advise(tiles);
    parallel_for(tiles.size(), options_.threads, [&](std::uint64_t k) {
      const TileRef& tile = tiles[k];
      if (auto ok = field.store().check(tile); !ok)
        return add_damaged(FindingKind::checksum, ok.error().message, tile.layer, tile.key);
      thread_local Bytes samples;
      samples.resize(field.tile_shape(tile.layer, tile.key).bytes());
      if (auto ok = field.decode(tile, samples); !ok)
        add_damaged(FindingKind::decode, ok.error().message, tile.layer, tile.key);
    });
    field.store().release(tiles);
  }

  Result<void> drop(const std::string& path) {
    if (damaged_.empty()) return {};
    if (!fixable_)
      return fail(ErrorCode::bad_file, path,
                  ": the file's structure is damaged, so nothing in it can be replaced in place; "
                  "build it anew, or restore a copy");
    auto writer = storage::TileWriter::resume(path);
    if (!writer) return tl::unexpected(writer.error());
    for (const Damaged& tile : damaged_) {
      if (auto ok = writer->replace(tile.layer, tile.key, TileState::missing, {}); !ok) return ok;
      ++report_.dropped;
    }
    report_.complete = false;
    return writer->close();
  }

  const VerifyOptions& options_;
  const ProgressCallback& progress_;
  VerifyReport report_;
  std::mutex mutex_;
  std::vector<Damaged> damaged_;
  bool fixable_ = true;
};

}  // namespace

const char* id(FindingKind kind) {
  constexpr const char* kIds[] = {"S1", "M1", "R1", "K1", "T1", "T2", "C1", "C2"};
  return kIds[static_cast<int>(kind)];
}

Result<VerifyReport> verify_field(const std::string& path, const VerifyOptions& options,
                                  const ProgressCallback& progress) {
  return Verifier(options, progress).run(path);
}

}  // namespace slf

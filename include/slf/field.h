// Field: an open sphere light field.
//
//   auto field = slf::Field::open("brain.slf");
//   if (!field) return report(field.error());
//   slf::Renderer renderer(*field);
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "slf/error.h"
#include "slf/reveal.h"
#include "slf/shape.h"
#include "slf/tile.h"

namespace slf {

class FieldFile;  // internal
struct Structure;

/// How much of a level exists. Reports describe their members (base/report.h).
struct LevelContent {
  unsigned level = 0;
  std::uint64_t tiles = 0, stored = 0, empty = 0, slabs = 0, payload_bytes = 0;
  std::optional<std::uint64_t> same{};
  std::uint32_t entry_resolution = 0, exit_resolution = 0;

  static constexpr const char* kPython = "Level";
  void describe(auto& member) const {
    member("level", level, "0 is the coarsest");
    member("tiles", tiles, "of the complete level");
    member("stored", stored, "tiles with a payload");
    member("empty", empty, "tiles that were built and show nothing");
    member("slabs", slabs, "rays of the level");
    member("payload_bytes", payload_bytes, "of the tiles");
    member("same", same ? &*same : nullptr,
           "tiles that are stored with an earlier state; only of fields with states");
    member("entry_resolution", entry_resolution, "cells", R"("minimum": 1)");
    member("exit_resolution", exit_resolution, "cells", R"("minimum": 1)");
  }
};

struct FieldContent {
  std::vector<LevelContent> levels;
  bool complete = false;
  std::uint64_t file_bytes = 0, payload_bytes = 0;

  static constexpr const char* kPython = "Content";
  void describe(auto& member) const {
    member("levels", levels, "by level");
    member("complete", complete, "no tile of the field, or of its part, is missing");
    member("file_bytes", file_bytes, "size of the file");
    member("payload_bytes", payload_bytes, "sum of all payloads");
  }
};

/// A read-only snapshot of a field: the last commit before it was opened. A handle: copies are
/// cheap and share one open file. A Renderer keeps a copy, so the Field need not outlive it. The
/// file is untrusted. Thread-safety: immutable; any thread.
class Field {
 public:
  /// Opens a field, complete or not. not_found: there is no file. io: unreadable. bad_file:
  /// damaged, truncated, not a field. unsupported: another version of the format.
  [[nodiscard]] static Result<Field> open(const std::string& path);

  [[nodiscard]] const std::string& path() const;
  [[nodiscard]] const FieldShape& shape() const;
  [[nodiscard]] SampleFormat format() const;
  /// The specification of the codec, such as "jpeg:75".
  [[nodiscard]] const std::string& codec() const;
  /// Whether samples have depths beside their colours.
  [[nodiscard]] bool has_depth() const { return slf::has_depth(format()); }
  /// If this file is one part of a field that is built in several (build.h): the tiles of that
  /// part, of each state by their keys in the first.
  [[nodiscard]] std::optional<TileRange> part() const;
  /// The names of the states: variants of the object on one sphere; none if there is just one.
  [[nodiscard]] std::vector<std::string> states() const;
  /// The state that this shows: 0 after open().
  [[nodiscard]] unsigned state() const { return state_; }
  /// Another state, of the same snapshot. To all that reads it, it is a field of its own. usage:
  /// there is no such state. `name` may also be the number of a state.
  [[nodiscard]] Result<Field> in_state(unsigned state) const;
  [[nodiscard]] Result<Field> in_state(const std::string& name) const;
  /// The source and the settings of the build: a JSON object without a fixed schema. Of a composed
  /// field, those of a build that shows the labels of all its structures, if they have labels and
  /// are neither faded nor tinted; else it has the member "composed", their number.
  [[nodiscard]] std::string provenance() const;
  /// Whether colours are linear radiance, which map_tones() in render.h shows.
  [[nodiscard]] bool linear() const;
  /// The light of its scene (Scene::light()); no bytes if the field has none. bad_file: it is
  /// damaged.
  [[nodiscard]] Result<std::vector<std::byte>> light() const;
  /// The small copy of the volume that this state shows; none if the field has none, or that of
  /// another volume. bad_file: it is damaged. unsupported: it is of a later version.
  [[nodiscard]] Result<std::optional<Reveal>> reveal(RevealPart part = RevealPart::all) const;
  /// The whole manifest, a JSON object (FORMAT.md).
  [[nodiscard]] std::string manifest() const;
  [[nodiscard]] std::uint64_t file_bytes() const;

  /// Counts the tiles and bytes of each level. Reads the records' tables and no payload; the time
  /// is linear in the number of records. bad_file: a page or a record's table is damaged.
  [[nodiscard]] Result<FieldContent> content() const;

  /// What compose() made it of; null if it is a file's own content.
  [[nodiscard]] const std::vector<Structure>* structures() const { return structures_.get(); }

  /// For slf's own libraries; the type is not installed.
  [[nodiscard]] const FieldFile& file() const { return *file_; }
  [[nodiscard]] static Field of(std::shared_ptr<const FieldFile> file) {
    return Field(std::move(file));
  }

 private:
  explicit Field(std::shared_ptr<const FieldFile> file) : file_(std::move(file)) {}
  friend Result<Field> compose(const Field& field, std::vector<Structure> structures);
  std::shared_ptr<const FieldFile> file_;
  unsigned state_ = 0;
  std::shared_ptr<const std::vector<Structure>> structures_;
};

/// A field that is drawn together with others.
struct Structure {
  Field field;
  float opacity = 1;  ///< 0 to 1, of all that it shows; 0: hidden, nothing of it is read
  std::array<float, 3> tint{1, 1, 1};  ///< sRGB, 0 to 1: its colours are multiplied by this
};

/// The field that shows structures together, in place of what `field` itself shows. Along each
/// stored ray the nearest structure is over those behind it; at one depth, those that come first in
/// the list are in front. So where surfaces are opaque, and further apart than depths are precise,
/// it has the samples of one field of all of them. Each structure counts with the mean depth of a
/// ray, so matter that is translucent must not interleave.
///
/// The result is read as other fields are, but of what describes it, everything except `format`
/// and `shape` is that of `field`. Cost is linear in the number of visible structures.
/// usage: an opacity or tint out of range; a structure that is composed itself, without depth, or
/// on another sphere, lattice or kind of colour than `field`; the message names it.
[[nodiscard]] Result<Field> compose(const Field& field, std::vector<Structure> structures);

}  // namespace slf

#include "field/manifest.h"

#include <algorithm>
#include <set>

#include "base/try.h"
#include "codec/codec.h"
#include "field/geometry/tile_order.h"

namespace slf {
namespace {

constexpr int kMaxNesting = 64;
constexpr std::size_t kMaxBytes = std::size_t{16} << 20;  // parsed, it takes some 40 times as much
constexpr std::uint32_t kMaxKeyLevel = 11;  // the end of a range may be one above level 10

constexpr SampleFormat kFormats[] = {SampleFormat::rgba8, SampleFormat::rgba16f,
                                     SampleFormat::rgba8_depth8, SampleFormat::rgba16f_depth8};

constexpr unsigned kMaxPredictedLevels = 6;

/// A required feature: tiles that are predicted from coarser ones.
constexpr const char* kPredictive = "predictive";
/// Another: several states, some of whose tiles are the same.
constexpr const char* kStates = "states";
/// A third: tiles that keep rays of the same tile of an earlier state.
constexpr const char* kKeptRays = "kept rays";

/// Reads members of untrusted JSON. Records the first error and its place.
class Reader {
 public:
  Reader(const nlohmann::json& root, std::string file) : root_(root), file_(std::move(file)) {}

  const nlohmann::json* find(const std::string& pointer) {
    const nlohmann::json::json_pointer at(pointer);
    if (root_.contains(at)) return &root_.at(at);
    problem(pointer, "is missing");
    return nullptr;
  }
  double number(const std::string& pointer) {
    const auto* value = find(pointer);
    if (!value) return 0;
    if (!value->is_number()) return problem(pointer, "is not a number"), 0;
    return value->get<double>();
  }
  std::uint32_t integer(const std::string& pointer, std::uint32_t max) {
    const auto* value = find(pointer);
    if (!value) return 0;
    if (!value->is_number_unsigned() || value->get<std::uint64_t>() > max)
      return problem(pointer, "is not an integer from 0 to " + std::to_string(max)), 0;
    return value->get<std::uint32_t>();
  }
  std::string text(const std::string& pointer) {
    const auto* value = find(pointer);
    if (!value) return {};
    if (!value->is_string()) return problem(pointer, "is not a string"), std::string{};
    return value->get<std::string>();
  }
  /// A tile's key as [level, index].
  TileKey key(const std::string& pointer) {
    const std::uint32_t level = integer(pointer + "/0", kMaxKeyLevel);
    const auto* index = find(pointer + "/1");
    if (index && !index->is_number_unsigned())
      problem(pointer + "/1", "is not an index"), index = nullptr;
    return {static_cast<std::uint8_t>(level), index ? index->get<std::uint64_t>() : 0};
  }
  void problem(const std::string& pointer, const std::string& what) {
    if (error_.empty()) error_ = file_ + ": manifest: " + pointer + " " + what;
  }
  [[nodiscard]] const std::string& error() const { return error_; }

 private:
  const nlohmann::json& root_;
  std::string file_;
  std::string error_;
};

/// unsupported: another major version, or a required feature that this program does not have.
Result<void> check_version(Reader& in, const std::string& file) {
  const std::uint32_t major = in.integer("/slf/major", 1u << 20);
  if (in.error().empty() && major != Manifest::kMajor)
    return unsupported(
        file, "format version ", major, ", this program reads version ", Manifest::kMajor,
        major > Manifest::kMajor ? "; update slf" : "; slf 0.2 or older wrote it: build it anew");
  const auto* required = in.find("/required");
  const auto known_feature = [](const nlohmann::json& feature) {
    const auto* name = feature.get_ptr<const std::string*>();
    return name && (*name == kPredictive || *name == kStates || *name == kKeptRays);
  };
  if (required && !required->is_array())
    in.problem("/required", "is not an array");
  else if (required && !std::all_of(required->begin(), required->end(), known_feature))
    return unsupported(file, "needs features this program does not have: ",
                       required->dump(-1, ' ', false, nlohmann::json::error_handler_t::replace),
                       "; update slf");
  return {};
}

FieldShape read_shape(Reader& in, const nlohmann::json& json) {
  FieldShape shape;
  for (int axis = 0; axis < 3; ++axis)
    shape.sphere.center[axis] = in.number("/sphere/center/" + std::to_string(axis));
  shape.sphere.radius = in.number("/sphere/radius");
  shape.entry_side = in.integer("/entry_side", FieldShape::kMaxSide);
  shape.exit_side = in.integer("/exit_side", FieldShape::kMaxSide);
  shape.finest_level = in.integer("/levels", 10);
  shape.entry_extra_levels = in.integer("/entry_depth", 8);
  if (!json.contains("subfields")) return shape;
  const nlohmann::json& subfields = json["subfields"];
  if (!subfields.is_array() || subfields.size() > 64) {
    in.problem("/subfields", "is not an array of at most 64 numbers");
    return shape;
  }
  for (std::size_t k = 0; k < subfields.size(); ++k)
    shape.subfields.push_back(
        static_cast<std::uint8_t>(in.integer("/subfields/" + std::to_string(k), 63)));
  return shape;
}

std::vector<Manifest::State> read_states(Reader& in, const nlohmann::json& json) {
  std::vector<Manifest::State> states;
  if (!json.is_array() || json.size() < 2 || json.size() > kMaxStates)
    return in.problem("/states", "is not an array of 2 to " + std::to_string(kMaxStates)), states;
  for (const nlohmann::json& one : json) {
    const std::string at = "/states/" + std::to_string(states.size());
    Manifest::State& state = states.emplace_back();
    state.name = in.text(at + "/name");
    if (state.name.empty()) in.problem(at + "/name", "is empty");
    state.provenance = nlohmann::json::object();
    if (!one.is_object() || !one.contains("provenance")) continue;
    if (!one["provenance"].is_object()) in.problem(at + "/provenance", "is not an object");
    state.provenance = one["provenance"];
  }
  return states;
}

SampleFormat read_format(Reader& in) {
  const std::string format = in.text("/format");
  for (const SampleFormat known : kFormats)
    if (format == name(known)) return known;
  in.problem("/format", "is not a known sample format");
  return SampleFormat::rgba8;
}

/// The members of a JSON object that differ from those of another one, as a merge patch.
OwnedJson difference(const nlohmann::json& from, const nlohmann::json& to) {
  OwnedJson patch = nlohmann::json::object();
  for (const auto& [name, value] : to.items()) {
    const auto old = from.find(name);
    if (old == from.end())
      (*patch)[name] = value;
    else if (*old != value)
      (*patch)[name] = old->is_object() && value.is_object() ? *difference(*old, value) : value;
  }
  for (const auto& [name, value] : from.items())
    if (!to.contains(name)) (*patch)[name] = nullptr;
  return patch;
}

}  // namespace

Result<void> Manifest::set_states(std::span<const std::pair<std::string, OwnedJson>> provenances) {
  provenance = provenances[0].second;
  states.clear();
  keeps_rays = provenances.size() > 1;
  shape.states = static_cast<unsigned>(provenances.size());
  if (shape.states == 1) return {};
  std::set<std::string> names;
  for (const auto& [name, own] : provenances) {
    if (name.empty() || !names.insert(name).second)
      return fail(ErrorCode::usage, "state ", states.size(), " has ",
                  name.empty() ? "no name" : "the name of another: ", name);
    states.push_back({name, difference(*provenance, *own)});
  }
  return {};
}

Result<void> Manifest::check() const {
  // A tile's payload has a decision for each candidate reference in the next coarser level.
  if (codec::is_predictive(codec) && shape.finest_level > kMaxPredictedLevels)
    return fail_without("levels", ErrorCode::usage, "levels ", shape.finest_level,
                        ": with the codec ", codec, " expected at most ", kMaxPredictedLevels);
  return shape.check();
}

OwnedJson Manifest::to_json() const {
  using nlohmann::json;
  OwnedJson owned = json::object();
  json& all = *owned;
  all["slf"] = json::object();  // no shorter: see base/owned_json.h
  all["slf"]["major"] = kMajor;
  all["slf"]["minor"] = 0;
  all["required"] = json::array();
  if (codec::is_predictive(codec)) all["required"].push_back(kPredictive);
  if (!states.empty()) all["required"].push_back(kStates);
  if (keeps_rays && codec::is_predictive(codec)) all["required"].push_back(kKeptRays);
  for (const State& state : states) {
    json& one = all["states"].emplace_back();
    one["name"] = state.name;
    if (!state.provenance->empty()) one["provenance"] = *state.provenance;
  }
  all["sphere"] = json::object();
  all["sphere"]["center"] = json::array();
  for (int axis = 0; axis < 3; ++axis) all["sphere"]["center"].push_back(shape.sphere.center[axis]);
  all["sphere"]["radius"] = shape.sphere.radius;
  all["entry_side"] = shape.entry_side;
  all["exit_side"] = shape.exit_side;
  all["levels"] = shape.finest_level;
  all["entry_depth"] = shape.entry_extra_levels;
  all["format"] = name(format);
  all["codec"] = codec;
  all["provenance"] = *provenance;
  if (!shape.subfields.empty()) all["subfields"] = shape.subfields;
  all["filtered_levels"] = filtered_levels;
  if (!part) return owned;
  all["part"] = json::object();
  for (const auto& [name, key] : {std::pair{"begin", part->begin}, {"end", part->end}}) {
    all["part"][name] = json::array();
    all["part"][name].push_back(key.level);
    all["part"][name].push_back(key.index);
  }
  return owned;
}

OwnedJson Manifest::provenance_of(unsigned state) const {
  OwnedJson own = *provenance;
  if (state < states.size()) own->merge_patch(*states[state].provenance);
  return own;
}

const nlohmann::json* Manifest::provenance_at(unsigned state,
                                              std::initializer_list<const char*> path) const {
  const auto member = [](const nlohmann::json* of, const char* name) {
    const bool has = of && of->is_object() && of->contains(name);
    return has ? &*of->find(name) : nullptr;
  };
  const nlohmann::json* value = &*provenance;
  const nlohmann::json* patch = state < states.size() ? &*states[state].provenance : nullptr;
  for (const char* const name : path) {
    value = member(value, name);
    patch = member(patch, name);
    if (patch && !patch->is_object()) value = std::exchange(patch, nullptr);
  }
  return !value || value->is_object() || value->is_null() || patch ? nullptr : value;
}

std::uint64_t Manifest::tiles(unsigned level) const {
  if (!part) return shape.tiles(level);
  const TileOrder order(one_state(shape));
  const NumberRange own{order.number(part->begin), order.number(part->end)};
  return shape.states * own.within(order.level(level)).count();
}

Result<Manifest> Manifest::parse(std::string_view text, const std::string& file) {
  if (text.size() > kMaxBytes)
    return bad_file(file, "the manifest has ", text.size(), " bytes, more than ", kMaxBytes);
  // Copying and printing JSON is recursive: limit its depth to protect the stack.
  bool too_deep = false;
  const auto limit_depth = [&](int depth, nlohmann::json::parse_event_t, nlohmann::json&) {
    too_deep |= depth > kMaxNesting;
    return !too_deep;
  };
  const OwnedJson owned = nlohmann::json::parse(text, limit_depth, /*allow_exceptions=*/false);
  const nlohmann::json& json = *owned;
  if (too_deep) return bad_file(file, "the manifest is nested deeper than ", kMaxNesting);
  if (!json.is_object()) return bad_file(file, "the manifest is not JSON");
  Reader in(json, file);
  SLF_TRY(check_version(in, file));

  Manifest manifest;
  manifest.shape = read_shape(in, json);
  manifest.filtered_levels = json.contains("filtered_levels") ? in.integer("/filtered_levels", 10)
                                                              : manifest.shape.finest_level;
  if (json.contains("part")) {
    manifest.part = {in.key("/part/begin"), in.key("/part/end")};
    if (manifest.part->end < manifest.part->begin) in.problem("/part/end", "is before /part/begin");
  }
  if (json.contains("states")) manifest.states = read_states(in, json["states"]);
  manifest.shape.states = std::max<unsigned>(1, static_cast<unsigned>(manifest.states.size()));
  const auto* required = in.find("/required");
  // Comparing JSON with text would allocate where no exception may leave.
  manifest.keeps_rays =
      required && std::ranges::any_of(*required, [](const auto& feature) {
        return feature.is_string() && feature.template get_ref<const std::string&>() == kKeptRays;
      });
  manifest.format = read_format(in);
  manifest.codec = in.text("/codec");
  if (json.contains("provenance") && !json["provenance"].is_object())
    in.problem("/provenance", "is not an object");
  if (!in.error().empty()) return fail(ErrorCode::bad_file, in.error());
  if (auto ok = manifest.check(); !ok) return bad_file(file, "manifest: ", ok.error().message);
  manifest.provenance = json.contains("provenance") ? json["provenance"] : nlohmann::json::object();
  return manifest;
}

std::string first_difference(const Manifest& existing, const Manifest& expected) {
  const bool by_content = existing.provenance->contains("content");
  const auto comparable = [&](const Manifest& manifest) {
    OwnedJson json = manifest.to_json();
    const auto drop = [](nlohmann::json& from, const char* member) {
      const OwnedJson dropped = std::move(from[member]);
      from.erase(member);
    };
    for (const char* member : {"slf", "required", "filtered_levels", "part"}) drop(*json, member);
    for (const char* ignored : {by_content ? "source" : "content", "space", "recipe"}) {
      drop((*json)["provenance"], ignored);
      if (json->contains("states"))
        for (nlohmann::json& state : (*json)["states"]) drop(state["provenance"], ignored);
    }
    return json;
  };
  const OwnedJson patch = nlohmann::json::diff(*comparable(existing), *comparable(expected));
  std::string path = patch->empty() ? "" : patch->at(0).value("path", "");
  if (path.ends_with("/-")) path.resize(path.size() - 2);  // a further element of an array
  return path;
}

}  // namespace slf

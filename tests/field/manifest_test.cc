#include "field/manifest.h"

#include <gtest/gtest.h>

#include "slf/field.h"
#include "storage/tile_writer.h"
#include "tests/field/field_testing.h"

namespace slf {
namespace {

Manifest example() {
  Manifest manifest;
  manifest.shape.sphere = {{1.5, -2, 3}, 98.25};
  manifest.shape.entry_side = 16;
  manifest.shape.exit_side = 24;
  manifest.shape.finest_level = 3;
  manifest.shape.entry_extra_levels = 2;
  manifest.format = SampleFormat::rgba8_depth8;
  manifest.codec = "jpeg:75";
  manifest.provenance = nlohmann::json{{"kind", "scene"}, {"name", "balls"}};
  return manifest;
}

ErrorCode parse_error(const nlohmann::json& json) {
  const auto parsed = Manifest::parse(json.dump(), "x.slf");
  EXPECT_FALSE(parsed);
  if (parsed) return ErrorCode::failed;
  EXPECT_NE(parsed.error().message.find("x.slf"), std::string::npos);
  return parsed.error().code;
}

TEST(Manifest, RoundTrips) {
  const auto parsed = Manifest::parse(example().to_json()->dump(), "x.slf");
  ASSERT_TRUE(parsed) << parsed.error().message;
  EXPECT_EQ(parsed->to_json(), example().to_json());
}

TEST(Manifest, StatesDifferFromTheFirst) {
  Manifest manifest = example();
  EXPECT_FALSE(manifest.to_json()->contains("states"));
  manifest.states = {{"whole", nlohmann::json::object()},
                     {"cut", nlohmann::json{{"name", nullptr}, {"clip", {1, 2}}}}};
  const nlohmann::json good = *manifest.to_json();
  EXPECT_EQ(good["required"], nlohmann::json{"states"});
  const auto parsed = Manifest::parse(good.dump(), "x.slf");
  ASSERT_TRUE(parsed) << parsed.error().message;
  EXPECT_EQ(parsed->shape.states, 2u);
  EXPECT_EQ(parsed->shape.tiles(1), 2 * example().shape.tiles(1));
  EXPECT_EQ(*parsed->provenance_of(0), *example().provenance);
  EXPECT_EQ(*parsed->provenance_of(1), (nlohmann::json{{"kind", "scene"}, {"clip", {1, 2}}}));
  for (const auto& [at, wrong] : std::vector<std::pair<const char*, nlohmann::json>>{
           {"/states", 1},
           {"/states", nlohmann::json::array()},
           {"/states", nlohmann::json(4097, good["states"][0])},
           {"/states/1", "cut"},
           {"/states/1/name", ""},
           {"/states/1/name", 5},
           {"/states/0/provenance", 5}}) {
    nlohmann::json broken = good;
    broken[nlohmann::json::json_pointer(at)] = wrong;
    EXPECT_EQ(parse_error(broken), ErrorCode::bad_file) << at << " " << wrong;
  }
}

TEST(Manifest, EveryMemberIsNeededAndChecked) {
  const nlohmann::json good = *example().to_json();
  for (const char* at : {"/slf/major", "/sphere/radius", "/sphere/center/1", "/entry_side",
                         "/exit_side", "/levels", "/entry_depth", "/format", "/codec"}) {
    const nlohmann::json::json_pointer pointer(at);
    nlohmann::json broken = good;
    auto& parent = broken[pointer.parent_pointer()];
    if (parent.is_array())
      parent = nlohmann::json::array();
    else
      parent.erase(pointer.back());
    EXPECT_EQ(parse_error(broken), ErrorCode::bad_file) << at;
    for (const auto& wrong :
         std::vector<nlohmann::json>{nullptr, "?", -1, 1e300, nlohmann::json::object()}) {
      broken = good;
      broken[pointer] = wrong;
      if (wrong == "?" && std::string(at).ends_with("codec")) continue;
      if (std::string(at).starts_with("/sphere/center") && wrong == -1) continue;
      EXPECT_EQ(parse_error(broken), ErrorCode::bad_file) << at << " " << wrong;
    }
  }
  EXPECT_EQ(parse_error("text"), ErrorCode::bad_file);
  EXPECT_FALSE(Manifest::parse("{", "x.slf"));
  EXPECT_FALSE(Manifest::parse("", "x.slf"));
  EXPECT_FALSE(Manifest::parse(std::string(100000, '['), "x.slf"));
}

TEST(Manifest, MembersThatOthersRelyOnHaveTheRightKind) {
  const nlohmann::json good = *example().to_json();
  const auto with = [&](const char* at, const nlohmann::json& value) {
    nlohmann::json json = good;
    json[nlohmann::json::json_pointer(at)] = value;
    return json;
  };
  EXPECT_EQ(parse_error(with("/provenance", 7)), ErrorCode::bad_file);
  EXPECT_EQ(parse_error(with("/format", "depth8")), ErrorCode::bad_file);
  EXPECT_EQ(parse_error(with("/subfields", {{"0", 3}})), ErrorCode::bad_file);
  EXPECT_EQ(parse_error(with("/subfields", std::vector<int>(65, 1))), ErrorCode::bad_file);
  nlohmann::json none = good;
  none.erase("provenance");
  EXPECT_TRUE(Manifest::parse(none.dump(), "x.slf")->provenance->is_object());
  // A million levels would end the process when they are copied or printed.
  std::string deep = good.dump();
  deep.insert(deep.size() - 1,
              ",\"more\":" + std::string(1000000, '[') + std::string(1000000, ']'));
  const auto parsed = Manifest::parse(deep, "x.slf");
  ASSERT_FALSE(parsed);
  EXPECT_NE(parsed.error().message.find("nested"), std::string::npos) << parsed.error().message;
}

TEST(Manifest, SaysWhichLevelsAreFiltered) {
  Manifest manifest = example();
  nlohmann::json without = *manifest.to_json();
  without.erase("filtered_levels");  // as builds did that did not record it
  const auto earlier = Manifest::parse(without.dump(), "x.slf");
  ASSERT_TRUE(earlier) << earlier.error().message;
  EXPECT_TRUE(earlier->filtered(2));
  EXPECT_FALSE(earlier->filtered(3));
  manifest.filtered_levels = 1;
  const auto parsed = Manifest::parse(manifest.to_json()->dump(), "x.slf");
  ASSERT_TRUE(parsed) << parsed.error().message;
  EXPECT_EQ(*parsed->to_json(), *manifest.to_json());
  EXPECT_TRUE(parsed->filtered(0));
  EXPECT_FALSE(parsed->filtered(1));
  for (const auto& wrong : std::vector<nlohmann::json>{nullptr, "?", -1, 11, 0.5}) {
    nlohmann::json json = *manifest.to_json();
    json["filtered_levels"] = wrong;
    EXPECT_EQ(parse_error(json), ErrorCode::bad_file) << wrong;
  }
}

TEST(Manifest, NewerVersionsAndUnknownRequiredFeaturesAreRefused) {
  nlohmann::json json = *example().to_json();
  json["slf"]["major"] = 3;
  EXPECT_EQ(parse_error(json), ErrorCode::unsupported);
  json = *example().to_json();
  json["required"] = {"hologram"};
  EXPECT_EQ(parse_error(json), ErrorCode::unsupported);
  json = *example().to_json();
  json["slf"]["minor"] = 99;  // newer minor versions add what older readers may ignore
  json["more"] = 1;
  EXPECT_TRUE(Manifest::parse(json.dump(), "x.slf"));
}

TEST(Field, OpensOnlyContainersThatAreFields) {
  testing::TemporaryFolder folder;
  const auto make = [&](const std::string& name, const nlohmann::json& json) {
    const std::string text = json.dump();
    const ByteSpan bytes = std::as_bytes(std::span<const char>(text));
    std::vector<std::pair<std::string, Bytes>> blobs{{"field", Bytes(bytes.begin(), bytes.end())},
                                                     {"tables", {}}};
    auto writer = storage::TileWriter::create(folder / name, blobs);
    ASSERT_TRUE(writer) << writer.error().message;
    ASSERT_TRUE(writer->close());
  };
  nlohmann::json json = *example().to_json();
  make("good.slf", json);
  EXPECT_TRUE(Field::open(folder / "good.slf"));
  json["codec"] = "gif:3";
  make("codec.slf", json);
  EXPECT_EQ(Field::open(folder / "codec.slf").error().code, ErrorCode::unsupported);
  json = *example().to_json();
  json["slf"]["major"] = 3;
  make("newer.slf", json);
  const auto newer = Field::open(folder / "newer.slf");
  EXPECT_EQ(newer.error().code, ErrorCode::unsupported);
  EXPECT_NE(newer.error().message.find("update slf"), std::string::npos);
  json["slf"]["major"] = 1;
  make("older.slf", json);
  const auto older = Field::open(folder / "older.slf");
  EXPECT_EQ(older.error().code, ErrorCode::unsupported);
  EXPECT_NE(older.error().message.find("build it anew"), std::string::npos);
}

}  // namespace
}  // namespace slf

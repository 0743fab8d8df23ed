// What commands write, against everything that may be in the way: each command with each of its
// inputs as its output, and with a link, a lock, or somebody's file under each name that slf uses
// while it works. All files are compared before and after: only the output may differ, nothing may
// be left beside it.
#include <filesystem>
#include <map>
#include <set>

#include "tests/cli/cli_testing.h"

namespace slf {
namespace {

namespace fs = std::filesystem;
using testing::Outcome;
using testing::read_text;
using testing::slf;
using testing::Workplace;
using testing::write_text;
using Words = std::vector<std::string>;

/// Every file and link below a folder, and what it holds.
using State = std::map<std::string, std::string>;
State state_of(const std::string& folder) {
  State state;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    const std::string name = fs::relative(entry.path(), folder).string();
    if (entry.is_symlink())
      state[name] = "link to " + fs::read_symlink(entry.path()).string();
    else
      state[name] = entry.is_regular_file() ? read_text(entry.path()) : "a folder";
  }
  return state;
}

/// The names of what differs.
std::set<std::string> changes(const State& before, const State& after) {
  std::set<std::string> names;
  for (const auto& [name, content] : before)
    if (!after.contains(name) || after.at(name) != content) names.insert(name);
  for (const auto& [name, content] : after)
    if (!before.contains(name)) names.insert(name);
  return names;
}

Words split(const std::string& line) {
  std::istringstream in(line);
  return {std::istream_iterator<std::string>(in), {}};
}

class PreciousFiles : public ::testing::Test {
 protected:
  /// Runs a command in the folder of the test.
  Outcome run(const std::string& line) const {
    return slf(split(line), "cd " + testing::shell_quoted(place.path()) + ";");
  }
  void made(const std::string& line) const {
    const Outcome outcome = run(line);
    ASSERT_EQ(outcome.exit_code, 0) << line << ": " << outcome.err;
  }
  [[nodiscard]] bool has_page() const {
    return run("export a.slf -o none/none.html").exit_code != 5;
  }

  void make_field() const {
    made("build scene:balls -o a.slf --entry 2 --exit 4 --levels 0 --codec zstd");
  }

  void make_volumes() const {
    std::string voxels, ids;
    for (int k = 0; k < 12 * 12 * 12; ++k) {
      const bool inside = std::abs(k % 12 - 6) + std::abs(k / 12 % 12 - 6) < 5;
      voxels += static_cast<char>(inside ? 200 : 1);
      ids += static_cast<char>(inside ? 1 : 0);
    }
    const std::string head =
        "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 12 12 12\nencoding: raw\n";
    write_text(place / "vol.nhdr", head + "data file: vol.raw\n");
    write_text(place / "vol.raw", voxels);
    write_text(place / "vol.mhd",
               "ObjectType = Image\nNDims = 3\nDimSize = 12 12 12\nElementType = MET_UCHAR\n"
               "ElementDataFile = vol.zraw\n");
    write_text(place / "vol.zraw", voxels);
    for (const char* name : {"ids", "mask"}) {
      write_text(place / (std::string(name) + ".nhdr"), head + "data file: " + name + ".raw\n");
      write_text(place / (std::string(name) + ".raw"), ids);
    }
    write_text(place / "ids.txt", "1 part 255 0 0 255\n");
    write_text(place / "rig.json", R"({"lights": [{"direction": [0, 0, 1]}]})");
    const std::string points = R"("ColorSpace": "RGB", "RGBPoints": [0,1,0,0, 255,1,1,1],
                                  "Points": [0,0,0.5,0, 255,1,0.5,0])";
    write_text(place / "maps.json",
               R"([{"Name": "Other", )" + points + R"(}, {"Name": "Mine", )" + points + "}]");
  }

  void make_meshes() const {
    const float corners[] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1};
    const std::uint16_t triangles[] = {0, 1, 2, 0, 1, 3, 0, 2, 3, 1, 2, 3};
    std::string bin(reinterpret_cast<const char*>(corners), sizeof corners);
    bin += std::string(reinterpret_cast<const char*>(triangles), sizeof triangles);
    write_text(place / "m.bin", bin);
    fs::copy(place / "a.png", place / "m.png");
    write_text(place / "m.gltf", R"({"asset": {"version": "2.0"}, "scene": 0,
      "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
      "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 2}, "indices": 1,
                                  "material": 0}]}],
      "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
      "textures": [{"source": 0}], "images": [{"uri": "m.png"}],
      "buffers": [{"uri": "m.bin", "byteLength": 72}],
      "bufferViews": [{"buffer": 0, "byteLength": 48},
                      {"buffer": 0, "byteOffset": 48, "byteLength": 24}],
      "accessors": [{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3",
                     "min": [0, 0, 0], "max": [1, 1, 1]},
                    {"bufferView": 1, "componentType": 5123, "count": 12, "type": "SCALAR"},
                    {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC2"}]})");
    write_text(place / "o.obj",
               "mtllib o.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvt 0 0\n"
               "f 1/1 2/1 3/1\nf 1/1 2/1 4/1\nf 1/1 3/1 4/1\nf 2/1 3/1 4/1\n");
    write_text(place / "o.mtl", "newmtl m\nKd 1 1 1\nmap_Kd t.png\n");
    fs::copy(place / "a.png", place / "t.png");
  }

  void make_pictures() const {
    made("cameras --sphere 0,0,0,1.2 --count 6 --size 16 -o cams.json");
    made("raycast scene:balls --cameras cams.json -o pp");
    auto list = nlohmann::json::parse(read_text(place / "pp/transforms.json"));
    fs::copy(place / "a.png", place / "pp/mask.png");
    list["frames"][0]["mask_path"] = "mask.png";
    write_text(place / "pp/transforms.json", list.dump());
  }

  Workplace place;
};

struct Command {
  std::string line;    ///< OUT stands for the output
  std::string output;  ///< the file of it that is written, where that is in a folder
  Words inputs;
};

TEST_F(PreciousFiles, NoCommandWritesOverAFileThatItReads) {
  make_field();
  for (const char* picture : {"a.png", "b.png", "env.exr"})
    made(std::string("render a.slf --size 16 -o ") + picture);
  make_volumes();
  make_meshes();
  make_pictures();
  write_text(place / "keys.json", R"({"keys": [{"at": 0, "orbit": [0, 20, 3]},
                                               {"at": 0.1, "orbit": [9, 20, 3]}]})");
  const std::string shape = " --entry 2 --exit 4 --levels 0 --codec zstd";
  const std::string scene =
      "vol.nhdr --transfer maps.json#Mine --labels-volume ids.nhdr --label-table ids.txt --mask "
      "mask.nhdr --lighting shadowed --light-samples 1 --light-rig rig.json --environment env.exr "
      "--light-file scene.light";
  made("raycast " + scene + " --size 8 -o none.png");  // makes the light
  fs::remove(place / "none.png");
  const Words of_scene{"vol.nhdr",  "vol.raw",  "maps.json", "ids.nhdr", "ids.raw",    "ids.txt",
                       "mask.nhdr", "mask.raw", "rig.json",  "env.exr",  "scene.light"};
  const Words gltf{"m.gltf", "m.bin", "m.png"}, obj{"o.obj", "o.mtl", "t.png"};
  const Words pictures{"pp/transforms.json", "pp/images/0001.exr", "pp/mask.png"};
  const std::string sparse = " --voxels 32 --depth-kind none";
  std::vector<Command> commands{
      {"render a.slf --size 8 -f -o OUT", "o.png", {"a.slf"}},
      {"tile a.slf 0/0 --format raw -f -o OUT", "o.raw", {"a.slf"}},
      {"repack a.slf -f -o OUT", "o.slf", {"a.slf"}},
      {"merge a.slf -f -o OUT", "o.slf", {"a.slf"}},
      {"compare a.png b.png -f --diff OUT", "o.png", {"a.png", "b.png"}},
      {"transfer maps.json#Mine -f -o OUT", "o.json", {"maps.json"}},
      {"play a.slf --path keys.json --size 8 -f --preview OUT", "o.webp", {"a.slf", "keys.json"}},
      {"play a.slf --path keys.json --size 8 -f --frames OUT",
       "o/00000.png",
       {"a.slf", "keys.json"}},
      {"raycast " + scene + " --size 8 -f -o OUT", "o.png", of_scene},
      {"build " + scene + shape + " -f -o OUT", "o.slf", of_scene},
      {"cameras " + scene.substr(0, scene.find(" --light")) + " -f -o OUT",
       "o.json",
       {"vol.nhdr", "vol.raw", "maps.json", "ids.nhdr", "ids.raw", "ids.txt", "mask.raw"}},
      {"cameras vol.mhd --test 2 -f -o OUT", "o.json", {"vol.mhd", "vol.zraw"}},
      {"cameras vol.nhdr --test 2 -f -o o.json", "o_test.json", {"vol.nhdr", "vol.raw"}},
      {"cameras a.slf -f -o OUT", "o.json", {"a.slf"}},
      {"raycast scene:balls --cameras cams.json -f -o OUT", "o/transforms.json", {"cams.json"}},
      {"raycast vol.mhd --cameras cams.json -f -o OUT",
       "o/images/0005.exr",
       {"cams.json", "vol.mhd", "vol.zraw"}},
  };
  for (const auto& [source, inputs, more] : {std::tuple{"m.gltf", gltf, std::string()},
                                             {"o.obj", obj, std::string()},
                                             {"pictures:pp", pictures, sparse}}) {
    commands.push_back(
        {std::string("raycast ") + source + more + " --size 8 -f -o OUT", "o.png", inputs});
    commands.push_back(
        {std::string("build ") + source + more + shape + " -f -o OUT", "o.slf", inputs});
    if (more.empty())
      commands.push_back({std::string("cameras ") + source + " -f -o OUT", "o.json", inputs});
  }
  commands.push_back({"pictures depth pp --depth-kind none -f -o OUT", "o.png", pictures});
  if (has_page())
    for (const char* output : {"o.html", "o.htm", "o/index.html", "o/page.js", "o/field.slf"}) {
      commands.push_back({"export a.slf --codec zstd:2 -f -o OUT", output, {"a.slf"}});
      if (std::string(output) != "o/field.slf")
        commands.push_back({"export a.slf -f -o OUT", output, {"a.slf"}});
    }
  const auto expect_kept = [&](std::string line, const std::string& out) {
    SCOPED_TRACE(line + ", OUT: " + out);
    const State before = state_of(place.path());
    if (const auto at = line.find("OUT"); at != std::string::npos) line.replace(at, 3, out);
    EXPECT_OUTCOME(run(line), 1, "is the input");
    EXPECT_EQ(changes(before, state_of(place.path())), std::set<std::string>());
  };
  int cases = 0;
  for (const auto& [line, output, inputs] : commands)
    for (const std::string& input : inputs) {
      const std::string out = output.substr(0, output.find('/'));
      const fs::path at = place / output;
      fs::create_directories(at.parent_path());
      fs::create_symlink(place / input, at);
      expect_kept(line, out);
      fs::remove(at);
      fs::create_hard_link(place / input, at);
      expect_kept(line, out);
      fs::remove(at);
      if (out == output && line.find("OUT") != std::string::npos &&
          line.find("export") == std::string::npos && line.find("play") == std::string::npos)
        expect_kept(line, "./" + input);  // itself
      ++cases;
      fs::remove_all(place / "o");
    }
  EXPECT_GT(cases, 70);
}

/// What may be under a name.
struct Obstacle {
  const char* what;
  std::function<void(const std::string& at)> make;
};

TEST_F(PreciousFiles, NoNameThatSlfUsesIsTakenFromAnother) {
  make_field();
  const std::string lock("\xDE\xC0\xEF\xBE", 4);
  write_text(place / "text", "precious\n");
  write_text(place / "empty", "");
  write_text(place / "zeros", std::string(8192, '\0'));
  write_text(place / "lock", lock + std::string(8188, 'x'));
  made("build scene:globe -o field --entry 2 --exit 4 --levels 0 --codec zstd");
  const auto link_to = [](const char* target) {
    return [target](const std::string& at) { fs::create_symlink(target, at); };
  };
  const auto copy_of = [&](const char* name) {
    return [this, name](const std::string& at) { fs::copy(place / name, at); };
  };
  const Obstacle obstacles[] = {
      {"a link to a text", link_to("text")},
      {"a link to an empty file", link_to("empty")},
      {"a link to zeros", link_to("zeros")},
      {"a link to a lock", link_to("lock")},
      {"a link to a field", link_to("field")},
      {"a link to nothing", link_to("nothing")},
      {"a text", copy_of("text")},
      {"an empty file", copy_of("empty")},
      {"zeros", copy_of("zeros")},
      {"a lock with something behind it", copy_of("lock")},
      {"a field", copy_of("field")},
      {"a folder", [](const std::string& at) { fs::create_directory(at); }},
      {"a hard link", [this](const std::string& at) { fs::create_hard_link(place / "field", at); }},
  };
  // A field with a tile that was damaged and is missing: verify drops it, build fills it.
  const auto listed = run("ls a.slf --json").json();
  std::size_t at = 0;
  for (const auto& tile : listed)
    if (tile["state"] == "stored") at = tile["offset_bytes"].get<std::size_t>();
  std::string damaged = read_text(place / "a.slf");
  damaged[at] = static_cast<char>(damaged[at] ^ 1);
  write_text(place / "damaged", damaged);
  fs::copy(place / "damaged", place / "hole");
  ASSERT_EQ(run("verify --fix hole").exit_code, 0);

  struct Writer {
    std::string line, output;
    const char* begin;  ///< what is at the output before; null: nothing
    Words drafts;       ///< the names that it uses; they may be refused
  };
  const std::string build = "build scene:balls --entry 2 --exit 4 --levels 0 --codec zstd -o n.slf";
  std::vector<Writer> writers{
      {build, "n.slf", nullptr, {".unfinished"}},
      {build + " -f", "n.slf", "text", {".unfinished"}},
      {build, "n.slf", "hole", {}},
      {"verify --fix n.slf", "n.slf", "damaged", {}},
      {"repack a.slf -o n.slf", "n.slf", nullptr, {".repacking"}},
      {"repack a.slf --codec raw -f -o n.slf", "n.slf", "text", {".repacking"}},
      {"merge a.slf -o n.slf", "n.slf", nullptr, {".repacking"}},
      {"render a.slf --size 8 -f -o n.png", "n.png", "text", {}}};
  if (has_page()) {
    const Words drafts{".exporting", ".exporting.repacking"};
    writers.push_back({"export a.slf -o n.html", "n.html", nullptr, {}});
    writers.push_back({"export a.slf --codec zstd:2 -f -o n.htm", "n.htm", "text", drafts});
    writers.push_back({"export a.slf -f -o n", "n/field.slf", nullptr, {}});
    writers.push_back({"export a.slf --codec zstd:2 -f -o n", "n/field.slf", "text", drafts});
  }
  // Names that some command uses, or one of an older version did.
  const Words suffixes{
      "-lock",           ".new",           ".unfinished",         ".unfinished-lock",
      ".unfinished.new", ".repacking",     ".repacking-lock",     ".repacking.new",
      ".exporting",      ".exporting.new", ".4194304-0.tmp",      ".part",
      ".light",          ".part.slf",      ".exporting.repacking"};
  const std::set<std::string> page{"n/index.html",      "n/style.css",     "n/page.js",
                                   "n/module.bin",      "n/module.bin.js", "n/poster.jpg",
                                   "n/poster-light.jpg"};
  int cases = 0, refused = 0;
  for (const Obstacle& obstacle : obstacles)
    for (const Writer& writer : writers) {
      // All names that it does not use at once, then those that it uses one by one.
      std::vector<Words> groups{{}};
      for (const std::string& suffix : suffixes)
        if (std::ranges::find(writer.drafts, suffix) == writer.drafts.end())
          groups.front().push_back(suffix);
      for (const std::string& draft : writer.drafts) groups.push_back({draft});
      for (const Words& group : groups) {
        const bool used = &group != &groups.front();
        SCOPED_TRACE(writer.line + " beside " + obstacle.what + ", *" + group.front());
        const bool site = writer.output.starts_with("n/");
        if (site) fs::create_directory(place / "n");
        if (writer.begin != nullptr) fs::copy(place / writer.begin, place / writer.output);
        Words names;
        for (const std::string& suffix : group) {
          names.push_back(site ? place / "n" + suffix : place / writer.output + suffix);
          if (site && !used) names.push_back(place / writer.output + suffix);
        }
        for (const std::string& name : names) obstacle.make(name);
        const State before = state_of(place.path());
        const Outcome outcome = run(writer.line);
        auto changed = changes(before, state_of(place.path()));
        EXPECT_EQ(outcome.signal, 0);
        if (outcome.exit_code == 0) {
          EXPECT_EQ(changed.erase(writer.output), 1u) << outcome.err;
          if (site) std::erase_if(changed, [&](const auto& name) { return page.contains(name); });
        } else {
          EXPECT_TRUE(used) << outcome.err;
          EXPECT_NE(outcome.err.find(group.front()), std::string::npos) << outcome.err;
          ++refused;
        }
        EXPECT_EQ(changed, std::set<std::string>()) << outcome.err;
        for (const std::string& name : names) fs::remove_all(name);
        fs::remove_all(place / (site ? "n" : writer.output));
        cases += static_cast<int>(names.size());
      }
    }
  EXPECT_GT(cases, 638);
  EXPECT_GT(refused, 50);
}

// What somebody does who rescues a killed repack.
TEST_F(PreciousFiles, AnInputThatHasTheNameOfADraftIsKept) {
  make_field();
  fs::copy(place / "a.slf", place / "coarse");
  for (const char* suffix : {".unfinished", ".repacking"}) {
    const std::string draft = std::string("q.slf") + suffix;
    for (const bool soft : {false, true}) {
      if (soft)
        fs::create_symlink("a.slf", place / draft);
      else
        fs::copy(place / "a.slf", place / draft);
      const State before = state_of(place.path());
      for (const std::string& line :
           Words{"merge " + draft + " -o q.slf", "merge a.slf " + draft + " -f -o q.slf",
                 "repack " + draft + " -o q.slf", "repack " + draft + " -o q.slf --codec jpeg:20",
                 "build scene:balls --entry 2 --exit 4 --levels 1 --only-levels 1 --coarser " +
                     draft + " -o q.slf"}) {
        SCOPED_TRACE(line);
        EXPECT_OUTCOME(run(line), 1, "is the input, and");
        EXPECT_EQ(changes(before, state_of(place.path())), std::set<std::string>());
      }
      fs::remove(place / draft);
    }
  }
}

TEST_F(PreciousFiles, AnUnfinishedBuildOfOtherSettingsIsKept) {
  made("build scene:balls --entry 2 --exit 4 --levels 1 --shard 1/2 -o part.slf");
  // As a build that was stopped leaves it.
  made("merge part.slf --part -o q.slf.unfinished");
  const State before = state_of(place.path());
  for (const char* more : {"", " -f"})
    EXPECT_OUTCOME(run(std::string("build scene:balls --entry 2 --exit 8 -o q.slf") + more), 1,
                   "q.slf.unfinished: exists and was built with other settings");
  EXPECT_EQ(changes(before, state_of(place.path())), std::set<std::string>());
}

// Names in a file of cameras are somebody else's.
TEST_F(PreciousFiles, PicturesOfCamerasStayInTheirFolder) {
  made("cameras --sphere 0,0,0,1.2 --count 2 --size 4 -o cams.json");
  const auto with_names = [&](const std::string& first, const std::string& second) {
    auto list = nlohmann::json::parse(read_text(place / "cams.json"));
    list["frames"][0]["file_path"] = first;
    list["frames"][1]["file_path"] = second;
    write_text(place / "named.json", list.dump());
  };
  fs::create_directories(place / "x/y");
  for (const char* output : {"x/..", "out", "./out", "x/../out", "x/y/../..", ".", "x//y/"})
    for (const char* name : {"../evil", "../../evil", "a/../../evil", "..", "a/..", "/../evil"}) {
      SCOPED_TRACE(std::string(output) + ", " + name);
      with_names(name, "good");
      const State before = state_of(place.path());
      EXPECT_OUTCOME(run(std::string("raycast scene:balls --cameras named.json -o ") + output), 3,
                     "leads out of the folder");
      EXPECT_EQ(changes(before, state_of(place.path())), std::set<std::string>());
    }
  for (const char* output : {"./out", "x/../out", "x//y/", "x/../x/../out"}) {
    with_names("a/../b/1.png", "/c/2");
    made(std::string("raycast scene:balls --cameras named.json -o ") + output);
    for (const char* made_there : {"/b/1.exr", "/c/2.exr", "/transforms.json"})
      EXPECT_TRUE(fs::exists(place / (output + std::string(made_there))));
    fs::remove_all(place / output);
    fs::create_directories(place / "x/y");
  }
  with_names("a.png", "a.jpg");
  EXPECT_OUTCOME(run("raycast scene:balls --cameras named.json -o out"), 3, "another picture");
}

// Before the light is computed, which takes long.
TEST_F(PreciousFiles, AnOutputThatExistsIsFoundBeforeTheWork) {
  make_volumes();
  made("cameras vol.nhdr --count 2 --size 4 -o cams.json");
  fs::create_directories(place / "out/images");
  write_text(place / "out/images/0001.exr", "precious");
  const State before = state_of(place.path());
  const Outcome outcome =
      run("--progress json:0.001 raycast vol.nhdr --lighting global --light-spacing 0.5 "
          "--light-samples 4096 --cameras cams.json -o out");
  EXPECT_OUTCOME(outcome, 1, "0001.exr: exists; -f overwrites it");
  EXPECT_EQ(outcome.err.find("light"), std::string::npos) << outcome.err;
  EXPECT_EQ(changes(before, state_of(place.path())), std::set<std::string>());
}

}  // namespace
}  // namespace slf

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <numbers>

#include "base/join.h"
#include "base/try.h"
#include "cli/command.h"
#include "field/field_file.h"

namespace slf::cli {
namespace {

struct InfoArguments {
  SourceArguments source;
  std::string state;  // of a field; empty: all
  bool json = false, recipe = false;
};

/// What the file says of its reveal, whichever state is shown.
struct RevealInfo {
  std::uint64_t bytes = 0;  ///< 0: there is none, or it is damaged
  std::array<std::uint32_t, 3> dims{};
  bool labels = false;
  std::uint32_t loss = 0;

  static RevealInfo of(const Field& field) {
    const auto code = field.file().reveal();
    if (code && code->empty()) return {};
    const auto head = code ? decode_reveal(*code, RevealPart::head) : tl::unexpected(code.error());
    if (!head) note(field.path() + ": " + head.error().message);
    return head ? RevealInfo{code->size(), head->dims, !head->ids.empty(), head->loss}
                : RevealInfo();
  }
  void describe(auto& member) const {
    member("bytes", bytes, "");
    member("dims", dims, "voxels along x, y, z");
    member("labels", labels, "whether it holds ids");
    member("loss", loss, "by how much its bytes may be off");
  }
};

/// What slf build makes the field of, but for files that are not named.
nlohmann::json recipe_json(const Field& field) {
  const FieldShape& shape = field.shape();
  const auto recipe_of = [](const Field& one) {
    const auto provenance = nlohmann::json::parse(one.provenance());
    auto recipe = provenance.value("recipe", nlohmann::json::object());
    const std::string kind = text_of(provenance, "kind", "");
    const std::string source = text_of(provenance, "source", ""),
                      name = text_of(provenance, "name", "");
    if (kind == "scene")
      recipe["input"] = "scene:" + name;
    else if (!source.empty() && source != "DICOM")
      recipe["input"] = (kind == "pictures" ? "pictures:" : "") + source;
    return recipe;
  };
  const auto states = field.states();
  const Field first = states.empty() ? field : *field.in_state(0);
  const nlohmann::json common = recipe_of(first);
  nlohmann::json recipe = common;
  recipe.update({{"entry", shape.entry_side},
                 {"exit", shape.exit_side},
                 {"finest_level", shape.finest_level},
                 {"entry_extra_levels", shape.entry_extra_levels},
                 {"codec", field.codec()},
                 {"depth", field.has_depth()},
                 {"color_type", is_half(field.format()) ? "half" : "u8"}});
  if (const auto reveal = RevealInfo::of(field); reveal.bytes > 0) {
    recipe["reveal"] = std::max(16u, *std::ranges::max_element(reveal.dims));
    if (reveal.loss > 0) recipe["reveal_loss"] = reveal.loss;
  }
  if (recipe.contains("each_label") || recipe.contains("each_time")) return recipe;
  for (std::size_t k = 0; k < states.size(); ++k) {
    const nlohmann::json own = recipe_of(*field.in_state(static_cast<unsigned>(k)));
    nlohmann::json state = nlohmann::json::object();
    for (const auto& [option, value] : common.items())
      if (!own.contains(option)) state[option] = nullptr;
    for (const auto& [option, value] : own.items())
      if (common.value(option, nlohmann::json()) != value) state[option] = value;
    state["name"] = states[k];
    if (own.value("time", nlohmann::json()) == "all") {  // "NAME 0" stands for all times
      const std::size_t space = states[k].rfind(' ');
      if (states[k].substr(space + 1) != "0") continue;
      state["name"] = states[k].substr(0, space);
    }
    recipe["states"].push_back(state);
  }
  return recipe;
}

std::string spaced(const std::string& unit) { return unit.empty() ? "" : " " + unit; }

struct SphereInfo {
  glm::dvec3 center{0.0};
  double radius = 0;

  void describe(auto& member) const {
    member("center", center, "world units");
    member("radius", radius, "world units", R"("minimum": 0)");
  }
};
struct StateInfo {
  std::string name{};
  nlohmann::json provenance{};

  void describe(auto& member) const {
    member("name", name, "");
    member("provenance", &provenance,
           "what differs from that of the field: a merge patch (RFC 7386)", R"("type": "object")");
  }
};
/// The manifest of a field, and what the file has of it.
struct FieldInfo {
  nlohmann::json manifest = nlohmann::json::object();
  FieldContent content{};
  std::uint32_t entry_resolution = 0, exit_resolution = 0;
  RevealInfo reveal{};

  /// A member of the manifest.
  template <class T>
  void of(auto& member, const char* name, const char* help, const char* more = "") const {
    member(name, report::Typed<T>{manifest.value(name, nlohmann::json())}, help, more);
  }
  /// One that may not be there.
  template <class T>
  void if_stated(auto& member, const char* name, const char* help) const {
    const report::Typed<T> value{manifest.value(name, nlohmann::json())};
    member(name, value.value.is_null() ? nullptr : &value, help);
  }
  void describe(auto& member) const {
    constexpr const char* kPositive = R"("minimum": 1)";
    of<std::map<std::string, unsigned>>(member, "slf", "version of the format, major and minor");
    of<std::vector<std::string>>(member, "required", "features that a reader must know");
    of<SphereInfo>(member, "sphere", "");
    of<unsigned>(member, "entry_depth", "how much deeper the entry side is split than the exit");
    of<unsigned>(member, "entry_side", "cells along an octsphere's edge at level 0", kPositive);
    of<unsigned>(member, "exit_side", "cells along an octsphere's edge at level 0", kPositive);
    of<std::string>(member, "format", "of a sample",
                    R"("enum": ["rgba8", "rgba16f", "rgba8_depth8", "rgba16f_depth8"])");
    of<std::string>(member, "codec", "specification, as jpeg:75");
    of<nlohmann::json>(member, "provenance", "source and settings of the build; free form",
                       R"("type": "object")");
    if_stated<unsigned>(member, "filtered_levels",
                        "how many levels, from 0 on, hold means of rays");
    if_stated<std::vector<unsigned>>(member, "subfields",
                                     "kept, 8 × entry octant + exit octant; absent: all");
    if_stated<std::vector<StateInfo>>(member, "states", "variants of the object; absent: one");
    if_stated<std::map<std::string, std::array<std::uint64_t, 2>>>(
        member, "part", "tiles that the file is to hold: begin and end, level and index");
    member("entry_resolution", entry_resolution, "of the finest level", kPositive);
    member("exit_resolution", exit_resolution, "of the finest level", kPositive);
    content.describe(member);
    member("reveal", reveal.bytes > 0 ? &reveal : nullptr,
           "the copy of the volume that cuts show; only if there is one");
  }
};

void print_field(const Field& field, const FieldContent& content) {
  const FieldShape& shape = field.shape();
  const glm::dvec3& c = shape.sphere.center;
  print("{}: {}sphere light field, {} on disk, {} of payload\n", field.path(),
        content.complete ? "" : "INCOMPLETE ", human_bytes(content.file_bytes),
        human_bytes(content.payload_bytes));
  const auto provenance = nlohmann::json::parse(field.provenance());
  const std::string space = text_of(provenance, "space", "");
  print("sphere  centre {:.2f},{:.2f},{:.2f}  radius {:.2f}{}{}\n", c.x, c.y, c.z,
        shape.sphere.radius, spaced(text_of(provenance, "unit", "")),
        space.empty() ? "" : "  (world coordinates are " + space + ")");
  print("lattice {} entry, {} exit at the finest level\n",
        shape.entry_resolution(shape.finest_level), shape.exit_resolution(shape.finest_level));
  print("samples {} as {}\n", name(field.format()), field.codec());
  if (const auto part = field.part())
    print("part    tiles {}/{} up to {}/{}{}\n", part->begin.level, part->begin.index,
          part->end.level, part->end.index, field.states().empty() ? "" : " of each state");
  print("source  {}\n", text_of(provenance, "source", text_of(provenance, "name", "unknown")));
  if (const auto light = provenance.find("lighting"); light != provenance.end()) {
    const LightOptions lighting = raycast_options(field.provenance()).lighting;
    print("light   {}, {}{}, {} paths per node\n", text_of(*light, "mode", "?"),
          light->contains("environment") ? "an environment picture and the lights of " : "rig ",
          lighting.rig.name, lighting.samples);
  }
  if (const auto [bytes, dims, labels, loss] = RevealInfo::of(field); bytes > 0)
    print("reveal  {}x{}x{} {}{}, {}\n", dims[0], dims[1], dims[2], labels ? "labels" : "bytes",
          loss > 0 ? fmt::format(" within {}", loss) : "", human_bytes(bytes));
  const std::vector<std::string> states = field.states();
  for (std::size_t state = 0; state < states.size(); ++state)
    print("state   {}: {}\n", state, states[state]);
  std::vector<std::string> rows{"level\tlattice\ttiles\tstored\tempty\tslabs\tpayload"};
  if (!states.empty()) rows[0] += "\tsame";
  for (const LevelContent& level : content.levels) {
    rows.push_back(fmt::format("{}\t{}/{}\t{}\t{}\t{}\t{}\t{}", level.level, level.entry_resolution,
                               level.exit_resolution, level.tiles, level.stored, level.empty,
                               human_count(level.slabs), human_bytes(level.payload_bytes)));
    if (level.same) rows.back() += fmt::format("\t{}", *level.same);
  }
  print_table(rows);
}

struct VolumeInfo {
  Volume volume{};
  std::array<double, 2> range{};
  std::vector<VolumeSeries> series{};

  void describe(auto& member) const {
    const auto& axes = volume.axes;
    member("source", volume.source, "path");
    member("dims", volume.dims, "voxels along x, y, z",
           R"("items": {"type": "integer", "minimum": 1})");
    member("type", name(volume.type), "of a voxel");
    member("spacing", volume.spacing(), "world units");
    member("origin", volume.origin, "centre of the first voxel, world units");
    member("axes", std::array{axes[0], axes[1], axes[2]}, "of x, y, z: world units per voxel");
    member("world", volume.patient_axes ? "LPS" : "xyz",
           "coordinate system: LPS if the file states the patient's axes",
           R"("enum": ["LPS", "xyz"])");
    member("unit", volume.unit, "of world coordinates, as mm; empty if the file does not state it");
    member("value_unit", volume.value_unit,
           "of values, as HU; empty if the file does not state it");
    member("slope", volume.slope, "value = slope × voxel + intercept");
    member("intercept", volume.intercept, "value = slope × voxel + intercept");
    member("range", range, "least and largest value", R"("items": {"type": ["number", "null"]})");
    member("labels", volume.labels, "voxels are ids");
    member("looks_like_labels", !volume.labels && looks_like_labels(volume), "they may be ids");
    member("placement", volume.placement, "what placed the volume in the world; may be empty");
    member("notes", volume.notes, "what is worth knowing about the file");
    member("series", series.empty() ? nullptr : &series, "DICOM series of the folder");
  }
};

/// The corners of the box around all vertices.
std::pair<glm::dvec3, glm::dvec3> box_of(const Mesh& mesh) {
  glm::dvec3 low(mesh.positions.front()), high = low;
  for (const glm::vec3& p : mesh.positions)
    low = glm::min(low, glm::dvec3(p)), high = glm::max(high, glm::dvec3(p));
  return {mesh.origin + low, mesh.origin + high};
}

void print_volume(const Volume& volume) {
  const auto range = volume.value_range();
  const auto vec = [](const glm::dvec3& v) {
    return fmt::format("{:.6g},{:.6g},{:.6g}", v.x, v.y, v.z);
  };
  print("{}: volume\n", volume.source);
  print("dims    {}x{}x{} {}{}\n", volume.dims[0], volume.dims[1], volume.dims[2],
        name(volume.type), volume.labels ? " labels" : "");
  print("spacing {}{}\n", vec(volume.spacing()), spaced(volume.unit));
  print("range   {:.6g} to {:.6g}{}\n", range[0], range[1], spaced(volume.value_unit));
  print("origin  {}  (world coordinates are {})\n", vec(volume.origin),
        volume.patient_axes ? "LPS" : "x, y, z: the file states no patient's axes");
  for (int axis = 0; axis < 3; ++axis)
    print("axis {}  {}\n", "xyz"[axis], vec(volume.axes[axis] / volume.spacing()[axis]));
  if (!volume.placement.empty()) print("placed  by {}\n", volume.placement);
  for (const std::string& remark : volume.notes) print("note    {}\n", remark);
  if (!volume.labels && looks_like_labels(volume))
    print("note    {}; {}\n", kLabelsHint, hint_of("labels"));
}

struct MeshInfo {
  Mesh mesh{};
  std::pair<glm::dvec3, glm::dvec3> box{};

  void describe(auto& member) const {
    member("source", mesh.source, "the path");
    member("triangles", mesh.triangles.size(), "");
    member("vertices", mesh.positions.size(), "");
    member("materials", mesh.materials.size(), "");
    member("textures", mesh.textures, "");
    member("normals", !mesh.normals.empty(), "whether the file has normals");
    member("colors", !mesh.colors.empty(), "whether vertices have colours");
    member("low", box.first, "corner of the box, world units");
    member("high", box.second, "corner of the box, world units");
    member("content", content_hash(mesh), "hash of everything that shows");
    member("files", mesh.files, "");
    member("notes", mesh.notes, "");
  }
};

void print_mesh(const Mesh& mesh) {
  const auto [low, high] = box_of(mesh);
  print("{}: mesh\n", mesh.source);
  print("size    {} triangles, {} vertices\n", mesh.triangles.size(), mesh.positions.size());
  print("box     {:.6g},{:.6g},{:.6g} to {:.6g},{:.6g},{:.6g}  (world coordinates, +z is up)\n",
        low.x, low.y, low.z, high.x, high.y, high.z);
  print("colour  {} materials, {} textures{}\n", mesh.materials.size(), mesh.textures.size(),
        mesh.colors.empty() ? "" : ", colours of vertices");
  for (const MeshTexture& t : mesh.textures)
    print("texture {}: {}x{} pixels\n", t.name, t.width, t.height);
  print("normals {}\n",
        mesh.normals.empty() ? "none in the file: made smooth below 60 degrees" : "of the file");
}

struct SeriesInfo {
  std::string source{};
  SeriesList list{};

  void describe(auto& member) const {
    member("source", source, "path");
    member("series", list.series, "DICOM series of the folder");
    member("notes", list.notes, "files that cannot be read");
  }
};

void print_series(const std::string& folder, const SeriesList& list) {
  print("{}: {} DICOM series, see --series\n", folder, list.series.size());
  std::vector<std::string> rows{"series\tmodality\tsize\ttype\ttimes\tdescription\tuid"};
  // As print() shows them, so that columns are as wide.
  const auto cell = [](const std::string& text) { return printable(text, Lines::indented); };
  for (const VolumeSeries& s : list.series) {
    const std::string depth =
        s.problem.empty() ? fmt::format("x{}", s.dims[2]) : fmt::format(", {} slices", s.slices);
    const std::string type =
        s.components == 1 ? name(s.type) : fmt::format("{} x {}", s.components, name(s.type));
    rows.push_back(fmt::format("{}\t{}\t{}x{}{}\t{}\t{}\t{}\t{}", cell(s.id), cell(s.modality),
                               s.dims[0], s.dims[1], depth, type, s.times, cell(s.description),
                               cell(s.uid)));
  }
  print_table(rows);
  for (const VolumeSeries& s : list.series)
    if (!s.problem.empty()) print("{}: {}\n", s.id, s.problem);
  for (const std::string& remark : list.notes) print("note    {}\n", remark);
}

/// How many cameras there are in each direction from the middle of what they look at: 24 x 8 cells
/// of equal area, azimuth to the right, from above to below.
std::vector<std::vector<unsigned>> coverage_map(const PictureSet& set) {
  constexpr int kColumns = 24, kRows = 8;
  const glm::dvec3 center = focus_of(set.pictures).value_or(glm::dvec3(0));
  std::vector<std::vector<unsigned>> counts(kRows, std::vector<unsigned>(kColumns, 0));
  for (const Picture& picture : set.pictures) {
    const glm::dvec3 toward = picture.eye - center;
    const double length = glm::length(toward);
    if (!(length > 0)) continue;
    const double turn = std::atan2(toward.y, toward.x) / (2 * std::numbers::pi) + 0.5;
    const auto cell = [](double share, int cells) {
      return std::clamp(static_cast<int>(share * cells), 0, cells - 1);
    };
    ++counts[static_cast<std::size_t>(cell((1 - toward.z / length) / 2, kRows))]
            [static_cast<std::size_t>(cell(turn, kColumns))];
  }
  return counts;
}

struct PicturesInfo {
  PictureSet set{};
  std::map<std::string, unsigned> sizes{}, lenses{};
  std::size_t masks = 0, depths = 0;

  void describe(auto& member) const {
    member("source", set.source, "the file or folder of cameras");
    member("pictures", set.pictures.size(), "how many", R"("minimum": 1)");
    member("sizes", sizes, "pictures of each size, as 800x600");
    member("lenses", lenses, "pictures of each kind of lens: pinhole, distorted, fisheye");
    member("mask_files", masks, "pictures with a mask of their own");
    member("depth_files", depths, "pictures with a picture of depths");
    member("points", set.points.size(), "points of the object that the source states");
    member("coverage", coverage_map(set),
           "cameras in each direction: a row for each of 8 cells from +z to -z, with 24 cells of "
           "azimuth from -180 degrees");
    member("notes", set.notes, "what people should know");
  }
};

Result<void> print_pictures(const SourceArguments& source, bool json) {
  auto read = SLF_TRY(read_pictures(source));
  PicturesInfo info{std::move(read)};
  auto& [set, sizes, lenses, masks, depths] = info;
  for (const Picture& picture : set.pictures) {
    const Lens& lens = picture.lens;
    ++sizes[fmt::format("{}x{}", lens.width, lens.height)];
    ++lenses[lens.fisheye ? "fisheye" : lens.distorted() ? "distorted" : "pinhole"];
    masks += !picture.mask.empty();
    depths += !picture.depth.empty();
  }
  if (json) {
    print_json(info);
    return {};
  }
  const auto list = [](const std::map<std::string, unsigned>& counts) {
    return joined(counts, ", ", [](const auto& of) { return concat(of.second, " ", of.first); });
  };
  print("{}: {} pictures with cameras\n", set.source, set.pictures.size());
  print("sizes   {}\n", list(sizes));
  print("lenses  {}\n", list(lenses));
  print("files   {} masks and {} depths beside the pictures\n", masks, depths);
  if (!set.points.empty()) print("points  {}\n", set.points.size());
  print("cameras seen from the object, from +z above to -z below, azimuth from -180 to 180:\n");
  for (const auto& row : coverage_map(set)) {
    std::string line;
    for (const unsigned count : row)
      line += count == 0 ? '.' : count < 10 ? static_cast<char>('0' + count) : '+';
    print("        {}\n", line);
  }
  return {};
}

/// The DICOM series of a folder; none of anything else.
SeriesList series_of(const std::string& path) {
  std::error_code ignored;
  if (!std::filesystem::is_directory(path, ignored)) return {};
  return list_series(path).value_or(SeriesList{});
}

Result<void> run_info(const InfoArguments& arguments) {
  SourceArguments source = arguments.source;
  SLF_TRY(source.finish(0, OnSignal::end));
  const std::string& input = source.input;
  if (source.is_pictures()) return print_pictures(source, arguments.json);
  if (!is_field(input)) {
    if (is_mesh_name(input)) {
      Mesh mesh = SLF_TRY(read_mesh(input, source.up_axis));
      for (const std::string& remark : mesh.notes) note(fmt::format("{}: {}", input, remark));
      const auto box = box_of(mesh);
      if (arguments.json)
        print_json(MeshInfo{std::move(mesh), box});
      else
        print_mesh(mesh);
      return {};
    }
    const SeriesList list = series_of(input);
    if (list.series.size() > 1 && !source.reading.series) {
      if (arguments.json)
        print_json(SeriesInfo{input, list});
      else
        print_series(input, list);
      return {};
    }
    auto volume = SLF_TRY(hinted(read_volume(source)));
    const auto range = volume.value_range();
    if (arguments.json)
      print_json(VolumeInfo{std::move(volume), range, list.series});
    else
      print_volume(volume);
    return {};
  }
  const auto field = SLF_TRY(open_field(input, arguments.state));
  if (arguments.recipe) {
    print_document(recipe_json(field));
    return {};
  }
  const auto content = SLF_TRY(arguments.state.empty() ? field.file().content() : field.content());
  if (arguments.json) {
    const FieldShape& shape = field.shape();
    const FieldInfo info{nlohmann::json::parse(field.manifest()), content,
                         shape.entry_resolution(shape.finest_level),
                         shape.exit_resolution(shape.finest_level), RevealInfo::of(field)};
    print_json(info);
  } else {
    print_field(field, content);
  }
  if (!content.complete) note(input + ": incomplete; the build command that made it resumes it");
  return {};
}

}  // namespace

void add_info(CLI::App& app, Run& run) {
  const auto [command, a] = add_command(
      app, run, "info", "What a field (.slf), pictures, a mesh or a volume (anything else) holds",
      run_info);
  add_file(*command, "INPUT", a->source.input,
           std::string("Field: .slf\nPictures with cameras: pictures:FOLDER or pictures:JSON\n") +
               kVolumeHelp + "\n" + kMeshHelp)
      ->required();
  add_state(*command, "--state", a->state, "Of a field: count the tiles of this state only");
  a->source.add_to(*command, [](const auto& o) { return o.use == recipe::Use::reading; });
  add_json<FieldInfo, VolumeInfo, SeriesInfo, PicturesInfo, MeshInfo>(*command, a->json);
  command->add_flag("--recipe", a->recipe,
                    "Of a field: the recipe that `slf build` makes it of, as JSON; files by their\n"
                    "names alone");
}

}  // namespace slf::cli

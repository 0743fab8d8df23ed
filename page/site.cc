#include "page/site.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <initializer_list>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "base/bytes.h"
#include "base/join.h"
#include "base/reporter.h"
#include "base/try.h"
#include "field/field_file.h"
#include "field/structure_looks.h"
#include "field/write/field_writer.h"
#include "page/fit.h"
#include "page/page.h"
#include "slf/camera.h"
#include "slf/field.h"
#include "slf/image.h"
#include "slf/inspect.h"
#include "slf/render.h"

namespace slf::page {
namespace {

namespace fs = std::filesystem;

// The field is embedded in pieces of base64. This is a multiple of 3, so that only the last piece
// has padding.
constexpr std::size_t kPieceBytes = std::size_t{3} << 20;

/// Exported folders.
constexpr std::string_view kIndexFile = "index.html", kStyleFile = "style.css",
                           kScriptFile = "page.js", kModuleFile = "module.bin",
                           kModuleScriptFile = "module.bin.js", kCutFile = "cut.bin",
                           kCutScriptFile = "cut.bin.js", kFieldFile = "field.slf",
                           kViewsFile = "views.json", kDarkPoster = "poster.jpg",
                           kLightPoster = "poster-light.jpg";

constexpr std::uint32_t kPosterSize = 512;
constexpr std::size_t kMaxPosterBytes = 40000;

/// Some hosts send the page of a folder without the slash at the end of its address. Then the files
/// beside the page are not where their names lead. A path that begins with // would be a host.
constexpr std::string_view kSlashScript = R"(<script>
if (/\/[^./]+$/.test(location.pathname))
  document.head.append(Object.assign(document.createElement('base'), {
    href: location.href.split(/[?#]/)[0] + '/' + location.search}));
</script>
)";

std::string_view file_named(std::string_view name) {
  for (const PageFile& file : page_files())
    if (file.name == name) return file.bytes;
  return {};
}

std::string base64(std::string_view bytes) {
  constexpr std::string_view kDigits =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  text.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t at = 0; at < bytes.size(); at += 3) {
    const std::size_t count = std::min<std::size_t>(3, bytes.size() - at);
    std::uint32_t word = 0;
    for (std::size_t i = 0; i < 3; ++i)
      word = word << 8 | (i < count ? static_cast<unsigned char>(bytes[at + i]) : 0u);
    for (std::size_t i = 0; i < 4; ++i)
      text += i <= count ? kDigits[word >> (18 - 6 * i) & 63] : '=';
  }
  return text;
}

/// A WebAssembly module as a script, for where scripts cannot load other files.
std::string module_script(std::string_view name) {
  return concat("globalThis.slfModules = {...globalThis.slfModules, '", name, "': '",
                base64(file_named(name)), "'};\n");
}

/// Whether its pages need the module of cuts.
bool has_reveal(const Field& field) {
  const auto reveal = field.file().reveal();
  return !reveal || !reveal->empty();
}

void replace_first(std::string& text, std::string_view what, std::string_view by) {
  if (const std::size_t at = text.find(what); at != std::string::npos)
    text.replace(at, what.size(), by);
}

/// What the page shows before any script runs: its first view, on dark and on light.
struct Posters {
  std::string dark, light;  ///< JPEG files
  std::string first;  ///< ranges in the file, "BEGIN-END …", of the tiles of level 0 of that view
};

Result<Posters> make_posters(Field field, const Views& views) {
  if (!views.state.empty()) field = SLF_TRY(field.in_state(views.state));
  if (has_structures(field)) {
    const std::vector<std::string> all{"*"};
    const auto looks =
        SLF_TRY(parse_structures(views.structures ? *views.structures : all, field.states()));
    std::vector<StructureLook> unknown;
    auto shown = SLF_TRY(structures_of(field, looks, unknown));
    field = SLF_TRY(compose(field, std::move(shown)));
  }
  const Sphere& sphere = field.shape().sphere;
  std::array<double, 6> view{30, 20, 3, 0, 0, 0};  // as in camera.js
  std::ranges::copy(views.camera, view.begin());
  const Camera camera = page_camera(sphere, view, kPosterSize, kPosterSize);
  Renderer renderer(field);
  const RenderMode mode = field.has_depth() ? RenderMode::depth : RenderMode::bitri;
  Posters posters;
  ViewStatistics coarse;
  SLF_TRY(renderer.render(camera, {mode, 0}, &coarse));
  const std::vector itself{Structure{field}};
  for (const auto& [part, opacity, tint] : field.structures() ? *field.structures() : itself)
    SLF_TRY(list_tiles(part, {.last_level = 0}, [&](const ListedTile& tile) {
      if (tile.payload_bytes > 0 && std::ranges::binary_search(coarse.tiles, tile.key))
        posters.first += std::to_string(tile.offset_bytes) + "-" +
                         std::to_string(tile.offset_bytes + tile.payload_bytes) + " ";
      return Result<void>();
    }));
  if (views.cut) return posters;  // it would show the whole
  Image picture =
      SLF_TRY(renderer.render(camera, {mode, matching_level(field.shape(), camera, mode)}));
  SLF_TRY(map_tones(field, std::nullopt, /*display=*/true, picture));
  for (const auto& [background, poster] : {std::pair{glm::vec3(0), &posters.dark},
                                           {glm::vec3(244, 245, 247) / 255.0f, &posters.light}})
    for (int quality = 88; poster->empty() || poster->size() > kMaxPosterBytes; quality -= 8) {
      const auto bytes = SLF_TRY(
          encode_image("poster.jpg", picture, {.background = background, .jpeg_quality = quality}));
      poster->assign(chars_of(bytes));
      if (quality <= 8) break;
    }
  return posters;
}

std::string meta(std::string_view key, std::string_view name, std::string_view content) {
  if (content.empty()) return "";
  return concat("<meta ", key, "=\"", name, "\" content=\"", escape_html(content), "\">\n");
}

/// What search engines, and programs that show links, read of a page, in its head. `image` is
/// relative to `url`; either may be empty.
std::string described(const About& about, std::string_view url, std::string_view image) {
  const std::size_t path = url.find('/', url.find("://") + 3);  // none: the host's own page
  const std::string folder =
      path == url.npos ? concat(url, "/") : std::string(url.substr(0, url.rfind('/') + 1));
  const std::string shown = image.empty() ? "" : concat(url.empty() ? "" : folder, image);
  return meta("name", "description", about.description) + meta("name", "author", about.author) +
         meta("property", "og:type", "website") + meta("property", "og:title", about.title) +
         meta("property", "og:description", about.description) + meta("property", "og:url", url) +
         meta("property", "og:image", shown) +
         meta("name", "twitter:card", shown.empty() ? "" : "summary_large_image");
}

/// What the element contains before any script runs.
std::string poster_element(const Posters& posters, const About& about, const std::string& dark,
                           const std::string& light) {
  if (posters.dark.empty()) return "";
  return concat(
      "<picture slot=\"poster\"><source media=\"(prefers-color-scheme: light)\" srcset=\"", light,
      "\"><img src=\"", dark, "\" alt=\"", escape_html(about.title), "\"></picture>\n");
}

/// The page with more in its head, before the elements that refer to files.
std::string with_head(std::string html, const std::string& head) {
  return html.insert(html.find("<link rel=\"stylesheet\""), head);
}

/// What the panel says of the field, below its title.
std::string about_element(const About& about) {
  std::string parts = escape_html(about.description);
  const auto add = [&](const std::string& html) {
    if (!html.empty()) parts += (parts.empty() ? "" : " · ") + html;
  };
  add(escape_html(about.author));
  add(escape_html(about.licence));
  if (!about.source.empty())
    add("<a href=\"" + escape_html(about.source) + "\" rel=\"noopener\">Source</a>");
  if (about.title.empty() && parts.empty()) return "";
  return concat("<p slot=\"about\" data-title=\"", escape_html(about.title), "\">", parts,
                "</p>\n");
}

Result<void> export_page(const Field& field, const std::string& input, const std::string& output,
                         const Views& views, const std::string& url,
                         const ProgressCallback& progress) {
  if (field.file_bytes() > kMaxEmbeddedBytes)
    return unsupported(input, field.file_bytes(), " bytes are too many for one page; ",
                       "export to a folder, or make it smaller with slf repack");
  const auto bytes = SLF_TRY(read_file(field.path(), kMaxEmbeddedBytes));
  const std::string_view content = chars_of(bytes);

  const auto posters = SLF_TRY(make_posters(field, views));
  std::string scripts;
  if (!views.json.empty())
    scripts = "<script type=\"application/json\" class=\"views\">" + views.json + "</script>\n";
  Reporter reporter(progress, {0, content.size(), 0}, output + ": interrupted");
  for (std::size_t at = 0; at < content.size(); at += kPieceBytes) {
    const std::string_view piece = content.substr(at, kPieceBytes);
    scripts += "<script type=\"text/plain\" class=\"piece\">" + base64(piece) + "</script>\n";
    SLF_TRY(reporter.add(piece.size()));
  }
  scripts += "<script>\n" + module_script(kModuleFile) +
             (has_reveal(field) ? module_script(kCutFile) : "") +
             std::string(file_named(kScriptFile)) + "</script>\n";
  const auto inlined = [](std::string_view file) {
    return "data:image/jpeg;base64," + base64(file);
  };
  std::string page = with_head(
      page_with(
          views.about, views.attributes,
          poster_element(posters, views.about, inlined(posters.dark), inlined(posters.light))),
      concat(described(views.about, url, ""), "<style>\n", file_named(kStyleFile), "</style>\n"));
  const std::size_t links = page.find("<link rel=\"stylesheet\"");
  page.erase(links, page.find("</head>") - links);
  replace_first(page, "</body>", scripts + "</body>");
  return write_file(output, bytes_of(page));
}

Result<void> export_site(const Field& field, const std::string& input, const std::string& folder,
                         const Views& views, const std::string& url,
                         const ProgressCallback& progress) {
  const std::uint64_t size = field.file_bytes();
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) return fail(ErrorCode::io, folder, ": cannot create: ", error.message());
  // The field takes long and may not fit, so it is copied first. It gets its name last.
  const std::string target = (fs::path(folder) / kFieldFile).string();
  std::optional<NewFile> copy;
  if (!is_same_file(field.path(), target)) {
    SLF_TRY(check_output(target, {&input, 1}));  // as it is when it is made smaller
    auto copied = SLF_TRY(copy_file(field.path(), target, progress));
    copy.emplace(std::move(copied));
    SLF_TRY(index_field(copy->path(), [&] { return !progress || progress({size, size, 0}); }));
  }
  const auto posters = SLF_TRY(make_posters(field, views));
  const std::string element = page_with(
      views.about,
      "src=\"field.slf\" first=\"" + posters.first + "\"" + views.attributes +
          (views.json.empty() ? "" : " views=\"" + std::string(kViewsFile) + "\""),
      poster_element(posters, views.about, std::string(kDarkPoster), std::string(kLightPoster)));
  for (const auto& [name, text] : std::initializer_list<std::pair<std::string_view, std::string>>{
           {kIndexFile, with_head(element, described(views.about, url,
                                                     posters.dark.empty() ? "" : kDarkPoster) +
                                               std::string(kSlashScript))},
           {kDarkPoster, posters.dark},
           {kLightPoster, posters.light},
           {kStyleFile, std::string(file_named(kStyleFile))},
           {kScriptFile, std::string(file_named(kScriptFile))},
           {kModuleFile, std::string(file_named(kModuleFile))},
           {kModuleScriptFile, module_script(kModuleFile)},
           {kCutFile, has_reveal(field) ? std::string(file_named(kCutFile)) : ""},
           {kCutScriptFile, has_reveal(field) ? module_script(kCutFile) : ""},
           {kViewsFile, views.json}})
    if (!text.empty()) SLF_TRY(write_file((fs::path(folder) / name).string(), bytes_of(text)));
  return copy ? copy->publish(Existing::replace) : Result<void>();
}

/// bad_file: bytes of a tile do not match their checksum.
Result<void> check_tiles(const Field& field) {
  const auto& store = field.file().store();
  return store.visit({0, 0}, {255, 0}, [&](const auto& tile) { return store.check(tile); });
}

/// Whether an export is one file.
bool is_page_name(std::string_view output) {
  return output.ends_with(".html") || output.ends_with(".htm");
}

/// The size of the largest field, with its index, whose export as one HTML file or as a folder has
/// at most `max_bytes` bytes; 0 if the page alone is larger. `cuts`: the field has a reveal.
std::uint64_t room_for_field(std::uint64_t max_bytes, bool one_file, bool cuts) {
  // What is around scripts and pieces, and posters.
  std::uint64_t page = 65536 + 2 * (kMaxPosterBytes / 3 * 4 + 4);
  for (const PageFile& file : page_files()) {
    if (file.name == kCutFile && !cuts) continue;
    const bool module = file.name == kModuleFile || file.name == kCutFile;
    if (!one_file || !module) page += file.bytes.size();
    if (module) page += file.bytes.size() / 3 * 4 + 4;  // base64
  }
  if (max_bytes <= page) return 0;
  return one_file ? (max_bytes - page) / 4 * 3 : max_bytes - page;  // base64
}

/// The errors of export_field() that can be found before any work.
Result<void> check_export(const std::string& input, const std::string& output, Existing existing) {
  if (page_files().empty()) return fail(ErrorCode::unsupported, no_page());
  if (is_page_name(output)) return check_output(output, {&input, 1}, existing);
  std::error_code ignored;
  if (existing == Existing::keep && fs::is_directory(output, ignored) &&
      !fs::is_empty(output, ignored))
    return fail_without("replace in", ErrorCode::usage, output, ": is not empty");
  for (const std::string_view name :
       {kIndexFile, kStyleFile, kScriptFile, kModuleFile, kModuleScriptFile, kCutFile,
        kCutScriptFile, kViewsFile, kDarkPoster, kLightPoster})
    SLF_TRY(check_output((fs::path(output) / name).string(), {&input, 1}));
  const std::string target = (fs::path(output) / kFieldFile).string();
  return is_same_file(input, target) ? Result<void>() : check_output(target, {&input, 1});
}

/// Makes a smaller field if the options request one, and returns its descriptor. Without one, the
/// field is exported unchanged, as are several states for the sake of their light, since they would
/// be encoded again. It is made beside the output and loses its name at once, so that nothing
/// remains if the process is killed.
Result<Descriptor> repack_if_requested(const Field& field, std::string output,
                                       const ExportOptions& options,
                                       const ProgressCallback& progress) {
  const auto states = SLF_TRY(state_sources(field, options.states));
  RepackOptions repack = options.repack;
  repack.light = false;  // views do not need it
  const bool limited = options.max_size > 0, one_file = is_page_name(output);
  const std::uint64_t room =
      room_for_field(options.max_size, one_file, repack.reveal && has_reveal(field));
  if (limited && room == 0)
    return fail_without("max_size", ErrorCode::usage,
                        "the page alone is larger; allow 2MiB or more");
  const auto light = field.light();
  const bool drops_light = states.size() == 1 && (!light || !light->empty());
  const bool drops_reveal = !repack.reveal && has_reveal(field);
  // Older versions kept the path of the source, which is not for the public.
  const auto own = nlohmann::json::parse(field.provenance());
  const bool tells = own.contains("content") && own.contains("source") &&
                     own["source"].dump().find('/') != std::string::npos;
  const bool as_it_is = !drops_light && !drops_reveal && !field.structures() &&
                        options.states.empty() && !repack.finest_level && repack.codec.empty() &&
                        repack.depth && !tells;
  // In a folder, a field without an index gets one and so becomes larger; a repacked one has it.
  const bool fits = !limited || (one_file && field.file_bytes() <= room);
  if (as_it_is && fits) return check_tiles(field).map([] { return Descriptor(); });
  while (output.size() > 1 && output.back() == '/') output.pop_back();
  const std::string path = output + ".exporting";
  std::error_code ignored;
  if (fs::exists(fs::symlink_status(path, ignored)))
    return misuse(path, "exists; move or remove it: the export needs its name");
  SLF_TRY(limited ? repack_to_fit(states, path, repack, room, progress)
                  : join_states(states, path, repack, progress));
  Descriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  ::unlink(path.c_str());
  return file;
}

}  // namespace

std::string escape_html(std::string_view text) {
  std::string html;
  for (const char c : text)
    html += c == '&' ? "&amp;" : c == '<' ? "&lt;" : c == '"' ? "&quot;" : std::string(1, c);
  return html;
}

std::string page_with(const About& about, std::string_view attributes, std::string_view content) {
  std::string html(file_named(kIndexFile));
  replace_first(html, "<slf-field src=\"field.slf\" own address role=\"main\">\n",
                concat("<slf-field ", attributes, " address role=\"main\">\n", about_element(about),
                       content));
  if (!about.title.empty())
    replace_first(html, "<title>Sphere light field", "<title>" + escape_html(about.title));
  return html;
}

Result<ExportReport> export_field(const std::string& input, const std::string& output,
                                  const ExportOptions& options, const ProgressCallback& tiles,
                                  const ProgressCallback& bytes) {
  SLF_TRY(check_export(input, output, options.existing));
  if (!options.url.empty() && !is_address(options.url))
    return fail_without("url", ErrorCode::usage, "an address was expected, https://…");
  const auto field = SLF_TRY(Field::open(input));
  auto views = SLF_TRY(parse_views(options.views, field.shape().sphere));
  if (!options.title.empty()) views.about.title = options.title;
  const auto file = SLF_TRY(repack_if_requested(field, output, options, tiles));
  const bool smaller = file.get() >= 0;
  const auto exported = SLF_TRY(smaller ? Field::open(path_of_descriptor(file.get())) : field);
  if (auto begun = begin_with(options.first, exported, views); !begun) {
    if (!smaller || !begin_with(options.first, field, views)) return tl::unexpected(begun.error());
    return fail(ErrorCode::usage, "what the page shows first is not among the states to keep");
  }
  SLF_TRY(is_page_name(output) ? export_page(exported, input, output, views, options.url, bytes)
                               : export_site(exported, input, output, views, options.url, bytes));
  return ExportReport{output, exported.file_bytes(), exported.shape().finest_level};
}

}  // namespace slf::page

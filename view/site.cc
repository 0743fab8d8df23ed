#include "view/site.h"

#include <algorithm>
#include <filesystem>
#include <initializer_list>
#include <optional>
#include <utility>

#include "base/bytes.h"
#include "base/reporter.h"
#include "base/try.h"
#include "field/write/field_index.h"
#include "slf/field.h"
#include "view/bundle.h"
#include "view/page.h"

namespace slf::view {
namespace {

namespace fs = std::filesystem;

// The field is embedded in pieces of base64. This is a multiple of 3, so that only the last piece
// has padding.
constexpr std::size_t kPieceBytes = std::size_t{3} << 20;

/// Exported folders.
constexpr std::string_view kIndexFile = "index.html", kStyleFile = "style.css",
                           kScriptFile = "page.js", kModuleScriptFile = "module.bin.js",
                           kFieldFile = "field.slf";

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

void replace_first(std::string& text, std::string_view what, std::string_view by) {
  if (const std::size_t at = text.find(what); at != std::string::npos)
    text.replace(at, what.size(), by);
}

/// The page with other elements in its head, in place of those that refer to files, and with other
/// scripts.
std::string page_html(std::string_view head, std::string_view scripts) {
  std::string html(file_named("index.html"));
  const std::size_t links = html.find("<link rel=\"stylesheet\"");
  html.replace(links, html.find("</head>") - links, head);
  replace_first(html, "<script type=\"module\" src=\"main.js\"></script>\n", scripts);
  return html;
}

/// Checks that the file is a field, and returns its size.
Result<std::uint64_t> field_size(const std::string& path) {
  const auto field = SLF_TRY(Field::open(path));
  return field.file_bytes();
}

Result<void> export_page(const std::string& field, const std::string& input,
                         const std::string& output, const ProgressCallback& progress) {
  const auto size = SLF_TRY(field_size(field));
  if (size > kMaxEmbeddedBytes)
    return unsupported(input, size, " bytes are too many for one page; ",
                       "export to a folder, or make it smaller with slf repack");
  const auto bytes = SLF_TRY(read_file(field, kMaxEmbeddedBytes));
  const std::string_view content(reinterpret_cast<const char*>(bytes.data()), bytes.size());

  std::string scripts;
  Reporter reporter(progress, {0, content.size(), 0}, output + ": interrupted");
  for (std::size_t at = 0; at < content.size(); at += kPieceBytes) {
    const std::string_view piece = content.substr(at, kPieceBytes);
    scripts += "<script type=\"text/plain\" class=\"piece\">" + base64(piece) + "</script>\n";
    SLF_TRY(reporter.add(piece.size()));
  }
  scripts +=
      "<script>\n" +
      page_script("module: " + module_string() + ",\npieceBytes: " + std::to_string(kPieceBytes) +
                  ", size: " + std::to_string(content.size()) + ",\n") +
      "</script>\n";
  const std::string page =
      page_html("<style>\n" + std::string(file_named(kStyleFile)) + "</style>", scripts);
  return write_file(output, bytes_of(page));
}

Result<void> export_site(const std::string& field, const std::string& input,
                         const std::string& folder, const ProgressCallback& progress) {
  const auto size = SLF_TRY(field_size(field));
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) return fail(ErrorCode::io, folder, ": cannot create: ", error.message());
  // The field takes long and may not fit, so it is copied first. It gets its name last.
  const std::string target = (fs::path(folder) / kFieldFile).string();
  std::optional<NewFile> copy;
  if (!is_same_file(field, target)) {
    SLF_TRY(check_output(target, {&input, 1}));  // as it is when it is made smaller
    auto copied = SLF_TRY(copy_file(field, target, progress));
    copy.emplace(std::move(copied));
    SLF_TRY(index_field(copy->path(), [&] { return !progress || progress({size, size, 0}); }));
  }
  const std::string style = "<link rel=\"stylesheet\" href=\"" + std::string(kStyleFile) + "\">\n";
  const std::string module =
      "<link rel=\"preload\" href=\"" + std::string(kModuleFile) + "\" as=\"fetch\" crossorigin>\n";
  const std::string script = "<script src=\"" + std::string(kScriptFile) + "\"></script>\n";
  for (const auto& [name, text] : std::initializer_list<std::pair<std::string_view, std::string>>{
           {kIndexFile, page_html(std::string(kSlashScript) + style + module, script)},
           {kStyleFile, std::string(file_named(kStyleFile))},
           {kScriptFile, page_script("")},
           {kModuleFile, std::string(file_named(kModuleFile))},
           {kModuleScriptFile, "slfInside.module = " + module_string() + ";\n"}})
    SLF_TRY(write_file((fs::path(folder) / name).string(), bytes_of(text)));
  return copy ? copy->publish(Existing::replace) : Result<void>();
}

}  // namespace

std::uint64_t room_for_field(std::uint64_t max_bytes, bool one_file) {
  std::uint64_t page = 65536;  // what is around scripts and pieces
  for (const PageFile& file : page_files()) {
    if (!one_file || file.name != kModuleFile) page += file.bytes.size();
    if (file.name == kModuleFile) page += file.bytes.size() / 3 * 4 + 4;  // base64
  }
  if (max_bytes <= page) return 0;
  return one_file ? (max_bytes - page) / 4 * 3 : max_bytes - page;  // base64
}

bool is_page_name(std::string_view output) {
  return output.ends_with(".html") || output.ends_with(".htm");
}

Result<void> check_export(const std::string& input, const std::string& output, Existing existing) {
  if (page_files().empty()) return fail(ErrorCode::unsupported, no_page());
  if (is_page_name(output)) return check_output(output, {&input, 1}, existing);
  std::error_code ignored;
  if (existing == Existing::keep && fs::is_directory(output, ignored) &&
      !fs::is_empty(output, ignored))
    return fail_without("replace in", ErrorCode::usage, output, ": is not empty");
  for (const std::string_view name :
       {kIndexFile, kStyleFile, kScriptFile, kModuleFile, kModuleScriptFile})
    SLF_TRY(check_output((fs::path(output) / name).string(), {&input, 1}));
  const std::string target = (fs::path(output) / kFieldFile).string();
  return is_same_file(input, target) ? Result<void>() : check_output(target, {&input, 1});
}

Result<void> export_field(const std::string& field, const std::string& input,
                          const std::string& output, Existing existing,
                          const ProgressCallback& progress) {
  SLF_TRY(check_export(input, output, existing));
  return is_page_name(output) ? export_page(field, input, output, progress)
                              : export_site(field, input, output, progress);
}

}  // namespace slf::view

#include "view/site.h"

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <initializer_list>
#include <utility>

#include "base/bytes.h"
#include "base/file.h"
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

/// Exported folders: files beside index.html.
constexpr std::string_view kStyleFile = "style.css", kScriptFile = "page.js",
                           kModuleScriptFile = "module.bin.js";

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

/// Writes a file of the page, but never over the field.
Result<void> write_text(const std::string& path, std::string_view text, const std::string& field) {
  SLF_TRY(check_output(path, {&field, 1}));
  return write_file(path, bytes_of(text));
}

/// Checks that the file is a field, and returns its size.
Result<std::uint64_t> field_size(const std::string& path) {
  const auto field = SLF_TRY(Field::open(path));
  return field.file_bytes();
}

/// Removes copies of the field `target` that exports which were killed left beside it, under names
/// that unused_name() gave.
void remove_abandoned(const fs::path& target) {
  const std::string start = target.filename().string() + ".";
  std::error_code code;
  for (auto it = fs::directory_iterator(target.parent_path(), code);
       !code && it != fs::directory_iterator(); it.increment(code)) {
    const std::string name = it->path().filename().string();
    pid_t process = 0;
    unsigned count = 0;
    int end = 0;
    const bool named =
        name.starts_with(start) &&
        std::sscanf(name.c_str() + start.size(), "%d-%u.tmp%n", &process, &count, &end) == 2 &&
        end > 0 && name.size() == start.size() + static_cast<std::size_t>(end);
    const bool dead = process > 0 && ::kill(process, 0) != 0 && errno == ESRCH;
    std::error_code ignored;
    if (named && dead && it->is_regular_file(ignored)) fs::remove(it->path(), ignored);
  }
}

/// A file that is removed unless it gets another name.
struct Draft {
  std::string path{};
  Draft() = default;
  Draft(const Draft&) = delete;
  Draft& operator=(const Draft&) = delete;
  ~Draft() {
    std::error_code ignored;
    if (!path.empty()) fs::remove(path, ignored);
  }
};

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

Result<void> export_page(const std::string& field, const std::string& output,
                         const ProgressCallback& progress) {
  const auto size = SLF_TRY(field_size(field));
  if (size > kMaxEmbeddedBytes)
    return fail(ErrorCode::unsupported, field, ": ", size, " bytes are too many for one page; ",
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
  return write_text(
      output, page_html("<style>\n" + std::string(file_named(kStyleFile)) + "</style>", scripts),
      field);
}

Result<void> export_site(const std::string& field, const std::string& folder, bool force,
                         const ProgressCallback& progress) {
  const auto size = SLF_TRY(field_size(field));
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) return fail(ErrorCode::io, folder, ": cannot create: ", error.message());
  const fs::path target = fs::path(folder) / "field.slf";
  remove_abandoned(target);
  if (!force && !fs::is_empty(folder, error))
    return fail(ErrorCode::usage, folder, ": is not empty; -f overwrites files in it");
  // The field takes long and may not fit, so it is copied first. It gets its name last.
  Draft draft;
  if (!fs::equivalent(field, target, error)) {
    SLF_TRY(check_output(target.string(), {&field, 1}));
    draft.path = unused_name(target.string());
    SLF_TRY(copy_file(field, draft.path, progress));
    SLF_TRY(index_field(draft.path, [&] { return !progress || progress({size, size, 0}); }));
  }
  const std::string style = "<link rel=\"stylesheet\" href=\"" + std::string(kStyleFile) + "\">\n";
  const std::string module =
      "<link rel=\"preload\" href=\"" + std::string(kModuleFile) + "\" as=\"fetch\" crossorigin>\n";
  const std::string script = "<script src=\"" + std::string(kScriptFile) + "\"></script>\n";
  for (const auto& [name, text] : std::initializer_list<std::pair<std::string_view, std::string>>{
           {"index.html", page_html(std::string(kSlashScript) + style + module, script)},
           {kStyleFile, std::string(file_named(kStyleFile))},
           {kScriptFile, page_script("")},
           {kModuleFile, std::string(file_named(kModuleFile))},
           {kModuleScriptFile, "slfInside.module = " + module_string() + ";\n"}})
    SLF_TRY(write_text((fs::path(folder) / name).string(), text, field));
  if (draft.path.empty()) return {};
  return publish_file(draft.path, target.string(), Existing::replace);
}

}  // namespace slf::view

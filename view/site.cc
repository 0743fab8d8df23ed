#include "view/site.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <utility>

#include "base/bytes.h"
#include "base/file.h"
#include "field/build/field_index.h"
#include "slf/field.h"
#include "view/page.h"

namespace slf::view {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kModuleFile = "module.bin";
// The field is embedded in pieces of base64. This is a multiple of 3, so that only the last piece
// has padding.
constexpr std::size_t kPieceBytes = std::size_t{3} << 20;

/// Inside one file, scripts cannot import each other by name. So this script gives each module an
/// address of its own, in the order of the imports. The worker gets the text of the module that it
/// imports instead. PIECE and SIZE stand for numbers.
constexpr std::string_view kStartScript = R"(<script>
{
  const texts = {}, urls = {};
  const url = (text) => URL.createObjectURL(new Blob([text], {type: 'text/javascript'}));
  const text = (id) => document.getElementById(id).textContent;
  const bytes = (base64) => Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));
  for (const script of document.querySelectorAll('script[type="text/x-module"]')) {
    texts[script.id] = script.textContent;
    urls[script.id] = url(script.textContent.replace(/from '\.\/([\w.]+)'/g,
      (_, name) => `from '${urls[name]}'`));
  }
  const plain = texts['module.js'].replace(/^export /gm, '');
  const pieces = [...document.querySelectorAll('script.piece')].map((s) => s.textContent);
  globalThis.slfInside = {
    worker: url(plain + texts['worker.js'].replace(/^import .*$/gm, '')),
    wasm: bytes(text('module.bin')),
    pieces, pieceBytes: PIECE, size: SIZE,
  };
  import(urls['main.js']);
}
</script>
)";

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

std::string_view file_named(std::string_view name) {
  for (const PageFile& file : page_files())
    if (file.name == name) return file.bytes;
  return {};
}

void replace_first(std::string& text, std::string_view what, std::string_view by) {
  if (const std::size_t at = text.find(what); at != std::string::npos)
    text.replace(at, what.size(), by);
}

/// Checks that the file is a field, and returns its size.
Result<std::uint64_t> field_size(const std::string& path) {
  const auto field = Field::open(path);
  if (!field) return tl::unexpected(field.error());
  return field->file_bytes();
}

}  // namespace

std::uint64_t room_for_field(std::uint64_t max_bytes, bool one_file) {
  std::uint64_t page = 0;
  for (const PageFile& file : page_files())
    page +=
        one_file && file.name == kModuleFile ? file.bytes.size() / 3 * 4 + 4 : file.bytes.size();
  if (one_file)
    page += kStartScript.size() + 65536;  // 65536: the elements around scripts and pieces
  if (max_bytes <= page) return 0;
  return one_file ? (max_bytes - page) / 4 * 3 : max_bytes - page;  // base64
}

Result<void> export_page(const std::string& field, const std::string& output) {
  const auto size = field_size(field);
  if (!size) return tl::unexpected(size.error());
  if (*size > kMaxEmbeddedBytes)
    return fail(ErrorCode::unsupported, field, ": ", *size, " bytes are too many for one page; ",
                "export to a folder, or make it smaller with slf repack");
  const auto bytes = read_file(field, kMaxEmbeddedBytes);
  if (!bytes) return tl::unexpected(bytes.error());
  const std::string_view content(reinterpret_cast<const char*>(bytes->data()), bytes->size());

  std::string scripts;
  for (const PageFile& file : page_files())
    if (file.name.ends_with(".js")) {
      scripts += "<script type=\"text/x-module\" id=\"" + std::string(file.name) + "\">\n";
      scripts.append(file.bytes).append("</script>\n");
    }
  scripts += "<script type=\"text/plain\" id=\"module.bin\">" + base64(file_named(kModuleFile)) +
             "</script>\n";
  for (std::size_t at = 0; at < content.size(); at += kPieceBytes)
    scripts += "<script type=\"text/plain\" class=\"piece\">" +
               base64(content.substr(at, kPieceBytes)) + "</script>\n";
  std::string start(kStartScript);
  replace_first(start, "PIECE", std::to_string(kPieceBytes));
  replace_first(start, "SIZE", std::to_string(content.size()));

  // In place of links to files: their content.
  std::string html(file_named("index.html"));
  const std::size_t preloads = html.find("<link rel=\"modulepreload\"");
  html.erase(preloads, html.find("</head>") - preloads);
  replace_first(html, "<link rel=\"stylesheet\" href=\"style.css\">",
                "<style>\n" + std::string(file_named("style.css")) + "</style>");
  replace_first(html, "<script type=\"module\" src=\"main.js\"></script>\n", scripts + start);
  return write_file(output, std::as_bytes(std::span(html.data(), html.size())));
}

Result<void> export_site(const std::string& field, const std::string& folder, bool force) {
  if (auto size = field_size(field); !size) return tl::unexpected(size.error());
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) return fail(ErrorCode::io, folder, ": cannot create: ", error.message());
  if (!force && !fs::is_empty(folder, error))
    return fail(ErrorCode::usage, folder, ": is not empty; -f overwrites files in it");
  for (const PageFile& file : page_files()) {
    const auto bytes = std::as_bytes(std::span(file.bytes.data(), file.bytes.size()));
    if (auto ok = write_file((fs::path(folder) / file.name).string(), bytes); !ok) return ok;
  }
  // The field is written last, and gets its name only when it is complete.
  const fs::path target = fs::path(folder) / "field.slf", temporary = target.string() + ".part";
  if (fs::equivalent(field, target, error)) return {};
  Result<void> indexed;
  fs::copy_file(field, temporary, fs::copy_options::overwrite_existing, error);
  if (!error) fs::permissions(temporary, fs::perms::owner_write, fs::perm_options::add, error);
  if (!error) indexed = index_field(temporary);
  if (!error && indexed) fs::rename(temporary, target, error);
  if (!error && indexed) return {};
  std::error_code ignored;
  fs::remove(temporary, ignored);
  if (!indexed) return indexed;
  return fail(ErrorCode::io, target.string(), ": cannot write: ", error.message());
}

}  // namespace slf::view

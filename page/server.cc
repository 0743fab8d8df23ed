#include "page/server.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <filesystem>
#include <optional>
#include <random>
#include <utility>

#include "base/file.h"
#include "base/try.h"
#include "page/http.h"
#include "page/page.h"
#include "page/ranges.h"
#include "page/site.h"
#include "slf/field.h"

namespace slf::page {
namespace {

/// Who may show the page in a frame comes last.
constexpr const char* kPolicy =
    "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; style-src 'self'; img-src 'self' "
    "blob: data:; connect-src 'self'; worker-src blob:; frame-src 'self'; base-uri 'none'; "
    "form-action 'none'";
/// Notebooks on this machine; http stands for https, too.
constexpr const char* kFrames = "; frame-ancestors 'self' http://localhost:* http://127.0.0.1:*";

/// The folder of what `ServerOptions::studio` answers.
constexpr std::string_view kStudio = "/studio/";

/// A file as requests see it.
struct Content {
  std::uint64_t size;
  std::string tag;   ///< entity tag
  std::string type;  ///< media type
  Response::Read read;
};

struct ServedField {
  std::string name;  ///< its folder
  std::string path;
};

/// The current content of a field; none if it cannot be read. Each request opens the file that has
/// its name now.
std::optional<Content> content_of(const ServedField& field) {
  const auto file = std::make_shared<const Descriptor>(
      ::open(field.path.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC));
  struct stat status = {};
  if (file->get() < 0 || fstat(file->get(), &status) != 0 || !S_ISREG(status.st_mode) ||
      status.st_size == 0)
    return std::nullopt;
  std::array<char, 100> tag;
  std::snprintf(tag.data(), tag.size(), "\"%llx-%llx-%llx-%lx\"",
                static_cast<unsigned long long>(status.st_ino),
                static_cast<unsigned long long>(status.st_size),
                static_cast<unsigned long long>(status.st_mtim.tv_sec), status.st_mtim.tv_nsec);
  return Content{static_cast<std::uint64_t>(status.st_size), tag.data(), "application/octet-stream",
                 [file](std::uint64_t offset, std::span<char> to) -> std::size_t {
                   const ssize_t got =
                       pread(file->get(), to.data(), to.size(), static_cast<off_t>(offset));
                   return got < 0 ? 0 : static_cast<std::size_t>(got);
                 }};
}

/// A field's name as part of an address: letters, digits, '.', '-' and '_'.
std::string folder_name(const std::string& path) {
  std::string name = std::filesystem::path(path).stem().string();
  for (char& c : name)
    if (!std::isalnum(static_cast<unsigned char>(c)) && c != '.' && c != '-') c = '_';
  if (name.empty() || name[0] == '.') name.insert(0, "_");
  return name;
}

std::string content_range(const FilePart& part, std::uint64_t file) {
  return "bytes " + std::to_string(part.first) + "-" + std::to_string(part.first + part.size - 1) +
         "/" + std::to_string(file);
}

/// Whether a list of entity tags contains `tag`, even as a weak tag.
bool contains_tag(std::string_view header, std::string_view tag) {
  return header == "*" || header.find(tag) != std::string_view::npos;
}

/// Whether a header Host names this machine. The port may be another one, which something else
/// forwards here.
bool is_loopback(std::string_view host) {
  for (const std::string_view name : {"127.0.0.1", "localhost", "[::1]"}) {
    if (!host.starts_with(name)) continue;
    const std::string_view port = host.substr(name.size());
    return port.empty() ||
           (port[0] == ':' && port.find_first_not_of("0123456789", 1) == std::string_view::npos);
  }
  return false;
}

/// A word that nobody guesses: 32 hexadecimal digits of the system's random numbers.
std::string make_token() {
  std::random_device random;
  std::string token;
  while (token.size() < 32) token += "0123456789abcdef"[random() & 15];
  return token;
}

/// Whether a text begins with another one, in a time that does not tell where they differ.
bool begins_with_secret(std::string_view text, std::string_view secret) {
  if (text.size() < secret.size()) return false;
  unsigned differences = 0;
  for (std::size_t k = 0; k < secret.size(); ++k)
    differences |= static_cast<unsigned>(text[k] ^ secret[k]);
  return differences == 0;
}

/// An address for browsers of a server that listens on `address`: of this machine in its network,
/// if that is all addresses.
std::string reachable_address(const std::string& address) {
  if (address != "0.0.0.0" && address != "::") return address;
  std::string found = address == "::" ? "::1" : "127.0.0.1";
  ifaddrs* all = nullptr;
  if (getifaddrs(&all) != 0) return found;
  for (const ifaddrs* at = all; at != nullptr; at = at->ifa_next) {
    if (at->ifa_addr == nullptr || at->ifa_addr->sa_family != AF_INET ||
        (at->ifa_flags & IFF_LOOPBACK) != 0 || (at->ifa_flags & IFF_UP) == 0)
      continue;
    std::array<char, INET_ADDRSTRLEN> text;
    const auto& ipv4 = *reinterpret_cast<const sockaddr_in*>(at->ifa_addr);
    found = inet_ntop(AF_INET, &ipv4.sin_addr, text.data(), text.size());
    break;
  }
  freeifaddrs(all);
  return found;
}

bool answer_text(Response& response, int status, const std::string& text) {
  response.status = status;
  response.set("Content-Type", "text/plain; charset=utf-8");
  response.body = {{text + "\n"}};
  return true;
}

bool redirect(Response& response, std::string_view where) {
  response.status = 302;
  response.set("Location", where);
  return true;
}

Content page_content(std::string_view bytes, std::string_view type, const std::string& tag) {
  return {bytes.size(), tag, std::string(type), [bytes](std::uint64_t offset, std::span<char> to) {
            return bytes.copy(to.data(), to.size(), offset);
          }};
}

bool answer_content(const Request& request, Response& response, const Content& content) {
  response.set("ETag", content.tag);
  response.set("Accept-Ranges", "bytes");
  if (request.count("if-match") > 0 && !contains_tag(request.header("if-match"), content.tag))
    return answer_text(response, 412, "The file has changed.");
  if (contains_tag(request.header("if-none-match"), content.tag)) {
    response.status = 304;
    return true;
  }
  const bool same = request.count("if-range") == 0 || request.header("if-range") == content.tag;
  const auto parts = select_ranges(same ? request.header("range") : "", content.size);
  if (parts && parts->empty()) {
    response.set("Content-Range", "bytes */" + std::to_string(content.size));
    return answer_text(response, 416, "The file has " + std::to_string(content.size) + " bytes.");
  }
  response.status = parts ? 206 : 200;
  response.read = content.read;
  const bool several = parts && parts->size() > 1;
  response.set("Content-Type", several ? "multipart/byteranges; boundary=slf-part" : content.type);
  if (!parts) {
    response.body = {{"", {0, content.size}}};
  } else if (!several) {
    response.set("Content-Range", content_range(parts->front(), content.size));
    response.body = {{"", parts->front()}};
  } else {
    for (const FilePart& part : *parts)
      response.body.push_back({"\r\n--slf-part\r\nContent-Type: " + content.type +
                                   "\r\nContent-Range: " + content_range(part, content.size) +
                                   "\r\n\r\n",
                               part});
    response.body.push_back({"\r\n--slf-part--\r\n"});
  }
  return true;
}

/// Whether a name of --allow-frames is an origin as policies write it.
bool is_origin(std::string_view text) {
  const bool secure = text.starts_with("https://");
  if (!secure && !text.starts_with("http://")) return false;
  text.remove_prefix(secure ? 8 : 7);
  const std::string_view host = text.substr(0, text.find(':'));
  const std::string_view port = text.substr(host.size());
  const auto of = [](std::string_view part, const char* characters) {
    return !part.empty() && part.find_first_not_of(characters) == std::string_view::npos;
  };
  return of(host, "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789.-") &&
         (port.empty() || port == ":*" || of(port.substr(1), "0123456789"));
}

}  // namespace

struct Server::State {
  HttpServer http;
  std::vector<ServedField> fields;
  std::string url, tag;  // tag: the entity tag of the page's files
  std::string root;      // "/TOKEN"
  std::string frames = kFrames;
  std::string views, index;  // views.json, or empty; index.html
  bool any_host = false;
  std::function<std::optional<Response>(const Request&, std::string_view)> studio;

  [[nodiscard]] std::optional<Response> answer(const Request& request) const;
  bool answer_list(Response& response) const;
  /// Whether there is an answer already.
  bool choose(const Request& request, Response& response) const;
  [[nodiscard]] Result<std::string> add(const std::string& path);
};

std::optional<Response> Server::State::answer(const Request& request) const {
  Response response;
  // Policies cannot name [::1], but a page there says where it is when it opens a frame.
  const std::string_view referer = request.header("referer");
  const bool from_ipv6 =
      referer.starts_with("http://[::1]:") || referer.starts_with("https://[::1]:");
  response.set("Content-Security-Policy", kPolicy + (from_ipv6 ? "" : frames));
  response.set("Cache-Control", from_ipv6 ? "no-store" : "no-cache");
  response.set("X-Content-Type-Options", "nosniff");
  response.set("Referrer-Policy", "no-referrer");
  response.set("Cross-Origin-Resource-Policy", "same-origin");
  if (!choose(request, response)) return std::nullopt;
  return response;
}

bool Server::State::choose(const Request& request, Response& response) const {
  if (!any_host && (request.count("host") != 1 || !is_loopback(request.header("host"))))
    return answer_text(response, 403,
                       "Host not allowed: this server answers only to 127.0.0.1, localhost and "
                       "[::1]. slf view --bind ADDRESS answers to any name.");
  const bool reads = request.method == "GET" || request.method == "HEAD";
  const auto refuse_method = [&] {
    response.set("Allow", "GET, HEAD");
    return answer_text(response, 405, "Only GET and HEAD work here.");
  };
  if (!reads && !studio) return refuse_method();
  std::string_view path = request.path;
  // The token is in the path, because frames of other sites get no cookies.
  if (!begins_with_secret(path, root))
    return answer_text(response, 403,
                       "Not allowed: an address of this server begins with the token that slf view "
                       "or field.show() printed.");
  path.remove_prefix(root.size());
  if (studio && path.starts_with(kStudio)) {
    auto made = studio(request, path.substr(kStudio.size()));
    if (!made) return false;
    made->headers.insert(0, response.headers);
    response = std::move(*made);
    return true;
  }
  if (!reads) return refuse_method();
  if (path.empty()) return redirect(response, root.substr(1) + "/");
  if (path == "/") {
    if (fields.size() > 1 && !studio) return answer_list(response);
    return redirect(response, studio ? kStudio.substr(1) : fields[0].name + "/");
  }
  for (const ServedField& field : fields) {
    const std::string folder = "/" + field.name;
    if (path == folder) return redirect(response, field.name + "/");
    if (!path.starts_with(folder + "/")) continue;
    const std::string_view name = path.substr(folder.size() + 1);
    if (name == "field.slf") {
      if (const auto content = content_of(field))
        return answer_content(request, response, *content);
      return answer_text(response, 500, "The field cannot be read.");
    }
    if (name == "views.json" && !views.empty())
      return answer_content(request, response, page_content(views, "application/json", tag));
    for (const PageFile& file : page_files()) {
      const bool is_index = file.name == "index.html";
      if (name != file.name && !(name.empty() && is_index)) continue;
      return answer_content(
          request, response,
          page_content(is_index ? std::string_view(index) : file.bytes, file.type, tag));
    }
  }
  return answer_text(response, 404, "Not here. The fields are listed right behind the token.");
}

bool Server::State::answer_list(Response& response) const {
  std::string html =
      "<!doctype html><html lang=\"en\"><meta "
      "charset=\"utf-8\"><title>Fields</title><h1>Fields</h1><ul>";
  for (const ServedField& field : fields)  // names need no escaping in HTML
    html += "<li><a href=\"" + field.name + "/\">" + field.name + "</a></li>";
  response.set("Content-Type", "text/html; charset=utf-8");
  response.body = {{html + "</ul></html>"}};
  return true;
}

Result<std::string> Server::State::add(const std::string& path) {
  SLF_TRY(Field::open(path));
  const std::string name = folder_name(path);
  ServedField field{name, path};
  for (int copy = 2; std::ranges::any_of(
           fields, [&](const ServedField& other) { return other.name == field.name; });
       ++copy)
    field.name = name + "-" + std::to_string(copy);
  return fields.emplace_back(std::move(field)).name;
}

Server::Server(std::unique_ptr<State> state) : state_(std::move(state)) {}
Server::Server(Server&&) noexcept = default;
Server& Server::operator=(Server&&) noexcept = default;
Server::~Server() = default;

const std::string& Server::url() const { return state_->url; }

Result<Server> Server::make(std::span<const std::string> fields, const ServerOptions& options) {
  if (fields.empty() && !options.studio)
    return fail(ErrorCode::usage, "view: name at least one field");
  auto state = std::make_unique<State>();
  for (const std::string& path : fields) SLF_TRY(state->add(path));
  const First& first = options.first;
  if (fields.size() > 1 &&
      !(options.views.text.empty() && first.state.empty() && first.structures.empty()))
    return fail(ErrorCode::usage,
                "views, a state and structures to show first are of one field, but ", fields.size(),
                " are given");
  Views views;
  if (!fields.empty()) {
    const auto field = SLF_TRY(Field::open(fields[0]));
    views = SLF_TRY(parse_views(options.views, field.shape().sphere));
    SLF_TRY(begin_with(first, field, views));
  }
  state->views = views.json;
  state->studio = options.studio;
  state->index = page_with(views.about,
                           "src=\"field.slf\" own" + views.attributes +
                               (views.json.empty() ? "" : " views=\"views.json\""),
                           "");
  std::size_t hash = std::hash<std::string>()(state->index + state->views);
  for (const PageFile& file : page_files())
    hash = hash * 31 + std::hash<std::string_view>()(file.bytes);
  state->tag = "\"" + std::to_string(hash) + "\"";

  for (const std::string& origin : options.frames) {
    if (!is_origin(origin))
      return misuse(origin, "not an origin such as https://notebooks.example.org");
    state->frames += " " + origin;
  }
  const auto port = SLF_TRY(state->http.bind(options.address, options.port));
  state->any_host = options.any_host;
  state->root = "/" + make_token();
  const std::string address = reachable_address(options.address);
  const bool ipv6 = address.find(':') != std::string::npos;
  state->url = "http://" + (ipv6 ? "[" + address + "]" : address) + ":" + std::to_string(port) +
               state->root + "/" + (fields.size() == 1 ? state->fields[0].name + "/" : "");
  return Server(std::move(state));
}

Result<std::string> Server::add(const std::string& field) { return state_->add(field); }

Result<void> Server::run(const std::function<bool()>& stop) {
  return state_->http.run([this](const Request& request) { return state_->answer(request); }, stop);
}

}  // namespace slf::page

// Fields in a browser: the server of ranges, and exported pages.
#include <unistd.h>

#include <atomic>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "convert.h"
#include "fields.h"
#include "module.h"
#include "page/page.h"
#include "page/server.h"
#include "page/site.h"
#include "page/studio/studio.h"

namespace slf::python {
namespace {

/// Serves a field, or a studio, on a thread of its own until it is closed.
class ViewServer {
 public:
  ViewServer(const std::vector<std::string>& fields, const Text& name,
             const page::ServerOptions& options)
      : server_(value_of(page::Server::make(fields, options), name)),
        thread_(std::make_unique<std::thread>(
            [this] { (void)server_.run([this] { return stop_.load(); }); })) {}
  ~ViewServer() { close(); }
  ViewServer(const ViewServer&) = delete;
  ViewServer& operator=(const ViewServer&) = delete;

  [[nodiscard]] const std::string& url() const { return server_.url(); }
  page::Server& server() { return server_; }
  void close() {
    if (getpid() != process_)
      (void)thread_.release();  // it is missing in this process, a forked one
    if (!thread_) return;
    stop_ = true;
    const py::gil_scoped_release release;
    thread_->join();
    thread_.reset();
  }

 private:
  page::Server server_;
  std::atomic<bool> stop_{false};
  const pid_t process_ = getpid();
  std::unique_ptr<std::thread> thread_;
};

/// A studio and its server.
class StudioServer {
 public:
  StudioServer(const Recipe& recipe, page::StudioOptions options, bool any_host) {
    const Text output(options.output);
    options.show = [this](const std::string& field) { return server_->server().add(field); };
    studio_ = value_of(page::Studio::make(recipe, std::move(options)), output);
    page::ServerOptions how{.any_host = any_host};
    how.studio = [this](const page::Request& request, std::string_view rest) {
      return studio_->answer(request, rest);
    };
    server_ = std::make_unique<ViewServer>(std::vector<std::string>(), output, how);
  }
  ~StudioServer() { close(); }
  StudioServer(const StudioServer&) = delete;
  StudioServer& operator=(const StudioServer&) = delete;

  [[nodiscard]] Text url() const { return Text(server_->url()); }
  void close() {
    server_->close();
    const py::gil_scoped_release release;
    studio_.reset();
  }

 private:
  std::unique_ptr<page::Studio> studio_;
  std::unique_ptr<ViewServer> server_;
};

void check_page() {
  if (page::page_files().empty()) throw Failure({ErrorCode::unsupported, page::no_page()}, "");
}

/// Views as Python has them: None, a file, or what such a file has.
page::ViewsFile views_of(const py::object& views) {
  if (views.is_none()) return {};
  if (py::isinstance<py::dict>(views))
    return {"views", py::module_::import("json").attr("dumps")(views).cast<std::string>()};
  const auto name = views.cast<Text>();
  return value_of(page::read_views(name), name);
}

page::First first_of(const Text& state, const LookTuples& structures) {
  page::First first{state};
  for (const StructureLook& look : looks_of(structures)) first.structures.push_back(text_of(look));
  return first;
}

py::object export_field(const Text& field, const Text& output, const py::object& views,
                        const Text& state, const LookTuples& structures, py::object progress,
                        const py::kwargs& given) {
  page::ExportOptions options{.views = views_of(views), .first = first_of(state, structures)};
  Texts states;
  Text title, url;
  bool force = false;
  read(given, "states", states, "codec", options.repack.codec, "depth", options.repack.depth,
       "reveal", options.repack.reveal, "finest_level", options.repack.finest_level, "threads",
       options.repack.threads, "max_size", options.max_size, "title", title, "url", url, "force",
       force);
  options.states.assign(states.begin(), states.end());
  options.title = title;
  options.url = url;
  options.existing = force ? Existing::replace : Existing::keep;
  LongCall call(std::move(progress));
  return python_of(call.value(field, [&] {
    auto written = page::export_field(field, output, options, call.progress(), call.progress());
    if (!written && std::string_view(written.error().choice ? written.error().choice : "")
                        .starts_with("replace"))
      written.error().message += "; force=True overwrites it";
    return written;
  }));
}

py::bytes page_file(const std::string& name) {
  check_page();
  for (const page::PageFile& file : page::page_files())
    if (file.name == name) return {file.bytes.data(), file.bytes.size()};
  throw Failure({ErrorCode::usage, "the page has no file " + name}, "");
}

}  // namespace

void bind_views(py::module_& module) {
  py::class_<ViewServer>(module, "Server")
      .def(py::init([](const Text& field, const py::object& views, bool any_host, const Text& state,
                       const LookTuples& structures) {
        check_page();
        return std::make_unique<ViewServer>(
            std::vector<std::string>{field}, field,
            page::ServerOptions{.any_host = any_host,
                                .views = views_of(views),
                                .first = first_of(state, structures)});
      }))
      .def_property_readonly("url", [](const ViewServer& server) { return Text(server.url()); })
      .def("close", &ViewServer::close);
  bind_closing(
      py::class_<StudioServer>(module, "Studio"), &StudioServer::close,
      "Ends the server. What was not saved is kept as a draft. A second call does nothing.")
      .def(py::init([](const Recipe& recipe, const Text& output, const Text& save, unsigned threads,
                       bool any_host) {
        check_page();
        return std::make_unique<StudioServer>(
            recipe, page::StudioOptions{.output = output, .save = save, .threads = threads},
            any_host);
      }))
      .def_property_readonly("url", &StudioServer::url, "The address of the page.");
  module.def("export_field", export_field);
  module.def("page_file", page_file);
  module.def("texts_of", [](const LookTuples& looks) {
    const auto texts = first_of({}, looks).structures;
    return Texts(texts.begin(), texts.end());
  });
}

}  // namespace slf::python

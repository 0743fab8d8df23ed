// Fields in a browser: the server of ranges, and exported pages.
#include "calls.h"

#include <pybind11/stl.h>

#include <atomic>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "base/try.h"
#include "module.h"
#include "slf/field.h"
#include "view/page.h"
#include "view/server.h"
#include "view/site.h"

namespace slf::python {
namespace {

/// Serves fields on a thread of its own until it is closed.
class ViewServer {
 public:
  ViewServer(const Texts& fields, const view::ViewsFile& views, bool any_host)
      : server_(value_of(view::Server::make(std::vector<std::string>(fields.begin(), fields.end()),
                                            {.any_host = any_host, .views = views}),
                         fields.empty() ? Text() : fields.front())),
        thread_([this] { (void)server_.run([this] { return stop_.load(); }); }) {}
  ~ViewServer() { close(); }
  ViewServer(const ViewServer&) = delete;
  ViewServer& operator=(const ViewServer&) = delete;

  [[nodiscard]] const std::string& url() const { return server_.url(); }
  void close() {
    stop_ = true;
    const py::gil_scoped_release release;
    if (thread_.joinable()) thread_.join();
  }

 private:
  view::Server server_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

void check_page() {
  if (view::page_files().empty()) throw Failure({ErrorCode::unsupported, view::no_page()}, "");
}

/// Views as Python has them: a name for messages, and JSON, or none to read the file of that name.
view::ViewsFile views_of(const Text& name, const std::optional<Text>& json) {
  if (name.empty()) return {};
  return json ? view::ViewsFile{name, *json} : value_of(view::read_views(name), name);
}

void export_field(const Text& field, const Text& output, const Text& views,
                  const std::optional<Text>& json, bool force, py::object progress) {
  LongCall call(std::move(progress));
  const view::ViewsFile file = views_of(views, json);
  call.value(field, [&]() -> Result<void> {
    const auto opened = SLF_TRY(Field::open(field));
    const auto checked = SLF_TRY(view::parse_views(file, opened.shape().sphere));
    auto written = view::export_field(field, field, output, checked,
                                      force ? Existing::replace : Existing::keep, call.progress());
    if (!written && written.error().choice) written.error().message += "; force=True overwrites it";
    return written;
  });
}

}  // namespace

void bind_views(py::module_& module) {
  py::class_<ViewServer>(module, "Server")
      .def(py::init([](const Texts& fields, const Text& views, const std::optional<Text>& json,
                       bool any_host) {
        check_page();
        return std::make_unique<ViewServer>(fields, views_of(views, json), any_host);
      }))
      .def_property_readonly("url", [](const ViewServer& server) { return Text(server.url()); })
      .def("close", &ViewServer::close);
  module.def("export_field", export_field);
}

}  // namespace slf::python

// Fields in a browser: the server of ranges, and exported pages.
#include "calls.h"

#include <pybind11/stl.h>

#include <atomic>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "module.h"
#include "view/page.h"
#include "view/server.h"
#include "view/site.h"

namespace slf::python {
namespace {

/// Serves fields on a thread of its own until it is closed.
class ViewServer {
 public:
  explicit ViewServer(const Texts& fields)
      : server_(
            value_of(view::Server::make(std::vector<std::string>(fields.begin(), fields.end()), {}),
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

void export_field(const Text& field, const Text& output, bool force, py::object progress) {
  LongCall call(std::move(progress));
  call.value(field, [&] {
    auto written = view::export_field(field, field, output,
                                      force ? Existing::replace : Existing::keep, call.progress());
    if (!written && written.error().choice) written.error().message += "; force=True overwrites it";
    return written;
  });
}

}  // namespace

void bind_views(py::module_& module) {
  py::class_<ViewServer>(module, "Server")
      .def(py::init([](const Texts& fields) {
        check_page();
        return std::make_unique<ViewServer>(fields);
      }))
      .def_property_readonly("url", [](const ViewServer& server) { return Text(server.url()); })
      .def("close", &ViewServer::close);
  module.def("export_field", export_field);
}

}  // namespace slf::python

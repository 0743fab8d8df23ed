#include "calls.h"

#include <pthread.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <mutex>
#include <thread>

namespace slf::python {
namespace {

constexpr double kInterval = 0.1;  // seconds between calls of Python code

struct Calls {
  std::mutex mutex;
  std::condition_variable ended;
  int running = 0;
  std::atomic<bool> exiting{false};
  std::thread::id exiting_thread{};
};

Calls& calls() {
  static auto* const instance = new Calls;  // threads may outlive the module
  return *instance;
}

double now() {
  const auto since = std::chrono::steady_clock::now().time_since_epoch();
  return std::chrono::duration<double>(since).count();
}

/// Called at the interpreter's exit, when only daemon threads are left. Python ends a thread that
/// asks for the GIL after this by unwinding its stack, which C++ does not survive. Builds commit
/// what is finished.
void stop_calls() {
  const py::gil_scoped_release release;
  std::unique_lock lock(calls().mutex);
  calls().exiting_thread = std::this_thread::get_id();
  calls().exiting = true;
  calls().ended.wait(lock, [] { return calls().running == 0; });
}

/// Ends a daemon thread's part in a process that exits.
void stay_if_exiting(std::unique_lock<std::mutex>& lock) {
  if (!calls().exiting || calls().exiting_thread == std::this_thread::get_id()) return;
  lock.unlock();
  for (;;) pause();
}

void raise(const Failure& failure) {
  const py::object path =
      failure.path.empty() ? py::object(py::none()) : py::cast(Text(failure.path));
  const py::object exception =
      py::module_::import("slf._errors")
          .attr("error_of")(name(failure.code), Text(failure.what()), path);
  PyErr_SetObject(py::type::handle_of(exception).ptr(), exception.ptr());
}

}  // namespace

LongCall::Running::Running() {
  std::unique_lock lock(calls().mutex);
  stay_if_exiting(lock);
  ++calls().running;
}

LongCall::Running::~Running() {
  std::unique_lock lock(calls().mutex);
  --calls().running;
  calls().ended.notify_all();
  stay_if_exiting(lock);
}

bool LongCall::go_on(const Progress& progress) {
  if (calls().exiting || raised_) return false;
  const double time = now();
  const bool last = progress.done == progress.total;
  if (!last && time - last_ < kInterval) return true;
  last_ = time;
  const py::gil_scoped_acquire acquire;
  try {
    if (PyErr_CheckSignals() != 0) throw py::error_already_set();
    if (callback_.is_none()) return true;
    const py::object answer = callback_(progress.done, progress.total, progress.skipped);
    if (!answer.is(py::bool_(false))) return true;
  } catch (py::error_already_set& error) {
    raised_.emplace(std::move(error));
  } catch (const std::exception& error) {  // none may pass the C code that calls this
    PyErr_SetString(PyExc_RuntimeError, error.what());
    raised_.emplace();
  }
  return false;
}

void bind_calls(py::module_& module) {
  py::register_exception_translator([](std::exception_ptr thrown) {
    try {
      std::rethrow_exception(std::move(thrown));
    } catch (const Failure& failure) {
      raise(failure);
    }
  });
  // The calls of other threads do not go on in a forked process.
  pthread_atfork(nullptr, nullptr, [] { new (&calls()) Calls; });
  module.def("stop_calls", stop_calls, "Stops long calls of all threads, and waits for their end.");
}

}  // namespace slf::python

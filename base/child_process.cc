#include "base/child_process.h"

#include <fcntl.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <fstream>

namespace slf {
namespace {

void reset_signal_handlers() {
  for (const int signal : {SIGABRT, SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGINT, SIGTERM, SIGHUP,
                           SIGPIPE, SIGXCPU, SIGCHLD})
    ::signal(signal, SIG_DFL);
}

bool silence() {
  const int nowhere = ::open("/dev/null", O_RDWR);
  if (nowhere < 0) return false;
  for (const int standard : {0, 1, 2})
    if (::dup2(nowhere, standard) < 0) return false;
  return true;
}

bool set_limits(std::uint64_t bytes, std::uint64_t seconds) {
  std::uint64_t pages = 0;
  if (!(std::ifstream("/proc/self/statm") >> pages)) return false;
  const auto page = static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE));
  const auto limit = [](auto resource, std::uint64_t max) {
    rlimit now{};
    if (::getrlimit(resource, &now) != 0) return false;
    now.rlim_max = std::min<rlim_t>(now.rlim_max, max);  // it cannot be raised again
    now.rlim_cur = now.rlim_max;
    return ::setrlimit(resource, &now) == 0;
  };
  return limit(RLIMIT_CORE, 0) && limit(RLIMIT_FSIZE, 0) && limit(RLIMIT_NPROC, 0) &&
         limit(RLIMIT_CPU, seconds) && limit(RLIMIT_AS, pages * page + bytes);
}

}  // namespace

void confine_child(std::uint64_t bytes, std::uint64_t seconds) {
  reset_signal_handlers();
  if (!silence() || !set_limits(bytes, seconds)) ::_exit(kNotConfined);
}

tl::unexpected<Error> not_confined(const std::string& path) {
  return fail(ErrorCode::failed, path,
              ": a file of this kind is read only by a process whose memory and time are limited, "
              "and the system refuses the limits: mount /proc, and see that /dev/null opens");
}

}  // namespace slf

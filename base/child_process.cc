#include "base/child_process.h"

#include <fcntl.h>
#include <linux/audit.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <csignal>
#include <cstddef>
#include <fstream>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

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

/// Maps of files, and memory that other processes have, too: the parent's output may be among them.
bool drop_shared_memory() {
  std::ifstream maps("/proc/self/maps");
  std::vector<std::pair<std::uintptr_t, std::uintptr_t>> shared;
  for (std::string line; std::getline(maps, line);) {  // BEGIN-END rwxs ...
    std::uintptr_t begin = 0, end = 0;
    const auto [dash, _] = std::from_chars(line.data(), line.data() + line.size(), begin, 16);
    const auto [at, error] = std::from_chars(dash + 1, line.data() + line.size(), end, 16);
    if (error == std::errc() && std::string_view(at).substr(4, 1) == "s")
      shared.emplace_back(begin, end);
  }
  for (const auto& [begin, end] : shared)  // nothing else gets these addresses
    // NOLINTNEXTLINE(performance-no-int-to-ptr): the kernel names them so
    if (::mmap(reinterpret_cast<void*>(begin), end - begin, PROT_NONE,
               MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE | MAP_FIXED, -1, 0) == MAP_FAILED)
      return false;
  return maps.eof();
}

/// What an argument of a system call must be: (argument & mask) == value, of its low 32 bits.
struct Check {
  std::uint32_t argument, mask, value;
};
struct Allowed {
  std::uint32_t call;
  std::vector<Check> checks{};
};

#if defined(__x86_64__) || defined(__aarch64__)
#ifdef __x86_64__
constexpr std::uint32_t kProcessor = AUDIT_ARCH_X86_64;
#else
constexpr std::uint32_t kProcessor = AUDIT_ARCH_AARCH64;
#endif

/// Has the kernel refuse all system calls but those of memory, of ending, and of writing to `to`.
/// True without doing so where it cannot.
bool refuse_system_calls(int to) {
  const auto fd = static_cast<std::uint32_t>(to);
  const Check not_executable{2, PROT_EXEC, 0};
  const Allowed all[] = {
      {SYS_write, {{0, ~0u, fd}}},
      {SYS_mmap, {not_executable, {3, MAP_ANONYMOUS, MAP_ANONYMOUS}}},
      {SYS_mprotect, {not_executable}},
      {SYS_munmap},
      {SYS_mremap},
      {SYS_brk},
      {SYS_madvise},
      {SYS_futex},
      {SYS_clock_gettime},
      {SYS_getpid},
      {SYS_gettid},
      {SYS_rt_sigprocmask},
      {SYS_rt_sigreturn},
      {SYS_sigaltstack},  // which sanitizers ask about at exceptions
      {SYS_exit},
      {SYS_exit_group},
  };
  std::vector<sock_filter> program;
  const auto load = [&](std::size_t offset) {
    program.push_back(BPF_STMT(BPF_LD | BPF_W | BPF_ABS, static_cast<std::uint32_t>(offset)));
  };
  const auto skip_unless = [&](std::uint32_t value, std::size_t instructions) {
    program.push_back(
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, value, 0, static_cast<std::uint8_t>(instructions)));
  };
  const auto end = [&](std::uint32_t with) { program.push_back(BPF_STMT(BPF_RET | BPF_K, with)); };
  constexpr std::uint32_t kRefuse = SECCOMP_RET_ERRNO | EPERM;
  load(offsetof(seccomp_data, arch));
  program.push_back(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, kProcessor, 1, 0));
  end(kRefuse);
  load(offsetof(seccomp_data, nr));
  for (const Allowed& one : all) {
    std::size_t left = 3 * one.checks.size() + 2;  // instructions of this call
    skip_unless(one.call, left);
    for (const Check& check : one.checks) {
      load(offsetof(seccomp_data, args) + 8 * check.argument);  // little-endian
      program.push_back(BPF_STMT(BPF_ALU | BPF_AND | BPF_K, check.mask));
      left -= 3;
      skip_unless(check.value, left - 1);
    }
    end(SECCOMP_RET_ALLOW);
    end(kRefuse);
  }
  end(kRefuse);
  const sock_fprog filter{static_cast<unsigned short>(program.size()), program.data()};
  return ::prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0 &&
         (::prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &filter) == 0 || errno == EINVAL ||
          errno == ENOSYS);
}
#else
bool refuse_system_calls(int) { return true; }
#endif

}  // namespace

void confine_child(std::uint64_t bytes, std::uint64_t seconds, int to) {
  reset_signal_handlers();
  if (!silence() || !set_limits(bytes, seconds) || !drop_shared_memory() ||
      !refuse_system_calls(to))
    ::_exit(kNotConfined);
}

tl::unexpected<Error> not_confined(const std::string& path) {
  return fail(ErrorCode::failed, path,
              ": a file of this kind is read only by a process whose memory and time are limited, "
              "and the system refuses the limits: mount /proc, and see that /dev/null opens");
}

}  // namespace slf

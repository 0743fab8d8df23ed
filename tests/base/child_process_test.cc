#include "base/child_process.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/mman.h>
#include <sys/ptrace.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <fstream>
#include <functional>
#include <map>
#include <new>
#include <string>
#include <vector>

#include "tests/sanitized.h"
#include "tests/temporary_folder.h"

namespace slf {
namespace {

/// What a hostile child, confined, sends before it ends, and its status.
std::pair<std::string, int> in_child(const std::function<std::string()>& hostile) {
  std::array<int, 2> ends{};
  EXPECT_EQ(::pipe(ends.data()), 0);
  const pid_t child = ::fork();
  if (child == 0) {
    confine_child(std::uint64_t{1} << 30, 10, ends[1]);
    const std::string said = hostile();
    ::_exit(::write(ends[1], said.data(), said.size()) == static_cast<ssize_t>(said.size()) ? 0
                                                                                            : 1);
  }
  ::close(ends[1]);
  std::string said(4096, '\0');
  said.resize(static_cast<std::size_t>(std::max<ssize_t>(0, ::read(ends[0], &said[0], 4096))));
  ::close(ends[0]);
  int status = 0;
  EXPECT_EQ(::waitpid(child, &status, 0), child);
  return {said, status};
}

class ChildProcess : public ::testing::Test {
 protected:
  void SetUp() override {
    if (testing::kSanitized)
      GTEST_SKIP() << "a sanitizer catches signals, and has more memory than the child may have";
  }
  ChildProcess() {
    std::ofstream(path_) << "precious";
    open_ = ::open(path_.c_str(), O_RDWR);
    map_ = static_cast<char*>(::mmap(nullptr, 8, PROT_READ | PROT_WRITE, MAP_SHARED, open_, 0));
  }
  ~ChildProcess() override {
    ::munmap(map_, 8);
    ::close(open_);
  }
  /// The file that a hostile child is after.
  std::string content() const {
    std::string text;
    std::ifstream(path_) >> text;
    return text;
  }

  testing::TemporaryFolder folder_;
  std::string path_ = folder_ / "file";
  int open_ = -1;
  char* map_ = nullptr;
};

TEST_F(ChildProcess, MayNeitherTouchFilesNorProcesses) {
  static char secret[] = "parent";
  const pid_t parent = ::getpid();
  iovec own{secret, 6}, theirs{secret, 6};
  const std::string memory = "/proc/" + std::to_string(parent) + "/mem", other = folder_ / "new";
  const char* path = path_.c_str();
  const std::map<std::string, std::function<long()>> attacks{
      {"open to read", [&] { return ::open(path, O_RDONLY); }},
      {"open to write", [&] { return ::open(path, O_WRONLY); }},
      {"create", [&] { return ::open(other.c_str(), O_CREAT | O_WRONLY, 0600); }},
      {"openat2", [&] { return ::syscall(SYS_openat2, AT_FDCWD, path, nullptr, 0); }},
      {"truncate", [&] { return ::truncate(path, 0); }},
      {"ftruncate", [&] { return ::ftruncate(open_, 0); }},
      {"write to what is open", [&] { return ::write(open_, "hostile", 7); }},
      {"pwrite", [&] { return ::pwrite(open_, "hostile", 7, 0); }},
      {"read", [&] { return ::pread(open_, secret, 1, 0); }},
      {"unlink", [&] { return ::unlink(path); }},
      {"rename", [&] { return ::rename(path, other.c_str()); }},
      {"map a file",
       [&] {
         void* map = ::mmap(nullptr, 8, PROT_READ | PROT_WRITE, MAP_SHARED, open_, 0);
         return map == MAP_FAILED ? -1L : 0L;
       }},
      {"make code",
       [&] {
         void* map = ::mmap(nullptr, 8, PROT_READ | PROT_EXEC, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
         return map == MAP_FAILED ? -1L : 0L;
       }},
      {"ptrace", [&] { return ::ptrace(PTRACE_ATTACH, parent, nullptr, nullptr); }},
      {"process_vm_writev", [&] { return ::process_vm_writev(parent, &own, 1, &theirs, 1, 0); }},
      {"process_vm_readv", [&] { return ::process_vm_readv(parent, &own, 1, &theirs, 1, 0); }},
      {"the parent's memory", [&] { return ::open(memory.c_str(), O_RDWR); }},
      {"kill", [&] { return ::kill(parent, 0); }},
      {"clone", [&] { return ::syscall(SYS_clone, SIGCHLD, nullptr, nullptr, nullptr, nullptr); }},
      {"execve", [&] { return ::execl("/bin/true", "true", static_cast<char*>(nullptr)); }},
      {"socket", [&] { return ::socket(AF_INET, SOCK_STREAM, 0); }},
      {"io_uring", [&] { return ::syscall(SYS_io_uring_setup, 1, nullptr); }},
      {"chdir", [&] { return ::chdir("/"); }},
  };
  const auto [said, status] = in_child([&] {
    std::string worked;
    for (const auto& [name, attack] : attacks)
      if (errno = 0; attack() != -1 || errno != EPERM)
        worked += name + " (" + std::to_string(errno) + "); ";
    return worked.empty() ? std::string("all refused") : worked;
  });
  EXPECT_EQ(said, "all refused");
  EXPECT_EQ(status, 0);
  EXPECT_EQ(content(), "precious");
  EXPECT_STREQ(secret, "parent");
}

TEST_F(ChildProcess, LosesMapsOfFilesThatTheParentWrites) {
  const auto [said, status] = in_child([&] {
    std::memcpy(map_, "hostile!", 8);
    return std::string("written");
  });
  EXPECT_EQ(said, "");
  EXPECT_TRUE(WIFSIGNALED(status));
  EXPECT_EQ(std::string(map_, 8), "precious");
  EXPECT_EQ(content(), "precious");
}

TEST_F(ChildProcess, StillComputes) {
  const auto [said, status] = in_child([&] {
    std::vector<std::string> large;
    for (std::size_t size = 1; size < 1 << 26; size *= 2) large.emplace_back(size, 'a');
    try {
      throw std::bad_alloc();
    } catch (const std::exception&) {
      return std::string("caught");
    }
  });
  EXPECT_EQ(said, "caught");
  EXPECT_EQ(status, 0);
}

}  // namespace
}  // namespace slf

#include "storage/internal/mapped_file.h"

#include <signal.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <mutex>
#include <string>

#include "base/file.h"

namespace slf::storage::internal {
namespace {

std::atomic<MapSlot*> all_slots{nullptr};
struct sigaction previous_action;
std::uintptr_t system_page = 4096;

MapSlot* slot_of(std::uintptr_t address) {
  for (MapSlot* slot = all_slots.load(std::memory_order_acquire); slot != nullptr;
       slot = slot->next) {
    const std::uintptr_t end = slot->end.load(std::memory_order_acquire);
    if (address < end && address >= slot->begin.load(std::memory_order_acquire)) return slot;
  }
  return nullptr;
}

bool is_armed();
void arm();

void call_previous(int signal, siginfo_t* info, void* context) {
  const struct sigaction previous = previous_action;
  const bool sent = info->si_code <= 0;  // by a process, not by an access
  const bool armed = is_armed();         // else a later handler has called ours
  if ((previous.sa_flags & SA_SIGINFO) != 0) {
    previous.sa_sigaction(signal, info, context);
  } else if (previous.sa_handler == SIG_DFL || (previous.sa_handler == SIG_IGN && !sent)) {
    ::signal(signal, SIG_DFL);
    ::raise(signal);  // ends the process on return
    return;
  } else if (previous.sa_handler != SIG_IGN) {
    previous.sa_handler(signal);
  }
  if (armed) arm();  // again, if the previous handler has installed another one
}

// Runs in a signal handler: atomics and system calls only.
void on_bus_error(int signal, siginfo_t* info, void* context) {
  const int saved_errno = errno;
  const auto address = reinterpret_cast<std::uintptr_t>(info->si_addr);
  MapSlot* slot = slot_of(address);
  if (slot != nullptr) {
    // NOLINTNEXTLINE(performance-no-int-to-ptr)
    void* page = reinterpret_cast<void*>(address & ~(system_page - 1));
    if (mmap(page, system_page, PROT_READ, MAP_PRIVATE | MAP_ANONYMOUS | MAP_FIXED, -1, 0) !=
        MAP_FAILED) {
      slot->changed.store(true, std::memory_order_release);
      errno = saved_errno;
      return;
    }
  }
  call_previous(signal, info, context);
  errno = saved_errno;
}

bool is_armed() {
  struct sigaction now = {};
  sigaction(SIGBUS, nullptr, &now);
  return (now.sa_flags & SA_SIGINFO) != 0 && now.sa_sigaction == on_bus_error;
}

// Installs the handler unless it is installed.
void arm() {
  if (is_armed()) return;
  struct sigaction action = {};
  action.sa_sigaction = on_bus_error;
  action.sa_flags = SA_SIGINFO | SA_ONSTACK;
  sigemptyset(&action.sa_mask);
  sigaction(SIGBUS, &action, &previous_action);
}

void install_handler() {
  static std::once_flag once;
  std::call_once(once, [] {
    system_page = static_cast<std::uintptr_t>(sysconf(_SC_PAGESIZE));
    arm();
  });
}

MapSlot* take_slot() {
  for (MapSlot* slot = all_slots.load(); slot != nullptr; slot = slot->next) {
    bool expected = false;
    if (slot->used.compare_exchange_strong(expected, true)) return slot;
  }
  auto* slot = new MapSlot;  // never freed: the handler may be reading it
  slot->used = true;
  slot->next = all_slots.load();
  while (!all_slots.compare_exchange_weak(slot->next, slot)) {
  }
  return slot;
}

}  // namespace

GuardedRange::GuardedRange(ByteSpan mapped) {
  install_handler();
  slot_.reset(take_slot());
  slot_->changed = false;
  slot_->begin = reinterpret_cast<std::uintptr_t>(mapped.data());
  slot_->end = reinterpret_cast<std::uintptr_t>(mapped.data()) + mapped.size();
}

void GuardedRange::Release::operator()(MapSlot* slot) const {
  slot->end = 0;
  slot->used = false;
}

Result<MappedFile> MappedFile::map(int file, std::size_t bytes, const std::string& path) {
  void* base = mmap(nullptr, bytes, PROT_READ, MAP_SHARED, file, 0);
  if (base == MAP_FAILED) return io_error(path, "cannot map " + std::to_string(bytes) + " bytes");
  (void)madvise(base, bytes, MADV_RANDOM);
  MappedFile result;
  result.file_ = file;
  result.map_ = {static_cast<std::byte*>(base), Unmap{bytes}};
  result.guard_ = GuardedRange(result.bytes());
  return result;
}

Result<void> MappedFile::unchanged(const std::string& path) const {
  if (!guard_.changed()) return {};
  struct stat status = {};
  if (fstat(file_, &status) != 0 || static_cast<std::size_t>(status.st_size) >= bytes().size())
    return fail(ErrorCode::io, path, ": ", kUnreadablePage);
  return bad_file(path, "changed while open: it has become shorter");
}

void MappedFile::Unmap::operator()(std::byte* map) const { munmap(map, bytes); }

}  // namespace slf::storage::internal

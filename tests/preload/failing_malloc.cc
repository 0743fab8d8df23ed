// For LD_PRELOAD: the allocation with the number SLF_TEST_FAILING, from 0, of the process fails,
// and all later ones, too, with SLF_TEST_ALL_LATER. Then the file SLF_TEST_FAILED comes to be.
#include <fcntl.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstdlib>
#include <cstring>

extern "C" {
void* __libc_malloc(size_t);
void* __libc_calloc(size_t, size_t);
void* __libc_realloc(void*, size_t);
void* __libc_memalign(size_t, size_t);
}

namespace {

std::atomic<long> left{-1};
std::atomic<bool> begun{false};
bool later = false;
const char* mark = nullptr;

/// Takes no memory, unlike the loader that may ask for it first.
const char* variable(const char* name) {
  const size_t length = std::strlen(name);
  for (char** each = environ; each && *each; ++each)
    if (std::strncmp(*each, name, length) == 0 && (*each)[length] == '=') return *each + length + 1;
  return nullptr;
}

bool fails() {
  if (!environ) return false;
  if (!begun.exchange(true)) {
    const char* const at = variable("SLF_TEST_FAILING");
    later = variable("SLF_TEST_ALL_LATER") != nullptr;
    mark = variable("SLF_TEST_FAILED");
    left = at ? std::atol(at) : 1L << 60;
  }
  const long mine = left.fetch_sub(1);
  if (mine > 0 || (mine < 0 && !later)) return false;
  if (mine == 0 && mark) close(open(mark, O_CREAT | O_WRONLY, 0600));
  errno = ENOMEM;
  return true;
}

}  // namespace

extern "C" {

void* malloc(size_t bytes) { return fails() ? nullptr : __libc_malloc(bytes); }
void* calloc(size_t count, size_t bytes) { return fails() ? nullptr : __libc_calloc(count, bytes); }
void* realloc(void* block, size_t bytes) {
  return fails() ? nullptr : __libc_realloc(block, bytes);
}
void* memalign(size_t alignment, size_t bytes) {
  return fails() ? nullptr : __libc_memalign(alignment, bytes);
}
void* aligned_alloc(size_t alignment, size_t bytes) { return memalign(alignment, bytes); }
int posix_memalign(void** block, size_t alignment, size_t bytes) {
  void* const made = memalign(alignment, bytes);
  if (!made) return ENOMEM;
  *block = made;
  return 0;
}

}  // extern "C"

#include "benchmarks/storage/page_cache.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <filesystem>
#include <vector>

#include "benchmarks/storage/expect.h"

namespace slf::bench {
namespace {

namespace fs = std::filesystem;

std::vector<std::string> files_of(const std::string& path) {
  std::vector<std::string> files;
  const fs::path base(path);
  for (const auto& entry : fs::directory_iterator(base.parent_path())) {
    const std::string name = entry.path().filename().string();
    const std::string own = base.filename().string();
    if (name != own && !name.starts_with(own + ".")) continue;
    if (!entry.is_directory()) {
      files.push_back(entry.path().string());
      continue;
    }
    for (const auto& inner : fs::directory_iterator(entry.path()))
      if (inner.is_regular_file()) files.push_back(inner.path().string());
  }
  return files;
}

std::uint64_t cached_pages_of(int file, std::size_t bytes) {
  if (bytes == 0) return 0;
  void* map = mmap(nullptr, bytes, PROT_READ, MAP_SHARED, file, 0);
  require(map != MAP_FAILED, "cannot map a file to count its pages");
  const auto page = static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
  std::vector<unsigned char> resident((bytes + page - 1) / page);
  require(mincore(map, bytes, resident.data()) == 0, "mincore failed");
  munmap(map, bytes);
  std::uint64_t count = 0;
  for (const unsigned char flag : resident) count += flag & 1;
  return count;
}

// Calls use(descriptor, bytes) for each file, and returns the sum of its results.
template <class Use>
std::uint64_t sum_over(const std::string& path, Use use) {
  std::uint64_t sum = 0;
  for (const std::string& name : files_of(path)) {
    const int file = ::open(name.c_str(), O_RDONLY | O_CLOEXEC);
    require(file >= 0, name + ": cannot open");
    sum += use(file, static_cast<std::size_t>(fs::file_size(name)));
    ::close(file);
  }
  return sum;
}

}  // namespace

std::uint64_t drop_from_cache(const std::string& path) {
  return sum_over(path, [](int file, std::size_t bytes) {
    require(fsync(file) == 0, "fsync failed");
    (void)posix_fadvise(file, 0, 0, POSIX_FADV_DONTNEED);
    return cached_pages_of(file, bytes);
  });
}

std::uint64_t cached_pages(const std::string& path) { return sum_over(path, cached_pages_of); }

std::uint64_t disk_bytes(const std::string& path) {
  return sum_over(path, [](int, std::size_t bytes) { return bytes; });
}

void remove_files(const std::string& path) {
  for (const std::string& name : files_of(path)) fs::remove(name);
  fs::remove_all(path);
}

}  // namespace slf::bench

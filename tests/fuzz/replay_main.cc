// Replays a fuzz target's corpus as an ordinary test: every file as it is, truncated, and with bits
// flipped. Deterministic; the target aborts where it finds a fault.
//   NAME_replay FOLDER
#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <string>
#include <vector>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

namespace {

using Input = std::vector<std::uint8_t>;

// A copy of exactly the input's size, so that the address sanitizer sees a read past its end.
void run(const Input& input) {
  const Input exact(input.begin(), input.end());
  LLVMFuzzerTestOneInput(exact.data(), exact.size());
}

void run_around(const Input& seed) {
  run(seed);
  constexpr std::size_t kCuts = 64, kFlips = 64;
  const std::size_t step = std::max<std::size_t>(1, seed.size() / kCuts);
  for (std::size_t length = 0; length < seed.size(); length += step)
    run(Input(seed.begin(), seed.begin() + static_cast<std::ptrdiff_t>(length)));
  std::mt19937 random(static_cast<std::uint32_t>(seed.size()));
  for (std::size_t i = 0; i < kFlips && !seed.empty(); ++i) {
    Input flipped = seed;
    // Most of what matters is near the front: headers.
    const std::size_t range = i % 2 ? seed.size() : std::min<std::size_t>(seed.size(), 400);
    flipped[random() % range] ^= static_cast<std::uint8_t>(1u << random() % 8);
    run(flipped);
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) return 1;
  std::vector<std::filesystem::path> files;
  std::error_code code;
  for (const auto& entry : std::filesystem::directory_iterator(argv[1], code))
    if (entry.is_regular_file()) files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  for (const auto& path : files) {
    std::printf("%s\n", path.filename().c_str());
    std::fflush(stdout);
    std::ifstream file(path, std::ios::binary);
    run_around(Input(std::istreambuf_iterator<char>(file), {}));
  }
  if (files.empty()) std::fprintf(stderr, "no corpus in %s\n", argv[1]);
  return files.empty() ? 1 : 0;
}

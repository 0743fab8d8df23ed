// Compares stores of tiles in one run. The ratios are meaningful; absolute numbers depend on the
// machine.
//
//   storage_peers FIELD.slf --slf SLF [--folder DIR] [--only reads|writes|opens|memory]...
//
//   reads    random get, and get + decode, hot and cold, 1 and 8 threads; the tiles of the field's
//            finest level and synthetic ones of 4, 24 and 64 KiB
//   writes   building and repacking against encoding alone
//   opens    opening stores of 1 k, 32 k and 1 M tiles
//   memory   peak anonymous memory of `slf repack` in a budget
//
// Hot: all tiles are in the page cache or the store's own cache; speeds are per processor second.
// Cold: fsync and POSIX_FADV_DONTNEED have dropped all pages of the files ("pages not cold" counts
// those that mincore still finds). Tiles are read once, at random; stores that accept hints get
// them 16 tiles ahead; speeds are by the wall clock. A virtual machine's host may still cache the
// disk. Stores alternate every 128 tiles (512 with 8 threads); when cold, the file is dropped
// before each turn. "ours/it" is the median over the turns of the ratio of speeds. "read KiB/tile"
// is the amount that the kernel fetched, including readahead.
#include <CLI/CLI.hpp>
#include <filesystem>

#include "benchmarks/storage/expect.h"
#include "benchmarks/storage/scenarios.h"
#include "benchmarks/storage/store_peer.h"

int main(int argc, char** argv) {
  using namespace slf::bench;
  constexpr std::size_t kAll = ~std::size_t{0};
  Settings settings;
  settings.folder = std::filesystem::temp_directory_path().string();
  std::string json;
  std::vector<std::string> only{"reads", "writes", "opens", "memory"};
  CLI::App app{"Stores of tiles against their peers"};
  app.add_option("field", settings.field, "A field with jpeg colour")->required();
  app.add_option("--slf", settings.slf, "The slf command, for repack's memory");
  app.add_option("--folder", settings.folder, "Where to put the stores")
      ->check(CLI::ExistingDirectory)
      ->capture_default_str();
  app.add_option("--only", only, "What to measure")
      ->check(CLI::IsMember({"reads", "writes", "opens", "memory"}));
  app.add_option("--rounds", settings.rounds, "The best of these counts")->capture_default_str();
  app.add_option("--mb", settings.megabytes, "Payloads of each set that is read, in MB")
      ->capture_default_str();
  app.add_option("--reads", settings.reads, "Tiles read at random of each set")
      ->capture_default_str();
  app.add_option("--json", json, "Also write the report to this file");
  CLI11_PARSE(app, argc, argv);
  const auto wanted = [&](const char* what) {
    return std::find(only.begin(), only.end(), what) != only.end();
  };

  settings.folder += "/slf-storage-peers";
  std::filesystem::create_directories(settings.folder);
  Report report(settings.folder);
  for (const std::string& name : missing_peers())
    report.note(name + " is left out: its library was not there when this was built");
  if (wanted("reads")) {
    const std::size_t bytes = settings.megabytes * 1'000'000;
    measure_reads(settings, repeated(tiles_of_field(settings.field, kAll), bytes), report);
    for (const std::size_t kib : {4, 24, 64})
      measure_reads(settings, synthetic_tiles(kib << 10, bytes / (kib << 10)), report);
  }
  if (wanted("writes")) measure_writes(settings, report);
  if (wanted("opens")) measure_opens(settings, report);
  if (wanted("memory")) measure_memory(settings, report);
  std::filesystem::remove_all(settings.folder);
  if (!json.empty()) report.save(json);
  return 0;
}

// Disk: what a power cut may leave of a folder, after some calls.
//
// What is not synced is lost, or not, in any combination: each sector of 512 bytes of each write,
// each change of a file's length, each change of a name. A rename is one change. A sync of a file
// keeps its content and length, and a sync of the folder keeps all names; a file without a name is
// lost.
#pragma once

#include <functional>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "tests/power/calls.h"

namespace slf::testing {

class Disk {
 public:
  static constexpr std::size_t kSector = 512;

  void make(const Call& call);

  /// What of the changes that are not synced is kept.
  struct Luck {
    std::function<bool()> data, names;
  };
  using Image = std::map<std::string, Bytes>;
  [[nodiscard]] Image image(const Luck& luck) const;
  /// The folder as programs see it, while there is power.
  [[nodiscard]] Image now() const {
    return image({[] { return true; }, [] { return true; }});
  }

  /// The last transaction of LMDB that a file has kept for good; by the name that the file has now.
  [[nodiscard]] std::map<std::string, std::uint64_t> promised() const;

 private:
  struct File {
    Bytes kept{};
    std::vector<Call> pending{};
    std::uint64_t transaction = 0;
  };
  std::vector<File> files_;
  std::map<std::string, int> kept_names_;
  std::vector<Call> pending_names_;
};

}  // namespace slf::testing

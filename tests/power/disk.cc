#include "tests/power/disk.h"

#include <algorithm>

namespace slf::testing {
namespace {

using Kind = Call::Kind;
using Names = std::map<std::string, int>;

void change(const Call& call, const std::function<bool()>& keeps, Bytes& content) {
  if (call.kind == Kind::truncate) {
    if (keeps()) content.resize(call.at);
    return;
  }
  const std::uint64_t end = call.at + call.bytes.size();
  for (std::uint64_t from = call.at; from < end;) {
    const std::uint64_t to = std::min(end, (from / Disk::kSector + 1) * Disk::kSector);
    if (keeps()) {
      if (content.size() < to) content.resize(to);
      std::copy_n(call.bytes.begin() + static_cast<std::ptrdiff_t>(from - call.at), to - from,
                  content.begin() + static_cast<std::ptrdiff_t>(from));
    }
    from = to;
  }
}

void change(const Call& call, Names& names) {
  if (call.kind == Kind::link) {
    names[call.name] = call.file;
  } else if (call.kind == Kind::unlink) {
    names.erase(call.name);
  } else if (const auto from = names.find(call.from); from != names.end()) {
    const int file = from->second;
    names.erase(from);
    names[call.name] = file;
  }
}

bool always() { return true; }

}  // namespace

void Disk::make(const Call& call) {
  switch (call.kind) {
    case Kind::create:
      files_.emplace_back();
      break;
    case Kind::write:
    case Kind::truncate: {
      File& file = files_[static_cast<std::size_t>(call.file)];
      file.pending.push_back(call);
      if (!call.durable) break;
      // With the write, what came before in the same sectors is kept, and what these need of the
      // file's length.
      const auto overlaps = [&](const Call& other) {
        return other.kind == Kind::write && other.at < call.at + call.bytes.size() &&
               call.at < other.at + other.bytes.size();
      };
      for (const Call& other : file.pending)
        if (overlaps(other)) change(other, always, file.kept);
      std::erase_if(file.pending, overlaps);
      // A meta page of LMDB.
      if (call.at < 2 * 4096 && call.bytes.size() >= 8)
        file.transaction =
            std::max(file.transaction,
                     load_le<std::uint64_t>(file.kept.data() + 144 + call.at / 4096 * 4096));
      break;
    }
    case Kind::sync: {
      File& file = files_[static_cast<std::size_t>(call.file)];
      for (const Call& pending : file.pending) change(pending, always, file.kept);
      file.pending.clear();
      break;
    }
    case Kind::link:
    case Kind::unlink:
    case Kind::rename:
      pending_names_.push_back(call);
      break;
    case Kind::sync_folder:
      for (const Call& pending : pending_names_) change(pending, kept_names_);
      pending_names_.clear();
      break;
    case Kind::done:
      break;
  }
}

Disk::Image Disk::image(const Luck& luck) const {
  Names names = kept_names_;
  for (const Call& pending : pending_names_)
    if (luck.names()) change(pending, names);
  Image image;
  for (const auto& [name, number] : names) {
    const File& file = files_[static_cast<std::size_t>(number)];
    Bytes& content = image[name] = file.kept;
    for (const Call& pending : file.pending) change(pending, luck.data, content);
  }
  return image;
}

std::map<std::string, std::uint64_t> Disk::promised() const {
  Names names = kept_names_;
  for (const Call& pending : pending_names_) change(pending, names);
  std::map<std::string, std::uint64_t> promised;
  for (const auto& [name, number] : names)
    promised[name] = files_[static_cast<std::size_t>(number)].transaction;
  return promised;
}

}  // namespace slf::testing

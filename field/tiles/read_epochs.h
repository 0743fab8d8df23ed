// ReadEpochs: tells when memory that was removed from a shared table can be freed, although threads
// look it up without a lock (epoch-based reclamation).
#pragma once

#include <atomic>
#include <cstdint>
#include <deque>
#include <mutex>

namespace slf {

/// Thread-safety: any thread.
class ReadEpochs {
  struct alignas(64) Slot {
    std::atomic<std::uint64_t> epoch{0};  // when its Scope began; 0: in none
    bool taken = false;
  };

 public:
  /// Registers a thread that looks things up. Made once, used for many Scopes, one at a time. Must
  /// not outlive the ReadEpochs.
  class Reader {
   public:
    explicit Reader(ReadEpochs& epochs);
    ~Reader();
    Reader(const Reader&) = delete;
    Reader& operator=(const Reader&) = delete;

   private:
    friend class ReadEpochs;
    ReadEpochs& epochs_;
    Slot* slot_;
  };

  /// During its lifetime, what was found in it stays valid. Keep it short.
  class Scope {
   public:
    explicit Scope(Reader& reader);
    ~Scope() { slot_.epoch.store(0, std::memory_order_release); }
    Scope(const Scope&) = delete;
    Scope& operator=(const Scope&) = delete;

   private:
    Slot& slot_;
  };

  /// Call after a removal: its number.
  [[nodiscard]] std::uint64_t end() { return 1 + epoch_.fetch_add(1, std::memory_order_seq_cst); }
  /// Removals up to this number are of things that no Scope can have found.
  [[nodiscard]] std::uint64_t freed() const;

 private:
  std::atomic<std::uint64_t> epoch_{1};  // removals so far
  mutable std::mutex mutex_;             // guards what follows
  std::deque<Slot> readers_;
};

}  // namespace slf

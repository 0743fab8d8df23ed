// fork() beside threads. A child has the memory of its parent, but only the thread that forked.
// What other threads had locked or half changed stays so there.
#pragma once

namespace slf {

/// While one lives, its thread works with what threads share, and fork() waits for it, at most a
/// second. Take it before locks. Other work does not begin meanwhile, unless it is `inner`: then it
/// may be part of work that another thread waits for.
class AtWork {
 public:
  enum class Kind { outer, inner };
  explicit AtWork(Kind kind = Kind::outer);
  ~AtWork();
  AtWork(const AtWork&) = delete;
  AtWork& operator=(const AtWork&) = delete;
};

/// How many of the forks that led to this process did not find all threads idle. What was made
/// before the last of these may be locked for ever: let it be, its destructor too.
[[nodiscard]] unsigned torn_forks();

}  // namespace slf

#include "base/fork.h"

#include <pthread.h>
#include <unistd.h>

#include <atomic>

namespace slf {
namespace {

constexpr unsigned kPause = 500;  // microseconds

std::atomic<unsigned> at_work{0}, forking{0}, torn{0};
thread_local unsigned own = 0;   // of `at_work`
thread_local bool alone = true;  // no other thread was at work when this one forked

// Once `at_work` was `own`, it exceeds it only for moments: who begins sees `forking` and waits.
// So it is looked at here, not in the child, whose copy may be of such a moment.
void begin_fork() {
  ++forking;
  for (unsigned waited = 0; !(alone = at_work <= own) && waited < 1000000; waited += kPause)
    usleep(kPause);
}

void end_in_parent() { --forking; }

void end_in_child() {
  if (!alone || own > 0) ++torn;  // its own work has threads, too
  at_work = own;
  forking = 0;
}

[[maybe_unused]] const int registered = pthread_atfork(begin_fork, end_in_parent, end_in_child);

}  // namespace

AtWork::AtWork(Kind kind) {
  for (++at_work; kind == Kind::outer && own == 0 && forking > 0; ++at_work) {
    --at_work;
    usleep(kPause);
  }
  ++own;
}

AtWork::~AtWork() { --own, --at_work; }

unsigned torn_forks() { return torn; }

}  // namespace slf

#include "field/tiles/read_epochs.h"

#include <algorithm>

namespace slf {

ReadEpochs::Reader::Reader(ReadEpochs& epochs) : epochs_(epochs) {
  const std::lock_guard lock(epochs.mutex_);
  const auto free = std::ranges::find(epochs.readers_, false, &Slot::taken);
  slot_ = free != epochs.readers_.end() ? &*free : &epochs.readers_.emplace_back();
  slot_->taken = true;
}

ReadEpochs::Reader::~Reader() {
  const std::lock_guard lock(epochs_.mutex_);
  slot_->taken = false;
}

ReadEpochs::Scope::Scope(Reader& reader) : slot_(*reader.slot_) {
  // If freed() does not see this epoch, this thread sees the removal: the fence orders the store
  // before the look-ups, and that of freed() orders removals before loads of epochs.
  slot_.epoch.store(reader.epochs_.epoch_.load(std::memory_order_acquire),
                    std::memory_order_relaxed);
  std::atomic_thread_fence(std::memory_order_seq_cst);
}

std::uint64_t ReadEpochs::freed() const {
  std::atomic_thread_fence(std::memory_order_seq_cst);
  std::uint64_t oldest = ~std::uint64_t{0};
  const std::lock_guard lock(mutex_);
  for (const Slot& slot : readers_)
    if (const std::uint64_t epoch = slot.epoch.load(std::memory_order_acquire))
      oldest = std::min(oldest, epoch);
  return oldest;
}

}  // namespace slf

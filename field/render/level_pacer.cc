#include "field/render/level_pacer.h"

#include <cmath>

namespace slf {
namespace {

constexpr double kLate = 0.5;    // time without a finished plan after which a level is left out
constexpr double kFill = 1.25;   // time for the tiles of a whole view, after a level is added
constexpr double kMemory = 0.5;  // time constant of the decaying sums
// A view has about four times as many tiles in the next finer level. With them, the loader must not
// be busy for more than this share of its time.
constexpr double kGrowth = 5, kMaxBusy = 0.8;
constexpr double kMaxPatience = 8;

}  // namespace

void LevelPacer::add_plan(unsigned requested, double idle, double busy, bool finished) {
  const double fade = std::exp(-(busy + idle) / kMemory);
  busy_ = fade * busy_ + busy;
  idle_ = fade * idle_ + idle;
  since_change_ += busy + idle;
  unfinished_ = finished ? 0 : unfinished_ + busy;
  if (unfinished_ > kLate && since_change_ > kFill && left_out_ < requested) {
    // The level was added again too early: wait longer next time.
    patience_ = since_change_ < 4 * kLate ? std::min(2 * patience_, kMaxPatience) : kFirstPatience;
    ++left_out_;
  } else if (finished && left_out_ > 0 && since_change_ > patience_ &&
             kGrowth * busy_share() < kMaxBusy) {
    --left_out_;
  } else {
    return;
  }
  busy_ = idle_ = unfinished_ = since_change_ = 0;
}

}  // namespace slf

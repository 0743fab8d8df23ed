#include "field/render/level_pacer.h"

#include <cmath>

namespace slf {
namespace {

// A level is left out if, in this time, no plan was finished and the missing tiles did not become
// fewer by one in kFewer. Filling a whole view takes several such steps. If kElsewhere times as
// many are missing, the camera was moved elsewhere, and the time begins again.
constexpr double kLate = 0.5;
constexpr std::size_t kFewer = 8, kElsewhere = 2;
constexpr double kMemory = 0.5;  // time constant of the decaying sums
// A view has about four times as many tiles in the next finer level. With them, the loader must not
// be busy for more than this share of its time.
constexpr double kGrowth = 5, kMaxBusy = 0.8;
constexpr double kMaxPatience = 8;

}  // namespace

void LevelPacer::add_plan(const Plan& plan) {
  const double fade = std::exp(-(plan.busy + plan.idle) / kMemory);
  busy_ = fade * busy_ + plan.busy;
  idle_ = fade * idle_ + plan.idle;
  since_change_ += plan.busy + plan.idle;
  late_ += plan.busy;
  in_time_ = in_time_ || plan.finished;
  const bool fewer = kFewer * plan.missing <= (kFewer - 1) * missing_;
  const bool elsewhere = plan.missing > kElsewhere * missing_;
  if (plan.finished || plan.resting || fewer || elsewhere) {
    late_ = 0;
    missing_ = plan.finished ? 0 : plan.missing;
  }
  if (late_ > kLate && left_out_ < plan.requested) {
    // If the level was never in time, it was added again too early: wait longer next time.
    patience_ = in_time_ ? kFirstPatience : std::min(2 * patience_, kMaxPatience);
    ++left_out_;
  } else if (plan.finished && left_out_ > 0 &&
             since_change_ > (plan.resting ? kFirstPatience : patience_) &&
             kGrowth * busy_share() < kMaxBusy) {
    --left_out_;
  } else {
    return;
  }
  busy_ = idle_ = late_ = since_change_ = 0;
  missing_ = 0;
  in_time_ = false;
}

}  // namespace slf

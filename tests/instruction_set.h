// Code that is compiled once per instruction set, run with each.
#pragma once

#include <hwy/targets.h>

#include <cstdint>

namespace slf::testing {

/// While it lives, all threads use one instruction set; 0 for the machine's best.
class InstructionSet {
 public:
  explicit InstructionSet(std::int64_t target) { set(target); }
  ~InstructionSet() { set(0); }
  InstructionSet(const InstructionSet&) = delete;
  InstructionSet& operator=(const InstructionSet&) = delete;

 private:
  static void set(std::int64_t target) {
    hwy::SetSupportedTargetsForTest(target);
    hwy::GetChosenTarget().DeInit();  // until the next look-up
  }
};

/// Calls use(name) with each instruction set that the machine has.
template <class Use>
void with_each_instruction_set(Use use) {
  for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
    const InstructionSet only(target);
    use(hwy::TargetName(target));
  }
}

}  // namespace slf::testing

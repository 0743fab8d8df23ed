// Under a sanitizer code runs about ten times slower: tests of chance and of races do less there.
#pragma once

namespace slf::testing {

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
inline constexpr bool kSanitized = true;
#else
inline constexpr bool kSanitized = false;
#endif

/// How often a test repeats something: `rounds`, or a tenth of them under a sanitizer.
[[nodiscard]] constexpr int repetitions(int rounds) { return kSanitized ? rounds / 10 : rounds; }

}  // namespace slf::testing

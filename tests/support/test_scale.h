// SPDX-License-Identifier: Apache-2.0
//
// How much work a randomized test does: counts are written for a Release build; under a sanitizer,
// which is some ten to twenty times slower, a share of them is run. SIGHTLINE_TEST_SCALE (a
// positive number) multiplies all of them, for a longer hunt by hand.
//
// Thread safety: reads the environment; call it from tests only.
//
//   for (int i = 0; i < ScaledCount(200'000); ++i) ...
#ifndef SIGHTLINE_TESTS_SUPPORT_TEST_SCALE_H_
#define SIGHTLINE_TESTS_SUPPORT_TEST_SCALE_H_

#include <algorithm>
#include <cstdint>
#include <cstdlib>

namespace sightline::testing_support {

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
inline constexpr bool kSanitizerBuild = true;
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer) || \
    __has_feature(undefined_behavior_sanitizer)
inline constexpr bool kSanitizerBuild = true;
#else
inline constexpr bool kSanitizerBuild = false;
#endif
#else
inline constexpr bool kSanitizerBuild = false;
#endif

#if defined(__SANITIZE_THREAD__)
inline constexpr bool kThreadSanitizerBuild = true;
#else
inline constexpr bool kThreadSanitizerBuild = false;
#endif

// `count` of a Release build, scaled; at least 1.
inline int64_t ScaledCount(int64_t count, int64_t sanitizer_divisor = 20) {
  const char* const text = std::getenv("SIGHTLINE_TEST_SCALE");
  const double factor = text == nullptr || *text == '\0' ? 1.0 : std::strtod(text, nullptr);
  const double scaled = static_cast<double>(count) * (factor > 0 ? factor : 1.0) /
                        static_cast<double>(kSanitizerBuild ? sanitizer_divisor : 1);
  return std::max<int64_t>(1, static_cast<int64_t>(scaled));
}

}  // namespace sightline::testing_support

#endif  // SIGHTLINE_TESTS_SUPPORT_TEST_SCALE_H_

// SPDX-License-Identifier: Apache-2.0
//
// Waits for what another process or thread is to bring about, by asking again and again. Gives up
// after so long that only something that hangs takes it, but before ctest would end the program
// without a word of what it waited for.
//
// Thread safety: a function only; `done` runs in the caller's thread.
//
//   ASSERT_TRUE(Until("it is ready", [&] { return HttpGet(port, "/readyz").code == 200; }));
#ifndef SIGHTLINE_TESTS_SUPPORT_UNTIL_H_
#define SIGHTLINE_TESTS_SUPPORT_UNTIL_H_

#include <chrono>
#include <string_view>
#include <thread>

#include "gtest/gtest.h"

namespace sightline::testing_support {

template <typename Done>
testing::AssertionResult Until(std::string_view what, const Done& done) {
  constexpr std::chrono::minutes kPatience{2};
  const auto end = std::chrono::steady_clock::now() + kPatience;
  while (!done()) {
    if (std::chrono::steady_clock::now() > end) {
      return testing::AssertionFailure()
             << "not after " << kPatience.count() << " minutes: " << what;
    }
    std::this_thread::yield();
  }
  return testing::AssertionSuccess();
}

}  // namespace sightline::testing_support

#endif  // SIGHTLINE_TESTS_SUPPORT_UNTIL_H_

// SPDX-License-Identifier: Apache-2.0
//
// A hill climb toward the input whose error comes nearest to its margin.
//
// An input is a row of floats. From each start, some numbers at a time are moved by ulps, scaled,
// turned round, or set beside one another, and what brings the error nearer to the margin is kept.
//
// Thread safety: none.
//
//   Hunt hunt(rng);
//   hunt.Run(6, 100, [&] { return RandomInput(); }, [](const Input& x) { return ErrorOverMargin(x);
//   }); EXPECT_LE(hunt.worst(), 1) << hunt;
#ifndef SIGHTLINE_TESTS_CORE_SHAFT_MARGIN_HUNT_H_
#define SIGHTLINE_TESTS_CORE_SHAFT_MARGIN_HUNT_H_

#include <functional>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "tests/support/random.h"

namespace sightline::testing_support {

using HuntInput = std::vector<float>;

class Hunt {
 public:
  explicit Hunt(TestRng& rng) : rng_(rng) {}

  // `climbs` times: a start, and steps from it. `ratio` is an error over its margin; nullopt where
  // the input is none that the margin speaks of. Inputs stay finite and within ±2^40.
  void Run(int64_t climbs, const std::function<HuntInput()>& start,
           const std::function<std::optional<double>(const HuntInput&)>& ratio);

  // The largest ratio so far, 0 before one was found, and where.
  double worst() const { return worst_; }
  const HuntInput& worst_input() const { return worst_input_; }

 private:
  HuntInput Moved(HuntInput input);

  TestRng& rng_;
  double worst_ = 0;
  HuntInput worst_input_;
};

// In hexadecimal floats, so that a failure can be written down as a test.
std::string Hex(const HuntInput& input);
// The worst ratio, and its input.
std::ostream& operator<<(std::ostream& out, const Hunt& hunt);

}  // namespace sightline::testing_support

#endif  // SIGHTLINE_TESTS_CORE_SHAFT_MARGIN_HUNT_H_

// SPDX-License-Identifier: Apache-2.0
//
// Numbers in sentences: so many significant digits, or all before the point, and no exponent for
// people to decode.
//
// Thread safety: free functions.
//
//   PlainNumber(12345.6, 4);                // "12346"
//   PlainNumber(0.00000751, 3);             // "0.00000751"
//   MillisecondsText(absl::Seconds(3.37));  // "3370"
#ifndef SIGHTLINE_CLIENT_LOAD_PLAIN_NUMBER_H_
#define SIGHTLINE_CLIENT_LOAD_PLAIN_NUMBER_H_

#include <string>

#include "absl/time/time.h"

namespace sightline::load {

// REQUIRES: digits > 0. What is not finite is "inf", "-inf" or "nan".
std::string PlainNumber(double value, int digits);

// A latency in milliseconds, three digits.
std::string MillisecondsText(absl::Duration latency);

}  // namespace sightline::load

#endif  // SIGHTLINE_CLIENT_LOAD_PLAIN_NUMBER_H_

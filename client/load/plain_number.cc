// SPDX-License-Identifier: Apache-2.0
#include "client/load/plain_number.h"

#include <algorithm>

#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "core/base/check.h"

namespace sightline::load {

std::string PlainNumber(double value, int digits) {
  SIGHTLINE_DCHECK(digits > 0) << digits << " digits";
  std::string text = absl::StrFormat("%.*g", digits, value);
  const size_t e = text.find('e');
  int exponent = 0;
  if (e == std::string::npos || !absl::SimpleAtoi(text.substr(e + 1), &exponent)) return text;
  text = absl::StrFormat("%.*f", std::max(0, digits - 1 - exponent), value);
  // As %g leaves them off: 1e-06 is 0.000001.
  if (exponent < 0) text.erase(text.find_last_not_of('0') + 1);
  return text;
}

std::string MillisecondsText(absl::Duration latency) {
  return PlainNumber(absl::ToDoubleMilliseconds(latency), 3);
}

}  // namespace sightline::load

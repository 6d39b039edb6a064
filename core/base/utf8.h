// SPDX-License-Identifier: Apache-2.0
//
// Whether bytes are text: names travel in messages whose readers refuse anything but UTF-8.
//
// Thread safety: functions only.
//
//   if (!IsUtf8(name)) return absl::InvalidArgumentError("...");
#ifndef SIGHTLINE_CORE_BASE_UTF8_H_
#define SIGHTLINE_CORE_BASE_UTF8_H_

#include "absl/strings/string_view.h"

namespace sightline {

// Well-formed UTF-8 (Unicode 15, table 3-7): no overlong forms, no surrogates, nothing above
// U+10FFFF. Control characters are text; nothing at all is, too.
bool IsUtf8(absl::string_view text);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_BASE_UTF8_H_

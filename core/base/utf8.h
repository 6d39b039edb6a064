// SPDX-License-Identifier: Apache-2.0
//
// Whether bytes are text: names travel in messages whose readers refuse anything but UTF-8.
//
// Thread safety: functions only.
//
//   if (!IsUtf8(name)) return absl::InvalidArgumentError("...");
#ifndef SIGHTLINE_CORE_BASE_UTF8_H_
#define SIGHTLINE_CORE_BASE_UTF8_H_

#include <cstddef>

#include "absl/strings/string_view.h"

namespace sightline {

// Bytes of the well-formed character at the front of `text`; 0 where there is none (Unicode 15,
// table 3-7: no overlong forms, no surrogates, nothing above U+10FFFF).
size_t Utf8CharacterSize(absl::string_view text);

// Nothing but such characters. Control characters are text; nothing at all is, too.
bool IsUtf8(absl::string_view text);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_BASE_UTF8_H_

// SPDX-License-Identifier: Apache-2.0
//
// What somebody else wrote, as it stands in an error or in a line of the log: no longer than is of
// use to a reader, since a client may send megabytes for any name.
//
// Thread safety: functions only.
//
//   absl::StrCat("spec = ", Shortened(spec, 200));
#ifndef SIGHTLINE_SERVER_BASE_SHORTENED_H_
#define SIGHTLINE_SERVER_BASE_SHORTENED_H_

#include <cstddef>
#include <string>

#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"

namespace sightline {

// The first `most` bytes, or up to three fewer where a character of UTF-8 would be cut, and how
// long the whole is; `text` itself where it is no longer than that.
inline std::string Shortened(absl::string_view text, size_t most) {
  if (text.size() <= most) return std::string(text);
  size_t end = most;
  while (end > 0 && most - end < 3 && (static_cast<unsigned char>(text[end]) & 0xC0) == 0x80) --end;
  return absl::StrCat(text.substr(0, end), "... (", text.size(), " bytes)");
}

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_BASE_SHORTENED_H_

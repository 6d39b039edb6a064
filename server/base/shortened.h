// SPDX-License-Identifier: Apache-2.0
//
// What somebody else wrote, as it stands in an error or in a line of the log: no longer than is of
// use to a reader, since a client may send megabytes for any name.
//
// Thread safety: functions only.
//
//   absl::StrCat("spec = ", Shortened(spec, 200));
//   ShortenedWithin(status.message(), 700, 300);
#ifndef SIGHTLINE_SERVER_BASE_SHORTENED_H_
#define SIGHTLINE_SERVER_BASE_SHORTENED_H_

#include <cstddef>
#include <string>

#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"

namespace sightline {

// Whether a character of UTF-8 that began before goes on there.
inline bool IsWithinCharacter(absl::string_view text, size_t at) {
  return (static_cast<unsigned char>(text[at]) & 0xC0) == 0x80;
}

// The first `most` bytes, or up to three fewer where a character of UTF-8 would be cut.
// REQUIRES: text.size() > most.
inline absl::string_view HeadOf(absl::string_view text, size_t most) {
  size_t end = most;
  while (end > 0 && most - end < 3 && IsWithinCharacter(text, end)) --end;
  return text.substr(0, end);
}

// The same of the last ones.
inline absl::string_view TailOf(absl::string_view text, size_t most) {
  const size_t first = text.size() - most;
  size_t begin = first;
  while (begin < text.size() && begin - first < 3 && IsWithinCharacter(text, begin)) ++begin;
  return text.substr(begin);
}

// The head, and how long the whole is; `text` itself where it is no longer than `most`.
inline std::string Shortened(absl::string_view text, size_t most) {
  if (text.size() <= most) return std::string(text);
  return absl::StrCat(HeadOf(text, most), "... (", text.size(), " bytes)");
}

// Head and tail, and how long the whole is, for sentences: what is wrong with a name stands behind
// it, and what to do behind that.
inline std::string ShortenedWithin(absl::string_view text, size_t most_first, size_t most_last) {
  if (text.size() <= most_first + most_last) return std::string(text);
  return absl::StrCat(HeadOf(text, most_first), "... (", text.size(), " bytes) ...",
                      TailOf(text, most_last));
}

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_BASE_SHORTENED_H_

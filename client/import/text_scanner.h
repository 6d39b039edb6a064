// SPDX-License-Identifier: Apache-2.0
//
// Cuts text into lines and blank-separated tokens, and tokens into numbers, without copying.
// Numbers do not depend on the locale, and a decimal is rounded once, to the nearest double.
//
// Invariants: every view that is handed out points into the text; no function reads past its end.
//
// Thread safety: one scanner per thread; the text must outlive it.
//
//   TextScanner scanner("v 1 2.5 -3\n");
//   std::string_view keyword = scanner.Token();
//   double x = ParseDouble(scanner.Token()).value_or(kNaN);
#ifndef SIGHTLINE_CLIENT_IMPORT_TEXT_SCANNER_H_
#define SIGHTLINE_CLIENT_IMPORT_TEXT_SCANNER_H_

#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <string_view>

#include "absl/strings/string_view.h"
#include "core/geometry/vec3.h"

namespace sightline {

inline bool IsBlank(char c) { return c == ' ' || c == '\t' || c == '\v' || c == '\f'; }
inline bool IsLineEnd(char c) { return c == '\n' || c == '\r'; }

// What stands for a number that is none.
inline constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

// The whole token as a double: decimals with an optional sign and exponent, `inf` and `nan` in any
// case, and the forms of old Microsoft libraries (1.#INF, -1.#IND, 1.#QNAN). Too large becomes
// infinite, too small 0. Empty for anything else.
std::optional<double> ParseDouble(std::string_view token);

// The whole token as a decimal integer; empty where it is none or does not fit.
std::optional<int64_t> ParseInt(std::string_view token);

// The vertex itself, or, if a coordinate is not finite, the one quiet NaN in all three.
Vec3d CanonicalVertex(Vec3d v);

// Takes the next token (up to a blank or line end) off the front of `line`; empty where none is
// left.
std::string_view TakeToken(std::string_view* line);

std::string_view TrimBlanks(std::string_view text);

class TextScanner {
 public:
  explicit TextScanner(std::string_view text) : text_(text) {}

  // The next token, over line ends; empty at the end of the text.
  std::string_view Token();

  // The rest of the current line without its end ("\n", "\r\n" or "\r"), which is consumed.
  std::string_view RestOfLine();

  // The next line that holds more than blanks and a comment (from `comment` to its end; '\0': no
  // comments), without that comment; empty at the end of the text.
  std::string_view ContentLine(char comment);

  bool AtEnd() const { return position_ >= text_.size(); }
  size_t position() const { return position_; }
  size_t remaining() const { return text_.size() - position_; }

 private:
  std::string_view text_;
  size_t position_ = 0;
};

// Debian's Abseil has a string_view of its own.
inline absl::string_view ToAbsl(std::string_view s) { return {s.data(), s.size()}; }

// ASCII case-insensitive comparison.
bool StartsWithIgnoreCase(std::string_view text, std::string_view start);
bool EqualsIgnoreCase(std::string_view a, std::string_view b);

// `text` cut to a length fit for a one-line message, with control characters and non-ASCII bytes
// escaped.
std::string Quoted(std::string_view text);

}  // namespace sightline

#endif  // SIGHTLINE_CLIENT_IMPORT_TEXT_SCANNER_H_

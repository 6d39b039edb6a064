// SPDX-License-Identifier: Apache-2.0
#include "client/import/text_scanner.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>

#include "absl/strings/charconv.h"
#include "absl/strings/escaping.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"

namespace sightline {
namespace {

// "1.#INF", "-1.#IND00", "1.#QNAN", "1.#SNAN": what Microsoft's printf wrote before 2015.
std::optional<double> ParseMicrosoftSpecial(std::string_view token) {
  const bool negative = !token.empty() && token.front() == '-';
  if (!token.empty() && (token.front() == '-' || token.front() == '+')) token.remove_prefix(1);
  if (token.substr(0, 3) != "1.#") return std::nullopt;
  const double inf = std::numeric_limits<double>::infinity();
  return StartsWithIgnoreCase(token.substr(3), "INF") ? (negative ? -inf : inf) : kNaN;
}

}  // namespace

std::optional<double> ParseDouble(std::string_view token) {
  std::string_view digits = token;
  // from_chars takes no plus sign, which printf("%+g") writes; "+-1" stays malformed.
  if (digits.size() > 1 && digits[0] == '+' && digits[1] != '-') digits.remove_prefix(1);
  // absl would take a C program's hexadecimal floats too.
  if (digits.find_first_of("xX") != std::string_view::npos) return std::nullopt;
  double value = 0;
  const absl::from_chars_result r =
      absl::from_chars(digits.data(), digits.data() + digits.size(), value);
  const bool whole = r.ptr == digits.data() + digits.size() && !digits.empty();
  if (whole && r.ec == std::errc()) return value;
  if (whole && r.ec == std::errc::result_out_of_range) {
    // absl leaves the largest double behind for what is too large, ±0 or a tiny one for what is too
    // small.
    return std::abs(value) > 1 ? std::copysign(std::numeric_limits<double>::infinity(), value)
                               : value;
  }
  return ParseMicrosoftSpecial(token);
}

std::optional<int64_t> ParseInt(std::string_view token) {
  if (token.size() > 1 && token[0] == '+' && token[1] != '-') token.remove_prefix(1);
  int64_t value = 0;
  const auto [end, error] = std::from_chars(token.data(), token.data() + token.size(), value);
  if (error != std::errc() || end != token.data() + token.size()) return std::nullopt;
  return value;
}

Vec3d CanonicalVertex(Vec3d v) { return IsFinite(v) ? v : Vec3d{kNaN, kNaN, kNaN}; }

std::string_view TakeToken(std::string_view* line) {
  size_t begin = 0;
  while (begin < line->size() && (IsBlank((*line)[begin]) || IsLineEnd((*line)[begin]))) ++begin;
  size_t end = begin;
  while (end < line->size() && !IsBlank((*line)[end]) && !IsLineEnd((*line)[end])) ++end;
  const std::string_view token = line->substr(begin, end - begin);
  line->remove_prefix(end);
  return token;
}

std::string_view TrimBlanks(std::string_view text) {
  while (!text.empty() && (IsBlank(text.front()) || IsLineEnd(text.front()))) text.remove_prefix(1);
  while (!text.empty() && (IsBlank(text.back()) || IsLineEnd(text.back()))) text.remove_suffix(1);
  return text;
}

std::string_view TextScanner::Token() {
  while (position_ < text_.size() && (IsBlank(text_[position_]) || IsLineEnd(text_[position_]))) {
    ++position_;
  }
  const size_t begin = position_;
  while (position_ < text_.size() && !IsBlank(text_[position_]) && !IsLineEnd(text_[position_])) {
    ++position_;
  }
  return text_.substr(begin, position_ - begin);
}

std::string_view TextScanner::RestOfLine() {
  const size_t begin = position_;
  while (position_ < text_.size() && !IsLineEnd(text_[position_])) ++position_;
  const std::string_view line = text_.substr(begin, position_ - begin);
  if (position_ < text_.size()) {
    const bool two =
        text_[position_] == '\r' && position_ + 1 < text_.size() && text_[position_ + 1] == '\n';
    position_ += two ? 2 : 1;
  }
  return line;
}

std::string_view TextScanner::ContentLine(char comment) {
  while (!AtEnd()) {
    std::string_view line = RestOfLine();
    if (comment != '\0') line = line.substr(0, line.find(comment));
    line = TrimBlanks(line);
    if (!line.empty()) return line;
  }
  return {};
}

bool StartsWithIgnoreCase(std::string_view text, std::string_view start) {
  return EqualsIgnoreCase(text.substr(0, start.size()), start);
}

bool EqualsIgnoreCase(std::string_view a, std::string_view b) {
  return absl::EqualsIgnoreCase(ToAbsl(a), ToAbsl(b));
}

std::string Quoted(std::string_view text) {
  constexpr size_t kLongest =
      60;  // Bytes of a file that a message quotes: enough to find the place.
  const bool cut = text.size() > kLongest;
  return absl::StrCat("\"", absl::CHexEscape(ToAbsl(text.substr(0, kLongest))),
                      cut ? "...\"" : "\"");
}

}  // namespace sightline

// SPDX-License-Identifier: Apache-2.0
#include "client/cli/progress.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/time/clock.h"

namespace sightline::cli {

std::string HumanCount(double value) {
  if (!std::isfinite(value)) return "?";
  static constexpr const char* kSuffix[] = {"", " k", " M", " G", " T"};
  int i = 0;
  // 999.5 would print as 1000: it belongs to the next suffix already.
  while (i < 4 && std::abs(value) >= 999.5) {
    value /= 1000;
    ++i;
  }
  const double size = std::abs(value);
  if (i == 0 && value == std::floor(value)) return absl::StrFormat("%.0f", value);
  return absl::StrFormat("%.*f%s", size < 9.995 ? 2 : size < 99.95 ? 1 : 0, value, kSuffix[i]);
}

std::string GroupedCount(uint64_t value) {
  const std::string digits = absl::StrCat(value);
  std::string grouped;
  for (size_t i = 0; i < digits.size(); ++i) {
    if (i > 0 && (digits.size() - i) % 3 == 0) grouped += ',';
    grouped += digits[i];
  }
  return grouped;
}

std::string ClockTime(absl::Duration duration) {
  const int64_t seconds = absl::ToInt64Seconds(absl::Ceil(duration, absl::Seconds(1)));
  if (seconds >= 3600) {
    return absl::StrFormat("%d:%02d:%02d", seconds / 3600, seconds / 60 % 60, seconds % 60);
  }
  return absl::StrFormat("%d:%02d", seconds / 60, seconds % 60);
}

Progress::Progress(std::ostream& err, bool is_terminal, std::string what, std::string unit,
                   uint64_t total)
    : err_(err),
      is_terminal_(is_terminal),
      what_(std::move(what)),
      unit_(std::move(unit)),
      total_(total),
      start_(absl::Now()),
      last_shown_(start_) {}

std::string Progress::Line(uint64_t done, absl::Duration elapsed) const {
  const double seconds = absl::ToDoubleSeconds(elapsed);
  const double share = total_ == 0 ? 1.0 : static_cast<double>(done) / static_cast<double>(total_);
  std::string line = absl::StrFormat("%s %3.0f %%", what_, 100.0 * share);
  if (done > 0 && seconds > 0) {
    absl::StrAppend(&line, "  ", HumanCount(static_cast<double>(done) / seconds), " ", unit_, "/s");
    absl::StrAppend(&line, "  ", ClockTime(elapsed * ((1.0 - share) / share)), " left");
  }
  return line;
}

void Progress::Update(uint64_t done) {
  if (!is_terminal_) return;
  const absl::Time now = absl::Now();
  if (now - last_shown_ < absl::Milliseconds(100)) return;
  last_shown_ = now;
  shown_ = true;
  err_ << '\r' << Line(std::min(done, total_), now - start_) << "\x1b[K" << std::flush;
}

void Progress::Finish() {
  if (!shown_) return;
  shown_ = false;
  err_ << "\r\x1b[K" << std::flush;
}

}  // namespace sightline::cli

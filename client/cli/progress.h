// SPDX-License-Identifier: Apache-2.0
//
// One line that says how far a long work is, how fast it goes and how long it will still take.
// Shown where people look (a terminal), and nowhere else.
//
// Thread safety: Update may be called from any one thread at a time.
//
//   Progress progress(err, is_terminal, "tracing", "rays", total);
//   progress.Update(done);   // As often as one likes; the line changes ten times a second at most.
//   progress.Finish();       // Takes the line away.
#ifndef SIGHTLINE_CLIENT_CLI_PROGRESS_H_
#define SIGHTLINE_CLIENT_CLI_PROGRESS_H_

#include <cstdint>
#include <ostream>
#include <string>

#include "absl/time/time.h"

namespace sightline::cli {

// "12.3 M" of a count or a rate, three digits.
std::string HumanCount(double value);
// "1,234,567".
std::string GroupedCount(uint64_t value);
// "0:07", "3:25:00".
std::string ClockTime(absl::Duration duration);

class Progress {
 public:
  Progress(std::ostream& err, bool is_terminal, std::string what, std::string unit, uint64_t total);
  ~Progress() { Finish(); }
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  void Update(uint64_t done);
  void Finish();

  // The line for `done` after `elapsed`, without the terminal's control characters.
  std::string Line(uint64_t done, absl::Duration elapsed) const;

 private:
  std::ostream& err_;
  const bool is_terminal_;
  const std::string what_, unit_;
  const uint64_t total_;
  const absl::Time start_;
  absl::Time last_shown_;
  bool shown_ = false;
};

}  // namespace sightline::cli

#endif  // SIGHTLINE_CLIENT_CLI_PROGRESS_H_

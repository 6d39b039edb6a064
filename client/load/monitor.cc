// SPDX-License-Identifier: Apache-2.0
#include "client/load/monitor.h"

#include <chrono>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/cli/progress.h"
#include "client/load/plain_number.h"
#include "client/load/stability.h"

namespace sightline::load {
namespace {

constexpr std::chrono::milliseconds kPeriod(200);

}  // namespace

std::string LiveLine(const MonitorOptions& options, const Glance& glance) {
  if (options.interrupted != nullptr && options.interrupted->load()) {
    return absl::StrCat(options.title, "  interrupted: waiting for what is unanswered");
  }
  if (glance.elapsed <= absl::ZeroDuration()) return absl::StrCat(options.title, "  warming up");
  std::string line = absl::StrFormat(
      "%s  %.1f s of %.1f s  %s answers", options.title, absl::ToDoubleSeconds(glance.elapsed),
      absl::ToDoubleSeconds(options.duration), cli::GroupedCount(glance.answered));
  if (!glance.last.empty()) {
    const Window& window = glance.last.back();
    absl::StrAppend(&line, "  last window ", cli::GroupedCount(window.answered), " answers, p50 ",
                    MillisecondsText(window.planned.PercentileOf(50)), " ms, p99 ",
                    MillisecondsText(window.planned.PercentileOf(99)), " ms");
  }
  if (glance.failed > 0) absl::StrAppend(&line, "  ", cli::GroupedCount(glance.failed), " failed");
  if (glance.wrong > 0) absl::StrAppend(&line, "  ", cli::GroupedCount(glance.wrong), " WRONG");
  return line;
}

Monitor::Monitor(const MonitorOptions& options, const Recorder& recorder, Driver& driver,
                 Clock& clock, std::ostream& err)
    : options_(options),
      recorder_(recorder),
      driver_(driver),
      clock_(clock),
      err_(err),
      thread_([this] { Run(); }) {}

Monitor::~Monitor() {
  {
    MutexLock lock(mutex_);
    closed_ = true;
    changed_.SignalAll();
  }
  thread_.join();
  if (shown_) err_ << "\r\x1b[K" << std::flush;
}

void Monitor::Run() {
  while (true) {
    {
      MutexLock lock(mutex_);
      const auto until = std::chrono::steady_clock::now() + kPeriod;
      while (!closed_ && changed_.WaitUntil(mutex_, until)) {
      }
      if (closed_) return;
    }
    if (options_.interrupted != nullptr && options_.interrupted->load()) driver_.Stop();
    if (!options_.until_stable && !options_.is_terminal) continue;
    const Glance glance = recorder_.Look(clock_.Now(), kStableWindows);
    if (options_.until_stable && JudgeStability(glance.last, options_.tolerance).stable) {
      driver_.Stop();
    }
    if (options_.is_terminal) {
      shown_ = true;
      err_ << '\r' << LiveLine(options_, glance) << "\x1b[K" << std::flush;
    }
  }
}

}  // namespace sightline::load

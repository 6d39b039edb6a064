// SPDX-License-Identifier: Apache-2.0
#include "client/load/recorder.h"

#include <algorithm>
#include <optional>

#include "absl/strings/str_cat.h"
#include "client/lib/status.h"
#include "core/base/check.h"

namespace sightline::load {
namespace {

// Status::code() maps what it does not know to kUnknown.
size_t CodeOf(const absl::Status& status) { return static_cast<size_t>(status.code()); }

void AddRequest(const Outcome& outcome, Series* series) {
  ++series->requests;
  if (!outcome.status.ok()) {
    ++series->failed;
    if (outcome.sent == absl::InfiniteFuture()) ++series->unsent;
    if (outcome.given_up) series->planned.Record(outcome.received - outcome.request.planned);
    return;
  }
  ++series->answered;
  series->planned.Record(outcome.received - outcome.request.planned);
  series->sent.Record(outcome.received - outcome.sent);
}

void AddAnswer(const Outcome& outcome, Series* series) {
  ++series->answered_in_time;
  series->rays_in_time += outcome.rays;
  series->bytes_received_in_time += outcome.bytes_received;
  series->bytes_sent_in_time += outcome.bytes_sent;
}

}  // namespace

std::string ErrorName(const absl::Status& status) {
  std::string name = absl::StatusCodeToString(status.code());
  if (const std::optional<client::ErrorDetail> detail = client::GetErrorDetail(status)) {
    if (detail->reason != name) absl::StrAppend(&name, " ", detail->reason);
  }
  return name;
}

Recorder::Recorder(absl::Duration window) {
  SIGHTLINE_CHECK(window > absl::ZeroDuration()) << "window " << absl::FormatDuration(window);
  MutexLock lock(mutex_);
  measured_.window = window;
}

void Recorder::Begin(absl::Time begin, absl::Time end) {
  MutexLock lock(mutex_);
  measured_.begin = begin;
  end_ = end;
}

void Recorder::Add(const Outcome& outcome) {
  MutexLock lock(mutex_);
  Measurement& m = measured_;
  if (outcome.verdict != Verdict::kNotChecked) ++m.checked;
  if (outcome.verdict == Verdict::kWrong && m.wrong++ == 0) m.first_wrong = outcome.difference;
  Series& of_kind = m.by_kind[static_cast<size_t>(outcome.request.work.kind)];
  if (outcome.request.planned >= m.begin && outcome.request.planned < end_) {
    AddRequest(outcome, &m.all);
    AddRequest(outcome, &of_kind);
    if (!outcome.status.ok()) {
      ++m.errors[ErrorName(outcome.status)];
      ++m.failed_by_code[CodeOf(outcome.status)];
      if (m.first_error.ok()) m.first_error = outcome.status;
    } else if (outcome.server_compute > absl::ZeroDuration()) {
      m.server_queue.Record(outcome.server_queue);
      m.server_compute.Record(outcome.server_compute);
    }
  }
  if (outcome.received < m.begin || outcome.received >= end_) return;
  if (outcome.status.ok()) {
    AddAnswer(outcome, &m.all);
    AddAnswer(outcome, &of_kind);
  }
  const int64_t index =
      absl::ToInt64Nanoseconds(outcome.received - m.begin) / absl::ToInt64Nanoseconds(m.window);
  if (index >= static_cast<int64_t>(kMaxWindows)) return;
  const auto at = static_cast<size_t>(index);
  if (m.windows.size() <= at) m.windows.resize(at + 1);
  Window& window = m.windows[at];
  if (outcome.status.ok()) {
    ++window.answered;
    window.rays += outcome.rays;
    window.bytes_received += outcome.bytes_received;
    window.bytes_sent += outcome.bytes_sent;
    window.planned.Record(outcome.received - outcome.request.planned);
    window.sent.Record(outcome.received - outcome.sent);
  } else {
    ++window.failed;
    ++window.failed_by_code[CodeOf(outcome.status)];
  }
}

void Recorder::AddRefusalWait(absl::Time from, absl::Time to) {
  MutexLock lock(mutex_);
  const absl::Duration within = std::min(to, end_) - std::max(from, measured_.begin);
  if (within <= absl::ZeroDuration()) return;
  ++measured_.refusal_waits;
  measured_.refusal_wait += within;
}

absl::Duration Recorder::Elapsed(absl::Time now) const {
  return std::max(absl::ZeroDuration(), std::min(now, end_) - measured_.begin);
}

size_t Recorder::CompleteWindows(absl::Time now) const {
  return static_cast<size_t>(std::min<int64_t>(
      kMaxWindows,
      absl::ToInt64Nanoseconds(Elapsed(now)) / absl::ToInt64Nanoseconds(measured_.window)));
}

Measurement Recorder::Result(absl::Time now) const {
  MutexLock lock(mutex_);
  Measurement result = measured_;
  result.elapsed = Elapsed(now);
  // Windows in which nothing was answered count, too.
  result.windows.resize(CompleteWindows(now));
  return result;
}

Glance Recorder::Look(absl::Time now, size_t windows) const {
  MutexLock lock(mutex_);
  Glance glance{.elapsed = Elapsed(now),
                .answered = measured_.all.answered,
                .failed = measured_.all.failed,
                .wrong = measured_.wrong};
  const size_t complete = CompleteWindows(now);
  for (size_t i = complete - std::min(complete, windows); i < complete; ++i) {
    glance.last.push_back(i < measured_.windows.size() ? measured_.windows[i] : Window());
  }
  return glance;
}

}  // namespace sightline::load

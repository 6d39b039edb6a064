// SPDX-License-Identifier: Apache-2.0
//
// Structured logs: one line per event, `key=value` pairs, values quoted where they need it and cut
// after 1,024 bytes, so that both people and programs can read them.
//
// Log waits for nobody: lines go to a queue of 2,048, from which a thread of spdlog's writes them
// to stderr. Where they come faster than stderr takes them the oldest are dropped and counted, and
// a line `event=log_lines_dropped` says so as soon as there is room again. Whoever ends the process
// calls FlushLog first; a failed SIGHTLINE_CHECK does so by itself.
//
// Thread safety: every function may be called from any thread; a line is written in one piece.
//
//   Log(LogLevel::kInfo, "scene_ready", {{"scene", name}, {"triangles", absl::StrCat(n)}});
//   // time=2026-11-20T10:00:00.123Z level=info event=scene_ready scene=hall triangles=1000000
#ifndef SIGHTLINE_SERVER_BASE_LOG_H_
#define SIGHTLINE_SERVER_BASE_LOG_H_

#include <cstdint>
#include <initializer_list>
#include <string>
#include <utility>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"

namespace sightline {

enum class LogLevel { kDebug, kInfo, kWarning, kError, kOff };

using LogField = std::pair<absl::string_view, std::string>;

// "debug", "info", "warning", "error", "off". InvalidArgument listing them.
absl::StatusOr<LogLevel> ParseLogLevel(absl::string_view name);
// Events below `level` are dropped. kInfo at start.
void SetLogLevel(LogLevel level);

void Log(LogLevel level, absl::string_view event, std::initializer_list<LogField> fields = {});

// Returns true once everything logged before is written, false after `timeout`: nobody reads it.
bool FlushLog(absl::Duration timeout = absl::Seconds(1));
// Lines that were dropped since the start.
uint64_t DroppedLogLines();

// `value` as it stands in a line: itself, or in double quotes with \", \\, \n and \xNN escapes.
std::string QuoteLogValue(absl::string_view value);

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_BASE_LOG_H_

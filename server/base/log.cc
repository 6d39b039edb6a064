// SPDX-License-Identifier: Apache-2.0
#include "server/base/log.h"

#include <spdlog/pattern_formatter.h>
#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <memory>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"

namespace sightline {
namespace {

spdlog::logger& Logger() {
  // Leaked on purpose: threads may log until the process is gone.
  static spdlog::logger* const logger = [] {
    auto* made = new spdlog::logger("sightline", std::make_shared<spdlog::sinks::stderr_sink_mt>());
    made->set_formatter(std::make_unique<spdlog::pattern_formatter>(
        "time=%Y-%m-%dT%H:%M:%S.%eZ %v", spdlog::pattern_time_type::utc));
    made->set_level(spdlog::level::info);
    made->flush_on(spdlog::level::trace);
    return made;
  }();
  return *logger;
}

constexpr std::pair<absl::string_view, spdlog::level::level_enum> kLevels[] = {
    {"debug", spdlog::level::debug},  {"info", spdlog::level::info},
    {"warning", spdlog::level::warn}, {"error", spdlog::level::err},
    {"off", spdlog::level::off},
};

}  // namespace

absl::StatusOr<LogLevel> ParseLogLevel(absl::string_view name) {
  for (size_t i = 0; i < std::size(kLevels); ++i) {
    if (kLevels[i].first == name) return static_cast<LogLevel>(i);
  }
  return absl::InvalidArgumentError(
      absl::StrCat("log level \"", name, "\" is none of debug, info, warning, error, off"));
}

void SetLogLevel(LogLevel level) { Logger().set_level(kLevels[static_cast<int>(level)].second); }

void Log(LogLevel level, absl::string_view event, std::initializer_list<LogField> fields) {
  const auto& [name, spdlog_level] = kLevels[static_cast<int>(level)];
  if (!Logger().should_log(spdlog_level)) return;
  std::string line = absl::StrCat("level=", name, " event=", event);
  for (const auto& [key, value] : fields)
    absl::StrAppend(&line, " ", key, "=", QuoteLogValue(value));
  Logger().log(spdlog_level, spdlog::string_view_t(line));
}

std::string QuoteLogValue(absl::string_view value) {
  const bool plain = !value.empty() && std::all_of(value.begin(), value.end(), [](char c) {
    return c > ' ' && c <= '~' && c != '"' && c != '\\' && c != '=';
  });
  return plain ? std::string(value) : absl::StrCat("\"", absl::CHexEscape(value), "\"");
}

}  // namespace sightline

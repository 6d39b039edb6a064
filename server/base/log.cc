// SPDX-License-Identifier: Apache-2.0
#include "server/base/log.h"

#include <poll.h>
#include <spdlog/async_logger.h>
#include <spdlog/details/null_mutex.h>
#include <spdlog/details/thread_pool.h>
#include <spdlog/pattern_formatter.h>
#include <spdlog/sinks/base_sink.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <memory>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "core/base/check_failure.h"
#include "core/base/mutex.h"
#include "server/base/shortened.h"

namespace sightline {
namespace {

// Some 400 bytes each, and more where a line is long: a megabyte, and tens of milliseconds of a
// server that logs every item.
constexpr size_t kQueuedLines = 2048;
constexpr size_t kMaxLogValue = 1024;  // Bytes of one field.
// What a failed check waits for its last lines.
constexpr absl::Duration kCheckPatience = absl::Seconds(1);

// spdlog's thread must take no signal: those of the process are waited for elsewhere, and a pipe
// whose reader is gone is a failed write.
void BlockSignals() {
  sigset_t all;
  sigfillset(&all);
  pthread_sigmask(SIG_BLOCK, &all, nullptr);
}

std::unique_ptr<spdlog::formatter> LineFormatter() {
  return std::make_unique<spdlog::pattern_formatter>("time=%Y-%m-%dT%H:%M:%S.%eZ %v",
                                                     spdlog::pattern_time_type::utc);
}

// Used by spdlog's thread alone, but for WaitFor.
class StderrSink final : public spdlog::sinks::base_sink<spdlog::details::null_mutex> {
 public:
  // `pool` outlives the sink.
  explicit StderrSink(spdlog::details::thread_pool& pool)
      : base_sink(LineFormatter()), pool_(pool) {}

  // Whether the first `lines` lines that were given to spdlog are written or dropped before
  // `deadline`. Counted, as a mark among them might be dropped itself: it drops the oldest first.
  bool WaitFor(uint64_t lines, std::chrono::steady_clock::time_point deadline) {
    MutexLock lock(done_mutex_);
    while (done_ < lines) {
      if (!more_done_.WaitUntil(done_mutex_, deadline)) return done_ >= lines;
    }
    return true;
  }

 private:
  void sink_it_(const spdlog::details::log_msg& line) override {
    // Whatever becomes of it.
    const absl::Cleanup count = [this] { CountDone(); };
    if (const uint64_t dropped = pool_.overrun_counter(); dropped > told_) {
      const std::string text =
          absl::StrCat("level=warning event=log_lines_dropped lines=", dropped - told_);
      told_ = dropped;
      Write({{}, line.logger_name, spdlog::level::warn, text});
    }
    Write(line);
  }
  void flush_() override {}  // Nothing is held back.

  // Between two lines only: while one is being written, later ones may have been dropped. After a
  // dropped one there is always another to write.
  void CountDone() {
    ++written_;
    MutexLock lock(done_mutex_);
    done_ = written_ + pool_.overrun_counter();
    more_done_.SignalAll();
  }

  void Write(const spdlog::details::log_msg& line) {
    spdlog::memory_buf_t text;
    formatter_->format(line, text);
    for (size_t written = 0; written < text.size();) {
      const ssize_t n = ::write(STDERR_FILENO, text.data() + written, text.size() - written);
      if (n >= 0) {
        written += static_cast<size_t>(n);
      } else if (errno == EAGAIN) {
        pollfd out{.fd = STDERR_FILENO, .events = POLLOUT, .revents = 0};
        (void)poll(&out, 1, /*timeout=*/-1);
      } else if (errno != EINTR) {
        return;  // There is nowhere to say so.
      }
    }
  }

  spdlog::details::thread_pool& pool_;
  uint64_t told_ = 0;  // Of the dropped lines.
  uint64_t written_ = 0;
  Mutex done_mutex_;
  CondVar more_done_;
  uint64_t done_ ABSL_GUARDED_BY(done_mutex_) = 0;
};

struct AsyncLog {
  std::shared_ptr<spdlog::details::thread_pool> pool =
      std::make_shared<spdlog::details::thread_pool>(kQueuedLines, /*threads_n=*/1, &BlockSignals);
  std::shared_ptr<StderrSink> sink = std::make_shared<StderrSink>(*pool);
  std::shared_ptr<spdlog::async_logger> logger = std::make_shared<spdlog::async_logger>(
      "sightline", sink, pool, spdlog::async_overflow_policy::overrun_oldest);
  std::atomic<uint64_t> lines = 0;  // Given to the logger, or about to be.
};

AsyncLog& TheLog() {
  // Leaked on purpose: threads may log until the process is gone, and its own may be waiting for a
  // reader.
  static AsyncLog* const log = [] {
    auto* made = new AsyncLog;
    made->logger->set_level(spdlog::level::info);
    SetBeforeCheckFailure([] { FlushLog(kCheckPatience); });
    return made;
  }();
  return *log;
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

void SetLogLevel(LogLevel level) {
  TheLog().logger->set_level(kLevels[static_cast<int>(level)].second);
}

void Log(LogLevel level, absl::string_view event, std::initializer_list<LogField> fields) {
  const auto& [name, spdlog_level] = kLevels[static_cast<int>(level)];
  AsyncLog& log = TheLog();
  spdlog::logger& logger = *log.logger;
  if (!logger.should_log(spdlog_level)) return;
  std::string line = absl::StrCat("level=", name, " event=", event);
  for (const auto& [key, value] : fields)
    absl::StrAppend(&line, " ", key, "=", QuoteLogValue(Shortened(value, kMaxLogValue)));
  // First: then none of the lines before this one in the queue is uncounted.
  ++log.lines;
  logger.log(spdlog_level, spdlog::string_view_t(line));
}

bool FlushLog(absl::Duration timeout) {
  AsyncLog& log = TheLog();
  return log.sink->WaitFor(log.lines,
                           std::chrono::steady_clock::now() + absl::ToChronoNanoseconds(timeout));
}

uint64_t DroppedLogLines() { return TheLog().pool->overrun_counter(); }

std::string QuoteLogValue(absl::string_view value) {
  const bool plain = !value.empty() && std::all_of(value.begin(), value.end(), [](char c) {
    return c > ' ' && c <= '~' && c != '"' && c != '\\' && c != '=';
  });
  return plain ? std::string(value) : absl::StrCat("\"", absl::CHexEscape(value), "\"");
}

}  // namespace sightline

// SPDX-License-Identifier: Apache-2.0
#include "client/import/child_process.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>  // NOLINT(modernize-deprecated-headers): kill is POSIX, not in <csignal>.
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <exception>
#include <new>
#include <stdexcept>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"

#if defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define SIGHTLINE_CHILD_HAS_SHADOW_MEMORY 1
#endif
#endif
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define SIGHTLINE_CHILD_HAS_SHADOW_MEMORY 1
#endif

namespace sightline {
namespace {

// The first byte that the child sends.
constexpr char kResult = 'R', kException = 'E', kNoMemory = 'M', kTooLong = 'L';

// How often who waits for a child looks whether it is still wanted.
constexpr int kLookMilliseconds = 20;

bool WriteAll(int fd, const char* data, size_t size) {
  while (size > 0) {
    const ssize_t wrote = write(fd, data, size);
    if (wrote < 0 && errno == EINTR) continue;
    if (wrote <= 0) return false;
    data += wrote;
    size -= static_cast<size_t>(wrote);
  }
  return true;
}

void LimitMemory([[maybe_unused]] uint64_t bytes) {
#ifndef SIGHTLINE_CHILD_HAS_SHADOW_MEMORY
  uint64_t pages = 0;  // Of address space in use: the first number in statm.
  if (FILE* statm = std::fopen("/proc/self/statm", "re"); statm != nullptr) {
    if (std::fscanf(statm, "%lu", &pages) != 1) pages = 0;
    std::fclose(statm);
  }
  if (pages == 0) return;
  const uint64_t limit = pages * static_cast<uint64_t>(sysconf(_SC_PAGESIZE)) + bytes;
  struct rlimit rl;
  if (getrlimit(RLIMIT_AS, &rl) == 0) {
    rl.rlim_cur = std::min<rlim_t>(limit, rl.rlim_max);
    setrlimit(RLIMIT_AS, &rl);
  }
#endif
}

[[noreturn]] void RunChild(int fd, pid_t parent, absl::FunctionRef<std::string()> work,
                           const ChildLimits& limits) {
  // Dies with its parent, leaves no core file, and meets every signal with its default, but for
  // those that a terminal or a supervisor sends to both: they are the parent's, who ends it.
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (getppid() != parent) _exit(1);
  const struct rlimit no_core {};
  setrlimit(RLIMIT_CORE, &no_core);
  for (const int s : {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT}) signal(s, SIG_DFL);
  for (const int s : {SIGTERM, SIGINT, SIGHUP, SIGPIPE}) signal(s, SIG_IGN);
  LimitMemory(limits.memory_bytes);
  // What a library prints on the way out (assertions, glibc's heap checks) is no business of the
  // user's.
  if (const int null = open("/dev/null", O_WRONLY | O_CLOEXEC); null >= 0) {
    dup2(null, STDOUT_FILENO);
    dup2(null, STDERR_FILENO);
  }
  char kind = kResult;
  std::string result;
  try {
    result = work();
  } catch (const std::bad_alloc&) {
    kind = kNoMemory;
  } catch (const std::length_error& e) {
    kind = kTooLong;
    result = e.what();
  } catch (const std::exception& e) {
    kind = kException;
    result = e.what();
  } catch (...) {
    kind = kException;
    result = "an unknown exception";
  }
  const bool sent = WriteAll(fd, &kind, 1) && WriteAll(fd, result.data(), result.size());
  _exit(sent ? 0 : 1);
}

// All that the child writes, until it closes the pipe.
absl::StatusOr<std::string> ReadUntilClosed(int fd, const ChildLimits& limits) {
  const absl::Time deadline = absl::Now() + absl::Seconds(limits.timeout_seconds);
  std::string bytes;
  constexpr size_t kBlock = size_t{256} << 10;
  for (;;) {
    const int64_t left = absl::ToInt64Milliseconds(deadline - absl::Now());
    if (left <= 0) {
      return absl::DeadlineExceededError(
          absl::StrCat("was not read within ", limits.timeout_seconds, " seconds"));
    }
    if (limits.cancel != nullptr && limits.cancel->cancelled()) return limits.cancel->ToStatus();
    struct pollfd ready {
      fd, POLLIN, 0
    };
    const int64_t most = limits.cancel != nullptr ? kLookMilliseconds : 60'000;
    const int events = poll(&ready, 1, static_cast<int>(std::min(left, most)));
    if (events == 0 || (events < 0 && errno == EINTR)) continue;
    const size_t have = bytes.size();
    if (have > limits.result_bytes) {
      return absl::ResourceExhaustedError(
          absl::StrCat("comes to more than ", limits.result_bytes, " bytes of mesh"));
    }
    bytes.resize(have + kBlock);
    const ssize_t got = read(fd, bytes.data() + have, kBlock);
    bytes.resize(have + (got > 0 ? static_cast<size_t>(got) : 0));
    if (got == 0) return bytes;
    if (got < 0 && errno != EINTR) {
      return absl::UnavailableError(absl::StrCat("pipe: ", std::strerror(errno)));
    }
  }
}

}  // namespace

absl::StatusOr<std::string> RunInChild(absl::FunctionRef<std::string()> work,
                                       const ChildLimits& limits) {
  int ends[2];
  if (pipe2(ends, O_CLOEXEC) != 0) {
    return absl::UnavailableError(absl::StrCat("pipe: ", std::strerror(errno)));
  }
  const pid_t parent = getpid();
  const pid_t child = fork();
  if (child < 0) {
    const int error = errno;
    close(ends[0]);
    close(ends[1]);
    return absl::UnavailableError(absl::StrCat("fork: ", std::strerror(error)));
  }
  if (child == 0) {
    close(ends[0]);
    RunChild(ends[1], parent, work, limits);
  }
  close(ends[1]);
  absl::StatusOr<std::string> bytes = ReadUntilClosed(ends[0], limits);
  close(ends[0]);
  if (!bytes.ok()) kill(child, SIGKILL);
  int state = 0;
  pid_t waited = 0;
  do {
    waited = waitpid(child, &state, 0);
  } while (waited < 0 && errno == EINTR);
  if (!bytes.ok()) return bytes;
  // Where the process ignores SIGCHLD there is no state to be had; the bytes speak for themselves.
  if (waited == child && WIFSIGNALED(state)) {
    return absl::DataLossError(
        absl::StrCat("made its reader crash (", strsignal(WTERMSIG(state)), ")"));
  }
  if (bytes->empty() || (waited == child && (!WIFEXITED(state) || WEXITSTATUS(state) != 0))) {
    return absl::DataLossError("made its reader end without an answer");
  }
  const char kind = bytes->front();
  bytes->erase(0, 1);
  if (kind == kNoMemory) {
    return absl::ResourceExhaustedError(
        absl::StrCat("needs more memory than the limit of ", limits.memory_bytes, " bytes"));
  }
  if (kind == kTooLong) return absl::ResourceExhaustedError(*bytes);
  if (kind != kResult) return absl::InvalidArgumentError(*bytes);
  return bytes;
}

}  // namespace sightline

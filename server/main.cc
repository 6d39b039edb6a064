// SPDX-License-Identifier: Apache-2.0
//
// sightlined: a Sightline server as a process. Reads its flags, starts a Server, and drains it on
// SIGTERM or SIGINT, which end it at once while it starts, and again while it drains. SIGHUP has it
// read certificates and the access file again.
#include <unistd.h>

#include <csignal>
#include <cstdio>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/time/time.h"
#include "server/base/exit_deadline.h"
#include "server/base/log.h"
#include "server/option_sources.h"
#include "server/options.h"
#include "server/port_file.h"
#include "server/server.h"
#include "server/version.h"

namespace sightline {
namespace {

// Ends the process on SIGTERM or SIGINT for as long as it lives: loading a repository may take
// minutes, and there is nothing yet to drain. What is being stored is beside its place until it is
// whole. REQUIRES: both signals are blocked in every thread.
class StopWhileStarting {
 public:
  StopWhileStarting()
      : thread_([] {
          sigset_t signals;
          sigemptyset(&signals);
          sigaddset(&signals, SIGTERM);
          sigaddset(&signals, SIGINT);
          siginfo_t info{};
          while (sigwaitinfo(&signals, &info) < 0) {
          }
          if (info.si_code == SI_QUEUE && info.si_pid == getpid()) return;  // The destructor's.
          Log(LogLevel::kInfo, "stopped_while_starting", {{"signal", absl::StrCat(info.si_signo)}});
          FlushLog();
          _exit(0);
        }) {}
  ~StopWhileStarting() {
    pthread_sigqueue(thread_.native_handle(), SIGTERM, sigval{});
    thread_.join();
  }
  StopWhileStarting(const StopWhileStarting&) = delete;
  StopWhileStarting& operator=(const StopWhileStarting&) = delete;

 private:
  std::thread thread_;
};

// From sysexits.h.
constexpr int kExitUsage = 64;
constexpr int kExitUnavailable = 69;
constexpr int kExitSoftware = 70;

// What SIGHUP asks for. Some expect it to read the configuration again: the log says what it did.
void Reload(const ServerOptions& options, Server& server) {
  constexpr char kConfiguration[] = "as at the start; to have it read again, restart";
  if (options.tls.certificate.empty() && options.access_file.empty()) {
    Log(LogLevel::kWarning, "nothing_to_reload",
        {{"why", "no --tls-cert and no --access-file"}, {"configuration", kConfiguration}});
    return;
  }
  if (!server.ReloadSecurity().ok()) return;  // It has said what was wrong.
  std::vector<std::string> files;
  for (const std::string& file :
       {options.tls.certificate, options.tls.key, options.tls.client_ca, options.access_file}) {
    if (!file.empty()) files.push_back(file);
  }
  Log(LogLevel::kInfo, "reloaded",
      {{"files", absl::StrJoin(files, ",")}, {"configuration", kConfiguration}});
}

int Run(int argc, char** argv) {
  const absl::StatusOr<ParsedOptions> parsed = ReadOptions(argc, argv, environ);
  if (!parsed.ok()) {
    std::fprintf(stderr, "sightlined: %s\n", std::string(parsed.status().message()).c_str());
    return kExitUsage;
  }
  if (parsed->help) {
    std::fputs(HelpText().c_str(), stdout);
    return 0;
  }
  if (parsed->version) {
    std::printf("sightlined %s\n", std::string(kVersion).c_str());
    return 0;
  }
  if (const absl::Status status = CheckOptions(parsed->options); !status.ok()) {
    std::fprintf(stderr, "sightlined: %s\n", std::string(status.message()).c_str());
    return kExitUsage;
  }
  if (parsed->print_config) std::fputs(ConfigText(*parsed).c_str(), stdout);
  std::vector<std::string> warnings = parsed->warnings;
  for (std::string& trouble : ForeseenTroubles(parsed->options)) {
    warnings.push_back(std::move(trouble));
  }
  if (parsed->check_config || parsed->print_config) {
    // The server says these itself when it comes to them.
    for (std::string& warning : StoredInstead(parsed->options)) {
      warnings.push_back(std::move(warning));
    }
    for (const std::string& warning : warnings) {
      std::fprintf(stderr, "sightlined: %s\n", warning.c_str());
    }
    if (parsed->check_config) std::fputs("the configuration is good\n", stderr);
    return 0;
  }
  const ServerOptions& options = parsed->options;
  SetLogLevel(options.log_level);
  for (const std::string& warning : warnings) {
    Log(LogLevel::kWarning, "configuration", {{"warning", warning}});
  }

  // A file that grows over its limit is a failed write, not the end.
  std::signal(SIGXFSZ, SIG_IGN);
  // Blocked before any thread starts, so that all of them inherit it and those that wait for the
  // signals alone hear them: a handler could not shut gRPC down (it takes locks).
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGTERM);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGHUP);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);

  std::optional<ExitDeadline> end;  // Holds for the server's destruction, too.
  absl::StatusOr<std::unique_ptr<Server>> server = [&options] {
    const StopWhileStarting stop;
    return Server::Start(options);
  }();
  absl::Status status = server.status();
  if (status.ok() && !options.port_file.empty()) {
    status = WritePortFile(options.port_file, (*server)->port());
  }
  if (!status.ok()) {
    Log(LogLevel::kError, "start_failed", {{"status", status.ToString()}});
    // An exit code alone would leave whoever wants no log in the dark.
    if (options.log_level == LogLevel::kOff) {
      std::fprintf(stderr, "sightlined: %s\n", std::string(status.message()).c_str());
    }
    return kExitUnavailable;
  }
  Log(LogLevel::kInfo, "serving",
      {{"version", std::string(kVersion)},
       {"listen", absl::StrJoin(options.listen, ",")},
       {"port", absl::StrCat((*server)->port())},
       {"metrics_port", absl::StrCat((*server)->metrics_port())}});

  int signal = 0;
  while (sigwait(&signals, &signal) == 0 && signal == SIGHUP) {
    Reload(options, **server);
  }
  // A second signal ends the process at once, also where a shell that started it in the background
  // has SIGINT ignored; SIGHUP has nothing more to say.
  std::signal(SIGINT, SIG_DFL);
  std::signal(SIGTERM, SIG_DFL);
  sigdelset(&signals, SIGHUP);
  pthread_sigmask(SIG_UNBLOCK, &signals, nullptr);
  Log(LogLevel::kInfo, "signal", {{"signal", absl::StrCat(signal)}});
  end.emplace(options.drain_delay + options.drain_timeout + kCutOffTimeout, kExitSoftware);
  status = (*server)->Drain(options.drain_timeout);
  if (!options.port_file.empty()) RemovePortFile(options.port_file);
  Log(status.ok() ? LogLevel::kInfo : LogLevel::kError, "stopped", {{"status", status.ToString()}});
  return status.ok() ? 0 : kExitSoftware;
}

}  // namespace
}  // namespace sightline

int main(int argc, char** argv) {
  const int code = sightline::Run(argc, argv);
  sightline::FlushLog();
  return code;
}

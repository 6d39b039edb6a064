// SPDX-License-Identifier: Apache-2.0
#include "client/cli/session.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "client/cli/exit_code.h"

namespace sightline::cli {
namespace {

class RemoteSession final : public Session {
 public:
  RemoteSession(std::shared_ptr<client::Connection> connection, const SessionFlags& flags,
                client::Cancellation* cancellation)
      : Session(std::move(connection), /*server=*/nullptr, flags, cancellation) {}
};

client::RetryOptions RetriesOf(const SessionFlags& flags) {
  client::RetryOptions retry;
  retry.give_up_after = absl::Seconds(flags.retry_seconds);
  return retry;
}

}  // namespace

absl::Status SecurityFileError(const absl::Status& status) {
  // What is in the file is wrong, or it cannot be read: for whichever reason, some of which have no
  // code of their own.
  return absl::IsInvalidArgument(status) ? status : WithExitCode(status, kExitNoInput);
}

void SessionFlags::Register(FlagSet* flags, bool embeddable, bool streams_too) {
  flags->Heading("Server");
  flags->Custom("server", "HOST:PORT",
                embeddable ? "the server to ask; without it one is started in this process"
                           : "the server to ask; required",
                "", [this](const std::string& text) -> absl::Status {
                  const size_t colon = text.rfind(':');
                  const bool unix_socket = text.substr(0, 5) == "unix:";
                  if (!unix_socket &&
                      (colon == std::string::npos || colon == 0 || colon + 1 == text.size())) {
                    return absl::InvalidArgumentError("wants HOST:PORT");
                  }
                  server = text;
                  return absl::OkStatus();
                });
  if (embeddable) {
    flags->Count("threads", "N",
                 "threads of the server in this process, 0: one per core; no answer depends on it",
                 &threads, 0, 1000);
  }
  flags->Number("timeout", "SECONDS", "give up after so long, 0: never", &timeout_seconds);
  flags->Number("retry", "SECONDS",
                "go on so long while the server cannot be reached or is busy, 0: try once",
                &retry_seconds);
  flags->Text("tls-ca", "FILE", "speak TLS; PEM authorities that the server must be known by",
              &security.ca);
  flags->Text("tls-cert", "FILE", "speak TLS; PEM certificate to show", &security.certificate);
  flags->Text("tls-key", "FILE", "PEM private key of --tls-cert", &security.key);
  flags->Text("token-file", "FILE", "holds a bearer token to show", &security.token);
  if (embeddable && streams_too) {
    flags->Count("streams", "N", "streams to the server at once, 0: one per connection", &streams,
                 0, 64);
  }
}

uint64_t SessionFlags::ConnectionCount() const {
  return connections > 0 ? connections : std::min<uint64_t>(streams, 8);
}

absl::Status SessionFlags::Check() const {
  if (timeout_seconds < 0) {
    return UsageError(absl::StrCat("--timeout wants 0 or more seconds; got ", timeout_seconds));
  }
  if (retry_seconds < 0) {
    return UsageError(absl::StrCat("--retry wants 0 or more seconds; got ", retry_seconds));
  }
  const std::pair<const char*, const std::string&> of_servers[] = {
      {"tls-ca", security.ca},
      {"tls-cert", security.certificate},
      {"tls-key", security.key},
      {"token-file", security.token}};
  for (const auto& [flag, file] : of_servers) {
    if (server.empty() && !file.empty()) {
      return UsageError(absl::StrCat("--", flag, " goes with --server"));
    }
  }
  return absl::OkStatus();
}

Session::Session(std::shared_ptr<client::Connection> connection, std::shared_ptr<void> server,
                 const SessionFlags& flags, client::Cancellation* cancellation)
    : server_(std::move(server)),
      connection_(std::move(connection)),
      client_(connection_),
      flags_(flags),
      cancellation_(cancellation),
      deadline_(flags.timeout_seconds > 0 ? absl::Now() + absl::Seconds(flags.timeout_seconds)
                                          : absl::InfiniteFuture()) {}

client::StreamOptions Session::stream() const {
  client::StreamOptions options;
  options.deadline = deadline_;
  options.cancellation = cancellation_;
  options.streams = static_cast<int>(flags_.streams);
  options.retry = RetriesOf(flags_);
  return options;
}

absl::StatusOr<client::Scene> Session::LoadNative(const SceneBytes& file,
                                                  const std::string&) const {
  return UsageError(absl::StrCat(
      file.shown,
      " is a native scene file, which a server takes from its own repository alone: put ",
      "it there, then sightline scene load scenes/NAME"));
}

absl::StatusOr<std::unique_ptr<Session>> OpenRemote(const SessionFlags& flags,
                                                    client::Cancellation* cancellation) {
  if (flags.server.empty()) {
    return UsageError("wants --server HOST:PORT: scenes live on a server");
  }
  return Session::Open(flags, cancellation);
}

absl::StatusOr<std::unique_ptr<Session>> Session::Open(const SessionFlags& flags,
                                                       client::Cancellation* cancellation) {
  if (absl::Status s = flags.Check(); !s.ok()) return s;
  if (flags.server.empty()) return OpenEmbedded(flags, cancellation);
  client::ConnectionOptions options;
  if (absl::Status s = client::CheckSecurity(flags.security, flags.server); !s.ok()) {
    return UsageError(s.message());
  }
  absl::StatusOr<client::Security> security = client::LoadSecurity(flags.security, flags.server);
  if (!security.ok()) return SecurityFileError(security.status());
  options.security = *std::move(security);
  options.retry = RetriesOf(flags);
  if (const uint64_t count = flags.ConnectionCount(); count > 0) {
    options.channels = static_cast<int>(count);
  }
  return std::make_unique<RemoteSession>(client::MakeConnection(flags.server, options), flags,
                                         cancellation);
}

}  // namespace sightline::cli

// SPDX-License-Identifier: Apache-2.0
//
// What a command talks to: the server at --server, or one started in this process and stopped with
// the command. Both are spoken to by the same client library, over the same messages.
//
// Thread safety: one thread per Session; its Client may be shared.
//
//   SL_ASSIGN_OR_RETURN(std::unique_ptr<Session> session,
//                       Session::Open(flags, context.interruption.calls()));
//   session->client().ListScenes();
#ifndef SIGHTLINE_CLIENT_CLI_SESSION_H_
#define SIGHTLINE_CLIENT_CLI_SESSION_H_

#include <cstdint>
#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "client/cli/flags.h"
#include "client/lib/cancellation.h"
#include "client/lib/client.h"
#include "client/lib/connection.h"
#include "client/lib/security.h"
#include "core/scene/scene_file.h"

namespace sightline::cli {

struct SessionFlags {
  std::string server;          // HOST:PORT; empty: embedded.
  uint64_t threads = 0;        // Of the embedded server; 0: one per core.
  double timeout_seconds = 0;  // 0: none.
  double retry_seconds = 10;   // How long to go on without an answer.
  uint64_t streams = 0;        // 0: one per network connection.
  uint64_t connections = 0;    // Network connections; 0: as many as streams, at most 8.
  client::SecurityFiles security;

  // `embeddable`: the command also works without a server. `streams_too`: with
  // --streams, for commands whose streams the library makes.
  void Register(FlagSet* flags, bool embeddable, bool streams_too = true);
  // Network connections to make; 0: as many as the library makes by itself.
  uint64_t ConnectionCount() const;
  // Usage errors that one flag alone does not show.
  absl::Status Check() const;
};

class Session {
 public:
  // `cancellation` (may be null) ends calls and streams of the session early, and outlives it.
  static absl::StatusOr<std::unique_ptr<Session>> Open(
      const SessionFlags& flags, client::Cancellation* cancellation = nullptr);
  virtual ~Session() = default;

  const client::Client& client() const { return client_; }
  // What the client stands on, for callers that keep streams of their own.
  const std::shared_ptr<client::Connection>& connection() const { return connection_; }
  bool embedded() const { return server_ != nullptr; }
  // For calls that are made now.
  client::CallOptions call() const {
    return {.deadline = deadline_, .cancellation = cancellation_};
  }
  client::StreamOptions stream() const;
  // A scene of a native scene file, which the embedded server maps; a usage error for a remote one.
  virtual absl::StatusOr<client::Scene> LoadNative(const SceneBytes& file,
                                                   const std::string& scene_id) const;

 protected:
  // `server`: the embedded one, null for a remote one.
  Session(std::shared_ptr<client::Connection> connection, std::shared_ptr<void> server,
          const SessionFlags& flags, client::Cancellation* cancellation);

 private:
  const std::shared_ptr<void> server_;  // Outlives the connection, whose channels end in it.
  const std::shared_ptr<client::Connection> connection_;
  const client::Client client_;
  const SessionFlags flags_;
  client::Cancellation* const cancellation_;
  const absl::Time deadline_;
};

// What reading a certificate, a key or a token returned, with its exit code.
absl::Status SecurityFileError(const absl::Status& status);

// Starts a server in this process (embedded_session.cc: the one file that knows the server).
absl::StatusOr<std::unique_ptr<Session>> OpenEmbedded(const SessionFlags& flags,
                                                      client::Cancellation* cancellation);

// Session::Open for commands that need a server: a usage error without one.
absl::StatusOr<std::unique_ptr<Session>> OpenRemote(const SessionFlags& flags,
                                                    client::Cancellation* cancellation);

}  // namespace sightline::cli

#endif  // SIGHTLINE_CLIENT_CLI_SESSION_H_

// SPDX-License-Identifier: Apache-2.0
//
// A server without a port over a repository's folder, and a client of it in this process.
//
// Thread safety: functions.
//
//   std::unique_ptr<Server> server = *Server::Start(RepositoryOptions(dir.path()));
//   const std::unique_ptr<client::Client> client = ClientInProcess(*server);
#ifndef SIGHTLINE_TESTS_INTEGRATION_REPOSITORY_SERVER_H_
#define SIGHTLINE_TESTS_INTEGRATION_REPOSITORY_SERVER_H_

#include <memory>
#include <string>

#include "absl/time/time.h"
#include "client/lib/client.h"
#include "server/base/log.h"
#include "server/options.h"
#include "server/server.h"

namespace sightline {

inline ServerOptions RepositoryOptions(const std::string& folder) {
  ServerOptions options;
  options.listen.clear();
  options.threads = 2;
  options.build_threads = 2;
  options.log_level = LogLevel::kOff;
  options.repository = folder;
  return options;
}

// Which gives up at once.
inline std::unique_ptr<client::Client> ClientInProcess(Server& server) {
  client::ConnectionOptions connection;
  connection.retry.give_up_after = absl::ZeroDuration();
  return std::make_unique<client::Client>(client::MakeConnection(
      {server.InProcessChannel(client::DefaultChannelArguments())}, connection));
}

}  // namespace sightline

#endif  // SIGHTLINE_TESTS_INTEGRATION_REPOSITORY_SERVER_H_

// SPDX-License-Identifier: Apache-2.0
//
// The server in this process. The one file of the tool that includes the server's headers.
#include <algorithm>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "client/cli/cancelled_work.h"
#include "client/cli/session.h"
#include "core/base/parallel.h"
#include "core/base/status_macros.h"
#include "server/base/log.h"
#include "server/machine_memory.h"
#include "server/server.h"

namespace sightline::cli {
namespace {

class EmbeddedSession final : public Session {
 public:
  EmbeddedSession(std::shared_ptr<client::Connection> connection,
                  const std::shared_ptr<Server>& server, const SessionFlags& flags,
                  client::Cancellation* cancellation)
      : Session(std::move(connection), server, flags, cancellation), server_(*server) {}

  absl::StatusOr<client::Scene> LoadNative(const SceneBytes& file,
                                           const std::string& scene_id) const override {
    const CancelledWork work(call().cancellation);
    SL_RETURN_IF_ERROR(
        server_.scenes().CreateFromBytes({.scene_id = scene_id}, file, work.token()).status());
    return client().GetScene(absl::StrCat("scenes/", scene_id), call());
  }

 private:
  Server& server_;  // The base's.
};

// Scenes may take three quarters of the memory that there is: nobody else uses this server.
uint64_t SceneBudget(uint64_t least) { return std::max(least, ThisMachinesMemory().bytes / 4 * 3); }

}  // namespace

absl::StatusOr<std::unique_ptr<Session>> OpenEmbedded(const SessionFlags& flags,
                                                      client::Cancellation* cancellation) {
  ServerOptions options;
  options.listen.clear();  // No socket: in-process channels alone.
  options.threads = static_cast<int>(flags.threads);
  // Nobody asks anything before the scene is there.
  options.build_threads =
      flags.threads > 0 ? static_cast<int>(flags.threads) : ThreadPool(0).threads();
  // Standard error belongs to the command.
  options.log_level = LogLevel::kError;
  SetLogLevel(options.log_level);
  options.limits.max_scene_bytes = SceneBudget(options.limits.max_scene_bytes);
  options.limits.max_bytes_per_scene = options.limits.max_scene_bytes;
  SL_ASSIGN_OR_RETURN(std::unique_ptr<Server> server, Server::Start(options));
  std::vector<std::shared_ptr<grpc::Channel>> channels;
  const uint64_t count = std::max<uint64_t>(1, flags.ConnectionCount());
  for (uint64_t i = 0; i < count; ++i) {
    channels.push_back(server->InProcessChannel(client::DefaultChannelArguments()));
  }
  client::ConnectionOptions connection;
  connection.retry.give_up_after = absl::Seconds(flags.retry_seconds);
  return std::make_unique<EmbeddedSession>(client::MakeConnection(std::move(channels), connection),
                                           std::shared_ptr<Server>(std::move(server)), flags,
                                           cancellation);
}

}  // namespace sightline::cli

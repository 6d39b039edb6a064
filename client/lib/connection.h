// SPDX-License-Identifier: Apache-2.0
//
// The seam between the client library and the network: what Client needs of a server, in the wire's
// own messages. MakeConnection gives the real one; tests give a mock.
//
// Layers, as in google-cloud-cpp: Client (a value; plain structs) → Connection with retries
// (MakeRetryingConnection) → Connection over gRPC (MakeGrpcConnection).
//
// Thread safety: all members of a Connection may be called from any thread. Of a BidiStream, one
// thread may read while another writes; Cancel may be called from any.
//
//   std::shared_ptr<Connection> connection = MakeConnection("localhost:7070", {});
//   Client client(connection);
#ifndef SIGHTLINE_CLIENT_LIB_CONNECTION_H_
#define SIGHTLINE_CLIENT_LIB_CONNECTION_H_

#include <grpcpp/channel.h>
#include <grpcpp/support/channel_arguments.h>

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "client/lib/backoff.h"
#include "client/lib/cancellation.h"
#include "client/lib/security.h"
#include "client/lib/types.h"
#include "sightline/v1/capability_service.pb.h"
#include "sightline/v1/point_set_service.pb.h"
#include "sightline/v1/scene_service.pb.h"
#include "sightline/v1/visibility_service.pb.h"

namespace sightline::client {

// How one call goes.
struct CallOptions {
  absl::Time deadline = absl::InfiniteFuture();
  // Ends the call early with CANCELLED; may be null. Must outlive the call.
  Cancellation* cancellation = nullptr;
};

// A stream in both directions; every member but Cancel blocks.
template <typename Request, typename Response>
class BidiStream {
 public:
  virtual ~BidiStream() = default;
  // False once the stream is broken; Finish then says why.
  virtual bool Write(const Request& request) = 0;
  virtual bool WritesDone() = 0;
  // False when nothing more comes.
  virtual bool Read(Response* response) = 0;
  // Unblocks everything; Finish will say CANCELLED.
  virtual void Cancel() = 0;
  // REQUIRES: Read returned false, and no Write is under way. Called once.
  virtual absl::Status Finish() = 0;
};

// Sends the messages of an upload through `write`, which is false once the stream is broken. An
// upload can be played again from its start: that is what makes it safe to retry.
template <typename Request>
using Upload = std::function<void(const std::function<bool(const Request&)>& write)>;

class Connection {
 public:
  using TileStream = BidiStream<v1::TraceTilesRequest, v1::TraceTilesResponse>;
  using ShadowStream = BidiStream<v1::ComputeShadowsRequest, v1::ComputeShadowsResponse>;
  using SegmentStream = BidiStream<v1::TestSegmentsRequest, v1::TestSegmentsResponse>;

  virtual ~Connection() = default;

  virtual absl::StatusOr<v1::Scene> CreateScene(const Upload<v1::CreateSceneRequest>& upload,
                                                const CallOptions& options) = 0;
  virtual absl::StatusOr<v1::Scene> UpdateScene(const Upload<v1::UpdateSceneRequest>& upload,
                                                const CallOptions& options) = 0;
  virtual absl::StatusOr<v1::Scene> GetScene(const v1::GetSceneRequest& request,
                                             const CallOptions& options) = 0;
  virtual absl::StatusOr<v1::ListScenesResponse> ListScenes(const v1::ListScenesRequest& request,
                                                            const CallOptions& options) = 0;
  virtual absl::StatusOr<v1::ListSceneObjectsResponse> ListSceneObjects(
      const v1::ListSceneObjectsRequest& request, const CallOptions& options) = 0;
  virtual absl::Status DeleteScene(const v1::DeleteSceneRequest& request,
                                   const CallOptions& options) = 0;
  // Calls `on_change` for each message until it returns false or the stream ends.
  virtual absl::Status WatchScene(
      const v1::WatchSceneRequest& request,
      const std::function<bool(const v1::WatchSceneResponse&)>& on_change,
      const CallOptions& options) = 0;
  virtual absl::StatusOr<v1::Scene> LoadScene(const v1::LoadSceneRequest& request,
                                              const CallOptions& options) = 0;
  virtual absl::StatusOr<v1::Scene> ReloadScene(const v1::ReloadSceneRequest& request,
                                                const CallOptions& options) = 0;
  virtual absl::Status UnloadScene(const v1::UnloadSceneRequest& request,
                                   const CallOptions& options) = 0;
  virtual absl::StatusOr<v1::ListStoredScenesResponse> ListStoredScenes(
      const v1::ListStoredScenesRequest& request, const CallOptions& options) = 0;

  virtual absl::StatusOr<v1::PointSet> CreatePointSet(
      const Upload<v1::CreatePointSetRequest>& upload, const CallOptions& options) = 0;
  virtual absl::StatusOr<v1::PointSet> GetPointSet(const v1::GetPointSetRequest& request,
                                                   const CallOptions& options) = 0;
  virtual absl::StatusOr<v1::ListPointSetsResponse> ListPointSets(
      const v1::ListPointSetsRequest& request, const CallOptions& options) = 0;
  virtual absl::Status DeletePointSet(const v1::DeletePointSetRequest& request,
                                      const CallOptions& options) = 0;
  virtual absl::StatusOr<v1::PointSet> RenewLease(const v1::RenewLeaseRequest& request,
                                                  const CallOptions& options) = 0;

  virtual absl::StatusOr<v1::Capabilities> GetCapabilities(const CallOptions& options) = 0;
  // `service` empty: the server as a whole.
  virtual absl::StatusOr<Health> CheckHealth(const std::string& service,
                                             const CallOptions& options) = 0;

  // How many network connections bulk streams may be spread over.
  virtual int channel_count() const = 0;
  // `channel` counts modulo channel_count().
  virtual std::unique_ptr<TileStream> OpenTiles(int channel, const CallOptions& options) = 0;
  virtual std::unique_ptr<ShadowStream> OpenShadows(int channel, const CallOptions& options) = 0;
  virtual std::unique_ptr<SegmentStream> OpenSegments(int channel, const CallOptions& options) = 0;
};

struct ConnectionOptions {
  RetryOptions retry;
  // Network connections of their own for bulk streams (MakeConnection by address).
  int channels = 2;
  // What to show and whom to trust (MakeConnection by address).
  Security security;
};

// Plain gRPC without retries over channels that exist: CallOptions, errors as absl::Status.
// REQUIRES: at least one channel.
std::shared_ptr<Connection> MakeGrpcConnection(
    std::vector<std::shared_ptr<grpc::Channel>> channels);

// Repeats calls that fail with a retryable error (status.h), with back-off. Streams are handed
// through: what a stream lost is sent again by the caller that knows its items.
std::shared_ptr<Connection> MakeRetryingConnection(std::shared_ptr<Connection> inner,
                                                   const RetryOptions& options);

// Both, over channels of an in-process server or of the caller's making.
std::shared_ptr<Connection> MakeConnection(std::vector<std::shared_ptr<grpc::Channel>> channels,
                                           const ConnectionOptions& options);
// Both, to HOST:PORT (or any gRPC target).
std::shared_ptr<Connection> MakeConnection(const std::string& target,
                                           const ConnectionOptions& options);

// What every channel to a server should be made with: message sizes, no port sharing of
// connections, and pings, so that a peer that falls silent during a call ends it with UNAVAILABLE
// within a minute.
grpc::ChannelArguments DefaultChannelArguments();

}  // namespace sightline::client

#endif  // SIGHTLINE_CLIENT_LIB_CONNECTION_H_

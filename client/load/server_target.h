// SPDX-License-Identifier: Apache-2.0
//
// A server as a target: for each connection one stream per camera of the path, one for points and
// one for segments, as far as the mix asks for them. Requests go round the connections in turn
// (Workload::ConnectionOf).
//
// Thread safety: as Target. SetOnDone only while nothing is unanswered.
//
//   SL_ASSIGN_OR_RETURN(auto target, ServerTarget::Open(*session->connection(), workload, ...));
#ifndef SIGHTLINE_CLIENT_LOAD_SERVER_TARGET_H_
#define SIGHTLINE_CLIENT_LOAD_SERVER_TARGET_H_

#include <array>
#include <atomic>
#include <memory>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "client/lib/backoff.h"
#include "client/lib/cancellation.h"
#include "client/lib/connection.h"
#include "client/load/clock.h"
#include "client/load/item_stream.h"
#include "client/load/reference.h"
#include "client/load/target.h"
#include "client/load/workload.h"

namespace sightline::load {

struct ServerTargetOptions {
  absl::Duration item_timeout = absl::ZeroDuration();  // 0: none.
  client::RetryOptions retry;                          // Of streams that end.
  client::Limits limits;                               // As the server published them.
};

class ServerTarget final : public Target {
 public:
  // Returns once every stream is open, or with CANCELLED once `cancellation` (may be null) comes
  // before. `workload`, `reference` (may be null: nothing is checked), `clock` and `connection`
  // must outlive the target.
  static absl::StatusOr<std::unique_ptr<ServerTarget>> Open(
      client::Connection& connection, const Workload& workload, const Reference* reference,
      const ServerTargetOptions& options, Clock& clock, client::Cancellation* cancellation);

  void SetOnDone(OnDone on_done) override { on_done_ = std::move(on_done); }
  void Send(const Request& request) override;
  void CancelAll() override;
  absl::Status status() const override;
  size_t stream_count() const { return all_.size(); }

 private:
  ServerTarget(const Workload& workload, const Reference* reference)
      : workload_(workload), reference_(reference) {}
  LaneContext MakeContext(const ServerTargetOptions& options, Clock& clock);
  void AddTileLane(client::Connection& connection, int channel, size_t camera,
                   const LaneContext& context);
  void AddPointsLane(client::Connection& connection, int channel, const LaneContext& context);
  void AddSegmentsLane(client::Connection& connection, int channel, const LaneContext& context);
  void AddLane(Kind kind, int channel, std::unique_ptr<Lane> lane);

  const Workload& workload_;
  const Reference* const reference_;
  OnDone on_done_;
  std::atomic<bool> gone_{false};  // A lane has given up.
  // By kind: connections, then the kind's streams. They point into all_.
  std::array<std::vector<std::vector<Lane*>>, kKinds> lanes_;
  std::vector<std::unique_ptr<Lane>> all_;
};

}  // namespace sightline::load

#endif  // SIGHTLINE_CLIENT_LOAD_SERVER_TARGET_H_

// SPDX-License-Identifier: Apache-2.0
//
// What the three methods of VisibilityService have in common: the scene, the lights and the options
// that a stream's header names. See visibility_stream.h for what else a method has.
//
// Thread safety: constant once opened.
//
//   std::unique_ptr<TileMethod> method(new TileMethod(env));
//   SL_ASSIGN_OR_RETURN(method->lights_, LightSet::Open(header.lights(), env.limits));
//   SL_RETURN_IF_ERROR(method->OpenScene(header.stream()));
#ifndef SIGHTLINE_SERVER_STREAM_STREAM_METHOD_H_
#define SIGHTLINE_SERVER_STREAM_STREAM_METHOD_H_

#include <grpcpp/server_context.h>

#include <cstdint>
#include <memory>
#include <string>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"
#include "server/codec/query_codec.h"
#include "server/codec/wire_request.h"
#include "server/stream/light_set.h"
#include "server/stream/query_environment.h"
#include "server/stream/scene_pin.h"
#include "sightline/v1/visibility_service.pb.h"

namespace sightline {

class StreamMethod {
 public:
  StreamMethod(const StreamMethod&) = delete;
  StreamMethod& operator=(const StreamMethod&) = delete;

  bool statistics() const { return options_.statistics; }
  const std::string& scene_id() const { return pin_->scene_id(); }
  // The current revision when the stream was opened.
  uint64_t opened_revision() const { return opened_revision_; }
  // Of all lights together; 0 for a method without.
  uint64_t sample_count() const { return lights_ == nullptr ? 0 : lights_->sample_count(); }

 protected:
  explicit StreamMethod(const QueryEnvironment& env) : env_(env) {}
  ~StreamMethod() = default;

  // The last step of opening: finds the scene, and sees whether the lights fit it.
  absl::Status OpenScene(const v1::StreamHeader& header);

  const QueryEnvironment env_;
  DecodedOptions options_;
  std::unique_ptr<LightSet> lights_;  // Null for a method without.
  std::unique_ptr<ScenePin> pin_;

 private:
  uint64_t opened_revision_ = 0;
};

// How many rays so many elements ask for; saturating, since an item may say anything.
// REQUIRES: rays_each > 0.
uint64_t RayCount(uint64_t elements, uint64_t rays_each);

// ResourceExhausted (LIMIT_EXCEEDED) for more than max_item_rays.
absl::Status CheckItemRays(uint64_t rays, const Limits& limits);

// How many items of a stream may be unanswered at once: each costs at least min_item_cost_rays, and
// is sent while there is credit.
uint64_t MostUnanswered(const Limits& limits);

// How many lights, mirrors and ids of items a message may have, above what any is good for: each
// has a limit of its own, and whoever sends more than this is told of that one, too. `limits`
// outlive it.
ElementLimit MostElements(const Limits& limits);

// What an item takes off the credit and of the queue. Its rays say little of what is held for it if
// its arrays do not fit one another; so its message's bytes count as well, and what is held is no
// more than those and a fixed part: an item has no repeated fields, and its unknown ones are
// dropped before it is read. An item that makes sense has no more than 56 bytes to a ray.
inline constexpr uint64_t kBytesPerRay = 64;
uint64_t ItemCost(uint64_t rays, uint64_t message_bytes, const Limits& limits);

// InvalidArgument (INVALID_FIELD) for a message that cancels more items than may be unanswered.
absl::Status CheckCancelled(uint64_t ids, const Limits& limits);

// An item that was sent while `unanswered` ones take up all the credit.
absl::Status CreditError(uint64_t item_id, int64_t credit, size_t unanswered, const Limits& limits);

// DEADLINE_EXCEEDED: the item's timeout passed.
absl::Status ItemExpiredError(uint64_t item_id);
// CANCELLED: the client asked for it.
absl::Status ItemCancelledError(uint64_t item_id);
// There is nobody any more to answer. CANCELLED: the client wants none, or is gone;
// DEADLINE_EXCEEDED: the time that it gave has passed.
absl::Status CallCancelledError();
absl::Status CallExpiredError();
// DEADLINE_EXCEEDED: for max_stream_stall no reply was taken, or could be sent for want of credit.
absl::Status StreamStallError(const Limits& limits);
// The same for a watch of a scene, which has no credit.
absl::Status WatchStallError(const Limits& limits);

// Why a stream of `peer` ends, for the log.
void LogFailure(absl::string_view peer, const absl::Status& status);

// Ends a call whose write does not complete: as TryCancel does, but the client is told why, by code
// and message, without details. Before Finish, after which the context may be gone.
void CutOff(grpc::CallbackServerContext* context, const absl::Status& status);

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_STREAM_STREAM_METHOD_H_

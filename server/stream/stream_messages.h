// SPDX-License-Identifier: Apache-2.0
//
// What a visibility stream says that is no reply. Response is that of any of the three methods.
//
// Thread safety: functions only.
//
//   outbox.Push(DrainingMessage<v1::TraceTilesResponse>(accepted, last_accepted), nullptr);
#ifndef SIGHTLINE_SERVER_STREAM_STREAM_MESSAGES_H_
#define SIGHTLINE_SERVER_STREAM_STREAM_MESSAGES_H_

#include <cstdint>

#include "server/stream/item_reply.h"
#include "server/stream/outbox.h"

namespace sightline {

template <typename Response>
OutgoingMessage OpenedMessage(uint64_t revision, int64_t credit_rays, uint64_t light_samples) {
  Response response;
  response.mutable_opened()->set_revision(static_cast<int64_t>(revision));
  response.mutable_opened()->set_credit_rays(credit_rays);
  response.mutable_opened()->set_light_sample_count(static_cast<uint32_t>(light_samples));
  return {.bytes = MessageBytes(response)};
}

template <typename Response>
OutgoingMessage DrainingMessage(uint64_t accepted_items, uint64_t last_accepted_id) {
  Response response;
  response.mutable_draining()->set_accepted_item_count(accepted_items);
  response.mutable_draining()->set_last_accepted_item_id(last_accepted_id);
  return {.bytes = MessageBytes(response)};
}

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_STREAM_STREAM_MESSAGES_H_

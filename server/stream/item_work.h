// SPDX-License-Identifier: Apache-2.0
//
// One item of a visibility stream once it is decoded: parts that can be computed side by side, each
// of which fills one reply.
//
// Thread safety: RunPart may run for several parts at once, each part once; the rest is constant.
#ifndef SIGHTLINE_SERVER_STREAM_ITEM_WORK_H_
#define SIGHTLINE_SERVER_STREAM_ITEM_WORK_H_

#include <algorithm>
#include <cstdint>
#include <memory>
#include <numeric>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "core/base/cancel.h"
#include "core/query/options.h"
#include "core/scene/scene.h"
#include "server/base/error.h"
#include "server/base/limits.h"

namespace sightline {

// Elements [offset, offset + count) of an item.
struct PartRange {
  uint64_t offset = 0, count = 0;
};

// Cuts `elements` into parts. Each holds whole multiples of `unit` elements (but the last), starts
// at a multiple of 8, asks for about `part_rays` rays (Scheduler::Flow::PartRays: so that it keeps
// a thread for a few milliseconds), and its reply stays near the target size. ResourceExhausted
// (max_message_bytes) if the smallest legal part makes too long a reply; `bytes(n)` is what a reply
// of n elements takes at most.
template <typename Bytes>
absl::StatusOr<std::vector<PartRange>> CutIntoParts(uint64_t elements, uint64_t unit,
                                                    uint64_t rays_per_element, uint64_t part_rays,
                                                    const Limits& limits, const Bytes& bytes) {
  // Room for the reply's other fields beside its arrays.
  constexpr uint64_t kHeaderBytes = 1024;
  const uint64_t step = std::min(std::lcm(unit, uint64_t{8}), elements);
  const uint64_t reply_limit = limits.max_message_bytes - kHeaderBytes;
  if (bytes(step) > reply_limit) {
    return OverLimit("bytes of the smallest reply", bytes(step), "max_message_bytes",
                     limits.max_message_bytes);
  }
  const uint64_t target_bytes = std::min(limits.target_reply_bytes, reply_limit);
  const uint64_t by_rays = std::max<uint64_t>(1, part_rays / rays_per_element / step);
  const uint64_t by_bytes =
      std::max<uint64_t>(1, target_bytes / std::max<uint64_t>(1, bytes(step)));
  // In even parts, as many as come nearest: a little more at once is better than a small rest.
  const uint64_t steps = (elements + step - 1) / step;
  const uint64_t even = std::max<uint64_t>(1, (steps + by_rays / 2) / by_rays);
  const uint64_t size = step * std::min((steps + even - 1) / even, by_bytes);
  std::vector<PartRange> parts;
  for (uint64_t offset = 0; offset < elements; offset += size) {
    parts.push_back({offset, std::min(size, elements - offset)});
  }
  return parts;
}

template <typename Response>
class ItemWork {
 public:
  ItemWork(std::shared_ptr<const Scene> scene, std::vector<PartRange> parts)
      : scene_(std::move(scene)), parts_(std::move(parts)) {}
  ItemWork(const ItemWork&) = delete;
  ItemWork& operator=(const ItemWork&) = delete;
  virtual ~ItemWork() = default;

  const std::vector<PartRange>& parts() const { return parts_; }
  uint64_t revision() const { return scene_->revision; }
  // Fills everything of `reply` but its header. On an error the reply is not sent.
  virtual absl::Status RunPart(size_t part, const CancelToken& cancel, Response* reply,
                               QueryStats* stats) = 0;
  // Adds to the last reply what is true of the whole item.
  virtual void Complete(Response* reply) { (void)reply; }

 protected:
  const Scene& scene() const { return *scene_; }

 private:
  const std::shared_ptr<const Scene> scene_;
  const std::vector<PartRange> parts_;
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_STREAM_ITEM_WORK_H_

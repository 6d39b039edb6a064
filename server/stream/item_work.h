// SPDX-License-Identifier: Apache-2.0
//
// One item of a visibility stream once it is decoded: parts that can be computed side by side. Each
// fills a reply, or several share in one, which the last of them to be done fills.
//
// Invariants: the parts hold every element once; the replies do, too, perhaps in another order; the
// part that fills a reply is known when it is done.
//
// Thread safety: RunPart may run for several parts at once, each part once; the rest is constant.
//
//   SL_ASSIGN_OR_RETURN(const PartRange answered, work->RunPart(part, token, &reply, &stats));
//   if (answered.count > 0) Send(reply, answered);
#ifndef SIGHTLINE_SERVER_STREAM_ITEM_WORK_H_
#define SIGHTLINE_SERVER_STREAM_ITEM_WORK_H_

#include <algorithm>
#include <bit>
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
#include "server/stream/item_reply.h"

namespace sightline {

// Elements [offset, offset + count) of an item.
struct PartRange {
  uint64_t offset = 0, count = 0;
};

// Cuts `elements` into parts. Each holds whole multiples of `unit` elements (but the last), starts
// at a multiple of 8, asks for about `part_rays` rays (Scheduler::Flow::PartRays: so that it keeps
// a thread for a few milliseconds), and its reply stays near the target size. ResourceExhausted
// (max_message_bytes) if the smallest legal part makes too long a reply; `bytes(n)` is what a reply
// of n elements takes at most, and does not fall with n.
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
                     limits.max_message_bytes,
                     "ask for fewer kinds of results, or for sums over the lights");
  }
  const uint64_t target_bytes = std::min(limits.target_reply_bytes, reply_limit);
  const uint64_t by_rays = std::max<uint64_t>(1, part_rays / rays_per_element / step);
  const uint64_t steps = (elements + step - 1) / step;
  // Some bytes are every reply's, however few elements it has: so no division tells.
  uint64_t by_bytes = 1;
  for (uint64_t more = std::bit_floor(steps); more > 0; more /= 2) {
    const uint64_t some = by_bytes + more;
    if (some <= steps && bytes(some * step) <= target_bytes) by_bytes = some;
  }
  // In even parts, as many as come nearest: a little more at once is better than a small rest.
  const uint64_t even = std::max<uint64_t>(1, (steps + by_rays / 2) / by_rays);
  const uint64_t size = step * std::min((steps + even - 1) / even, by_bytes);
  std::vector<PartRange> parts;
  for (uint64_t offset = 0; offset < elements; offset += size) {
    parts.push_back({offset, std::min(size, elements - offset)});
  }
  return parts;
}

class ItemWork {
 public:
  // Each part fills a reply of its own, which holds the elements of its range.
  ItemWork(std::shared_ptr<const Scene> scene, std::vector<PartRange> parts)
      : ItemWork(std::move(scene), std::move(parts), 0) {
    replies_ = parts_.size();
  }
  ItemWork(const ItemWork&) = delete;
  ItemWork& operator=(const ItemWork&) = delete;
  virtual ~ItemWork() = default;

  // One behind the other, from 0 to the number of elements.
  const std::vector<PartRange>& parts() const { return parts_; }
  // How many replies the parts will fill.
  size_t replies() const { return replies_; }
  uint64_t revision() const { return scene_->revision; }
  // From now on the parts count what answered their rays. Before the first part.
  void CountAnswers() { count_answers_ = true; }
  // The elements that the reply holds: it is filled but for its header. No elements: other parts
  // share in this one's reply. On an error nothing is sent.
  virtual absl::StatusOr<PartRange> RunPart(size_t part, const CancelToken& cancel,
                                            ItemReply* reply, QueryStats* stats) = 0;
  // Adds to the last reply what is true of the whole item.
  virtual void Complete(ItemReply* reply) { (void)reply; }

 protected:
  ItemWork(std::shared_ptr<const Scene> scene, std::vector<PartRange> parts, size_t replies)
      : scene_(std::move(scene)), parts_(std::move(parts)), replies_(replies) {}

  const Scene& scene() const { return *scene_; }
  // The stream's options, for a part.
  QueryOptions PartOptions(QueryOptions options, const CancelToken& cancel) const {
    options.cancel = &cancel;
    options.count_answers = count_answers_;
    return options;
  }

 private:
  const std::shared_ptr<const Scene> scene_;
  const std::vector<PartRange> parts_;
  size_t replies_;
  bool count_answers_ = false;
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_STREAM_ITEM_WORK_H_

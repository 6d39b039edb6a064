// SPDX-License-Identifier: Apache-2.0
//
// Whose turn it is among parties that share something by cost: start-time fair queueing. Each
// party's next piece carries a start tag, the least goes first, and serving it moves the party's
// next tag on by what the piece cost. Costs are in rays here; any unit will do.
//
// Invariants
//  1. While two parties both wait, what they are served differs by no more than one piece of each,
//     whatever their numbers of pieces (theorem 1 of the paper).
//  2. A party that comes back after a pause starts at the tag now in service: it has saved up
//     nothing, and goes before all who have had more. One that is in debt (its last piece was
//     large) stays so until the others have caught up or nobody waits any more.
//  3. Ties go to who entered first, so the order is a function of the calls alone.
//
// P. Goyal, H. M. Vin and H. Cheng, "Start-time fair queueing: a scheduling algorithm for
// integrated services packet switching networks", SIGCOMM 1996, sections 2 and 3.
//
// Thread safety: none; its owner's lock guards it.
//
//   FairOrder order;
//   order.Enter(&a);
//   FairNode* next = order.First();
//   order.Serve(next, rays);      // Still waiting, now behind those who have had less.
//   order.Leave(next);            // Waits for nothing any more.
#ifndef SIGHTLINE_SERVER_ADMISSION_FAIR_ORDER_H_
#define SIGHTLINE_SERVER_ADMISSION_FAIR_ORDER_H_

#include <algorithm>
#include <cstdint>
#include <set>
#include <utility>

#include "core/base/check.h"

namespace sightline {

// A party. Derive from it; one order at a time.
class FairNode {
 public:
  FairNode() = default;
  FairNode(const FairNode&) = delete;
  FairNode& operator=(const FairNode&) = delete;

 private:
  friend class FairOrder;
  uint64_t start_ = 0;   // Tag of its next piece.
  uint64_t finish_ = 0;  // Tag at which its last piece ends.
  uint64_t entry_ = 0;
  bool waits_ = false;
};

class FairOrder {
 public:
  bool empty() const { return waiting_.empty(); }

  // `node` has something to be served. Does nothing if it waits already.
  void Enter(FairNode* node) {
    if (node->waits_) return;
    node->waits_ = true;
    node->start_ = std::max(now_, node->finish_);
    node->entry_ = next_entry_++;
    waiting_.insert(node);
  }

  // `node` has nothing more. Does nothing if it does not wait.
  void Leave(FairNode* node) {
    if (!node->waits_) return;
    waiting_.erase(node);
    node->waits_ = false;
    // The end of a busy time: debts are to nobody.
    if (waiting_.empty()) now_ = last_finish_;
  }

  // Whose turn it is; null if nobody waits.
  FairNode* First() const { return waiting_.empty() ? nullptr : *waiting_.begin(); }

  // A piece of `node`, which waits, was taken. It goes on waiting.
  void Serve(FairNode* node, uint64_t cost) {
    SIGHTLINE_CHECK(node->waits_) << "served without waiting";
    waiting_.erase(node);
    now_ = std::max(now_, node->start_);
    node->finish_ = node->start_ + cost;
    last_finish_ = std::max(last_finish_, node->finish_);
    node->start_ = node->finish_;
    node->entry_ = next_entry_++;
    waiting_.insert(node);
  }

 private:
  struct Sooner {
    bool operator()(const FairNode* a, const FairNode* b) const {
      return std::pair(a->start_, a->entry_) < std::pair(b->start_, b->entry_);
    }
  };

  std::set<FairNode*, Sooner> waiting_;
  uint64_t now_ = 0;  // The start tag in service.
  uint64_t last_finish_ = 0;
  uint64_t next_entry_ = 0;
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_ADMISSION_FAIR_ORDER_H_

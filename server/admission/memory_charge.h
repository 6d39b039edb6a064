// SPDX-License-Identifier: Apache-2.0
//
// Memory that a request takes up before it becomes what a budget is there for, such as the part of
// an upload that has arrived: it counts against the same budget, as it comes, until it is given
// back.
//
// Invariant: what a charge has taken is given back once, however its owner ends.
//
// Units: bytes. Thread safety: a budget's methods from any thread; a charge belongs to one thread
// at a time. The budget outlives its charges.
//
//   MemoryCharge charge(catalog);
//   SL_RETURN_IF_ERROR(charge.Add(SceneUpload::BytesOf(message)));
//   // RESOURCE_EXHAUSTED (OUT_OF_MEMORY_BUDGET)
#ifndef SIGHTLINE_SERVER_ADMISSION_MEMORY_CHARGE_H_
#define SIGHTLINE_SERVER_ADMISSION_MEMORY_CHARGE_H_

#include <cstdint>
#include <utility>

#include "absl/status/status.h"
#include "core/base/status_macros.h"

namespace sightline {

class MemoryBudget {
 public:
  virtual ~MemoryBudget() = default;
  // Counts `bytes` until they are given back. May make room first, which takes time: not on a gRPC
  // thread. ResourceExhausted (OUT_OF_MEMORY_BUDGET).
  virtual absl::Status SetAside(uint64_t bytes) = 0;
  virtual void GiveBack(uint64_t bytes) = 0;
};

class MemoryCharge {
 public:
  explicit MemoryCharge(MemoryBudget& budget) : budget_(budget) {}
  ~MemoryCharge() { Release(); }
  MemoryCharge(const MemoryCharge&) = delete;
  MemoryCharge& operator=(const MemoryCharge&) = delete;

  absl::Status Add(uint64_t bytes) {
    if (bytes == 0) return absl::OkStatus();
    SL_RETURN_IF_ERROR(budget_.SetAside(bytes));
    bytes_ += bytes;
    return absl::OkStatus();
  }
  void Release() {
    if (bytes_ > 0) budget_.GiveBack(std::exchange(bytes_, 0));
  }
  // Leaves what it has taken to the caller, who sees to its being given back.
  uint64_t Leave() { return std::exchange(bytes_, 0); }

 private:
  MemoryBudget& budget_;
  uint64_t bytes_ = 0;
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_ADMISSION_MEMORY_CHARGE_H_

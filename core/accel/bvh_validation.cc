// SPDX-License-Identifier: Apache-2.0
#include "core/accel/bvh_validation.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <limits>
#include <string>
#include <vector>

#include "absl/base/attributes.h"
#include "absl/strings/str_cat.h"
#include "core/base/aligned_vector.h"
#include "core/base/float_environment.h"
#include "core/base/parallel.h"
#include "core/base/status_macros.h"

namespace sightline {
namespace {

template <typename... Args>
absl::Status Fault(const Args&... args) {
  return absl::DataLossError(absl::StrCat("invalid BVH: ", args...));
}

class Validator {
 public:
  Validator(const Bvh& bvh, const SceneGeometry& geometry, const CancelToken* cancel)
      : bvh_(bvh), geometry_(geometry), cancel_(cancel) {}

  // Not inlined: it computes in its caller's floating-point environment.
  ABSL_ATTRIBUTE_NOINLINE absl::Status Validate() {
    const size_t live = geometry_.triangles.size() - geometry_.inert.size();
    if (bvh_.triangle_count != live) {
      return Fault("it counts ", bvh_.triangle_count, " triangles, the geometry ", live);
    }
    if (bvh_.nodes.empty()) return ValidateEmpty();
    SL_RETURN_IF_ERROR(ValidateSizes());
    triangles_.resize(geometry_.triangles.size(), kUnseen);
    for (uint32_t id : geometry_.inert) triangles_[id] = kInert;
    units_seen_.resize(units_, kUnseen);
    unseen_nodes_.assign(bvh_.nodes.size(), true);
    order_.reserve(bvh_.nodes.size());
    boxes_.resize(bvh_.nodes.size());
    SL_RETURN_IF_ERROR(WalkDown());
    for (size_t i = 0; i < unseen_nodes_.size(); ++i) {
      if (unseen_nodes_[i]) return Fault("node ", i, " is never reached");
    }
    SL_RETURN_IF_ERROR(CheckLeaves());
    SL_RETURN_IF_ERROR(CheckAllSeen());
    return CheckInnerBoxes();
  }

 private:
  absl::Status ValidateEmpty() const {
    if (bvh_.triangle_count != 0 || bvh_.leaf_count != 0 || bvh_.max_depth != 0 ||
        !bvh_.leaves.empty() || !bvh_.leaf_ids.empty() || !bvh_.bounds.empty()) {
      return Fault("it has no nodes, but triangles, leaves, a depth or bounds");
    }
    return absl::OkStatus();
  }

  absl::Status ValidateSizes() {
    if (!bvh_.has_leaf_rows()) {
      if (!bvh_.leaves.empty()) return Fault("it has rows and names for its leaves");
      if (bvh_.leaf_ids.size() % kUnitTriangles != 0) {
        return Fault(bvh_.leaf_ids.size(), " leaf ids are not whole units");
      }
    } else if (bvh_.leaves.size() < kLeafPadding ||
               (bvh_.leaves.size() - kLeafPadding) % kUnitFloats != 0) {
      return Fault(bvh_.leaves.size(), " leaf floats are not whole units and ", kLeafPadding,
                   " of padding");
    }
    units_ = bvh_.units();
    if (bvh_.nodes.size() > std::numeric_limits<uint32_t>::max()) {
      return Fault(bvh_.nodes.size(), " nodes are more than can be numbered");
    }
    return absl::OkStatus();
  }

  struct Pending {
    uint32_t node, depth;
  };

  // Checks the nodes; leaves them in order_, parents first.
  absl::Status WalkDown() {
    std::vector<Pending> pending = {{0, 1}};
    unseen_nodes_[0] = false;
    uint32_t deepest = 0;
    while (!pending.empty()) {
      if (order_.size() % kPollNodes == 0) SL_RETURN_IF_ERROR(Stopped());
      const Pending next = pending.back();
      pending.pop_back();
      order_.push_back(next.node);
      deepest = std::max(deepest, next.depth);
      if (next.depth > kMaxBvhDepth) {
        return Fault("node ", next.node, " is at depth ", next.depth, ", beyond ", kMaxBvhDepth);
      }
      const BvhNode& node = bvh_.nodes[next.node];
      if (node.child_count < 1 || node.child_count > kBvhWidth) {
        return Fault("node ", next.node, " has ", node.child_count, " children");
      }
      for (uint32_t slot = 0; slot < kBvhWidth; ++slot) {
        const ChildRef child = node.child[slot];
        if ((slot < node.child_count) == child.is_empty()) {
          return Fault("node ", next.node, " says ", node.child_count, " children, but slot ", slot,
                       child.is_empty() ? " is empty" : " is not");
        }
        if (child.is_empty()) {
          SL_RETURN_IF_ERROR(CheckEmptySlot(next.node, slot));
        } else if (child.is_inner()) {
          const uint32_t below = child.node();
          if (below >= bvh_.nodes.size()) {
            return Fault("node ", next.node, " slot ", slot, " refers to node ", below, " of ",
                         bvh_.nodes.size());
          }
          if (!unseen_nodes_[below]) return Fault("node ", below, " is reached twice");
          unseen_nodes_[below] = false;
          pending.push_back({below, next.depth + 1});
        }
      }
    }
    if (deepest != bvh_.max_depth) {
      return Fault("its depth is ", deepest, ", but it says ", bvh_.max_depth);
    }
    return absl::OkStatus();
  }

  Box3f BoxOf(uint32_t node, uint32_t slot) const {
    const auto& b = bvh_.nodes[node].bounds;
    return {{b[0][slot], b[1][slot], b[2][slot]}, {b[3][slot], b[4][slot], b[5][slot]}};
  }

  absl::Status CheckEmptySlot(uint32_t node, uint32_t slot) const {
    if (BoxOf(node, slot) != Box3f()) {
      return Fault("node ", node, " slot ", slot, " is empty, but its box is not inverted");
    }
    return absl::OkStatus();
  }

  // What a block of nodes has seen in its leaves.
  struct Seen {
    absl::Status fault;  // The first.
    uint64_t leaves = 0, units = 0, triangles = 0;
  };

  // Nearly all of the work, and so in parallel. Blocks mark what they see without agreeing on it:
  // two leaves that hold the same triangle may both take it for unseen. The sums tell then.
  absl::Status CheckLeaves() {
    const size_t nodes = bvh_.nodes.size();
    std::vector<Seen> blocks((nodes + kNodesPerBlock - 1) / kNodesPerBlock);
    ParallelFor(
        nodes, kNodesPerBlock,
        [&](size_t begin, size_t end) {
          Seen& seen = blocks[begin / kNodesPerBlock];
          for (size_t node = begin; node < end && seen.fault.ok(); ++node) {
            const uint32_t count = bvh_.nodes[node].child_count;
            for (uint32_t slot = 0; slot < count && seen.fault.ok(); ++slot) {
              if (!bvh_.nodes[node].child[slot].is_leaf()) continue;
              seen.fault = CheckLeaf(static_cast<uint32_t>(node), slot, &seen);
            }
          }
        },
        cancel_);
    SL_RETURN_IF_ERROR(Stopped());
    for (const Seen& seen : blocks) {
      SL_RETURN_IF_ERROR(seen.fault);
      seen_.leaves += seen.leaves;
      seen_.units += seen.units;
      seen_.triangles += seen.triangles;
    }
    return absl::OkStatus();
  }

  // Marks `flag` as seen; whether it was unseen.
  static bool See(uint8_t& flag) {
    std::atomic_ref<uint8_t> shared(flag);
    if (shared.load(std::memory_order_relaxed) != kUnseen) return false;
    shared.store(kSeen, std::memory_order_relaxed);
    return true;
  }

  absl::Status CheckLeaf(uint32_t node, uint32_t slot, Seen* seen) {
    const ChildRef child = bvh_.nodes[node].child[slot];
    const auto fault = [&](const auto&... args) {
      return Fault("the leaf of node ", node, " slot ", slot, args...);
    };
    const uint64_t unit = child.leaf_unit();
    if (unit + child.leaf_units() > units_) {
      return fault(" needs units ", unit, " to ", unit + child.leaf_units() - 1, " of ", units_);
    }
    for (uint64_t u = unit; u < unit + child.leaf_units(); ++u) {
      if (!See(units_seen_[u])) return fault(" shares unit ", u, " with another");
    }
    ++seen->leaves;
    seen->units += child.leaf_units();
    seen->triangles += child.leaf_count();
    const uint32_t lanes = kUnitTriangles * child.leaf_units();
    const bool has_rows = bvh_.has_leaf_rows();
    const float* const rows = has_rows ? &bvh_.leaves[unit * kUnitFloats] : nullptr;
    Box3f box;
    uint32_t previous = 0;
    for (uint32_t lane = 0; lane < lanes; ++lane) {
      const uint32_t id = has_rows ? std::bit_cast<uint32_t>(rows[9 * lanes + lane])
                                   : bvh_.leaf_ids[unit * kUnitTriangles + lane];
      std::array<Vec3f, 3> corners{};
      if (lane < child.leaf_count()) {
        if (id >= triangles_.size()) {
          return fault(" holds triangle ", id, " of ", triangles_.size());
        }
        if (lane > 0 && id < previous) return fault(" does not hold its ids in order");
        if (!See(triangles_[id])) {
          return fault(" holds triangle ", id, ", which is inert or stands in a leaf already");
        }
        previous = id;
        corners = geometry_.Corners(id);
        for (const Vec3f& corner : corners) box.Extend(corner);
      } else if (id != kNoTriangle) {
        return fault(" has triangle ", id, " in unused lane ", lane);
      }
      for (int row = 0; has_rows && row < 9; ++row) {
        const float stored = corners[row / 3][row % 3];
        if (std::bit_cast<uint32_t>(rows[row * lanes + lane]) != std::bit_cast<uint32_t>(stored)) {
          return fault(" has another coordinate in row ", row, " lane ", lane, " than triangle ",
                       id, " stores");
        }
      }
    }
    if (box != BoxOf(node, slot)) return fault(" has a box that is not its triangles'");
    boxes_[node].Extend(box);
    return absl::OkStatus();
  }

  absl::Status CheckAllSeen() const {
    const auto unit = std::find(units_seen_.begin(), units_seen_.end(), kUnseen);
    if (unit != units_seen_.end()) {
      return Fault("leaf unit ", unit - units_seen_.begin(), " is never reached");
    }
    const auto triangle = std::find(triangles_.begin(), triangles_.end(), kUnseen);
    if (triangle != triangles_.end()) {
      return Fault("triangle ", triangle - triangles_.begin(), " stands in no leaf");
    }
    if (seen_.units != units_ || seen_.triangles != bvh_.triangle_count) {
      return Fault("its leaves hold ", seen_.units, " units and ", seen_.triangles,
                   " triangles, but there are ", units_, " and ", bvh_.triangle_count,
                   ": some stand in two leaves");
    }
    if (seen_.leaves != bvh_.leaf_count) {
      return Fault("it has ", seen_.leaves, " leaves, but says ", bvh_.leaf_count);
    }
    return absl::OkStatus();
  }

  // Children come after their parents in order_, so backwards every box is complete when it is
  // needed.
  absl::Status CheckInnerBoxes() {
    for (size_t i = order_.size(); i-- > 0;) {
      if (i % kPollNodes == 0) SL_RETURN_IF_ERROR(Stopped());
      const uint32_t node = order_[i];
      for (uint32_t slot = 0; slot < bvh_.nodes[node].child_count; ++slot) {
        const ChildRef child = bvh_.nodes[node].child[slot];
        if (!child.is_inner()) continue;
        if (boxes_[child.node()] != BoxOf(node, slot)) {
          return Fault("node ", node, " slot ", slot, " has a box that is not node ", child.node(),
                       "'s");
        }
        boxes_[node].Extend(boxes_[child.node()]);
      }
    }
    if (boxes_[0] != bvh_.bounds) return Fault("its bounds are not its root's");
    return absl::OkStatus();
  }

  absl::Status Stopped() const {
    return cancel_ == nullptr ? absl::OkStatus() : cancel_->ToStatus();
  }

  static constexpr uint8_t kUnseen = 0, kSeen = 1, kInert = 2;
  static constexpr size_t kNodesPerBlock = 256;
  static constexpr size_t kPollNodes = 1 << 14;  // Between two looks at the cancel token.

  const Bvh& bvh_;
  const SceneGeometry& geometry_;
  const CancelToken* const cancel_;
  uint64_t units_ = 0;
  Seen seen_;
  AlignedVector<uint8_t> triangles_, units_seen_;
  std::vector<bool> unseen_nodes_;
  std::vector<uint32_t> order_;
  AlignedVector<Box3f> boxes_;  // Per node: of what has been seen below it.
};

}  // namespace

uint64_t BvhValidationBytes(uint64_t triangles, uint64_t nodes, uint64_t units) {
  // A flag for each triangle and unit; of each node whether it was reached, its place in the order,
  // its box, and a block's share of what is seen in leaves.
  constexpr uint64_t kPerNode = 1 + sizeof(uint32_t) + sizeof(Box3f) + 1;
  return triangles + units + nodes * kPerNode + (64 << 10);
}

absl::Status ValidateBvh(const Bvh& bvh, const SceneGeometry& geometry, const CancelToken* cancel) {
  const ScopedFloatEnvironment environment;
  return Validator(bvh, geometry, cancel).Validate();
}

}  // namespace sightline

// SPDX-License-Identifier: Apache-2.0
#include "core/accel/binary_bvh_validation.h"

#include <algorithm>
#include <vector>

#include "absl/base/attributes.h"
#include "absl/strings/str_cat.h"
#include "core/base/float_environment.h"
#include "core/base/status_macros.h"

namespace sightline {
namespace {

// Nodes between two looks at the cancel token.
constexpr size_t kPoll = 1 << 14;

template <typename... Args>
absl::Status Fault(const Args&... args) {
  return absl::DataLossError(absl::StrCat("binary bvh: ", args...));
}

class Validator {
 public:
  Validator(const BinaryBvh& bvh, const SceneGeometry& geometry, const CancelToken* cancel)
      : bvh_(bvh), geometry_(geometry), cancel_(cancel) {}

  // Not inlined: it computes in its caller's floating-point environment.
  ABSL_ATTRIBUTE_NOINLINE absl::Status Run() {
    const size_t triangles = geometry_.triangles.size() - geometry_.inert.size();
    if (bvh_.ids.size() != triangles) {
      return Fault(bvh_.ids.size(), " ids for ", triangles, " triangles that can be hit");
    }
    if (bvh_.nodes.empty() != (triangles == 0)) {
      return Fault(bvh_.nodes.size(), " nodes over ", triangles, " triangles");
    }
    if (!bvh_.nodes.empty() && bvh_.nodes.size() > 2 * triangles - 1) {
      return Fault(bvh_.nodes.size(), " nodes are more than ", triangles, " triangles can have");
    }
    SL_RETURN_IF_ERROR(CheckLinks());
    SL_RETURN_IF_ERROR(CheckLeaves());
    return CheckBoxes();
  }

 private:
  absl::Status Poll(size_t at) const {
    return at % kPoll == 0 && cancel_ != nullptr ? cancel_->ToStatus() : absl::OkStatus();
  }

  // Forward: a parent stands before its children, so that depths are known when they are met.
  absl::Status CheckLinks() {
    const size_t n = bvh_.nodes.size();
    std::vector<uint32_t> depth(n, kUnreached);
    if (n > 0) depth[0] = 0;
    uint32_t leaves = 0, deepest = 0;
    for (size_t i = 0; i < n; ++i) {
      SL_RETURN_IF_ERROR(Poll(i));
      const BinaryBvhNode& node = bvh_.nodes[i];
      if (depth[i] == kUnreached) return Fault("node ", i, " is never reached");
      if (node.is_leaf()) {
        ++leaves;
        deepest = std::max(deepest, depth[i]);
        continue;
      }
      if (node.first <= i || node.first >= n - 1) {
        return Fault("node ", i, " refers to nodes ", node.first, " and the next, of ", n);
      }
      if (depth[i] >= kMaxBinaryBvhDepth) {
        return Fault("node ", i, " is deeper than ", kMaxBinaryBvhDepth);
      }
      for (const uint32_t child : {node.first, node.first + 1}) {
        if (depth[child] != kUnreached) return Fault("node ", child, " is reached twice");
        depth[child] = depth[i] + 1;
      }
    }
    if (leaves != bvh_.leaf_count || deepest != bvh_.max_depth) {
      return Fault("it says ", bvh_.leaf_count, " leaves and depth ", bvh_.max_depth, ", and has ",
                   leaves, " and ", deepest);
    }
    return absl::OkStatus();
  }

  absl::Status CheckLeaves() {
    std::vector<bool> seen(geometry_.triangles.size());
    for (const uint32_t id : geometry_.inert) seen[id] = true;  // To be in none.
    uint64_t named = 0;
    for (size_t i = 0; i < bvh_.nodes.size(); ++i) {
      SL_RETURN_IF_ERROR(Poll(i));
      const BinaryBvhNode& node = bvh_.nodes[i];
      if (!node.is_leaf()) continue;
      if (node.first > bvh_.ids.size() || node.count > bvh_.ids.size() - node.first) {
        return Fault("leaf ", i, " names ", node.count, " ids from ", node.first, ", of ",
                     bvh_.ids.size());
      }
      named += node.count;
      for (uint32_t k = node.first; k < node.first + node.count; ++k) {
        const uint32_t id = bvh_.ids[k];
        if (id >= seen.size() || seen[id]) {
          return Fault("leaf ", i, " names triangle ", id,
                       ", which is none, never hit, or in another leaf");
        }
        seen[id] = true;
        if (k > node.first && bvh_.ids[k - 1] > id) {
          return Fault("the ids of leaf ", i, " do not ascend");
        }
      }
    }
    if (named != bvh_.ids.size()) {
      return Fault("its leaves name ", named, " of ", bvh_.ids.size(), " ids");
    }
    return absl::OkStatus();
  }

  absl::Status CheckBoxes() const {
    for (size_t i = bvh_.nodes.size(); i-- > 0;) {
      SL_RETURN_IF_ERROR(Poll(i));
      const BinaryBvhNode& node = bvh_.nodes[i];
      Box3f box;
      if (node.is_leaf()) {
        for (uint32_t k = node.first; k < node.first + node.count; ++k) {
          for (const Vec3f corner : geometry_.Corners(bvh_.ids[k])) box.Extend(corner);
        }
      } else {
        box = bvh_.nodes[node.first].box();
        box.Extend(bvh_.nodes[node.first + 1].box());
      }
      if (!(box == node.box()))
        return Fault("the box of node ", i, " is not that of what it holds");
    }
    return absl::OkStatus();
  }

  static constexpr uint32_t kUnreached = 0xFFFFFFFFu;
  const BinaryBvh& bvh_;
  const SceneGeometry& geometry_;
  const CancelToken* const cancel_;
};

}  // namespace

absl::Status ValidateBinaryBvh(const BinaryBvh& bvh, const SceneGeometry& geometry,
                               const CancelToken* cancel) {
  const ScopedFloatEnvironment environment;
  return Validator(bvh, geometry, cancel).Run();
}

}  // namespace sightline

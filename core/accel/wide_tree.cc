// SPDX-License-Identifier: Apache-2.0
#include "core/accel/wide_tree.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <limits>
#include <vector>

#include "absl/strings/str_cat.h"
#include "core/base/check.h"
#include "core/base/parallel.h"

namespace sightline::bvh_build {
namespace {

static_assert(kWidth == kBvhWidth);
constexpr size_t kLeafGrain = 256;  // Leaves, some 10 KB of rows each four.

class Gatherer {
 public:
  Gatherer(BinaryTree& tree, const SceneGeometry& geometry, const CancelToken* cancel)
      : tree_(tree), geometry_(geometry), cancel_(cancel) {}

  absl::StatusOr<Bvh> Gather() {
    GatherNodes();
    if (units_ > uint64_t{ChildRef::kMaxUnit} + 1) {
      return absl::ResourceExhaustedError(
          absl::StrCat("the BVH would need ", units_, " leaf units of four triangles; at most ",
                       uint64_t{ChildRef::kMaxUnit} + 1, " can be numbered: split the scene"));
    }
    bvh_.nodes.shrink_to_fit();
    bvh_.leaf_count = static_cast<uint32_t>(leaves_.size());
    bvh_.triangle_count = tree_.nodes[0].count;
    const BinaryNode& root = tree_.nodes[0];
    bvh_.bounds = {{root.lo[0], root.lo[1], root.lo[2]}, {root.hi[0], root.hi[1], root.hi[2]}};
    bvh_.leaves.ResizeUninitialized(units_ * kUnitFloats + kLeafPadding);
    std::fill_n(bvh_.leaves.end() - kLeafPadding, kLeafPadding, 0.0f);
    ParallelFor(
        leaves_.size(), kLeafGrain,
        [this](size_t begin, size_t end) {
          for (size_t i = begin; i < end; ++i) FillLeaf(leaves_[i]);
        },
        cancel_);
    return std::move(bvh_);
  }

 private:
  struct PendingNode {
    uint32_t binary;  // Its place in the binary tree.
    uint32_t parent, slot;
    uint32_t depth;
  };
  struct Leaf {
    uint64_t unit;
    uint32_t first, count;  // In the tree's ids.
  };
  struct Children {
    uint32_t binary[kBvhWidth];
    int count = 0;
  };

  // Adds what represents the subtree of `node` by at most `slots` children.
  void Open(uint32_t node, int slots, Children& children) const {
    const BinaryNode& n = tree_.nodes[node];
    if (!n.wide.is_binary_leaf()) {
      while (slots > 1 && n.wide.LeftChildren(slots) == 0) --slots;
      if (slots > 1) return OpenBoth(node, slots, children);
    }
    children.binary[children.count++] = node;
  }
  void OpenBoth(uint32_t node, int slots, Children& children) const {
    const BinaryNode& n = tree_.nodes[node];
    const int left = n.wide.LeftChildren(slots);
    Open(n.first, left, children);
    Open(n.first + 1, slots - left, children);
  }

  void GatherNodes() {
    constexpr uint32_t kNone = std::numeric_limits<uint32_t>::max();
    std::vector<PendingNode> pending = {{0, kNone, 0, 1}};
    while (!pending.empty()) {
      const PendingNode next = pending.back();
      pending.pop_back();
      const uint32_t index = static_cast<uint32_t>(bvh_.nodes.size());
      if (next.parent != kNone) bvh_.nodes[next.parent].child[next.slot] = ChildRef::Inner(index);
      bvh_.max_depth = std::max(bvh_.max_depth, next.depth);
      Children children;
      // Only the root can be a leaf here: a node over that leaf alone.
      if (tree_.nodes[next.binary].wide.is_leaf()) {
        children.binary[children.count++] = next.binary;
      } else {
        OpenBoth(next.binary, kBvhWidth, children);
      }
      bvh_.nodes.push_back(MakeNode(children));
      for (int slot = children.count - 1; slot >= 0; --slot) {
        const uint32_t child = children.binary[slot];
        if (!tree_.nodes[child].wide.is_leaf()) {
          pending.push_back({child, index, static_cast<uint32_t>(slot), next.depth + 1});
        }
      }
    }
  }

  // Boxes of all children, references to the leaves.
  BvhNode MakeNode(const Children& children) {
    BvhNode node;
    node.child_count = static_cast<uint32_t>(children.count);
    for (int slot = 0; slot < kBvhWidth; ++slot) {
      const bool used = slot < children.count;
      const BinaryNode* const child = used ? &tree_.nodes[children.binary[slot]] : nullptr;
      for (int axis = 0; axis < 3; ++axis) {
        constexpr float kInfinity = std::numeric_limits<float>::infinity();
        node.bounds[axis][slot] = used ? child->lo[axis] : kInfinity;
        node.bounds[axis + 3][slot] = used ? child->hi[axis] : -kInfinity;
      }
      if (!used || !child->wide.is_leaf()) continue;
      // Unit numbers beyond 27 bits are cut here and refused by Gather.
      node.child[slot] = ChildRef::Leaf(
          static_cast<uint32_t>(std::min<uint64_t>(units_, ChildRef::kMaxUnit)), child->count);
      leaves_.push_back({units_, FirstId(*child), child->count});
      units_ += node.child[slot].leaf_units();
    }
    return node;
  }

  uint32_t FirstId(const BinaryNode& subtree) const {
    const BinaryNode* node = &subtree;
    while (!node->wide.is_binary_leaf()) node = &tree_.nodes[node->first];
    return node->first;
  }

  void FillLeaf(const Leaf& leaf) {
    uint32_t* const ids = &tree_.ids[leaf.first];
    std::sort(ids, ids + leaf.count);
    const uint32_t lanes = (leaf.count + kUnitTriangles - 1) / kUnitTriangles * kUnitTriangles;
    float* const rows = &bvh_.leaves[leaf.unit * kUnitFloats];
    for (uint32_t lane = 0; lane < lanes; ++lane) {
      std::array<Vec3f, 3> corners{};
      uint32_t id = kNoTriangle;
      if (lane < leaf.count) {
        id = ids[lane];
        corners = geometry_.Corners(id);
      }
      for (int corner = 0; corner < 3; ++corner) {
        for (int axis = 0; axis < 3; ++axis) {
          rows[(3 * corner + axis) * lanes + lane] = corners[corner][axis];
        }
      }
      rows[9 * lanes + lane] = std::bit_cast<float>(id);
    }
  }

  BinaryTree& tree_;
  const SceneGeometry& geometry_;
  const CancelToken* const cancel_;
  std::vector<Leaf> leaves_;
  uint64_t units_ = 0;
  Bvh bvh_;
};

}  // namespace

absl::StatusOr<Bvh> GatherWideTree(BinaryTree& tree, const SceneGeometry& geometry,
                                   const CancelToken* cancel) {
  return Gatherer(tree, geometry, cancel).Gather();
}

}  // namespace sightline::bvh_build

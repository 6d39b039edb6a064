// SPDX-License-Identifier: Apache-2.0
#include "core/accel/wide_tree.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "core/accel/leaf_rows.h"
#include "core/base/check.h"
#include "core/base/parallel.h"

namespace sightline::bvh_build {
namespace {

static_assert(kWidth == kBvhWidth);
// Subtrees of up to this many triangles are gathered by one task each. Depends on the tree alone,
// and the result not even on that.
constexpr uint32_t kPieceTriangles = 1 << 13;
constexpr uint32_t kNone = std::numeric_limits<uint32_t>::max();

struct Leaf {
  uint64_t unit;
  uint32_t first, count;  // In the tree's ids.
};

// Where something hangs in the tree.
struct Place {
  uint32_t binary;        // In the binary tree.
  uint32_t parent, slot;  // kNone at the top.
  uint32_t depth;
};

// Nodes in depth-first order and the leaves that hang in them, both numbered from 0.
class Piece {
 public:
  explicit Piece(const BinaryTree& tree) : tree_(&tree) {}

  // Appends the node at `place` and tells its parent, if that is in this piece. What hangs below
  // it and is no leaf goes to `pending`, the first of it last.
  void AddNode(const Place& place, std::vector<Place>& pending) {
    const uint32_t index = static_cast<uint32_t>(nodes.size());
    if (place.parent != kNone) nodes[place.parent].child[place.slot] = ChildRef::Inner(index);
    max_depth = std::max(max_depth, place.depth);
    Children children;
    // Only the root can be a leaf here: a node over that leaf alone.
    if (tree_->nodes[place.binary].wide.is_leaf()) {
      children.binary[children.count++] = place.binary;
    } else {
      OpenBoth(place.binary, kBvhWidth, children);
      SortByCost(children);
    }
    nodes.push_back(MakeNode(children));
    for (int slot = children.count - 1; slot >= 0; --slot) {
      const uint32_t child = children.binary[slot];
      if (!tree_->nodes[child].wide.is_leaf()) {
        pending.push_back({child, index, static_cast<uint32_t>(slot), place.depth + 1});
      }
    }
  }

  // The whole subtree, of which nothing hangs elsewhere.
  void AddSubtree(const Place& place) {
    std::vector<Place> pending = {{place.binary, kNone, 0, place.depth}};
    while (!pending.empty()) {
      const Place next = pending.back();
      pending.pop_back();
      AddNode(next, pending);
    }
  }

  AlignedVector<BvhNode> nodes;
  std::vector<Leaf> leaves;
  uint64_t units = 0;
  uint32_t max_depth = 0;

 private:
  struct Children {
    uint32_t binary[kBvhWidth];
    int count = 0;
  };

  // Adds what represents the subtree of `node` by at most `slots` children.
  void Open(uint32_t node, int slots, Children& children) const {
    const BinaryNode& n = tree_->nodes[node];
    if (!n.wide.is_binary_leaf()) {
      while (slots > 1 && n.wide.LeftChildren(slots) == 0) --slots;
      if (slots > 1) return OpenBoth(node, slots, children);
    }
    children.binary[children.count++] = node;
  }
  void OpenBoth(uint32_t node, int slots, Children& children) const {
    const BinaryNode& n = tree_->nodes[node];
    const int left = n.wide.LeftChildren(slots);
    Open(n.first, left, children);
    Open(n.first + 1, slots - left, children);
  }

  // The cheapest last: walks for any hit take the last child first, and of two that may both hold
  // one the cheaper is the better to begin with (core/traverse/EXPERIMENTS.md). Those of one cost
  // stay as they are.
  void SortByCost(Children& children) const {
    for (int i = 1; i < children.count; ++i) {
      const uint32_t child = children.binary[i];
      const float cost = tree_->nodes[child].wide.cost();
      int at = i;
      for (; at > 0 && tree_->nodes[children.binary[at - 1]].wide.cost() < cost; --at) {
        children.binary[at] = children.binary[at - 1];
      }
      children.binary[at] = child;
    }
  }

  // Boxes of all children, references to the leaves.
  BvhNode MakeNode(const Children& children) {
    BvhNode node;
    node.child_count = static_cast<uint32_t>(children.count);
    for (int slot = 0; slot < kBvhWidth; ++slot) {
      const bool used = slot < children.count;
      const BinaryNode* const child = used ? &tree_->nodes[children.binary[slot]] : nullptr;
      for (int axis = 0; axis < 3; ++axis) {
        constexpr float kInfinity = std::numeric_limits<float>::infinity();
        node.bounds[axis][slot] = used ? child->lo[axis] : kInfinity;
        node.bounds[axis + 3][slot] = used ? child->hi[axis] : -kInfinity;
      }
      if (!used || !child->wide.is_leaf()) continue;
      // Unit numbers beyond 27 bits are cut here and refused by the gatherer.
      node.child[slot] = ChildRef::Leaf(
          static_cast<uint32_t>(std::min<uint64_t>(units, ChildRef::kMaxUnit)), child->count);
      leaves.push_back({units, FirstId(*child), child->count});
      units += node.child[slot].leaf_units();
    }
    return node;
  }

  uint32_t FirstId(const BinaryNode& subtree) const {
    const BinaryNode* node = &subtree;
    while (!node->wide.is_binary_leaf()) node = &tree_->nodes[node->first];
    return node->first;
  }

  const BinaryTree* tree_;
};

// A node at the top, or a piece below: in depth-first order.
struct Part {
  uint32_t node;   // The top's node, or the top's node in which the piece hangs.
  uint32_t slot;   // Of the piece in that node.
  uint32_t piece;  // kNone for a node at the top.
  uint64_t first_node = 0, first_unit = 0;
};

class Gatherer {
 public:
  Gatherer(BinaryTree& tree, const SceneGeometry& geometry, bool leaf_rows,
           const CancelToken* cancel)
      : tree_(tree), geometry_(geometry), leaf_rows_(leaf_rows), cancel_(cancel), top_(tree) {}

  absl::StatusOr<Bvh> Gather() {
    GatherTop();
    ParallelFor(
        pieces_.size(), 1,
        [this](size_t begin, size_t end) {
          for (size_t i = begin; i < end; ++i) pieces_[i].AddSubtree(places_[i]);
        },
        cancel_);
    if (cancel_ != nullptr && cancel_->cancelled()) return Bvh{};
    NumberParts();
    if (units_ > uint64_t{ChildRef::kMaxUnit} + 1) {
      return absl::ResourceExhaustedError(
          absl::StrCat("the BVH would need ", units_, " leaf units of four triangles; at most ",
                       uint64_t{ChildRef::kMaxUnit} + 1, " can be numbered: split the scene"));
    }
    const BinaryNode& root = tree_.nodes[0];
    bvh_.bounds = {{root.lo[0], root.lo[1], root.lo[2]}, {root.hi[0], root.hi[1], root.hi[2]}};
    bvh_.triangle_count = root.count;
    bvh_.leaf_count = static_cast<uint32_t>(top_.leaves.size());
    bvh_.max_depth = top_.max_depth;
    for (const Piece& piece : pieces_) {
      bvh_.leaf_count += static_cast<uint32_t>(piece.leaves.size());
      bvh_.max_depth = std::max(bvh_.max_depth, piece.max_depth);
    }
    bvh_.nodes.ResizeUninitialized(nodes_);
    if (leaf_rows_) {
      bvh_.leaves.ResizeUninitialized(units_ * kUnitFloats + kLeafPadding);
      std::fill_n(bvh_.leaves.end() - kLeafPadding, kLeafPadding, 0.0f);
    } else {
      bvh_.leaf_ids.ResizeUninitialized(units_ * kUnitTriangles);
    }
    ParallelFor(
        parts_.size(), 1,
        [this](size_t begin, size_t end) {
          for (size_t i = begin; i < end; ++i) SetPart(parts_[i]);
        },
        cancel_);
    return std::move(bvh_);
  }

 private:
  // The nodes over more than a piece's triangles; what is below them goes to places_.
  void GatherTop() {
    std::vector<Place> pending = {{0, kNone, 0, 1}};
    while (!pending.empty()) {
      const Place next = pending.back();
      pending.pop_back();
      if (tree_.nodes[next.binary].count <= kPieceTriangles) {
        parts_.push_back({.node = next.parent,
                          .slot = next.slot,
                          .piece = static_cast<uint32_t>(places_.size())});
        places_.push_back(next);
      } else {
        parts_.push_back({.node = static_cast<uint32_t>(top_.nodes.size()), .piece = kNone});
        top_.AddNode(next, pending);
      }
    }
    pieces_.assign(places_.size(), Piece(tree_));
  }

  // Gives every part its first node and unit, and ties pieces to their parents.
  void NumberParts() {
    std::vector<uint64_t> index_of_top(top_.nodes.size());
    for (Part& part : parts_) {
      part.first_node = nodes_;
      part.first_unit = units_;
      if (part.piece == kNone) {
        index_of_top[part.node] = nodes_++;
        for (const ChildRef child : top_.nodes[part.node].child) {
          if (child.is_leaf()) units_ += child.leaf_units();
        }
      } else {
        nodes_ += pieces_[part.piece].nodes.size();
        units_ += pieces_[part.piece].units;
      }
    }
    for (BvhNode& node : top_.nodes) {
      for (ChildRef& child : node.child) {
        if (child.is_inner()) {
          child = ChildRef::Inner(static_cast<uint32_t>(index_of_top[child.node()]));
        }
      }
    }
    for (const Part& part : parts_) {
      if (part.piece == kNone || part.node == kNone) continue;
      top_.nodes[part.node].child[part.slot] =
          ChildRef::Inner(static_cast<uint32_t>(part.first_node));
    }
  }

  void SetPart(const Part& part) {
    if (part.piece == kNone) return SetTopNode(part);
    const Piece& piece = pieces_[part.piece];
    BvhNode* const nodes = &bvh_.nodes[part.first_node];
    for (size_t i = 0; i < piece.nodes.size(); ++i) {
      nodes[i] = piece.nodes[i];
      for (ChildRef& child : nodes[i].child) {
        if (child.is_leaf()) {
          child = ChildRef::Leaf(static_cast<uint32_t>(part.first_unit + child.leaf_unit()),
                                 child.leaf_count());
        } else if (child.is_inner()) {
          child = ChildRef::Inner(static_cast<uint32_t>(part.first_node + child.node()));
        }
      }
    }
    for (const Leaf& leaf : piece.leaves) SetLeaf(leaf, part.first_unit + leaf.unit);
  }

  // Its leaves are some of the top's, which are in the order of the top's nodes.
  void SetTopNode(const Part& part) {
    BvhNode& node = bvh_.nodes[part.first_node];
    node = top_.nodes[part.node];
    uint64_t unit = part.first_unit;
    for (ChildRef& child : node.child) {
      if (!child.is_leaf()) continue;
      const auto leaf =
          std::lower_bound(top_.leaves.begin(), top_.leaves.end(), child.leaf_unit(),
                           [](const Leaf& l, uint64_t wanted) { return l.unit < wanted; });
      SetLeaf(*leaf, unit);
      child = ChildRef::Leaf(static_cast<uint32_t>(unit), child.leaf_count());
      unit += child.leaf_units();
    }
  }

  void SetLeaf(const Leaf& leaf, uint64_t unit) {
    const std::span<uint32_t> ids(&tree_.ids[leaf.first], leaf.count);
    if (!std::is_sorted(ids.begin(), ids.end())) std::sort(ids.begin(), ids.end());
    const size_t lanes = (ids.size() + kUnitTriangles - 1) / kUnitTriangles * kUnitTriangles;
    if (leaf_rows_) {
      WriteLeafRows(geometry_, ids, lanes, &bvh_.leaves[unit * kUnitFloats]);
    } else {
      uint32_t* const out = &bvh_.leaf_ids[unit * kUnitTriangles];
      std::fill(std::copy(ids.begin(), ids.end(), out), out + lanes, kNoTriangle);
    }
  }

  BinaryTree& tree_;
  const SceneGeometry& geometry_;
  const bool leaf_rows_;
  const CancelToken* const cancel_;
  Piece top_;
  std::vector<Piece> pieces_;
  std::vector<Place> places_;  // By piece.
  std::vector<Part> parts_;    // In depth-first order.
  uint64_t nodes_ = 0, units_ = 0;
  Bvh bvh_;
};

}  // namespace

absl::StatusOr<Bvh> GatherWideTree(BinaryTree& tree, const SceneGeometry& geometry, bool leaf_rows,
                                   const CancelToken* cancel) {
  return Gatherer(tree, geometry, leaf_rows, cancel).Gather();
}

}  // namespace sightline::bvh_build

// SPDX-License-Identifier: Apache-2.0
#include "core/accel/kd_validation.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <span>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "core/accel/kd_clip.h"
#include "core/base/parallel.h"
#include "core/base/status_macros.h"

namespace sightline {
namespace {

template <typename... Args>
absl::Status Fault(const Args&... args) {
  return absl::DataLossError(absl::StrCat("invalid kd-tree: ", args...));
}

bool Contains(const Box3f& outer, const Box3f& inner) {
  for (int axis = 0; axis < 3; ++axis) {
    if (!(outer.lo[axis] <= inner.lo[axis] && inner.hi[axis] <= outer.hi[axis])) return false;
  }
  return true;
}

class Validator {
 public:
  Validator(const KdTree& tree, const SceneGeometry& geometry, const CancelToken* cancel)
      : tree_(tree), geometry_(geometry), cancel_(cancel) {}

  absl::Status Validate() {
    const size_t live = geometry_.triangles.size() - geometry_.inert.size();
    if (tree_.triangle_count != live) {
      return Fault("it counts ", tree_.triangle_count, " triangles, the geometry ", live);
    }
    if (tree_.nodes.empty()) return ValidateEmpty();
    if (live == 0) return Fault("it has nodes, but the geometry no triangles");
    if (tree_.nodes.size() > KdNode::kMaxIndex || tree_.leaves.size() > KdNode::kMaxIndex) {
      return Fault("it has more nodes or leaves than can be numbered");
    }
    if (tree_.perfect() && tree_.reach.size() != tree_.nodes.size()) {
      return Fault(tree_.reach.size(), " reaches for ", tree_.nodes.size(), " nodes");
    }
    inert_.assign(geometry_.triangles.size(), false);
    for (uint32_t id : geometry_.inert) inert_[id] = true;
    SL_RETURN_IF_ERROR(CheckBounds());
    SL_RETURN_IF_ERROR(Stopped());
    SL_RETURN_IF_ERROR(WalkDown());
    SL_RETURN_IF_ERROR(CheckReferences());
    return CheckReach();
  }

 private:
  absl::Status ValidateEmpty() const {
    if (tree_.triangle_count != 0 || !tree_.leaves.empty() || !tree_.ids.empty() ||
        !tree_.reach.empty() || tree_.max_depth != 0 || !tree_.bounds.empty()) {
      return Fault("it has no nodes, but triangles, leaves, a depth or bounds");
    }
    return absl::OkStatus();
  }

  absl::Status CheckBounds() const {
    Box3f bounds;
    for (size_t id = 0; id < inert_.size(); ++id) {
      if (!inert_[id]) bounds.Extend(BoxOf(static_cast<uint32_t>(id)));
    }
    if (bounds != tree_.bounds) return Fault("its bounds are not its triangles'");
    return absl::OkStatus();
  }

  Box3f BoxOf(uint32_t id) const {
    Box3f box;
    for (const Vec3f& corner : geometry_.Corners(id)) box.Extend(corner);
    return box;
  }

  struct Pending {
    uint32_t node, depth;
    Box3f cell;
  };

  // Checks the nodes, depth-first with the lower child before the upper one, and the leaves'
  // ranges.
  absl::Status WalkDown() {
    std::vector<bool> unseen(tree_.nodes.size(), true);
    std::vector<Pending> pending = {{0, 0, tree_.bounds}};
    uint32_t deepest = 0, leaves = 0;
    uint64_t ids = 0;
    while (!pending.empty()) {
      const Pending next = pending.back();
      pending.pop_back();
      if (order_.size() % kPollNodes == 0) SL_RETURN_IF_ERROR(Stopped());
      if (!unseen[next.node]) return Fault("node ", next.node, " is reached twice");
      unseen[next.node] = false;
      order_.push_back(next.node);
      deepest = std::max(deepest, next.depth);
      const KdNode node = tree_.nodes[next.node];
      if (node.is_empty_leaf()) continue;
      if (node.is_leaf()) {
        if (node.leaf() != leaves || leaves >= tree_.leaves.size()) {
          return Fault("node ", next.node, " has leaf ", node.leaf(), " of ", tree_.leaves.size(),
                       " where leaf ", leaves, " comes next");
        }
        SL_RETURN_IF_ERROR(CheckLeaf(leaves, next.cell, &ids));
        ++leaves;
        continue;
      }
      if (next.depth >= kMaxKdDepth) {
        return Fault("node ", next.node, " is an inner node at depth ", next.depth + 1, ", beyond ",
                     kMaxKdDepth);
      }
      const int axis = node.axis();
      if (!(node.split() > next.cell.lo[axis] && node.split() < next.cell.hi[axis])) {
        return Fault("node ", next.node, " splits axis ", axis, " at ", node.split(),
                     ", not within its cell of ", next.cell.lo[axis], " .. ", next.cell.hi[axis]);
      }
      const uint64_t child = node.first_child();
      if (child + 1 >= tree_.nodes.size()) {
        return Fault("node ", next.node, " refers to nodes ", child, " and ", child + 1, " of ",
                     tree_.nodes.size());
      }
      Pending below = {static_cast<uint32_t>(child), next.depth + 1, next.cell};
      Pending above = {static_cast<uint32_t>(child) + 1, next.depth + 1, next.cell};
      below.cell.hi[axis] = above.cell.lo[axis] = node.split();
      pending.push_back(above);
      pending.push_back(below);
    }
    for (size_t i = 0; i < unseen.size(); ++i) {
      if (unseen[i]) return Fault("node ", i, " is never reached");
    }
    if (leaves != tree_.leaves.size()) return Fault("leaf ", leaves, " is never reached");
    if (ids != tree_.ids.size()) {
      return Fault("its leaves hold ", ids, " ids of ", tree_.ids.size());
    }
    if (deepest != tree_.max_depth) {
      return Fault("its depth is ", deepest, ", but it says ", tree_.max_depth);
    }
    return absl::OkStatus();
  }

  absl::Status CheckLeaf(uint32_t index, const Box3f& cell, uint64_t* ids) const {
    const KdLeaf& leaf = tree_.leaves[index];
    if (leaf.first != *ids || leaf.count == 0 || leaf.count > tree_.ids.size() - *ids) {
      return Fault("leaf ", index, " has ids ", leaf.first, " and ", leaf.count, " more of ",
                   tree_.ids.size(), " where id ", *ids, " comes next");
    }
    *ids += leaf.count;
    const Box3f box = leaf.box();
    if (box.empty() || !Contains(cell, box)) {
      return Fault("leaf ", index, " has a box that is not within its cell");
    }
    Box3f hull;
    for (uint32_t i = 0; i < leaf.count; ++i) {
      const uint32_t id = tree_.ids[leaf.first + i];
      if (id >= inert_.size()) {
        return Fault("leaf ", index, " holds triangle ", id, " of ", inert_.size());
      }
      if (inert_[id]) return Fault("leaf ", index, " holds triangle ", id, ", which is inert");
      if (i > 0 && id <= tree_.ids[leaf.first + i - 1]) {
        return Fault("leaf ", index, " does not hold its ids in order");
      }
      hull.Extend(CutTo(cell, BoxOf(id)));
    }
    // With perfect splits it may be smaller.
    if (tree_.perfect() ? !Contains(hull, box) : box != hull) {
      return Fault("leaf ", index, " has a box that is not its triangles'");
    }
    return absl::OkStatus();
  }

  static Box3f CutTo(const Box3f& cell, const Box3f& box) {
    Box3f cut;
    for (int axis = 0; axis < 3; ++axis) {
      cut.lo[axis] = std::max(cell.lo[axis], box.lo[axis]);
      cut.hi[axis] = std::min(cell.hi[axis], box.hi[axis]);
    }
    return cut;
  }

  // A triangle on its way down, as far as it reaches into the cell.
  struct Reference {
    uint32_t id;
    bool flat;  // It lies in the plane of a split above, and may stand on the other side alone.
    Box3f box;
  };
  using References = std::vector<Reference>;
  struct Subtree {
    uint32_t node;
    References references;
  };

  // Sends every triangle down to the leaves it must stand in, and looks for it there: subtree by
  // subtree, in parallel.
  absl::Status CheckReferences() {
    std::vector<Subtree> subtrees(1), cut;
    subtrees[0].node = 0;
    for (size_t id = 0; id < inert_.size(); ++id) {
      if (inert_[id]) continue;
      const auto triangle = static_cast<uint32_t>(id);
      subtrees[0].references.push_back({triangle, false, BoxOf(triangle)});
    }
    marks_.assign(inert_.size(), 0);
    while (!subtrees.empty()) {
      SL_RETURN_IF_ERROR(Stopped());
      Subtree next = std::move(subtrees.back());
      subtrees.pop_back();
      const KdNode node = tree_.nodes[next.node];
      if (node.is_leaf() || next.references.size() <= kSubtreeReferences) {
        cut.push_back(std::move(next));
        continue;
      }
      for (uint32_t side = 0; side < 2; ++side) {
        Subtree child = {node.first_child() + side, {}};
        for (const Reference& reference : next.references) {
          Reference part = reference;
          if (GoesDown(node, side, &part)) child.references.push_back(part);
        }
        subtrees.push_back(std::move(child));
      }
    }
    std::vector<absl::Status> faults(cut.size());
    ParallelFor(
        cut.size(), 1,
        [&](size_t begin, size_t end) {
          for (size_t i = begin; i < end; ++i) {
            faults[i] = CheckSubtree(cut[i].node, &cut[i].references, 0);
            cut[i].references = {};
          }
        },
        cancel_);
    SL_RETURN_IF_ERROR(Stopped());
    for (const absl::Status& fault : faults) SL_RETURN_IF_ERROR(fault);
    if (half_flat_ != kNoTriangle) {
      return Fault("triangle ", half_flat_.load(),
                   " lies in a split and, on either side of it, not in all leaves it reaches");
    }
    for (size_t id = 0; id < marks_.size(); ++id) {
      if (marks_[id] == kFlat) return Fault("triangle ", id, " lies in a split and in no leaf");
    }
    return absl::OkStatus();
  }

  absl::Status Stopped() const {
    return cancel_ == nullptr ? absl::OkStatus() : cancel_->ToStatus();
  }

  // Whether the triangle reaches into the lower (0) or upper (1) child, and then how far.
  bool GoesDown(KdNode node, uint32_t side, Reference* reference) {
    const int axis = node.axis();
    const float at = node.split();
    float& lo = reference->box.lo[axis];
    float& hi = reference->box.hi[axis];
    if (lo == at && hi == at) {
      // Below the first such plane it stands on one side of it, wherever it reaches.
      if (!reference->flat && side == 0 && !StandsBelow(node.first_child(), *reference) &&
          !StandsBelow(node.first_child() + 1, *reference)) {
        half_flat_.store(reference->id, std::memory_order_relaxed);
      }
      reference->flat = true;
      Add(kFlat, reference->id);
      return true;
    }
    if (side == 0 ? !(lo < at) : !(hi > at)) return false;
    (side == 0 ? hi : lo) = side == 0 ? std::min(hi, at) : std::max(lo, at);
    return true;
  }

  // Whether all leaves below that the triangle reaches into name it, of the two sides of a plane
  // that it lies in those of one. Once cancelled, true: nobody asks any more.
  bool StandsBelow(uint32_t at, const Reference& reference) const {
    if (cancel_ != nullptr && cancel_->cancelled()) return true;
    const KdNode node = tree_.nodes[at];
    if (node.is_leaf()) {
      if (!MustStand(reference)) return true;
      if (node.is_empty_leaf()) return false;
      const auto ids = tree_.LeafIds(tree_.leaves[node.leaf()]);
      return std::binary_search(ids.begin(), ids.end(), reference.id);
    }
    const int axis = node.axis();
    const float split = node.split();
    const float lo = reference.box.lo[axis], hi = reference.box.hi[axis];
    if (lo == split && hi == split) {
      return StandsBelow(node.first_child(), reference) ||
             StandsBelow(node.first_child() + 1, reference);
    }
    Reference lower = reference, upper = reference;
    lower.box.hi[axis] = std::min(hi, split);
    upper.box.lo[axis] = std::max(lo, split);
    return (!(lo < split) || StandsBelow(node.first_child(), lower)) &&
           (!(hi > split) || StandsBelow(node.first_child() + 1, upper));
  }

  // Of the references from `first` on, which are taken away again. The way down is no longer than
  // kMaxKdDepth: WalkDown has seen to that.
  absl::Status CheckSubtree(uint32_t at, References* references, size_t first) {
    const KdNode node = tree_.nodes[at];
    if (node.is_leaf()) return CheckLeafReferences(node, at, std::span(*references).subspan(first));
    if (cancel_ != nullptr && cancel_->cancelled()) return cancel_->ToStatus();
    const size_t end = references->size();
    for (uint32_t side = 0; side < 2; ++side) {
      for (size_t i = first; i < end; ++i) {
        Reference part = (*references)[i];
        if (GoesDown(node, side, &part)) references->push_back(part);
      }
      SL_RETURN_IF_ERROR(CheckSubtree(node.first_child() + side, references, end));
      references->resize(end);
    }
    return absl::OkStatus();
  }

  // Marks are added, by several threads at once.
  enum Mark : uint8_t { kFlat = 1, kFound = 2 };
  void Add(Mark mark, uint32_t id) {
    std::atomic_ref<uint8_t> marks(marks_[id]);
    if ((marks.load(std::memory_order_relaxed) & mark) == 0) {
      marks.fetch_or(mark, std::memory_order_relaxed);
    }
  }

  absl::Status CheckLeafReferences(KdNode node, uint32_t at,
                                   std::span<const Reference> references) {
    std::span<const uint32_t> ids;
    if (!node.is_empty_leaf()) ids = tree_.LeafIds(tree_.leaves[node.leaf()]);
    size_t found = 0;
    for (const Reference& reference : references) {
      const bool stands = std::binary_search(ids.begin(), ids.end(), reference.id);
      found += stands;
      if (stands && !HoldsPart(tree_.leaves[node.leaf()].box(), reference)) {
        return Fault("the leaf of node ", at, " has a box that does not hold triangle ",
                     reference.id);
      }
      if (stands) {
        Add(kFound, reference.id);
      } else if (!reference.flat && MustStand(reference)) {
        return Fault("triangle ", reference.id, " reaches into the cell of node ", at,
                     " and does not stand in its leaf");
      }
    }
    if (found != ids.size()) {
      return Fault("the leaf of node ", at, " holds ", ids.size() - found,
                   " triangles that do not reach into its cell");
    }
    return absl::OkStatus();
  }

  // Whether a leaf's box holds what of the triangle lies in its cell.
  bool HoldsPart(const Box3f& box, const Reference& reference) const {
    return tree_.perfect() ? ClipHolds(geometry_.Corners(reference.id), reference.box, box)
                           : Contains(box, reference.box);
  }

  // With perfect splits, a cell that the triangle's box alone reaches into may leave it out.
  bool MustStand(const Reference& reference) const {
    return !tree_.perfect() || !ClipMisses(geometry_.Corners(reference.id), reference.box);
  }

  // Children come after their parents in order_, so backwards every box is complete when it is
  // needed.
  absl::Status CheckReach() const {
    if (!tree_.perfect()) return absl::OkStatus();
    std::vector<Box3f> reach(tree_.nodes.size());
    for (size_t i = order_.size(); i-- > 0;) {
      const uint32_t at = order_[i];
      const KdNode node = tree_.nodes[at];
      if (!node.is_leaf()) {
        reach[at].Extend(reach[node.first_child()]);
        reach[at].Extend(reach[node.first_child() + 1]);
      } else if (!node.is_empty_leaf()) {
        for (const uint32_t id : tree_.LeafIds(tree_.leaves[node.leaf()])) {
          reach[at].Extend(BoxOf(id));
        }
      }
      if (reach[at] != tree_.reach[at]) return Fault("node ", at, " has another reach");
    }
    return absl::OkStatus();
  }

  // Subtrees of so many references are one thread's: a few milliseconds.
  static constexpr size_t kSubtreeReferences = 1 << 14;
  static constexpr size_t kPollNodes = 1 << 14;

  const KdTree& tree_;
  const SceneGeometry& geometry_;
  const CancelToken* const cancel_;
  std::vector<uint8_t> marks_;  // By triangle, of Mark.
  // A triangle that stands on no side of a plane that it lies in wherever it reaches.
  std::atomic<uint32_t> half_flat_{kNoTriangle};
  std::vector<bool> inert_;      // By triangle.
  std::vector<uint32_t> order_;  // The nodes, parents first.
};

}  // namespace

absl::Status ValidateKdTree(const KdTree& tree, const SceneGeometry& geometry,
                            const CancelToken* cancel) {
  return Validator(tree, geometry, cancel).Validate();
}

}  // namespace sightline

// SPDX-License-Identifier: Apache-2.0
#include "core/accel/kd_validation.h"

#include <algorithm>
#include <limits>
#include <span>
#include <utility>
#include <vector>

#include "absl/base/attributes.h"
#include "absl/strings/str_cat.h"
#include "core/accel/kd_clip.h"
#include "core/base/float_environment.h"
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

  // Not inlined: it computes in its caller's floating-point environment.
  ABSL_ATTRIBUTE_NOINLINE absl::Status Validate() {
    const size_t live = geometry_.triangles.size() - geometry_.inert.size();
    if (tree_.triangle_count != live) {
      return Fault("it counts ", tree_.triangle_count, " triangles, the geometry ", live);
    }
    if (tree_.nodes.empty()) return ValidateEmpty();
    if (live == 0) return Fault("it has nodes, but the geometry no triangles");
    if (tree_.nodes.size() > KdNode::kMaxIndex || tree_.leaves.size() > KdNode::kMaxIndex ||
        tree_.ids.size() > std::numeric_limits<uint32_t>::max()) {
      return Fault("it has more nodes, leaves or ids than can be numbered");
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
    first_leaf_.assign(tree_.nodes.size(), 0);
    std::vector<Pending> pending = {{0, 0, tree_.bounds}};
    uint32_t deepest = 0, leaves = 0;
    uint64_t ids = 0;
    while (!pending.empty()) {
      const Pending next = pending.back();
      pending.pop_back();
      if (order_.size() % kPollNodes == 0) SL_RETURN_IF_ERROR(Stopped());
      if (!unseen[next.node]) return Fault("node ", next.node, " is reached twice");
      unseen[next.node] = false;
      first_leaf_[next.node] = leaves;
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

  // A triangle on its way down, as far as it reaches into the cell, with a range of stands_: the
  // leaves that name it below the last plane that it was on both sides of. Of these ranges none is
  // empty and no two overlap. So all that are under way at once are no more than the tree's ids,
  // however many cells a triangle reaches into.
  struct Reference {
    uint32_t id;
    uint32_t begin, end;
    Box3f box;
  };
  using References = std::vector<Reference>;
  struct Subtree {
    uint32_t node;
    References references;
  };

  // By triangle, from begins_[id] to begins_[id + 1], the leaves that name it, ascending.
  absl::Status FindLeaves() {
    begins_.assign(inert_.size() + 1, 0);
    for (const uint32_t id : tree_.ids) ++begins_[id + 1];
    for (size_t id = 0; id < inert_.size(); ++id) begins_[id + 1] += begins_[id];
    SL_RETURN_IF_ERROR(Stopped());
    stands_.resize(tree_.ids.size());
    std::vector<uint32_t> next(begins_.begin(), begins_.end() - 1);
    for (size_t leaf = 0; leaf < tree_.leaves.size(); ++leaf) {
      for (const uint32_t id : tree_.LeafIds(tree_.leaves[leaf])) {
        stands_[next[id]++] = static_cast<uint32_t>(leaf);
      }
    }
    return Stopped();
  }

  // Sends every triangle down to the leaves that name it, and sees that they are those it must
  // stand in: subtree by subtree, in parallel.
  absl::Status CheckReferences() {
    SL_RETURN_IF_ERROR(FindLeaves());
    std::vector<Subtree> subtrees(1), cut;
    subtrees[0].node = 0;
    for (size_t id = 0; id < inert_.size(); ++id) {
      if (inert_[id]) continue;
      const auto triangle = static_cast<uint32_t>(id);
      if (begins_[id] == begins_[id + 1]) return Fault("triangle ", id, " stands in no leaf");
      subtrees[0].references.push_back({triangle, begins_[id], begins_[id + 1], BoxOf(triangle)});
    }
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
        absl::Status fault;
        for (Reference part : next.references) {
          if (GoesDown(next.node, side, &part, &fault)) child.references.push_back(part);
          SL_RETURN_IF_ERROR(fault);
        }
        if (!child.references.empty()) subtrees.push_back(std::move(child));
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
    return absl::OkStatus();
  }

  absl::Status Stopped() const {
    return cancel_ == nullptr ? absl::OkStatus() : cancel_->ToStatus();
  }

  // Whether the triangle goes down to the lower (0) or upper (1) child of node `at`, which is then
  // as far as it reaches there. `fault`: it does not stand where it must.
  bool GoesDown(uint32_t at, uint32_t side, Reference* reference, absl::Status* fault) const {
    const KdNode node = tree_.nodes[at];
    const float split = node.split();
    float& lo = reference->box.lo[node.axis()];
    float& hi = reference->box.hi[node.axis()];
    const bool below = lo < split;
    const bool above = hi > split;
    // On one side alone. If a leaf names it on the other, a leaf here has a name too many.
    if (below != above) return side == 0 ? below : above;
    // On both, or in the plane. Leaves of the lower child come before those of the upper one.
    const auto all = stands_.begin();
    const uint32_t child = node.first_child();
    const auto middle = static_cast<uint32_t>(
        std::lower_bound(all + reference->begin, all + reference->end, first_leaf_[child + 1]) -
        all);
    const bool named_below = reference->begin < middle, named_above = middle < reference->end;
    const bool named = side == 0 ? named_below : named_above;
    (side == 0 ? reference->end : reference->begin) = middle;
    if (!below) {
      // In the plane: it stands on one side, and there wherever it reaches.
      if (named_below && named_above) {
        *fault = Fault("triangle ", reference->id, " lies in the split of node ", at,
                       " and stands on both sides of it");
      }
      return named;
    }
    (side == 0 ? hi : lo) = split;
    if (!named && MustStand(*reference)) {
      *fault = Fault("triangle ", reference->id, " reaches into the cell of node ", child + side,
                     tree_.nodes[child + side].is_leaf() ? " and does not stand in its leaf"
                                                         : " and stands in no leaf below it");
    }
    return named;
  }

  // Of the references from `first` on, which are taken away again. Where there are none, leaves may
  // name no triangle: one that they name has a name too many at another leaf, and is a fault there.
  // The way down is no longer than kMaxKdDepth: WalkDown has seen to that.
  absl::Status CheckSubtree(uint32_t at, References* references, size_t first) const {
    const size_t end = references->size();
    if (first == end) return absl::OkStatus();
    const KdNode node = tree_.nodes[at];
    if (node.is_leaf()) return CheckLeafReferences(at, std::span(*references).subspan(first));
    SL_RETURN_IF_ERROR(Stopped());
    for (uint32_t side = 0; side < 2; ++side) {
      absl::Status fault;
      for (size_t i = first; i < end; ++i) {
        Reference part = (*references)[i];
        if (GoesDown(at, side, &part, &fault)) references->push_back(part);
        SL_RETURN_IF_ERROR(fault);
      }
      SL_RETURN_IF_ERROR(CheckSubtree(node.first_child() + side, references, end));
      references->resize(end);
    }
    return absl::OkStatus();
  }

  // They must be those that the leaf names, in its order, and named nowhere else below the last
  // plane that they were on both sides of. Where that is so at all leaves, every name was met.
  absl::Status CheckLeafReferences(uint32_t at, std::span<const Reference> references) const {
    const KdNode node = tree_.nodes[at];
    std::span<const uint32_t> ids;
    Box3f box;
    if (!node.is_empty_leaf()) {
      ids = tree_.LeafIds(tree_.leaves[node.leaf()]);
      box = tree_.leaves[node.leaf()].box();
    }
    for (size_t i = 0; i < references.size(); ++i) {
      const Reference& reference = references[i];
      if (i >= ids.size() || reference.id < ids[i]) {
        return Fault("triangle ", reference.id, " reaches into the cell of node ", at,
                     " and does not stand in its leaf");
      }
      if (reference.id > ids[i]) return DoesNotReach(ids[i], node.leaf());
      if (reference.end - reference.begin != 1) {
        const uint32_t* const other = &stands_[reference.begin];
        return DoesNotReach(reference.id, other[other[0] == node.leaf() ? 1 : 0]);
      }
      if (!HoldsPart(box, reference)) {
        return Fault("the leaf of node ", at, " has a box that does not hold triangle ",
                     reference.id);
      }
    }
    return references.size() < ids.size() ? DoesNotReach(ids[references.size()], node.leaf())
                                          : absl::OkStatus();
  }
  static absl::Status DoesNotReach(uint32_t id, uint32_t leaf) {
    return Fault("leaf ", leaf, " holds triangle ", id, ", which does not reach into its cell");
  }

  // Whether a leaf's box holds what of the triangle lies in its cell.
  bool HoldsPart(const Box3f& box, const Reference& reference) const {
    return tree_.perfect() ? ClipHolds(geometry_.Corners(reference.id), reference.box, box)
                           : Contains(box, reference.box);
  }

  // With perfect splits, a cell that the triangle's box alone reaches into may leave it out. That
  // can be asked of an inner node's cell, too: builders leave a triangle out of cells by a wider
  // margin than is asked for here (kd_clip.h), and so of all parts of a cell only where the
  // whole misses it.
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
  std::vector<bool> inert_;                // By triangle.
  std::vector<uint32_t> order_;            // The nodes, parents first.
  std::vector<uint32_t> first_leaf_;       // By node: the leaves that come before it.
  std::vector<uint32_t> begins_, stands_;  // FindLeaves().
};

}  // namespace

absl::Status ValidateKdTree(const KdTree& tree, const SceneGeometry& geometry,
                            const CancelToken* cancel) {
  const ScopedFloatEnvironment environment;
  return Validator(tree, geometry, cancel).Validate();
}

}  // namespace sightline

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

// What FindLeaves and the references are counted as.
constexpr uint64_t kKdReferenceBytes = 12;
// Subtrees of so many references are one thread's: a few milliseconds.
constexpr size_t kSubtreeReferences = 1 << 14;
// Of a subtree a thread holds its references once for each level on the way down, about half as
// many at each as at the one above, with those that are on both sides; in a vector that has grown
// to twice that, while it is copied from one of half the size.
constexpr uint64_t kHeldPerReference = 3 * 3;

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
    begins_ = Words();  // Before other memory is taken.
    stands_ = Words();
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

  using Words = std::vector<uint32_t>;

  struct Pending {
    uint32_t node, depth;
    Box3f cell;
  };

  // Checks the nodes, depth-first with the lower child before the upper one, and the leaves'
  // ranges.
  absl::Status WalkDown() {
    std::vector<bool> unseen(tree_.nodes.size(), true);
    first_leaf_.assign(tree_.nodes.size(), 0);
    order_.reserve(tree_.nodes.size());
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

  // A triangle on its way down, with a range of stands_: the leaves that name it below the last
  // plane that it was on both sides of. Of these ranges none is empty and no two overlap. So all
  // that are under way at once are no more than the tree's ids, however many cells a triangle
  // reaches into. How far it reaches into a cell is its box cut to that.
  struct Reference {
    uint32_t id;
    uint32_t begin, end;
  };
  static_assert(sizeof(Reference) == kKdReferenceBytes);
  using References = std::vector<Reference>;
  struct Subtree {
    uint32_t node;
    Box3f cell;
    References references;
  };

  // By triangle, from begins_[id] to begins_[id + 1], the leaves that name it, ascending.
  absl::Status FindLeaves() {
    begins_.assign(inert_.size() + 1, 0);
    for (const uint32_t id : tree_.ids) ++begins_[id];
    for (size_t id = 0; id < inert_.size(); ++id) begins_[id + 1] += begins_[id];
    SL_RETURN_IF_ERROR(Stopped());
    // From the ends on, the last leaf first.
    stands_.resize(tree_.ids.size());
    for (size_t leaf = tree_.leaves.size(); leaf-- > 0;) {
      for (const uint32_t id : tree_.LeafIds(tree_.leaves[leaf])) {
        stands_[--begins_[id]] = static_cast<uint32_t>(leaf);
      }
    }
    return Stopped();
  }

  // Sends every triangle down to the leaves that name it, and sees that they are those it must
  // stand in: subtree by subtree, in parallel.
  absl::Status CheckReferences() {
    SL_RETURN_IF_ERROR(FindLeaves());
    std::vector<Subtree> subtrees(1), cut;
    subtrees[0] = {0, tree_.bounds, {}};
    subtrees[0].references.reserve(tree_.triangle_count);
    for (size_t id = 0; id < inert_.size(); ++id) {
      if (inert_[id]) continue;
      if (begins_[id] == begins_[id + 1]) return Fault("triangle ", id, " stands in no leaf");
      subtrees[0].references.push_back({static_cast<uint32_t>(id), begins_[id], begins_[id + 1]});
    }
    while (!subtrees.empty()) {
      SL_RETURN_IF_ERROR(Stopped());
      Subtree next = std::move(subtrees.back());
      subtrees.pop_back();
      const KdNode node = tree_.nodes[next.node];
      if (node.is_leaf() || next.references.size() <= kSubtreeReferences) {
        next.references.shrink_to_fit();
        cut.push_back(std::move(next));
        continue;
      }
      Subtree below = {node.first_child(), Half(next.cell, node, 0), {}};
      Subtree above = {node.first_child() + 1, Half(next.cell, node, 1), {}};
      SL_RETURN_IF_ERROR(
          Part(next.node, below.cell, above.cell, &next.references, &above.references));
      below.references = std::move(next.references);
      if (!above.references.empty()) subtrees.push_back(std::move(above));
      if (!below.references.empty()) subtrees.push_back(std::move(below));
    }
    std::vector<absl::Status> faults(cut.size());
    ParallelFor(
        cut.size(), 1,
        [&](size_t begin, size_t end) {
          for (size_t i = begin; i < end; ++i) {
            faults[i] = CheckSubtree(cut[i].node, cut[i].cell, &cut[i].references, 0);
            cut[i].references = References();  // Not {}, which would keep its room.
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

  // The cell of the lower (0) or upper (1) child.
  static Box3f Half(const Box3f& cell, KdNode node, uint32_t side) {
    Box3f half = cell;
    (side == 0 ? half.hi : half.lo)[node.axis()] = node.split();
    return half;
  }

  struct Sides {
    bool below, above;  // Neither: it lies in the plane.
  };
  // On which sides of the split a triangle has an extent. What of it reaches into the node's cell
  // does so too: the split is within the cell.
  Sides SidesOf(KdNode node, uint32_t id) const {
    const int axis = node.axis();
    const auto [a, b, c] = geometry_.Corners(id);
    return {std::min({a[axis], b[axis], c[axis]}) < node.split(),
            std::max({a[axis], b[axis], c[axis]}) > node.split()};
  }

  // Leaves those that go down to the lower child of node `at`, and puts those that go down to the
  // upper one into `upper`, whose room is no more than they take, or little more.
  absl::Status Part(uint32_t at, const Box3f& lower_cell, const Box3f& upper_cell,
                    References* references, References* upper) const {
    const KdNode node = tree_.nodes[at];
    size_t most = 0;
    for (const Reference& reference : *references) {
      const Sides sides = SidesOf(node, reference.id);
      most += sides.above || !sides.below;
    }
    upper->reserve(most);
    absl::Status fault;
    size_t kept = 0;
    for (const Reference& reference : *references) {
      const Sides sides = SidesOf(node, reference.id);
      Reference low = reference, high = reference;
      if (GoesDown(at, 0, sides, lower_cell, &low, &fault)) (*references)[kept++] = low;
      if (GoesDown(at, 1, sides, upper_cell, &high, &fault)) upper->push_back(high);
      SL_RETURN_IF_ERROR(fault);
    }
    references->resize(kept);
    return absl::OkStatus();
  }

  // Whether the triangle, with an extent on those sides of the split, goes down to the lower (0) or
  // upper (1) child of node `at`, whose cell is `half`. `fault`: it does not stand where it must.
  bool GoesDown(uint32_t at, uint32_t side, Sides sides, const Box3f& half, Reference* reference,
                absl::Status* fault) const {
    const KdNode node = tree_.nodes[at];
    const auto [below, above] = sides;
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
    if (!named && MustStand(reference->id, half)) {
      *fault = Fault("triangle ", reference->id, " reaches into the cell of node ", child + side,
                     tree_.nodes[child + side].is_leaf() ? " and does not stand in its leaf"
                                                         : " and stands in no leaf below it");
    }
    return named;
  }

  // Of the references from `first` on, which are taken away again. Where there are none, leaves may
  // name no triangle: one that they name has a name too many at another leaf, and is a fault there.
  // The way down is no longer than kMaxKdDepth: WalkDown has seen to that.
  absl::Status CheckSubtree(uint32_t at, const Box3f& cell, References* references,
                            size_t first) const {
    const size_t end = references->size();
    if (first == end) return absl::OkStatus();
    const KdNode node = tree_.nodes[at];
    if (node.is_leaf()) return CheckLeafReferences(at, cell, std::span(*references).subspan(first));
    SL_RETURN_IF_ERROR(Stopped());
    for (uint32_t side = 0; side < 2; ++side) {
      const Box3f half = Half(cell, node, side);
      absl::Status fault;
      for (size_t i = first; i < end; ++i) {
        Reference part = (*references)[i];
        const Sides sides = SidesOf(node, part.id);
        if (GoesDown(at, side, sides, half, &part, &fault)) references->push_back(part);
        SL_RETURN_IF_ERROR(fault);
      }
      SL_RETURN_IF_ERROR(CheckSubtree(node.first_child() + side, half, references, end));
      references->resize(end);
    }
    return absl::OkStatus();
  }

  // They must be those that the leaf names, in its order, and named nowhere else below the last
  // plane that they were on both sides of. Where that is so at all leaves, every name was met.
  absl::Status CheckLeafReferences(uint32_t at, const Box3f& cell,
                                   std::span<const Reference> references) const {
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
      if (!HoldsPart(box, reference.id, cell)) {
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
  bool HoldsPart(const Box3f& box, uint32_t id, const Box3f& cell) const {
    const Box3f part = CutTo(cell, BoxOf(id));
    return tree_.perfect() ? ClipHolds(geometry_.Corners(id), part, box) : Contains(box, part);
  }

  // With perfect splits, a cell that the triangle's box alone reaches into may leave it out. That
  // can be asked of an inner node's cell, too: builders leave a triangle out of cells by a wider
  // margin than is asked for here (kd_clip.h), and so of all parts of a cell only where the
  // whole misses it.
  bool MustStand(uint32_t id, const Box3f& cell) const {
    return !tree_.perfect() || !ClipMisses(geometry_.Corners(id), CutTo(cell, BoxOf(id)));
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

  static constexpr size_t kPollNodes = 1 << 14;

  const KdTree& tree_;
  const SceneGeometry& geometry_;
  const CancelToken* const cancel_;
  std::vector<bool> inert_;  // By triangle.
  Words order_;              // The nodes, parents first.
  Words first_leaf_;         // By node: the leaves that come before it.
  Words begins_, stands_;    // FindLeaves().
};

}  // namespace

uint64_t KdValidationBytes(uint64_t triangles, uint64_t nodes, uint64_t ids, bool perfect,
                           int threads) {
  constexpr uint64_t kWord = sizeof(uint32_t);
  // Of each node whether it was reached, its place in the order and the leaves before it; of each
  // triangle whether it is inert.
  const uint64_t walk = (nodes + triangles) / 8 + 2 * kWord * nodes;
  // The leaves that name each triangle; all triangles, then as many references as there are ids.
  const uint64_t references =
      kWord * (triangles + ids) + kKdReferenceBytes * (triangles + ids) +
      kKdReferenceBytes * kHeldPerReference *
          std::min<uint64_t>(ids, kSubtreeReferences * static_cast<uint64_t>(threads));
  const uint64_t reach = perfect ? nodes * sizeof(Box3f) : 0;
  // Subtrees and their statuses, some hundred bytes for thousands of references; stacks.
  const uint64_t rest = references / 64 + (64 << 10);
  return walk + std::max(references, reach) + rest;
}

absl::Status ValidateKdTree(const KdTree& tree, const SceneGeometry& geometry,
                            const CancelToken* cancel) {
  const ScopedFloatEnvironment environment;
  return Validator(tree, geometry, cancel).Validate();
}

}  // namespace sightline

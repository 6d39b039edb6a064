// SPDX-License-Identifier: Apache-2.0
#include "core/accel/bvh_refit.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <span>

#include "core/accel/leaf_rows.h"
#include "core/accel/sah_split.h"
#include "core/base/status_macros.h"
#include "core/geometry/float4.h"

namespace sightline {
namespace {

// Nodes above this depth have their children fitted in parallel: up to 8^3 tasks.
constexpr int kParallelDepth = 3;

struct FittedBox {
  Float4 lo = Broadcast(std::numeric_limits<float>::infinity());
  Float4 hi = -Broadcast(std::numeric_limits<float>::infinity());

  void Add(const FittedBox& other) {
    lo = Min(lo, other.lo);
    hi = Max(hi, other.hi);
  }
};

double HalfArea(const Box3f& box) {
  const double x = double{box.hi.x} - box.lo.x, y = double{box.hi.y} - box.lo.y,
               z = double{box.hi.z} - box.lo.z;
  return x * y + y * z + z * x;
}

// Of a subtree: its box, and what the heuristic expects of it before and now, times areas.
struct Fitted {
  FittedBox box;
  double cost_before = 0, cost_now = 0;
};

class Refitter {
 public:
  // `to` may be `from`; else its arrays have the sizes of those.
  Refitter(const Bvh& from, const SceneGeometry& geometry, const CancelToken* cancel, Bvh* to)
      : from_(from), geometry_(geometry), cancel_(cancel), to_(*to) {}

  // In an order of its own, not by the nodes' numbers: those of a tree from a file may be any.
  Fitted FitNode(uint32_t index, int depth) const {
    Fitted fitted;
    if (cancel_ != nullptr && cancel_->cancelled()) return fitted;
    const BvhNode& from = from_.nodes[index];
    BvhNode& to = to_.nodes[index];
    if (&to != &from) to = from;
    std::array<Fitted, kBvhWidth> children;
    const auto fit = [&](size_t begin, size_t end) {
      for (size_t slot = begin; slot < end; ++slot) {
        const ChildRef child = to.child[slot];
        children[slot] =
            child.is_leaf() ? Fitted{FitLeaf(child)} : FitNode(child.node(), depth + 1);
      }
    };
    if (depth < kParallelDepth) {
      ParallelFor(to.child_count, 1, fit, cancel_);
    } else {
      fit(0, to.child_count);
    }
    for (uint32_t slot = 0; slot < to.child_count; ++slot) {
      const Fitted& child = children[slot];
      fitted.cost_before += child.cost_before + HalfArea(BoxOf(to, slot)) * Visit(to.child[slot]);
      for (int axis = 0; axis < 3; ++axis) {
        to.bounds[axis][slot] = child.box.lo[axis];
        to.bounds[axis + 3][slot] = child.box.hi[axis];
      }
      fitted.cost_now += child.cost_now + HalfArea(BoxOf(to, slot)) * Visit(to.child[slot]);
      fitted.box.Add(child.box);
    }
    return fitted;
  }

 private:
  static Box3f BoxOf(const BvhNode& node, uint32_t slot) {
    const auto& b = node.bounds;
    return {{b[0][slot], b[1][slot], b[2][slot]}, {b[3][slot], b[4][slot], b[5][slot]}};
  }

  static double Visit(ChildRef child) {
    constexpr bvh_build::SahCost kCost;
    return child.is_leaf() ? kCost.Leaf(child.leaf_count()) : kCost.node_visit;
  }

  // Writes the corners of a leaf that has rows.
  FittedBox FitLeaf(ChildRef leaf) const {
    uint32_t ids[kMaxLeafTriangles];  // A copy: rows are written over what they are read from.
    const uint32_t count = leaf.leaf_count();
    const size_t lanes = size_t{leaf.leaf_units()} * kUnitTriangles;
    if (from_.has_leaf_rows()) {
      const float* const rows = &from_.leaves[size_t{leaf.leaf_unit()} * kUnitFloats];
      std::memcpy(ids, rows + (kLeafRows - 1) * lanes, count * sizeof(uint32_t));
      WriteLeafRows(geometry_, {ids, count}, lanes,
                    &to_.leaves[size_t{leaf.leaf_unit()} * kUnitFloats]);
    } else {
      std::copy_n(&from_.leaf_ids[size_t{leaf.leaf_unit()} * kUnitTriangles], count, ids);
    }
    FittedBox box;
    for (const uint32_t id : std::span(ids, count)) {
      for (const uint32_t vertex : geometry_.triangles[id]) {
        const Float4 corner = LoadVertex(geometry_.vertices[vertex]);
        box.Add({corner, corner});
      }
    }
    return box;
  }

  const Bvh& from_;
  const SceneGeometry& geometry_;
  const CancelToken* const cancel_;
  Bvh& to_;
};

// All but the arrays' sizes, which are there already.
absl::Status Fit(const Bvh& from, const SceneGeometry& geometry, ThreadPool& pool,
                 const CancelToken* cancel, Bvh* to) {
  if (from.empty()) return absl::OkStatus();
  // One block: the calling thread enters the pool, and everything below runs within it.
  pool.ParallelFor(1, 1, [&](size_t, size_t) {
    const double area_before = HalfArea(from.bounds);
    const Fitted root = Refitter(from, geometry, cancel, to).FitNode(0, 0);
    const Float4 lo = root.box.lo, hi = root.box.hi;
    to->bounds = {{lo[0], lo[1], lo[2]}, {hi[0], hi[1], hi[2]}};
    const double before = area_before > 0 ? root.cost_before / area_before : 0;
    const double area_now = HalfArea(to->bounds);
    const double now = area_now > 0 ? root.cost_now / area_now : 0;
    // Of boxes without an area the heuristic says nothing.
    constexpr double kUnknown = std::numeric_limits<double>::infinity();
    to->cost_growth = before > 0 && now > 0 ? from.cost_growth * (now / before) : kUnknown;
  });
  return cancel == nullptr ? absl::OkStatus() : cancel->ToStatus();
}

}  // namespace

bool CanRefit(const SceneGeometry& before, const SceneGeometry& now) {
  return before.triangles.size() == now.triangles.size() &&
         std::equal(before.inert.begin(), before.inert.end(), now.inert.begin(), now.inert.end());
}

absl::StatusOr<Bvh> RefitBvh(const Bvh& bvh, const SceneGeometry& geometry, ThreadPool& pool,
                             const CancelToken* cancel) {
  Bvh to;
  to.nodes.ResizeUninitialized(bvh.nodes.size());
  to.leaves.ResizeUninitialized(bvh.leaves.size());
  if (!to.leaves.empty()) {
    std::fill_n(to.leaves.end() - kLeafPadding, kLeafPadding, 0.0f);
  }
  to.leaf_ids = bvh.leaf_ids;
  to.leaf_count = bvh.leaf_count;
  to.triangle_count = bvh.triangle_count;
  to.max_depth = bvh.max_depth;
  SL_RETURN_IF_ERROR(Fit(bvh, geometry, pool, cancel, &to));
  return to;
}

absl::Status RefitBvhInPlace(const SceneGeometry& geometry, ThreadPool& pool, Bvh* bvh,
                             const CancelToken* cancel) {
  bvh->mates = {};  // As in RefitBvh: edges may have parted.
  return Fit(*bvh, geometry, pool, cancel, bvh);
}

}  // namespace sightline

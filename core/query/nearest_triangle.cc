// SPDX-License-Identifier: Apache-2.0
#include "core/query/nearest_triangle.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "core/base/check.h"
#include "core/intersect/predicate.h"
#include "core/query/box_walk.h"
#include "core/traverse/leaf_range.h"
#include "core/traverse/leaf_view.h"

namespace sightline {
namespace {

// Below this share of its longest edge, a triangle's width is lost in the rounding of its corners
// (2^-24 of a coordinate): its edges stand for it. Above it, the normal in doubles is good to some
// 2^-53 / 2^-24 = 2^-29.
constexpr double kSliverWidth = 0x1p-24;
constexpr double kPlaneMargin = 0x1p-44;

Vec3d Clamp(Vec3d p, const Box3d& box) {
  return {std::min(std::max(p.x, box.lo.x), box.hi.x), std::min(std::max(p.y, box.lo.y), box.hi.y),
          std::min(std::max(p.z, box.lo.z), box.hi.z)};
}

Box3d BoxOf(Vec3d a, Vec3d b) {
  return {{std::min(a.x, b.x), std::min(a.y, b.y), std::min(a.z, b.z)},
          {std::max(a.x, b.x), std::max(a.y, b.y), std::max(a.z, b.z)}};
}

bool Before(Vec3d a, Vec3d b) {
  if (a.x != b.x) return a.x < b.x;
  if (a.y != b.y) return a.y < b.y;
  return a.z < b.z;
}

Vec3d ClosestPointOnEdge(Vec3d p, Vec3d a, Vec3d b) {
  if (Before(b, a)) std::swap(a, b);
  const Vec3d d = b - a;
  const double length_squared = Dot(d, d);
  const double t = length_squared > 0 ? Dot(p - a, d) / length_squared : 0;
  if (!(t > 0)) return a;
  if (t >= 1) return b;
  return Clamp(a + d * t, BoxOf(a, b));
}

// Squared distance per axis-aligned box, for `lanes` boxes side by side. Infinite for an inverted
// box.
template <int kLanes>
void BoxDistances(const float* lo_x, const float* lo_y, const float* lo_z, const float* hi_x,
                  const float* hi_y, const float* hi_z, Vec3d p, double* out) {
  const auto gap = [](double lo, double hi, double x) {
    const double below = lo - x, above = x - hi;
    const double outside = below > above ? below : above;
    return outside > 0 ? outside : 0.0;
  };
  for (int k = 0; k < kLanes; ++k) {
    const double x = gap(lo_x[k], hi_x[k], p.x);
    const double y = gap(lo_y[k], hi_y[k], p.y);
    const double z = gap(lo_z[k], hi_z[k], p.z);
    out[k] = (x * x + y * y) + z * z;
  }
}

void ChildDistances(const BvhNode& node, Vec3d p, double out[kBvhWidth]) {
  BoxDistances<kBvhWidth>(node.bounds[0], node.bounds[1], node.bounds[2], node.bounds[3],
                          node.bounds[4], node.bounds[5], p, out);
}

// The boxes of a leaf's triangles; lanes past their number hold nothing of use.
struct LeafBoxes {
  float lo[3][kMaxLeafTriangles], hi[3][kMaxLeafTriangles];

  explicit LeafBoxes(const LeafView& leaf) {
    const size_t stride = leaf.stride;
    const int lanes = static_cast<int>(std::min<size_t>(stride, kMaxLeafTriangles));
    for (size_t axis = 0; axis < 3; ++axis) {
      const float* a = leaf.rows + axis * stride;
      const float* b = a + 3 * stride;
      const float* c = b + 3 * stride;
      for (int k = 0; k < lanes; ++k) {
        const float ab_lo = a[k] < b[k] ? a[k] : b[k];
        const float ab_hi = a[k] < b[k] ? b[k] : a[k];
        lo[axis][k] = ab_lo < c[k] ? ab_lo : c[k];
        hi[axis][k] = ab_hi < c[k] ? c[k] : ab_hi;
      }
      for (int k = lanes; k < kMaxLeafTriangles; ++k) lo[axis][k] = hi[axis][k] = 0;
    }
  }
  void Distances(Vec3d p, double out[kMaxLeafTriangles]) const {
    BoxDistances<kMaxLeafTriangles>(lo[0], lo[1], lo[2], hi[0], hi[1], hi[2], p, out);
  }
};

double BoxDistance(const Box3f& box, Vec3d p) {
  double distance;
  BoxDistances<1>(&box.lo.x, &box.lo.y, &box.lo.z, &box.hi.x, &box.hi.y, &box.hi.z, p, &distance);
  return distance;
}

// Makes `best` the best of it and a leaf's triangles.
void LookAtLeaf(const LeafView& leaf, Vec3d p, NearestTriangle* best) {
  double distance[kMaxLeafTriangles];
  LeafBoxes(leaf).Distances(p, distance);
  for (uint32_t k = 0; k < leaf.count; ++k) {
    if (!(distance[k] <= best->distance_squared)) continue;
    const Vec3d q =
        ClosestPointOnTriangle(p, leaf.corner(0, k), leaf.corner(1, k), leaf.corner(2, k));
    const NearestTriangle candidate{leaf.id(k), DistanceSquared(p, q)};
    if (candidate.distance_squared < best->distance_squared ||
        (candidate.distance_squared == best->distance_squared &&
         candidate.triangle < best->triangle)) {
      *best = candidate;
    }
  }
}

// FindNearest by the kd-tree, the nearer child first.
NearestTriangle NearestInKdTree(const IndexedGeometry& scene, Vec3d p, double max_distance_squared,
                                PointPoll* poll) {
  const KdTree& tree = *scene.kd_tree;
  NearestTriangle best{kNoTriangle, max_distance_squared};
  struct Entry {
    double distance;
    uint32_t node;
    Box3f cell;
  };
  const auto entry_of = [&](uint32_t node, const Box3f& cell) {
    return Entry{BoxDistance(tree.perfect() ? tree.reach[node] : cell, p), node, cell};
  };
  std::vector<Entry> stack;
  stack.reserve(kKdStackSize);
  stack.push_back(entry_of(0, tree.bounds));
  while (!stack.empty()) {
    const Entry entry = stack.back();
    stack.pop_back();
    // Equal distances are looked at: a lower id may have one.
    const KdNode node = tree.nodes[entry.node];
    if (node.is_empty_leaf() || !(entry.distance <= best.distance_squared)) continue;
    if (node.is_leaf()) {
      const KdLeaf& leaf = tree.leaves[node.leaf()];
      if (!tree.perfect() && !(BoxDistance(leaf.box(), p) <= best.distance_squared)) continue;
      const LeafRange range = LeafRange::Of(scene, leaf);
      for (uint32_t first = 0; first < range.count; first += kMaxLeafTriangles) {
        const RangeView view(scene.geometry, range, first);
        LookAtLeaf(view.leaf, p, &best);
        if (Stops(poll, view.leaf.count)) return best;
      }
      continue;
    }
    Box3f lower = entry.cell, upper = entry.cell;
    lower.hi[node.axis()] = node.split();
    upper.lo[node.axis()] = node.split();
    Entry far = entry_of(node.first_child(), lower), near = entry_of(node.first_child() + 1, upper);
    if (far.distance < near.distance) std::swap(far, near);
    stack.push_back(far);
    stack.push_back(near);
  }
  return best;
}

// The floats around x, r to either side: rounded outward, and r taken 2^-40 larger, so that
// whatever lies beyond them is farther than r in rounded doubles, too.
float FloatBelow(double x, double r) {
  return std::nextafterf(static_cast<float>(x - r * (1 + 0x1p-40)),
                         -std::numeric_limits<float>::infinity());
}
float FloatAbove(double x, double r) {
  return std::nextafterf(static_cast<float>(x + r * (1 + 0x1p-40)),
                         std::numeric_limits<float>::infinity());
}

// Whatever does not meet this is farther than its radius from p, in rounded doubles, too.
TouchBox TouchBoxAround(const IndexedGeometry& scene, Vec3d p, TouchRadius radius) {
  constexpr double kUp = 1 + TouchBox::kRoundedUp;
  return {.at = BoxAround({p, p}, 0),
          .farthest = BoxAround({p, p}, radius.Largest(scene)),
          .base = static_cast<float>(radius.base * kUp) + std::numeric_limits<float>::min(),
          .per_vertex = static_cast<float>(radius.per_vertex * kUp)};
}

// Boxes of triangles that are compared, eight at a time, in the time that one takes to be measured
// (PointPoll).
constexpr uint32_t kComparedPerWork = 8;

// Calls found(id) for touched triangles in no particular order, on a kd-tree perhaps more than once
// for one; found returns whether to go on.
template <typename Found>
void ForEachTouching(const IndexedGeometry& scene, Vec3d p, TouchRadius radius, uint32_t skip,
                     PointPoll* poll, Found found) {
  const auto touches = [&](const LeafView& leaf, uint32_t k) {
    const uint32_t id = leaf.id(k);
    if (id == skip) return true;
    if (Stops(poll, 1)) return false;
    const Vec3f a = leaf.corner(0, k), b = leaf.corner(1, k), c = leaf.corner(2, k);
    return Touches(p, radius, a, b, c) ? found(id) : true;
  };
  // A kd-tree's cells do not tell how far out their triangles reach: one stray triangle may have
  // all of them looked through.
  uint32_t compared = 0;
  const auto enters = [&](uint32_t triangles) {
    compared += triangles;
    if (compared < kComparedPerWork) return true;
    const uint32_t work = compared / kComparedPerWork;
    compared %= kComparedPerWork;
    return !Stops(poll, work);
  };
  ForEachMeeting(scene, TouchBoxAround(scene, p, radius), touches, enters);
}

}  // namespace

ClosestPoints::ClosestPoints(Vec3f af, Vec3f bf, Vec3f cf)
    : a(ToDouble(af)),
      b(ToDouble(bf)),
      c(ToDouble(cf)),
      ab(b - a),
      bc(c - b),
      ca(a - c),
      n(Cross(ab, bc)),
      nn(Dot(n, n)) {
  longest = std::max({Dot(ab, ab), Dot(bc, bc), Dot(ca, ca)});
  sliver = !(nn >= (kSliverWidth * kSliverWidth) * (longest * longest));
  box = BoxOf(a, b);
  box = {BoxOf(box.lo, c).lo, BoxOf(box.hi, c).hi};
}

bool ClosestPoints::IsBelow(Vec3d p) const {
  return !sliver && Dot(Cross(ab, p - a), n) > 0 && Dot(Cross(bc, p - b), n) > 0 &&
         Dot(Cross(ca, p - c), n) > 0;
}

Vec3d ClosestPoints::Held(Vec3d p) const { return Clamp(p, box); }

Vec3d ClosestPoints::To(Vec3d p) const {
  if (IsBelow(p)) return Held(p - n * (Dot(n, p - a) / nn));
  Vec3d best = ClosestPointOnEdge(p, a, b);
  double best_distance = DistanceSquared(p, best);
  for (const Vec3d q : {ClosestPointOnEdge(p, b, c), ClosestPointOnEdge(p, c, a)}) {
    const double distance = DistanceSquared(p, q);
    if (distance < best_distance) best = q, best_distance = distance;
  }
  return best;
}

Vec3d ClosestPointOnTriangle(Vec3d p, Vec3f a, Vec3f b, Vec3f c) {
  return ClosestPoints(a, b, c).To(p);
}

double TouchRadius::Of(Vec3f a, Vec3f b, Vec3f c) const {
  return base +
         per_vertex * std::max({NormOne(ToDouble(a)), NormOne(ToDouble(b)), NormOne(ToDouble(c))});
}

// No triangle's corner is farther out than the farthest corner of all bounds, in rounded sums too.
double TouchRadius::Largest(const IndexedGeometry& scene) const {
  const Box3f& bounds = scene.geometry.bounds;
  const Vec3d lo = ToDouble(bounds.lo), hi = ToDouble(bounds.hi);
  const Vec3d far = {std::max(std::abs(lo.x), std::abs(hi.x)),
                     std::max(std::abs(lo.y), std::abs(hi.y)),
                     std::max(std::abs(lo.z), std::abs(hi.z))};
  return base + per_vertex * NormOne(far);
}

bool Touches(Vec3d p, TouchRadius radius, Vec3f a, Vec3f b, Vec3f c) {
  const ClosestPoints closest(a, b, c);
  const double largest = std::max({NormOne(closest.a), NormOne(closest.b), NormOne(closest.c)});
  const double r = radius.base + radius.per_vertex * largest;
  // Most that come here are outside of its plane by far more than r. The margin is that of
  // TouchCandidates (touch_candidates.cc), which says why it is enough; where the division gives
  // infinity or no number, nothing is said.
  const double margin =
      kPlaneMargin * (NormOne(p) + largest) * (closest.longest / closest.nn) * closest.longest;
  const double reach = 2 * r + margin, limit = closest.nn * (reach * reach);
  const double from_a = Dot(closest.n, p - closest.a), from_b = Dot(closest.n, p - closest.b),
               from_c = Dot(closest.n, p - closest.c);
  const double nearest =
      from_a > 0 ? std::min({from_a, from_b, from_c}) : -std::max({from_a, from_b, from_c});
  if (nearest > 0 && nearest * nearest > limit) return false;
  return DistanceSquared(p, closest.To(p)) <= r * r;
}

Box3f BoxAround(const Box3d& points, double radius) {
  const auto [lo, hi] = points;
  return {.lo = {FloatBelow(lo.x, radius), FloatBelow(lo.y, radius), FloatBelow(lo.z, radius)},
          .hi = {FloatAbove(hi.x, radius), FloatAbove(hi.y, radius), FloatAbove(hi.z, radius)}};
}

NearestTriangle FindNearest(const IndexedGeometry& scene, Vec3d p, double max_distance_squared,
                            PointPoll* poll) {
  if (scene.kd_tree_alone()) return NearestInKdTree(scene, p, max_distance_squared, poll);
  NearestTriangle best{kNoTriangle, max_distance_squared};
  if (scene.bvh.empty()) return best;
  struct Entry {  // Trivial: the stack is not initialized.
    double distance;
    uint32_t ref_bits;
  };
  Entry stack[kBvhStackSize];
  uint32_t size = 0;
  stack[size++] = {0, ChildRef::Inner(0).bits()};
  while (size > 0) {
    const Entry entry = stack[--size];
    // Equal distances are looked at: a lower id may have one.
    if (!(entry.distance <= best.distance_squared)) continue;
    const ChildRef ref = ChildRef::FromBits(entry.ref_bits);
    if (ref.is_leaf()) {
      const LeafView leaf(scene, ref);
      LookAtLeaf(leaf, p, &best);
      if (Stops(poll, leaf.count)) return best;
      continue;
    }
    double distance[kBvhWidth];
    // Children go on the stack so that the nearest comes off first.
    const BvhNode& node = scene.bvh.nodes[ref.node()];
    ChildDistances(node, p, distance);
    const uint32_t first = size;
    for (uint32_t k = 0; k < node.child_count; ++k) {
      if (!(distance[k] <= best.distance_squared)) continue;
      SIGHTLINE_DCHECK(size < kBvhStackSize);
      uint32_t at = size++;
      for (; at > first && stack[at - 1].distance < distance[k]; --at) stack[at] = stack[at - 1];
      stack[at] = {distance[k], node.child[k].bits()};
    }
  }
  return best;
}

void FindTouching(const IndexedGeometry& scene, Vec3d p, TouchRadius radius, uint32_t skip,
                  std::vector<uint32_t>* ids, size_t most, PointPoll* poll) {
  const auto keep_distinct = [&] {
    std::sort(ids->begin(), ids->end());
    ids->erase(std::unique(ids->begin(), ids->end()), ids->end());
  };
  // On a kd-tree some may be one triangle again: so that they are sorted seldom, as many more are
  // gathered as are wanted at all.
  const size_t gathered = scene.kd_tree_alone() && most <= ids->max_size() / 2 ? 2 * most : most;
  ids->clear();
  ForEachTouching(scene, p, radius, skip, poll, [&](uint32_t id) {
    ids->push_back(id);
    if (ids->size() <= gathered) return true;
    keep_distinct();
    return ids->size() <= most;
  });
  keep_distinct();
}

bool TouchesAny(const IndexedGeometry& scene, Vec3d p, TouchRadius radius, uint32_t skip,
                PointPoll* poll) {
  bool any = false;
  ForEachTouching(scene, p, radius, skip, poll, [&](uint32_t) {
    any = true;
    return false;
  });
  return any;
}

bool CrossesAny(const IndexedGeometry& scene, Vec3f from, Vec3f to, std::span<const uint32_t> skip,
                PointPoll* poll) {
  Box3f box;
  box.Extend(from);
  box.Extend(to);
  const PredicateRay segment = PredicateRay::Segment(from, to);
  bool crosses = false;
  ForEachMeeting(scene, box, [&](const LeafView& leaf, uint32_t k) {
    if (Stops(poll, 1)) return false;
    if (std::binary_search(skip.begin(), skip.end(), leaf.id(k))) return true;
    crosses = Blocks(segment, leaf.corner(0, k), leaf.corner(1, k), leaf.corner(2, k));
    return !crosses;
  });
  return crosses;
}

}  // namespace sightline

// SPDX-License-Identifier: Apache-2.0
#include "core/query/placement.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "core/base/check.h"
#include "core/intersect/predicate.h"

namespace sightline {
namespace {

// Rounds of such moves. At right angles one or two are enough, and what kMaxReach lets through
// needs few more; the result is verified, so this bounds time alone.
constexpr int kSweeps = 32;
// What so many of them take for one plane, in triangles looked at (PointPoll).
constexpr size_t kWorkPerPlane = 8;
// A point is not moved farther than this many touch radii for the sake of other triangles: room for
// two planes that meet at some 10 degrees. Beyond that, the move would begin to show.
constexpr double kMaxReach = 16;
// The offsets, in units of PlacementOffset, that are tried for several planes. Rounding alone needs
// the first; the others help where planes are slivers, whose normals are bad in doubles.
constexpr std::array<double, 3> kScales = {1, 4, 16};
// A plane whose distances may be off by more than this share of what the coordinates allow says
// nothing: a sliver's normal can be wrong in all its bits, and the offset for that be longer than
// the sliver. Triangles that are none stay below 2^-21 at the largest scale
// (ClosestPoints::sliver), so that they are placed alike here and a vector at a time
// (placement-inl.h).
constexpr double kMostSlack = 0x1p-20;
// Doublings of the source's own offset. From 2^-149 to 2^41 there are 190; PlacementOffset starts
// within 2^-50 of the coordinates, from where 60 reach past them.
constexpr int kMaxDoublings = 60;

double Slack(const Plane& plane, Vec3d from_anchor) {
  return kSlackPerConditioning * plane.conditioning * NormOne(from_anchor);
}

// Moves *x to kAim offsets from the plane if it is nearer than one, or behind. False if nothing had
// to be done.
bool Correct(const Plane& plane, double scale, Vec3d* x) {
  const Vec3d from_anchor = *x - ToDouble(plane.corners[0]);
  const double distance = Dot(plane.normal, from_anchor);
  const double offset = scale * PlacementOffset(plane.normal, *x, Slack(plane, from_anchor));
  if (distance >= offset) return false;
  *x = *x + plane.normal * (kAim * offset - distance);
  return true;
}

// -0 becomes +0, as in stored vertices.
Vec3f Rounded(Vec3d x) { return ToFloat(x) + Vec3f{0.0f, 0.0f, 0.0f}; }

bool HoldsAll(std::span<const Plane> planes, Vec3f p) {
  return std::all_of(planes.begin(), planes.end(), [&](const Plane& h) { return h.Holds(p); });
}

bool TryAll(std::span<const Plane> planes, double scale, Vec3d at, double reach, Vec3f* placed) {
  Vec3d x = at;
  for (int sweep = 0; sweep < kSweeps; ++sweep) {
    bool moved = false;
    for (const Plane& plane : planes) moved |= Correct(plane, scale, &x);
    if (!moved) break;
  }
  if (!(DistanceSquared(x, at) <= reach * reach)) return false;
  *placed = Rounded(x);
  return HoldsAll(planes, *placed);
}

// The exact signs of the normal's components: moving along them raises the distance from the plane
// by at least as much as the move's largest component, whatever the normal is in doubles.
Vec3d SignsOfNormal(const Plane& plane) {
  const auto& [a, b, c] = plane.corners;
  return {static_cast<double>(plane.side * SideOfDirection(a, b, c, {1, 0, 0})),
          static_cast<double>(plane.side * SideOfDirection(a, b, c, {0, 1, 0})),
          static_cast<double>(plane.side * SideOfDirection(a, b, c, {0, 0, 1}))};
}

Vec3f PlaceBesideSource(const Plane& plane, Vec3d at) {
  const Vec3d anchor = ToDouble(plane.corners[0]);
  const double slack = Slack(plane, at - anchor);
  Vec3f placed;
  for (double scale : kScales) {
    if (!(scale * slack <= kMostSlack * (NormOne(at) + NormOne(anchor)))) break;
    Vec3d x = at;
    Correct(plane, scale, &x);
    placed = Rounded(x);
    if (plane.Holds(placed)) return placed;
  }
  const Vec3d signs = SignsOfNormal(plane);
  double step = PlacementOffset({1, 1, 1}, at, 0x1p-50 * NormOne(anchor));
  for (int i = 0; i < kMaxDoublings; ++i, step *= 2) {
    placed = Rounded(at + signs * step);
    if (plane.Holds(placed)) return placed;
  }
  SIGHTLINE_CHECK(false) << "no place beside a triangle near (" << at.x << ", " << at.y << ", "
                         << at.z << "): is it of zero area?";
  return placed;
}

// A touched triangle while its side is being found.
struct Neighbour {
  std::array<Vec3f, 3> corners;
  int side = 0;  // 0: not known, or not needed.
  bool coplanar = false;
  bool rises = false;  // Has a corner strictly on the point's side of the source's plane.
};

bool IsCorner(const std::array<Vec3f, 3>& triangle, Vec3f p) {
  return triangle[0] == p || triangle[1] == p || triangle[2] == p;
}

// As SideOfPlane, with an answer at hand for the triangle's own corners.
int SideOf(const std::array<Vec3f, 3>& triangle, Vec3f p) {
  if (IsCorner(triangle, p)) return 0;
  return SideOfPlane(triangle[0], triangle[1], triangle[2], p);
}

Vec3d NormalOf(const std::array<Vec3f, 3>& t) {
  const Vec3d a = ToDouble(t[0]);
  return Cross(ToDouble(t[1]) - a, ToDouble(t[2]) - a);
}

// Directed edges under undirected keys, so that triangles find each other over shared edges.
struct HalfEdge {
  Vec3f lo, hi;
  bool forward;  // Runs from lo to hi.
  uint32_t owner;

  static bool Less(Vec3f p, Vec3f q) {
    if (p.x != q.x) return p.x < q.x;
    if (p.y != q.y) return p.y < q.y;
    return p.z < q.z;
  }
  static HalfEdge Make(Vec3f from, Vec3f to, uint32_t owner) {
    const bool forward = Less(from, to);
    return {forward ? from : to, forward ? to : from, forward, owner};
  }
  bool KeyLess(const HalfEdge& other) const {
    if (!(lo == other.lo)) return Less(lo, other.lo);
    return Less(hi, other.hi);
  }
  bool operator<(const HalfEdge& other) const {
    if (KeyLess(other)) return true;
    if (other.KeyLess(*this)) return false;
    return owner < other.owner;
  }
};

// Passes sides from triangle to triangle over shared edges, breadth first from those that have one.
// Two triangles on one sheet run along their edge in opposite directions if their fronts are on the
// same side of the sheet. Where more than two meet at an edge, or a sheet has one side only, the
// first to come decides (ids ascend).
void SpreadSides(std::vector<Neighbour>& neighbours) {
  std::vector<HalfEdge> edges;
  edges.reserve(3 * neighbours.size());
  for (uint32_t i = 0; i < neighbours.size(); ++i) {
    const auto& c = neighbours[i].corners;
    for (int k = 0; k < 3; ++k) edges.push_back(HalfEdge::Make(c[k], c[(k + 1) % 3], i));
  }
  std::sort(edges.begin(), edges.end());
  std::vector<uint32_t> queue;
  for (uint32_t i = 0; i < neighbours.size(); ++i) {
    if (neighbours[i].side != 0) queue.push_back(i);
  }
  // By an edge's first entry: all who share it have a side. A thousand copies of one triangle share
  // three.
  std::vector<bool> passed(edges.size());
  for (size_t head = 0; head < queue.size(); ++head) {
    const uint32_t from = queue[head];
    const auto& c = neighbours[from].corners;
    for (int k = 0; k < 3; ++k) {
      const HalfEdge mine = HalfEdge::Make(c[k], c[(k + 1) % 3], 0);
      const auto first = std::lower_bound(edges.begin(), edges.end(), mine);
      const size_t group = static_cast<size_t>(first - edges.begin());
      if (passed[group]) continue;
      passed[group] = true;
      for (auto it = first; it != edges.end() && !mine.KeyLess(*it); ++it) {
        Neighbour& other = neighbours[it->owner];
        if (other.side != 0) continue;
        other.side = it->forward == mine.forward ? -neighbours[from].side : neighbours[from].side;
        queue.push_back(it->owner);
      }
    }
  }
}

// The side of a triangle that no chain of shared edges leads to (see the header).
int SideOfUnconnected(const Neighbour& source, const Neighbour& other, Vec3f reference) {
  int low = 0, high = 0;
  for (Vec3f corner : source.corners) {
    const int s = SideOf(other.corners, corner);
    low = std::min(low, s);
    high = std::max(high, s);
  }
  if (low == 0 && high > 0) return 1;
  if (high == 0 && low < 0) return -1;
  if (const int s = SideOf(other.corners, reference); s != 0) return s;
  return source.side * Dot(NormalOf(source.corners), NormalOf(other.corners)) >= 0 ? 1 : -1;
}

// Entry 0 is the source, the others are the touched triangles in order.
std::vector<Neighbour> FindSides(const IndexedGeometry& scene, const Placement& placement,
                                 std::span<const uint32_t> touched) {
  std::vector<Neighbour> all(touched.size() + 1);
  all[0] = {.corners = scene.geometry.Corners(placement.source), .side = placement.side};
  for (size_t i = 1; i < all.size(); ++i) {
    Neighbour& n = all[i];
    n.corners = scene.geometry.Corners(touched[i - 1]);
    n.coplanar = true;
    for (Vec3f corner : n.corners) {
      const int s = SideOf(all[0].corners, corner) * placement.side;
      n.coplanar &= s == 0;
      n.rises |= s > 0;
    }
    if (n.coplanar) {  // Normals are parallel: their signs are clear.
      const double dot = Dot(NormalOf(all[0].corners), NormalOf(n.corners));
      n.side = dot >= 0 ? placement.side : -placement.side;
    }
  }
  SpreadSides(all);
  for (size_t i = 1; i < all.size(); ++i) {
    if (all[i].side == 0 && all[i].rises) {
      all[i].side = SideOfUnconnected(all[0], all[i], placement.reference);
    }
  }
  return all;
}

// All sides first, then those that can stand between the point and a light in front of its source.
bool PlaceAmong(const IndexedGeometry& scene, const Placement& placement, const Plane& source,
                std::span<const uint32_t> touched, PointPoll* poll, Placed* placed) {
  const std::vector<Neighbour> neighbours = FindSides(scene, placement, touched);
  std::vector<uint32_t> skip(touched.begin(), touched.end());
  skip.insert(std::lower_bound(skip.begin(), skip.end(), placement.source), placement.source);
  const Vec3f start = Rounded(placement.at);
  const auto& c = source.corners;
  const double reach = kMaxReach * placement.radius.Of(c[0], c[1], c[2]);
  std::vector<Plane> planes;
  size_t all_planes = 0;
  for (const bool all : {true, false}) {
    planes.assign(1, source);
    for (size_t i = 1; i < neighbours.size(); ++i) {
      const Neighbour& n = neighbours[i];
      // Whatever is strictly beside the source is so beside triangles in its plane.
      if (n.side == 0 || n.coplanar || !(all || n.rises)) continue;
      planes.push_back(MakePlane(n.corners, n.side));
    }
    if (all) {
      all_planes = planes.size();
    } else if (planes.size() == all_planes) {
      return false;  // The same again.
    }
    for (double scale : kScales) {
      if (Stops(poll, kWorkPerPlane * planes.size())) return false;
      if (TryAll(planes, scale, placement.at, reach, &placed->position) &&
          !CrossesAny(scene, start, placed->position, skip, poll)) {
        placed->clear = all;
        return true;
      }
    }
  }
  return false;
}

}  // namespace

Plane MakePlane(const std::array<Vec3f, 3>& corners, int side) {
  const Vec3d a = ToDouble(corners[0]);
  const Vec3d ab = ToDouble(corners[1]) - a, ac = ToDouble(corners[2]) - a;
  const Vec3d n = Cross(ab, ac);
  const double length = Length(n);
  Plane plane{.corners = corners, .side = side};
  if (length > 0) {
    plane.normal = n * (side / length);
    plane.conditioning = Length(ab) * Length(ac) / length;
  }
  return plane;  // A zero normal (area lost in doubles) pushes nowhere; the source's fallback is
                 // exact.
}

double PlacementOffset(Vec3d n, Vec3d p, double slack) {
  const double rounding = (std::abs(n.x * p.x) + std::abs(n.y * p.y)) + std::abs(n.z * p.z);
  return 2 * (0x1p-24 * rounding + 2 * 0x1p-150) + slack;
}

Placed Place(const IndexedGeometry& scene, const Placement& placement, PlacementScratch* scratch,
             PointPoll* poll) {
  FindTouching(scene, placement.at, placement.radius, placement.source, &scratch->touched,
               kMaxTouched, poll);
  const Plane source = MakePlane(scene.geometry.Corners(placement.source), placement.side);
  return PlaceTouching(scene, placement, source, scratch->touched, poll);
}

Placed PlaceTouching(const IndexedGeometry& scene, const Placement& placement, const Plane& source,
                     std::span<const uint32_t> touched, PointPoll* poll) {
  Placed placed;
  if (!touched.empty() && touched.size() <= kMaxTouched &&
      PlaceAmong(scene, placement, source, touched, poll, &placed)) {
    return placed;
  }
  placed.position = PlaceBesideSource(source, placement.at);
  placed.clear = touched.empty();
  // Within the base radius of a point that touches nothing there is nothing to cross.
  const double base = placement.radius.base;
  const double moved = DistanceSquared(ToDouble(placed.position), placement.at);
  if (placed.clear && moved > base * base) {
    const auto& [a, b, c] = source.corners;
    const double reach = kMaxReach * placement.radius.Of(a, b, c);
    placed.clear =
        moved <= reach * reach && !CrossesAny(scene, Rounded(placement.at), placed.position,
                                              std::span(&placement.source, 1), poll);
  }
  return placed;
}

}  // namespace sightline

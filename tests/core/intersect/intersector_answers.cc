// SPDX-License-Identifier: Apache-2.0
#include "tests/core/intersect/intersector_answers.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "core/geometry/vec3.h"
#include "core/intersect/intersector_check.h"
#include "tests/core/intersect/same_bits.h"

namespace sightline::testing_support {
namespace {

constexpr double kSliverAspect = 1000;
constexpr double kBesideEdge = 1e-3;  // Of the weights of the corners at the crossing.

// The least magnitude of a corner's weight where the ray crosses the triangle's plane.
double LeastWeight(const PredicateRay& ray, Vec3f a, Vec3f b, Vec3f c) {
  const Vec3d o = ToDouble(ray.origin);
  const Vec3d d = ray.segment ? ToDouble(ray.target) - o : ToDouble(ray.target);
  const Vec3d p[3] = {ToDouble(a) - o, ToDouble(b) - o, ToDouble(c) - o};
  double weights[3], sum = 0;
  for (int k = 0; k < 3; ++k) {
    weights[k] = Dot(Cross(p[(k + 1) % 3], p[(k + 2) % 3]), d);
    sum += weights[k];
  }
  double least = std::numeric_limits<double>::infinity();
  for (const double w : weights) least = std::min(least, std::abs(w / sum));
  return std::isfinite(least) ? least : 0;
}

// What excuses one of two answers. Nothing does where it is that nothing is hit.
struct HitCheck {
  bool is_hit = false, certain = true;
  bool denied = false;  // By the test, edges and all.
  double t_error = 0;
  bool sliver = false, edge = false, end = false;
};
HitCheck CheckHit(const SceneGeometry& geometry, Intersector kind, const PredicateRay& ray,
                  const Hit& hit) {
  HitCheck result;
  if (hit.triangle == kNoTriangle) return result;
  const auto [a, b, c] = geometry.Corners(hit.triangle);
  const IntersectorCheck check = CheckIntersector(kind, ray, a, b, c);
  result.is_hit = true;
  result.certain = check.certain;
  result.denied = !check.hit;
  result.t_error = check.t_error;
  result.sliver = AspectRatio(a, b, c) >= kSliverAspect;
  result.edge = LeastWeight(ray, a, b, c) < kBesideEdge;
  result.end = !(hit.t > check.t_error) || (ray.segment && !(hit.t < 1 - check.t_error));
  return result;
}

}  // namespace

double AspectRatio(Vec3f a, Vec3f b, Vec3f c) {
  const Vec3d ab = ToDouble(b) - ToDouble(a), ac = ToDouble(c) - ToDouble(a), bc = ac - ab;
  const Vec3d n = Cross(ab, ac);
  const double longest = std::max({Dot(ab, ab), Dot(ac, ac), Dot(bc, bc)});
  const double area2 = std::sqrt(Dot(n, n));
  return area2 > 0 ? longest / area2 : std::numeric_limits<double>::infinity();
}

Difference CompareHits(const SceneGeometry& geometry, Intersector kind, const PredicateRay& ray,
                       const Hit& hit, const Hit& truth, bool edges_left_out) {
  if (SameBits(hit, truth)) return Difference::kNone;
  const HitCheck found = CheckHit(geometry, kind, ray, hit);
  const HitCheck true_one = CheckHit(geometry, kind, ray, truth);
  const bool tie =
      found.is_hit && true_one.is_hit &&
      !(std::abs(static_cast<double>(hit.t) - truth.t) > found.t_error + true_one.t_error);
  // A walk puts the ray to some of the triangles, by the same test: it may lose a hit in doubt to
  // a box that the ray passes by, but no certain one, and it finds none that is nearer.
  // Without the edges' tests it may find one that they deny in doubt, whatever that hides.
  const bool nearer = found.is_hit && (!true_one.is_hit || hit.t < truth.t);
  const bool lost = true_one.is_hit && true_one.certain;
  if (nearer && found.denied && edges_left_out) {
    if (found.certain) return Difference::kBeyondBound;
    return found.sliver ? Difference::kSliver : found.edge ? Difference::kEdge : Difference::kPlain;
  }
  if (!tie && ((found.certain && true_one.certain) || nearer || lost))
    return Difference::kBeyondBound;
  return found.sliver || true_one.sliver ? Difference::kSliver
         : found.edge || true_one.edge   ? Difference::kEdge
         : found.end || true_one.end     ? Difference::kEnd
         : tie                           ? Difference::kTie
                                         : Difference::kPlain;
}

int64_t DifferenceTally::compared() const {
  return std::accumulate(counts_.begin(), counts_.end(), int64_t{0});
}

std::ostream& operator<<(std::ostream& out, const DifferenceTally& tally) {
  constexpr std::array<const char*, kDifferences> kNames = {
      "same", "by slivers", "beside edges", "at ends", "in ties", "plain", "beyond the bound"};
  out << tally.compared() << " compared";
  for (int i = 0; i < kDifferences; ++i) {
    if (tally.counts_[i] != 0) out << ", " << tally.counts_[i] << ' ' << kNames[i];
  }
  return out;
}

}  // namespace sightline::testing_support

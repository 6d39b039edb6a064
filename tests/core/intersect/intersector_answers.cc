// SPDX-License-Identifier: Apache-2.0
#include "tests/core/intersect/intersector_answers.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <numeric>

#include "core/geometry/vec3.h"
#include "core/intersect/intersector_check.h"

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

bool SameBits(const Hit& a, const Hit& b) {
  return a.triangle == b.triangle && std::bit_cast<uint32_t>(a.t) == std::bit_cast<uint32_t>(b.t);
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
                       const Hit& hit, const Hit& truth) {
  if (SameBits(hit, truth)) return Difference::kNone;
  bool sliver = false, edge = false, end = false, certain = true;
  bool truth_certain = false;
  double reach = 0;
  const Hit at[] = {hit, truth};
  for (const Hit& one : at) {
    if (one.triangle == kNoTriangle) continue;
    const auto [a, b, c] = geometry.Corners(one.triangle);
    const IntersectorCheck check = CheckIntersector(kind, ray, a, b, c);
    certain &= check.certain;
    if (&one == &at[1]) truth_certain = check.certain;
    reach += check.t_error;
    sliver |= AspectRatio(a, b, c) >= kSliverAspect;
    edge |= LeastWeight(ray, a, b, c) < kBesideEdge;
    end |= !(one.t > check.t_error) || (ray.segment && !(one.t < 1 - check.t_error));
  }
  const bool tie = hit.triangle != kNoTriangle && truth.triangle != kNoTriangle &&
                   !(std::abs(static_cast<double>(hit.t) - truth.t) > reach);
  // A walk puts the ray to some of the triangles, by the same test: it may lose a hit in doubt to
  // a box that the ray passes by, but no certain one, and it finds none that is nearer.
  const bool nearer =
      hit.triangle != kNoTriangle && (truth.triangle == kNoTriangle || hit.t < truth.t);
  const bool lost = truth.triangle != kNoTriangle && truth_certain;
  if (!tie && (certain || nearer || lost)) return Difference::kBeyondBound;
  return sliver ? Difference::kSliver
         : edge ? Difference::kEdge
         : end  ? Difference::kEnd
         : tie  ? Difference::kTie
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

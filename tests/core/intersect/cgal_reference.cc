// SPDX-License-Identifier: Apache-2.0
#include "tests/core/intersect/cgal_reference.h"

#include <CGAL/Exact_predicates_exact_constructions_kernel.h>
#include <CGAL/determinant.h>

namespace sightline::testing_support {
namespace {

using Kernel = CGAL::Exact_predicates_exact_constructions_kernel;
using Number = Kernel::FT;
using Point = Kernel::Point_3;
using Vector = Kernel::Vector_3;

Point ToPoint(Vec3f v) { return Point(double{v.x}, double{v.y}, double{v.z}); }
Vector ToVector(Vec3f v) { return Vector(double{v.x}, double{v.y}, double{v.z}); }

int DeterminantSign(const Vector& x, const Vector& y, const Vector& z) {
  const Number value =
      CGAL::determinant(x.x(), x.y(), x.z(), y.x(), y.y(), y.z(), z.x(), z.y(), z.z());
  return static_cast<int>(CGAL::sign(value));
}

}  // namespace

int CgalSideOfPlane(Vec3f a, Vec3f b, Vec3f c, Vec3f p) {
  return static_cast<int>(CGAL::orientation(ToPoint(a), ToPoint(b), ToPoint(c), ToPoint(p)));
}

int CgalSideOfDirection(Vec3f a, Vec3f b, Vec3f c, Vec3f d) {
  const Point origin = ToPoint(a);
  return DeterminantSign(ToPoint(b) - origin, ToPoint(c) - origin, ToVector(d));
}

bool CgalBlocks(const PredicateRay& ray, Vec3f a, Vec3f b, Vec3f c) {
  int e[3];
  const Vec3f corners[3] = {a, b, c};
  for (int i = 0; i < 3; ++i) {
    const Vec3f p = corners[i], q = corners[(i + 1) % 3];
    e[i] = ray.segment ? CgalSideOfPlane(ray.origin, p, q, ray.target)
                       : CgalSideOfDirection(ray.origin, p, q, ray.target);
  }
  const bool no_negative = e[0] >= 0 && e[1] >= 0 && e[2] >= 0;
  const bool no_positive = e[0] <= 0 && e[1] <= 0 && e[2] <= 0;
  const bool all_zero = no_negative && no_positive;
  if (all_zero || !(no_negative || no_positive)) return false;
  const int origin_side = CgalSideOfPlane(a, b, c, ray.origin);
  const int target_side =
      ray.segment ? CgalSideOfPlane(a, b, c, ray.target) : CgalSideOfDirection(a, b, c, ray.target);
  return origin_side * target_side < 0;
}

}  // namespace sightline::testing_support

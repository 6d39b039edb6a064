// SPDX-License-Identifier: Apache-2.0
#include "core/intersect/predicate.h"

#include <cmath>

#include "core/geometry/exact_sum.h"

namespace sightline {
namespace {

struct Determinant {
  double value;
  double bound;
  // -1, +1, or 0 for "in doubt or zero".
  int sign() const { return value > bound ? 1 : value < -bound ? -1 : 0; }
  // Each of its products has a factor that is zero: products of three numbers that are not, floats
  // or differences of floats, do not underflow.
  bool zero() const { return bound == 0; }
};

Determinant TripleProduct(Vec3d x, Vec3d y, Vec3d z) {
  const double px = x.y * y.z, qx = x.z * y.y;
  const double py = x.z * y.x, qy = x.x * y.z;
  const double pz = x.x * y.y, qz = x.y * y.x;
  const double value = ((px - qx) * z.x + (py - qy) * z.y) + (pz - qz) * z.z;
  const double permanent = ((std::abs(px) + std::abs(qx)) * std::abs(z.x) +
                            (std::abs(py) + std::abs(qy)) * std::abs(z.y)) +
                           (std::abs(pz) + std::abs(qz)) * std::abs(z.z);
  return {value, kDoubleBound * permanent};
}

// Adds sign · det(x, y, z). The product of two floats is exact in double, the third comes by
// TwoProduct: 12 terms.
template <int kCapacity>
void AddDeterminant(ExactSum<kCapacity>& sum, double sign, Vec3f xf, Vec3f yf, Vec3f zf) {
  const Vec3d x = ToDouble(xf), y = ToDouble(yf), z = ToDouble(zf);
  sum.AddProduct(sign * (x.x * y.y), z.z);
  sum.AddProduct(-sign * (x.x * y.z), z.y);
  sum.AddProduct(sign * (x.y * y.z), z.x);
  sum.AddProduct(-sign * (x.y * y.x), z.z);
  sum.AddProduct(sign * (x.z * y.x), z.y);
  sum.AddProduct(-sign * (x.z * y.y), z.x);
}

// Exact sign of det(p-o, q-o, r-o) = [pqr] - [oqr] - [por] - [pqo].
int SignOfPoints(Vec3f p, Vec3f q, Vec3f r, Vec3f o) {
  ExactSum<48> sum;
  AddDeterminant(sum, 1, p, q, r);
  AddDeterminant(sum, -1, o, q, r);
  AddDeterminant(sum, -1, p, o, r);
  AddDeterminant(sum, -1, p, q, o);
  return sum.sign();
}

// Exact sign of det(p-o, q-o, d) = [pqd] - [oqd] - [pod].
int SignOfDirection(Vec3f p, Vec3f q, Vec3f d, Vec3f o) {
  ExactSum<36> sum;
  AddDeterminant(sum, 1, p, q, d);
  AddDeterminant(sum, -1, o, q, d);
  AddDeterminant(sum, -1, p, o, d);
  return sum.sign();
}

bool Combine(int e0, int e1, int e2, int side_of_origin, int toward) {
  if (side_of_origin == 0 || toward != -side_of_origin) return false;
  const bool any_positive = e0 > 0 || e1 > 0 || e2 > 0;
  const bool any_negative = e0 < 0 || e1 < 0 || e2 < 0;
  return any_positive != any_negative;
}

}  // namespace

int SideOfPlane(Vec3f a, Vec3f b, Vec3f c, Vec3f p) {
  const Vec3d ad = ToDouble(a);
  const Determinant det = TripleProduct(ToDouble(b) - ad, ToDouble(c) - ad, ToDouble(p) - ad);
  if (const int sign = det.sign(); sign != 0 || det.zero()) return sign;
  return SignOfPoints(b, c, p, a);
}

int SideOfDirection(Vec3f a, Vec3f b, Vec3f c, Vec3f direction) {
  const Vec3d ad = ToDouble(a);
  const Determinant det = TripleProduct(ToDouble(b) - ad, ToDouble(c) - ad, ToDouble(direction));
  if (const int sign = det.sign(); sign != 0 || det.zero()) return sign;
  return SignOfDirection(b, c, direction, a);
}

bool BlocksExactly(const PredicateRay& ray, Vec3f a, Vec3f b, Vec3f c) {
  const Vec3f o = ray.origin, t = ray.target;
  const int side_of_origin = SignOfPoints(b, c, o, a);
  if (ray.segment) {
    return Combine(SignOfPoints(a, b, t, o), SignOfPoints(b, c, t, o), SignOfPoints(c, a, t, o),
                   side_of_origin, SignOfPoints(b, c, t, a));
  }
  return Combine(SignOfDirection(a, b, t, o), SignOfDirection(b, c, t, o),
                 SignOfDirection(c, a, t, o), side_of_origin, SignOfDirection(b, c, t, a));
}

bool Blocks(const PredicateRay& ray, Vec3f a, Vec3f b, Vec3f c, PredicateStage* stage) {
  if (stage != nullptr) *stage = PredicateStage::kDouble;
  const Vec3d od = ToDouble(ray.origin), td = ToDouble(ray.target);
  const Vec3d ad = ToDouble(a), bd = ToDouble(b), cd = ToDouble(c);
  const Vec3d d = ray.segment ? td - od : td;
  const Vec3d ab = bd - ad, bc = cd - bd, ca = ad - cd;
  const int e0 = TripleProduct(ad - od, ab, d).sign();
  const int e1 = TripleProduct(bd - od, bc, d).sign();
  const int e2 = TripleProduct(cd - od, ca, d).sign();
  const bool any_positive = e0 > 0 || e1 > 0 || e2 > 0;
  const bool any_negative = e0 < 0 || e1 < 0 || e2 < 0;
  if (any_positive && any_negative) return false;

  const int side_of_origin = TripleProduct(ab, bc, od - ad).sign();
  // An edge's certain sign is that of N·D, should the line cross the triangle at all; then the
  // origin must lie on the other side.
  if ((any_positive && side_of_origin > 0) || (any_negative && side_of_origin < 0)) return false;
  const int toward = TripleProduct(ab, bc, ray.segment ? td - ad : td).sign();
  if (side_of_origin != 0 && toward == side_of_origin) return false;
  const bool certain = e0 != 0 && e1 != 0 && e2 != 0 && side_of_origin != 0 && toward != 0;
  if (certain) return true;  // All edges agree, and the ends lie on opposite sides.

  if (stage != nullptr) *stage = PredicateStage::kExact;
  return BlocksExactly(ray, a, b, c);
}

}  // namespace sightline

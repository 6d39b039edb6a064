// SPDX-License-Identifier: Apache-2.0
#include "core/intersect/hit.h"

#include "core/geometry/box3.h"
#include "core/geometry/box_ray.h"

namespace sightline {

float HitDistance(const PredicateRay& ray, Vec3f a, Vec3f b, Vec3f c) {
  const Vec3d o = ToDouble(ray.origin), ad = ToDouble(a);
  const Vec3d d = ray.segment ? ToDouble(ray.target) - o : ToDouble(ray.target);
  const Vec3d n = Cross(ToDouble(b) - ad, ToDouble(c) - ad);
  float t = static_cast<float>(Dot(n, ad - o) * (1.0 / Dot(n, d)));

  Box3f box;
  box.Extend(a);
  box.Extend(b);
  box.Extend(c);
  const BoxRay box_ray = BoxRay::Make(ray.origin, ray.RoundedDirection());
  // The order matters: a rounded exit may lie before the rounded entry, and the entry must win. The
  // negations let a product of 0 and inf pass to the bounds, and the last one turns -0 into 0.
  if (ray.segment && !(t <= 1)) t = 1;  // The normal of a sliver may be off by all of its bits.
  const float exit = BoxExit(box_ray, box);
  if (!(t <= exit)) t = exit;
  const float entry = BoxEntry(box_ray, box);
  if (!(t >= entry)) t = entry;
  if (!(t > 0)) t = 0;
  return t;
}

void HitBarycentrics(const PredicateRay& ray, Vec3f a, Vec3f b, Vec3f c, float* u, float* v) {
  const Vec3d o = ToDouble(ray.origin);
  const Vec3d d = ray.segment ? ToDouble(ray.target) - o : ToDouble(ray.target);
  const Vec3d ad = ToDouble(a), bd = ToDouble(b), cd = ToDouble(c);
  const double e0 = Dot(Cross(ad - o, bd - ad), d);
  const double e2 = Dot(Cross(cd - o, ad - cd), d);
  const double reciprocal = 1.0 / Dot(Cross(bd - ad, cd - ad), d);
  const auto share = [reciprocal](double e) {
    const double s = e * reciprocal;
    return static_cast<float>(s > 0 ? (s < 1 ? s : 1.0)
                                    : 0.0);  // NaN (a sum lost to rounding) gives 0.
  };
  *u = share(e2);
  *v = share(e0);
}

}  // namespace sightline

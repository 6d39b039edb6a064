// SPDX-License-Identifier: Apache-2.0
//
// The predicate's definition once more, in CGAL's exact kernel: nothing of ours takes part in it.
// Test-only.
//
// Thread safety: functions only.
#ifndef SIGHTLINE_TESTS_CORE_INTERSECT_CGAL_REFERENCE_H_
#define SIGHTLINE_TESTS_CORE_INTERSECT_CGAL_REFERENCE_H_

#include "core/geometry/vec3.h"
#include "core/intersect/predicate.h"

namespace sightline::testing_support {

// Whether ABC blocks the ray, by the two conditions at the head of core/intersect/predicate.h.
bool CgalBlocks(const PredicateRay& ray, Vec3f a, Vec3f b, Vec3f c);
// The signs of det(B-A, C-A, P-A) and det(B-A, C-A, D).
int CgalSideOfPlane(Vec3f a, Vec3f b, Vec3f c, Vec3f p);
int CgalSideOfDirection(Vec3f a, Vec3f b, Vec3f c, Vec3f d);

}  // namespace sightline::testing_support

#endif  // SIGHTLINE_TESTS_CORE_INTERSECT_CGAL_REFERENCE_H_

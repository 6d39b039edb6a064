// SPDX-License-Identifier: Apache-2.0
//
// Pairs of a ray or segment and a triangle that are meant to break a predicate: random ones, ones
// constructed on an edge, a vertex or the plane and then rounded, moved by single ulps or hit
// exactly, degenerate triangles, and coordinates from 2^-149 to 2^40.
//
// Invariants: everything is finite, |coordinate| <= 2^40, |component of a direction| <= 2^40.
//
// Thread safety: none.
//
//   TestRng rng;
//   TriangleCases cases(rng);
//   const TriangleCase c = cases.Next();   // c.ray, c.a, c.b, c.c, c.kind
#ifndef SIGHTLINE_TESTS_CORE_INTERSECT_TRIANGLE_CASES_H_
#define SIGHTLINE_TESTS_CORE_INTERSECT_TRIANGLE_CASES_H_

#include <ostream>
#include <string>

#include "core/geometry/vec3.h"
#include "core/intersect/predicate.h"
#include "tests/support/random.h"

namespace sightline::testing_support {

struct TriangleCase {
  PredicateRay ray;
  Vec3f a, b, c;
  const char* kind = "";
};

// In hexadecimal floats, so that a failure can be written down as a test.
std::ostream& operator<<(std::ostream& out, const TriangleCase& c);
std::string Hex(Vec3f v);

// `x` moved by `steps` representable floats.
float MoveByUlps(float x, int steps);
// Within ±2^40.
Vec3f ClampToRange(Vec3f v);

class TriangleCases {
 public:
  explicit TriangleCases(TestRng& rng) : rng_(rng) {}

  TriangleCase Next();
  // Counts of Next() by kind go round robin: every `kKinds` calls see each kind once.
  static constexpr int kKinds = 18;

 private:
  Vec3f Random(double scale);
  Vec3f Integer(int range, float scale);
  void AimAt(TriangleCase& c, Vec3d point);
  void Jitter(Vec3f& v);

  TestRng& rng_;
  int next_ = 0;
};

}  // namespace sightline::testing_support

#endif  // SIGHTLINE_TESTS_CORE_INTERSECT_TRIANGLE_CASES_H_

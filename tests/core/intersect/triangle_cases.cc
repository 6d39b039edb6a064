// SPDX-License-Identifier: Apache-2.0
#include "tests/core/intersect/triangle_cases.h"

#include <bit>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <limits>

namespace sightline::testing_support {
namespace {

constexpr float kRange = 0x1p40f;

float ClampToRange(float x) { return std::fmin(std::fmax(x, -kRange), kRange); }

// The double-rounded sum or product is not exact: that is the point of the near-degenerate kinds.
Vec3d Mix(Vec3f a, Vec3f b, double w) { return ToDouble(a) * (1 - w) + ToDouble(b) * w; }

}  // namespace

std::string Hex(Vec3f v) {
  char text[96];
  std::snprintf(text, sizeof(text), "{%af, %af, %af}", v.x, v.y, v.z);
  return text;
}

std::ostream& operator<<(std::ostream& out, const TriangleCase& c) {
  return out << c.kind << ": " << (c.ray.segment ? "Segment(" : "Ray(") << Hex(c.ray.origin) << ", "
             << Hex(c.ray.target) << ") against " << Hex(c.a) << ", " << Hex(c.b) << ", "
             << Hex(c.c);
}

float MoveByUlps(float x, int steps) {
  const float end =
      steps > 0 ? std::numeric_limits<float>::infinity() : -std::numeric_limits<float>::infinity();
  for (int i = 0; i < std::abs(steps); ++i) x = std::nextafter(x, end);
  return x;
}

Vec3f ClampToRange(Vec3f v) { return {ClampToRange(v.x), ClampToRange(v.y), ClampToRange(v.z)}; }

Vec3f TriangleCases::Random(double scale) {
  return ToFloat(
      Vec3d{rng_.Uniform(-1, 1) * scale, rng_.Uniform(-1, 1) * scale, rng_.Uniform(-1, 1) * scale});
}

Vec3f TriangleCases::Integer(int range, float scale) {
  const auto one = [&] {
    return static_cast<float>(static_cast<int>(rng_.Below(2 * range + 1)) - range) * scale;
  };
  const float x = one(), y = one(), z = one();
  return {x, y, z};
}

void TriangleCases::Jitter(Vec3f& v) {
  const int axis = static_cast<int>(rng_.Below(3));
  v[axis] = MoveByUlps(v[axis], static_cast<int>(rng_.Below(7)) - 3);
}

// The segment from c.ray.origin through `point` and beyond it, or short of it, or ending at it.
void TriangleCases::AimAt(TriangleCase& c, Vec3d point) {
  constexpr double kLengths[] = {0.5, 0.999, 1.0, 1.0, 1.0000001, 1.5, 2.0, 2.0, 3.0, 100.0};
  const double s = kLengths[rng_.Below(std::size(kLengths))];
  const Vec3d o = ToDouble(c.ray.origin);
  c.ray.target = ToFloat(o + (point - o) * s);
}

TriangleCase TriangleCases::Next() {
  TriangleCase c;
  const int kind = next_++ % kKinds;
  const double scale = std::ldexp(1.0, static_cast<int>(rng_.Below(60)) - 30);
  c.a = Random(scale);
  c.b = Random(scale);
  c.c = Random(scale);
  c.ray = PredicateRay::Segment(Random(scale), Random(scale));
  switch (kind) {
    case 0:
      c.kind = "random";
      break;
    case 1: {
      c.kind = "random bits";
      for (Vec3f* v : {&c.a, &c.b, &c.c, &c.ray.origin, &c.ray.target}) {
        for (int k = 0; k < 3; ++k) (*v)[k] = rng_.AnyFloat();
      }
      break;
    }
    case 2:
      c.kind = "aimed at a point on an edge, rounded";
      AimAt(c, Mix(c.a, c.b, rng_.Uniform(0, 1)));
      break;
    case 3:
      c.kind = "aimed at a vertex, rounded";
      AimAt(c, ToDouble(c.b));
      break;
    case 4: {
      c.kind = "small integers: zeros of every sort";
      const float unit = std::ldexp(1.0f, static_cast<int>(rng_.Below(60)) - 30);
      for (Vec3f* v : {&c.a, &c.b, &c.c, &c.ray.origin, &c.ray.target}) *v = Integer(2, unit);
      break;
    }
    case 5: {
      c.kind = "through a vertex or an edge's middle exactly";
      for (Vec3f* v : {&c.a, &c.b, &c.c, &c.ray.origin}) *v = Integer(1 << 18, 2.0f);
      const Vec3f at = rng_.Chance(0.5) ? c.c : (c.a + c.c) * 0.5f;
      c.ray.target = (at - c.ray.origin) * 2.0f + c.ray.origin;
      break;
    }
    case 6: {
      c.kind = "an end in the plane exactly";
      const Vec3f a = Integer(1000, 1.0f), e = Integer(1000, 1.0f), f = Integer(1000, 1.0f);
      c.a = a;
      c.b = a + e;
      c.c = a + f;
      const float i = static_cast<float>(rng_.Below(9)) - 4,
                  j = static_cast<float>(rng_.Below(9)) - 4;
      const Vec3f in_plane = a + e * i + f * j;
      (rng_.Chance(0.5) ? c.ray.origin : c.ray.target) = in_plane;
      if (rng_.Chance(0.2)) {  // Both.
        c.ray.origin = a + e * j;
        c.ray.target = in_plane;
      }
      break;
    }
    case 7:
      c.kind = "zero area";
      if (rng_.Chance(0.3)) {
        c.c = rng_.Chance(0.5) ? c.a : c.b;
      } else if (rng_.Chance(0.5)) {
        c.a = Integer(1000, 1.0f);
        const Vec3f e = Integer(1000, 1.0f);
        c.b = c.a + e;
        c.c = c.a + e * 3.0f;
      } else {
        c.b = c.a;
        c.c = c.a;
      }
      if (rng_.Chance(0.5)) AimAt(c, ToDouble(c.c));
      break;
    case 8:
      c.kind = "sliver";
      c.c = ToFloat(Mix(c.a, c.b, rng_.Uniform(-0.5, 1.5)));
      AimAt(c, Mix(c.a, c.c, rng_.Uniform(0, 1)));
      break;
    case 9: {
      c.kind = "subnormal lattice";
      const int range = 1 << (1 + rng_.Below(20));
      for (Vec3f* v : {&c.a, &c.b, &c.c, &c.ray.origin, &c.ray.target})
        *v = Integer(range, 0x1p-149f);
      break;
    }
    case 10: {
      c.kind = "at the bound";
      for (Vec3f* v : {&c.a, &c.b, &c.c, &c.ray.origin, &c.ray.target}) {
        for (int k = 0; k < 3; ++k) {
          (*v)[k] = std::copysign(MoveByUlps(kRange, -static_cast<int>(rng_.Below(3))),
                                  rng_.Chance(0.5) ? 1.0f : -1.0f);
        }
      }
      break;
    }
    case 11: {
      c.kind = "mixed scales";
      for (Vec3f* v : {&c.a, &c.b, &c.c, &c.ray.origin, &c.ray.target}) {
        for (int k = 0; k < 3; ++k) {
          (*v)[k] = static_cast<float>(
              std::ldexp(rng_.Uniform(-1, 1), static_cast<int>(rng_.Below(189)) - 148));
        }
      }
      if (rng_.Chance(0.5)) AimAt(c, Mix(c.a, c.b, rng_.Uniform(0, 1)));
      break;
    }
    case 12: {
      c.kind = "far from the origin";
      const Vec3f base = Random(std::ldexp(1.0, 10 + static_cast<int>(rng_.Below(28))));
      for (Vec3f* v : {&c.a, &c.b, &c.c, &c.ray.origin})
        *v = *v * static_cast<float>(1 / scale) + base;
      AimAt(c, Mix(c.a, c.b, rng_.Uniform(0, 1)));
      break;
    }
    case 13: {
      c.kind = "shared corners";
      Vec3f* const corners[] = {&c.a, &c.b, &c.c};
      c.ray.origin = *corners[rng_.Below(3)];
      if (rng_.Chance(0.3)) c.ray.target = *corners[rng_.Below(3)];
      if (rng_.Chance(0.3)) std::swap(c.ray.origin, c.ray.target);
      if (rng_.Chance(0.1)) c.ray.target = c.ray.origin;
      break;
    }
    case 14: {
      c.kind = "an end near the plane";
      const double u = rng_.Uniform(-1, 2), v = rng_.Uniform(-1, 2);
      const Vec3d at = ToDouble(c.a) * (1 - u - v) + ToDouble(c.b) * u + ToDouble(c.c) * v;
      (rng_.Chance(0.5) ? c.ray.origin : c.ray.target) = ToFloat(at);
      break;
    }
    case 15: {
      c.kind = "axis-parallel";
      c.ray.target = c.ray.origin;
      const int axis = static_cast<int>(rng_.Below(3));
      c.ray.target[axis] = c.a[axis] * 2 - c.ray.origin[axis];
      if (rng_.Chance(0.5)) {  // Through a corner or along an edge's coordinate.
        const int other = (axis + 1) % 3;
        c.ray.origin[other] = c.ray.target[other] = c.b[other];
        if (rng_.Chance(0.5)) c.a[other] = c.b[other];
      }
      break;
    }
    case 16: {
      c.kind = "huge triangle, small ray";
      const double size = std::ldexp(1.0, static_cast<int>(rng_.Below(20)));
      c.a = c.a * static_cast<float>(size);
      c.b = c.b * static_cast<float>(size);
      c.c = c.c * static_cast<float>(size);
      const double u = rng_.Uniform(0, 1), v = rng_.Uniform(0, 1 - u);
      const Vec3d at = ToDouble(c.a) * (1 - u - v) + ToDouble(c.b) * u + ToDouble(c.c) * v;
      c.ray.origin = ToFloat(at + ToDouble(Random(scale)));
      AimAt(c, at);
      break;
    }
    default: {
      c.kind = "a lattice far from the origin";
      const Vec3f base = Integer(1 << 20, 8.0f);
      for (Vec3f* v : {&c.a, &c.b, &c.c, &c.ray.origin, &c.ray.target})
        *v = Integer(3, 1.0f) + base;
      break;
    }
  }
  if (rng_.Chance(0.25)) {
    for (Vec3f* v : {&c.a, &c.b, &c.c, &c.ray.origin, &c.ray.target}) {
      if (rng_.Chance(0.3)) Jitter(*v);
    }
  }
  c.a = ClampToRange(c.a);
  c.b = ClampToRange(c.b);
  c.c = ClampToRange(c.c);
  c.ray.origin = ClampToRange(c.ray.origin);
  c.ray.target = ClampToRange(c.ray.target);
  if (rng_.Chance(0.4)) {
    // As a direction: rounded, sometimes scaled (underflow may bend it: it is what it is then).
    Vec3f d = c.ray.target - c.ray.origin;
    if (rng_.Chance(0.3)) d = d * std::ldexp(1.0f, -static_cast<int>(rng_.Below(120)));
    if (rng_.Chance(0.1)) d[static_cast<int>(rng_.Below(3))] = rng_.Chance(0.5) ? 0.0f : -0.0f;
    c.ray = PredicateRay::Ray(c.ray.origin, ClampToRange(d));
  }
  return c;
}

}  // namespace sightline::testing_support

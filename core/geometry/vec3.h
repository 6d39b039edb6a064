// SPDX-License-Identifier: Apache-2.0
//
// Three-component vectors of floats (stored coordinates, relative to a scene's origin) and of
// doubles (world coordinates). Every operation is written in one fixed order and compiled without
// contraction, so the same operands give the same bits on every machine.
//
// Thread safety: plain values.
#ifndef SIGHTLINE_CORE_GEOMETRY_VEC3_H_
#define SIGHTLINE_CORE_GEOMETRY_VEC3_H_

#include <cmath>

namespace sightline {

template <typename T>
struct Vec3 {
  T x{}, y{}, z{};

  constexpr T& operator[](int axis) { return axis == 0 ? x : axis == 1 ? y : z; }
  constexpr const T& operator[](int axis) const { return axis == 0 ? x : axis == 1 ? y : z; }

  friend constexpr Vec3 operator+(Vec3 a, Vec3 b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
  friend constexpr Vec3 operator-(Vec3 a, Vec3 b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
  friend constexpr Vec3 operator-(Vec3 a) { return {-a.x, -a.y, -a.z}; }
  friend constexpr Vec3 operator*(Vec3 a, T s) { return {a.x * s, a.y * s, a.z * s}; }
  friend constexpr Vec3 operator*(T s, Vec3 a) { return a * s; }
  // Not defaulted: a vector of SIMD vectors, whose == gives no bool, must be a type.
  friend constexpr bool operator==(const Vec3& a, const Vec3& b) {
    return a.x == b.x && a.y == b.y && a.z == b.z;
  }
};

using Vec3f = Vec3<float>;
using Vec3d = Vec3<double>;

// (x·x' + y·y') + z·z'.
template <typename T>
constexpr T Dot(Vec3<T> a, Vec3<T> b) {
  return (a.x * b.x + a.y * b.y) + a.z * b.z;
}

template <typename T>
constexpr Vec3<T> Cross(Vec3<T> a, Vec3<T> b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

template <typename T>
T Length(Vec3<T> a) {
  return std::sqrt(Dot(a, a));
}

// The largest of |x|, |y|, |z|; NaN if a component is NaN.
template <typename T>
T MaxAbs(Vec3<T> a) {
  T m = std::abs(a.x);
  m = std::abs(a.y) > m || std::isnan(a.y) ? std::abs(a.y) : m;
  m = std::abs(a.z) > m || std::isnan(a.z) ? std::abs(a.z) : m;
  return m;
}

template <typename T>
bool IsFinite(Vec3<T> a) {
  return std::isfinite(a.x) && std::isfinite(a.y) && std::isfinite(a.z);
}

// Each component rounded once, to nearest.
inline Vec3f ToFloat(Vec3d a) {
  return {static_cast<float>(a.x), static_cast<float>(a.y), static_cast<float>(a.z)};
}
inline Vec3d ToDouble(Vec3f a) { return {a.x, a.y, a.z}; }

}  // namespace sightline

#endif  // SIGHTLINE_CORE_GEOMETRY_VEC3_H_

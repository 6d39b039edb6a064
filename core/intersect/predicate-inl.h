// SPDX-License-Identifier: Apache-2.0
//
// The predicate's float stage (see predicate.h), one source for every SIMD target: many triangles
// against one origin at a time. It says "blocks", "does not", or "in doubt"; lanes in doubt go to
// Blocks().
//
// Formulation. With O the origin, the edge vectors e are taken between stored vertices and the apex
// vectors from O:
//     det(A-O, B-O, D) = ((A-O) × (B-A))·D,   N = (B-A) × (C-B),   N·(A-O),   N·(P-A).
// Rounding is then proportional to distance times edge length, not distance squared (measured:
// 0.006-0.04 % of lanes in doubt, against 2-38 % for ((A-O) × (B-O))·D).
//
// Error bound. (x × y)·z, where x, y and z each carry one relative rounding of u = 2^-24 per
// component, suffers at most 8 roundings per product of three components (three inputs, product,
// difference, product, two sums; fused multiply-adds do some at once): the error is at most 8(1 +
// 9u)u times the permanent of |x|, |y|, |z|, and that is at most |x|_1·|y|_1·|z|_inf (it sums
// |x_i||y_j||z_k| over distinct i, j, k). Its computed value carries at most 3 roundings of each
// 1-norm (difference, two sums), 1 of |z|_inf and 3 of the products: 8(1 + 9u)(1 + 10u) < 9 =
// kFloatUnits. The permanent itself, by components of z, is computed with 3 roundings of inputs, 2
// of each component, 1 of the units' product and 3 of the sum, and is as good; where z lies in a
// level or upright triangle's plane it is far less (bounds of normals, below, and of packets' and
// shafts' forms). Underflow adds at most 2^-149 to a cross product's component (scaled by that of z
// later) and 2^-148 to the sum, and takes as little from the bound: kFloatUnderflow covers all.
// Nothing overflows: with coordinates within R, differences are within 2R, components of a cross
// product within 8R², sums of three products within 48R³, which is 2^125.6 for R = 2^40 and below
// the largest float for R = 1.5·2^40. Measured (float_stage_test): the largest error that a hill
// climb finds is 0.53 of its bound.
//
// Thread safety: pure functions.

#if defined(SIGHTLINE_CORE_INTERSECT_PREDICATE_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_INTERSECT_PREDICATE_INL_H_
#undef SIGHTLINE_CORE_INTERSECT_PREDICATE_INL_H_
#else
#define SIGHTLINE_CORE_INTERSECT_PREDICATE_INL_H_
#endif

#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

constexpr float kFloatUnits = 9 * 0x1p-24f;
constexpr float kFloatUnderflow = 0x1p-126f;

template <class V>
struct Vec3V {
  V x, y, z;
};

template <class D, class V = hn::Vec<D>>
HWY_INLINE Vec3V<V> Broadcast(D d, float x, float y, float z) {
  return {hn::Set(d, x), hn::Set(d, y), hn::Set(d, z)};
}

template <class V>
HWY_INLINE Vec3V<V> SubV(const Vec3V<V>& a, const Vec3V<V>& b) {
  return {hn::Sub(a.x, b.x), hn::Sub(a.y, b.y), hn::Sub(a.z, b.z)};
}

template <class V>
HWY_INLINE Vec3V<V> CrossV(const Vec3V<V>& a, const Vec3V<V>& b) {
  return {hn::MulSub(a.y, b.z, hn::Mul(a.z, b.y)), hn::MulSub(a.z, b.x, hn::Mul(a.x, b.z)),
          hn::MulSub(a.x, b.y, hn::Mul(a.y, b.x))};
}

template <class V>
HWY_INLINE V DotV(const Vec3V<V>& a, const Vec3V<V>& b) {
  return hn::MulAdd(a.x, b.x, hn::MulAdd(a.y, b.y, hn::Mul(a.z, b.z)));
}

template <class V>
HWY_INLINE V Norm1V(const Vec3V<V>& a) {
  return hn::Add(hn::Add(hn::Abs(a.x), hn::Abs(a.y)), hn::Abs(a.z));
}

template <class V>
HWY_INLINE V NormInfV(const Vec3V<V>& a) {
  return hn::Max(hn::Max(hn::Abs(a.x), hn::Abs(a.y)), hn::Abs(a.z));
}

// The permanent of |x|, |y| and any |z| is this one's product with |z|.
template <class V>
HWY_INLINE Vec3V<V> PermanentV(const Vec3V<V>& x, const Vec3V<V>& y) {
  const Vec3V<V> a = {hn::Abs(x.x), hn::Abs(x.y), hn::Abs(x.z)};
  const Vec3V<V> b = {hn::Abs(y.x), hn::Abs(y.y), hn::Abs(y.z)};
  return {hn::MulAdd(a.y, b.z, hn::Mul(a.z, b.y)), hn::MulAdd(a.z, b.x, hn::Mul(a.x, b.z)),
          hn::MulAdd(a.x, b.y, hn::Mul(a.y, b.x))};
}

// How far (x × y)·z may be off, by the components of z, but for what underflow adds to the sum.
template <class D, class V = hn::Vec<D>>
HWY_INLINE Vec3V<V> CrossBound(D d, const Vec3V<V>& x, const Vec3V<V>& y) {
  const V units = hn::Set(d, kFloatUnits), underflow = hn::Set(d, kFloatUnderflow);
  const Vec3V<V> permanent = PermanentV(x, y);
  return {hn::MulAdd(units, permanent.x, underflow), hn::MulAdd(units, permanent.y, underflow),
          hn::MulAdd(units, permanent.z, underflow)};
}
// The same of one z, underflow included.
template <class D, class V = hn::Vec<D>>
HWY_INLINE V BoundAlong(D d, const Vec3V<V>& bound, const Vec3V<V>& z) {
  return hn::MulAdd(bound.x, hn::Abs(z.x),
                    hn::MulAdd(bound.y, hn::Abs(z.y),
                               hn::MulAdd(bound.z, hn::Abs(z.z), hn::Set(d, kFloatUnderflow))));
}

// Keeps GCC 12 from spilling a mask register of 8 or 16 bits by its own size where all 32 are read
// back: the others were whatever had been in that place of the stack before.
HWY_INLINE uint32_t InGeneralRegister(uint32_t bits) {
#if HWY_COMPILER_GCC_ACTUAL && HWY_TARGET <= HWY_AVX3
  asm("" : "+r"(bits));
#endif
  return bits;
}

// Keeps GCC 12 from reading what all of a triangle's forms are multiplied with from memory each
// time, so that the terms of the forms, of which there are more, are not broadcast beside.
template <class V>
HWY_INLINE void InVectorRegisters([[maybe_unused]] Vec3V<V>* v) {
#if HWY_COMPILER_GCC_ACTUAL && HWY_TARGET <= HWY_AVX3
  asm("" : "+v"(v->x.raw), "+v"(v->y.raw), "+v"(v->z.raw));
#endif
}

// Mask to integer, bit i for lane i. Only what StoreMaskBits wrote is read back, so that compilers
// keep it in a register.
template <class D, class M>
HWY_INLINE uint32_t MaskBits(D d, M mask) {
  uint8_t bytes[8];
  hn::StoreMaskBits(d, mask, bytes);
  if constexpr (hn::MaxLanes(D()) <= 8) {
    return InGeneralRegister(bytes[0]);
  } else {
    static_assert(hn::MaxLanes(D()) == 16);
    uint16_t bits;
    __builtin_memcpy(&bits, bytes, sizeof(bits));
    return InGeneralRegister(bits);
  }
}

// What the float stage needs of a vector of triangles, relative to one origin: linear forms in D
// and their bounds.
template <class V>
struct OriginTriangles {
  Vec3V<V> edge[3];  // edge[k]·D has the sign of e_k, if |edge[k]·D| > edge_bound[k]·|D|_inf +
                     // kFloatUnderflow.
  V edge_bound[3];
  Vec3V<V> normal, normal_bound;  // normal·(P-A) has P's side, if beyond BoundAlong(P-A).
  V origin_side;  // N·(A-O): positive when O is behind; in doubt up to origin_bound.
  V origin_bound;
  Vec3V<V> a;  // Corner A as stored.
};

// `rows` points at the triangles' first lane in row 0 of a leaf (core/accel/bvh.h), `stride` floats
// apart.
template <class D, class V = hn::Vec<D>>
HWY_INLINE OriginTriangles<V> PrepareTriangles(D d, const float* HWY_RESTRICT rows, size_t stride,
                                               const Vec3V<V>& origin) {
  const auto load = [&](int corner) HWY_ATTR -> Vec3V<V> {
    return {hn::LoadU(d, rows + (3 * corner) * stride),
            hn::LoadU(d, rows + (3 * corner + 1) * stride),
            hn::LoadU(d, rows + (3 * corner + 2) * stride)};
  };
  const Vec3V<V> a = load(0), b = load(1), c = load(2);
  const Vec3V<V> oa = SubV(a, origin), ob = SubV(b, origin), oc = SubV(c, origin);
  const Vec3V<V> ab = SubV(b, a), bc = SubV(c, b), ca = SubV(a, c);
  const V units = hn::Set(d, kFloatUnits), underflow = hn::Set(d, kFloatUnderflow);
  const V ab1 = Norm1V(ab), bc1 = Norm1V(bc), ca1 = Norm1V(ca);
  OriginTriangles<V> t;
  t.edge[0] = CrossV(oa, ab);
  t.edge[1] = CrossV(ob, bc);
  t.edge[2] = CrossV(oc, ca);
  t.edge_bound[0] = hn::MulAdd(units, hn::Mul(Norm1V(oa), ab1), underflow);
  t.edge_bound[1] = hn::MulAdd(units, hn::Mul(Norm1V(ob), bc1), underflow);
  t.edge_bound[2] = hn::MulAdd(units, hn::Mul(Norm1V(oc), ca1), underflow);
  t.normal = CrossV(ab, bc);
  t.normal_bound = CrossBound(d, ab, bc);
  t.origin_side = DotV(t.normal, oa);
  t.origin_bound = BoundAlong(d, t.normal_bound, oa);
  t.a = a;
  return t;
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard

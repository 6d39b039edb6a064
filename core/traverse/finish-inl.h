// SPDX-License-Identifier: Apache-2.0
//
// The last step of a closest-hit walk over a packet: exact distances, and weights where they are
// wanted, of the triangles that won. A walk that orders hits by bounds of their distance need not
// evaluate one for every candidate; neighbouring rays mostly share their winner, so that a triangle
// is set up once for several vectors of rays.
//
// Thread safety: pure functions.

#if defined(SIGHTLINE_CORE_TRAVERSE_FINISH_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_FINISH_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_FINISH_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_FINISH_INL_H_
#endif

#include <bit>
#include <limits>

#include "core/accel/indexed_geometry.h"
#include "core/intersect/hit-inl.h"
#include "core/traverse/trace_ray.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// Writes t (and u, v if packet.want_barycentrics) for packet.triangle, misses included.
inline void FinishHits(const SceneGeometry& geometry, RayPacket& packet) {
  const hn::CappedTag<float, 16> d;
  const hn::RebindToUnsigned<decltype(d)> du;
  using V = hn::Vec<decltype(d)>;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const Vec3V<V> o = Broadcast(d, packet.origin.x, packet.origin.y, packet.origin.z);
  uint32_t ready = kNoTriangle;  // The triangle that is set up.
  TriangleDistance distance;
  TriangleWeights weights;
  for (int i = 0; i < packet.count; i += lanes) {
    const auto ids = hn::Load(du, packet.triangle + i);
    const Vec3V<V> target = {hn::Load(d, packet.target_x + i), hn::Load(d, packet.target_y + i),
                             hn::Load(d, packet.target_z + i)};
    const Vec3V<V> inv = SlabReciprocals(d, packet.segments ? SubV(target, o) : target);
    V t = hn::Set(d, std::numeric_limits<float>::infinity());
    V u = hn::Zero(d), v = hn::Zero(d);
    uint32_t left = ~MaskBits(du, hn::Eq(ids, hn::Set(du, kNoTriangle))) & ((1u << lanes) - 1);
    if (packet.count - i < lanes) left &= (1u << (packet.count - i)) - 1;
    while (left != 0) {
      const uint32_t id = packet.triangle[i + std::countr_zero(left)];
      if (id != ready) {
        const auto [a, b, c] = geometry.Corners(id);
        distance = TriangleDistance::Make(packet.origin, a, b, c);
        if (packet.want_barycentrics) weights = TriangleWeights::Make(packet.origin, a, b, c);
        ready = id;
      }
      const auto same_u = hn::Eq(ids, hn::Set(du, id));
      const auto same = hn::RebindMask(d, same_u);
      if (packet.want_barycentrics) {
        V new_u, new_v;
        t = hn::IfThenElse(same,
                           HitDistances(d, distance, packet.origin, packet.segments, target, inv,
                                        &weights, &new_u, &new_v),
                           t);
        u = hn::IfThenElse(same, new_u, u);
        v = hn::IfThenElse(same, new_v, v);
      } else {
        t = hn::IfThenElse(
            same, HitDistances(d, distance, packet.origin, packet.segments, target, inv), t);
      }
      left &= ~MaskBits(du, same_u);
    }
    hn::Store(t, d, packet.t + i);
    if (packet.want_barycentrics) {
      hn::Store(u, d, packet.u + i);
      hn::Store(v, d, packet.v + i);
    }
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard

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

#include <algorithm>
#include <bit>
#include <limits>

#include "core/accel/indexed_geometry.h"
#include "core/intersect/hit-inl.h"
#include "core/traverse/trace_ray.h"
#include "hwy/cache_control.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// The terms of each lane's own triangle, for the lanes of `here`; those of others are any.
// REQUIRES: `any` is a triangle.
template <class D, bool kWeights, class VU>
HWY_NOINLINE void GatherTerms(const SceneGeometry& geometry, Vec3f origin, VU ids, uint32_t any,
                              uint32_t here, HitTerms<D, kWeights>* terms) {
  const D d;
  const hn::RebindToUnsigned<D> du;
  const hn::RebindToSigned<D> di;
  static_assert(sizeof(geometry.triangles[0]) == 3 * sizeof(uint32_t));
  static_assert(sizeof(Vec3f) == 3 * sizeof(float));
  const auto lanes = hn::LoadMaskBits(du, reinterpret_cast<const uint8_t*>(&here));
  const auto three_times = [](VU x) HWY_ATTR { return hn::Add(hn::Add(x, x), x); };
  const VU at = three_times(hn::IfThenElse(lanes, ids, hn::Set(du, any)));
  const uint32_t* indices = geometry.triangles.data()->data();
  const float* positions = &geometry.vertices.data()->x;
  Vec3V<hn::Vec<D>> corner[3];
  for (int k = 0; k < 3; ++k) {
    // Offsets stay below 2^31: MeshLimits.
    const VU vertex = three_times(hn::GatherIndex(du, indices + k, hn::BitCast(di, at)));
    const auto offset = hn::BitCast(di, vertex);
    corner[k] = {hn::GatherIndex(d, positions, offset), hn::GatherIndex(d, positions + 1, offset),
                 hn::GatherIndex(d, positions + 2, offset)};
  }
  terms->Make(origin, corner[0], corner[1], corner[2]);
}

// Triangles set up for exact distances from one origin, as many as a packet is likely to need.
class ReadyTriangles {
 public:
  // `geometry` must outlive it. Without `weights` it gives no terms with kWeights.
  ReadyTriangles(const SceneGeometry& geometry, Vec3f origin, bool weights)
      : geometry_(geometry), origin_(origin), weights_(weights) {
    std::fill_n(ready_, kReady, kNoTriangle);
  }

  const SceneGeometry& geometry() const { return geometry_; }

  // The terms of each lane's triangle, for the lanes of `here`, which is not zero; others are any.
  // ids[i] is that of lane i.
  template <class D, bool kWeights>
  HWY_INLINE void Fill(const uint32_t* ids, uint32_t here, HitTerms<D, kWeights>* terms) {
    const hn::RebindToUnsigned<D> du;
    const auto lanes = hn::Load(du, ids);
    const uint32_t first = ids[std::countr_zero(here)];
    uint32_t left = here & ~MaskBits(du, hn::Eq(lanes, hn::Set(du, first)));
    const TriangleTerms& ready = Get(first);
    terms->Set(ready.distance, &ready.weights);
    for (int blends = 1; left != 0; ++blends) {
      if (blends == kMostBlends) {
        GatherTerms(geometry_, origin_, lanes, first, here, terms);
        return;
      }
      const uint32_t id = ids[std::countr_zero(left)];
      const uint32_t same = left & MaskBits(du, hn::Eq(lanes, hn::Set(du, id)));
      const TriangleTerms& other = Get(id);
      terms->Blend(same, other.distance, &other.weights);
      left &= ~same;
    }
  }

 private:
  // Triangles kept, by the low bits of their ids: neighbouring vectors share theirs.
  static constexpr uint32_t kReady = 16;
  // Lanes of a vector with more triangles than this are set up each for itself.
  static constexpr int kMostBlends = 4;

  // Not set to anything before it is filled.
  union Slot {
    Slot() {}  // NOLINT(modernize-use-equals-default): defaulted, it would be deleted.
    TriangleTerms terms;
  };

  const TriangleTerms& Get(uint32_t id) {
    const uint32_t slot = id % kReady;
    TriangleTerms& terms = terms_[slot].terms;
    if (ready_[slot] != id) {
      const auto [a, b, c] = geometry_.Corners(id);
      terms.distance = TriangleDistance::Make(origin_, a, b, c);
      if (weights_) terms.weights = TriangleWeights::Make(origin_, a, b, c);
      ready_[slot] = id;
    }
    return terms;
  }

  const SceneGeometry& geometry_;
  const Vec3f origin_;
  const bool weights_;
  uint32_t ready_[kReady];
  Slot terms_[kReady];
};

template <bool kWeights>
class HitFinisher {
 public:
  HitFinisher(ReadyTriangles& ready, RayPacket& packet) : ready_(ready), packet_(packet) {}

  // Misses included.
  void Finish() {
    FetchCorners();
    FindOctant();
    const DU du;
    for (int i = 0; i < packet_.count; i += kLanes) {
      const int lanes = std::min(kLanes, packet_.count - i);
      const uint32_t used = static_cast<uint32_t>((uint64_t{1} << lanes) - 1);
      const auto missed = hn::Eq(hn::Load(du, packet_.triangle + i), hn::Set(du, kNoTriangle));
      FinishLanes(i, used & ~MaskBits(du, missed));
    }
  }

 private:
  using D = hn::CappedTag<float, 16>;
  using DU = hn::RebindToUnsigned<D>;
  using V = hn::Vec<D>;
  static constexpr int kLanes = static_cast<int>(hn::MaxLanes(D()));

  Vec3V<V> Targets(int i) const {
    const D d;
    return {hn::Load(d, packet_.target_x + i), hn::Load(d, packet_.target_y + i),
            hn::Load(d, packet_.target_z + i)};
  }

  Vec3V<V> Direction(int i) const {
    const Vec3f o = packet_.origin;
    const Vec3V<V> target = Targets(i);
    return packet_.segments ? SubV(target, Broadcast(D(), o.x, o.y, o.z)) : target;
  }

  // Asks for the corners of what each vector's first and last rays see, so that one comes from
  // memory while others do.
  void FetchCorners() const {
    const SceneGeometry& geometry = ready_.geometry();
    uint32_t last = kNoTriangle, ids[2 * RayPacket::kMaxRays / kLanes];
    int count = 0;
    for (int i = 0; i < packet_.count; i += kLanes) {
      for (const int lane : {i, std::min(i + kLanes, packet_.count) - 1}) {
        const uint32_t id = packet_.triangle[lane];
        if (id == last || id == kNoTriangle) continue;
        last = ids[count++] = id;
        hwy::Prefetch(&geometry.triangles[id]);
      }
    }
    for (int k = 0; k < count; ++k) {
      for (const uint32_t vertex : geometry.triangles[ids[k]]) {
        hwy::Prefetch(&geometry.vertices[vertex]);
      }
    }
  }

  // Whether all rays point into one octant, with no component that is zero or subnormal.
  void FindOctant() {
    const D d;
    const V infinity = hn::Set(d, std::numeric_limits<float>::infinity());
    V least[3] = {infinity, infinity, infinity};
    V most[3] = {hn::Neg(infinity), hn::Neg(infinity), hn::Neg(infinity)};
    for (int i = 0; i < packet_.count; i += kLanes) {
      // Lanes that are not in use repeat others (the walks pad packets).
      const Vec3V<V> v = Direction(i);
      least[0] = hn::Min(least[0], v.x);
      most[0] = hn::Max(most[0], v.x);
      least[1] = hn::Min(least[1], v.y);
      most[1] = hn::Max(most[1], v.y);
      least[2] = hn::Min(least[2], v.z);
      most[2] = hn::Max(most[2], v.z);
    }
    one_octant_ = true;
    for (int k = 0; k < 3; ++k) {
      octant_[k] = hn::GetLane(hn::MaxOfLanes(d, most[k])) <= -std::numeric_limits<float>::min();
      one_octant_ = one_octant_ && (octant_[k] || hn::GetLane(hn::MinOfLanes(d, least[k])) >=
                                                      std::numeric_limits<float>::min());
    }
  }

  HWY_INLINE void FinishLanes(int i, uint32_t hit) {
    const D d;
    V t = hn::Set(d, std::numeric_limits<float>::infinity());
    V u = hn::Zero(d), v = u;
    if (hit != 0) {
      HitTerms<D, kWeights> terms;
      ready_.Fill(packet_.triangle + i, hit, &terms);
      const Vec3V<V> target = Targets(i), direction = Direction(i);
      const V one = hn::Set(d, 1.0f);
      const Vec3V<V> inv = one_octant_
                               ? Vec3V<V>{hn::Div(one, direction.x), hn::Div(one, direction.y),
                                          hn::Div(one, direction.z)}
                               : SlabReciprocals(d, direction);
      V new_u = u, new_v = v;
      const V new_t =
          EvaluateHits(d, terms, packet_.origin, packet_.segments, target, inv,
                       one_octant_ ? octant_ : static_cast<const bool*>(nullptr), &new_u, &new_v);
      const auto here = hn::LoadMaskBits(d, reinterpret_cast<const uint8_t*>(&hit));
      t = hn::IfThenElse(here, new_t, t);
      u = hn::IfThenElseZero(here, new_u);
      v = hn::IfThenElseZero(here, new_v);
    }
    hn::Store(t, d, packet_.t + i);
    if constexpr (kWeights) {
      hn::Store(u, d, packet_.u + i);
      hn::Store(v, d, packet_.v + i);
    }
  }

  ReadyTriangles& ready_;
  RayPacket& packet_;
  bool one_octant_ = false;
  bool octant_[3] = {};  // Negative, by axis.
};

// What FinishHits writes where nothing is hit.
inline void FillMisses(RayPacket& packet) {
  std::fill_n(packet.t, packet.count, std::numeric_limits<float>::infinity());
  if (!packet.want_barycentrics) return;
  std::fill_n(packet.u, packet.count, 0.0f);
  std::fill_n(packet.v, packet.count, 0.0f);
}

// Writes t (and u, v if packet.want_barycentrics) for packet.triangle, misses included. `ready` is
// of the packet's origin, with weights if they are wanted. REQUIRES: lanes up to a whole vector
// repeat others.
inline void FinishHits(ReadyTriangles& ready, RayPacket& packet) {
  if (packet.want_barycentrics) {
    HitFinisher<true>(ready, packet).Finish();
  } else {
    HitFinisher<false>(ready, packet).Finish();
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard

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

#include "core/base/fill-inl.h"
#include "core/intersect/box_ray-inl.h"
#include "core/intersect/hit-inl.h"
#include "core/traverse/ready_triangles-inl.h"
#include "core/traverse/trace_ray.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// What FinishHits writes where nothing is hit, of the lanes first .. first + count. REQUIRES: a
// block of sixteen begins at `first`.
HWY_INLINE void FillMisses(RayPacket& packet, size_t first, size_t count) {
  FillRow(packet.t + first, count, std::numeric_limits<float>::infinity());
  if (!packet.want_barycentrics) return;
  FillRow(packet.u + first, count, 0.0f);
  FillRow(packet.v + first, count, 0.0f);
}

template <bool kWeights, bool kSegments>
class HitFinisher {
 public:
  HitFinisher(ReadyTriangles& ready, RayPacket& packet) : ready_(ready), packet_(packet) {}

  // Misses included, a block with any at a time. What is to be done is listed first, so that no
  // work waits for a branch that cannot be foretold: how many triangles a vector has.
  void Finish() {
    FindOctant();
    for (int i = 0; i < packet_.count;) {
      ready_.Forget();
      shared_count_ = mixed_count_ = gathered_count_ = 0;
      for (; i < packet_.count && ready_.rows_left() >= kMostInTurn; i += kBlockLanes) List(i);
      ready_.SetUpRows();
      for (int k = 0; k < shared_count_; ++k) {
        const Shared& work = shared_[k];
        Evaluate(work.first, work.lanes, RowTerms(ready_, work.row));
      }
      for (int k = 0; k < mixed_count_; ++k) {
        const Mixed& work = mixed_[k];
        HitTerms<D, kWeights> terms;
        const TriangleTerms first = ready_.Terms(work.row[0]);
        terms.Set(first.distance, &first.weights);
        for (int j = 1; j < work.count; ++j) {
          const TriangleTerms other = ready_.Terms(work.row[j]);
          terms.Blend(work.lanes[j], other.distance, &other.weights);
        }
        Evaluate(work.first, work.all, terms);
      }
      for (int k = 0; k < gathered_count_; ++k) {
        const int first = gathered_[k].first;
        const uint32_t lanes = gathered_[k].lanes;
        HitTerms<D, kWeights> terms;
        GatherTerms(ready_.geometry(), ready_.origin(), hn::Load(DU(), packet_.triangle + first),
                    packet_.triangle[first + std::countr_zero(lanes)], lanes, &terms);
        Evaluate(first, lanes, terms);
      }
    }
  }

 private:
  using D = hn::CappedTag<float, 16>;
  using DU = hn::RebindToUnsigned<D>;
  using V = hn::Vec<D>;
  using RowTerms = ReadyTriangles::RowTerms<D>;
  static constexpr int kLanes = static_cast<int>(hn::MaxLanes(D()));
  static constexpr int kVectors = RayPacket::kMaxRays / kLanes;
  // With AVX2 each triangle is put to all lanes of a vector, which costs less than to blend their
  // terms: those fill twice the registers there are.
  static constexpr bool kInTurn = HWY_TARGET == HWY_AVX2;
  // Lanes are looked at sixteen at a time.
  static constexpr int kBlockLanes = 16;
  static constexpr int kBlockVectors = kBlockLanes / kLanes;
  static_assert(kInTurn || kBlockVectors == 1);
  // Triangles of them that get a row; lanes that have others gather theirs.
  static constexpr int kMostInTurn = 6;
  static_assert(kMostInTurn >= kMostBlends);

  // Work: lanes of the vector that begins at `first`, and their triangle's row.
  struct Shared {
    int first;
    uint32_t lanes, row;
  };
  // ... their triangles' rows, and who has them.
  struct Mixed {
    int first, count;
    uint32_t all, row[kMostBlends], lanes[kMostBlends];
  };

  // What is to be done for the lanes i .. i + kBlockLanes.
  HWY_INLINE void List(int i) {
    const int lanes = std::min(kBlockLanes, packet_.count - i);
    const uint32_t all = (1u << lanes) - 1;
    uint32_t left = all & ~Having(i, kNoTriangle);
    if (left != all) FillMisses(packet_, static_cast<size_t>(i), static_cast<size_t>(lanes));
    if constexpr (kInTurn) {
      for (int k = 0; left != 0; ++k) {
        if (k == kMostInTurn) {
          ForEachVector(i, left, [&](int first, uint32_t own) {
            gathered_[gathered_count_] = {first, own, 0};
            gathered_count_ += own != 0 ? 1 : 0;
          });
          break;
        }
        const uint32_t id = packet_.triangle[i + std::countr_zero(left)];
        const uint32_t same = left & Having(i, id), row = ready_.Row(id);
        left &= ~same;
        ForEachVector(i, same, [&](int first, uint32_t own) {
          shared_[shared_count_] = {first, own, row};
          shared_count_ += own != 0 ? 1 : 0;
        });
      }
    } else {
      uint32_t own[kMostBlends], same[kMostBlends];
      const int count = DistinctTriangles<D>(packet_.triangle + i, left, own, same);
      if (count == 1) {
        shared_[shared_count_++] = {i, same[0], ready_.Row(own[0])};
      } else if (count > kMostBlends) {
        gathered_[gathered_count_++] = {i, left, 0};
      } else if (count > 1) {
        Mixed& work = mixed_[mixed_count_++];
        work.first = i;
        work.count = count;
        work.all = left;
        for (int k = 0; k < count; ++k) {
          work.row[k] = ready_.Row(own[k]);
          work.lanes[k] = same[k];
        }
      }
    }
  }

  // The lanes i .. i + kBlockLanes that have triangle `id`.
  HWY_INLINE uint32_t Having(int i, uint32_t id) const {
    const DU du;
    uint32_t bits = 0;
    for (int k = 0; k < kBlockVectors; ++k) {
      const auto ids = hn::Load(du, packet_.triangle + i + k * kLanes);
      bits |= MaskBits(du, hn::Eq(ids, hn::Set(du, id))) << (k * kLanes);
    }
    return bits;
  }

  // fn(first, lanes) for the vectors of a block.
  template <class Fn>
  static HWY_INLINE void ForEachVector(int i, uint32_t lanes, const Fn& fn) {
    for (int k = 0; k < kBlockVectors; ++k) {
      fn(i + k * kLanes, lanes >> (k * kLanes) & ((1u << kLanes) - 1));
    }
  }

  Vec3V<V> Targets(int i) const {
    const D d;
    return {hn::Load(d, packet_.target_x + i), hn::Load(d, packet_.target_y + i),
            hn::Load(d, packet_.target_z + i)};
  }

  Vec3V<V> Direction(int i) const {
    const Vec3f o = packet_.origin;
    if constexpr (kSegments) return SubV(Targets(i), Broadcast(D(), o.x, o.y, o.z));
    return Targets(i);
  }

  // Whether all rays point into one octant, with no component that is zero or subnormal.
  void FindOctant() {
    Vec3f least, most;
    if (packet_.grid != nullptr) {
      // Each component of a pixel's ray grows, or falls, along columns and along rows.
      least = most = packet_.target(PixelGrid::kCornerLanes[0]);
      for (const int lane : PixelGrid::kCornerLanes) {
        for (int k = 0; k < 3; ++k) {
          least[k] = std::min(least[k], packet_.target(lane)[k]);
          most[k] = std::max(most[k], packet_.target(lane)[k]);
        }
      }
    } else {
      Bound(&least, &most);
    }
    one_octant_ = true;
    for (int k = 0; k < 3; ++k) {
      octant_[k] = most[k] <= -std::numeric_limits<float>::min();
      one_octant_ = one_octant_ && (octant_[k] || least[k] >= std::numeric_limits<float>::min());
    }
  }

  // Over all rays' directions.
  void Bound(Vec3f* least, Vec3f* most) const {
    const D d;
    const V infinity = hn::Set(d, std::numeric_limits<float>::infinity());
    V lo[3] = {infinity, infinity, infinity};
    V hi[3] = {hn::Neg(infinity), hn::Neg(infinity), hn::Neg(infinity)};
    for (int i = 0; i < packet_.count; i += kLanes) {
      // Lanes that are not in use repeat others (the walks pad packets).
      const Vec3V<V> v = Direction(i);
      lo[0] = hn::Min(lo[0], v.x);
      hi[0] = hn::Max(hi[0], v.x);
      lo[1] = hn::Min(lo[1], v.y);
      hi[1] = hn::Max(hi[1], v.y);
      lo[2] = hn::Min(lo[2], v.z);
      hi[2] = hn::Max(hi[2], v.z);
    }
    for (int k = 0; k < 3; ++k) {
      (*least)[k] = hn::GetLane(hn::MinOfLanes(d, lo[k]));
      (*most)[k] = hn::GetLane(hn::MaxOfLanes(d, hi[k]));
    }
  }

  // The lanes of `here`, of the vector that begins at i.
  template <class Terms>
  HWY_INLINE void Evaluate(int i, uint32_t here, const Terms& terms) const {
    const D d;
    const Vec3V<V> direction = Direction(i);
    Vec3V<V> inv;
    if (one_octant_) {
      const V one = hn::Set(d, 1.0f);
      inv = {hn::Div(one, direction.x), hn::Div(one, direction.y), hn::Div(one, direction.z)};
    } else {
      inv = SlabReciprocals(d, direction);
    }
    V u = hn::Zero(d), v = u;
    const V t = EvaluateHits<kWeights>(d, terms, packet_.origin, kSegments, Targets(i), inv,
                                       one_octant_ ? octant_ : nullptr, &u, &v);
    const auto lanes = hn::LoadMaskBits(d, reinterpret_cast<const uint8_t*>(&here));
    const auto put = [&](V value, float* row) HWY_ATTR {
      const D floats;
      hn::Store(hn::IfThenElse(lanes, value, hn::Load(floats, row + i)), floats, row + i);
    };
    put(t, packet_.t);
    if constexpr (kWeights) {
      put(u, packet_.u);
      put(v, packet_.v);
    }
  }

  ReadyTriangles& ready_;
  RayPacket& packet_;
  bool one_octant_ = false;
  bool octant_[3] = {};  // Negative, by axis.
  int shared_count_ = 0, mixed_count_ = 0, gathered_count_ = 0;
  // One more than there can be: written before it is known whether it is wanted.
  Shared shared_[(kInTurn ? kVectors * kMostInTurn : kVectors) + 1], gathered_[kVectors + 1];
  Mixed mixed_[kInTurn ? 1 : kVectors];
};

// Writes t (and u, v if packet.want_barycentrics) for packet.triangle, misses included. `ready` is
// of the packet's origin, with weights if they are wanted. REQUIRES: lanes up to a whole vector
// repeat others.
inline void FinishHits(ReadyTriangles& ready, RayPacket& packet) {
  const auto finish = [&]<bool kWeights>() {
    if (packet.segments) {
      HitFinisher<kWeights, true>(ready, packet).Finish();
    } else {
      HitFinisher<kWeights, false>(ready, packet).Finish();
    }
  };
  if (packet.want_barycentrics) {
    finish.template operator()<true>();
  } else {
    finish.template operator()<false>();
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard

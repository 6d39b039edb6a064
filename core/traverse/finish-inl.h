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
    Forget();
    std::fill_n(row_of_, kNumbers, uint8_t{0});
  }

  // Sets up those that Fill is going to be asked about, a vector of them at a time: one by one they
  // take several times as long. `count` ids; kNoTriangle is passed over. REQUIRES: `ids` may be
  // read up to the end of a vector.
  void Prepare(const uint32_t* ids, int count) {
    Forget();
    for (int i = 0; i < count && rows_ < kReady; i += static_cast<int>(kLanes)) {
      const int lanes = std::min(static_cast<int>(kLanes), count - i);
      List(ids + i, static_cast<uint32_t>((uint64_t{1} << lanes) - 1));
    }
    for (uint32_t row = 0; row < rows_; ++row) {
      for (const uint32_t vertex : geometry_.triangles[ready_[row]]) {
        hwy::Prefetch(&geometry_.vertices[vertex]);
      }
    }
    for (uint32_t row = 0; row < rows_; row += kLanes) {
      if (weights_) {
        SetUp<true>(row);
      } else {
        SetUp<false>(row);
      }
    }
  }

  // Lanes of a vector with more triangles than this are set up each for itself.
  static constexpr int kMostBlends = 3;

  // The triangles of a vector's lanes `here`, each once, and who has it; returns how many, or
  // kMostBlends + 1 for more than that. ids[i] is that of lane i.
  template <class D>
  static HWY_INLINE int Distinct(const uint32_t* ids, uint32_t here, uint32_t* own,
                                 uint32_t* same) {
    const hn::RebindToUnsigned<D> du;
    const auto lanes = hn::Load(du, ids);
    int count = 0;
    for (uint32_t left = here; left != 0; ++count) {
      if (count == kMostBlends) return kMostBlends + 1;
      own[count] = ids[std::countr_zero(left)];
      same[count] = left & MaskBits(du, hn::Eq(lanes, hn::Set(du, own[count])));
      left &= ~same[count];
    }
    return count;
  }

  HWY_INLINE TriangleTerms Get(uint32_t id) {
    if (!IsReady(id)) SetUpOne(id);
    const uint32_t row = row_of_[id % kNumbers];
    const auto of = [row](const double(&rows)[3][kReady]) {
      return Vec3d{rows[0][row], rows[1][row], rows[2][row]};
    };
    const auto face = [row](const float(&rows)[3][kReady]) {
      return Vec3f{rows[0][row], rows[1][row], rows[2][row]};
    };
    return {{of(normal_), numerator_[row], face(lo_), face(hi_)}, {of(e0_), of(e2_)}};
  }

  // The terms of each lane's triangle, for the lanes of `here`, which is not zero; others are any.
  // ids[i] is that of lane i.
  template <class D, bool kWeights>
  HWY_INLINE void Fill(const uint32_t* ids, uint32_t here, HitTerms<D, kWeights>* terms) {
    uint32_t own[kMostBlends], same[kMostBlends];
    FillDistinct(ids, here, own, same, Distinct<D>(ids, here, own, same), terms);
  }
  // With what Distinct said.
  template <class D, bool kWeights>
  HWY_INLINE void FillDistinct(const uint32_t* ids, uint32_t here, const uint32_t* own,
                               const uint32_t* same, int count, HitTerms<D, kWeights>* terms) {
    if (count > kMostBlends) {
      const hn::RebindToUnsigned<D> du;
      GatherTerms(geometry_, origin_, hn::Load(du, ids), own[0], here, terms);
      return;
    }
    const TriangleTerms first = Get(own[0]);
    terms->Set(first.distance, &first.weights);
    for (int k = 1; k < count; ++k) {
      const TriangleTerms other = Get(own[k]);
      terms->Blend(same[k], other.distance, &other.weights);
    }
  }

 private:
  using Lanes = hn::CappedTag<float, 16>;
  static constexpr uint32_t kLanes = hn::MaxLanes(Lanes());
  // Rows of triangles kept, taken one after another, and found by the low bits of their ids.
  static constexpr uint32_t kReady = 64, kNumbers = 256;
  static_assert(kReady % kLanes == 0 && kReady <= 256);

  void Forget() {
    rows_ = 0;
    std::fill_n(ready_, kReady, kNoTriangle);
  }

  bool IsReady(uint32_t id) const { return ready_[row_of_[id % kNumbers]] == id; }

  uint32_t TakeRow(uint32_t id) {
    const uint32_t row = rows_++ % kReady;
    ready_[row] = id;
    row_of_[id % kNumbers] = static_cast<uint8_t>(row);
    return row;
  }

  // Takes rows for the triangles of a vector's lanes `used`, if Fill will ask for them, and as far
  // as there are rows. Asks for their indices.
  void List(const uint32_t* ids, uint32_t used) {
    const hn::RebindToUnsigned<Lanes> du;
    const uint32_t missed = MaskBits(du, hn::Eq(hn::Load(du, ids), hn::Set(du, kNoTriangle)));
    uint32_t own[kMostBlends], same[kMostBlends];
    const int count = Distinct<Lanes>(ids, used & ~missed, own, same);
    if (count > kMostBlends) return;
    for (int k = 0; k < count && rows_ < kReady; ++k) {
      if (IsReady(own[k])) continue;
      TakeRow(own[k]);
      hwy::Prefetch(&geometry_.triangles[own[k]]);
    }
  }

  // The triangles of rows from `row` on, a vector of them.
  template <bool kWeights>
  HWY_INLINE void SetUp(uint32_t row) {
    const Lanes d;
    const hn::Rebind<double, hn::Half<Lanes>> dd;
    HWY_ALIGN float corners[9][kLanes];
    for (uint32_t lane = 0; lane < kLanes; ++lane) {
      const uint32_t id = ready_[std::min(row + lane, rows_ - 1)];
      for (int k = 0; k < 3; ++k) {
        const Vec3f at = geometry_.vertices[geometry_.triangles[id][k]];
        for (int axis = 0; axis < 3; ++axis) corners[3 * k + axis][lane] = at[axis];
      }
    }
    const auto corner = [&](int k) HWY_ATTR -> Vec3V<hn::Vec<Lanes>> {
      return {hn::Load(d, corners[3 * k]), hn::Load(d, corners[3 * k + 1]),
              hn::Load(d, corners[3 * k + 2])};
    };
    HitTerms<Lanes, kWeights> terms;
    terms.Make(origin_, corner(0), corner(1), corner(2));
    for (int h = 0; h < 2; ++h) {
      const uint32_t at = row + static_cast<uint32_t>(h) * kLanes / 2;
      const auto put = [&](const auto& v, double(*to)[kReady]) HWY_ATTR {
        hn::Store(v.x, dd, to[0] + at);
        hn::Store(v.y, dd, to[1] + at);
        hn::Store(v.z, dd, to[2] + at);
      };
      put(terms.normal[h], normal_);
      hn::Store(terms.numerator[h], dd, numerator_ + at);
      if constexpr (kWeights) {
        put(terms.e0[h], e0_);
        put(terms.e2[h], e2_);
      }
    }
    for (int k = 0; k < 3; ++k) {
      hn::Store(terms.lo[k], d, lo_[k] + row);
      hn::Store(terms.hi[k], d, hi_[k] + row);
    }
  }

  // One triangle that nobody had foreseen.
  HWY_NOINLINE void SetUpOne(uint32_t id) {
    const uint32_t row = TakeRow(id);
    const auto [a, b, c] = geometry_.Corners(id);
    const auto distance = TriangleDistance::Make(origin_, a, b, c);
    const auto weights = weights_ ? TriangleWeights::Make(origin_, a, b, c) : TriangleWeights();
    numerator_[row] = distance.numerator;
    for (int k = 0; k < 3; ++k) {
      normal_[k][row] = distance.normal[k];
      e0_[k][row] = weights.e0[k];
      e2_[k][row] = weights.e2[k];
      lo_[k][row] = distance.lo[k];
      hi_[k][row] = distance.hi[k];
    }
  }

  const SceneGeometry& geometry_;
  const Vec3f origin_;
  const bool weights_;
  uint32_t rows_;  // Taken so far.
  alignas(64) uint32_t ready_[kReady];
  uint8_t row_of_[kNumbers];
  // By row, none of them set before its row is taken: what TriangleTerms holds.
  alignas(64) double normal_[3][kReady], numerator_[kReady], e0_[3][kReady], e2_[3][kReady];
  alignas(64) float lo_[3][kReady], hi_[3][kReady];
};

template <bool kWeights, bool kSegments>
class HitFinisher {
 public:
  HitFinisher(ReadyTriangles& ready, RayPacket& packet) : ready_(ready), packet_(packet) {}

  // Misses included.
  void Finish() {
    ready_.Prepare(packet_.triangle, packet_.count);
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
    if constexpr (kSegments) return SubV(Targets(i), Broadcast(D(), o.x, o.y, o.z));
    return Targets(i);
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

  // Triangles of a vector up to which each is put to all of its lanes. With AVX2 that costs less
  // than to blend them, whose terms fill twice the registers there are.
  static constexpr int kMostInTurn = HWY_TARGET == HWY_AVX2 ? ReadyTriangles::kMostBlends : 1;

  HWY_INLINE void FinishLanes(int i, uint32_t hit) {
    const D d;
    V t = hn::Set(d, std::numeric_limits<float>::infinity());
    V u = hn::Zero(d), v = u;
    if (hit != 0) {
      const V one = hn::Set(d, 1.0f);
      const Vec3V<V> direction = Direction(i);
      Vec3V<V> inv;
      if (one_octant_) {
        inv = {hn::Div(one, direction.x), hn::Div(one, direction.y), hn::Div(one, direction.z)};
      } else {
        inv = SlabReciprocals(d, direction);
      }
      uint32_t own[ReadyTriangles::kMostBlends], same[ReadyTriangles::kMostBlends];
      const uint32_t* ids = packet_.triangle + i;
      const int count = ReadyTriangles::Distinct<D>(ids, hit, own, same);
      if (count <= kMostInTurn) {
        for (int k = 0; k < count; ++k) {
          const TriangleTerms terms = ready_.Get(own[k]);
          Evaluate(i, same[k], OneTriangleTerms<D>(terms), inv, &t, &u, &v);
        }
      } else {
        HitTerms<D, kWeights> terms;
        ready_.FillDistinct(ids, hit, own, same, count, &terms);
        Evaluate(i, hit, terms, inv, &t, &u, &v);
      }
    }
    hn::Store(t, d, packet_.t + i);
    if constexpr (kWeights) {
      hn::Store(u, d, packet_.u + i);
      hn::Store(v, d, packet_.v + i);
    }
  }

  // The lanes of `here`; others stay as they are.
  template <class Terms>
  HWY_INLINE void Evaluate(int i, uint32_t here, const Terms& terms, const Vec3V<V>& inv, V* t,
                           V* u, V* v) const {
    const D d;
    V new_u = hn::Zero(d), new_v = new_u;
    const V new_t = EvaluateHits<kWeights>(d, terms, packet_.origin, kSegments, Targets(i), inv,
                                           one_octant_ ? octant_ : nullptr, &new_u, &new_v);
    const auto lanes = hn::LoadMaskBits(d, reinterpret_cast<const uint8_t*>(&here));
    *t = hn::IfThenElse(lanes, new_t, *t);
    *u = hn::IfThenElse(lanes, new_u, *u);
    *v = hn::IfThenElse(lanes, new_v, *v);
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

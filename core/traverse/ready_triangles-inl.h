// SPDX-License-Identifier: Apache-2.0
//
// Triangles set up for exact distances from one origin, and weights where they are wanted, so that
// the rays of a packet share what is the same for all of them.
//
// Thread safety: one thread's own.

#if defined(SIGHTLINE_CORE_TRAVERSE_READY_TRIANGLES_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_READY_TRIANGLES_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_READY_TRIANGLES_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_READY_TRIANGLES_INL_H_
#endif

#include <algorithm>
#include <bit>

#include "core/accel/indexed_geometry.h"
#include "core/base/check.h"
#include "core/base/fill-inl.h"
#include "core/intersect/hit-inl.h"
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
    // Offsets have a sign: 3 (kMaxGeometryItems - 1) is the largest that is asked for here.
    static_assert(3 * kMaxGeometryItems <= 0x7FFFFFFF);
    const VU vertex = three_times(hn::GatherIndex(du, indices + k, hn::BitCast(di, at)));
    const auto offset = hn::BitCast(di, vertex);
    corner[k] = {hn::GatherIndex(d, positions, offset), hn::GatherIndex(d, positions + 1, offset),
                 hn::GatherIndex(d, positions + 2, offset)};
  }
  terms->Make(origin, corner[0], corner[1], corner[2]);
}

// A vector with more triangles than this has each lane's gathered instead.
constexpr int kMostBlends = 3;

// The triangles of a vector's lanes `here`, each once, and who has it; returns how many, or
// kMostBlends + 1 for more than that. ids[i] is that of lane i.
template <class D>
HWY_INLINE int DistinctTriangles(const uint32_t* ids, uint32_t here, uint32_t* own,
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

// As many as a packet is likely to need, each in a row.
class ReadyTriangles {
 public:
  static constexpr uint32_t kRows = 64;

  // `geometry` must outlive it. Without `weights` it gives no terms with kWeights.
  ReadyTriangles(const SceneGeometry& geometry, Vec3f origin, bool weights)
      : geometry_(geometry), origin_(origin), weights_(weights) {
    Forget();
    FillRow(row_of_, kNumbers, uint8_t{0});
  }

  const SceneGeometry& geometry() const { return geometry_; }
  Vec3f origin() const { return origin_; }

  // ---- Many triangles at once: rows are taken, then set up together, a vector of them at a time;
  // one by one that takes several times as long.

  void Forget() {
    rows_ = 0;
    FillRow(ready_, kRows, kNoTriangle);
  }
  uint32_t rows_left() const { return kRows - rows_; }
  // The row of a triangle: one that it has, or the next. REQUIRES: one is left.
  HWY_INLINE uint32_t Row(uint32_t id) {
    if (IsReady(id)) return row_of_[id % kNumbers];
    hwy::Prefetch(&geometry_.triangles[id]);
    return TakeRow(id);
  }
  void SetUpRows() {
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
  // Of a row that is set up.
  TriangleTerms Terms(uint32_t row) const {
    const auto of = [row](const double(&rows)[3][kRows]) {
      return Vec3d{rows[0][row], rows[1][row], rows[2][row]};
    };
    const auto face = [row](const float(&rows)[3][kRows]) {
      return Vec3f{rows[0][row], rows[1][row], rows[2][row]};
    };
    return {{of(normal_), numerator_[row], face(lo_), face(hi_)}, {of(e0_), of(e2_)}};
  }

  // What EvaluateHits asks for where all lanes have the triangle of one row: fetched where it is
  // used.
  template <class D>
  class RowTerms {
   public:
    using DD = hn::Rebind<double, hn::Half<D>>;
    using V = hn::Vec<D>;
    using VD = hn::Vec<DD>;

    RowTerms(const ReadyTriangles& ready, uint32_t row) : ready_(ready), row_(row) {}

    HWY_INLINE Vec3V<VD> Normal(int) const { return Of(ready_.normal_); }
    HWY_INLINE VD Numerator(int) const { return hn::Set(DD(), ready_.numerator_[row_]); }
    HWY_INLINE Vec3V<VD> E0(int) const { return Of(ready_.e0_); }
    HWY_INLINE Vec3V<VD> E2(int) const { return Of(ready_.e2_); }
    HWY_INLINE V Lo(int k) const { return hn::Set(D(), ready_.lo_[k][row_]); }
    HWY_INLINE V Hi(int k) const { return hn::Set(D(), ready_.hi_[k][row_]); }

   private:
    HWY_INLINE Vec3V<VD> Of(const double (&rows)[3][kRows]) const {
      const DD dd;
      return {hn::Set(dd, rows[0][row_]), hn::Set(dd, rows[1][row_]), hn::Set(dd, rows[2][row_])};
    }

    const ReadyTriangles& ready_;
    const uint32_t row_;
  };

  // ---- One by one, while a walk is under way.

  // The terms of each lane's triangle, for the lanes of `here`, which is not zero; others are any.
  // ids[i] is that of lane i.
  template <class D, bool kWeights>
  HWY_INLINE void Fill(const uint32_t* ids, uint32_t here, HitTerms<D, kWeights>* terms) {
    uint32_t own[kMostBlends], same[kMostBlends];
    const int count = DistinctTriangles<D>(ids, here, own, same);
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
  static constexpr uint32_t kNumbers = 256;  // Rows are found by the low bits of ids.
  static_assert(kRows % kLanes == 0 && kRows <= 256);

  bool IsReady(uint32_t id) const { return ready_[row_of_[id % kNumbers]] == id; }

  uint32_t TakeRow(uint32_t id) {
    const uint32_t row = rows_++ % kRows;
    ready_[row] = id;
    row_of_[id % kNumbers] = static_cast<uint8_t>(row);
    return row;
  }

  TriangleTerms Get(uint32_t id) {
    if (!IsReady(id)) SetUpOne(id);
    return Terms(row_of_[id % kNumbers]);
  }

  // The triangles of rows from `row` on, a vector of them.
  template <bool kWeights>
  HWY_INLINE void SetUp(uint32_t row) {
    const Lanes d;
    const hn::Rebind<double, hn::Half<Lanes>> dd;
    HWY_ALIGN float corners[9][kLanes];
    for (float(&of_corner)[kLanes] : corners) hn::Store(hn::Zero(d), d, of_corner);
    const uint32_t count = std::min(kLanes, rows_ - row);
    for (uint32_t lane = 0; lane < count; ++lane) {
      const uint32_t id = ready_[row + lane];
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
      const auto put = [&](const auto& v, double(*to)[kRows]) HWY_ATTR {
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
  uint32_t rows_;  // Taken so far; one by one, they are taken over again.
  alignas(64) uint32_t ready_[kRows];
  alignas(64) uint8_t row_of_[kNumbers];
  // By row, none of them set before its row is taken: what TriangleTerms holds.
  alignas(64) double normal_[3][kRows], numerator_[kRows], e0_[3][kRows], e2_[3][kRows];
  alignas(64) float lo_[3][kRows], hi_[3][kRows];
};

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard

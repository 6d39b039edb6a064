// SPDX-License-Identifier: Apache-2.0
//
// point_rows.h, a vector at a time.
//
// Thread safety: pure functions.

#if defined(SIGHTLINE_CORE_QUERY_POINT_ROWS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_QUERY_POINT_ROWS_INL_H_
#undef SIGHTLINE_CORE_QUERY_POINT_ROWS_INL_H_
#else
#define SIGHTLINE_CORE_QUERY_POINT_ROWS_INL_H_
#endif

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <span>

#include "core/base/masked_store-inl.h"
#include "core/intersect/hit.h"
#include "core/intersect/predicate-inl.h"
#include "core/query/point_rows.h"
#include "core/traverse/gradual_fetch.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using PointRowD = hn::CappedTag<float, 16>;

// Three vectors hold as many points as one has lanes: coordinate `axis` of point i is number
// 3i + axis of their floats. As three and the number of lanes have no common factor, no two points
// have theirs in the same lane, so that the vectors blend into one, whose lanes have then to be put
// in order.
struct CoordinateLanes {
  static constexpr size_t kLanes = hn::MaxLanes(PointRowD());

  constexpr CoordinateLanes() {
    for (size_t axis = 0; axis < 3; ++axis) {
      for (size_t i = 0; i < kLanes; ++i) {
        const size_t number = 3 * i + axis, lane = number % kLanes;
        vector_of[axis][lane] = static_cast<int32_t>(number / kLanes);
        order[axis][i] = static_cast<int32_t>(lane);
      }
    }
  }

  alignas(64) int32_t vector_of[3][kLanes] = {};  // By lane of the three.
  alignas(64) int32_t order[3][kLanes] = {};      // By point: the lane.
};
constexpr CoordinateLanes kCoordinateLanes;

// One of the coordinates of such points.
class Coordinate {
 public:
  explicit HWY_INLINE Coordinate(size_t axis)
      : first_(LanesOf(axis, 0)),
        second_(LanesOf(axis, 1)),
        order_(hn::SetTableIndices(PointRowD(), kCoordinateLanes.order[axis])) {}

  HWY_INLINE hn::Vec<PointRowD> Of(hn::Vec<PointRowD> a, hn::Vec<PointRowD> b,
                                   hn::Vec<PointRowD> c) const {
    return hn::TableLookupLanes(hn::IfThenElse(first_, a, hn::IfThenElse(second_, b, c)), order_);
  }

 private:
  static HWY_INLINE hn::Mask<PointRowD> LanesOf(size_t axis, int32_t vector) {
    const hn::RebindToSigned<PointRowD> di;
    return hn::RebindMask(
        PointRowD(), hn::Eq(hn::Load(di, kCoordinateLanes.vector_of[axis]), hn::Set(di, vector)));
  }

  const hn::Mask<PointRowD> first_, second_;
  const decltype(hn::SetTableIndices(PointRowD(), kCoordinateLanes.order[0])) order_;
};

// The box around points, of vectors of their coordinates as they lie. Three of these that follow
// one another are a row of numbers, of which number n is coordinate n % 3 of a point.
class RowBox {
 public:
  RowBox() {
    const PointRowD d;
    for (auto& v : lo_) v = hn::Set(d, std::numeric_limits<float>::infinity());
    for (auto& v : hi_) v = hn::Set(d, -std::numeric_limits<float>::infinity());
  }

  HWY_INLINE void Extend(const hn::Vec<PointRowD> (&row)[3]) {
    for (int k = 0; k < 3; ++k) {
      lo_[k] = hn::Min(lo_[k], row[k]);
      hi_[k] = hn::Max(hi_[k], row[k]);
    }
  }

  HWY_INLINE void Get(Box3f* box) const {
    box->lo = OfAll(PointRowD(), lo_[0], lo_[1], lo_[2],
                    [](auto a, auto b) HWY_ATTR { return hn::Min(a, b); });
    box->hi = OfAll(PointRowD(), hi_[0], hi_[1], hi_[2],
                    [](auto a, auto b) HWY_ATTR { return hn::Max(a, b); });
  }

 private:
  // What `op` makes of all numbers of each coordinate: a half of the row, which is whole vectors of
  // half the length, is put to the other, until four numbers are left of a vector.
  template <class D, class V, class Op>
  static HWY_INLINE Vec3f OfAll(D d, V a, V b, V c, const Op& op) {
    if constexpr (hn::MaxLanes(D()) > 4) {
      const hn::Half<D> half;
      return OfAll(half, op(hn::LowerHalf(half, a), hn::UpperHalf(half, b)),
                   op(hn::UpperHalf(half, a), hn::LowerHalf(half, c)),
                   op(hn::LowerHalf(half, b), hn::UpperHalf(half, c)), op);
    } else {
      // Four points, each moved to where the first one begins.
      const V second = hn::CombineShiftRightBytes<12>(d, b, a);
      const V third = hn::CombineShiftRightBytes<8>(d, c, b);
      const V fourth = hn::CombineShiftRightBytes<4>(d, c, c);
      alignas(16) float of_all[4];
      hn::Store(op(op(a, second), op(third, fourth)), d, of_all);
      return {of_all[0], of_all[1], of_all[2]};
    }
  }

  hn::Vec<PointRowD> lo_[3], hi_[3];
};

// As many points as a vector has lanes: three vectors, from `point` on. With AVX-512 each is loaded
// once, whatever is done with it: GCC 12 reads memory for its least and its most by themselves.
HWY_INLINE void LoadPoints(const Vec3f* point, hn::Vec<PointRowD> (&row)[3]) {
  const PointRowD d;
  static_assert(sizeof(Vec3f) == 3 * sizeof(float));
  Vec3V<hn::Vec<PointRowD>> v = {hn::LoadU(d, &point->x), hn::LoadU(d, &point->x + hn::Lanes(d)),
                                 hn::LoadU(d, &point->x + 2 * hn::Lanes(d))};
  InVectorRegisters(&v);
  row[0] = v.x;
  row[1] = v.y;
  row[2] = v.z;
}

inline void SplitPoints(std::span<const Vec3f> points, float* x, float* y, float* z, Box3f* box) {
  const PointRowD d;
  const Coordinate axes[3] = {Coordinate(0), Coordinate(1), Coordinate(2)};
  float* const rows[3] = {x, y, z};
  RowBox all;
  size_t i = 0;
  for (; i + hn::Lanes(d) <= points.size(); i += hn::Lanes(d)) {
    hn::Vec<PointRowD> row[3];
    LoadPoints(&points[i], row);
    all.Extend(row);
    for (int k = 0; k < 3; ++k) {
      hn::Store(axes[k].Of(row[0], row[1], row[2]), d, rows[k] + i);
    }
  }
  all.Get(box);
  for (; i < points.size(); ++i) {
    for (int k = 0; k < 3; ++k) rows[k][i] = points[i][k];
    box->Extend(points[i]);
  }
}

inline void BoxOfPoints(std::span<const Vec3f> points, const Vec3f* coming, Box3f* box) {
  constexpr size_t kLanes = hn::MaxLanes(PointRowD());
  RowBox all;
  size_t i = 0;
  for (; i + kLanes <= points.size(); i += kLanes) {
    if (coming != nullptr) {
      AskForLines(reinterpret_cast<uintptr_t>(coming + i), kLanes * sizeof(Vec3f));
    }
    hn::Vec<PointRowD> row[3];
    LoadPoints(&points[i], row);
    all.Extend(row);
  }
  all.Get(box);
  for (; i < points.size(); ++i) box->Extend(points[i]);
}

inline void FreeBits(std::span<const uint32_t> ids, uint8_t* bits) {
  const hn::RebindToUnsigned<PointRowD> d;
  constexpr size_t kBytes = hn::MaxLanes(PointRowD()) / 8;
  const auto of = [&](size_t i) HWY_ATTR {
    const hn::RebindToUnsigned<PointRowD> lanes;
    return MaskBits(lanes, hn::Eq(hn::Load(lanes, ids.data() + i), hn::Set(lanes, kNoTriangle)));
  };
  size_t i = 0;
  for (; i + hn::Lanes(d) <= ids.size(); i += hn::Lanes(d)) {
    const uint32_t lanes = of(i);
    std::memcpy(bits + i / 8, &lanes, kBytes);  // Little-endian, as all that is compiled for.
  }
  if (i == ids.size()) return;
  const uint32_t lanes = of(i) & ((1u << (ids.size() - i)) - 1);
  std::memcpy(bits + i / 8, &lanes, (ids.size() - i + 7) / 8);
}

inline size_t FlagBits(std::span<const uint16_t> flags, uint32_t bit, uint16_t* bits) {
  const hn::CappedTag<uint16_t, 16> d;
  const auto own = hn::Set(d, static_cast<uint16_t>(1u << bit));
  size_t count = 0;
  for (size_t i = 0; i < flags.size(); i += 16) {
    const auto set = hn::And(hn::FirstN(d, flags.size() - i),
                             hn::Eq(hn::And(hn::Load(d, flags.data() + i), own), own));
    bits[i / 16] = static_cast<uint16_t>(MaskBits(d, set));
    count += hn::CountTrue(d, set);
  }
  return count;
}

inline void SetWhere(std::span<const uint16_t> bits, uint32_t id, uint32_t* ids) {
  const hn::RebindToUnsigned<PointRowD> d;
  for (size_t i = 0; i < bits.size() * 16; i += hn::Lanes(d)) {
    const uint8_t* const own = reinterpret_cast<const uint8_t*>(bits.data()) + i / 8;
    const uint8_t lanes[8] = {own[0], hn::Lanes(d) > 8 ? own[1] : uint8_t{0}};
    StoreWhere(hn::LoadMaskBits(d, lanes), hn::Set(d, id), d, ids + i);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard

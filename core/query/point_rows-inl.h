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

inline void SplitPoints(std::span<const Vec3f> points, float* x, float* y, float* z, Box3f* box) {
  const PointRowD d;
  static_assert(sizeof(Vec3f) == 3 * sizeof(float));
  const Coordinate axes[3] = {Coordinate(0), Coordinate(1), Coordinate(2)};
  float* const rows[3] = {x, y, z};
  const auto least = hn::Set(d, std::numeric_limits<float>::infinity()), most = hn::Neg(least);
  hn::Vec<PointRowD> lo[3] = {least, least, least}, hi[3] = {most, most, most};
  size_t i = 0;
  for (; i + hn::Lanes(d) <= points.size(); i += hn::Lanes(d)) {
    const float* const from = &points[i].x;
    const auto a = hn::LoadU(d, from), b = hn::LoadU(d, from + hn::Lanes(d)),
               c = hn::LoadU(d, from + 2 * hn::Lanes(d));
    for (int k = 0; k < 3; ++k) {
      const auto row = axes[k].Of(a, b, c);
      hn::Store(row, d, rows[k] + i);
      lo[k] = hn::Min(lo[k], row);
      hi[k] = hn::Max(hi[k], row);
    }
  }
  for (int k = 0; k < 3; ++k) {
    box->lo[k] = hn::GetLane(hn::MinOfLanes(d, lo[k]));
    box->hi[k] = hn::GetLane(hn::MaxOfLanes(d, hi[k]));
  }
  for (; i < points.size(); ++i) {
    for (int k = 0; k < 3; ++k) rows[k][i] = points[i][k];
    box->Extend(points[i]);
  }
}

inline void BoxOfPoints(std::span<const Vec3f> points, Box3f* box) {
  const PointRowD d;
  constexpr size_t kLanes = hn::MaxLanes(PointRowD());
  const auto least = hn::Set(d, std::numeric_limits<float>::infinity()), most = hn::Neg(least);
  // By place in three vectors of coordinates.
  hn::Vec<PointRowD> lo[3] = {least, least, least}, hi[3] = {most, most, most};
  size_t i = 0;
  for (; i + kLanes <= points.size(); i += kLanes) {
    for (size_t k = 0; k < 3; ++k) {
      const auto v = hn::LoadU(d, &points[i].x + k * kLanes);
      lo[k] = hn::Min(lo[k], v);
      hi[k] = hn::Max(hi[k], v);
    }
  }
  for (size_t axis = 0; axis < 3; ++axis) {
    const Coordinate of(axis);
    box->lo[axis] = hn::GetLane(hn::MinOfLanes(d, of.Of(lo[0], lo[1], lo[2])));
    box->hi[axis] = hn::GetLane(hn::MaxOfLanes(d, of.Of(hi[0], hi[1], hi[2])));
  }
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

// SPDX-License-Identifier: Apache-2.0
//
// The box around points that come a vector at a time.
//
// Thread safety: a box is one thread's own.

#if defined(SIGHTLINE_CORE_TRAVERSE_POINT_BOX_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_POINT_BOX_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_POINT_BOX_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_POINT_BOX_INL_H_
#endif

#include <algorithm>
#include <cstddef>
#include <limits>

#include "core/base/check.h"
#include "core/geometry/box3.h"
#include "core/traverse/shaft_lanes-inl.h"
#include "core/traverse/trace_ray.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

class PointBox {
 public:
  // Empty: inverted.
  HWY_INLINE PointBox() {
    const ShaftV infinity = hn::Set(ShaftD(), std::numeric_limits<float>::infinity());
    for (int k = 0; k < 3; ++k) {
      least_[k] = infinity;
      most_[k] = hn::Neg(infinity);
    }
  }

  HWY_INLINE void Take(const Vec3V<ShaftV>& p) {
    const ShaftV* const axes[3] = {&p.x, &p.y, &p.z};
    for (int k = 0; k < 3; ++k) {
      least_[k] = hn::Min(least_[k], *axes[k]);
      most_[k] = hn::Max(most_[k], *axes[k]);
    }
  }

  // `count` points in three rows, but for those `unasked` (RayPacket); whole vectors are read.
  HWY_INLINE void Take(const float* x, const float* y, const float* z, size_t count,
                       const uint16_t* unasked) {
    const ShaftD d;
    for (size_t i = 0; i < count; i += hn::Lanes(d)) {
      const Vec3V<ShaftV> p = {hn::Load(d, x + i), hn::Load(d, y + i), hn::Load(d, z + i)};
      if (unasked == nullptr && i + hn::Lanes(d) <= count) {
        Take(p);
        continue;
      }
      ShaftM in = hn::FirstN(d, count - i);
      if (unasked != nullptr) in = hn::AndNot(LanesOf(unasked, i), in);
      const ShaftV* const axes[3] = {&p.x, &p.y, &p.z};
      for (int k = 0; k < 3; ++k) {
        least_[k] = hn::Min(least_[k], hn::IfThenElse(in, *axes[k], least_[k]));
        most_[k] = hn::Max(most_[k], hn::IfThenElse(in, *axes[k], most_[k]));
      }
    }
  }

  Box3f box() const { return {{least(0), least(1), least(2)}, {most(0), most(1), most(2)}}; }
  float least(int axis) const { return hn::GetLane(hn::MinOfLanes(ShaftD(), least_[axis])); }
  float most(int axis) const { return hn::GetLane(hn::MaxOfLanes(ShaftD(), most_[axis])); }

 private:
  ShaftV least_[3], most_[3];
};

inline HWY_NOINLINE Box3f FindBox(const float* x, const float* y, const float* z, int count,
                                  const uint16_t* unasked) {
  PointBox box;
  box.Take(x, y, z, static_cast<size_t>(count), unasked);
  return box.box();
}

// The box around a packet's points that are asked about, inverted if none is: ends of segments,
// origins of parallel rays.
template <class Packet>
Box3f BoxAround(const Packet& packet, const float* x, const float* y, const float* z) {
  const Box3f* const known = packet.point_box;
  SIGHTLINE_DCHECK(known == nullptr || *known == FindBox(x, y, z, packet.count, nullptr));
  return known != nullptr ? *known : FindBox(x, y, z, packet.count, packet.unasked);
}
inline Box3f BoxAround(const RayPacket& packet) {
  return BoxAround(packet, packet.target_x, packet.target_y, packet.target_z);
}
inline Box3f BoxAround(const PacketPair& packets) { return *packets.point_box; }
inline Box3f BoxAround(const ParallelPacket& packet) {
  return BoxAround(packet, packet.origin_x, packet.origin_y, packet.origin_z);
}

// Bounds how far points of a box are from another one along each axis, but for a rounding.
inline Vec3f FarthestFrom(const Box3f& box, Vec3f from) {
  Vec3f far;
  for (int k = 0; k < 3; ++k) far[k] = std::max(box.hi[k] - from[k], from[k] - box.lo[k]);
  return far;
}

// The least coordinate in a box along an axis, or against it.
inline float LeastIn(const Box3f& box, int axis, bool up) {
  return up ? box.lo[axis] : -box.hi[axis];
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard

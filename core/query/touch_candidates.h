// SPDX-License-Identifier: Apache-2.0
//
// The triangles that any of some neighbouring points can touch, gathered in one walk, and which of
// them each point does touch: for all points together what FindTouching finds for one.
//
// Most candidates touch no point. Four planes tell so quickly: a point that is farther than its
// touch radius outside the triangle's own plane or one of the three planes through its edges at
// right angles to it is farther than that from the triangle. Only what they leave open is measured.
// They only ever spare the measuring; why they cannot spare too much is told where their margin is
// set (PlanesOf).
//
// Thread safety: an object belongs to one thread.
//
//   TouchCandidates candidates(PlacementKernelsFor(SimdTarget::kBest));
//   if (candidates.Gather(scene, box, norm_one, kMost)) {
//     candidates.ForEachTouching(box, points, [&](int i, uint32_t id) { ... });
//   }
#ifndef SIGHTLINE_CORE_QUERY_TOUCH_CANDIDATES_H_
#define SIGHTLINE_CORE_QUERY_TOUCH_CANDIDATES_H_

#include <array>
#include <bit>
#include <cstdint>

#include "core/accel/indexed_geometry.h"
#include "core/geometry/box3.h"
#include "core/geometry/vec3.h"
#include "core/query/nearest_triangle.h"
#include "core/query/placement_kernels.h"
#include "core/query/touch_points.h"

namespace sightline {

class TouchCandidates {
 public:
  static constexpr uint32_t kMost = 256;

  explicit TouchCandidates(const PlacementKernels& kernels) : kernels_(kernels) {}

  // Holds the triangles whose boxes meet `box`, for points whose 1-norms do not exceed `norm_one`.
  // False if there are more than `most`; then it holds nothing. REQUIRES: most <= kMost.
  bool Gather(const IndexedGeometry& scene, const Box3f& box, double norm_one, uint32_t most);

  // found(i, id) for each triangle but its source that point i touches, in no particular order.
  // REQUIRES: `within` is around all the points by their largest radius (BoxAround), and inside the
  // box of Gather; all they were ever asked about since Gather have the same radius per vertex.
  template <typename Found>
  void ForEachTouching(const Box3f& within, const TouchPoints& points, const Found& found) {
    for (uint32_t first = 0; first < count_; first += 8) {
      for (uint32_t bits = Meeting(first, within); bits != 0; bits &= bits - 1) {
        const uint32_t k = first + static_cast<uint32_t>(std::countr_zero(bits));
        const auto& [a, b, c] = corners_[k];
        for (uint32_t open = NotApart(k, points); open != 0; open &= open - 1) {
          const int i = std::countr_zero(open);
          if (Touches(points.at(i), points.radius(i), a, b, c)) found(i, ids_[k]);
        }
      }
    }
  }

 private:
  uint32_t Meeting(uint32_t first, const Box3f& within) const;
  uint32_t NotApart(uint32_t k, const TouchPoints& points);
  TouchPlanes PlanesOf(uint32_t k, double per_vertex) const;

  const PlacementKernels& kernels_;
  uint32_t count_ = 0;
  double norm_one_ = 0;
  alignas(32) float lo_[3][kMost], hi_[3][kMost];
  uint32_t ids_[kMost];
  std::array<Vec3f, 3> corners_[kMost];
  // Of the candidates for which they have been asked. One radius per vertex serves all points.
  TouchPlanes planes_[kMost];
  bool has_planes_[kMost];
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_TOUCH_CANDIDATES_H_

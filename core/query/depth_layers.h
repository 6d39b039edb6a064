// SPDX-License-Identifier: Apache-2.0
//
// A picture's points by layers of depth. They come pixel by pixel, neighbours in the picture, but
// where a picture shows leaves before leaves each block of sixteen reaches from the nearest to the
// farthest. To part them in space (point_parter.h) costs some 35 cycles a point; to sort them by
// how deep they lie, in a few dozen layers, each with its points as they came, costs eight, and
// leaves blocks nearly as narrow.
//
// Which way depth runs nobody says: it is where points of one block differ most.
//
// Thread safety: a plain value.
//
//   const DepthLayers layers(positions, valid);
//   if (layers.gain() > 1.5) order = layers.Order();
#ifndef SIGHTLINE_CORE_QUERY_DEPTH_LAYERS_H_
#define SIGHTLINE_CORE_QUERY_DEPTH_LAYERS_H_

#include <cstddef>
#include <cstdint>
#include <span>

#include "core/base/aligned_vector.h"
#include "core/base/cancel.h"
#include "core/geometry/vec3.h"
#include "core/query/point_parter.h"

namespace sightline {

class DepthLayers {
 public:
  // Looks at a sample of some five hundred points. The points must outlive this.
  // REQUIRES: as many flags as positions, at least sixteen; valid ones are finite.
  DepthLayers(std::span<const Vec3f> positions, std::span<const uint8_t> valid);

  // How many times as wide blocks of sixteen are, about, in the order given as they would be in
  // layers: less than 1 where layers would part what belongs together, 0 where blocks are thin
  // already, or nothing can be said (hardly any is valid as a whole, or all points are one).
  double gain() const { return gain_; }

  // The valid points, the layers one after another, every other one backward, so that where one
  // ends the next begins. O(n); once `cancel` has fired it ends soon, with none.
  // REQUIRES: gain() > 0, fewer than 2^32 points.
  PartedPoints Order(const CancelToken* cancel = nullptr) const;

 private:
  // The layer of each point; behind all layers, `layers_`, of those that are not valid, and of what
  // there is room for besides.
  AlignedVector<uint8_t> LayersOfPoints(size_t room) const;

  std::span<const Vec3f> positions_;
  std::span<const uint8_t> valid_;
  double gain_ = 0;
  uint32_t layers_ = 0;
  // By depth, in layers: along `axis_`, and what that is for the first one's beginning.
  Vec3f axis_;
  float first_ = 0;
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_DEPTH_LAYERS_H_

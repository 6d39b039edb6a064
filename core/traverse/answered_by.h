// SPDX-License-Identifier: Apache-2.0
//
// What answered a ray: how far the work that rays share went for it. Not part of the answer: it
// depends on the strategy, on which rays walk together, and on the instruction set.
//
// Thread safety: plain values.
#ifndef SIGHTLINE_CORE_TRAVERSE_ANSWERED_BY_H_
#define SIGHTLINE_CORE_TRAVERSE_ANSWERED_BY_H_

#include <cstdint>

namespace sightline {

enum class AnsweredBy : uint8_t {
  kNoRay = 0,  // Nothing was asked.
  // Whole shafts alone: found empty, or (but not with kRtt) covered; or the triangle just beneath
  // the point. No ray's test decided.
  kShaft = 1,
  // A shaft's relevant triangles, of which some took the exact test of the ray; with kRtt a tile's
  // list with at least one triangle, be it one that covers the tile and needs no test.
  kTriangles = 2,
  kPacket = 3,  // The boxes were shared, each triangle was tested with each ray.
  kRay = 4,     // The ray walked by itself, or was put to every triangle.
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_TRAVERSE_ANSWERED_BY_H_

// SPDX-License-Identifier: Apache-2.0
//
// Segments as a scene stores them: float32(x - origin), the difference in double, in the scene's
// own origin (Scene::origin). What the server would make of the doubles, in half the bytes; so the
// answers are the same, to the last bit.
//
// A segment with an end that is not finite, or has a coordinate beyond 2^40 in magnitude in the
// world or relative to the origin, is stored as NaNs: the server answers that it is not valid.
//
// Thread safety: a free function.
//
//   item->set_segments_f32(StoreSegments(query.segments, scene.origin));
#ifndef SIGHTLINE_CLIENT_LIB_STORED_SEGMENTS_H_
#define SIGHTLINE_CLIENT_LIB_STORED_SEGMENTS_H_

#include <span>
#include <string>

#include "client/lib/types.h"

namespace sightline::client {

// Float32 [n, 6], packed, of float64 [n, 6]. REQUIRES: 6 divides the length.
std::string StoreSegments(std::span<const double> segments, const Point3& origin);

}  // namespace sightline::client

#endif  // SIGHTLINE_CLIENT_LIB_STORED_SEGMENTS_H_

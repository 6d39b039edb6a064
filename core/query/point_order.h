// SPDX-License-Identifier: Apache-2.0
//
// Which order to walk points in, so that blocks of them are neighbours and share a shaft. Points of
// a camera or a mesh come that way; shuffled ones are brought along a space-filling curve first,
// once for all their lights. Internal to core/query.
//
// Thread safety: functions only.
#ifndef SIGHTLINE_CORE_QUERY_POINT_ORDER_H_
#define SIGHTLINE_CORE_QUERY_POINT_ORDER_H_

#include <cstdint>
#include <span>
#include <vector>

#include "core/geometry/vec3.h"

namespace sightline {

// Whether neighbours in the given order lie far apart, for the room that all take: then ordering
// them pays. Looks at a sample of them.
bool IsScattered(std::span<const Vec3f> positions, std::span<const uint8_t> valid);

// The valid points along a Morton curve through their box, 2^10 cells an axis; in a cell as they
// come.
std::vector<uint32_t> MortonOrder(std::span<const Vec3f> positions, std::span<const uint8_t> valid);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_POINT_ORDER_H_

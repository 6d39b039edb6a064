// SPDX-License-Identifier: Apache-2.0
//
// A hash of where a stored vertex is, whatever its index.
//
// Thread safety: a pure function.
#ifndef SIGHTLINE_CORE_MESH_POSITION_HASH_H_
#define SIGHTLINE_CORE_MESH_POSITION_HASH_H_

#include <bit>
#include <cstdint>

#include "core/base/mix_bits.h"
#include "core/geometry/vec3.h"

namespace sightline {

// By the bits of its coordinates. REQUIRES: none is -0.
inline uint64_t HashPosition(Vec3f p) {
  const auto bits = [](float x) { return uint64_t{std::bit_cast<uint32_t>(x)}; };
  return MixBits((bits(p.x) << 32 | bits(p.y)) ^ MixBits(bits(p.z)));
}

}  // namespace sightline

#endif  // SIGHTLINE_CORE_MESH_POSITION_HASH_H_

// SPDX-License-Identifier: Apache-2.0
//
// What neighbouring shafts of one origin or direction can share, and answers do not depend on: the
// frame that their rays are placed in, and which way the surface under their points faces.
//
// Thread safety: one thread's own.
#ifndef SIGHTLINE_CORE_TRAVERSE_SHAFT_SEED_H_
#define SIGHTLINE_CORE_TRAVERSE_SHAFT_SEED_H_

#include "core/geometry/vec3.h"
#include "core/shaft/frame.h"

namespace sightline {

struct ShaftSeed {
  bool made = false;  // By the first shaft that is asked.
  ShaftFrame frame;
  Vec3f cap_normal;  // Of the receivers' cap (margins.h).
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_TRAVERSE_SHAFT_SEED_H_

// SPDX-License-Identifier: Apache-2.0
//
// What neighbouring shafts can share, of one direction or of origins near one another, and answers
// do not depend on: the frame that their rays are placed in, and which way the surface under their
// points faces.
//
// Thread safety: one thread's own.
#ifndef SIGHTLINE_CORE_TRAVERSE_SHAFT_SEED_H_
#define SIGHTLINE_CORE_TRAVERSE_SHAFT_SEED_H_

#include "core/geometry/vec3.h"
#include "core/shaft/frame.h"

namespace sightline {

struct ShaftSeed {
  bool made = false;  // By a shaft that had none, or not one that held it.
  ShaftFrame frame;
  Vec3f cap_normal;  // Of the receivers' cap (margins.h).

  // Whether the frame's axis leads to where `own` does, from the origin, so that it may well hold
  // what is there: within 53°, where it holds 66 (kMinDepthShare).
  bool LeadsTo(Vec3f own) const {
    const float depth = Dot(frame.w, own);
    return depth > 0 && depth * depth >= 0.36f * Dot(own, own);
  }
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_TRAVERSE_SHAFT_SEED_H_

// SPDX-License-Identifier: Apache-2.0
//
// Which way is up and which way is north in a scene: what altitudes and azimuths are turned into
// directions with. Altitudes count from the horizon up, azimuths from north by way of east, both in
// degrees.
//
// Thread safety: plain values.
//
//   SL_ASSIGN_OR_RETURN(HorizonFrame frame, MakeHorizonFrame({0, 0, 1}, {0, 1, 0}));
//   Vec3d southeast = frame.Toward(/*altitude_degrees=*/30, /*azimuth_degrees=*/135);
#ifndef SIGHTLINE_CORE_LIGHT_HORIZON_FRAME_H_
#define SIGHTLINE_CORE_LIGHT_HORIZON_FRAME_H_

#include "absl/status/statusor.h"
#include "core/geometry/vec3.h"

namespace sightline {

struct HorizonFrame {
  Vec3d up, north, east;  // Unit, mutually orthogonal; east = north × up.

  // A unit vector. Uses sin() and cos(): for what is prepared, never on the way to an answer.
  Vec3d Toward(double altitude_degrees, double azimuth_degrees) const;
};

// `up` and `north` of any length; of `north` the level part is taken. InvalidArgument with the
// value: one that is zero or not finite, or a north within 0.06° of up or down.
absl::StatusOr<HorizonFrame> MakeHorizonFrame(Vec3d up, Vec3d north);

// The north that modellers mean who only say what is up: -z where that is mostly y or -y, else y.
// Fits MakeHorizonFrame for every `up` that does.
Vec3d DefaultNorth(Vec3d up);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_LIGHT_HORIZON_FRAME_H_

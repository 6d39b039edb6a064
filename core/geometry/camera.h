// SPDX-License-Identifier: Apache-2.0
//
// A pinhole camera. It travels with its basis and the tangent of half its vertical field of view,
// so that no library function stands between a request and its rays: the ray of a pixel is a fixed
// sequence of double additions, multiplications and divisions, rounded once to the stored floats.
//
// Pixel (0, 0) is the upper left one; rays go through pixel centres and depend on the absolute
// pixel index alone, never on a tile. A ray's parameter t is the depth along `forward`.
//
// Thread safety: plain values. REQUIRES, of Pixel...: round to nearest, gradual underflow.
//
//   absl::StatusOr<Camera> camera = LookAt({0, -5, 2}, {0, 0, 1}, {0, 0, 1}, 50.0, 1920, 1080);
//   Vec3f direction = PixelDirection(*camera, 17, 4);
#ifndef SIGHTLINE_CORE_GEOMETRY_CAMERA_H_
#define SIGHTLINE_CORE_GEOMETRY_CAMERA_H_

#include <cstdint>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "core/geometry/vec3.h"

namespace sightline {

struct Camera {
  Vec3d eye;                       // World coordinates.
  Vec3d right, up, forward;        // Unit, mutually orthogonal.
  double tan_half_fov_y = 0;       // > 0; half the image's height over the depth.
  uint32_t width = 0, height = 0;  // Pixels, 1 .. kMaxImageSide.
};

inline constexpr uint32_t kMaxImageSide = 1u << 16;
// tan(89.95°) = 1145.9; wider cameras are refused, as are ones narrower than 1 / 2^20.
inline constexpr double kMaxTanHalfFov = 1146.0;
inline constexpr double kMinTanHalfFov = 1.0 / (1 << 20);
// How far a travelling basis may be from orthonormal, per dot product: generous enough for a basis
// kept in floats, small enough that a swapped or unscaled vector is noticed.
inline constexpr double kBasisTolerance = 1.0 / (1 << 16);

// InvalidArgument naming the field and its value.
absl::Status ValidateCamera(const Camera& camera);

// A camera at `eye` that looks at `at`, `up` upright. REQUIRES nothing: eye = at, an up vector
// along the view, a field of view outside (0°, 179.9°) or a size of zero give InvalidArgument with
// the value. Uses tan(): for clients, which send the result; the engine itself never calls it.
absl::StatusOr<Camera> LookAt(Vec3d eye, Vec3d at, Vec3d up, double fov_y_degrees, uint32_t width,
                              uint32_t height);

// forward + right·sx + up·sy with sx = (2(x+½)/width − 1)·tan·width/height and
// sy = (1 − 2(y+½)/height)·tan, in double in this order, each component rounded once.
Vec3f PixelDirection(const Camera& camera, uint32_t x, uint32_t y);

// Its two terms, for many pixels at a time: the same bits as ToFloat(column(x) + row(y)).
Vec3d PixelColumn(const Camera& camera, uint32_t x);  // forward + right·sx.
Vec3d PixelRow(const Camera& camera, uint32_t y);     // up·sy.

}  // namespace sightline

#endif  // SIGHTLINE_CORE_GEOMETRY_CAMERA_H_

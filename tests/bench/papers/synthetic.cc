// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/papers/synthetic.h"

#include <cmath>

#include "core/base/check.h"

namespace sightline::bench {
namespace {

constexpr double kEdge = 2;  // Of the cell.
constexpr double kOriginDistance = 3;

Vec3d OnUnitSphere(Random& random) {
  for (;;) {
    const Vec3d v{random.Uniform(-1, 1), random.Uniform(-1, 1), random.Uniform(-1, 1)};
    const double length = Length(v);
    if (length > 0.1 && length <= 1) return v * (1 / length);
  }
}

// Of a sphere `ratio` times smaller than the cell's, within the cell.
Vec3d MiddleOf(double ratio, Random& random) {
  const double room = 1 - 1 / ratio;
  return {random.Uniform(-room, room), random.Uniform(-room, room), random.Uniform(-room, room)};
}

}  // namespace

SyntheticCell MakeCell(size_t triangles, double ratio, uint64_t seed) {
  Random random(seed);
  SyntheticCell cell;
  for (size_t i = 0; i < triangles; ++i) {
    const Vec3d middle = MiddleOf(ratio, random);
    std::array<Vec3f, 3> corners;
    for (Vec3f& corner : corners) corner = ToFloat(middle + OnUnitSphere(random) * (1 / ratio));
    cell.triangles.push_back(corners);
  }
  return cell;
}

SyntheticPacket MakePacket(size_t size, double ratio, double jitter, Random& random) {
  const auto side = static_cast<size_t>(std::lround(std::sqrt(static_cast<double>(size))));
  SIGHTLINE_CHECK_EQ(side * side, size);
  const Vec3d middle = MiddleOf(ratio, random);
  const Vec3d toward = OnUnitSphere(random);
  const Vec3d origin = middle - toward * kOriginDistance;
  Vec3d right = Cross(toward, OnUnitSphere(random));
  while (Length(right) < 0.1) right = Cross(toward, OnUnitSphere(random));
  right = right * (1 / Length(right));
  const Vec3d up = Cross(right, toward);
  SyntheticPacket packet;
  packet.origin = ToFloat(origin);
  const double pixel = jitter * kEdge / static_cast<double>(side);
  const double half = jitter * kEdge / 2;
  for (size_t y = 0; y < side; ++y) {
    for (size_t x = 0; x < side; ++x) {
      const double px = (static_cast<double>(x) + random.Uniform(0, 1)) * pixel - half;
      const double py = (static_cast<double>(y) + random.Uniform(0, 1)) * pixel - half;
      packet.directions.push_back(ToFloat(middle + right * px + up * py - origin));
    }
  }
  return packet;
}

}  // namespace sightline::bench

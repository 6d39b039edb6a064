// SPDX-License-Identifier: Apache-2.0
#include "client/lib/stored_segments.h"

#include <array>
#include <cmath>
#include <cstring>
#include <limits>

namespace sightline::client {
namespace {

// The wire's bound on coordinates (SegmentItem.segments).
constexpr double kMaxCoordinate = 1099511627776.0;  // 2^40

}  // namespace

std::string StoreSegments(std::span<const double> segments, const Point3& origin) {
  constexpr size_t kNumbers = 6;
  std::string bytes(segments.size() * sizeof(float), '\0');
  char* out = bytes.data();
  for (size_t i = 0; i < segments.size(); i += kNumbers) {
    std::array<float, kNumbers> stored;
    int valid = 1;  // Without branches.
    for (size_t k = 0; k < kNumbers; ++k) {
      const double world = segments[i + k], relative = world - origin[k % 3];
      valid &= static_cast<int>(std::abs(world) <= kMaxCoordinate);
      valid &= static_cast<int>(std::abs(relative) <= kMaxCoordinate);
      stored[k] = static_cast<float>(relative);
    }
    if (valid == 0) stored.fill(std::numeric_limits<float>::quiet_NaN());
    std::memcpy(out, stored.data(), sizeof(stored));
    out += sizeof(stored);
  }
  return bytes;
}

}  // namespace sightline::client

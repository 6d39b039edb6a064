// SPDX-License-Identifier: Apache-2.0
//
// What the hunts for counter-examples to core/shaft/margins.h share: 113-bit arithmetic, one lane
// of the walks' float arithmetic, and the fixture that judges a hunt.
//
// Thread safety: plain values and functions.
#ifndef SIGHTLINE_TESTS_CORE_SHAFT_MARGIN_FIXTURE_H_
#define SIGHTLINE_TESTS_CORE_SHAFT_MARGIN_FIXTURE_H_

#include <cmath>
#include <iostream>
#include <optional>
#include <string>

#include "core/shaft/frame.h"
#include "gtest/gtest.h"
#include "tests/core/shaft/margin_hunt.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline::testing_support {

using Quad = __float128;

inline constexpr int64_t kClimbs = 600;
// The error that a hunt must find, as a share of the margin: more than a sixteenth; half of that
// where a constant covers, among others, what errs less.
inline constexpr double kTight = 1.0 / 16, kLoose = 1.0 / 32;

struct Vec3q {
  Quad x, y, z;
};
inline Vec3q ToQuad(Vec3f v) { return {v.x, v.y, v.z}; }
inline Vec3q operator-(Vec3q a, Vec3q b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
inline Vec3q operator+(Vec3q a, Vec3q b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
inline Vec3q operator*(Vec3q a, Quad s) { return {a.x * s, a.y * s, a.z * s}; }
inline Quad DotQ(Vec3q a, Vec3q b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline Vec3q CrossQ(Vec3q a, Vec3q b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
inline Quad AbsQ(Quad x) { return x < 0 ? -x : x; }

// One lane of DotV, CrossV and Norm1V (predicate-inl.h), operation by operation.
inline float DotF(Vec3f a, Vec3f b) { return std::fma(a.x, b.x, std::fma(a.y, b.y, a.z * b.z)); }
inline Vec3f CrossF(Vec3f a, Vec3f b) {
  return {std::fma(a.y, b.z, -(a.z * b.y)), std::fma(a.z, b.x, -(a.x * b.z)),
          std::fma(a.x, b.y, -(a.y * b.x))};
}
inline float Norm1(Vec3f a) { return std::abs(a.x) + std::abs(a.y) + std::abs(a.z); }
inline Vec3f Abs(Vec3f a) { return {std::abs(a.x), std::abs(a.y), std::abs(a.z)}; }

inline double Ratio(Quad error, Quad margin) { return static_cast<double>(AbsQ(error) / margin); }

// The k-th vector of an input.
inline Vec3f At(const HuntInput& input, size_t k) {
  return {input[3 * k], input[3 * k + 1], input[3 * k + 2]};
}
inline void Append(Vec3f v, HuntInput* input) { input->insert(input->end(), {v.x, v.y, v.z}); }

inline std::optional<ShaftFrame> FrameOf(Vec3f axis, Vec3f sideways) {
  ShaftFrame frame;
  if (!MakeShaftFrame(ToDouble(axis), ToDouble(sideways), &frame)) return std::nullopt;
  return frame;
}

class MarginsTest : public testing::Test {
 protected:
  // The margin held, and the hunt came near enough to tell.
  static void Report(const std::string& what, const Hunt& hunt, double least) {
    std::cout << what << ": " << hunt.worst() << "\n";
    EXPECT_LE(hunt.worst(), 1) << what << ": " << hunt;
    if (kSanitizerBuild) return;  // Hunts less.
    EXPECT_GT(hunt.worst(), least) << what << ": the hunt is not hunting";
  }

  Vec3f Random(double scale) {
    return ToFloat(Vec3d{rng_.Uniform(-scale, scale), rng_.Uniform(-scale, scale),
                         rng_.Uniform(-scale, scale)});
  }
  // About one, or anywhere from `least` to `most` as powers of two.
  double Scale(int least, int most) {
    if (rng_.Chance(0.3)) return 1;
    return std::ldexp(
        1.0, least + static_cast<int>(rng_.Below(static_cast<uint64_t>(most - least) + 1)));
  }
  // A direction that a frame along `axis` just holds, or anywhere within.
  Vec3f NearTheLimit(Vec3f axis) {
    const Vec3d w = ToDouble(axis) * (1 / Length(ToDouble(axis)));
    Vec3d side = ToDouble(Random(1));
    side = side - w * Dot(w, side);
    side = side * (1 / Length(side));
    const double depth = rng_.Chance(0.7) ? rng_.Uniform(0.4, 0.42) : rng_.Uniform(0.4, 1);
    return ToFloat(w * depth + side * std::sqrt(1 - depth * depth));
  }

  TestRng rng_;
  Hunt hunt_{rng_};
};

}  // namespace sightline::testing_support

#endif  // SIGHTLINE_TESTS_CORE_SHAFT_MARGIN_FIXTURE_H_

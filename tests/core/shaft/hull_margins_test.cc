// SPDX-License-Identifier: Apache-2.0
//
// The bounds of what all samples of an area light see of an edge (core/shaft/margins.h, as
// core/traverse/hull_leaf-inl.h computes it), against 113-bit arithmetic: of each sample's own
// value, and of the range over a block of rays. Over eight seeds error over bound was
//
//   a sample's value    0.32-0.45 (no leans)  0.34-0.48 (leans)    1.00 (samples beside the plane)
//   a block's range     0.02-0.03             0.005-0.03           0.50
#include <cmath>
#include <optional>

#include "core/intersect/predicate-inl.h"
#include "core/shaft/margins.h"
#include "gtest/gtest.h"
#include "tests/core/shaft/margin_fixture.h"
#include "tests/core/shaft/margin_hunt.h"

namespace sightline::testing_support {
namespace {

using HWY_NAMESPACE::kFloatUnderflow;

// What a light has: no extent, or one, and samples beside its parallelogram.
struct Shape {
  const char* name;
  bool leans, rest;
};
constexpr Shape kShapes[] = {
    {"centre", false, false}, {"leans", true, false}, {"rest", true, true}};

// An edge from A to B, the light's centre C and half axes, a point P, and a sample's place.
struct Case {
  Vec3f a, b, c, p, half[2], left;
  float along[2];

  Case(const HuntInput& input, const Shape& shape)
      : a(At(input, 0)),
        b(At(input, 1)),
        c(At(input, 2)),
        p(At(input, 3)),
        half{At(input, 4), At(input, 5)},
        left(At(input, 6)),
        along{std::fmod(input[21], 1.0f), std::fmod(input[22], 1.0f)} {
    if (!shape.leans) half[0] = half[1] = {0, 0, 0};
    if (!shape.rest) left = {0, 0, 0};
  }

  // e(L, P), exactly.
  Quad Exact() const {
    Vec3q light = ToQuad(c) + ToQuad(left);
    for (int h = 0; h < 2; ++h) light = light + ToQuad(half[h]) * along[h];
    return DotQ(CrossQ(ToQuad(a) - light, ToQuad(b) - ToQuad(a)), ToQuad(p) - light);
  }
  float size() const { return Norm1(half[0]) + Norm1(half[1]); }
  float rest() const { return std::max({std::abs(left.x), std::abs(left.y), std::abs(left.z)}); }
};

class HullMarginsTest : public MarginsTest {
 protected:
  HuntInput Start() {
    const double scale = Scale(-20, 36);
    const double light = scale * Scale(-10, 0);
    HuntInput input;
    const Vec3f a = Random(scale);
    const double edge = rng_.Chance(0.5) ? scale : scale * Scale(-16, 0);
    for (const Vec3f v : {a, a + Random(edge), Random(scale), Random(scale), Random(light),
                          Random(light), Random(light * 0x1p-20)}) {
      Append(v, &input);
    }
    for (int h = 0; h < 2; ++h) {
      input.push_back(static_cast<float>(rng_.Chance(0.3) ? 0.99999 : rng_.Uniform(-1, 1)));
    }
    return input;
  }
};

TEST_F(HullMarginsTest, ASamplesValueIsWithinItsBound) {
  for (const Shape& shape : kShapes) {
    Hunt hunt(rng_);
    hunt.Run(
        ScaledCount(kClimbs), [&] { return Start(); },
        [&](const HuntInput& input) -> std::optional<double> {
          const Case x(input, shape);
          const Vec3f q = x.p - x.c, corner = x.a - x.c, m = x.b - x.a;
          float value = DotF(CrossF(corner, m), q);
          for (int h = 1; h >= 0; --h) {
            const Vec3f n = CrossF(m, x.half[h]);
            const float lean =
                std::fma(n.x, q.x, std::fma(n.y, q.y, std::fma(n.z, q.z, -DotF(n, corner))));
            value = std::fma(x.along[h], lean, value);
          }
          const float longest = Norm1(m), reach = Norm1(corner);
          const float slack = longest * (kLeanUnits * x.size() + x.rest() * kRestScale);
          const float bound = std::fma(slack + kFloatUnderflow, reach, kFloatUnderflow);
          const float scale =
              std::fma(kCentreUnits, longest * reach, std::fma(slack, 3.0f, kFloatUnderflow));
          const float inf = std::max({std::abs(q.x), std::abs(q.y), std::abs(q.z)});
          const float most = std::fma(scale, inf, bound);
          if (!std::isfinite(most) || !std::isfinite(value)) return std::nullopt;
          return Ratio(Quad(value) - x.Exact(), most);
        });
    Report(std::string("a sample's value, ") + shape.name, hunt, kTight);
  }
}

TEST_F(HullMarginsTest, ABlocksRangeHoldsAllSamples) {
  for (const Shape& shape : kShapes) {
    Hunt hunt(rng_);
    hunt.Run(
        ScaledCount(kClimbs), [&] { return Start(); },
        [&](const HuntInput& input) -> std::optional<double> {
          Case x(input, shape);
          const Vec3f q = x.p - x.c, corner = x.a - x.c, m = x.b - x.a;
          const auto frame = FrameOf(q, x.a - x.c);
          if (!frame) return std::nullopt;
          const float z = DotF(frame->w, q);
          if (!(z >= kLeastDepth)) return std::nullopt;
          // A block of one point: its slopes, and inverse depths, widened as a block's.
          const float sx = DotF(frame->u, q) / z, sy = DotF(frame->v, q) / z;
          const float most_z = 1.0f / z * kDepthScale;
          const float least_z = 1.0f / (z * kDepthScale) * (2.0f - kDepthScale);
          const float iz = 0.5f * (least_z + most_z);
          const float ez = std::fma(most_z, kDepthScale - 1.0f, 0.5f * (most_z - least_z));
          const auto form = [&](Vec3f v, float offset, float* radius) {
            const float f[3] = {DotF(frame->u, v), DotF(frame->v, v), DotF(frame->w, v)};
            *radius = std::fma(std::abs(f[0]), kSlopeMargin,
                               std::fma(std::abs(f[1]), kSlopeMargin, std::abs(offset) * ez));
            return std::fma(f[0], sx, std::fma(f[1], sy, std::fma(offset, iz, f[2])));
          };
          float radius;
          const float middle = form(CrossF(corner, m), 0, &radius);
          for (int h = 0; h < 2; ++h) {
            const Vec3f n = CrossF(m, x.half[h]);
            float lean_radius;
            const float lean = form(n, -DotF(n, corner), &lean_radius);
            radius += std::abs(lean) + lean_radius;
            x.along[h] = std::copysign(1.0f, lean);  // The sample at that end.
          }
          const float longest = Norm1(m), reach = Norm1(corner);
          const float slack = longest * (kEdgeMargin * x.size() + 2 * x.rest() * kRestScale);
          const float margin = std::fma(slack * reach, most_z,
                                        std::fma(kEdgeMargin, longest * reach,
                                                 std::fma(slack, kRestPerDepth, kEdgeUnderflow)));
          if (!std::isfinite(margin) || !std::isfinite(radius)) return std::nullopt;
          const Quad depth = DotQ(ToQuad(frame->w), ToQuad(x.p) - ToQuad(x.c));
          const Quad beyond = AbsQ(x.Exact() / depth - middle) - radius;
          return beyond > 0 ? Ratio(beyond, margin) : 0.0;
        });
    // A block's rectangle of slopes covers most of the rounding, so that hunts come less near.
    Report(std::string("a block's range, ") + shape.name, hunt, kTight / 64);
  }
}

}  // namespace
}  // namespace sightline::testing_support

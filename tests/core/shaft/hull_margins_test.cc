// SPDX-License-Identifier: Apache-2.0
//
// The bounds of what all samples of an area light see of an edge (core/shaft/margins.h, as
// core/traverse/hull_leaf-inl.h computes it), against 113-bit arithmetic: of each sample's own
// value, and of the range over a block of rays, of all and of one. Over eight seeds error over
// bound was
//
//   a sample's value    0.32-0.45 (no leans)  0.34-0.48 (leans)    1.00 (samples beside the plane)
//   a block's range     0.02-0.03             0.005-0.03           0.50
//   the same of one     0.02-0.03             0.005-0.03           0.50
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

// A block of one point, as the light's frame sees it, and an edge's forms over it.
struct Block {
  ShaftFrame frame;
  float x, y;                // Slopes.
  float most, middle, half;  // Inverse depths, widened as a block's.
  Vec3f q, corner, edge;
  const Case& of;

  static std::optional<Block> Of(const Case& of) {
    const Vec3f q = of.p - of.c, corner = of.a - of.c;
    const auto frame = FrameOf(q, corner);
    if (!frame) return std::nullopt;
    const float z = DotF(frame->w, q);
    if (!(z >= kLeastDepth)) return std::nullopt;
    const float most = 1.0f / z * kDepthScale;
    const float least = 1.0f / (z * kDepthScale) * (2.0f - kDepthScale);
    return Block{.frame = *frame,
                 .x = DotF(frame->u, q) / z,
                 .y = DotF(frame->v, q) / z,
                 .most = most,
                 .middle = 0.5f * (least + most),
                 .half = std::fma(most, kDepthScale - 1.0f, 0.5f * (most - least)),
                 .q = q,
                 .corner = corner,
                 .edge = of.b - of.a,
                 .of = of};
  }

  // Coefficients: of slopes, of the inverse depth, and of one.
  struct Form {
    float x, y, one, inverse;
  };
  Form Along(Vec3f v, float offset) const {
    return {DotF(frame.u, v), DotF(frame.v, v), DotF(frame.w, v), offset};
  }
  Form Centre() const { return Along(CrossF(corner, edge), 0); }
  Form Lean(int h) const {
    const Vec3f n = CrossF(edge, of.half[h]);
    return Along(n, -DotF(n, corner));
  }
  float Middle(const Form& f) const {
    return std::fma(f.x, x, std::fma(f.y, y, std::fma(f.inverse, middle, f.one)));
  }
  float Radius(const Form& f, float margin) const {
    return std::fma(
        std::abs(f.x), kSlopeMargin,
        std::fma(std::abs(f.y), kSlopeMargin, std::fma(std::abs(f.inverse), half, margin)));
  }
  float Margin() const {
    const float longest = Norm1(edge), reach = Norm1(corner);
    const float slack = longest * (kEdgeMargin * of.size() + 2 * of.rest() * kRestScale);
    return std::fma(
        slack * reach, most,
        std::fma(kEdgeMargin, longest * reach, std::fma(slack, kRestPerDepth, kEdgeUnderflow)));
  }

  // By how many margins a sample's value lies beyond `about` and `radius`.
  std::optional<double> Beyond(const Case& sample, float about, float radius) const {
    const float margin = Margin();
    if (!std::isfinite(margin) || !std::isfinite(radius)) return std::nullopt;
    const Quad depth = DotQ(ToQuad(frame.w), ToQuad(of.p) - ToQuad(of.c));
    const Quad beyond = AbsQ(sample.Exact() / depth - about) - radius;
    return beyond > 0 ? Ratio(beyond, margin) : 0.0;
  }
};

TEST_F(HullMarginsTest, ABlocksRangeHoldsAllSamples) {
  for (const Shape& shape : kShapes) {
    Hunt hunt(rng_);
    hunt.Run(
        ScaledCount(kClimbs), [&] { return Start(); },
        [&](const HuntInput& input) -> std::optional<double> {
          const Case all(input, shape);
          const auto block = Block::Of(all);
          if (!block) return std::nullopt;
          Case farthest = all;
          float radius = block->Radius(block->Centre(), 0);
          for (int h = 0; h < 2; ++h) {
            const float lean = block->Middle(block->Lean(h));
            radius += std::abs(lean) + block->Radius(block->Lean(h), 0);
            farthest.along[h] = std::copysign(1.0f, lean);
          }
          return block->Beyond(farthest, block->Middle(block->Centre()), radius);
        });
    // A block's rectangle of slopes covers most of the rounding, so that hunts come less near.
    Report(std::string("a block's range, ") + shape.name, hunt, kTight / 64);
  }
}

TEST_F(HullMarginsTest, ABlocksRangeOfASampleHoldsIt) {
  for (const Shape& shape : kShapes) {
    Hunt hunt(rng_);
    hunt.Run(
        ScaledCount(kClimbs), [&] { return Start(); },
        [&](const HuntInput& input) -> std::optional<double> {
          const Case sample(input, shape);
          const auto block = Block::Of(sample);
          if (!block) return std::nullopt;
          Block::Form form = block->Centre();
          for (int h = 1; h >= 0; --h) {
            const Block::Form lean = block->Lean(h);
            const float along = sample.along[h];
            form = {std::fma(along, lean.x, form.x), std::fma(along, lean.y, form.y),
                    std::fma(along, lean.one, form.one),
                    std::fma(along, lean.inverse, form.inverse)};
          }
          return block->Beyond(sample, block->Middle(form), block->Radius(form, 0));
        });
    Report(std::string("a block's range of a sample, ") + shape.name, hunt, kTight / 64);
  }
}

}  // namespace
}  // namespace sightline::testing_support

// SPDX-License-Identifier: Apache-2.0
//
// The margins of parallel rays and of the receivers' cap, as margins_test.cc has those of rays with
// a common origin.
#include <algorithm>
#include <cmath>
#include <optional>

#include "core/intersect/predicate-inl.h"
#include "core/shaft/frame.h"
#include "core/shaft/margins.h"
#include "gtest/gtest.h"
#include "tests/core/shaft/margin_fixture.h"
#include "tests/core/shaft/margin_hunt.h"

namespace sightline::testing_support {
namespace {

using HWY_NAMESPACE::kFloatUnderflow;

class ParallelMarginsTest : public MarginsTest {};

// ---- Parallel rays

TEST_F(ParallelMarginsTest, FormsOfParallelRays) {
  Hunt edge_block(rng_), plane_block(rng_), edge_ray(rng_), plane_ray(rng_);
  const auto start = [&] {
    const double scale = Scale(-20, 30);
    HuntInput input;
    const Vec3f r = Random(rng_.Chance(0.5) ? scale : Scale(0, 39));
    const Vec3f a = r + Random(scale);
    const double size = rng_.Chance(0.5) ? scale : scale * Scale(-16, 0);
    const double spread = rng_.Chance(0.5) ? scale : scale * Scale(-8, 8);
    const Vec3f d = Random(Scale(-19, 19));
    // Origins anywhere, or far along the rays: there the basis' own rounding shows.
    const Vec3f away = rng_.Chance(0.5) ? Random(1) : d * (1 / MaxAbs(d));
    for (const Vec3f v : {d, Random(1), r, a, a + Random(size), a + Random(size),
                          r + away * static_cast<float>(spread)}) {
      Append(v, &input);
    }
    return input;
  };
  enum Form { kEdgeBlock, kPlaneBlock, kEdgeRay, kPlaneRay };
  const auto ratio = [](const HuntInput& input, Form form) -> std::optional<double> {
    const Vec3f direction = At(input, 0), r = At(input, 2), p = At(input, 6);
    const Vec3f a = At(input, 3), b = At(input, 4), c = At(input, 5);
    const float size = MaxAbs(direction);
    if (!(size >= 0x1p-20f) || !(size <= 0x1p20f)) return std::nullopt;
    const auto frame = FrameOf(direction, At(input, 1));
    if (!frame) return std::nullopt;
    const bool plane = form == kPlaneBlock || form == kPlaneRay;
    const Vec3f ab = b - a, bc = c - b, ra = a - r, own = p - r;
    // Both are (A-P)·m with m the normal, or the edge's product with D.
    const Vec3f m = plane ? CrossF(ab, bc) : CrossF(ab, direction);
    const Vec3q exact = plane ? CrossQ(ToQuad(b) - ToQuad(a), ToQuad(c) - ToQuad(b))
                              : CrossQ(ToQuad(b) - ToQuad(a), ToQuad(direction));
    const Quad truth = DotQ(exact, ToQuad(a) - ToQuad(p));
    const float k = Norm1(ab) * (plane ? Norm1(bc) : size) * (Norm1(ra) + Norm1(own));
    const float offset = DotF(m, ra);
    if (form == kEdgeRay || form == kPlaneRay) {
      return Ratio(truth - (offset - DotF(m, own)), std::fma(kParallelUnits, k, kFloatUnderflow));
    }
    const float x = DotF(frame->u, own), y = DotF(frame->v, own), z = DotF(frame->w, own);
    float value = std::fma(-DotF(frame->u, m), x, std::fma(-DotF(frame->v, m), y, offset));
    if (plane) value = std::fma(-DotF(frame->w, m), z, value);
    return Ratio(truth - value, std::fma(kEdgeMargin, k, kEdgeUnderflow));
  };
  const struct {
    const char* name;
    Hunt& hunt;
    Form form;
    double least;
  } hunts[] = {{"kEdgeMargin, parallel edges over a block", edge_block, kEdgeBlock, kLoose},
               {"kEdgeMargin, parallel planes over a block", plane_block, kPlaneBlock, kLoose},
               {"kParallelUnits, edges", edge_ray, kEdgeRay, kTight},
               {"kParallelUnits, planes", plane_ray, kPlaneRay, kTight}};
  for (const auto& [name, hunt, form, least] : hunts) {
    const Form which = form;
    hunt.Run(ScaledCount(kClimbs), start,
             [&ratio, which](const HuntInput& input) { return ratio(input, which); });
    Report(name, hunt, least);
  }
}

// A hit along a parallel ray keeps the offsets of its origin.
TEST_F(ParallelMarginsTest, OffsetsOfParallelRaysHoldTheirHits) {
  hunt_.Run(
      ScaledCount(kClimbs),
      [&] {
        const double scale = Scale(-20, 30);
        HuntInput input;
        const Vec3f r = Random(rng_.Chance(0.5) ? scale : Scale(0, 39));
        for (const Vec3f v :
             {Random(Scale(-19, 19)), Random(1), r, r + Random(rng_.Chance(0.5) ? scale : 1)}) {
          Append(v, &input);
        }
        input.push_back(static_cast<float>(scale * Scale(-8, 8)));
        return input;
      },
      [&](const HuntInput& input) -> std::optional<double> {
        const Vec3f direction = At(input, 0), r = At(input, 2), p = At(input, 3);
        const float size = MaxAbs(direction);
        if (!(size >= 0x1p-20f) || !(size <= 0x1p20f)) return std::nullopt;
        const auto frame = FrameOf(direction, At(input, 1));
        if (!frame) return std::nullopt;
        const Vec3f own = p - r;
        const Vec3q hit =
            ToQuad(p) + ToQuad(direction) * (AbsQ(Quad(input[12])) / size) - ToQuad(r);
        const Quad reach = AbsQ(hit.x) + AbsQ(hit.y) + AbsQ(hit.z) + Norm1(own);
        const auto ratio = [&](Vec3f axis) {
          return Ratio(DotQ(ToQuad(axis), hit) - DotF(axis, own), kBoxMargin * reach);
        };
        return std::max(ratio(frame->u), ratio(frame->v));
      });
  Report("kBoxMargin, parallel offsets", hunt_, kLoose);
}

// ---- Receivers' cap

TEST_F(ParallelMarginsTest, CapsHoldTheirReceivers) {
  hunt_.Run(
      ScaledCount(kClimbs),
      [&] {
        HuntInput input;
        const Vec3f centre = Random(Scale(-20, 39));
        const Vec3f n = Random(1);
        Append(n * (1 / Length(n)), &input);
        Append(centre, &input);
        Append(rng_.Chance(0.5) ? centre + Random(Scale(-30, 30)) : Random(Scale(-20, 39)), &input);
        return input;
      },
      [&](const HuntInput& input) -> std::optional<double> {
        const Vec3f g = At(input, 0), c = At(input, 1), x = At(input, 2);
        if (MaxAbs(g) > 1.0f) return std::nullopt;
        const Vec3f p = x - c;
        const float value = DotF(g, p), sum = DotF(Abs(g), Abs(p));
        if (!(sum > 0x1p-60f)) return std::nullopt;
        const Quad truth = DotQ(ToQuad(g), ToQuad(x) - ToQuad(c));
        // As MakeCap (above) and WithinCap (below) widen it.
        EXPECT_LE(truth, Quad(std::fma(sum, kCapMargin, value))) << Hex(input);
        EXPECT_GE(truth, Quad(std::fma(-sum, kCapMargin, value))) << Hex(input);
        return Ratio(truth - value, Quad(kCapMargin) * sum);
      });
  Report("kCapMargin", hunt_, kTight);
}

}  // namespace
}  // namespace sightline::testing_support

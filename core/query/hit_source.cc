// SPDX-License-Identifier: Apache-2.0
#include "core/query/hit_source.h"

#include <cmath>

#include "core/intersect/predicate.h"
#include "hwy/highway.h"

namespace sightline {
namespace {

// The most by which the exact parameter of a hit can differ from its float, relatively: one
// rounding (2^-24), the slab test's hold on it (2^-20, kSegmentEnd), and the distance's own error
// in doubles unless the ray grazes. A larger correction would say that doubles cannot tell where a
// grazing ray meets the plane; then t is as good.
constexpr double kParameterError = 0x1p-19;

// One instruction set is enough (AVX2, the floor): four doubles.
namespace hn = hwy::HWY_NAMESPACE;
using Four = hn::CappedTag<double, 4>;
static_assert(hn::MaxLanes(Four()) == 4, "x86-64-v3 holds four doubles in a vector");
using FourFloats = hn::Rebind<float, Four>;
using V = hn::Vec<Four>;
using Vec3v = Vec3<V>;

V All(double x) { return hn::Set(Four(), x); }
Vec3v All(Vec3d p) { return {All(p.x), All(p.y), All(p.z)}; }
Vec3v Abs(Vec3v p) { return {hn::Abs(p.x), hn::Abs(p.y), hn::Abs(p.z)}; }
V NormOne(Vec3v p) { return (hn::Abs(p.x) + hn::Abs(p.y)) + hn::Abs(p.z); }
Vec3v IfThenElse(hn::Mask<Four> mask, Vec3v yes, Vec3v no) {
  return {hn::IfThenElse(mask, yes.x, no.x), hn::IfThenElse(mask, yes.y, no.y),
          hn::IfThenElse(mask, yes.z, no.z)};
}

// As std::max and std::min choose where both are zeros.
V Clamp(V x, double lo, double hi) {
  const V held = hn::IfThenElse(hn::Lt(x, All(lo)), All(lo), x);
  return hn::IfThenElse(hn::Lt(All(hi), held), All(hi), held);
}

uint32_t Bits(hn::Mask<Four> mask) {
  uint8_t bytes[8] = {};
  hn::StoreMaskBits(Four(), mask, bytes);
  return bytes[0];
}

}  // namespace

HitSource::HitSource(const IndexedGeometry& scene, Vec3f origin, uint32_t triangle)
    : triangle(triangle) {
  const auto corners = scene.geometry.Corners(triangle);
  const auto& [a, b, c] = corners;
  anchor = ToDouble(a);
  const Vec3d ab = ToDouble(b) - anchor, ac = ToDouble(c) - anchor;
  normal = Cross(ab, ac);
  permanent = {std::abs(ab.y * ac.z) + std::abs(ab.z * ac.y),
               std::abs(ab.z * ac.x) + std::abs(ab.x * ac.z),
               std::abs(ab.x * ac.y) + std::abs(ab.y * ac.x)};
  closest = ClosestPoints(a, b, c);
  // An origin within the plane sees the triangle by a test of the papers' alone; either side will
  // do.
  const int side = SideOfPlane(a, b, c, origin);
  plane = MakePlane(corners, side != 0 ? side : 1);
}

Placement HitSource::PlacementOf(Vec3f origin, Vec3f direction, float t) const {
  const Vec3d d = ToDouble(direction);
  // What rounding took from t, from the height left over the plane.
  Vec3d p = ToDouble(origin) + d * static_cast<double>(t);
  const double lost = Dot(normal, anchor - p) / Dot(normal, d);
  if (std::abs(lost) <= kParameterError * t) p = p + d * lost;
  const Vec3d at = closest.To(p);
  return {.at = at,
          .source = triangle,
          .side = plane.side,
          .radius = HitTouchRadius(sightline::NormOne(at), sightline::NormOne(d) * t),
          .reference = origin};
}

void HitSource::PlacementsOf(const RayPacket& packet, const std::array<int, 4>& lanes,
                             const std::array<Placement*, 4>& placements) const {
  const Four four;
  const FourFloats floats;
  alignas(16) float in[4][4];
  for (int i = 0; i < 4; ++i) {
    in[0][i] = packet.target_x[lanes[i]];
    in[1][i] = packet.target_y[lanes[i]];
    in[2][i] = packet.target_z[lanes[i]];
    in[3][i] = packet.t[lanes[i]];
  }
  const auto load = [&](int row) { return hn::PromoteTo(four, hn::Load(floats, in[row])); };
  const Vec3v d = {load(0), load(1), load(2)};
  const V t = load(3);

  Vec3v p = All(ToDouble(packet.origin)) + d * t;
  const Vec3v n = All(normal);
  const V lost = Dot(n, All(anchor) - p) / Dot(n, d);
  p = IfThenElse(hn::Le(hn::Abs(lost), All(kParameterError) * t), p + d * lost, p);

  const Vec3v m = All(closest.n), ap = p - All(closest.a);
  const auto inside = [&](Vec3d edge, Vec3v from) {
    return hn::Gt(Dot(Cross(All(edge), from), m), hn::Zero(four));
  };
  const auto within = hn::And(
      inside(closest.ab, ap),
      hn::And(inside(closest.bc, p - All(closest.b)), inside(closest.ca, p - All(closest.c))));
  const uint32_t settled = closest.sliver ? 0 : Bits(within);
  const Vec3v foot = p - m * (Dot(m, ap) / All(closest.nn));
  const Vec3v at = {Clamp(foot.x, closest.box.lo.x, closest.box.hi.x),
                    Clamp(foot.y, closest.box.lo.y, closest.box.hi.y),
                    Clamp(foot.z, closest.box.lo.z, closest.box.hi.z)};

  alignas(32) double x[4], y[4], z[4], norm_one[4], along[4];
  hn::Store(at.x, four, x);
  hn::Store(at.y, four, y);
  hn::Store(at.z, four, z);
  hn::Store(NormOne(at), four, norm_one);
  hn::Store(NormOne(d) * t, four, along);
  for (int i = 0; i < 4; ++i) {
    if (settled >> i & 1) {
      *placements[i] = {.at = {x[i], y[i], z[i]},
                        .source = triangle,
                        .side = plane.side,
                        .radius = HitTouchRadius(norm_one[i], along[i]),
                        .reference = packet.origin};
    } else {  // Beside the triangle by rounding, or a sliver.
      *placements[i] = PlacementOf(packet.origin, packet.target(lanes[i]), packet.t[lanes[i]]);
    }
  }
}

uint32_t HitSource::PlaceBeside(const std::array<const Placement*, 4>& placements,
                                std::array<Vec3f, 4>* placed) const {
  const Four four;
  const FourFloats floats;
  alignas(32) double in[3][4];
  for (int i = 0; i < 4; ++i) {
    in[0][i] = placements[i]->at.x;
    in[1][i] = placements[i]->at.y;
    in[2][i] = placements[i]->at.z;
  }
  const Vec3v at = {hn::Load(four, in[0]), hn::Load(four, in[1]), hn::Load(four, in[2])};

  // Correct, with PlacementOffset and the plane's slack (placement.cc).
  const Vec3v n = All(plane.normal), from_anchor = at - All(anchor);
  const V distance = Dot(n, from_anchor);
  const V slack = All(kSlackPerConditioning * plane.conditioning) * NormOne(from_anchor);
  const V rounding = (hn::Abs(n.x * at.x) + hn::Abs(n.y * at.y)) + hn::Abs(n.z * at.z);
  const V offset = All(2) * (All(0x1p-24) * rounding + All(2 * 0x1p-150)) + slack;
  const Vec3v x =
      IfThenElse(hn::Ge(distance, offset), at, at + n * (All(kAim) * offset - distance));

  // Rounded; -0 becomes +0.
  const auto zero = hn::Zero(floats);
  const auto fx = hn::DemoteTo(floats, x.x) + zero, fy = hn::DemoteTo(floats, x.y) + zero,
             fz = hn::DemoteTo(floats, x.z) + zero;

  // The double stage of SideOfPlane. Not finite: no comparison holds.
  const Vec3v out =
      Vec3v{hn::PromoteTo(four, fx), hn::PromoteTo(four, fy), hn::PromoteTo(four, fz)} -
      All(anchor);
  const V height = Dot(All(normal), out) * All(plane.side);
  const V bound = All(kDoubleBound) * Dot(All(permanent), Abs(out));
  const auto holds = hn::And(hn::Gt(height, bound), hn::Lt(bound, hn::Inf(four)));

  alignas(16) float px[4], py[4], pz[4];
  hn::Store(fx, floats, px);
  hn::Store(fy, floats, py);
  hn::Store(fz, floats, pz);
  for (int i = 0; i < 4; ++i) (*placed)[i] = {px[i], py[i], pz[i]};
  return Bits(holds);
}

}  // namespace sightline

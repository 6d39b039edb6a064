// SPDX-License-Identifier: Apache-2.0
//
// The grounds of a packet's points (point_ground.h): found by one walk, of the boxes that points
// lie in, and asked about sixteen points at a time.
//
// Thread safety: pure functions.

#if defined(SIGHTLINE_CORE_TRAVERSE_POINT_GROUND_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_POINT_GROUND_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_POINT_GROUND_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_POINT_GROUND_INL_H_
#endif

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <limits>
#include <optional>

#include "core/accel/indexed_geometry.h"
#include "core/geometry/box3.h"
#include "core/intersect/predicate-inl.h"
#include "core/traverse/clear_leaves-inl.h"
#include "core/traverse/leaf_corners-inl.h"
#include "core/traverse/leaf_view.h"
#include "core/traverse/point_ground.h"
#include "core/traverse/shaft_lanes-inl.h"
#include "core/traverse/trace_ray.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// A triangle as a ground, in doubles: with p = P - corner, its height above the plane is |up·p|,
// and its foot inward[k]·p + from[k] within edge k, each up to `units` times what is said beside.
struct GroundTriangle {
  Vec3d corner, up, inward[3];
  double from[3];
  double size;   // Of its longest edge.
  double units;  // Heights: of |p|_1; distances from edges: of |p|_1 + size. Infinite for slivers.

  GroundTriangle(Vec3f a, Vec3f b, Vec3f c) {
    const Vec3d corners[3] = {ToDouble(a), ToDouble(b), ToDouble(c)};
    const Vec3d edge[3] = {corners[1] - corners[0], corners[2] - corners[1],
                           corners[0] - corners[2]};
    const Vec3d normal = Cross(edge[0], edge[1]);
    const double length = Length(normal);
    corner = corners[0];
    up = normal * (1.0 / length);
    size = 0;
    for (int k = 0; k < 3; ++k) {
      const double own = Length(edge[k]);
      inward[k] = Cross(up, edge[k]) * (1.0 / own);
      from[k] = Dot(inward[k], corner - corners[k]);
      size = std::max(size, own);
    }
    const double across = size * size;
    units = length > kLeastGroundSine * across ? kGroundUnits * (across / length)
                                               : std::numeric_limits<double>::infinity();
  }
};

// Looks for the ground of the least slope of each point. Points that lie far apart have the whole
// tree between them: the search ends after so many steps or pairs, with what it has.
class GroundSearch {
 public:
  using V = ShaftV;
  using V3 = Vec3V<V>;

  // `sources`: the points' own triangles, or null.
  // `lends`: points that have no ground get another's normal, and all have it in doubles, too.
  GroundSearch(const IndexedGeometry& scene, const uint32_t* sources, bool lends,
               PointGrounds* grounds, WalkStats* stats)
      : scene_(scene),
        has_sources_(sources != nullptr),
        lends_(lends),
        grounds_(*grounds),
        stats_(*stats) {
    const int count = grounds_.count;
    const auto pad = [count](float* row) {
      std::fill(row + count, row + PointGrounds::kMaxPoints, row[count - 1]);
    };
    pad(grounds_.x);
    pad(grounds_.y);
    pad(grounds_.z);
    const auto clear = [](float* row, float value) {
      std::fill_n(row, PointGrounds::kMaxPoints, value);
    };
    clear(grounds_.normal_x, 0);
    clear(grounds_.normal_y, 0);
    clear(grounds_.normal_z, 0);
    clear(grounds_.height, 0);
    clear(grounds_.slope, PointGrounds::kNone);
    if (lends_) {
      for (double(&row)[PointGrounds::kMaxPoints] : normals_) {
        std::fill(std::begin(row), std::end(row), 0);
      }
    }
    if (has_sources_) {
      std::copy_n(sources, count, source_);
      std::fill(source_ + count, std::end(source_), kNoTriangle);
    }
    grounds_.leaf_count = 0;
    PlaceBlocks();
  }

  // Returns how many points have one.
  uint32_t Run() {
    uint32_t stack[kBvhStackSize];
    uint32_t size = 0;
    if (!scene_.bvh.empty()) stack[size++] = ChildRef::Inner(0).bits();
    while (size > 0 && steps_ < kMostSteps && pairs_ < kMostPairs) {
      const ChildRef ref = ChildRef::FromBits(stack[--size]);
      ++steps_;
      if (ref.is_leaf()) {
        if (VisitLeaf(LeafView(scene_, ref)) && grounds_.leaf_count < PointGrounds::kMostLeaves) {
          grounds_.leaf[grounds_.leaf_count++] = ref.bits();
        }
        continue;
      }
      const BvhNode& node = scene_.bvh.nodes[ref.node()];
      ++stats_.nodes;
      for (uint32_t met = MeetNode(node); met != 0; met &= met - 1) {
        stack[size++] = node.child[std::countr_zero(met)].bits();
      }
    }
    uint32_t found = 0;
    const ShaftD d;
    const auto count = static_cast<size_t>(grounds_.count);
    for (size_t i = 0; i < count; i += hn::Lanes(d)) {
      const ShaftM has = hn::Lt(hn::Load(d, grounds_.slope + i), hn::Set(d, PointGrounds::kNone));
      found += static_cast<uint32_t>(hn::CountTrue(d, hn::And(has, hn::FirstN(d, count - i))));
    }
    if (lends_ && found > 0 && found < count) LendNormals();
    return found;
  }

  // REQUIRES: it lends, and Run() has found one.
  const PointNormals& normals() const { return normals_; }

 private:
  // To points that have none: the last one's before them, or the first one's behind.
  void LendNormals() {
    const auto has = [this](int i) { return grounds_.slope[i] < PointGrounds::kNone; };
    int from = 0;
    while (!has(from)) ++from;
    for (int i = 0; i < PointGrounds::kMaxPoints; ++i) {
      if (has(i)) {
        from = i;
        continue;
      }
      grounds_.normal_x[i] = grounds_.normal_x[from];
      grounds_.normal_y[i] = grounds_.normal_y[from];
      grounds_.normal_z[i] = grounds_.normal_z[from];
      for (double(&row)[PointGrounds::kMaxPoints] : normals_) row[i] = row[from];
    }
  }

  // Boxes around each block's points, as much wider as a ground that large may be beneath them.
  void PlaceBlocks() {
    const ShaftD d;
    const float* const rows[3] = {grounds_.x, grounds_.y, grounds_.z};
    for (int k = 0; k < 3; ++k) BlockRanges<uint16_t>(rows[k], nullptr, lo_[k], hi_[k]);
    V least[3], most[3];
    for (int k = 0; k < 3; ++k) {
      least[k] = hn::Set(d, std::numeric_limits<float>::infinity());
      most[k] = hn::Neg(least[k]);
    }
    for (size_t b = 0; b < kShaftBlocks; b += hn::Lanes(d)) {
      V extent = hn::Zero(d), farthest = hn::Zero(d);
      for (int k = 0; k < 3; ++k) {
        const V lo = hn::Load(d, lo_[k] + b), hi = hn::Load(d, hi_[k] + b);
        extent = hn::Max(extent, hn::Sub(hi, lo));
        farthest = hn::Max(farthest, hn::Max(hn::Abs(lo), hn::Abs(hi)));
      }
      const V reach =
          hn::MulAdd(extent, hn::Set(d, kReach), hn::Mul(farthest, hn::Set(d, kGroundSlack)));
      for (int k = 0; k < 3; ++k) {
        const V lo = hn::Sub(hn::Load(d, lo_[k] + b), reach);
        const V hi = hn::Add(hn::Load(d, hi_[k] + b), reach);
        hn::Store(lo, d, lo_[k] + b);
        hn::Store(hi, d, hi_[k] + b);
        least[k] = hn::Min(least[k], lo);
        most[k] = hn::Max(most[k], hi);
      }
    }
    for (int k = 0; k < 3; ++k) {
      box_.lo[k] = hn::GetLane(hn::MinOfLanes(d, least[k]));
      box_.hi[k] = hn::GetLane(hn::MaxOfLanes(d, most[k]));
    }
  }

  HWY_INLINE uint32_t MeetNode(const BvhNode& node) const {
    const hn::CappedTag<float, kBvhWidth> d;
    auto met = hn::FirstN(d, node.child_count);
    for (int k = 0; k < 3; ++k) {
      met = hn::And(met, hn::And(hn::Le(hn::Load(d, node.bounds[k]), hn::Set(d, box_.hi[k])),
                                 hn::Ge(hn::Load(d, node.bounds[k + 3]), hn::Set(d, box_.lo[k]))));
    }
    return MaskBits(d, met);
  }

  // Returns whether some of its triangles are beside the points.
  bool VisitLeaf(const LeafView& leaf) {
    ++stats_.leaves;
    bool beside = false;
    const ShaftD d;
    for (uint32_t first = 0; first < leaf.count; first += static_cast<uint32_t>(hn::Lanes(d))) {
      const V3 a = LeafCorner(leaf, 0, first), b = LeafCorner(leaf, 1, first),
               c = LeafCorner(leaf, 2, first);
      const V lo[3] = {hn::Min(hn::Min(a.x, b.x), c.x), hn::Min(hn::Min(a.y, b.y), c.y),
                       hn::Min(hn::Min(a.z, b.z), c.z)};
      const V hi[3] = {hn::Max(hn::Max(a.x, b.x), c.x), hn::Max(hn::Max(a.y, b.y), c.y),
                       hn::Max(hn::Max(a.z, b.z), c.z)};
      ShaftM met = hn::FirstN(d, leaf.count - first);
      for (int k = 0; k < 3; ++k) {
        met = hn::And(met, hn::And(hn::Le(lo[k], hn::Set(d, box_.hi[k])),
                                   hn::Ge(hi[k], hn::Set(d, box_.lo[k]))));
      }
      uint32_t left = MaskBits(d, met);
      if (left == 0) continue;
      beside = true;
      for (int k = 0; k < 3; ++k) {
        hn::Store(lo[k], d, triangles_.lo[k]);
        hn::Store(hi[k], d, triangles_.hi[k]);
      }
      Prepare(a, b, c);
      for (; left != 0; left &= left - 1) {
        const uint32_t i = static_cast<uint32_t>(std::countr_zero(left));
        VisitTriangle(leaf, i, first + i);
      }
    }
    return beside;
  }

  // Barycentric coordinates, heights above the plane, and what a coordinate of one is in length.
  HWY_INLINE void Prepare(const V3& a, const V3& b, const V3& c) {
    const ShaftD d;
    const V3 ab = SubV(b, a), ac = SubV(c, a), bc = SubV(c, b);
    const V3 normal = CrossV(ab, ac);
    const V square = DotV(normal, normal);
    const V inverse = hn::Div(hn::Set(d, 1.0f), square);
    const V length = hn::Sqrt(square), inverse_length = hn::Mul(inverse, length);
    const auto put = [d](const V3& v, V scale, float(*rows)[kMaxLeafTriangles]) HWY_ATTR {
      hn::Store(hn::Mul(v.x, scale), d, rows[0]);
      hn::Store(hn::Mul(v.y, scale), d, rows[1]);
      hn::Store(hn::Mul(v.z, scale), d, rows[2]);
    };
    put(a, hn::Set(d, 1.0f), triangles_.corner);
    put(CrossV(ac, normal), inverse, triangles_.second);
    put(CrossV(normal, ab), inverse, triangles_.third);
    put(normal, inverse_length, triangles_.up);
    const auto across = [length](const V3& edge)
                            HWY_ATTR { return hn::Div(length, hn::Sqrt(DotV(edge, edge))); };
    hn::Store(across(bc), d, triangles_.across[0]);
    hn::Store(across(ac), d, triangles_.across[1]);
    hn::Store(across(ab), d, triangles_.across[2]);
  }

  HWY_INLINE void VisitTriangle(const LeafView& leaf, size_t i, uint32_t number) {
    const ShaftD d;
    uint32_t blocks = 0;
    for (size_t b = 0; b < kShaftBlocks; b += hn::Lanes(d)) {
      ShaftM met = hn::FirstN(d, kShaftBlocks);
      for (int k = 0; k < 3; ++k) {
        met =
            hn::And(met, hn::And(hn::Ge(hn::Load(d, hi_[k] + b), hn::Set(d, triangles_.lo[k][i])),
                                 hn::Le(hn::Load(d, lo_[k] + b), hn::Set(d, triangles_.hi[k][i]))));
      }
      blocks |= MaskBits(d, met) << b;
    }
    const auto pairs = static_cast<uint32_t>(std::popcount(blocks));
    pairs_ += pairs;
    stats_.triangle_tests += uint64_t{pairs} * kShaftBlockRays;
    std::optional<GroundTriangle> triangle;
    for (; blocks != 0; blocks &= blocks - 1) {
      const size_t first = static_cast<size_t>(std::countr_zero(blocks)) * kShaftBlockRays;
      for (size_t at = first; at < first + kShaftBlockRays; at += hn::Lanes(d)) {
        const uint32_t lanes = LanesAbove(i, leaf.id(number), at);
        if (lanes == 0) continue;
        if (!triangle.has_value()) {
          triangle.emplace(leaf.corner(0, number), leaf.corner(1, number), leaf.corner(2, number));
        }
        Settle(*triangle, at, lanes);
      }
    }
  }

  // Those of a vector of points for which the triangle is a better ground than what they have, as
  // far as floats tell.
  HWY_INLINE uint32_t LanesAbove(size_t i, uint32_t id, size_t at) const {
    const ShaftD d;
    const auto of = [d, i](const float(*rows)[kMaxLeafTriangles])
                        HWY_ATTR { return Broadcast(d, rows[0][i], rows[1][i], rows[2][i]); };
    const V3 own = SubV(
        {hn::Load(d, grounds_.x + at), hn::Load(d, grounds_.y + at), hn::Load(d, grounds_.z + at)},
        of(triangles_.corner));
    const V v = DotV(own, of(triangles_.second)), w = DotV(own, of(triangles_.third));
    const V u = hn::Sub(hn::Sub(hn::Set(d, 1.0f), v), w);
    const V inside = hn::Min(hn::Min(hn::Mul(u, hn::Set(d, triangles_.across[0][i])),
                                     hn::Mul(v, hn::Set(d, triangles_.across[1][i]))),
                             hn::Mul(w, hn::Set(d, triangles_.across[2][i])));
    const V most = hn::Min(hn::Load(d, grounds_.slope + at), hn::Set(d, kMostGroundSlope));
    ShaftM better = hn::Lt(hn::Abs(DotV(own, of(triangles_.up))), hn::Mul(most, inside));
    if (has_sources_) {
      const hn::RebindToUnsigned<ShaftD> du;
      const auto others = hn::Ne(hn::Load(du, source_ + at), hn::Set(du, id));
      better = hn::And(better, hn::RebindMask(d, others));
    }
    return MaskBits(d, better);
  }

  // Makes the triangle the ground of those `lanes` from `at` on whose ground it betters for sure.
  HWY_INLINE void Settle(const GroundTriangle& triangle, size_t at, uint32_t lanes) {
    const hn::Half<ShaftD> df;
    const hn::Rebind<double, decltype(df)> d;
    const size_t width = hn::Lanes(d);
    for (; lanes != 0; at += width, lanes >>= width) {
      const uint32_t own = lanes & ((1u << width) - 1);
      if (own == 0) continue;
      const auto relative = [&](const float* row, double corner) HWY_ATTR {
        return hn::Sub(hn::PromoteTo(d, hn::Load(df, row + at)), hn::Set(d, corner));
      };
      const auto x = relative(grounds_.x, triangle.corner.x);
      const auto y = relative(grounds_.y, triangle.corner.y);
      const auto z = relative(grounds_.z, triangle.corner.z);
      const auto along = [&](Vec3d axis, double from) HWY_ATTR {
        return hn::MulAdd(
            x, hn::Set(d, axis.x),
            hn::MulAdd(y, hn::Set(d, axis.y), hn::MulAdd(z, hn::Set(d, axis.z), hn::Set(d, from))));
      };
      const auto size = hn::Add(hn::Add(hn::Abs(x), hn::Abs(y)), hn::Abs(z));
      const auto units = hn::Set(d, triangle.units);
      const auto height = along(triangle.up, 0), lost = hn::Mul(units, size);
      const auto inside = hn::Sub(hn::Min(hn::Min(along(triangle.inward[0], triangle.from[0]),
                                                  along(triangle.inward[1], triangle.from[1])),
                                          along(triangle.inward[2], triangle.from[2])),
                                  hn::Mul(units, hn::Add(size, hn::Set(d, triangle.size))));
      const auto highest = hn::Add(hn::Abs(height), lost);
      const auto slope = hn::Div(highest, inside);
      const uint8_t bits[8] = {static_cast<uint8_t>(own)};
      const auto certain = hn::And(
          hn::And(hn::Gt(hn::Abs(height), lost), hn::Gt(inside, hn::Zero(d))),
          hn::And(hn::Le(slope, hn::Set(d, double{kMostGroundSlope})), hn::LoadMaskBits(d, bits)));
      const auto known = hn::IfThenElse(certain, slope, hn::Set(d, double{PointGrounds::kNone}));
      const auto new_slope = hn::Add(hn::DemoteTo(df, known), hn::Set(df, kGroundSlack));
      const auto old_slope = hn::Load(df, grounds_.slope + at);
      const auto better = hn::Lt(new_slope, old_slope);
      const auto put = [&](decltype(new_slope) value, float* row) HWY_ATTR {
        hn::Store(hn::IfThenElse(better, value, hn::Load(df, row + at)), df, row + at);
      };
      put(new_slope, grounds_.slope);
      put(hn::MulAdd(hn::DemoteTo(df, highest), hn::Set(df, 1 + 0x1p-22f),
                     hn::Set(df, kFloatUnderflow)),
          grounds_.height);
      const auto side = hn::And(hn::DemoteTo(df, height), hn::SignBit(df));
      const auto turned = [&](double axis) HWY_ATTR {
        return hn::Xor(hn::Set(df, static_cast<float>(axis)), side);
      };
      put(turned(triangle.up.x), grounds_.normal_x);
      put(turned(triangle.up.y), grounds_.normal_y);
      put(turned(triangle.up.z), grounds_.normal_z);
      if (!lends_) continue;
      const auto chosen =
          hn::Gt(hn::PromoteTo(d, hn::IfThenElseZero(better, hn::Set(df, 1.0f))), hn::Zero(d));
      const auto side_in_doubles = hn::And(height, hn::SignBit(d));
      for (int k = 0; k < 3; ++k) {
        const auto own_up = hn::Xor(hn::Set(d, triangle.up[k]), side_in_doubles);
        hn::Store(hn::IfThenElse(chosen, own_up, hn::Load(d, normals_[k] + at)), d,
                  normals_[k] + at);
      }
    }
  }

  // Of a block's extent.
  static constexpr float kReach = 1.0f / 64;
  // Nodes and leaves; pairs of a triangle and a block: far more than where points are neighbours on
  // a surface, and then no more than some walks of a light's.
  static constexpr uint32_t kMostSteps = 1024, kMostPairs = 8192;

  // A vector of a leaf's triangles: the boxes around them, and for a point P with p = P - corner
  // its barycentric coordinates second·p and third·p, its height |up·p|, and how far from its edge
  // the corner of each coordinate is.
  struct Triangles {
    alignas(64) float lo[3][kMaxLeafTriangles], hi[3][kMaxLeafTriangles];
    alignas(64) float corner[3][kMaxLeafTriangles], second[3][kMaxLeafTriangles];
    alignas(64) float third[3][kMaxLeafTriangles], up[3][kMaxLeafTriangles];
    alignas(64) float across[3][kMaxLeafTriangles];
  };

  const IndexedGeometry& scene_;
  const bool has_sources_, lends_;
  PointGrounds& grounds_;
  WalkStats& stats_;
  uint32_t steps_ = 0, pairs_ = 0;
  Box3f box_;
  alignas(64) float lo_[3][kShaftBlocks], hi_[3][kShaftBlocks];  // By block.
  Triangles triangles_;
  alignas(64) PointNormals normals_;                       // Of points that have one.
  alignas(64) uint32_t source_[PointGrounds::kMaxPoints];  // If has_sources_.
};

// As FindGroundsFn says.
inline uint32_t FindGrounds(const IndexedGeometry& scene, const uint32_t* sources,
                            PointGrounds* grounds, ClearLeaves* clear, WalkStats* stats) {
  if (clear != nullptr) clear->count = 0;
  if (grounds->count == 0) return 0;
  GroundSearch search(scene, sources, /*lends=*/clear != nullptr, grounds, stats);
  const uint32_t found = search.Run();
  if (found > 0 && clear != nullptr) {
    ClearLeafSearch(scene, *grounds, search.normals(), clear, stats).Run();
  }
  return found;
}

// As GroundBitsFn says.
template <bool kParallel>
size_t GroundBits(const PointGrounds& grounds, Vec3f common, uint16_t* bits, float* rises) {
  using V = ShaftV;
  const ShaftD d;
  const Vec3V<V> toward = Broadcast(d, common.x, common.y, common.z);
  const V underflow = hn::Set(d, kFloatUnderflow);
  const V infinity = hn::Set(d, std::numeric_limits<float>::infinity());
  HWY_ALIGN float rise[PointGrounds::kMaxPoints];
  size_t dark = 0;
  for (size_t at = 0; at < PointGrounds::kMaxPoints; at += kShaftBlockRays) {
    uint32_t of_block = 0;
    for (size_t i = at; i < at + kShaftBlockRays; i += hn::Lanes(d)) {
      Vec3V<V> along = toward;
      V down = hn::Zero(d);
      if constexpr (!kParallel) {
        along = SubV(toward, {hn::Load(d, grounds.x + i), hn::Load(d, grounds.y + i),
                              hn::Load(d, grounds.z + i)});
        down = hn::Load(d, grounds.height + i);
      }
      const V up =
          DotV(along, Vec3V<V>{hn::Load(d, grounds.normal_x + i), hn::Load(d, grounds.normal_y + i),
                               hn::Load(d, grounds.normal_z + i)});
      const V least = hn::MulAdd(hn::Load(d, grounds.slope + i), Norm1V(along), underflow);
      const ShaftM below = hn::Lt(hn::Add(up, down), hn::Neg(least));
      of_block |= MaskBits(d, below) << (i - at);
      if (rises != nullptr) hn::Store(hn::IfThenElse(below, infinity, up), d, rise + i);
    }
    const int points = std::clamp(grounds.count - static_cast<int>(at), 0, kShaftBlockRays);
    of_block &= (1u << points) - 1;
    bits[at / kShaftBlockRays] = static_cast<uint16_t>(of_block);
    dark += static_cast<size_t>(std::popcount(of_block));
  }
  if (rises == nullptr) return dark;
  ReduceBlocks([](V a, V b) HWY_ATTR { return hn::Min(a, b); },
               [&rise](size_t at) HWY_ATTR { return hn::Load(ShaftD(), rise + at); }, rises);
  return dark;
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard

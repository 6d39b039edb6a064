// SPDX-License-Identifier: Apache-2.0
//
// What the packet walks do in a leaf that may be large: vertex culling (packet_frustum-inl.h), then
// the tests that are left, by the predicate or by one of the papers' (leaf_culling.h). One routine
// for the binary BVH and the kd-tree, whose leaves are ranges of ids with a box.
//
// Thread safety: pure functions.

#if defined(SIGHTLINE_CORE_TRAVERSE_PACKET_LEAF_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_PACKET_LEAF_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_PACKET_LEAF_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_PACKET_LEAF_INL_H_
#endif

#include <algorithm>
#include <bit>
#include <limits>

#include "core/accel/indexed_geometry.h"
#include "core/intersect/intersector-inl.h"
#include "core/traverse/leaf_culling.h"
#include "core/traverse/leaf_range.h"
#include "core/traverse/packet_frustum-inl.h"
#include "core/traverse/packet_lanes-inl.h"
#include "core/traverse/single-inl.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// The triangle `id` for a test: the scene's where it has it, else prepared into `room`.
HWY_INLINE const float* PreparedValue(const IndexedGeometry& scene, Intersector kind, uint32_t id,
                                      PreparedTriangle* room) {
  if (scene.prepared && scene.prepared->kind == kind) return scene.prepared->triangles[id].value;
  const auto [a, b, c] = scene.geometry.Corners(id);
  *room = PrepareTriangle(kind, a, b, c);
  return room->value;
}

template <bool kAny>
class PacketLeaf {
 public:
  using D = hn::CappedTag<float, 16>;
  using V = hn::Vec<D>;
  static constexpr uint32_t kMaxGroups = RayPacket::kMaxRays / 8;

  PacketLeaf(const IndexedGeometry& scene, const LeafCulling& culling, PacketLanes<kAny>& lanes,
             WalkStats* stats, PacketPoll* poll)
      : scene_(scene),
        culling_(culling),
        lanes_(lanes),
        stats_(stats),
        poll_(poll),
        slopes_(lanes, culling.first_axis) {}

  const PacketSlopes& slopes() const { return slopes_; }

  // `met`: by group, the lanes that meet the leaf's box; clobbered. Groups before `begin` have
  // none. Leaves off when the poll fires.
  void Visit(const LeafRange& range, uint32_t* met, uint32_t begin) {
    uint32_t rays = 0;
    Frustum frustum = slopes_.whole();
    const bool planes = slopes_.valid() && (culling_.side_planes || culling_.near_far);
    const bool edges = slopes_.valid() && culling_.aperture;
    if ((planes || edges) && culling_.frustum == FrustumRays::kMasked) {
      frustum = slopes_.Hold(met, begin, lanes_.groups());
    }
    uint32_t within[kMaxGroups];  // The others hit nothing here, whether they are asked or not.
    for (uint32_t g = begin; g < lanes_.groups(); ++g) {
      within[g] = met[g];
      if (!culling_.ray_mask && met[g] != 0) met[g] = lanes_.active(g);
      rays += static_cast<uint32_t>(std::popcount(met[g]));
    }
    if (rays == 0) return;
    if ((planes || edges) && culling_.frustum == FrustumRays::kRows) {
      uint32_t rows[kMaxGroups];
      for (uint32_t g = begin; g < lanes_.groups(); ++g) rows[g] = met[g] != 0 ? ~0u : 0;
      frustum = slopes_.Hold(rows, begin, lanes_.groups());
    }
    // The lanes that the frustum holds. Those that are asked though they miss the leaf's box need
    // not lie in one of those that meet it, so that nothing can be told of their edges; where these
    // are not asked for, neither are they.
    const uint32_t* const held = culling_.frustum == FrustumRays::kMasked ? within : met;
    const bool near_far_first = culling_.near_far && !(edges && culling_.aperture_first);
    float limit = FarthestLimit(within, begin);
    for (uint32_t at = 0; at < range.count; at += kMaxLeafTriangles) {
      if (at > 0 && poll_->Stops()) return;
      const RangeView view(scene_.geometry, range, at);
      const LeafView& leaf = view.leaf;
      if (at > 0) limit = FarthestLimit(within, begin);
      if (limit == -std::numeric_limits<float>::infinity()) return;  // All have what they look for.
      uint32_t chosen = (1u << leaf.count) - 1;
      if (planes && (culling_.side_planes || near_far_first)) {
        chosen = slopes_.KeepByPlanes(leaf, lanes_.origin(), frustum, culling_.side_planes,
                                      near_far_first, limit);
      }
      if (culling_.intersector != Intersector::kExact && !edges) {
        Count(leaf.count - std::popcount(chosen), rays);
        for (; chosen != 0; chosen &= chosen - 1) {
          TestByIntersector<true>(leaf, std::countr_zero(chosen), held, met, begin);
        }
        continue;
      }
      FacingTriangle facing[kMaxLeafTriangles];
      const uint32_t count = TurnTriangles(lanes_, leaf, chosen, facing);
      uint32_t kept = 0;
      bool nearer = false;  // The far plane, than when the planes were asked.
      for (uint32_t i = 0; i < count; ++i) {
        if (nearer && near_far_first && !NearEnough(leaf, facing[i], limit)) continue;
        Corners corners = Corners::kUnknown;
        if (edges) {
          ++stats_->aperture_tests;
          corners = slopes_.AgainstEdges(facing[i], frustum);
          if (corners == Corners::kOutside) continue;
          if (culling_.near_far && culling_.aperture_first && !NearEnough(leaf, facing[i], limit)) {
            continue;
          }
        }
        ++kept;
        const bool inside = corners == Corners::kInside && culling_.skip_edges;
        if (culling_.intersector != Intersector::kExact) {
          inside ? TestByIntersector<false>(leaf, facing[i].lane, held, met, begin)
                 : TestByIntersector<true>(leaf, facing[i].lane, held, met, begin);
        } else {
          inside ? Test<false>(leaf, facing[i], held, met, begin)
                 : Test<true>(leaf, facing[i], held, met, begin);
        }
        // All rays meet it: what lies behind it is behind all of them (paper 000, section 2; paper
        // 004, section 4).
        if (corners == Corners::kInside && culling_.near_far) {
          limit = FarthestLimit(within, begin);
          nearer = true;
        }
      }
      Count(leaf.count - kept, rays);
    }
  }

 private:
  void Count(uint32_t triangles, uint32_t rays) {
    stats_->culled_tests += uint64_t{triangles} * rays;
  }

  // None of these lanes looks further; -inf where none is still asked. The limits of rays that miss
  // the leaf's box say nothing of it: one that sees the sky never has any.
  float FarthestLimit(const uint32_t* lanes, uint32_t begin) const {
    const D d;
    const V none = hn::Set(d, -std::numeric_limits<float>::infinity());
    V most = none;
    for (uint32_t g = begin; g < lanes_.groups(); ++g) {
      if (lanes[g] == 0) continue;
      const auto some = hn::LoadMaskBits(d, reinterpret_cast<const uint8_t*>(&lanes[g]));
      most = hn::Max(
          most, hn::IfThenElse(some, hn::Load(d, lanes_.limit_row() + g * hn::Lanes(d)), none));
    }
    return hn::GetLane(hn::MaxOfLanes(d, most));
  }

  // KeepByPlanes' near and far planes, for one triangle.
  bool NearEnough(const LeafView& leaf, const FacingTriangle& f, float limit) const {
    float nearest = std::numeric_limits<float>::infinity(), farthest = -nearest;
    for (int c = 0; c < 3; ++c) {
      const int axis = slopes_.axis();
      const float x = (leaf.corner(c, f.lane)[axis] - lanes_.origin()[axis]) * slopes_.sign();
      nearest = std::min(nearest, x);
      farthest = std::max(farthest, x);
    }
    return farthest > 0 && !(nearest * slopes_.least_inv() > limit);
  }

  // One triangle against the lanes `met`, without kEdges against those of them that are `held`;
  // takes off those that need no further one.
  template <bool kEdges>
  HWY_INLINE void Test(const LeafView& leaf, const FacingTriangle& f, const uint32_t* held,
                       uint32_t* met, uint32_t begin) {
    for (uint32_t g = begin; g < lanes_.groups(); ++g) {
      const uint32_t asked = kEdges ? met[g] : Held(held[g], met[g]);
      if (asked == 0) continue;
      if (!kEdges) stats_->edges_spared += std::popcount(asked);
      met[g] &= ~lanes_.template Test<kEdges>(leaf, f, g, asked);
    }
  }

  // Counts the others.
  HWY_INLINE uint32_t Held(uint32_t held, uint32_t met) {
    Count(1, static_cast<uint32_t>(std::popcount(met & ~held)));
    return met & held;
  }

  template <bool kEdges>
  void TestByIntersector(const LeafView& leaf, uint32_t lane, const uint32_t* held, uint32_t* met,
                         uint32_t begin) {
    const uint32_t id = leaf.id(lane);
    if (id == lanes_.origin_source() || lanes_.unseen().Holds(id)) return;
    if (MustAskObjects(scene_.geometry, lanes_.mask()) &&
        !ObjectBlocks(scene_.geometry, id, lanes_.mask(),
                      SideOfPlane(leaf.corner(0, lane), leaf.corner(1, lane), leaf.corner(2, lane),
                                  lanes_.origin()))) {
      return;
    }
    PreparedTriangle room;
    const float* const value = PreparedValue(scene_, culling_.intersector, id, &room);
    for (uint32_t g = begin; g < lanes_.groups(); ++g) {
      uint32_t asked = kEdges ? met[g] : Held(held[g], met[g]);
      if (asked == 0) continue;
      stats_->triangle_tests += std::popcount(asked);
      if (!kEdges) stats_->edges_spared += std::popcount(asked);
      asked &= ~lanes_.SourceLanes(g, id);
      met[g] &= ~TestGroup<kEdges>(value, g, asked, id);
    }
  }

  // Returns the lanes that need no further triangle.
  template <bool kEdges>
  uint32_t TestGroup(const float* value, uint32_t group, uint32_t asked, uint32_t id) {
    switch (culling_.intersector) {
      case Intersector::kHavelHerout:
      case Intersector::kHavelHeroutDotProduct:
        return TestGroupBy<Intersector::kHavelHerout, kEdges>(value, group, asked, id);
      case Intersector::kHavelHeroutDivided:
        return TestGroupBy<Intersector::kHavelHeroutDivided, kEdges>(value, group, asked, id);
      case Intersector::kWald:
        return TestGroupBy<Intersector::kWald, kEdges>(value, group, asked, id);
      case Intersector::kShevtsov:
        return TestGroupBy<Intersector::kShevtsov, kEdges>(value, group, asked, id);
      case Intersector::kKenslerShirley:
        return TestGroupBy<Intersector::kKenslerShirley, kEdges>(value, group, asked, id);
      case Intersector::kExact:
      case Intersector::kMoellerTrumbore:
        break;
    }
    return TestGroupBy<Intersector::kMoellerTrumbore, kEdges>(value, group, asked, id);
  }

  template <Intersector kKind, bool kEdges>
  HWY_INLINE uint32_t TestGroupBy(const float* value, uint32_t group, uint32_t asked, uint32_t id) {
    using O = LaneOps<D>;
    const D d;
    const size_t first = group * hn::Lanes(d);
    int p = 0, q = 1, r = 2;
    if constexpr (kProjects<kKind>) {
      r = static_cast<int>(value[kPreparedAxis]);
      p = r == 2 ? 0 : r + 1;
      q = p == 2 ? 0 : p + 1;
    }
    const Vec3f o = lanes_.origin();
    const float end = lanes_.segments() ? 1.0f : std::numeric_limits<float>::infinity();
    const TestedRay<O> ray = {
        Broadcast(d, o[p], o[q], o[r]),
        {hn::Load(d, lanes_.direction_row(p) + first), hn::Load(d, lanes_.direction_row(q) + first),
         hn::Load(d, lanes_.direction_row(r) + first)},
        hn::Min(hn::Load(d, lanes_.limit_row() + first), hn::Set(d, end))};
    const Tested<O> tested =
        ::sightline::HWY_NAMESPACE::Test<kKind, O, kEdges>(BroadcastRows<O>{value}, ray);
    uint32_t hits = MaskBits(d, tested.hit) & asked;
    if (hits == 0) return 0;
    if constexpr (kAny) {
      lanes_.Block(id, group, hits);
      return hits;
    } else {
      HWY_ALIGN float t[16];
      hn::Store(tested.t, d, t);
      for (; hits != 0; hits &= hits - 1) {
        const uint32_t bit = std::countr_zero(hits);
        lanes_.Offer(first + bit, {t[bit], id});
      }
      return 0;
    }
  }

  const IndexedGeometry& scene_;
  const LeafCulling& culling_;
  PacketLanes<kAny>& lanes_;
  WalkStats* const stats_;
  PacketPoll* const poll_;
  PacketSlopes slopes_;
};

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard

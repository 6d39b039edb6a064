// SPDX-License-Identifier: Apache-2.0
//
// Rays with one origin, or with one direction, walk together for any hit. A node's eight boxes are
// put to what the whole packet reaches over, by intervals; those that survive to what each group of
// rays does, a vector of them each, for all groups that came into the parent at once; and then to
// the rays of those, until one enters (paper 004, section 3). In a leaf, rays that miss the leaf's
// own box are left out; triangles are put to the rectangle in which a group's rays are seen,
// sixteen at a time, and their forms serve all that come to a test. Either a triangle is tested
// against a group's rays or, where fewer of these have met the box than triangles are seen there, a
// ray against all of the leaf's triangles. A few rays in all are tested as single rays are.
//
// For neighbours that share what they walk through but not what they end on, where a shaft culls
// little: a million points of a city, and a light of it or a patch of its sky.
//
// Thread safety: a walk is one thread's own.

#if defined(SIGHTLINE_CORE_TRAVERSE_OCCLUDED_PACKET_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_OCCLUDED_PACKET_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_OCCLUDED_PACKET_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_OCCLUDED_PACKET_INL_H_
#endif

#include <bit>

#include "core/base/cancel.h"
#include "core/base/check.h"
#include "core/shaft/axis_caps-inl.h"
#include "core/shaft/margins.h"
#include "core/traverse/clear_leaves-inl.h"
#include "core/traverse/lane_rectangles-inl.h"
#include "core/traverse/lane_shadows-inl.h"
#include "core/traverse/leaf_corners-inl.h"
#include "core/traverse/origin_lanes-inl.h"
#include "core/traverse/parallel_lanes-inl.h"
#include "core/traverse/point_box-inl.h"
#include "core/traverse/shaft_cut.h"
#include "core/traverse/shaft_leaf-inl.h"
#include "core/traverse/shaft_test-inl.h"
#include "core/traverse/single-inl.h"
#include "core/traverse/trace_ray.h"
#include "core/traverse/visit_fetcher-inl.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// What ShaftTest and rectangles need of a leaf's triangles, sixteen at a time; the other rows are
// left as they are. Bounds are those of core/shaft/margins.h, for rays relative to the lanes' apex.
// Returns the triangles that may block anything (bit i for triangle i).
template <class Lanes>
HWY_INLINE uint32_t PrepareOccluders(const SceneGeometry& geometry, const LeafView& leaf,
                                     const Lanes& lanes, LeafForms* forms) {
  using V = ShaftV;
  using V3 = Vec3V<V>;
  constexpr bool kParallel = Lanes::kParallel;
  const ShaftD d;
  const V3 apex = Broadcast(d, lanes.apex().x, lanes.apex().y, lanes.apex().z);
  const V3 common = Broadcast(d, lanes.common().x, lanes.common().y, lanes.common().z);
  const V common_inf = hn::Set(d, MaxAbs(lanes.common()));
  const V spread = hn::Set(d, lanes.spread()), underflow = hn::Set(d, kFloatUnderflow);
  const uint32_t mask = lanes.packet().mask;
  uint32_t all = 0;
  for (uint32_t first = 0; first < leaf.count; first += static_cast<uint32_t>(hn::Lanes(d))) {
    const V3 corner[3] = {LeafCorner(leaf, 0, first), LeafCorner(leaf, 1, first),
                          LeafCorner(leaf, 2, first)};
    const V3 along[3] = {SubV(corner[1], corner[0]), SubV(corner[2], corner[1]),
                         SubV(corner[0], corner[2])};
    const V along1[3] = {Norm1V(along[0]), Norm1V(along[1]), Norm1V(along[2])};
    const V3 from_apex[3] = {SubV(corner[0], apex), SubV(corner[1], apex), SubV(corner[2], apex)};
    const V3 normal = CrossV(along[0], along[1]);
    const V3 normal_bound = CrossBound(d, along[0], along[1]);
    // Which way the triangle is to be turned: by where the direction leads, or the origin's side.
    V turn = DotV(normal, kParallel ? common : from_apex[0]);
    const V turn_bound = BoundAlong(d, normal_bound, kParallel ? common : from_apex[0]);
    const V approach = hn::Abs(turn);  // Before a turn that is settled takes its place.
    uint32_t chosen = leaf.count - first >= hn::Lanes(d) ? (1u << hn::Lanes(d)) - 1
                                                         : (1u << (leaf.count - first)) - 1;
    if (lanes.common_source() != kNoTriangle) {
      for (uint32_t i = 0; first + i < leaf.count && i < hn::Lanes(d); ++i) {
        if (leaf.id(first + i) == lanes.common_source()) chosen &= ~(1u << i);
      }
    }
    const uint32_t unsure = chosen & MaskBits(d, hn::Le(hn::Abs(turn), turn_bound));
    if (unsure != 0 || MustAskObjects(geometry, mask)) {
      HWY_ALIGN float turns[kMaxLeafTriangles];
      hn::Store(turn, d, turns);
      chosen = SettleTurns<kParallel>(geometry, leaf, first, chosen, unsure, mask, lanes.common(),
                                      turns);
      turn = hn::Load(d, turns);
    }
    if (chosen == 0) continue;
    all |= chosen << first;
    const V flip = hn::And(turn, hn::SignBit(d));
    const auto put = [first, d, flip](const V3& v, float(*rows)[kMaxLeafTriangles]) HWY_ATTR {
      hn::Store(hn::Xor(v.x, flip), d, rows[0] + first);
      hn::Store(hn::Xor(v.y, flip), d, rows[1] + first);
      hn::Store(hn::Xor(v.z, flip), d, rows[2] + first);
    };
    const V from_apex1[3] = {Norm1V(from_apex[0]), Norm1V(from_apex[1]), Norm1V(from_apex[2])};
    const V reach = hn::Max(hn::Max(from_apex1[0], from_apex1[1]), from_apex1[2]);
    for (int e = 0; e < 3; ++e) {
      if constexpr (kParallel) {
        const V3 edge = CrossV(along[e], common);
        put(edge, forms->edge[e]);
        hn::Store(hn::Xor(DotV(edge, from_apex[e]), flip), d, forms->edge_offset[e] + first);
      } else {
        put(CrossV(from_apex[e], along[e]), forms->edge[e]);
      }
    }
    // One bound for the three, of the farthest corner and the longest edge.
    [[maybe_unused]] const V3 farthest = MostV(from_apex[0], from_apex[1], from_apex[2]);
    V edge_bound;
    if constexpr (kParallel) {
      const V edge_k = hn::Mul(hn::Max(hn::Max(along1[0], along1[1]), along1[2]), common_inf);
      const V extent = hn::Add(reach, spread);
      edge_bound = ParallelEdgeBound(hn::Mul(edge_k, extent), extent);
    } else {
      edge_bound = EdgeBound(farthest, MostV(along[0], along[1], along[2]), lanes.most_own());
    }
    PutBounds(edge_bound, first, forms->edge_most, forms->edge_least);
    if (lanes.frame() != nullptr) {
      const V margin = hn::MulAdd(hn::Add(reach, spread), hn::Set(d, kBoxMargin), underflow);
      PutRectangles<kParallel>({*lanes.frame(), {&from_apex[0], &from_apex[1], &from_apex[2]}},
                               {&from_apex1[0], &from_apex1[1], &from_apex1[2]}, margin, first,
                               forms);
    }
    put(kParallel ? V3{hn::Neg(normal.x), hn::Neg(normal.y), hn::Neg(normal.z)} : normal,
        forms->normal);
    const V off = kParallel ? turn_bound : BoundAlong(d, normal_bound, farthest);
    PutBounds(PlaneBound(normal_bound, along[0], along[2], approach, off), first, forms->plane_most,
              forms->plane_least);
    hn::Store(corner[0].x, d, forms->corner[0] + first);
    hn::Store(corner[0].y, d, forms->corner[1] + first);
    hn::Store(corner[0].z, d, forms->corner[2] + first);
    hn::Store(LeafIds(leaf, first), hn::RebindToUnsigned<ShaftD>(), forms->id + first);
    hn::Store(hn::Xor(hn::Set(d, 1.0f), flip), d, forms->turn + first);
  }
  return all;
}

// Lanes: OriginLanes or ParallelLanes.
template <class Lanes>
class OccludedPacketWalk {
 public:
  using Packet = typename Lanes::Packet;

  OccludedPacketWalk(const IndexedGeometry& scene, Packet& packet, WalkStats* stats)
      : scene_(scene),
        packet_(packet),
        stats_(stats),
        fetcher_(scene.bvh),
        lanes_(scene, packet, stats) {
    if constexpr (!Lanes::kParallel) PlaceCaps();
  }

  // Returns false if `cancel` fired.
  bool Run(const CancelToken* cancel) {
    if (cancel != nullptr && cancel->cancelled()) return false;
    if (scene_.bvh.empty()) return true;
    Pending stack[kBvhStackSize + ShaftCut::kMaxChildren];
    if (packet_.first_leaf != RayPacket::kNoLeaf) {
      // Wherever it lies: what darkened the packet before often darkens this one.
      const ChildRef first = ChildRef::FromBits(packet_.first_leaf);
      SIGHTLINE_DCHECK(scene_.bvh.HoldsLeaf(first)) << "first leaf " << packet_.first_leaf;
      if (VisitLeaf(first, {0, ~0u, Lanes::Everywhere()})) return true;
      packet_.first_leaf = RayPacket::kNoLeaf;
    }
    // What the walk begins with, the last one first: nearest to the light, in a cut.
    const ShaftCut* const cut = packet_.cut;
    const BvhNode* const first_nodes = cut == nullptr ? scene_.bvh.nodes.data() : cut->nodes;
    uint32_t first_left = cut == nullptr ? 1 : cut->node_count;
    int depth = 0;
    uint64_t visited = 0;
    for (;;) {
      if (first_left > 0) {
        depth = VisitNode(first_nodes[--first_left], ~0u, stack, depth);
        continue;
      }
      if (depth == 0) return true;
      const Pending pending = stack[--depth];
      if (++visited % kPollInterval == 0 && cancel != nullptr && cancel->cancelled()) return false;
      const ChildRef ref = ChildRef::FromBits(pending.ref_bits);
      if (ref.is_inner()) {
        depth = VisitNode(scene_.bvh.nodes[ref.node()], pending.groups, stack, depth);
      } else if (VisitLeaf(ref, pending)) {
        packet_.first_leaf = ref.bits();
        return true;
      }
    }
  }

 private:
  struct Pending {  // Trivial: the stack is not initialized.
    uint32_t ref_bits;
    uint32_t groups;  // No lane of any other enters.
    typename Lanes::LaneBox box;
  };

  static constexpr uint32_t kLanes = hn::MaxLanes(ShaftD());

  // Pushes those of its children that some of the groups enter. Returns how many are on the stack.
  HWY_INLINE int VisitNode(const BvhNode& node, uint32_t of_groups, Pending* stack, int depth) {
    ++stats_->nodes;
    // The cheapest child is the last, and is taken first.
    BoxShadows boxes;
    uint32_t bits = lanes_.MeetNode(node, &boxes);
    if constexpr (!Lanes::kParallel) {
      const hn::CappedTag<float, kBvhWidth> d8;
      bits &= MaskBits(d8, BeyondCaps(d8, caps_, node.bounds));
    }
    for (; bits != 0; bits &= bits - 1) {
      const int i = std::countr_zero(bits);
      uint32_t groups = lanes_.GroupsMeet(boxes, i, of_groups);
      if (groups == 0) continue;
      const typename Lanes::LaneBox box = lanes_.LaneBoxOf(node, boxes, i);
      while (groups != 0 && lanes_.LanesMeet(std::countr_zero(groups), box) == 0) {
        groups &= groups - 1;
      }
      if (groups == 0) continue;
      fetcher_.FetchAll(node.child[i]);
      stack[depth++] = {node.child[i].bits(), groups, box};
    }
    return depth;
  }

  // Along one direction they bring nothing: what lies behind all origins is passed by as it is.
  void PlaceCaps() {
    if (!lanes_.segments()) return;
    const Box3f box = BoxAround(packet_);
    for (int k = 0; k < 3; ++k) {
      const float origin = packet_.origin[k];
      const bool up = origin >= packet_.target(packet_.count / 2)[k];
      caps_.CapSegments(k, up, LeastIn(box, k, up), up ? origin : -origin);
    }
  }

  // Returns true when no lane is left to answer.
  bool VisitLeaf(ChildRef ref, const Pending& pending) {
    uint32_t met[Lanes::kMaxRays / 8];
    uint32_t groups = 0;  // Those of which a lane enters.
    int rays = 0;
    const uint32_t asked = pending.groups & lanes_.open_groups() & ~ClearGroups(ref);
    for (uint32_t left = asked; left != 0; left &= left - 1) {
      const uint32_t g = std::countr_zero(left);
      met[g] = lanes_.LanesMeet(g, pending.box);
      groups |= (met[g] != 0 ? 1u : 0u) << g;
      rays += std::popcount(met[g]);
    }
    if (groups == 0) return false;
    ++stats_->leaves;
    const LeafView leaf(scene_, ref);
    if (rays <= kFewRays) {
      TestOneByOne(leaf, groups, met);
      lanes_.CloseGroups();
      return lanes_.open_groups() == 0;
    }
    const uint32_t relevant = PrepareOccluders(scene_.geometry, leaf, lanes_, &forms_);
    // A list first, then the tests, without a branch that depends on them: how many triangles a
    // group meets, and whether one blocks anything, cannot be foretold. What is in doubt waits.
    Tests tests;
    ListTests(leaf, groups, met, relevant, &tests);
    const Test test(lanes_, leaf, forms_);
    Doubts doubts;
    TestRays(leaf, relevant, tests, test, &doubts);
    TestPairs(met, tests, test, &doubts);
    if (doubts.pair_count + doubts.ray_count > 0) Settle(leaf, test, doubts);
    lanes_.CloseGroups();
    return lanes_.open_groups() == 0;
  }

  // Those of whose lanes the leaf blocks none.
  HWY_INLINE uint32_t ClearGroups(ChildRef ref) const {
    const uint32_t blocks = ClearBlocks(packet_.clear, ref.bits());
    if constexpr (kLanes == kShaftBlockRays) {
      return blocks;
    } else {
      uint32_t groups = 0;
      for (uint32_t left = blocks; left != 0; left &= left - 1) {
        constexpr uint32_t kGroups = kShaftBlockRays / kLanes;
        groups |= ((1u << kGroups) - 1) << (kGroups * std::countr_zero(left));
      }
      return groups;
    }
  }

  // So few rays cost less one by one than forms that serve any number.
  static constexpr int kFewRays = 3;

  HWY_NOINLINE void TestOneByOne(const LeafView& leaf, uint32_t groups, const uint32_t* met) {
    for (; groups != 0; groups &= groups - 1) {
      const uint32_t g = std::countr_zero(groups);
      for (uint32_t left = met[g]; left != 0; left &= left - 1) {
        const uint32_t lane = g * kLanes + static_cast<uint32_t>(std::countr_zero(left));
        const TraceRay query = packet_.trace_ray(static_cast<int>(lane));
        TestLeaf(leaf, query, scene_.geometry, stats_, [&](uint32_t i) HWY_ATTR {
          lanes_.BlockLane(leaf.id(i), lane, /*hit=*/true);
          return true;
        });
      }
    }
  }

  using Test = ShaftTest<true, Lanes::kParallel, Lanes>;

  // What a leaf's triangles are put to.
  struct Tests {
    // Of a triangle i and a group g that sees its rectangle: g * kMaxLeafTriangles + i. A whole
    // vector is stored at its end.
    size_t pair_count = 0;
    alignas(64) uint32_t pairs[(Lanes::kMaxRays / kLanes + 1) * kMaxLeafTriangles];
    // Lanes that are put to all of the triangles.
    size_t ray_count = 0;
    alignas(64) uint32_t rays[Lanes::kMaxRays + kLanes];
  };
  struct RayInDoubt {
    uint16_t lane, triangles;
  };
  struct Doubts {
    size_t pair_count = 0;
    PairInDoubt pairs[std::size(Tests().pairs)];
    size_t ray_count = 0;
    RayInDoubt rays[std::size(Tests().rays)];
  };

  HWY_INLINE void ListTests(const LeafView& leaf, uint32_t groups, const uint32_t* met,
                            uint32_t relevant, Tests* list) const {
    const ShaftD d;
    const auto vectors = static_cast<int>((leaf.count + kLanes - 1) / kLanes);
    // LoadMaskBits may read as many.
    const auto mask = [d](uint32_t bits) HWY_ATTR {
      const uint32_t some[2] = {bits};
      return hn::LoadMaskBits(d, reinterpret_cast<const uint8_t*>(some));
    };
    for (; groups != 0; groups &= groups - 1) {
      const uint32_t g = std::countr_zero(groups);
      const uint32_t in = relevant & InRectangle(leaf, g);
      const bool by_rays = std::popcount(met[g]) * vectors < std::popcount(in);
      list->ray_count +=
          ListLanes(g * kLanes, mask(by_rays ? met[g] : 0), list->rays + list->ray_count);
      const uint32_t listed = by_rays ? 0 : in;
      for (uint32_t first = 0; first < kMaxLeafTriangles; first += kLanes) {
        list->pair_count += ListLanes(g * kMaxLeafTriangles + first, mask(listed >> first),
                                      list->pairs + list->pair_count);
      }
    }
  }

  HWY_NOINLINE void TestRays(const LeafView& leaf, uint32_t relevant, const Tests& tests,
                             const Test& test, Doubts* doubts) {
    const ShaftD d;
    const hn::RebindToUnsigned<ShaftD> du;
    size_t doubt_count = 0;
    for (size_t k = 0; k < tests.ray_count; ++k) {
      const uint32_t lane = tests.rays[k];
      uint32_t hits = 0, open = 0, own = 0;
      for (uint32_t first = 0; first < kMaxLeafTriangles; first += kLanes) {
        if (first >= leaf.count) break;
        const auto said = test.OfTriangles(lane, first);
        hits |= MaskBits(d, said.hit) << first;
        open |= MaskBits(d, said.open) << first;
        own |= MaskBits(du, hn::Eq(LeafIds(leaf, first), hn::Set(du, lanes_.source(lane))))
               << first;
      }
      const uint32_t asked = relevant & ~own;
      hits &= asked;
      // Of a ray that nothing blocks any triangle is named.
      const auto first_hit = static_cast<uint32_t>(std::countr_zero(hits | 1u << (leaf.count - 1)));
      lanes_.BlockLane(leaf.id(first_hit), lane, hits != 0);
      open = hits != 0 ? 0 : open & asked;
      doubts->rays[doubt_count] = {static_cast<uint16_t>(lane), static_cast<uint16_t>(open)};
      doubt_count += open != 0 ? 1 : 0;
    }
    doubts->ray_count = doubt_count;
    stats_->triangle_tests += tests.ray_count * static_cast<uint64_t>(std::popcount(relevant));
  }

  HWY_INLINE void TestPairs(const uint32_t* met, const Tests& tests, const Test& test,
                            Doubts* doubts) {
    const ShaftD d;
    uint64_t asked_rays = 0;
    size_t doubt_count = 0;
    for (size_t k = 0; k < tests.pair_count; ++k) {
      const uint32_t pair = tests.pairs[k], g = pair / kMaxLeafTriangles;
      const uint32_t i = pair % kMaxLeafTriangles, id = forms_.id[i];
      const uint32_t asked = met[g] & lanes_.active(g) & ~lanes_.SourceLanes(g, id);
      // Where a triangle has blocked all of a group, the group's pairs that follow end here.
      if (asked == 0) continue;
      asked_rays += static_cast<uint64_t>(std::popcount(asked));
      const auto said = test.InFloats(i, g * kLanes);
      const uint32_t hits = asked & MaskBits(d, said.hit);
      lanes_.Block(id, g, hits);
      const uint32_t open = asked & ~hits & MaskBits(d, said.open);
      doubts->pairs[doubt_count] = {static_cast<uint16_t>(pair), static_cast<uint16_t>(open)};
      doubt_count += open != 0 ? 1 : 0;
    }
    doubts->pair_count = doubt_count;
    stats_->triangle_tests += asked_rays;
  }

  HWY_NOINLINE void Settle(const LeafView& leaf, const Test& test, const Doubts& doubts) {
    const ShaftD d;
    const auto ray = [this](int lane) { return packet_.ray(lane); };
    const auto settle = [&](uint32_t i, uint32_t g, uint32_t rays) HWY_ATTR {
      // LoadMaskBits may read as many.
      const uint32_t open[2] = {rays & lanes_.active(g)};
      if (open[0] == 0) return;
      const ShaftM lanes = hn::LoadMaskBits(d, reinterpret_cast<const uint8_t*>(open));
      lanes_.Block(leaf.id(i), g, MaskBits(d, test.Settle(i, g * kLanes, lanes, ray, stats_)));
    };
    for (size_t k = 0; k < doubts.pair_count; ++k) {
      const PairInDoubt& doubt = doubts.pairs[k];
      settle(doubt.pair % kMaxLeafTriangles, doubt.pair / kMaxLeafTriangles, doubt.rays);
    }
    for (size_t k = 0; k < doubts.ray_count;) {
      const uint32_t g = doubts.rays[k].lane / kLanes;
      uint16_t rays[kMaxLeafTriangles] = {};
      for (; k < doubts.ray_count && doubts.rays[k].lane / kLanes == g; ++k) {
        for (uint32_t left = doubts.rays[k].triangles; left != 0; left &= left - 1) {
          rays[std::countr_zero(left)] |= static_cast<uint16_t>(1u << doubts.rays[k].lane % kLanes);
        }
      }
      for (uint32_t i = 0; i < kMaxLeafTriangles; ++i) {
        if (rays[i] != 0) settle(i, g, rays[i]);
      }
    }
  }

  // The leaf's triangles that are seen where a group's lanes are.
  uint32_t InRectangle(const LeafView& leaf, uint32_t group) const {
    if (lanes_.frame() == nullptr) return ~0u;
    const ShaftD d;
    const LaneRectangle& at = lanes_.rectangle(group);
    uint32_t in = 0;
    for (uint32_t first = 0; first < leaf.count; first += static_cast<uint32_t>(hn::Lanes(d))) {
      const ShaftM x = hn::And(hn::Le(hn::Load(d, forms_.x0 + first), hn::Set(d, at.x1)),
                               hn::Ge(hn::Load(d, forms_.x1 + first), hn::Set(d, at.x0)));
      const ShaftM y = hn::And(hn::Le(hn::Load(d, forms_.y0 + first), hn::Set(d, at.y1)),
                               hn::Ge(hn::Load(d, forms_.y1 + first), hn::Set(d, at.y0)));
      in |= MaskBits(d, hn::And(x, y)) << first;
    }
    return in;
  }

  const IndexedGeometry& scene_;
  Packet& packet_;
  WalkStats* const stats_;
  const VisitFetcher fetcher_;
  Lanes lanes_;
  AxisCaps caps_;
  LeafForms forms_;
};

template <class Lanes>
bool TraceOccludedPacket(const IndexedGeometry& scene, typename Lanes::Packet& packet,
                         const CancelToken* cancel, WalkStats* stats) {
  if (packet.count == 0) return true;
  return OccludedPacketWalk<Lanes>(scene, packet, stats).Run(cancel);
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard

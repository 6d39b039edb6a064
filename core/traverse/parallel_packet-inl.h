// SPDX-License-Identifier: Apache-2.0
//
// Rays with one direction walk together, for any hit: what packet-inl.h does for rays with one
// origin. A node's eight boxes are put to the whole packet by interval arithmetic, those that
// survive to vectors of rays from the first that entered the parent (paper 004, section 3); in a
// leaf, rays that miss the leaf's own box are left out, and a triangle's forms serve all the
// others.
//
// For neighbours that share what they walk through but not what they end on, where a shaft culls
// little: a million points of a city and a patch of its sky.
//
// The interval test is exact about floats: a lane's slab parameter is fl(fl(face - P)·inv) with inv
// common and P between the packet's extremes, and rounding is monotone. What is no number, where
// the direction runs along the face, culls nothing (core/geometry/box_ray.h).
//
// Thread safety: a walk is one thread's own.

#if defined(SIGHTLINE_CORE_TRAVERSE_PARALLEL_PACKET_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_PARALLEL_PACKET_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_PARALLEL_PACKET_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_PARALLEL_PACKET_INL_H_
#endif

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "core/base/cancel.h"
#include "core/geometry/box_ray.h"
#include "core/shaft/margins.h"
#include "core/traverse/shaft_leaf-inl.h"
#include "core/traverse/shaft_test-inl.h"
#include "core/traverse/single-inl.h"
#include "core/traverse/trace_ray.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// The rays of a packet with one direction: as ShaftTest asks for them, and against boxes.
class ParallelLanes {
 public:
  using D = ShaftD;
  using V = ShaftV;
  using M = ShaftM;
  static constexpr int kMaxRays = ParallelPacket::kMaxRays;

  // A box's faces along the direction, by axis.
  struct Slab {
    float near[3], far[3];
  };

  // One that no lane misses: what is no number culls nothing.
  static Slab Everywhere() {
    constexpr float kNoNumber = std::numeric_limits<float>::quiet_NaN();
    return {{kNoNumber, kNoNumber, kNoNumber}, {kNoNumber, kNoNumber, kNoNumber}};
  }

  explicit ParallelLanes(ParallelPacket& packet) : packet_(packet) {
    const D d;
    const size_t lanes = hn::Lanes(d), count = static_cast<size_t>(packet.count);
    groups_ = static_cast<uint32_t>((count + lanes - 1) / lanes);
    // Lanes out of use copy the last one in use, and are never active.
    for (size_t i = count; i < groups_ * lanes; ++i) {
      packet.origin_x[i] = packet.origin_x[count - 1];
      packet.origin_y[i] = packet.origin_y[count - 1];
      packet.origin_z[i] = packet.origin_z[count - 1];
      packet.origin_source[i] = kNoTriangle;
    }
    apex_ = packet.origin(packet.count / 2);
    V widest = hn::Zero(d);
    const hn::RebindToUnsigned<D> du;
    auto sources = hn::Set(du, kNoTriangle);
    V least[3], most[3];
    for (int k = 0; k < 3; ++k) least[k] = most[k] = hn::Load(d, row(k));
    for (uint32_t g = 0; g < groups_; ++g) {
      const size_t at = g * lanes;
      const Vec3V<V> p = {Point(0, at), Point(1, at), Point(2, at)};
      const Vec3V<V> own = SubV(p, Broadcast(d, apex_.x, apex_.y, apex_.z));
      hn::Store(own.x, d, own_[0] + at);
      hn::Store(own.y, d, own_[1] + at);
      hn::Store(own.z, d, own_[2] + at);
      widest = hn::Max(widest, Norm1V(own));
      const V* const axes[3] = {&p.x, &p.y, &p.z};
      for (int k = 0; k < 3; ++k) {
        least[k] = hn::Min(least[k], *axes[k]);
        most[k] = hn::Max(most[k], *axes[k]);
      }
      sources = hn::And(sources, hn::Load(du, packet.origin_source + at));
      const size_t left = count - at;
      active_[g] = left >= lanes ? (1u << lanes) - 1 : (1u << left) - 1;
      hn::Store(hn::Set(du, kNoTriangle), du, packet.triangle + at);
    }
    static_assert(kNoTriangle == 0xFFFFFFFFu, "all bits, so that And keeps it");
    has_sources_ = !hn::AllTrue(du, hn::Eq(sources, hn::Set(du, kNoTriangle)));
    spread_ = hn::GetLane(hn::MaxOfLanes(d, widest));
    for (int k = 0; k < 3; ++k) {
      inv_[k] = SlabReciprocal(packet.direction[k]);
      backward_[k] = std::signbit(inv_[k]);
      const float lo = hn::GetLane(hn::MinOfLanes(d, least[k]));
      const float hi = hn::GetLane(hn::MaxOfLanes(d, most[k]));
      first_[k] = backward_[k] ? lo : hi;
      last_[k] = backward_[k] ? hi : lo;
    }
    live_ = packet.count;
    BoundGroups();
  }

  uint32_t groups() const { return groups_; }
  uint32_t active(uint32_t group) const { return active_[group]; }  // Lanes still asked about.
  int live() const { return live_; }                                // How many of them.
  const ParallelPacket& packet() const { return packet_; }
  Vec3f apex() const { return apex_; }      // What `Own` is relative to.
  float spread() const { return spread_; }  // Bounds |P - apex|_1.
  // Axes across the direction; null where there are none.
  const ShaftFrame* frame() const { return has_frame_ ? &frame_ : nullptr; }
  // Of a group's lanes: extents along the frame's axes, wide enough for their rounding.
  struct Rectangle {
    float x0, x1, y0, y1;
  };
  const Rectangle& rectangle(uint32_t group) const { return rectangles_[group]; }

  // What ShaftTest asks for.
  static constexpr bool segments() { return false; }
  Vec3f common() const { return packet_.direction; }
  HWY_INLINE Vec3V<V> Own(size_t at) const {
    const D d;
    return {hn::Load(d, own_[0] + at), hn::Load(d, own_[1] + at), hn::Load(d, own_[2] + at)};
  }
  HWY_INLINE V Point(int axis, size_t at) const { return hn::Load(D(), row(axis) + at); }

  // Which of the node's boxes some lane may enter.
  HWY_INLINE uint32_t MeetNode(const BvhNode& node) const {
    const hn::CappedTag<float, kBvhWidth> d8;
    using V8 = hn::Vec<decltype(d8)>;
    V8 entry = hn::Zero(d8), exit = hn::Set(d8, std::numeric_limits<float>::infinity());
    for (int k = 0; k < 3; ++k) {
      const V8 inv = hn::Set(d8, inv_[k]);
      const V8 near = hn::Load(d8, node.bounds[backward_[k] ? k + 3 : k]);
      const V8 far = hn::Load(d8, node.bounds[backward_[k] ? k : k + 3]);
      // The running value stays second: what is no number is passed over.
      entry = hn::Max(hn::Mul(hn::Sub(near, hn::Set(d8, first_[k])), inv), entry);
      exit = hn::Min(hn::Mul(hn::Sub(far, hn::Set(d8, last_[k])), inv), exit);
    }
    const auto met =
        hn::Le(entry, hn::MulAdd(exit, hn::Set(d8, kBoxExitScale), hn::Set(d8, kBoxExitShift)));
    return MaskBits(d8, met) & ((1u << node.child_count) - 1);
  }
  HWY_INLINE Slab SlabOf(const BvhNode& node, int child) const {
    Slab slab;
    for (int k = 0; k < 3; ++k) {
      slab.near[k] = node.bounds[backward_[k] ? k + 3 : k][child];
      slab.far[k] = node.bounds[backward_[k] ? k : k + 3][child];
    }
    return slab;
  }
  // The lanes of a group, still asked about, that may hit something in the box.
  HWY_INLINE uint32_t LanesMeet(uint32_t group, const Slab& slab) const {
    if (active_[group] == 0) return 0;
    const D d;
    const size_t at = group * hn::Lanes(d);
    V entry = hn::Zero(d), exit = hn::Set(d, std::numeric_limits<float>::infinity());
    for (int k = 0; k < 3; ++k) {
      const V p = Point(k, at), inv = hn::Set(d, inv_[k]);
      entry = hn::Max(hn::Mul(hn::Sub(hn::Set(d, slab.near[k]), p), inv), entry);
      exit = hn::Min(hn::Mul(hn::Sub(hn::Set(d, slab.far[k]), p), inv), exit);
    }
    const M met =
        hn::Le(entry, hn::MulAdd(exit, hn::Set(d, kBoxExitScale), hn::Set(d, kBoxExitShift)));
    return MaskBits(d, met) & active_[group];
  }

  // Lanes of a group whose own source is triangle `id`.
  HWY_INLINE uint32_t SourceLanes(uint32_t group, uint32_t id) const {
    if (!has_sources_) return 0;
    const hn::RebindToUnsigned<D> du;
    return MaskBits(
        du, hn::Eq(hn::Load(du, packet_.origin_source + group * hn::Lanes(du)), hn::Set(du, id)));
  }
  // Ends lanes: triangle `id` blocks them.
  HWY_INLINE void Block(uint32_t id, uint32_t group, uint32_t hits) {
    const uint32_t first = group * static_cast<uint32_t>(hn::Lanes(D()));
    active_[group] &= ~hits;
    live_ -= std::popcount(hits);
    for (; hits != 0; hits &= hits - 1) packet_.triangle[first + std::countr_zero(hits)] = id;
  }

 private:
  void BoundGroups() {
    const Vec3d sideways =
        ToDouble(packet_.origin(std::min(3, packet_.count - 1))) - ToDouble(packet_.origin(0));
    has_frame_ = MakeShaftFrame(ToDouble(packet_.direction), sideways, &frame_);
    if (!has_frame_) return;
    const D d;
    const Vec3V<V> u = Broadcast(d, frame_.u.x, frame_.u.y, frame_.u.z);
    const Vec3V<V> v = Broadcast(d, frame_.v.x, frame_.v.y, frame_.v.z);
    const float margin = kBoxMargin * spread_;
    for (uint32_t g = 0; g < groups_; ++g) {
      const Vec3V<V> own = Own(g * hn::Lanes(d));
      const V x = DotV(u, own), y = DotV(v, own);
      rectangles_[g] = {
          hn::GetLane(hn::MinOfLanes(d, x)) - margin, hn::GetLane(hn::MaxOfLanes(d, x)) + margin,
          hn::GetLane(hn::MinOfLanes(d, y)) - margin, hn::GetLane(hn::MaxOfLanes(d, y)) + margin};
    }
  }

  const float* row(int axis) const {
    return axis == 0 ? packet_.origin_x : axis == 1 ? packet_.origin_y : packet_.origin_z;
  }

  ParallelPacket& packet_;
  uint32_t groups_ = 0;
  int live_ = 0;
  bool has_sources_ = false;
  Vec3f apex_;
  float spread_ = 0;
  float inv_[3];
  bool backward_[3];
  float first_[3], last_[3];  // Of the origins, along the direction: the foremost and the hindmost.
  uint32_t active_[kMaxRays / 8];
  bool has_frame_ = false;
  ShaftFrame frame_;
  Rectangle rectangles_[kMaxRays / 8];
  alignas(64) float own_[3][kMaxRays];
};

// The forms that ShaftTest needs of a leaf's triangles, sixteen at a time; the other rows are left
// as they are. Bounds are those of core/shaft/margins.h, for rays relative to the lanes' apex.
// Returns the triangles that may block anything (bit i for triangle i).
HWY_INLINE uint32_t PrepareParallelForms(const SceneGeometry& geometry, const LeafView& leaf,
                                         const ParallelLanes& lanes, LeafForms* forms) {
  using V = ShaftV;
  using V3 = Vec3V<V>;
  const ShaftD d;
  const ParallelPacket& packet = lanes.packet();
  const V3 apex = Broadcast(d, lanes.apex().x, lanes.apex().y, lanes.apex().z);
  const V3 direction = Broadcast(d, packet.direction.x, packet.direction.y, packet.direction.z);
  const V direction_inf = hn::Set(d, MaxAbs(packet.direction));
  const V underflow = hn::Set(d, kFloatUnderflow);
  uint32_t all = 0;
  for (uint32_t first = 0; first < leaf.count; first += static_cast<uint32_t>(hn::Lanes(d))) {
    const auto load = [&](int corner) HWY_ATTR -> V3 {
      const float* rows = leaf.rows + 3 * corner * leaf.stride + first;
      return {hn::LoadU(d, rows), hn::LoadU(d, rows + leaf.stride),
              hn::LoadU(d, rows + 2 * leaf.stride)};
    };
    const V3 corner[3] = {load(0), load(1), load(2)};
    const V3 along[3] = {SubV(corner[1], corner[0]), SubV(corner[2], corner[1]),
                         SubV(corner[0], corner[2])};
    const V along1[3] = {Norm1V(along[0]), Norm1V(along[1]), Norm1V(along[2])};
    const V3 normal = CrossV(along[0], along[1]);
    const V normal_bound =
        hn::MulAdd(hn::Set(d, kFloatUnits), hn::Mul(along1[0], along1[1]), underflow);
    V turn = DotV(normal, direction);
    const V turn_bound = hn::MulAdd(normal_bound, direction_inf, underflow);
    uint32_t chosen = leaf.count - first >= hn::Lanes(d) ? (1u << hn::Lanes(d)) - 1
                                                         : (1u << (leaf.count - first)) - 1;
    if (packet.direction_source != kNoTriangle) {
      for (uint32_t i = 0; first + i < leaf.count && i < hn::Lanes(d); ++i) {
        if (leaf.id(first + i) == packet.direction_source) chosen &= ~(1u << i);
      }
    }
    const uint32_t unsure = chosen & MaskBits(d, hn::Le(hn::Abs(turn), turn_bound));
    if (unsure != 0 || MustAskObjects(geometry, packet.mask)) {
      HWY_ALIGN float turns[kMaxLeafTriangles];
      hn::Store(turn, d, turns);
      chosen = SettleTurns<true>(geometry, leaf, first, chosen, unsure, packet.mask,
                                 packet.direction, turns);
      turn = hn::Load(d, turns);
    }
    if (chosen == 0) continue;
    all |= chosen << first;
    const V flip = hn::And(turn, hn::SignBit(d));
    const auto put = [first, d](const V3& v, V sign, float(*rows)[kMaxLeafTriangles]) HWY_ATTR {
      hn::Store(hn::Xor(v.x, sign), d, rows[0] + first);
      hn::Store(hn::Xor(v.y, sign), d, rows[1] + first);
      hn::Store(hn::Xor(v.z, sign), d, rows[2] + first);
    };
    const V infinity = hn::Set(d, std::numeric_limits<float>::infinity());
    V reach = hn::Zero(d), x0 = infinity, x1 = hn::Neg(infinity), y0 = x0, y1 = x1;
    const ShaftFrame* const frame = lanes.frame();
    for (int e = 0; e < 3; ++e) {
      const V3 from_apex = SubV(corner[e], apex);
      reach = hn::Max(reach, Norm1V(from_apex));
      if (frame != nullptr) {
        const V x = DotV(Broadcast(d, frame->u.x, frame->u.y, frame->u.z), from_apex);
        const V y = DotV(Broadcast(d, frame->v.x, frame->v.y, frame->v.z), from_apex);
        x0 = hn::Min(x0, x);
        x1 = hn::Max(x1, x);
        y0 = hn::Min(y0, y);
        y1 = hn::Max(y1, y);
      }
      const V3 edge = CrossV(along[e], direction);
      put(edge, flip, forms->edge[e]);
      hn::Store(hn::Xor(DotV(edge, from_apex), flip), d, forms->edge_offset[e] + first);
    }
    // One bound for the three, of the farthest corner and the longest edge.
    const V longest = hn::Max(hn::Max(along1[0], along1[1]), along1[2]);
    const V edge_k =
        hn::Mul(hn::Mul(longest, direction_inf), hn::Add(reach, hn::Set(d, lanes.spread())));
    hn::Store(hn::MulAdd(hn::Set(d, kParallelUnits), edge_k, underflow), d,
              forms->edge_bound + first);
    const V margin =
        hn::MulAdd(hn::Add(reach, hn::Set(d, lanes.spread())), hn::Set(d, kBoxMargin), underflow);
    hn::Store(hn::Sub(x0, margin), d, forms->x0 + first);
    hn::Store(hn::Add(x1, margin), d, forms->x1 + first);
    hn::Store(hn::Sub(y0, margin), d, forms->y0 + first);
    hn::Store(hn::Add(y1, margin), d, forms->y1 + first);
    put(normal, flip, forms->normal);
    hn::Store(normal_bound, d, forms->normal_bound + first);
    hn::Store(hn::Xor(hn::Set(d, 1.0f), flip), d, forms->turn + first);
  }
  return all;
}

class ParallelPacketWalk {
 public:
  ParallelPacketWalk(const IndexedGeometry& scene, ParallelPacket& packet, WalkStats* stats)
      : scene_(scene), packet_(packet), stats_(stats), lanes_(packet) {}

  // Returns false if `cancel` fired.
  bool Run(const CancelToken* cancel) {
    if (cancel != nullptr && cancel->cancelled()) return false;
    if (scene_.bvh.empty()) return true;
    Pending stack[kBvhStackSize];
    int depth = 0;
    if (packet_.first_leaf != RayPacket::kNoLeaf) {
      // Wherever it lies: what darkened the packet before often darkens this one.
      if (VisitLeaf(ChildRef::FromBits(packet_.first_leaf), {0, 0, ParallelLanes::Everywhere()})) {
        return true;
      }
      packet_.first_leaf = RayPacket::kNoLeaf;
    }
    stack[depth++] = {ChildRef::Inner(0).bits(), 0, ParallelLanes::Everywhere()};
    const VisitFetcher fetcher(scene_.bvh);
    uint64_t visited = 0;
    while (depth > 0) {
      const Pending pending = stack[--depth];
      if (++visited % kPollInterval == 0 && cancel != nullptr && cancel->cancelled()) return false;
      const ChildRef ref = ChildRef::FromBits(pending.ref_bits);
      if (ref.is_leaf()) {
        if (VisitLeaf(ref, pending)) {
          packet_.first_leaf = ref.bits();
          return true;
        }
        continue;
      }
      ++stats_->nodes;
      const BvhNode& node = scene_.bvh.nodes[ref.node()];
      // The cheapest child is the last, and is taken first.
      for (uint32_t bits = lanes_.MeetNode(node); bits != 0; bits &= bits - 1) {
        const int i = std::countr_zero(bits);
        const ParallelLanes::Slab slab = lanes_.SlabOf(node, i);
        uint32_t group = pending.first_group;
        while (group < lanes_.groups() && lanes_.LanesMeet(group, slab) == 0) ++group;
        if (group == lanes_.groups()) continue;
        fetcher.FetchAll(node.child[i]);
        stack[depth++] = {node.child[i].bits(), group, slab};
      }
    }
    return true;
  }

 private:
  struct Pending {  // Trivial: the stack is not initialized.
    uint32_t ref_bits;
    uint32_t first_group;  // No lane of a group before it enters.
    ParallelLanes::Slab slab;
  };

  // Returns true when no lane is left to answer.
  bool VisitLeaf(ChildRef ref, const Pending& pending) {
    uint32_t met[ParallelLanes::kMaxRays / 8];
    uint32_t rays = 0;
    for (uint32_t g = pending.first_group; g < lanes_.groups(); ++g) {
      met[g] = lanes_.LanesMeet(g, pending.slab);
      rays += static_cast<uint32_t>(std::popcount(met[g]));
    }
    if (rays == 0) return false;  // Others have been blocked since.
    ++stats_->leaves;
    const LeafView leaf(scene_, ref);
    const uint32_t relevant = PrepareParallelForms(scene_.geometry, leaf, lanes_, &forms_);
    const ShaftD d;
    const ShaftTest<true, true, ParallelLanes> test(lanes_, leaf, forms_);
    const auto ray = [this](int lane) { return packet_.ray(lane); };
    for (uint32_t g = pending.first_group; g < lanes_.groups(); ++g) {
      if (met[g] == 0) continue;
      for (uint32_t left = relevant & InRectangle(leaf, g); left != 0 && met[g] != 0;
           left &= left - 1) {
        const uint32_t i = std::countr_zero(left), id = leaf.id(i);
        const uint32_t asked[2] = {met[g] & ~lanes_.SourceLanes(g, id)};
        stats_->triangle_tests += static_cast<uint64_t>(std::popcount(asked[0]));
        const ShaftM blocked =
            test.Certain(i, g * hn::Lanes(d),
                         hn::LoadMaskBits(d, reinterpret_cast<const uint8_t*>(asked)), ray, stats_);
        if (hn::AllFalse(d, blocked)) continue;
        const uint32_t hits = MaskBits(d, blocked);
        lanes_.Block(id, g, hits);
        met[g] &= ~hits;
      }
    }
    return lanes_.live() == 0;
  }

  // The leaf's triangles that are seen along the direction where a group's lanes are.
  uint32_t InRectangle(const LeafView& leaf, uint32_t group) const {
    if (lanes_.frame() == nullptr) return ~0u;
    const ShaftD d;
    const ParallelLanes::Rectangle& at = lanes_.rectangle(group);
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
  ParallelPacket& packet_;
  WalkStats* const stats_;
  ParallelLanes lanes_;
  LeafForms forms_;
};

inline bool TraceParallelPacket(const IndexedGeometry& scene, ParallelPacket& packet,
                                const CancelToken* cancel, WalkStats* stats) {
  if (packet.count == 0) return true;
  return ParallelPacketWalk(scene, packet, stats).Run(cancel);
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard

// SPDX-License-Identifier: Apache-2.0
//
// Rays with one origin walk together (paper 004, section 5; paper 000 for the shared origin's gains).
//
// A node's eight boxes are first put to the whole packet by interval arithmetic; a box that survives is tried on
// groups of lanes, from the group that was first to enter the parent (first-active-ray test), until one enters. In a
// leaf, each triangle's edge normals relative to the common origin are computed once and serve every lane, and lanes
// that miss the leaf's own box are left out.
//
// The interval test is exact about floats: a lane's slab parameter is fl(x·inv) with x common and inv between the
// packet's extremes, and rounding is monotone, so the lane's value lies between the two end products.

#if defined(SIGHTLINE_CORE_TRAVERSE_PACKET_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_PACKET_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_PACKET_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_PACKET_INL_H_
#endif

#include "core/intersect/hit-inl.h"
#include "core/traverse/single-inl.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

template <bool kAny>
class PacketWalk {
 public:
  PacketWalk(const IndexedGeometry& scene, RayPacket& packet, WalkStats* stats)
      : scene_(scene), packet_(packet), stats_(stats) {
    LoadRays();
    BoundReciprocals();
  }

  // Returns false if `cancel` fired.
  bool Run(const CancelToken* cancel) {
    if (scene_.bvh.empty()) return true;
    Pending stack[kBvhStackSize];
    int depth = 0;
    stack[depth++] = {-std::numeric_limits<float>::infinity(), ChildRef::Inner(0).bits(), 0, Slab{}};
    uint64_t visited = 0;
    while (depth > 0) {
      const Pending pending = stack[--depth];
      if (pending.entry > limit_) continue;
      if (++visited % kPollInterval == 0 && cancel != nullptr && cancel->cancelled()) return false;
      const ChildRef ref = ChildRef::FromBits(pending.ref_bits);
      if (ref.is_leaf()) {
        if (VisitLeaf(ref, pending)) return true;
        continue;
      }
      ++stats_->nodes;
      const BvhNode& node = scene_.bvh.nodes[ref.node()];
      HWY_ALIGN float entries[kBvhWidth];
      uint32_t bits = MeetPacket(node, entries);
      const int base = depth;
      for (; bits != 0; bits &= bits - 1) {
        const int i = std::countr_zero(bits);
        const Slab slab = SlabOf(node, i);
        uint32_t group = pending.first_group;
        while (group < groups_ && !GroupMeets(group, slab)) ++group;
        if (group == groups_) continue;
        const Pending child = {entries[i], node.child[i].bits(), group, slab};
        int at = depth++;
        while (at > base && stack[at - 1].entry < child.entry) {
          stack[at] = stack[at - 1];
          --at;
        }
        stack[at] = child;
      }
    }
    return true;
  }

 private:
  using D = hn::CappedTag<float, 16>;
  using V = hn::Vec<D>;
  using M = hn::Mask<D>;
  static constexpr int kMaxRays = RayPacket::kMaxRays;

  // A box's faces relative to the origin: lo - o, hi - o.
  struct Slab {
    float lo[3], hi[3];
  };
  struct Pending {  // Trivial: the stack is not initialized.
    float entry;    // No lane enters before this.
    uint32_t ref_bits;
    uint32_t first_group;  // No lane of a group before it enters.
    Slab slab;
  };
  // One triangle, turned so that the origin lies behind it: all three forms are positive where it is hit.
  struct Facing {
    float edge[3][3], edge_bound[3];
    float normal[3], normal_bound;
    float a[3];
    uint32_t lane;
  };

  void LoadRays() {
    const D d;
    const size_t lanes = hn::Lanes(d);
    groups_ = static_cast<uint32_t>((packet_.count + lanes - 1) / lanes);
    const int padded = static_cast<int>(groups_ * lanes);
    // Lanes out of use copy the last one in use, and are never active.
    for (int i = packet_.count; i < padded; ++i) {
      packet_.target_x[i] = packet_.target_x[packet_.count - 1];
      packet_.target_y[i] = packet_.target_y[packet_.count - 1];
      packet_.target_z[i] = packet_.target_z[packet_.count - 1];
      packet_.target_source[i] = kNoTriangle;
    }
    const Vec3V<V> o = Broadcast(d, packet_.origin.x, packet_.origin.y, packet_.origin.z);
    const V min_normal = hn::Set(d, std::numeric_limits<float>::min());
    const V nan = hn::Set(d, std::numeric_limits<float>::quiet_NaN());
    const V one = hn::Set(d, 1.0f);
    limit_ = packet_.segments ? kSegmentEnd : std::numeric_limits<float>::infinity();
    has_sources_ = false;
    for (int i = 0; i < padded; i += static_cast<int>(lanes)) {
      Vec3V<V> dir = {hn::Load(d, packet_.target_x + i), hn::Load(d, packet_.target_y + i),
                      hn::Load(d, packet_.target_z + i)};
      if (packet_.segments) dir = SubV(dir, o);
      hn::Store(dir.x, d, direction_[0] + i);
      hn::Store(dir.y, d, direction_[1] + i);
      hn::Store(dir.z, d, direction_[2] + i);
      hn::Store(NormInfV(dir), d, direction_inf_ + i);
      const V* components[3] = {&dir.x, &dir.y, &dir.z};
      for (int k = 0; k < 3; ++k) {
        const V& c = *components[k];
        // SlabReciprocal of core/geometry/box_ray.h, lane by lane.
        const M subnormal = hn::And(hn::Lt(hn::Abs(c), min_normal), hn::Ne(c, hn::Zero(d)));
        hn::Store(hn::IfThenElse(subnormal, nan, hn::Div(one, c)), d, inv_[k] + i);
      }
      hn::Store(hn::Set(d, limit_), d, limit_of_ + i);
    }
    for (int i = 0; i < padded; ++i) packet_.hit[i] = Hit{};
    if (packet_.segments) {
      for (int i = 0; i < packet_.count; ++i) {
        has_sources_ |= packet_.target_source[i] != kNoTriangle;
      }
    }
    for (uint32_t g = 0; g < groups_; ++g) {
      const int left = packet_.count - static_cast<int>(g * lanes);
      active_[g] = left >= static_cast<int>(lanes) ? (1u << lanes) - 1 : (1u << left) - 1;
    }
    for (int i = packet_.count; i < padded; ++i) {
      limit_of_[i] = -std::numeric_limits<float>::infinity();  // Enters nothing.
    }
    live_ = packet_.count;
  }

  // Per axis, the range of the lanes' reciprocals, where they share a sign and are finite; elsewhere the axis stays
  // out of the interval test.
  void BoundReciprocals() {
    for (int k = 0; k < 3; ++k) {
      float lo = std::numeric_limits<float>::infinity(), hi = -lo;
      bool usable = true;
      for (int i = 0; i < packet_.count; ++i) {
        const float v = inv_[k][i];
        usable &= std::isfinite(v);
        lo = std::min(lo, v);
        hi = std::max(hi, v);
      }
      axis_usable_[k] = usable && (lo > 0 || hi < 0);
      axis_negative_[k] = hi < 0;
      inv_min_[k] = lo;
      inv_max_[k] = hi;
    }
  }

  // Which of the node's boxes some lane may enter; their least entries.
  uint32_t MeetPacket(const BvhNode& node, float* entries) const {
    const hn::CappedTag<float, kBvhWidth> d8;
    using V8 = hn::Vec<decltype(d8)>;
    V8 entry = hn::Set(d8, -std::numeric_limits<float>::infinity());
    V8 exit = hn::Set(d8, std::numeric_limits<float>::infinity());
    for (int k = 0; k < 3; ++k) {
      if (!axis_usable_[k]) continue;
      const V8 o = hn::Set(d8, packet_.origin[k]);
      const V8 i0 = hn::Set(d8, inv_min_[k]), i1 = hn::Set(d8, inv_max_[k]);
      const V8 near = hn::Sub(hn::Load(d8, node.bounds[axis_negative_[k] ? k + 3 : k]), o);
      const V8 far = hn::Sub(hn::Load(d8, node.bounds[axis_negative_[k] ? k : k + 3]), o);
      entry = hn::Max(hn::Min(hn::Mul(near, i0), hn::Mul(near, i1)), entry);
      exit = hn::Min(hn::Max(hn::Mul(far, i0), hn::Mul(far, i1)), exit);
    }
    hn::Store(entry, d8, entries);
    const auto met = hn::And(
        hn::Le(hn::Max(entry, hn::Zero(d8)),
               hn::MulAdd(exit, hn::Set(d8, kBoxExitScale), hn::Set(d8, kBoxExitShift))),
        hn::Le(entry, hn::Set(d8, limit_)));
    return MaskBits(d8, met) & ((1u << node.child_count) - 1);
  }

  Slab SlabOf(const BvhNode& node, int i) const {
    Slab slab;
    for (int k = 0; k < 3; ++k) {
      slab.lo[k] = node.bounds[k][i] - packet_.origin[k];
      slab.hi[k] = node.bounds[k + 3][i] - packet_.origin[k];
    }
    return slab;
  }

  // The lanes of a group that may enter the box: the slab test of core/geometry/box_ray.h.
  HWY_INLINE M LanesMeet(uint32_t group, const Slab& slab) const {
    const D d;
    const size_t first = group * hn::Lanes(d);
    V entry = hn::Set(d, -std::numeric_limits<float>::infinity());
    V exit = hn::Set(d, std::numeric_limits<float>::infinity());
    for (int k = 0; k < 3; ++k) {
      const V inv = hn::Load(d, inv_[k] + first);
      const V lo = hn::Mul(hn::Set(d, slab.lo[k]), inv), hi = hn::Mul(hn::Set(d, slab.hi[k]), inv);
      // By sign, not by minimum: a face on the ray's line gives NaN, which must stay with its own face.
      entry = hn::Max(hn::IfNegativeThenElse(inv, hi, lo), entry);
      exit = hn::Min(hn::IfNegativeThenElse(inv, lo, hi), exit);
    }
    return hn::And(hn::Le(hn::Max(entry, hn::Zero(d)),
                          hn::MulAdd(exit, hn::Set(d, kBoxExitScale), hn::Set(d, kBoxExitShift))),
                   hn::Le(entry, hn::Load(d, limit_of_ + first)));
  }

  bool GroupMeets(uint32_t group, const Slab& slab) const {
    return active_[group] != 0 && !hn::AllFalse(D(), LanesMeet(group, slab));
  }

  // Returns true when no lane is left to answer.
  bool VisitLeaf(ChildRef ref, const Pending& pending) {
    ++stats_->leaves;
    const LeafView leaf(scene_.bvh, ref);
    Facing facing[kMaxLeafTriangles];
    const uint32_t count = TurnTriangles(leaf, facing);
    if (count == 0) return false;
    for (uint32_t group = pending.first_group; group < groups_; ++group) {
      if (active_[group] == 0) continue;
      uint32_t in_leaf = MaskBits(D(), LanesMeet(group, pending.slab)) & active_[group];
      for (uint32_t i = 0; i < count && in_leaf != 0; ++i) {
        in_leaf = TestTriangle(leaf, facing[i], group, in_leaf);
      }
    }
    if constexpr (kAny) return live_ == 0;
    UpdateLimit();
    return false;
  }

  // Fills `facing` with the leaf's triangles that can block a ray from the origin.
  uint32_t TurnTriangles(const LeafView& leaf, Facing* facing) const {
    const D d;
    const size_t lanes = hn::Lanes(d);
    const Vec3V<V> o = Broadcast(d, packet_.origin.x, packet_.origin.y, packet_.origin.z);
    uint32_t count = 0;
    for (uint32_t first = 0; first < leaf.count; first += static_cast<uint32_t>(lanes)) {
      const OriginTriangles<V> t = PrepareTriangles(d, leaf.rows + first, leaf.stride, o);
      // Transposed through memory: 17 rows of the vector's lanes.
      HWY_ALIGN float columns[21][16];
      const auto put = [&](int row, const Vec3V<V>& v) HWY_ATTR {
        hn::Store(v.x, d, columns[row]);
        hn::Store(v.y, d, columns[row + 1]);
        hn::Store(v.z, d, columns[row + 2]);
      };
      put(0, t.edge[0]);
      put(3, t.edge[1]);
      put(6, t.edge[2]);
      put(9, t.normal);
      put(12, t.a);
      hn::Store(t.edge_bound[0], d, columns[15]);
      hn::Store(t.edge_bound[1], d, columns[16]);
      hn::Store(t.edge_bound[2], d, columns[17]);
      hn::Store(t.normal_bound, d, columns[18]);
      hn::Store(t.origin_side, d, columns[19]);
      hn::Store(t.origin_bound, d, columns[20]);
      const uint32_t in_use = std::min<uint32_t>(leaf.count - first, static_cast<uint32_t>(lanes));
      for (uint32_t i = 0; i < in_use; ++i) {
        const uint32_t lane = first + i;
        const uint32_t id = leaf.id(lane);
        if (id == packet_.origin_source) continue;
        // +1: the origin is behind, and rays that hit cross toward the front.
        int turn = columns[19][i] > columns[20][i] ? 1 : columns[19][i] < -columns[20][i] ? -1 : 0;
        if (turn == 0) {
          turn = -SideOfPlane(leaf.corner(0, lane), leaf.corner(1, lane), leaf.corner(2, lane),
                              packet_.origin);
          if (turn == 0) continue;  // The origin lies in its plane: it blocks nothing.
        }
        if (!scene_.geometry.uniform &&
            !ObjectBlocks(scene_.geometry, id, packet_.mask, -turn)) {
          continue;
        }
        Facing& f = facing[count++];
        const float sign = static_cast<float>(turn);
        for (int e = 0; e < 3; ++e) {
          for (int k = 0; k < 3; ++k) f.edge[e][k] = sign * columns[3 * e + k][i];
          f.edge_bound[e] = columns[15 + e][i];
          f.normal[e] = sign * columns[9 + e][i];
          f.a[e] = columns[12 + e][i];
        }
        f.normal_bound = columns[18][i];
        f.lane = lane;
      }
    }
    return count;
  }

  // One triangle against one group's lanes `lanes_in`; returns those that still look for a hit in this leaf.
  HWY_INLINE uint32_t TestTriangle(const LeafView& leaf, const Facing& f, uint32_t group,
                                   uint32_t lanes_in) {
    const D d;
    const size_t first = group * hn::Lanes(d);
    stats_->triangle_tests += std::popcount(lanes_in);
    const V underflow = hn::Set(d, kFloatUnderflow);
    const Vec3V<V> dir = {hn::Load(d, direction_[0] + first), hn::Load(d, direction_[1] + first),
                          hn::Load(d, direction_[2] + first)};
    const V dir_inf = hn::Load(d, direction_inf_ + first);
    V least = hn::Set(d, std::numeric_limits<float>::infinity()), most = least;
    for (int e = 0; e < 3; ++e) {
      const V value = DotV(Broadcast(d, f.edge[e][0], f.edge[e][1], f.edge[e][2]), dir);
      const V bound = hn::MulAdd(hn::Set(d, f.edge_bound[e]), dir_inf, underflow);
      least = hn::Min(least, hn::Sub(value, bound));
      most = hn::Min(most, hn::Add(value, bound));
    }
    // `most` < 0: some form is certainly negative. `least` > 0: all are certainly positive.
    uint32_t open = lanes_in & ~MaskBits(d, hn::Lt(most, hn::Zero(d)));
    if (open == 0) return lanes_in;
    if (packet_.segments) {
      const Vec3V<V> ap = SubV({hn::Load(d, packet_.target_x + first), hn::Load(d, packet_.target_y + first),
                                hn::Load(d, packet_.target_z + first)},
                               Broadcast(d, f.a[0], f.a[1], f.a[2]));
      const V value = DotV(Broadcast(d, f.normal[0], f.normal[1], f.normal[2]), ap);
      const V bound = hn::MulAdd(hn::Set(d, f.normal_bound), NormInfV(ap), underflow);
      open &= ~MaskBits(d, hn::Lt(hn::Add(value, bound), hn::Zero(d)));
      least = hn::Min(least, hn::Sub(value, bound));
    }
    const uint32_t id = leaf.id(f.lane);
    if (has_sources_) {
      const hn::RebindToUnsigned<D> du;
      const auto is_source = hn::Eq(hn::Load(du, packet_.target_source + first), hn::Set(du, id));
      open &= ~MaskBits(du, is_source);
    }
    uint32_t hits = open & MaskBits(d, hn::Gt(least, hn::Zero(d)));
    const Vec3f a = leaf.corner(0, f.lane), b = leaf.corner(1, f.lane), c = leaf.corner(2, f.lane);
    for (uint32_t doubt = open & ~hits; doubt != 0; doubt &= doubt - 1) {
      const uint32_t bit = std::countr_zero(doubt);
      PredicateStage stage;
      if (Blocks(packet_.ray(static_cast<int>(first + bit)), a, b, c, &stage)) hits |= 1u << bit;
      ++stats_->doubt_double;
      stats_->doubt_exact += stage == PredicateStage::kExact;
    }
    if (hits == 0) return lanes_in;
    if constexpr (kAny) {
      for (uint32_t rest = hits; rest != 0; rest &= rest - 1) {
        const uint32_t lane = static_cast<uint32_t>(first) + std::countr_zero(rest);
        packet_.hit[lane] = {0.0f, id};
        limit_of_[lane] = -std::numeric_limits<float>::infinity();
      }
      active_[group] &= ~hits;
      live_ -= std::popcount(hits);
      return lanes_in & ~hits;
    } else {
      KeepCloserLanes(TriangleDistance::Make(packet_.origin, a, b, c), id, first, hits);
      return lanes_in;
    }
  }

  // Keeps the least hit by (t, id) in the lanes of `hits`.
  HWY_INLINE void KeepCloserLanes(const TriangleDistance& triangle, uint32_t id, size_t first,
                                  uint32_t hits) {
    const D d;
    const Vec3V<V> target = {hn::Load(d, packet_.target_x + first),
                             hn::Load(d, packet_.target_y + first),
                             hn::Load(d, packet_.target_z + first)};
    const Vec3V<V> inv = {hn::Load(d, inv_[0] + first), hn::Load(d, inv_[1] + first),
                          hn::Load(d, inv_[2] + first)};
    HWY_ALIGN float distances[16];
    hn::Store(HitDistances(d, triangle, packet_.origin, packet_.segments, target, inv), d, distances);
    for (; hits != 0; hits &= hits - 1) {
      const uint32_t bit = std::countr_zero(hits);
      const Hit hit{distances[bit], id};
      Hit& best = packet_.hit[first + bit];
      if (!(hit < best)) continue;
      best = hit;
      if (hit.t < limit_of_[first + bit]) limit_of_[first + bit] = hit.t;
    }
  }

  void UpdateLimit() {
    const D d;
    V most = hn::Set(d, -std::numeric_limits<float>::infinity());
    for (uint32_t g = 0; g < groups_; ++g) {
      most = hn::Max(most, hn::Load(d, limit_of_ + g * hn::Lanes(d)));
    }
    limit_ = hn::GetLane(hn::MaxOfLanes(d, most));
  }

  const IndexedGeometry& scene_;
  RayPacket& packet_;
  WalkStats* stats_;
  uint32_t groups_ = 0;
  int live_ = 0;           // Lanes not yet blocked (any hit).
  bool has_sources_ = false;
  float limit_ = 0;        // No live lane looks beyond this.
  bool axis_usable_[3], axis_negative_[3];
  float inv_min_[3], inv_max_[3];
  uint32_t active_[kMaxRays / 8];
  alignas(64) float direction_[3][kMaxRays];
  alignas(64) float inv_[3][kMaxRays];
  alignas(64) float direction_inf_[kMaxRays];
  alignas(64) float limit_of_[kMaxRays];  // Per lane: nearest hit, or the segment's end; -inf when done.
};

template <bool kAny>
bool TracePacket(const IndexedGeometry& scene, RayPacket& packet, const CancelToken* cancel,
                 WalkStats* stats) {
  if (packet.count == 0) return true;
  PacketWalk<kAny> walk(scene, packet, stats);
  return walk.Run(cancel);
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard

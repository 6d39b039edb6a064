// SPDX-License-Identifier: Apache-2.0
//
// The shaft walk: up to 256 rays with one origin are one convex shaft, and one walk of the tree
// answers them all (paper 002 for shafts and relevant triangles; paper 000 for vertex culling).
// Unlike a packet's, a node's cost does not depend on the number of rays.
//
//  1. A node's eight boxes are put to the shaft's four sides and its far end.
//  2. A leaf's sixteen triangles are put to the same planes by their vertices; those left are
//  relevant.
//  3. A relevant triangle is put to sixteen blocks of sixteen rays at once, each with its own
//  rectangle of slopes and
//     range of depths, one block per SIMD lane: blocks it misses drop out; blocks it covers whole
//     and stands before are blocked without a ray tested; the rest take the exact test, ray by ray.
//  4. When any hit will do and a walk has cost too much, its rays are split at the middle of their
//  widest extent, and
//     both halves go on with what is left on the stack.
//
// All culls carry the margins of core/shaft/margins.h; what a cull keeps is decided by the exact
// predicate.

#if defined(SIGHTLINE_CORE_TRAVERSE_SHAFT_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_SHAFT_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_SHAFT_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_SHAFT_INL_H_
#endif

#include "core/base/cancel.h"
#include "core/shaft/frame.h"
#include "core/shaft/margins.h"
#include "core/traverse/packet-inl.h"
#include "core/traverse/packet_lanes-inl.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// Work (nodes + 2·leaves + relevant triangles) after which a walk's rays are split in two.
constexpr uint32_t kSplitBudget = 100;
// Sets this small are not split: their walk costs about what two halves would.
constexpr int kLeastSplitRays = 16;

template <bool kAny>
class ShaftWalk {
 public:
  ShaftWalk(const IndexedGeometry& scene, RayPacket& packet, WalkStats* stats)
      : scene_(scene), stats_(stats), lanes_(scene, packet, stats) {}

  // Finds the frame. False: the rays do not fit one (they spread too far around the origin, or have
  // no direction).
  bool MakeFrame() {
    Vec3d axis;
    for (int i = 0; i < lanes_.count(); ++i) {
      const Vec3d d = Direction(i);
      const double norm = MaxAbs(d);
      if (norm > 0) axis = axis + d * (1.0 / norm);
    }
    // Lanes 0 and 3 are neighbours in a row of a tile; points come as they come.
    const Vec3d sideways = Direction(std::min(3, lanes_.count() - 1)) - Direction(0);
    if (!MakeShaftFrame(axis, sideways, &frame_)) return false;
    return Project();
  }

  // Returns false if `cancel` fired. REQUIRES: MakeFrame() was true.
  bool Run(const CancelToken* cancel) {
    if (scene_.bvh.empty()) return true;
    cancel_ = cancel;
    RaySet all;
    for (int b = 0; b < kBlocks; ++b) {
      const int left = lanes_.count() - b * kBlockRays;
      all.rays[b] = left >= kBlockRays ? 0xFFFF
                    : left > 0         ? static_cast<uint16_t>((1u << left) - 1)
                                       : 0;
    }
    Pending stack[kBvhStackSize];
    stack[0] = {-std::numeric_limits<float>::infinity(), ChildRef::Inner(0).bits()};
    return Walk(all, stack, 1);
  }

 private:
  static constexpr int kBlocks = 16;
  static constexpr int kBlockRays = 16;
  static_assert(kBlocks * kBlockRays == RayPacket::kMaxRays);
  using D = hn::CappedTag<float, 16>;  // Sixteen rays, triangles or blocks.
  using V = hn::Vec<D>;

  struct RaySet {
    uint16_t rays[kBlocks];
  };
  struct Pending {  // Trivial: the stack is not initialized.
    float depth;
    uint32_t ref_bits;
  };
  struct Rect {
    float x0, x1, y0, y1;
  };
  // A relevant triangle's forms in frame coordinates: value at slopes (x, y) is f[0]·x + f[1]·y +
  // f[2].
  struct Form {
    float f[3], margin;
  };

  Vec3d Direction(int lane) const {
    return {lanes_.direction_row(0)[lane], lanes_.direction_row(1)[lane],
            lanes_.direction_row(2)[lane]};
  }

  // Depths and slopes of all rays.
  bool Project() {
    const D d;
    const Vec3V<V> u = Broadcast(d, frame_.u.x, frame_.u.y, frame_.u.z);
    const Vec3V<V> v = Broadcast(d, frame_.v.x, frame_.v.y, frame_.v.z);
    const Vec3V<V> w = Broadcast(d, frame_.w.x, frame_.w.y, frame_.w.z);
    const V share = hn::Set(d, kMinDepthShare * kMinDepthShare);
    const V least = hn::Set(d, kLeastDepth);
    bool fits = true;
    for (size_t i = 0; i < lanes_.groups() * hn::Lanes(d); i += hn::Lanes(d)) {
      const Vec3V<V> dir = {hn::Load(d, lanes_.direction_row(0) + i),
                            hn::Load(d, lanes_.direction_row(1) + i),
                            hn::Load(d, lanes_.direction_row(2) + i)};
      const V z = DotV(w, dir);
      // A square that underflows or overflows fails the test, and the rays go another way.
      const auto good =
          hn::And(hn::Ge(z, least), hn::Ge(hn::Mul(z, z), hn::Mul(share, DotV(dir, dir))));
      fits = fits && hn::AllTrue(d, good);
      hn::Store(z, d, depth_ + i);
      hn::Store(hn::Div(DotV(u, dir), z), d, slope_x_ + i);
      hn::Store(hn::Div(DotV(v, dir), z), d, slope_y_ + i);
    }
    return fits;
  }

  // Bounds the rays of `set` that are still asked about, block by block and together. Returns how
  // many there are.
  int Bound(const RaySet& set) {
    const D d;
    const V infinity = hn::Set(d, std::numeric_limits<float>::infinity());
    rect_ = {infinity_, -infinity_, infinity_, -infinity_};
    open_blocks_ = 0;
    far_ = -infinity_;
    int count = 0;
    for (int b = 0; b < kBlocks; ++b) {
      open_[b] = set.rays[b] & ActiveOf(b);
      block_mx_[b] = block_my_[b] = block_hx_[b] = block_hy_[b] = block_near_[b] = block_far_[b] =
          0;
      if (open_[b] == 0) continue;
      open_blocks_ |= 1u << b;
      count += std::popcount(open_[b]);
      V x0 = infinity, x1 = hn::Neg(infinity), y0 = x0, y1 = x1, z0 = x0, z1 = x1;
      for (size_t i = 0; i < kBlockRays; i += hn::Lanes(d)) {
        const uint8_t bits[8] = {static_cast<uint8_t>(open_[b] >> i),
                                 static_cast<uint8_t>(open_[b] >> (i + 8))};
        const auto in = hn::LoadMaskBits(d, bits);
        const size_t at = b * kBlockRays + i;
        const V x = hn::Load(d, slope_x_ + at), y = hn::Load(d, slope_y_ + at);
        x0 = hn::Min(x0, hn::IfThenElse(in, x, infinity));
        x1 = hn::Max(x1, hn::IfThenElse(in, x, hn::Neg(infinity)));
        y0 = hn::Min(y0, hn::IfThenElse(in, y, infinity));
        y1 = hn::Max(y1, hn::IfThenElse(in, y, hn::Neg(infinity)));
        const V z = hn::Load(d, depth_ + at);
        z0 = hn::Min(z0, hn::IfThenElse(in, z, infinity));
        z1 = hn::Max(z1, hn::IfThenElse(in, z, hn::Neg(infinity)));
      }
      const Rect r = {hn::GetLane(hn::MinOfLanes(d, x0)) - kSlopeMargin,
                      hn::GetLane(hn::MaxOfLanes(d, x1)) + kSlopeMargin,
                      hn::GetLane(hn::MinOfLanes(d, y0)) - kSlopeMargin,
                      hn::GetLane(hn::MaxOfLanes(d, y1)) + kSlopeMargin};
      // Half extents are taken a little large, so that centre ± half holds the rectangle after
      // rounding.
      block_mx_[b] = 0.5f * (r.x0 + r.x1);
      block_my_[b] = 0.5f * (r.y0 + r.y1);
      block_hx_[b] = 0.5f * (r.x1 - r.x0) + kSlopeMargin;
      block_hy_[b] = 0.5f * (r.y1 - r.y0) + kSlopeMargin;
      block_near_[b] = hn::GetLane(hn::MinOfLanes(d, z0));
      block_far_[b] =
          lanes_.segments() ? hn::GetLane(hn::MaxOfLanes(d, z1)) * kDepthScale : infinity_;
      rect_ = {std::min(rect_.x0, r.x0), std::max(rect_.x1, r.x1), std::min(rect_.y0, r.y0),
               std::max(rect_.y1, r.y1)};
      if constexpr (!kAny) UpdateFar(b);
      far_ = std::max(far_, block_far_[b]);
    }
    SetSide(0, frame_.u, -rect_.x0);
    SetSide(1, -frame_.u, rect_.x1);
    SetSide(2, frame_.v, -rect_.y0);
    SetSide(3, -frame_.v, rect_.y1);
    return count;
  }

  // A block's far end: nothing deeper matters to any of its rays.
  void UpdateFar(int b) {
    const D d;
    V most = hn::Set(d, -infinity_);
    for (size_t i = 0; i < kBlockRays; i += hn::Lanes(d)) {
      const size_t at = b * kBlockRays + i;
      if (at >= lanes_.groups() * hn::Lanes(d)) break;
      const uint8_t bits[8] = {static_cast<uint8_t>(open_[b] >> i),
                               static_cast<uint8_t>(open_[b] >> (i + 8))};
      const V limit = hn::Mul(hn::Load(d, lanes_.limit_row() + at), hn::Load(d, depth_ + at));
      most =
          hn::Max(most, hn::IfThenElse(hn::LoadMaskBits(d, bits), limit, hn::Set(d, -infinity_)));
    }
    block_far_[b] = hn::GetLane(hn::MaxOfLanes(d, most)) * kDepthScale;
  }

  void SetSide(int i, Vec3f across, float slope) {
    const Vec3f n = across + frame_.w * slope;
    for (int k = 0; k < 3; ++k) {
      side_[i][k] = n[k];
      side_far_[i][k] = n[k] >= 0 ? k + 3 : k;  // The face where the side's value is largest.
    }
  }

  uint32_t ActiveOf(int block) const {
    const D d;
    const uint32_t lanes = static_cast<uint32_t>(hn::Lanes(d));
    uint32_t active = 0;
    for (uint32_t i = 0; i < kBlockRays / lanes; ++i) {
      const uint32_t group = block * (kBlockRays / lanes) + i;
      if (group < lanes_.groups()) active |= lanes_.active(group) << (i * lanes);
    }
    return active;
  }

  // Returns false if cancelled.
  bool Walk(const RaySet& set, Pending* stack, int depth) {
    const int rays = Bound(set);
    if (rays == 0) return true;
    uint32_t work = 0;
    uint64_t visited = 0;
    while (depth > 0) {
      const Pending pending = stack[--depth];
      if (pending.depth > far_) continue;
      if (++visited % kPollInterval == 0 && cancel_ != nullptr && cancel_->cancelled())
        return false;
      const ChildRef ref = ChildRef::FromBits(pending.ref_bits);
      if (ref.is_leaf()) {
        work += 2 + VisitLeaf(ref);
        if (open_blocks_ == 0) return true;
      } else {
        ++work;
        depth = VisitNode(scene_.bvh.nodes[ref.node()], stack, depth);
      }
      if (work > kSplitBudget && rays >= 2 * kLeastSplitRays && depth > 0) {
        RaySet halves[2];
        if (!Split(halves)) {
          work = 0;  // All rays in one place: nothing to gain by parting them.
          continue;
        }
        Pending copy[kBvhStackSize];
        std::copy_n(stack, depth, copy);
        return Walk(halves[0], copy, depth) && Walk(halves[1], stack, depth);
      }
    }
    return true;
  }

  // Parts the open rays at the middle of their widest extent of slopes. False: one side would be
  // empty.
  bool Split(RaySet* halves) const {
    Rect now = {infinity_, -infinity_, infinity_, -infinity_};
    ForEachOpen([&](int lane) {
      now = {std::min(now.x0, slope_x_[lane]), std::max(now.x1, slope_x_[lane]),
             std::min(now.y0, slope_y_[lane]), std::max(now.y1, slope_y_[lane])};
    });
    const bool by_x = now.x1 - now.x0 >= now.y1 - now.y0;
    const float* slope = by_x ? slope_x_ : slope_y_;
    const float middle = by_x ? 0.5f * (now.x0 + now.x1) : 0.5f * (now.y0 + now.y1);
    halves[0] = halves[1] = RaySet{};
    int counts[2] = {0, 0};
    ForEachOpen([&](int lane) {
      const int half = slope[lane] > middle;
      ++counts[half];
      halves[half].rays[lane / kBlockRays] |= static_cast<uint16_t>(1u << (lane % kBlockRays));
    });
    return counts[0] > 0 && counts[1] > 0;
  }

  template <class Fn>
  void ForEachOpen(const Fn& fn) const {
    for (int b = 0; b < kBlocks; ++b) {
      for (uint32_t rest = open_[b]; rest != 0; rest &= rest - 1) {
        fn(b * kBlockRays + std::countr_zero(rest));
      }
    }
  }

  // Pushes the boxes that the shaft may meet, the nearest on top. Returns the new depth.
  int VisitNode(const BvhNode& node, Pending* stack, int depth) {
    ++stats_->nodes;
    const hn::CappedTag<float, kBvhWidth> d8;
    using V8 = hn::Vec<decltype(d8)>;
    HWY_ALIGN float faces[6][kBvhWidth];
    V8 reach = hn::Zero(d8);  // |far corner - o|_1.
    for (int k = 0; k < 3; ++k) {
      const V8 o = hn::Set(d8, lanes_.origin()[k]);
      const V8 lo = hn::Sub(hn::Load(d8, node.bounds[k]), o),
               hi = hn::Sub(hn::Load(d8, node.bounds[k + 3]), o);
      hn::Store(lo, d8, faces[k]);
      hn::Store(hi, d8, faces[k + 3]);
      reach = hn::Add(reach, hn::Max(hn::Abs(lo), hn::Abs(hi)));
    }
    const V8 margin = hn::Mul(reach, hn::Set(d8, kBoxMargin));
    V8 least = hn::Set(d8, infinity_);  // Over the sides, of the box's largest value.
    for (int i = 0; i < 4; ++i) {
      V8 value = hn::Mul(hn::Set(d8, side_[i][0]), hn::Load(d8, faces[side_far_[i][0]]));
      value = hn::MulAdd(hn::Set(d8, side_[i][1]), hn::Load(d8, faces[side_far_[i][1]]), value);
      value = hn::MulAdd(hn::Set(d8, side_[i][2]), hn::Load(d8, faces[side_far_[i][2]]), value);
      least = hn::Min(least, value);
    }
    V8 nearest = hn::Zero(d8);
    for (int k = 0; k < 3; ++k) {
      const float w = frame_.w[k];
      nearest = hn::MulAdd(hn::Set(d8, w), hn::Load(d8, faces[w >= 0 ? k : k + 3]), nearest);
    }
    nearest = hn::Sub(nearest, margin);
    const auto met = hn::And(hn::Ge(least, hn::Neg(margin)), hn::Le(nearest, hn::Set(d8, far_)));
    uint32_t bits = MaskBits(d8, met) & ((1u << node.child_count) - 1);
    HWY_ALIGN float depths[kBvhWidth];
    hn::Store(nearest, d8, depths);
    const int base = depth;
    for (; bits != 0; bits &= bits - 1) {
      const int i = std::countr_zero(bits);
      int at = depth++;
      while (at > base && stack[at - 1].depth < depths[i]) {
        stack[at] = stack[at - 1];
        --at;
      }
      stack[at] = {depths[i], node.child[i].bits()};
    }
    return depth;
  }

  // Returns the number of relevant triangles.
  uint32_t VisitLeaf(ChildRef ref) {
    ++stats_->leaves;
    const LeafView leaf(scene_.bvh, ref);
    const uint32_t relevant = CullVertices(leaf);
    if (relevant == 0) return 0;
    FacingTriangle facing[kMaxLeafTriangles];
    const uint32_t count = TurnTriangles(lanes_, leaf, relevant, facing);
    for (uint32_t i = 0; i < count && open_blocks_ != 0; ++i) TestBlocks(leaf, facing[i]);
    return count;
  }

  // The leaf's triangles that are not wholly outside one side of the shaft, nor beyond its end.
  uint32_t CullVertices(const LeafView& leaf) const {
    const D d;
    const Vec3V<V> o = Broadcast(d, lanes_.origin().x, lanes_.origin().y, lanes_.origin().z);
    const Vec3V<V> u = Broadcast(d, frame_.u.x, frame_.u.y, frame_.u.z);
    const Vec3V<V> v = Broadcast(d, frame_.v.x, frame_.v.y, frame_.v.z);
    const Vec3V<V> w = Broadcast(d, frame_.w.x, frame_.w.y, frame_.w.z);
    const V x0 = hn::Set(d, rect_.x0), x1 = hn::Set(d, rect_.x1), y0 = hn::Set(d, rect_.y0),
            y1 = hn::Set(d, rect_.y1);
    uint32_t relevant = 0;
    for (size_t first = 0; first < leaf.count; first += hn::Lanes(d)) {
      // Per side the largest value of the three vertices, margin included; the least depth
      // likewise. A closest hit's distance may leave an ill-conditioned triangle, but not its box
      // (hit.h): there the box's least depth counts.
      V left = hn::Set(d, -infinity_), right = left, below = left, above = left;
      V nearest = hn::Set(d, infinity_);
      Vec3V<V> lo = {nearest, nearest, nearest}, hi = {left, left, left};
      for (int corner = 0; corner < 3; ++corner) {
        const float* rows = leaf.rows + 3 * corner * leaf.stride + first;
        const Vec3V<V> p = SubV({hn::LoadU(d, rows), hn::LoadU(d, rows + leaf.stride),
                                 hn::LoadU(d, rows + 2 * leaf.stride)},
                                o);
        const V margin = hn::Mul(Norm1V(p), hn::Set(d, kBoxMargin));
        const V x = DotV(u, p), y = DotV(v, p), z = DotV(w, p);
        left = hn::Max(left, hn::Add(hn::NegMulAdd(x0, z, x), margin));
        right = hn::Max(right, hn::Add(hn::MulSub(x1, z, x), margin));
        below = hn::Max(below, hn::Add(hn::NegMulAdd(y0, z, y), margin));
        above = hn::Max(above, hn::Add(hn::MulSub(y1, z, y), margin));
        nearest = hn::Min(nearest, hn::Sub(z, margin));
        if constexpr (!kAny) {
          lo = {hn::Min(lo.x, p.x), hn::Min(lo.y, p.y), hn::Min(lo.z, p.z)};
          hi = {hn::Max(hi.x, p.x), hn::Max(hi.y, p.y), hn::Max(hi.z, p.z)};
        }
      }
      if constexpr (!kAny) {
        const Vec3V<V> near_corner = {frame_.w.x >= 0 ? lo.x : hi.x, frame_.w.y >= 0 ? lo.y : hi.y,
                                      frame_.w.z >= 0 ? lo.z : hi.z};
        const V reach = hn::Add(
            hn::Add(hn::Max(hn::Abs(lo.x), hn::Abs(hi.x)), hn::Max(hn::Abs(lo.y), hn::Abs(hi.y))),
            hn::Max(hn::Abs(lo.z), hn::Abs(hi.z)));
        nearest = hn::NegMulAdd(reach, hn::Set(d, kBoxMargin), DotV(w, near_corner));
      }
      const V least = hn::Min(hn::Min(left, right), hn::Min(below, above));
      const auto in = hn::And(hn::Ge(least, hn::Zero(d)), hn::Le(nearest, hn::Set(d, far_)));
      relevant |= MaskBits(d, in) << first;
    }
    return relevant & ((1u << leaf.count) - 1);
  }

  Form FormOf(const float* c, float bound) const {
    return {{c[0] * frame_.u.x + c[1] * frame_.u.y + c[2] * frame_.u.z,
             c[0] * frame_.v.x + c[1] * frame_.v.y + c[2] * frame_.v.z,
             c[0] * frame_.w.x + c[1] * frame_.w.y + c[2] * frame_.w.z},
            bound * (kEdgeMargin / kFloatUnits) + kEdgeUnderflow};
  }

  // One relevant triangle against all blocks; then against the rays of those it may touch.
  void TestBlocks(const LeafView& leaf, const FacingTriangle& t) {
    const D d;
    const Form edges[3] = {FormOf(t.edge[0], t.edge_bound[0]), FormOf(t.edge[1], t.edge_bound[1]),
                           FormOf(t.edge[2], t.edge_bound[2])};
    const Form plane = FormOf(t.normal, t.normal_bound);
    // Depth along the normal at which the plane stands, with rounding both ways.
    const V plane_lo = hn::Set(d, (t.depth - t.depth_bound) * (2.0f - kDepthScale));
    const V plane_hi = hn::Set(d, (t.depth + t.depth_bound) * kDepthScale);
    uint32_t touched = 0, covered = 0;
    for (size_t i = 0; i < kBlocks; i += hn::Lanes(d)) {
      const V mx = hn::Load(d, block_mx_ + i), my = hn::Load(d, block_my_ + i);
      const V hx = hn::Load(d, block_hx_ + i), hy = hn::Load(d, block_hy_ + i);
      V most = hn::Set(d, infinity_),
        least = most;  // Over the edges: of largest, of least values in the block.
      V centre, radius;
      for (const Form& e : edges) {
        Range(d, e, mx, my, hx, hy, &centre, &radius);
        most = hn::Min(most, hn::Add(centre, radius));
        least = hn::Min(least, hn::Sub(centre, radius));
      }
      auto in = hn::Ge(most, hn::Zero(d));
      auto cover = hn::Gt(least, hn::Zero(d));
      // The rays' rate of approach to the plane, per unit of depth.
      Range(d, plane, mx, my, hx, hy, &centre, &radius);
      const V fastest = hn::Add(centre, radius), slowest = hn::Sub(centre, radius);
      const V far = hn::Load(d, block_far_ + i);
      if constexpr (kAny) {
        if (lanes_.segments()) {
          // Some ray must reach the plane; all must pass it for a cover.
          in = hn::And(
              in, hn::And(hn::Gt(fastest, hn::Zero(d)), hn::Ge(hn::Mul(far, fastest), plane_lo)));
          const V near = hn::Mul(hn::Load(d, block_near_ + i), hn::Set(d, 2.0f - kDepthScale));
          cover = hn::And(cover, hn::And(hn::Gt(slowest, hn::Zero(d)),
                                         hn::Gt(hn::Mul(near, slowest), plane_hi)));
        }
      } else {
        // Where every ray certainly approaches, the plane quotient is good to a few float
        // roundings, and no hit on this triangle comes before plane / fastest. Elsewhere (grazing)
        // only the vertices' depths have a say.
        const auto certain = hn::Gt(slowest, hn::Zero(d));
        const auto beyond = hn::Lt(hn::Mul(far, fastest), plane_lo);
        in = hn::AndNot(hn::And(certain, beyond), in);
      }
      touched |= MaskBits(d, in) << i;
      covered |= MaskBits(d, hn::And(in, cover)) << i;
    }
    touched &= open_blocks_;
    const uint32_t id = leaf.id(t.lane);
    const uint32_t lanes = static_cast<uint32_t>(hn::Lanes(d)), per_block = kBlockRays / lanes;
    for (; touched != 0; touched &= touched - 1) {
      const int b = std::countr_zero(touched);
      uint32_t done = 0;
      for (uint32_t i = 0; i < per_block; ++i) {
        const uint32_t group = b * per_block + i;
        uint32_t asked = open_[b] >> (i * lanes) & ((1u << lanes) - 1);
        if (asked == 0) continue;
        if (kAny && (covered >> b & 1) != 0) {
          const uint32_t hits = asked & ~lanes_.SourceLanes(group, id);
          lanes_.Block(id, group, hits);
          done |= hits << (i * lanes);
        } else {
          done |= lanes_.Test(leaf, t, group, asked) << (i * lanes);
        }
      }
      if constexpr (kAny) {
        open_[b] &= ~done;
        if (open_[b] == 0) open_blocks_ &= ~(1u << b);
      } else {
        UpdateFar(b);
      }
    }
    if constexpr (!kAny) {
      V most = hn::Set(d, -infinity_);
      for (size_t i = 0; i < kBlocks; i += lanes) {
        const uint8_t bits[8] = {static_cast<uint8_t>(open_blocks_ >> i),
                                 static_cast<uint8_t>(open_blocks_ >> (i + 8))};
        most = hn::Max(most, hn::IfThenElse(hn::LoadMaskBits(d, bits), hn::Load(d, block_far_ + i),
                                            hn::Set(d, -infinity_)));
      }
      far_ = hn::GetLane(hn::MaxOfLanes(d, most));
    }
  }

  static HWY_INLINE void Range(D d, const Form& form, V mx, V my, V hx, V hy, V* centre,
                               V* radius) {
    *centre = hn::MulAdd(hn::Set(d, form.f[0]), mx,
                         hn::MulAdd(hn::Set(d, form.f[1]), my, hn::Set(d, form.f[2])));
    *radius = hn::MulAdd(hn::Set(d, std::abs(form.f[0])), hx,
                         hn::MulAdd(hn::Set(d, std::abs(form.f[1])), hy, hn::Set(d, form.margin)));
  }

  static constexpr float infinity_ = std::numeric_limits<float>::infinity();

  const IndexedGeometry& scene_;
  WalkStats* stats_;
  PacketLanes<kAny> lanes_;
  const CancelToken* cancel_ = nullptr;
  ShaftFrame frame_;
  // Of the set being walked:
  Rect rect_;
  float far_;               // Nothing deeper matters.
  uint32_t open_blocks_;    // Blocks with rays still asked about.
  uint32_t open_[kBlocks];  // These rays, per block.
  float side_[4][3];        // Normals, positive inside.
  int side_far_[4][3];
  alignas(64) float block_mx_[kBlocks], block_my_[kBlocks], block_hx_[kBlocks], block_hy_[kBlocks];
  alignas(64) float block_near_[kBlocks], block_far_[kBlocks];
  // Of all rays:
  alignas(64) float depth_[RayPacket::kMaxRays];
  alignas(64) float slope_x_[RayPacket::kMaxRays], slope_y_[RayPacket::kMaxRays];
};

// Rays that no frame holds walk as a packet.
template <bool kAny>
bool TraceShaft(const IndexedGeometry& scene, RayPacket& packet, const CancelToken* cancel,
                WalkStats* stats) {
  if (packet.count == 0) return true;
  ShaftWalk<kAny> walk(scene, packet, stats);
  if (!walk.MakeFrame()) return TracePacket<kAny>(scene, packet, cancel, stats);
  return walk.Run(cancel);
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard

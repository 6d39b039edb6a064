// SPDX-License-Identifier: Apache-2.0
//
// What all cuts have in common: opens the largest boxes that a convex set meets until there are as
// many as a ShaftCut holds.
//
// Thread safety: an opener is one thread's own.

#if defined(SIGHTLINE_CORE_TRAVERSE_CUT_OPENER_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_CUT_OPENER_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_CUT_OPENER_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_CUT_OPENER_INL_H_
#endif

#include <algorithm>
#include <bit>
#include <limits>

#include "core/base/compress-inl.h"
#include "core/traverse/shaft_cut.h"
#include "core/traverse/shaft_rays-inl.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// Children enough for rays of one direction, and for the hull of an area light and its points: more
// of them cost each packet more than they spare it.
constexpr uint32_t kFewCutChildren = 4 * kBvhWidth;

class CutOpener {
 public:
  // The set is what `sides` leave, and `wedges`, which may be null; `margin` is that of a box
  // (MeetsSides), and `along` the direction that children are ordered by. What lies behind one of
  // `caps` is left out. Sides, wedges and caps must outlive the opener.
  // There will be `most` children, a whole number of nodes' worth, at most.
  CutOpener(uint32_t most, const ShaftSides& sides, const ShaftWedges* wedges, const AxisCaps& caps,
            float margin, Vec3f along)
      : most_(most), sides_(sides), wedges_(wedges), caps_(caps), margin_(margin), along_(along) {}

  // Takes the node's children that the set may meet. REQUIRES: there is room for eight.
  void Open(const BvhNode& node) {
    const D d;
    auto met = hn::And(MeetsSides(node, sides_, margin_), hn::FirstN(d, node.child_count));
    if (wedges_ != nullptr) {
      met = hn::And(met, hn::Ge(WithinWedges(d, *wedges_, node.bounds), hn::Zero(d)));
    }
    met = hn::And(met, BeyondCaps(d, caps_, node.bounds));
    auto depth = hn::Zero(d);
    hn::Vec<D> size[3];
    for (int k = 0; k < 3; ++k) {
      const auto lo = hn::Load(d, node.bounds[k]), hi = hn::Load(d, node.bounds[k + 3]);
      depth = hn::MulAdd(hn::Set(d, along_[k]), along_[k] >= 0 ? lo : hi, depth);
      size[k] = hn::Sub(hi, lo);
      Append(lo, met, bounds_[k]);
      Append(hi, met, bounds_[k + 3]);
    }
    Append(depth, met, depth_);
    const auto area = hn::MulAdd(size[0], hn::Add(size[1], size[2]), hn::Mul(size[1], size[2]));
    const hn::RebindToUnsigned<D> du;
    static_assert(sizeof(ChildRef) == sizeof(uint32_t));
    const auto refs = hn::Load(du, reinterpret_cast<const uint32_t*>(node.child));
    static_assert(ChildRef::kLeafBit == 1u << 31, "a sign");
    Append(hn::IfNegativeThenElse(hn::BitCast(d, refs), hn::Set(d, kNotOpened), area), met, area_);
    hn::StoreU(CompressLanes(du, refs, hn::RebindMask(du, met)), du, refs_ + count_);
    count_ += static_cast<uint32_t>(hn::CountTrue(d, met));
  }

  // Takes a child, with the box around it, whatever the set meets. REQUIRES: there is room for it.
  void Take(ChildRef ref, const Box3f& box) {
    depth_[count_] = 0;
    for (int k = 0; k < 3; ++k) {
      bounds_[k][count_] = box.lo[k];
      bounds_[k + 3][count_] = box.hi[k];
      depth_[count_] += along_[k] * (along_[k] >= 0 ? box.lo[k] : box.hi[k]);
    }
    area_[count_] = kNotOpened;
    refs_[count_++] = ref.bits();
  }

  void OpenLargest(const Bvh& bvh) {
    const D d;
    while (count_ + kBvhWidth <= most_) {
      auto largest = hn::Set(d, kNotOpened);
      ForEachVector([&](size_t at, auto in) HWY_ATTR {
        largest = hn::Max(largest, hn::IfThenElse(in, hn::Load(D(), area_ + at), largest));
      });
      largest = hn::MaxOfLanes(d, largest);
      if (hn::GetLane(largest) < 0) break;
      const int i = std::countr_zero(LanesWhere(
          [&](size_t at) HWY_ATTR { return hn::Eq(hn::Load(D(), area_ + at), largest); }));
      const uint32_t node = ChildRef::FromBits(refs_[i]).node();
      Move(--count_, i);
      Open(bvh.nodes[node]);
    }
  }

  // Drops the leaves that `keeps` does not keep.
  template <class Keeps>
  void FilterLeaves(const Keeps& keeps) {
    uint32_t kept = 0;
    for (uint32_t i = 0; i < count_; ++i) {
      const ChildRef ref = ChildRef::FromBits(refs_[i]);
      if (ref.is_inner() || keeps(ref)) Move(i, kept++);
    }
    count_ = kept;
  }

  // Least depth first, or last. Each is put where as many as come before it say: no branch depends
  // on them.
  void Sort(bool descending) {
    const D d;
    const auto sign = descending ? hn::SignBit(d) : hn::Zero(d);
    ForEachVector([&](size_t at, auto) HWY_ATTR {
      hn::Store(hn::Xor(hn::Load(D(), depth_ + at), sign), D(), depth_ + at);
    });
    for (uint32_t i = 0; i < count_; ++i) {
      const auto own = hn::Set(d, depth_[i]);
      const uint64_t before =
          LanesWhere([&](size_t at) HWY_ATTR { return hn::Lt(hn::Load(D(), depth_ + at), own); });
      const uint64_t equal =
          LanesWhere([&](size_t at) HWY_ATTR { return hn::Eq(hn::Load(D(), depth_ + at), own); });
      order_[std::popcount(before | (equal & ((uint64_t{1} << i) - 1)))] = i;
    }
  }

  // REQUIRES: they were sorted.
  void Pack(ShaftCut* cut) const {
    cut->node_count = (count_ + kBvhWidth - 1) / kBvhWidth;
    for (uint32_t first = 0; first < count_; first += kBvhWidth) {
      BvhNode& node = cut->nodes[first / kBvhWidth];
      node.child_count = std::min<uint32_t>(kBvhWidth, count_ - first);
      for (uint32_t slot = 0; slot < node.child_count; ++slot) {
        const uint32_t i = order_[first + slot];
        for (int k = 0; k < 6; ++k) node.bounds[k][slot] = bounds_[k][i];
        node.child[slot] = ChildRef::FromBits(refs_[i]);
      }
      for (uint32_t slot = node.child_count; slot < kBvhWidth; ++slot) {
        for (int k = 0; k < 3; ++k) {
          node.bounds[k][slot] = std::numeric_limits<float>::infinity();
          node.bounds[k + 3][slot] = -std::numeric_limits<float>::infinity();
        }
        node.child[slot] = ChildRef::Empty();
      }
    }
  }

 private:
  using D = hn::CappedTag<float, kBvhWidth>;
  // A whole vector is stored at the end of a row.
  static constexpr size_t kRow = ShaftCut::kMaxChildren + kBvhWidth;
  static constexpr float kNotOpened = -1;  // A leaf's area.
  static_assert(ShaftCut::kMaxChildren <= 64, "a bit for each");

  HWY_INLINE void Append(hn::Vec<D> v, hn::Mask<D> chosen, float* row) const {
    hn::StoreU(CompressLanes(D(), v, chosen), D(), row + count_);
  }
  void Move(uint32_t from, uint32_t to) {
    for (auto& row : bounds_) row[to] = row[from];
    depth_[to] = depth_[from];
    area_[to] = area_[from];
    refs_[to] = refs_[from];
  }
  // fn(first lane, those that are children) for all of them, in vectors.
  template <class Fn>
  HWY_INLINE void ForEachVector(const Fn& fn) const {
    for (size_t at = 0; at < count_; at += kBvhWidth) fn(at, hn::FirstN(D(), count_ - at));
  }
  // Bit i: child i is where `where` says.
  template <class Where>
  HWY_INLINE uint64_t LanesWhere(const Where& where) const {
    uint64_t bits = 0;
    ForEachVector([&](size_t at, auto in)
                      HWY_ATTR { bits |= uint64_t{MaskBits(D(), hn::And(in, where(at)))} << at; });
    return bits;
  }

  const uint32_t most_;
  const ShaftSides& sides_;
  const ShaftWedges* const wedges_;
  const AxisCaps& caps_;
  const float margin_;
  const Vec3f along_;
  // By child.
  uint32_t count_ = 0;
  alignas(64) float bounds_[6][kRow];
  alignas(64) float depth_[kRow], area_[kRow];
  alignas(64) uint32_t refs_[kRow];
  uint32_t order_[ShaftCut::kMaxChildren];  // By place.
};

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard

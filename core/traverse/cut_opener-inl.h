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

#include "core/traverse/shaft_cut.h"
#include "core/traverse/shaft_rays-inl.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

class CutOpener {
 public:
  // The set is what `sides` leave, and `wedges`, which may be null; `margin` is that of a box
  // (MeetsSides), and `along` the direction that children are ordered by. What lies behind one of
  // `caps` is left out. Sides, wedges and caps must outlive the opener.
  CutOpener(const ShaftSide* sides, int side_count, const ShaftWedges* wedges, const AxisCaps& caps,
            float margin, Vec3f along)
      : sides_(sides),
        side_count_(side_count),
        wedges_(wedges),
        caps_(caps),
        margin_(margin),
        along_(along) {}

  // Takes the node's children that the set may meet. REQUIRES: there is room for eight.
  void Open(const BvhNode& node) {
    const hn::CappedTag<float, kBvhWidth> d8;
    auto met = MeetsSides(node, sides_, side_count_, margin_);
    if (wedges_ != nullptr) {
      met = hn::And(met, hn::Ge(WithinWedges(d8, *wedges_, node.bounds), hn::Zero(d8)));
    }
    met = hn::And(met, BeyondCaps(d8, caps_, node.bounds));
    uint32_t bits = MaskBits(d8, met) & ((1u << node.child_count) - 1);
    for (; bits != 0; bits &= bits - 1) {
      const int i = std::countr_zero(bits);
      Child& child = children_[count_++];
      child.ref_bits = node.child[i].bits();
      child.depth = 0;
      float size[3];
      for (int k = 0; k < 3; ++k) {
        child.bounds[k] = node.bounds[k][i];
        child.bounds[k + 3] = node.bounds[k + 3][i];
        size[k] = node.bounds[k + 3][i] - node.bounds[k][i];
        child.depth += along_[k] * (along_[k] >= 0 ? child.bounds[k] : child.bounds[k + 3]);
      }
      child.area = size[0] * size[1] + size[1] * size[2] + size[2] * size[0];
    }
  }

  void OpenLargest(const Bvh& bvh) {
    while (count_ + kBvhWidth <= ShaftCut::kMaxChildren) {
      uint32_t largest = count_;
      float area = -1;
      for (uint32_t i = 0; i < count_; ++i) {
        if (ChildRef::FromBits(children_[i].ref_bits).is_inner() && children_[i].area > area) {
          largest = i;
          area = children_[i].area;
        }
      }
      if (largest == count_) break;
      const uint32_t node = ChildRef::FromBits(children_[largest].ref_bits).node();
      children_[largest] = children_[--count_];
      Open(bvh.nodes[node]);
    }
  }

  // Drops the leaves that `keeps` does not keep.
  template <class Keeps>
  void FilterLeaves(const Keeps& keeps) {
    uint32_t kept = 0;
    for (uint32_t i = 0; i < count_; ++i) {
      const ChildRef ref = ChildRef::FromBits(children_[i].ref_bits);
      if (ref.is_inner() || keeps(ref)) children_[kept++] = children_[i];
    }
    count_ = kept;
  }

  // Least depth first, or last.
  void Sort(bool descending) {
    std::sort(children_, children_ + count_, [descending](const Child& a, const Child& b) {
      return descending ? a.depth > b.depth : a.depth < b.depth;
    });
  }

  void Pack(ShaftCut* cut) const {
    cut->node_count = (count_ + kBvhWidth - 1) / kBvhWidth;
    for (uint32_t i = 0; i < cut->node_count * kBvhWidth; ++i) {
      BvhNode& node = cut->nodes[i / kBvhWidth];
      const uint32_t slot = i % kBvhWidth;
      const bool used = i < count_;
      for (int k = 0; k < 6; ++k) {
        node.bounds[k][slot] = used    ? children_[i].bounds[k]
                               : k < 3 ? std::numeric_limits<float>::infinity()
                                       : -std::numeric_limits<float>::infinity();
      }
      node.child[slot] = used ? ChildRef::FromBits(children_[i].ref_bits) : ChildRef::Empty();
      if (used) node.child_count = slot + 1;
    }
  }

 private:
  struct Child {
    float depth, area;
    uint32_t ref_bits;
    float bounds[6];
  };

  const ShaftSide* const sides_;
  const int side_count_;
  const ShaftWedges* const wedges_;
  const AxisCaps& caps_;
  const float margin_;
  const Vec3f along_;
  uint32_t count_ = 0;
  Child children_[ShaftCut::kMaxChildren];
};

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard

// SPDX-License-Identifier: Apache-2.0
//
// Where the nodes and the leaves of a BVH lie. Fetches what a walk will visit, without a branch:
// which of the two that is cannot be foretold.
//
// Thread safety: plain values; the BVH must outlive them.

#if defined(SIGHTLINE_CORE_TRAVERSE_VISIT_FETCHER_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_VISIT_FETCHER_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_VISIT_FETCHER_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_VISIT_FETCHER_INL_H_
#endif

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <iterator>

#include "core/accel/bvh.h"
#include "hwy/cache_control.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {

constexpr size_t kCacheLine = 64;

// What a walk does next.
enum NextVisit : uint32_t { kVisitNode, kVisitLeaf, kVisitEnd };

class VisitFetcher {
 public:
  HWY_INLINE explicit VisitFetcher(const Bvh& bvh)
      : base_{reinterpret_cast<const char*>(bvh.nodes.data()),
              bvh.has_leaf_rows() ? reinterpret_cast<const char*>(bvh.leaves.data())
                                  : reinterpret_cast<const char*>(bvh.leaf_ids.data()),
              reinterpret_cast<const char*>(bvh.nodes.data())},
        bytes_{
            sizeof(BvhNode),
            bvh.has_leaf_rows() ? kUnitFloats * sizeof(float) : kUnitTriangles * sizeof(uint32_t),
            0},
        lines_(bvh.has_leaf_rows() ? &kRowLines : &kIdLines),
        leaves_are_far_(bvh.leaves.size() * sizeof(float) > kNearLeafBytes) {}

  // Whether a leaf's later lines, too, are worth asking for beforehand.
  HWY_INLINE bool leaves_are_far() const { return leaves_are_far_; }

  // A node, or as much of a leaf; at the end the root once more. Returns where it lies.
  HWY_INLINE const char* Fetch(NextVisit next, ChildRef ref) const {
    const char* const at = At(next, ref);
    for (size_t i = 0; i < sizeof(BvhNode); i += kCacheLine) hwy::Prefetch(at + i);
    return at;
  }
  // A node or a leaf, all of it. REQUIRES: not empty.
  HWY_INLINE void FetchAll(ChildRef ref) const {
    const NextVisit next = ref.is_leaf() ? kVisitLeaf : kVisitNode;
    const char* const at = At(next, ref);
    const size_t units[2] = {0, ref.leaf_units()};
    for (const uint16_t line : lines_->of[units[next]]) hwy::Prefetch(at + line);
  }
  // The rest of a leaf. Lines of one that has fewer are its last.
  HWY_INLINE void FetchRest(ChildRef leaf) const {
    const char* const at = At(kVisitLeaf, leaf);
    for (size_t i = sizeof(BvhNode) / kCacheLine; i < kMaxLines; ++i) {
      hwy::Prefetch(at + lines_->of[leaf.leaf_units()][i]);
    }
  }

 private:
  static constexpr size_t kMaxLeafBytes = kMaxLeafTriangles * kLeafRows * sizeof(float);
  // Up to here leaves stay in a cache whose latency a walk's other work hides.
  static constexpr size_t kNearLeafBytes = size_t{16} << 20;
  HWY_INLINE const char* At(NextVisit next, ChildRef ref) const {
    return base_[next] + size_t{ref.bits() & kNumber[next]} * bytes_[next];
  }

  static constexpr size_t kMaxLines = kMaxLeafBytes / kCacheLine + 1;
  // Where the lines of a leaf of so many units begin, or with none of them a node's; the last one
  // again where there are no more. In a table: GCC 12 finds eleven minima by vectors, and takes
  // these apart again, which comes to some fifty instructions more.
  struct Lines {
    uint16_t of[kMaxLeafTriangles / kUnitTriangles + 1][kMaxLines];
  };
  static constexpr Lines LinesOf(size_t unit_bytes) {
    Lines lines = {};
    for (size_t units = 0; units < std::size(lines.of); ++units) {
      const size_t last = (units == 0 ? sizeof(BvhNode) : units * unit_bytes) - 1;
      size_t at = 0;
      for (uint16_t& line : lines.of[units]) {
        line = static_cast<uint16_t>(std::min(at, last));
        at += kCacheLine;
      }
    }
    return lines;
  }
  static const Lines kRowLines, kIdLines;

  // The bits of a reference that are a node's number, a leaf's first unit, and nothing.
  static constexpr uint32_t kNumber[3] = {~ChildRef::kLeafBit, ChildRef::FromBits(~0u).leaf_unit(),
                                          0};

  const char* base_[3];
  size_t bytes_[3];
  const Lines* lines_;
  bool leaves_are_far_;
};

inline constexpr VisitFetcher::Lines VisitFetcher::kRowLines =
    VisitFetcher::LinesOf(kUnitFloats * sizeof(float));
inline constexpr VisitFetcher::Lines VisitFetcher::kIdLines =
    VisitFetcher::LinesOf(kUnitTriangles * sizeof(uint32_t));

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard

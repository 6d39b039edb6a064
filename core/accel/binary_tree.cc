// SPDX-License-Identifier: Apache-2.0
#include "core/accel/binary_tree.h"

#include <algorithm>
#include <atomic>
#include <bit>
#include <cstring>
#include <numeric>
#include <utility>
#include <vector>

#include "core/base/check.h"
#include "core/base/parallel.h"

namespace sightline::bvh_build {
namespace {

// Ranges of at least this many primitives are binned and partitioned in parallel, by chunks;
// smaller ones fit a second-level cache. Depends on the range alone, as every result must.
constexpr size_t kParallelRange = 1 << 16;
constexpr size_t kMinChunk = 1 << 14;
constexpr size_t kMaxChunks = 256;
// Subtrees of at least this many triangles are tasks of their own.
constexpr size_t kTaskTriangles = 1 << 11;
// Ranges of at least this many look whether they are to stop.
constexpr size_t kCancelTriangles = 1 << 10;
constexpr uint32_t kNodeBlock = 256;

struct Range {
  size_t begin = 0, end = 0;
  Box4 bounds, centroids;
  int buffer = 0;  // Which of the two holds the primitives.

  size_t size() const { return end - begin; }
};

// Nodes set aside for one task, so that tasks meet at the shared counter rarely.
struct NodeBlock {
  uint32_t next = 0, end = 0;
};

class Builder {
 public:
  Builder(AlignedVector<Primitive> primitives, const SahCost& cost,
          const BinaryTreeOptions& options, const CancelToken* cancel,
          const std::function<void(double)>& progress)
      : size_(primitives.size()),
        cost_(cost),
        options_(options),
        cancel_(cancel),
        progress_(progress) {
    // Blocks are taken by tasks; a task begins at a node with at least kTaskTriangles on either
    // side.
    const size_t blocks = 1 + size_ / kTaskTriangles + 2 * size_ / kNodeBlock + 1;
    tree_.nodes.ResizeUninitialized((blocks + 1) * kNodeBlock);
    tree_.ids.ResizeUninitialized(size_);
    buffer_[0] = std::move(primitives);
    buffer_[1].ResizeUninitialized(size_);
  }

  BinaryTree Build(const Box4& bounds, const Box4& centroids) {
    NodeBlock block;
    const uint32_t root = AllocatePair(block);
    SIGHTLINE_CHECK_EQ(root, 0u);
    BuildSubtree({0, size_, bounds, centroids, 0}, root, 1, block);
    return std::move(tree_);
  }

 private:
  uint32_t AllocatePair(NodeBlock& block) {
    if (block.next == block.end) {
      block.next = next_node_.fetch_add(kNodeBlock, std::memory_order_relaxed);
      block.end = block.next + kNodeBlock;
      SIGHTLINE_CHECK_LE(block.end, tree_.nodes.size());
    }
    return std::exchange(block.next, block.next + 2);
  }

  // Levels of inner nodes that median splits need below and at a range of n.
  int MedianLevels(size_t n) const {
    const size_t leaf = static_cast<size_t>(cost_.max_leaf_triangles);
    return std::bit_width((n + leaf - 1) / leaf - 1);
  }

  // `depth`: inner nodes on the path to here, and this node if it becomes one.
  // Keeps depth - 1 + MedianLevels(size) <= max_depth: so medians can always finish.
  void BuildSubtree(const Range& range, uint32_t node, int depth, NodeBlock& block) {
    BinaryNode& out = tree_.nodes[node];
    std::memcpy(out.lo, &range.bounds.lo, sizeof(out.lo));
    std::memcpy(out.hi, &range.bounds.hi, sizeof(out.hi));
    const size_t n = range.size();
    out.count = static_cast<uint32_t>(n);
    const float area = out.HalfArea(cost_.area_scale);
    const bool stop = n >= kCancelTriangles && cancel_ != nullptr && cancel_->cancelled();
    Range left, right;
    if (stop || n == 1 || !Split(range, area, depth, left, right)) {
      out.first = static_cast<uint32_t>(range.begin);
      out.wide.SetLeaf(area, out.count, cost_);
      const Primitive* const primitives = buffer_[range.buffer].data();
      for (size_t i = range.begin; i < range.end; ++i) tree_.ids[i] = primitives[i].id;
      return;
    }
    const uint32_t child = AllocatePair(block);
    out.first = child;
    if (std::min(left.size(), right.size()) >= kTaskTriangles) {
      ParallelInvoke([&] { BuildSubtree(left, child, depth + 1, block); },
                     [&] {
                       NodeBlock own;
                       BuildSubtree(right, child + 1, depth + 1, own);
                     });
    } else {
      BuildSubtree(left, child, depth + 1, block);
      BuildSubtree(right, child + 1, depth + 1, block);
    }
    out.wide.SetInner(area, out.count, tree_.nodes[child].wide, tree_.nodes[child + 1].wide, cost_);
    ReportProgress(n, left.size(), right.size());
  }

  // False if the range is to be a leaf.
  bool Split(const Range& range, float area, int depth, Range& left, Range& right) {
    const size_t n = range.size();
    const bool may_be_leaf = n <= static_cast<size_t>(cost_.max_leaf_triangles);
    if (depth + MedianLevels(n) <= options_.max_depth) {
      const BinMapping mapping(range.centroids, options_.bins, options_.longest_axis_only);
      if (mapping.CanSplit()) {
        const SahSplit split = FindSahSplit(range, mapping);
        if (split.axis >= 0) {
          if (may_be_leaf && split.cost >= area * cost_.Leaf(static_cast<uint32_t>(n)))
            return false;
          Partition(range, mapping, split, left, right);
          return true;
        }
      }
    }
    if (may_be_leaf) return false;
    SplitAtMedian(range, left, right);
    return true;
  }

  static size_t ChunkSize(size_t n) {
    return std::max(kMinChunk, (n + kMaxChunks - 1) / kMaxChunks);
  }
  std::span<const Primitive> PrimitivesOf(const Range& range) const {
    return {buffer_[range.buffer].data() + range.begin, range.size()};
  }

  // Not inlined: its bins would be on the stack of every level.
  __attribute__((noinline)) SahSplit FindSahSplit(const Range& range, const BinMapping& mapping) {
    const std::span<const Primitive> primitives = PrimitivesOf(range);
    const size_t n = range.size();
    SahBins bins(mapping.count());
    if (n < kParallelRange) {
      bins.Add(primitives, mapping);
      return FindSplit(bins, mapping, cost_);
    }
    const size_t chunk = ChunkSize(n);
    std::vector<SahBins> partial;
    partial.reserve((n + chunk - 1) / chunk);
    for (size_t i = 0; i < n; i += chunk) partial.emplace_back(mapping.count());
    ParallelFor(n, chunk, [&](size_t begin, size_t end) {
      partial[begin / chunk].Add(primitives.subspan(begin, end - begin), mapping);
    });
    for (const SahBins& p : partial) bins.Merge(p);
    return FindSplit(bins, mapping, cost_);
  }

  // Stable, so that the order of the primitives depends on nothing else.
  void Partition(const Range& range, const BinMapping& mapping, const SahSplit& split, Range& left,
                 Range& right) {
    const size_t middle = range.begin + split.left_count;
    left = {range.begin, middle, split.left, {}, range.buffer};
    right = {middle, range.end, split.right, {}, range.buffer};
    if (range.size() < kParallelRange) {
      PartitionInPlace(range, mapping, split, left.centroids, right.centroids);
    } else {
      PartitionToOther(range, mapping, split, left.centroids, right.centroids);
      left.buffer = right.buffer = 1 - range.buffer;
    }
  }

  // Adds a centroid to the side that it is on, without a branch.
  static void AddCentroid(const Primitive& p, bool is_left, Box4& left, Box4& right) {
    const Float4 c = p.centroid();
    const int32_t bits = -static_cast<int32_t>(is_left);
    const Int4 mask{bits, bits, bits, bits};
    const Box4 none;
    left.lo = Min(left.lo, mask ? c : none.lo);
    left.hi = Max(left.hi, mask ? c : none.hi);
    right.lo = Min(right.lo, mask ? none.lo : c);
    right.hi = Max(right.hi, mask ? none.hi : c);
  }

  void PartitionInPlace(const Range& range, const BinMapping& mapping, const SahSplit& split,
                        Box4& left_centroids, Box4& right_centroids) {
    Primitive* const primitives = buffer_[range.buffer].data() + range.begin;
    Primitive* const set_aside = buffer_[1 - range.buffer].data() + range.begin;
    Box4 left, right;
    size_t left_count = 0, right_count = 0;
    for (size_t i = 0; i < range.size(); ++i) {
      const Primitive p = primitives[i];
      const bool is_left = mapping.BinOf(p, split.axis) < split.bin;
      AddCentroid(p, is_left, left, right);
      primitives[left_count] = p;
      set_aside[right_count] = p;
      left_count += is_left ? 1 : 0;
      right_count += is_left ? 0 : 1;
    }
    SIGHTLINE_CHECK_EQ(left_count, split.left_count);
    std::memcpy(primitives + left_count, set_aside, right_count * sizeof(Primitive));
    left_centroids = left;
    right_centroids = right;
  }

  void PartitionToOther(const Range& range, const BinMapping& mapping, const SahSplit& split,
                        Box4& left_centroids, Box4& right_centroids) {
    struct Chunk {
      size_t left = 0, right = 0;  // Counts, then the places in the other buffer.
      Box4 left_centroids, right_centroids;
    };
    const std::span<const Primitive> source = PrimitivesOf(range);
    Primitive* const target = buffer_[1 - range.buffer].data() + range.begin;
    const size_t n = range.size(), size = ChunkSize(n);
    std::vector<Chunk> chunks((n + size - 1) / size);
    ParallelFor(n, size, [&](size_t begin, size_t end) {
      Chunk& chunk = chunks[begin / size];
      size_t count = 0;
      for (size_t i = begin; i < end; ++i) {
        count += mapping.BinOf(source[i], split.axis) < split.bin ? 1 : 0;
      }
      chunk.left = count;
      chunk.right = end - begin - count;
    });
    size_t left = 0, right = split.left_count;
    for (Chunk& chunk : chunks) {
      left += std::exchange(chunk.left, left);
      right += std::exchange(chunk.right, right);
    }
    SIGHTLINE_CHECK_EQ(left, split.left_count);
    ParallelFor(n, size, [&](size_t begin, size_t end) {
      Chunk& chunk = chunks[begin / size];
      for (size_t i = begin; i < end; ++i) {
        const Primitive& p = source[i];
        const bool is_left = mapping.BinOf(p, split.axis) < split.bin;
        AddCentroid(p, is_left, chunk.left_centroids, chunk.right_centroids);
        target[is_left ? chunk.left++ : chunk.right++] = p;
      }
    });
    for (const Chunk& chunk : chunks) {
      left_centroids.Extend(chunk.left_centroids);
      right_centroids.Extend(chunk.right_centroids);
    }
  }

  // Halves the range, in whole leaves, along the widest axis of its centroids; in the order that it
  // has where they all coincide.
  void SplitAtMedian(const Range& range, Range& left, Range& right) {
    const size_t leaf = static_cast<size_t>(cost_.max_leaf_triangles);
    const size_t leaves = (range.size() + leaf - 1) / leaf;
    const size_t middle = range.begin + leaves / 2 * leaf;
    const Float4 extent = range.centroids.hi - range.centroids.lo;
    int axis = 0;
    for (int i = 1; i < 3; ++i) axis = extent[i] > extent[axis] ? i : axis;
    Primitive* const primitives = buffer_[range.buffer].data();
    if (extent[axis] > 0) {
      std::nth_element(primitives + range.begin, primitives + middle, primitives + range.end,
                       [axis](const Primitive& a, const Primitive& b) {
                         const float x = a.centroid(axis), y = b.centroid(axis);
                         return x < y || (x == y && a.id < b.id);
                       });
    }
    left = {range.begin, middle, {}, {}, range.buffer};
    right = {middle, range.end, {}, {}, range.buffer};
    for (Range* side : {&left, &right}) {
      for (size_t i = side->begin; i < side->end; ++i) {
        side->bounds.Extend(primitives[i]);
        side->centroids.Extend(primitives[i].centroid());
      }
    }
  }

  // Counts the triangles of a subtree that its large children, done before, have not counted.
  void ReportProgress(size_t n, size_t left, size_t right) {
    if (!progress_ || n < kTaskTriangles) return;
    const size_t more =
        n - (left >= kTaskTriangles ? left : 0) - (right >= kTaskTriangles ? right : 0);
    const size_t before = placed_.fetch_add(more, std::memory_order_relaxed);
    if (100 * before / size_ != 100 * (before + more) / size_) {
      progress_(static_cast<double>(before + more) / static_cast<double>(size_));
    }
  }

  const size_t size_;
  const SahCost& cost_;
  const BinaryTreeOptions& options_;
  const CancelToken* const cancel_;
  const std::function<void(double)>& progress_;
  AlignedVector<Primitive> buffer_[2];
  std::atomic<uint32_t> next_node_{0};
  std::atomic<size_t> placed_{0};
  BinaryTree tree_;
};

}  // namespace

BinaryTree BuildBinaryTree(AlignedVector<Primitive> primitives, const Box4& bounds,
                           const Box4& centroids, const SahCost& cost,
                           const BinaryTreeOptions& options, const CancelToken* cancel,
                           const std::function<void(double)>& progress) {
  SIGHTLINE_CHECK(!primitives.empty());
  return Builder(std::move(primitives), cost, options, cancel, progress).Build(bounds, centroids);
}

}  // namespace sightline::bvh_build

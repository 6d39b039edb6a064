// SPDX-License-Identifier: Apache-2.0
#include "core/accel/range_builder.h"

#include <algorithm>
#include <bit>
#include <cstring>
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
// Ranges of at least this many look whether they are to stop.
constexpr size_t kCancelTriangles = 1 << 10;
constexpr uint32_t kNodeBlock = 256;
// Few primitives need few bins: they are about as many as the planes between them.
constexpr size_t kFewBins = 4, kTrianglesPerBin = 4;

size_t ChunkSize(size_t n) { return std::max(kMinChunk, (n + kMaxChunks - 1) / kMaxChunks); }

// Where a split sends primitives: to the next place of either side, with the centroids' boxes.
struct Sides {
  Primitive* target;
  size_t left = 0, right = 0;  // Next places.
  BuildBox left_centroids, right_centroids;

  // Without a branch, for which side a primitive is on cannot be predicted; and not inlined, so
  // that the boxes stay in registers.
  __attribute__((noinline)) void Add(std::span<const Primitive> source, const BinMapping& mapping,
                                     const SahSplit& split) {
    const BinMapping::Plane plane(mapping, split.axis, split.bin);
    const Float8 empty = BuildBox().faces;
    Float8 left_faces = left_centroids.faces, right_faces = right_centroids.faces;
    size_t to_left = left, to_right = right;
    Primitive* const out = target;
    for (const Primitive& p : source) {
      const Int8 is_left = plane.IsBelow(p);
      const Float8 c = p.centroid();
      left_faces = Min(left_faces, is_left ? c : empty);
      right_faces = Min(right_faces, is_left ? empty : c);
      const size_t goes_left = static_cast<size_t>(static_cast<int64_t>(is_left[0]));  // All ones.
      out[to_right ^ ((to_left ^ to_right) & goes_left)] = Primitive(p.box());
      to_left -= goes_left;
      to_right += goes_left + 1;
    }
    left_centroids.faces = left_faces;
    right_centroids.faces = right_faces;
    left = to_left;
    right = to_right;
  }
};

void PartitionInChunks(std::span<const Primitive> source, Primitive* target,
                       const BinMapping& mapping, const SahSplit& split, Sides& sides) {
  const size_t n = source.size(), size = ChunkSize(n);
  std::vector<Sides> chunks((n + size - 1) / size);
  ParallelFor(n, size, [&](size_t begin, size_t end) {
    size_t count = 0;
    for (size_t i = begin; i < end; ++i) {
      count += mapping.BinOf(source[i], split.axis) < split.bin ? 1 : 0;
    }
    chunks[begin / size].left = count;
    chunks[begin / size].right = end - begin - count;
  });
  for (Sides& chunk : chunks) {
    chunk.target = target;
    sides.left += std::exchange(chunk.left, sides.left);
    sides.right += std::exchange(chunk.right, sides.right);
  }
  ParallelFor(n, size, [&](size_t begin, size_t end) {
    chunks[begin / size].Add(source.subspan(begin, end - begin), mapping, split);
  });
  for (const Sides& chunk : chunks) {
    sides.left_centroids.Extend(chunk.left_centroids);
    sides.right_centroids.Extend(chunk.right_centroids);
  }
}

}  // namespace

RangeBuilder::RangeBuilder(BinaryTree& tree, size_t triangles, size_t tasks, const SahCost& cost,
                           const BinaryTreeOptions& options, const CancelToken* cancel,
                           const std::function<void(double)>& progress)
    : tree_(tree),
      triangles_(triangles),
      cost_(cost),
      options_(options),
      cancel_(cancel),
      progress_(progress) {
  // Blocks are taken by tasks; inner tasks begin at a node with at least kTaskTriangles on either
  // side.
  const size_t blocks = tasks + triangles / kTaskTriangles + 2 * triangles / kNodeBlock + 1;
  tree_.nodes = SparseArray<BinaryNode>((blocks + 1) * kNodeBlock);
}

uint32_t RangeBuilder::AllocatePair(NodeBlock& block) {
  if (block.next == block.end) {
    block.next = next_node_.fetch_add(kNodeBlock, std::memory_order_relaxed);
    block.end = block.next + kNodeBlock;
    SIGHTLINE_CHECK_LE(block.end, tree_.nodes.size());
  }
  return std::exchange(block.next, block.next + 2);
}

int RangeBuilder::MedianLevels(size_t n) const {
  const size_t leaf = static_cast<size_t>(cost_.max_leaf_triangles);
  return std::bit_width((n + leaf - 1) / leaf - 1);
}

// Keeps depth - 1 + MedianLevels(size) <= max_depth: so medians can always finish.
void RangeBuilder::Build(const Buffers& buffers, const Range& range, uint32_t node, int depth,
                         NodeBlock& block) {
  BinaryNode& out = tree_.nodes[node];
  const size_t n = range.size();
  out.SetBox(range.bounds);
  out.count = static_cast<uint32_t>(n);
  if (options_.cells && n <= kCellTriangles && n > static_cast<size_t>(cost_.max_leaf_triangles) &&
      BuildByCells(buffers, range, node, depth, block)) {
    return;
  }
  const float area = out.HalfArea(cost_.area_scale);
  const bool stop = n >= kCancelTriangles && cancelled();
  Range left, right;
  if (stop || n == 1 || !Split(buffers, range, area, depth, left, right)) {
    out.first = buffers.first_id + static_cast<uint32_t>(range.begin);
    out.wide.SetLeaf(area, out.count, cost_);
    const Primitive* const primitives = buffers.primitives[range.buffer];
    for (size_t i = range.begin; i < range.end; ++i) buffers.ids[i] = primitives[i].id;
    return;
  }
  const uint32_t child = AllocatePair(block);
  if (std::min(left.size(), right.size()) >= kTaskTriangles) {
    ParallelInvoke([&] { Build(buffers, left, child, depth + 1, block); },
                   [&] {
                     NodeBlock own;
                     Build(buffers, right, child + 1, depth + 1, own);
                   });
  } else {
    Build(buffers, left, child, depth + 1, block);
    Build(buffers, right, child + 1, depth + 1, block);
  }
  SetInner(node, child);
  if (progress_ && n >= kTaskTriangles) {
    // Large children have counted theirs.
    ReportPlaced(n - (left.size() >= kTaskTriangles ? left.size() : 0) -
                 (right.size() >= kTaskTriangles ? right.size() : 0));
  }
}

void RangeBuilder::SetInner(uint32_t node, uint32_t child) {
  BinaryNode& out = tree_.nodes[node];
  out.first = child;
  out.wide.SetInner(out.HalfArea(cost_.area_scale), out.count, tree_.nodes[child].wide,
                    tree_.nodes[child + 1].wide, cost_);
}

void RangeBuilder::ReportPlaced(size_t more) {
  if (!progress_) return;
  const size_t before = placed_.fetch_add(more, std::memory_order_relaxed);
  if (100 * before / triangles_ != 100 * (before + more) / triangles_) {
    progress_(static_cast<double>(before + more) / static_cast<double>(triangles_));
  }
}

// False if the range is to be a leaf.
bool RangeBuilder::Split(const Buffers& buffers, const Range& range, float area, int depth,
                         Range& left, Range& right) const {
  const size_t n = range.size();
  const bool may_be_leaf = n <= static_cast<size_t>(cost_.max_leaf_triangles);
  if (may_be_leaf && options_.full_leaves) return false;
  if (depth + MedianLevels(n) <= options_.max_depth) {
    const int bins = static_cast<int>(
        std::min<size_t>(static_cast<size_t>(options_.bins), kFewBins + n / kTrianglesPerBin));
    const BinMapping mapping(range.centroids, bins, options_.longest_axis_only);
    if (mapping.CanSplit()) {
      const std::span<const Primitive> source(buffers.primitives[range.buffer] + range.begin, n);
      const SahSplit split = FindSahSplit(
          source, mapping, options_.longest_axis_only ? range.centroids.widest_axis() : -1);
      if (split.axis >= 0) {
        if (may_be_leaf && split.cost >= area * cost_.Leaf(static_cast<uint32_t>(n))) return false;
        Sides sides{
            buffers.primitives[1 - range.buffer] + range.begin, 0, split.left_count, {}, {}};
        if (n < kParallelRange) {
          sides.Add(source, mapping, split);
        } else {
          PartitionInChunks(source, sides.target, mapping, split, sides);
        }
        const size_t middle = range.begin + split.left_count;
        left = {range.begin, middle, split.left, sides.left_centroids, 1 - range.buffer};
        right = {middle, range.end, split.right, sides.right_centroids, 1 - range.buffer};
        return true;
      }
    }
  }
  if (may_be_leaf) return false;
  SplitAtMedian(buffers, range, left, right);
  return true;
}

// Not inlined: its bins would be on the stack of every level.
__attribute__((noinline)) SahSplit RangeBuilder::FindSahSplit(std::span<const Primitive> primitives,
                                                              const BinMapping& mapping,
                                                              int single_axis) const {
  const auto add = [&](std::span<const Primitive> some, SahBins& bins) {
    if (single_axis >= 0) {
      bins.AddAxis(some, mapping, single_axis);
    } else {
      bins.Add(some, mapping);
    }
  };
  const size_t n = primitives.size();
  SahBins bins(mapping.count());
  if (n < kParallelRange) {
    add(primitives, bins);
    return FindSplit(bins, mapping, cost_);
  }
  const size_t chunk = ChunkSize(n);
  std::vector<SahBins> partial;
  partial.reserve((n + chunk - 1) / chunk);
  for (size_t i = 0; i < n; i += chunk) partial.emplace_back(mapping.count());
  ParallelFor(n, chunk, [&](size_t begin, size_t end) {
    add(primitives.subspan(begin, end - begin), partial[begin / chunk]);
  });
  for (const SahBins& p : partial) bins.Merge(p);
  return FindSplit(bins, mapping, cost_);
}

// Halves the range, in whole leaves, along the widest axis of its centroids; in the order that it
// has where they all coincide.
void RangeBuilder::SplitAtMedian(const Buffers& buffers, const Range& range, Range& left,
                                 Range& right) const {
  const size_t leaf = static_cast<size_t>(cost_.max_leaf_triangles);
  const size_t leaves = (range.size() + leaf - 1) / leaf;
  const size_t middle = range.begin + leaves / 2 * leaf;
  const int axis = range.centroids.widest_axis();
  Primitive* const primitives = buffers.primitives[range.buffer];
  if (range.centroids.extent(axis) > 0) {
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

}  // namespace sightline::bvh_build

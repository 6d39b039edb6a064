// SPDX-License-Identifier: Apache-2.0
//
// The binary tree with its upper part built over the cells of a grid: triangles are counted into
// cells by their centroids, with a box and a number per cell; the surface area heuristic, with the
// grid's lines for planes, divides the cells; and where few enough triangles are left, their cells
// together are a bucket, which is built as every range is. So a triangle is read twice, and its
// number moved once, for what would be ten levels of binning and moving its box.
//
// Where a scene's triangles stand in few cells, buckets are large, and all is as without a grid.
#include <algorithm>
#include <array>
#include <bit>
#include <limits>
#include <utility>
#include <vector>

#include "core/accel/binary_tree.h"
#include "core/accel/cell_grid.h"
#include "core/accel/range_builder.h"
#include "core/base/check.h"
#include "core/base/parallel.h"

namespace sightline::bvh_build {
namespace {

// Cells: some for each few triangles, no more than tables for them fit a second-level cache.
constexpr int kTrianglesPerCellBits = 7;
// Fixed by the number of triangles alone: few of them come in four, many in 32. Each has a table of
// the cells.
constexpr size_t kLeastChunk = 1 << 11, kSmallChunk = 1 << 14;
constexpr size_t kFewChunks = 4, kMaxChunks = 32;
size_t ChunkSize(size_t triangles) {
  return std::max(std::clamp(triangles / kFewChunks, kLeastChunk, kSmallChunk),
                  (triangles + kMaxChunks - 1) / kMaxChunks);
}
// A bucket is as many cells as hold up to this many triangles, or one cell: two copies of its
// primitives fit a second-level cache, and there are enough for threads to share them evenly.
constexpr size_t kBucketTriangles = 1 << 9;
constexpr size_t kBucketGrain = 4;
// Below this depth cells are halved without regard to cost, so that no path becomes long.
constexpr int kMaxCostDepth = 20;
static_assert(kMaxCostDepth + kMaxCellBits + 31 <= kMinDepthBound);  // 31: median levels of 2^31.
constexpr uint16_t kNoCell = 0xFFFF;
static_assert(1 << kMaxCellBits <= kNoCell);

struct Bucket {
  uint32_t node;
  int depth;
  CellSum sum;
  uint32_t first = 0;  // In the tree's ids.
};

struct InnerNode {
  uint32_t node, child;
};

Float4 Doubled(Vec3f v) { return Float4{2 * v.x, 2 * v.y, 2 * v.z, 0}; }
int CellBits(size_t triangles) {
  return std::clamp(static_cast<int>(std::bit_width(triangles)) - kTrianglesPerCellBits, 0,
                    kMaxCellBits);
}

class GridTreeBuilder {
 public:
  GridTreeBuilder(const SceneGeometry& geometry, const SahCost& cost,
                  const BinaryTreeOptions& options, const CancelToken* cancel,
                  const std::function<void(double)>& progress)
      : geometry_(geometry),
        cost_(cost),
        cancel_(cancel),
        triangles_(geometry.triangles.size()),
        live_(triangles_ - geometry.inert.size()),
        grid_(Doubled(geometry.bounds.lo), Doubled(geometry.bounds.hi), CellBits(live_)),
        chunk_(ChunkSize(triangles_)),
        // Every bucket but the large ones holds more than half a bucket together with its sibling.
        builder_(tree_, live_, grid_.cells(), cost, options, cancel, progress) {
    tree_.ids.ResizeUninitialized(live_);
  }

  BinaryTree Build() {
    CountCells();
    if (Cancelled()) return std::move(tree_);
    std::vector<Cell> cells = SumCells();
    RangeBuilder::NodeBlock block;
    const uint32_t root = builder_.AllocatePair(block);
    SIGHTLINE_CHECK_EQ(root, 0u);
    bucket_of_cell_.resize(grid_.cells());
    Divide(cells, root, 1, block);
    PlaceIds();
    if (Cancelled()) return std::move(tree_);
    ParallelFor(
        buckets_.size(), kBucketGrain,
        [this](size_t begin, size_t end) { BuildBuckets(begin, end); }, cancel_);
    if (Cancelled()) return std::move(tree_);
    // Children were divided after their parents.
    for (size_t i = inner_.size(); i-- > 0;) builder_.SetInner(inner_[i].node, inner_[i].child);
    return std::move(tree_);
  }

 private:
  bool Cancelled() const { return cancel_ != nullptr && cancel_->cancelled(); }
  size_t chunks() const { return (triangles_ + chunk_ - 1) / chunk_; }

  // Which cell every triangle belongs to, and what is in each cell, by chunks.
  void CountCells() {
    cell_of_.ResizeUninitialized(triangles_);
    sums_.resize(chunks());
    ParallelFor(
        triangles_, chunk_,
        [this](size_t begin, size_t end) {
          AlignedVector<CellSum>& sums = sums_[begin / chunk_];
          sums.resize(grid_.cells());
          const AlignedVector<uint32_t>& inert = geometry_.inert;
          auto skip = std::lower_bound(inert.begin(), inert.end(), begin);
          for (size_t id = begin; id < end; ++id) {
            if (skip != inert.end() && *skip == id) {
              ++skip;
              cell_of_[id] = kNoCell;
              continue;
            }
            const Primitive p = MakePrimitive(geometry_, static_cast<uint32_t>(id));
            const uint32_t cell = grid_.CellOf(p);
            cell_of_[id] = static_cast<uint16_t>(cell);
            sums[cell].Extend(p);
          }
        },
        cancel_);
  }

  // The cells that hold triangles.
  std::vector<Cell> SumCells() const {
    std::vector<Cell> cells;
    for (uint32_t i = 0; i < grid_.cells(); ++i) {
      Cell cell;
      for (const auto& sums : sums_) cell.Extend(sums[i]);
      if (cell.count == 0) continue;
      cell.index = static_cast<uint16_t>(i);
      cell.place = grid_.Place(i);
      cells.push_back(cell);
    }
    return cells;
  }

  // Makes `node` a bucket, or an inner node over two halves of the cells.
  void Divide(std::span<Cell> cells, uint32_t node, int depth, RangeBuilder::NodeBlock& block) {
    CellSum sum;
    for (const Cell& cell : cells) sum.Extend(cell);
    BinaryNode& out = tree_.nodes[node];
    out.SetBox(sum.bounds);
    out.count = sum.count;
    if (sum.count <= kBucketTriangles || cells.size() == 1) {
      for (const Cell& cell : cells) {
        bucket_of_cell_[cell.index] = static_cast<uint16_t>(buckets_.size());
      }
      buckets_.push_back({.node = node, .depth = depth, .sum = sum});
      return;
    }
    const size_t left = PartitionCells(
        cells, depth < kMaxCostDepth ? CheapestLine(cells, cost_) : MiddleLine(cells));
    const uint32_t child = builder_.AllocatePair(block);
    inner_.push_back({node, child});
    Divide(cells.first(left), child, depth + 1, block);
    Divide(cells.subspan(left), child + 1, depth + 1, block);
  }

  // Each bucket's triangles together, in the order of their ids.
  void PlaceIds() {
    uint32_t first = 0;
    for (Bucket& bucket : buckets_) first += std::exchange(bucket.first, first) + bucket.sum.count;
    // Where each chunk puts its first triangle of each bucket.
    std::vector<std::vector<uint32_t>> places(chunks());
    std::vector<uint32_t> next(buckets_.size());
    for (size_t b = 0; b < buckets_.size(); ++b) next[b] = buckets_[b].first;
    for (size_t chunk = 0; chunk < chunks(); ++chunk) {
      places[chunk] = next;
      for (size_t cell = 0; cell < grid_.cells(); ++cell) {
        next[bucket_of_cell_[cell]] += sums_[chunk][cell].count;
      }
    }
    ParallelFor(
        triangles_, chunk_,
        [&](size_t begin, size_t end) {
          std::vector<uint32_t>& place = places[begin / chunk_];
          for (size_t id = begin; id < end; ++id) {
            if (cell_of_[id] == kNoCell) continue;
            tree_.ids[place[bucket_of_cell_[cell_of_[id]]]++] = static_cast<uint32_t>(id);
          }
        },
        cancel_);
  }

  void BuildBuckets(size_t begin, size_t end) {
    AlignedVector<Primitive> buffers[2];
    RangeBuilder::NodeBlock block;
    for (size_t b = begin; b < end; ++b) {
      const Bucket& bucket = buckets_[b];
      const size_t n = bucket.sum.count;
      uint32_t* const ids = &tree_.ids[bucket.first];
      for (auto& buffer : buffers) buffer.ResizeUninitialized(n);
      RangeBuilder::Range range{.end = n, .bounds = bucket.sum.bounds};
      for (size_t i = 0; i < n; ++i) {
        buffers[0][i] = MakePrimitive(geometry_, ids[i]);
        range.centroids.Extend(buffers[0][i].centroid());
      }
      builder_.Build({{buffers[0].data(), buffers[1].data()}, ids, bucket.first}, range,
                     bucket.node, bucket.depth, block);
      if (n < RangeBuilder::kTaskTriangles) builder_.ReportPlaced(n);
    }
  }

  const SceneGeometry& geometry_;
  const SahCost& cost_;
  const CancelToken* const cancel_;
  const size_t triangles_, live_;
  const CellGrid grid_;
  const size_t chunk_;
  BinaryTree tree_;
  RangeBuilder builder_;
  AlignedVector<uint16_t> cell_of_;           // By triangle.
  std::vector<AlignedVector<CellSum>> sums_;  // By chunk and cell.
  std::vector<uint16_t> bucket_of_cell_;
  std::vector<Bucket> buckets_;
  std::vector<InnerNode> inner_;
};

}  // namespace

BinaryTree BuildGridTree(const SceneGeometry& geometry, const SahCost& cost,
                         const BinaryTreeOptions& options, const CancelToken* cancel,
                         const std::function<void(double)>& progress) {
  SIGHTLINE_CHECK_GT(geometry.triangles.size(), geometry.inert.size());
  return GridTreeBuilder(geometry, cost, options, cancel, progress).Build();
}

}  // namespace sightline::bvh_build

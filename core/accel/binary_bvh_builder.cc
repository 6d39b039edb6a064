// SPDX-License-Identifier: Apache-2.0
#include "core/accel/binary_bvh_builder.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <limits>
#include <memory>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "core/accel/area_scale.h"
#include "core/base/sparse_array.h"
#include "core/base/status_macros.h"

namespace sightline {
namespace {

constexpr size_t kGrain = 1 << 14;
// Their tree's nodes, up to twice as many less one, are numbered in 32 bits.
constexpr uint64_t kMaxTriangles = uint64_t{1} << 31;
// Ranges of fewer triangles are built by one thread, which is when tasks stop paying.
constexpr size_t kParallelTriangles = 1 << 12;

// A triangle's box and the double of its middle.
struct Primitive {
  Vec3f lo, hi;
  uint32_t id;
  // Halves first: the sum of two faces may leave a float's range, their halves' may not.
  float centroid(int axis) const { return 0.5f * lo[axis] + 0.5f * hi[axis]; }
};

// Of boxes within one, whose longest side `factor` brings to about 1.
struct Scale {
  float factor;
  float HalfArea(const Box3f& box) const {
    if (box.empty()) return 0;
    const Vec3f e = box.Extent() * factor;
    return (e.x * e.y + e.y * e.z) + e.z * e.x;
  }
};

struct Bin {
  Box3f box;
  uint32_t count = 0;
};

class Builder {
 public:
  Builder(const SceneGeometry& geometry, const BinaryBvhOptions& options, const CancelToken* cancel,
          BinaryBvh* bvh)
      : geometry_(geometry), options_(options), cancel_(cancel), bvh_(bvh) {
    const Vec3f extent = geometry.bounds.Extent();
    extent_ = std::max({extent.x, extent.y, extent.z});
  }

  void Build() {
    std::vector<uint32_t> ids;
    ids.reserve(geometry_.triangles.size() - geometry_.inert.size());
    auto inert = geometry_.inert.begin();
    for (uint32_t id = 0; id < geometry_.triangles.size(); ++id) {
      if (inert != geometry_.inert.end() && *inert == id) {
        ++inert;
      } else {
        ids.push_back(id);
      }
    }
    if (ids.empty()) return;
    primitives_.ResizeUninitialized(ids.size());
    ParallelFor(ids.size(), kGrain, [&](size_t begin, size_t end) {
      for (size_t i = begin; i < end; ++i) {
        Box3f box;
        for (const Vec3f corner : geometry_.Corners(ids[i])) box.Extend(corner);
        primitives_[i] = {box.lo, box.hi, ids[i]};
      }
    });
    bvh_->ids.ResizeUninitialized(ids.size());
    // No binary tree over n leaves has more.
    nodes_ = SparseArray<BinaryBvhNode>(2 * ids.size() - 1);
    Node(0, 0, ids.size(), 0);
    if (cancelled_.load()) return;
    // Where nodes stand depends on the threads; depth-first they do not.
    bvh_->nodes.ResizeUninitialized(next_.load());
    Lay(0, 0, 0);
  }

 private:
  // The range [begin, end) as node `at`.
  void Node(uint32_t at, size_t begin, size_t end, int depth) {
    if (cancel_ != nullptr && end - begin >= kParallelTriangles && cancel_->cancelled()) {
      cancelled_.store(true);
    }
    Box3f box, centroids;
    for (size_t i = begin; i < end; ++i) {
      const Primitive& p = primitives_[i];
      box.Extend(Box3f{p.lo, p.hi});
      centroids.Extend(Vec3f{p.centroid(0), p.centroid(1), p.centroid(2)});
    }
    BinaryBvhNode& node = nodes_[at];
    for (int k = 0; k < 3; ++k) node.lo[k] = box.lo[k], node.hi[k] = box.hi[k];
    const size_t middle = cancelled_.load(std::memory_order_relaxed)
                              ? begin
                              : Split(box, centroids, begin, end, depth);
    if (middle == begin) {
      for (size_t i = begin; i < end; ++i) bvh_->ids[i] = primitives_[i].id;
      std::sort(bvh_->ids.begin() + begin, bvh_->ids.begin() + end);
      node.first = static_cast<uint32_t>(begin);
      node.count = static_cast<uint32_t>(end - begin);
      return;
    }
    const uint32_t children = next_.fetch_add(2, std::memory_order_relaxed);
    node.first = children;
    node.count = 0;
    const auto left = [&] { Node(children, begin, middle, depth + 1); };
    const auto right = [&] { Node(children + 1, middle, end, depth + 1); };
    if (end - begin >= kParallelTriangles) {
      ParallelInvoke(left, right);
    } else {
      left();
      right();
    }
  }

  // Parts the range in two and returns where the second begins; `begin` where a leaf is to be.
  size_t Split(const Box3f& box, const Box3f& centroids, size_t begin, size_t end, int depth) {
    const size_t n = end - begin;
    if (n <= static_cast<size_t>(options_.min_triangles) || depth >= options_.max_depth) {
      return begin;
    }
    const Vec3f extent = centroids.Extent();
    const int axis = extent.x >= extent.y && extent.x >= extent.z ? 0
                     : extent.y >= extent.z                       ? 1
                                                                  : 2;
    if (!(extent[axis] > extent_ * options_.min_extent)) return begin;
    const float first = centroids.lo[axis];
    // However small a node is, the bins of its parts and their costs are told apart.
    const float to_one = ScaleToOne(extent[axis]);
    const float per_bin = static_cast<float>(options_.bins) / (extent[axis] * to_one);
    const Scale scale = {AreaScale(box)};
    const int last = options_.bins - 1;
    const auto bin_of = [=](const Primitive& p) {
      return std::clamp(static_cast<int>((p.centroid(axis) - first) * to_one * per_bin), 0, last);
    };
    // The small kind on the stack: most nodes are near the leaves.
    std::array<Bin, 64> small;
    std::vector<Bin> large;
    Bin* bins = small.data();
    if (static_cast<size_t>(options_.bins) > small.size()) {
      large.resize(static_cast<size_t>(options_.bins));
      bins = large.data();
    }
    for (size_t i = begin; i < end; ++i) {
      Bin& bin = bins[bin_of(primitives_[i])];
      bin.box.Extend(Box3f{primitives_[i].lo, primitives_[i].hi});
      ++bin.count;
    }
    // To the left of each plane, then from the right.
    std::vector<float> left_cost(static_cast<size_t>(last));
    Bin side;
    for (int i = 0; i < last; ++i) {
      side.box.Extend(bins[i].box);
      side.count += bins[i].count;
      left_cost[i] = scale.HalfArea(side.box) * static_cast<float>(side.count);
    }
    side = Bin();
    float best = std::numeric_limits<float>::infinity();
    int split = -1;
    for (int i = last; i > 0; --i) {
      side.box.Extend(bins[i].box);
      side.count += bins[i].count;
      if (side.count == 0 || side.count == n) continue;
      const float cost =
          left_cost[i - 1] + scale.HalfArea(side.box) * static_cast<float>(side.count);
      if (cost < best) best = cost, split = i;
    }
    if (split < 0) return begin;
    const float area = scale.HalfArea(box);
    const float ratio = options_.cost_ratio;
    if (options_.stop_by_cost && ratio * static_cast<float>(n) * area <= 2 * area + ratio * best) {
      return begin;
    }
    const auto middle = std::partition(primitives_.begin() + begin, primitives_.begin() + end,
                                       [&](const Primitive& p) { return bin_of(p) < split; });
    return static_cast<size_t>(middle - primitives_.begin());
  }

  // Copies the subtree of `from` to `to`, children after it.
  void Lay(uint32_t from, uint32_t to, uint32_t depth) {
    BinaryBvhNode node = nodes_[from];
    if (node.is_leaf()) {
      ++bvh_->leaf_count;
      bvh_->max_depth = std::max(bvh_->max_depth, depth);
      bvh_->nodes[to] = node;
      return;
    }
    const uint32_t children = laid_;
    laid_ += 2;
    const uint32_t source = node.first;
    node.first = children;
    bvh_->nodes[to] = node;
    Lay(source, children, depth + 1);
    Lay(source + 1, children + 1, depth + 1);
  }

  const SceneGeometry& geometry_;
  const BinaryBvhOptions& options_;
  const CancelToken* const cancel_;
  BinaryBvh* const bvh_;
  float extent_ = 0;
  AlignedVector<Primitive> primitives_;
  SparseArray<BinaryBvhNode> nodes_;
  std::atomic<uint32_t> next_{1};
  std::atomic<bool> cancelled_{false};
  uint32_t laid_ = 1;
};

}  // namespace

absl::Status ValidateBinaryBvhOptions(const BinaryBvhOptions& o) {
  const auto outside = [](absl::string_view name, auto value, auto low, auto high) {
    return absl::InvalidArgumentError(
        absl::StrCat(name, " is ", value, "; it must be ", low, " to ", high));
  };
  if (o.bins < 2 || o.bins > kMaxBinaryBvhBins) {
    return outside("bins", o.bins, 2, kMaxBinaryBvhBins);
  }
  if (!(o.cost_ratio >= kMinCostRatio && o.cost_ratio <= kMaxCostRatio)) {
    return outside("cost_ratio", o.cost_ratio, kMinCostRatio, kMaxCostRatio);
  }
  if (o.min_triangles < 1 || o.min_triangles > 1 << 20) {
    return outside("min_triangles", o.min_triangles, 1, 1 << 20);
  }
  if (o.max_depth < 1 || o.max_depth > static_cast<int>(kMaxBinaryBvhDepth)) {
    return outside("max_depth", o.max_depth, 1, kMaxBinaryBvhDepth);
  }
  if (!(o.min_extent >= 0 && o.min_extent <= 1)) {
    return outside("min_extent", o.min_extent, 0, 1);
  }
  return absl::OkStatus();
}

absl::StatusOr<BinaryBvh> BuildBinaryBvh(const SceneGeometry& geometry,
                                         const BinaryBvhOptions& options, ThreadPool& pool,
                                         const CancelToken* cancel) {
  SL_RETURN_IF_ERROR(ValidateBinaryBvhOptions(options));
  const uint64_t triangles = geometry.triangles.size() - geometry.inert.size();
  if (triangles > kMaxTriangles) {
    return absl::ResourceExhaustedError(absl::StrCat("the scene has ", triangles,
                                                     " triangles; a binary BVH holds at most ",
                                                     kMaxTriangles, ": split the scene"));
  }
  BinaryBvh bvh;
  // One block: the calling thread enters the pool, and everything below runs within it.
  pool.ParallelFor(1, 1, [&](size_t, size_t) {
    Builder(geometry, options, cancel, &bvh).Build();
    bvh.leaves = MakeLeafTriangles(geometry, {bvh.ids.data(), bvh.ids.size()});
  });
  if (cancel != nullptr && cancel->cancelled()) return cancel->ToStatus();
  return bvh;
}

}  // namespace sightline

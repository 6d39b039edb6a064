// SPDX-License-Identifier: Apache-2.0
#include "core/accel/kd_builder.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <memory>
#include <type_traits>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "core/accel/kd_cell.h"
#include "core/accel/kd_sweep.h"
#include "core/base/status_macros.h"

namespace sightline {
namespace {

using kd_build::FindKdSplit;
using kd_build::KdCell;
using kd_build::KdReference;
using kd_build::KdSplit;
using kd_build::SplitCell;

// Cells of more references have their halves built side by side, and are asked about cancellation.
constexpr size_t kTaskRefs = 1 << 11;
// Splits with references on both sides are fewer than references. Beside them, the six faces of
// each of their halves may be cut off as empty: up to fourteen nodes a reference.
constexpr uint64_t kMaxReferences = KdNode::kMaxIndex / 14;
// More than any tree takes; small enough for doubles to tell it from all that is less.
constexpr uint64_t kUnboundedBytes = uint64_t{1} << 52;
// Share of the time that sorting the root's events takes (sphere of 1 M triangles: a tenth).
constexpr double kRootShare = 0.1;

// What a cell and all below it may take.
struct Allowance {
  uint64_t references;
  uint64_t bytes;  // Of its node, and of what is below. REQUIRES: enough for a leaf.
};

// A finished part of the tree. Its nodes, leaves and ids are numbered from 0; the root is nodes[0].
struct Part {
  std::vector<KdNode> nodes;
  std::vector<KdLeaf> leaves;
  std::vector<uint32_t> ids;
  uint32_t depth = 0;  // Inner nodes on its longest path.

  bool is_leaf() const { return nodes[0].is_leaf(); }
  bool is_empty_leaf() const { return nodes[0].is_empty_leaf(); }
};

class KdTreeBuilder {
 public:
  KdTreeBuilder(const SceneGeometry& geometry, const KdBuildOptions& options, int max_depth,
                const CancelToken* cancel, const std::function<void(double)>& progress)
      : geometry_(geometry),
        options_(options),
        max_depth_(max_depth),
        node_bytes_(sizeof(KdNode) + (options.perfect_splits ? sizeof(Box3f) : 0)),
        cancel_(cancel),
        progress_(progress) {}

  // What a root with so many references takes as one leaf.
  uint64_t LeastBytes(uint64_t references) const { return LeafBytes(references); }

  // `share` of the whole work, for the progress. `allowed`: what its nodes and leaves may take.
  // Incomplete once the token has fired.
  std::unique_ptr<Part> Build(KdCell cell, int depth, Allowance allowed, double share) {
    auto part = std::make_unique<Part>();
    part->nodes.emplace_back();
    if (cell.refs.size() <= kTaskRefs) {
      BuildSerially(part.get(), 0, std::move(cell), depth, allowed);
      part->depth = Deepest(*part);
      Report(share);
      return part;
    }
    if (cancelled()) return part;
    const KdSplit split = Choose(cell, depth, allowed);
    if (split.axis < 0) {
      MakeLeaf(part.get(), 0, cell);
      Report(share);
      return part;
    }
    const auto [allowed_below, allowed_above] = Share(split, allowed);
    const double share_below =
        share * static_cast<double>(split.below) / static_cast<double>(split.below + split.above);
    auto halves = SplitCell(geometry_, std::move(cell), split, options_.perfect_splits);
    std::unique_ptr<Part> child[2];
    ParallelInvoke(
        [&, below = allowed_below] {
          child[0] = Build(std::move(halves.first), depth + 1, below, share_below);
        },
        [&, above = allowed_above] {
          child[1] = Build(std::move(halves.second), depth + 1, above, share - share_below);
        });
    return Join(split, std::move(child[0]), std::move(child[1]));
  }

 private:
  bool cancelled() const { return cancel_ != nullptr && cancel_->cancelled(); }

  void Report(double share) {
    if (!progress_) return;
    constexpr double kUnits = 0x1p40;
    const uint64_t units = static_cast<uint64_t>(share * kUnits);
    const uint64_t before = done_.fetch_add(units, std::memory_order_relaxed);
    progress_(kRootShare +
              (1 - kRootShare) * std::min(1.0, static_cast<double>(before + units) / kUnits));
  }

  // The split to make; axis -1 for a leaf.
  KdSplit Choose(const KdCell& cell, int depth, Allowance allowed) const {
    const size_t n = cell.refs.size();
    if (n <= static_cast<size_t>(options_.min_leaf_triangles) || depth > max_depth_) return {};
    const KdSplit split = FindKdSplit(cell.bounds, n, cell.events, options_.traversal_cost);
    if (split.axis < 0 || split.below + split.above > allowed.references ||
        BytesOfSplit(split) > allowed.bytes) {
      return {};
    }
    const bool too_full =
        options_.max_leaf_triangles != 0 && n > static_cast<size_t>(options_.max_leaf_triangles);
    // A plane that every reference reaches across takes nothing off.
    const bool useful = split.below < n || split.above < n;
    if (split.cost < static_cast<double>(n) || (too_full && useful)) return split;
    return {};
  }

  // Of a leaf with its node.
  uint64_t LeafBytes(uint64_t references) const {
    return node_bytes_ + (references == 0 ? 0 : sizeof(KdLeaf)) + references * sizeof(uint32_t);
  }
  // Of a node whose halves are leaves.
  uint64_t BytesOfSplit(const KdSplit& split) const {
    return node_bytes_ + LeafBytes(split.below) + LeafBytes(split.above);
  }

  // What the halves may take: what each has, and of what is spare its share.
  std::pair<Allowance, Allowance> Share(const KdSplit& split, Allowance allowed) const {
    const uint64_t used = split.below + split.above;
    const auto of_spare = [&](uint64_t all, uint64_t taken) {
      const uint64_t spare = all - taken;
      return std::min(spare, static_cast<uint64_t>(static_cast<double>(spare) *
                                                   static_cast<double>(split.below) /
                                                   static_cast<double>(used)));
    };
    const Allowance below = {split.below + of_spare(allowed.references, used),
                             LeafBytes(split.below) + of_spare(allowed.bytes, BytesOfSplit(split))};
    return {below,
            {allowed.references - below.references, allowed.bytes - node_bytes_ - below.bytes}};
  }

  static void MakeLeaf(Part* part, uint32_t node, const KdCell& cell) {
    if (cell.refs.empty()) {
      part->nodes[node] = KdNode::EmptyLeaf();
      return;
    }
    Box3f box;
    const size_t first = part->ids.size();
    for (const KdReference& ref : cell.refs) {
      box.Extend(ref.box);
      part->ids.push_back(ref.id);
    }
    std::sort(part->ids.begin() + static_cast<ptrdiff_t>(first), part->ids.end());
    part->nodes[node] = KdNode::Leaf(static_cast<uint32_t>(part->leaves.size()));
    part->leaves.push_back({{box.lo.x, box.lo.y, box.lo.z},
                            static_cast<uint32_t>(first),
                            {box.hi.x, box.hi.y, box.hi.z},
                            static_cast<uint32_t>(cell.refs.size())});
  }

  void BuildSerially(Part* part, uint32_t node, KdCell cell, int depth, Allowance allowed) const {
    const KdSplit split = Choose(cell, depth, allowed);
    if (split.axis < 0) {
      MakeLeaf(part, node, cell);
      return;
    }
    const auto [allowed_below, allowed_above] = Share(split, allowed);
    auto halves = SplitCell(geometry_, std::move(cell), split, options_.perfect_splits);
    const uint32_t pair = static_cast<uint32_t>(part->nodes.size());
    part->nodes.resize(part->nodes.size() + 2);
    BuildSerially(part, pair, std::move(halves.first), depth + 1, allowed_below);
    BuildSerially(part, pair + 1, std::move(halves.second), depth + 1, allowed_above);
    const KdNode below = part->nodes[pair], above = part->nodes[pair + 1];
    if (Folds(below, above)) {
      part->nodes.resize(pair);
      part->nodes[node] = below.is_empty_leaf() ? above : below;
    } else {
      part->nodes[node] = KdNode::Inner(split.axis, split.at, pair);
    }
  }

  // A split that only takes empty space off a leaf says no more than the leaf's box.
  static bool Folds(KdNode below, KdNode above) {
    return below.is_leaf() && above.is_leaf() && (below.is_empty_leaf() || above.is_empty_leaf());
  }

  static uint32_t Deepest(const Part& part) {
    uint32_t deepest = 0;
    std::vector<std::pair<uint32_t, uint32_t>> pending = {{0, 0}};
    while (!pending.empty()) {
      const auto [node, above] = pending.back();
      pending.pop_back();
      deepest = std::max(deepest, above);
      if (part.nodes[node].is_leaf()) continue;
      pending.emplace_back(part.nodes[node].first_child(), above + 1);
      pending.emplace_back(part.nodes[node].first_child() + 1, above + 1);
    }
    return deepest;
  }

  static std::unique_ptr<Part> Join(const KdSplit& split, std::unique_ptr<Part> below,
                                    std::unique_ptr<Part> above) {
    if (Folds(below->nodes[0], above->nodes[0])) {
      return below->is_empty_leaf() ? std::move(above) : std::move(below);
    }
    // The root and the pair; then the rest of the lower part, and that of the upper one.
    auto part = std::make_unique<Part>();
    part->nodes.reserve(below->nodes.size() + above->nodes.size() + 1);
    part->nodes.push_back(KdNode::Inner(split.axis, split.at, 1));
    part->nodes.resize(3);
    part->leaves = std::move(below->leaves);
    part->ids = std::move(below->ids);
    part->depth = 1 + std::max(below->depth, above->depth);
    const uint32_t leaves = static_cast<uint32_t>(part->leaves.size());
    const uint32_t ids = static_cast<uint32_t>(part->ids.size());
    // Memory is given back as soon as it is not needed: both halves' is as much as the whole's.
    Append(*below, /*root=*/1, /*first_leaf=*/0, part.get());
    below.reset();
    Append(*above, /*root=*/2, leaves, part.get());
    std::vector<KdNode>().swap(above->nodes);  // `= {}` would keep its room.
    for (KdLeaf leaf : above->leaves) {
      leaf.first += ids;
      part->leaves.push_back(leaf);
    }
    part->ids.insert(part->ids.end(), above->ids.begin(), above->ids.end());
    return part;
  }

  // `from`'s nodes, its root in place of `root` and the rest at the end.
  static void Append(const Part& from, uint32_t root, uint32_t first_leaf, Part* part) {
    const uint32_t shift = static_cast<uint32_t>(part->nodes.size()) - 1;
    for (size_t i = 0; i < from.nodes.size(); ++i) {
      KdNode node = from.nodes[i];
      if (!node.is_leaf()) {
        node = KdNode::Inner(node.axis(), node.split(), node.first_child() + shift);
      } else if (!node.is_empty_leaf()) {
        node = KdNode::Leaf(node.leaf() + first_leaf);
      }
      if (i == 0) {
        part->nodes[root] = node;
      } else {
        part->nodes.push_back(node);
      }
    }
  }

  const SceneGeometry& geometry_;
  const KdBuildOptions& options_;
  const int max_depth_;
  const uint64_t node_bytes_;  // With its `reach`.
  const CancelToken* const cancel_;
  const std::function<void(double)>& progress_;
  std::atomic<uint64_t> done_{0};
};

// By node, the hull of the whole boxes of the triangles below. Children stand after their parents.
void FillReach(const SceneGeometry& geometry, KdTree* tree) {
  tree->reach.resize(tree->nodes.size(), Box3f());
  ParallelFor(tree->nodes.size(), 1 << 12, [&](size_t begin, size_t end) {
    for (size_t i = begin; i < end; ++i) {
      const KdNode node = tree->nodes[i];
      if (!node.is_leaf() || node.is_empty_leaf()) continue;
      for (const uint32_t id : tree->LeafIds(tree->leaves[node.leaf()])) {
        for (const Vec3f& corner : geometry.Corners(id)) tree->reach[i].Extend(corner);
      }
    }
  });
  for (size_t i = tree->nodes.size(); i-- > 0;) {
    const KdNode node = tree->nodes[i];
    if (node.is_leaf()) continue;
    tree->reach[i].Extend(tree->reach[node.first_child()]);
    tree->reach[i].Extend(tree->reach[node.first_child() + 1]);
  }
}

// On a thread of the pool.
absl::StatusOr<KdTree> Build(const SceneGeometry& geometry, const KdBuildOptions& options,
                             const CancelToken* cancel,
                             const std::function<void(double)>& progress) {
  const auto check_cancel = [cancel] {
    return cancel == nullptr ? absl::OkStatus() : cancel->ToStatus();
  };
  KdCell root = kd_build::RootCell(geometry, cancel);
  SL_RETURN_IF_ERROR(check_cancel());
  const uint64_t triangles = root.refs.size();
  if (progress) progress(kRootShare);
  const int max_depth = options.max_depth != 0
                            ? options.max_depth
                            : std::min(static_cast<int>(kMaxKdDepth),
                                       static_cast<int>(8 + 1.3 * std::log2(triangles)));
  Allowance allowed = {
      .references = static_cast<uint64_t>(static_cast<double>(options.max_references) *
                                          static_cast<double>(triangles)),
      .bytes =
          options.max_bytes == 0 ? kUnboundedBytes : std::min(options.max_bytes, kUnboundedBytes)};
  KdTree tree;
  tree.bounds = root.bounds;
  tree.triangle_count = static_cast<uint32_t>(triangles);
  KdTreeBuilder builder(geometry, options, max_depth, cancel, progress);
  allowed.bytes = std::max(allowed.bytes, builder.LeastBytes(triangles));
  const std::unique_ptr<Part> part = builder.Build(std::move(root), /*depth=*/1, allowed, 1.0);
  SL_RETURN_IF_ERROR(check_cancel());
  // One array after the other, so that two trees are never there at once.
  const auto take = [](auto* from, auto* to) {
    to->Append(*from);
    std::remove_reference_t<decltype(*from)>().swap(*from);
  };
  take(&part->nodes, &tree.nodes);
  take(&part->leaves, &tree.leaves);
  take(&part->ids, &tree.ids);
  tree.max_depth = part->depth;
  if (options.perfect_splits) FillReach(geometry, &tree);
  if (progress) progress(1.0);
  return tree;
}

}  // namespace

absl::Status ValidateKdOptions(const KdBuildOptions& options) {
  const auto outside = [](const char* name, auto value, auto lo, auto hi) {
    return absl::InvalidArgumentError(
        absl::StrCat(name, " = ", value, " is outside ", lo, " .. ", hi));
  };
  if (!(options.traversal_cost >= kMinKdTraversalCost &&
        options.traversal_cost <= kMaxKdTraversalCost)) {
    return outside("traversal_cost", options.traversal_cost, kMinKdTraversalCost,
                   kMaxKdTraversalCost);
  }
  if (options.min_leaf_triangles < 1 || options.min_leaf_triangles > kMaxKdLeafTriangles) {
    return outside("min_leaf_triangles", options.min_leaf_triangles, 1, kMaxKdLeafTriangles);
  }
  if (options.max_leaf_triangles != 0 && (options.max_leaf_triangles < options.min_leaf_triangles ||
                                          options.max_leaf_triangles > kMaxKdLeafTriangles)) {
    return absl::InvalidArgumentError(
        absl::StrCat("max_leaf_triangles = ", options.max_leaf_triangles,
                     " is neither 0 nor within min_leaf_triangles = ", options.min_leaf_triangles,
                     " .. ", kMaxKdLeafTriangles));
  }
  if (options.max_depth < 0 || options.max_depth > static_cast<int>(kMaxKdDepth)) {
    return outside("max_depth", options.max_depth, 0, kMaxKdDepth);
  }
  if (!(options.max_references >= 1 && options.max_references <= kMaxKdReferences)) {
    return outside("max_references", options.max_references, 1, kMaxKdReferences);
  }
  return absl::OkStatus();
}

absl::StatusOr<KdTree> BuildKdTree(const SceneGeometry& geometry, const KdBuildOptions& options,
                                   ThreadPool& pool, const CancelToken* cancel,
                                   const std::function<void(double)>& progress) {
  SL_RETURN_IF_ERROR(ValidateKdOptions(options));
  const uint64_t triangles = geometry.triangles.size() - geometry.inert.size();
  if (triangles == 0) return KdTree{};
  const double references =
      static_cast<double>(options.max_references) * static_cast<double>(triangles);
  if (references > static_cast<double>(kMaxReferences)) {
    return absl::ResourceExhaustedError(absl::StrCat(
        "a kd-tree over ", triangles, " triangles with max_references = ", options.max_references,
        " may have ", references, " references; it numbers at most ", kMaxReferences,
        ": ask for fewer, or split the scene"));
  }
  absl::StatusOr<KdTree> tree;
  // One block: the calling thread enters the pool, and everything below runs within it.
  pool.ParallelFor(1, 1,
                   [&](size_t, size_t) { tree = Build(geometry, options, cancel, progress); });
  return tree;
}

}  // namespace sightline

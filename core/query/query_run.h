// SPDX-License-Identifier: Apache-2.0
//
// What one query call needs around its walks: kernels for the asked instruction set, a clock, and
// statistics. Internal to core/query.
//
// Thread safety: one QueryRun belongs to one call.
#ifndef SIGHTLINE_CORE_QUERY_QUERY_RUN_H_
#define SIGHTLINE_CORE_QUERY_QUERY_RUN_H_

#include <chrono>
#include <span>

#include "absl/status/status.h"
#include "core/base/check.h"
#include "core/query/options.h"
#include "core/traverse/culled_kernels.h"
#include "core/traverse/kernels.h"

namespace sightline {

class QueryRun {
 public:
  QueryRun(const IndexedGeometry& scene, const QueryOptions& options)
      : options_(options),
        kernels_(KernelsFor(options.simd)),
        on_kd_tree_(WalksKdTree(scene, options)) {
    culling_ = options.leaf_culling.value_or(LeafCulling::None());
    culling_.intersector = options.intersector;
    culling_.tree = options.structure == Structure::kBinaryBvh ? CulledTree::kBinaryBvh
                    : on_kd_tree()                             ? CulledTree::kKdTree
                                                               : CulledTree::kBvh;
  }

  const QueryOptions& options() const { return options_; }
  const Kernels& kernels() const { return kernels_; }
  const CancelToken* cancel() const { return options_.cancel; }

  // Whether the kd-tree is walked, not the BVH.
  bool on_kd_tree() const { return on_kd_tree_; }

  bool on_binary_bvh() const { return options_.structure == Structure::kBinaryBvh; }

  // What single rays and packets walk, test by and cull within leaves; null: by the predicate, they
  // do not, and the tree is an ordinary one. Its kernels beside.
  const LeafCulling* culling() const {
    return options_.leaf_culling.has_value() || by_intersector() || on_binary_bvh() ? &culling_
                                                                                    : nullptr;
  }
  // Whether another test than the predicate decides.
  bool by_intersector() const { return options_.intersector != Intersector::kExact; }
  const CulledKernels& culled_kernels() const { return CulledKernelsFor(options_.simd); }

  // Once a group of blocks: a walk polls too, but only a long one.
  absl::Status Poll() const {
    return options_.cancel == nullptr ? absl::OkStatus() : options_.cancel->ToStatus();
  }

  // The status of a walk that left off. REQUIRES: the token has fired.
  absl::Status Stopped() const {
    SIGHTLINE_CHECK(options_.cancel != nullptr) << "a walk stopped that nobody cancelled";
    return options_.cancel->ToStatus();
  }

 private:
  const QueryOptions& options_;
  const Kernels& kernels_;
  const bool on_kd_tree_;
  LeafCulling culling_;
};

// Adds what happened between its construction and destruction to `stats`.
class StatsScope {
 public:
  StatsScope(QueryStats* stats, Strategy strategy, uint64_t rays)
      : stats_(stats), strategy_(strategy), rays_(rays), start_(Clock::now()) {}
  ~StatsScope() {
    QueryStats now;
    now.strategy = strategy_;
    now.rays = rays_;
    now.nodes = walk_.nodes;
    now.leaves = walk_.leaves;
    now.triangle_tests = walk_.triangle_tests;
    now.doubt_double = walk_.doubt_double;
    now.doubt_exact = walk_.doubt_exact;
    now.tiles = walk_.tiles;
    now.tiles_answered = walk_.tiles_answered;
    now.relevant_triangles = walk_.relevant_triangles;
    now.culled_tests = walk_.culled_tests;
    now.shaft = walk_.shaft;
    now.compute_nanoseconds = static_cast<uint64_t>(
        std::chrono::duration_cast<std::chrono::nanoseconds>(Clock::now() - start_).count());
    stats_->Add(now);
  }
  StatsScope(const StatsScope&) = delete;
  StatsScope& operator=(const StatsScope&) = delete;

  WalkStats* walk() { return &walk_; }
  void AddRays(uint64_t rays) { rays_ += rays; }
  // A walk that was taken: more than one kind is kAuto.
  void Took(Strategy walk) {
    strategy_ = !took_any_ || strategy_ == walk ? walk : Strategy::kAuto;
    took_any_ = true;
  }

 private:
  using Clock = std::chrono::steady_clock;
  QueryStats* const stats_;
  Strategy strategy_;
  bool took_any_ = false;
  uint64_t rays_;
  const Clock::time_point start_;
  WalkStats walk_;
};

// Adds to `stats` what answered some rays.
inline void CountAnswers(std::span<const AnsweredBy> answered_by, QueryStats* stats) {
  for (const AnsweredBy by : answered_by) ++stats->answered_by[static_cast<size_t>(by)];
}

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_QUERY_RUN_H_

// SPDX-License-Identifier: Apache-2.0
//
// Paper 001 (Nah, Park, Kang, Han): Tables 2 and 3, ray-box culling in kd-trees by leaf size.
//
// The paper's scenes are PBRT's; here are four of like character, with the paper's rows beside
// those that are most like one of its own (published001.h). Direct light is a picture and its
// shadow rays toward one light; paths are every second pixel's, of three bounces, with a shadow ray
// to each hit, as the paper's path tracer has them. One thread; the tests are Moeller and
// Trumbore's, one at a time, as PBRT's are. Trees are built by our exact sweep, with PBRT's costs
// and depth rule; their leaves' triangles are laid out beside them, and the time that takes is part
// of the build's. Boxes are put to sixteen triangles at once, and to those left of them again after
// a hit. The engine's own test, the predicate, takes sixteen triangles at once with or without
// boxes; its own way for such rays, one by one over its eight-wide BVH, is beside the fastest of
// all that.
#include <algorithm>
#include <array>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "core/accel/binary_bvh_builder.h"
#include "core/accel/bvh_builder.h"
#include "core/accel/kd_builder.h"
#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "tests/bench/papers/engine.h"
#include "tests/bench/papers/papers.h"
#include "tests/bench/papers/picture.h"
#include "tests/bench/papers/published001.h"

namespace sightline::bench {
namespace {

constexpr double kKilo = 1024;

// What is left out of leaves, and by which test.
struct Variant001 {
  const char* name;
  Intersector intersector;
  bool boxes, update, mailbox;
  bool on_bvh = false;  // Also over the BVH, which has every triangle once.
};
constexpr auto kTheirs = Intersector::kMoellerTrumbore;
constexpr Variant001 kVariants[] = {
    {"none", kTheirs, false, false, false, true},
    {"boxes", kTheirs, true, true, false, true},
    {"boxes, never updated", kTheirs, true, false, false, true},
    {"mailbox", kTheirs, false, false, true},
    {"boxes, mailbox", kTheirs, true, true, true},
    {"the predicate", Intersector::kExact, false, false, false, true},
    {"the predicate, boxes", Intersector::kExact, true, true, false, true}};

LeafCulling CullingOf(const Variant001& variant, CulledTree tree) {
  LeafCulling c = LeafCulling::None();
  c.tree = tree;
  c.intersector = variant.intersector;
  c.ray_box = variant.boxes;
  c.ray_box_update = variant.update;
  c.mailbox = variant.mailbox;
  return c;
}

constexpr std::array kLeafSizes = {1, 4, 8, 16, 32};

struct Workload001 {
  const char* name;
  bool path;
  std::vector<TraceRay> closest, any;
  double rays() const { return static_cast<double>(closest.size() + any.size()); }
};

// The fastest of what was timed, of one workload.
struct Fastest001 {
  CulledTree tree = CulledTree::kKdTree;
  int leaf = 1;
  const Variant001* variant = nullptr;
  double seconds = std::numeric_limits<double>::infinity();

  void Offer(const Fastest001& other) {
    if (other.seconds < seconds) *this = other;
  }
};
// To trace, and to build and trace.
struct FastestOf {
  Fastest001 tracing, both;
};

// A tree with leaves of one size: seconds to build it, and of each variant over it.
struct Outcome {
  int leaf = 0;
  double build = 0;
  std::vector<double> seconds, tests;  // Tests a ray.
};

struct TreeTimes {
  double build = 0, layout = 0;  // The one includes the other.
};

// PBRT's own, which the paper leaves as it is: 80 for a triangle's test against 1 for a node. Our
// default, which suits sixteen tests at once, would end most branches before the leaf size does.
constexpr float kPbrtTraversalCost = 1.0f / 80;

// Builds a tree with leaves of the size on the pool of one thread, this one, as the paper does; the
// leaves' triangles are laid out with it.
absl::Status UseTree(CulledTree tree, int leaf_size, ThreadPool& one, IndexedGeometry* indexed,
                     TreeTimes* times) {
  const double start = ThreadSeconds();
  if (tree == CulledTree::kBinaryBvh) {
    // Cut to size without the heuristic's say.
    SL_ASSIGN_OR_RETURN(indexed->binary_bvh,
                        BuildBinaryBvh(indexed->geometry,
                                       {.min_triangles = leaf_size, .stop_by_cost = false}, one));
    *times = {ThreadSeconds() - start, 0};
    return absl::OkStatus();
  }
  SL_ASSIGN_OR_RETURN(
      indexed->kd_tree,
      BuildKdTree(indexed->geometry,
                  {.traversal_cost = kPbrtTraversalCost, .min_leaf_triangles = leaf_size}, one));
  const double built = ThreadSeconds();
  one.ParallelFor(1, 1, [&](size_t, size_t) {
    const KdTree& kd = *indexed->kd_tree;
    indexed->kd_leaves = MakeLeafTriangles(indexed->geometry, {kd.ids.data(), kd.ids.size()});
  });
  const double end = ThreadSeconds();
  *times = {end - start, end - built};
  return absl::OkStatus();
}

// Traces the rays by the variant, and counts anew.
std::function<void()> CallOf(const PaperScene& scene, const Variant001& variant, CulledTree tree,
                             const Workload001& work, WalkStats* stats) {
  return [&scene, &work, stats, culling = CullingOf(variant, tree)] {
    *stats = WalkStats();
    TraceSingly(scene.indexed, culling, work.closest, false, stats);
    TraceSingly(scene.indexed, culling, work.any, true, stats);
  };
}

// Times the variants by turns, and adds their rows.
Outcome MeasureLeaf(const PaperScene& scene, const char* like, const Workload001& work,
                    CulledTree tree, int leaf_size, const TreeTimes& times, uint64_t repeats,
                    PaperReport* report, FastestOf* fastest) {
  std::vector<const Variant001*> variants;
  for (const Variant001& variant : kVariants) {
    if (tree == CulledTree::kKdTree || variant.on_bvh) variants.push_back(&variant);
  }
  std::vector<WalkStats> stats(variants.size());
  std::vector<std::function<void()>> calls;
  for (size_t v = 0; v < variants.size(); ++v) {
    calls.push_back(CallOf(scene, *variants[v], tree, work, &stats[v]));
  }
  Outcome outcome = {leaf_size, times.build, SecondsByTurns(calls, repeats), {}};
  const Published001* const paper =
      tree == CulledTree::kKdTree ? PublishedOf(like, work.path, leaf_size) : nullptr;
  for (size_t v = 0; v < variants.size(); ++v) {
    const double seconds = outcome.seconds[v];
    fastest->tracing.Offer({tree, leaf_size, variants[v], seconds});
    fastest->both.Offer({tree, leaf_size, variants[v], times.build + seconds});
    const auto per_ray = [&](uint64_t count) { return static_cast<double>(count) / work.rays(); };
    outcome.tests.push_back(per_ray(stats[v].triangle_tests));
    // The paper has these two alone.
    const auto published = [&](double Published001::*plain, double Published001::*boxes) {
      const auto value = v == 0 ? plain : v == 1 ? boxes : nullptr;
      return paper != nullptr && value != nullptr ? Row(paper->*value) : Row(nullptr);
    };
    report->Add({{"rays and culling", absl::StrCat(work.name, ": ", variants[v]->name)},
                 {"leaf", leaf_size},
                 {"TB", times.build},
                 {"TL", times.layout},
                 {"NT", per_ray(stats[v].nodes + stats[v].leaves)},
                 {"NPI", outcome.tests[v]},
                 {"NAC", per_ray(stats[v].ray_boxes)},
                 {"NAU", per_ray(stats[v].ray_box_updates)},
                 {"TR", outcome.seconds[v]},
                 {"TB+TR", times.build + outcome.seconds[v]},
                 {"paper_NT", published(&Published001::traversals, &Published001::traversals)},
                 {"paper_NPI", published(&Published001::tests, &Published001::tests_boxes)},
                 {"paper_NAC", published(nullptr, &Published001::made)},
                 {"paper_NAU", published(nullptr, &Published001::updated)},
                 {"paper_TB", published(&Published001::build, &Published001::build)},
                 {"paper_TR", published(&Published001::trace, &Published001::trace_boxes)}});
  }
  return outcome;
}

constexpr char kColumns[] =
    "NT: traversals, NPI: tests, NAC and NAU: boxes made and updated, all per ray; TB: build, TL: "
    "what of it lays the leaves' triangles out, TR: trace, in seconds";

// The same over a BVH.
absl::Status OnBvh(const std::vector<Workload001>& workloads, const PaperOptions& options,
                   PaperReport* report, ThreadPool& one, PaperScene* scene,
                   std::vector<FastestOf>* fastest) {
  report->Begin("001", absl::StrCat("Table 2 on a binary BVH, ", scene->name),
                "the same rays, and columns as in Table 2; leaves are laid out as they are built");
  for (const int leaf_size : kLeafSizes) {
    TreeTimes times;
    SL_RETURN_IF_ERROR(UseTree(CulledTree::kBinaryBvh, leaf_size, one, &scene->indexed, &times));
    for (size_t w = 0; w < workloads.size(); ++w) {
      MeasureLeaf(*scene, "", workloads[w], CulledTree::kBinaryBvh, leaf_size, times,
                  options.repeats, report, &(*fastest)[w]);
    }
  }
  report->Plot({.x = "leaf", .y = "TR", .series = "rays and culling"});
  report->End();
  return absl::OkStatus();
}

std::string NameOf(const Fastest001& fastest) {
  return absl::StrFormat("%s, %s, leaves of %d",
                         fastest.tree == CulledTree::kKdTree ? "kd" : "binary BVH",
                         fastest.variant->name, fastest.leaf);
}

// That the engine's single rays find, over its BVH, what the predicate finds over the paper's tree.
void CheckSame(const PaperScene& scene, const Workload001& work, CulledTree tree) {
  LeafCulling exact = LeafCulling::None();
  exact.tree = tree;
  WalkStats stats;
  for (const bool any : {false, true}) {
    const std::vector<TraceRay>& rays = any ? work.any : work.closest;
    const std::vector<Hit> theirs = TraceSingly(scene.indexed, exact, rays, any, &stats);
    const std::vector<Hit> ours = TraceSinglyByEngine(scene.indexed, rays, any, &stats);
    for (size_t i = 0; i < rays.size(); ++i) {
      const bool same =
          any ? (theirs[i].triangle == kNoTriangle) == (ours[i].triangle == kNoTriangle)
              : theirs[i].triangle == ours[i].triangle && theirs[i].t == ours[i].t;
      SIGHTLINE_CHECK(same) << "ray " << i << " of " << work.name << ", " << scene.name;
    }
  }
}

// The engine's single rays beside the fastest of both tables' ways, which is built again for it.
absl::Status BesideEngine(const std::vector<Workload001>& workloads,
                          const std::vector<FastestOf>& fastest, const PaperOptions& options,
                          PaperReport* report, ThreadPool& one, PaperScene* scene) {
  IndexedGeometry& indexed = scene->indexed;
  report->Begin("001", absl::StrCat("the engine beside Table 2, ", scene->name),
                "the same rays, closest hits and any: the fastest way of Table 2, on the kd-tree "
                "or the binary BVH, against the engine's single rays on its eight-wide BVH, by the "
                "predicate; by turns, and with the build on one thread");
  for (size_t w = 0; w < workloads.size(); ++w) {
    const Workload001& work = workloads[w];
    WalkStats stats;
    const std::function<void()> ours = [&] {
      TraceSinglyByEngine(indexed, work.closest, false, &stats);
      TraceSinglyByEngine(indexed, work.any, true, &stats);
    };
    const char* const kOurs = "SINGLE, eight-wide BVH";
    const Fastest001& tracing = fastest[w].tracing;
    TreeTimes times;
    SL_RETURN_IF_ERROR(UseTree(tracing.tree, tracing.leaf, one, &indexed, &times));
    SL_ASSIGN_OR_RETURN(indexed.bvh, BuildBvh(indexed.geometry, {}, one));
    CheckSame(*scene, work, tracing.tree);
    AddBeside(absl::StrCat(work.name, ", trace"), work.rays(),
              {{NameOf(tracing), CallOf(*scene, *tracing.variant, tracing.tree, work, &stats)},
               {kOurs, ours}},
              options.repeats, report);
    const Fastest001& both = fastest[w].both;
    absl::Status status;
    AddBeside(absl::StrCat(work.name, ", build + trace"), work.rays(),
              {{NameOf(both),
                [&, trace = CallOf(*scene, *both.variant, both.tree, work, &stats)] {
                  status.Update(UseTree(both.tree, both.leaf, one, &indexed, &times));
                  if (status.ok()) trace();
                }},
               {kOurs,
                [&] {
                  absl::StatusOr<Bvh> bvh = BuildBvh(indexed.geometry, {}, one);
                  status.Update(bvh.status());
                  if (!status.ok()) return;
                  indexed.bvh = *std::move(bvh);
                  ours();
                }}},
              options.repeats, report);
    SL_RETURN_IF_ERROR(status);
  }
  report->End();
  return absl::OkStatus();
}

// What the paper claims of one kind of rays, at each side's best leaf size.
void Conclude(const std::string& scene, const char* like, const Workload001& work,
              const std::vector<Outcome>& outcomes, PaperReport* report) {
  constexpr size_t kNone = 0, kBoxes = 1;
  const auto best = [&](size_t variant, bool with_build) -> const Outcome& {
    const auto seconds = [&](const Outcome& o) {
      return o.seconds[variant] + (with_build ? o.build : 0);
    };
    return *std::min_element(
        outcomes.begin(), outcomes.end(),
        [&](const Outcome& a, const Outcome& b) { return seconds(a) < seconds(b); });
  };
  const Outcome &plain = best(kNone, false), &culled = best(kBoxes, false);
  const Outcome &plain_both = best(kNone, true), &culled_both = best(kBoxes, true);
  const double gain = plain.seconds[kNone] / culled.seconds[kBoxes];
  const double of_both = (plain_both.build + plain_both.seconds[kNone]) /
                         (culled_both.build + culled_both.seconds[kBoxes]);
  double removed = 0;
  for (const Outcome& o : outcomes)
    removed = std::max(removed, 1 - o.tests[kBoxes] / o.tests[kNone]);
  report->Conclude(absl::StrFormat(
      "%s: at each side's best leaf size (%d without, %d with), culling makes tracing %.2f and "
      "build + trace %.2f times as fast (paper: 1.06 to 1.15, 1.08 to 1.22). Leaves of 32: %.2f.",
      work.name, plain.leaf, culled.leaf, gain, of_both,
      outcomes.back().seconds[kNone] / outcomes.back().seconds[kBoxes]));
  const std::string what = absl::StrCat(scene, ", ", work.name);
  const Outcome& large = outcomes.back();
  const Published001* const paper = PublishedOf(like, work.path, large.leaf);
  report->Claim(
      {absl::StrCat(what, ": tests removed"), "up to 92 %",
       absl::StrFormat("up to %.1f %%", 100 * removed), VerdictOfShare(removed, 0.92),
       absl::StrCat(absl::StrFormat("there are fewer to remove: at leaves of %d, %.1f tests a ray "
                                    "without boxes and %.1f with them",
                                    large.leaf, large.tests[kNone], large.tests[kBoxes]),
                    paper == nullptr ? ""
                                     : absl::StrFormat(" (the paper's %s: %.1f and %.1f)", like,
                                                       paper->tests, paper->tests_boxes))});
  report->Claim({absl::StrCat(what, ": faster tracing"), "1.06 to 1.15",
                 absl::StrFormat("%.2f", gain), VerdictOfGain(gain, 1.15),
                 absl::StrFormat("without boxes leaves of %d are the best, and have but %.1f tests "
                                 "a ray to spare",
                                 plain.leaf, plain.tests[kNone])});
  report->Claim(
      {absl::StrCat(what, ": faster build and tracing"), "1.08 to 1.22",
       absl::StrFormat("%.2f", of_both), VerdictOfGain(of_both, 1.22),
       absl::StrFormat("the build is %.0f %% of both, with leaves of %d",
                       100 * culled_both.build / (culled_both.build + culled_both.seconds[kBoxes]),
                       culled_both.leaf)});
}

// A row of Table 3.
struct Memory001 {
  const char* like;
  double triangles;
  Row row;
};

absl::Status Scene001(const std::string& name, const char* like, const PaperOptions& options,
                      PaperReport* report, Context& context, ThreadPool& pool,
                      std::vector<Memory001>* memory) {
  SL_ASSIGN_OR_RETURN(std::optional<PaperScene> read,
                      ReadIfThere("001", name, options, report, context, pool));
  if (!read) return absl::OkStatus();
  PaperScene scene = *std::move(read);
  IndexedGeometry& indexed = scene.indexed;
  indexed.prepared = PrepareGeometry(indexed.geometry, Intersector::kMoellerTrumbore);
  const auto size = static_cast<uint32_t>(options.size);
  const Picture picture = MakePicture(scene, size, size, 4);

  std::vector<Workload001> workloads;
  std::vector<std::vector<Outcome>> outcomes(2);
  std::vector<FastestOf> fastest(2);
  ThreadPool one(1);  // The paper builds on one thread.
  const bool beside = *like != '\0';
  report->Begin(
      "001", absl::StrCat("Table 2, ", scene.name),
      absl::StrCat(kColumns, beside ? "; beside, the paper's " : "; the paper has no like scene",
                   like));
  for (const int leaf_size : kLeafSizes) {
    context.err << scene.name << ", leaves of " << leaf_size << std::endl;
    TreeTimes times;
    SL_RETURN_IF_ERROR(UseTree(CulledTree::kKdTree, leaf_size, one, &indexed, &times));
    const KdTree& tree = *indexed.kd_tree;
    if (workloads.empty()) {
      const Vec3d light = scene.view.lights.at(0);
      WalkStats stats;
      const std::vector<Hit> hits =
          TracePackets(indexed, CullingOf(kVariants[0], CulledTree::kKdTree), picture, &stats);
      workloads.push_back(
          {"direct", false, RaysOf(picture), RaysOf(ShadowsOf(scene, picture, hits, light))});
      Paths paths = PathsOf(scene, picture, /*step=*/2, /*depth=*/3, light);
      workloads.push_back({"paths", true, std::move(paths.closest), std::move(paths.any)});
    }
    for (size_t w = 0; w < workloads.size(); ++w) {
      outcomes[w].push_back(MeasureLeaf(scene, like, workloads[w], CulledTree::kKdTree, leaf_size,
                                        times, options.repeats, report, &fastest[w]));
    }
    const double kd = static_cast<double>(tree.nodes.size() * sizeof(KdNode) +
                                          tree.leaves.size() * sizeof(KdLeaf) +
                                          tree.ids.size() * sizeof(uint32_t)) /
                      kKilo;
    const double boxes = 24.0 * static_cast<double>(indexed.geometry.triangles.size()) / kKilo;
    // What Table 2 walks: the same tree, and its leaves' triangles laid out, with their boxes.
    const double laid_out = static_cast<double>(indexed.kd_leaves->MemoryBytes()) / kKilo;
    const double laid_boxes =
        static_cast<double>(indexed.kd_leaves->boxes.size() * sizeof(float)) / kKilo;
    const PublishedMemory001* const paper = PublishedMemoryOf(like, leaf_size);
    const auto published = [&](double PublishedMemory001::*value) {
      return paper == nullptr ? Row(nullptr) : Row(paper->*value);
    };
    memory->push_back(
        {like,
         static_cast<double>(indexed.geometry.triangles.size()),
         {{"scene", scene.name},
          {"leaf", leaf_size},
          {"nodes", tree.nodes.size()},
          {"references", tree.ids.size()},
          {"tree_KB", kd},
          {"boxes_KB", boxes},
          {"total_KB", kd + boxes},
          {"timed_KB", kd + laid_out - laid_boxes},
          {"timed_boxes_KB", kd + laid_out},
          {"paper_nodes", published(&PublishedMemory001::nodes)},
          {"paper_references", published(&PublishedMemory001::references)},
          {"paper_tree_KB", published(&PublishedMemory001::tree_kb)},
          {"paper_boxes_KB", published(&PublishedMemory001::boxes_kb)},
          {"paper_total_KB",
           paper == nullptr ? Row(nullptr) : Row(paper->tree_kb + paper->boxes_kb)}}});
  }
  for (size_t w = 0; w < workloads.size(); ++w) {
    Conclude(scene.name, like, workloads[w], outcomes[w], report);
  }
  report->Plot({.x = "leaf", .y = "TR", .series = "rays and culling"});
  report->Plot({.x = "leaf", .y = "NPI", .series = "rays and culling"});
  report->End();
  SL_RETURN_IF_ERROR(OnBvh(workloads, options, report, one, &scene, &fastest));
  return BesideEngine(workloads, fastest, options, report, one, &scene);
}

// At each side's best leaf size in the paper: 1 without culling, boxes left out; 16 with it.
void ClaimMemory(const Memory001& one, const Memory001& sixteen, PaperReport* report) {
  for (const bool timed : {false, true}) {
    const double plain = one.row.at(timed ? "timed_KB" : "tree_KB"),
                 culled = sixteen.row.at(timed ? "timed_boxes_KB" : "total_KB");
    const double bytes = kKilo * plain / one.triangles;
    std::string why = absl::StrFormat("with leaves of 1 there are %.0f bytes a triangle", bytes);
    if (const PublishedMemory001* const paper = PublishedMemoryOf(one.like, 1);
        !timed && paper != nullptr) {
      absl::StrAppend(&why, absl::StrFormat(" (the paper's %s: %.0f)", one.like,
                                            24 * paper->tree_kb / paper->boxes_kb));
    }
    absl::StrAppend(&why, timed ? ", of which references, laid out, shrink less than nodes, and "
                                  "each has a box"
                                : ", beside which the 24 of a triangle's box do not shrink");
    report->Claim({absl::StrCat(one.row.at("scene").get<std::string>(),
                                ": memory with culling (leaves of 16) against without (of 1)",
                                timed ? ", of what is timed" : ", as the paper counts"),
                   "-47 % to -63 %", absl::StrFormat("%+.0f %%", 100 * (culled / plain - 1)),
                   VerdictOfShare(1 - culled / plain, 0.47), std::move(why)});
  }
}

}  // namespace

absl::Status Paper001(const PaperOptions& options, PaperReport* report, Context& context) {
  ThreadPool pool(0);
  std::vector<Memory001> memory;
  // And what they are like in the paper, if anything: its Balls are spheres.
  std::vector<std::pair<const char*, const char*>> names = {{"bunny.ply.xz", "Killeroo"},
                                                            {"buddha_100k.obj.xz", "Buddha"},
                                                            {"sponza_crytek.obj.xz", "Sponza"}};
  if (options.quick) names.clear();
  names.emplace_back(options.quick ? "builtin:room:15000" : "builtin:room", "");
  for (const auto& [name, like] : names) {
    SL_RETURN_IF_ERROR(Scene001(name, like, options, report, context, pool, &memory));
  }
  report->Begin("001", "Table 3",
                "memory of Table 2's kd-trees (8 bytes a node, 32 a leaf with its box, 4 a "
                "reference) and of the triangles' boxes (24 each), as the paper counts; timed: of "
                "what Table 2 walks, where leaves' triangles are laid out (40 bytes a reference, "
                "24 more with boxes), without and with them");
  for (size_t i = 0; i + 4 < memory.size(); i += 5) {
    ClaimMemory(memory[i], memory[i + 3], report);
  }
  for (Memory001& of : memory) report->Add(std::move(of.row));
  report->End();
  return absl::OkStatus();
}

}  // namespace sightline::bench

// SPDX-License-Identifier: Apache-2.0
//
// Paper 000 (Reshetov): figures 3, 4 and 5 on synthetic cells (synthetic.h), and 7 to 9 on real
// scenes: vertex culling against the bare test, by the size of the tree, and the engine's own ways
// beside the fastest of it.
#include <x86intrin.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "core/accel/binary_bvh_builder.h"
#include "core/accel/bvh_builder.h"
#include "core/accel/kd_builder.h"
#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/mesh/scene_geometry.h"
#include "tests/bench/papers/engine.h"
#include "tests/bench/papers/intersector_passes.h"
#include "tests/bench/papers/leaf_boxes.h"
#include "tests/bench/papers/papers.h"
#include "tests/bench/papers/picture.h"
#include "tests/bench/papers/synthetic.h"

namespace sightline::bench {
namespace {

constexpr size_t kCellTriangles = 64;
constexpr size_t kPackets = 32;
constexpr double kSphereTriangles = 9.5e6;  // The paper's 10 M, as near as the built-in one comes.

struct Variant {
  const char* name;
  LeafCulling culling;
};

// All off: the bare test.
LeafCulling Bare(Intersector intersector) {
  LeafCulling c;
  c.intersector = intersector;
  c.side_planes = c.near_far = c.aperture = c.skip_edges = c.ray_mask = false;
  c.frustum = FrustumRays::kAll;
  return c;
}
LeafCulling With(LeafCulling c, bool planes, bool near_far, bool aperture) {
  c.side_planes = planes;
  c.near_far = near_far;
  c.aperture = c.skip_edges = aperture;
  return c;
}

std::vector<Variant> SyntheticVariants() {
  const LeafCulling base = Bare(Intersector::kKenslerShirley);
  const LeafCulling exact = With(Bare(Intersector::kExact), true, true, true);
  return {{"base: Kensler-Shirley", base},
          {"4 planes", With(base, true, false, false)},
          {"6 planes", With(base, true, true, false)},
          {"aperture", With(base, false, false, true)},
          {"4 planes + aperture", With(base, true, false, true)},
          {"6 planes + aperture", With(base, true, true, true)},
          {"the predicate, bare", Bare(Intersector::kExact)},
          {"the predicate, 6 planes + aperture", exact}};
}

// Ticks of the time stamp counter a second.
double TicksPerSecond() {
  const double start = Now();
  const uint64_t ticks = __rdtsc();
  while (Now() - start < 0.02) {
  }
  return static_cast<double>(__rdtsc() - ticks) / (Now() - start);
}

// A cell as a scene with one leaf.
IndexedGeometry CellScene(const SyntheticCell& cell, Intersector prepared, ThreadPool& pool) {
  ObjectInput object;
  object.name = "cell";
  for (const auto& triangle : cell.triangles) {
    for (const Vec3f corner : triangle) {
      object.indices.push_back(static_cast<uint32_t>(object.vertices.size()));
      object.vertices.push_back(ToDouble(corner));
    }
  }
  IndexedGeometry scene;
  absl::StatusOr<SceneGeometry> geometry =
      CompileScene(std::span(&object, 1), Vec3d{0, 0, 0}, MeshLimits{});
  SIGHTLINE_CHECK(geometry.ok()) << geometry.status();
  scene.geometry = *std::move(geometry);
  absl::StatusOr<BinaryBvh> bvh = BuildBinaryBvh(scene.geometry, {.min_triangles = 1 << 20}, pool);
  SIGHTLINE_CHECK(bvh.ok()) << bvh.status();
  scene.binary_bvh = *std::move(bvh);
  scene.prepared = PrepareGeometry(scene.geometry, prepared);
  return scene;
}

struct SyntheticPoint {
  double ratio = 1;
  size_t packet = 64;
  double jitter = 0.04;
};

// The paper's cycles, where its text has them: of its figure 3 at a ratio of 1, on four lanes.
Row PublishedCycles(const SyntheticPoint& point, const std::string& culling) {
  const SyntheticPoint at;
  if (point.ratio != at.ratio || point.packet != at.packet || point.jitter != at.jitter) {
    return nullptr;
  }
  return culling == "base: Kensler-Shirley" ? Row(8)
         : culling == "6 planes + aperture" ? Row(3)
                                            : Row(nullptr);
}

struct SyntheticFigure {
  const char* title;
  const char* remark;
  const char* x;
  bool log_x;
  std::vector<SyntheticPoint> points;
};

struct SyntheticResult {
  double cycles, culled_share;
};

// Cycles a test, and the share of tests culled, of each variant.
std::vector<SyntheticResult> MeasureSynthetic(const SyntheticPoint& point,
                                              const std::vector<Variant>& variants, double ticks,
                                              uint64_t repeats, ThreadPool& pool) {
  const IndexedGeometry scene =
      CellScene(MakeCell(kCellTriangles, point.ratio, 1), Intersector::kKenslerShirley, pool);
  Random random(2);
  std::vector<Picture> packets;
  for (size_t p = 0; p < kPackets; ++p) {
    SyntheticPacket packet = MakePacket(point.packet, point.ratio, point.jitter, random);
    Picture picture;
    picture.origin = packet.origin;
    picture.packet_rays = static_cast<int>(point.packet);
    picture.targets = std::move(packet.directions);
    packets.push_back(std::move(picture));
  }
  std::vector<std::function<void()>> calls;
  std::vector<WalkStats> stats(variants.size());
  std::vector<uint64_t> rounds(variants.size());
  for (size_t v = 0; v < variants.size(); ++v) {
    calls.push_back([&, v] {
      for (const Picture& packet : packets) {
        TracePackets(scene, variants[v].culling, packet, &stats[v]);
      }
      ++rounds[v];
    });
  }
  const std::vector<double> seconds = SecondsByTurns(calls, repeats);
  const double tests = static_cast<double>(kPackets * point.packet * kCellTriangles);
  std::vector<SyntheticResult> results;
  for (size_t v = 0; v < variants.size(); ++v) {
    results.push_back({seconds[v] * ticks / tests, static_cast<double>(stats[v].culled_tests) /
                                                       (tests * static_cast<double>(rounds[v]))});
  }
  return results;
}

void Synthetic(const PaperOptions& options, PaperReport* report, ThreadPool& pool) {
  const double ticks = TicksPerSecond();
  std::vector<SyntheticFigure> figures = {
      {"Figure 3",
       "cycles a ray-triangle test (ticks of the time stamp counter, every cost of the "
       "packet included) over the ratio of the cell's edge to a triangle's; packets of "
       "64, cross-section 4 % of the cell; the paper's are about 8, and under 3",
       "ratio",
       false,
       {}},
      {"Figure 4a", "the same over the packet's size, ratio 1", "packet", true, {}},
      {"Figure 4b", "the same over the packet's size, ratio 4", "packet", true, {}},
      {"Figure 5",
       "the same over the packet's cross-section in per cent of the cell's edge; "
       "packets of 64, ratio 1",
       "cross_section",
       true,
       {}}};
  for (int ratio = 1; ratio <= 8; ++ratio) figures[0].points.push_back({.ratio = 1.0 * ratio});
  for (const size_t packet : {4, 16, 64, 256}) {
    figures[1].points.push_back({.packet = packet});
    figures[2].points.push_back({.ratio = 4, .packet = packet});
  }
  for (const double percent : {0.4, 1.0, 4.0, 10.0, 30.0, 100.0}) {
    figures[3].points.push_back({.jitter = percent / 100});
  }
  const std::vector<Variant> variants = SyntheticVariants();
  for (const SyntheticFigure& figure : figures) {
    report->Begin("000", figure.title, figure.remark);
    std::vector<std::vector<SyntheticResult>> all;
    for (const SyntheticPoint& point : figure.points) {
      all.push_back(MeasureSynthetic(point, variants, ticks, options.repeats, pool));
      const std::string x = figure.x;
      const double at = x == "ratio"    ? point.ratio
                        : x == "packet" ? static_cast<double>(point.packet)
                                        : 100 * point.jitter;
      for (size_t v = 0; v < variants.size(); ++v) {
        report->Add({{"culling", variants[v].name},
                     {x, at},
                     {"cycles", all.back()[v].cycles},
                     {"paper_cycles", PublishedCycles(point, variants[v].name)},
                     {"culled_percent", 100 * all.back()[v].culled_share}});
      }
    }
    report->Plot({.x = figure.x, .y = "cycles", .series = "culling", .log_x = figure.log_x});
    if (figure.points[0].packet == 64 && std::string(figure.x) == "ratio") {
      report->Conclude(absl::StrFormat(
          "At a ratio of 1: %.2f cycles bare, %.2f with six planes and aperture, a gain of %.1f "
          "(paper, on four lanes: 8 and under 3, a gain of 2.7). At 8: %.2f and %.2f, %.1f. Tests "
          "culled at 8: %.0f %% (paper: over 90 %%).",
          all[0][0].cycles, all[0][5].cycles, all[0][0].cycles / all[0][5].cycles, all[7][0].cycles,
          all[7][5].cycles, all[7][0].cycles / all[7][5].cycles, 100 * all[7][5].culled_share));
      double most_culled = 0;
      for (const auto& point : all) most_culled = std::max(most_culled, point[5].culled_share);
      report->Claim({"synthetic cells: share of the tests removed by all tests together",
                     "over 90 %", absl::StrFormat("up to %.1f %%", 100 * most_culled),
                     VerdictOfShare(most_culled, 0.9), "triangles are large against packets"});
      report->Claim(
          {"synthetic cells at a ratio of 8: cycles a test, bare and culled",
           "about 8 and under 3: 2.7 times fewer",
           absl::StrFormat("%.2f and %.2f: %.1f times fewer", all[7][0].cycles, all[7][5].cycles,
                           all[7][0].cycles / all[7][5].cycles),
           VerdictOfGain(all[7][0].cycles / all[7][5].cycles, 8.0 / 3),
           absl::StrFormat("the bare test takes %d rays at once, the paper's four, while culling "
                           "is paid per triangle as before",
                           RegisterRays())});
    }
    report->End();
  }
}

// ---- Real scenes

// Triangles of leaves are laid out beside the kd-tree unless they would take more: ten million
// triangles in a deep tree are named some sixty million times, 64 bytes each.
constexpr size_t kMostLaidOutBytes = size_t{6} << 30;

struct RealVariant {
  const char* name;
  LeafCulling culling;
  bool kd_alone = false;  // An option of the kd-tree.
  bool fetched = false;   // Its leaves' triangles are fetched on the way.
  bool computed = false;  // And their boxes computed (leaf_boxes.h).
};
// Their places.
enum : size_t { kBase, kMaskless, kRows, kMasked, kMaskedExact, kCells, kFetched, kComputed };

std::vector<RealVariant> RealVariants() {
  LeafCulling base = Bare(Intersector::kKenslerShirley);
  LeafCulling culled = With(base, true, true, true);
  culled.aperture_first = true;  // The paper's order for real scenes.
  LeafCulling masked = culled, rows = culled;
  masked.frustum = FrustumRays::kMasked;
  masked.ray_mask = true;
  rows.frustum = FrustumRays::kRows;
  LeafCulling exact = masked, cells = masked;
  exact.intersector = Intersector::kExact;
  cells.cell_boxes = true;
  return {{"base", base},
          {"maskless", culled},
          {"active rows", rows},
          {"masked", masked},
          {"masked, the predicate", exact},
          {"masked, cells for leaf boxes", cells, /*kd_alone=*/true},
          {"masked, leaves fetched", masked, /*kd_alone=*/true, /*fetched=*/true},
          {"masked, leaf boxes computed", masked, /*kd_alone=*/true, /*fetched=*/false,
           /*computed=*/true}};
}

// The variant over the scene's kd-tree, or its binary BVH; counts into *stats anew.
std::function<void()> CallOf(const RealVariant& variant, bool kd, const Picture& picture,
                             PaperScene* scene, WalkStats* stats) {
  LeafCulling culling = variant.culling;
  culling.tree = kd ? CulledTree::kKdTree : CulledTree::kBinaryBvh;
  return [scene, &picture, stats, culling, fetched = variant.fetched,
          trace = variant.computed ? ClosestWithComputedBoxes() : nullptr] {
    *stats = WalkStats();
    std::optional<LeafTriangles> put_aside;
    if (fetched) put_aside = std::exchange(scene->indexed.kd_leaves, std::nullopt);
    TracePackets(scene->indexed, culling, picture, stats, trace);
    if (fetched) scene->indexed.kd_leaves = std::move(put_aside);
  };
}

// A tree, and pictures a second over it.
struct TreePoint {
  double nodes = 0, leaf_triangles = 0, frames = 0;
};

// The kd-tree and what goes with it, in place of the last: what that held makes room for the next.
absl::Status UseKdTree(const KdBuildOptions& options, ThreadPool& pool, PaperScene* scene) {
  scene->indexed.kd_tree.reset();
  scene->indexed.kd_leaves.reset();
  scene->indexed.binary_bvh.reset();
  SL_ASSIGN_OR_RETURN(scene->indexed.kd_tree, BuildKdTree(scene->indexed.geometry, options, pool));
  const KdTree& tree = *scene->indexed.kd_tree;
  if (tree.ids.size() * kLeafTriangleBytes <= kMostLaidOutBytes) {
    scene->indexed.kd_leaves =
        MakeLeafTriangles(scene->indexed.geometry, {tree.ids.data(), tree.ids.size()});
  }
  return absl::OkStatus();
}

constexpr int kPacketSide = 4;

// One of the two trees, in place of either.
absl::Status UseTree(bool kd, float ratio, ThreadPool& pool, PaperScene* scene) {
  if (kd) return UseKdTree({.traversal_cost = 1 / ratio}, pool, scene);
  scene->indexed.kd_tree.reset();
  scene->indexed.kd_leaves.reset();
  scene->indexed.binary_bvh.reset();
  SL_ASSIGN_OR_RETURN(
      scene->indexed.binary_bvh,
      BuildBinaryBvh(scene->indexed.geometry, {.bins = 16, .cost_ratio = ratio}, pool));
  return absl::OkStatus();
}

// Where a picture took the least time.
struct FastestWay {
  bool kd = true;
  float ratio = 1;
  size_t variant = 0;
  double seconds = std::numeric_limits<double>::infinity();
};

// The engine's own ways beside the fastest of all of the paper's, which is built again for it.
absl::Status BesideEngine(const FastestWay& fastest, const std::vector<RealVariant>& variants,
                          const Picture& picture, const PaperOptions& options, PaperScene* scene,
                          PaperReport* report, Context& context, ThreadPool& pool) {
  context.err << scene->name << ", the engine's BVH" << std::endl;
  SL_RETURN_IF_ERROR(UseTree(fastest.kd, fastest.ratio, pool, scene));
  SL_ASSIGN_OR_RETURN(scene->indexed.bvh, BuildBvh(scene->indexed.geometry, {}, pool));
  const auto size = static_cast<uint32_t>(options.size);
  EnginePicture engine(*scene, size, size, kPacketSide);
  report->Begin("000", absl::StrCat("the engine beside Figures 7 to 9, ", scene->name),
                absl::StrFormat("the same picture of %d x %d, its triangles and distances: the "
                                "fastest of the figures' ways against the engine's, by the "
                                "predicate, on its eight-wide BVH; by turns",
                                size, size));
  WalkStats stats;
  const RealVariant& variant = variants[fastest.variant];
  const std::string name = absl::StrFormat("%s, %s, cost ratio %.2g", fastest.kd ? "kd" : "BVH",
                                           variant.name, fastest.ratio);
  AddBeside("camera rays", static_cast<double>(picture.targets.size()),
            engine.Beside({name, CallOf(variant, fastest.kd, picture, scene, &stats)}),
            options.repeats, report);
  report->End();
  // Both exact: the paper's way by the predicate, and the engine's.
  LeafCulling exact = variants[kMaskedExact].culling;
  exact.tree = fastest.kd ? CulledTree::kKdTree : CulledTree::kBinaryBvh;
  SL_RETURN_IF_ERROR(engine.CheckSame(TracePackets(scene->indexed, exact, picture, &stats)));
  scene->indexed.bvh = Bvh();
  return absl::OkStatus();
}

// Paper 000, section 4: what smaller trees lose, with culling and without, against the best tree
// without culling. They are smaller than the cost ratio's range makes them: cells stay whole from
// so many triangles on.
absl::Status SmallTrees(const TreePoint& best, const std::vector<RealVariant>& variants,
                        const Picture& picture, const PaperOptions& options, PaperScene* scene,
                        PaperReport* report, Context& context, ThreadPool& pool) {
  struct Size {
    int factor;
    const char* paper;
    double least;  // Of the best tree's frame rate, for the claim to hold.
    Row paper_with, paper_without;
  };
  const double triangles = static_cast<double>(scene->indexed.geometry.triangles.size());
  report->Begin("000", absl::StrCat("section 4, ", scene->name, ": smaller trees"),
                absl::StrFormat("kd-trees with fewer nodes than the fastest without culling (%.3f "
                                "a triangle), which cells make that stay whole from so many "
                                "triangles on; frame rates over its. The paper's: over 1 and 0.70 "
                                "with culling, 0.25 without",
                                best.nodes / triangles));
  int least = 16;  // Too few.
  for (const Size& size :
       {Size{20, "faster with culling", 1.0, 1.0, nullptr},
        Size{60, "0.70 with culling, 0.25 without", (1 - kGainBand) * 0.7, 0.7, 0.25}}) {
    double nodes = 0;
    int built = 0;
    const auto build = [&](int whole) -> absl::Status {
      built = whole;
      context.err << scene->name << ", kd-tree, " << whole << " triangles in a cell" << std::endl;
      SL_RETURN_IF_ERROR(UseKdTree(
          {.traversal_cost = kMaxKdTraversalCost, .min_leaf_triangles = whole}, pool, scene));
      nodes = static_cast<double>(scene->indexed.kd_tree->nodes.size());
      return absl::OkStatus();
    };
    const auto is_small = [&] { return nodes * size.factor <= best.nodes || nodes <= 1; };
    int whole = least;
    do {
      least = whole;
      whole *= 2;
      SL_RETURN_IF_ERROR(build(whole));
    } while (!is_small() && 2 * whole <= kMaxKdLeafTriangles);
    while (whole - least > whole / 8) {  // Nearer to the size that the paper names.
      const int middle = (least + whole) / 2;
      SL_RETURN_IF_ERROR(build(middle));
      (is_small() ? whole : least) = middle;
    }
    if (built != whole) SL_RETURN_IF_ERROR(build(whole));
    std::vector<std::function<void()>> calls;
    WalkStats stats;
    for (const size_t v : {kBase, kMaskless, kMasked}) {
      calls.push_back(CallOf(variants[v], /*kd=*/true, picture, scene, &stats));
    }
    const std::vector<double> seconds = SecondsByTurns(calls, options.repeats);
    const double base = 1 / seconds[0], culled = 1 / std::min(seconds[1], seconds[2]);
    const KdTree& tree = *scene->indexed.kd_tree;
    report->Add({{"triangles_whole", whole},
                 {"nodes_per_triangle", nodes / triangles},
                 {"times_smaller", best.nodes / nodes},
                 {"leaf_triangles",
                  static_cast<double>(tree.ids.size()) / static_cast<double>(tree.leaves.size())},
                 {"with_culling", culled / best.frames},
                 {"paper_with", size.paper_with},
                 {"without", base / best.frames},
                 {"paper_without", size.paper_without}});
    report->Claim(
        {absl::StrCat(scene->name, ", kd-tree ", size.factor,
                      " times smaller than the best without culling: frame rate over its"),
         size.paper,
         absl::StrFormat("%.2f with culling, %.2f without (%.0f times smaller)",
                         culled / best.frames, base / best.frames, best.nodes / nodes),
         // In part where culling at least makes up for some of what the smaller tree loses.
         culled >= size.least * best.frames ? Verdict::kHolds
         : culled > base                    ? Verdict::kInPart
                                            : Verdict::kDoesNotHold,
         absl::StrFormat("the best tree without culling has %.2f nodes a triangle already, the "
                         "paper's about 4: a register of %d rays makes bare tests cheap",
                         best.nodes / triangles, RegisterRays())});
  }
  report->End();
  return absl::OkStatus();
}

absl::Status RealScene(const std::string& name, const PaperOptions& options, PaperReport* report,
                       Context& context, ThreadPool& pool) {
  SL_ASSIGN_OR_RETURN(std::optional<PaperScene> read,
                      ReadIfThere("000", name, options, report, context, pool));
  if (!read) return absl::OkStatus();
  PaperScene scene = *std::move(read);
  scene.indexed.prepared = PrepareGeometry(scene.indexed.geometry, Intersector::kKenslerShirley);
  const auto size = static_cast<uint32_t>(options.size);
  const Picture picture = MakePicture(scene, size, size, kPacketSide);
  const std::vector<RealVariant> variants = RealVariants();
  const double triangles = static_cast<double>(scene.indexed.geometry.triangles.size());
  const bool reduced = absl::StrContains(name, "builtin:sphere") && triangles < kSphereTriangles;
  report->Begin(
      "000",
      absl::StrCat("Figures 7 to 9, ", scene.name,
                   reduced ? " (reduced: the paper's has 10 M)" : ""),
      absl::StrFormat("%.0f triangles; a picture of %d x %d by packets of 4 x 4, one thread, over "
                      "the cost ratio (intersection over traversal); kd-tree and binary BVH. Boxes "
                      "of the kd-tree's leaves are stored with them, or computed: from the leaf's "
                      "triangles at every visit, cut to the cell, which gives the same box. Cells: "
                      "in place of boxes what the walk has come to anyway; these are larger than "
                      "the paper's last cells, since the builder makes no node for empty space cut "
                      "off a leaf, so that this row is no other way to the same box",
                      triangles, size, size));
  double most_culled = 0;
  TreePoint best_kd;  // Without culling.
  FastestWay fastest;
  for (const bool kd : {true, false}) {
    std::vector<TreePoint> best(variants.size());
    for (const float ratio : {0.1f, 0.3f, 1.0f, 3.0f, 10.0f, 30.0f, 100.0f}) {
      context.err << scene.name << (kd ? ", kd-tree" : ", BVH") << ", ratio " << ratio << std::endl;
      double nodes = 0, leaves = 0, references = 0, bytes = 0;
      const double start = Now();
      SL_RETURN_IF_ERROR(UseTree(kd, ratio, pool, &scene));
      if (kd) {
        const KdTree& tree = *scene.indexed.kd_tree;
        bytes = static_cast<double>(tree.MemoryBytes());
        nodes = static_cast<double>(tree.nodes.size());
        leaves = static_cast<double>(tree.leaves.size());
        references = static_cast<double>(tree.ids.size());
      } else {
        nodes = static_cast<double>(scene.indexed.binary_bvh->nodes.size());
        leaves = scene.indexed.binary_bvh->leaf_count;
        references = static_cast<double>(scene.indexed.binary_bvh->ids.size());
        bytes = static_cast<double>(scene.indexed.binary_bvh->TreeBytes());
      }
      context.err << absl::StrFormat("  built in %.1f s; %.1f bytes a triangle", Now() - start,
                                     bytes / triangles)
                  << std::endl;
      std::vector<size_t> asked;  // Of the variants.
      std::vector<std::function<void()>> calls;
      std::vector<WalkStats> stats(variants.size());
      for (size_t v = 0; v < variants.size(); ++v) {
        if (variants[v].kd_alone && !kd) continue;
        asked.push_back(v);
        calls.push_back(CallOf(variants[v], kd, picture, &scene, &stats[v]));
      }
      const std::vector<double> of_calls = SecondsByTurns(calls, options.repeats);
      std::vector<double> seconds(variants.size(), 0);
      for (size_t i = 0; i < asked.size(); ++i) seconds[asked[i]] = of_calls[i];
      for (const size_t v : asked) {
        const double tests = static_cast<double>(stats[v].triangle_tests);
        const double culled = static_cast<double>(stats[v].culled_tests);
        if (1 / seconds[v] > best[v].frames) {
          best[v] = {nodes, references / leaves, 1 / seconds[v]};
        }
        if (seconds[v] < fastest.seconds) fastest = {kd, ratio, v, seconds[v]};
        if (v != kBase) {
          most_culled = std::max(most_culled, culled / std::max(1.0, tests + culled));
        }
        report->Add({{"tree and culling", absl::StrCat(kd ? "kd, " : "BVH, ", variants[v].name)},
                     {"tree", kd ? "kd" : "BVH"},
                     {"ratio", ratio},
                     {"frames_per_s", 1 / seconds[v]},
                     {"culled_percent", 100 * culled / std::max(1.0, tests + culled)},
                     {"leaf_triangles", references / leaves},
                     {"nodes_per_triangle", nodes / triangles},
                     {"tree_bytes_per_triangle", bytes / triangles}});
      }
    }
    report->Conclude(absl::StrFormat(
        "%s: best of all ratios: base %.1f, maskless %.1f, masked %.1f frames a second; culling "
        "gains %.2f (paper: about 1.1, at a smaller tree).",
        kd ? "kd-tree" : "BVH", best[kBase].frames, best[kMaskless].frames, best[kMasked].frames,
        std::max(best[kMaskless].frames, best[kMasked].frames) / best[kBase].frames));
    const TreePoint& culled =
        best[kMaskless].frames > best[kMasked].frames ? best[kMaskless] : best[kMasked];
    report->Conclude(absl::StrFormat(
        "%s: the fastest tree has %.2f nodes a triangle and %.1f triangles a leaf without culling "
        "(paper: about 4 and 3), %.2f and %.1f with it (paper: half as many nodes as triangles).",
        kd ? "kd-tree" : "BVH", best[kBase].nodes / triangles, best[kBase].leaf_triangles,
        culled.nodes / triangles, culled.leaf_triangles));
    if (kd) best_kd = best[kBase];
    const double gain = culled.frames / best[kBase].frames;
    report->Claim({absl::StrCat(scene.name, kd ? ", kd-tree" : ", binary BVH",
                                ": frame rate with culling, each side at its best cost ratio"),
                   "about 1.1", absl::StrFormat("%.2f", gain), VerdictOfGain(gain, 1.1),
                   absl::StrFormat("the best tree without culling has leaves of %.1f triangles "
                                   "already, since a register takes %d rays' tests at once",
                                   best[kBase].leaf_triangles, RegisterRays())});
    if (kd) {
      report->Conclude(absl::StrFormat(
          "kd-tree: leaves' boxes computed on the way instead of stored with them %.2f, cells "
          "instead of either %.2f, leaves fetched instead of laid out %.2f of the masked frame "
          "rate, each at its best (paper: no difference between stored and computed).",
          best[kComputed].frames / best[kMasked].frames, best[kCells].frames / best[kMasked].frames,
          best[kFetched].frames / best[kMasked].frames));
    }
  }
  report->Claim({absl::StrCat(scene.name, ": share of the tests removed"), "over 90 %",
                 absl::StrFormat("up to %.1f %%", 100 * most_culled),
                 VerdictOfShare(most_culled, 0.9),
                 "frusta are wide against the leaves, so that most triangles meet them"});
  report->Plot({.x = "ratio", .y = "frames_per_s", .series = "tree and culling", .log_x = true});
  report->Plot({.x = "ratio", .y = "culled_percent", .series = "tree and culling", .log_x = true});
  report->Plot({.x = "ratio", .y = "leaf_triangles", .series = "tree", .log_x = true});
  report->Plot({.x = "ratio", .y = "nodes_per_triangle", .series = "tree", .log_x = true});
  report->End();
  SL_RETURN_IF_ERROR(
      BesideEngine(fastest, variants, picture, options, &scene, report, context, pool));
  return SmallTrees(best_kd, variants, picture, options, &scene, report, context, pool);
}

}  // namespace

absl::Status Paper000(const PaperOptions& options, PaperReport* report, Context& context) {
  ThreadPool pool(0);
  context.err << "paper 000: synthetic cells" << std::endl;
  Synthetic(options, report, pool);
  std::vector<std::string> names = {"bunny.ply.xz", "buddha_100k.obj.xz"};
  if (options.quick) names.clear();
  names.push_back(absl::StrCat("builtin:sphere:", options.sphere));
  for (const std::string& name : names) {
    SL_RETURN_IF_ERROR(RealScene(name, options, report, context, pool));
  }
  return absl::OkStatus();
}

}  // namespace sightline::bench

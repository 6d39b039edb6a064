// SPDX-License-Identifier: Apache-2.0
//
// Paper 002 (Dmitriev, Havran, Seidel): Table 1 and its two curves, relevant triangles tracing
// against packets and single rays on the same kd-tree, and against shafts on the BVH.
//
// Reconstruction. Its scenes are not published: the built-in room with seven of its views' nine
// point lights, the office with its sixteen, and plants under a grid of sixteen, each through its
// first view. Its packets of four rays are the engine's packets of 2×2 on the kd-tree, whose lanes
// are mostly idle in registers of eight or sixteen; so there are two verdicts: against those, as
// the paper compares, and against packets of whichever side is the fastest, which is what RTT is
// worth here. Rays that RTT walks are four corner rays a tile, which here are beside the tile's
// own, and all rays of tiles that their lists do not answer.
#include <algorithm>
#include <cmath>
#include <numeric>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "core/accel/bvh_builder.h"
#include "core/accel/kd_builder.h"
#include "core/base/status_macros.h"
#include "core/geometry/camera.h"
#include "core/light/light.h"
#include "core/mesh/builtin/builtin.h"
#include "core/query/tiles.h"
#include "core/traverse/rtt.h"
#include "tests/bench/measure.h"
#include "tests/bench/papers/papers.h"
#include "tests/bench/workload.h"

namespace sightline::bench {
namespace {

struct RttScene {
  std::string name;
  IndexedGeometry indexed;
  BuiltinView view;
  std::vector<LightSample> samples;
};

// As many triangles as the scene has by itself, or as few as it can have.
absl::StatusOr<RttScene> MakeScene(const char* name, size_t lights, bool quick, ThreadPool& pool) {
  BuiltinSpec spec{.name = name};
  for (const BuiltinInfo& info : BuiltinScenes()) {
    if (quick && info.name == spec.name) spec.target_triangles = info.min_triangles;
  }
  SL_ASSIGN_OR_RETURN(const BuiltinScene builtin, MakeBuiltin(spec));
  RttScene scene{.name = name, .indexed = {}, .view = builtin.views.front(), .samples = {}};
  SL_ASSIGN_OR_RETURN(scene.indexed.geometry, CompileScene(builtin.objects, std::nullopt, {}));
  SL_ASSIGN_OR_RETURN(scene.indexed.bvh, BuildBvh(scene.indexed.geometry, {}, pool));
  SL_ASSIGN_OR_RETURN(scene.indexed.kd_tree, BuildKdTree(scene.indexed.geometry, {}, pool));
  std::vector<Vec3d> at = builtin.many_lights;
  if (at.empty() && lights < 16) {
    for (const BuiltinView& view : builtin.views) {
      at.insert(at.end(), view.lights.begin(), view.lights.end());
    }
  }
  const Box3f& box = scene.indexed.geometry.bounds;
  for (int i = 0; at.size() < lights; ++i) {  // Four by four below the top.
    const double x = (0.5 + i % 4) / 4, y = (0.5 + i / 4) / 4;
    const Vec3d lo = ToDouble(box.lo), size = ToDouble(box.Extent());
    at.push_back(scene.indexed.geometry.origin + lo + Vec3d{x * size.x, y * size.y, 0.9 * size.z});
  }
  at.resize(lights);
  for (uint32_t i = 0; i < lights; ++i) {
    SL_RETURN_IF_ERROR(
        AppendSamples(Light::Point(at[i]), i, scene.indexed.geometry.origin, &scene.samples));
  }
  return scene;
}

// A way of tracing it all.
struct Way {
  const char* name;
  QueryOptions options;
};
Way PacketsOf(const char* name, int side) {
  return {name,
          {.strategy = Strategy::kPacket, .structure = Structure::kKdTree, .packet_side = side}};
}
// Packets of every side come first, the paper's four rays before all.
enum : size_t { kFours, kSixteens, kSixtyFours, kPackets, kRtt, kShafts, kSingle, kWays };
constexpr size_t kPacketWays = kPackets + 1;

std::vector<Way> AllWays(int antialiasing) {
  std::vector<Way> ways(kWays);
  ways[kFours] = PacketsOf("4", 2);
  ways[kSixteens] = PacketsOf("16", 4);
  ways[kSixtyFours] = PacketsOf("64", 8);
  ways[kPackets] = PacketsOf("256", 16);
  ways[kRtt] = {"RTT", {.strategy = Strategy::kRtt, .rtt_antialiasing = antialiasing}};
  ways[kShafts] = {"shafts on the BVH", {.strategy = Strategy::kShaft}};
  ways[kSingle] = {"single rays", {.strategy = Strategy::kSingle, .structure = Structure::kKdTree}};
  return ways;
}

enum Rays : size_t { kPrimary, kShadow, kKinds };

// Milliseconds, and what was counted, of a picture's primary and shadow rays.
struct Frame {
  double milliseconds[kKinds] = {};
  QueryStats stats[kKinds];
};

// What is traced: every so many-th tile of a picture, its primary rays and the shadows of some of
// the scene's lights. Tiles are of whole tiles of RTT and whole packets alike.
struct Shot {
  uint32_t width, height;
  size_t lights;
  int antialiasing = 1;
  size_t step = 1;

  uint32_t TileSide() const { return std::lcm(kTileSide, 4 * static_cast<uint32_t>(antialiasing)); }
};

absl::StatusOr<Frame> Trace(const RttScene& scene, const Way& way, const Shot& shot) {
  SL_ASSIGN_OR_RETURN(const Camera camera,
                      LookAt(scene.view.eye, scene.view.at, scene.view.up, scene.view.fov_y_degrees,
                             shot.width, shot.height));
  const std::span<const LightSample> samples(scene.samples.data(), shot.lights);
  const std::vector<TileRect> tiles = CutImage(shot.width, shot.height, shot.TileSide());
  Frame frame;
  TileResult result;
  for (const bool lit : {false, true}) {
    QueryStats stats[kKinds];
    const double start = ThreadSeconds();
    for (size_t i = 0; i < tiles.size(); i += shot.step) {
      SL_RETURN_IF_ERROR(TraceTile(scene.indexed, camera, tiles[i], samples,
                                   {.ids = true, .depth = true, .lit = lit}, way.options, &result));
      stats[kPrimary].Add(result.primary);
      stats[kShadow].Add(result.shadow);
    }
    const double milliseconds = 1e3 * (ThreadSeconds() - start);
    // With shadows it is both.
    frame.milliseconds[lit] = lit ? milliseconds - frame.milliseconds[kPrimary] : milliseconds;
    frame.stats[lit] = stats[lit];
  }
  return frame;
}

// The frames of the ways, by turns; times are medians.
absl::StatusOr<std::vector<Frame>> ByTurns(const RttScene& scene, const Shot& shot,
                                           uint64_t repeats) {
  const std::vector<Way> ways = AllWays(shot.antialiasing);
  std::vector<Frame> frames(ways.size());
  std::vector<std::vector<double>> times[kKinds];
  for (auto& kind : times) kind.resize(ways.size());
  for (uint64_t r = 0; r <= repeats; ++r) {  // The first round warms up.
    for (size_t i = 0; i < ways.size(); ++i) {
      SL_ASSIGN_OR_RETURN(frames[i], Trace(scene, ways[i], shot));
      for (size_t kind = 0; kind < kKinds && r > 0; ++kind) {
        times[kind][i].push_back(frames[i].milliseconds[kind]);
      }
    }
  }
  for (size_t i = 0; i < ways.size(); ++i) {
    for (size_t kind = 0; kind < kKinds; ++kind) {
      frames[i].milliseconds[kind] = SpreadOf(times[kind][i]).median;
    }
  }
  return frames;
}

// How RTT fares among the ways.
struct Gains {
  double over_fours, over_best;  // Of packets.
  size_t best;                   // The way that is.
  double of_shafts;              // Over the best packets.
};
Gains GainsOf(const std::vector<Frame>& frames, Rays kind) {
  const auto ms = [&](size_t way) { return frames[way].milliseconds[kind]; };
  size_t best = kFours;
  for (size_t way = 0; way < kPacketWays; ++way) {
    if (ms(way) < ms(best)) best = way;
  }
  return {ms(kFours) / ms(kRtt), ms(best) / ms(kRtt), best, ms(best) / ms(kShafts)};
}

int RaysOf(size_t packets) { return 4 << 2 * packets; }

const char* NameOf(Rays kind) { return kind == kPrimary ? "primary" : "shadow"; }

// The two verdicts on what RTT gains: against the paper's packets, and against the best there are.
// `answered`: the share of tiles that needed no rays.
void ClaimGains(const std::string& what, const std::string& paper, double paper_gain,
                const Gains& gains, double answered, PaperReport* report) {
  const char* const best = AllWays(1)[gains.best].name;
  const std::string best_rays = absl::StrFormat("%.2f (packets of %s)", gains.over_best, best);
  report->Claim({absl::StrCat(what, ": RTT over packets of four"), paper,
                 absl::StrFormat("%.2f", gains.over_fours),
                 VerdictOfGain(gains.over_fours, paper_gain),
                 absl::StrFormat("%.0f %% of the tiles are not answered, and walk twice: their "
                                 "corners, then their rays",
                                 100 * (1 - answered))});
  report->Claim({absl::StrCat(what, ": RTT over the best packets"),
                 absl::StrCat(paper, ", where packets of four were the best"), best_rays,
                 VerdictOfGain(gains.over_best, paper_gain),
                 absl::StrFormat("packets of %s walk once where %d of four would, so that a tile's "
                                 "list has less to save",
                                 best, RaysOf(gains.best) / 4)});
}

// What RTT walked with: corners, and the rays of tiles that had no answer.
double RaysWalked(const QueryStats& stats, int antialiasing) {
  const double tile = 16.0 * antialiasing * antialiasing;
  return std::min(static_cast<double>(stats.rays),
                  tile * static_cast<double>(stats.tiles - stats.tiles_answered)) +
         4 * static_cast<double>(stats.tiles);
}

// The paper's figures, at 640×480 on a Pentium 4: milliseconds, rays, mean relevant triangles.
struct Published {
  const char* scene;
  double packets[2], rtt[2], rays[2], walked[2], relevant[2];
};
constexpr Published kPublished[] = {
    {"room", {119, 81.8}, {96.8, 70.1}, {307200, 247251}, {172524, 129461}, {1.134, 1.095}},
    {"office", {157, 2127}, {142, 1716}, {307200, 4812053}, {170928, 2356197}, {1.139, 3.246}},
    {"plants", {477, 5991}, {502, 5485}, {307200, 3708088}, {273588, 2400053}, {1.127, 4.274}}};

constexpr uint32_t kWidth = 640, kHeight = 480;
// As many rays as one round of a picture traces, about: of larger ones every so many-th tile, by a
// prime, so that no column of tiles is left out.
constexpr double kMostRays = 1.5e6;
size_t StepOf(uint32_t width, uint32_t height, uint32_t tile_side) {
  const double share = static_cast<double>(width) * height / kMostRays;
  const size_t columns = (width + tile_side - 1) / tile_side;
  for (const size_t prime :
       {1, 2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53, 59, 61, 67, 71, 73, 79}) {
    if (prime >= share && (prime == 1 || columns % prime != 0)) return prime;
  }
  return 83;
}

// A picture's side, or a tenth.
uint32_t Part(uint32_t pixels, const PaperOptions& options) {
  return options.quick ? pixels / 10 : pixels;
}

absl::Status TableOne(const std::vector<RttScene>& scenes, const PaperOptions& options,
                      PaperReport* report) {
  report->Begin("002", "Table 1",
                "640×480, one ray a pixel; milliseconds of one thread's own time. RTT, packets of "
                "4 to 256 rays and single rays on the kd-tree, shafts on the BVH; gain_4 is RTT's "
                "over packets of four rays, as the paper's (Pentium 4) beside it, gain_best over "
                "those of the side that is the fastest, shafts_gain_best and shafts_gain_rtt the "
                "shafts' over these and over RTT; count: all rays; walked: those that RTT traced");
  for (size_t i = 0; i < scenes.size(); ++i) {
    const Shot shot = {Part(kWidth, options), Part(kHeight, options), scenes[i].samples.size()};
    SL_ASSIGN_OR_RETURN(const std::vector<Frame> frames, ByTurns(scenes[i], shot, options.repeats));
    for (const Rays kind : {kPrimary, kShadow}) {
      const QueryStats& rtt = frames[kRtt].stats[kind];
      const Published& paper = kPublished[i];
      const double walked = RaysWalked(rtt, 1);
      const Gains gains = GainsOf(frames, kind);
      const double paper_gain = paper.packets[kind] / paper.rtt[kind];
      const double fewer = static_cast<double>(rtt.rays) / walked;
      const double paper_fewer = paper.rays[kind] / paper.walked[kind];
      const double answered =
          static_cast<double>(rtt.tiles_answered) / static_cast<double>(rtt.tiles);
      const double relevant = static_cast<double>(rtt.relevant_triangles) /
                              std::max(1.0, static_cast<double>(rtt.tiles_answered));
      const auto ms = [&](size_t way) { return frames[way].milliseconds[kind]; };
      report->Add({{"scene", scenes[i].name},
                   {"rays", NameOf(kind)},
                   {"count", rtt.rays},
                   {"paper_count", static_cast<uint64_t>(paper.rays[kind])},
                   {"walked", static_cast<uint64_t>(walked)},
                   {"paper_walked", static_cast<uint64_t>(paper.walked[kind])},
                   {"rtt_ms", ms(kRtt)},
                   {"packets4_ms", ms(kFours)},
                   {"packets16_ms", ms(kSixteens)},
                   {"packets64_ms", ms(kSixtyFours)},
                   {"packets256_ms", ms(kPackets)},
                   {"single_ms", ms(kSingle)},
                   {"shafts_ms", ms(kShafts)},
                   {"gain_4", gains.over_fours},
                   {"paper_gain", paper_gain},
                   {"gain_best", gains.over_best},
                   {"shafts_gain_best", gains.of_shafts},
                   {"shafts_gain_rtt", ms(kRtt) / ms(kShafts)},
                   {"fewer_rays", fewer},
                   {"paper_fewer_rays", paper_fewer},
                   {"answered", answered},
                   {"relevant", relevant},
                   {"paper_relevant", paper.relevant[kind]},
                   {"paper_packets4_ms", paper.packets[kind]},
                   {"paper_rtt_ms", paper.rtt[kind]}});
      const std::string what = absl::StrCat(scenes[i].name, ", ", NameOf(kind), " rays");
      ClaimGains(absl::StrCat(what, " at 640×480"), absl::StrFormat("%.2f", paper_gain), paper_gain,
                 gains, answered, report);
      report->Claim(
          {absl::StrCat(what, ": times fewer rays walk"), absl::StrFormat("%.2f", paper_fewer),
           absl::StrFormat("%.2f", fewer), VerdictOfGain(fewer, paper_fewer),
           absl::StrFormat("%.0f %% of the tiles are answered; their four corner rays are "
                           "counted besides, where the paper's tiles hold them already",
                           100 * answered)});
      report->Claim({absl::StrCat(what, ": mean relevant triangles of a tile"),
                     absl::StrFormat("%.2f", paper.relevant[kind]),
                     absl::StrFormat("%.2f", relevant),
                     // Fewer are better: a gain of the paper's number over ours.
                     relevant <= (1 + kGainBand) * paper.relevant[kind] ? Verdict::kHolds
                     : relevant <= 2 * paper.relevant[kind]             ? Verdict::kInPart
                                                                        : Verdict::kDoesNotHold,
                     "corners beside the tile's rays make a wider shaft, and tiles in front of "
                     "several surfaces are answered, too, with a triangle of each on their lists"});
    }
  }
  report->Conclude(
      "answered: share of tiles that needed no ray of their own; walked counts four corner rays a "
      "tile, which the paper's tiles already hold, and fewer_rays is count over walked.");
  report->End();
  return absl::OkStatus();
}

// One picture of a curve: a row for its primary rays, and one for the shadows of a light.
absl::Status AddPicture(const RttScene& scene, const Row& x, uint32_t width, uint32_t height, int n,
                        const PaperOptions& options, bool highest, PaperReport* report) {
  const auto rays = static_cast<uint32_t>(n);
  Shot shot = {.width = Part(width, options) * rays,
               .height = Part(height, options) * rays,
               .lights = 1,
               .antialiasing = n};
  shot.step = StepOf(shot.width, shot.height, shot.TileSide());
  SL_ASSIGN_OR_RETURN(const std::vector<Frame> frames,
                      ByTurns(scene, shot, std::min<uint64_t>(options.repeats, 3)));
  for (const Rays kind : {kPrimary, kShadow}) {
    const QueryStats& stats = frames[kRtt].stats[kind];
    const Gains gains = GainsOf(frames, kind);
    const std::string name = absl::StrCat(scene.name, ", ", NameOf(kind));
    Row row = {{"scene and rays", name}};
    row.update(x);
    row["tiles_of"] = shot.step;
    row["gain_4"] = gains.over_fours;
    row["gain_best"] = gains.over_best;
    row["best_packets"] = RaysOf(gains.best);
    row["shafts_gain_best"] = gains.of_shafts;
    const double answered =
        static_cast<double>(stats.tiles_answered) / std::max(1.0, static_cast<double>(stats.tiles));
    row["answered"] = answered;
    report->Add(std::move(row));
    if (highest && kind == kPrimary) {
      ClaimGains(absl::StrCat(scene.name, ", 2048×1560 with 6×6 rays a pixel"), "up to 2.43", 2.43,
                 gains, answered, report);
    }
  }
  return absl::OkStatus();
}

absl::Status Curves(const std::vector<RttScene>& scenes, const PaperOptions& options,
                    PaperReport* report, Context& context) {
  constexpr char kColumns[] =
      "RTT's gain over packets of four (gain_4) and over the best packets, primary rays and the "
      "shadows of one light; of large pictures every so many-th tile (tiles_of)";
  report->Begin("002", "Figure 7",
                absl::StrCat(kColumns,
                             "; 640×480 with n×n rays a pixel (the paper, over four: 1.1 "
                             "to 1.3 without, up to 2.5 with antialiasing at high "
                             "resolution)"));
  for (const RttScene& scene : scenes) {
    context.err << "paper 002: antialiasing, " << scene.name << std::endl;
    for (int n = 1; n <= kMaxRttAntialiasing; ++n) {
      SL_RETURN_IF_ERROR(AddPicture(scene, {{"antialiasing", n}}, kWidth, kHeight, n, options,
                                    /*highest=*/false, report));
    }
  }
  report->Plot({.x = "antialiasing", .y = "gain_4", .series = "scene and rays"});
  report->Plot({.x = "antialiasing", .y = "gain_best", .series = "scene and rays"});
  report->End();
  report->Begin("002", "Figure 8", absl::StrCat(kColumns, "; one ray a pixel"));
  for (const RttScene& scene : scenes) {
    context.err << "paper 002: resolution, " << scene.name << std::endl;
    for (const auto& [width, height] : {std::pair(320u, 240u), std::pair(640u, 480u),
                                        std::pair(1024u, 768u), std::pair(2048u, 1560u)}) {
      SL_RETURN_IF_ERROR(AddPicture(scene, {{"width", width}}, width, height, 1, options,
                                    /*highest=*/false, report));
    }
  }
  report->Plot({.x = "width", .y = "gain_4", .series = "scene and rays"});
  report->Plot({.x = "width", .y = "gain_best", .series = "scene and rays"});
  report->End();
  report->Begin("002", "Figures 7 and 8, both at their highest",
                absl::StrCat(kColumns, "; 2048×1560 with 6×6 rays a pixel"));
  for (const RttScene& scene : scenes) {
    context.err << "paper 002: resolution and antialiasing, " << scene.name << std::endl;
    SL_RETURN_IF_ERROR(AddPicture(scene, {{"width", 2048}, {"antialiasing", kMaxRttAntialiasing}},
                                  2048, 1560, kMaxRttAntialiasing, options, /*highest=*/true,
                                  report));
  }
  report->End();
  return absl::OkStatus();
}

}  // namespace

absl::Status Paper002(const PaperOptions& options, PaperReport* report, Context& context) {
  ThreadPool pool(0);
  std::vector<RttScene> scenes;
  for (const auto& [name, lights] : {std::pair("room", size_t{7}), std::pair("office", size_t{16}),
                                     std::pair("plants", size_t{16})}) {
    context.err << "paper 002: building " << name << std::endl;
    SL_ASSIGN_OR_RETURN(RttScene scene, MakeScene(name, lights, options.quick, pool));
    scenes.push_back(std::move(scene));
  }
  SL_RETURN_IF_ERROR(TableOne(scenes, options, report));
  return Curves(scenes, options, report, context);
}

}  // namespace sightline::bench

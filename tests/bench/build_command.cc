// SPDX-License-Identifier: Apache-2.0
//
// sightline-bench build: how long a scene takes to be ready, how long build and one picture take
// together, and what a triangle costs in memory, against Embree's builders.
//
// Builds are timed from either kind of arrays to ready-to-trace, in rows of their own:
//  * build-*: from stored floats and indices. Ours is BuildBvh of a compiled geometry; Embree's is
//  a
//    scene with one geometry on shared buffers, committed.
//  * load-*: from the arrays as they were read, doubles by object. Ours is CompileScene (placing,
//    rounding, checks of every vertex and index, search for triangles without area) and BuildBvh;
//    Embree's places and rounds as well, and puts the indices together, but checks nothing.
// A picture's build is that from stored floats, on both sides.
#include <algorithm>
#include <array>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/cli/exit_code.h"
#include "core/accel/bvh_refit.h"
#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "tests/bench/bench_scene.h"
#include "tests/bench/command.h"
#include "tests/bench/embree_peer.h"
#include "tests/bench/frame.h"
#include "tests/bench/measure.h"
#include "tests/bench/report.h"
#include "tests/bench/workload.h"

namespace sightline::bench {
namespace {

using Quality = EmbreeOptions::Quality;

struct Options {
  std::vector<std::string> scenes;
  std::string views, isa = "best";
  uint64_t width = 1920, height = 1080, threads = 0, repeats = 5;
  bool high = true, pictures = true, quick = false, json = false;
};

cli::FlagSet Flags(Options* o) {
  cli::FlagSet flags(
      "sightline-bench build --scene SCENE [flags]",
      "Times building against Embree's builders, building and drawing one picture with shadows, "
      "and counts bytes per triangle. Points of pictures are moved back toward the eye, on both "
      "sides alike; those of placed-pictures are placed by derived bounds on our side.");
  flags.Texts("scene", "SCENE", "a mesh file or a built-in scene", &o->scenes);
  flags.Text("views", "FILE", "views by scene, instead of views.json beside the scene file",
             &o->views);
  flags.Count("width", "PIXELS", "of the picture", &o->width, 1, kMaxImageSide);
  flags.Count("height", "PIXELS", "of the picture", &o->height, 1, kMaxImageSide);
  RegisterThreads(&flags, &o->threads);
  RegisterIsa(&flags, &o->isa);
  flags.Count("repeats", "N", "repetitions, of whose ratios the median is given", &o->repeats, 1,
              1000);
  flags.Switch("high", "also build with Embree's quality HIGH", &o->high);
  flags.Switch("pictures", "also build and draw pictures", &o->pictures);
  RegisterQuick(&flags, &o->quick);
  flags.Switch("json", "one JSON object per line, instead of a table", &o->json);
  return flags;
}

const char* QualityName(Quality quality) {
  switch (quality) {
    case Quality::kLow:
      return "LOW";
    case Quality::kMedium:
      return "MEDIUM";
    case Quality::kHigh:
      return "HIGH";
    case Quality::kRefit:
      return "REFIT";
  }
  return "";
}

// One scene, and what all its rows share.
struct Bench {
  const Options& options;
  const SceneSource& source;
  IndexedGeometry scene;  // Built with the static preset.
  const PeerMesh mesh;
  const EmbreeDevice& device;
  const int threads;
  const SimdTarget simd;
  ThreadPool& pool;
  Context& context;
};

Row CommonRow(const Bench& bench, const std::string& workload, const std::string& preset) {
  return {{"workload", workload},
          {"scene", bench.source.name},
          {"triangles", bench.scene.geometry.triangles.size()},
          {"views", 0},
          {"queries", bench.scene.geometry.triangles.size()},
          {"threads", bench.threads},
          {"isa", std::string(SimdTargetName(bench.simd))},
          {"strategy", preset}};
}

void AddTimes(const Timings& timings, size_t ours, size_t peer, const std::string& unit,
              const std::string& peer_mode, Row* row) {
  const Spread ratio = timings.Ratio(ours, peer);
  (*row)["unit"] = unit;
  (*row)["rate_per_s"] = timings.Rate(ours).median;
  (*row)["peer"] = absl::StrCat(EmbreeDevice::Name(), " robust");
  (*row)["peer_mode"] = peer_mode;
  (*row)["peer_rate_per_s"] = timings.Rate(peer).median;
  (*row)["ratio"] = ratio.median;
  (*row)["ratio_min"] = ratio.min;
  (*row)["ratio_max"] = ratio.max;
  // Builds and pictures with points of their own answer no common question.
  (*row)["disagreements"] = nullptr;
  (*row)["disagreements_beyond_rounding"] = nullptr;
}

std::unique_ptr<EmbreeScene> BuildPeer(const Bench& bench, EmbreeOptions options) {
  auto scene = EmbreeScene::Build(bench.device, bench.mesh, options);
  SIGHTLINE_CHECK(scene.ok()) << scene.status();
  return *std::move(scene);
}

Bvh BuildOurs(const Bench& bench, BvhPreset preset) {
  absl::StatusOr<Bvh> bvh = BuildBvh(bench.scene.geometry, BvhPresetOptions(preset), bench.pool);
  SIGHTLINE_CHECK(bvh.ok()) << bvh.status();
  return *std::move(bvh);
}

// As after vertices moved: they have not, so the tree stays as good as a built one.
void RefitOurs(const Bench& bench, Bvh* bvh) {
  const absl::Status status = RefitBvhInPlace(bench.scene.geometry, bench.pool, bvh);
  SIGHTLINE_CHECK(status.ok()) << status;
}

void Say(const Bench& bench, const std::string& what) {
  bench.context.err << bench.source.name << ": " << what << std::endl;
}

std::function<void(size_t)> SayRepetition(const Bench& bench, const std::string& what) {
  return [&bench, what](size_t repetition) {
    Say(bench, absl::StrCat(what, ", repetition ", repetition + 1, " of ", bench.options.repeats));
  };
}

// ---- Builds

// Seconds that the peer's mesh takes from the arrays as they were read.
Spread TimeConversions(const Bench& bench) {
  constexpr int kTimes = 5;
  std::vector<double> seconds;
  for (int i = 0; i < kTimes; ++i) {
    const double begin = Now();
    const PeerMesh mesh(bench.source.objects, bench.scene.geometry.origin, bench.pool);
    seconds.push_back(Now() - begin);
  }
  return SpreadOf(std::move(seconds));
}

void TimeBuilds(const Bench& bench, Report* report) {
  Bvh ours;
  absl::StatusOr<SceneGeometry> compiled = absl::UnknownError("not compiled");
  std::unique_ptr<EmbreeScene> peer;
  Bvh kept = BuildOurs(bench, BvhPreset::kDynamic);
  const auto kept_peer = BuildPeer(bench, {.quality = Quality::kRefit});
  std::vector<Side> sides;
  for (const BvhPreset preset : {BvhPreset::kStatic, BvhPreset::kDynamic}) {
    sides.push_back(
        {[&, preset](size_t) { ours = BuildOurs(bench, preset); }, [&] { ours = Bvh(); }});
  }
  std::vector<Quality> qualities = {Quality::kMedium, Quality::kLow};
  if (bench.options.high) qualities.push_back(Quality::kHigh);
  for (const Quality quality : qualities) {
    sides.push_back({[&, quality](size_t) { peer = BuildPeer(bench, {.quality = quality}); },
                     [&] { peer.reset(); }});
  }
  const size_t compile = sides.size();
  sides.push_back({[&](size_t) {
                     bench.pool.ParallelFor(1, 1, [&](size_t, size_t) {
                       compiled = CompileScene(bench.source.objects, std::nullopt, MeshLimits{});
                     });
                     SIGHTLINE_CHECK(compiled.ok()) << compiled.status();
                   },
                   [&] { compiled = absl::UnknownError("not compiled"); }});
  const size_t refit = sides.size();
  sides.push_back({[&](size_t) { RefitOurs(bench, &kept); }});
  sides.push_back({[&](size_t) { kept_peer->CommitMovedVertices(); }});
  Say(bench, "warming up");
  for (Side& side : sides) {
    side.run(0);
    if (side.clean_up != nullptr) side.clean_up();
  }
  const size_t triangles = bench.scene.geometry.triangles.size();
  const Timings timings = TimeByTurns({.count = 1,
                                       .queries = [&](size_t) { return triangles; },
                                       .min_seconds = MinSeconds(bench.options.quick)},
                                      sides, bench.options.repeats, SayRepetition(bench, "builds"));
  // The peer's mesh takes so little that turns of its own would be too short to time.
  const Spread convert = TimeConversions(bench);
  const auto seconds = [&](const Timings& of, size_t side) {
    return static_cast<double>(triangles) / of.Rate(side).median;
  };
  const auto add = [&](const std::string& kind, BvhPreset preset, size_t peer_side) {
    const bool is_static = preset == BvhPreset::kStatic;
    const size_t our_side = is_static ? 0 : 1;
    const std::string name = is_static ? "static" : "dynamic";
    // One run after the other, as they follow each other in use.
    Timings both = timings;
    const bool loads = kind == "load";
    for (size_t r = 0; loads && r < bench.options.repeats; ++r) {
      both.seconds[our_side][r] += timings.seconds[compile][r];
      const double passes = timings.queries[r] / static_cast<double>(triangles);
      both.seconds[peer_side][r] += passes * convert.median;
    }
    Row row = CommonRow(bench, absl::StrCat(kind, "-", name), is_static ? "STATIC" : "DYNAMIC");
    AddTimes(both, our_side, peer_side, "triangles/s", QualityName(qualities[peer_side - 2]), &row);
    row["compile_seconds"] = loads ? Row(seconds(timings, compile)) : Row();
    row["peer_convert_seconds"] = loads ? Row(convert.median) : Row();
    row["seconds"] = seconds(both, our_side);
    row["peer_seconds"] = seconds(both, peer_side);
    report->Add(WithCommonKeys(row));
  };
  for (const char* kind : {"build", "load"}) {
    add(kind, BvhPreset::kStatic, 2);
    add(kind, BvhPreset::kDynamic, 3);
    if (bench.options.high) add(kind, BvhPreset::kStatic, 4);
  }
  Row row = CommonRow(bench, "refit", "DYNAMIC");
  AddTimes(timings, refit, refit + 1, "triangles/s", QualityName(Quality::kRefit), &row);
  row["seconds"] = seconds(timings, refit);
  row["peer_seconds"] = seconds(timings, refit + 1);
  report->Add(WithCommonKeys(row));
}

// ---- Build and one picture

// The peer's best modes for the views' camera rays and shadows, on a tree of this kind.
using FrameModes = std::array<PeerMode, 2>;
FrameModes PickFrameModes(const Bench& bench, Workload& primary, Workload& shadow,
                          Quality quality) {
  Say(bench, absl::StrCat("Embree's best modes on ", QualityName(quality)));
  const auto peer = BuildPeer(bench, {.quality = quality});
  return {PickMode(primary, *peer), PickMode(shadow, *peer)};
}

absl::StatusOr<std::unique_ptr<Workload>> FrameWorkload(const Bench& bench, const char* name) {
  WorkloadSpec spec;
  spec.name = name;
  spec.width = static_cast<uint32_t>(bench.options.width);
  spec.height = static_cast<uint32_t>(bench.options.height);
  return MakeWorkload(spec, bench.source, bench.scene, bench.pool);
}

absl::Status TimeFrames(const Bench& bench, Report* report) {
  // As sides 0 .. 2 below; the others are ours.
  constexpr std::array kQualities = {Quality::kLow, Quality::kMedium, Quality::kRefit};
  std::array<FrameModes, kQualities.size()> modes;
  {
    SL_ASSIGN_OR_RETURN(const auto primary, FrameWorkload(bench, "primary"));
    SL_ASSIGN_OR_RETURN(const auto shadow, FrameWorkload(bench, "shadow"));
    for (size_t q = 0; q < kQualities.size(); ++q) {
      modes[q] = PickFrameModes(bench, *primary, *shadow, kQualities[q]);
    }
  }
  std::vector<Frame> frames;
  for (const BuiltinView& view : bench.source.views) {
    SL_ASSIGN_OR_RETURN(Frame frame, Frame::Make(view, static_cast<uint32_t>(bench.options.width),
                                                 static_cast<uint32_t>(bench.options.height),
                                                 bench.scene.geometry, bench.pool));
    frames.push_back(std::move(frame));
  }
  std::unique_ptr<EmbreeScene> peer;
  const auto refitted = BuildPeer(bench, {.quality = Quality::kRefit});
  std::vector<Side> sides;
  for (const size_t q : {0, 1}) {
    sides.push_back({[&, q](size_t view) {
                       peer = BuildPeer(bench, {.quality = kQualities[q]});
                       frames[view].DrawPeer(*peer, modes[q][0], modes[q][1]);
                     },
                     [&] { peer.reset(); }});
  }
  sides.push_back({[&](size_t view) {
    refitted->CommitMovedVertices();
    frames[view].DrawPeer(*refitted, modes[2][0], modes[2][1]);
  }});
  IndexedGeometry built, kept;
  built.geometry = bench.scene.geometry;
  kept.geometry = bench.scene.geometry;
  kept.bvh = BuildOurs(bench, BvhPreset::kDynamic);
  const QueryOptions options{.simd = bench.simd};
  std::vector<std::string> our_workloads;
  for (const auto& [points, picture] : {std::pair{Frame::Points::kSteppedBack, "picture"},
                                        std::pair{Frame::Points::kPlaced, "placed-picture"}}) {
    our_workloads.push_back(absl::StrCat("build-and-", picture));
    sides.push_back({[&, points = points](size_t view) {
                       built.bvh = BuildOurs(bench, BvhPreset::kDynamic);
                       frames[view].DrawOurs(built, points, options);
                     },
                     [&] { built.bvh = Bvh(); }});
    our_workloads.push_back(absl::StrCat("refit-and-", picture));
    sides.push_back({[&, points = points](size_t view) {
      RefitOurs(bench, &kept.bvh);
      frames[view].DrawOurs(kept, points, options);
    }});
  }
  std::vector<uint64_t> lit(sides.size());
  for (size_t view = 0; view < frames.size(); ++view) {  // A round to warm up.
    for (size_t side = 0; side < sides.size(); ++side) {
      sides[side].run(view);
      if (sides[side].clean_up != nullptr) sides[side].clean_up();
      lit[side] += side < kQualities.size() ? frames[view].peer_lit() : frames[view].our_lit();
    }
  }
  const Timings timings =
      TimeByTurns({.count = frames.size(),
                   .queries = [](size_t) { return uint64_t{1}; },
                   .min_seconds = MinSeconds(bench.options.quick)},
                  sides, bench.options.repeats, SayRepetition(bench, "pictures"));
  size_t best = 0;
  for (size_t side = 1; side < kQualities.size(); ++side) {
    if (timings.Rate(side).median > timings.Rate(best).median) best = side;
  }
  for (size_t ours = kQualities.size(); ours < sides.size(); ++ours) {
    Row row = CommonRow(bench, our_workloads[ours - kQualities.size()], "DYNAMIC");
    row["views"] = frames.size();
    row["queries"] = frames.size();
    AddTimes(timings, ours, best, "pictures/s",
             absl::StrCat(QualityName(kQualities[best]), ", ", modes[best][0].Name(), ", ",
                          modes[best][1].Name()),
             &row);
    for (size_t q = 0; q < kQualities.size(); ++q) {
      const std::string name = QualityName(kQualities[q]);
      row[absl::StrCat("ratio_to_", name)] = timings.Ratio(ours, q).median;
      row[absl::StrCat("peer_modes_", name)] =
          absl::StrCat(modes[q][0].Name(), ", ", modes[q][1].Name());
    }
    row["lit"] = lit[ours];
    row["peer_lit"] = lit[best];
    row["width"] = bench.options.width;
    row["height"] = bench.options.height;
    report->Add(WithCommonKeys(row));
  }
  return absl::OkStatus();
}

// ---- Bytes

// Vertices, indices and everything built over them, of the default presets and of the compact ones.
void CountBytes(const Bench& bench, Report* report) {
  const double triangles = static_cast<double>(bench.scene.geometry.triangles.size());
  for (const bool compact : {false, true}) {
    const Bvh bvh = BuildOurs(bench, compact ? BvhPreset::kCompact : BvhPreset::kStatic);
    const double ours =
        static_cast<double>(bench.scene.geometry.MemoryBytes() + bvh.MemoryBytes()) / triangles;
    const int64_t before = bench.device.allocated_bytes();
    const auto peer = BuildPeer(bench, {.quality = Quality::kMedium, .compact = compact});
    const int64_t structure = bench.device.allocated_bytes() - before;
    const double theirs =
        static_cast<double>(structure + static_cast<int64_t>(bench.mesh.bytes())) / triangles;
    Row row = CommonRow(bench, "bytes-per-triangle", compact ? "COMPACT" : "STATIC");
    row["unit"] = "bytes/triangle";
    row["rate_per_s"] = nullptr;
    row["peer"] = absl::StrCat(EmbreeDevice::Name(), " robust");
    row["peer_mode"] = compact ? "MEDIUM compact" : "MEDIUM";
    row["peer_rate_per_s"] = nullptr;
    row["bytes_per_triangle"] = ours;
    row["peer_bytes_per_triangle"] = theirs;
    row["ratio"] = ours / theirs;  // Of memory: less is better.
    row["ratio_min"] = ours / theirs;
    row["ratio_max"] = ours / theirs;
    row["disagreements"] = nullptr;
    row["disagreements_beyond_rounding"] = nullptr;
    report->Add(WithCommonKeys(row));
  }
}

// ---- The table

// A rate or an amount, in its row's unit.
std::function<std::string(const Row&)> Amount(const std::string& rate, const std::string& bytes) {
  return [rate, bytes](const Row& row) {
    const std::string unit = row.at("unit");
    if (unit == "bytes/triangle") {
      return absl::StrFormat("%.1f B/triangle", row.at(bytes).get<double>());
    }
    if (unit == "triangles/s") {
      return absl::StrFormat("%.2f M triangles/s", row.at(rate).get<double>() * 1e-6);
    }
    return absl::StrFormat("%.2f %s", row.at(rate).get<double>(), unit);
  };
}

std::vector<Column> Columns() {
  return {TextColumn("workload", "workload"),
          TextColumn("scene", "scene"),
          CountColumn("triangles", "triangles"),
          TextColumn("preset", "strategy"),
          {"ours", Amount("rate_per_s", "bytes_per_triangle")},
          {"Embree", Amount("peer_rate_per_s", "peer_bytes_per_triangle")},
          SpreadColumn("ratio", "ratio"),
          TextColumn("Embree's mode", "peer_mode")};
}

absl::Status RunScene(const Options& options, const std::string& name, Context& context,
                      Report* report) {
  SL_ASSIGN_OR_RETURN(const SimdTarget simd, ResolveIsa(options.isa));
  const int threads = ResolveThreads(options.threads);
  context.err << name << ": reading" << std::endl;
  SL_ASSIGN_OR_RETURN(const SceneSource source, ReadScene(name, options.views));
  ThreadPool pool(threads);
  SL_ASSIGN_OR_RETURN(IndexedGeometry scene,
                      IndexScene(source, {.bvh = BvhPresetOptions(BvhPreset::kStatic)}, pool));
  if (scene.bvh.empty()) {
    return absl::InvalidArgumentError(
        absl::StrCat("'", source.name, "' has no triangle that can be hit"));
  }
  SL_ASSIGN_OR_RETURN(const auto device, EmbreeDevice::Open(threads, simd));
  PeerMesh mesh(scene.geometry);
  const Bench bench{options, source, std::move(scene), std::move(mesh), *device, threads,
                    simd,    pool,   context};
  CountBytes(bench, report);
  TimeBuilds(bench, report);
  if (!options.pictures) return absl::OkStatus();
  if (!source.views.empty()) return TimeFrames(bench, report);
  Say(bench, "no views, hence no picture");
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<bool> BuildCommand(std::span<const std::string> args, Context& context) {
  Options options;
  cli::FlagSet flags = Flags(&options);
  SL_ASSIGN_OR_RETURN(const bool go_on, ParseOrHelp(&flags, args, context));
  if (!go_on) return true;
  if (options.scenes.empty()) return cli::UsageError("wants --scene");
  Report report(Columns(), options.json, context.out);
  SL_RETURN_IF_ERROR(RunScenes(options.scenes, &report, context.err, [&](const std::string& scene) {
    return RunScene(options, scene, context, &report);
  }));
  return true;
}

}  // namespace sightline::bench

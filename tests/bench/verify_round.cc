// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/verify_round.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <utility>

#include "absl/strings/str_cat.h"
#include "core/base/check.h"
#include "core/mesh/rebase.h"

namespace sightline::bench {
namespace {

constexpr absl::string_view kSingle = "SINGLE", kWalk = "independent walk",
                            kBruteForce = "brute force";

bool Bit(const std::vector<uint8_t>& bits, size_t i) { return (bits[i / 8] >> (i % 8) & 1) != 0; }
bool SameFloat(float a, float b) {
  return std::bit_cast<uint32_t>(a) == std::bit_cast<uint32_t>(b);
}

}  // namespace

VerifyRound::VerifyRound(const VerifyScene& scene, const VerifyOptions& options, Random random,
                         std::string name, VerifyReport* report)
    : scene_(scene), options_(options), random_(random), name_(std::move(name)), report_(*report) {}

std::string VerifyRound::Way::Name() const {
  return absl::StrCat(
      StrategyName(strategy), " on ",
      SimdTargetName(simd == SimdTarget::kBest ? BestSimdTarget() : simd),
      structure == Structure::kAuto ? "" : absl::StrCat(", ", StructureName(structure)),
      culling ? ", culling in leaves" : "", bit_by_bit ? ", bit by bit with hints" : "");
}

void VerifyRound::Run() {
  ++report_.rounds;
  if (random_.Chance(0.2)) mask_ = 1u << random_.Below(3);
  rtt_shared_edges_ = random_.Chance(0.3);
  Placer placer(scene_.indexed, random_);
  switch (random_.Below(5)) {
    case 0:
      return RunSegments();
    case 1:
      return RunShadows(MakeVerifyPoints(scene_.indexed, placer, random_));
    default:
      return RunTiles();
  }
}

LeafCulling VerifyRound::SomeCulling() {
  LeafCulling culling;
  if (random_.Chance(0.3)) return culling;
  culling.side_planes = random_.Chance(0.7);
  culling.near_far = random_.Chance(0.7);
  culling.aperture = random_.Chance(0.7);
  culling.aperture_first = random_.Chance(0.5);
  culling.skip_edges = random_.Chance(0.7);
  culling.frustum = kAllFrustumRays[random_.Below(kAllFrustumRays.size())];
  culling.first_axis = random_.Chance(0.3);
  culling.ray_mask = random_.Chance(0.7);
  culling.node_test = kAllNodeTests[random_.Below(kAllNodeTests.size())];
  culling.split = kAllPacketSplits[random_.Below(kAllPacketSplits.size())];
  culling.ray_box = random_.Chance(0.8);
  culling.ray_box_min_triangles = static_cast<uint32_t>(random_.Below(20));
  culling.ray_box_update = random_.Chance(0.7);
  culling.mailbox = random_.Chance(0.4);
  culling.cell_boxes = random_.Chance(0.4);
  return culling;
}

VerifyRound::Way VerifyRound::OtherOnBvh() {
  std::vector<Way> others;
  for (const SimdTarget simd : {SimdTarget::kAvx2, SimdTarget::kAvx512}) {
    if (!SimdTargetAvailable(simd)) continue;
    for (const Strategy strategy :
         {Strategy::kSingle, Strategy::kPacket, Strategy::kShaft, Strategy::kAuto}) {
      if (strategy == Strategy::kSingle && simd == BestSimdTarget()) continue;  // The truth.
      if (strategy == Strategy::kAuto && simd == BestSimdTarget()) continue;    // Always there.
      others.push_back({strategy, simd});
    }
    for (const Strategy strategy : {Strategy::kSingle, Strategy::kPacket}) {
      others.push_back({.strategy = strategy, .simd = simd, .culling = LeafCulling()});
    }
  }
  Way way = others[random_.Below(others.size())];
  if (way.culling) way.culling = SomeCulling();
  way.packet_side = kPacketSides[random_.Below(kPacketSides.size())];
  way.pixel_shadow_packets = random_.Chance(0.5);
  return way;
}

VerifyRound::Way VerifyRound::OnAnotherTree() {
  const bool kd_tree = scene_.indexed.kd_tree.has_value();
  const bool binary = scene_.indexed.binary_bvh.has_value();
  if (!kd_tree && !binary) return OtherOnBvh();
  std::vector<Way> ways;
  for (const Strategy strategy : {Strategy::kSingle, Strategy::kPacket, Strategy::kAuto}) {
    for (const bool culls : {false, true}) {
      if (culls && strategy == Strategy::kAuto) continue;
      Way way{.strategy = strategy};
      if (culls) way.culling = SomeCulling();
      way.structure = Structure::kKdTree;
      if (kd_tree) ways.push_back(way);
      way.structure = Structure::kBinaryBvh;
      if (binary) ways.push_back(way);
    }
  }
  if (kd_tree) {
    // As likely as all others together: it has most of its own.
    const Way rtt{.strategy = Strategy::kRtt};
    ways.insert(ways.end(), ways.size(), rtt);
  }
  Way way = ways[random_.Below(ways.size())];
  way.packet_side = kPacketSides[random_.Below(kPacketSides.size())];
  way.pixel_shadow_packets = random_.Chance(0.5);
  if (SimdTargetAvailable(SimdTarget::kAvx512) && random_.Chance(0.5)) {
    way.simd = SimdTarget::kAvx512;
  } else {
    way.simd = SimdTarget::kAvx2;
  }
  return way;
}

std::vector<VerifyRound::Way> VerifyRound::SomeWays() {
  return {{Strategy::kAuto, BestSimdTarget()}, OtherOnBvh(), OnAnotherTree()};
}

QueryOptions VerifyRound::Ask(const Way& way) const {
  return {.strategy = way.strategy,
          .structure = way.structure,
          .rtt_shared_edges = rtt_shared_edges_,
          .leaf_culling = way.culling,
          .packet_side = way.packet_side,
          .pixel_shadow_packets = way.pixel_shadow_packets,
          .simd = way.simd,
          .mask = mask_};
}

bool VerifyRound::BruteForceAllowed() const {
  return scene_.indexed.geometry.triangles.size() <= options_.max_brute_force_triangles;
}

uint64_t VerifyRound::BruteForceRays() const {
  const uint64_t triangles = scene_.indexed.geometry.triangles.size();
  return std::clamp<uint64_t>(options_.brute_force_tests / triangles, 1, 1024);
}

void VerifyRound::Compare(absl::string_view kind, const Way& way, absl::string_view reference,
                          size_t count, const Same& same) {
  VerifyReport::Tally& tally =
      report_.tallies[{std::string(kind), way.Name(), std::string(reference)}];
  tally.compared += count;
  if (way.strategy == Strategy::kAuto && way.structure == Structure::kAuto) {
    if (reference == kSingle) report_.auto_rays += count;
    if (reference == kBruteForce) report_.brute_force_rays += count;
  }
  for (size_t i = 0; i < count; ++i) {
    std::string what;
    if (same(i, &what)) continue;
    ++tally.different;
    ++report_.different;
    if (report_.differences.size() >= VerifyReport::kMostDifferences) continue;
    report_.differences.push_back(absl::StrCat(name_, ", ", scene_.name, ", ", kind, ": ",
                                               way.Name(), ", packets of ", way.packet_side,
                                               " square, against ", reference, ": ", what));
  }
}

// ---- Tiles

void VerifyRound::RunTiles() {
  Placer placer(scene_.indexed, random_);
  const CameraCase camera = MakeCamera(scene_.indexed, placer, random_);
  const size_t pixels = size_t{camera.tile.width} * camera.tile.height;
  report_.places[absl::StrCat("eye ", PlaceKindName(camera.eye))] += pixels;
  // With lights the tile shades its own hits; without, its hits may become points.
  // Not a large one: that is for many camera rays.
  const bool large = pixels > 64 * 64;
  LightCase lights;
  if (!large && random_.Chance(0.3)) {
    PreparedPoints one;
    one.positions = {placer.OnTriangle(placer.Triangle())};
    one.valid = {1};
    lights = MakeVerifyLights(scene_.indexed, one, placer, random_);
    if (lights.extreme && pixels > kExtremeRays) lights = {};
  }
  const bool lit = !lights.samples.empty(), points = !large && !lit && random_.Chance(0.5);
  const std::vector<Mirror> mirrors =
      MakeVerifyMirrors(scene_.indexed, camera.camera, placer, random_);
  if (!mirrors.empty()) report_.places["eye before a mirror"] += pixels;
  TileOutputs outputs{.hits = true,
                      .ids = true,
                      .depth = true,
                      .uv = true,
                      .lit = lit,
                      .mirrors = !mirrors.empty()};
  const auto trace = [&](const Way& way, const TileOutputs& wanted, TileResult* result) {
    const absl::Status status = TraceTile(scene_.indexed, camera.camera, camera.tile,
                                          lights.samples, mirrors, wanted, Ask(way), result);
    SIGHTLINE_CHECK(status.ok()) << name_ << ", " << scene_.name << ": " << status;
  };
  const Way truth_way{Strategy::kSingle, BestSimdTarget()};
  TileResult truth;
  TileOutputs truth_outputs = outputs;
  truth_outputs.points = points;
  trace(truth_way, truth_outputs, &truth);
  CheckPixels(camera, mirrors, truth_way, truth);
  for (const Way& way : SomeWays()) {
    TileResult got;
    trace(way, outputs, &got);
    CompareTiles(way, kSingle, got, truth, lights.samples.size());
    if (way.strategy != Strategy::kAuto) continue;
    CheckPixels(camera, mirrors, way, got);
    TileResult hits;  // Hits alone are answered by any hit.
    trace(way, {.hits = true}, &hits);
    Compare("hits alone", way, kSingle, pixels, [&](size_t i, std::string* what) {
      if (Bit(hits.hit_bits, i) == Bit(truth.hit_bits, i)) return true;
      *what = absl::StrCat("pixel ", i, ": ", Bit(truth.hit_bits, i) ? "missed" : "hit");
      return false;
    });
  }
  if (points && truth.points.size() > 0) RunShadows(truth.points);
}

void VerifyRound::CompareTiles(const Way& way, absl::string_view reference, const TileResult& got,
                               const TileResult& truth, size_t samples) {
  const size_t n = truth.triangle.size(), row = (n + 7) / 8;
  Compare("tiles", way, reference, n, [&](size_t i, std::string* what) {
    if (got.triangle[i] == truth.triangle[i] && SameFloat(got.depth[i], truth.depth[i]) &&
        SameFloat(got.u[i], truth.u[i]) && SameFloat(got.v[i], truth.v[i]) &&
        Bit(got.hit_bits, i) == Bit(truth.hit_bits, i) &&
        (got.mirror_bits.empty() || Bit(got.mirror_bits, i) == Bit(truth.mirror_bits, i))) {
      return true;
    }
    *what = absl::StrCat("pixel ", i, ": triangle ", got.triangle[i], " at ", got.depth[i],
                         ", not ", truth.triangle[i], " at ", truth.depth[i]);
    return false;
  });
  if (got.lit_bits.empty()) return;
  Compare("lit pixels", way, reference, n * samples, [&](size_t i, std::string* what) {
    const size_t bit = i / n * row * 8 + i % n;
    if (Bit(got.lit_bits, bit) == Bit(truth.lit_bits, bit)) return true;
    *what = absl::StrCat("sample ", i / n, ", pixel ", i % n, ": ",
                         Bit(got.lit_bits, bit) ? "lit" : "not lit");
    return false;
  });
}

Hit VerifyRound::WalkPixel(const CameraCase& camera, const PreparedMirrors& mirrors, uint32_t x,
                           uint32_t y) const {
  const SceneGeometry& geometry = scene_.indexed.geometry;
  Vec3f eye;
  SIGHTLINE_CHECK(Rebase(camera.camera.eye, geometry.origin, &eye));
  const Vec3f direction = PixelDirection(camera.camera, x, y);
  const Hit hit =
      scene_.walk.Closest(geometry, {.ray = PredicateRay::Ray(eye, direction), .mask = mask_});
  for (const PreparedMirror& mirror : mirrors.all()) {
    if (!mirror.triangles().Holds(hit.triangle)) continue;
    return scene_.walk.Closest(geometry,
                               {.ray = PredicateRay::Ray(mirror.eye(), mirror.Direction(direction)),
                                .mask = mask_,
                                .near = hit.t,
                                .unseen = mirror.triangles()});
  }
  return hit;
}

// A way's answers against the independent walk and brute force, on some pixels.
void VerifyRound::CheckPixels(const CameraCase& camera, const std::vector<Mirror>& mirrors,
                              const Way& way, const TileResult& got) {
  const TileRect& tile = camera.tile;
  Vec3f eye;
  SIGHTLINE_CHECK(Rebase(camera.camera.eye, scene_.indexed.geometry.origin, &eye));
  const auto prepared = PreparedMirrors::Prepare(scene_.indexed.geometry, mirrors, eye);
  SIGHTLINE_CHECK(prepared.ok()) << prepared.status();
  const size_t n = got.triangle.size();
  Compare("tiles", way, kWalk, std::min<size_t>(n, options_.walked_rays),
          [&](size_t, std::string* what) {
            const size_t i = random_.Below(n);
            const Hit hit =
                WalkPixel(camera, *prepared, tile.x + static_cast<uint32_t>(i) % tile.width,
                          tile.y + static_cast<uint32_t>(i) / tile.width);
            if (hit.triangle == got.triangle[i] && SameFloat(hit.t, got.depth[i])) return true;
            *what = absl::StrCat("pixel ", i, ": triangle ", got.triangle[i], " at ", got.depth[i],
                                 ", not ", hit.triangle, " at ", hit.t);
            return false;
          });
  if (!BruteForceAllowed()) return;
  const uint32_t side = static_cast<uint32_t>(std::sqrt(static_cast<double>(BruteForceRays())));
  TileRect part{.width = std::min(side, tile.width), .height = std::min(side, tile.height)};
  const uint32_t dx = static_cast<uint32_t>(random_.Below(tile.width - part.width + 1));
  const uint32_t dy = static_cast<uint32_t>(random_.Below(tile.height - part.height + 1));
  part.x = tile.x + dx;
  part.y = tile.y + dy;
  TileResult truth;
  const absl::Status status =
      TraceTile(scene_.indexed, camera.camera, part, {}, mirrors,
                {.ids = true, .depth = true, .uv = true}, Ask({Strategy::kBruteForce}), &truth);
  SIGHTLINE_CHECK(status.ok()) << status;
  Compare("tiles", way, kBruteForce, truth.triangle.size(), [&](size_t k, std::string* what) {
    const size_t i = (dy + k / part.width) * tile.width + dx + k % part.width;
    if (got.triangle[i] == truth.triangle[k] && SameFloat(got.depth[i], truth.depth[k]) &&
        SameFloat(got.u[i], truth.u[k]) && SameFloat(got.v[i], truth.v[k])) {
      return true;
    }
    *what = absl::StrCat("pixel ", i, ": triangle ", got.triangle[i], " at ", got.depth[i],
                         ", not ", truth.triangle[k], " at ", truth.depth[k]);
    return false;
  });
}

// ---- Shadows

void VerifyRound::RunShadows(PreparedPoints points) {
  Placer placer(scene_.indexed, random_);
  LightCase lights = MakeVerifyLights(scene_.indexed, points, placer, random_);
  if (lights.extreme && points.size() > kExtremeRays) {
    points.positions.resize(kExtremeRays);
    if (!points.sources.empty()) points.sources.resize(kExtremeRays);
    points.valid.resize(kExtremeRays);
  }
  const size_t n = points.size(), samples = lights.samples.size();
  report_.places[absl::StrCat(lights.directional ? "direction " : "light ",
                              PlaceKindName(lights.kind))] += n * samples;
  if (random_.Chance(0.2)) points.sources.clear();
  double t_min = 0;
  if (random_.Chance(0.2)) t_min = random_.Chance(0.5) ? 0x1p-10 : random_.Uniform(0, 0.9);
  const ShadowOptions shadow{.t_min = t_min};
  const bool blockers = random_.Chance(0.3);
  const auto compute = [&](const Way& way, const ShadowOutputs& outputs, ShadowResult* result) {
    const absl::Status status =
        ComputeShadows(scene_.indexed, PointRange::All(points), lights.samples, {}, shadow, outputs,
                       Ask(way), result);
    SIGHTLINE_CHECK(status.ok()) << name_ << ", " << scene_.name << ": " << status;
  };
  const Way truth_way{Strategy::kSingle, BestSimdTarget()};
  ShadowResult truth;
  compute(truth_way, {.bits = true, .blockers = blockers}, &truth);
  CheckPairs(points, lights.samples, t_min, truth_way, truth);
  if (!blockers) CompareBitByBit(points, lights.samples, t_min, truth);
  for (const Way& way : SomeWays()) {
    ShadowResult got;
    compute(way, {.bits = true, .blockers = blockers}, &got);
    CompareShadows(way, kSingle, got, truth, n, samples);
    if (way.strategy != Strategy::kAuto) continue;
    if (blockers) {  // Bits alone are answered by any hit.
      compute(way, {.bits = true}, &got);
      CompareShadows(way, kSingle, got, truth, n, samples);
    }
    CheckPairs(points, lights.samples, t_min, way, got);
  }
}

// AUTO again, as points come that are handed over in parts: each with what the ones before left,
// and said to be in order, or brought into one, by depth or in space, as after rays that were dear.
void VerifyRound::CompareBitByBit(const PreparedPoints& points,
                                  std::span<const LightSample> samples, double t_min,
                                  const ShadowResult& truth) {
  if (!random_.Chance(0.3)) return;
  Way way{Strategy::kAuto, BestSimdTarget()};
  way.bit_by_bit = true;
  const size_t n = points.size(), row = (n + 7) / 8, part = 1 + random_.Below(n);
  const bool ordered = random_.Chance(0.5);
  const float ray_cost = static_cast<float>(random_.Uniform(50, 1000));
  ShadowHints hints;
  const PointRange all = PointRange::All(points);
  for (size_t first = 0; first < n; first += part) {
    const size_t count = std::min(part, n - first), part_row = (count + 7) / 8;
    const PointRange range{all.positions.subspan(first, count),
                           all.sources.empty() ? all.sources : all.sources.subspan(first, count),
                           all.valid.subspan(first, count)};
    ShadowResult got;
    if (!ordered) hints.ray_cost = ray_cost;
    const absl::Status status = ComputeShadows(
        scene_.indexed, range, samples, {}, {.t_min = t_min, .ordered = ordered, .hints = &hints},
        {.bits = true}, Ask(way), &got);
    SIGHTLINE_CHECK(status.ok()) << name_ << ", " << scene_.name << ": " << status;
    Compare("shadows", way, kSingle, count * samples.size(), [&](size_t i, std::string* what) {
      const size_t s = i / count, p = first + i % count;
      const bool lit = Bit(truth.lit_bits, s * row * 8 + p);
      if (Bit(got.lit_bits, s * part_row * 8 + i % count) == lit) return true;
      *what = absl::StrCat("sample ", s, ", point ", p, " of parts of ", part, ": ",
                           lit ? "not lit" : "lit");
      return false;
    });
  }
}

void VerifyRound::CompareShadows(const Way& way, absl::string_view reference,
                                 const ShadowResult& got, const ShadowResult& truth, size_t points,
                                 size_t samples) {
  const size_t row = (points + 7) / 8;
  const bool blockers = !got.blocker.empty() && !truth.blocker.empty();
  Compare(blockers ? "blockers" : "shadows", way, reference, points * samples,
          [&](size_t i, std::string* what) {
            const size_t bit = i / points * row * 8 + i % points;
            if (Bit(got.lit_bits, bit) == Bit(truth.lit_bits, bit) &&
                (!blockers || (got.blocker[i] == truth.blocker[i] &&
                               SameFloat(got.blocker_t[i], truth.blocker_t[i])))) {
              return true;
            }
            *what = absl::StrCat("sample ", i / points, ", point ", i % points, ": ",
                                 Bit(got.lit_bits, bit) ? "lit" : "not lit");
            if (blockers) {
              absl::StrAppend(what, ", blocker ", got.blocker[i], ", not ", truth.blocker[i]);
            }
            return false;
          });
}

void VerifyRound::CheckPairs(const PreparedPoints& points, std::span<const LightSample> samples,
                             double t_min, const Way& way, const ShadowResult& got) {
  const size_t n = points.size(), row = (n + 7) / 8;
  Compare("shadows", way, kWalk, std::min<size_t>(n * samples.size(), options_.walked_rays),
          [&](size_t, std::string* what) {
            const size_t s = random_.Below(samples.size()), p = random_.Below(n);
            const LightSample& sample = samples[s];
            bool lit = false;
            if (points.valid[p] && sample.valid) {
              TraceRay query{.mask = mask_ & sample.mask};
              const uint32_t source = points.sources.empty() ? kNoTriangle : points.sources[p];
              // The shortened end, as core/query/shadows.h defines it.
              Vec3f end = points.positions[p];
              if (t_min != 0) {
                const Vec3d from = ToDouble(end), light = ToDouble(sample.value);
                end = ToFloat(from + (sample.directional ? light : light - from) * t_min);
              }
              if (sample.directional) {
                query.ray = PredicateRay::Ray(end, sample.value);
                query.from_source = source;
                query.to_source = sample.source_triangle;
              } else {
                query.ray = PredicateRay::Segment(sample.value, end);
                query.from_source = sample.source_triangle;
                query.to_source = source;
              }
              lit = scene_.walk.Closest(scene_.indexed.geometry, query).triangle == kNoTriangle;
            }
            if (Bit(got.lit_bits, s * row * 8 + p) == lit) return true;
            *what = absl::StrCat("sample ", s, ", point ", p, ": ", lit ? "not lit" : "lit");
            return false;
          });
  if (!BruteForceAllowed()) return;
  // A slice of the points against all samples.
  const size_t count =
      std::clamp<size_t>(static_cast<size_t>(BruteForceRays()) / samples.size(), 1, n);
  const size_t first = random_.Below(n - count + 1), part_row = (count + 7) / 8;
  const PointRange all = PointRange::All(points);
  const PointRange part{all.positions.subspan(first, count),
                        all.sources.empty() ? all.sources : all.sources.subspan(first, count),
                        all.valid.subspan(first, count)};
  ShadowResult truth;
  const absl::Status status = ComputeShadows(scene_.indexed, part, samples, {}, {.t_min = t_min},
                                             {.bits = true}, Ask({Strategy::kBruteForce}), &truth);
  SIGHTLINE_CHECK(status.ok()) << status;
  Compare("shadows", way, kBruteForce, count * samples.size(), [&](size_t i, std::string* what) {
    const size_t s = i / count, p = first + i % count;
    const bool lit = Bit(truth.lit_bits, s * part_row * 8 + i % count);
    if (Bit(got.lit_bits, s * row * 8 + p) == lit) return true;
    *what = absl::StrCat("sample ", s, ", point ", p, ": ", lit ? "not lit" : "lit");
    return false;
  });
}

// ---- Segments

void VerifyRound::RunSegments() {
  Placer placer(scene_.indexed, random_);
  const PreparedSegments segments = MakeVerifySegments(placer, random_);
  const size_t n = segments.size();
  report_.places["segments, both ends anyhow"] += n;
  const auto test = [&](const PreparedSegments& some, const Way& way, bool first_hits,
                        SegmentResult* result) {
    const absl::Status status = TestSegments(
        scene_.indexed, some, {.bits = true, .first_hits = first_hits}, Ask(way), result);
    SIGHTLINE_CHECK(status.ok()) << name_ << ", " << scene_.name << ": " << status;
  };
  const Way truth_way{Strategy::kSingle, BestSimdTarget()};
  SegmentResult truth;
  test(segments, truth_way, true, &truth);
  for (const Way& way : SomeWays()) {
    SegmentResult got;
    test(segments, way, true, &got);
    CompareSegments(way, kSingle, got, truth, 0);
    test(segments, way, false, &got);
    CompareSegments(way, kSingle, got, truth, 0);
  }
  const Way auto_way{Strategy::kAuto, BestSimdTarget()};
  SegmentResult got;
  test(segments, auto_way, true, &got);
  for (const bool ours : {false, true}) {
    const Way way = ours ? auto_way : truth_way;
    const SegmentResult& result = ours ? got : truth;
    Compare("segments", way, kWalk, std::min<size_t>(n, options_.walked_rays),
            [&](size_t, std::string* what) {
              const size_t i = random_.Below(n);
              const Hit hit = scene_.walk.Closest(
                  scene_.indexed.geometry,
                  {.ray = PredicateRay::Segment(segments.from[i], segments.to[i]),
                   .mask = mask_,
                   .from_source = segments.from_source[i],
                   .to_source = segments.to_source[i]});
              if (hit.triangle == result.triangle[i]) return true;
              *what = absl::StrCat("segment ", i, ": triangle ", result.triangle[i], ", not ",
                                   hit.triangle);
              return false;
            });
  }
  if (!BruteForceAllowed()) return;
  const size_t count = std::min<size_t>(n, static_cast<size_t>(BruteForceRays()));
  const size_t first = random_.Below(n - count + 1);
  const auto cut = [&](const auto& all) {
    const auto begin = all.begin() + static_cast<ptrdiff_t>(first);
    return std::vector(begin, begin + static_cast<ptrdiff_t>(count));
  };
  const PreparedSegments part{.from = cut(segments.from),
                              .to = cut(segments.to),
                              .from_source = cut(segments.from_source),
                              .to_source = cut(segments.to_source),
                              .valid = cut(segments.valid)};
  SegmentResult brute;
  test(part, {Strategy::kBruteForce}, true, &brute);
  CompareSegments(truth_way, kBruteForce, truth, brute, first);
  CompareSegments(auto_way, kBruteForce, got, brute, first);
}

// `truth` holds the segments from number `first` on of those that `got` holds.
void VerifyRound::CompareSegments(const Way& way, absl::string_view reference,
                                  const SegmentResult& got, const SegmentResult& truth,
                                  size_t first) {
  const bool hits = !got.triangle.empty();
  Compare(
      hits ? "segments, first hits" : "segments", way, reference, truth.triangle.size(),
      [&](size_t k, std::string* what) {
        const size_t i = first + k;
        if (Bit(got.blocked_bits, i) == Bit(truth.blocked_bits, k) &&
            (!hits || (got.triangle[i] == truth.triangle[k] && SameFloat(got.t[i], truth.t[k])))) {
          return true;
        }
        *what = absl::StrCat("segment ", i, ": ", Bit(got.blocked_bits, i) ? "blocked" : "free");
        if (hits) absl::StrAppend(what, " by ", got.triangle[i], ", not ", truth.triangle[k]);
        return false;
      });
}

}  // namespace sightline::bench

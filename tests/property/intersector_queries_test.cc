// SPDX-License-Identifier: Apache-2.0
//
// The papers' tests in what queries ask beyond camera and shadow rays: what mirrors show, lights
// asked about with a tile, packets of shadows by the pixels' own squares, shadows that end before
// their points, and pictures relit over hits that were kept. Every walk that takes such a test,
// over every structure, against brute force by it: what differs lies within the test's bound. And
// brute force is what the test says of the triangles in turn (paper_answers.h), of the rays that
// the contracts of core/query name: a fault in what all walks are asked would show in none of them
// against another.
#include <array>
#include <bit>
#include <cstdint>
#include <iostream>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/string_view.h"
#include "core/accel/binary_bvh_builder.h"
#include "core/base/parallel.h"
#include "core/mesh/rebase.h"
#include "core/query/relighting.h"
#include "core/query/shadows.h"
#include "core/query/tiles.h"
#include "gtest/gtest.h"
#include "tests/core/intersect/intersector_answers.h"
#include "tests/core/traverse/nasty_scenes.h"
#include "tests/property/grid_options.h"
#include "tests/property/paper_answers.h"
#include "tests/property/query_cases.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline {
namespace {

using testing_support::AddKdTree;
using testing_support::Bit;
using testing_support::CompareHits;
using testing_support::Describe;
using testing_support::Difference;
using testing_support::DifferenceTally;
using testing_support::FirstHitBy;
using testing_support::IndexObjects;
using testing_support::kSanitizerBuild;
using testing_support::LeavesEdgesOut;
using testing_support::MakeClosedSphere;
using testing_support::MakeGrid;
using testing_support::MakeNastyScenes;
using testing_support::MakePoints;
using testing_support::MayDifferByAnyHit;
using testing_support::NastyRays;
using testing_support::NastyScene;
using testing_support::ScaledCount;
using testing_support::TestRng;
using testing_support::WaysBy;

constexpr uint32_t kWidth = 22, kHeight = 19;  // Packets of every side are full, and cut.
constexpr uint32_t kPixels = kWidth * kHeight;
constexpr TileRect kWhole = {0, 0, kWidth, kHeight};
constexpr TileOutputs kSeen = {.ids = true, .depth = true, .uv = true};
constexpr TileOutputs kLit = {
    .ids = true, .depth = true, .uv = true, .lit = true, .points = true, .mirrors = true};
// Of queries, and of a light: objects that either sees alone do not block its rays.
constexpr uint32_t kMask = 0x80000001u, kLightMask = 3;
constexpr Structure kStructures[] = {Structure::kBvh, Structure::kKdTree, Structure::kBinaryBvh};

struct Scene {
  std::string name;
  IndexedGeometry indexed;
  std::vector<Mirror> mirrors;
  Camera camera;
  Vec3f eye;
  PreparedMirrors prepared;
  std::vector<LightSample> lights;  // Light 0: a point; light 1: another, and a sun.
};

// ---- Verdicts

class Judge {
 public:
  Judge(const SceneGeometry& geometry, Intersector kind) : geometry_(geometry), kind_(kind) {}

  // Whether they are the same.
  bool First(const QueryOptions& way, const PredicateRay& ray, const Hit& hit, const Hit& truth) {
    const Difference difference =
        CompareHits(geometry_, kind_, ray, hit, truth, LeavesEdgesOut(way));
    tally_.Add(difference);
    EXPECT_NE(difference, Difference::kBeyondBound)
        << hit.triangle << " at " << hit.t << ", not " << truth.triangle << " at " << truth.t
        << ": " << Describe(way);
    return difference == Difference::kNone;
  }

  void Any(const QueryOptions& way, const TraceRay& query, bool blocked, bool truth) {
    ++any_;
    if (blocked == truth) return;
    ++any_differ_;
    EXPECT_TRUE(MayDifferByAnyHit(geometry_, kind_, query, blocked, LeavesEdgesOut(way)))
        << (blocked ? "blocked" : "free") << ": " << Describe(way);
  }

  // Nothing excuses brute force.
  void Defines(const TraceRay& query, const Hit& hit) {
    const Hit truth = FirstHitBy(geometry_, kind_, query);
    EXPECT_EQ(hit.triangle, truth.triangle);
    EXPECT_EQ(std::bit_cast<uint32_t>(hit.t), std::bit_cast<uint32_t>(truth.t));
  }
  void DefinesAny(const TraceRay& query, bool blocked) const {
    EXPECT_EQ(blocked, Blocks(query)) << "by brute force";
  }
  bool Blocks(const TraceRay& query) const {
    return FirstHitBy(geometry_, kind_, query).triangle != kNoTriangle;
  }

  const DifferenceTally& tally() const { return tally_; }
  int64_t any() const { return any_; }
  int64_t any_differ() const { return any_differ_; }

 private:
  const SceneGeometry& geometry_;
  const Intersector kind_;
  DifferenceTally tally_;
  int64_t any_ = 0, any_differ_ = 0;
};

QueryOptions BruteForceBy(Intersector kind) {
  QueryOptions options;
  options.strategy = Strategy::kBruteForce;
  options.intersector = kind;
  options.mask = kMask;
  return options;
}

template <typename T, size_t kCount>
T OneOf(const std::array<T, kCount>& values, TestRng& rng) {
  return values[rng.Below(kCount)];
}

LeafCulling AnyCulling(TestRng& rng) {
  LeafCulling c;
  for (bool* const on :
       {&c.side_planes, &c.near_far, &c.aperture, &c.aperture_first, &c.skip_edges, &c.first_axis,
        &c.ray_mask, &c.ray_box, &c.ray_box_update, &c.mailbox, &c.cell_boxes}) {
    *on = rng.Chance(0.5);
  }
  c.frustum = OneOf(kAllFrustumRays, rng);
  c.node_test = OneOf(kAllNodeTests, rng);
  c.split = OneOf(kAllPacketSplits, rng);
  c.ray_box_min_triangles = static_cast<uint32_t>(rng.Below(5));
  return c;
}

// All of a kind's ways, half of those that cull in leaves by whatever can be chosen there, packets
// of any size; under a sanitizer one of six.
std::vector<QueryOptions> SomeWaysBy(Intersector kind, TestRng& rng) {
  const std::vector<QueryOptions> all = WaysBy(kind, kStructures);
  const size_t step = kSanitizerBuild ? 6 : 1;
  std::vector<QueryOptions> ways;
  for (size_t i = rng.Below(step); i < all.size(); i += step) {
    ways.push_back(all[i]);
    ways.back().mask = kMask;
    ways.back().packet_side = OneOf(kPacketSides, rng);
    if (all[i].leaf_culling && rng.Chance(0.5)) ways.back().leaf_culling = AnyCulling(rng);
  }
  return ways;
}

// ---- Scenes

const PreparedMirror* MirrorAt(const Scene& scene, uint32_t triangle) {
  for (const PreparedMirror& mirror : scene.prepared.all()) {
    if (mirror.triangles().Holds(triangle)) return &mirror;
  }
  return nullptr;
}

PredicateRay PixelRay(const Scene& scene, uint32_t pixel) {
  return PredicateRay::Ray(scene.eye, PixelDirection(scene.camera, pixel % kWidth, pixel / kWidth));
}

// What a pixel shows by core/query/mirrors.h, given what its own ray hits.
TraceRay ShownRay(const Scene& scene, uint32_t pixel, const Hit& direct) {
  TraceRay query;
  query.ray = PixelRay(scene, pixel);
  query.mask = kMask;
  const PreparedMirror* mirror = MirrorAt(scene, direct.triangle);
  if (mirror == nullptr) return query;
  query.ray = PredicateRay::Ray(mirror->eye(), mirror->Direction(query.ray.target));
  query.near = direct.t;
  query.unseen = mirror->triangles();
  return query;
}

TraceRay ShadowRay(const LightSample& light, Vec3f point, uint32_t source) {
  TraceRay query;
  query.mask = kMask & light.mask;
  if (light.directional) {
    query.ray = PredicateRay::Ray(point, light.value);
    query.from_source = source;
    query.to_source = light.source_triangle;
  } else {
    query.ray = PredicateRay::Segment(light.value, point);
    query.from_source = light.source_triangle;
    query.to_source = source;
  }
  return query;
}

// Mirrors and what is seen in them take a good part of the picture, and not all of it.
bool IsGoodView(const Scene& scene) {
  TileResult tile;
  const absl::Status status = TraceTile(scene.indexed, scene.camera, kWhole, {}, scene.mirrors,
                                        {.ids = true, .mirrors = true},
                                        {.structure = Structure::kBvh, .mask = kMask}, &tile);
  if (!status.ok()) return false;  // The eye may lie in the mirror.
  uint32_t mirrored = 0, hit_there = 0;
  for (uint32_t p = 0; p < kPixels; ++p) {
    const bool bit = Bit(tile.mirror_bits, p);
    mirrored += bit;
    hit_there += bit && tile.triangle[p] != kNoTriangle;
  }
  return mirrored > kPixels / 8 && mirrored < kPixels * 7 / 8 && hit_there > kPixels / 16;
}

Scene Finish(std::string name, std::vector<ObjectInput> objects, std::optional<Vec3d> origin,
             ObjectInput mirror, TestRng& rng) {
  Scene scene;
  scene.name = std::move(name);
  mirror.name = "mirror";
  scene.mirrors = {Mirror{.object = static_cast<uint32_t>(objects.size())}};
  objects.push_back(std::move(mirror));
  scene.indexed = IndexObjects(objects, origin);
  AddKdTree({}, &scene.indexed);
  ThreadPool pool(1);
  absl::StatusOr<BinaryBvh> binary = BuildBinaryBvh(scene.indexed.geometry, {}, pool);
  EXPECT_TRUE(binary.ok()) << binary.status();
  if (binary.ok()) scene.indexed.binary_bvh = *std::move(binary);

  NastyRays rays(scene.indexed, rng);
  const Vec3d at = scene.indexed.geometry.origin;
  bool found = false;
  for (int tries = 0; tries < 2000 && !found; ++tries) {
    const absl::StatusOr<Camera> camera =
        LookAt(at + ToDouble(rays.Point()), at + ToDouble(rays.Point()), {0.1, 0.3, 1}, 80, kWidth,
               kHeight);
    if (!camera.ok()) continue;
    scene.camera = *camera;
    found = IsGoodView(scene);
  }
  EXPECT_TRUE(found) << "no camera sees the mirror of " << scene.name;
  EXPECT_TRUE(Rebase(scene.camera.eye, at, &scene.eye));
  absl::StatusOr<PreparedMirrors> prepared =
      PreparedMirrors::Prepare(scene.indexed.geometry, scene.mirrors, scene.eye);
  EXPECT_TRUE(prepared.ok()) << prepared.status();
  if (prepared.ok()) scene.prepared = *std::move(prepared);
  for (uint32_t i = 0; i < 3; ++i) {
    LightSample& sample = scene.lights.emplace_back();
    sample.light = i == 0 ? 0 : 1;
    sample.directional = i == 2;
    sample.value = sample.directional ? rays.Target({}, /*segment=*/false) : rays.Point();
    sample.source_triangle = rays.Source();
  }
  scene.lights[1].mask = kLightMask;
  return scene;
}

// A flat square of that many cells a side, two of its units each, at y = height.
ObjectInput Floor(int cells, double height, TestRng& rng) {
  ObjectInput object = MakeGrid(cells, 0, {}, rng);
  for (Vec3d& v : object.vertices) v = {2 * v.x - cells, height, 2 * v.z - cells};
  return object;
}

std::vector<Scene> MakeScenes(TestRng& rng) {
  std::vector<Scene> scenes;
  // The second ball stands behind the mirror, where mirrored rays would meet it first.
  scenes.push_back(
      Finish("waves and a ball under a mirror",
             {MakeGrid(7, 0.4, {-3.5, 0, -3.5}, rng), MakeClosedSphere(7, 10, 0.9, {0.2, 1.2, 0}),
              MakeClosedSphere(5, 6, 0.5, {-0.3, 3.6, 0.2})},
             std::nullopt, Floor(2, 2.9, rng), rng));
  for (NastyScene& nasty : MakeNastyScenes(rng)) {
    struct Mirrored {
      absl::string_view name;
      double height;
    };
    for (const auto& [name, height] :
         {Mirrored{"slivers", -6}, Mirrored{"coplanar and duplicate faces", -0.5},
          Mirrored{"a closed box", -1.5}, Mirrored{"masks and culling", -3},
          Mirrored{"mixed exponents, fewer", -1}}) {
      if (nasty.name != name) continue;
      scenes.push_back(Finish(nasty.name, nasty.objects, nasty.origin,
                              Floor(static_cast<int>(2 - height), height, rng), rng));
    }
  }
  return scenes;
}

// fn(scene, kind, judge), the work of one test; says what it found.
template <typename Fn>
void ForEachSceneAndKind(const Fn& fn) {
  TestRng rng;
  for (int64_t round = ScaledCount(1); round > 0; --round) {
    const std::vector<Scene> scenes = MakeScenes(rng);
    ASSERT_EQ(scenes.size(), 6u);
    for (const Scene& scene : scenes) {
      SCOPED_TRACE(scene.name);
      for (const Intersector kind : kPaperIntersectors) {
        SCOPED_TRACE(IntersectorName(kind));
        Judge judge(scene.indexed.geometry, kind);
        fn(scene, kind, judge, rng);
        std::cout << scene.name << ", " << IntersectorName(kind) << ": " << judge.tally()
                  << "; any hits: " << judge.any() << ", " << judge.any_differ() << " differ\n";
        if (&scene == scenes.data()) {
          EXPECT_EQ(judge.tally().of(Difference::kPlain), 0);
        }
        if (testing::Test::HasFailure()) return;
      }
    }
  }
}

// ---- Tiles: mirrors, lights, packets of the pixels' squares

// What a way says of the whole picture.
struct Picture {
  TileResult direct;  // Without mirrors.
  TileResult shown;   // With them, and with lights.

  static Hit HitOf(const TileResult& tile, uint32_t pixel) {
    return {tile.depth[pixel], tile.triangle[pixel]};
  }
  // Of the pixel's point in `shown`, or none.
  std::vector<std::optional<size_t>> point_of = std::vector<std::optional<size_t>>(kPixels);

  bool Lit(size_t light, uint32_t pixel) const {
    const size_t row = (kPixels + 7) / 8;
    return shown.lit_bits[light * row + pixel / 8] >> (pixel % 8) & 1;
  }
};

Picture Take(const Scene& scene, const QueryOptions& way) {
  Picture picture;
  const absl::Status direct =
      TraceTile(scene.indexed, scene.camera, kWhole, {}, kSeen, way, &picture.direct);
  EXPECT_TRUE(direct.ok()) << direct;
  const absl::Status shown = TraceTile(scene.indexed, scene.camera, kWhole, scene.lights,
                                       scene.mirrors, kLit, way, &picture.shown);
  EXPECT_TRUE(shown.ok()) << shown;
  for (size_t i = 0; i < picture.shown.point_pixel.size(); ++i) {
    picture.point_of[picture.shown.point_pixel[i]] = i;
  }
  return picture;
}

// Brute force shows what the definition says, and lights it so.
void CheckDefinition(const Scene& scene, const Picture& truth, Judge& judge) {
  const PreparedPoints& points = truth.shown.points;
  for (uint32_t p = 0; p < kPixels; p += kSanitizerBuild ? 11 : 1) {
    const TraceRay query = ShownRay(scene, p, Picture::HitOf(truth.direct, p));
    judge.Defines(query, Picture::HitOf(truth.shown, p));
    const std::optional<size_t> point = truth.point_of[p];
    EXPECT_EQ(point.has_value(), truth.shown.triangle[p] != kNoTriangle);
    for (size_t s = 0; s < scene.lights.size(); ++s) {
      if (!point) {
        EXPECT_FALSE(truth.Lit(s, p)) << "nothing is there to be lit";
        continue;
      }
      judge.DefinesAny(ShadowRay(scene.lights[s], points.positions[*point], points.sources[*point]),
                       !truth.Lit(s, p));
    }
  }
}

void ComparePictures(const Scene& scene, const QueryOptions& way, const Picture& picture,
                     const Picture& truth, Judge& judge) {
  for (uint32_t p = 0; p < kPixels; ++p) {
    const Hit direct = Picture::HitOf(picture.direct, p), hit = Picture::HitOf(picture.shown, p);
    // The pixel's own ray is asked alike with mirrors and without.
    const bool same_direct =
        judge.First(way, PixelRay(scene, p), direct, Picture::HitOf(truth.direct, p));
    const bool mirrored = MirrorAt(scene, direct.triangle) != nullptr;
    EXPECT_EQ(Bit(picture.shown.mirror_bits, p), mirrored);
    bool same = same_direct;
    if (mirrored) {
      // Where the way meets the mirror, and so where hits begin to count, is its own.
      const TraceRay query = ShownRay(scene, p, direct);
      const Hit expected = same_direct ? Picture::HitOf(truth.shown, p)
                                       : FirstHitBy(scene.indexed.geometry, way.intersector, query);
      same = judge.First(way, query.ray, hit, expected) && same_direct;
    } else {
      EXPECT_EQ(hit.triangle, direct.triangle);
      EXPECT_EQ(std::bit_cast<uint32_t>(hit.t), std::bit_cast<uint32_t>(direct.t));
    }
    if (same) {
      EXPECT_EQ(picture.shown.u[p], truth.shown.u[p]);
      EXPECT_EQ(picture.shown.v[p], truth.shown.v[p]);
    }
    const std::optional<size_t> point = picture.point_of[p], true_point = truth.point_of[p];
    ASSERT_EQ(point.has_value(), hit.triangle != kNoTriangle);
    if (!point) {
      for (size_t s = 0; s < scene.lights.size(); ++s) EXPECT_FALSE(picture.Lit(s, p));
      continue;
    }
    const Vec3f position = picture.shown.points.positions[*point];
    EXPECT_EQ(picture.shown.points.sources[*point], hit.triangle);
    if (same) {
      EXPECT_EQ(position, truth.shown.points.positions[*true_point]);
    }
    for (size_t s = 0; s < scene.lights.size(); ++s) {
      const TraceRay query = ShadowRay(scene.lights[s], position, hit.triangle);
      judge.Any(way, query, !picture.Lit(s, p), same ? !truth.Lit(s, p) : judge.Blocks(query));
    }
  }
}

TEST(IntersectorQueriesTest, MirrorsAndLightsOfTilesDifferOnlyWithinTheBound) {
  uint64_t stand_ins = 0;
  ForEachSceneAndKind([&](const Scene& scene, Intersector kind, Judge& judge, TestRng& rng) {
    const Picture truth = Take(scene, BruteForceBy(kind));
    CheckDefinition(scene, truth, judge);
    for (const QueryOptions& way : SomeWaysBy(kind, rng)) {
      const Picture picture = Take(scene, way);
      ComparePictures(scene, way, picture, truth, judge);
      if (way.strategy != Strategy::kPacket || testing::Test::HasFailure()) continue;
      QueryOptions pixels = way;
      pixels.pixel_shadow_packets = true;
      const Picture by_pixels = Take(scene, pixels);
      ComparePictures(scene, pixels, by_pixels, truth, judge);
      stand_ins += by_pixels.shown.shadow.rays > picture.shown.shadow.rays;
    }
  });
  std::cout << stand_ins << " pictures whose packets of shadows held more than hits\n";
  if (!kSanitizerBuild) {
    EXPECT_GT(stand_ins, 0u);
  }
}

// ---- Shadows that end before their points

TEST(IntersectorQueriesTest, ShortenedShadowsDifferOnlyWithinTheBound) {
  ForEachSceneAndKind([&](const Scene& scene, Intersector kind, Judge& judge, TestRng& rng) {
    const PreparedPoints points = MakePoints(scene.indexed, rng, kSanitizerBuild ? 20 : 70);
    const size_t n = points.size(), row = (n + 7) / 8;
    const PointRange range = PointRange::All(points);
    const ShadowOptions shadow{.t_min = rng.Chance(0.5) ? 0.2 : 0x1p-10};
    constexpr ShadowOutputs kFirst = {.bits = true, .blockers = true};
    // The contract of ShadowOptions::t_min, to the bit.
    const auto query_of = [&](const LightSample& light, size_t i) {
      const Vec3d p = ToDouble(points.positions[i]), l = ToDouble(light.value);
      return ShadowRay(light, ToFloat(p + (light.directional ? l : l - p) * shadow.t_min),
                       points.sources[i]);
    };
    ShadowResult truth;
    ASSERT_TRUE(ComputeShadows(scene.indexed, range, scene.lights, {}, shadow, kFirst,
                               BruteForceBy(kind), &truth)
                    .ok());
    const auto for_each_valid = [&](const auto& fn) {
      for (size_t s = 0; s < scene.lights.size(); ++s) {
        for (size_t i = 0; i < n; ++i) {
          if (points.valid[i]) fn(scene.lights[s], i, s * n + i, 8 * s * row + i);
        }
      }
    };
    for_each_valid([&](const LightSample& light, size_t i, size_t at, size_t bit) {
      judge.Defines(query_of(light, i), {truth.blocker_t[at], truth.blocker[at]});
      EXPECT_EQ(Bit(truth.lit_bits, bit), truth.blocker[at] == kNoTriangle);
    });
    for (const QueryOptions& way : SomeWaysBy(kind, rng)) {
      ShadowResult first, any;
      ASSERT_TRUE(
          ComputeShadows(scene.indexed, range, scene.lights, {}, shadow, kFirst, way, &first).ok());
      ASSERT_TRUE(
          ComputeShadows(scene.indexed, range, scene.lights, {}, shadow, {.bits = true}, way, &any)
              .ok());
      for_each_valid([&](const LightSample& light, size_t i, size_t at, size_t bit) {
        const TraceRay query = query_of(light, i);
        judge.First(way, query.ray, {first.blocker_t[at], first.blocker[at]},
                    {truth.blocker_t[at], truth.blocker[at]});
        EXPECT_EQ(Bit(first.lit_bits, bit), first.blocker[at] == kNoTriangle);
        judge.Any(way, query, !Bit(any.lit_bits, bit), !Bit(truth.lit_bits, bit));
      });
    }
  });
}

// ---- Pictures relit over the hits of a camera

// Weights that tell which samples reach a pixel: a sum of them is a set.
std::vector<double> TellingWeights(size_t begin, size_t count) {
  std::vector<double> weights;
  for (size_t i = 0; i < count; ++i) weights.push_back(static_cast<double>(1u << (begin + i)));
  return weights;
}

TEST(IntersectorQueriesTest, RelitPicturesDifferOnlyWithinTheBound) {
  ForEachSceneAndKind([&](const Scene& scene, Intersector kind, Judge& judge, TestRng& rng) {
    // Kept as the engine sees them, or as the test does.
    TileResult hits;
    const QueryOptions by = rng.Chance(0.5) ? QueryOptions() : BruteForceBy(kind);
    ASSERT_TRUE(TraceTile(scene.indexed, scene.camera, kWhole, {}, scene.mirrors, {.points = true},
                          by, &hits)
                    .ok());
    NastyRays rays(scene.indexed, rng);
    std::vector<LightSample> moved(2, scene.lights[0]);
    moved[0].value = rays.Point();
    moved[1].value = rays.Point();
    const std::vector<double> weights = TellingWeights(0, scene.lights.size()),
                              moved_weights = TellingWeights(4, moved.size());
    // Every picture of the sequence: all lights, and light 0 gone elsewhere.
    const auto relight = [&](const QueryOptions& way, std::vector<std::vector<double>>* pictures) {
      absl::StatusOr<Relighting> picture = Relighting::Make(
          scene.indexed,
          PacketsOfHits(hits.points, hits.point_pixel, kWidth, kHeight, way.packet_side),
          scene.lights, weights, way);
      ASSERT_TRUE(picture.ok()) << picture.status();
      pictures->push_back(picture->color());
      ASSERT_TRUE(picture->Choose(0).ok());
      ASSERT_TRUE(picture->Move(moved, moved_weights, way).ok());
      pictures->push_back(picture->color());
    };
    std::vector<std::vector<double>> truth;
    relight(BruteForceBy(kind), &truth);
    ASSERT_EQ(truth.size(), 2u);
    std::vector<std::pair<LightSample, uint32_t>> of_picture[2];  // Samples and their bits.
    for (uint32_t s = 0; s < scene.lights.size(); ++s) {
      of_picture[0].emplace_back(scene.lights[s], 1u << s);
      if (s != 0) of_picture[1].emplace_back(scene.lights[s], 1u << s);
    }
    for (uint32_t s = 0; s < moved.size(); ++s) of_picture[1].emplace_back(moved[s], 16u << s);
    const auto for_each = [&](const std::vector<std::vector<double>>& pictures, const auto& fn) {
      for (size_t k = 0; k < pictures.size(); ++k) {
        for (size_t i = 0; i < hits.points.size(); ++i) {
          const auto lit = static_cast<uint32_t>(pictures[k][hits.point_pixel[i]]);
          const auto true_lit = static_cast<uint32_t>(truth[k][hits.point_pixel[i]]);
          for (const auto& [sample, bit] : of_picture[k]) {
            fn(ShadowRay(sample, hits.points.positions[i], hits.points.sources[i]),
               (lit & bit) == 0, (true_lit & bit) == 0);
          }
        }
      }
    };
    for_each(truth,
             [&](const TraceRay& query, bool, bool truly) { judge.DefinesAny(query, truly); });
    for (const QueryOptions& way : SomeWaysBy(kind, rng)) {
      if (rng.Chance(0.5)) continue;  // Of all kinds and scenes together, each way often enough.
      std::vector<std::vector<double>> pictures;
      relight(way, &pictures);
      ASSERT_EQ(pictures.size(), 2u);
      for_each(pictures, [&](const TraceRay& query, bool blocked, bool truly) {
        judge.Any(way, query, blocked, truly);
      });
    }
  });
}

}  // namespace
}  // namespace sightline

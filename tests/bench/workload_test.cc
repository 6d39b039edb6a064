// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/workload.h"

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>

#include "core/base/check.h"
#include "gtest/gtest.h"
#include "tests/bench/test_scene.h"

namespace sightline::bench {
namespace {

// A small view's.
std::unique_ptr<Workload> MakeSmall(const std::string& name, const TestScene& from,
                                    ThreadPool& pool) {
  WorkloadSpec spec;
  spec.name = name;
  spec.width = 300;
  spec.height = 200;
  auto made = MakeWorkload(spec, from.source, from.scene, pool);
  SIGHTLINE_CHECK(made.ok()) << made.status();
  return *std::move(made);
}

// Units of these differ in how many ranges they have: views see different parts of a scene.
TEST(WorkloadTest, ADigestIsOfTheLastRunAlone) {
  TestScene sphere("builtin:sphere:20000");
  for (const std::string name : {"shadow", "sun", "area"}) {
    SCOPED_TRACE(name);
    const std::unique_ptr<Workload> workload = MakeSmall(name, sphere, sphere.pool);
    for (size_t unit = 0; unit < workload->units(); ++unit) {
      workload->RunOurs(unit);
      const uint64_t digest = workload->OurDigest();
      for (size_t other = 0; other < workload->units(); ++other) workload->RunOurs(other);
      workload->RunOurs(unit);
      EXPECT_EQ(workload->OurDigest(), digest) << "unit " << unit << " of " << workload->units();
    }
  }
}

TEST(WorkloadTest, ThreadsTakeAllRangesBetweenThem) {
  const TestScene sphere("builtin:sphere:20000");
  ThreadPool one(1);
  const std::unique_ptr<Workload> alone = MakeSmall("shadow", sphere, one);
  for (const int threads : {2, 3, 7}) {
    SCOPED_TRACE(threads);
    ThreadPool several(threads);
    const std::unique_ptr<Workload> together = MakeSmall("shadow", sphere, several);
    for (size_t unit = 0; unit < alone->units(); ++unit) {
      alone->RunOurs(unit);
      together->RunOurs(unit);
      EXPECT_EQ(together->OurStats().rays, alone->queries(unit)) << "unit " << unit;
      EXPECT_EQ(together->OurDigest(), alone->OurDigest()) << "unit " << unit;
    }
  }
}

// As scaling wants them: the same units, with the same answers.
TEST(WorkloadTest, PointsCutForAsManyThreadsAreTheSame) {
  const TestScene box("builtin:box:1000");
  ThreadPool one(1), three(3);
  for (const uint64_t range : {0, 500'000}) {  // As suits, and all in one.
    SCOPED_TRACE(range);
    WorkloadSpec spec{.name = "points", .points = 2000, .lights = "lights", .range = range};
    spec.cut_for_threads = 3;
    auto alone = MakeWorkload(spec, box.source, box.scene, one);
    auto together = MakeWorkload(spec, box.source, box.scene, three);
    ASSERT_TRUE(alone.ok() && together.ok()) << alone.status() << together.status();
    ASSERT_EQ((*alone)->units(), (*together)->units());
    for (size_t unit = 0; unit < (*alone)->units(); ++unit) {
      (*alone)->RunOurs(unit);
      (*together)->RunOurs(unit);
      EXPECT_EQ((*alone)->queries(unit), (*together)->queries(unit)) << "unit " << unit;
      EXPECT_EQ((*alone)->OurDigest(), (*together)->OurDigest()) << "unit " << unit;
    }
  }
}

// Two triangles that fill a view: number 1 at z = 0, and number 0 at a height of the test's choice.
class TwoTriangles {
 public:
  TwoTriangles() : pool_(1) {
    source_.name = "two";
    source_.views = {{.eye = {0, 0, 5}, .at = {0, 0, 0}, .up = {0, 1, 0}, .fov_y_degrees = 30}};
    source_.objects.resize(1);
    source_.objects[0].name = "two";
    source_.objects[0].indices = {3, 4, 5, 0, 1, 2};
    PutFirstAt(-1);
  }
  // Keeps the scene's place and origin.
  void PutFirstAt(double z) {
    source_.objects[0].vertices = {{-9, -9, 0}, {9, -9, 0}, {0, 9, 0},
                                   {-9, -9, z}, {9, -9, z}, {0, 9, z}};
    auto built = IndexScene(source_, {}, pool_);
    SIGHTLINE_CHECK(built.ok()) << built.status();
    scene_ = *std::move(built);
  }
  // Asks our side now, and the peer about the scene with number 0 at `first` and 1 at `second`;
  // then compares with number 0 where `compared` says.
  Agreement Compare(double first, double second, double compared) {
    auto workload =
        MakeWorkload({.name = "primary", .width = 32, .height = 32}, source_, scene_, pool_);
    SIGHTLINE_CHECK(workload.ok()) << workload.status();
    (*workload)->RunOurs(0);
    SceneGeometry moved = scene_.geometry;
    for (size_t i = 0; i < 6; ++i) moved.vertices[i].z = static_cast<float>(i < 3 ? second : first);
    const auto device = EmbreeDevice::Open(1, SimdTarget::kBest);
    SIGHTLINE_CHECK(device.ok()) << device.status();
    const PeerMesh mesh(moved);
    const auto peer = EmbreeScene::Build(**device, mesh, {});
    SIGHTLINE_CHECK(peer.ok()) << peer.status();
    (*workload)->RunPeer(**peer, {}, 0, Share::kAll);
    PutFirstAt(compared);
    Agreement agreement;
    (*workload)->Compare(0, &agreement);
    return agreement;
  }

 private:
  ThreadPool pool_;
  SceneSource source_;
  IndexedGeometry scene_;
};

// Of two triangles at one distance number 0 is the answer.
TEST(PrimaryWorkloadTest, ATieIsHarmlessWhereThePeersTriangleYieldsToOurs) {
  TwoTriangles scene;
  scene.PutFirstAt(0);
  const Agreement agreement = scene.Compare(/*first=*/-1, /*second=*/0, /*compared=*/0);
  EXPECT_EQ(agreement.ties, 32u * 32);
  EXPECT_EQ(agreement.disagreements, 0u);
  EXPECT_EQ(agreement.beyond_rounding, 0u);
}

// An engine that says 1, as ours did when 0 lay behind it, is wrong.
TEST(PrimaryWorkloadTest, OursIsNotToTakeTheHigherOfTwoAtOneDistance) {
  TwoTriangles scene;
  const Agreement agreement = scene.Compare(/*first=*/0, /*second=*/-1, /*compared=*/0);
  EXPECT_EQ(agreement.ties, 0u);
  EXPECT_EQ(agreement.disagreements, 32u * 32);
  EXPECT_GE(agreement.beyond_rounding, 32u * 32);
  EXPECT_GE(agreement.by_brute_force, 32u * 32);
}

}  // namespace
}  // namespace sightline::bench

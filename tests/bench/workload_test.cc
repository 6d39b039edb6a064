// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/workload.h"

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>

#include "core/base/check.h"
#include "gtest/gtest.h"
#include "tests/bench/bench_scene.h"

namespace sightline::bench {
namespace {

class WorkloadTest : public ::testing::Test {
 protected:
  void SetUp() override {
    auto source = ReadScene("builtin:sphere:20000", "");
    ASSERT_TRUE(source.ok()) << source.status();
    source_ = *std::move(source);
    auto scene = IndexScene(source_, {}, pool_);
    ASSERT_TRUE(scene.ok()) << scene.status();
    scene_ = *std::move(scene);
  }

  // A small view's.
  std::unique_ptr<Workload> Make(const std::string& name, ThreadPool& pool) {
    WorkloadSpec spec;
    spec.name = name;
    spec.width = 300;
    spec.height = 200;
    auto made = MakeWorkload(spec, source_, scene_, pool);
    SIGHTLINE_CHECK(made.ok()) << made.status();
    return *std::move(made);
  }

  ThreadPool pool_{2};
  SceneSource source_;
  IndexedGeometry scene_;
};

// Units of these differ in how many ranges they have: views see different parts of a scene.
TEST_F(WorkloadTest, ADigestIsOfTheLastRunAlone) {
  for (const std::string name : {"shadow", "sun", "area"}) {
    SCOPED_TRACE(name);
    const std::unique_ptr<Workload> workload = Make(name, pool_);
    for (size_t unit = 0; unit < workload->units(); ++unit) {
      workload->RunOurs(unit);
      const uint64_t digest = workload->OurDigest();
      for (size_t other = 0; other < workload->units(); ++other) workload->RunOurs(other);
      workload->RunOurs(unit);
      EXPECT_EQ(workload->OurDigest(), digest) << "unit " << unit << " of " << workload->units();
    }
  }
}

TEST_F(WorkloadTest, ThreadsTakeAllRangesBetweenThem) {
  ThreadPool one(1);
  const std::unique_ptr<Workload> alone = Make("shadow", one);
  for (const int threads : {2, 3, 7}) {
    SCOPED_TRACE(threads);
    ThreadPool several(threads);
    const std::unique_ptr<Workload> together = Make("shadow", several);
    for (size_t unit = 0; unit < alone->units(); ++unit) {
      alone->RunOurs(unit);
      together->RunOurs(unit);
      EXPECT_EQ(together->OurStats().rays, alone->queries(unit)) << "unit " << unit;
      EXPECT_EQ(together->OurDigest(), alone->OurDigest()) << "unit " << unit;
    }
  }
}

}  // namespace
}  // namespace sightline::bench

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

}  // namespace
}  // namespace sightline::bench

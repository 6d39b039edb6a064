// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/workload.h"

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>

#include "gtest/gtest.h"
#include "tests/bench/bench_scene.h"

namespace sightline::bench {
namespace {

// Units of these differ in how many ranges they have: views see different parts of a scene.
TEST(WorkloadTest, ADigestIsOfTheLastRunAlone) {
  ThreadPool pool(2);
  auto source = ReadScene("builtin:sphere:20000", "");
  ASSERT_TRUE(source.ok()) << source.status();
  auto scene = IndexScene(*source, {}, pool);
  ASSERT_TRUE(scene.ok()) << scene.status();
  for (const std::string name : {"shadow", "sun", "area"}) {
    SCOPED_TRACE(name);
    WorkloadSpec spec;
    spec.name = name;
    spec.width = 300;
    spec.height = 200;
    auto made = MakeWorkload(spec, *source, *scene, pool);
    ASSERT_TRUE(made.ok()) << made.status();
    Workload& workload = **made;
    for (size_t unit = 0; unit < workload.units(); ++unit) {
      workload.RunOurs(unit);
      const uint64_t digest = workload.OurDigest();
      for (size_t other = 0; other < workload.units(); ++other) workload.RunOurs(other);
      workload.RunOurs(unit);
      EXPECT_EQ(workload.OurDigest(), digest) << "unit " << unit << " of " << workload.units();
    }
  }
}

}  // namespace
}  // namespace sightline::bench

// SPDX-License-Identifier: Apache-2.0
#include "server/scenes/scene_catalog.h"

#include <vector>

#include "core/base/parallel.h"
#include "gtest/gtest.h"
#include "server/base/error.h"

namespace sightline {
namespace {

TEST(SceneCatalogTest, ABuiltinSceneIsMadeOnlyWhereThereIsRoomForIt) {
  Limits limits;
  limits.max_scene_bytes = 32 << 20;
  ThreadPool pool(1);
  SceneCatalog catalog(limits, pool);
  const absl::StatusOr<std::vector<ObjectInput>> small =
      catalog.MakeBuiltinObjects("a", "builtin:box:1000");
  ASSERT_TRUE(small.ok()) << small.status();
  ASSERT_TRUE(catalog.Create({.scene_id = "a"}, *small, nullptr).ok());
  // The city has a million unless told otherwise.
  for (const char* const spec : {"builtin:sphere:1M", "builtin:city"}) {
    const absl::Status status = catalog.MakeBuiltinObjects("b", spec).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kResourceExhausted) << status;
    EXPECT_EQ(ReasonOf(status), v1::ERROR_REASON_OUT_OF_MEMORY_BUDGET);
  }
  EXPECT_EQ(ReasonOf(catalog.MakeBuiltinObjects("a", "builtin:box:1000").status()),
            v1::ERROR_REASON_ALREADY_EXISTS);
}

}  // namespace
}  // namespace sightline

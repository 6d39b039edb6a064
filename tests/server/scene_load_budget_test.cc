// SPDX-License-Identifier: Apache-2.0
//
// What it takes to check a scene's file counts against the budget while the file is loaded.
#include <cstdint>

#include "core/scene/scene_file.h"
#include "gtest/gtest.h"
#include "server/base/error.h"
#include "server/scenes/scene_catalog.h"
#include "tests/support/temp_dir.h"

namespace sightline {
namespace {

TEST(SceneLoadBudgetTest, ChecksCountUntilTheSceneIsThere) {
  const testing_support::TempDir dir;
  ThreadPool pool(1);
  const auto repository = SceneRepository::Open(dir.path());
  ASSERT_TRUE(repository.ok()) << repository.status();
  {
    const ObjectInput object{
        .name = "o", .vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, .indices = {0, 1, 2}};
    SceneCatalog first(Limits(), pool, repository->get());
    const auto made =
        first.Create({.scene_id = "hall", .kd_tree = KdBuildOptions()}, {&object, 1}, nullptr);
    ASSERT_TRUE(made.ok()) << made.status();
    ASSERT_TRUE(made->status.kept);
  }
  const auto file = MapSceneFile(*Folder::Open(dir.path()), "hall.slscene");
  ASSERT_TRUE(file.ok()) << file.status();
  const auto info = InspectSceneFile(*file);
  ASSERT_TRUE(info.ok()) << info.status();
  const uint64_t checks = SceneCheckBytes(*info, pool.threads());
  ASSERT_GT(checks, 0u);
  for (const bool fits : {false, true}) {
    Limits limits;
    limits.max_scene_bytes = info->scene_bytes + checks - (fits ? 0 : 1);
    SceneCatalog catalog(limits, pool, repository->get());
    const auto loaded = catalog.Load("hall", nullptr);
    if (!fits) {
      EXPECT_EQ(ReasonOf(loaded.status()), v1::ERROR_REASON_OUT_OF_MEMORY_BUDGET)
          << loaded.status();
      EXPECT_EQ(catalog.MemoryBytes(), 0u);
      continue;
    }
    ASSERT_TRUE(loaded.ok()) << loaded.status();
    const uint64_t bytes = loaded->status.latest->report.memory_bytes;
    EXPECT_EQ(catalog.MemoryBytes(), bytes);
    // And again beside it.
    EXPECT_EQ(ReasonOf(catalog.Reload("hall", nullptr).status()),
              v1::ERROR_REASON_OUT_OF_MEMORY_BUDGET);
    EXPECT_EQ(catalog.MemoryBytes(), bytes);
  }
}

}  // namespace
}  // namespace sightline

// SPDX-License-Identifier: Apache-2.0
//
// How much dearer a fitted tree has become goes along into a native file: or edits of what was
// written and read again could wear it out without bound.
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "core/scene/scene_file.h"
#include "gtest/gtest.h"
#include "tests/support/random.h"
#include "tests/support/scene_file_seal.h"
#include "tests/support/temp_dir.h"

namespace sightline {
namespace {

using testing_support::SealSceneFile;
using testing_support::TempDir;
using testing_support::TestRng;

using Bytes = AlignedVector<std::byte>;

class SceneFileGrowthTest : public ::testing::Test {
 protected:
  std::shared_ptr<const Scene> Build() {
    ObjectInput soup{.name = "soup", .dynamic = true}, walls{.name = "walls"};
    for (ObjectInput* object : {&soup, &walls}) {
      for (uint32_t i = 0; i < 900; ++i) {
        object->indices.push_back(i);
        object->vertices.push_back({rng_.Uniform(0, 9), rng_.Uniform(0, 9), rng_.Uniform(0, 9)});
      }
    }
    auto scene =
        BuildScene("hall", 7, std::vector<ObjectInput>{soup, walls}, std::nullopt, options_, pool_);
    EXPECT_TRUE(scene.ok()) << scene.status();
    return *std::move(scene);
  }
  std::shared_ptr<const Scene> Moved(const Scene& scene, double x) {
    Affine3d transform;
    transform.m[3] = x;
    const std::vector<SceneEdit> edits = {
        {SceneEdit::Kind::kSetTransform, {.name = "soup", .transform = transform}}};
    auto next = EditScene(scene, 8, edits, options_, pool_);
    EXPECT_TRUE(next.ok()) << next.status();
    return *std::move(next);
  }
  Bytes Written(const Scene& scene) {
    const Folder folder = *Folder::Open(dir_.path());
    const absl::Status status = WriteSceneFile(scene, folder, "scene.slscene", pool_);
    EXPECT_TRUE(status.ok()) << status;
    const absl::StatusOr<SceneBytes> file = MapSceneFile(folder, "scene.slscene");
    EXPECT_TRUE(file.ok()) << file.status();
    return Bytes(file->bytes.begin(), file->bytes.end());
  }
  absl::StatusOr<std::shared_ptr<const Scene>> Load(const Bytes& bytes) {
    auto owner = std::make_shared<const Bytes>(bytes);
    const std::span<const std::byte> view = *owner;
    return LoadScene(SceneBytes{view, std::move(owner), "'file'"}, "again", {}, pool_);
  }
  // The one behind those that all files have: a dynamic scene's tree has no mates.
  static SceneFileSection& Growth(Bytes& bytes) {
    auto* const table = reinterpret_cast<SceneFileSection*>(bytes.data() + sizeof(SceneFileHeader));
    return table[kRequiredSections];
  }

  TestRng rng_;
  ThreadPool pool_{2};
  TempDir dir_;
  const SceneBuildOptions options_ = {.bvh = BvhPresetOptions(BvhPreset::kDynamic)};
};

TEST_F(SceneFileGrowthTest, GoesAlong) {
  const auto built = Build();
  const auto scene = Moved(*built, 0.4);
  ASSERT_TRUE(scene->report.bvh_refitted);
  ASSERT_NE(scene->bvh.cost_growth, 1);
  const auto again = Load(Written(*scene));
  ASSERT_TRUE(again.ok()) << again.status();
  EXPECT_EQ((*again)->bvh.cost_growth, scene->bvh.cost_growth);
  EXPECT_EQ(Moved(**again, 0.8)->bvh.cost_growth, Moved(*scene, 0.8)->bvh.cost_growth);
  // As it was built, it needs no section.
  Bytes plain = Written(*built);
  EXPECT_EQ(reinterpret_cast<const SceneFileHeader*>(plain.data())->section_count,
            kRequiredSections);
  EXPECT_EQ((*Load(plain))->bvh.cost_growth, 1);
}

TEST_F(SceneFileGrowthTest, IsFiniteAndAboveZero) {
  const Bytes good = Written(*Moved(*Build(), 0.4));
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  for (const double growth : {0.0, -1.0, kInfinity, std::nan("")}) {
    Bytes bad = good;
    std::memcpy(&bad[Growth(bad).offset], &growth, sizeof(growth));
    SealSceneFile(bad);
    const absl::Status status = Load(bad).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kDataLoss) << status;
    EXPECT_NE(std::string(status.message()).find("times what it did"), std::string::npos);
  }
}

TEST_F(SceneFileGrowthTest, FilesOfBeforeThereWasAnyAreRead) {
  Bytes old = Written(*Moved(*Build(), 0.4));
  Growth(old).kind += 700;  // An addition that nobody knows.
  SealSceneFile(old);
  const auto without = Load(old);
  ASSERT_TRUE(without.ok()) << without.status();
  EXPECT_EQ((*without)->bvh.cost_growth, 1);
}

}  // namespace
}  // namespace sightline

// SPDX-License-Identifier: Apache-2.0
#include "core/scene/scene.h"

#include <string>
#include <vector>

#include "core/accel/bvh_validation.h"
#include "core/accel/kd_validation.h"
#include "core/base/mutex.h"
#include "core/scene/registry.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/support/random.h"

namespace sightline {
namespace {

using ::testing::HasSubstr;
using testing_support::TestRng;
using Kind = SceneEdit::Kind;

ObjectInput Soup(TestRng& rng, const std::string& name, size_t triangles, bool dynamic = false) {
  ObjectInput object{.name = name, .dynamic = dynamic};
  for (size_t i = 0; i < 3 * triangles; ++i) {
    object.indices.push_back(static_cast<uint32_t>(i));
    object.vertices.push_back({rng.Uniform(0, 9), rng.Uniform(0, 9), rng.Uniform(0, 9)});
  }
  return object;
}

class SceneTest : public ::testing::Test {
 protected:
  void SetUp() override {
    objects_ = {Soup(rng_, "walls", 300), Soup(rng_, "chair", 50, /*dynamic=*/true)};
    base_ = Build(objects_);
    ASSERT_NE(base_, nullptr);
  }
  std::shared_ptr<const Scene> Build(const std::vector<ObjectInput>& objects) {
    auto scene = BuildScene("hall", 1, objects, std::nullopt, {}, pool_);
    EXPECT_TRUE(scene.ok()) << scene.status();
    return scene.ok() ? *scene : nullptr;
  }
  absl::StatusOr<std::shared_ptr<const Scene>> Edit(const std::vector<SceneEdit>& edits) {
    return EditScene(*base_, 2, edits, {}, pool_);
  }
  void ExpectError(const std::vector<SceneEdit>& edits, absl::StatusCode code,
                   const std::string& part) {
    const absl::Status status = Edit(edits).status();
    EXPECT_EQ(status.code(), code) << status;
    EXPECT_THAT(std::string(status.message()), HasSubstr(part));
  }

  TestRng rng_;
  ThreadPool pool_{2};
  std::vector<ObjectInput> objects_;
  std::shared_ptr<const Scene> base_;
};

TEST_F(SceneTest, BuildsAndReports) {
  EXPECT_EQ(base_->name, "hall");
  EXPECT_EQ(base_->revision, 1u);
  EXPECT_TRUE(ValidateBvh(base_->bvh, base_->geometry).ok());
  EXPECT_EQ(base_->report.mesh.triangles, 350u);
  EXPECT_EQ(base_->report.bvh_nodes, base_->bvh.nodes.size());
  EXPECT_EQ(base_->report.bvh_leaves, base_->bvh.leaf_count);
  EXPECT_EQ(base_->report.bvh_depth, base_->bvh.max_depth);
  EXPECT_EQ(base_->report.memory_bytes, base_->MemoryBytes());
  EXPECT_LE(base_->report.memory_bytes, EstimateSceneBytes(350, 1050) + 150 * sizeof(Vec3d));
  const auto empty = Build({});
  EXPECT_TRUE(empty->bvh.empty());
}

TEST_F(SceneTest, BuildsAKdTreeBesideIfAsked) {
  EXPECT_FALSE(base_->kd_tree.has_value());
  EXPECT_EQ(base_->report.kd_tree_nodes, 0u);
  SceneBuildOptions options;
  options.kd_tree.emplace();
  const auto scene = BuildScene("hall", 1, objects_, std::nullopt, options, pool_);
  ASSERT_TRUE(scene.ok()) << scene.status();
  ASSERT_TRUE((*scene)->kd_tree.has_value());
  const KdTree& tree = *(*scene)->kd_tree;
  EXPECT_TRUE(ValidateKdTree(tree, (*scene)->geometry).ok());
  const BuildReport& report = (*scene)->report;
  EXPECT_EQ(report.kd_tree_nodes, tree.nodes.size());
  EXPECT_EQ(report.kd_tree_leaves, tree.leaves.size());
  EXPECT_EQ(report.kd_tree_references, tree.ids.size());
  EXPECT_EQ(report.kd_tree_bytes, tree.MemoryBytes());
  EXPECT_EQ(report.memory_bytes, (*scene)->MemoryBytes());
  EXPECT_EQ(report.memory_bytes, base_->report.memory_bytes + tree.MemoryBytes());
  EXPECT_LE(report.memory_bytes, EstimateSceneBytes(350, 1050, options) + 150 * sizeof(Vec3d));
  const std::vector<SceneEdit> edits = {{.kind = Kind::kRemove, .object = {.name = "chair"}}};
  const auto edited = EditScene(**scene, 2, edits, options, pool_);
  ASSERT_TRUE(edited.ok()) << edited.status();
  EXPECT_EQ((*edited)->kd_tree->triangle_count, 300u);
}

TEST_F(SceneTest, BuildsABinaryBvhBesideIfAsked) {
  EXPECT_FALSE(base_->binary_bvh.has_value());
  EXPECT_EQ(base_->report.binary_bvh_nodes, 0u);
  SceneBuildOptions options;
  options.binary_bvh = BinaryBvhOptions{.bins = 4, .cost_ratio = 0.1f};
  const auto scene = BuildScene("hall", 1, objects_, std::nullopt, options, pool_);
  ASSERT_TRUE(scene.ok()) << scene.status();
  ASSERT_TRUE((*scene)->binary_bvh.has_value());
  const BinaryBvh& tree = *(*scene)->binary_bvh;
  const BuildReport& report = (*scene)->report;
  EXPECT_EQ(report.binary_bvh_nodes, tree.nodes.size());
  EXPECT_EQ(report.binary_bvh_leaves, tree.leaf_count);
  EXPECT_EQ(report.binary_bvh_bytes, tree.MemoryBytes());
  EXPECT_EQ(report.memory_bytes, base_->report.memory_bytes + tree.MemoryBytes());
  EXPECT_LE(report.memory_bytes, EstimateSceneBytes(350, 1050, options) + 150 * sizeof(Vec3d));
  const std::vector<SceneEdit> edits = {{.kind = Kind::kRemove, .object = {.name = "chair"}}};
  const auto edited = EditScene(**scene, 2, edits, options, pool_);
  ASSERT_TRUE(edited.ok()) << edited.status();
  EXPECT_EQ((*edited)->binary_bvh->ids.size(), 300u);
  options.binary_bvh->bins = 1;
  EXPECT_EQ(BuildScene("hall", 1, objects_, std::nullopt, options, pool_).status().code(),
            absl::StatusCode::kInvalidArgument);
}

TEST_F(SceneTest, AKdTreeMayStandAlone) {
  SceneBuildOptions options;
  options.without_bvh = true;
  const absl::Status status =
      BuildScene("hall", 1, objects_, std::nullopt, options, pool_).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << status;
  options.kd_tree.emplace();
  const auto scene = BuildScene("hall", 1, objects_, std::nullopt, options, pool_);
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_TRUE((*scene)->kd_tree_alone());
  EXPECT_EQ((*scene)->report.bvh_nodes, 0u);
  EXPECT_GT((*scene)->report.kd_tree_nodes, 0u);
  const auto edited = EditScene(
      **scene, 2, {{{.kind = Kind::kRemove, .object = {.name = "chair"}}}}, options, pool_);
  ASSERT_TRUE(edited.ok()) << edited.status();
  EXPECT_TRUE((*edited)->kd_tree_alone());
}

// Names and records of many small objects weigh as much as their triangles.
TEST_F(SceneTest, EstimatesCountObjects) {
  constexpr size_t kObjects = 3000;
  std::vector<ObjectInput> objects(kObjects);
  uint64_t name_bytes = 0;
  for (size_t i = 0; i < kObjects; ++i) {
    const double x = static_cast<double>(i);
    objects[i].vertices = {{x, 0, 0}, {x + 1, 0, 0}, {x, 1, 0}};
    objects[i].indices = {0, 1, 2};
    objects[i].name = std::string(i % 60, 'o') + std::to_string(i);
    name_bytes += objects[i].name.size();
  }
  for (const BvhPreset preset : {BvhPreset::kStatic, BvhPreset::kDynamic, BvhPreset::kCompact}) {
    SceneBuildOptions options{.bvh = BvhPresetOptions(preset)};
    options.binary_bvh.emplace();
    const auto scene = BuildScene("many", 1, objects, std::nullopt, options, pool_);
    ASSERT_TRUE(scene.ok()) << scene.status();
    EXPECT_LE((*scene)->report.memory_bytes, EstimateSceneBytes(kObjects, 3 * kObjects, options) +
                                                 EstimateObjectBytes(kObjects, name_bytes));
  }
  objects.resize(1);
  SceneBuildOptions options;
  options.binary_bvh.emplace();
  const auto one = BuildScene("one", 1, objects, std::nullopt, options, pool_);
  ASSERT_TRUE(one.ok()) << one.status();
  EXPECT_LE((*one)->report.memory_bytes,
            EstimateSceneBytes(1, 3, options) + EstimateObjectBytes(1, 1));
}

// Long slivers, which a kd-tree cuts into ever more pieces where it is asked to: it stops at what
// was reckoned with.
TEST_F(SceneTest, EstimatesHoldForTheDeepestKdTrees) {
  constexpr uint32_t kSlivers = 600;
  ObjectInput slivers;
  for (uint32_t i = 0; i < 3 * kSlivers; ++i) {
    const Vec3d any = {rng_.Uniform(-1, 1), rng_.Uniform(-1, 1), rng_.Uniform(-1, 1)};
    slivers.vertices.push_back(i % 3 == 2 ? slivers.vertices.back() + any * 0.02 : any);
    slivers.indices.push_back(i);
  }
  const auto expect_within = [&](const KdBuildOptions& kd_tree, double least_share) {
    SceneBuildOptions options;
    const uint64_t without = EstimateSceneBytes(kSlivers, 3 * kSlivers, options);
    options.kd_tree = kd_tree;
    const uint64_t reckoned = EstimateSceneBytes(kSlivers, 3 * kSlivers, options) - without;
    const auto scene = BuildScene("slivers", 1, {{slivers}}, std::nullopt, options, pool_);
    ASSERT_TRUE(scene.ok()) << scene.status();
    EXPECT_TRUE(ValidateKdTree(*(*scene)->kd_tree, (*scene)->geometry).ok());
    EXPECT_LE((*scene)->report.kd_tree_bytes, reckoned);
    EXPECT_GT(static_cast<double>((*scene)->report.kd_tree_bytes),
              least_share * static_cast<double>(reckoned));
  };
  for (const float cost : {kMinKdTraversalCost, KdBuildOptions().traversal_cost}) {
    for (const float references : {1.5f, 6.0f, 64.0f}) {
      for (const bool perfect : {false, true}) {
        SCOPED_TRACE(::testing::Message() << cost << ' ' << references << ' ' << perfect);
        expect_within({.traversal_cost = cost,
                       .perfect_splits = perfect,
                       .max_leaf_triangles = 1,
                       .max_depth = kMaxKdDepth,
                       .max_references = references},
                      0);
      }
    }
  }
  // Here the bytes end it, and nothing before.
  expect_within({.perfect_splits = true,
                 .max_leaf_triangles = 1,
                 .max_depth = kMaxKdDepth,
                 .max_references = 64},
                0.5);
}

// Estimates are upper ones, whatever is built, and what is left out is not in them.
TEST_F(SceneTest, EstimatesCountWhatIsBuilt) {
  const auto estimate = [&](const SceneBuildOptions& options) {
    return EstimateSceneBytes(350, 1050, options) + 150 * sizeof(Vec3d) +
           EstimateObjectBytes(objects_.size(), /*name_bytes=*/10);
  };
  SceneBuildOptions options;
  const uint64_t bvh_alone = estimate(options);
  for (const bool laid_out : {false, true}) {
    for (const bool binary : {false, true}) {
      options = {};
      options.kd_tree = KdBuildOptions{.perfect_splits = binary, .lay_out_leaves = laid_out};
      if (binary) options.binary_bvh.emplace();
      const uint64_t with_bvh = estimate(options);
      options.without_bvh = true;
      const uint64_t alone = estimate(options);
      const auto scene = BuildScene("hall", 1, objects_, std::nullopt, options, pool_);
      ASSERT_TRUE(scene.ok()) << scene.status();
      EXPECT_LE((*scene)->report.memory_bytes, alone) << laid_out << binary;
      // What a kd-tree alone is not charged for is the BVH, as it is where there is nothing else.
      EXPECT_GE(with_bvh - alone, base_->bvh.MemoryBytes()) << laid_out << binary;
      EXPECT_LT(with_bvh - alone, bvh_alone) << laid_out << binary;
    }
  }
  // Nor is a budget: what fits without a BVH is built without one, and refused with it.
  options.binary_bvh.reset();
  options.kd_tree->lay_out_leaves = false;
  SceneRegistry registry({.memory_budget_bytes = estimate(options)}, pool_);
  EXPECT_TRUE(registry.Create("alone", objects_, std::nullopt, options).ok());
  ASSERT_TRUE(registry.Delete("alone").ok());
  options.without_bvh = false;
  EXPECT_EQ(registry.Create("both", objects_, std::nullopt, options).status().code(),
            absl::StatusCode::kResourceExhausted);
}

TEST_F(SceneTest, ProgressRisesToOneAndErrorsComeThrough) {
  Mutex mutex;
  double last = 0;
  ASSERT_TRUE(BuildScene("hall", 1, objects_, std::nullopt, {}, pool_, nullptr, [&](double share) {
                MutexLock lock(mutex);
                EXPECT_GT(share, last);
                last = share;
              }).ok());
  EXPECT_EQ(last, 1.0);
  SceneBuildOptions options;
  options.bvh.bins = 0;
  EXPECT_EQ(BuildScene("hall", 1, objects_, std::nullopt, options, pool_).status().code(),
            absl::StatusCode::kInvalidArgument);
  options = {};
  options.limits.max_triangles = 349;
  EXPECT_EQ(BuildScene("hall", 1, objects_, std::nullopt, options, pool_).status().code(),
            absl::StatusCode::kResourceExhausted);
  CancelToken cancel;
  cancel.Cancel();
  EXPECT_EQ(BuildScene("hall", 1, objects_, std::nullopt, {}, pool_, &cancel).status().code(),
            absl::StatusCode::kCancelled);
}

// Among very many objects, too: the token is looked at before the first is gathered, before the
// first edit, and before the first object is laid out, which would each find a fault here.
TEST_F(SceneTest, CancelledEditsAreNotLookedAt) {
  const auto base = BuildScene("hall", 1, objects_, std::nullopt, {}, pool_);
  ASSERT_TRUE(base.ok());
  CancelToken cancel;
  cancel.Cancel();
  const std::vector<SceneEdit> unknown = {{Kind::kRemove, {.name = "no such object"}}};
  const std::vector<SceneEdit> no_name = {{Kind::kAdd, {.name = "\xFF"}}};
  for (const auto& edits : {unknown, no_name}) {
    EXPECT_EQ(EditScene(**base, 2, edits, {}, pool_, &cancel).status().code(),
              absl::StatusCode::kCancelled);
    EXPECT_NE(EditScene(**base, 2, edits, {}, pool_).status().code(), absl::StatusCode::kOk);
  }
}

TEST_F(SceneTest, EditsGiveWhatABuildOfTheEditedObjectsGives) {
  Affine3d transform;
  transform.m = {0, -1, 0, 3, 1, 0, 0, 4, 0, 0, 2, 5};
  const ObjectInput lamp = Soup(rng_, "lamp", 20);
  const std::vector<Vec3d> moved = Soup(rng_, "", 20).vertices;
  const auto edited = Edit({{Kind::kAdd, lamp},
                            {Kind::kSetTransform, {.name = "chair", .transform = transform}},
                            {Kind::kSetVertices, {.name = "lamp", .vertices = moved}}});
  ASSERT_TRUE(edited.ok()) << edited.status();
  EXPECT_EQ((*edited)->revision, 2u);
  EXPECT_EQ((*edited)->name, "hall");
  EXPECT_TRUE(ValidateBvh((*edited)->bvh, (*edited)->geometry).ok());
  std::vector<ObjectInput> objects = objects_;
  objects[1].transform = transform;
  objects.push_back(lamp);
  objects[2].vertices = moved;
  const auto built = Build(objects);
  EXPECT_EQ((*edited)->geometry.vertices, built->geometry.vertices);
  EXPECT_EQ((*edited)->geometry.triangles, built->geometry.triangles);
  EXPECT_EQ((*edited)->bvh.leaves.size(), built->bvh.leaves.size());
  // The base is as it was.
  EXPECT_EQ(base_->geometry.objects.size(), 2u);
  EXPECT_EQ(base_->geometry.objects[1].transform, Affine3d());
}

TEST_F(SceneTest, MovesKeepADynamicScenesTreeWhileItIsGood) {
  SceneBuildOptions options;
  options.bvh = BvhPresetOptions(BvhPreset::kDynamic);
  const auto base = BuildScene("hall", 1, objects_, std::nullopt, options, pool_);
  ASSERT_TRUE(base.ok()) << base.status();
  EXPECT_FALSE((*base)->report.bvh_refitted);
  const auto refitted = [&](const std::vector<SceneEdit>& edits, const Scene& before,
                            const SceneBuildOptions& with) {
    const auto edited = EditScene(before, 2, edits, with, pool_);
    EXPECT_TRUE(edited.ok()) << edited.status();
    EXPECT_TRUE(ValidateBvh((*edited)->bvh, (*edited)->geometry).ok());
    EXPECT_EQ((*edited)->report.bvh_nodes, (*edited)->bvh.nodes.size());
    return (*edited)->report.bvh_refitted;
  };
  Affine3d near;
  near.m = {1, 0, 0, 0.01, 0, 1, 0, 0, 0, 0, 1, 0};
  const SceneEdit nudge{Kind::kSetTransform, {.name = "chair", .transform = near}};
  EXPECT_TRUE(refitted({nudge}, **base, options));
  std::vector<Vec3d> moved = objects_[0].vertices;
  for (Vec3d& v : moved) v = v + Vec3d{0, 0.01, 0};
  const SceneEdit lift{Kind::kSetVertices, {.name = "walls", .vertices = moved}};
  EXPECT_TRUE(refitted({nudge, lift}, **base, options));
  // Not where the preset does not say so, the edit does more than move, or there is no tree yet.
  EXPECT_FALSE(refitted({nudge}, *base_, {}));
  EXPECT_FALSE(refitted({nudge, {Kind::kAdd, Soup(rng_, "lamp", 3)}}, **base, options));
  EXPECT_FALSE(refitted({{Kind::kRemove, {.name = "walls"}}}, **base, options));
  SceneBuildOptions alone;
  alone.without_bvh = true;
  alone.kd_tree.emplace();
  const auto kd_only = BuildScene("hall", 1, objects_, std::nullopt, alone, pool_);
  ASSERT_TRUE(kd_only.ok()) << kd_only.status();
  EXPECT_FALSE(refitted({nudge}, **kd_only, options));
  // Nor where a triangle lost its area, or so much moved that a new tree is better.
  std::vector<Vec3d> flat = objects_[0].vertices;
  flat[1] = flat[0];
  EXPECT_FALSE(
      refitted({{Kind::kSetVertices, {.name = "walls", .vertices = flat}}}, **base, options));
  EXPECT_FALSE(
      refitted({{Kind::kSetVertices, {.name = "walls", .vertices = Soup(rng_, "", 300).vertices}}},
               **base, options));
}

TEST_F(SceneTest, RemovingKeepsTheOriginAndTheOtherFloats) {
  const auto edited = Edit({{Kind::kRemove, {.name = "walls"}}});
  ASSERT_TRUE(edited.ok()) << edited.status();
  EXPECT_EQ((*edited)->geometry.origin, base_->geometry.origin);
  for (uint32_t i = 0; i < 50; ++i) {
    EXPECT_EQ((*edited)->geometry.Corners(i), base_->geometry.Corners(300 + i));
  }
  // A removed name is free again, within the same edit.
  EXPECT_TRUE(
      Edit({{Kind::kRemove, {.name = "walls"}}, {Kind::kAdd, Soup(rng_, "walls", 1)}}).ok());
  EXPECT_TRUE(Edit({}).ok());
}

TEST_F(SceneTest, AddedObjectsWithoutANameGetAFreeOne) {
  const auto edited = Edit({{Kind::kAdd, Soup(rng_, "", 1)}, {Kind::kAdd, Soup(rng_, "", 1)}});
  ASSERT_TRUE(edited.ok()) << edited.status();
  EXPECT_EQ((*edited)->geometry.objects[2].name, "object-2");
  EXPECT_EQ((*edited)->geometry.objects[3].name, "object-3");
}

TEST_F(SceneTest, EditErrorsNameTheObject) {
  ExpectError({{Kind::kRemove, {.name = "sofa"}}}, absl::StatusCode::kNotFound, "\"sofa\"");
  ExpectError({{Kind::kRemove, {.name = "walls"}}, {Kind::kSetVertices, {.name = "walls"}}},
              absl::StatusCode::kNotFound, "\"walls\"");
  ExpectError({{Kind::kAdd, Soup(rng_, "chair", 1)}}, absl::StatusCode::kAlreadyExists,
              "\"chair\"");
  ExpectError({{Kind::kSetTransform, {.name = "walls"}}}, absl::StatusCode::kFailedPrecondition,
              "\"walls\" is not dynamic");
  ExpectError({{Kind::kSetVertices, {.name = "chair", .vertices = {{1, 2, 3}}}}},
              absl::StatusCode::kInvalidArgument, "150 vertices, but 1 were given");
  ObjectInput bad = Soup(rng_, "bad", 1);
  bad.indices[1] = 17;
  ExpectError({{Kind::kAdd, bad}}, absl::StatusCode::kInvalidArgument, "indices[1] = 17");
}

}  // namespace
}  // namespace sightline

// SPDX-License-Identifier: Apache-2.0
//
// What is written is what is read; and a file that is cut, changed or made up is an error, whatever
// its sums say.
#include "core/scene/scene_file.h"

#include <sys/stat.h>

#include <array>
#include <cstring>
#include <limits>
#include <string>
#include <vector>

#include "core/accel/binary_bvh_builder.h"
#include "core/accel/bvh_validation.h"
#include "core/accel/kd_builder.h"
#include "core/accel/leaf_mates_validation.h"
#include "core/mesh/geometry_validation.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/core/scene/scene_file_bytes.h"
#include "tests/support/faulty_file_calls.h"
#include "tests/support/random.h"
#include "tests/support/scene_file_seal.h"
#include "tests/support/temp_dir.h"
#include "tests/support/test_scale.h"

namespace sightline {
namespace {

using ::testing::HasSubstr;
using testing_support::FaultyFileCalls;
using testing_support::Header;
using testing_support::ScaledCount;
using testing_support::SealSceneFile;
using testing_support::Section;
using testing_support::TempDir;
using testing_support::TestRng;

using Bytes = AlignedVector<std::byte>;

// Every other triangle shares an edge with the one before.
ObjectInput SharingSoup(TestRng& rng, const std::string& name, size_t triangles,
                        bool dynamic = false) {
  ObjectInput object{.name = name, .dynamic = dynamic};
  for (size_t i = 0; i < 3 * triangles; ++i) {
    object.indices.push_back(static_cast<uint32_t>(i));
    object.vertices.push_back({rng.Uniform(0, 9), rng.Uniform(0, 9), rng.Uniform(0, 9)});
  }
  for (size_t i = 3; i < 3 * triangles; i += 6) {
    object.indices[i + 1] = object.indices[i - 1];
    object.indices[i + 2] = object.indices[i - 2];
  }
  return object;
}

template <typename T>
bool SameBytes(const AlignedVector<T>& a, const AlignedVector<T>& b) {
  return a.size() == b.size() &&
         (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0);
}

void ExpectSame(const Scene& a, const Scene& b) {
  EXPECT_EQ(a.geometry.origin, b.geometry.origin);
  EXPECT_EQ(a.geometry.bounds, b.geometry.bounds);
  EXPECT_EQ(a.geometry.uniform, b.geometry.uniform);
  EXPECT_TRUE(SameBytes(a.geometry.vertices, b.geometry.vertices));
  EXPECT_TRUE(SameBytes(a.geometry.triangles, b.geometry.triangles));
  EXPECT_TRUE(SameBytes(a.geometry.inert, b.geometry.inert));
  ASSERT_EQ(a.geometry.objects.size(), b.geometry.objects.size());
  for (size_t i = 0; i < a.geometry.objects.size(); ++i) {
    const ObjectRecord& p = a.geometry.objects[i];
    const ObjectRecord& q = b.geometry.objects[i];
    EXPECT_EQ(p.name, q.name);
    EXPECT_EQ(p.first_triangle, q.first_triangle);
    EXPECT_EQ(p.triangle_count, q.triangle_count);
    EXPECT_EQ(p.first_vertex, q.first_vertex);
    EXPECT_EQ(p.vertex_count, q.vertex_count);
    EXPECT_EQ(p.mask, q.mask);
    EXPECT_EQ(p.culling, q.culling);
    EXPECT_EQ(p.transform, q.transform);
    EXPECT_EQ(p.largest_rounding, q.largest_rounding);
    ASSERT_EQ(p.source_vertices != nullptr, q.source_vertices != nullptr);
    if (p.source_vertices != nullptr) {
      EXPECT_EQ(*p.source_vertices, *q.source_vertices);
    }
  }
  const MeshReport &r = a.report.mesh, &s = b.report.mesh;
  EXPECT_EQ(r.triangles, s.triangles);
  EXPECT_EQ(r.vertices, s.vertices);
  EXPECT_EQ(r.non_finite_vertices, s.non_finite_vertices);
  EXPECT_EQ(r.non_finite_triangles, s.non_finite_triangles);
  EXPECT_EQ(r.zero_area_triangles, s.zero_area_triangles);
  EXPECT_EQ(r.duplicate_triangles, s.duplicate_triangles);
  EXPECT_EQ(r.inert_triangles, s.inert_triangles);
  EXPECT_EQ(r.largest_rounding, s.largest_rounding);
  EXPECT_EQ(a.report.compile_seconds, b.report.compile_seconds);
  EXPECT_EQ(a.report.bvh_seconds, b.report.bvh_seconds);
  EXPECT_TRUE(SameBytes(a.bvh.nodes, b.bvh.nodes));
  EXPECT_TRUE(SameBytes(a.bvh.leaves, b.bvh.leaves));
  EXPECT_TRUE(SameBytes(a.bvh.leaf_ids, b.bvh.leaf_ids));
  EXPECT_TRUE(SameBytes(a.bvh.mates.rows, b.bvh.mates.rows));
  EXPECT_TRUE(SameBytes(a.bvh.mates.units, b.bvh.mates.units));
  EXPECT_EQ(a.bvh.bounds, b.bvh.bounds);
  EXPECT_EQ(a.bvh.leaf_count, b.bvh.leaf_count);
  EXPECT_EQ(a.bvh.triangle_count, b.bvh.triangle_count);
  EXPECT_EQ(a.bvh.max_depth, b.bvh.max_depth);
  EXPECT_EQ(a.bvh.cost_growth, b.bvh.cost_growth);
}

class SceneFileTest : public ::testing::Test {
 protected:
  // Everything that a scene can have: culling, masks, a dynamic object, an empty one, inert
  // triangles, a duplicate.
  std::vector<ObjectInput> Objects(size_t triangles) {
    std::vector<ObjectInput> objects = {SharingSoup(rng_, "walls", triangles),
                                        {.name = "nothing"},
                                        SharingSoup(rng_, "chair", 9, /*dynamic=*/true)};
    const auto last = static_cast<uint32_t>(objects[0].vertices.size());
    objects[0].vertices.push_back({std::numeric_limits<double>::quiet_NaN(), 0, 0});
    objects[0].indices.insert(objects[0].indices.end(), {0, 1, 2, 0, 0, 1, 0, 1, last});
    objects[2].mask = 5;
    objects[2].culling = Culling::kBack;
    objects[2].transform.m[3] = 0.1;
    return objects;
  }
  std::shared_ptr<const Scene> Build(const std::vector<ObjectInput>& objects,
                                     BvhPreset preset = BvhPreset::kStatic) {
    SceneBuildOptions options;
    options.bvh = BvhPresetOptions(preset);
    auto scene = BuildScene("hall", 7, objects, std::nullopt, options, pool_);
    EXPECT_TRUE(scene.ok()) << scene.status();
    return *std::move(scene);
  }
  Folder OpenFolder() { return *Folder::Open(dir_.path(), calls_); }
  absl::StatusOr<std::shared_ptr<const Scene>> Load(const SceneBytes& file,
                                                    const LoadOptions& options = {}) {
    return LoadScene(file, "again", options, pool_);
  }
  absl::StatusOr<std::shared_ptr<const Scene>> Load(Bytes bytes) {
    auto owner = std::make_shared<const Bytes>(std::move(bytes));
    const std::span<const std::byte> view = *owner;
    return Load(SceneBytes{view, std::move(owner), "'file'"});
  }
  // The bytes of a file of that scene.
  Bytes Written(const Scene& scene) {
    const Folder folder = OpenFolder();
    const absl::Status status = WriteSceneFile(scene, folder, "scene.slscene", pool_);
    EXPECT_TRUE(status.ok()) << status;
    const absl::StatusOr<SceneBytes> file = MapSceneFile(folder, "scene.slscene");
    EXPECT_TRUE(file.ok()) << file.status();
    return Bytes(file->bytes.begin(), file->bytes.end());
  }
  void ExpectRefused(const Bytes& bytes, absl::StatusCode code, const std::string& part) {
    const absl::Status status = Load(bytes).status();
    EXPECT_EQ(status.code(), code) << status;
    EXPECT_THAT(std::string(status.message()), HasSubstr(part));
    EXPECT_THAT(std::string(status.message()), HasSubstr("'file'"));
  }

  TestRng rng_;
  ThreadPool pool_{2};
  TempDir dir_;
  FaultyFileCalls calls_;
};

TEST_F(SceneFileTest, WhatIsWrittenIsWhatIsRead) {
  for (const BvhPreset preset : {BvhPreset::kStatic, BvhPreset::kDynamic, BvhPreset::kCompact}) {
    for (const size_t triangles : {1u, 40u, 60'000u}) {
      const auto scene = Build(Objects(triangles), preset);
      const Folder folder = OpenFolder();
      ASSERT_TRUE(WriteSceneFile(*scene, folder, "scene.slscene", pool_).ok());
      const absl::StatusOr<SceneBytes> file = MapSceneFile(folder, "scene.slscene");
      ASSERT_TRUE(file.ok()) << file.status();
      const auto again = Load(*file);
      ASSERT_TRUE(again.ok()) << again.status();
      ExpectSame(*scene, **again);
      EXPECT_EQ((*again)->name, "again");
      EXPECT_EQ((*again)->revision, 7u);
      EXPECT_TRUE((*again)->geometry.vertices.borrowed());
      EXPECT_TRUE((*again)->bvh.nodes.borrowed());
      EXPECT_EQ((*Load(*file, {.revision = 3}))->revision, 3u);
      const absl::StatusOr<SceneFileInfo> info = InspectSceneFile(*file);
      ASSERT_TRUE(info.ok()) << info.status();
      EXPECT_EQ(info->triangles, scene->geometry.triangles.size());
      EXPECT_EQ(info->vertices, scene->geometry.vertices.size());
      EXPECT_EQ(info->objects, 3u);
      EXPECT_EQ(info->revision, 7u);
      EXPECT_GE(info->scene_bytes, (*again)->report.memory_bytes);
    }
  }
}

TEST_F(SceneFileTest, ScenesWithNothingToHit) {
  for (const std::vector<ObjectInput>& objects :
       {std::vector<ObjectInput>(),
        {{.name = "point", .vertices = {{1, 2, 3}}}},
        {{.name = "flat", .vertices = {{1, 2, 3}}, .indices = {0, 0, 0}}}}) {
    const auto scene = Build(objects);
    const auto again = Load(Written(*scene));
    ASSERT_TRUE(again.ok()) << again.status();
    ExpectSame(*scene, **again);
  }
}

TEST_F(SceneFileTest, AnEditOfALoadedSceneIsTheEditOfTheBuiltOne) {
  const auto scene = Build(Objects(500));
  const auto again = Load(Written(*scene));
  ASSERT_TRUE(again.ok()) << again.status();
  Affine3d transform;
  transform.m = {0, -1, 0, 3, 1, 0, 0, 4, 0, 0, 2, 5};
  const std::vector<SceneEdit> edits = {
      {SceneEdit::Kind::kSetTransform, {.name = "chair", .transform = transform}},
      {SceneEdit::Kind::kRemove, {.name = "nothing"}}};
  const auto a = EditScene(*scene, 8, edits, {}, pool_);
  const auto b = EditScene(**again, 8, edits, {}, pool_);
  ASSERT_TRUE(a.ok() && b.ok()) << a.status() << b.status();
  EXPECT_TRUE(SameBytes((*a)->geometry.vertices, (*b)->geometry.vertices));
  EXPECT_TRUE(SameBytes((*a)->bvh.leaves, (*b)->bvh.leaves));
}

TEST_F(SceneFileTest, EveryFlippedByteIsFound) {
  const Bytes good = Written(*Build(Objects(3)));
  ASSERT_TRUE(Load(good).ok());
  const size_t step = testing_support::kSanitizerBuild ? 17 : 1;
  for (size_t i = 0; i < good.size(); i += step) {
    Bytes bad = good;
    bad[i] ^= static_cast<std::byte>(1u << rng_.Below(8));
    ASSERT_FALSE(Load(std::move(bad)).ok()) << "byte " << i << " of " << good.size();
  }
}

TEST_F(SceneFileTest, EveryTruncationIsFound) {
  const Bytes good = Written(*Build(Objects(3)));
  const size_t step = testing_support::kSanitizerBuild ? 17 : 1;
  for (size_t size = 0; size < good.size(); size += step) {
    Bytes bad(good.begin(), good.begin() + size);
    const absl::Status status = Load(bad).status();
    ASSERT_EQ(status.code(), size < sizeof(kSceneFileMagic) ? absl::StatusCode::kInvalidArgument
                                                            : absl::StatusCode::kDataLoss)
        << size << status;
    // A file that says that it ends there is no better.
    if (size < sizeof(SceneFileHeader)) continue;
    Header(bad).file_bytes = size;
    SealSceneFile(bad);
    ASSERT_FALSE(Load(bad).ok()) << size;
  }
  Bytes longer = good;
  longer.resize(good.size() + 64, std::byte{0});
  ExpectRefused(longer, absl::StatusCode::kDataLoss, "something follows");
  Header(longer).file_bytes = longer.size();
  SealSceneFile(longer);
  ExpectRefused(longer, absl::StatusCode::kDataLoss, "belong to no section");
}

TEST_F(SceneFileTest, WhatIsNoSceneFileIsSaidToBeNone) {
  ExpectRefused({}, absl::StatusCode::kInvalidArgument, "is no native scene file");
  ExpectRefused(Bytes(1000, std::byte{'x'}), absl::StatusCode::kInvalidArgument,
                "sightline import");
  Bytes newer = Written(*Build(Objects(3)));
  Header(newer).version = 3;
  SealSceneFile(newer);
  ExpectRefused(newer, absl::StatusCode::kUnimplemented, "version 3");
}

TEST_F(SceneFileTest, HostileTables) {
  const Bytes good = Written(*Build(Objects(3)));
  const auto refused = [&](const std::string& part, const auto& spoil) {
    Bytes bad = good;
    spoil(bad);
    SealSceneFile(bad);
    ExpectRefused(bad, absl::StatusCode::kDataLoss, part);
  };
  constexpr uint64_t kHuge = std::numeric_limits<uint64_t>::max();
  refused("sections", [&](Bytes& b) { Header(b).section_count = 9; });
  refused("sections", [&](Bytes& b) { Header(b).section_count = 0xFFFFFFFF; });
  refused("do not lie within", [&](Bytes& b) { Section(b, 0).count = 0; });
  for (uint32_t i = 0; i < kRequiredSections; ++i) {
    refused("out of order", [&](Bytes& b) { Section(b, i).kind = 300; });
    refused("bytes", [&](Bytes& b) { ++Section(b, i).element_bytes; });
    refused("bytes", [&](Bytes& b) { Section(b, i).element_bytes = 0; });
    refused("do not lie within", [&](Bytes& b) { Section(b, i).count = kHuge; });
    refused("do not lie within", [&](Bytes& b) { Section(b, i).count = kHuge / 4; });
    refused("do not lie within", [&](Bytes& b) { Section(b, i).offset += 64; });
    refused("do not lie within", [&](Bytes& b) { Section(b, i).offset = kHuge; });
    refused("", [&](Bytes& b) { Section(b, i).count += 64; });
  }
}

// With every sum right, only the checks of what the sections say can find a fault; and where they
// find none the scene must be one that keeps every promise.
TEST_F(SceneFileTest, HostileSectionsAreRefusedOrHarmless) {
  for (const BvhPreset preset : {BvhPreset::kStatic, BvhPreset::kCompact}) {
    const Bytes good = Written(*Build(Objects(40), preset));
    int64_t tried = 0, refused = 0;
    const int64_t cases = ScaledCount(6000);
    while (tried < cases) {
      Bytes bad = good;
      const SceneFileSection section =
          Section(bad, static_cast<uint32_t>(rng_.Below(Header(bad).section_count)));
      const uint64_t size = section.count * section.element_bytes;
      if (size == 0) continue;
      ++tried;
      const uint64_t word = section.offset + rng_.Below((size + 3) / 4) * 4;
      uint32_t value = static_cast<uint32_t>(rng_());
      if (rng_.Chance(0.5)) {
        std::memcpy(&value, &bad[word], 4);
        value ^= 1u << rng_.Below(32);
      }
      std::memcpy(&bad[word], &value, 4);
      SealSceneFile(bad);
      const auto scene = Load(std::move(bad));
      if (!scene.ok()) {
        ++refused;
        continue;
      }
      ASSERT_TRUE(ValidateGeometry((*scene)->geometry).ok());
      ASSERT_TRUE(ValidateBvh((*scene)->bvh, (*scene)->geometry).ok());
      ASSERT_TRUE(ValidateLeafMates((*scene)->bvh, (*scene)->geometry).ok());
    }
    EXPECT_GT(refused, tried / 2);
  }
}

TEST_F(SceneFileTest, SectionsOfALaterVersionArePassedOver) {
  const auto scene = Build(Objects(40), BvhPreset::kDynamic);
  Bytes bytes = Written(*scene);
  // A table of eleven sections takes one more row of 64 bytes: everything moves up.
  ASSERT_EQ(PaddedSection(10 * sizeof(SceneFileSection)), 320u);
  Bytes longer(bytes.size() + 64 + 64, std::byte{0});
  std::memcpy(longer.data(), bytes.data(), sizeof(SceneFileHeader) + 320);
  std::memcpy(&longer[sizeof(SceneFileHeader) + 384], &bytes[sizeof(SceneFileHeader) + 320],
              bytes.size() - sizeof(SceneFileHeader) - 320);
  for (uint32_t i = 0; i < kRequiredSections; ++i) Section(longer, i).offset += 64;
  Section(longer, 10) = {.kind = 1000, .element_bytes = 7, .offset = bytes.size() + 64, .count = 5};
  Header(longer).section_count = 11;
  Header(longer).file_bytes = longer.size();
  SealSceneFile(longer);
  const auto again = Load(longer);
  ASSERT_TRUE(again.ok()) << again.status();
  ExpectSame(*scene, **again);
  longer[longer.size() - 60] = std::byte{1};
  ExpectRefused(longer, absl::StatusCode::kDataLoss, "the addition were changed");
}

TEST_F(SceneFileTest, KdTreesGoAlong) {
  for (const bool perfect : {false, true}) {
    Scene scene = *Build(Objects(300));
    absl::StatusOr<KdTree> tree = BuildKdTree(scene.geometry, {.perfect_splits = perfect}, pool_);
    ASSERT_TRUE(tree.ok()) << tree.status();
    scene.kd_tree = *std::move(tree);
    const Bytes good = Written(scene);
    const auto again = Load(good);
    ASSERT_TRUE(again.ok()) << again.status();
    ExpectSame(scene, **again);
    ASSERT_TRUE((*again)->kd_tree.has_value());
    EXPECT_TRUE(SameBytes(scene.kd_tree->nodes, (*again)->kd_tree->nodes));
    EXPECT_TRUE(SameBytes(scene.kd_tree->leaves, (*again)->kd_tree->leaves));
    EXPECT_TRUE(SameBytes(scene.kd_tree->ids, (*again)->kd_tree->ids));
    EXPECT_TRUE(SameBytes(scene.kd_tree->reach, (*again)->kd_tree->reach));
    EXPECT_EQ(scene.kd_tree->bounds, (*again)->kd_tree->bounds);
    EXPECT_EQ(scene.kd_tree->max_depth, (*again)->kd_tree->max_depth);
    EXPECT_EQ(scene.kd_tree->triangle_count, (*again)->kd_tree->triangle_count);
    // A reference that is none, under a sum that is right.
    Bytes bad = good;
    const SceneFileSection ids = Section(bad, 13);
    ASSERT_EQ(ids.kind, static_cast<uint32_t>(SectionKind::kKdIds));
    const uint32_t none = 1'000'000;
    std::memcpy(&bad[ids.offset + 4], &none, 4);
    SealSceneFile(bad);
    ExpectRefused(bad, absl::StatusCode::kDataLoss, "kd");
    bad = good;
    bad[ids.offset] ^= std::byte{1};
    ExpectRefused(bad, absl::StatusCode::kDataLoss, "the kd-tree ids were changed");
  }
}

TEST_F(SceneFileTest, AKdTreeMayStandAlone) {
  const auto with_bvh = Build(Objects(300));
  Scene scene = *with_bvh;
  absl::StatusOr<KdTree> tree = BuildKdTree(scene.geometry, {}, pool_);
  ASSERT_TRUE(tree.ok()) << tree.status();
  scene.kd_tree = *std::move(tree);
  const auto version = [](Bytes bytes) { return Header(bytes).version; };
  EXPECT_EQ(version(Written(scene)), kSceneFileVersion);  // As older readers want it.
  scene.bvh = Bvh();
  const Bytes good = Written(scene);
  EXPECT_EQ(version(good), kSceneFileVersionWithoutBvh);
  const auto again = Load(good);
  ASSERT_TRUE(again.ok()) << again.status();
  ExpectSame(scene, **again);
  EXPECT_TRUE((*again)->kd_tree_alone());
  EXPECT_FALSE((*again)->kd_leaves.has_value());
  EXPECT_TRUE(SameBytes(scene.kd_tree->nodes, (*again)->kd_tree->nodes));
  // The version says what is there, and nothing else will do.
  Bytes bad = good;
  Header(bad).version = kSceneFileVersion;
  SealSceneFile(bad);
  ExpectRefused(bad, absl::StatusCode::kDataLoss, "");
  bad = Written(*with_bvh);
  Header(bad).version = kSceneFileVersionWithoutBvh;
  SealSceneFile(bad);
  ExpectRefused(bad, absl::StatusCode::kDataLoss, "it says that it has no bvh, and has one");
  bad = good;
  // The kd-tree's sections, as additions that nobody knows.
  for (uint32_t i = kRequiredSections; i < kRequiredSections + 5; ++i) Section(bad, i).kind += 700;
  SealSceneFile(bad);
  ExpectRefused(bad, absl::StatusCode::kDataLoss, "it says that its kd-tree stands alone");
}

TEST_F(SceneFileTest, LeavesLaidOutAreLaidOutAgain) {
  SceneBuildOptions options;
  options.kd_tree = KdBuildOptions{.lay_out_leaves = true};
  const auto scene = BuildScene("hall", 7, Objects(300), std::nullopt, options, pool_);
  ASSERT_TRUE(scene.ok()) << scene.status();
  ASSERT_TRUE((*scene)->kd_leaves.has_value());
  Bytes good = Written(**scene);
  const auto again = Load(good);
  ASSERT_TRUE(again.ok()) << again.status();
  ASSERT_TRUE((*again)->kd_leaves.has_value());
  EXPECT_TRUE(SameBytes((*scene)->kd_leaves->rows, (*again)->kd_leaves->rows));
  EXPECT_TRUE(SameBytes((*scene)->kd_leaves->boxes, (*again)->kd_leaves->boxes));
  auto* const record = reinterpret_cast<SceneFileKdTree*>(&good[Section(good, 10).offset]);
  record->leaves_laid_out = 2;
  SealSceneFile(good);
  ExpectRefused(good, absl::StatusCode::kDataLoss, "flags that are none");
}

TEST_F(SceneFileTest, BinaryBvhsGoAlong) {
  Scene scene = *Build(Objects(300));
  for (const bool kd_tree : {false, true}) {
    if (kd_tree) {
      absl::StatusOr<KdTree> tree = BuildKdTree(scene.geometry, {}, pool_);
      ASSERT_TRUE(tree.ok()) << tree.status();
      scene.kd_tree = *std::move(tree);
    }
    absl::StatusOr<BinaryBvh> bvh = BuildBinaryBvh(scene.geometry, {.cost_ratio = 0.2f}, pool_);
    ASSERT_TRUE(bvh.ok()) << bvh.status();
    scene.binary_bvh = *std::move(bvh);
    const Bytes good = Written(scene);
    const auto again = Load(good);
    ASSERT_TRUE(again.ok()) << again.status();
    ExpectSame(scene, **again);
    EXPECT_EQ((*again)->kd_tree.has_value(), kd_tree);
    ASSERT_TRUE((*again)->binary_bvh.has_value());
    const BinaryBvh &a = *scene.binary_bvh, &b = *(*again)->binary_bvh;
    EXPECT_TRUE(SameBytes(a.nodes, b.nodes));
    EXPECT_TRUE(SameBytes(a.ids, b.ids));
    EXPECT_TRUE(SameBytes(a.leaves.rows, b.leaves.rows));
    EXPECT_TRUE(SameBytes(a.leaves.boxes, b.leaves.boxes));
    EXPECT_EQ(a.leaf_count, b.leaf_count);
    EXPECT_EQ(a.max_depth, b.max_depth);
    EXPECT_EQ((*again)->report.binary_bvh_bytes, b.MemoryBytes());
    auto owner = std::make_shared<const Bytes>(good);
    const auto info = InspectSceneFile({*owner, owner, "'file'"});
    ASSERT_TRUE(info.ok()) << info.status();
    EXPECT_GE(info->scene_bytes, (*again)->report.memory_bytes);
    // Under sums that are right: a reference that is none, and a box that is not its contents'.
    Bytes bad = good;
    const uint32_t record = kRequiredSections + (kd_tree ? 5 : 0);
    const SceneFileSection nodes = Section(bad, record + 1), ids = Section(bad, record + 2);
    ASSERT_EQ(ids.kind, static_cast<uint32_t>(SectionKind::kBinaryBvhIds));
    const uint32_t none = 1'000'000;
    std::memcpy(&bad[ids.offset + 4], &none, 4);
    SealSceneFile(bad);
    ExpectRefused(bad, absl::StatusCode::kDataLoss, "binary bvh: leaf");
    bad = good;
    bad[nodes.offset] ^= std::byte{1};
    SealSceneFile(bad);
    ExpectRefused(bad, absl::StatusCode::kDataLoss, "the box of node 0");
    bad = good;
    bad[ids.offset] ^= std::byte{1};
    ExpectRefused(bad, absl::StatusCode::kDataLoss, "the binary bvh ids were changed");
  }
}

TEST_F(SceneFileTest, LeafMatesGoAlong) {
  const auto scene = Build(Objects(300));
  ASSERT_FALSE(scene->bvh.mates.empty());
  const Bytes good = Written(*scene);
  const auto again = Load(good);
  ASSERT_TRUE(again.ok()) << again.status();
  ExpectSame(*scene, **again);
  EXPECT_TRUE((*again)->bvh.mates.rows.borrowed());
  auto owner = std::make_shared<const Bytes>(good);
  const auto info = InspectSceneFile({*owner, owner, "'file'"});
  ASSERT_TRUE(info.ok()) << info.status();
  EXPECT_GE(info->scene_bytes, (*again)->report.memory_bytes);
  constexpr uint32_t kRows = kRequiredSections, kUnits = kRows + 1;
  const auto refused = [&](const std::string& part, const auto& spoil) {
    Bytes bad = good;
    spoil(bad);
    SealSceneFile(bad);
    ExpectRefused(bad, absl::StatusCode::kDataLoss, part);
  };
  // Under sums that are right: an edge's mate taken from one side alone, a leaf that is none.
  refused("invalid mates: edge", [&](Bytes& b) {
    LeafMate* mate = reinterpret_cast<LeafMate*>(&b[Section(b, kRows).offset]);
    while (!mate->exists()) ++mate;
    *mate = {};
  });
  refused("invalid mates: unit", [&](Bytes& b) { b[Section(b, kUnits).offset] ^= std::byte{1}; });
  // One without the other.
  refused("invalid mates: ", [&](Bytes& b) { Section(b, kUnits).kind += 700; });
  // Of a tree that is not there.
  Bytes bad = good;
  Header(bad).version = kSceneFileVersionWithoutBvh;
  SealSceneFile(bad);
  ExpectRefused(bad, absl::StatusCode::kDataLoss, "it says that it has no bvh, and has one");
  // Files of before there were any.
  Bytes old = good;
  Section(old, kRows).kind += 700;
  Section(old, kUnits).kind += 700;
  SealSceneFile(old);
  const auto without = Load(old);
  ASSERT_TRUE(without.ok()) << without.status();
  EXPECT_TRUE((*without)->bvh.mates.empty());
}

TEST_F(SceneFileTest, LimitsAndCancelling) {
  const Bytes good = Written(*Build(Objects(40)));
  auto owner = std::make_shared<const Bytes>(good);
  const SceneBytes file{*owner, owner, "'file'"};
  for (const MeshLimits& limits : {MeshLimits{.max_triangles = 51}, MeshLimits{.max_vertices = 147},
                                   MeshLimits{.max_objects = 2}}) {
    const absl::Status status = Load(file, {.limits = limits}).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kResourceExhausted) << status;
  }
  EXPECT_TRUE(
      Load(file, {.limits = {.max_triangles = 52, .max_vertices = 148, .max_objects = 3}}).ok());
  CancelToken cancel;
  cancel.Cancel();
  EXPECT_EQ(LoadScene(file, "x", {}, pool_, &cancel).status().code(), absl::StatusCode::kCancelled);
  const auto scene = Build(Objects(40));
  EXPECT_EQ(WriteSceneFile(*scene, OpenFolder(), "other.slscene", pool_, &cancel).code(),
            absl::StatusCode::kCancelled);
  EXPECT_EQ(OpenFolder().List()->size(), 1u);
}

// What is mapped stays what it was while another file takes its name.
TEST_F(SceneFileTest, AMappedSceneSurvivesItsFile) {
  const Folder folder = OpenFolder();
  const auto old_scene = Build(Objects(4000)), new_scene = Build(Objects(400));
  ASSERT_TRUE(WriteSceneFile(*old_scene, folder, "scene.slscene", pool_).ok());
  const auto mapped = Load(*MapSceneFile(folder, "scene.slscene"));
  ASSERT_TRUE(mapped.ok());
  ASSERT_TRUE(WriteSceneFile(*new_scene, folder, "scene.slscene", pool_).ok());
  ASSERT_TRUE(folder.Remove("scene.slscene").ok());
  ExpectSame(*old_scene, **mapped);
}

}  // namespace
}  // namespace sightline

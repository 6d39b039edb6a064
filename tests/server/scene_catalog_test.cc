// SPDX-License-Identifier: Apache-2.0
#include "server/scenes/scene_catalog.h"

#include <cerrno>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "core/base/folder.h"
#include "core/base/parallel.h"
#include "core/mesh/builtin/builtin.h"
#include "core/scene/scene_file.h"
#include "gtest/gtest.h"
#include "server/admission/call_quota.h"
#include "server/base/error.h"
#include "server/codec/scene_codec.h"
#include "server/points/point_set_store.h"
#include "tests/support/faulty_file_calls.h"
#include "tests/support/temp_dir.h"

namespace sightline {
namespace {

TEST(SceneCatalogTest, ABuiltinSceneIsMadeOnlyWhereThereIsRoomForIt) {
  Limits limits;
  limits.max_scene_bytes = 32 << 20;
  ThreadPool pool(1);
  SceneCatalog catalog(limits, pool);
  const auto create = [&](const std::string& id, const std::string& spec) {
    return catalog.CreateBuiltin({.scene_id = id, .builtin = spec}, nullptr).status();
  };
  const absl::Status small = create("a", "builtin:box:1000");
  ASSERT_TRUE(small.ok()) << small;
  // The city has a million unless told otherwise.
  for (const char* const spec : {"builtin:sphere:1M", "builtin:city"}) {
    const absl::Status status = create("b", spec);
    EXPECT_EQ(status.code(), absl::StatusCode::kResourceExhausted) << status;
    EXPECT_EQ(ReasonOf(status), v1::ERROR_REASON_OUT_OF_MEMORY_BUDGET);
  }
  EXPECT_EQ(ReasonOf(create("a", "builtin:box:1000")), v1::ERROR_REASON_ALREADY_EXISTS);
  EXPECT_EQ(catalog.MemoryBytes(), catalog.Get("a")->status.latest->report.memory_bytes);
}

// A catalog that tells a test of what is set aside.
class WatchedCatalog final : public SceneCatalog {
 public:
  using SceneCatalog::SceneCatalog;
  absl::Status SetAside(uint64_t bytes) override {
    const absl::Status status = SceneCatalog::SetAside(bytes);
    if (status.ok()) on_set_aside(bytes);
    return status;
  }
  std::function<void(uint64_t)> on_set_aside = [](uint64_t) {};
};

TEST(SceneCatalogTest, BuiltinScenesThatAreMadeAtOnceShareTheBudget) {
  ThreadPool pool(1);
  const auto create = [](SceneCatalog& catalog, const std::string& id) {
    return catalog.CreateBuiltin({.scene_id = id, .builtin = "builtin:sphere:20000"}, nullptr)
        .status();
  };
  uint64_t one = 0;
  int times = 0;
  {
    WatchedCatalog catalog(Limits(), pool);
    catalog.on_set_aside = [&](uint64_t bytes) { one += bytes, ++times; };
    const absl::Status made = create(catalog, "a");
    ASSERT_TRUE(made.ok()) << made;
  }
  ASSERT_GT(one, 20'000u * 100);  // A scene has more of each triangle.
  Limits limits;
  limits.max_scene_bytes = 2 * one - 1;
  WatchedCatalog catalog(limits, pool);
  absl::Status beside = absl::UnknownError("not asked");
  // Another one, when the first has been let in, and before any of it is made.
  catalog.on_set_aside = [&](uint64_t) {
    if (--times == 0) beside = create(catalog, "b");
  };
  const absl::Status made = create(catalog, "a");
  ASSERT_TRUE(made.ok()) << made;
  EXPECT_EQ(ReasonOf(beside), v1::ERROR_REASON_OUT_OF_MEMORY_BUDGET) << beside;
  EXPECT_EQ(catalog.MemoryBytes(), catalog.Get("a")->status.latest->report.memory_bytes);
  const absl::Status after = create(catalog, "b");
  EXPECT_TRUE(after.ok()) << after;
}

TEST(SceneCatalogTest, AFirstRevisionSaysWhichBuiltinSceneItIs) {
  ThreadPool pool(1);
  SceneCatalog catalog(Limits(), pool);
  const std::vector<ObjectInput> objects = MakeBuiltin(*ParseBuiltin("box:1k"))->objects;
  const auto made = catalog.CreateBuiltin({.scene_id = "a", .builtin = "builtin:box:1k"}, nullptr);
  ASSERT_TRUE(made.ok()) << made.status();
  EXPECT_EQ(made->builtin, "builtin:box:1000,seed=1");
  v1::Scene encoded;
  EncodeScene(*made, &encoded);
  EXPECT_EQ(encoded.builtin_spec(), "builtin:box:1000,seed=1");
  // What is uploaded is what it is, the same triangles or not.
  EXPECT_EQ(catalog.Create({.scene_id = "b"}, objects, nullptr)->builtin, "");
  const SceneEdit edit{.kind = SceneEdit::Kind::kRemove,
                       .object = ObjectInput{.name = objects.front().name}};
  const auto edited = catalog.Edit({.scene_id = "a"}, {&edit, 1}, nullptr);
  ASSERT_TRUE(edited.ok()) << edited.status();
  EXPECT_EQ(edited->builtin, "");
}

TEST(SceneCatalogTest, AnEditThatFailsChangesNothingOfWhatIsBuiltFromThenOn) {
  ThreadPool pool(1);
  SceneCatalog catalog(Limits(), pool);
  const auto made = catalog.CreateBuiltin({.scene_id = "a", .builtin = "builtin:box:1k"}, nullptr);
  ASSERT_TRUE(made.ok()) << made.status();
  int objects = 0;
  const auto edit = [&](SceneEdit::Kind kind, const SceneCatalog::EditOptions& options) {
    SceneEdit edit{.kind = kind};
    edit.object = {.name = absl::StrCat("more", ++objects),
                   .vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}},
                   .indices = {0, 1, 2}};
    return catalog.Edit(options, {&edit, 1}, nullptr);
  };
  const auto expect_built = [&](bool other) {
    const absl::StatusOr<SceneView> built = edit(SceneEdit::Kind::kAdd, {.scene_id = "a"});
    ASSERT_TRUE(built.ok()) << built.status();
    EXPECT_EQ(built->status.latest->bvh.has_leaf_rows(), !other);
    EXPECT_EQ(built->status.latest->kd_tree.has_value(), other);
    EXPECT_EQ(built->status.latest->binary_bvh.has_value(), other);
  };
  SceneCatalog::EditOptions other{.scene_id = "a",
                                  .preset = BvhPreset::kCompact,
                                  .kd_tree = KdBuildOptions(),
                                  .binary_bvh = BinaryBvhOptions()};
  ASSERT_FALSE(edit(SceneEdit::Kind::kRemove, other).ok());  // There is no such object.
  expect_built(false);
  other.base_revision = 7;
  ASSERT_FALSE(edit(SceneEdit::Kind::kAdd, other).ok());
  expect_built(false);
  other.base_revision = 0;
  ASSERT_TRUE(edit(SceneEdit::Kind::kAdd, other).ok());
  expect_built(true);
}

TEST(SceneCatalogTest, WhatArrivesCountsAgainstTheBudget) {
  Limits limits;
  limits.max_scene_bytes = 32 << 20;
  ThreadPool pool(1);
  SceneCatalog catalog(limits, pool);
  ASSERT_TRUE(catalog.SetAside(20 << 20).ok());
  EXPECT_EQ(catalog.MemoryBytes(), uint64_t{20} << 20);
  const absl::Status more = catalog.SetAside(13 << 20);
  EXPECT_EQ(ReasonOf(more), v1::ERROR_REASON_OUT_OF_MEMORY_BUDGET) << more;
  // 100,000 triangles would fit into an empty catalog.
  EXPECT_EQ(ReasonOf(catalog.CheckRoom("a", 120'000, 0)), v1::ERROR_REASON_OUT_OF_MEMORY_BUDGET);
  catalog.GiveBack(20 << 20);
  EXPECT_EQ(catalog.MemoryBytes(), 0u);
  EXPECT_TRUE(catalog.CheckRoom("a", 120'000, 0).ok());
  EXPECT_FALSE(catalog.CheckRoom("a", 120'000, 0, /*arriving=*/20 << 20).ok());
}

TEST(SceneCatalogTest, AnEditIsRefusedAsSoonAsItAnnouncesTooMuch) {
  Limits limits;
  limits.max_scene_bytes = 32 << 20;
  limits.max_bytes_per_scene = 16 << 20;
  ThreadPool pool(1);
  SceneCatalog catalog(limits, pool);
  ASSERT_TRUE(
      catalog.CreateBuiltin({.scene_id = "a", .builtin = "builtin:box:50000"}, nullptr).ok());
  EXPECT_TRUE(catalog.CheckEditRoom("a", 1000, 3000).ok());
  EXPECT_EQ(ReasonOf(catalog.CheckEditRoom("a", 100'000, 50'000)),
            v1::ERROR_REASON_OUT_OF_MEMORY_BUDGET);
  EXPECT_TRUE(catalog.CheckEditRoom("none", 100'000, 50'000).ok());  // For the edit to say.
}

// Two catalogs one after the other on a folder of stored scenes.
class StoredScenesTest : public ::testing::Test {
 protected:
  StoredScenesTest() {
    auto opened = SceneRepository::Open(dir_.path(), calls_);
    EXPECT_TRUE(opened.ok()) << opened.status();
    repository_ = *std::move(opened);
    SceneCatalog first(Limits(), pool_, repository_.get());
    for (const char* id : {"hall", "attic", "cellar"}) {
      EXPECT_TRUE(first.Create({.scene_id = id}, {&object_, 1}, nullptr).ok());
      EXPECT_TRUE(Exists(id));
    }
  }
  std::string File(const std::string& id) const { return dir_.File(id + ".slscene"); }
  bool Exists(const std::string& id) const { return std::filesystem::exists(File(id)); }
  // The scene of the hall's file, which says its last word when it is let go of: after the registry
  // has forgotten it, before the catalog has.
  SceneBytes Hall(const std::function<void()>& last_word) {
    const absl::StatusOr<Folder> folder = Folder::Open(dir_.path());
    SceneBytes file = *MapSceneFile(*folder, "hall.slscene");
    file.owner = std::shared_ptr<const void>(
        file.owner.get(), [owner = file.owner, last_word](const void*) { last_word(); });
    return file;
  }
  // A scene that is there is one that can be edited and stored.
  void ExpectSound(SceneCatalog& catalog, const std::string& id) {
    ObjectInput more = object_;
    more.name = "more";
    const SceneEdit edit{.kind = SceneEdit::Kind::kAdd, .object = more};
    const absl::StatusOr<SceneView> edited = catalog.Edit({.scene_id = id}, {&edit, 1}, nullptr);
    ASSERT_TRUE(edited.ok()) << edited.status();
    EXPECT_TRUE(edited->status.kept);
    EXPECT_TRUE(Exists(id));
  }

  const ObjectInput object_{
      .name = "o", .vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, .indices = {0, 1, 2}};
  const testing_support::TempDir dir_;
  testing_support::FaultyFileCalls calls_;
  ThreadPool pool_{1};
  std::unique_ptr<SceneRepository> repository_;
};

TEST_F(StoredScenesTest, OneThatIsLoadedWhileItIsEvictedCanBeEdited) {
  Limits limits;
  limits.max_scenes = 2;
  SceneCatalog catalog(limits, pool_, repository_.get(), /*evict=*/true);
  PointSetStore point_sets(limits, [] { return absl::UnixEpoch(); });
  absl::Status again = absl::UnknownError("not asked");
  // Loads it again, and uploads points to it at once.
  const auto load_again = [&] {
    again = catalog.Load("hall", nullptr).status();
    PointSet set;
    set.scene_id = "hall";
    set.point_set_id = "floor";
    ASSERT_TRUE(catalog.PinTagged("hall", 0, &set.scene_tag).ok());
    ASSERT_TRUE(point_sets.Add(std::move(set), absl::Seconds(1)).ok());
  };
  ASSERT_TRUE(catalog.CreateFromBytes({.scene_id = "hall"}, Hall(load_again), nullptr).ok());
  ASSERT_TRUE(catalog.Load("attic", nullptr).ok());
  ASSERT_TRUE(catalog.Pin("attic", 0).ok());
  std::vector<std::string> told;
  catalog.SetListener([&](const SceneView& view) {
    if (!view.deleted) return;
    told.push_back(view.status.name);
    point_sets.RemoveScene(view.status.name, view.status.tag);
  });
  // Makes room of the hall, which at that moment is asked for again, and makes room of the attic.
  ASSERT_TRUE(catalog.Load("cellar", nullptr).ok());
  ASSERT_TRUE(again.ok()) << again;
  EXPECT_EQ(told.size(), 2u);
  ASSERT_TRUE(catalog.Get("hall").ok());
  EXPECT_TRUE(point_sets.Get("hall", "floor").ok());
  ExpectSound(catalog, "hall");
}

// A share of a quota of one, as a client has that may make one scene.
std::shared_ptr<CallShare> TakeOne(CallQuota& quota) {
  absl::StatusOr<CallShare> share = quota.Take("client", 1);
  return share.ok() ? std::make_shared<CallShare>(*std::move(share)) : nullptr;
}

TEST_F(StoredScenesTest, ASceneIsItsMakersUntilItIsDeleted) {
  CallQuota quota("scenes", CallQuota::Shares::kLast);
  SceneCatalog catalog(Limits(), pool_, repository_.get());
  const auto create = [&](const std::string& id, bool temporary) {
    return catalog
        .Create({.scene_id = id, .temporary = temporary, .share = TakeOne(quota)}, {&object_, 1},
                nullptr)
        .status();
  };
  for (const bool temporary : {true, false}) {
    ASSERT_TRUE(create("a", temporary).ok());
    EXPECT_EQ(TakeOne(quota), nullptr);
    ASSERT_TRUE(catalog.Delete("a").ok());
    EXPECT_NE(TakeOne(quota), nullptr);
    EXPECT_EQ(catalog.Delete("a").code(), absl::StatusCode::kNotFound);
  }
  // What is not made takes nothing.
  EXPECT_EQ(create("hall", false).code(), absl::StatusCode::kAlreadyExists);
  EXPECT_NE(TakeOne(quota), nullptr);
  // Not in memory, it is stored as before; loaded again, the same.
  ASSERT_TRUE(create("a", false).ok());
  ASSERT_TRUE(catalog.Unload("a").ok());
  EXPECT_EQ(TakeOne(quota), nullptr);
  ASSERT_TRUE(catalog.Load("a", nullptr).ok());
  EXPECT_EQ(TakeOne(quota), nullptr);
  ASSERT_TRUE(catalog.Unload("a").ok());
  ASSERT_TRUE(catalog.Delete("a").ok());
  EXPECT_NE(TakeOne(quota), nullptr);
  // Nobody's, until somebody has it made of its file.
  ASSERT_TRUE(
      catalog.CreateFromFile({.scene_id = "hall", .share = TakeOne(quota)}, "hall", nullptr).ok());
  EXPECT_EQ(TakeOne(quota), nullptr);
  ASSERT_TRUE(catalog.Delete("hall").ok());
  EXPECT_NE(TakeOne(quota), nullptr);
}

TEST_F(StoredScenesTest, ADeletionThatIsRefusedLeavesTheShareToTheOtherOne) {
  CallQuota quota("scenes", CallQuota::Shares::kLast);
  SceneCatalog catalog(Limits(), pool_, repository_.get());
  ASSERT_TRUE(
      catalog.Create({.scene_id = "a", .share = TakeOne(quota)}, {&object_, 1}, nullptr).ok());
  absl::Status beside;
  bool held = false;
  calls_.on_unlink = [&] {
    beside = catalog.Delete("a");
    held = TakeOne(quota) == nullptr;
  };
  ASSERT_TRUE(catalog.Delete("a").ok());
  calls_.on_unlink = nullptr;
  EXPECT_EQ(ReasonOf(beside), v1::ERROR_REASON_SCENE_BUSY) << beside;
  EXPECT_TRUE(held);
  EXPECT_NE(TakeOne(quota), nullptr);
}

TEST_F(StoredScenesTest, AFileThatIsGoneFromOutsideIsNobodysAnyMore) {
  CallQuota quota("scenes", CallQuota::Shares::kLast);
  SceneCatalog catalog(Limits(), pool_, repository_.get());
  ASSERT_TRUE(
      catalog.Create({.scene_id = "a", .share = TakeOne(quota)}, {&object_, 1}, nullptr).ok());
  ASSERT_TRUE(catalog.Unload("a").ok());
  ASSERT_TRUE(std::filesystem::remove(File("a")));
  EXPECT_FALSE(catalog.Delete("a").ok());
  EXPECT_NE(TakeOne(quota), nullptr);
}

TEST_F(StoredScenesTest, OneThatIsLoadedWhileItIsUnloadedIsBusy) {
  SceneCatalog catalog(Limits(), pool_, repository_.get());
  absl::Status again = absl::UnknownError("not asked");
  ASSERT_TRUE(catalog
                  .CreateFromBytes({.scene_id = "hall"},
                                   Hall([&] { again = catalog.Load("hall", nullptr).status(); }),
                                   nullptr)
                  .ok());
  ASSERT_TRUE(catalog.Unload("hall").ok());
  EXPECT_EQ(again.code(), absl::StatusCode::kAborted) << again;
  EXPECT_EQ(ReasonOf(again), v1::ERROR_REASON_SCENE_BUSY);
  EXPECT_FALSE(catalog.Get("hall").ok());
  ASSERT_TRUE(catalog.Load("hall", nullptr).ok());
  ExpectSound(catalog, "hall");
}

// It may be edited once it is there: that is worth asking again.
TEST_F(StoredScenesTest, OneThatIsMadeOrLoadedIsBusyForAnEdit) {
  SceneCatalog catalog(Limits(), pool_, repository_.get());
  std::vector<absl::Status> early;
  uint64_t tag = 0;
  const auto ask = [&](const std::string& id) {
    early.push_back(catalog.CheckEdit({.scene_id = id}, &tag));
  };
  catalog.SetListener([&](const SceneView& view) {
    if (view.status.state != SceneState::kBuilding || view.status.latest != nullptr) return;
    ask(view.status.name);
    EXPECT_EQ(ReasonOf(catalog.Pin(view.status.name, 0).status()),
              v1::ERROR_REASON_SCENE_NOT_READY);
  });
  ASSERT_TRUE(catalog.Create({.scene_id = "new"}, {&object_, 1}, nullptr).ok());
  EXPECT_FALSE(early.empty());
  calls_.on_map = [&] { ask("hall"); };  // Before it counts as being loaded.
  ASSERT_TRUE(catalog.Load("hall", nullptr).ok());
  calls_.on_map = nullptr;
  for (const absl::Status& status : early) {
    EXPECT_EQ(status.code(), absl::StatusCode::kAborted) << status;
    EXPECT_EQ(ReasonOf(status), v1::ERROR_REASON_SCENE_BUSY) << status;
  }
  EXPECT_TRUE(catalog.CheckEdit({.scene_id = "hall"}, &tag).ok());
  EXPECT_EQ(ReasonOf(catalog.CheckEdit({.scene_id = "hall", .base_revision = 5}, &tag)),
            v1::ERROR_REASON_REVISION_MISMATCH);
}

TEST_F(StoredScenesTest, OneWhoseFileIsBeingRemovedIsNotLoaded) {
  SceneCatalog catalog(Limits(), pool_, repository_.get());
  absl::Status again = absl::UnknownError("not asked");
  calls_.on_unlink = [&] { again = catalog.Load("hall", nullptr).status(); };
  ASSERT_TRUE(catalog.Delete("hall").ok());
  calls_.on_unlink = nullptr;
  EXPECT_EQ(ReasonOf(again), v1::ERROR_REASON_SCENE_BUSY) << again;
  // It would serve without a file, and count as stored.
  EXPECT_FALSE(catalog.Get("hall").ok());
  EXPECT_FALSE(Exists("hall"));
  // The name is free again.
  ASSERT_TRUE(catalog.Create({.scene_id = "hall"}, {&object_, 1}, nullptr).ok());
  ExpectSound(catalog, "hall");
}

// Another file takes the place of the one that a reload has begun with, as an edit's might.
TEST_F(StoredScenesTest, AReloadIsOfTheFileThatIsThereNow) {
  SceneCatalog catalog(Limits(), pool_, repository_.get());
  ASSERT_TRUE(catalog.Load("hall", nullptr).ok());
  bool replaced = false;
  calls_.on_map = [&] {
    if (std::exchange(replaced, true)) return;
    std::filesystem::copy_file(File("attic"), dir_.File("new"));
    std::filesystem::rename(dir_.File("new"), File("hall"));
  };
  const absl::Status busy = catalog.Reload("hall", nullptr).status();
  EXPECT_EQ(busy.code(), absl::StatusCode::kAborted) << busy;
  EXPECT_EQ(ReasonOf(busy), v1::ERROR_REASON_SCENE_BUSY);
  const absl::StatusOr<SceneView> again = catalog.Reload("hall", nullptr);
  ASSERT_TRUE(again.ok()) << again.status();
  EXPECT_EQ(again->status.latest->revision, 2u);
}

// Which begins when the name is free, and ends when it is another's, whose file it would replace.
TEST_F(StoredScenesTest, AFileIsNotStoredUnderTheNameOfAStoredScene) {
  SceneCatalog catalog(Limits(), pool_, repository_.get());
  bool made = false;
  calls_.on_map = [&] {
    if (std::exchange(made, true)) return;
    ASSERT_TRUE(catalog.Create({.scene_id = "shed"}, {&object_, 1}, nullptr).ok());
    ASSERT_TRUE(catalog.Unload("shed").ok());
  };
  for (const bool temporary : {false, true}) {
    const absl::Status taken =
        catalog.CreateFromFile({.scene_id = "shed", .temporary = temporary}, "hall", nullptr)
            .status();
    EXPECT_EQ(ReasonOf(taken), v1::ERROR_REASON_ALREADY_EXISTS) << taken;
  }
  calls_.on_map = nullptr;
  EXPECT_FALSE(catalog.Get("shed").ok());
  ASSERT_TRUE(catalog.Load("shed", nullptr).ok());
  ExpectSound(catalog, "shed");
  // Of a free name it is another scene.
  ASSERT_TRUE(catalog.CreateFromFile({.scene_id = "hut"}, "hall", nullptr).ok());
  ExpectSound(catalog, "hut");
}

// A temporary scene, and a file that is put where its own would be.
TEST_F(StoredScenesTest, ASceneThatIsReloadedIsStoredFromThenOn) {
  SceneCatalog catalog(Limits(), pool_, repository_.get());
  ASSERT_TRUE(catalog.Create({.scene_id = "shed", .temporary = true}, {&object_, 1}, nullptr).ok());
  std::filesystem::copy_file(File("attic"), File("shed"));
  calls_.map_error = EIO;
  EXPECT_FALSE(catalog.Reload("shed", nullptr).ok());
  calls_.map_error = 0;
  const auto edit = [&](const std::string& name) {
    ObjectInput more = object_;
    more.name = name;
    const SceneEdit edit{.kind = SceneEdit::Kind::kAdd, .object = more};
    const absl::StatusOr<SceneView> edited =
        catalog.Edit({.scene_id = "shed"}, {&edit, 1}, nullptr);
    EXPECT_TRUE(edited.ok()) << edited.status();
    return edited.ok() && edited->status.kept;
  };
  EXPECT_FALSE(edit("a"));  // It is what it was.
  const absl::StatusOr<SceneView> reloaded = catalog.Reload("shed", nullptr);
  ASSERT_TRUE(reloaded.ok()) << reloaded.status();
  EXPECT_TRUE(edit("b"));
  ASSERT_TRUE(catalog.Delete("shed").ok());
  EXPECT_FALSE(Exists("shed"));
}

// Else it would be back by the next start.
TEST_F(StoredScenesTest, AFileUnderTheNameOfATemporarySceneIsDeletedWithIt) {
  SceneCatalog catalog(Limits(), pool_, repository_.get());
  const auto make = [&] {
    return catalog.Create({.scene_id = "shed", .temporary = true}, {&object_, 1}, nullptr).ok();
  };
  ASSERT_TRUE(make());
  std::filesystem::copy_file(File("attic"), File("shed"));
  ASSERT_TRUE(catalog.Delete("shed").ok());
  EXPECT_FALSE(Exists("shed"));
  // Whether there is one need not be known: it stores nothing.
  ASSERT_TRUE(make());
  calls_.stat_error = EIO;
  EXPECT_TRUE(catalog.Delete("shed").ok());
}

// It looks for a file when there is none yet, and goes on when a creation has stored one.
TEST_F(StoredScenesTest, ADeletionLeavesNoFileOfWhatWasMadeMeanwhile) {
  SceneCatalog catalog(Limits(), pool_, repository_.get());
  bool made = false;
  calls_.on_stat = [&] {
    if (std::exchange(made, true)) return;
    ASSERT_TRUE(catalog.Create({.scene_id = "shed"}, {&object_, 1}, nullptr).ok());
  };
  const absl::Status deleted = catalog.Delete("shed");
  calls_.on_stat = nullptr;
  ASSERT_TRUE(made);
  EXPECT_TRUE(deleted.ok()) << deleted;
  EXPECT_FALSE(catalog.Get("shed").ok());
  EXPECT_FALSE(Exists("shed"));
}

TEST_F(StoredScenesTest, AnEditAfterAReloadBuildsWhatTheFileHas) {
  SceneCatalog catalog(Limits(), pool_, repository_.get());
  const auto preset = [&](const std::string& id, BvhPreset preset) {
    return catalog.CreateBuiltin({.scene_id = id, .preset = preset, .builtin = "builtin:box:1000"},
                                 nullptr);
  };
  ASSERT_TRUE(preset("compact", BvhPreset::kCompact).ok());
  ASSERT_TRUE(preset("static", BvhPreset::kStatic).ok());
  const auto rows = [](const absl::StatusOr<SceneView>& view) {
    EXPECT_TRUE(view.ok()) << view.status();
    return view.ok() && view->status.latest->bvh.has_leaf_rows();
  };
  ASSERT_FALSE(rows(catalog.Get("compact")));
  ASSERT_TRUE(rows(catalog.Get("static")));
  std::filesystem::rename(File("compact"), dir_.File("swapped"));
  std::filesystem::rename(File("static"), File("compact"));
  std::filesystem::rename(dir_.File("swapped"), File("static"));
  const SceneEdit edit{.kind = SceneEdit::Kind::kAdd, .object = object_};
  for (const std::string id : {"compact", "static"}) {
    const bool file_has_rows = id == "compact";
    EXPECT_EQ(rows(catalog.Reload(id, nullptr)), file_has_rows);
    EXPECT_EQ(rows(catalog.Edit({.scene_id = id}, {&edit, 1}, nullptr)), file_has_rows);
  }
}

// By somebody who is told of it, before whoever had it made is.
TEST_F(StoredScenesTest, AnEditOfASceneOfAFileThatIsJustReadyBuildsWhatTheFileHas) {
  SceneCatalog catalog(Limits(), pool_, repository_.get());
  std::string watched;
  std::optional<BvhPreset> asked;
  int objects = 0;
  const auto edit = [&](const std::string& id, std::optional<BvhPreset> preset) {
    ObjectInput more = object_;
    more.name = absl::StrCat("more", ++objects);
    const SceneEdit edit{.kind = SceneEdit::Kind::kAdd, .object = more};
    const absl::StatusOr<SceneView> edited =
        catalog.Edit({.scene_id = id, .preset = preset}, {&edit, 1}, nullptr);
    EXPECT_TRUE(edited.ok()) << edited.status();
    return edited.ok() && edited->status.latest->bvh.has_leaf_rows();
  };
  std::optional<bool> rows;
  catalog.SetListener([&](const SceneView& view) {
    if (view.status.name != watched || view.status.state != SceneState::kReady) return;
    watched.clear();
    rows = edit(view.status.name, asked);
  });
  ASSERT_TRUE(
      catalog
          .CreateBuiltin(
              {.scene_id = "compact", .preset = BvhPreset::kCompact, .builtin = "builtin:box:1000"},
              nullptr)
          .ok());
  for (const bool temporary : {true, false}) {
    for (const bool other : {false, true}) {
      const std::string id = absl::StrCat("copy", temporary, other);
      watched = id;
      asked = other ? std::optional(BvhPreset::kStatic) : std::nullopt;
      rows.reset();
      const absl::Status made =
          catalog.CreateFromFile({.scene_id = id, .temporary = temporary}, "compact", nullptr)
              .status();
      ASSERT_TRUE(made.ok()) << made;
      EXPECT_EQ(rows, other);
      EXPECT_EQ(edit(id, std::nullopt), other);  // What it asked for stays.
    }
  }
}

TEST_F(StoredScenesTest, FilesThatAreReadTakeAFaultOfTheDiskForAnError) {
  const auto repository = SceneRepository::Open(dir_.path(), calls_, SceneFiles::kRead);
  ASSERT_TRUE(repository.ok()) << repository.status();
  SceneCatalog catalog(Limits(), pool_, repository->get());
  ASSERT_TRUE(catalog.Load("hall", nullptr).ok());
  // What was read does not depend on its file any more: mapped, reading on would be the end.
  std::filesystem::resize_file(File("hall"), 1000);
  const std::shared_ptr<const Scene> hall = *catalog.Pin("hall", 0);
  EXPECT_EQ(hall->geometry.triangles.size(), 1u);
  EXPECT_EQ(hall->geometry.vertices.size(), 3u);
  EXPECT_EQ(ReasonOf(catalog.Reload("hall", nullptr).status()), v1::ERROR_REASON_BAD_SCENE_FILE);
  calls_.read_error = EIO;
  const absl::Status failed = catalog.Load("attic", nullptr).status();
  EXPECT_EQ(failed.code(), absl::StatusCode::kDataLoss) << failed;
  EXPECT_EQ(ReasonOf(failed), v1::ERROR_REASON_STORAGE_FAILED);
  EXPECT_EQ(catalog.MemoryBytes(), hall->report.memory_bytes);  // What was set aside is back.
  EXPECT_TRUE(catalog.Get("hall").ok());
  calls_.read_error = 0;
  ASSERT_TRUE(catalog.Load("attic", nullptr).ok());
  ExpectSound(catalog, "hall");
}

TEST_F(StoredScenesTest, AServerThatStopsLeavesNoHalfWrittenFile) {
  SceneCatalog catalog(Limits(), pool_, repository_.get());
  calls_.on_write = [&] { catalog.StopStoring(); };
  const absl::StatusOr<SceneView> made = catalog.Create({.scene_id = "a"}, {&object_, 1}, nullptr);
  ASSERT_TRUE(made.ok()) << made.status();  // It serves.
  EXPECT_FALSE(made->status.kept);
  EXPECT_EQ(ReasonOf(made->status.keep_error), v1::ERROR_REASON_CANCELLED)
      << made->status.keep_error;
  size_t files = 0;
  for (const auto& file : std::filesystem::directory_iterator(dir_.path())) {
    EXPECT_EQ(file.path().extension(), ".slscene") << file.path();
    ++files;
  }
  EXPECT_EQ(files, 3u);
  EXPECT_FALSE(Exists("a"));
}

TEST_F(StoredScenesTest, TheBudgetIsAskedBeforeAFileIsRead) {
  const auto repository = SceneRepository::Open(dir_.path(), calls_, SceneFiles::kRead);
  ASSERT_TRUE(repository.ok()) << repository.status();
  Limits limits;
  limits.max_scene_bytes = std::filesystem::file_size(File("hall")) - 1;
  SceneCatalog catalog(limits, pool_, repository->get());
  calls_.read_error = EIO;
  const absl::Status refused = catalog.Load("hall", nullptr).status();
  EXPECT_EQ(ReasonOf(refused), v1::ERROR_REASON_OUT_OF_MEMORY_BUDGET) << refused;
}

}  // namespace
}  // namespace sightline

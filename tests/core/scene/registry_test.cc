// SPDX-License-Identifier: Apache-2.0
#include "core/scene/registry.h"

#include <atomic>
#include <new>
#include <string>
#include <thread>
#include <vector>

#include "core/accel/bvh_validation.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace sightline {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using Kind = SceneEdit::Kind;

// A strip of triangles.
ObjectInput Strip(const std::string& name, uint32_t triangles) {
  ObjectInput object{.name = name};
  for (uint32_t i = 0; i < triangles + 2; ++i) {
    object.vertices.push_back({static_cast<double>(i), static_cast<double>(i % 2), 0});
  }
  for (uint32_t i = 0; i < triangles; ++i) {
    object.indices.insert(object.indices.end(), {i, i + 1, i + 2});
  }
  return object;
}

void ExpectError(const absl::Status& status, absl::StatusCode code,
                 const std::vector<std::string>& parts) {
  EXPECT_EQ(status.code(), code) << status;
  for (const std::string& part : parts) {
    EXPECT_THAT(std::string(status.message()), HasSubstr(part));
  }
}

class RegistryTest : public ::testing::Test {
 protected:
  absl::StatusOr<std::shared_ptr<const Scene>> Create(SceneRegistry& registry,
                                                      const std::string& name,
                                                      uint32_t triangles = 10) {
    const std::vector<ObjectInput> objects = {Strip("strip", triangles)};
    return registry.Create(name, objects, std::nullopt, {});
  }
  absl::StatusOr<std::shared_ptr<const Scene>> Add(SceneRegistry& registry, const std::string& name,
                                                   uint64_t expected, const std::string& object,
                                                   uint32_t triangles = 5) {
    const std::vector<SceneEdit> edits = {{Kind::kAdd, Strip(object, triangles)}};
    return registry.Edit(name, expected, edits, {});
  }
  ThreadPool pool_{2};
};

TEST_F(RegistryTest, CreatesServesAndDeletes) {
  SceneRegistry registry({}, pool_);
  ExpectError(registry.Get("hall", 0).status(), absl::StatusCode::kNotFound, {"\"hall\""});
  ExpectError(registry.GetStatus("hall").status(), absl::StatusCode::kNotFound, {"\"hall\""});
  ExpectError(registry.Delete("hall").status(), absl::StatusCode::kNotFound, {"\"hall\""});
  ExpectError(Add(registry, "hall", 0, "a").status(), absl::StatusCode::kNotFound, {"\"hall\""});

  ASSERT_TRUE(Create(registry, "hall").ok());
  ASSERT_TRUE(Create(registry, "attic").ok());
  ExpectError(Create(registry, "hall").status(), absl::StatusCode::kAlreadyExists, {"\"hall\""});
  const auto scene = registry.Get("hall", 0);
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_EQ((*scene)->revision, 1u);
  EXPECT_EQ(*registry.Get("hall", 1), *scene);
  const std::vector<SceneStatus> list = registry.List();
  ASSERT_EQ(list.size(), 2u);
  EXPECT_EQ(list[0].name, "attic");
  EXPECT_EQ(list[1].name, "hall");
  EXPECT_EQ(list[1].state, SceneState::kReady);
  EXPECT_EQ(list[1].progress, 1.0);
  ASSERT_TRUE(registry.Delete("hall").ok());
  EXPECT_EQ(registry.List().size(), 1u);
  // What was pinned lives on.
  EXPECT_TRUE(ValidateBvh((*scene)->bvh, (*scene)->geometry).ok());
}

TEST_F(RegistryTest, EditsMakeRevisionsAndPinnedOnesLive) {
  SceneRegistry registry({}, pool_);
  std::shared_ptr<const Scene> first = *Create(registry, "hall");
  const auto second = Add(registry, "hall", 1, "a");
  ASSERT_TRUE(second.ok()) << second.status();
  EXPECT_EQ((*second)->revision, 2u);
  EXPECT_EQ(*registry.Get("hall", 0), *second);
  EXPECT_EQ(*registry.Get("hall", 1), first);
  ExpectError(Add(registry, "hall", 1, "b").status(), absl::StatusCode::kFailedPrecondition,
              {"revision 2", "not 1"});
  ExpectError(registry.Get("hall", 3).status(), absl::StatusCode::kFailedPrecondition,
              {"no revision 3 yet", "revision 2"});
  EXPECT_EQ(first->geometry.triangles.size(), 10u);
  const uint64_t with_both = registry.MemoryBytes();
  const uint64_t bytes = first->report.memory_bytes;
  first.reset();
  EXPECT_EQ(registry.MemoryBytes(), with_both - bytes);
  ExpectError(registry.Get("hall", 1).status(), absl::StatusCode::kFailedPrecondition,
              {"no revision 1 any more", "revision 2"});
}

TEST_F(RegistryTest, AFailedEditLeavesTheRevisionServing) {
  SceneRegistry registry({}, pool_);
  ASSERT_TRUE(Create(registry, "hall").ok());
  const uint64_t bytes = registry.MemoryBytes();
  const std::vector<SceneEdit> edits = {{Kind::kRemove, {.name = "sofa"}}};
  EXPECT_EQ(registry.Edit("hall", 0, edits, {}).status().code(), absl::StatusCode::kNotFound);
  const auto status = registry.GetStatus("hall");
  ASSERT_TRUE(status.ok());
  EXPECT_EQ(status->state, SceneState::kReady);
  EXPECT_EQ(status->error.code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(status->latest->revision, 1u);
  EXPECT_EQ(registry.MemoryBytes(), bytes);
  ASSERT_TRUE(Add(registry, "hall", 1, "a").ok());
  EXPECT_TRUE(registry.GetStatus("hall")->error.ok());
}

TEST_F(RegistryTest, AFailedCreationLeavesNothing) {
  SceneRegistry registry({}, pool_);
  std::vector<ObjectInput> objects = {Strip("strip", 3)};
  objects[0].indices[0] = 99;
  EXPECT_EQ(registry.Create("hall", objects, std::nullopt, {}).status().code(),
            absl::StatusCode::kInvalidArgument);
  EXPECT_TRUE(registry.List().empty());
  EXPECT_EQ(registry.MemoryBytes(), 0u);
  CancelToken cancel;
  cancel.Cancel();
  objects = {Strip("strip", 3)};
  EXPECT_EQ(registry.Create("hall", objects, std::nullopt, {}, &cancel).status().code(),
            absl::StatusCode::kCancelled);
  EXPECT_TRUE(Create(registry, "hall").ok());
}

TEST_F(RegistryTest, LimitsAreNamedWithTheirValue) {
  const uint64_t room = EstimateSceneBytes(1000, 1002) + EstimateObjectBytes(1, /*name_bytes=*/16);
  SceneRegistry registry({.memory_budget_bytes = room, .max_scenes = 2}, pool_);
  const std::string budget = std::to_string(registry.options().memory_budget_bytes);
  ExpectError(Create(registry, "large", 1001).status(), absl::StatusCode::kResourceExhausted,
              {"\"large\"", budget});
  EXPECT_TRUE(registry.List().empty());
  std::shared_ptr<const Scene> pinned = *Create(registry, "a", 1000);
  ExpectError(Create(registry, "b", 900).status(), absl::StatusCode::kResourceExhausted, {budget});
  ExpectError(Add(registry, "a", 0, "more", 1).status(), absl::StatusCode::kResourceExhausted,
              {budget});
  // A deleted scene counts as long as somebody holds a revision of it.
  ASSERT_TRUE(registry.Delete("a").ok());
  EXPECT_EQ(registry.MemoryBytes(), pinned->report.memory_bytes);
  EXPECT_FALSE(Create(registry, "b", 900).ok());
  pinned.reset();
  EXPECT_EQ(registry.MemoryBytes(), 0u);
  EXPECT_TRUE(Create(registry, "b", 10).ok());
  EXPECT_TRUE(Create(registry, "c", 10).ok());
  ExpectError(Create(registry, "d", 10).status(), absl::StatusCode::kResourceExhausted,
              {"max_scenes is 2"});
}

// The observer runs within the build, so what is refused meanwhile can be tried from it.
TEST_F(RegistryTest, WhileABuildRuns) {
  SceneRegistry registry({}, pool_);
  std::vector<SceneState> states;
  bool tried = false;
  registry.SetObserver([&](const SceneStatus& status) {
    states.push_back(status.state);
    if (status.state != SceneState::kBuilding || tried) return;
    tried = true;
    EXPECT_EQ(registry.Get("hall", 0).status().code(), absl::StatusCode::kUnavailable);
    EXPECT_EQ(registry.Delete("hall").status().code(), absl::StatusCode::kAborted);
    EXPECT_EQ(Add(registry, "hall", 0, "a").status().code(), absl::StatusCode::kAborted);
    EXPECT_EQ(Create(registry, "hall").status().code(), absl::StatusCode::kAlreadyExists);
    EXPECT_EQ(registry.GetStatus("hall")->state, SceneState::kBuilding);
    EXPECT_GT(registry.MemoryBytes(), 0u);  // Reserved.
  });
  ASSERT_TRUE(Create(registry, "hall").ok());
  EXPECT_TRUE(tried);
  EXPECT_EQ(states.back(), SceneState::kReady);
  states.clear();
  ASSERT_TRUE(Add(registry, "hall", 0, "a").ok());
  EXPECT_EQ(states.front(), SceneState::kBuilding);
  EXPECT_EQ(states.back(), SceneState::kReady);
  states.clear();
  std::vector<ObjectInput> bad = {Strip("strip", 1)};
  bad[0].indices[2] = 3;
  EXPECT_FALSE(registry.Create("bad", bad, std::nullopt, {}).ok());
  EXPECT_THAT(states, ElementsAre(SceneState::kBuilding, SceneState::kFailed));
  registry.SetObserver(nullptr);
  EXPECT_TRUE(Create(registry, "quiet").ok());
}

TEST_F(RegistryTest, AnOldRevisionOfADeletedNamesakeIsNotFound) {
  SceneRegistry registry({}, pool_);
  const auto old_first = Create(registry, "hall", 10);
  ASSERT_TRUE(registry.Delete("hall").ok());
  ASSERT_TRUE(Create(registry, "hall", 20).ok());
  ASSERT_TRUE(Add(registry, "hall", 0, "a").ok());
  EXPECT_EQ(registry.Get("hall", 1).status().code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_EQ((*old_first)->geometry.triangles.size(), 10u);
}

// Threads create, edit, read and delete the same few scenes; every scene seen is whole, every error
// one of those documented, and the books are even at the end.
TEST_F(RegistryTest, ManyThreads) {
  SceneRegistry registry({}, pool_);
  std::atomic<int> seen{0};
  registry.SetObserver([&](const SceneStatus&) { seen.fetch_add(1); });
  const auto work = [&](int thread) {
    for (int i = 0; i < 40; ++i) {
      const std::string name = "scene-" + std::to_string((thread + i) % 3);
      absl::Status status;
      switch ((7 * i + thread) % 5) {
        case 0:
          status = Create(registry, name).status();
          break;
        case 1:
          status = Add(registry, name, 0, std::to_string(100 * thread + i)).status();
          break;
        case 4:
          status = i % 3 == 0 ? registry.Delete(name).status() : absl::OkStatus();
          break;
        default: {
          const auto scene = registry.Get(name, 0);
          status = scene.status();
          if (scene.ok()) {
            EXPECT_EQ((*scene)->name, name);
            EXPECT_TRUE(ValidateBvh((*scene)->bvh, (*scene)->geometry).ok());
          }
        }
      }
      EXPECT_THAT(status.code(),
                  ::testing::AnyOf(absl::StatusCode::kOk, absl::StatusCode::kNotFound,
                                   absl::StatusCode::kAlreadyExists, absl::StatusCode::kAborted,
                                   absl::StatusCode::kUnavailable));
    }
  };
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t) threads.emplace_back(work, t);
  for (std::thread& thread : threads) thread.join();
  EXPECT_GT(seen.load(), 0);
  for (const SceneStatus& status : registry.List()) {
    EXPECT_EQ(status.state, SceneState::kReady);
    EXPECT_TRUE(registry.Delete(status.name).ok());
  }
  EXPECT_EQ(registry.MemoryBytes(), 0u);
}

// ---- What is kept elsewhere

class KeptRegistryTest : public RegistryTest {
 protected:
  static constexpr uint32_t kTriangles = 1000;

  std::shared_ptr<const Scene> MakeScene(uint64_t revision) {
    const std::vector<ObjectInput> objects = {Strip("strip", kTriangles)};
    return *BuildScene("kept", revision, objects, std::nullopt, {}, pool_);
  }
  absl::StatusOr<std::shared_ptr<const Scene>> Load(SceneRegistry& registry,
                                                    const std::string& name) {
    return registry.Load(name, bytes_, [&](uint64_t revision, const auto&) {
      return absl::StatusOr<std::shared_ptr<const Scene>>(MakeScene(revision == 0 ? 5 : revision));
    });
  }
  const uint64_t bytes_ = MakeScene(1)->report.memory_bytes;
};

TEST_F(KeptRegistryTest, LoadsAndReloads) {
  SceneRegistry registry({}, pool_);
  ASSERT_TRUE(Load(registry, "hall").ok());
  EXPECT_EQ((*registry.Get("hall", 0))->revision, 5u);
  EXPECT_TRUE(registry.GetStatus("hall")->kept);
  ExpectError(Load(registry, "hall").status(), absl::StatusCode::kAlreadyExists, {"\"hall\""});
  const auto reload = [&](auto loader) { return registry.Reload("hall", bytes_, loader); };
  ASSERT_TRUE(reload([&](uint64_t revision, const auto&) {
                return absl::StatusOr<std::shared_ptr<const Scene>>(MakeScene(revision));
              }).ok());
  EXPECT_EQ((*registry.Get("hall", 0))->revision, 6u);
  // A failed reload keeps the old one serving, and says why.
  ExpectError(reload([](uint64_t, const auto&) {
                return absl::StatusOr<std::shared_ptr<const Scene>>(absl::DataLossError("broken"));
              }).status(),
              absl::StatusCode::kDataLoss, {"broken"});
  EXPECT_EQ((*registry.Get("hall", 0))->revision, 6u);
  const SceneStatus status = *registry.GetStatus("hall");
  EXPECT_EQ(status.state, SceneState::kReady);
  EXPECT_THAT(std::string(status.error.message()), HasSubstr("broken"));
  EXPECT_EQ(registry.MemoryBytes(), bytes_);
  ExpectError(registry
                  .Reload("attic", 1,
                          [&](uint64_t, const auto&) {
                            return absl::StatusOr<std::shared_ptr<const Scene>>(MakeScene(1));
                          })
                  .status(),
              absl::StatusCode::kNotFound, {"\"attic\""});
}

// Whoever is called by a build may run out of memory: its scene is not busy for ever, and nothing
// stays reserved.
TEST_F(KeptRegistryTest, MemoryThatRunsOutInABuildEndsIt) {
  SceneRegistry registry({}, pool_);
  using Made = absl::StatusOr<std::shared_ptr<const Scene>>;
  const auto throws = [](uint64_t, const auto&) -> Made { throw std::bad_alloc(); };
  ExpectError(registry.Load("hall", bytes_, throws).status(), absl::StatusCode::kResourceExhausted,
              {"out of memory", "\"hall\""});
  EXPECT_TRUE(registry.List().empty());
  EXPECT_EQ(registry.MemoryBytes(), 0u);

  ASSERT_TRUE(Load(registry, "hall").ok());
  ExpectError(registry.Reload("hall", bytes_, throws).status(),
              absl::StatusCode::kResourceExhausted, {"out of memory", "\"hall\""});
  EXPECT_EQ(registry.MemoryBytes(), bytes_);
  SceneStatus status = *registry.GetStatus("hall");
  EXPECT_EQ(status.state, SceneState::kReady);
  EXPECT_EQ(status.error.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(status.latest->revision, 5u);

  const std::vector<SceneEdit> edits = {{Kind::kAdd, Strip("more", 5)}};
  const auto edited = registry.Edit("hall", 0, edits, {}, nullptr,
                                    [](const Scene&) -> absl::Status { throw std::bad_alloc(); });
  ASSERT_TRUE(edited.ok()) << edited.status();
  status = *registry.GetStatus("hall");
  EXPECT_EQ(status.state, SceneState::kReady);
  EXPECT_FALSE(status.kept);
  ExpectError(status.keep_error, absl::StatusCode::kResourceExhausted, {"out of memory"});
  EXPECT_EQ(registry.MemoryBytes(), (*edited)->report.memory_bytes);
  EXPECT_TRUE(registry.Delete("hall").ok());
}

TEST_F(KeptRegistryTest, AnObserverThatRunsOutOfMemoryHoldsNoBuildUp) {
  SceneRegistry registry({}, pool_);
  registry.SetObserver([](const SceneStatus&) { throw std::bad_alloc(); });
  const auto keeper = [](const Scene&) { return absl::OkStatus(); };
  const std::vector<ObjectInput> objects = {Strip("strip", 10)};
  const auto made = registry.Create("hall", objects, std::nullopt, {}, nullptr, keeper);
  ASSERT_TRUE(made.ok()) << made.status();
  EXPECT_TRUE(registry.GetStatus("hall")->kept);
  ASSERT_TRUE(Add(registry, "hall", 1, "a").ok());
  EXPECT_EQ(registry.Edit("hall", 0, std::vector<SceneEdit>{{Kind::kRemove, {.name = "sofa"}}}, {})
                .status()
                .code(),
            absl::StatusCode::kNotFound);
  EXPECT_EQ(registry.GetStatus("hall")->state, SceneState::kReady);
  EXPECT_TRUE(registry.Delete("hall").ok());
}

TEST_F(KeptRegistryTest, WhatIsNotKeptIsDeletedOnlyByWhoMeansIt) {
  SceneRegistry registry({}, pool_);
  ASSERT_TRUE(Create(registry, "memory").ok());
  ExpectError(registry.Delete("memory", /*if_kept=*/true).status(),
              absl::StatusCode::kFailedPrecondition, {"\"memory\""});
  EXPECT_TRUE(registry.Get("memory", 0).ok());
  EXPECT_TRUE(registry.Delete("memory").ok());
  ASSERT_TRUE(Load(registry, "kept").ok());
  EXPECT_TRUE(registry.Delete("kept", /*if_kept=*/true).ok());
}

TEST_F(KeptRegistryTest, WhatIsSetAsideCountsAndMakesRoom) {
  SceneRegistry strict({.memory_budget_bytes = 2 * bytes_}, pool_);
  ASSERT_TRUE(Load(strict, "a").ok());
  ASSERT_TRUE(strict.SetAside(bytes_).ok());
  EXPECT_EQ(strict.MemoryBytes(), 2 * bytes_);
  ExpectError(strict.SetAside(1), absl::StatusCode::kResourceExhausted,
              {std::to_string(2 * bytes_), "delete a scene"});
  ExpectError(Load(strict, "b").status(), absl::StatusCode::kResourceExhausted, {"\"b\""});
  strict.GiveBack(bytes_);
  EXPECT_TRUE(Load(strict, "b").ok());

  SceneRegistry yielding({.memory_budget_bytes = 2 * bytes_, .evict_least_used = true}, pool_);
  ASSERT_TRUE(Load(yielding, "a").ok());
  ASSERT_TRUE(Load(yielding, "b").ok());
  ASSERT_TRUE(yielding.SetAside(bytes_).ok());
  EXPECT_EQ(yielding.List().size(), 1u);
  EXPECT_EQ(yielding.GetStatus("a").status().code(), absl::StatusCode::kNotFound);
  ExpectError(yielding.SetAside(2 * bytes_), absl::StatusCode::kResourceExhausted, {});
  EXPECT_EQ(yielding.List().size(), 1u);  // Nothing goes in vain.
  yielding.GiveBack(bytes_);
}

TEST_F(KeptRegistryTest, WhatWasSetAsideForASceneBecomesItsOwn) {
  SceneRegistry registry({.memory_budget_bytes = bytes_}, pool_);
  uint64_t while_loading = 0;
  const auto loader = [&](uint64_t revision, const auto&) {
    while_loading = registry.MemoryBytes();
    return absl::StatusOr<std::shared_ptr<const Scene>>(MakeScene(revision));
  };
  // There is no room for both.
  ASSERT_TRUE(registry.SetAside(bytes_).ok());
  ASSERT_TRUE(registry.Load("a", bytes_, loader, nullptr, /*tag=*/0, bytes_).ok());
  EXPECT_EQ(while_loading, bytes_);
  EXPECT_EQ(registry.MemoryBytes(), bytes_);
  ASSERT_TRUE(registry.Delete("a").ok());
  // A scene that cannot be begun leaves nothing of it behind.
  ASSERT_TRUE(registry.SetAside(bytes_).ok());
  EXPECT_FALSE(registry.Load("b", bytes_ + 1, loader, nullptr, /*tag=*/0, bytes_).ok());
  EXPECT_EQ(registry.MemoryBytes(), 0u);
  ASSERT_TRUE(registry.SetAside(bytes_).ok());
  EXPECT_FALSE(registry.Reload("none", bytes_, loader, bytes_).ok());
  EXPECT_EQ(registry.MemoryBytes(), 0u);
}

TEST_F(KeptRegistryTest, ATagTellsScenesOfOneNameApart) {
  SceneRegistry registry({.max_scenes = 1, .evict_least_used = true}, pool_);
  std::vector<uint64_t> evicted;
  registry.SetObserver([&](const SceneStatus& status) {
    if (status.state == SceneState::kEvicted) evicted.push_back(status.tag);
  });
  const auto load = [&](const std::string& name, uint64_t tag) {
    return registry
        .Load(
            name, bytes_,
            [&](uint64_t, const auto&) {
              return absl::StatusOr<std::shared_ptr<const Scene>>(MakeScene(1));
            },
            nullptr, tag)
        .status();
  };
  ASSERT_TRUE(load("a", 7).ok());
  EXPECT_EQ(registry.GetStatus("a")->tag, 7u);
  ASSERT_TRUE(load("b", 8).ok());
  const uint64_t creation = registry.GetStatus("b")->creation;
  ASSERT_TRUE(load("a", 6).ok());
  EXPECT_EQ(registry.GetStatus("a")->tag, 6u);
  // Makers may give their tags in any order.
  EXPECT_GT(registry.GetStatus("a")->creation, creation);
  EXPECT_THAT(evicted, ::testing::ElementsAre(7, 8));
  const absl::StatusOr<SceneStatus> deleted = registry.Delete("a");
  ASSERT_TRUE(deleted.ok());
  EXPECT_EQ(deleted->tag, 6u);
}

TEST_F(KeptRegistryTest, AKeeperIsAskedOncePublishedAndHoldsOffOtherBuilds) {
  SceneRegistry registry({}, pool_);
  int kept = 0;
  const SceneKeeper keeper = [&](const Scene& scene) {
    ++kept;
    EXPECT_EQ((*registry.Get("hall", 0))->revision, scene.revision);
    EXPECT_EQ(registry.GetStatus("hall")->state, SceneState::kBuilding);
    EXPECT_FALSE(registry.GetStatus("hall")->kept);
    ExpectError(Add(registry, "hall", 0, "other").status(), absl::StatusCode::kAborted, {});
    return scene.revision == 2 ? absl::ResourceExhaustedError("disk full") : absl::OkStatus();
  };
  const std::vector<ObjectInput> objects = {Strip("strip", 10)};
  ASSERT_TRUE(registry.Create("hall", objects, std::nullopt, {}, nullptr, keeper).ok());
  EXPECT_TRUE(registry.GetStatus("hall")->kept);
  for (uint64_t revision = 2; revision <= 3; ++revision) {
    const std::vector<SceneEdit> edits = {{Kind::kAdd, Strip(std::to_string(revision), 3)}};
    ASSERT_TRUE(registry.Edit("hall", 0, edits, {}, nullptr, keeper).ok());
    const SceneStatus status = *registry.GetStatus("hall");
    EXPECT_EQ(status.latest->revision, revision);
    EXPECT_EQ(status.state, SceneState::kReady);
    EXPECT_EQ(status.kept, revision == 3);
    EXPECT_EQ(status.keep_error.ok(), revision == 3);
  }
  EXPECT_EQ(kept, 3);
  // An edit that nobody keeps is not kept.
  ASSERT_TRUE(Add(registry, "hall", 0, "last").ok());
  EXPECT_FALSE(registry.GetStatus("hall")->kept);
}

TEST_F(KeptRegistryTest, OneSceneMayTakeOnlySoMuch) {
  SceneRegistry registry({.max_bytes_per_scene = bytes_ - 1}, pool_);
  ExpectError(Load(registry, "hall").status(), absl::StatusCode::kResourceExhausted,
              {std::to_string(bytes_), std::to_string(bytes_ - 1)});
  EXPECT_TRUE(registry.List().empty());
  EXPECT_EQ(registry.MemoryBytes(), 0u);
}

TEST_F(KeptRegistryTest, NothingIsEvictedUnlessAskedFor) {
  SceneRegistry registry({.memory_budget_bytes = 2 * bytes_}, pool_);
  ASSERT_TRUE(Load(registry, "a").ok() && Load(registry, "b").ok());
  ExpectError(Load(registry, "c").status(), absl::StatusCode::kResourceExhausted, {"\"c\""});
  EXPECT_EQ(registry.List().size(), 2u);
}

TEST_F(KeptRegistryTest, TheLeastRecentlyUsedMakesRoom) {
  SceneRegistry registry({.memory_budget_bytes = 3 * bytes_, .evict_least_used = true}, pool_);
  std::vector<std::string> evicted;
  registry.SetObserver([&](const SceneStatus& status) {
    if (status.state == SceneState::kEvicted) evicted.push_back(status.name);
  });
  for (const char* name : {"a", "b", "c"}) ASSERT_TRUE(Load(registry, name).ok());
  ASSERT_TRUE(registry.Get("a", 0).ok());
  ASSERT_TRUE(Load(registry, "d").ok());
  EXPECT_THAT(evicted, ElementsAre("b"));
  // One that is held would not be freed: "c" stays, though "a" was used after it.
  const auto held = *registry.Get("c", 0);
  ASSERT_TRUE(registry.Get("d", 0).ok());
  ASSERT_TRUE(Load(registry, "e").ok());
  EXPECT_THAT(evicted, ElementsAre("b", "a"));
  EXPECT_LE(registry.MemoryBytes(), 3 * bytes_);
}

TEST_F(KeptRegistryTest, RoomIsMadeByNumberToo) {
  SceneRegistry registry({.max_scenes = 2, .evict_least_used = true}, pool_);
  std::vector<std::string> evicted;
  registry.SetObserver([&](const SceneStatus& status) {
    if (status.state == SceneState::kEvicted) evicted.push_back(status.name);
  });
  for (const char* name : {"a", "b", "c"}) ASSERT_TRUE(Load(registry, name).ok());
  EXPECT_THAT(evicted, ElementsAre("a"));
  // A next revision takes no place of its own.
  ASSERT_TRUE(Add(registry, "c", 0, "more").ok());
  EXPECT_EQ(evicted.size(), 1u);
  // Now "c" is not kept, and "b" is held.
  const auto held = *registry.Get("b", 0);
  ExpectError(Load(registry, "d").status(), absl::StatusCode::kResourceExhausted,
              {"max_scenes is 2"});
  EXPECT_EQ(registry.List().size(), 2u);
}

TEST_F(KeptRegistryTest, WhatIsNotKeptIsNeverEvictedNorAnythingInVain) {
  SceneRegistry registry({.memory_budget_bytes = 3 * bytes_, .evict_least_used = true}, pool_);
  ASSERT_TRUE(Load(registry, "kept").ok());
  ASSERT_TRUE(Create(registry, "mine").ok());
  const size_t before = registry.List().size();
  ExpectError(registry
                  .Load("huge", 4 * bytes_,
                        [&](uint64_t, const auto&) {
                          return absl::StatusOr<std::shared_ptr<const Scene>>(MakeScene(1));
                        })
                  .status(),
              absl::StatusCode::kResourceExhausted, {"\"huge\""});
  EXPECT_EQ(registry.List().size(), before);
}

}  // namespace
}  // namespace sightline

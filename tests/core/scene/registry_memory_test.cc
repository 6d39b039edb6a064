// SPDX-License-Identifier: Apache-2.0
//
// Wherever memory runs out, the registry's books stay right: a scene is there and counted, or it is
// gone, told of and freed; and nothing is being built for ever.
#include <cstdint>
#include <memory>
#include <new>
#include <optional>
#include <string>
#include <vector>

#include "core/scene/registry.h"
#include "gtest/gtest.h"
#include "tests/support/failing_new.h"

namespace sightline {
namespace {

using testing_support::FailingNew;
using Made = absl::StatusOr<std::shared_ptr<const Scene>>;

// Longer than what a string holds within itself: every copy is an allocation.
std::string Name(int i) { return "a scene with a name that is no short one, " + std::to_string(i); }

class RegistryMemoryTest : public ::testing::Test {
 protected:
  RegistryMemoryTest() {
    const std::vector<ObjectInput> objects = {
        {.name = "o", .vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, .indices = {0, 1, 2}}};
    for (uint64_t revision : {1, 2}) {
      scenes_.push_back(*BuildScene("s", revision, objects, std::nullopt, {}, pool_));
    }
    bytes_ = scenes_[0]->report.memory_bytes;
  }
  // A scene of its own, so that nobody else holds it.
  Made Load(SceneRegistry& registry, const std::string& name, uint64_t declared) {
    auto scene = std::make_shared<const Scene>(*scenes_[0]);
    return registry.Load(name, declared, [&](uint64_t, const std::function<void(double)>& told) {
      told(0.5);
      return Made(std::move(scene));
    });
  }

  // What holds of a registry in which nothing is under way.
  void ExpectSound(const SceneRegistry& registry, size_t scenes) {
    uint64_t bytes = 0;
    for (const SceneStatus& status : registry.List()) {
      EXPECT_EQ(status.state, SceneState::kReady) << status.name;
      ASSERT_NE(status.latest, nullptr) << status.name;
      bytes += status.latest->report.memory_bytes;
    }
    EXPECT_EQ(registry.List().size(), scenes);
    EXPECT_EQ(registry.MemoryBytes(), bytes);
  }

  // Runs `act` on a registry with three scenes that are kept, with memory that runs out at the
  // first allocation, the second and so on, until it takes no more.
  template <typename Act>
  void RunOut(const RegistryOptions& options, const Act& act) {
    constexpr int kFar = 1000;
    for (int before = 0; before < kFar; ++before) {
      SCOPED_TRACE(before);
      SceneRegistry registry(options, pool_);
      for (int i = 0; i < 3; ++i) ASSERT_TRUE(Load(registry, Name(i), bytes_).ok());
      int evicted = 0;
      registry.SetObserver([&](const SceneStatus& status) {
        evicted += status.state == SceneState::kEvicted;
      });
      bool ok = false, met = false;
      {
        std::optional<FailingNew> fault(before);
        try {
          ok = act(registry);
        } catch (const std::bad_alloc&) {
        }
        met = fault->met();
        fault.reset();
      }
      const size_t scenes = registry.List().size();
      EXPECT_EQ(scenes, 3u - static_cast<size_t>(evicted) + (registry.GetStatus(Name(9)).ok()));
      EXPECT_TRUE(ok || met);
      ExpectSound(registry, scenes);
      // And it goes on.
      EXPECT_TRUE(Load(registry, Name(7), bytes_).ok());
      if (!met) return;
    }
    FAIL() << "it takes more than " << kFar << " allocations";
  }

  ThreadPool pool_{1};
  std::vector<std::shared_ptr<const Scene>> scenes_;
  uint64_t bytes_ = 0;
};

TEST_F(RegistryMemoryTest, WhereRoomIsMadeForANewScene) {
  const RegistryOptions options = {
      .memory_budget_bytes = 3 * bytes_ + bytes_ / 2, .max_scenes = 4, .evict_least_used = true};
  RunOut(options, [&](SceneRegistry& registry) {
    return Load(registry, Name(9), 2 * bytes_).ok();  // In the place of two.
  });
}

TEST_F(RegistryMemoryTest, WhereRoomIsMadeForANextRevision) {
  const RegistryOptions options = {.memory_budget_bytes = 3 * bytes_ + bytes_ / 2,
                                   .evict_least_used = true};
  RunOut(options, [&](SceneRegistry& registry) {
    return registry.Reload(Name(0), bytes_, [&](uint64_t, const auto&) { return Made(scenes_[1]); })
        .ok();
  });
}

TEST_F(RegistryMemoryTest, WhereRoomIsSetAside) {
  const RegistryOptions options = {.memory_budget_bytes = 3 * bytes_ + bytes_ / 2,
                                   .evict_least_used = true};
  RunOut(options, [&](SceneRegistry& registry) {
    if (!registry.SetAside(2 * bytes_).ok()) return false;
    registry.GiveBack(2 * bytes_);
    return true;
  });
}

TEST_F(RegistryMemoryTest, WhereASceneNeedsMoreThanWasForeseen) {
  const RegistryOptions options = {.memory_budget_bytes = 3 * bytes_ + bytes_ / 2,
                                   .evict_least_used = true};
  RunOut(options,
         [&](SceneRegistry& registry) { return !Load(registry, Name(9), bytes_ / 4).ok(); });
}

}  // namespace
}  // namespace sightline

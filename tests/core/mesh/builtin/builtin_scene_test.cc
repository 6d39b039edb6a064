// SPDX-License-Identifier: Apache-2.0
//
// What every built-in scene promises: the same bits everywhere, the size that was asked for, sound
// indices, closed solids.
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "core/base/mix_bits.h"
#include "core/mesh/builtin/builtin.h"
#include "core/mesh/builtin/prng.h"
#include "gtest/gtest.h"
#include "tests/core/mesh/builtin/mesh_facts.h"

namespace sightline {
namespace {

BuiltinScene Make(const BuiltinSpec& spec) {
  absl::StatusOr<BuiltinScene> scene = MakeBuiltin(spec);
  EXPECT_TRUE(scene.ok()) << spec.name << ": " << scene.status();
  return scene.ok() ? *std::move(scene) : BuiltinScene{};
}

uint64_t CountTriangles(const BuiltinScene& scene) {
  uint64_t count = 0;
  for (const ObjectInput& object : scene.objects) count += object.indices.size() / 3;
  return count;
}

// Over every name, coordinate, index, view and light, in order.
uint64_t HashScene(const BuiltinScene& scene) {
  uint64_t hash = 0;
  const auto add = [&](uint64_t x) { hash = MixBits(hash + kGoldenStep + x); };
  const auto add_point = [&](Vec3d p) {
    for (int axis = 0; axis < 3; ++axis) add(std::bit_cast<uint64_t>(p[axis]));
  };
  for (const ObjectInput& object : scene.objects) {
    add(HashString(object.name));
    add(object.vertices.size());
    for (const Vec3d& p : object.vertices) add_point(p);
    add(object.indices.size());
    for (uint32_t index : object.indices) add(index);
  }
  for (const BuiltinView& view : scene.views) {
    for (Vec3d p : {view.eye, view.at, view.up, view.area.center, view.area.u, view.area.v})
      add_point(p);
    add(std::bit_cast<uint64_t>(view.fov_y_degrees));
    for (const Vec3d& p : view.lights) add_point(p);
    for (const Vec3d& p : view.suns) add_point(p);
  }
  for (const Vec3d& p : scene.many_lights) add_point(p);
  return hash;
}

struct Golden {
  std::string_view name;
  uint64_t target, seed, hash;
};

// Whoever changes a scene on purpose writes the new values here: they are printed. A change without
// such a purpose, or on another machine or compiler, is a bug.
constexpr Golden kGolden[] = {
#include "tests/core/mesh/builtin/golden.inc"
};

TEST(BuiltinScene, HasTheSameBitsEverywhere) {
  for (const Golden& golden : kGolden) {
    const uint64_t hash = HashScene(Make({std::string(golden.name), golden.target, golden.seed}));
    EXPECT_EQ(hash, golden.hash) << "{\"" << golden.name << "\", " << golden.target << ", "
                                 << golden.seed << ", 0x" << std::hex << hash << "},";
  }
}

TEST(BuiltinScene, GoldenTableCoversEveryScene) {
  for (const BuiltinInfo& info : BuiltinScenes()) {
    int rows = 0;
    for (const Golden& golden : kGolden) rows += golden.name == info.name ? 1 : 0;
    EXPECT_GE(rows, 2) << info.name;
  }
}

TEST(BuiltinScene, ComesTwiceTheSameAndDiffersBySeed) {
  const BuiltinScene scene = Make({"room", 0, 1});
  EXPECT_EQ(HashScene(scene), HashScene(Make({"room", 0, 1})));
  EXPECT_NE(HashScene(scene), HashScene(Make({"room", 0, 2})));
}

TEST(BuiltinScene, IsGivenUpOnceNobodyWantsIt) {
  CancelToken cancel;
  EXPECT_EQ(HashScene(*MakeBuiltin({"room", 0, 1}, &cancel)), HashScene(Make({"room", 0, 1})));
  cancel.Cancel();
  for (const BuiltinInfo& info : BuiltinScenes()) {
    EXPECT_EQ(MakeBuiltin({.name = std::string(info.name)}, &cancel).status().code(),
              absl::StatusCode::kCancelled);
  }
}

// Within a tenth, from the least to the most (the most of one scene: ten million take a second or
// two).
TEST(BuiltinScene, HasTheSizeAskedFor) {
  const auto expect = [](std::string_view name, uint64_t target, uint64_t seed) {
    const uint64_t count = CountTriangles(Make({std::string(name), target, seed}));
    const double ratio = static_cast<double>(count) / static_cast<double>(target);
    EXPECT_GT(ratio, 0.9) << name << " of " << target << ", seed " << seed;
    EXPECT_LT(ratio, 1.1) << name << " of " << target << ", seed " << seed;
  };
  for (const BuiltinInfo& info : BuiltinScenes()) {
    for (uint64_t seed : {1, 2}) {
      expect(info.name, info.min_triangles, seed);
      expect(info.name, info.min_triangles * 7 / 5, seed);
    }
    expect(info.name, info.default_triangles, 1);
    expect(info.name, 2'345'678, 1);
  }
  expect("forest", kMaxBuiltinTriangles, 1);
}

// Open by nature: grounds, leaves, and the walls of the box.
bool IsSheet(std::string_view scene, std::string_view name) {
  const std::string_view kind = name.substr(0, name.find_last_not_of("0123456789") + 1);
  if (scene == "box" && (kind == "floor" || kind == "ceiling" || kind.substr(0, 5) == "wall-"))
    return true;
  // Kinds with an index keep the hyphen before it.
  for (std::string_view sheet : {"terrain", "ground", "backdrop", "leaves-", "needles-", "grass-",
                                 "fern-", "plant-", "desk-plant-", "street-trees-", "grove-"}) {
    if (kind == sheet) return true;
  }
  return false;
}

TEST(BuiltinScene, IsSound) {
  for (const BuiltinInfo& info : BuiltinScenes()) {
    for (uint64_t target : {info.min_triangles, info.default_triangles}) {
      SCOPED_TRACE(std::string(info.name) + " of " + std::to_string(target));
      const BuiltinScene scene = Make({std::string(info.name), target, 1});
      ASSERT_FALSE(scene.objects.empty());
      EXPECT_LE(scene.objects.size(), 2000u);
      const Vec3d origin = scene.objects[0].vertices[0];
      std::set<std::string_view> names;
      size_t closed = 0, zero_area = 0;
      for (const ObjectInput& object : scene.objects) {
        SCOPED_TRACE(object.name);
        EXPECT_TRUE(names.insert(object.name).second) << "twice";
        EXPECT_TRUE(object.transform.IsIdentity());
        ASSERT_FALSE(object.indices.empty());
        ASSERT_EQ(object.indices.size() % 3, 0u);
        std::vector<bool> used(object.vertices.size());
        for (uint32_t index : object.indices) {
          ASSERT_LT(index, object.vertices.size());
          used[index] = true;
        }
        EXPECT_EQ(std::count(used.begin(), used.end(), false), 0) << "unused vertices";
        for (const Vec3d& p : object.vertices) ASSERT_TRUE(IsFinite(p));
        zero_area += CountZeroArea(object, origin);
        if (IsSheet(info.name, object.name)) continue;
        ++closed;
        ASSERT_TRUE(IsClosed(object));
        EXPECT_GT(SignedVolume(object), 0) << "inside out";
      }
      EXPECT_EQ(zero_area, 0u);
      EXPECT_EQ(closed == 0, info.name == "terrain");
    }
  }
}

TEST(BuiltinScene, SphereIsOneClosedSurfaceAtEverySize) {
  for (uint64_t target : {1'500, 3'000, 50'000, 1'000'000}) {
    const BuiltinScene scene = Make({"sphere", target, 5});
    ASSERT_EQ(scene.objects.size(), 1u);
    const ObjectInput& sphere = scene.objects[0];
    EXPECT_TRUE(IsClosed(sphere)) << target;
    // Euler: V - E + F = 2, with 3F = 2E.
    EXPECT_EQ(sphere.vertices.size(), sphere.indices.size() / 6 + 2) << target;
    for (const Vec3d& p : sphere.vertices) {
      ASSERT_GT(Length(p), 0.6);
      ASSERT_LT(Length(p), 1.4);
    }
  }
}

TEST(BuiltinScene, CityStandsAtItsMapCoordinates) {
  for (const ObjectInput& object : Make({"city", 0, 1}).objects) {
    for (const Vec3d& p : object.vertices) {
      ASSERT_LT(std::abs(p.x - 500'000), 1000);
      ASSERT_LT(std::abs(p.y - 4'400'000), 1000);
    }
  }
}

TEST(BuiltinScene, OfficeHasSixteenLights) {
  const BuiltinScene scene = Make({"office", 0, 1});
  EXPECT_EQ(scene.many_lights.size(), 16u);
  for (const Vec3d& light : scene.many_lights) {
    EXPECT_LT(std::abs(light.x), 10);
    EXPECT_LT(std::abs(light.y), 7);
    EXPECT_GT(light.z, 2.5);
    EXPECT_LT(light.z, 3);
  }
  EXPECT_TRUE(Make({"room", 0, 1}).many_lights.empty());
}

// The box's walls meet in bit-equal vertices, so no segment slips out between them.
TEST(BuiltinScene, BoxWallsShareTheirEdges) {
  const BuiltinScene scene = Make({"box", 0, 1});
  std::set<std::array<double, 3>> floor;
  size_t shared = 0, edge = 0;
  for (const ObjectInput& object : scene.objects) {
    if (object.name == "floor") {
      for (const Vec3d& p : object.vertices) floor.insert({p.x, p.y, p.z});
    }
    if (object.name != "wall-left") continue;
    for (const Vec3d& p : object.vertices) {
      if (p.z != 0) continue;
      ++edge;
      shared += floor.count({p.x, p.y, p.z});
    }
  }
  EXPECT_GT(edge, 1u);
  EXPECT_EQ(shared, edge);
}

}  // namespace
}  // namespace sightline

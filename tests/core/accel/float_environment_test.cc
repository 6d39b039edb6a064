// SPDX-License-Identifier: Apache-2.0
//
// Whatever floating-point environment a host runs its threads in, builds, fits and checks are what
// they are in the engine's own.
#include "core/base/float_environment.h"

#include <array>
#include <cstring>
#include <functional>
#include <utility>

#include "core/accel/binary_bvh_builder.h"
#include "core/accel/binary_bvh_validation.h"
#include "core/accel/bvh_builder.h"
#include "core/accel/bvh_refit.h"
#include "core/accel/bvh_validation.h"
#include "core/accel/kd_builder.h"
#include "core/accel/kd_validation.h"
#include "core/accel/leaf_mates_validation.h"
#include "gtest/gtest.h"
#include "tests/core/accel/same_bytes.h"
#include "tests/core/accel/test_meshes.h"

namespace sightline {
namespace {

using testing_support::SameBytes;
using testing_support::ScatteredTriangles;
using testing_support::TestRng;

constexpr unsigned kEngine = ScopedFloatEnvironment::kEngineMxcsr;
constexpr unsigned kRoundDown = 0x2000, kRoundUp = 0x4000, kFtz = 0x8000, kDaz = 0x0040;
constexpr unsigned kForeign[] = {kEngine | kRoundUp, kEngine | kRoundDown, kEngine | kFtz | kDaz,
                                 kEngine | kFtz | kDaz | kRoundUp};

// fn() in that environment. Behind std::function, so that it is not inlined.
template <class T>
T In(unsigned environment, const std::function<T()>& fn) {
  const unsigned saved = _mm_getcsr();
  _mm_setcsr(environment);
  T result = fn();
  _mm_setcsr(saved);
  return result;
}

bool SameTrees(const BinaryBvh& a, const BinaryBvh& b) {
  return a.nodes.size() == b.nodes.size() && a.ids == b.ids && a.leaf_count == b.leaf_count &&
         a.max_depth == b.max_depth &&
         (a.empty() ||
          std::memcmp(a.nodes.data(), b.nodes.data(), a.nodes.size() * sizeof(BinaryBvhNode)) == 0);
}

class AccelFloatEnvironmentTest : public ::testing::Test {
 protected:
  template <class T>
  static T Must(absl::StatusOr<T> made) {
    EXPECT_TRUE(made.ok()) << made.status();
    return *std::move(made);
  }
  BinaryBvh Binary(const BinaryBvhOptions& options = {}) {
    return Must(BuildBinaryBvh(geometry_, options, pool_));
  }
  Bvh Wide() { return Must(BuildBvh(geometry_, {}, pool_)); }
  KdTree Kd(bool perfect) {
    return Must(BuildKdTree(geometry_, {.perfect_splits = perfect}, pool_));
  }

  TestRng rng_;
  ThreadPool pool_{1};
  SceneGeometry geometry_ = ScatteredTriangles(rng_, 700, 0.1);
};

TEST_F(AccelFloatEnvironmentTest, Builds) {
  const BinaryBvh binary = Binary();
  const Bvh wide = Wide();
  for (const unsigned foreign : kForeign) {
    EXPECT_TRUE(SameTrees(In<BinaryBvh>(foreign, [&] { return Binary(); }), binary)) << foreign;
    EXPECT_TRUE(SameBytes(In<Bvh>(foreign, [&] { return Wide(); }), wide)) << foreign;
    for (const bool perfect : {false, true}) {
      const KdTree kd = In<KdTree>(foreign, [&] { return Kd(perfect); });
      EXPECT_EQ(kd.ids, Kd(perfect).ids) << foreign;
      EXPECT_EQ(kd.nodes, Kd(perfect).nodes) << foreign;
    }
  }
}

// Two triangles, as far from each other as the scene is long: whether that is more than the share
// of the scene's length below which nothing is split depends on how the length was rounded.
TEST_F(AccelFloatEnvironmentTest, LengthsOfBinaryBvhs) {
  constexpr float kAlmostAll = 0x1.fffffep-1f;
  constexpr float kFrom = -0x1p-26f;  // Of an eighth of the last place of what it is taken from.
  for (const float to : {1.1f, 1.2f, 1.3f}) {
    geometry_ = {};
    for (const float x : {kFrom, to}) {
      const auto first = static_cast<uint32_t>(geometry_.vertices.size());
      for (const Vec3f corner : {Vec3f{x, 0, 0}, Vec3f{x, 0.5f, 0}, Vec3f{x, 0, 0.5f}}) {
        geometry_.vertices.push_back(corner);
        geometry_.bounds.Extend(corner);
      }
      geometry_.triangles.push_back({first, first + 1, first + 2});
    }
    const BinaryBvhOptions options = {.stop_by_cost = false, .min_extent = kAlmostAll};
    const BinaryBvh bvh = Binary(options);
    for (const unsigned foreign : kForeign) {
      EXPECT_TRUE(SameTrees(In<BinaryBvh>(foreign, [&] { return Binary(options); }), bvh))
          << foreign << " " << to;
    }
  }
}

TEST_F(AccelFloatEnvironmentTest, Refits) {
  const Bvh bvh = Wide();
  for (Vec3f& vertex : geometry_.vertices) vertex = {vertex.x, 1.7f * vertex.y, 0.9f * vertex.z};
  const auto refit = [&] { return Must(RefitBvh(bvh, geometry_, pool_)); };
  const auto in_place = [&] {
    Bvh fitted = bvh;
    EXPECT_TRUE(RefitBvhInPlace(geometry_, pool_, &fitted).ok());
    return fitted;
  };
  const Bvh fitted = refit();
  for (const unsigned foreign : kForeign) {
    for (const std::function<Bvh()>& fit : {std::function<Bvh()>(refit), {in_place}}) {
      const Bvh other = In<Bvh>(foreign, fit);
      EXPECT_TRUE(SameBytes(other, fitted)) << foreign;
      EXPECT_EQ(other.cost_growth, fitted.cost_growth) << foreign;
    }
  }
}

// Faults by a denormal are faults, and no others are found.
TEST_F(AccelFloatEnvironmentTest, Checks) {
  constexpr float kDenormal = 0x1p-140f;
  for (Vec3f& vertex : geometry_.vertices) vertex.x = vertex.x < 0.5f ? 0 : vertex.x;
  geometry_.bounds.lo.x = 0;
  const auto same_everywhere = [](const std::function<absl::Status()>& check, bool ok) {
    EXPECT_EQ(check().ok(), ok) << check();
    for (const unsigned foreign : kForeign) {
      EXPECT_EQ(In<absl::Status>(foreign, check), check()) << foreign;
    }
  };
  for (const bool spoil : {false, true}) {
    const float by = spoil ? kDenormal : 0;
    Bvh wide = Wide();
    wide.bounds.lo.x += by;
    same_everywhere([&] { return ValidateBvh(wide, geometry_); }, !spoil);
    same_everywhere([&] { return ValidateLeafMates(wide, geometry_); }, true);
    BinaryBvh binary = Binary();
    binary.nodes[0].lo[0] += by;
    same_everywhere([&] { return ValidateBinaryBvh(binary, geometry_); }, !spoil);
    for (const bool perfect : {false, true}) {
      KdTree kd = Kd(perfect);
      kd.bounds.lo.x += by;
      same_everywhere([&] { return ValidateKdTree(kd, geometry_); }, !spoil);
    }
  }
}

}  // namespace
}  // namespace sightline

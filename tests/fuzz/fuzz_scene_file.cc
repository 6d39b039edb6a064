// SPDX-License-Identifier: Apache-2.0
//
// Any bytes as a native scene file: an error, or a scene that keeps every promise and answers
// alike by every structure it has; never a crash. Unless the first byte is odd the sums are made
// right first, so that what stands behind them is reached.
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <span>
#include <vector>

#include "core/accel/binary_bvh_validation.h"
#include "core/accel/bvh_validation.h"
#include "core/accel/kd_validation.h"
#include "core/accel/leaf_mates_validation.h"
#include "core/base/aligned_vector.h"
#include "core/mesh/geometry_validation.h"
#include "core/query/segments.h"
#include "core/scene/scene_file.h"
#include "tests/support/scene_file_seal.h"

namespace sightline {
namespace {

using testing_support::SealSceneFile;

void Require(bool condition) {
  if (!condition) std::abort();
}

SegmentResult Answer(const Scene& scene, const QueryOptions& options) {
  const Vec3d o = scene.geometry.origin;
  std::vector<std::array<Vec3d, 2>> ends;
  for (const Vec3f& v : scene.geometry.vertices) {
    if (ends.size() == 32) break;
    const Vec3d at = o + ToDouble(v);
    ends.push_back({at + Vec3d{0.5, 0.25, 1}, at - Vec3d{0.25, 0.5, 1}});
    ends.push_back({o, at});
  }
  PreparedSegments segments;
  Require(PrepareSegments(scene, ends, {}, {}, &segments).ok());
  SegmentResult result;
  Require(TestSegments(scene, segments, {.bits = true, .first_hits = true}, options, &result).ok());
  return result;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  static auto* const pool = new ThreadPool(1);
  if (size == 0) return 0;
  const auto* const bytes = reinterpret_cast<const std::byte*>(data);
  auto owner = std::make_shared<AlignedVector<std::byte>>(bytes + 1, bytes + size);
  if (data[0] % 2 == 0 && !owner->empty()) SealSceneFile({owner->data(), owner->size()});
  const std::span<const std::byte> view(std::as_const(*owner));
  const LoadOptions options = {.limits = {.max_triangles = 5000, .max_vertices = 15000}};
  const absl::StatusOr<std::shared_ptr<const Scene>> scene =
      LoadScene({view, owner, "'fuzz'"}, "fuzz", options, *pool);
  if (!scene.ok()) return 0;
  Require(ValidateGeometry((*scene)->geometry).ok());
  Require((*scene)->kd_tree_alone() || ValidateBvh((*scene)->bvh, (*scene)->geometry).ok());
  Require(ValidateLeafMates((*scene)->bvh, (*scene)->geometry).ok());
  const SegmentResult checked = Answer(**scene, {.strategy = Strategy::kBruteForce});
  const auto expect_same = [&](const QueryOptions& options) {
    const SegmentResult walked = Answer(**scene, options);
    Require(walked.blocked_bits == checked.blocked_bits && walked.triangle == checked.triangle);
  };
  expect_same({});
  if ((*scene)->kd_tree) {
    Require(ValidateKdTree(*(*scene)->kd_tree, (*scene)->geometry).ok());
    expect_same({.structure = Structure::kKdTree});
  }
  if ((*scene)->binary_bvh) {
    Require(ValidateBinaryBvh(*(*scene)->binary_bvh, (*scene)->geometry).ok());
    expect_same({.structure = Structure::kBinaryBvh});
  }
  return 0;
}

}  // namespace sightline

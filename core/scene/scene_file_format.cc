// SPDX-License-Identifier: Apache-2.0
#include "core/scene/scene_file_format.h"

#define XXH_INLINE_ALL
#include <xxhash.h>

#include <algorithm>
#include <array>
#include <bit>
#include <vector>

#include "core/accel/binary_bvh.h"
#include "core/accel/bvh.h"
#include "core/accel/kd_tree.h"
#include "core/base/parallel.h"
#include "core/geometry/vec3.h"

namespace sightline {

static_assert(std::endian::native == std::endian::little);

namespace {

// Of the bytes [first, last) of the parts from `parts` on, followed by fewer than 64 zeros.
// REQUIRES: they have that many, and the first of them has byte `first`.
uint64_t BlockSum(const std::span<const std::byte>* parts, uint64_t first, uint64_t last,
                  size_t zeros) {
  if (zeros == 0 && last <= parts->size()) {
    return XXH3_64bits(parts->data() + first, last - first);
  }
  static constexpr std::array<std::byte, kSectionAlignment> kZeros{};
  XXH3_state_t state;
  XXH3_64bits_reset(&state);
  while (first < last) {
    const uint64_t end = std::min<uint64_t>(last, parts->size());
    XXH3_64bits_update(&state, parts->data() + first, end - first);
    last -= end;
    first = 0;
    ++parts;
  }
  XXH3_64bits_update(&state, kZeros.data(), zeros);
  return XXH3_64bits_digest(&state);
}

}  // namespace

absl::string_view SectionName(uint32_t kind) {
  switch (static_cast<SectionKind>(kind)) {
    case SectionKind::kScene:
      return "scene";
    case SectionKind::kObjects:
      return "objects";
    case SectionKind::kNames:
      return "names";
    case SectionKind::kSourceVertices:
      return "source vertices";
    case SectionKind::kVertices:
      return "vertices";
    case SectionKind::kTriangles:
      return "triangles";
    case SectionKind::kInert:
      return "inert triangles";
    case SectionKind::kBvhNodes:
      return "bvh nodes";
    case SectionKind::kBvhLeaves:
      return "bvh leaves";
    case SectionKind::kBvhLeafIds:
      return "bvh leaf ids";
    case SectionKind::kKdTree:
      return "kd-tree";
    case SectionKind::kKdNodes:
      return "kd-tree nodes";
    case SectionKind::kKdLeaves:
      return "kd-tree leaves";
    case SectionKind::kKdIds:
      return "kd-tree ids";
    case SectionKind::kKdReach:
      return "kd-tree reach";
    case SectionKind::kBinaryBvh:
      return "binary bvh";
    case SectionKind::kBinaryBvhNodes:
      return "binary bvh nodes";
    case SectionKind::kBinaryBvhIds:
      return "binary bvh ids";
    case SectionKind::kLeafMateRows:
      return "leaf mates";
    case SectionKind::kLeafMateUnits:
      return "leaf mates' units";
    case SectionKind::kBvhGrowth:
      return "bvh growth";
  }
  return "addition";
}

uint32_t SectionElementBytes(SectionKind kind) {
  switch (kind) {
    case SectionKind::kScene:
      return sizeof(SceneFileScene);
    case SectionKind::kObjects:
      return sizeof(SceneFileObject);
    case SectionKind::kSourceVertices:
      return sizeof(Vec3d);
    case SectionKind::kVertices:
      return sizeof(Vec3f);
    case SectionKind::kTriangles:
      return 3 * sizeof(uint32_t);
    case SectionKind::kBvhNodes:
      return sizeof(BvhNode);
    case SectionKind::kInert:
    case SectionKind::kBvhLeaves:
    case SectionKind::kBvhLeafIds:
    case SectionKind::kKdIds:
    case SectionKind::kBinaryBvhIds:
      return sizeof(uint32_t);
    case SectionKind::kKdTree:
      return sizeof(SceneFileKdTree);
    case SectionKind::kKdNodes:
      return sizeof(KdNode);
    case SectionKind::kKdLeaves:
      return sizeof(KdLeaf);
    case SectionKind::kKdReach:
      return sizeof(Box3f);
    case SectionKind::kBinaryBvh:
      return sizeof(SceneFileBinaryBvh);
    case SectionKind::kBinaryBvhNodes:
      return sizeof(BinaryBvhNode);
    case SectionKind::kLeafMateRows:
      return sizeof(LeafMate);
    case SectionKind::kBvhGrowth:
      return sizeof(SceneFileBvhGrowth);
    case SectionKind::kNames:
    case SectionKind::kLeafMateUnits:
      return 1;
  }
  return 0;
}

uint64_t SectionSum(std::span<const std::byte> bytes, const CancelToken* cancel) {
  return SectionSum(std::span(&bytes, 1), cancel);
}

uint64_t SectionSum(std::span<const std::span<const std::byte>> parts, const CancelToken* cancel) {
  std::vector<uint64_t> ends(parts.size());  // Of the parts, from the section's start.
  uint64_t bytes = 0;
  for (size_t i = 0; i < parts.size(); ++i) ends[i] = bytes += parts[i].size();
  const uint64_t padded = PaddedSection(bytes);
  const size_t blocks = (padded + kSumBlockBytes - 1) / kSumBlockBytes;
  std::vector<uint64_t> sums(blocks);
  ParallelFor(
      blocks, 1,
      [&](size_t begin, size_t end) {
        for (size_t block = begin; block < end; ++block) {
          const uint64_t first = block * kSumBlockBytes;
          const uint64_t last = std::min(padded, first + kSumBlockBytes);
          const uint64_t there = std::min<uint64_t>(last, bytes);
          const size_t part = std::upper_bound(ends.begin(), ends.end(), first) - ends.begin();
          const uint64_t start = ends[part] - parts[part].size();
          sums[block] = BlockSum(&parts[part], first - start, there - start, last - there);
        }
      },
      cancel);
  return XXH3_64bits(sums.data(), sums.size() * sizeof(uint64_t));
}

uint64_t HeaderSum(const SceneFileHeader& header) {
  return XXH3_64bits(&header, offsetof(SceneFileHeader, header_sum));
}

}  // namespace sightline

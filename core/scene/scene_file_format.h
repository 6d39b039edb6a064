// SPDX-License-Identifier: Apache-2.0
//
// The layout of a native scene file (.slscene): what the writer and the reader share.
// Numbers are little-endian, as the processors that this engine runs on have them.
//
//   SceneFileHeader                     64 bytes
//   SceneFileSection[section_count]     the table, padded with zeros to 64 bytes
//   sections                            in the order of the table, each padded with zeros to 64
//
// Sections follow each other without a gap and end where the file does, so that every byte of the
// file stands under one of the sums. Their kinds ascend. Those of version 1 are all there, perhaps
// empty; kinds from kFirstOptional on are additions that a reader may not know: it checks their
// sums and passes over them.
//
// Version 2 is that of scenes whose kd-tree stands alone: the sections of the BVH are empty, which
// a reader of version 1 would take for a fault. All other scenes are written as version 1.
//
// A sum is the XXH3 (64 bits) of the XXH3s of the section's blocks of kSumBlockBytes, padding
// included: blocks are summed in parallel. It tells accidents, not attacks: whatever the sums say,
// the reader checks all that is used (ValidateGeometry, ValidateBvh, ValidateLeafMates).
//
// Thread safety: plain values and functions.
#ifndef SIGHTLINE_CORE_SCENE_SCENE_FILE_FORMAT_H_
#define SIGHTLINE_CORE_SCENE_SCENE_FILE_FORMAT_H_

#include <cstddef>
#include <cstdint>
#include <span>

#include "absl/strings/string_view.h"
#include "core/base/cancel.h"

namespace sightline {

inline constexpr char kSceneFileMagic[8] = {'S', 'L', 'S', 'C', 'E', 'N', 'E', '\n'};
inline constexpr uint32_t kSceneFileVersion = 1;
inline constexpr uint32_t kSceneFileVersionWithoutBvh = 2;
inline constexpr uint32_t kSceneFileByteOrder = 0x01020304;
// The greatest revision in a file: those that edits make of it, one by one, still are int64s.
inline constexpr uint64_t kMaxSceneFileRevision = uint64_t{1} << 62;
inline constexpr uint64_t kSectionAlignment = 64;
inline constexpr uint32_t kMaxSections = 64;
inline constexpr uint64_t kSumBlockBytes = uint64_t{1} << 20;

enum class SectionKind : uint32_t {
  kScene = 1,           // One SceneFileScene.
  kObjects = 2,         // SceneFileObject, in the order of their numbers.
  kNames = 3,           // Their names, one after the other, UTF-8.
  kSourceVertices = 4,  // Vec3d: the local vertices of the dynamic objects, in that order.
  kVertices = 5,        // Vec3f: SceneGeometry::vertices.
  kTriangles = 6,       // uint32[3]: SceneGeometry::triangles.
  kInert = 7,           // uint32: SceneGeometry::inert.
  kBvhNodes = 8,        // Bvh::nodes.
  kBvhLeaves = 9,       // Bvh::leaves.
  kBvhLeafIds = 10,     // Bvh::leaf_ids.
  kFirstOptional = 256,
  // The kd-tree of a scene that has one: all of these, or none.
  kKdTree = 256,    // One SceneFileKdTree.
  kKdNodes = 257,   // KdTree::nodes.
  kKdLeaves = 258,  // KdTree::leaves.
  kKdIds = 259,     // KdTree::ids.
  kKdReach = 260,   // KdTree::reach.
  // The binary BVH of a scene that has one: all of these, or none. Its leaves' triangles are laid
  // out again when it is read.
  kBinaryBvh = 261,       // One SceneFileBinaryBvh.
  kBinaryBvhNodes = 262,  // BinaryBvh::nodes.
  kBinaryBvhIds = 263,    // BinaryBvh::ids.
  // Bvh::mates, if it has any: both, or none.
  kLeafMateRows = 264,   // LeafMates::rows.
  kLeafMateUnits = 265,  // LeafMates::units.
  // Of a BVH that was fitted to triangles that moved. Without it, the tree is as it was built.
  kBvhGrowth = 266,  // One SceneFileBvhGrowth.
};
inline constexpr uint32_t kRequiredSections = 10;

struct SceneFileHeader {
  char magic[8];
  uint32_t version;
  uint32_t byte_order;
  uint64_t file_bytes;
  uint32_t section_count;
  uint32_t zeros[5];
  uint64_t table_sum;   // Of the table with its padding.
  uint64_t header_sum;  // Of the header up to here.
};
static_assert(sizeof(SceneFileHeader) == 64);

struct SceneFileSection {
  uint32_t kind;
  uint32_t element_bytes;
  uint64_t offset;  // From the file's start, a multiple of 64.
  uint64_t count;   // Of elements.
  uint64_t sum;
};
static_assert(sizeof(SceneFileSection) == 32);

// What SceneGeometry, Bvh and BuildReport hold beside arrays and what follows from them.
struct SceneFileScene {
  double origin[3];
  double largest_rounding;
  uint64_t revision;  // 1 .. kMaxSceneFileRevision.
  uint64_t non_finite_vertices, non_finite_triangles, zero_area_triangles, duplicate_triangles;
  double compile_seconds, structure_seconds;
  float bounds[6];  // Lower, then upper corner; inverted if nothing can be hit.
  uint32_t leaf_count, max_depth;
};
static_assert(sizeof(SceneFileScene) == 120);

struct SceneFileObject {
  uint32_t name_bytes;
  uint32_t triangle_count, vertex_count;
  uint32_t mask;
  uint32_t culling;  // Culling.
  uint32_t dynamic;  // 1: its local vertices are in kSourceVertices.
  double transform[12];
  double largest_rounding;
};
static_assert(sizeof(SceneFileObject) == 128);

// What KdTree holds beside arrays and what follows from them.
struct SceneFileKdTree {
  float bounds[6];
  uint32_t max_depth;
  uint32_t leaves_laid_out;  // 1: IndexedGeometry::kd_leaves are there, and made anew when read.
};
static_assert(sizeof(SceneFileKdTree) == 32);

// What BinaryBvh holds beside arrays and what follows from them.
struct SceneFileBinaryBvh {
  uint32_t leaf_count, max_depth;
};
static_assert(sizeof(SceneFileBinaryBvh) == 8);

struct SceneFileBvhGrowth {
  double cost_growth;  // Bvh::cost_growth: finite, above 0.
};
static_assert(sizeof(SceneFileBvhGrowth) == 8);

constexpr bool IsSceneFileRevision(uint64_t revision) {
  return revision >= 1 && revision <= kMaxSceneFileRevision;
}

constexpr uint64_t PaddedSection(uint64_t bytes) {
  return (bytes + kSectionAlignment - 1) / kSectionAlignment * kSectionAlignment;
}

// "vertices", "bvh nodes"; "addition" for a kind of a later version.
absl::string_view SectionName(uint32_t kind);

// The size of an element of a section of this version; 0 for another kind, which may have any.
uint32_t SectionElementBytes(SectionKind kind);

// Of `bytes` as they stand followed by zeros up to a multiple of 64. In parallel within the calling
// thread's pool. Meaningless once `cancel` has fired.
uint64_t SectionSum(std::span<const std::byte> bytes, const CancelToken* cancel = nullptr);
// The same of what lies in several places: of all parts' bytes, one after the other.
uint64_t SectionSum(std::span<const std::span<const std::byte>> parts,
                    const CancelToken* cancel = nullptr);

// Of the header's bytes before header_sum.
uint64_t HeaderSum(const SceneFileHeader& header);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_SCENE_SCENE_FILE_FORMAT_H_

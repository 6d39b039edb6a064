// SPDX-License-Identifier: Apache-2.0
//
// Parts points in space, again and again, down to the blocks that share a shaft. What costs is
// moving points to either side of a plane, so that is done by vectors, without a branch.
//
// Thread safety: a plain value.
//
//   PointParter parter(positions, valid);
//   parter.Part();
//   const std::vector<uint32_t> order = parter.Order();
#ifndef SIGHTLINE_CORE_QUERY_POINT_PARTER_H_
#define SIGHTLINE_CORE_QUERY_POINT_PARTER_H_

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "core/geometry/vec3.h"

namespace sightline {

class PointParter {
 public:
  // What a walk puts to a triangle at once (core/traverse/shaft_rays-inl.h): no block is parted
  // further.
  static constexpr size_t kSmallestBlock = 16;

  // The valid ones, of as many as there are flags. REQUIRES: those are finite.
  PointParter(std::span<const Vec3f> positions, std::span<const uint8_t> valid);

  // Parts them across their widest axis, and each part again. The first part takes the largest
  // power of two of smallest blocks that leaves something over, so that every block of 16, 32, 64
  // and so on from the start of the order is one part. O(n log n), whatever the points.
  void Part() { Part(0, count_); }

  // Their numbers, as they stand.
  std::vector<uint32_t> Order() const { return {rows_.number, rows_.number + count_}; }

 private:
  // Points in rows.
  struct Rows {
    float* at[3];
    uint32_t* number;
  };
  // All keys of some points lie in it. As ordered integers, of which there is a next one.
  struct Range {
    int32_t least, most;
  };

  void Part(size_t begin, size_t end);
  // The widest axis of some points, more than one vector of them, and their extent along it.
  int WidestAxis(size_t begin, size_t end, Range* range) const;
  // Moves those of [begin, end) with the lesser keys before `middle`, the others behind it.
  void Select(size_t begin, size_t middle, size_t end, int axis, Range range);
  // Moves those of [begin, end) whose key is below `pivot` to the front, with `equal` those at it,
  // too; returns where the others begin.
  size_t Split(size_t begin, size_t end, int axis, float pivot, bool equal);

  size_t room_;  // Of each row.
  std::unique_ptr<float[]> coordinates_;
  std::unique_ptr<uint32_t[]> numbers_;
  Rows rows_, aside_;  // The points; and what Split puts aside.
  size_t count_ = 0;
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_POINT_PARTER_H_

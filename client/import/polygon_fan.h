// SPDX-License-Identifier: Apache-2.0
//
// Cuts polygons into triangles as a fan from their first corner, and counts what it sees: corners
// 0, i, i + 1 for i = 1 ... n - 2, in that order. A face with a corner out of range is dropped
// whole, as is one with fewer than three corners. This is the one place where faces become
// triangles, whatever the format.
//
// Thread safety: one fan per thread.
//
//   PolygonFan fan(vertices.size(), options, &report);
//   SL_RETURN_IF_ERROR(fan.Add(corners, &object.indices));
#ifndef SIGHTLINE_CLIENT_IMPORT_POLYGON_FAN_H_
#define SIGHTLINE_CLIENT_IMPORT_POLYGON_FAN_H_

#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "absl/status/status.h"
#include "client/import/import_types.h"

namespace sightline {

// The most vertices that 32-bit indices can name.
inline constexpr uint64_t kMaxVertices = uint64_t{std::numeric_limits<uint32_t>::max()};

class PolygonFan {
 public:
  // A corner that never names a vertex: for indices that could not be read.
  static constexpr int64_t kBadCorner = -1;

  PolygonFan(uint64_t vertex_count, const ImportOptions& options, ImportReport* report)
      : vertex_count_(vertex_count),
        max_triangles_(options.max_triangles),
        cancel_(options.cancel),
        report_(report) {}

  // For formats whose vertices and faces come mixed.
  void set_vertex_count(uint64_t vertex_count) { vertex_count_ = vertex_count; }

  // Appends the triangles of a face. ResourceExhausted where the scene would hold more triangles
  // than the options allow; the status of their `cancel` soon after that stopped. REQUIRES:
  // vertex_count <= kMaxVertices.
  absl::Status Add(std::span<const int64_t> corners, std::vector<uint32_t>* indices);

  // Counts triangles that come about without a face of the file (instances of a mesh).
  absl::Status Charge(uint64_t triangles);

 private:
  uint64_t vertex_count_;
  const uint64_t max_triangles_;
  const CancelToken* const cancel_;
  uint64_t triangles_ = 0;
  ImportReport* const report_;
};

}  // namespace sightline

#endif  // SIGHTLINE_CLIENT_IMPORT_POLYGON_FAN_H_

// SPDX-License-Identifier: Apache-2.0
//
// Cuts arrays into the messages of an upload.
//
// Thread safety: free functions.
#ifndef SIGHTLINE_CLIENT_LIB_UPLOAD_H_
#define SIGHTLINE_CLIENT_LIB_UPLOAD_H_

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <string>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "client/lib/types.h"
#include "sightline/v1/query_options.pb.h"
#include "sightline/v1/scene_service.pb.h"

namespace sightline::client {

// Array bytes per message: large enough that per-message costs vanish, small enough that neither
// side holds much (64 KiB to 1 MiB measured best). The rest of a message is a few dozen bytes.
inline constexpr uint64_t kUploadChunkBytes = uint64_t{1} << 20;

// The most array bytes that one message may have.
inline uint64_t ArrayBytes(uint64_t max_message_bytes) {
  constexpr uint64_t kMargin = 4096;
  if (max_message_bytes == 0) return kUploadChunkBytes;
  return std::max<uint64_t>(256, max_message_bytes - std::min(max_message_bytes, kMargin));
}

inline uint64_t ChunkBytes(uint64_t max_message_bytes) {
  return std::min(ArrayBytes(max_message_bytes), kUploadChunkBytes);
}

// `count` rows of `row` numbers from row `begin` on, as packed bytes.
template <typename T>
std::string PackRows(std::span<const T> values, size_t row, size_t begin, size_t count) {
  const std::span<const T> part = values.subspan(begin * row, count * row);
  return std::string(reinterpret_cast<const char*>(part.data()), part.size_bytes());
}

// Sends vertices, then indices, in chunks of at most `bytes`; false once `send` is.
inline bool SendMesh(std::span<const double> vertices, std::span<const uint32_t> indices,
                     uint64_t bytes, const std::function<bool(v1::MeshChunk)>& send) {
  const size_t vertex_rows = std::max<size_t>(1, bytes / (3 * sizeof(double)));
  for (size_t i = 0; i < vertices.size() / 3; i += vertex_rows) {
    v1::MeshChunk chunk;
    chunk.set_vertices_f64(
        PackRows(vertices, 3, i, std::min(vertex_rows, vertices.size() / 3 - i)));
    if (!send(std::move(chunk))) return false;
  }
  const size_t index_rows = std::max<size_t>(1, bytes / (3 * sizeof(uint32_t)));
  for (size_t i = 0; i < indices.size() / 3; i += index_rows) {
    v1::MeshChunk chunk;
    chunk.set_indices(PackRows(indices, 3, i, std::min(index_rows, indices.size() / 3 - i)));
    if (!send(std::move(chunk))) return false;
  }
  return true;
}

// INVALID_ARGUMENT for arrays of which the lengths do not fit each other.
inline absl::Status CheckPoints(const Points& points) {
  if (points.positions.size() % 3 != 0) {
    return absl::InvalidArgumentError(absl::StrCat("points.positions has ", points.positions.size(),
                                                   " numbers, which 3 does not divide"));
  }
  const size_t n = points.positions.size() / 3;
  const auto check = [n](size_t size, size_t row, absl::string_view field) -> absl::Status {
    if (size == 0 || size == n * row) return absl::OkStatus();
    return absl::InvalidArgumentError(
        absl::StrCat("points.", field, " has ", size, " numbers; ", n, " points need ", n * row));
  };
  absl::Status s = check(points.source_objects.size(), 1, "source_objects");
  s.Update(check(points.source_triangles.size(), 1, "source_triangles"));
  s.Update(check(points.normals.size(), 3, "normals"));
  return s;
}

// What a point takes in a message, of the arrays that there are.
inline uint64_t BytesPerPoint(const Points& points) {
  return 3 * sizeof(double) + (points.source_objects.empty() ? 0 : sizeof(uint32_t)) +
         (points.source_triangles.empty() ? 0 : sizeof(uint32_t)) +
         (points.normals.empty() ? 0 : 3 * sizeof(double));
}

// Points begin .. begin + count - 1 with whatever is known of them. REQUIRES: CheckPoints is OK.
inline void PackPoints(const Points& points, size_t begin, size_t count, v1::PointArrays* out) {
  out->set_points(PackRows(points.positions, 3, begin, count));
  if (!points.source_objects.empty()) {
    out->set_source_objects(PackRows(points.source_objects, 1, begin, count));
  }
  if (!points.source_triangles.empty()) {
    out->set_source_triangles(PackRows(points.source_triangles, 1, begin, count));
  }
  if (!points.normals.empty()) out->set_normals(PackRows(points.normals, 3, begin, count));
}

}  // namespace sightline::client

#endif  // SIGHTLINE_CLIENT_LIB_UPLOAD_H_

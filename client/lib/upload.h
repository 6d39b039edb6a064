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

#include "client/lib/types.h"
#include "sightline/v1/query_options.pb.h"
#include "sightline/v1/scene_service.pb.h"

namespace sightline::client {

// Array bytes per message: large enough that per-message costs vanish, small enough that neither
// side holds much (64 KiB to 1 MiB measured best). The rest of a message is a few dozen bytes.
inline constexpr uint64_t kUploadChunkBytes = uint64_t{1} << 20;

inline uint64_t ChunkBytes(uint64_t max_message_bytes) {
  constexpr uint64_t kMargin = 4096;
  if (max_message_bytes == 0) return kUploadChunkBytes;
  return std::clamp<uint64_t>(max_message_bytes > kMargin ? max_message_bytes - kMargin : 0, 256,
                              kUploadChunkBytes);
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

// Points begin .. begin + count - 1 with whatever is known of them.
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

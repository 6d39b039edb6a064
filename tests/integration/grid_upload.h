// SPDX-License-Identifier: Apache-2.0
//
// Uploads that take several messages: a square grid of triangles as a scene, the edit that moves it
// to another height, and points on it; as the messages of their calls, in chunks of equal size.
//
// Invariants
//  1. The grid spans -1 to 1 in x and y, in a plane of constant z.
//  2. Half of a call's messages, rounded down, has its header and a part of its arrays, and not all
//     of them: `side` is a multiple of 10, and vertices come in ten chunks.
//
// Thread safety: constant after construction.
//
//   const GridUpload grid(900);
//   for (const auto& message : grid.Scene("grid", 1)) writer->Write(message);
//   ...
//   EXPECT_TRUE(GridBlocks(server.Channel(), "scenes/grid", 1.5));
#ifndef SIGHTLINE_TESTS_INTEGRATION_GRID_UPLOAD_H_
#define SIGHTLINE_TESTS_INTEGRATION_GRID_UPLOAD_H_

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "sightline/v1/point_set_service.pb.h"
#include "sightline/v1/scene_service.pb.h"
#include "tests/integration/server_harness.h"

namespace sightline {

class GridUpload {
 public:
  // `side` vertices along each side.
  explicit GridUpload(uint32_t side) : side_(side) {}

  uint64_t vertices() const { return uint64_t{side_} * side_; }
  uint64_t triangles() const { return uint64_t{side_ - 1} * (side_ - 1) * 2; }

  std::vector<v1::CreateSceneRequest> Scene(const std::string& id, double z) const {
    std::vector<v1::CreateSceneRequest> messages(2);
    v1::CreateSceneHeader* const header = messages[0].mutable_header();
    header->set_scene_id(id);
    header->set_request_id(absl::StrCat("upload-of-", id));
    header->mutable_upload()->set_object_count(1);
    header->mutable_upload()->set_triangle_count(triangles());
    header->mutable_upload()->set_vertex_count(vertices());
    messages[1].mutable_object()->set_object_name("grid");
    messages[1].mutable_object()->set_triangle_count(triangles());
    messages[1].mutable_object()->set_vertex_count(vertices());
    for (uint64_t at = 0; at < vertices(); at += chunk()) {
      messages.emplace_back().mutable_chunk()->set_vertices_f64(Vertices(at, z));
    }
    const std::string indices = Indices();
    const size_t bytes = 12 * ((triangles() + kChunks - 1) / kChunks);
    for (size_t at = 0; at < indices.size(); at += bytes) {
      messages.emplace_back().mutable_chunk()->set_indices(indices.substr(at, bytes));
    }
    return messages;
  }

  // Of the scene `name`: new vertices for the grid, at height `z`.
  std::vector<v1::UpdateSceneRequest> Move(const std::string& name, double z) const {
    std::vector<v1::UpdateSceneRequest> messages(2);
    messages[0].mutable_header()->set_name(name);
    messages[1].mutable_replace_vertices()->set_object_name("grid");
    messages[1].mutable_replace_vertices()->set_vertex_count(vertices());
    for (uint64_t at = 0; at < vertices(); at += chunk()) {
      messages.emplace_back().mutable_chunk()->set_vertices_f64(Vertices(at, z));
    }
    return messages;
  }

  // A point set "points" of the scene `name`: the grid's vertices at height `z`.
  std::vector<v1::CreatePointSetRequest> Points(const std::string& name, double z) const {
    std::vector<v1::CreatePointSetRequest> messages(1);
    messages[0].mutable_header()->set_parent(name);
    messages[0].mutable_header()->set_point_set_id("points");
    messages[0].mutable_header()->mutable_upload()->set_point_count(vertices());
    for (uint64_t at = 0; at < vertices(); at += chunk()) {
      messages.emplace_back().mutable_chunk()->set_points(Vertices(at, z));
    }
    return messages;
  }

 private:
  static constexpr uint64_t kChunks = 10;

  uint64_t chunk() const { return vertices() / kChunks; }
  // A chunk of them, from the vertex `begin`.
  std::string Vertices(uint64_t begin, double z) const {
    std::vector<double> numbers;
    numbers.reserve(3 * chunk());
    for (uint64_t i = begin; i < begin + chunk(); ++i) {
      numbers.push_back(2.0 * static_cast<double>(i % side_) / (side_ - 1) - 1);
      numbers.push_back(2.0 * static_cast<double>(i / side_) / (side_ - 1) - 1);
      numbers.push_back(z);
    }
    return PackArray(numbers);
  }
  std::string Indices() const {
    std::vector<uint32_t> indices;
    indices.reserve(3 * triangles());
    for (uint32_t y = 0; y + 1 < side_; ++y) {
      for (uint32_t x = 0; x + 1 < side_; ++x) {
        const uint32_t a = y * side_ + x, b = a + 1, c = a + side_, d = c + 1;
        indices.insert(indices.end(), {a, b, d, a, d, c});
      }
    }
    return PackArray(indices);
  }

  const uint32_t side_;
};

// Whether the grid that is the scene `name` stands between the plane z = 0 and z = `top`, as the
// server answers it.
inline bool GridBlocks(const std::shared_ptr<grpc::Channel>& channel, const std::string& name,
                       double top) {
  const auto stub = v1::VisibilityService::NewStub(channel);
  grpc::ClientContext context;
  const auto stream = stub->TestSegments(&context);
  v1::TestSegmentsRequest request;
  request.mutable_header()->mutable_stream()->set_scene(name);
  stream->Write(request);
  request.mutable_item()->set_segments(PackArray<double>({0.25, 0.125, 0, 0.25, 0.125, top}));
  stream->Write(request);
  stream->WritesDone();
  v1::TestSegmentsResponse response;
  std::string bits;
  while (stream->Read(&response)) bits += response.reply().segments().blocked_bits();
  const grpc::Status status = stream->Finish();
  EXPECT_TRUE(status.ok()) << status.error_message();
  EXPECT_EQ(bits.size(), 1u);
  return bits == std::string(1, 1);
}

}  // namespace sightline

#endif  // SIGHTLINE_TESTS_INTEGRATION_GRID_UPLOAD_H_

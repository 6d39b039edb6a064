// SPDX-License-Identifier: Apache-2.0
//
// The upload state machines of meshes, edits and points, by whole uploads: the input says how a
// good upload is cut into messages, and what is then done to them (one dropped, doubled, exchanged
// with the last, or a bit of it changed). fuzz_request_decoders hands the same machines any bytes;
// here most messages are good, so that the states behind them are reached.
//
// An upload that nothing was done to is accepted and comes out as it went in; whatever is accepted
// has what its header announced; after the first error nothing more is.
//
// make_upload_corpus.py writes the seeds: it knows what choices are asked for here, and in which
// order.
#include <fuzzer/FuzzedDataProvider.h>

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <string>
#include <utility>
#include <vector>

#include "server/base/limits.h"
#include "server/points/point_upload.h"
#include "server/scenes/scene_upload.h"

namespace sightline {
namespace {

void Require(bool condition) {
  if (!condition) std::abort();
}

template <typename T>
std::string Pack(const std::vector<T>& values) {
  return std::string(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T));
}

// What can be done to the messages of an upload. Returns whether anything was.
template <typename Message>
bool Disturb(FuzzedDataProvider& input, std::vector<Message>* messages) {
  bool disturbed = false;
  for (int n = input.ConsumeIntegralInRange(0, 2); n > 0 && !messages->empty(); --n) {
    const size_t at = input.ConsumeIntegralInRange<size_t>(0, messages->size() - 1);
    switch (input.ConsumeIntegralInRange(0, 3)) {
      case 0:
        messages->erase(messages->begin() + static_cast<std::ptrdiff_t>(at));
        break;
      case 1:
        messages->insert(messages->begin() + static_cast<std::ptrdiff_t>(at), (*messages)[at]);
        break;
      case 2:
        std::swap((*messages)[at], messages->back());
        break;
      default: {
        std::string bytes = (*messages)[at].SerializeAsString();
        if (!bytes.empty()) bytes[input.ConsumeIntegralInRange<size_t>(0, bytes.size() - 1)] ^= 1;
        Message changed;
        if (changed.ParseFromString(bytes)) (*messages)[at] = std::move(changed);
      }
    }
    disturbed = true;
  }
  return disturbed;
}

// Hands over the messages; whether all were taken.
template <typename Upload, typename Message>
bool Send(const std::vector<Message>& messages, Upload* upload) {
  bool good = true;
  for (const Message& message : messages) {
    const bool taken = upload->Add(message).ok();
    Require(good || !taken);
    good = taken;
  }
  return good;
}

// What a server charges for these messages.
template <typename Upload, typename Message>
uint64_t Charged(const std::vector<Message>& messages) {
  uint64_t bytes = 0;
  for (const Message& message : messages) bytes += Upload::BytesOf(message);
  return bytes;
}

struct Mesh {
  std::vector<double> vertices;
  std::vector<uint32_t> indices;
};

std::vector<double> Vertices(uint32_t count) {
  std::vector<double> vertices;
  for (uint32_t i = 0; i < 3 * count; ++i) vertices.push_back(0.25 * i);
  return vertices;
}

Mesh AnyMesh(FuzzedDataProvider& input) {
  Mesh mesh;
  const auto vertices = input.ConsumeIntegralInRange<uint32_t>(3, 12);
  mesh.vertices = Vertices(vertices);
  const auto triangles = input.ConsumeIntegralInRange<uint32_t>(1, 12);
  for (uint32_t i = 0; i < 3 * triangles; ++i) {
    mesh.indices.push_back(input.ConsumeIntegralInRange<uint32_t>(0, vertices - 1));
  }
  return mesh;
}

void Announce(const Mesh& mesh, const std::string& name, v1::ObjectHeader* header) {
  header->set_object_name(name);
  header->set_vertex_count(mesh.vertices.size() / 3);
  header->set_triangle_count(mesh.indices.size() / 3);
}

bool Holds(const ObjectInput& object, const Mesh& mesh) {
  return object.vertices.size() * 3 == mesh.vertices.size() && object.indices == mesh.indices;
}

uint64_t HeldBy(const ObjectInput& object) {
  return object.vertices.size() * sizeof(Vec3d) + object.indices.size() * sizeof(uint32_t);
}

// The arrays in chunks of any size; indices may come before, with or after their vertices.
template <typename Message>
void AddChunks(FuzzedDataProvider& input, const Mesh& mesh, std::vector<Message>* messages) {
  const bool floats = input.ConsumeBool();
  size_t v = 0, t = 0;
  while (v < mesh.vertices.size() || t < mesh.indices.size()) {
    const size_t more_v =
        std::min<size_t>(mesh.vertices.size() - v, 3 * input.ConsumeIntegralInRange<size_t>(0, 4));
    const size_t more_t =
        std::min<size_t>(mesh.indices.size() - t, 3 * input.ConsumeIntegralInRange<size_t>(0, 4));
    // An input that has run dry gives zeros for ever.
    const bool dry = more_v == 0 && more_t == 0;
    const size_t end_v = dry ? mesh.vertices.size() : v + more_v;
    const size_t end_t = dry ? mesh.indices.size() : t + more_t;
    v1::MeshChunk* const chunk = messages->emplace_back().mutable_chunk();
    const auto from = mesh.vertices.begin();
    if (floats) {
      chunk->set_vertices_f32(Pack(std::vector<float>(from + static_cast<std::ptrdiff_t>(v),
                                                      from + static_cast<std::ptrdiff_t>(end_v))));
    } else {
      chunk->set_vertices_f64(Pack(std::vector<double>(from + static_cast<std::ptrdiff_t>(v),
                                                       from + static_cast<std::ptrdiff_t>(end_v))));
    }
    const auto first = mesh.indices.begin();
    chunk->set_indices(Pack(std::vector<uint32_t>(first + static_cast<std::ptrdiff_t>(t),
                                                  first + static_cast<std::ptrdiff_t>(end_t))));
    v = end_v;
    t = end_t;
  }
}

void FuzzMeshUpload(FuzzedDataProvider& input) {
  std::vector<Mesh> meshes(input.ConsumeIntegralInRange<size_t>(1, 3));
  std::vector<v1::CreateSceneRequest> messages(1);
  uint64_t triangles = 0, vertices = 0;
  for (size_t m = 0; m < meshes.size(); ++m) {
    meshes[m] = AnyMesh(input);
    v1::ObjectHeader* const object = messages.emplace_back().mutable_object();
    Announce(meshes[m], "object" + std::to_string(m), object);
    triangles += object->triangle_count();
    vertices += object->vertex_count();
    AddChunks(input, meshes[m], &messages);
  }
  v1::UploadSource* const source = messages[0].mutable_header()->mutable_upload();
  source->set_object_count(static_cast<uint32_t>(meshes.size()));
  source->set_triangle_count(triangles);
  source->set_vertex_count(vertices);
  const bool disturbed = Disturb(input, &messages);

  SceneUpload upload{Limits()};
  const bool taken = Send(messages, &upload);
  const absl::StatusOr<std::vector<ObjectInput>> objects = upload.Finish();
  Require(taken || !objects.ok());
  uint64_t held = 0;
  if (objects.ok()) {
    for (const ObjectInput& object : *objects) held += HeldBy(object);
  }
  Require(held <= Charged<SceneUpload>(messages));
  if (!disturbed) {
    Require(objects.ok() && objects->size() == meshes.size());
    for (size_t m = 0; m < meshes.size(); ++m) Require(Holds((*objects)[m], meshes[m]));
  } else if (objects.ok() && upload.header()->builtin.empty()) {
    Require(objects->size() == upload.header()->object_count);
  }
}

// An edit that the messages ask for.
struct Asked {
  SceneEdit::Kind kind = SceneEdit::Kind::kAdd;
  std::string name;
  Mesh mesh;
  Affine3d transform;
};

Asked AskForEdit(FuzzedDataProvider& input, const std::string& name,
                 std::vector<v1::UpdateSceneRequest>* messages) {
  Asked asked{.name = name};
  v1::UpdateSceneRequest& message = messages->emplace_back();
  switch (input.ConsumeIntegralInRange(0, 3)) {
    case 0:
      asked.mesh = AnyMesh(input);
      Announce(asked.mesh, name, message.mutable_add_object());
      AddChunks(input, asked.mesh, messages);
      break;
    case 1:
      asked.kind = SceneEdit::Kind::kSetVertices;
      asked.mesh.vertices = Vertices(input.ConsumeIntegralInRange<uint32_t>(1, 12));
      message.mutable_replace_vertices()->set_object_name(name);
      message.mutable_replace_vertices()->set_vertex_count(asked.mesh.vertices.size() / 3);
      AddChunks(input, asked.mesh, messages);
      break;
    case 2:
      asked.kind = SceneEdit::Kind::kRemove;
      message.mutable_remove_object()->set_object_name(name);
      break;
    default:
      asked.kind = SceneEdit::Kind::kSetTransform;
      message.mutable_set_transform()->set_object_name(name);
      for (double& number : asked.transform.m) {
        number = input.ConsumeIntegralInRange(-4, 4);
        message.mutable_set_transform()->add_transform(number);
      }
  }
  return asked;
}

void FuzzEditUpload(FuzzedDataProvider& input) {
  std::vector<v1::UpdateSceneRequest> messages(1);
  messages[0].mutable_header()->set_name("scenes/box");
  messages[0].mutable_header()->set_base_revision(1);
  std::vector<Asked> asked(input.ConsumeIntegralInRange<size_t>(1, 4));
  for (size_t e = 0; e < asked.size(); ++e) {
    asked[e] = AskForEdit(input, "object" + std::to_string(e), &messages);
  }
  const bool disturbed = Disturb(input, &messages);

  SceneEditUpload upload{Limits()};
  const bool taken = Send(messages, &upload);
  const absl::StatusOr<std::vector<SceneEdit>> edits = upload.Finish();
  Require(taken || !edits.ok());
  Require(disturbed || edits.ok());
  if (!edits.ok()) return;
  uint64_t held = 0, triangles = 0;
  for (const SceneEdit& edit : *edits) {
    held += HeldBy(edit.object);
    triangles += edit.object.indices.size() / 3;
  }
  Require(held <= Charged<SceneEditUpload>(messages));
  Require(triangles == upload.added_triangles());
  if (disturbed) return;
  Require(edits->size() == asked.size());
  for (size_t e = 0; e < asked.size(); ++e) {
    const SceneEdit& edit = (*edits)[e];
    Require(edit.kind == asked[e].kind && edit.object.name == asked[e].name);
    Require(Holds(edit.object, asked[e].mesh));
    if (edit.kind == SceneEdit::Kind::kSetTransform) {
      Require(edit.object.transform.m == asked[e].transform.m);
    }
  }
}

void FuzzPointUpload(FuzzedDataProvider& input) {
  const size_t count = input.ConsumeIntegralInRange<size_t>(1, 40);
  const bool normals = input.ConsumeBool(), sources = input.ConsumeBool();
  std::vector<v1::CreatePointSetRequest> messages(1);
  messages[0].mutable_header()->set_parent("scenes/box");
  messages[0].mutable_header()->mutable_upload()->set_point_count(count);
  for (size_t sent = 0; sent < count;) {
    const size_t more = std::min(count - sent, input.ConsumeIntegralInRange<size_t>(1, 8));
    v1::PointArrays* const chunk = messages.emplace_back().mutable_chunk();
    chunk->set_points(Pack(std::vector<double>(3 * more, 0.5)));
    if (normals) chunk->set_normals(Pack(std::vector<double>(3 * more, 1.0)));
    if (sources) {
      chunk->set_source_objects(Pack(std::vector<uint32_t>(more, 0xFFFFFFFF)));
      chunk->set_source_triangles(Pack(std::vector<uint32_t>(more, 0)));
    }
    sent += more;
  }
  const bool disturbed = Disturb(input, &messages);

  PointUpload upload{Limits()};
  const bool taken = Send(messages, &upload);
  const absl::StatusOr<DecodedPoints> points = upload.Finish();
  Require(taken || !points.ok());
  if (points.ok()) {
    const uint64_t held = (points->positions.size() + points->normals.size()) * sizeof(Vec3d) +
                          (points->objects.size() + points->triangles.size()) * sizeof(uint32_t);
    Require(held <= Charged<PointUpload>(messages));
  }
  if (!disturbed) Require(points.ok() && points->positions.size() == count);
  if (points.ok() && !upload.header()->camera.has_value()) {
    Require(points->positions.size() == upload.header()->point_count);
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  FuzzedDataProvider input(data, size);
  switch (input.ConsumeIntegralInRange(0, 2)) {
    case 0:
      FuzzMeshUpload(input);
      break;
    case 1:
      FuzzEditUpload(input);
      break;
    default:
      FuzzPointUpload(input);
  }
  return 0;
}

}  // namespace sightline

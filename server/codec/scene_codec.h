// SPDX-License-Identifier: Apache-2.0
//
// Scenes, their reports and their objects to the wire, and build presets and culling from it.
//
// Thread safety: functions only.
//
//   EncodeScene(view, response);
#ifndef SIGHTLINE_SERVER_CODEC_SCENE_CODEC_H_
#define SIGHTLINE_SERVER_CODEC_SCENE_CODEC_H_

#include <optional>

#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "core/accel/bvh_builder.h"
#include "core/mesh/object.h"
#include "core/scene/scene.h"
#include "google/protobuf/duration.pb.h"
#include "google/protobuf/timestamp.pb.h"
#include "server/scenes/scene_catalog.h"
#include "sightline/v1/scene_service.pb.h"

namespace sightline {

void EncodeTime(absl::Time time, google::protobuf::Timestamp* out);
void EncodeDuration(absl::Duration duration, google::protobuf::Duration* out);

void EncodeScene(const SceneView& view, v1::Scene* out);
void EncodeStoredScene(const StoredScene& scene, v1::StoredScene* out);
void EncodeObject(const Scene& scene, uint32_t index, v1::SceneObject* out);

absl::StatusOr<Culling> DecodeCulling(v1::Culling culling);
// Nullopt for unspecified.
absl::StatusOr<std::optional<BvhPreset>> DecodePreset(v1::BuildPreset preset);
// InvalidArgument naming the field that is out of range.
absl::StatusOr<KdBuildOptions> DecodeKdTree(const v1::KdTreeOptions& options);
absl::StatusOr<BinaryBvhOptions> DecodeBinaryBvh(const v1::BinaryBvhOptions& options);

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_CODEC_SCENE_CODEC_H_

// SPDX-License-Identifier: Apache-2.0
//
// Vectors, boxes, cameras, lights and triangle references between the wire and core.
//
// Errors are INVALID_ARGUMENT naming the field and its value, or RESOURCE_EXHAUSTED naming the
// limit. Lights that are not finite are no errors: their samples are marked invalid.
//
// Thread safety: functions only.
//
//   SL_ASSIGN_OR_RETURN(Camera camera, DecodeCamera(header, limits));
#ifndef SIGHTLINE_SERVER_CODEC_GEOMETRY_CODEC_H_
#define SIGHTLINE_SERVER_CODEC_GEOMETRY_CODEC_H_

#include <google/protobuf/repeated_ptr_field.h>

#include <cstdint>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "core/geometry/affine.h"
#include "core/geometry/box3.h"
#include "core/geometry/camera.h"
#include "core/geometry/vec3.h"
#include "core/light/light.h"
#include "core/mesh/scene_geometry.h"
#include "core/query/mirrors.h"
#include "server/base/limits.h"
#include "sightline/v1/geometry.pb.h"

namespace sightline {

Vec3d DecodeVector(const v1::Vector3& vector);
void EncodeVector(Vec3d vector, v1::Vector3* out);
void EncodeBox(const Box3d& box, v1::Box3* out);

// Twelve numbers, or none for the identity.
absl::StatusOr<Affine3d> DecodeTransform(absl::string_view field,
                                         const google::protobuf::RepeatedField<double>& numbers);

absl::StatusOr<Camera> DecodeCamera(const v1::Camera& camera, const Limits& limits);

// The global id of a triangle of `geometry`; `field` is what an error names.
absl::StatusOr<uint32_t> DecodeTriangle(absl::string_view field, uint32_t object, uint32_t triangle,
                                        const SceneGeometry& geometry);

// The mirrors of a stream, for a revision of a scene; those whose plane is not given are judged by
// core/query/mirrors.h. NotFound (OBJECT_NOT_FOUND): the revision has no such object.
absl::StatusOr<std::vector<Mirror>> DecodeMirrors(
    const google::protobuf::RepeatedPtrField<v1::Mirror>& mirrors, absl::string_view scene_id,
    const SceneGeometry& geometry);

// Light samples, and each one's share of its light's weight.
struct SampleSet {
  std::vector<LightSample> samples;
  std::vector<double> weights;
};

// ResourceExhausted (LIMIT_EXCEEDED) for more than max_lights.
absl::Status CheckLightCount(uint64_t lights, const Limits& limits);

// What can be said of lights without a scene: the kinds are set, the counts within the limits.
// Returns the number of samples.
absl::StatusOr<uint64_t> CheckLights(const google::protobuf::RepeatedPtrField<v1::Light>& lights,
                                     const Limits& limits);

// REQUIRES: CheckLights(lights) was OK.
absl::StatusOr<SampleSet> DecodeLights(const google::protobuf::RepeatedPtrField<v1::Light>& lights,
                                       const SceneGeometry& geometry);

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_CODEC_GEOMETRY_CODEC_H_

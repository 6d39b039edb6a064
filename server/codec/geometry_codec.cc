// SPDX-License-Identifier: Apache-2.0
#include "server/codec/geometry_codec.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "core/base/status_macros.h"
#include "server/base/error.h"
#include "server/base/resource_name.h"
#include "server/base/shortened.h"

namespace sightline {
namespace {

std::string LightField(int index, absl::string_view field) {
  return absl::StrCat("lights[", index, "]", field);
}

std::string Describe(Vec3d v) { return absl::StrCat("(", v.x, ", ", v.y, ", ", v.z, ")"); }

Light DecodeLight(const v1::Light& light) {
  Light result;
  switch (light.kind_case()) {
    case v1::Light::kPoint:
      result.kind = Light::Kind::kPoint;
      result.position = DecodeVector(light.point().position());
      break;
    case v1::Light::kDirectional:
      result.kind = Light::Kind::kDirectional;
      result.direction = DecodeVector(light.directional().direction());
      break;
    case v1::Light::kRectangularArea:
      result.kind = Light::Kind::kRectangle;
      result.position = DecodeVector(light.rectangular_area().center());
      result.half_u = DecodeVector(light.rectangular_area().half_u());
      result.half_v = DecodeVector(light.rectangular_area().half_v());
      result.sample_count = light.rectangular_area().sample_count();
      break;
    case v1::Light::KIND_NOT_SET:
      break;
  }
  if (light.has_mask()) result.mask = light.mask();
  if (light.has_weight()) result.weight = light.weight();
  return result;
}

}  // namespace

Vec3d DecodeVector(const v1::Vector3& vector) { return {vector.x(), vector.y(), vector.z()}; }

void EncodeVector(Vec3d vector, v1::Vector3* out) {
  out->set_x(vector.x);
  out->set_y(vector.y);
  out->set_z(vector.z);
}

void EncodeBox(const Box3d& box, v1::Box3* out) {
  EncodeVector(box.lo, out->mutable_min());
  EncodeVector(box.hi, out->mutable_max());
}

absl::StatusOr<Affine3d> DecodeTransform(absl::string_view field,
                                         const google::protobuf::RepeatedField<double>& numbers) {
  Affine3d transform;
  if (numbers.empty()) return transform;
  if (numbers.size() != 12) {
    return InvalidField(field, absl::StrCat(numbers.size(), " numbers"),
                        "must be 12 numbers (three rows of a 3 by 4 matrix) or none",
                        v1::ERROR_REASON_BAD_ARRAY_LENGTH);
  }
  for (int i = 0; i < 12; ++i) {
    if (!std::isfinite(numbers[i])) {
      return InvalidField(absl::StrCat(field, "[", i, "]"), numbers[i], "must be finite");
    }
    transform.m[i] = numbers[i];
  }
  return transform;
}

absl::StatusOr<Camera> DecodeCamera(const v1::Camera& camera, const Limits& limits) {
  for (const auto& [name, present] :
       {std::pair("camera.eye", camera.has_eye()), std::pair("camera.right", camera.has_right()),
        std::pair("camera.up", camera.has_up()),
        std::pair("camera.forward", camera.has_forward())}) {
    if (!present) return InvalidField(name, "(unset)", "is required");
  }
  Camera result{.eye = DecodeVector(camera.eye()),
                .right = DecodeVector(camera.right()),
                .up = DecodeVector(camera.up()),
                .forward = DecodeVector(camera.forward()),
                .tan_half_fov_y = camera.tan_half_fov_y(),
                .width = camera.width(),
                .height = camera.height()};
  if (result.width == 0) return InvalidField("camera.width", result.width, "must be at least 1");
  if (result.height == 0) return InvalidField("camera.height", result.height, "must be at least 1");
  if (result.width > limits.max_image_width) {
    return OverLimit("camera.width", result.width, "max_image_width", limits.max_image_width,
                     "make the image narrower, or cut it into several cameras' images");
  }
  if (result.height > limits.max_image_height) {
    return OverLimit("camera.height", result.height, "max_image_height", limits.max_image_height,
                     "make the image lower, or cut it into several cameras' images");
  }
  if (!(MaxAbs(result.eye) <= kMaxCoordinate)) {
    return InvalidField("camera.eye", Describe(result.eye), "must be finite and within 2^40");
  }
  // What is left is the basis, whose vectors are judged together, and the field of view.
  SL_RETURN_IF_ERROR(WithReason(
      ValidateCamera(result), v1::ERROR_REASON_INVALID_FIELD,
      {{"field", "camera"},
       {"value",
        absl::StrCat("right ", Describe(result.right), ", up ", Describe(result.up), ", forward ",
                     Describe(result.forward), ", tan_half_fov_y ", result.tan_half_fov_y)}}));
  return result;
}

absl::StatusOr<std::vector<Mirror>> DecodeMirrors(
    const google::protobuf::RepeatedPtrField<v1::Mirror>& mirrors, absl::string_view scene_id,
    const SceneGeometry& geometry) {
  std::vector<Mirror> result;
  for (int i = 0; i < mirrors.size(); ++i) {
    const v1::Mirror& mirror = mirrors[i];
    const std::string field = absl::StrCat("header.mirrors[", i, "]");
    const auto object = std::find_if(
        geometry.objects.begin(), geometry.objects.end(),
        [&](const ObjectRecord& record) { return record.name == mirror.object_name(); });
    if (object == geometry.objects.end()) {
      return WithReason(absl::NotFoundError(absl::StrCat(field, ".object_name = \"",
                                                         Shortened(mirror.object_name(), 200),
                                                         "\": the scene has no such object")),
                        v1::ERROR_REASON_OBJECT_NOT_FOUND,
                        {{"resource", SceneName(scene_id)},
                         {"field", absl::StrCat(field, ".object_name")},
                         {"value", mirror.object_name()}});
    }
    Mirror decoded = {.object = static_cast<uint32_t>(object - geometry.objects.begin())};
    if (mirror.has_plane()) {
      for (const auto& [name, present] :
           {std::pair(".plane.point", mirror.plane().has_point()),
            std::pair(".plane.normal", mirror.plane().has_normal())}) {
        if (!present) return InvalidField(absl::StrCat(field, name), "(unset)", "is required");
      }
      decoded.plane =
          MirrorPlane{DecodeVector(mirror.plane().point()), DecodeVector(mirror.plane().normal())};
    }
    result.push_back(decoded);
  }
  return result;
}

absl::StatusOr<uint32_t> DecodeTriangle(absl::string_view field, uint32_t object, uint32_t triangle,
                                        const SceneGeometry& geometry) {
  if (object >= geometry.objects.size()) {
    return InvalidField(absl::StrCat(field, ".object"), object,
                        absl::StrCat("the revision has ", geometry.objects.size(), " objects"));
  }
  const ObjectRecord& record = geometry.objects[object];
  if (triangle >= record.triangle_count) {
    return InvalidField(
        absl::StrCat(field, ".triangle"), triangle,
        absl::StrCat("object ", object, " has ", record.triangle_count, " triangles"));
  }
  return record.first_triangle + triangle;
}

absl::Status CheckLightCount(uint64_t lights, const Limits& limits) {
  if (lights <= limits.max_lights) return absl::OkStatus();
  return OverLimit("lights", lights, "max_lights", limits.max_lights,
                   "spread the lights over several streams");
}

absl::StatusOr<uint64_t> CheckLights(const google::protobuf::RepeatedPtrField<v1::Light>& lights,
                                     const Limits& limits) {
  SL_RETURN_IF_ERROR(CheckLightCount(static_cast<uint64_t>(lights.size()), limits));
  uint64_t total = 0;
  for (int i = 0; i < lights.size(); ++i) {
    const v1::Light& light = lights[i];
    if (light.kind_case() == v1::Light::KIND_NOT_SET) {
      return InvalidField(LightField(i, ".kind"), "(unset)",
                          "must be point, directional or rectangular_area");
    }
    if (light.has_weight() && !std::isfinite(light.weight())) {
      return InvalidField(LightField(i, ".weight"), light.weight(), "must be finite");
    }
    uint64_t samples = 1;
    if (light.has_rectangular_area()) {
      samples = light.rectangular_area().sample_count();
      const std::string field = LightField(i, ".rectangular_area.sample_count");
      if (samples == 0) return InvalidField(field, samples, "must be at least 1");
      if (samples > limits.max_samples_per_light) {
        return OverLimit(field, samples, "max_samples_per_light", limits.max_samples_per_light,
                         "take fewer samples of it, or cut the light into several");
      }
    }
    total += samples;
  }
  if (total > limits.max_light_samples) {
    return OverLimit("light samples", total, "max_light_samples", limits.max_light_samples,
                     "take fewer samples, or spread the lights over several streams");
  }
  return total;
}

absl::StatusOr<SampleSet> DecodeLights(const google::protobuf::RepeatedPtrField<v1::Light>& lights,
                                       const SceneGeometry& geometry) {
  SampleSet result;
  for (int i = 0; i < lights.size(); ++i) {
    Light light = DecodeLight(lights[i]);
    if (lights[i].has_source()) {
      SL_ASSIGN_OR_RETURN(light.source_triangle,
                          DecodeTriangle(LightField(i, ".source"), lights[i].source().object(),
                                         lights[i].source().triangle(), geometry));
    }
    // CheckLights has looked at everything but the most samples that the engine takes.
    SL_RETURN_IF_ERROR(WithReason(AppendSamples(light, i, geometry.origin, &result.samples),
                                  v1::ERROR_REASON_INVALID_FIELD,
                                  {{"field", LightField(i, ".rectangular_area.sample_count")},
                                   {"value", absl::StrCat(light.sample_count)}}));
    // One share per sample, rounded once; the engine adds those of the samples that reach a point.
    result.weights.resize(result.samples.size(), light.weight / light.sample_count);
  }
  return result;
}

}  // namespace sightline

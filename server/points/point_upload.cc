// SPDX-License-Identifier: Apache-2.0
#include "server/points/point_upload.h"

#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "core/base/status_macros.h"
#include "server/base/error.h"
#include "server/base/resource_name.h"
#include "server/codec/geometry_codec.h"

namespace sightline {

uint64_t PointUpload::BytesOf(const v1::CreatePointSetRequest& message) {
  if (message.has_header()) return message.header().ByteSizeLong();
  const v1::PointArrays& chunk = message.chunk();
  return chunk.points().size() + chunk.normals().size() + chunk.source_objects().size() +
         chunk.source_triangles().size();
}

absl::Status PointUpload::Add(const v1::CreatePointSetRequest& message) {
  if (failure_.ok()) failure_ = AddPart(message);
  return failure_;
}

absl::Status PointUpload::AddPart(const v1::CreatePointSetRequest& message) {
  using Request = v1::CreatePointSetRequest;
  switch (message.part_case()) {
    case Request::PART_NOT_SET:
      return BadSequence("part", "is required");
    case Request::kHeader:
      if (header_.has_value()) return BadSequence("header", "comes once");
      return AddHeader(message.header());
    case Request::kChunk:
      break;
  }
  if (!header_.has_value()) return BadSequence("header", "must be the first message");
  if (header_->camera.has_value()) return BadSequence("chunk", "a camera's points have no upload");
  const uint64_t count = points_.positions.size() + message.chunk().points().size() / sizeof(Vec3d);
  if (count > header_->point_count) {
    return BadSequence(
        "chunk.points",
        absl::StrCat(count, " points have arrived, the header announced ", header_->point_count));
  }
  return AppendPoints("chunk", message.chunk(), &points_);
}

absl::Status PointUpload::AddHeader(const v1::CreatePointSetHeader& header) {
  PointSetHeader result;
  SL_ASSIGN_OR_RETURN(result.scene_id, ParseSceneName("header.parent", header.parent()));
  result.point_set_id = header.point_set_id();
  if (!header.point_set_id().empty()) {
    SL_RETURN_IF_ERROR(CheckId("header.point_set_id", header.point_set_id()));
  }
  result.request_id = header.request_id();
  v1::CreatePointSetHeader identity = header;
  identity.clear_request_id();
  result.fingerprint = FingerprintOf(identity.SerializeAsString());
  if (header.revision() < 0) {
    return InvalidField("header.revision", header.revision(), "must not be negative");
  }
  result.revision = static_cast<uint64_t>(header.revision());
  SL_ASSIGN_OR_RETURN(
      result.lease,
      DecodeDuration("header.lease_duration", header.has_lease_duration(), header.lease_duration(),
                     kDefaultLease, absl::Seconds(limits_.max_lease_seconds)));
  SL_ASSIGN_OR_RETURN(result.options, DecodePointOptions(header.point_options()));
  switch (header.source_case()) {
    case v1::CreatePointSetHeader::kUpload:
      result.point_count = header.upload().point_count();
      if (result.point_count == 0) {
        return InvalidField("header.upload.point_count", 0, "must be at least 1");
      }
      break;
    case v1::CreatePointSetHeader::kCamera: {
      SL_ASSIGN_OR_RETURN(result.camera, DecodeCamera(header.camera().camera(), limits_));
      SL_ASSIGN_OR_RETURN(const DecodedOptions options, DecodeOptions(header.camera().options()));
      result.camera_options = options.query;
      result.point_count = uint64_t{result.camera->width} * result.camera->height;
      break;
    }
    case v1::CreatePointSetHeader::SOURCE_NOT_SET:
      return InvalidField("header.source", "(unset)", "must be upload or camera");
  }
  if (result.point_count > limits_.max_points_per_set) {
    return OverLimit("points", result.point_count, "max_points_per_set", limits_.max_points_per_set,
                     "split them into several point sets");
  }
  header_ = std::move(result);
  return absl::OkStatus();
}

absl::StatusOr<DecodedPoints> PointUpload::Finish() {
  if (!failure_.ok()) return failure_;
  if (!header_.has_value()) return BadSequence("header", "the stream ended without one");
  if (!header_->camera.has_value() && points_.positions.size() != header_->point_count) {
    return BadSequence("chunk", absl::StrCat("the stream ended after ", points_.positions.size(),
                                             " of ", header_->point_count, " points"));
  }
  return std::move(points_);
}

}  // namespace sightline

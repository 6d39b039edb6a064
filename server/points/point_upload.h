// SPDX-License-Identifier: Apache-2.0
//
// The upload state machine of PointSetService: messages in, a header and decoded points out. No
// gRPC in it.
//
// Invariants and thread safety: as SceneUpload.
//
//   PointUpload upload(limits);
//   for (message : stream) SL_RETURN_IF_ERROR(upload.Add(message));
//   SL_ASSIGN_OR_RETURN(DecodedPoints points, upload.Finish());
#ifndef SIGHTLINE_SERVER_POINTS_POINT_UPLOAD_H_
#define SIGHTLINE_SERVER_POINTS_POINT_UPLOAD_H_

#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "core/geometry/camera.h"
#include "core/query/options.h"
#include "core/query/points.h"
#include "server/base/limits.h"
#include "server/base/request_log.h"
#include "server/codec/query_codec.h"
#include "sightline/v1/point_set_service.pb.h"

namespace sightline {

inline constexpr absl::Duration kDefaultLease = absl::Minutes(10);

// What CreatePointSet's header asks for.
struct PointSetHeader {
  std::string scene_id, point_set_id;  // point_set_id empty: to be made up.
  std::string request_id;
  Fingerprint fingerprint{};
  uint64_t revision = 0;
  absl::Duration lease = kDefaultLease;
  PointOptions options;
  uint64_t point_count = 0;      // Of an upload, or the camera's pixels.
  std::optional<Camera> camera;  // Set for points taken from a camera.
  QueryOptions camera_options;
};

class PointUpload {
 public:
  explicit PointUpload(const Limits& limits) : limits_(limits) {}

  // What an upload will hold of a message; 0 for one that brings nothing.
  static uint64_t BytesOf(const v1::CreatePointSetRequest& message);
  absl::Status Add(const v1::CreatePointSetRequest& message);
  const std::optional<PointSetHeader>& header() const { return header_; }
  // The points; none for a camera.
  absl::StatusOr<DecodedPoints> Finish();

 private:
  absl::Status AddPart(const v1::CreatePointSetRequest& message);
  absl::Status AddHeader(const v1::CreatePointSetHeader& header);

  const Limits limits_;
  absl::Status failure_;
  std::optional<PointSetHeader> header_;
  DecodedPoints points_;
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_POINTS_POINT_UPLOAD_H_

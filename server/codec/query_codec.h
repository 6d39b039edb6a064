// SPDX-License-Identifier: Apache-2.0
//
// What queries are asked with, between the wire and core: options, wanted outputs, points,
// segments.
//
// Errors are INVALID_ARGUMENT naming the field and its value.
//
// Thread safety: functions only.
//
//   SL_ASSIGN_OR_RETURN(DecodedOptions options, DecodeOptions(header.stream().options()));
#ifndef SIGHTLINE_SERVER_CODEC_QUERY_CODEC_H_
#define SIGHTLINE_SERVER_CODEC_QUERY_CODEC_H_

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"
#include "core/geometry/vec3.h"
#include "core/query/options.h"
#include "core/query/points.h"
#include "core/scene/scene.h"
#include "google/protobuf/duration.pb.h"
#include "server/codec/wire_array.h"
#include "sightline/v1/query_options.pb.h"
#include "sightline/v1/visibility_service.pb.h"

namespace sightline {

struct DecodedOptions {
  QueryOptions query;  // Without a cancel token.
  bool statistics = false;
};

absl::StatusOr<DecodedOptions> DecodeOptions(const v1::QueryOptions& options);
v1::Strategy EncodeStrategy(Strategy strategy);
// Those that this server has, AUTO first.
std::vector<Strategy> AvailableStrategies();
// CheckOptions of core/query, with the reason: FailedPrecondition (STRUCTURE_UNAVAILABLE),
// InvalidArgument.
absl::Status CheckSceneOptions(const Scene& scene, const QueryOptions& options);

absl::StatusOr<PointOptions> DecodePointOptions(const v1::PointOptions& options);

// Decoded PointArrays, which PointInput's spans refer to. `objects` and `triangles` are parallel.
struct DecodedPoints {
  std::vector<Vec3d> positions, normals;
  std::vector<uint32_t> objects, triangles;

  // The global ids of the sources. REQUIRES: `geometry` is the revision that they are about.
  absl::StatusOr<std::vector<uint32_t>> Sources(const SceneGeometry& geometry) const;
};

// The arrays of v1::PointArrays, wherever they are.
struct PointBytes {
  WireArray points, source_objects, source_triangles, normals;
};

// Appends; arrays that one call leaves out must be left out by all (an upload's chunks). No point
// at all is an error.
absl::Status AppendPoints(absl::string_view field, const PointBytes& arrays, DecodedPoints* points);
absl::Status AppendPoints(absl::string_view field, const v1::PointArrays& arrays,
                          DecodedPoints* points);

// Bytes of a segment in v1::SegmentItem's two forms.
inline constexpr size_t kSegmentBytes = sizeof(std::array<Vec3d, 2>);
inline constexpr size_t kStoredSegmentBytes = sizeof(std::array<Vec3f, 2>);

// Whether so many bytes of either form are segments at all, before any is decoded: of one form.
absl::Status CheckSegments(size_t bytes, size_t stored_bytes);
absl::Status DecodeSegments(absl::string_view bytes, std::vector<std::array<Vec3d, 2>>* segments);

// A positive duration of at most `most`, or `unset` where there is none.
absl::StatusOr<absl::Duration> DecodeDuration(absl::string_view field, bool present,
                                              const google::protobuf::Duration& duration,
                                              absl::Duration unset, absl::Duration most);

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_CODEC_QUERY_CODEC_H_

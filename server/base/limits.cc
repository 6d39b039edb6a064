// SPDX-License-Identifier: Apache-2.0
#include "server/base/limits.h"

#include "absl/strings/str_cat.h"
#include "core/mesh/scene_geometry.h"

namespace sightline {
namespace {

constexpr uint64_t kMany = uint64_t{1} << 40;
// gRPC's own bound on messages and streams is an int.
constexpr uint64_t kInt = 0x7FFFFFFF;

constexpr LimitEntry kTable[] = {
    {"max_message_bytes", &Limits::max_message_bytes, 1 << 16, kInt, "longest message read, bytes"},
    {"target_reply_bytes", &Limits::target_reply_bytes, 1 << 10, kInt,
     "replies are cut to about this size, bytes"},
    {"max_concurrent_streams", &Limits::max_concurrent_streams, 1, kInt,
     "calls at once on one connection"},
    {"stream_credit_rays", &Limits::stream_credit_rays, 1, kMany,
     "rays a visibility stream may have unanswered"},
    {"min_item_cost_rays", &Limits::min_item_cost_rays, 1, kMany, "least cost of an item, rays"},
    {"max_item_rays", &Limits::max_item_rays, 1, kMany, "most rays of one item"},
    {"max_queued_rays", &Limits::max_queued_rays, 1, kMany, "unanswered rays of all streams"},
    {"max_lights", &Limits::max_lights, 1, 1 << 24, "lights of one stream"},
    {"max_samples_per_light", &Limits::max_samples_per_light, 1, 1 << 16,
     "samples of one area light"},
    {"max_light_samples", &Limits::max_light_samples, 1, 1 << 24, "light samples of one stream"},
    {"max_image_width", &Limits::max_image_width, 1, 1 << 16, "columns of a camera's image"},
    {"max_image_height", &Limits::max_image_height, 1, 1 << 16, "rows of a camera's image"},
    {"max_scenes", &Limits::max_scenes, 1, 1 << 20, "scenes at once"},
    {"max_objects_per_scene", &Limits::max_objects_per_scene, 1, 1 << 24, "objects of one scene"},
    {"max_triangles_per_scene", &Limits::max_triangles_per_scene, 1, kMaxGeometryItems,
     "triangles of one scene"},
    {"max_vertices_per_scene", &Limits::max_vertices_per_scene, 3, kMaxGeometryItems,
     "vertices of one scene"},
    {"max_scene_bytes", &Limits::max_scene_bytes, 1 << 20, kMany, "memory for scenes, bytes"},
    {"max_points_per_set", &Limits::max_points_per_set, 1, kMany, "points of one point set"},
    {"max_point_sets", &Limits::max_point_sets, 1, 1 << 20, "point sets at once"},
    {"max_point_set_bytes", &Limits::max_point_set_bytes, 1 << 10, kMany,
     "memory for point sets, bytes"},
    {"max_lease_seconds", &Limits::max_lease_seconds, 1, 366 * 86400,
     "longest lease of a point set"},
    {"max_pin_seconds", &Limits::max_pin_seconds, 1, 366 * 86400,
     "longest time a stream keeps an exact revision"},
    {"max_concurrent_uploads", &Limits::max_concurrent_uploads, 1, 1 << 16, "uploads at once"},
    {"max_queued_rays_per_client", &Limits::max_queued_rays_per_client, 1, kMany,
     "unanswered rays of one client"},
    {"max_bytes_per_scene", &Limits::max_bytes_per_scene, 1 << 20, kMany,
     "memory for one revision of a scene, bytes"},
    {"max_connections", &Limits::max_connections, 1, 1 << 20, "connections at once"},
    {"max_connections_per_address", &Limits::max_connections_per_address, 1, 1 << 20,
     "TCP connections at once from one address"},
    {"max_concurrent_uploads_per_client", &Limits::max_concurrent_uploads_per_client, 1, 1 << 16,
     "uploads at once of one client, unless its role has a limit"},
    {"max_streams_per_client", &Limits::max_streams_per_client, 1, kInt,
     "streams at once of one client, watched scenes among them, unless its role has a limit"},
    {"max_upload_idle_seconds", &Limits::max_upload_idle_seconds, 1, 86400,
     "how long an upload may wait for a message that brings something, seconds"},
    {"max_stream_stall_seconds", &Limits::max_stream_stall_seconds, 1, 86400,
     "how long a visibility stream, or a watch of a scene, may wait for its client to take a "
     "reply, a stream also to grant credit for one, seconds"},
};

}  // namespace

std::span<const LimitEntry> LimitTable() { return kTable; }

absl::Status ValidateLimits(const Limits& limits) {
  for (const LimitEntry& entry : kTable) {
    const uint64_t value = limits.*entry.value;
    if (value < entry.least || value > entry.most) {
      return absl::InvalidArgumentError(
          absl::StrCat(entry.name, " = ", value, " is outside ", entry.least, " .. ", entry.most));
    }
  }
  return absl::OkStatus();
}

}  // namespace sightline

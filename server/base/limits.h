// SPDX-License-Identifier: Apache-2.0
//
// How far a server goes: the one table behind GetCapabilities, the flags and every
// RESOURCE_EXHAUSTED.
//
// Invariant: the names in LimitTable() are the field names of sightline.v1.Limits, so that an error
// names what GetCapabilities publishes (a test compares them).
//
// Thread safety: plain values.
//
//   Limits limits;
//   limits.max_scenes = 10;
//   absl::Status status = ValidateLimits(limits);
#ifndef SIGHTLINE_SERVER_BASE_LIMITS_H_
#define SIGHTLINE_SERVER_BASE_LIMITS_H_

#include <cstdint>
#include <span>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"

namespace sightline {

struct Limits {
  uint64_t max_message_bytes = 4 << 20;
  uint64_t target_reply_bytes = 1 << 20;
  uint64_t max_concurrent_streams = 100;
  // Holds about 0.2 s of work of two threads; inline points of that many rays take 100 to 235 MB.
  uint64_t stream_credit_rays = 4 << 20;
  // Bounds the items of one stream to 4,096 and makes tiny items pay for their bookkeeping.
  uint64_t min_item_cost_rays = 1 << 10;
  uint64_t max_item_rays = 64 << 20;
  uint64_t max_queued_rays = 256 << 20;
  uint64_t max_lights = 16384;
  uint64_t max_samples_per_light = 65536;
  uint64_t max_light_samples = 65536;
  uint64_t max_image_width = 65536;
  uint64_t max_image_height = 65536;
  uint64_t max_scenes = 1000;
  uint64_t max_objects_per_scene = 1'000'000;
  uint64_t max_triangles_per_scene = 200'000'000;
  uint64_t max_vertices_per_scene = 600'000'000;
  uint64_t max_scene_bytes = 8ull << 30;
  uint64_t max_points_per_set = 64 << 20;
  uint64_t max_point_sets = 1000;
  uint64_t max_point_set_bytes = 2ull << 30;
  uint64_t max_lease_seconds = 24 * 3600;
  uint64_t max_pin_seconds = 3600;
  uint64_t max_concurrent_uploads = 16;
  // Half of all: one client alone never fills the queue.
  uint64_t max_queued_rays_per_client = 128 << 20;
  uint64_t max_bytes_per_scene = 8ull << 30;
  uint64_t max_connections = 1000;
  // Half of all, as for rays: one address alone never takes every connection or upload.
  uint64_t max_connections_per_address = 500;
  uint64_t max_concurrent_uploads_per_client = 8;
  // As many as ten connections carry by default, and far more than any client here has needed.
  uint64_t max_streams_per_client = 1000;
  // A client that reads a large mesh between two messages is done well within a minute.
  uint64_t max_upload_idle_seconds = 60;
  // A reply of target_reply_bytes goes out in it at 140 kbit/s.
  uint64_t max_stream_stall_seconds = 60;
};

// One row of the table: which limit, and what it may be set to.
struct LimitEntry {
  absl::string_view name;  // As in sightline.v1.Limits; durations with `_seconds`.
  uint64_t Limits::*value;
  uint64_t least, most;
  absl::string_view help;
};

std::span<const LimitEntry> LimitTable();

// InvalidArgument naming the limit, its value and its range.
absl::Status ValidateLimits(const Limits& limits);

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_BASE_LIMITS_H_

#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
#
# Writes corpus/requests, the seeds of fuzz_request_decoders, and corpus/calls, those of fuzz_plain_calls: good
# calls of each kind, encoded by protoc. Run it again when the wire changes.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")"
protos="../../proto"
out="corpus/requests"
calls="corpus/calls"
rm -rf "$out" "$calls"
mkdir -p "$out" "$calls"

# begin NAME DIGIT: starts a seed. add TYPE TEXT: appends one message of it behind its length.
begin() {
  seed="$out/$1"
  printf '%s' "$2" >"$seed"
}
add() {
  local body size
  body="$(mktemp)"
  printf '%s' "$2" | protoc -I "$protos" --encode="sightline.v1.$1" sightline/v1/scene_service.proto \
    sightline/v1/point_set_service.proto sightline/v1/visibility_service.proto >"$body"
  size=$(stat -c %s "$body")
  # shellcheck disable=SC2059
  printf "\\x$(printf %02x $((size % 256)))\\x$(printf %02x $((size / 256)))" >>"$seed"
  cat "$body" >>"$seed"
  rm "$body"
}

# call NAME LETTER TYPE TEXT: a seed of fuzz_plain_calls.
call() {
  printf '%s' "$2" >"$calls/$1"
  printf '%s' "$4" | protoc -I "$protos" --encode="sightline.v1.$3" sightline/v1/scene_service.proto \
    sightline/v1/point_set_service.proto sightline/v1/capability_service.proto >>"$calls/$1"
}

# Doubles, little-endian, as protoc's text format takes bytes: 0, 1, 2, 0.5.
d0='\000\000\000\000\000\000\000\000'
d1='\000\000\000\000\000\000\360\077'
d2='\000\000\000\000\000\000\000\100'
dh='\000\000\000\000\000\000\340\077'
# Floats: 0, 1, 2.
f0='\000\000\000\000'
f1='\000\000\200\077'
f2='\000\000\000\100'
triangle="vertices_f64: '$d0$d0$d0$d1$d0$d0$d0$d1$d0' indices: '\\000\\000\\000\\000\\001\\000\\000\\000\\002\\000\\000\\000'"
stream="stream { scene: 'scenes/box' options { strategy: STRATEGY_AUTO statistics: true } }"
point_light="lights { point { position { x: 0.5 y: 0.5 z: 1.5 } } weight: 0.5 }"
sun="lights { directional { direction { x: 0.3 y: 0.9 z: 0.2 } } mask: 3 }"
area="lights { rectangular_area { center { z: 2 } half_u { x: 0.2 } half_v { y: 0.2 } sample_count: 4 } }"
camera="camera { eye { x: 0.5 y: -2 z: 0.5 } right { x: 1 } up { z: 1 } forward { y: 1 } tan_half_fov_y: 0.5 width: 32 height: 16 }"
all_shadows="lit_bits: true lit_counts: true weighted_sums: true first_blockers: true"

begin create_upload 0
add CreateSceneRequest "header { scene_id: 'a' request_id: 'r' origin { x: 1 } upload { object_count: 1 triangle_count: 1 vertex_count: 3 } }"
add CreateSceneRequest "object { object_name: 'o' vertex_count: 3 triangle_count: 1 transform: [1, 0, 0, 5, 0, 1, 0, 0, 0, 0, 1, 0] mask: 7 dynamic: true }"
add CreateSceneRequest "chunk { $triangle }"

begin create_builtin 0
add CreateSceneRequest "header { builtin { spec: 'builtin:box:300' } }"

begin update 1
add UpdateSceneRequest "header { name: 'scenes/box' request_id: 'r' base_revision: 1 }"
add UpdateSceneRequest "add_object { object_name: 'new' vertex_count: 3 triangle_count: 1 }"
add UpdateSceneRequest "chunk { $triangle }"
add UpdateSceneRequest "set_transform { object_name: 'o' transform: [1, 0, 0, 5, 0, 1, 0, 0, 0, 0, 1, 0] }"
add UpdateSceneRequest "remove_object { object_name: 'o' }"

begin points_upload 2
add CreatePointSetRequest "header { parent: 'scenes/box' point_set_id: 'p' request_id: 'r' lease_duration { seconds: 60 } point_options { attach_distance: 0.1 } upload { point_count: 2 } }"
add CreatePointSetRequest "chunk { points: '$d0$d0$d1$d1$d2$dh' source_objects: '\\000\\000\\000\\000\\000\\000\\000\\000' source_triangles: '\\000\\000\\000\\000\\001\\000\\000\\000' }"

begin points_camera 2
add CreatePointSetRequest "header { parent: 'scenes/box' camera { $camera } }"

begin points_attached 2
add CreatePointSetRequest "header { parent: 'scenes/box' point_options { attach_distance: 0.75 normal_offset: 0.125 } upload { point_count: 2 } }"
add CreatePointSetRequest "chunk { points: '$dh$dh$dh$dh$d0$d1' normals: '$d0$d0$d1$d0$d0$d1' }"

begin points_camera_options 2
add CreatePointSetRequest "header { parent: 'scenes/box' revision: 1 camera { $camera options { strategy: STRATEGY_PACKET mask: 5 statistics: true packet_side: 8 leaf_culling { side_planes: true ray_box: true } } } }"

begin tiles 3
add TraceTilesRequest "header { $stream $camera $point_light $sun $area outputs { hit_bits: true object_ids: true triangle_ids: true depths: true barycentrics: true } shadow_outputs { $all_shadows } }"
add TraceTilesRequest "item { item { item_id: 1 timeout { seconds: 1 } priority: 2 } width: 16 height: 8 }"
add TraceTilesRequest "item { item { item_id: 2 } x: 16 y: 8 width: 16 height: 8 }"

begin shadows 4
add ComputeShadowsRequest "header { $stream $point_light $sun $area point_options { attach_distance: 0.1 normal_offset: 0.001 } outputs { $all_shadows } t_min: 0.001 }"
add ComputeShadowsRequest "item { item { item_id: 1 } points { points: '$d0$d0$d1$d1$d2$dh' normals: '$d0$d0$d1$d0$d0$d1' } }"
add ComputeShadowsRequest "item { item { item_id: 2 } point_set_range { point_set: 'scenes/box/pointSets/p' offset: 1 count: 2 } }"

begin segments 5
add TestSegmentsRequest "header { $stream outputs { } }"
add TestSegmentsRequest "item { item { item_id: 1 } segments: '$d0$d0$d0$d1$d1$d1$d2$d2$d2$dh$dh$dh' }"

begin segments_stored 5
add TestSegmentsRequest "header { $stream outputs { blocked_bits: true first_blockers: true } origin { } }"
add TestSegmentsRequest "item { item { item_id: 1 } segments_f32: '$f0$f0$f0$f1$f1$f2' }"
add TestSegmentsRequest "item { item { item_id: 2 } segments_f32: '$f0$f1$f2$f1$f0$f0' segments: '$d0$d0$d0$d1$d1$d1' }"

box="name: 'scenes/box'"
points="name: 'scenes/box/pointSets/points'"
call get_scene a GetSceneRequest "$box"
call get_scene_none a GetSceneRequest "name: 'scenes/none'"
call list_scenes b ListScenesRequest "page_size: 1 page_token: '~a'"
call list_scene_objects c ListSceneObjectsRequest "parent: 'scenes/box' page_size: 1 page_token: 'i1'"
call delete_scene d DeleteSceneRequest "$box"
call load_scene e LoadSceneRequest "$box"
call load_scene_none e LoadSceneRequest "name: 'scenes/none'"
call unload_scene f UnloadSceneRequest "$box"
call reload_scene g ReloadSceneRequest "$box"
call list_stored_scenes h ListStoredScenesRequest "page_size: 2 page_token: '~a'"
call watch_scene i WatchSceneRequest "$box wait_for_scene: true"
call get_point_set j GetPointSetRequest "$points"
call list_point_sets k ListPointSetsRequest "parent: 'scenes/box' page_size: 1 page_token: '~a'"
call delete_point_set l DeletePointSetRequest "$points"
call renew_lease m RenewLeaseRequest "$points lease_duration { seconds: 60 nanos: 5 }"
call renew_lease_negative m RenewLeaseRequest "$points lease_duration { seconds: -1 }"
call get_capabilities n GetCapabilitiesRequest ""
# grpc.health.v1.HealthCheckRequest: field 1, the service's name.
printf 'o\x0a\x0ascenes/box' >"$calls/health"
printf 'o' >"$calls/health_all"

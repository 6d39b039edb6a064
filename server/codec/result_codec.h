// SPDX-License-Identifier: Apache-2.0
//
// Core's results to the wire. Whatever was not asked for stays out of the message.
//
// Thread safety: functions only.
//
//   EncodeTile(*scene, result, wanted, response->mutable_reply()->mutable_tile());
#ifndef SIGHTLINE_SERVER_CODEC_RESULT_CODEC_H_
#define SIGHTLINE_SERVER_CODEC_RESULT_CODEC_H_

#include <cstdint>
#include <span>
#include <string>

#include "core/light/light.h"
#include "core/mesh/scene_geometry.h"
#include "core/query/options.h"
#include "core/query/segments.h"
#include "core/query/shadows.h"
#include "core/query/tiles.h"
#include "sightline/v1/query_options.pb.h"
#include "sightline/v1/visibility_service.pb.h"

namespace sightline {

// The wanted outputs with their defaults filled in.
v1::TileOutputs WantedTile(const v1::TileOutputs& outputs, bool lights);
v1::ShadowOutputs WantedShadows(const v1::ShadowOutputs& outputs);
v1::SegmentOutputs WantedSegments(const v1::SegmentOutputs& outputs);
ShadowOutputs DecodeShadowOutputs(const v1::ShadowOutputs& wanted);

// The longest a result of n elements can get, in bytes.
uint64_t TileBytes(const v1::TileOutputs& wanted, uint64_t n);
uint64_t ShadowBytes(const v1::ShadowOutputs& wanted, uint64_t n, uint64_t samples);
uint64_t SegmentBytes(const v1::SegmentOutputs& wanted, uint64_t n);

// Global ids as parallel arrays of object and triangle within it; kNoTriangle in both for none.
void EncodeTriangles(const SceneGeometry& geometry, std::span<const uint32_t> ids,
                     std::string* objects, std::string* triangles);

// One bit per byte of `flags`, least significant first.
void EncodeBits(std::span<const uint8_t> flags, std::string* bits);

void EncodeTile(const SceneGeometry& geometry, const TileResult& result,
                const v1::TileOutputs& wanted, v1::TileResult* out);

// Shadows of n points. `valid` is one byte per point.
void EncodeShadows(const SceneGeometry& geometry, const ShadowResult& result,
                   std::span<const uint8_t> valid, std::span<const LightSample> samples,
                   const v1::ShadowOutputs& wanted, v1::ShadowResult* out);

void EncodeSegments(const SceneGeometry& geometry, const SegmentResult& result,
                    std::span<const uint8_t> valid, const v1::SegmentOutputs& wanted,
                    v1::SegmentResult* out);

void EncodeStatistics(const QueryStats& stats, uint64_t queue_nanos, v1::Statistics* out);

// Shadows of points that are not lit, have no blocker, and count nothing.
ShadowResult NothingLit(size_t points, size_t samples, const ShadowOutputs& outputs);

// Puts shadows computed for some of `points` points (the hits of a tile, a part of them in another
// order) where they belong: point i of `some` at places[i] of `all`. Statistics stay.
void SpreadShadows(const ShadowResult& some, std::span<const uint32_t> places, size_t points,
                   size_t samples, const ShadowOutputs& outputs, ShadowResult* all);

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_CODEC_RESULT_CODEC_H_

// SPDX-License-Identifier: Apache-2.0
//
// Core's results to the wire. Whatever was not asked for stays out of the message; what was is
// taken out of the result, since large arrays travel from where they were computed.
//
// Thread safety: functions only.
//
//   const WireMessage tile = EncodeTile(scene->geometry, std::move(result), wanted);
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
#include "server/codec/wire_message.h"
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

// A v1::TileResult.
WireMessage EncodeTile(const SceneGeometry& geometry, TileResult result,
                       const v1::TileOutputs& wanted);

// A v1::ShadowResult of n points. `valid` is one byte per point.
WireMessage EncodeShadows(const SceneGeometry& geometry, ShadowResult result,
                          std::span<const uint8_t> valid, std::span<const LightSample> samples,
                          const v1::ShadowOutputs& wanted);

// A v1::SegmentResult.
WireMessage EncodeSegments(const SceneGeometry& geometry, SegmentResult result,
                           std::span<const uint8_t> valid, const v1::SegmentOutputs& wanted);

void EncodeStatistics(const QueryStats& stats, uint64_t queue_nanos, v1::Statistics* out);

// Shadows of points that are not lit, have no blocker, and count nothing.
ShadowResult NothingLit(size_t points, size_t samples, const ShadowOutputs& outputs);

// Puts shadows computed for some of `points` points (the hits of a tile, a part of them in another
// order) where they belong: point i of `some` at places[i] of `all`, or nowhere (kNoPixel).
// Statistics stay.
void SpreadShadows(const ShadowResult& some, std::span<const uint32_t> places, size_t points,
                   size_t samples, const ShadowOutputs& outputs, ShadowResult* all);

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_CODEC_RESULT_CODEC_H_

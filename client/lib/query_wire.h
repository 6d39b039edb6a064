// SPDX-License-Identifier: Apache-2.0
//
// Queries as the messages that open a stream, and an item's replies as arrays: what Client is made
// of, for callers that keep streams open and pace the items themselves (sightline-load). The
// replies of an item must be all of it, in any order, all OK; arrays that do not have the length
// that is due are INTERNAL errors: a server's mistake.
//
// Thread safety: free functions.
//
//   v1::TestSegmentsRequest first;
//   *first.mutable_header() = SegmentsHeader(query, /*revision=*/0);
//   stream->Write(first);
//   ...
//   absl::StatusOr<Segments> answer = DecodeSegments(query, 0, 16, std::move(replies));
#ifndef SIGHTLINE_CLIENT_LIB_QUERY_WIRE_H_
#define SIGHTLINE_CLIENT_LIB_QUERY_WIRE_H_

#include <cstdint>
#include <vector>

#include "absl/status/statusor.h"
#include "client/lib/types.h"
#include "sightline/v1/visibility_service.pb.h"

namespace sightline::client {

// `revision` 0: each item sees the one that is current when it comes.
v1::TraceTilesHeader TilesHeader(const TileQuery& query, int64_t revision);
v1::ComputeShadowsHeader ShadowsHeader(const ShadowQuery& query, int64_t revision);
v1::TestSegmentsHeader SegmentsHeader(const SegmentQuery& query, int64_t revision);

// All but the id.
void FillTileItem(const TileRect& rect, v1::TileItem* item);
// `count` points from `begin` on, of the query's set or of its arrays.
void FillShadowItem(const ShadowQuery& query, uint64_t begin, uint64_t count, v1::ShadowItem* item);
void FillSegmentItem(const SegmentQuery& query, uint64_t begin, uint64_t count,
                     v1::SegmentItem* item);

absl::StatusOr<Tile> DecodeTile(const TileQuery& query, size_t index, const TileRect& rect,
                                std::vector<v1::TileReply> replies);
absl::StatusOr<Shadows> DecodeShadows(const ShadowQuery& query, uint64_t begin, uint64_t n,
                                      std::vector<v1::ShadowReply> replies);
absl::StatusOr<Segments> DecodeSegments(const SegmentQuery& query, uint64_t begin, uint64_t n,
                                        std::vector<v1::SegmentReply> replies);

}  // namespace sightline::client

#endif  // SIGHTLINE_CLIENT_LIB_QUERY_WIRE_H_

// SPDX-License-Identifier: Apache-2.0
#include "server/codec/result_codec.h"

#include <algorithm>
#include <bit>
#include <limits>
#include <utility>
#include <vector>

#include "server/codec/packed_array.h"
#include "server/codec/query_codec.h"

namespace sightline {
namespace {

// The wire has core's numbers.
static_assert(static_cast<int>(AnsweredBy::kNoRay) == v1::ANSWERED_BY_UNSPECIFIED);
static_assert(static_cast<int>(AnsweredBy::kShaft) == v1::ANSWERED_BY_SHAFT);
static_assert(static_cast<int>(AnsweredBy::kTriangles) == v1::ANSWERED_BY_TRIANGLES);
static_assert(static_cast<int>(AnsweredBy::kPacket) == v1::ANSWERED_BY_PACKET);
static_assert(static_cast<int>(AnsweredBy::kRay) == v1::ANSWERED_BY_RAY);

uint64_t BitBytes(uint64_t n) { return (n + 7) / 8; }

bool AllSet(std::span<const uint8_t> flags) {
  return std::all_of(flags.begin(), flags.end(), [](uint8_t flag) { return flag != 0; });
}

// The numbers of the samples that are not valid, and nothing else.
v1::ShadowResult InvalidSamples(std::span<const LightSample> samples) {
  v1::ShadowResult invalid;
  for (size_t s = 0; s < samples.size(); ++s) {
    if (!samples[s].valid) invalid.add_invalid_samples(static_cast<uint32_t>(s));
  }
  return invalid;
}

// An array of numbers, handed over.
template <typename Array>
void Add(int field, Array values, WireMessage* out) {
  out->AddArray(field, WireArray(std::move(values)));
}

void AddValid(int field, std::span<const uint8_t> valid, WireMessage* out) {
  if (AllSet(valid)) return;
  std::string bits;
  EncodeBits(valid, &bits);
  out->AddArray(field, WireArray(std::move(bits)));
}

// Global ids as parallel arrays of object and triangle within it; kNoTriangle in both for none.
// Either may be null.
void SplitTriangles(const SceneGeometry& geometry, std::span<const uint32_t> ids,
                    std::vector<uint32_t>* objects, std::vector<uint32_t>* triangles) {
  if (objects != nullptr) objects->assign(ids.size(), kNoTriangle);
  if (triangles != nullptr) triangles->assign(ids.size(), kNoTriangle);
  // Neighbours mostly see the same object, so the search is rarely needed.
  uint32_t object = 0, first = 1, last = 0;
  for (size_t i = 0; i < ids.size(); ++i) {
    const uint32_t id = ids[i];
    if (id == kNoTriangle) continue;
    if (id < first || id >= last) {
      object = geometry.ObjectOf(id);
      first = geometry.objects[object].first_triangle;
      last = first + geometry.objects[object].triangle_count;
    }
    if (objects != nullptr) (*objects)[i] = object;
    if (triangles != nullptr) (*triangles)[i] = id - first;
  }
}

constexpr int kLeaveOut = 0;  // No field has this number.

void AddTriangles(const SceneGeometry& geometry, std::span<const uint32_t> ids, int object_field,
                  int triangle_field, WireMessage* out) {
  std::vector<uint32_t> objects, triangles;
  SplitTriangles(geometry, ids, object_field == kLeaveOut ? nullptr : &objects,
                 triangle_field == kLeaveOut ? nullptr : &triangles);
  if (object_field != kLeaveOut) Add(object_field, std::move(objects), out);
  if (triangle_field != kLeaveOut) Add(triangle_field, std::move(triangles), out);
}

}  // namespace

v1::TileOutputs WantedTile(const v1::TileOutputs& outputs, bool lights) {
  v1::TileOutputs wanted = outputs;
  const bool any = outputs.hit_bits() || outputs.object_ids() || outputs.triangle_ids() ||
                   outputs.depths() || outputs.barycentrics() || outputs.answered_by() ||
                   outputs.mirror_bits();
  if (!any && !lights) wanted.set_hit_bits(true);
  return wanted;
}

v1::ShadowOutputs WantedShadows(const v1::ShadowOutputs& outputs) {
  v1::ShadowOutputs wanted = outputs;
  const bool any = outputs.lit_bits() || outputs.lit_counts() || outputs.weighted_sums() ||
                   outputs.first_blockers() || outputs.answered_by();
  if (!any) wanted.set_lit_bits(true);
  return wanted;
}

v1::SegmentOutputs WantedSegments(const v1::SegmentOutputs& outputs) {
  v1::SegmentOutputs wanted = outputs;
  if (!outputs.blocked_bits() && !outputs.first_blockers()) wanted.set_blocked_bits(true);
  return wanted;
}

ShadowOutputs DecodeShadowOutputs(const v1::ShadowOutputs& wanted) {
  return {.bits = wanted.lit_bits(),
          .counts = wanted.lit_counts(),
          .weighted_sums = wanted.weighted_sums(),
          .blockers = wanted.first_blockers(),
          .answered_by = wanted.answered_by()};
}

uint64_t TileBytes(const v1::TileOutputs& wanted, uint64_t n) {
  return (wanted.hit_bits() ? BitBytes(n) : 0) + (wanted.object_ids() ? 4 * n : 0) +
         (wanted.triangle_ids() ? 4 * n : 0) + (wanted.depths() ? 4 * n : 0) +
         (wanted.barycentrics() ? 8 * n : 0) + (wanted.answered_by() ? n : 0) +
         (wanted.mirror_bits() ? BitBytes(n) : 0);
}

uint64_t ShadowBytes(const v1::ShadowOutputs& wanted, uint64_t n, uint64_t samples) {
  return BitBytes(n) + 5 * samples +  // The valid bits, and at worst every sample's number.
         (wanted.lit_bits() ? samples * BitBytes(n) : 0) + (wanted.lit_counts() ? 4 * n : 0) +
         (wanted.weighted_sums() ? 8 * n : 0) + (wanted.first_blockers() ? 12 * samples * n : 0) +
         (wanted.answered_by() ? samples * n : 0);
}

uint64_t SegmentBytes(const v1::SegmentOutputs& wanted, uint64_t n) {
  return BitBytes(n) + (wanted.blocked_bits() ? BitBytes(n) : 0) +
         (wanted.first_blockers() ? 12 * n : 0);
}

void EncodeTriangles(const SceneGeometry& geometry, std::span<const uint32_t> ids,
                     std::string* objects, std::string* triangles) {
  std::vector<uint32_t> object_ids, triangle_ids;
  SplitTriangles(geometry, ids, &object_ids, &triangle_ids);
  if (objects != nullptr) EncodeArray(std::span<const uint32_t>(object_ids), objects);
  if (triangles != nullptr) EncodeArray(std::span<const uint32_t>(triangle_ids), triangles);
}

void EncodeBits(std::span<const uint8_t> flags, std::string* bits) {
  bits->assign(BitBytes(flags.size()), '\0');
  for (size_t i = 0; i < flags.size(); ++i) {
    if (flags[i] != 0) (*bits)[i / 8] |= static_cast<char>(1u << (i % 8));
  }
}

WireMessage EncodeTile(const SceneGeometry& geometry, TileResult result,
                       const v1::TileOutputs& wanted) {
  using Field = v1::TileResult;
  WireMessage out;
  if (wanted.hit_bits()) Add(Field::kHitBitsFieldNumber, std::move(result.hit_bits), &out);
  if (wanted.object_ids() || wanted.triangle_ids()) {
    AddTriangles(geometry, result.triangle,
                 wanted.object_ids() ? Field::kObjectIdsFieldNumber : kLeaveOut,
                 wanted.triangle_ids() ? Field::kTriangleIdsFieldNumber : kLeaveOut, &out);
  }
  if (wanted.depths()) Add(Field::kDepthsFieldNumber, std::move(result.depth), &out);
  if (wanted.barycentrics()) {
    Add(Field::kBarycentricUFieldNumber, std::move(result.u), &out);
    Add(Field::kBarycentricVFieldNumber, std::move(result.v), &out);
  }
  if (wanted.answered_by()) Add(Field::kAnsweredByFieldNumber, std::move(result.answered_by), &out);
  if (wanted.mirror_bits()) Add(Field::kMirrorBitsFieldNumber, std::move(result.mirror_bits), &out);
  return out;
}

WireMessage EncodeShadows(const SceneGeometry& geometry, ShadowResult result,
                          std::span<const uint8_t> valid, std::span<const LightSample> samples,
                          const v1::ShadowOutputs& wanted) {
  using Field = v1::ShadowResult;
  WireMessage out;
  if (wanted.lit_bits()) Add(Field::kLitBitsFieldNumber, std::move(result.lit_bits), &out);
  AddValid(Field::kValidBitsFieldNumber, valid, &out);
  out.AddFields(InvalidSamples(samples));
  if (wanted.lit_counts()) Add(Field::kLitCountsFieldNumber, std::move(result.lit_counts), &out);
  if (wanted.weighted_sums()) {
    Add(Field::kWeightedSumsFieldNumber, std::move(result.weighted_sums), &out);
  }
  if (wanted.first_blockers()) {
    AddTriangles(geometry, result.blocker, Field::kBlockerObjectsFieldNumber,
                 Field::kBlockerTrianglesFieldNumber, &out);
    Add(Field::kBlockerDistancesFieldNumber, std::move(result.blocker_t), &out);
  }
  if (wanted.answered_by()) Add(Field::kAnsweredByFieldNumber, std::move(result.answered_by), &out);
  return out;
}

WireMessage EncodeSegments(const SceneGeometry& geometry, SegmentResult result,
                           std::span<const uint8_t> valid, const v1::SegmentOutputs& wanted) {
  using Field = v1::SegmentResult;
  WireMessage out;
  if (wanted.blocked_bits()) {
    Add(Field::kBlockedBitsFieldNumber, std::move(result.blocked_bits), &out);
  }
  AddValid(Field::kValidBitsFieldNumber, valid, &out);
  if (wanted.first_blockers()) {
    AddTriangles(geometry, result.triangle, Field::kBlockerObjectsFieldNumber,
                 Field::kBlockerTrianglesFieldNumber, &out);
    Add(Field::kBlockerDistancesFieldNumber, std::move(result.t), &out);
  }
  return out;
}

void EncodeStatistics(const QueryStats& stats, uint64_t queue_nanos, v1::Statistics* out) {
  out->set_ray_count(stats.rays);
  out->set_node_count(stats.nodes);
  out->set_leaf_count(stats.leaves);
  out->set_triangle_test_count(stats.triangle_tests);
  out->set_double_test_count(stats.doubt_double);
  out->set_exact_test_count(stats.doubt_exact);
  out->set_strategy(EncodeStrategy(stats.strategy));
  out->set_compute_nanos(stats.compute_nanoseconds);
  out->set_queue_nanos(queue_nanos);
  out->set_tile_count(stats.tiles);
  out->set_answered_tile_count(stats.tiles_answered);
  out->set_relevant_triangle_count(stats.relevant_triangles);
  out->set_culled_test_count(stats.culled_tests);
  out->set_shaft_triangle_count(stats.shaft.triangles);
  out->set_shaft_relevant_count(stats.shaft.relevant);
  out->set_shaft_pair_count(stats.shaft.pairs);
  out->set_shaft_cover_count(stats.shaft.covers);
  out->set_shaft_split_count(stats.shaft.splits);
  out->set_shaft_single_count(stats.shaft.singles);
  const auto answered = [&](AnsweredBy by) { return stats.answered_by[static_cast<size_t>(by)]; };
  out->set_shaft_answered_count(answered(AnsweredBy::kShaft));
  out->set_triangles_answered_count(answered(AnsweredBy::kTriangles));
  out->set_packet_answered_count(answered(AnsweredBy::kPacket));
  out->set_ray_answered_count(answered(AnsweredBy::kRay));
}

ShadowResult NothingLit(size_t points, size_t samples, const ShadowOutputs& outputs) {
  ShadowResult result;
  if (outputs.bits) result.lit_bits.assign(samples * BitBytes(points), 0);
  if (outputs.counts) result.lit_counts.assign(points, 0);
  if (outputs.weighted_sums) result.weighted_sums.assign(points, 0.0);
  if (outputs.blockers) {
    result.blocker.assign(samples * points, kNoTriangle);
    result.blocker_t.assign(samples * points, std::numeric_limits<float>::infinity());
  }
  if (outputs.answered_by) result.answered_by.assign(samples * points, AnsweredBy::kNoRay);
  return result;
}

void SpreadShadows(const ShadowResult& some, std::span<const uint32_t> places, size_t points,
                   size_t samples, const ShadowOutputs& outputs, ShadowResult* all) {
  const size_t count = places.size();
  for (size_t s = 0; s < samples && outputs.bits; ++s) {
    const uint8_t* from = some.lit_bits.data() + s * BitBytes(count);
    uint8_t* to = all->lit_bits.data() + s * BitBytes(points);
    for (size_t byte = 0; byte < BitBytes(count); ++byte) {
      for (uint32_t lit = from[byte]; lit != 0; lit &= lit - 1) {
        const uint32_t place = places[8 * byte + static_cast<size_t>(std::countr_zero(lit))];
        if (place == kNoPixel) continue;
        to[place / 8] |= static_cast<uint8_t>(1u << (place % 8));
      }
    }
  }
  // Of `rows` rows, where they are wanted.
  const auto spread = [&](bool wanted, size_t rows, const auto& from, auto* to) {
    for (size_t row = 0; row < rows && wanted; ++row) {
      for (size_t i = 0; i < count; ++i) {
        if (places[i] != kNoPixel) (*to)[row * points + places[i]] = from[row * count + i];
      }
    }
  };
  spread(outputs.counts, 1, some.lit_counts, &all->lit_counts);
  spread(outputs.weighted_sums, 1, some.weighted_sums, &all->weighted_sums);
  spread(outputs.blockers, samples, some.blocker, &all->blocker);
  spread(outputs.blockers, samples, some.blocker_t, &all->blocker_t);
  spread(outputs.answered_by, samples, some.answered_by, &all->answered_by);
}

}  // namespace sightline

// SPDX-License-Identifier: Apache-2.0
//
// What the streamed queries share: headers and items, and the decoding of replies. For the
// library's own files. Arrays that do not have the length that is due are INTERNAL errors: a
// server's mistake.
//
// Thread safety: free functions.
#ifndef SIGHTLINE_CLIENT_LIB_QUERY_SUPPORT_H_
#define SIGHTLINE_CLIENT_LIB_QUERY_SUPPORT_H_

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"
#include "client/lib/client.h"
#include "client/lib/convert.h"
#include "sightline/v1/visibility_service.pb.h"

namespace sightline::client {

inline constexpr uint8_t kInvalid = 255;

inline uint64_t TotalSamples(const std::vector<Light>& lights) {
  uint64_t samples = 0;
  for (const Light& light : lights) samples += light.SampleCount();
  return samples;
}

inline void FillItem(size_t id, const StreamOptions& options, v1::ItemHeader* item) {
  item->set_item_id(id);
  if (options.item_timeout > absl::ZeroDuration()) {
    ToProto(options.item_timeout, item->mutable_timeout());
  }
}

inline void FillHeader(const std::string& scene, int64_t revision, const QueryOptions& options,
                       v1::StreamHeader* header) {
  header->set_scene(scene);
  header->set_revision(revision);
  ToProto(options, header->mutable_options());
}

// Hands the replies of an item to `decode` in order of offset; together they must hold each of the
// `count` elements once.
template <typename Reply, typename Decode>
absl::Status DecodeReplies(std::vector<Reply> replies, uint64_t count, Statistics* statistics,
                           const Decode& decode) {
  std::sort(replies.begin(), replies.end(), [](const Reply& a, const Reply& b) {
    return a.header().offset() < b.header().offset();
  });
  uint64_t done = 0;
  for (const Reply& reply : replies) {
    const v1::ReplyHeader& header = reply.header();
    if (header.offset() != done || header.element_count() > count - done) {
      return absl::InternalError(absl::StrCat("the server's reply holds ", header.element_count(),
                                              " elements from ", header.offset(), " on where ",
                                              count - done, " from ", done, " on are due"));
    }
    if (absl::Status s = decode(reply, done, header.element_count()); !s.ok()) return s;
    done += header.element_count();
    if (header.has_statistics()) *statistics = FromProto(header.statistics());
  }
  if (done == count) return absl::OkStatus();
  return absl::InternalError(
      absl::StrCat("the server answered ", done, " of ", count, " elements of an item"));
}

// Bits [rows, count] into columns begin .. of [rows, total], as 1 or 0.
inline absl::Status DecodeBits(absl::string_view bits, absl::string_view field, uint64_t rows,
                               uint64_t begin, uint64_t count, uint64_t total,
                               std::vector<uint8_t>* out) {
  const BitRows bit(bits, count);
  if (absl::Status s = bit.Check(rows, field); !s.ok()) return s;
  for (uint64_t r = 0; r < rows; ++r) {
    for (uint64_t i = 0; i < count; ++i) (*out)[r * total + begin + i] = bit(r, i) ? 1 : 0;
  }
  return absl::OkStatus();
}

// Bits [count], or none for "all of them", into elements begin ...
inline absl::Status DecodeValid(absl::string_view bits, uint64_t begin, uint64_t count,
                                std::vector<uint8_t>* out) {
  if (!bits.empty()) return DecodeBits(bits, "valid_bits", 1, begin, count, out->size(), out);
  std::fill_n(out->begin() + static_cast<ptrdiff_t>(begin), count, uint8_t{1});
  return absl::OkStatus();
}

// Lit bits with what is not valid set to kInvalid. `valid` receives the points' own validity.
inline absl::Status DecodeLit(const v1::ShadowResult& result, uint64_t samples, uint64_t begin,
                              uint64_t count, uint64_t total, std::vector<uint8_t>* lit,
                              std::vector<uint8_t>* valid) {
  absl::Status s = DecodeBits(result.lit_bits(), "lit_bits", samples, begin, count, total, lit);
  s.Update(DecodeValid(result.valid_bits(), begin, count, valid));
  if (!s.ok()) return s;
  for (uint64_t r = 0; r < samples; ++r) {
    for (uint64_t i = begin; i < begin + count; ++i) {
      if ((*valid)[i] == 0) (*lit)[r * total + i] = kInvalid;
    }
  }
  for (uint32_t r : result.invalid_samples()) {
    if (r >= samples) {
      return absl::InternalError(
          absl::StrCat("the server's reply names sample ", r, " of ", samples));
    }
    std::fill_n(lit->begin() + static_cast<ptrdiff_t>(r * total + begin), count, kInvalid);
  }
  return absl::OkStatus();
}

// [rows, count] numbers into columns begin .. of [rows, total].
template <typename T>
absl::Status DecodeRows(absl::string_view bytes, absl::string_view field, uint64_t rows,
                        uint64_t begin, uint64_t count, uint64_t total, std::vector<T>* out) {
  if (bytes.size() != rows * count * sizeof(T)) {
    return Unpack<T>(bytes, rows * count, field, nullptr);
  }
  for (uint64_t r = 0; r < rows; ++r) {
    absl::Status s = Unpack<T>(bytes.substr(r * count * sizeof(T), count * sizeof(T)), count, field,
                               out->data() + r * total + begin);
    if (!s.ok()) return s;
  }
  return absl::OkStatus();
}

// Copies columns of a part, [rows, part], into [rows, total] at `begin`.
template <typename T>
void Place(const std::vector<T>& part, uint64_t rows, uint64_t begin, uint64_t total,
           std::vector<T>* out) {
  if (part.empty()) return;
  const uint64_t columns = part.size() / rows;
  for (uint64_t r = 0; r < rows; ++r) {
    std::copy_n(part.begin() + static_cast<ptrdiff_t>(r * columns), columns,
                out->begin() + static_cast<ptrdiff_t>(r * total + begin));
  }
}

// First blockers, [rows, n] in Shadows and Segments alike.
template <typename Part>
void ResizeBlockers(uint64_t size, Part* out) {
  out->blocker_object.resize(size);
  out->blocker_triangle.resize(size);
  out->blocker_distance.resize(size);
}

template <typename Result, typename Part>
absl::Status DecodeBlockers(const Result& result, uint64_t rows, uint64_t begin, uint64_t count,
                            uint64_t total, Part* out) {
  absl::Status s = DecodeRows(result.blocker_objects(), "blocker_objects", rows, begin, count,
                              total, &out->blocker_object);
  s.Update(DecodeRows(result.blocker_triangles(), "blocker_triangles", rows, begin, count, total,
                      &out->blocker_triangle));
  s.Update(DecodeRows(result.blocker_distances(), "blocker_distances", rows, begin, count, total,
                      &out->blocker_distance));
  return s;
}

template <typename Part>
void PlaceBlockers(const Part& part, uint64_t rows, uint64_t total, Part* all) {
  Place(part.blocker_object, rows, part.offset, total, &all->blocker_object);
  Place(part.blocker_triangle, rows, part.offset, total, &all->blocker_triangle);
  Place(part.blocker_distance, rows, part.offset, total, &all->blocker_distance);
}

inline absl::Status CheckLights(const std::vector<Light>& lights, const Limits& limits) {
  const uint64_t samples = TotalSamples(lights);
  if (limits.max_light_samples != 0 && samples > limits.max_light_samples) {
    return absl::ResourceExhaustedError(
        absl::StrCat("the lights have ", samples, " samples; max_light_samples is ",
                     limits.max_light_samples, ": give fewer lights, or fewer samples of them"));
  }
  return absl::OkStatus();
}

}  // namespace sightline::client

#endif  // SIGHTLINE_CLIENT_LIB_QUERY_SUPPORT_H_

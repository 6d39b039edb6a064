// SPDX-License-Identifier: Apache-2.0
#include "client/load/server_answers.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "core/base/check.h"
#include "core/base/status_macros.h"

namespace sightline::load {
namespace {

// Rays times triangles up to which brute force is asked for: two or three seconds of two cores that
// test 0.22 billion a second each (an EPYC, Zen 3, AVX2, beside other work; builtin:box).
constexpr double kMostTests = 1e9;

// The rows of every `stride`-th item, one after the other. `width`: numbers of a row.
std::vector<double> Gather(std::span<const double> rows, size_t width, uint32_t each, size_t items,
                           size_t stride) {
  std::vector<double> gathered;
  const size_t length = width * each;
  for (size_t i = 0; i < items; i += stride) {
    const std::span<const double> item = rows.subspan(i * length, length);
    gathered.insert(gathered.end(), item.begin(), item.end());
  }
  return gathered;
}

// Elements of an image; points and segments are one row.
struct Block {
  uint64_t x = 0, y = 0, width = 0, height = 0;
  uint64_t size() const { return width * height; }
};

Block BlockOf(const client::TileRect& rect) { return {rect.x, rect.y, rect.width, rect.height}; }
Block BlockOf(uint64_t begin, uint64_t count) { return {begin, 0, count, 1}; }

// Copies what [planes, elements of `from`] and [planes, elements of `to`] have in common.
template <typename T>
void PlaceRows(const std::vector<T>& part, const Block& from, const Block& to,
               std::vector<T>* out) {
  const uint64_t planes = part.size() / from.size();
  out->resize(planes * to.size());
  const uint64_t left = std::max(from.x, to.x), top = std::max(from.y, to.y);
  const uint64_t right = std::min(from.x + from.width, to.x + to.width);
  const uint64_t bottom = std::min(from.y + from.height, to.y + to.height);
  SIGHTLINE_CHECK(left < right && top < bottom)
      << from.x << ' ' << from.y << ' ' << to.x << ' ' << to.y;
  const auto at = [left](const Block& block, uint64_t plane, uint64_t y) {
    return static_cast<ptrdiff_t>((plane * block.height + y - block.y) * block.width + left -
                                  block.x);
  };
  for (uint64_t plane = 0; plane < planes; ++plane) {
    for (uint64_t y = top; y < bottom; ++y) {
      std::copy_n(part.begin() + at(from, plane, y), right - left, out->begin() + at(to, plane, y));
    }
  }
}

// The client library cuts a query as the server's limits and its own messages want it: what comes
// at once, `part` of the elements `from`, may be of several items, `to` being one of them.
void PlacePart(const Answer& part, const Block& from, const Block& to, Answer* item) {
  PlaceRows(part.flags, from, to, &item->flags);
  PlaceRows(part.objects, from, to, &item->objects);
  PlaceRows(part.triangles, from, to, &item->triangles);
  PlaceRows(part.distances, from, to, &item->distances);
}

// The same for items that are `each` elements of a row, of which the part has `count` from `begin`
// on.
void PlacePart(const Answer& part, uint64_t begin, uint64_t count, uint32_t each,
               std::vector<Answer>* items) {
  SIGHTLINE_CHECK(count > 0 && begin + count <= items->size() * each) << begin << ' ' << count;
  for (uint64_t i = begin / each; i <= (begin + count - 1) / each; ++i) {
    PlacePart(part, BlockOf(begin, count), BlockOf(i * each, each), &(*items)[i]);
  }
}

// Images are asked for whole: the client library knows no others.
absl::Status AskTiles(const client::Client& client, const Workload& workload,
                      const client::QueryOptions& options, size_t stride,
                      const client::StreamOptions& stream, std::vector<Answer>* answers) {
  const std::vector<client::TileQuery>& cameras = workload.tile_queries();
  const size_t tiles = workload.ItemCount(Kind::kTiles) / cameras.size();
  for (size_t i = 0; i < cameras.size(); ++i) {
    client::TileQuery query = cameras[i];
    query.options = options;
    const uint32_t side = query.tile_size;
    const size_t columns = (size_t{query.camera.width} + side - 1) / side;
    const auto take = [&](client::Tile tile) {
      const client::TileRect part = tile.rect;
      const Answer answer = ToAnswer(std::move(tile));
      for (size_t row = part.y / side; row <= (part.y + part.height - 1) / side; ++row) {
        for (size_t column = part.x / side; column <= (part.x + part.width - 1) / side; ++column) {
          const size_t item = i * tiles + row * columns + column;
          if (item % stride != 0) continue;
          SIGHTLINE_CHECK(item / stride < answers->size()) << item;
          PlacePart(answer, BlockOf(part), BlockOf(workload.tile(item).rect),
                    &(*answers)[item / stride]);
        }
      }
      return absl::OkStatus();
    };
    SL_RETURN_IF_ERROR(client.TraceTiles(query, take, stream).status());
  }
  return absl::OkStatus();
}

absl::Status AskPoints(const client::Client& client, const Workload& workload,
                       const client::QueryOptions& options, size_t stride,
                       const client::StreamOptions& stream, std::vector<Answer>* answers) {
  client::ShadowQuery query = workload.shadow_query();
  const std::vector<double> points = Gather(query.points.positions, 3, query.points_per_item,
                                            workload.ItemCount(Kind::kPoints), stride);
  query.points = {.positions = points};
  query.point_set.clear();
  query.options = options;
  const auto take = [&](client::Shadows part) {
    const uint64_t begin = part.offset, count = part.points;
    PlacePart(ToAnswer(std::move(part)), begin, count, query.points_per_item, answers);
    return absl::OkStatus();
  };
  return client.ComputeShadows(query, take, stream).status();
}

absl::Status AskSegments(const client::Client& client, const Workload& workload,
                         const client::QueryOptions& options, size_t stride,
                         const client::StreamOptions& stream, std::vector<Answer>* answers) {
  client::SegmentQuery query = workload.segment_query();
  const std::vector<double> segments = Gather(query.segments, 6, query.segments_per_item,
                                              workload.ItemCount(Kind::kSegments), stride);
  query.segments = segments;
  query.options = options;
  const auto take = [&](client::Segments part) {
    const uint64_t begin = part.offset, count = part.segments;
    PlacePart(ToAnswer(std::move(part)), begin, count, query.segments_per_item, answers);
    return absl::OkStatus();
  };
  return client.TestSegments(query, take, stream).status();
}

}  // namespace

client::Strategy StrategyFor(const Workload& workload, uint64_t triangles) {
  double rays = 0;
  for (size_t k = 0; k < kKinds; ++k) {
    const Kind kind = static_cast<Kind>(k);
    if (workload.StreamCount(kind) == 0) continue;
    for (size_t i = 0; i < workload.ItemCount(kind); ++i) {
      rays += static_cast<double>(workload.Rays({.kind = kind, .item = i}));
    }
  }
  return rays * static_cast<double>(triangles) <= kMostTests ? client::Strategy::kBruteForce
                                                             : client::Strategy::kSingle;
}

const char* NameOf(client::Strategy strategy) {
  const bool brute = strategy == client::Strategy::kBruteForce;
  SIGHTLINE_CHECK(brute || strategy == client::Strategy::kSingle) << static_cast<int>(strategy);
  return brute ? "BRUTE_FORCE" : "SINGLE";
}

absl::StatusOr<Answers> ServerAnswers(const client::Client& client, const Workload& workload,
                                      int64_t revision, client::Strategy strategy, size_t stride,
                                      const client::StreamOptions& stream) {
  const client::QueryOptions options{.revision = revision, .strategy = strategy};
  constexpr decltype(&AskTiles) kAsk[kKinds] = {&AskTiles, &AskPoints, &AskSegments};
  Answers answers;
  for (size_t k = 0; k < kKinds; ++k) {
    const Kind kind = static_cast<Kind>(k);
    if (workload.StreamCount(kind) == 0) continue;
    answers[k].resize((workload.ItemCount(kind) + stride - 1) / stride);
    SL_RETURN_IF_ERROR(kAsk[k](client, workload, options, stride, stream, &answers[k]));
  }
  return answers;
}

}  // namespace sightline::load

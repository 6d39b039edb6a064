// SPDX-License-Identifier: Apache-2.0
#include "client/load/server_answers.h"

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

// Images are asked for whole: the client library knows no others.
absl::Status AskTiles(const client::Client& client, const Workload& workload,
                      const client::QueryOptions& options, size_t stride,
                      const client::StreamOptions& stream, std::vector<Answer>* answers) {
  const std::vector<client::TileQuery>& cameras = workload.tile_queries();
  const size_t tiles = workload.ItemCount(Kind::kTiles) / cameras.size();
  for (size_t i = 0; i < cameras.size(); ++i) {
    client::TileQuery query = cameras[i];
    query.options = options;
    const auto take = [&](client::Tile tile) {
      const size_t item = i * tiles + tile.index;
      if (item % stride == 0) (*answers)[item / stride] = ToAnswer(std::move(tile));
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
  const auto take = [&](client::Shadows shadows) {
    (*answers)[shadows.offset / query.points_per_item] = ToAnswer(std::move(shadows));
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
    (*answers)[part.offset / query.segments_per_item] = ToAnswer(std::move(part));
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

// SPDX-License-Identifier: Apache-2.0
//
// The answer to one item, in one form for every kind of query: what of it must be the same bit for
// bit, however it was asked.
//
//   tiles      flags: lit [samples, pixels]; objects, triangles, distances (depth) of the pixels
//   points     flags: lit [samples, points]
//   segments   flags: blocked; objects, triangles, distances of the first blockers
//
// Thread safety: plain values and functions.
//
//   if (std::string difference = Difference(due, given); !difference.empty()) ...
#ifndef SIGHTLINE_CLIENT_LOAD_ANSWER_H_
#define SIGHTLINE_CLIENT_LOAD_ANSWER_H_

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "client/lib/types.h"
#include "client/load/request.h"

namespace sightline::load {

struct Answer {
  std::vector<uint8_t> flags;
  std::vector<uint32_t> objects, triangles;
  std::vector<float> distances;
};
// By kind and item; empty where nothing was asked for.
using Answers = std::array<std::vector<Answer>, kKinds>;

Answer ToAnswer(client::Tile tile);
Answer ToAnswer(client::Shadows shadows);
Answer ToAnswer(client::Segments segments);

// Where `given` first differs from `due`, and how; empty if every bit is the same.
std::string Difference(const Answer& due, const Answer& given);

}  // namespace sightline::load

#endif  // SIGHTLINE_CLIENT_LOAD_ANSWER_H_

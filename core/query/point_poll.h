// SPDX-License-Identifier: Apache-2.0
//
// A WorkPoll for searches about one point, which may lie near any number of triangles, as many as
// the scene has copies of one. Its work is triangles that are looked at, or what takes as long.
//
// Thread safety: an object belongs to one thread.
//
//   PointPoll poll(cancel);
//   FindTouching(scene, p, radius, skip, &ids, kMost, &poll);
//   if (poll.stopped()) return cancel->ToStatus();  // `ids` are not all of them.
#ifndef SIGHTLINE_CORE_QUERY_POINT_POLL_H_
#define SIGHTLINE_CORE_QUERY_POINT_POLL_H_

#include <cstddef>

#include "core/base/work_poll.h"

namespace sightline {

// A triangle takes 10 to 50 ns (Touches, Blocks): some hundred microseconds.
using PointPoll = WorkPoll<4096>;

// For functions to which a poll may be null.
inline bool Stops(PointPoll* poll, size_t triangles) {
  return poll != nullptr && poll->Stops(triangles);
}

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_POINT_POLL_H_

// SPDX-License-Identifier: Apache-2.0
//
// Which walk AUTO asks next where rays belong together and a shaft would fit them: the shaft's,
// unless shafts have turned out dear, and packets or single rays cheaper, on the blocks of rays
// asked about just before. Shafts cull nothing where neighbours are strangers: points thinly
// scattered over foliage, or triangles smaller than pixels.
//
// Costs are cycles a ray, estimated from what a walk counts (nodes, leaves, tests), not from a
// clock: the same questions are walked alike every time. Answers do not depend on the choice.
// Internal to core/query.
//
// The papers compare such strategies scene by scene (000, section 4; 004, section 4.2: packets
// without coherence fall to single rays); the weights and thresholds are from `sightline-bench
// auto` (core/traverse/DESIGN.md, "What AUTO walks").
//
// Where a light is says much of how far shafts help, so each has a choice of its own, and takes up
// where the light before it left off.
//
// Thread safety: none; belongs to one call.
//
//   WalkChoice choice(WalkChoice::Others::kOneOrigin);
//   for each block of rays:
//     const Strategy walk = choice.Next();
//     const WalkStats before = stats;
//     ... trace the block by `walk`, counting into stats ...
//     choice.Learn(walk, before, stats, rays);
#ifndef SIGHTLINE_CORE_QUERY_WALK_CHOICE_H_
#define SIGHTLINE_CORE_QUERY_WALK_CHOICE_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "core/query/options.h"
#include "core/traverse/trace_ray.h"

namespace sightline {

class WalkChoice {
 public:
  // What there is beside shafts: nothing, as where a strategy was asked for; or packets and single
  // rays, whose costs differ between rays with one origin, for their closest hits or for any, and
  // rays with one direction, for any.
  enum class Others : uint8_t { kNone, kClosest, kOneOrigin, kParallel };

  explicit WalkChoice(Others others) : others_(others) {}

  // kShaft, kPacket or kSingle.
  Strategy Next() const;
  // Whether shafts have lost so often that, for rays of one origin, it does not pay to prepare a
  // cut for the next.
  bool ShaftsAreRare() const;
  // What `rays` rays cost by the walk of `strategy`: the difference of the statistics. Returns that
  // in cycles, about; 0 where there is no choice.
  float Learn(Strategy strategy, const WalkStats& before, const WalkStats& after, size_t rays);

 private:
  enum Walk : uint8_t { kShafts, kPackets, kSingles };
  static constexpr size_t kWalks = 3;

  struct Record {
    float cost = 0;       // Cycles a ray, recent blocks counting more.
    uint32_t blocks = 0;  // That cost is of.
    uint32_t age = 0;     // Blocks since it was taken.
    uint32_t wait = 0;    // Blocks before it is tried again, and how many after the next failure.
    uint32_t next_wait = 0;

    bool known() const { return blocks > 0; }
  };

  // Whether shafts are so dear that it might be cheaper.
  bool WorthATrial(Walk walk) const;
  // The cheapest of those known.
  Walk Best() const;

  const Others others_;
  std::array<Record, kWalks> records_;
};

// A WalkChoice for each of many lights.
class WalkChoices {
 public:
  explicit WalkChoices(WalkChoice::Others others) : untaught_(others) {}

  // That of light number `light`, counted from 0: few numbers go unused. At first it knows what the
  // light asked about before knows. Valid until the next call.
  WalkChoice& Of(uint32_t light);

 private:
  const WalkChoice untaught_;
  std::vector<std::optional<WalkChoice>> choices_;  // By light.
  std::optional<uint32_t> last_;
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_WALK_CHOICE_H_

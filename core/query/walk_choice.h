// SPDX-License-Identifier: Apache-2.0
//
// Which walk AUTO asks next where rays belong together and a shaft would fit them: the shaft's,
// unless shafts are dear, and packets or single rays cheaper. Shafts cull nothing where neighbours
// are strangers: points thinly scattered over foliage, triangles smaller than pixels, or a block of
// pixels that an edge runs through, with points far behind it.
//
// Costs are cycles a ray, estimated from what a walk counts (nodes, leaves, tests), not from a
// clock: the same questions are walked alike every time. What a walk will cost is told from what it
// cost on the blocks before, and a shaft's besides from how large a block is, seen from its light.
// Answers do not depend on the choice. Internal to core/query.
//
// The papers compare such strategies scene by scene (000, section 4; 004, section 4.2: packets
// without coherence fall to single rays); the weights and thresholds are from `sightline-bench
// auto` and from replaying what every block had cost by each walk (core/traverse/DESIGN.md, "What
// AUTO walks").
//
// Where a light is says much of how far shafts help, so each has a choice of its own, and takes up
// where the light before it left off. What was learnt may be handed on to the points that come next
// (ShadowHints).
//
// Thread safety: none; belongs to one call at a time.
//
//   WalkChoice choice(WalkChoice::Others::kOneOrigin);
//   for each block of rays:
//     const float growth = WalkChoice::Growth(extent of the block, squared);
//     const Strategy walk = choice.Next(growth);
//     const WalkStats before = stats;
//     ... trace the block by `walk`, counting into stats ...
//     choice.Learn(walk, before, stats, rays, growth);
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

  Others others() const { return others_; }

  // How much dearer a block's shaft is than that of one with an extent of 1: what Next and Learn
  // are told of a block. Its extent is the diagonal of the box around its points, over their
  // distance to the origin of their rays if they have one. Any unit will do that all blocks share,
  // and any value, NaN among them.
  static float Growth(float squared_extent);

  // kShaft, kPacket or kSingle.
  Strategy Next(float growth) const;
  // Whether no shaft was asked for so long that, for rays of one origin, it does not pay to prepare
  // a cut for the next.
  bool ShaftsAreRare() const;
  // What `rays` rays cost by the walk of `strategy`: the difference of the statistics. Returns that
  // in cycles, about; 0 where there is no choice.
  float Learn(Strategy strategy, const WalkStats& before, const WalkStats& after, size_t rays,
              float growth);

 private:
  enum Walk : uint8_t { kShafts, kPackets, kSingles };
  static constexpr size_t kWalks = 3;

  struct Record {
    float cost = 0;       // Cycles a ray, recent blocks counting more; a shaft's at an extent of 1.
    uint32_t blocks = 0;  // That cost is of.
    uint32_t since = 0;   // Blocks since it was taken.
    uint32_t wait = 0;    // Blocks before it is tried again.

    bool known() const { return blocks > 0; }
  };

  // Whether nothing but a shaft is to be taken for such a block.
  bool ShaftIsCheap(float growth) const;
  // What each will cost a ray of such a block; infinitely much if it should not be taken.
  std::array<float, kWalks> Expected(float growth) const;
  Walk Cheapest(const std::array<float, kWalks>& costs) const;

  Others others_;
  std::array<Record, kWalks> records_;
};

// A WalkChoice for each of many lights.
class WalkChoices {
 public:
  // That of light number `light`, counted from 0: few numbers go unused. At first, or if it had
  // others to choose between so far, it knows what the light asked about before knows, if that has
  // the same. Valid until the next call.
  WalkChoice& Of(uint32_t light, WalkChoice::Others others);

 private:
  std::vector<std::optional<WalkChoice>> choices_;  // By light.
  std::optional<uint32_t> last_;
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_WALK_CHOICE_H_

// SPDX-License-Identifier: Apache-2.0
#include "core/query/walk_choice.h"

#include <algorithm>

namespace sightline {
namespace {

// Cycles by what a walk counts. Thin points lie in no cache, and cost half as much again as
// pictures'. A packet's node is dear, since each child's box is put to vectors of rays; a single
// ray's tests, sixteen at a time, are in its leaf's.
struct Weights {
  float node, leaf, test, ray;
};
// Shafts that cost less a ray than `try_packets` or `try_singles` are not worth comparing: the
// others seldom do.
//
// `first_shafts`: their blocks before another walk is first tried. A trial costs, and one block of
// shafts is nothing to hold it against; but a picture's tile has some sixteen blocks, and all of
// them count. Along one direction packets seldom do much worse, so a trial costs little.
struct Costs {
  Weights of[3];  // By Walk.
  float try_packets, try_singles;
  uint32_t first_shafts;
};
// Those for closest hits were chosen by replaying what every block of some forty rows had cost by
// each walk (core/traverse/DESIGN.md, "What AUTO walks").
constexpr Weights kShaftWeights = {55, 250, 3.4f, 6};
// Those for any hit with one origin are fits, by counts, to what each walk took in all of nine
// scenes' shadows and 64 lights on thin points on a Zen 4, most within a tenth; those with one
// direction lie between such fits (suns and sky) and the ones of before, where AUTO chose best.
constexpr Costs kCosts[] = {
    {},                                                                          // By Others: none,
    {{kShaftWeights, {250, 1050, 2, 10}, {27, 75, 0, 30}}, 150, 350, 4},         // closest hits,
    {{{40, 470, 2.4f, 11}, {840, 150, 2.6f, 6}, {40, 47, 0, 175}}, 80, 420, 4},  // one origin,
    {{{40, 350, 3.3f, 12}, {400, 300, 2.2f, 6}, {24, 60, 0, 90}}, 45, 350, 1}};  // one direction.

// Another walk is taken only if it is so much cheaper: blocks differ, estimates err, and what looks
// cheapest by chance is taken more often.
constexpr float kClearlyCheaper = 0.9f;
// Shafts that cost so many times what makes single rays worth a trial are lost: few pixels over a
// million triangles, whose rays share nothing. Single rays are tried at once then, and first: such
// a picture is over before the usual trials, and packets share no more there.
constexpr float kLost = 16;
// What the last block says of the next, at the least; the rest is said by those before it, and the
// first few are averaged. Little: costs of thin points vary tenfold from block to block, and one
// that happened to be cheap should not win.
constexpr float kNewest = 0.1f;
// How long a walk that has lost is left alone, in blocks: doubled each time.
constexpr uint32_t kFirstWait = 16, kLongestWait = 64;
// Blocks after which what a walk has cost is history. A light's sixteen of one group of points
// follow each other.
constexpr uint32_t kMemory = 16;
// Blocks of fewer rays say little of others.
constexpr size_t kLeastRays = 32;

}  // namespace

bool WalkChoice::WorthATrial(Walk walk) const {
  const Record& shafts = records_[kShafts];
  const Costs& costs = kCosts[static_cast<size_t>(others_)];
  const float dear = walk == kSingles ? costs.try_singles : costs.try_packets;
  return others_ != Others::kNone && shafts.known() && shafts.cost > dear;
}

bool WalkChoice::ShaftsAreRare() const {
  return Best() != kShafts && records_[kShafts].next_wait >= 2 * kFirstWait;
}

WalkChoice::Walk WalkChoice::Best() const {
  Walk best = kShafts;
  float least = records_[kShafts].cost;
  for (const Walk walk : {kPackets, kSingles}) {
    const Record& record = records_[walk];
    if (!record.known() || !WorthATrial(walk) || record.cost >= kClearlyCheaper * least) continue;
    best = walk;
    least = record.cost;
  }
  return best;
}

Strategy WalkChoice::Next() const {
  Walk next = Best();
  if (next != kShafts) {
    // The rays may have come to where shafts do better.
    if (records_[kShafts].wait == 0) next = kShafts;
  } else {
    const Costs& costs = kCosts[static_cast<size_t>(others_)];
    const bool lost = records_[kShafts].cost > kLost * costs.try_singles;
    const std::array<Walk, 2> order = {lost ? kSingles : kPackets, lost ? kPackets : kSingles};
    for (const Walk walk : order) {
      if (!WorthATrial(walk) || records_[walk].wait > 0) continue;
      if (!lost && !records_[walk].known() && records_[kShafts].blocks < costs.first_shafts) {
        continue;
      }
      next = walk;
      break;
    }
  }
  return next == kPackets   ? Strategy::kPacket
         : next == kSingles ? Strategy::kSingle
                            : Strategy::kShaft;
}

float WalkChoice::Learn(Strategy strategy, const WalkStats& before, const WalkStats& after,
                        size_t rays) {
  if (others_ == Others::kNone || rays < kLeastRays) return 0;
  const Walk walk = strategy == Strategy::kPacket   ? kPackets
                    : strategy == Strategy::kSingle ? kSingles
                                                    : kShafts;
  const Weights& weights = kCosts[static_cast<size_t>(others_)].of[walk];
  const float cost =
      (weights.node * static_cast<float>(after.nodes - before.nodes) +
       weights.leaf * static_cast<float>(after.leaves - before.leaves) +
       weights.test * static_cast<float>(after.triangle_tests - before.triangle_tests)) /
          static_cast<float>(rays) +
      weights.ray;
  Record& record = records_[walk];
  if (record.age > kMemory) record.blocks = 0;
  ++record.blocks;
  record.cost += std::max(kNewest, 1.0f / static_cast<float>(record.blocks)) * (cost - record.cost);
  float least = record.cost;
  for (Record& other : records_) {
    ++other.age;
    if (other.wait > 0) --other.wait;
    if (other.known()) least = std::min(least, other.cost);
  }
  record.age = 1;
  const Record& shafts = records_[kShafts];
  const bool gains_nothing =
      walk != kShafts && shafts.known() && record.cost >= kClearlyCheaper * shafts.cost;
  if (gains_nothing || least < kClearlyCheaper * record.cost) {
    record.next_wait =
        record.next_wait == 0 ? kFirstWait : std::min(2 * record.next_wait, kLongestWait);
    record.wait = record.next_wait;
  } else {
    record.next_wait = 0;
  }
  return cost * static_cast<float>(rays);
}

WalkChoice& WalkChoices::Of(uint32_t light) {
  if (light >= choices_.size()) choices_.resize(size_t{light} + 1);
  if (!choices_[light].has_value()) {
    choices_[light].emplace(last_ ? *choices_[*last_] : untaught_);
  }
  last_ = light;
  return *choices_[light];
}

}  // namespace sightline

// SPDX-License-Identifier: Apache-2.0
#include "core/query/walk_choice.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace sightline {
namespace {

// Cycles by what a walk counts. Thin points lie in no cache, and cost half as much again as
// pictures'. A packet's node is dear, since each child's box is put to vectors of rays; a single
// ray's tests, sixteen at a time, are in its leaf's.
struct Weights {
  float node, leaf, test, ray;
};
// Shafts that cost less a ray than `try_packets` or `try_singles` are not worth comparing: the
// others seldom do. Nor are fewer blocks of them than `first_shafts`: of a camera's, packets pay
// least often.
//
// `newest`: what the last shaft says of the next, at the least; the rest is said by those before
// it. Much, since they differ from region to region.
//
// `clearly_cheaper`: another walk is taken only if it costs so much of the cheapest so far. Single
// rays', since what they cost differs most from block to block, and what looks cheapest by chance
// is taken more often; they are the best walk for thin points' sky over the forest, and lose most
// for lights. Packets' with one origin, since the finer a picture is, the less shafts cost of what
// these weights say (pine and Sponza at 4K).
struct Costs {
  Weights of[3];  // By Walk.
  float try_packets, try_singles;
  uint32_t first_shafts;
  float newest;
  float clearly_cheaper[3];  // By Walk.
};
// Those for closest hits were chosen by replaying what every block of some forty rows had cost by
// each walk (core/traverse/DESIGN.md, "What AUTO walks").
constexpr Weights kShaftWeights = {55, 250, 3.4f, 6};
// Those for any hit with one origin are fits, by counts, to what each walk took in all of nine
// scenes' shadows and 64 lights on thin points on a Zen 4, most within a tenth; those with one
// direction lie between such fits (suns and sky) and the ones of before, where AUTO chose best. The
// weights of packets' nodes were lowered by trial on a Xeon, since these became cheaper.
constexpr Costs kCosts[] = {
    {},                                                           // By Others: none,
    {.of = {kShaftWeights, {250, 1050, 2, 10}, {27, 75, 0, 30}},  // closest hits,
     .try_packets = 150,
     .try_singles = 350,
     .first_shafts = 4,
     .newest = 0.1f,
     .clearly_cheaper = {1, 1, 0.6f}},
    {.of = {{40, 470, 2.4f, 11}, {400, 150, 2.6f, 6}, {40, 47, 0, 175}},  // one origin,
     .try_packets = 100,
     .try_singles = 420,
     .first_shafts = 1,
     .newest = 0.3f,
     .clearly_cheaper = {1, 0.8f, 0.6f}},
    {.of = {{40, 350, 3.3f, 12}, {270, 300, 2.2f, 6}, {24, 60, 0, 90}},  // one direction.
     .try_packets = 50,
     .try_singles = 350,
     .first_shafts = 1,
     .newest = 0.3f,
     .clearly_cheaper = {1, 1, 0.8f}}};

// Before it was tried, another walk is taken to cost so much of what a shaft would.
constexpr float kPromise = 0.5f;
// Shafts that cost so many times what makes single rays worth a trial are lost: few pixels over a
// million triangles, whose rays share nothing. Single rays are tried first then: such a picture is
// over before the usual trials, and packets share no more there.
constexpr float kLost = 16;
// What the last block of another walk says of the next. Little: their costs vary tenfold from block
// to block, and one that happened to be cheap should not win.
constexpr float kNewestOther = 1.0f / 64;
// Blocks without a shaft after which the next one says once more as much.
constexpr float kStale = 16;
// Blocks after which a walk that is not the cheapest is tried again: the first and the longest
// wait, doubled each time that it has lost. The dearer it is, the longer: by the square of its cost
// over the cheapest's, up to sixteen times.
constexpr uint32_t kFirstWait = 8, kLongestWait = 64;
constexpr float kMostTimes = 4;
// Blocks of fewer rays say little of others.
constexpr size_t kLeastRays = 32;

constexpr float kNever = std::numeric_limits<float>::infinity();

}  // namespace

float WalkChoice::Growth(float squared_extent) {
  // Shafts' costs were found to grow as the root of the extent (the exponents of 22 sets of blocks
  // lie between 0.24 and 0.74), packets' hardly, single rays' not at all. The bounds are for points
  // all at one place, or at their light.
  constexpr float kLeast = 0x1p-60f, kMost = 0x1p60f;
  return std::sqrt(std::sqrt(squared_extent > kLeast ? std::min(squared_extent, kMost) : kLeast));
}

std::array<float, WalkChoice::kWalks> WalkChoice::Expected(float growth) const {
  const Costs& costs = kCosts[static_cast<size_t>(others_)];
  const float shaft = records_[kShafts].cost * growth;
  std::array<float, kWalks> expected = {shaft, kNever, kNever};
  if (ShaftIsCheap(growth)) return expected;
  const bool lost = shaft > kLost * costs.try_singles;
  if (!lost && records_[kShafts].blocks < costs.first_shafts) return expected;
  const auto of = [&](Walk walk) {
    return records_[walk].known() ? records_[walk].cost : kPromise * shaft;
  };
  if (records_[kPackets].known() || !lost) expected[kPackets] = of(kPackets);
  if (shaft > costs.try_singles) expected[kSingles] = of(kSingles);
  return expected;
}

WalkChoice::Walk WalkChoice::Cheapest(const std::array<float, kWalks>& costs) const {
  const float* const clearly = kCosts[static_cast<size_t>(others_)].clearly_cheaper;
  Walk best = kShafts;
  for (const Walk walk : {kPackets, kSingles}) {
    if (costs[walk] < clearly[walk] * costs[best]) best = walk;
  }
  return best;
}

bool WalkChoice::ShaftsAreRare() const {
  return records_[kShafts].known() && records_[kShafts].since >= kFirstWait;
}

bool WalkChoice::ShaftIsCheap(float growth) const {
  return others_ == Others::kNone || !records_[kShafts].known() ||
         records_[kShafts].cost * growth <= kCosts[static_cast<size_t>(others_)].try_packets;
}

Strategy WalkChoice::Next(float growth) const {
  if (ShaftIsCheap(growth)) return Strategy::kShaft;
  const std::array<float, kWalks> expected = Expected(growth);
  Walk next = Cheapest(expected);
  const float least = expected[next];
  for (const Walk walk : {kShafts, kPackets, kSingles}) {
    const Record& record = records_[walk];
    if (walk == next || !record.known() || expected[walk] == kNever) continue;
    const float times = std::clamp(expected[walk] / least, 1.0f, kMostTimes);
    if (static_cast<float>(record.since) < static_cast<float>(record.wait) * times * times) {
      continue;
    }
    next = walk;
    break;
  }
  return next == kPackets   ? Strategy::kPacket
         : next == kSingles ? Strategy::kSingle
                            : Strategy::kShaft;
}

float WalkChoice::Learn(Strategy strategy, const WalkStats& before, const WalkStats& after,
                        size_t rays, float growth) {
  if (others_ == Others::kNone || rays < kLeastRays) return 0;
  const Walk walk = strategy == Strategy::kPacket   ? kPackets
                    : strategy == Strategy::kSingle ? kSingles
                                                    : kShafts;
  const Costs& costs = kCosts[static_cast<size_t>(others_)];
  const Weights& weights = costs.of[walk];
  const float cost =
      (weights.node * static_cast<float>(after.nodes - before.nodes) +
       weights.leaf * static_cast<float>(after.leaves - before.leaves) +
       weights.test * static_cast<float>(after.triangle_tests - before.triangle_tests)) /
          static_cast<float>(rays) +
      weights.ray;
  Record& record = records_[walk];
  if (!record.known()) {
    record.wait = kFirstWait;
  } else if (walk == kShafts && ShaftIsCheap(growth)) {
    // Nothing else was in question.
  } else if (std::array<float, kWalks> others = Expected(growth); Cheapest(others) != walk) {
    // It was tried again.
    others[walk] = kNever;
    const bool lost = cost > *std::min_element(others.begin(), others.end());
    record.wait = lost ? std::min(2 * record.wait, kLongestWait) : kFirstWait;
  }
  ++record.blocks;
  const float newest = walk == kShafts
                           ? costs.newest * (1 + static_cast<float>(record.since) / kStale)
                           : kNewestOther;
  const float share = std::clamp(newest, 1.0f / static_cast<float>(record.blocks), 1.0f);
  record.cost += share * ((walk == kShafts ? cost / growth : cost) - record.cost);
  for (Record& any : records_) ++any.since;
  record.since = 0;
  return cost * static_cast<float>(rays);
}

WalkChoice& WalkChoices::Of(uint32_t light, WalkChoice::Others others) {
  if (light >= choices_.size()) choices_.resize(size_t{light} + 1);
  std::optional<WalkChoice>& choice = choices_[light];
  if (!choice.has_value() || choice->others() != others) {
    // Choices that were moved from know of no light.
    const WalkChoice* const before =
        last_.has_value() && *last_ < choices_.size() && choices_[*last_].has_value()
            ? &*choices_[*last_]
            : nullptr;
    choice = before != nullptr && before->others() == others ? *before : WalkChoice(others);
  }
  last_ = light;
  return *choice;
}

}  // namespace sightline

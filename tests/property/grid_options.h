// SPDX-License-Identifier: Apache-2.0
//
// The grid of a query's options: every combination of structure, strategy, culling, packet size and
// intersector, and of RTT's own, and which of them have a meaning. Enumerations tell themselves
// what they hold, and a culling option that is not named here does not compile.
//
// Thread safety: pure functions.
//
//   ForEachQuery([&](const QueryOptions& options) { if (HasMeaning(options)) Ask(options); });
#ifndef SIGHTLINE_TESTS_PROPERTY_GRID_OPTIONS_H_
#define SIGHTLINE_TESTS_PROPERTY_GRID_OPTIONS_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "core/query/options.h"
#include "core/traverse/rtt.h"

namespace sightline::testing_support {

// All values of an enumeration that counts from 0 and has names.
template <typename T>
std::vector<T> AllNamed(absl::string_view (*name)(T)) {
  std::vector<T> values;
  for (int i = 0; name(static_cast<T>(i)) != "UNKNOWN"; ++i) values.push_back(static_cast<T>(i));
  return values;
}

template <typename T, size_t kCount, typename Fn>
void ForEachOf(const std::array<T, kCount>& values, T* target, const Fn& fn) {
  for (const T value : values) {
    *target = value;
    fn();
  }
}

template <size_t kCount, typename Fn>
void ForEachSwitching(const std::array<bool*, kCount>& switches, const Fn& fn) {
  for (uint32_t bits = 0; bits < 1u << kCount; ++bits) {
    for (size_t i = 0; i < kCount; ++i) *switches[i] = (bits >> i & 1) != 0;
    fn();
  }
}

// fn(culling) for all that packets, or single rays, go by; what only the other goes by stays off.
template <typename Fn>
void ForEachCulling(Structure structure, Strategy strategy, const Fn& fn) {
  LeafCulling culling = LeafCulling::None();
  // A field that is not named here does not compile.
  auto& [tree, intersector, side_planes, near_far, aperture, aperture_first, skip_edges, frustum,
         first_axis, ray_mask, node_test, split, ray_box, ray_box_min_triangles, ray_box_update,
         mailbox, cell_boxes] = culling;
  static_cast<void>(tree), static_cast<void>(intersector);  // The query's own.
  const std::array<bool*, 7> of_packets = {&side_planes, &near_far,   &aperture, &aperture_first,
                                           &skip_edges,  &first_axis, &ray_mask};
  const std::array<bool*, 3> of_rays = {&ray_box, &ray_box_update, &mailbox};
  const auto call = [&, on_kd_tree = structure == Structure::kKdTree, cells = &cell_boxes] {
    fn(culling);
    if (!on_kd_tree) return;
    *cells = true;
    fn(culling);
    *cells = false;
  };
  if (strategy == Strategy::kPacket) {
    FrustumRays* const rays = &frustum;
    NodeTest* const test = &node_test;
    PacketSplit* const parts = &split;
    ForEachSwitching(of_packets, [&] {
      ForEachOf(kAllFrustumRays, rays, [&] {
        ForEachOf(kAllNodeTests, test, [&] { ForEachOf(kAllPacketSplits, parts, call); });
      });
    });
    return;
  }
  uint32_t* const least = &ray_box_min_triangles;
  ForEachSwitching(of_rays, [&] { ForEachOf(std::array<uint32_t, 3>{0, 3, 1000}, least, call); });
}

// fn(options) for every combination, sensible or not.
template <typename Fn>
void ForEachQuery(const Fn& fn) {
  for (const Structure structure : AllNamed(&StructureName)) {
    for (const Strategy strategy : AllNamed(&StrategyName)) {
      for (const Intersector intersector : AllNamed(&IntersectorName)) {
        QueryOptions options;
        options.structure = structure;
        options.strategy = strategy;
        options.intersector = intersector;
        const bool packets = strategy == Strategy::kPacket;
        for (const int side : kPacketSides) {
          if (!packets && side != kPacketSides[0]) continue;  // Read by packets alone.
          options.packet_side = side;
          options.leaf_culling.reset();
          fn(options);
          if (!packets && strategy != Strategy::kSingle) {
            options.leaf_culling = LeafCulling();
            fn(options);
            continue;
          }
          ForEachCulling(structure, strategy, [&](const LeafCulling& culling) {
            options.leaf_culling = culling;
            fn(options);
          });
        }
        if (strategy != Strategy::kRtt) continue;
        options.leaf_culling.reset();
        for (int n = 1; n <= kMaxRttAntialiasing; ++n) {
          options.rtt_antialiasing = n;
          for (const bool shared : {false, true}) {
            options.rtt_shared_edges = shared;
            for (int tiles = 0; tiles <= kMaxRttSideBySide; ++tiles) {
              options.rtt_side_by_side = tiles;
              fn(options);
            }
          }
        }
      }
    }
  }
}

inline std::string Describe(const QueryOptions& options) {
  std::string text = absl::StrCat(
      StrategyName(options.strategy), " on ", StructureName(options.structure), ", ",
      SimdTargetName(options.simd), ", ", IntersectorName(options.intersector), ", packets of ",
      options.packet_side, ", antialiasing ", options.rtt_antialiasing, ", ",
      options.rtt_side_by_side, " side by side", options.rtt_shared_edges ? ", shared edges" : "");
  if (!options.leaf_culling) return text;
  const LeafCulling& c = *options.leaf_culling;
  for (const bool on :
       {c.side_planes, c.near_far, c.aperture, c.aperture_first, c.skip_edges, c.first_axis,
        c.ray_mask, c.ray_box, c.ray_box_update, c.mailbox, c.cell_boxes}) {
    absl::StrAppend(&text, on ? " 1" : " 0");
  }
  absl::StrAppend(&text, ", frustum ", static_cast<int>(c.frustum), ", nodes ",
                  static_cast<int>(c.node_test), ", split ", static_cast<int>(c.split), ", from ",
                  c.ray_box_min_triangles, " triangles");
  return text;
}

// Whether a scene with a BVH is asked as by another combination, which names it. (Of these alone:
// the others are few.)
inline bool IsTheBvhAgain(const QueryOptions& options) {
  return options.structure == Structure::kAuto && options.strategy == Strategy::kPacket &&
         options.leaf_culling.has_value();
}

// What CheckOptions is to say: the contract, written down a second time.
inline bool HasMeaning(const QueryOptions& options) {
  const bool walks = options.strategy == Strategy::kSingle || options.strategy == Strategy::kPacket;
  if (options.strategy == Strategy::kRtt && options.structure == Structure::kBvh) return false;
  if ((options.strategy == Strategy::kRtt || options.strategy == Strategy::kShaft) &&
      options.structure == Structure::kBinaryBvh) {
    return false;
  }
  if (options.strategy == Strategy::kShaft && options.structure == Structure::kKdTree) return false;
  if (options.leaf_culling && !walks) return false;
  if (options.intersector == Intersector::kHavelHeroutDotProduct &&
      options.strategy == Strategy::kPacket) {
    return false;
  }
  return options.intersector == Intersector::kExact || walks ||
         options.strategy == Strategy::kBruteForce;
}

}  // namespace sightline::testing_support

#endif  // SIGHTLINE_TESTS_PROPERTY_GRID_OPTIONS_H_

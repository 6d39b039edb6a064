// SPDX-License-Identifier: Apache-2.0
//
// Vertices at one position are called by one of their numbers. Most mates stand in one leaf, and
// are paired there. The edges left over are counted, then gathered, by the lesser number of their
// ends; those of one vertex are few, are sorted by the other end, and paired.
#include "core/accel/leaf_mates_finder.h"

#include <algorithm>
#include <atomic>
#include <bit>
#include <cstddef>
#include <cstring>
#include <span>
#include <tuple>
#include <utility>

#include "core/base/parallel.h"
#include "core/mesh/position_hash.h"

namespace sightline {
namespace {

constexpr size_t kGrain = 1 << 11;
constexpr size_t kNodeGrain = 1 << 5;
// Places of a table looked at for a vertex. One that finds none, as where hashes were made to
// collide, keeps its own number, and its edges may miss their mates.
constexpr size_t kMaxProbes = 64;

struct Edge {
  uint32_t to;    // The greater number of its ends.
  uint32_t slot;  // 2 · (3 · place + edge) + whether it runs to the lesser one.

  friend bool operator<(const Edge& a, const Edge& b) {
    return std::tie(a.to, a.slot) < std::tie(b.to, b.slot);
  }
};

struct LeftEdge {
  uint32_t from;  // The lesser number.
  Edge edge;
};

struct LeftBlock {
  size_t begin, end;
};

class Finder {
 public:
  Finder(const Bvh& bvh, const SceneGeometry& geometry, const CancelToken* cancel)
      : bvh_(bvh), geometry_(geometry), cancel_(cancel) {}

  LeafMates Find() {
    // What stays comes first, so that it does not keep apart what is given back.
    DescribeUnits();
    mates_.rows.ResizeUninitialized(3 * kUnitTriangles * mates_.units.size());
    Fill(LeafMate(), &mates_.rows);
    NumberPositions();
    if (Stopped()) return {};
    PairWithinLeaves();
    if (Stopped()) return {};
    GatherEdges();
    if (Stopped()) return {};
    ParallelFor(
        ends_.size(), kGrain,
        [&](size_t begin, size_t end) {
          for (size_t v = begin; v < end; ++v) Pair(v == 0 ? 0 : ends_[v - 1], ends_[v]);
        },
        cancel_);
    return std::move(mates_);
  }

 private:
  bool Stopped() const { return cancel_ != nullptr && cancel_->cancelled(); }

  // number_[v] is the same for all vertices at a position. Which one it is depends on the threads,
  // what is paired in the end does not.
  void NumberPositions() {
    constexpr uint32_t kFree = 0xFFFFFFFFu;
    const std::span<const Vec3f> vertices(geometry_.vertices.data(), geometry_.vertices.size());
    number_.ResizeUninitialized(vertices.size());
    AlignedVector<uint32_t> table;
    table.ResizeUninitialized(size_t{2} << std::bit_width(vertices.size()));
    Fill(kFree, &table);
    const size_t last = table.size() - 1;
    ParallelFor(
        vertices.size(), kGrain,
        [&](size_t begin, size_t end) {
          for (size_t i = begin; i < end; ++i) {
            const auto v = static_cast<uint32_t>(i);
            const Vec3f p = vertices[v];
            const uint64_t hash = HashPosition(p);
            number_[v] = v;
            // Equal to none, and of one hash: they would fill the places that others look for.
            if (!IsFinite(p)) continue;
            for (size_t probe = 0; probe < kMaxProbes; ++probe) {
              std::atomic_ref<uint32_t> place(table[(hash + probe) & last]);
              uint32_t there = place.load(std::memory_order_relaxed);
              if (there == kFree && place.compare_exchange_strong(there, v)) break;
              if (vertices[there] == p) {
                number_[v] = there;
                break;
              }
            }
          }
        },
        cancel_);
  }

  // By all threads: most of it is the system's, which hands out the pages.
  template <class T>
  void Fill(T value, AlignedVector<T>* all) const {
    ParallelFor(
        all->size(), kGrain,
        [&](size_t begin, size_t end) { std::fill(&(*all)[begin], all->data() + end, value); },
        cancel_);
  }

  // fn(leaf) for the leaves of nodes begin .. end - 1.
  template <class Fn>
  void ForEachLeaf(size_t begin, size_t end, const Fn& fn) const {
    for (size_t n = begin; n < end; ++n) {
      const BvhNode& node = bvh_.nodes[n];
      for (uint32_t slot = 0; slot < node.child_count; ++slot) {
        if (node.child[slot].is_leaf()) fn(node.child[slot]);
      }
    }
  }

  void DescribeUnits() {
    mates_.units.ResizeUninitialized(bvh_.units());
    ParallelFor(
        bvh_.nodes.size(), kNodeGrain,
        [&](size_t begin, size_t end) {
          ForEachLeaf(begin, end, [&](ChildRef leaf) {
            for (uint32_t k = 0; k < leaf.leaf_units(); ++k) {
              mates_.units[leaf.leaf_unit() + k] =
                  static_cast<uint8_t>(LeafMates::UnitCode(leaf, k));
            }
          });
        },
        cancel_);
  }

  // A leaf's edges, by 3 · lane + edge.
  struct LeafEdges {
    uint32_t count;
    uint32_t from[3 * kMaxLeafTriangles], to[3 * kMaxLeafTriangles];  // Numbers.
  };
  void Read(ChildRef leaf, LeafEdges* edges) const {
    uint32_t ids[kMaxLeafTriangles];
    const uint32_t count = leaf.leaf_count();
    const size_t unit = leaf.leaf_unit();
    const void* const row =
        bvh_.has_leaf_rows()
            ? static_cast<const void*>(
                  &bvh_.leaves[unit * kUnitFloats +
                               (kLeafRows - 1) * kUnitTriangles * leaf.leaf_units()])
            : &bvh_.leaf_ids[unit * kUnitTriangles];
    std::memcpy(ids, row, count * sizeof(uint32_t));
    edges->count = 3 * count;
    for (uint32_t lane = 0; lane < count; ++lane) {
      const auto& corners = geometry_.triangles[ids[lane]];
      const uint32_t number[3] = {number_[corners[0]], number_[corners[1]], number_[corners[2]]};
      for (uint32_t e = 0; e < 3; ++e) {
        edges->from[3 * lane + e] = number[e];
        edges->to[3 * lane + e] = number[e == 2 ? 0 : e + 1];
      }
    }
  }

  // Those that run in contrary directions; what is left is counted, by lesser number.
  void PairWithinLeaves() {
    ends_.ResizeUninitialized(geometry_.vertices.size());
    Fill(0u, &ends_);
    // Room for all edges of a block of nodes; what is not written takes no memory.
    blocks_.resize((bvh_.nodes.size() + kNodeGrain - 1) / kNodeGrain);
    size_t room = 0;
    for (size_t k = 0; k < blocks_.size(); ++k) {
      blocks_[k] = {room, room};
      ForEachLeaf(k * kNodeGrain, std::min((k + 1) * kNodeGrain, bvh_.nodes.size()),
                  [&](ChildRef leaf) { room += 3 * leaf.leaf_count(); });
    }
    left_.ResizeUninitialized(room);
    ParallelFor(
        bvh_.nodes.size(), kNodeGrain,
        [&](size_t begin, size_t end) {
          LeftBlock& block = blocks_[begin / kNodeGrain];
          ForEachLeaf(begin, end, [&](ChildRef leaf) { PairWithin(leaf, &block); });
          for (size_t i = block.begin; i < block.end; ++i) {
            std::atomic_ref(ends_[left_[i].from]).fetch_add(1, std::memory_order_relaxed);
          }
        },
        cancel_);
  }

  void PairWithin(ChildRef leaf, LeftBlock* block) {
    LeafEdges edges;
    Read(leaf, &edges);
    // One edge for each place, by its number and 1.
    constexpr uint32_t kPlaces = 128;
    static_assert(kPlaces > 2 * 3 * kMaxLeafTriangles);
    uint8_t table[kPlaces] = {};
    bool paired[3 * kMaxLeafTriangles] = {};
    for (uint32_t i = 0; i < edges.count; ++i) {
      const uint32_t from = edges.from[i], to = edges.to[i];
      for (uint32_t at = (from + to) * 0x9E3779B1u >> 25;; ++at) {
        uint8_t& place = table[at % kPlaces];
        if (place == 0) {
          place = static_cast<uint8_t>(i + 1);
          break;
        }
        const uint32_t j = place - 1u;
        if (edges.from[j] == to && edges.to[j] == from && !paired[j]) {
          paired[i] = paired[j] = true;
          Entry(leaf, i) = LeafMate(LeafMates::PlaceOf(leaf, j / 3), false);
          Entry(leaf, j) = LeafMate(LeafMates::PlaceOf(leaf, i / 3), false);
          break;
        }
      }
    }
    for (uint32_t i = 0; i < edges.count; ++i) {
      if (paired[i]) continue;
      const uint32_t from = edges.from[i], to = edges.to[i];
      const uint32_t slot = 2 * (3 * LeafMates::PlaceOf(leaf, 0) + i);
      left_[block->end++] = {std::min(from, to), {std::max(from, to), slot + (from > to ? 1 : 0)}};
    }
  }

  // edges_[ends_[v - 1], ends_[v]) are those left whose lesser number is v.
  void GatherEdges() {
    uint32_t sum = 0;
    for (uint32_t& end : ends_) end = std::exchange(sum, sum + end);  // Where each begins.
    edges_.ResizeUninitialized(sum);
    ParallelFor(
        blocks_.size(), 1,
        [&](size_t begin, size_t end) {
          for (size_t k = begin; k < end; ++k) {
            for (size_t i = blocks_[k].begin; i < blocks_[k].end; ++i) {
              edges_[std::atomic_ref(ends_[left_[i].from])
                         .fetch_add(1, std::memory_order_relaxed)] = left_[i].edge;
            }
          }
        },
        cancel_);
  }

  void Pair(uint32_t begin, uint32_t end) {
    Edge* const edges = edges_.data();
    if (end - begin > 1) std::sort(edges + begin, edges + end);  // However threads took turns.
    for (uint32_t i = begin, next; i < end; i = next) {
      next = i + 1;
      while (next < end && edges[next].to == edges[i].to) ++next;
      if (next - i == 2) {
        Join(edges[i], edges[i + 1]);
      } else if (next - i > 2) {
        PairMany(edges + i, edges + next);
      }
    }
  }

  // Of three or more with the same ends.
  void PairMany(Edge* begin, Edge* end) {
    Edge* up = begin;
    Edge* down = std::stable_partition(begin, end, [](const Edge& e) { return e.slot % 2 == 0; });
    Edge* const middle = down;
    while (up != middle && down != end) Join(*up++, *down++);
    for (; middle - up >= 2; up += 2) Join(up[0], up[1]);
    for (; end - down >= 2; down += 2) Join(down[0], down[1]);
  }

  void Join(const Edge& a, const Edge& b) {
    const bool same_way = a.slot % 2 == b.slot % 2;
    Entry(a) = LeafMate(b.slot / 6, same_way);
    Entry(b) = LeafMate(a.slot / 6, same_way);
  }
  LeafMate& Entry(const Edge& edge) {
    const LeafMate own(edge.slot / 6, false);
    const ChildRef leaf = mates_.leaf(own);
    return Entry(leaf, 3 * LeafMates::lane(leaf, own) + edge.slot / 2 % 3);
  }
  // By 3 · lane + edge.
  LeafMate& Entry(ChildRef leaf, uint32_t i) {
    return mates_
        .rows[size_t{kUnitTriangles} * (3 * leaf.leaf_unit() + i % 3 * leaf.leaf_units()) + i / 3];
  }

  const Bvh& bvh_;
  const SceneGeometry& geometry_;
  const CancelToken* const cancel_;
  AlignedVector<uint32_t> number_, ends_;  // By vertex.
  AlignedVector<LeftEdge> left_;           // Those without a mate in their leaf.
  AlignedVector<LeftBlock> blocks_;        // By kNodeGrain nodes.
  AlignedVector<Edge> edges_;
  LeafMates mates_;
};

}  // namespace

LeafMates FindLeafMates(const Bvh& bvh, const SceneGeometry& geometry, const CancelToken* cancel) {
  if (bvh.empty()) return {};
  return Finder(bvh, geometry, cancel).Find();
}

}  // namespace sightline

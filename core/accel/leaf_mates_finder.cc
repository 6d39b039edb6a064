// SPDX-License-Identifier: Apache-2.0
//
// Vertices at one position are called by one of their numbers. Edges are counted, then gathered, by
// the lesser number of their ends; those of one vertex are few, are sorted by the other end, and
// paired.
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

namespace sightline {
namespace {

constexpr size_t kGrain = 1 << 13;
constexpr size_t kNodeGrain = 1 << 8;
// Places of a table looked at for a vertex. One that finds none, as where hashes were made to
// collide, keeps its own number, and its edges may miss their mates.
constexpr size_t kMaxProbes = 64;

uint64_t Mix(uint64_t h) {  // MurmurHash3's finalizer: a bijection of 64 bits.
  h = (h ^ (h >> 33)) * 0xFF51AFD7ED558CCDull;
  h = (h ^ (h >> 33)) * 0xC4CEB9FE1A85EC53ull;
  return h ^ (h >> 33);
}

struct Edge {
  uint32_t to;    // The greater number of its ends.
  uint32_t slot;  // 2 · (3 · place + edge) + whether it runs to the lesser one.

  friend bool operator<(const Edge& a, const Edge& b) {
    return std::tie(a.to, a.slot) < std::tie(b.to, b.slot);
  }
};

class Finder {
 public:
  Finder(const Bvh& bvh, const SceneGeometry& geometry, const CancelToken* cancel)
      : bvh_(bvh), geometry_(geometry), cancel_(cancel) {}

  LeafMates Find() {
    NumberPositions();
    DescribeUnits();
    if (Stopped()) return {};
    GatherEdges();
    if (Stopped()) return {};
    mates_.rows = AlignedVector<LeafMate>(3 * kUnitTriangles * mates_.units.size());
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
    AlignedVector<uint32_t> table(size_t{2} << std::bit_width(vertices.size()), kFree);
    const size_t last = table.size() - 1;
    ParallelFor(
        vertices.size(), kGrain,
        [&](size_t begin, size_t end) {
          for (size_t i = begin; i < end; ++i) {
            const auto v = static_cast<uint32_t>(i);
            const Vec3f p = vertices[v];
            const uint64_t hash =
                Mix((uint64_t{std::bit_cast<uint32_t>(p.x)} << 32 | std::bit_cast<uint32_t>(p.y)) ^
                    Mix(std::bit_cast<uint32_t>(p.z)));
            number_[v] = v;
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
  template <class Fn>
  void ForEachLeaf(const Fn& fn) const {
    ParallelFor(
        bvh_.nodes.size(), kNodeGrain,
        [&](size_t begin, size_t end) { ForEachLeaf(begin, end, fn); }, cancel_);
  }

  void DescribeUnits() {
    mates_.units.ResizeUninitialized(bvh_.has_leaf_rows()
                                         ? (bvh_.leaves.size() - kLeafPadding) / kUnitFloats
                                         : bvh_.leaf_ids.size() / kUnitTriangles);
    ForEachLeaf([&](ChildRef leaf) {
      for (uint32_t k = 0; k < leaf.leaf_units(); ++k) {
        mates_.units[leaf.leaf_unit() + k] = static_cast<uint8_t>(4 * (leaf.leaf_count() - 1) + k);
      }
    });
  }

  // fn(lesser number, edge) for all edges.
  template <class Fn>
  void ForEachEdge(const Fn& fn) const {
    ForEachLeaf([&](ChildRef leaf) {
      uint32_t ids[kMaxLeafTriangles];
      const uint32_t count = leaf.leaf_count(), first = kUnitTriangles * leaf.leaf_unit();
      const void* const row =
          bvh_.has_leaf_rows()
              ? static_cast<const void*>(
                    &bvh_.leaves[size_t{leaf.leaf_unit()} * kUnitFloats +
                                 (kLeafRows - 1) * kUnitTriangles * leaf.leaf_units()])
              : &bvh_.leaf_ids[first];
      std::memcpy(ids, row, count * sizeof(uint32_t));
      for (uint32_t lane = 0; lane < count; ++lane) {
        const auto& corners = geometry_.triangles[ids[lane]];
        const uint32_t number[3] = {number_[corners[0]], number_[corners[1]], number_[corners[2]]};
        for (uint32_t e = 0; e < 3; ++e) {
          const uint32_t from = number[e], to = number[e == 2 ? 0 : e + 1];
          fn(std::min(from, to),
             Edge{std::max(from, to), 2 * (3 * (first + lane) + e) + (from > to ? 1 : 0)});
        }
      }
    });
  }

  // edges_[ends_[v - 1], ends_[v]) are those whose lesser number is v.
  void GatherEdges() {
    ends_.resize(geometry_.vertices.size(), 0);
    ForEachEdge([&](uint32_t v, const Edge&) {
      std::atomic_ref(ends_[v]).fetch_add(1, std::memory_order_relaxed);
    });
    uint32_t sum = 0;
    for (uint32_t& end : ends_) end = std::exchange(sum, sum + end);  // Where each begins.
    edges_.ResizeUninitialized(sum);
    if (Stopped()) return;
    ForEachEdge([&](uint32_t v, const Edge& edge) {
      edges_[std::atomic_ref(ends_[v]).fetch_add(1, std::memory_order_relaxed)] = edge;
    });
  }

  void Pair(uint32_t begin, uint32_t end) {
    Edge* const edges = edges_.data();
    std::sort(edges + begin, edges + end);  // However the threads took turns.
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
    const uint32_t e = edge.slot / 2 % 3;
    return mates_.rows[size_t{kUnitTriangles} * (3 * leaf.leaf_unit() + e * leaf.leaf_units()) +
                       LeafMates::lane(leaf, own)];
  }

  const Bvh& bvh_;
  const SceneGeometry& geometry_;
  const CancelToken* const cancel_;
  AlignedVector<uint32_t> number_, ends_;  // By vertex.
  AlignedVector<Edge> edges_;
  LeafMates mates_;
};

}  // namespace

LeafMates FindLeafMates(const Bvh& bvh, const SceneGeometry& geometry, const CancelToken* cancel) {
  if (bvh.empty()) return {};
  return Finder(bvh, geometry, cancel).Find();
}

}  // namespace sightline

// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/duplicate_triangles.h"

#include <algorithm>
#include <atomic>
#include <bit>
#include <numeric>
#include <vector>

#include "core/base/parallel.h"

namespace sightline {
namespace {

using Triangle = std::array<uint32_t, 3>;
using Position = std::array<uint32_t, 3>;  // The bits of x, y, z.
using Key = std::array<Position, 3>;       // Sorted.

constexpr size_t kGrain = 1 << 16;
// Partitions of about this many triangles keep a hash table of theirs within a second-level cache.
constexpr size_t kPartitionTriangles = 1 << 13;
constexpr int kMaxPartitionBits = 12;
// Beyond this many probes the hashes collide by design of whoever made the mesh: sort instead.
constexpr int kMaxProbes = 256;
constexpr uint64_t kFree = ~uint64_t{0};

uint64_t Mix(uint64_t h) {  // MurmurHash3's finalizer: a bijection of 64 bits.
  h = (h ^ (h >> 33)) * 0xFF51AFD7ED558CCDull;
  h = (h ^ (h >> 33)) * 0xC4CEB9FE1A85EC53ull;
  return h ^ (h >> 33);
}

class Counter {
 public:
  Counter(std::span<const Vec3f> vertices, std::span<const Triangle> triangles,
          std::span<const uint32_t> inert, const CancelToken* cancel)
      : vertices_(vertices), triangles_(triangles), inert_(inert), cancel_(cancel) {}

  uint64_t Count() {
    const size_t n = triangles_.size();
    if (n < 2) return 0;
    Partition();
    if (Stopped()) return 0;
    std::atomic<uint64_t> distinct{0};
    ParallelFor(
        partitions(), 1,
        [&](size_t begin, size_t end) {
          for (size_t p = begin; p < end; ++p) {
            const std::span<uint64_t> entries(entries_.data() + partition_begin_[p],
                                              partition_begin_[p + 1] - partition_begin_[p]);
            distinct.fetch_add(CountDistinct(entries), std::memory_order_relaxed);
          }
        },
        cancel_);
    return entries_.size() - distinct.load();
  }

 private:
  bool Stopped() const { return cancel_ != nullptr && cancel_->cancelled(); }
  size_t partitions() const { return size_t{1} << partition_bits_; }
  // By the topmost bits; an entry keeps the lowest 32 beside the id.
  size_t PartitionOf(uint64_t hash) const {
    return partition_bits_ == 0 ? 0 : hash >> (64 - partition_bits_);
  }

  Position PositionOf(uint32_t vertex) const {
    const Vec3f v = vertices_[vertex];
    return {std::bit_cast<uint32_t>(v.x), std::bit_cast<uint32_t>(v.y),
            std::bit_cast<uint32_t>(v.z)};
  }

  // The same for any order of the corners.
  uint64_t HashOf(uint32_t id) const {
    uint64_t sum = 0;
    for (uint32_t vertex : triangles_[id]) {
      const Position p = PositionOf(vertex);
      sum += Mix((uint64_t{p[0]} << 32 | p[1]) ^ Mix(p[2]));
    }
    return Mix(sum);
  }

  Key KeyOf(uint32_t id) const {
    const Triangle& t = triangles_[id];
    Key key{PositionOf(t[0]), PositionOf(t[1]), PositionOf(t[2])};
    if (key[1] < key[0]) std::swap(key[0], key[1]);
    if (key[2] < key[1]) std::swap(key[1], key[2]);
    if (key[1] < key[0]) std::swap(key[0], key[1]);
    return key;
  }

  // Calls visit(id) for the ids of [begin, end) that are not inert.
  template <typename Visit>
  void ForEachLive(size_t begin, size_t end, Visit visit) const {
    auto inert = std::lower_bound(inert_.begin(), inert_.end(), begin);
    for (size_t id = begin; id < end; ++id) {
      if (inert != inert_.end() && *inert == id) {
        ++inert;
      } else {
        visit(static_cast<uint32_t>(id));
      }
    }
  }

  // Fills entries_ with (low half of the hash, id), gathered by partition, ids ascending within
  // each.
  void Partition() {
    const size_t n = triangles_.size();
    partition_bits_ =
        std::clamp<int>(std::bit_width(n / kPartitionTriangles), 0, kMaxPartitionBits);
    const size_t grain = std::max(kGrain, n / 256);
    const size_t blocks = (n + grain - 1) / grain;
    std::vector<uint64_t> hashes(n);
    std::vector<uint32_t> counts(blocks * partitions(), 0);
    ParallelFor(
        n, grain,
        [&](size_t begin, size_t end) {
          uint32_t* const count = &counts[begin / grain * partitions()];
          ForEachLive(begin, end, [&](uint32_t id) {
            hashes[id] = HashOf(id);
            ++count[PartitionOf(hashes[id])];
          });
        },
        cancel_);
    if (Stopped()) return;
    partition_begin_.assign(partitions() + 1, 0);
    size_t next = 0;
    for (size_t p = 0; p < partitions(); ++p) {
      partition_begin_[p] = next;
      for (size_t block = 0; block < blocks; ++block) {
        next += std::exchange(counts[block * partitions() + p], static_cast<uint32_t>(next));
      }
    }
    partition_begin_.back() = next;
    entries_.resize(next);
    ParallelFor(
        n, grain,
        [&](size_t begin, size_t end) {
          uint32_t* const cursor = &counts[begin / grain * partitions()];
          ForEachLive(begin, end, [&](uint32_t id) {
            entries_[cursor[PartitionOf(hashes[id])]++] = hashes[id] << 32 | id;
          });
        },
        cancel_);
  }

  uint64_t CountDistinct(std::span<uint64_t> entries) const {
    std::vector<uint64_t> table(2 * kPartitionTriangles, kFree);
    uint64_t distinct = 0;
    for (uint64_t entry : entries) {
      const size_t mask = table.size() - 1;
      size_t slot = (entry >> 32) & mask;
      for (int probes = 0; table[slot] != kFree; slot = (slot + 1) & mask) {
        if (table[slot] >> 32 == entry >> 32 && SamePositions(table[slot], entry)) break;
        if (++probes > kMaxProbes) return CountDistinctBySorting(entries);
      }
      if (table[slot] != kFree) continue;
      table[slot] = entry;
      if (2 * ++distinct > table.size()) Grow(table);
    }
    return distinct;
  }

  static void Grow(std::vector<uint64_t>& table) {
    std::vector<uint64_t> larger(2 * table.size(), kFree);
    for (uint64_t entry : table) {
      if (entry == kFree) continue;
      size_t slot = (entry >> 32) & (larger.size() - 1);
      while (larger[slot] != kFree) slot = (slot + 1) & (larger.size() - 1);
      larger[slot] = entry;
    }
    table.swap(larger);
  }

  bool SamePositions(uint64_t a, uint64_t b) const {
    return KeyOf(static_cast<uint32_t>(a)) == KeyOf(static_cast<uint32_t>(b));
  }

  uint64_t CountDistinctBySorting(std::span<uint64_t> entries) const {
    std::sort(entries.begin(), entries.end(), [this](uint64_t a, uint64_t b) {
      return KeyOf(static_cast<uint32_t>(a)) < KeyOf(static_cast<uint32_t>(b));
    });
    uint64_t distinct = 1;
    for (size_t i = 1; i < entries.size(); ++i) {
      distinct += SamePositions(entries[i - 1], entries[i]) ? 0 : 1;
    }
    return distinct;
  }

  const std::span<const Vec3f> vertices_;
  const std::span<const Triangle> triangles_;
  const std::span<const uint32_t> inert_;
  const CancelToken* const cancel_;
  int partition_bits_ = 0;
  std::vector<size_t> partition_begin_;
  std::vector<uint64_t> entries_;
};

}  // namespace

uint64_t CountDuplicateTriangles(std::span<const Vec3f> vertices,
                                 std::span<const Triangle> triangles,
                                 std::span<const uint32_t> inert, const CancelToken* cancel) {
  return Counter(vertices, triangles, inert, cancel).Count();
}

}  // namespace sightline

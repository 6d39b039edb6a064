// SPDX-License-Identifier: Apache-2.0
//
// In rounds: each candidate writes its id to a place of a table that its hash tells; then each that
// finds another's id there compares itself with that one. Those that differ are the next round's
// candidates: a seventh or so, since the table has two to four places for each. Who wrote last
// depends on the threads, what is counted does not: of triangles at the same positions one remains,
// whether the others met it in this round or go on together.
#include "core/mesh/duplicate_triangles.h"

#include <algorithm>
#include <atomic>
#include <bit>
#include <cstddef>
#include <numeric>
#include <vector>

#include "core/base/aligned_vector.h"
#include "core/base/mix_bits.h"
#include "core/base/parallel.h"
#include "core/mesh/position_hash.h"

namespace sightline {
namespace {

using Triangle = std::array<uint32_t, 3>;
using Position = std::array<uint32_t, 3>;  // The bits of x, y, z.
using Key = std::array<Position, 3>;       // Sorted.

constexpr size_t kGrain = 1 << 14;
// Candidates left after so many have hashes made to collide: sort them instead.
constexpr int kMaxRounds = 8;

class Counter {
  // Both return a function that calls visit(id) for the candidates of [begin, end).
  auto AllLive() const {
    return [this](size_t begin, size_t end, auto visit) {
      auto inert = std::lower_bound(inert_.begin(), inert_.end(), begin);
      for (size_t id = begin; id < end; ++id) {
        if (inert != inert_.end() && *inert == id) {
          ++inert;
        } else {
          visit(static_cast<uint32_t>(id));
        }
      }
    };
  }
  static auto Listed(const std::vector<uint32_t>& ids) {
    return [&ids](size_t begin, size_t end, auto visit) {
      for (size_t i = begin; i < end; ++i) visit(ids[i]);
    };
  }

 public:
  Counter(std::span<const Vec3f> vertices, std::span<const Triangle> triangles,
          std::span<const uint32_t> inert, const CancelToken* cancel)
      : vertices_(vertices), triangles_(triangles), inert_(inert), cancel_(cancel) {}

  uint64_t Count() {
    if (triangles_.size() - inert_.size() < 2) return 0;
    HashTriangles();
    uint64_t duplicates = 0;
    std::vector<uint32_t> rest = Round(0, triangles_.size(), AllLive(), &duplicates);
    for (int round = 1; round < kMaxRounds && rest.size() > 1 && !Stopped(); ++round) {
      rest = Round(round, rest.size(), Listed(rest), &duplicates);
    }
    return Stopped() ? 0 : duplicates + CountBySorting(rest);
  }

 private:
  bool Stopped() const { return cancel_ != nullptr && cancel_->cancelled(); }

  Position PositionOf(uint32_t vertex) const {
    const Vec3f v = vertices_[vertex];
    return {std::bit_cast<uint32_t>(v.x), std::bit_cast<uint32_t>(v.y),
            std::bit_cast<uint32_t>(v.z)};
  }

  Key KeyOf(uint32_t id) const {
    const Triangle& t = triangles_[id];
    Key key{PositionOf(t[0]), PositionOf(t[1]), PositionOf(t[2])};
    if (key[1] < key[0]) std::swap(key[0], key[1]);
    if (key[2] < key[1]) std::swap(key[1], key[2]);
    if (key[1] < key[0]) std::swap(key[0], key[1]);
    return key;
  }

  bool AreEqual(uint32_t a, uint32_t b) const {
    return hashes_[a] == hashes_[b] && KeyOf(a) == KeyOf(b);
  }

  // The same for any order of the corners, and for vertices at the same position.
  void HashTriangles() {
    AlignedVector<uint32_t> corners;
    corners.ResizeUninitialized(vertices_.size());
    ParallelFor(
        vertices_.size(), kGrain,
        [&](size_t begin, size_t end) {
          for (size_t i = begin; i < end; ++i) {
            corners[i] = static_cast<uint32_t>(HashPosition(vertices_[i]));
          }
        },
        cancel_);
    hashes_.ResizeUninitialized(triangles_.size());
    if (Stopped()) return;
    ParallelFor(
        triangles_.size(), kGrain,
        [&](size_t begin, size_t end) {
          for (size_t id = begin; id < end; ++id) {
            const Triangle& t = triangles_[id];
            const uint64_t sum = uint64_t{corners[t[0]]} + corners[t[1]] + corners[t[2]];
            hashes_[id] = static_cast<uint32_t>(MixBits(sum) >> 32);
          }
        },
        cancel_);
  }

  // Counts the candidates that are equal to the one in their place; returns those that differ.
  template <typename ForEach>
  std::vector<uint32_t> Round(int round, size_t n, ForEach for_each, uint64_t* duplicates) const {
    const int bits = std::bit_width(n);  // n < 2^32.
    const uint32_t salt = static_cast<uint32_t>(round);
    AlignedVector<uint32_t> table;  // Every place that is read was written before.
    table.ResizeUninitialized(size_t{2} << bits);
    const auto place = [&](uint32_t id) {
      const uint64_t hash =
          round == 0 ? hashes_[id] * kGoldenStep : MixBits(uint64_t{hashes_[id]} << 32 | salt);
      return std::atomic_ref<uint32_t>(table[hash >> (63 - bits)]);
    };
    if (Stopped()) return {};
    ParallelFor(
        n, kGrain,
        [&](size_t begin, size_t end) {
          for_each(begin, end,
                   [&](uint32_t id) { place(id).store(id, std::memory_order_relaxed); });
        },
        cancel_);
    if (Stopped()) return {};
    struct Found {
      std::vector<uint32_t> rest;
      uint64_t duplicates = 0;
    };
    std::vector<Found> blocks((n + kGrain - 1) / kGrain);
    ParallelFor(
        n, kGrain,
        [&](size_t begin, size_t end) {
          Found& found = blocks[begin / kGrain];
          // Whether an id is still there cannot be foretold: so without a branch, those that are
          // not are gathered, then compared.
          std::vector<uint32_t> ids(end - begin), others(end - begin);
          size_t n_gone = 0;
          for_each(begin, end, [&](uint32_t id) {
            const uint32_t there = place(id).load(std::memory_order_relaxed);
            ids[n_gone] = id;
            others[n_gone] = there;
            n_gone += there != id ? 1 : 0;
          });
          size_t n_rest = 0;
          for (size_t i = 0; i < n_gone; ++i) {
            const bool equal = AreEqual(ids[i], others[i]);
            ids[n_rest] = ids[i];
            n_rest += equal ? 0 : 1;
          }
          found.rest.assign(ids.begin(), ids.begin() + static_cast<ptrdiff_t>(n_rest));
          found.duplicates = n_gone - n_rest;
        },
        cancel_);
    std::vector<uint32_t> rest;
    size_t n_rest = 0;
    for (const Found& found : blocks) n_rest += found.rest.size();
    rest.reserve(n_rest);
    for (const Found& found : blocks) {
      *duplicates += found.duplicates;
      rest.insert(rest.end(), found.rest.begin(), found.rest.end());
    }
    return rest;
  }

  // Runs of kGrain, merged by twos: whoever makes hashes collide can stop no worker for longer than
  // a merge.
  void Sort(std::vector<uint32_t>& ids) const {
    const auto less = [this](uint32_t a, uint32_t b) {
      return hashes_[a] != hashes_[b] ? hashes_[a] < hashes_[b] : KeyOf(a) < KeyOf(b);
    };
    const size_t n = ids.size();
    const auto at = [&](size_t i) { return ids.begin() + static_cast<ptrdiff_t>(std::min(i, n)); };
    ParallelFor(
        n, kGrain, [&](size_t begin, size_t end) { std::sort(at(begin), at(end), less); }, cancel_);
    for (size_t run = kGrain; run < n && !Stopped(); run *= 2) {
      ParallelFor((n + 2 * run - 1) / (2 * run), 1,
                  [&](size_t begin, size_t end) {
                    for (size_t pair = begin; pair < end; ++pair) {
                      const size_t first = pair * 2 * run;
                      std::inplace_merge(at(first), at(first + run), at(first + 2 * run), less);
                    }
                  },
                  cancel_);
    }
  }

  uint64_t CountBySorting(std::vector<uint32_t>& ids) const {
    Sort(ids);
    if (Stopped()) return 0;
    uint64_t duplicates = 0;
    for (size_t i = 1; i < ids.size(); ++i) duplicates += AreEqual(ids[i - 1], ids[i]) ? 1 : 0;
    return duplicates;
  }

  const std::span<const Vec3f> vertices_;
  const std::span<const Triangle> triangles_;
  const std::span<const uint32_t> inert_;
  const CancelToken* const cancel_;
  AlignedVector<uint32_t> hashes_;  // By triangle.
};

}  // namespace

uint64_t CountDuplicateTriangles(std::span<const Vec3f> vertices,
                                 std::span<const Triangle> triangles,
                                 std::span<const uint32_t> inert, const CancelToken* cancel) {
  return Counter(vertices, triangles, inert, cancel).Count();
}

}  // namespace sightline

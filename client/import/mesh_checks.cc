// SPDX-License-Identifier: Apache-2.0
#include "client/import/mesh_checks.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "absl/status/statusor.h"
#include "client/import/polygon_fan.h"
#include "client/import/position_table.h"
#include "client/import/text_scanner.h"
#include "core/base/status_macros.h"

namespace sightline {
namespace {

using Corners = std::array<uint32_t, 3>;

// Sorted at once, between two looks whether that is still wanted: some ten milliseconds.
constexpr size_t kSortedAtOnce = size_t{1} << 17;

// Sorts triples whose first corners are `begin` .. `end` - 1. More than may be sorted at once are
// parted at the middle of these, as a sort would part them.
absl::Status Sort(std::span<Corners> triples, uint64_t begin, uint64_t end,
                  const CancelToken* cancel) {
  SL_RETURN_IF_ERROR(CheckWanted(cancel, 0));
  if (triples.size() <= kSortedAtOnce || end - begin <= 1) {
    std::sort(triples.begin(), triples.end());
    return absl::OkStatus();
  }
  const uint64_t middle = begin + (end - begin) / 2;
  const auto second = std::partition(triples.begin(), triples.end(),
                                     [middle](const Corners& t) { return t[0] < middle; });
  const size_t below = static_cast<size_t>(second - triples.begin());
  SL_RETURN_IF_ERROR(Sort(triples.first(below), begin, middle, cancel));
  return Sort(triples.subspan(below), middle, end, cancel);
}

// How many triples of corners below `end` repeat an earlier one: sorting brings copies together.
absl::StatusOr<uint64_t> CountRepeats(std::vector<Corners>* triples, uint64_t end,
                                      const CancelToken* cancel) {
  SL_RETURN_IF_ERROR(Sort(*triples, 0, end, cancel));
  uint64_t repeats = 0;
  for (size_t i = 1; i < triples->size(); ++i) repeats += (*triples)[i] == (*triples)[i - 1];
  return repeats;
}

}  // namespace

bool HasZeroArea(Vec3d a, Vec3d b, Vec3d c) {
  const Vec3d e = b - a;
  const Vec3d f = c - a;
  const double largest = std::max({MaxAbs(a), MaxAbs(b), MaxAbs(c)});
  const double longest = std::max(MaxAbs(e), MaxAbs(f));
  const Vec3d cross = Cross(e, f);
  return IsFinite(cross) && MaxAbs(cross) <= kZeroAreaUnits * largest * longest;
}

absl::Status CountDefects(std::span<const ObjectInput> objects, ImportReport* report,
                          const CancelToken* cancel) {
  report->triangles = 0;
  for (const ObjectInput& object : objects) report->triangles += object.indices.size() / 3;
  report->non_finite_triangles = report->degenerate_triangles = report->zero_area_triangles = 0;

  uint64_t vertices = 0;
  for (const ObjectInput& object : objects) vertices += object.vertices.size();
  if (vertices >= kMaxVertices) {
    report->warnings.emplace_back("too many vertices to look for flat and duplicate triangles");
    return absl::OkStatus();
  }

  PositionTable table;
  std::vector<Corners> triples;
  triples.reserve(report->triangles);
  std::vector<uint32_t> ids;
  for (const ObjectInput& object : objects) {
    const bool placed = !object.transform.IsIdentity();
    ids.clear();
    for (const Vec3d v : object.vertices) {
      SL_RETURN_IF_ERROR(CheckWanted(cancel, ids.size()));
      ids.push_back(table.Insert(CanonicalVertex(placed ? object.transform.Apply(v) : v)));
    }
    for (size_t i = 0; i + 2 < object.indices.size(); i += 3) {
      SL_RETURN_IF_ERROR(CheckWanted(cancel, i / 3));
      Corners t{ids[object.indices[i]], ids[object.indices[i + 1]], ids[object.indices[i + 2]]};
      const Vec3d a = table.positions()[t[0]];
      const Vec3d b = table.positions()[t[1]];
      const Vec3d c = table.positions()[t[2]];
      if (!IsFinite(a) || !IsFinite(b) || !IsFinite(c)) {
        ++report->non_finite_triangles;
        continue;
      }
      const bool degenerate = t[0] == t[1] || t[1] == t[2] || t[2] == t[0];
      report->degenerate_triangles += degenerate;
      report->zero_area_triangles += degenerate || HasZeroArea(a, b, c);
      std::sort(t.begin(), t.end());
      triples.push_back(t);
    }
  }
  SL_ASSIGN_OR_RETURN(report->duplicate_triangles,
                      CountRepeats(&triples, table.positions().size(), cancel));
  return absl::OkStatus();
}

}  // namespace sightline

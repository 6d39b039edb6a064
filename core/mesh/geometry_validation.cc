// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/geometry_validation.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <string_view>
#include <vector>

#include "absl/container/btree_set.h"
#include "absl/strings/str_cat.h"
#include "core/base/parallel.h"
#include "core/base/status_macros.h"
#include "core/mesh/zero_area.h"

namespace sightline {
namespace {

constexpr size_t kGrain = 1 << 14;

template <typename... Args>
absl::Status Fault(const Args&... args) {
  return absl::DataLossError(absl::StrCat("invalid geometry: ", args...));
}

class Validator {
 public:
  Validator(const SceneGeometry& geometry, const CancelToken* cancel)
      : geometry_(geometry), cancel_(cancel) {}

  absl::Status Validate() {
    SL_RETURN_IF_ERROR(CheckCount("triangles", geometry_.triangles.size()));
    SL_RETURN_IF_ERROR(CheckCount("vertices", geometry_.vertices.size()));
    SL_RETURN_IF_ERROR(CheckObjects());
    SL_RETURN_IF_ERROR(CheckInertOrder());
    SL_RETURN_IF_ERROR(CheckVertices());
    SL_RETURN_IF_ERROR(CheckTriangles());
    return CheckReport();
  }

 private:
  // What a block of vertices or triangles has seen.
  struct Seen {
    absl::Status fault;  // The first.
    uint64_t non_finite = 0;
    Box3f bounds;
  };

  static absl::Status CheckCount(const char* what, uint64_t count) {
    if (count <= kMaxGeometryItems) return absl::OkStatus();
    return Fault("it has ", count, " ", what, ", and a scene has at most ", kMaxGeometryItems,
                 ": split it");
  }

  // Runs check(begin, end, &seen) over blocks of [0, n) and puts what they saw together.
  template <typename Check>
  absl::StatusOr<Seen> ForBlocks(size_t n, const Check& check) const {
    std::vector<Seen> blocks((n + kGrain - 1) / kGrain);
    ParallelFor(
        n, kGrain,
        [&](size_t begin, size_t end) {
          Seen& seen = blocks[begin / kGrain];
          seen.fault = check(begin, end, &seen);
        },
        cancel_);
    if (cancel_ != nullptr) SL_RETURN_IF_ERROR(cancel_->ToStatus());
    Seen all;
    for (const Seen& seen : blocks) {
      SL_RETURN_IF_ERROR(seen.fault);
      all.non_finite += seen.non_finite;
      all.bounds.Extend(seen.bounds);
    }
    return all;
  }

  static bool IsRounding(double x) { return std::isfinite(x) && x >= 0; }

  absl::Status CheckObjects() const {
    if (!IsFinite(geometry_.origin) || MaxAbs(geometry_.origin) > kMaxCoordinate) {
      return Fault("its origin is not finite or out of range");
    }
    absl::btree_set<std::string_view> names;  // Of any hash, names could be made to collide.
    uint64_t triangles = 0, vertices = 0;
    bool uniform = true;
    double largest_rounding = 0;
    for (size_t i = 0; i < geometry_.objects.size(); ++i) {
      const ObjectRecord& object = geometry_.objects[i];
      const auto fault = [&](const auto&... args) { return Fault("object ", i, args...); };
      if (i % kGrain == 0 && cancel_ != nullptr) {
        SL_RETURN_IF_ERROR(cancel_->ToStatus());
      }
      if (object.name.empty() || !names.insert(object.name).second) {
        return fault(" has no name of its own");
      }
      if (object.first_triangle != triangles || object.first_vertex != vertices) {
        return fault(" does not begin where the one before it ends");
      }
      triangles += object.triangle_count;
      vertices += object.vertex_count;
      if (static_cast<uint8_t>(object.culling) > static_cast<uint8_t>(Culling::kFront)) {
        return fault(" has culling ", static_cast<int>(object.culling));
      }
      for (const double m : object.transform.m) {
        if (!std::isfinite(m)) return fault(" has a transform that is not finite");
      }
      if (!IsRounding(object.largest_rounding)) return fault(" has a rounding that is none");
      if (object.source_vertices != nullptr &&
          object.source_vertices->size() != object.vertex_count) {
        return fault(" keeps ", object.source_vertices->size(), " local vertices, but has ",
                     object.vertex_count);
      }
      uniform = uniform && object.mask == 0xFFFFFFFFu && object.culling == Culling::kNone;
      largest_rounding = std::max(largest_rounding, object.largest_rounding);
    }
    if (triangles != geometry_.triangles.size() || vertices != geometry_.vertices.size()) {
      return Fault("its objects have ", triangles, " triangles and ", vertices,
                   " vertices, but there are ", geometry_.triangles.size(), " and ",
                   geometry_.vertices.size());
    }
    if (triangles >= kNoTriangle || vertices >= kNoTriangle) {
      return Fault(triangles, " triangles and ", vertices, " vertices cannot be numbered");
    }
    if (uniform != geometry_.uniform) return Fault("its objects are not as uniform as it says");
    if (largest_rounding != geometry_.report.largest_rounding) {
      return Fault("its largest rounding is not its objects'");
    }
    return absl::OkStatus();
  }

  absl::Status CheckInertOrder() const {
    const AlignedVector<uint32_t>& inert = geometry_.inert;
    for (size_t i = 0; i < inert.size(); ++i) {
      if (inert[i] >= geometry_.triangles.size() || (i > 0 && inert[i] <= inert[i - 1])) {
        return Fault("inert triangle ", inert[i], " of ", geometry_.triangles.size(),
                     " is out of range or out of order");
      }
    }
    return absl::OkStatus();
  }

  absl::Status CheckVertices() {
    const auto check = [&](size_t begin, size_t end, Seen* seen) {
      for (size_t i = begin; i < end; ++i) {
        const Vec3f& v = geometry_.vertices[i];
        if (std::isnan(v.x) && std::isnan(v.y) && std::isnan(v.z)) {
          ++seen->non_finite;
          continue;
        }
        if (!(MaxAbs(v) <= static_cast<float>(kMaxCoordinate))) {
          return Fault("vertex ", i, " is not finite or beyond 2^40");
        }
        for (int axis = 0; axis < 3; ++axis) {
          if (std::bit_cast<uint32_t>(v[axis]) == 0x80000000u) {
            return Fault("vertex ", i, " has a coordinate -0");
          }
        }
      }
      return absl::OkStatus();
    };
    SL_ASSIGN_OR_RETURN(const Seen seen, ForBlocks(geometry_.vertices.size(), check));
    non_finite_vertices_ = seen.non_finite;
    return absl::OkStatus();
  }

  absl::Status CheckTriangles() {
    const auto check = [&](size_t begin, size_t end, Seen* seen) {
      const auto& inert = geometry_.inert;
      auto next_inert = std::lower_bound(inert.begin(), inert.end(), static_cast<uint32_t>(begin));
      uint32_t object = geometry_.ObjectOf(static_cast<uint32_t>(begin));
      for (size_t id = begin; id < end; ++id) {
        while (id - geometry_.objects[object].first_triangle >=
               geometry_.objects[object].triangle_count) {
          ++object;
        }
        const ObjectRecord& owner = geometry_.objects[object];
        for (const uint32_t index : geometry_.triangles[id]) {
          if (index < owner.first_vertex || index - owner.first_vertex >= owner.vertex_count) {
            return Fault("triangle ", id, " names vertex ", index, ", which is not one of object ",
                         object, "'s");
          }
        }
        const auto [a, b, c] = geometry_.Corners(static_cast<uint32_t>(id));
        const bool finite = IsFinite(a) && IsFinite(b) && IsFinite(c);
        const bool listed = next_inert != inert.end() && *next_inert == id;
        if (listed) ++next_inert;
        if ((finite && !IsZeroArea(a, b, c)) == listed) {
          return Fault("triangle ", id,
                       listed ? " can be hit, but is called inert"
                              : " can never be hit, but is not called inert");
        }
        seen->non_finite += finite ? 0 : 1;
        if (listed) continue;
        seen->bounds.Extend(a);
        seen->bounds.Extend(b);
        seen->bounds.Extend(c);
      }
      return absl::OkStatus();
    };
    SL_ASSIGN_OR_RETURN(const Seen seen, ForBlocks(geometry_.triangles.size(), check));
    non_finite_triangles_ = seen.non_finite;
    if (seen.bounds != geometry_.bounds) return Fault("its bounds are not its triangles'");
    return absl::OkStatus();
  }

  absl::Status CheckReport() const {
    const MeshReport& report = geometry_.report;
    if (report.triangles != geometry_.triangles.size() ||
        report.vertices != geometry_.vertices.size() ||
        report.non_finite_vertices != non_finite_vertices_ ||
        report.non_finite_triangles != non_finite_triangles_ ||
        report.inert_triangles != geometry_.inert.size() ||
        report.zero_area_triangles != geometry_.inert.size() - non_finite_triangles_ ||
        report.duplicate_triangles > geometry_.triangles.size() - geometry_.inert.size()) {
      return Fault("its report does not count what is there");
    }
    return absl::OkStatus();
  }

  const SceneGeometry& geometry_;
  const CancelToken* const cancel_;
  uint64_t non_finite_vertices_ = 0, non_finite_triangles_ = 0;
};

}  // namespace

absl::Status ValidateGeometry(const SceneGeometry& geometry, const CancelToken* cancel) {
  return Validator(geometry, cancel).Validate();
}

}  // namespace sightline

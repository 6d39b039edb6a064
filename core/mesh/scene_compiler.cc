// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/scene_compiler.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <memory>
#include <string>
#include <string_view>
#include <utility>

#include "absl/base/attributes.h"
#include "absl/container/btree_set.h"
#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "core/base/check.h"
#include "core/base/float_environment.h"
#include "core/base/limit_error.h"
#include "core/base/parallel.h"
#include "core/base/polled_blocks.h"
#include "core/base/status_macros.h"
#include "core/base/utf8.h"
#include "core/geometry/float4.h"
#include "core/mesh/duplicate_triangles.h"
#include "core/mesh/zero_area.h"

namespace sightline {
namespace {

constexpr size_t kGrain = 1 << 14;
// Records that are filled between two looks at the cancel token: a name and its letters each.
constexpr size_t kObjectGrain = 1 << 12;
// Vertices placed before anybody looks whether one of them needs care.
constexpr size_t kPlacedTogether = 64;
// What an error shows of a name that is none.
constexpr size_t kShownNameBytes = 64;
constexpr uint64_t kNowhere = std::numeric_limits<uint64_t>::max();

std::string Describe(Vec3d v) { return absl::StrFormat("(%.17g, %.17g, %.17g)", v.x, v.y, v.z); }

// Lowers `first` to `at`: the first fault in input order is the one reported, whoever found it.
void Lower(std::atomic<uint64_t>& first, uint64_t at) {
  uint64_t seen = first.load(std::memory_order_relaxed);
  while (at < seen && !first.compare_exchange_weak(seen, at, std::memory_order_relaxed)) {
  }
}

void Raise(double& largest, double value) {
  std::atomic_ref<double> shared(largest);
  double seen = shared.load(std::memory_order_relaxed);
  while (value > seen && !shared.compare_exchange_weak(seen, value, std::memory_order_relaxed)) {
  }
}

class Compiler {
 public:
  Compiler(std::span<const ObjectSource> sources, const SceneGeometry* base,
           const MeshLimits& limits, const CancelToken* cancel)
      : sources_(sources), base_(base), limits_(limits), cancel_(cancel) {}

  absl::StatusOr<SceneGeometry> Compile(std::optional<Vec3d> origin) {
    SL_RETURN_IF_ERROR(LayOutObjects());
    SL_RETURN_IF_ERROR(NameObjects());
    SL_RETURN_IF_ERROR(ChooseOrigin(origin));
    SL_RETURN_IF_ERROR(PlaceVertices());
    SL_RETURN_IF_ERROR(GatherTriangles());
    FindInert();
    SL_RETURN_IF_ERROR(CheckCancel());
    out_.report.duplicate_triangles =
        CountDuplicateTriangles(out_.vertices, out_.triangles, out_.inert, cancel_);
    SL_RETURN_IF_ERROR(CheckCancel());
    return std::move(out_);
  }

 private:
  absl::Status CheckCancel() const {
    return cancel_ == nullptr ? absl::OkStatus() : cancel_->ToStatus();
  }

  const ObjectRecord& BaseOf(size_t i) const {
    SIGHTLINE_CHECK(base_ != nullptr);
    SIGHTLINE_CHECK_LT(sources_[i].base_object, base_->objects.size());
    return base_->objects[sources_[i].base_object];
  }
  // True if the object's stored floats are taken over as they are.
  bool IsKept(size_t i) const {
    return sources_[i].input == nullptr && sources_[i].transform == nullptr &&
           sources_[i].vertices == nullptr;
  }
  // The local doubles of an object that is not kept.
  const std::vector<Vec3d>& LocalVertices(size_t i) const {
    if (sources_[i].vertices != nullptr) return *sources_[i].vertices;
    if (sources_[i].input != nullptr) return sources_[i].input->vertices;
    SIGHTLINE_CHECK(BaseOf(i).source_vertices != nullptr);
    return *BaseOf(i).source_vertices;
  }
  std::string NameForMessage(size_t i) const {
    return absl::StrCat("object ", i, " \"", out_.objects[i].name, "\"");
  }

  // Everything of the records but the name and the rounding; sizes against limits.
  absl::Status LayOutObjects() {
    if (sources_.size() > limits_.max_objects) {
      return LimitError("max_objects", limits_.max_objects,
                        absl::StrCat("the scene has ", sources_.size(), " objects"),
                        "merge objects or split the scene");
    }
    SL_RETURN_IF_ERROR(CheckCancel());
    out_.objects.resize(sources_.size());
    uint64_t triangles = 0, vertices = 0;
    for (size_t i = 0; i < sources_.size(); ++i) {
      if (i % kObjectGrain == 0) SL_RETURN_IF_ERROR(CheckCancel());
      ObjectRecord& record = out_.objects[i];
      uint64_t triangle_count = 0, vertex_count = 0;
      bool dynamic = false;
      if (const ObjectInput* input = sources_[i].input; input != nullptr) {
        if (!IsUtf8(input->name)) {
          return absl::InvalidArgumentError(
              absl::StrCat("the name of object ", i, ", \"",
                           absl::CHexEscape(input->name.substr(0, kShownNameBytes)),
                           "\", is not UTF-8: convert it"));
        }
        record.name = input->name;
        if (input->indices.size() % 3 != 0) {
          return absl::InvalidArgumentError(absl::StrCat(
              NameForMessage(i), " has ", input->indices.size(), " indices: not a multiple of 3"));
        }
        triangle_count = input->indices.size() / 3;
        vertex_count = input->vertices.size();
        record.mask = input->mask;
        record.culling = input->culling;
        record.transform = input->transform;
        dynamic = input->dynamic;
      } else {
        record = BaseOf(i);
        triangle_count = record.triangle_count;
        vertex_count = record.vertex_count;
        dynamic = record.source_vertices != nullptr;
        if (!IsKept(i)) record.largest_rounding = 0;
      }
      if (sources_[i].transform != nullptr) record.transform = *sources_[i].transform;
      if (const auto* moved = sources_[i].vertices;
          moved != nullptr && moved->size() != vertex_count) {
        return absl::InvalidArgumentError(
            absl::StrCat(NameForMessage(i), " has ", vertex_count, " vertices, but ", moved->size(),
                         " were given: remove and add it to change its mesh"));
      }
      // An object of the base that is only placed anew shares its doubles with the base.
      if (dynamic && (sources_[i].input != nullptr || sources_[i].vertices != nullptr)) {
        record.source_vertices = std::make_shared<const std::vector<Vec3d>>(
            CopyInPolledBlocks(std::span(LocalVertices(i)), cancel_));
        if (LocalVertices(i).size() > kPolledBlock) SL_RETURN_IF_ERROR(CheckCancel());
      }
      for (int k = 0; k < 12; ++k) {
        if (!std::isfinite(record.transform.m[k])) {
          return absl::InvalidArgumentError(absl::StrCat(NameForMessage(i), ": transform[", k,
                                                         "] = ", record.transform.m[k],
                                                         " is not finite"));
        }
      }
      record.first_triangle = static_cast<uint32_t>(triangles);
      record.first_vertex = static_cast<uint32_t>(vertices);
      record.triangle_count = static_cast<uint32_t>(triangle_count);
      record.vertex_count = static_cast<uint32_t>(vertex_count);
      SL_RETURN_IF_ERROR(Add("triangles", triangle_count, limits_.max_triangles, triangles));
      SL_RETURN_IF_ERROR(Add("vertices", vertex_count, limits_.max_vertices, vertices));
      out_.uniform = out_.uniform && record.mask == 0xFFFFFFFFu && record.culling == Culling::kNone;
    }
    out_.triangles.ResizeUninitialized(triangles);
    out_.vertices.ResizeUninitialized(vertices);
    out_.report.triangles = triangles;
    out_.report.vertices = vertices;
    return absl::OkStatus();
  }

  static absl::Status Add(const char* what, uint64_t count, uint64_t limit, uint64_t& total) {
    limit = std::min(limit, kMaxGeometryItems);
    if (count > limit || total > limit - count) {
      return LimitError(absl::StrCat("max_", what), limit,
                        absl::StrCat("the scene has at least ", total + count, " ", what),
                        "split it or simplify its meshes");
    }
    total += count;
    return absl::OkStatus();
  }

  absl::Status NameObjects() {
    absl::btree_set<std::string_view> names;  // Of any hash, names could be made to collide.
    for (size_t i = 0; i < sources_.size(); ++i) {
      if (i % kGrain == 0) SL_RETURN_IF_ERROR(CheckCancel());
      const std::string& name = out_.objects[i].name;
      if (!name.empty() && !names.insert(name).second) {
        return absl::InvalidArgumentError(
            absl::StrCat(NameForMessage(i), ": an earlier object has this name; names are unique"));
      }
    }
    size_t number = 0;
    for (size_t i = 0; i < sources_.size(); ++i) {
      if (i % kGrain == 0) SL_RETURN_IF_ERROR(CheckCancel());
      std::string& name = out_.objects[i].name;
      if (!name.empty()) continue;
      number = std::max(number, i);
      do {
        name = absl::StrCat("object-", number++);
      } while (!names.insert(name).second);
    }
    return absl::OkStatus();
  }

  absl::Status ChooseOrigin(std::optional<Vec3d> origin) {
    if (base_ != nullptr) {
      out_.origin = base_->origin;
      return absl::OkStatus();
    }
    if (origin.has_value()) {
      if (!IsFinite(*origin) || MaxAbs(*origin) > kMaxCoordinate) {
        return absl::InvalidArgumentError(absl::StrCat(
            "origin = ", Describe(*origin), " is not finite or beyond 2^40 in a coordinate"));
      }
      out_.origin = *origin;
      return absl::OkStatus();
    }
    for (size_t i = 0; i < sources_.size(); ++i) {
      for (const Vec3d& v : LocalVertices(i)) {
        if (!IsFinite(v)) continue;
        // A place out of bounds is an error that PlaceVertices reports.
        out_.origin = Place(out_.objects[i].transform, v);
        return absl::OkStatus();
      }
    }
    return absl::OkStatus();
  }

  static Vec3d Place(const Affine3d& transform, Vec3d v) {
    return transform.IsIdentity() ? v : transform.Apply(v);
  }

  // Calls part(i, begin, end) for every object with elements in [begin, end) of all elements, where
  // `first` and `count` are the members that number an object's; begin and end are relative to the
  // object.
  template <typename Part>
  void ForEachPart(uint32_t ObjectRecord::*first, uint32_t ObjectRecord::*count, size_t begin,
                   size_t end, Part part) const {
    const auto& objects = out_.objects;
    size_t i = std::upper_bound(objects.begin(), objects.end(), begin,
                                [&](size_t at, const ObjectRecord& o) { return at < o.*first; }) -
               objects.begin() - 1;
    for (; i < objects.size() && objects[i].*first < end; ++i) {
      const size_t from = std::max<size_t>(begin, objects[i].*first) - objects[i].*first;
      const size_t to = std::min<size_t>(end - objects[i].*first, objects[i].*count);
      if (from < to) part(i, from, to);
    }
  }

  absl::Status PlaceVertices() {
    std::atomic<uint64_t> first_fault{kNowhere}, non_finite{0};
    ParallelFor(
        out_.vertices.size(), kGrain,
        [&](size_t begin, size_t end) {
          uint64_t bad = 0;
          ForEachPart(&ObjectRecord::first_vertex, &ObjectRecord::vertex_count, begin, end,
                      [&](size_t i, size_t from, size_t to) {
                        bad += IsKept(i) ? KeepVertices(i, from, to)
                                         : PlaceVertices(i, from, to, first_fault);
                      });
          non_finite.fetch_add(bad, std::memory_order_relaxed);
        },
        cancel_);
    SL_RETURN_IF_ERROR(CheckCancel());
    if (first_fault != kNowhere) return VertexFault(first_fault);
    out_.report.non_finite_vertices = non_finite;
    for (const ObjectRecord& object : out_.objects) {
      out_.report.largest_rounding =
          std::max(out_.report.largest_rounding, object.largest_rounding);
    }
    return absl::OkStatus();
  }

  // Both return the number of vertices that are not finite.
  uint64_t KeepVertices(size_t i, size_t from, size_t to) {
    const Vec3f* const source = &base_->vertices[BaseOf(i).first_vertex];
    Vec3f* const target = &out_.vertices[out_.objects[i].first_vertex];
    uint64_t bad = 0;
    for (size_t k = from; k < to; ++k) {
      target[k] = source[k];
      bad += IsFinite(source[k]) ? 0 : 1;
    }
    return bad;
  }

  uint64_t PlaceVertices(size_t i, size_t from, size_t to, std::atomic<uint64_t>& first_fault) {
    ObjectRecord& record = out_.objects[i];
    const std::vector<Vec3d>& local = LocalVertices(i);
    Vec3f* const target = &out_.vertices[record.first_vertex];
    uint64_t bad = 0;
    double rounding = 0;
    for (size_t begin = from; begin < to; begin += kPlacedTogether) {
      const size_t n = std::min(to - begin, kPlacedTogether);
      const std::span<const Vec3d> some(&local[begin], n);
      if (PlaceSound(record.transform, some, &target[begin], rounding)) continue;
      const size_t placed = PlaceEach(record.transform, some, &target[begin], rounding, bad);
      if (placed < n) {
        Lower(first_fault, record.first_vertex + begin + placed);
        break;
      }
    }
    Raise(record.largest_rounding, rounding);
    return bad;
  }

  // Places, rounds and measures vertices that all are finite and in bounds: else it returns false,
  // and what it wrote is of no use. The same operations as PlaceEach.
  bool PlaceSound(const Affine3d& transform, std::span<const Vec3d> local, Vec3f* target,
                  double& rounding) const {
    const bool moved = !transform.IsIdentity();
    const Double4 origin = LoadVertex(out_.origin);
    const Double4 bound = {kMaxCoordinate, kMaxCoordinate, kMaxCoordinate, kMaxCoordinate};
    Long4 sound = {-1, -1, -1, -1};
    Double4 largest{};
    for (const Vec3d& v : local) {
      const Double4 world = LoadVertex(moved ? transform.Apply(v) : v);
      const Double4 relative = world - origin;
      sound &= (Abs(world) <= bound) & (Abs(relative) <= bound);
      const Float4 rounded = ToFloat(relative) + Float4{};  // -0 becomes +0.
      StoreVertex(rounded, target++);
      largest = Max(Abs(world - (origin + ToDouble(rounded))), largest);
    }
    if (!AllOfThree(sound)) return false;
    rounding = std::max({rounding, largest[0], largest[1], largest[2]});
    return true;
  }

  // The number placed: fewer than there are where the next one is out of bounds. Counts those that
  // are not finite in `bad`.
  size_t PlaceEach(const Affine3d& transform, std::span<const Vec3d> local, Vec3f* target,
                   double& rounding, uint64_t& bad) const {
    constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
    for (size_t k = 0; k < local.size(); ++k) {
      if (!IsFinite(local[k])) {
        target[k] = {kNan, kNan, kNan};
        ++bad;
        continue;
      }
      const Vec3d world = Place(transform, local[k]);
      const Vec3d relative = world - out_.origin;
      if (!(MaxAbs(world) <= kMaxCoordinate) || !(MaxAbs(relative) <= kMaxCoordinate)) {
        return k;
      }
      // Adding zero turns -0 into +0 and changes nothing else.
      target[k] = ToFloat(relative) + Vec3f{0.0f, 0.0f, 0.0f};
      rounding = std::max(rounding, MaxAbs(world - (out_.origin + ToDouble(target[k]))));
    }
    return local.size();
  }

  absl::Status VertexFault(uint64_t vertex) const {
    size_t object = 0, at = 0;
    ForEachPart(&ObjectRecord::first_vertex, &ObjectRecord::vertex_count, vertex, vertex + 1,
                [&](size_t i, size_t from, size_t) { object = i, at = from; });
    const Vec3d local = LocalVertices(object)[at];
    const Vec3d world = Place(out_.objects[object].transform, local);
    return absl::InvalidArgumentError(absl::StrCat(
        NameForMessage(object), ": vertex ", at, " = ", Describe(local), " is placed at ",
        Describe(world), ", beyond 2^40 in a coordinate, in the world or from the origin ",
        Describe(out_.origin)));
  }

  absl::Status GatherTriangles() {
    std::atomic<uint64_t> first_fault{kNowhere};
    ParallelFor(
        out_.triangles.size(), kGrain,
        [&](size_t begin, size_t end) {
          ForEachPart(&ObjectRecord::first_triangle, &ObjectRecord::triangle_count, begin, end,
                      [&](size_t i, size_t from, size_t to) {
                        if (sources_[i].input != nullptr) {
                          CheckTriangles(i, from, to, first_fault);
                        } else {
                          KeepTriangles(i, from, to);
                        }
                      });
        },
        cancel_);
    SL_RETURN_IF_ERROR(CheckCancel());
    return first_fault == kNowhere ? absl::OkStatus() : IndexFault(first_fault);
  }

  void CheckTriangles(size_t i, size_t from, size_t to, std::atomic<uint64_t>& first_fault) {
    const ObjectRecord& record = out_.objects[i];
    const std::vector<uint32_t>& indices = sources_[i].input->indices;
    for (size_t k = from; k < to; ++k) {
      for (int corner = 0; corner < 3; ++corner) {
        const uint32_t index = indices[3 * k + corner];
        if (index >= record.vertex_count) {
          return Lower(first_fault, record.first_triangle + k);
        }
        out_.triangles[record.first_triangle + k][corner] = record.first_vertex + index;
      }
    }
  }

  void KeepTriangles(size_t i, size_t from, size_t to) {
    const ObjectRecord& record = out_.objects[i];
    const ObjectRecord& source = BaseOf(i);
    for (size_t k = from; k < to; ++k) {
      for (int corner = 0; corner < 3; ++corner) {
        out_.triangles[record.first_triangle + k][corner] =
            base_->triangles[source.first_triangle + k][corner] - source.first_vertex +
            record.first_vertex;
      }
    }
  }

  absl::Status IndexFault(uint64_t triangle) const {
    size_t object = 0, at = 0;
    ForEachPart(&ObjectRecord::first_triangle, &ObjectRecord::triangle_count, triangle,
                triangle + 1, [&](size_t i, size_t from, size_t) { object = i, at = 3 * from; });
    const uint32_t vertex_count = out_.objects[object].vertex_count;
    const std::vector<uint32_t>& indices = sources_[object].input->indices;
    while (indices[at] < vertex_count) ++at;
    return absl::InvalidArgumentError(absl::StrCat(NameForMessage(object), ": indices[", at,
                                                   "] = ", indices[at], ", but it has ",
                                                   vertex_count, " vertices"));
  }

  // Fills the inert list, its counts and the bounds. After a cancel they are incomplete.
  void FindInert() {
    struct Block {
      std::vector<uint32_t> inert;
      uint64_t non_finite = 0;
      Box3f bounds;
    };
    const size_t n = out_.triangles.size();
    std::vector<Block> blocks((n + kGrain - 1) / kGrain);
    ParallelFor(
        n, kGrain,
        [&](size_t begin, size_t end) {
          Block& block = blocks[begin / kGrain];
          constexpr float kInfinity = std::numeric_limits<float>::infinity();
          Float4 lo = Broadcast(kInfinity), hi = Broadcast(-kInfinity);
          for (size_t id = begin; id < end; ++id) {
            const auto [a, b, c] = out_.Corners(static_cast<uint32_t>(id));
            const Float4 a4 = LoadVertex(a), b4 = LoadVertex(b), c4 = LoadVertex(c);
            if (!SurelyHasArea(a4, b4, c4)) {
              const bool finite = IsFinite(a) && IsFinite(b) && IsFinite(c);
              if (!finite || IsZeroArea(a, b, c)) {
                block.inert.push_back(static_cast<uint32_t>(id));
                block.non_finite += finite ? 0 : 1;
                continue;
              }
            }
            lo = Min(Min(a4, b4), Min(c4, lo));
            hi = Max(Max(a4, b4), Max(c4, hi));
          }
          block.bounds = {{lo[0], lo[1], lo[2]}, {hi[0], hi[1], hi[2]}};
        },
        cancel_);
    for (const Block& block : blocks) {
      out_.inert.Append(block.inert);
      out_.report.non_finite_triangles += block.non_finite;
      out_.bounds.Extend(block.bounds);
    }
    out_.report.inert_triangles = out_.inert.size();
    out_.report.zero_area_triangles = out_.inert.size() - out_.report.non_finite_triangles;
  }

  const std::span<const ObjectSource> sources_;
  const SceneGeometry* const base_;
  const MeshLimits& limits_;
  const CancelToken* const cancel_;
  SceneGeometry out_;
};

// Not inlined: compilers do not order arithmetic against the change of the floating-point state.
ABSL_ATTRIBUTE_NOINLINE absl::StatusOr<SceneGeometry> Compile(Compiler& compiler,
                                                              std::optional<Vec3d> origin) {
  return compiler.Compile(origin);
}

}  // namespace

absl::StatusOr<SceneGeometry> CompileSources(std::span<const ObjectSource> sources,
                                             const SceneGeometry* base, std::optional<Vec3d> origin,
                                             const MeshLimits& limits, const CancelToken* cancel) {
  Compiler compiler(sources, base, limits, cancel);
  const ScopedFloatEnvironment environment;
  return Compile(compiler, origin);
}

}  // namespace sightline

// SPDX-License-Identifier: Apache-2.0
//
// That edges lead to each other one to one follows from what is asked of each alone: no triangle of
// the tree has two edges with the same ends, for it would have no area.
#include "core/accel/leaf_mates_validation.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "absl/strings/str_cat.h"
#include "core/base/parallel.h"
#include "core/base/status_macros.h"

namespace sightline {
namespace {

constexpr size_t kNodesPerBlock = 32;

template <typename... Args>
absl::Status Fault(const Args&... args) {
  return absl::DataLossError(absl::StrCat("invalid mates: ", args...));
}

class Validator {
 public:
  Validator(const Bvh& bvh, const SceneGeometry& geometry, const CancelToken* cancel)
      : bvh_(bvh), mates_(bvh.mates), geometry_(geometry), cancel_(cancel) {}

  absl::Status Validate() const {
    if (mates_.rows.empty() && mates_.units.empty()) return absl::OkStatus();
    const size_t units = bvh_.units();
    if (mates_.units.size() != units || mates_.rows.size() != 3 * kUnitTriangles * units) {
      return Fault(mates_.units.size(), " units and ", mates_.rows.size(), " edges, of ", units,
                   " and ", 3 * kUnitTriangles * units);
    }
    SL_RETURN_IF_ERROR(CheckLeaves([&](ChildRef leaf) { return CheckUnits(leaf); }));
    return CheckLeaves([&](ChildRef leaf) { return CheckEdges(leaf); });
  }

 private:
  // The first fault of all leaves.
  template <class Check>
  absl::Status CheckLeaves(const Check& check) const {
    const size_t nodes = bvh_.nodes.size();
    std::vector<absl::Status> blocks((nodes + kNodesPerBlock - 1) / kNodesPerBlock);
    ParallelFor(
        nodes, kNodesPerBlock,
        [&](size_t begin, size_t end) {
          absl::Status& fault = blocks[begin / kNodesPerBlock];
          for (size_t n = begin; n < end && fault.ok(); ++n) {
            const BvhNode& node = bvh_.nodes[n];
            for (uint32_t slot = 0; slot < node.child_count && fault.ok(); ++slot) {
              if (node.child[slot].is_leaf()) fault = check(node.child[slot]);
            }
          }
        },
        cancel_);
    if (cancel_ != nullptr) SL_RETURN_IF_ERROR(cancel_->ToStatus());
    for (const absl::Status& fault : blocks) SL_RETURN_IF_ERROR(fault);
    return absl::OkStatus();
  }

  absl::Status CheckUnits(ChildRef leaf) const {
    for (uint32_t k = 0; k < leaf.leaf_units(); ++k) {
      const uint32_t unit = leaf.leaf_unit() + k, code = mates_.units[unit];
      if (code != LeafMates::UnitCode(leaf, k)) {
        return Fault("unit ", unit, " has code ", code, ", not ", LeafMates::UnitCode(leaf, k));
      }
    }
    return absl::OkStatus();
  }

  absl::Status CheckEdges(ChildRef leaf) const {
    const uint32_t lanes = kUnitTriangles * leaf.leaf_units();
    for (int e = 0; e < 3; ++e) {
      const LeafMate* const row = mates_.of(leaf, e);
      for (uint32_t lane = 0; lane < lanes; ++lane) {
        if (!row[lane].exists()) continue;
        if (lane >= leaf.leaf_count() || !LeadsBack(leaf, lane, e)) {
          return Fault("edge ", e, " of place ", LeafMates::PlaceOf(leaf, lane), " is not that of ",
                       row[lane].place());
        }
      }
    }
    return absl::OkStatus();
  }

  bool LeadsBack(ChildRef leaf, uint32_t lane, int edge) const {
    const LeafMate mate = mates_.of(leaf, edge)[lane];
    if (mate.place() / kUnitTriangles >= mates_.units.size()) return false;
    const ChildRef other = mates_.leaf(mate);
    const uint32_t i = LeafMates::lane(other, mate);
    const LeafMate back(LeafMates::PlaceOf(leaf, lane), mate.same_way());
    if (i >= other.leaf_count() || mate.place() == back.place()) return false;
    Vec3f from = Corner(leaf, lane, edge), to = Corner(leaf, lane, (edge + 1) % 3);
    if (!mate.same_way()) std::swap(from, to);
    for (int f = 0; f < 3; ++f) {
      if (mates_.of(other, f)[i] == back && Corner(other, i, f) == from &&
          Corner(other, i, (f + 1) % 3) == to) {
        return true;
      }
    }
    return false;
  }

  Vec3f Corner(ChildRef leaf, uint32_t lane, int corner) const {
    if (!bvh_.has_leaf_rows()) {
      return geometry_.Corners(bvh_.leaf_ids[LeafMates::PlaceOf(leaf, lane)])[corner];
    }
    const size_t lanes = size_t{kUnitTriangles} * leaf.leaf_units();
    const float* const x =
        &bvh_.leaves[size_t{leaf.leaf_unit()} * kUnitFloats + 3 * corner * lanes + lane];
    return {x[0], x[lanes], x[2 * lanes]};
  }

  const Bvh& bvh_;
  const LeafMates& mates_;
  const SceneGeometry& geometry_;
  const CancelToken* const cancel_;
};

}  // namespace

absl::Status ValidateLeafMates(const Bvh& bvh, const SceneGeometry& geometry,
                               const CancelToken* cancel) {
  return Validator(bvh, geometry, cancel).Validate();
}

}  // namespace sightline

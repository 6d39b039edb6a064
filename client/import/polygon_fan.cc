// SPDX-License-Identifier: Apache-2.0
#include "client/import/polygon_fan.h"

#include "absl/strings/str_cat.h"

namespace sightline {

absl::Status PolygonFan::Add(std::span<const int64_t> corners, std::vector<uint32_t>* indices) {
  if (absl::Status status = CheckWanted(cancel_, report_->polygons); !status.ok()) return status;
  ++report_->polygons;
  if (corners.size() < 3) {
    ++report_->faces_too_few_corners;
    return absl::OkStatus();
  }
  for (const int64_t corner : corners) {
    if (corner < 0 || static_cast<uint64_t>(corner) >= vertex_count_) {
      ++report_->faces_bad_index;
      return absl::OkStatus();
    }
  }
  if (absl::Status status = Charge(corners.size() - 2); !status.ok()) return status;
  if (corners.size() > 3) ++report_->polygons_fanned;
  for (size_t i = 1; i + 1 < corners.size(); ++i) {
    indices->push_back(static_cast<uint32_t>(corners[0]));
    indices->push_back(static_cast<uint32_t>(corners[i]));
    indices->push_back(static_cast<uint32_t>(corners[i + 1]));
  }
  return absl::OkStatus();
}

absl::Status PolygonFan::Charge(uint64_t triangles) {
  if (triangles > max_triangles_ - triangles_) {
    return absl::ResourceExhaustedError(
        absl::StrCat("holds more triangles than the limit max_triangles, ", max_triangles_));
  }
  triangles_ += triangles;
  return absl::OkStatus();
}

}  // namespace sightline

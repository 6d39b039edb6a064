// SPDX-License-Identifier: Apache-2.0
//
// The one converter between the library's structs and the wire's messages, and the readers of
// packed arrays.
//
// Thread safety: free functions.
#ifndef SIGHTLINE_CLIENT_LIB_CONVERT_H_
#define SIGHTLINE_CLIENT_LIB_CONVERT_H_

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "client/lib/types.h"
#include "sightline/v1/capability_service.pb.h"
#include "sightline/v1/point_set_service.pb.h"
#include "sightline/v1/scene_service.pb.h"
#include "sightline/v1/visibility_service.pb.h"

namespace sightline::client {

void ToProto(const Point3& p, v1::Vector3* out);
void ToProto(const Camera& camera, v1::Camera* out);
void ToProto(const Light& light, v1::Light* out);
void ToProto(const LeafCulling& culling, v1::LeafCulling* out);
void ToProto(const QueryOptions& options, v1::QueryOptions* out);
void ToProto(const PointOptions& options, v1::PointOptions* out);
void ToProto(const ObjectUpload& object, v1::ObjectHeader* out);
void ToProto(absl::Duration duration, google::protobuf::Duration* out);
v1::BuildPreset BuildPresetToProto(BuildPreset preset);
void ToProto(const KdTreeOptions& options, v1::KdTreeOptions* out);
void ToProto(const BinaryBvhOptions& options, v1::BinaryBvhOptions* out);

Point3 FromProto(const v1::Vector3& p);
SceneState FromProto(v1::SceneState state);
StoredScene FromProto(const v1::StoredScene& scene);
Scene FromProto(const v1::Scene& scene);
SceneObject FromProto(const v1::SceneObject& object);
PointSet FromProto(const v1::PointSet& set);
Statistics FromProto(const v1::Statistics& statistics);
Capabilities FromProto(const v1::Capabilities& capabilities);
absl::Duration FromProto(const google::protobuf::Duration& duration);

// Appends the `count` numbers that `bytes` holds to `out` at `offset`; INTERNAL if there are fewer
// or more. REQUIRES: out has room.
template <typename T>
absl::Status Unpack(absl::string_view bytes, size_t count, absl::string_view field, T* out) {
  if (bytes.size() != count * sizeof(T)) {
    return absl::InternalError(absl::StrCat("the server's reply holds ", bytes.size(), " bytes of ",
                                            field, " where ", count * sizeof(T), " are due"));
  }
  if (count > 0) std::memcpy(out, bytes.data(), bytes.size());
  return absl::OkStatus();
}

// Rows of bits, least significant first, each padded to a byte.
class BitRows {
 public:
  BitRows(absl::string_view bytes, size_t columns) : bytes_(bytes), stride_((columns + 7) / 8) {}
  bool operator()(size_t row, size_t column) const {
    return ((static_cast<unsigned char>(bytes_[row * stride_ + column / 8]) >> (column % 8)) & 1) !=
           0;
  }
  // INTERNAL unless the bytes are those of `rows` rows.
  absl::Status Check(size_t rows, absl::string_view field) const {
    if (bytes_.size() == rows * stride_) return absl::OkStatus();
    return absl::InternalError(absl::StrCat("the server's reply holds ", bytes_.size(),
                                            " bytes of ", field, " where ", rows * stride_,
                                            " are due"));
  }

 private:
  absl::string_view bytes_;
  size_t stride_;
};

}  // namespace sightline::client

#endif  // SIGHTLINE_CLIENT_LIB_CONVERT_H_

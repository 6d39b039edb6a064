// SPDX-License-Identifier: Apache-2.0
#include "server/services/capability_service.h"

#include <string>

#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include "core/base/check.h"
#include "core/mesh/builtin/builtin.h"
#include "core/mesh/scene_geometry.h"
#include "core/query/options.h"
#include "server/codec/query_codec.h"
#include "server/services/unary.h"
#include "server/version.h"

namespace sightline {
namespace {

// Field by field, by name: a limit without a field, or a field without a limit, is found by the
// first test.
void EncodeLimits(const Limits& limits, v1::Limits* out) {
  const google::protobuf::Descriptor* descriptor = out->GetDescriptor();
  const google::protobuf::Reflection* reflection = out->GetReflection();
  for (const LimitEntry& entry : LimitTable()) {
    const uint64_t value = limits.*entry.value;
    absl::string_view name = entry.name;
    const bool seconds = absl::ConsumeSuffix(&name, "_seconds");
    // "max_pin_seconds" travels as the Duration "max_pin_duration", "max_lease_seconds" as
    // "max_lease".
    const google::protobuf::FieldDescriptor* field = descriptor->FindFieldByName(std::string(name));
    if (field == nullptr && seconds) {
      field = descriptor->FindFieldByName(absl::StrCat(name, "_duration"));
    }
    SIGHTLINE_CHECK(field != nullptr) << "sightline.v1.Limits lacks " << std::string(entry.name);
    switch (field->cpp_type()) {
      case google::protobuf::FieldDescriptor::CPPTYPE_UINT32:
        reflection->SetUInt32(out, field, static_cast<uint32_t>(value));
        break;
      case google::protobuf::FieldDescriptor::CPPTYPE_UINT64:
        reflection->SetUInt64(out, field, value);
        break;
      case google::protobuf::FieldDescriptor::CPPTYPE_INT64:
        reflection->SetInt64(out, field, static_cast<int64_t>(value));
        break;
      default: {
        auto* duration =
            static_cast<google::protobuf::Duration*>(reflection->MutableMessage(out, field));
        duration->set_seconds(static_cast<int64_t>(value));
      }
    }
  }
  out->set_max_coordinate(kMaxCoordinate);
}

}  // namespace

v1::Capabilities DescribeServer(const Limits& limits, int threads) {
  v1::Capabilities out;
  out.set_version(std::string(kVersion));
  EncodeLimits(limits, out.mutable_limits());
  out.set_instruction_set(std::string(SimdTargetName(BestSimdTarget())));
  for (const SimdTarget target : {SimdTarget::kAvx512, SimdTarget::kAvx2}) {
    if (SimdTargetAvailable(target)) {
      out.add_available_instruction_sets(std::string(SimdTargetName(target)));
    }
  }
  for (const Strategy strategy : AvailableStrategies()) {
    out.add_strategies(EncodeStrategy(strategy));
  }
  out.add_encodings(v1::ENCODING_PACKED_LITTLE_ENDIAN);
  out.add_encodings(v1::ENCODING_STORED_FLOAT32);
  for (const BuiltinInfo& scene : BuiltinScenes()) out.add_builtin_scenes(std::string(scene.name));
  out.set_thread_count(static_cast<uint32_t>(threads));
  return out;
}

grpc::ServerUnaryReactor* CapabilityService::GetCapabilities(grpc::CallbackServerContext*,
                                                             const v1::GetCapabilitiesRequest*,
                                                             v1::Capabilities* response) {
  return Answer(env_, Operation::kGetCapabilities, [&] {
    *response = capabilities_;
    return absl::OkStatus();
  });
}

}  // namespace sightline

// SPDX-License-Identifier: Apache-2.0
//
// The lights of a stream's header, and their samples for whichever revision an item sees: a source
// triangle's number, and the origin if the scene was made anew, belong to a revision.
//
// Thread safety: every method from any thread.
//
//   SL_ASSIGN_OR_RETURN(LightSet lights, LightSet::Open(header.lights(), limits));
//   SL_ASSIGN_OR_RETURN(std::shared_ptr<const SampleSet> samples, lights.For(scene));
#ifndef SIGHTLINE_SERVER_STREAM_LIGHT_SET_H_
#define SIGHTLINE_SERVER_STREAM_LIGHT_SET_H_

#include <google/protobuf/repeated_ptr_field.h>

#include <cstdint>
#include <memory>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "core/base/mutex.h"
#include "core/query/options.h"
#include "core/query/shadows.h"
#include "core/scene/scene.h"
#include "server/base/limits.h"
#include "server/codec/geometry_codec.h"
#include "sightline/v1/geometry.pb.h"

namespace sightline {

class LightSet {
 public:
  using Lights = google::protobuf::RepeatedPtrField<v1::Light>;

  static absl::StatusOr<std::unique_ptr<LightSet>> Open(const Lights& lights, const Limits& limits);

  uint64_t sample_count() const { return sample_count_; }
  absl::StatusOr<std::shared_ptr<const SampleSet>> For(const std::shared_ptr<const Scene>& scene);

 private:
  LightSet(const Lights& lights, uint64_t samples) : lights_(lights), sample_count_(samples) {}

  const Lights lights_;
  const uint64_t sample_count_;
  Mutex mutex_;
  std::weak_ptr<const Scene> scene_ ABSL_GUARDED_BY(mutex_);  // What `samples_` are for.
  std::shared_ptr<const SampleSet> samples_ ABSL_GUARDED_BY(mutex_);
};

// core's ComputeShadows for a set, whose weights it takes where their sums are wanted.
absl::Status ComputeShadows(const Scene& scene, const PointRange& points, const SampleSet& samples,
                            const ShadowOptions& shadow, const ShadowOutputs& outputs,
                            const QueryOptions& options, ShadowResult* result);

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_STREAM_LIGHT_SET_H_

// SPDX-License-Identifier: Apache-2.0
//
// The flags that say what is built over a scene: what `scene load` asks a server for, what `import`
// builds itself, and how commands that put one query to a file or a built-in scene have built what
// the query walks. Costs are ratios, sizes are triangles; ranges are those of
// core/accel/kd_builder.h and binary_bvh_builder.h, checked by whoever builds.
//
// Thread safety: plain values; belongs to one command.
//
//   BuildFlags build;
//   build.Register(&flags);
//   ... parse ...
//   SL_RETURN_IF_ERROR(build.Check(flags, argument));
//   LoadScene(session, argument, name, build.ForServer(), ...);
//   BuildScene(name, 1, objects, origin, build.ForLibrary(), pool);
// or, after RegisterForQuery,
//   SL_ASSIGN_OR_RETURN(const SceneBuild made, build.ForQuery(flags, argument, trees));
#ifndef SIGHTLINE_CLIENT_CLI_BUILD_FLAGS_H_
#define SIGHTLINE_CLIENT_CLI_BUILD_FLAGS_H_

#include <cstdint>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/cli/flags.h"
#include "client/cli/scene_argument.h"
#include "core/scene/scene.h"

namespace sightline::cli {

class BuildFlags {
 public:
  // REQUIRES: this outlives `flags`.
  void Register(FlagSet* flags);
  // All but what is built: that, a query says by what it walks.
  void RegisterForQuery(FlagSet* flags);

  const std::string& preset() const { return preset_; }
  // After Register. A usage error names a flag that would change nothing: of what is not built of
  // `argument`, or of a scene that is built already.
  absl::Status Check(const FlagSet& flags, const std::string& argument) const;
  SceneBuild ForServer() const;
  SceneBuildOptions ForLibrary() const;
  // The trees that one query of `argument` walks beside the BVH, or in its place. A usage error
  // names a flag that would change nothing: of a tree that is not walked, or of a scene that is
  // built already.
  struct Trees {
    bool kd_tree = false, binary_bvh = false;
  };
  absl::StatusOr<SceneBuild> ForQuery(const FlagSet& flags, const std::string& argument,
                                      Trees trees) const;

 private:
  void RegisterPreset(FlagSet* flags);
  void RegisterKdTree(FlagSet* flags);
  void RegisterBinaryBvh(FlagSet* flags);
  client::BuildPreset PresetForServer() const;
  client::KdTreeOptions KdTreeForServer() const;
  client::BinaryBvhOptions BinaryBvhForServer() const;
  bool with_kd_tree() const { return structure_ != "bvh"; }
  bool without_bvh() const { return structure_ == "kd-tree"; }

  std::string preset_ = "static", structure_ = "bvh";
  KdBuildOptions kd_;
  double kd_cost_ = kd_.traversal_cost, kd_max_references_ = kd_.max_references;
  uint64_t kd_min_leaf_ = 1, kd_max_leaf_ = 0, kd_depth_ = 0;
  bool binary_bvh_ = false, binary_ignore_cost_ = false;
  BinaryBvhOptions binary_;
  double binary_cost_ = binary_.cost_ratio, binary_min_extent_ = binary_.min_extent;
  uint64_t binary_bins_ = 8, binary_min_triangles_ = 1, binary_depth_ = 64;
};

}  // namespace sightline::cli

#endif  // SIGHTLINE_CLIENT_CLI_BUILD_FLAGS_H_

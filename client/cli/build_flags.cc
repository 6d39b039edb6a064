// SPDX-License-Identifier: Apache-2.0
#include "client/cli/build_flags.h"

#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "client/cli/exit_code.h"
#include "core/base/status_macros.h"

namespace sightline::cli {
namespace {

constexpr uint64_t kMostLeafTriangles = kMaxKdLeafTriangles;

constexpr absl::string_view kOfKdTree[] = {
    "kd-cost",  "kd-perfect-splits", "kd-min-leaf",      "kd-max-leaf",
    "kd-depth", "kd-max-references", "kd-lay-out-leaves"};
constexpr absl::string_view kOfBinaryBvh[] = {"binary-bins",          "binary-cost",
                                              "binary-min-triangles", "binary-depth",
                                              "binary-min-extent",    "binary-ignore-cost"};

template <size_t kCount>
absl::Status NoneGiven(const FlagSet& flags, const absl::string_view (&names)[kCount],
                       absl::string_view why) {
  for (const absl::string_view name : names) {
    if (flags.given(name)) return UsageError(absl::StrCat("--", name, " changes nothing: ", why));
  }
  return absl::OkStatus();
}

// Of a scene that is built already: all that commands of either kind register.
absl::Status NoneGivenOfBuild(const FlagSet& flags, absl::string_view why) {
  SL_RETURN_IF_ERROR(NoneGiven(flags, {"build"}, why));
  SL_RETURN_IF_ERROR(NoneGiven(flags, kOfKdTree, why));
  return NoneGiven(flags, kOfBinaryBvh, why);
}

bool IsBuilt(const std::string& argument) {
  const SceneKind kind = KindOf(argument);
  return kind == SceneKind::kServer || kind == SceneKind::kNative;
}

std::string WhyBuilt(const std::string& argument) {
  return absl::StrCat("'", argument, "' is built already");
}

}  // namespace

void BuildFlags::Register(FlagSet* flags) {
  RegisterPreset(flags);
  flags->Choice("structure", {"bvh", "kd-tree", "both"},
                "what is built: the BVH, a kd-tree instead of it, or a kd-tree beside it, for "
                "--structure KD_TREE and --strategy RTT of queries",
                &structure_);
  RegisterKdTree(flags);
  flags->Switch("binary-bvh",
                "also build a binary BVH with large leaves, for --structure BINARY_BVH",
                &binary_bvh_);
  RegisterBinaryBvh(flags);
}

void BuildFlags::RegisterForQuery(FlagSet* flags) {
  flags->Heading("What is built, of a file or a built-in scene");
  RegisterPreset(flags);
  RegisterKdTree(flags);
  RegisterBinaryBvh(flags);
}

void BuildFlags::RegisterPreset(FlagSet* flags) {
  flags->Choice("build", {"static", "dynamic", "compact"},
                "what the build favours: fast answers, being built fast, or little memory",
                &preset_);
}

void BuildFlags::RegisterKdTree(FlagSet* flags) {
  flags->Number("kd-cost", "RATIO",
                "of the kd-tree: cost of a node over that of a triangle's test, 0.01 to 10; less "
                "makes a deeper tree",
                &kd_cost_);
  flags->Switch("kd-perfect-splits", "of the kd-tree: cut triangles to its cells, not their boxes",
                &kd_.perfect_splits);
  flags->Count("kd-min-leaf", "N", "of the kd-tree: cells of so few triangles stay whole",
               &kd_min_leaf_, 1, kMostLeafTriangles);
  flags->Count("kd-max-leaf", "N",
               "of the kd-tree: cells of more are split where that takes anything off; 0: as the "
               "costs say",
               &kd_max_leaf_, 0, kMostLeafTriangles);
  flags->Count("kd-depth", "N", "of the kd-tree: nodes on a path; 0: 8 + 1.3 log2 of the triangles",
               &kd_depth_, 0, kMaxKdDepth);
  flags->Number("kd-max-references", "RATIO",
                "of the kd-tree: triangles that leaves name over triangles, 1 to 64; no split that "
                "would exceed it is made",
                &kd_max_references_);
  flags->Switch(
      "kd-lay-out-leaves",
      "of the kd-tree: keep the leaves' triangles beside it, 64 bytes for each named, for "
      "--leaf-culling of queries",
      &kd_.lay_out_leaves);
}

void BuildFlags::RegisterBinaryBvh(FlagSet* flags) {
  flags->Count("binary-bins", "N", "of the binary BVH: bins along the longest axis", &binary_bins_,
               2, kMaxBinaryBvhBins);
  flags->Number("binary-cost", "RATIO",
                "of the binary BVH: cost of a triangle's test over that of a node, 0.001 to 1000; "
                "less makes larger leaves",
                &binary_cost_);
  flags->Count("binary-min-triangles", "N", "of the binary BVH: branches of so few triangles end",
               &binary_min_triangles_, 1, kMostLeafTriangles);
  flags->Count("binary-depth", "N", "of the binary BVH: branches as deep end", &binary_depth_, 1,
               kMaxBinaryBvhDepth);
  flags->Number("binary-min-extent", "SHARE",
                "of the binary BVH: branches end whose centroids' box is no longer than this share "
                "of the scene's, 0 to 1; by default one rounding",
                &binary_min_extent_);
  flags->Switch("binary-ignore-cost",
                "of the binary BVH: branches go on where a leaf would be cheaper",
                &binary_ignore_cost_);
}

absl::Status BuildFlags::Check(const FlagSet& flags, const std::string& argument) const {
  if (IsBuilt(argument)) {
    const std::string why = WhyBuilt(argument);
    SL_RETURN_IF_ERROR(NoneGiven(flags, {"structure", "binary-bvh"}, why));
    return NoneGivenOfBuild(flags, why);
  }
  if (without_bvh()) {
    SL_RETURN_IF_ERROR(
        NoneGiven(flags, {"build"}, "no BVH is built with --structure kd-tree, but with both"));
  }
  if (!with_kd_tree()) {
    SL_RETURN_IF_ERROR(
        NoneGiven(flags, kOfKdTree, "a kd-tree is built with --structure kd-tree or both"));
  }
  if (!binary_bvh_) {
    SL_RETURN_IF_ERROR(NoneGiven(flags, kOfBinaryBvh, "a binary BVH is built with --binary-bvh"));
  }
  return absl::OkStatus();
}

SceneBuild BuildFlags::ForServer() const {
  SceneBuild build;
  build.preset = PresetForServer();
  build.without_bvh = without_bvh();
  if (with_kd_tree()) build.kd_tree = KdTreeForServer();
  if (binary_bvh_) build.binary_bvh = BinaryBvhForServer();
  return build;
}

absl::StatusOr<SceneBuild> BuildFlags::ForQuery(const FlagSet& flags, const std::string& argument,
                                                Trees trees) const {
  if (IsBuilt(argument)) SL_RETURN_IF_ERROR(NoneGivenOfBuild(flags, WhyBuilt(argument)));
  if (!trees.kd_tree) {
    SL_RETURN_IF_ERROR(NoneGiven(flags, kOfKdTree,
                                 "a kd-tree is walked with --structure KD_TREE or --strategy RTT"));
  }
  if (!trees.binary_bvh) {
    SL_RETURN_IF_ERROR(
        NoneGiven(flags, kOfBinaryBvh, "a binary BVH is walked with --structure BINARY_BVH"));
  }
  SceneBuild build;
  build.preset = PresetForServer();
  if (trees.kd_tree) build.kd_tree = KdTreeForServer();
  if (trees.binary_bvh) build.binary_bvh = BinaryBvhForServer();
  return build;
}

client::BuildPreset BuildFlags::PresetForServer() const {
  return preset_ == "dynamic"   ? client::BuildPreset::kDynamic
         : preset_ == "compact" ? client::BuildPreset::kCompact
                                : client::BuildPreset::kStatic;
}

client::KdTreeOptions BuildFlags::KdTreeForServer() const {
  return {.traversal_cost = kd_cost_,
          .perfect_splits = kd_.perfect_splits,
          .min_leaf_triangles = static_cast<uint32_t>(kd_min_leaf_),
          .max_leaf_triangles = static_cast<uint32_t>(kd_max_leaf_),
          .max_depth = static_cast<uint32_t>(kd_depth_),
          .max_references = kd_max_references_,
          .lay_out_leaves = kd_.lay_out_leaves};
}

client::BinaryBvhOptions BuildFlags::BinaryBvhForServer() const {
  return {.bins = static_cast<uint32_t>(binary_bins_),
          .cost_ratio = binary_cost_,
          .min_triangles = static_cast<uint32_t>(binary_min_triangles_),
          .max_depth = static_cast<uint32_t>(binary_depth_),
          .ignore_cost = binary_ignore_cost_,
          .min_extent = binary_min_extent_};
}

SceneBuildOptions BuildFlags::ForLibrary() const {
  SceneBuildOptions options;
  options.bvh = BvhPresetOptions(preset_ == "dynamic"   ? BvhPreset::kDynamic
                                 : preset_ == "compact" ? BvhPreset::kCompact
                                                        : BvhPreset::kStatic);
  options.without_bvh = without_bvh();
  if (with_kd_tree()) {
    options.kd_tree = kd_;
    options.kd_tree->traversal_cost = static_cast<float>(kd_cost_);
    options.kd_tree->min_leaf_triangles = static_cast<int>(kd_min_leaf_);
    options.kd_tree->max_leaf_triangles = static_cast<int>(kd_max_leaf_);
    options.kd_tree->max_depth = static_cast<int>(kd_depth_);
    options.kd_tree->max_references = static_cast<float>(kd_max_references_);
  }
  if (binary_bvh_) {
    options.binary_bvh = BinaryBvhOptions{.bins = static_cast<int>(binary_bins_),
                                          .cost_ratio = static_cast<float>(binary_cost_),
                                          .min_triangles = static_cast<int>(binary_min_triangles_),
                                          .max_depth = static_cast<int>(binary_depth_),
                                          .stop_by_cost = !binary_ignore_cost_,
                                          .min_extent = static_cast<float>(binary_min_extent_)};
  }
  return options;
}

}  // namespace sightline::cli

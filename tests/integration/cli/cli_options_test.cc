// SPDX-License-Identifier: Apache-2.0
//
// How a query and a build are to be gone about comes from the command line to the engine as it was
// said, through the client library, the wire and the server's codec: each option by itself, and
// nothing with it. Answers cannot tell, since none of these changes one.
#include <cstdint>
#include <functional>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "client/cli/build_flags.h"
#include "client/cli/commands/command.h"
#include "client/lib/convert.h"
#include "core/accel/binary_bvh_builder.h"
#include "core/accel/kd_builder.h"
#include "core/query/options.h"
#include "core/traverse/rtt.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "server/codec/query_codec.h"
#include "server/codec/scene_codec.h"

namespace sightline::cli {
namespace {

// All there is to compare. A field that is not named here does not compile.
auto FieldsOf(const LeafCulling& culling) {
  const auto& [tree, intersector, side_planes, near_far, aperture, aperture_first, skip_edges,
               frustum, first_axis, ray_mask, node_test, split, ray_box, ray_box_min_triangles,
               ray_box_update, mailbox, cell_boxes] = culling;
  return std::make_tuple(tree, intersector, side_planes, near_far, aperture, aperture_first,
                         skip_edges, frustum, first_axis, ray_mask, node_test, split, ray_box,
                         ray_box_min_triangles, ray_box_update, mailbox, cell_boxes);
}

auto FieldsOf(const QueryOptions& options) {
  const auto& [strategy, structure, antialiasing, shared_edges, side_by_side, culling, intersector,
               packet_side, pixel_shadow_packets, simd, mask, cancel, count_answers] = options;
  static_cast<void>(culling);  // Compared by itself.
  return std::make_tuple(strategy, structure, antialiasing, shared_edges, side_by_side, intersector,
                         packet_side, pixel_shadow_packets, simd, mask, cancel, count_answers);
}

auto FieldsOf(const KdBuildOptions& options) {
  const auto& [cost, perfect, min_leaf, max_leaf, depth, references, bytes, laid_out] = options;
  return std::make_tuple(cost, perfect, min_leaf, max_leaf, depth, references, bytes, laid_out);
}

auto FieldsOf(const BinaryBvhOptions& options) {
  const auto& [bins, cost, min_triangles, depth, stop_by_cost, min_extent] = options;
  return std::make_tuple(bins, cost, min_triangles, depth, stop_by_cost, min_extent);
}

// What the engine is asked with, of these flags.
QueryOptions Asked(const std::vector<std::string>& args) {
  StrategyFlags strategy;
  FlagSet flags("test", "test");
  strategy.Register(&flags);
  const auto words = flags.Parse(args);
  EXPECT_TRUE(words.ok()) << words.status();
  client::QueryOptions options;
  strategy.Apply(&options);
  v1::QueryOptions wire;
  client::ToProto(options, &wire);
  const absl::StatusOr<DecodedOptions> decoded = DecodeOptions(wire);
  EXPECT_TRUE(decoded.ok()) << decoded.status();
  return decoded.ok() ? decoded->query : QueryOptions();
}

void ExpectSame(const QueryOptions& asked, const QueryOptions& meant) {
  EXPECT_EQ(FieldsOf(asked), FieldsOf(meant));
  ASSERT_EQ(asked.leaf_culling.has_value(), meant.leaf_culling.has_value());
  if (!meant.leaf_culling) return;
  EXPECT_EQ(FieldsOf(*asked.leaf_culling), FieldsOf(*meant.leaf_culling));
}

TEST(CliOptionsTest, EveryWordOfLeafCullingIsItsOption) {
  const std::pair<const char*, std::function<void(LeafCulling*)>> kWords[] = {
      {"side-planes", [](LeafCulling* c) { c->side_planes = true; }},
      {"near-far", [](LeafCulling* c) { c->near_far = true; }},
      {"aperture", [](LeafCulling* c) { c->aperture = true; }},
      {"aperture-first", [](LeafCulling* c) { c->aperture_first = true; }},
      {"skip-edges", [](LeafCulling* c) { c->skip_edges = true; }},
      {"rows", [](LeafCulling* c) { c->frustum = FrustumRays::kRows; }},
      {"masked", [](LeafCulling* c) { c->frustum = FrustumRays::kMasked; }},
      {"first-axis", [](LeafCulling* c) { c->first_axis = true; }},
      {"ray-mask", [](LeafCulling* c) { c->ray_mask = true; }},
      {"split-to-rays", [](LeafCulling* c) { c->split = PacketSplit::kSingleRays; }},
      {"corner-nodes", [](LeafCulling* c) { c->node_test = NodeTest::kCorners; }},
      {"all-ray-nodes", [](LeafCulling* c) { c->node_test = NodeTest::kAllRays; }},
      {"ray-box", [](LeafCulling* c) { c->ray_box = true; }},
      {"ray-box-fixed", [](LeafCulling* c) { c->ray_box_update = false; }},
      {"ray-box-from=9", [](LeafCulling* c) { c->ray_box = true, c->ray_box_min_triangles = 9; }},
      {"mailbox", [](LeafCulling* c) { c->mailbox = true; }},
      {"cell-boxes", [](LeafCulling* c) { c->cell_boxes = true; }}};
  for (const auto& [word, set] : kWords) {
    SCOPED_TRACE(word);
    QueryOptions meant;
    meant.leaf_culling = LeafCulling::None();
    set(&*meant.leaf_culling);
    EXPECT_NE(FieldsOf(*meant.leaf_culling), FieldsOf(LeafCulling::None()));
    ExpectSame(Asked({"--leaf-culling", word}), meant);
  }
  QueryOptions two;
  two.leaf_culling = LeafCulling::None();
  two.leaf_culling->aperture = two.leaf_culling->mailbox = true;
  ExpectSame(Asked({"--leaf-culling", "mailbox,aperture"}), two);
}

TEST(CliOptionsTest, EveryChoiceOfAQueryIsItsOption) {
  ExpectSame(Asked({}), QueryOptions());
  ExpectSame(Asked({"--mask", "5"}), {.mask = 5});
  ExpectSame(Asked({"--mask", "0"}), {.mask = 0});
  ExpectSame(Asked({"--mask", "0x80000002"}), {.mask = 0x80000002u});
  for (int i = 0; StrategyName(static_cast<Strategy>(i)) != "UNKNOWN"; ++i) {
    QueryOptions meant;
    meant.strategy = static_cast<Strategy>(i);
    ExpectSame(Asked({"--strategy", std::string(StrategyName(meant.strategy))}), meant);
  }
  for (int i = 0; StructureName(static_cast<Structure>(i)) != "UNKNOWN"; ++i) {
    QueryOptions meant;
    meant.structure = static_cast<Structure>(i);
    ExpectSame(Asked({"--structure", std::string(StructureName(meant.structure))}), meant);
  }
  for (int i = 0; IntersectorName(static_cast<Intersector>(i)) != "UNKNOWN"; ++i) {
    QueryOptions meant;
    meant.intersector = static_cast<Intersector>(i);
    const std::string name = absl::AsciiStrToLower(IntersectorName(meant.intersector));
    ExpectSame(Asked({"--intersector", absl::StrReplaceAll(name, {{"_", "-"}})}), meant);
  }
  for (const int side : kPacketSides) {
    ExpectSame(Asked({"--packet-side", absl::StrCat(side)}), {.packet_side = side});
  }
  ExpectSame(Asked({"--pixel-shadow-packets"}), {.pixel_shadow_packets = true});
  for (int n = 1; n <= kMaxRttAntialiasing; ++n) {
    ExpectSame(Asked({"--rtt-antialiasing", absl::StrCat(n)}), {.rtt_antialiasing = n});
  }
  ExpectSame(Asked({"--rtt-shared-edges"}), {.rtt_shared_edges = true});
  for (int n = 0; n <= kMaxRttSideBySide; ++n) {
    ExpectSame(Asked({"--rtt-side-by-side", absl::StrCat(n)}), {.rtt_side_by_side = n});
  }
}

// What a query of `argument` is to have built with these flags.
absl::StatusOr<SceneBuild> BuiltForQuery(const std::vector<std::string>& args,
                                         const std::string& argument) {
  StrategyFlags strategy;
  BuildFlags build;
  FlagSet flags("test", "test");
  strategy.Register(&flags);
  build.RegisterForQuery(&flags);
  const auto words = flags.Parse(args);
  EXPECT_TRUE(words.ok()) << words.status();
  return build.ForQuery(flags, argument, strategy.Trees());
}

TEST(CliOptionsTest, AQueryHasBuiltWhatItWalksAsItsFlagsSay) {
  const absl::StatusOr<SceneBuild> plain = BuiltForQuery({}, "builtin:box");
  ASSERT_TRUE(plain.ok()) << plain.status();
  EXPECT_FALSE(plain->kd_tree || plain->binary_bvh || plain->without_bvh);
  const std::vector<std::string> kd = {"--kd-cost",
                                       "0.5",
                                       "--kd-perfect-splits",
                                       "--kd-min-leaf",
                                       "2",
                                       "--kd-max-leaf",
                                       "16",
                                       "--kd-depth",
                                       "20",
                                       "--kd-max-references",
                                       "3",
                                       "--kd-lay-out-leaves"};
  for (const std::vector<std::string>& walk : std::vector<std::vector<std::string>>{
           {"--strategy", "RTT"}, {"--structure", "KD_TREE", "--build", "compact"}}) {
    std::vector<std::string> args = kd;
    args.insert(args.end(), walk.begin(), walk.end());
    const absl::StatusOr<SceneBuild> build = BuiltForQuery(args, "bunny.ply");
    ASSERT_TRUE(build.ok()) << build.status();
    EXPECT_EQ(build->preset,
              walk.size() == 2 ? client::BuildPreset::kStatic : client::BuildPreset::kCompact);
    ASSERT_TRUE(build->kd_tree);
    EXPECT_FALSE(build->binary_bvh);
    v1::KdTreeOptions wire;
    client::ToProto(*build->kd_tree, &wire);
    const auto decoded = DecodeKdTree(wire);
    ASSERT_TRUE(decoded.ok()) << decoded.status();
    EXPECT_EQ(FieldsOf(*decoded), FieldsOf(KdBuildOptions{.traversal_cost = 0.5f,
                                                          .perfect_splits = true,
                                                          .min_leaf_triangles = 2,
                                                          .max_leaf_triangles = 16,
                                                          .max_depth = 20,
                                                          .max_references = 3,
                                                          .lay_out_leaves = true}));
  }
  const absl::StatusOr<SceneBuild> binary =
      BuiltForQuery({"--structure", "BINARY_BVH", "--binary-bins", "64"}, "builtin:box");
  ASSERT_TRUE(binary.ok()) << binary.status();
  ASSERT_TRUE(binary->binary_bvh);
  EXPECT_EQ(binary->binary_bvh->bins, 64u);
  EXPECT_FALSE(binary->kd_tree);
}

// A flag that changes nothing is a mistake, not silence.
TEST(CliOptionsTest, FlagsOfWhatIsNotBuiltAreRefused) {
  const auto refused = [](const std::vector<std::string>& args, const std::string& argument) {
    return std::string(BuiltForQuery(args, argument).status().message());
  };
  EXPECT_THAT(refused({"--kd-cost", "2"}, "builtin:box"),
              testing::HasSubstr("--kd-cost changes nothing: a kd-tree is walked with"));
  EXPECT_THAT(refused({"--binary-bins", "2", "--strategy", "RTT"}, "builtin:box"),
              testing::HasSubstr("--binary-bins changes nothing"));
  for (const char* argument : {"scenes/city", "city.slscene"}) {
    EXPECT_THAT(refused({"--strategy", "RTT", "--kd-cost", "2"}, argument),
                testing::HasSubstr("is built already"));
    EXPECT_THAT(refused({"--build", "dynamic"}, argument), testing::HasSubstr("is built already"));
    EXPECT_EQ(refused({"--strategy", "RTT"}, argument), "");
  }
}

// Of a build both ways: what a server is asked for, and what `import` builds itself.
void ExpectBuilt(std::vector<std::string> args, const KdBuildOptions& kd,
                 const BinaryBvhOptions& binary) {
  SCOPED_TRACE(args.empty() ? "" : args[0]);
  args.insert(args.end(), {"--structure", "both", "--binary-bvh"});
  BuildFlags build;
  FlagSet flags("test", "test");
  build.Register(&flags);
  const auto words = flags.Parse(args);
  ASSERT_TRUE(words.ok()) << words.status();
  const SceneBuildOptions library = build.ForLibrary();
  ASSERT_TRUE(library.kd_tree.has_value() && library.binary_bvh.has_value());
  EXPECT_EQ(FieldsOf(*library.kd_tree), FieldsOf(kd));
  EXPECT_EQ(FieldsOf(*library.binary_bvh), FieldsOf(binary));
  EXPECT_FALSE(library.without_bvh);
  const SceneBuild server = build.ForServer();
  ASSERT_TRUE(server.kd_tree.has_value() && server.binary_bvh.has_value());
  EXPECT_FALSE(server.without_bvh);
  v1::KdTreeOptions wire_kd;
  v1::BinaryBvhOptions wire_binary;
  client::ToProto(*server.kd_tree, &wire_kd);
  client::ToProto(*server.binary_bvh, &wire_binary);
  const auto decoded_kd = DecodeKdTree(wire_kd);
  ASSERT_TRUE(decoded_kd.ok()) << decoded_kd.status();
  EXPECT_EQ(FieldsOf(*decoded_kd), FieldsOf(kd));
  const auto decoded_binary = DecodeBinaryBvh(wire_binary);
  ASSERT_TRUE(decoded_binary.ok()) << decoded_binary.status();
  EXPECT_EQ(FieldsOf(*decoded_binary), FieldsOf(binary));
}

TEST(CliOptionsTest, EveryFlagOfABuildIsItsOption) {
  ExpectBuilt({}, {}, {});
  ExpectBuilt({"--kd-cost", "0.01"}, {.traversal_cost = 0.01f}, {});
  ExpectBuilt({"--kd-cost", "10"}, {.traversal_cost = 10}, {});
  ExpectBuilt({"--kd-perfect-splits"}, {.perfect_splits = true}, {});
  ExpectBuilt({"--kd-min-leaf", "16"}, {.min_leaf_triangles = 16}, {});
  ExpectBuilt({"--kd-max-leaf", "32"}, {.max_leaf_triangles = 32}, {});
  ExpectBuilt({"--kd-depth", "20"}, {.max_depth = 20}, {});
  ExpectBuilt({"--kd-max-references", "3.5"}, {.max_references = 3.5f}, {});
  ExpectBuilt({"--kd-lay-out-leaves"}, {.lay_out_leaves = true}, {});
  ExpectBuilt({"--binary-bins", "2"}, {}, {.bins = 2});
  ExpectBuilt({"--binary-bins", "1024"}, {}, {.bins = 1024});
  ExpectBuilt({"--binary-cost", "0.1"}, {}, {.cost_ratio = 0.1f});
  ExpectBuilt({"--binary-min-triangles", "8"}, {}, {.min_triangles = 8});
  ExpectBuilt({"--binary-depth", "20"}, {}, {.max_depth = 20});
  ExpectBuilt({"--binary-ignore-cost"}, {}, {.stop_by_cost = false});
  ExpectBuilt({"--binary-min-extent", "0.25"}, {}, {.min_extent = 0.25f});
}

}  // namespace
}  // namespace sightline::cli

// SPDX-License-Identifier: Apache-2.0
//
// scene load|list|show|delete, health, check and help.
#include <nlohmann/json.hpp>

#include "absl/strings/str_split.h"
#include "tests/integration/cli/cli_testing.h"
#include "tests/support/scenes.h"

namespace sightline::cli {
namespace {

using ::testing::HasSubstr;

TEST_F(CliTest, ScenesComeAndGo) {
  const std::unique_ptr<Server> server = StartServer();
  ASSERT_NE(server, nullptr);
  const std::string flag = ServerFlag(*server);
  const std::string obj = Write("small.obj", kSmallObj);
  EXPECT_THAT(Good({"scene", "load", obj, "--name", "small", flag}).out, HasSubstr("scenes/small"));
  const RunResult list = Good({"scene", "list", flag, "--output", "json"});
  const nlohmann::json scenes = nlohmann::json::parse(list.out);
  ASSERT_EQ(scenes.size(), 1u);
  EXPECT_EQ(scenes[0]["name"], "scenes/small");
  EXPECT_EQ(scenes[0]["triangles"], 10);
  EXPECT_EQ(scenes[0]["objects"], 4);
  EXPECT_EQ(scenes[0]["state"], "ready");
  const RunResult show = Good({"scene", "show", "small", "--objects", flag});
  for (const char* object : {"floor", "wall", "roof", "post"})
    EXPECT_THAT(show.out, HasSubstr(object));

  // The scene on the server and the file give the same picture.
  Good({"view", "scenes/small", flag, "--size", "32x24", "--up", "0,0,1", "--ids", File("a.npy")});
  Good({"view", obj, flag, "--size", "32x24", "--up", "0,0,1", "--ids", File("b.npy")});
  EXPECT_TRUE(Read(File("a.npy")) == Read(File("b.npy")));
  // What view loaded for itself is gone.
  EXPECT_EQ(nlohmann::json::parse(Good({"scene", "list", flag, "--output", "json"}).out).size(),
            1u);

  Bad(kExitData, {"scene", "load", obj, "--name", "small", flag}, {"small"});
  EXPECT_THAT(Good({"scene", "delete", "scenes/small", flag}).out,
              HasSubstr("deleted scenes/small"));
  Bad(kExitNoInput, {"scene", "show", "small", flag}, {"scenes/small"});
  Bad(kExitNoInput, {"scene", "delete", "small", flag}, {"scenes/small"});
  Bad(kExitNoInput, {"view", "scenes/small", flag, "--stats"}, {"scenes/small"});
}

// A kd-tree is asked for when a scene is loaded; a query
// that needs one says so where it is not there.
TEST_F(CliTest, KdTreesBesideTheBvh) {
  const std::unique_ptr<Server> server = StartServer();
  ASSERT_NE(server, nullptr);
  const std::string flag = ServerFlag(*server);
  const std::string obj = Write("small.obj", kSmallObj);
  Good({"scene", "load", obj, "--name", "plain", flag});
  const nlohmann::json json = nlohmann::json::parse(
      Good({"scene", "load", obj, "--name", "both", "--structure", "both", "--kd-cost", "0.1",
            "--kd-perfect-splits", flag, "--output", "json"})
          .out);
  EXPECT_GT(json["build_report"]["kd_tree"]["references"], 9);
  EXPECT_THAT(Good({"scene", "show", "both", flag}).out, HasSubstr("kd-tree"));
  const auto ids = [&](const char* scene, const char* strategy) {
    Good({"view", scene, flag, "--size", "37x29", "--up", "0,0,1", "--strategy", strategy, "--ids",
          File("ids.npy")});
    return Read(File("ids.npy"));
  };
  EXPECT_TRUE(ids("scenes/both", "RTT") == ids("scenes/plain", "BRUTE_FORCE"));
  Bad(kExitData, {"view", "scenes/plain", flag, "--stats", "--strategy", "RTT"}, {"kd-tree"});
  Bad(kExitData, {"view", "scenes/plain", flag, "--stats", "--structure", "KD_TREE"}, {"kd-tree"});
  Bad(kExitData, {"scene", "load", obj, "--structure", "both", "--kd-cost", "99", flag},
      {"traversal_cost = 99"});
  Bad(kExitData, {"scene", "load", obj, "--structure", "both", "--kd-max-references", "65", flag},
      {"max_references = 65"});
}

// A kd-tree in place of the BVH answers whatever leaves the structure open, also out of a
// native scene file, and with a binary BVH beside it.
TEST_F(CliTest, KdTreesAlone) {
  const std::unique_ptr<Server> server = StartServer();
  ASSERT_NE(server, nullptr);
  const std::string flag = ServerFlag(*server);
  const std::string obj = Write("small.obj", kSmallObj);
  Good({"scene", "load", obj, "--name", "plain", flag});
  const nlohmann::json json = nlohmann::json::parse(
      Good({"scene", "load", obj, "--name", "alone", "--structure", "kd-tree", "--kd-min-leaf", "3",
            "--kd-lay-out-leaves", "--binary-bvh", flag, "--output", "json"})
          .out);
  EXPECT_EQ(json["build_report"]["nodes"], 0);
  EXPECT_GT(json["build_report"]["kd_tree"]["nodes"], 0);
  const std::string native = File("alone.slscene");
  Good({"import", obj, "-o", native, "--structure", "kd-tree", "--binary-bvh"});
  EXPECT_THAT(Good({"check", native}).out, HasSubstr("binary bvh nodes"));
  const auto lit = [&](const std::vector<std::string>& way) {
    std::vector<std::string> args = {"view",    "--size", "37x29", "--up",         "0,0,1",
                                     "--light", "1,2,9",  "--lit", File("lit.npy")};
    args.insert(args.end(), way.begin(), way.end());
    Good(args);
    return Read(File("lit.npy"));
  };
  const auto truth = lit({"scenes/plain", flag, "--strategy", "BRUTE_FORCE"});
  for (const std::vector<std::string>& where :
       {std::vector<std::string>{"scenes/alone", flag}, std::vector<std::string>{native}}) {
    for (const std::vector<std::string>& how :
         {std::vector<std::string>{},
          {"--strategy", "RTT"},
          {"--structure", "BINARY_BVH"},
          {"--structure", "KD_TREE", "--strategy", "PACKET", "--leaf-culling",
           "masked,side-planes,cell-boxes"}}) {
      std::vector<std::string> way = where;
      way.insert(way.end(), how.begin(), how.end());
      EXPECT_TRUE(lit(way) == truth);
    }
  }
  Bad(kExitData, {"view", "scenes/alone", flag, "--stats", "--strategy", "SHAFT"},
      {"strategy SHAFT needs a BVH"});
  Bad(kExitData, {"view", native, "--stats", "--structure", "BVH"}, {"structure BVH needs a BVH"});
}

// As are a binary BVH, and the tests that a query may let decide.
TEST_F(CliTest, BinaryBvhsAndIntersectors) {
  const std::unique_ptr<Server> server = StartServer();
  ASSERT_NE(server, nullptr);
  const std::string flag = ServerFlag(*server);
  const std::string obj = Write("small.obj", kSmallObj);
  Good({"scene", "load", obj, "--name", "plain", flag});
  const nlohmann::json json = nlohmann::json::parse(
      Good({"scene", "load", obj, "--name", "binary", "--binary-bvh", "--binary-bins", "32",
            "--binary-cost", "0.1", flag, "--output", "json"})
          .out);
  EXPECT_GT(json["build_report"]["binary_bvh"]["leaves"], 0);
  // Each of its rules to stop comes through: no branch is longer than all of the scene.
  const nlohmann::json whole = nlohmann::json::parse(
      Good({"scene", "load", obj, "--name", "whole", "--binary-bvh", "--binary-ignore-cost",
            "--binary-min-extent", "1", flag, "--output", "json"})
          .out);
  EXPECT_EQ(whole["build_report"]["binary_bvh"]["leaves"], 1);
  Good({"import", obj, "-o", File("whole.slscene"), "--binary-bvh", "--binary-ignore-cost",
        "--binary-min-extent", "1"});
  const nlohmann::json native =
      nlohmann::json::parse(Good({"check", File("whole.slscene"), "--output", "json"}).out);
  bool found = false;
  for (const nlohmann::json& section : native["sections"]) {
    if (section["name"] != "binary bvh nodes") continue;
    found = true;
    EXPECT_EQ(section["elements"], 1);
  }
  EXPECT_TRUE(found);
  EXPECT_THAT(Good({"scene", "show", "binary", flag}).out, HasSubstr("binary BVH"));
  const auto ids = [&](const std::vector<std::string>& way) {
    std::vector<std::string> args = {"view", flag,    "--size", "37x29",
                                     "--up", "0,0,1", "--ids",  File("ids.npy")};
    args.insert(args.end(), way.begin(), way.end());
    Good(args);
    return Read(File("ids.npy"));
  };
  const auto truth = ids({"scenes/plain", "--strategy", "BRUTE_FORCE"});
  EXPECT_TRUE(ids({"scenes/binary", "--structure", "BINARY_BVH"}) == truth);
  EXPECT_TRUE(ids({"scenes/binary", "--structure", "BINARY_BVH", "--strategy", "PACKET",
                   "--leaf-culling", "aperture,skip-edges,corner-nodes"}) == truth);
  // Ordinary triangles: the published tests see what the exact one does.
  EXPECT_TRUE(ids({"scenes/plain", "--strategy", "PACKET", "--intersector", "wald"}) == truth);
  for (const char* test : {"havel-herout", "havel-herout-divided", "havel-herout-dot-product"}) {
    for (const char* strategy : {"SINGLE", "BRUTE_FORCE"}) {
      EXPECT_TRUE(ids({"scenes/plain", "--strategy", strategy, "--intersector", test}) == truth)
          << test << ", " << strategy;
    }
  }
  Bad(kExitData, {"view", "scenes/plain", flag, "--stats", "--structure", "BINARY_BVH"},
      {"binary BVH"});
  Bad(kExitData, {"view", "scenes/plain", flag, "--stats", "--intersector", "wald"},
      {"intersector WALD", "SINGLE, PACKET and BRUTE_FORCE"});
  Bad(kExitData,
      {"view", "scenes/plain", flag, "--stats", "--strategy", "PACKET", "--intersector",
       "havel-herout-dot-product"},
      {"HAVEL_HEROUT_DOT_PRODUCT", "SINGLE and BRUTE_FORCE"});
  Bad(kExitData,
      {"view", "scenes/plain", flag, "--stats", "--strategy", "PACKET", "--packet-side", "5"},
      {"packet_side = 5"});
  Bad(kExitUsage, {"view", "scenes/plain", flag, "--stats", "--leaf-culling", "planes"},
      {"'planes' is none of", "side-planes", "ray-box-from=N"});
  for (const char* word : {"ray-box-from=0", "ray-box-from=x", "ray-box-from=1048577"}) {
    Bad(kExitUsage, {"view", "scenes/plain", flag, "--stats", "--leaf-culling", word},
        {word, "from 1 to 1048576"});
  }
  Bad(kExitData, {"scene", "load", obj, "--binary-bvh", "--binary-cost", "9999", flag},
      {"cost_ratio is 9999"});
  Bad(kExitData, {"scene", "load", obj, "--binary-bvh", "--binary-min-extent", "-1", flag},
      {"min_extent is -1"});
}

TEST_F(CliTest, HealthOfBothServers) {
  const std::unique_ptr<Server> server = StartServer();
  ASSERT_NE(server, nullptr);
  for (const std::vector<std::string>& where :
       {std::vector<std::string>{}, {ServerFlag(*server)}}) {
    std::vector<std::string> args = {"health", "--output", "json"};
    args.insert(args.end(), where.begin(), where.end());
    const nlohmann::json json = nlohmann::json::parse(Good(args).out);
    EXPECT_EQ(json["health"], "serving");
    EXPECT_THAT(json["strategies"].get<std::vector<std::string>>(),
                testing::Contains("BRUTE_FORCE"));
    EXPECT_GT(json["limits"]["max_lights"], 0);
  }
  Bad(kExitNoInput, {"health", "--service", "no.such.Service"}, {"no.such.Service"});
}

TEST_F(CliTest, CheckTellsWhatAFileHolds) {
  const std::string obj =
      Write("odd.obj", std::string(kSmallObj) +
                           "o odd\nv nan 0 0\nv 1 1 1\nv 1 1 1\nf 21 22 23\nf 22 22 23\n"
                           "f 1 2 3\nf 1 2 99\n");
  const nlohmann::json json = nlohmann::json::parse(Good({"check", obj, "--output", "json"}).out);
  EXPECT_EQ(json["objects"], 5);
  EXPECT_EQ(json["import_report"]["faces_bad_index"], 1);
  EXPECT_EQ(json["scene_report"]["non_finite_triangles"], 1);
  EXPECT_EQ(json["scene_report"]["zero_area_triangles"], 1);
  EXPECT_EQ(json["scene_report"]["duplicate_triangles"], 1);
  EXPECT_EQ(json["bounds"][1], nlohmann::json::array({10, 10, 5}));
  EXPECT_GT(json["memory_estimate_bytes"], 0);
  const RunResult text = Good({"check", obj, "--objects"});
  EXPECT_THAT(text.out, HasSubstr("1 not finite, 1 without area"));
  EXPECT_THAT(text.out, HasSubstr("roof"));
  EXPECT_THAT(Good({"check", "builtin:box"}).out, HasSubstr("builtin"));
}

// Whatever reads a file for its triangles says what it lost, in the same words.
TEST_F(CliTest, WhatAFileLostIsSaid) {
  const std::string obj = Write("lossy.obj", std::string(kSmallObj) +
                                                 "o odd\nv nan 0 0\nf 1 2 21\n"
                                                 "f 1 2 99\nf 1 2\nl 1 2\nl 2 3\nl 3 4\n");
  const std::string said = absl::StrCat("warning: '", obj, "': ");
  const std::string losses = absl::StrCat(
      said, "2 faces with bad indices or too few corners were left out (see sightline check)\n",
      said, "1 triangles with corners that are not finite are never hit (see sightline check)\n",
      said, "3 points and lines were skipped (see sightline check)\n");
  const std::string native = File("lossy.slscene");
  const std::string segments = WriteDoubles("segments.npy", {1, 1, 1, 8, 1, 1}, 6);
  EXPECT_EQ(Good({"import", obj, "-o", native}).err, losses);
  EXPECT_EQ(Good({"segments", obj, "--segments", segments, "--out", File("hit.npy")}).err, losses);
  const std::unique_ptr<Server> server = StartServer();
  ASSERT_NE(server, nullptr);
  EXPECT_EQ(Good({"scene", "load", obj, ServerFlag(*server)}).err, losses);

  // To machines import says what check does.
  const auto report = [&](std::vector<std::string> args) {
    args.emplace_back("--output=json");
    return nlohmann::json::parse(Good(args).out)["import_report"];
  };
  const nlohmann::json imported = report({"import", obj, "-o", native});
  EXPECT_EQ(imported["faces_too_few_corners"], 1);
  EXPECT_EQ(imported["faces_bad_index"], 1);
  EXPECT_EQ(imported["non_finite_triangles"], 1);
  EXPECT_EQ(imported["skipped_primitives"], 3);
  EXPECT_EQ(imported, report({"check", obj}));
  EXPECT_EQ(report({"import", "builtin:box", "-o", native}), report({"check", "builtin:box"}));
  // A file that lost nothing is not spoken of.
  EXPECT_EQ(Good({"import", Write("small.obj", kSmallObj), "-o", native}).err, "");
}

TEST_F(CliTest, HelpListsCommandsAndFlags) {
  const std::string help = Good({"help"}).out;
  for (const std::string command :
       {"view", "shade", "segments", "check", "import", "scene load", "scene unload",
        "scene reload", "scene repository", "scene list", "scene show", "scene delete", "health"}) {
    EXPECT_THAT(help, HasSubstr(command));
    std::vector<std::string> args = {"help"};
    for (const auto& word : absl::StrSplit(command, ' ')) args.emplace_back(word);
    const std::string own = Good(args).out;
    EXPECT_THAT(own, HasSubstr("Usage: sightline " + command));
    EXPECT_THAT(own, HasSubstr("Exit codes"));
    args.erase(args.begin());
    args.emplace_back("--help");
    EXPECT_EQ(Good(args).out, own);
  }
  const std::string view = Good({"view", "--help"}).out;
  for (const char* flag :
       {"--eye",     "--at",         "--up",          "--fov",    "--size",     "--light",
        "--sun",     "--sun-at",     "--strategy-of", "--sky",    "--north",    "--out",
        "--picture", "--ids",        "--depth",       "--lit",    "--strategy", "--stats",
        "--tile",    "--threads",    "--output",      "--server", "--timeout",  "--retry",
        "--streams", "--auto-lights"}) {
    EXPECT_THAT(view, HasSubstr(absl::StrCat("\n  ", flag)));
  }
  // These ask no server, so that they know no scene of one.
  for (const char* command : {"check", "import"}) {
    const std::string own = Good({command, "--help"}).out;
    EXPECT_THAT(own, HasSubstr("builtin:NAME[:TRIANGLES]"));
    EXPECT_THAT(own, testing::Not(HasSubstr("scenes/NAME")));
  }
  EXPECT_THAT(view, HasSubstr("scenes/NAME"));
  EXPECT_THAT(Good({"--version"}).out, testing::StartsWith("sightline "));
}

}  // namespace
}  // namespace sightline::cli

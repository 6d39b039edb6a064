// SPDX-License-Identifier: Apache-2.0
//
// What the answers of a run are compared with, for every kind of scene that --scene and
// --check-scene may name.
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "client/cli/exit_code.h"
#include "client/cli/formats/file.h"
#include "client/cli/native_scene.h"
#include "client/lib/client.h"
#include "client/load/check_source.h"
#include "client/load/reference.h"
#include "client/load/server_answers.h"
#include "core/base/check.h"
#include "core/base/parallel.h"
#include "core/geometry/camera.h"
#include "core/mesh/builtin/builtin.h"
#include "core/scene/scene.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/integration/load/load_fixture.h"
#include "tests/support/temp_dir.h"

namespace sightline::load {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

constexpr char kFullBox[] = "builtin:box:10000,seed=1";

class LoadCheckTest : public LoadRunTest {
 protected:
  // The box as a file of a repository would hold it.
  std::string WriteNative(const std::string& name, const SceneBuildOptions& build = {},
                          Vec3d origin = {}) {
    const std::string path = folder_.File(name);
    const absl::StatusOr<BuiltinScene> made = MakeBuiltin({.name = "box"});
    EXPECT_TRUE(made.ok()) << made.status();
    const auto scene = BuildScene("box", 1, made->objects, origin, build, pool_);
    EXPECT_TRUE(scene.ok()) << scene.status();
    const absl::Status saved = cli::SaveSceneFile(**scene, path, pool_, nullptr);
    EXPECT_TRUE(saved.ok()) << saved;
    return path;
  }
  // A triangle before a wall, its tip at `height`.
  std::string WriteObj(const std::string& name, double height) {
    const std::string path = folder_.File(name);
    const absl::Status written = cli::WriteFile(
        path, absl::StrCat("v -4 -4 0\nv 4 -4 0\nv 4 4 0\nv -4 4 0\nv -2 -2 3\nv 2 -2 3\nv 0 ",
                           height, " 3\nf 1 2 3\nf 1 3 4\nf 5 6 7\n"));
    EXPECT_TRUE(written.ok()) << written;
    return path;
  }
  // A server that found box in its repository when it started.
  void ServeFromRepository() {
    WriteNative("box.slscene");
    StartServer({.repository = folder_.path()});
  }
  // Twenty items of points and of segments on the box, and the tiles of two cameras before it.
  static Workload BoxWorkload(uint32_t tile, uint32_t points, uint32_t segments) {
    const absl::StatusOr<BuiltinScene> made = MakeBuiltin({.name = "box"});
    SIGHTLINE_CHECK(made.ok()) << made.status();
    const BuiltinView& view = made->views[0];
    const Camera camera = *LookAt(view.eye, view.at, view.up, view.fov_y_degrees, 60, 34);
    client::Camera eye{.tan_half_fov_y = camera.tan_half_fov_y, .width = 60, .height = 34};
    eye.eye = {camera.eye.x, camera.eye.y, camera.eye.z};
    eye.right = {camera.right.x, camera.right.y, camera.right.z};
    eye.up = {camera.up.x, camera.up.y, camera.up.z};
    eye.forward = {camera.forward.x, camera.forward.y, camera.forward.z};
    client::Camera left = eye;
    left.eye[0] -= 0.1;
    std::vector<double> surface;
    for (const Vec3d v : made->objects.back().vertices) {
      surface.insert(surface.end(), {v.x, v.y, v.z});
    }
    std::vector<client::Light> lights;
    for (const Vec3d light : view.lights) {
      lights.push_back(client::Light::Point({light.x, light.y, light.z}));
    }
    absl::StatusOr<Workload> workload = Workload::Make({.scene = "scenes/box",
                                                        .cameras = {eye, left},
                                                        .lights = std::move(lights),
                                                        .mix = {1, 1, 1},
                                                        .tile_size = tile,
                                                        .points_per_item = points,
                                                        .segments_per_item = segments,
                                                        .distinct_items = 20},
                                                       std::move(surface));
    SIGHTLINE_CHECK(workload.ok()) << workload.status();
    return *std::move(workload);
  }
  // What the server says of all items, and of some, is what the engine in this process says.
  void ExpectTheEnginesAnswers(const Workload& workload, client::Strategy strategy) {
    const absl::StatusOr<client::Scene> served = Client().GetScene("scenes/box");
    ASSERT_TRUE(served.ok()) << served.status();
    const auto scene = OpenCheckScene(served->builtin, *served, pool_);
    ASSERT_TRUE(scene.ok()) << scene.status();
    for (const size_t stride : {1, 3}) {
      const absl::StatusOr<Answers> answers =
          ServerAnswers(Client(), workload, 1, strategy, stride, {});
      ASSERT_TRUE(answers.ok()) << answers.status();
      for (const Kind kind : {Kind::kTiles, Kind::kPoints, Kind::kSegments}) {
        const std::vector<Answer>& of_kind = (*answers)[static_cast<size_t>(kind)];
        ASSERT_EQ(of_kind.size(), (workload.ItemCount(kind) + stride - 1) / stride);
        for (size_t i = 0; i < of_kind.size(); ++i) {
          const absl::StatusOr<Answer> due =
              EngineAnswer(**scene, workload, {.kind = kind, .item = i * stride});
          ASSERT_TRUE(due.ok()) << due.status();
          ASSERT_FALSE(due->flags.empty());
          EXPECT_EQ(Difference(*due, of_kind[i]), "") << KindName(kind) << ' ' << i * stride;
        }
      }
    }
  }

  ThreadPool pool_{2};
  testing_support::TempDir folder_;
};

TEST_F(LoadCheckTest, AScenesOfTheServersIsCheckedAsTheBuiltinSceneThatItIs) {
  for (const char* check : {"all", "sample"}) {
    const RunResult result =
        RunWith({ServerFlag(), "--scene=box", "--workload=mixed", "--requests=80",
                 absl::StrCat("--check=", check), "--output=json"});
    ASSERT_EQ(result.code, 0) << result.err;
    EXPECT_EQ(result.json()["check_by"], "engine");
    EXPECT_EQ(result.json()["check_with"], kFullBox);
    if (std::string(check) == "all") {
      EXPECT_EQ(result.json()["checked"], 80);
    } else {
      EXPECT_GT(result.json()["checked"], 0);
      EXPECT_LT(result.json()["checked"], 80);
    }
    EXPECT_THAT(result.err, Not(HasSubstr("warning")));
  }
  EXPECT_EQ(Scenes().size(), 1u);
}

TEST_F(LoadCheckTest, AScenesOfTheRepositoryIsCheckedFromItsFile) {
  ServeFromRepository();
  for (const char* reload : {"edit", "file"}) {
    const RunResult result =
        RunWith({ServerFlag(), "--scene=box", "--check-scene", folder_.File("box.slscene"),
                 "--workload=mixed", "--requests=400", "--reload-every=50",
                 absl::StrCat("--reload-by=", reload), "--check=all", "--output=json"});
    ASSERT_EQ(result.code, 0) << result.err;
    EXPECT_EQ(result.json()["check_by"], "engine");
    EXPECT_EQ(result.json()["checked"], 400);
  }
}

TEST_F(LoadCheckTest, NativeFilesAreCheckedByThemselves) {
  SceneBuildOptions compact, kd_tree_alone;
  compact.bvh = BvhPresetOptions(BvhPreset::kCompact);
  kd_tree_alone.kd_tree.emplace();
  kd_tree_alone.without_bvh = true;
  for (const std::string& path :
       {WriteNative("plain.slscene"), WriteNative("compact.slscene", compact),
        WriteNative("kd.slscene", kd_tree_alone)}) {
    // No server, and no flag but the scene: as --help offers it.
    const RunResult result =
        RunWith({"--scene", path, "--workload=mixed", "--requests=80", "--output=json"});
    ASSERT_EQ(result.code, 0) << path << result.err;
    EXPECT_EQ(result.json()["check_with"], path);
    EXPECT_GT(result.json()["checked"], 0);
  }
}

TEST_F(LoadCheckTest, WithoutItsTrianglesAServersSceneIsCheckedAgainstTheServerLoudly) {
  ServeFromRepository();
  const RunResult small =
      RunWith({ServerFlag(), "--scene=box", "--workload=mixed", "--requests=80", "--check=all"});
  ASSERT_EQ(small.code, 0) << small.err;
  EXPECT_THAT(small.out, HasSubstr("80 answers, 0 wrong; by the server itself with BRUTE_FORCE"));
  EXPECT_THAT(small.err, AllOf(HasSubstr("warning: 'scenes/box'"), HasSubstr("--check-scene")));
  // Reading the file again changes no triangle.
  const RunResult reloaded =
      RunWith({ServerFlag(), "--scene=box", "--workload=points", "--requests=80", "--check=all",
               "--reload-every=20", "--reload-by=file", "--output=json"});
  ASSERT_EQ(reloaded.code, 0) << reloaded.err;
  EXPECT_EQ(reloaded.json()["checked"], 80);
  // Many rays on many triangles would take brute force too long.
  const RunResult large = RunWith({ServerFlag(), "--scene=box", "--requests=40", "--size=640x360",
                                   "--tile=64", "--output=json"});
  ASSERT_EQ(large.code, 0) << large.err;
  EXPECT_EQ(large.json()["check_by"], "server");
  EXPECT_EQ(large.json()["check_with"], "SINGLE");
  EXPECT_GT(large.json()["checked"], 0);
  // Nobody can say what an edit's answers will be.
  const RunResult edited =
      RunWith({ServerFlag(), "--scene=box", "--requests=40", "--reload-every=10"});
  EXPECT_EQ(edited.code, cli::kExitUsage);
  EXPECT_THAT(edited.err, AllOf(HasSubstr("--check-scene"), HasSubstr("--check none")));
  EXPECT_EQ(edited.out, "");
  const RunResult unchecked =
      RunWith({ServerFlag(), "--scene=box", "--requests=40", "--reload-every=10", "--check=none"});
  EXPECT_EQ(unchecked.code, 0) << unchecked.err;
  EXPECT_THAT(unchecked.out, HasSubstr("nothing (--check none)"));
}

// The items that the server is asked about in bulk are those of the requests, and what it says of
// them is what the engine says.
TEST_F(LoadCheckTest, TheServersOwnAnswersAreTheEngines) {
  const Workload workload = BoxWorkload(/*tile=*/16, /*points=*/33, /*segments=*/5);
  for (const auto strategy : {client::Strategy::kSingle, client::Strategy::kBruteForce}) {
    ExpectTheEnginesAnswers(workload, strategy);
  }
  EXPECT_FALSE(ServerAnswers(Client(), workload, 2, client::Strategy::kSingle, 1, {}).ok());
}

// A part of the client library's then holds of several items, and an item is of several parts.
TEST_F(LoadCheckTest, TheServersOwnAnswersAreTheEnginesWhereItTakesSmallerItemsThanTheRequests) {
  ServerOptions options{.scenes = {"box=builtin:box"}};
  options.limits.max_item_rays = 64;
  StartServer(std::move(options));
  ExpectTheEnginesAnswers(BoxWorkload(/*tile=*/13, /*points=*/50, /*segments=*/65),
                          client::Strategy::kSingle);
}

// The client library sends what an upload sends in a message, 1 MiB, where points have normals.
TEST_F(LoadCheckTest, RequestsOfMoreThanTheClientSendsAtOnceAreCheckedAgainstTheServer) {
  ServeFromRepository();
  for (const char* kind : {"points", "segments"}) {
    const RunResult result =
        RunWith({ServerFlag(), "--scene=box", absl::StrCat("--workload=", kind),
                 absl::StrCat("--", kind, "=30000"), "--distinct=3", "--requests=6", "--check=all",
                 "--output=json"});
    ASSERT_EQ(result.code, 0) << result.err;
    EXPECT_EQ(result.json()["check_by"], "server");
    EXPECT_EQ(result.json()["checked"], 6);
  }
}

// The whole tiles are refused; those at the images' lower edge are not, and are right.
TEST_F(LoadCheckTest, TilesOfMoreThanTheServerTakesDoNotSpoilTheCheckOfOthers) {
  WriteNative("box.slscene");
  ServerOptions options{.repository = folder_.path()};
  options.limits.max_item_rays = 4000;
  StartServer(std::move(options));
  const RunResult result = RunWith({ServerFlag(), "--scene=box", "--workload=tiles", "--tile=32",
                                    "--requests=48", "--check=all", "--output=json"});
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_EQ(result.json()["check_by"], "server");
  EXPECT_EQ(result.json()["checked"], 16);
}

TEST_F(LoadCheckTest, WrongAnswersAreCaught) {
  // The reference has another scene than the server: the server's answers are then wrong.
  const RunResult result = RunWith({ServerFlag(), "--scene", WriteObj("a.obj", 2), "--check-scene",
                                    WriteObj("b.obj", 1), "--requests=40", "--check=all"});
  EXPECT_EQ(result.code, kExitWrong) << result.err;
  EXPECT_THAT(result.err, HasSubstr("answers are wrong; the first: request "));
  EXPECT_THAT(result.out, HasSubstr("first wrong"));
  // Nor does a file that cannot be written hide them.
  const std::vector<std::string> full = {ServerFlag(), "--requests=20", "--check=all",
                                         "--hgrm=/dev/full", "--scene"};
  std::vector<std::string> right = full, wrong = full;
  right.push_back(WriteObj("a.obj", 2));
  wrong.insert(wrong.end(), {WriteObj("a.obj", 2), "--check-scene", WriteObj("b.obj", 1)});
  EXPECT_EQ(RunWith(right).code, cli::kExitCannotCreate);
  const RunResult both = RunWith(wrong);
  EXPECT_EQ(both.code, kExitWrong) << both.err;
  EXPECT_THAT(both.err, AllOf(HasSubstr("warning: cannot write '/dev/full'"),
                              HasSubstr("answers are wrong; the first: request ")));
  // A search ends with them: a trial is short, but wrong is wrong.
  const RunResult search =
      RunWith({ServerFlag(), "--scene", WriteObj("a.obj", 2), "--check-scene", WriteObj("b.obj", 1),
               "--requests=40", "--check=all", "--find-knee", "--rate=200", "--slo=p50=10m",
               "--trial=100ms", "--output=json"});
  EXPECT_EQ(search.code, kExitWrong) << search.err;
  EXPECT_THAT(search.err, HasSubstr("answers are wrong; the first: request "));
  EXPECT_GT(search.json()["wrong"], 0);
  EXPECT_TRUE(search.json()["knee"]["trials"].empty());
}

TEST_F(LoadCheckTest, WhatCannotBeTheServersSceneIsRefused) {
  const RunResult larger =
      RunWith({ServerFlag(), "--scene=box", "--check-scene=builtin:box:20k", "--requests=40"});
  EXPECT_EQ(larger.code, cli::kExitData);
  EXPECT_THAT(larger.err, AllOf(HasSubstr("'builtin:box:20k' is not what scenes/box is made of"),
                                HasSubstr("the server's scene 10")));
  const RunResult moved = RunWith({ServerFlag(), "--scene=box", "--requests=40", "--check-scene",
                                   WriteNative("moved.slscene", {}, Vec3d{100, 0, 0})});
  EXPECT_EQ(moved.code, cli::kExitData);
  EXPECT_THAT(moved.err, HasSubstr("it is relative to (100, 0, 0)"));
  const RunResult absent = RunWith(
      {ServerFlag(), "--scene=box", "--check-scene", folder_.File("no.slscene"), "--requests=40"});
  EXPECT_EQ(absent.code, cli::kExitNoInput);
  for (const RunResult& result : {larger, moved, absent}) EXPECT_EQ(result.out, "");
}

}  // namespace
}  // namespace sightline::load

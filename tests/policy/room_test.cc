// SPDX-License-Identifier: Apache-2.0
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/policy/room_rules.h"
#include "tests/policy/source_tree.h"

namespace sightline::policy {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

std::vector<std::string> IncludesOf(std::string path, std::string_view header) {
  return FindIncludeViolations(MakeFile(std::move(path), "#include " + std::string(header) + "\n"));
}

TEST(RoomTest, TheTreeKeepsItsOrder) {
  for (const SourceFile& file : ReadSourceTree()) {
    for (const std::string& finding : FindIncludeViolations(file)) ADD_FAILURE() << finding;
    for (const std::string& finding : FindTargetViolations(file)) ADD_FAILURE() << finding;
  }
}

TEST(RoomTest, TheTreeIsSeenWhole) {
  std::set<std::string> paths;
  for (const SourceFile& file : ReadSourceTree()) paths.insert(file.path);
  for (const char* path : {"CMakeLists.txt", "core/base/check.h", "tests/policy/room_test.cc",
                           "deploy/test.sh", ".ci/run"}) {
    EXPECT_EQ(paths.count(path), 1u) << path;
  }
}

TEST(RoomTest, EveryFolderWithSourcesIsInARoom) {
  for (const SourceFile& file : ReadSourceTree()) {
    if (file.IsCpp()) {
      EXPECT_TRUE(RoomOfPath(file.path)) << file.path << " lies in no room of the list";
    }
  }
}

TEST(RoomTest, PlantedIncludesAreFound) {
  EXPECT_THAT(IncludesOf("core/base/a.cc", "\"core/geometry/vec3.h\""),
              ElementsAre(HasSubstr("core/base/a.cc:1: core/base must not use core/geometry")));
  EXPECT_THAT(IncludesOf("core/scene/a.h", "\"server/base/limits.h\""), testing::SizeIs(1));
  EXPECT_THAT(IncludesOf("client/lib/a.h", "\"core/base/check.h\""), testing::SizeIs(1));
  EXPECT_THAT(IncludesOf("client/import/a.h", "\"server/base/limits.h\""), testing::SizeIs(1));
  EXPECT_THAT(IncludesOf("client/import/a.h", "\"client/lib/client.h\""), testing::SizeIs(1));
  EXPECT_THAT(IncludesOf("client/import/a.h", "\"sightline/v1/geometry.pb.h\""),
              testing::SizeIs(1));
  EXPECT_THAT(IncludesOf("server/codec/a.h", "\"client/import/import.h\""), testing::SizeIs(1));
  EXPECT_THAT(IncludesOf("server/a.h", "\"client/cli/cli.h\""), testing::SizeIs(1));
  EXPECT_THAT(IncludesOf("client/cli/a.h", "\"tests/support/random.h\""), testing::SizeIs(1));
  EXPECT_THAT(IncludesOf("core/query/a.h", "\"sightline/v1/status.pb.h\""),
              testing::Not(IsEmpty()));
}

TEST(RoomTest, PlantedLibrariesAreFound) {
  EXPECT_THAT(IncludesOf("core/query/a.cc", "<grpcpp/grpcpp.h>"),
              ElementsAre(HasSubstr("the engine knows no wire")));
  EXPECT_THAT(IncludesOf("core/mesh/a.cc", "<google/protobuf/message.h>"), testing::SizeIs(1));
  EXPECT_THAT(IncludesOf("core/accel/a.cc", "<oneapi/tbb/parallel_for.h>"), testing::SizeIs(1));
  EXPECT_THAT(IncludesOf("server/a.cc", "  <tbb/task_arena.h>"), testing::SizeIs(1));
  EXPECT_THAT(IncludesOf("core/accel/a.cc", "<mutex>"), testing::SizeIs(1));
  EXPECT_THAT(IncludesOf("server/a.cc", "\"absl/synchronization/mutex.h\""), testing::SizeIs(1));
  for (const std::string room : {"core/mesh", "server"}) {
    for (const char* header : {"<assimp/scene.h>", "\"tiny_obj_loader.h\"", "<nlohmann/json.hpp>",
                               "<png.h>", "<lzma.h>"}) {
      EXPECT_THAT(IncludesOf(room + "/a.cc", header),
                  ElementsAre(HasSubstr("file formats are read in client/import")))
          << room << " with " << header;
    }
  }
}

TEST(RoomTest, WhatStandsAboveMayBeUsed) {
  EXPECT_THAT(IncludesOf("core/scene/a.cc", "\"core/base/check.h\""), IsEmpty());
  EXPECT_THAT(IncludesOf("core/base/tbb_seam.cc", "<oneapi/tbb/parallel_for.h>"), IsEmpty());
  EXPECT_THAT(IncludesOf("core/base/mutex.h", "<mutex>"), IsEmpty());
  EXPECT_THAT(IncludesOf("client/cli/a.cc", "\"server/wiring/server.h\""), IsEmpty());
  EXPECT_THAT(IncludesOf("client/lib/a.cc", "\"sightline/v1/status.pb.h\""), IsEmpty());
  EXPECT_THAT(IncludesOf("tests/server/a.cc", "\"client/lib/client.h\""), IsEmpty());
  EXPECT_THAT(IncludesOf("core/base/a.cc", "<vector>"), IsEmpty());
}

TEST(RoomTest, PlantedTargetsAreFound) {
  EXPECT_THAT(
      FindTargetViolations(MakeFile(
          "core/mesh/CMakeLists.txt",
          "# sightline_core_scene\nsightline_library(sightline_core_mesh DEPS sightline_core_base\n"
          "  sightline_core_accel absl::status)\n")),
      ElementsAre("core/mesh/CMakeLists.txt:3: core/mesh must not use core/accel"));
  EXPECT_THAT(FindTargetViolations(MakeFile("core/query/CMakeLists.txt", "x(sightline_proto)\n")),
              testing::SizeIs(1));
  EXPECT_THAT(FindTargetViolations(MakeFile("client/import/CMakeLists.txt",
                                            "x(sightline_client sightline_proto)\n")),
              testing::SizeIs(2));
  EXPECT_THAT(
      FindTargetViolations(MakeFile("core/accel/CMakeLists.txt", "x(sightline_core_builtin)")),
      IsEmpty());
  EXPECT_THAT(FindTargetViolations(MakeFile("core/mesh/CMakeLists.txt",
                                            "sightline_library(sightline_toys SOURCES a.cc)\n")),
              ElementsAre(HasSubstr("sightline_toys is not named after core/mesh")));
}

}  // namespace
}  // namespace sightline::policy

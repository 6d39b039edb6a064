// SPDX-License-Identifier: Apache-2.0
//
// Native scene files on the command line: made, checked, asked, and kept by a server.
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/integration/cli/cli_testing.h"

namespace sightline::cli {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;

class CliNativeTest : public CliTest {
 protected:
  void SetUp() override {
    obj_ = Write("small.obj", kSmallObj);
    native_ = File("small.slscene");
  }
  std::string obj_, native_;
};

TEST_F(CliNativeTest, ImportedScenesAnswerAsTheirMeshes) {
  for (const std::string build : {"static", "dynamic", "compact"}) {
    const RunResult made = Good({"import", obj_, "-o", native_, "--build", build, "--output=json"});
    const json report = json::parse(made.out);
    EXPECT_EQ(report["triangles"], 10);
    EXPECT_EQ(report["objects"], 4);
    EXPECT_EQ(report["bytes"], std::filesystem::file_size(native_));
    const std::string segments = WriteDoubles(
        "segments.npy", {1, 1, 1, 8, 1, 1, 1, 5, 1, 8, 5, 1, 2.25, 0, 1, 2.25, 9, 1}, 6);
    for (const std::string& scene : {obj_, native_}) {
      Good({"segments", scene, "--segments", segments, "--out", scene + ".npy"});
      Good({"view", scene, "--size=32x24", "--eye=1,-9,4", "--at=5,5,1", "--light=5,5,9", "--ids",
            scene + ".ids.npy", "--depth", scene + ".depth.npy", "--lit", scene + ".lit.npy"});
    }
    for (const char* ending : {".npy", ".ids.npy", ".depth.npy", ".lit.npy"}) {
      EXPECT_EQ(Read(obj_ + ending), Read(native_ + ending)) << build << ending;
    }
  }
}

// A file's name is any bytes; JSON is UTF-8.
TEST_F(CliNativeTest, JsonHoldsNamesThatAreNoUtf8) {
  const std::string mesh = Write("\xFF\xFE.obj", kSmallObj);
  const std::string native = File("\xC0.slscene"), out = File("out\xE9.npy");
  const std::string points = WriteDoubles("points.npy", {1, 1, 1}, 3);
  const std::string segments = WriteDoubles("segments.npy", {1, 1, 1, 8, 1, 1}, 6);
  const std::vector<std::string> commands[] = {
      {"import", mesh, "-o", native},
      {"check", mesh, "--objects"},
      {"check", native, "--objects"},
      {"view", mesh, "--size=8x6", "--ids", out},
      {"relight", mesh, "--size=8x6", "--by=1,0,0", "--frames=1"},
      {"shade", mesh, "--points", points, "--light=5,5,9", "--out", out},
      {"segments", mesh, "--segments", segments, "--out", out}};
  for (std::vector<std::string> command : commands) {
    command.emplace_back("--output=json");
    const json printed = json::parse(Good(command).out, nullptr, /*allow_exceptions=*/false);
    EXPECT_EQ(printed.value("command", ""), command[0]);
    EXPECT_THAT(printed.value(printed.contains("file") ? "file" : "scene", ""),
                HasSubstr("\uFFFD"));
  }
}

TEST_F(CliNativeTest, TheOriginCanBeChosen) {
  Good({"import", obj_, "-o", native_, "--origin", "100,200,300"});
  EXPECT_THAT(Good({"import", "builtin:box:1000", "--out", File("box.slscene")}).out,
              HasSubstr("bytes"));
  EXPECT_THAT(Good({"check", native_}).out, HasSubstr("native scene, version 1"));
}

TEST_F(CliNativeTest, CheckReportsSectionsAndFindsFaults) {
  Good({"import", obj_, "-o", native_});
  const RunResult text = Good({"check", native_, "--objects"});
  for (const char* part : {"triangles", "bvh nodes", "source vertices", "sums, indices", "roof"}) {
    EXPECT_THAT(text.out, HasSubstr(part));
  }
  const json report = json::parse(Good({"check", native_, "--output=json"}).out);
  EXPECT_EQ(report["version"], 1);
  EXPECT_EQ(report["triangles"], 10);
  EXPECT_GE(report["sections"].size(), 10u);
  std::string bytes = Read(native_);
  bytes[bytes.size() / 2] = static_cast<char>(bytes[bytes.size() / 2] ^ 4);
  Bad(65, {"check", Write("flipped.slscene", bytes)}, {"flipped.slscene", "changed"});
  Bad(65, {"check", Write("cut.slscene", bytes.substr(0, 500))}, {"cut.slscene", "truncated"});
  Bad(65, {"check", Write("text.slscene", "text")}, {"is no native scene file"});
  Bad(66, {"check", File("none.slscene")}, {"none.slscene"});
}

TEST_F(CliNativeTest, MistakesAreNamed) {
  Bad(64, {"import", obj_}, {"wants -o"});
  Bad(64, {"import", obj_, "-o", File("x.obj")}, {".slscene"});
  Bad(64, {"import", "scenes/hall", "-o", native_}, {"is a scene of a server"});
  Bad(73, {"import", obj_, "-o", File("none/x.slscene")}, {"none"});
  Good({"import", obj_, "-o", native_});
  Bad(64, {"import", native_, "-o", File("y.slscene")}, {"already"});
  const std::unique_ptr<Server> server = StartServer();
  Bad(64, {"scene", "load", native_, ServerFlag(*server)}, {"repository"});
}

TEST_F(CliNativeTest, AServerKeepsScenes) {
  const std::string folder = File("repository");
  std::filesystem::create_directory(folder);
  Good({"import", obj_, "-o", folder + "/town.slscene"});
  ServerOptions options;
  options.log_level = LogLevel::kError;
  options.repository = folder;
  absl::StatusOr<std::unique_ptr<Server>> server = Server::Start(options);
  ASSERT_TRUE(server.ok()) << server.status();
  const std::string at = ServerFlag(**server);
  const auto state = [&] {
    return json::parse(Good({"scene", "repository", at, "--output=json"}).out).at(0)["state"];
  };
  EXPECT_EQ(state(), "ready");
  EXPECT_THAT(Good({"scene", "unload", "town", at}).out, HasSubstr("unloaded scenes/town"));
  EXPECT_EQ(state(), "unloaded");
  EXPECT_THAT(Good({"scene", "repository", at}).out, HasSubstr("it was unloaded"));
  EXPECT_THAT(Good({"scene", "load", "scenes/town", at}).out, HasSubstr("1, stored"));
  EXPECT_EQ(json::parse(Good({"scene", "reload", "town", at, "--output=json"}).out)["revision"], 2);
  Bad(64, {"scene", "load", "scenes/town", "--name=x", at}, {"--name"});
  Bad(66, {"scene", "load", "scenes/none", at}, {"none.slscene"});
  Bad(64, {"scene", "unload", "town"}, {"--server"});
  // What a command uploads for itself is not stored.
  const std::string segments = WriteDoubles("segments.npy", {1, 1, 1, 8, 1, 1}, 6);
  Good({"segments", obj_, at, "--segments", segments, "--out", File("hit.npy")});
  EXPECT_EQ(json::parse(Good({"scene", "repository", at, "--output=json"}).out).size(), 1u);
}

}  // namespace
}  // namespace sightline::cli

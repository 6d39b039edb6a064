// SPDX-License-Identifier: Apache-2.0
//
// Scenes that a server stores: kept over restarts and kills, loaded, unloaded and reloaded, refused
// when they are broken, and served on when the disk is not there for them.
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <functional>
#include <future>
#include <string>
#include <thread>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "client/lib/client.h"
#include "client/lib/connection.h"
#include "client/lib/status.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "server/server.h"
#include "tests/integration/repository_server.h"
#include "tests/integration/serving_process.h"
#include "tests/integration/tile_load.h"
#include "tests/support/faulty_file_calls.h"
#include "tests/support/http_get.h"
#include "tests/support/temp_dir.h"

namespace sightline {
namespace {

using client::SceneState;
using ::testing::HasSubstr;
using testing_support::FaultyFileCalls;
using testing_support::TempDir;

std::string ReasonOf(const absl::Status& status) {
  const std::optional<client::ErrorDetail> detail = client::GetErrorDetail(status);
  return detail.has_value() ? detail->reason : "";
}

void ExpectError(const absl::Status& status, absl::StatusCode code, const std::string& reason) {
  EXPECT_EQ(status.code(), code) << status;
  EXPECT_EQ(ReasonOf(status), reason) << status;
}

// A square of two triangles in the plane z = 1, uploaded as scene `id`.
absl::StatusOr<client::Scene> UploadSquare(const client::Client& client, const std::string& id,
                                           bool temporary = false) {
  const std::vector<double> vertices = {-1, -1, 1, 1, -1, 1, 1, 1, 1, -1, 1, 1};
  const std::vector<uint32_t> indices = {0, 1, 2, 0, 2, 3};
  client::SceneSource source;
  source.scene_id = id;
  source.temporary = temporary;
  source.objects.push_back(
      {.name = "square", .vertices = vertices, .indices = indices, .dynamic = true});
  return client.CreateScene(source);
}

// Moves the square along z by `by`: a new revision.
absl::StatusOr<client::Scene> MoveSquare(const client::Client& client, const std::string& name,
                                         double by) {
  client::SceneEdit edit;
  edit.kind = client::SceneEdit::Kind::kSetTransform;
  edit.object.name = "square";
  edit.object.transform = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, by};
  return client.UpdateScene(name, {edit});
}

// How often a segment from the origin up to z = `top` is blocked: 1 or 0.
absl::StatusOr<int> Blocked(const client::Client& client, const std::string& name, double top) {
  const std::vector<double> segments = {0.25, 0.125, 0, 0.25, 0.125, top};
  absl::StatusOr<client::Segments> answer =
      client.TestAllSegments({.scene = name, .segments = segments});
  if (!answer.ok()) return answer.status();
  return answer->blocked.at(0);
}

// Some more answers come, and every one of them was right.
void ExpectAllRight(const TileLoad& load) {
  load.WaitForAnswers(20);
  EXPECT_EQ(load.wrong(), 0u);
  EXPECT_EQ(load.refused(), 0u);
  EXPECT_EQ(load.broken_streams(), 0u);
}

class RepositoryTest : public ::testing::Test {
 protected:
  // Stops the server, and starts one on the same folder.
  void Start(const std::function<void(ServerOptions*)>& change = nullptr) {
    client_.reset();
    server_.reset();
    ServerOptions options = RepositoryOptions(dir_.path());
    options.files = &calls_;
    SetLogLevel(LogLevel::kOff);
    if (change) change(&options);
    absl::StatusOr<std::unique_ptr<Server>> server = Server::Start(options);
    ASSERT_TRUE(server.ok()) << server.status();
    server_ = *std::move(server);
    client_ = ClientInProcess(*server_);
  }
  // The same, with a port for clients that ask for these tiles.
  void Start(const KnownTiles& tiles) {
    Start([&](ServerOptions* options) {
      options->listen = {"127.0.0.1:0"};
      options->scenes = {tiles.scene_option()};
    });
  }
  TileLoad::Options TileClient() {
    return {.address = absl::StrCat("127.0.0.1:", server_->port()), .clients = 1};
  }
  const client::Client& client() { return *client_; }
  void Write(const std::string& name, const std::string& bytes) {
    std::ofstream(dir_.File("new"), std::ios::binary) << bytes;
    std::filesystem::rename(dir_.File("new"), dir_.File(name));
  }
  bool Exists(const std::string& name) { return std::filesystem::exists(dir_.File(name)); }
  client::StoredScene Stored(const std::string& id) {
    const auto scenes = client().ListStoredScenes();
    EXPECT_TRUE(scenes.ok()) << scenes.status();
    if (scenes.ok()) {
      for (const client::StoredScene& scene : *scenes) {
        if (scene.name == absl::StrCat("scenes/", id)) return scene;
      }
    }
    ADD_FAILURE() << "no file of " << id;
    return {};
  }

  TempDir dir_;
  FaultyFileCalls calls_;
  std::unique_ptr<Server> server_;
  std::unique_ptr<client::Client> client_;
};

TEST_F(RepositoryTest, UploadsAndEditsComeBackAfterARestart) {
  Start();
  const auto made = UploadSquare(client(), "hall");
  ASSERT_TRUE(made.ok()) << made.status();
  EXPECT_TRUE(made->stored);
  EXPECT_TRUE(Exists("hall.slscene"));
  Start();
  EXPECT_EQ(client().GetScene("scenes/hall")->revision, 1);
  EXPECT_EQ(*Blocked(client(), "scenes/hall", 1.5), 1);
  const auto moved = MoveSquare(client(), "scenes/hall", 1);
  ASSERT_TRUE(moved.ok()) << moved.status();
  EXPECT_TRUE(moved->stored);
  Start();
  const auto back = client().GetScene("scenes/hall");
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(back->revision, 2);
  EXPECT_EQ(back->state, SceneState::kReady);
  EXPECT_EQ(back->origin, made->origin);
  EXPECT_EQ(*Blocked(client(), "scenes/hall", 1.5), 0);
  EXPECT_EQ(*Blocked(client(), "scenes/hall", 2.5), 1);
  ASSERT_TRUE(client().DeleteScene("scenes/hall").ok());
  EXPECT_FALSE(Exists("hall.slscene"));
  Start();
  EXPECT_TRUE(client().ListScenes()->empty());
}

TEST_F(RepositoryTest, TemporaryScenesAreNotStored) {
  Start([](ServerOptions* options) { options->scenes = {"builtin:box"}; });
  const auto scene = UploadSquare(client(), "hall", /*temporary=*/true);
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_FALSE(scene->stored);
  EXPECT_EQ(scene->state_message, "");
  ASSERT_TRUE(MoveSquare(client(), "scenes/hall", 1).ok());
  EXPECT_TRUE(client().ListStoredScenes()->empty());
  ExpectError(client().UnloadScene("scenes/hall"), absl::StatusCode::kFailedPrecondition,
              "SCENE_NOT_STORED");
}

TEST_F(RepositoryTest, LoadsUnloadsAndReloads) {
  Start();
  ASSERT_TRUE(UploadSquare(client(), "hall").ok());
  EXPECT_EQ(Stored("hall").state, SceneState::kReady);
  client::PointSetSource points;
  points.scene = "scenes/hall";
  points.point_set_id = "desk";
  const std::vector<double> positions = {0, 0, 0};
  points.points.positions = positions;
  ASSERT_TRUE(client().CreatePointSet(points).ok());

  ASSERT_TRUE(client().UnloadScene("scenes/hall").ok());
  EXPECT_EQ(server_->scenes().MemoryBytes(), 0u);
  EXPECT_EQ(Stored("hall").state, SceneState::kUnloaded);
  EXPECT_THAT(Stored("hall").state_message, HasSubstr("unloaded"));
  ExpectError(Blocked(client(), "scenes/hall", 1.5).status(), absl::StatusCode::kFailedPrecondition,
              "SCENE_NOT_READY");
  ExpectError(UploadSquare(client(), "hall").status(), absl::StatusCode::kAlreadyExists,
              "ALREADY_EXISTS");
  ExpectError(client().ReloadScene("scenes/hall").status(), absl::StatusCode::kFailedPrecondition,
              "SCENE_NOT_READY");

  const auto loaded = client().LoadScene("scenes/hall");
  ASSERT_TRUE(loaded.ok()) << loaded.status();
  EXPECT_EQ(loaded->revision, 1);
  EXPECT_TRUE(loaded->stored);
  EXPECT_EQ(*Blocked(client(), "scenes/hall", 1.5), 1);
  EXPECT_EQ(client().LoadScene("scenes/hall")->revision, 1);  // As it is.
  // Its point sets went with it.
  EXPECT_TRUE(absl::IsNotFound(client().GetPointSet("scenes/hall/pointSets/desk").status()));

  const auto reloaded = client().ReloadScene("scenes/hall");
  ASSERT_TRUE(reloaded.ok()) << reloaded.status();
  EXPECT_EQ(reloaded->revision, 2);
  EXPECT_EQ(*Blocked(client(), "scenes/hall", 1.5), 1);
}

TEST_F(RepositoryTest, AFailedReloadKeepsTheOldOneServing) {
  Start();
  ASSERT_TRUE(UploadSquare(client(), "hall").ok());
  Write("hall.slscene", "no scene file at all");
  ExpectError(client().ReloadScene("scenes/hall").status(), absl::StatusCode::kInvalidArgument,
              "BAD_SCENE_FILE");
  const auto scene = client().GetScene("scenes/hall");
  EXPECT_EQ(scene->revision, 1);
  EXPECT_EQ(scene->state, SceneState::kReady);
  EXPECT_THAT(scene->state_message, HasSubstr("is no native scene file"));
  EXPECT_EQ(*Blocked(client(), "scenes/hall", 1.5), 1);
  std::filesystem::remove(dir_.File("hall.slscene"));
  ExpectError(client().ReloadScene("scenes/hall").status(), absl::StatusCode::kNotFound,
              "SCENE_FILE_NOT_FOUND");
  EXPECT_EQ(*Blocked(client(), "scenes/hall", 1.5), 1);
}

TEST_F(RepositoryTest, BrokenFilesKeepNothingElseFromBeingServed) {
  Start();
  ASSERT_TRUE(UploadSquare(client(), "good").ok());
  std::filesystem::copy(dir_.File("good.slscene"), dir_.File("cut.slscene"));
  std::filesystem::resize_file(dir_.File("cut.slscene"),
                               std::filesystem::file_size(dir_.File("cut.slscene")) - 64);
  Write("text.slscene", "text");
  Write("Not An Id.slscene", "text");
  Write("notes.txt", "text");
  Write(".good.slscene.17-0.tmp", "half written");
  Start();
  EXPECT_FALSE(Exists(".good.slscene.17-0.tmp"));
  EXPECT_TRUE(Exists("notes.txt"));
  EXPECT_EQ(client().ListStoredScenes()->size(), 3u);
  EXPECT_EQ(Stored("good").state, SceneState::kReady);
  EXPECT_EQ(Stored("cut").state, SceneState::kFailed);
  EXPECT_THAT(Stored("cut").state_message, HasSubstr("truncated"));
  EXPECT_EQ(Stored("text").state, SceneState::kFailed);
  EXPECT_EQ(*Blocked(client(), "scenes/good", 1.5), 1);
  ExpectError(client().LoadScene("scenes/cut").status(), absl::StatusCode::kDataLoss,
              "BAD_SCENE_FILE");
  ASSERT_TRUE(client().DeleteScene("scenes/cut").ok());
  EXPECT_FALSE(Exists("cut.slscene"));
}

TEST_F(RepositoryTest, NothingOutsideCanBeNamed) {
  TempDir outside;
  Start();
  ASSERT_TRUE(UploadSquare(client(), "hall").ok());
  std::filesystem::rename(dir_.File("hall.slscene"), outside.File("hall.slscene"));
  ASSERT_EQ(::symlink(outside.File("hall.slscene").c_str(), dir_.File("link.slscene").c_str()), 0);
  ASSERT_EQ(::mkdir(dir_.File("folder.slscene").c_str(), 0700), 0);
  const std::string up =
      absl::StrCat("../", std::filesystem::path(outside.path()).filename().string(), "/hall");
  for (const std::string& id :
       {up, outside.File("hall"), std::string(".."), std::string("../hall"), std::string(""),
        std::string("a/b"), std::string("hall.slscene/../x"), std::string("a\\b")}) {
    ExpectError(client().LoadScene(absl::StrCat("scenes/", id)).status(),
                absl::StatusCode::kInvalidArgument, "INVALID_FIELD");
    ExpectError(client().CreateScene({.scene_id = "x", .file_id = id.empty() ? "/" : id}).status(),
                absl::StatusCode::kInvalidArgument, "INVALID_FIELD");
    EXPECT_FALSE(UploadSquare(client(), id.empty() ? "/" : id).ok());
  }
  for (const char* id : {"link", "folder"}) {
    ExpectError(client().LoadScene(absl::StrCat("scenes/", id)).status(),
                absl::StatusCode::kFailedPrecondition, "STORAGE_FAILED");
  }
}

TEST_F(RepositoryTest, AFileUnderAnotherNameIsStoredAsAnotherScene) {
  Start();
  ASSERT_TRUE(UploadSquare(client(), "hall").ok());
  const auto copy = client().CreateScene({.scene_id = "copy", .file_id = "hall"});
  ASSERT_TRUE(copy.ok()) << copy.status();
  EXPECT_TRUE(copy->stored);
  ASSERT_TRUE(MoveSquare(client(), "scenes/copy", 1).ok());
  const auto same = client().CreateScene({.scene_id = "hall", .file_id = "hall"});
  ASSERT_TRUE(same.ok()) << same.status();
  Start();
  EXPECT_EQ(*Blocked(client(), "scenes/hall", 1.5), 1);
  EXPECT_EQ(*Blocked(client(), "scenes/copy", 1.5), 0);
  ExpectError(client().CreateScene({.scene_id = "y", .file_id = "none"}).status(),
              absl::StatusCode::kNotFound, "SCENE_FILE_NOT_FOUND");
}

TEST_F(RepositoryTest, AFullDiskIsToldAndServingGoesOn) {
  const KnownTiles tiles("room:15000");
  Start([&](ServerOptions* options) {
    options->listen = {"127.0.0.1:0"};
    options->scenes = {tiles.scene_option()};
    options->metrics_listen = "127.0.0.1:0";
  });
  const auto metric = [&](const std::string& name) {
    return testing_support::MetricOf(server_->metrics_port(), "sightline_" + name);
  };
  TileLoad load(tiles, TileClient());
  load.WaitForAnswers(20);
  calls_.write_error = ENOSPC;
  const auto scene = UploadSquare(client(), "hall");
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_FALSE(scene->stored);
  EXPECT_THAT(scene->state_message, HasSubstr("not stored"));
  EXPECT_THAT(scene->state_message, HasSubstr("free some space"));
  EXPECT_EQ(metric("failed_scene_stores_total"), 1);
  EXPECT_EQ(metric("unstored_scenes"), 1);
  EXPECT_EQ(*Blocked(client(), "scenes/hall", 1.5), 1);
  EXPECT_EQ(*Blocked(client(), "scenes/hall", 0.5), 0);
  ExpectAllRight(load);
  ExpectError(client().UnloadScene("scenes/hall"), absl::StatusCode::kFailedPrecondition,
              "SCENE_NOT_STORED");
  calls_.write_error = 0;
  const auto moved = MoveSquare(client(), "scenes/hall", 1);
  ASSERT_TRUE(moved.ok()) << moved.status();
  EXPECT_TRUE(moved->stored);
  EXPECT_EQ(moved->state_message, "");
  EXPECT_EQ(metric("failed_scene_stores_total"), 1);
  EXPECT_EQ(metric("unstored_scenes"), 0);
  // A failed store leaves what was stored before.
  calls_.sync_error = EIO;
  const auto again = MoveSquare(client(), "scenes/hall", 2);
  ASSERT_TRUE(again.ok()) << again.status();
  EXPECT_FALSE(again->stored);
  EXPECT_EQ(*Blocked(client(), "scenes/hall", 2.5), 0);
  EXPECT_EQ(*Blocked(client(), "scenes/hall", 3.5), 1);
  ExpectAllRight(load);
  load.Stop();
  calls_.sync_error = 0;
  Start();
  EXPECT_EQ(client().GetScene("scenes/hall")->revision, 2);
}

TEST_F(RepositoryTest, AnUnreadableRepositoryIsToldAndServingGoesOn) {
  const KnownTiles tiles("room:15000");
  Start(tiles);
  TileLoad load(tiles, TileClient());
  load.WaitForAnswers(20);
  ASSERT_TRUE(UploadSquare(client(), "hall").ok());
  ASSERT_TRUE(UploadSquare(client(), "attic").ok());
  ASSERT_TRUE(client().UnloadScene("scenes/attic").ok());
  calls_.open_error = EACCES;
  ExpectError(client().ListStoredScenes().status(), absl::StatusCode::kPermissionDenied,
              "STORAGE_FAILED");
  ExpectError(client().LoadScene("scenes/attic").status(), absl::StatusCode::kPermissionDenied,
              "STORAGE_FAILED");
  ExpectError(client().ReloadScene("scenes/hall").status(), absl::StatusCode::kPermissionDenied,
              "STORAGE_FAILED");
  EXPECT_EQ(*Blocked(client(), "scenes/hall", 1.5), 1);
  EXPECT_EQ(*Blocked(client(), "scenes/hall", 0.5), 0);
  // What cannot be read is there all the same, and is not replaced.
  ExpectError(UploadSquare(client(), "attic").status(), absl::StatusCode::kAlreadyExists,
              "ALREADY_EXISTS");
  ExpectAllRight(load);
  // Nor is it known to be gone where it cannot even be looked at.
  calls_.stat_error = EIO;
  ExpectError(UploadSquare(client(), "attic").status(), absl::StatusCode::kDataLoss,
              "STORAGE_FAILED");
  for (const char* name : {"scenes/hall", "scenes/attic"}) {
    ExpectError(client().DeleteScene(name), absl::StatusCode::kDataLoss, "STORAGE_FAILED");
  }
  EXPECT_EQ(*Blocked(client(), "scenes/hall", 1.5), 1);
  ExpectAllRight(load);
  calls_.stat_error = 0;
  calls_.open_error = 0;
  calls_.map_error = ENOMEM;
  ExpectError(client().LoadScene("scenes/attic").status(), absl::StatusCode::kResourceExhausted,
              "STORAGE_FAILED");
  EXPECT_EQ(*Blocked(client(), "scenes/hall", 1.5), 1);
  ExpectAllRight(load);
  calls_.map_error = 0;
  EXPECT_TRUE(client().LoadScene("scenes/attic").ok());
  EXPECT_EQ(*Blocked(client(), "scenes/attic", 1.5), 1);
  ExpectAllRight(load);
  load.Stop();
  // Deleting takes no descriptor.
  calls_.open_error = EMFILE;
  EXPECT_TRUE(client().DeleteScene("scenes/attic").ok());
  calls_.open_error = 0;
  EXPECT_FALSE(Exists("attic.slscene"));
  Start();
  ExpectError(client().GetScene("scenes/attic").status(), absl::StatusCode::kNotFound,
              "SCENE_NOT_FOUND");
  EXPECT_EQ(*Blocked(client(), "scenes/hall", 1.5), 1);
}

TEST_F(RepositoryTest, TheBudgetIsCheckedBeforeAnythingIsLoaded) {
  Start();
  client::SceneSource box{.scene_id = "box", .builtin = "builtin:sphere:20000"};
  const auto made = client().CreateScene(box);
  ASSERT_TRUE(made.ok()) << made.status();
  const uint64_t bytes = made->report.resident_bytes;
  ASSERT_GT(bytes, uint64_t{1} << 20);
  Start([&](ServerOptions* options) { options->limits.max_scene_bytes = bytes - 1; });
  EXPECT_EQ(Stored("box").state, SceneState::kFailed);
  ExpectError(client().LoadScene("scenes/box").status(), absl::StatusCode::kResourceExhausted,
              "OUT_OF_MEMORY_BUDGET");
  Start([&](ServerOptions* options) { options->limits.max_bytes_per_scene = bytes - 1; });
  ExpectError(client().LoadScene("scenes/box").status(), absl::StatusCode::kResourceExhausted,
              "OUT_OF_MEMORY_BUDGET");
  ExpectError(client().CreateScene({.builtin = "builtin:sphere:20000"}).status(),
              absl::StatusCode::kResourceExhausted, "OUT_OF_MEMORY_BUDGET");
}

TEST_F(RepositoryTest, StoredScenesMakeRoomIfTheOperatorAsksForIt) {
  Start();
  uint64_t bytes = 0;
  for (const char* id : {"a", "b", "c"}) {
    const auto made = client().CreateScene({.scene_id = id, .builtin = "builtin:sphere:20000"});
    ASSERT_TRUE(made.ok()) << made.status();
    bytes = made->report.resident_bytes;
  }
  Start([&](ServerOptions* options) {
    options->load_repository = false;
    options->evict_least_used = true;
    options->limits.max_scene_bytes = 5 * bytes / 2;
  });
  EXPECT_EQ(Stored("a").state, SceneState::kUnloaded);
  for (const char* id : {"a", "b"}) {
    ASSERT_TRUE(client().LoadScene(absl::StrCat("scenes/", id)).ok());
  }
  ASSERT_TRUE(Blocked(client(), "scenes/a", 1).ok());
  ASSERT_TRUE(client().LoadScene("scenes/c").ok());
  EXPECT_EQ(Stored("a").state, SceneState::kReady);
  EXPECT_EQ(Stored("b").state, SceneState::kUnloaded);
  EXPECT_THAT(Stored("b").state_message, HasSubstr("make room"));
  ExpectError(Blocked(client(), "scenes/b", 1).status(), absl::StatusCode::kFailedPrecondition,
              "SCENE_NOT_READY");
}

TEST_F(RepositoryTest, StoredScenesMakeRoomByNumberToo) {
  Start([](ServerOptions* options) {
    options->evict_least_used = true;
    options->limits.max_scenes = 2;
  });
  for (const char* id : {"a", "b", "c"}) {
    const auto made = UploadSquare(client(), id);
    ASSERT_TRUE(made.ok()) << made.status();
  }
  EXPECT_EQ(client().ListScenes()->size(), 2u);
  EXPECT_EQ(Stored("a").state, SceneState::kUnloaded);
  EXPECT_EQ(*Blocked(client(), "scenes/c", 1.5), 1);
  ASSERT_TRUE(client().LoadScene("scenes/a").ok());
  EXPECT_EQ(Stored("b").state, SceneState::kUnloaded);
  // What is in memory alone stays.
  ASSERT_TRUE(client().DeleteScene("scenes/a").ok());
  ASSERT_TRUE(client().DeleteScene("scenes/c").ok());
  for (const char* id : {"d", "e"}) {
    ASSERT_TRUE(UploadSquare(client(), id, /*temporary=*/true).ok());
  }
  const absl::Status full = client().LoadScene("scenes/b").status();
  ExpectError(full, absl::StatusCode::kResourceExhausted, "LIMIT_EXCEEDED");
  EXPECT_THAT(std::string(full.message()), HasSubstr("max_scenes is 2"));
}

// A limit that a stored scene is over is named, and not taken for a lack of memory.
TEST_F(RepositoryTest, LimitsOfStoredScenesAreNamed) {
  Start();
  ASSERT_TRUE(UploadSquare(client(), "hall").ok());
  struct Case {
    uint64_t Limits::*limit;
    uint64_t value;
    const char* name;
  };
  for (const Case& c : {Case{&Limits::max_triangles_per_scene, 1, "max_triangles_per_scene"},
                        Case{&Limits::max_vertices_per_scene, 3, "max_vertices_per_scene"}}) {
    Start([&](ServerOptions* options) { options->limits.*c.limit = c.value; });
    const absl::Status refused = client().LoadScene("scenes/hall").status();
    ExpectError(refused, absl::StatusCode::kResourceExhausted, "LIMIT_EXCEEDED");
    const auto detail = client::GetErrorDetail(refused);
    ASSERT_TRUE(detail.has_value());
    EXPECT_EQ(detail->metadata.at("limit"), c.name);
    EXPECT_EQ(detail->metadata.at("limit_value"), std::to_string(c.value));
  }
}

// The load waits in the file system until its client has left.
TEST_F(RepositoryTest, ALoadWhoseClientLeavesIsGivenUp) {
  Start();
  ASSERT_TRUE(UploadSquare(client(), "hall").ok());
  ASSERT_TRUE(client().UnloadScene("scenes/hall").ok());
  // The server hears of it soon, but when is its own affair: then the load was done before.
  bool given_up = false;
  for (int attempt = 0; attempt < 200 && !given_up; ++attempt) {
    std::promise<void> left;
    calls_.on_map = [&left] { left.get_future().wait(); };
    const absl::Status status =
        client()
            .LoadScene("scenes/hall", {.deadline = absl::Now() + absl::Milliseconds(20)})
            .status();
    EXPECT_TRUE(absl::IsDeadlineExceeded(status)) << status;
    left.set_value();
    while (server_->active_calls() > 0) std::this_thread::yield();
    given_up = !client().GetScene("scenes/hall").ok();
    if (!given_up) {
      ASSERT_TRUE(client().UnloadScene("scenes/hall").ok());
    }
  }
  calls_.on_map = nullptr;
  EXPECT_TRUE(given_up);
  EXPECT_EQ(Stored("hall").state, SceneState::kUnloaded);
  EXPECT_TRUE(client().LoadScene("scenes/hall").ok());
  EXPECT_EQ(*Blocked(client(), "scenes/hall", 1.5), 1);
}

TEST_F(RepositoryTest, WithoutARepositoryThereIsNothingToLoad) {
  Start([](ServerOptions* options) { options->repository.clear(); });
  const auto scene = UploadSquare(client(), "hall");
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_FALSE(scene->stored);
  for (const absl::Status& status :
       {client().LoadScene("scenes/hall").status(), client().ReloadScene("scenes/hall").status(),
        client().UnloadScene("scenes/hall"), client().ListStoredScenes().status()}) {
    ExpectError(status, absl::StatusCode::kFailedPrecondition, "NO_REPOSITORY");
  }
}

// The real process.
class RepositoryProcessTest : public ::testing::Test {
 protected:
  std::vector<std::string> Flags() {
    return {"--threads=2", "--build-threads=2", "--repository", dir_.path()};
  }
  static client::Client ClientOf(const ServingProcess& process) {
    return client::Client(client::MakeConnection(process.address(), {.channels = 1}));
  }
  TempDir dir_;
};

TEST_F(RepositoryProcessTest, AKilledServerComesBackWithEveryStoredScene) {
  for (int round = 1; round <= 3; ++round) {
    ServingProcess process(Flags());
    const client::Client client = ClientOf(process);
    for (int earlier = 1; earlier < round; ++earlier) {
      const std::string name = absl::StrCat("scenes/s", earlier);
      const auto scene = client.GetScene(name);
      ASSERT_TRUE(scene.ok()) << scene.status();
      EXPECT_EQ(scene->revision, 2);
      EXPECT_EQ(*Blocked(client, name, 1.5), 0);
      EXPECT_EQ(*Blocked(client, name, 2.5), 1);
    }
    const std::string id = absl::StrCat("s", round);
    ASSERT_TRUE(UploadSquare(client, id)->stored);
    ASSERT_TRUE(MoveSquare(client, absl::StrCat("scenes/", id), 1)->stored);
    process.Signal(SIGKILL);  // What was answered has survived.
    EXPECT_EQ(process.Wait(), 1000 + SIGKILL);
  }
}

// Clients ask for tiles all the while.
TEST_F(RepositoryProcessTest, AFileBeyondItsLimitIsAFullDisk) {
  const KnownTiles tiles("room:15000");
  std::vector<std::string> flags = Flags();
  flags.push_back(tiles.flag());
  const ServingProcess process(flags, {.limits = {{RLIMIT_FSIZE, 64 << 10}}});
  TileLoad load(tiles, {.address = process.address(), .clients = 1});
  load.WaitForAnswers(20);
  const client::Client client = ClientOf(process);
  const auto scene = client.CreateScene({.scene_id = "big", .builtin = "builtin:sphere:20000"});
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_FALSE(scene->stored);
  EXPECT_THAT(scene->state_message, HasSubstr("limit on a file's size"));
  // Its radius is about 1.
  EXPECT_EQ(*Blocked(client, "scenes/big", 1.5), 1);
  EXPECT_EQ(*Blocked(client, "scenes/big", 0.5), 0);
  ExpectAllRight(load);
  const auto small = UploadSquare(client, "small");
  ASSERT_TRUE(small.ok()) << small.status();
  EXPECT_TRUE(small->stored);
  EXPECT_EQ(*Blocked(client, "scenes/small", 1.5), 1);
  EXPECT_EQ(*Blocked(client, "scenes/small", 0.5), 0);
  EXPECT_EQ(client.ListStoredScenes()->size(), 1u);
  ExpectAllRight(load);
  load.Stop();
}

}  // namespace
}  // namespace sightline

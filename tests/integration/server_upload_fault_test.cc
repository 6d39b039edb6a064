// SPDX-License-Identifier: Apache-2.0
//
// The real server killed in the middle of uploads, and started again: what was stored is there as
// it was, of what was half sent there is nothing, and the same upload goes through. Other clients
// ask all the while, and every answer that they get is held against the engine's.
#include <csignal>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "tests/integration/grid_upload.h"
#include "tests/integration/tile_load.h"
#include "tests/support/temp_dir.h"
#include "tests/support/until.h"

namespace sightline {
namespace {

// Vertices of 19 MB alone: far more than gRPC holds on its way, so that a server whose client has
// sent half of it has taken in some.
constexpr uint32_t kSide = 900;

// Sends the first `count` messages; then `after`, before the end is said if all were sent.
template <typename Open, typename Message>
grpc::Status Send(const Open& open, const std::vector<Message>& messages, size_t count,
                  const std::function<void()>& after) {
  grpc::ClientContext context;
  const auto writer = open(&context);
  for (size_t i = 0; i < count && writer->Write(messages[i]); ++i) {
  }
  if (count == messages.size()) writer->WritesDone();
  after();
  return writer->Finish();
}

class UploadFaultTest : public testing::Test {
 protected:
  UploadFaultTest() : tiles_("room:15000") {
    Start("127.0.0.1:0");
    load_ =
        std::make_unique<TileLoad>(tiles_, TileLoad::Options{.address = address_, .clients = 1});
    load_->WaitForAnswers(20);
  }
  // The server is killed, and another started where it was; clients go on.
  void Kill() {
    server_->Signal(SIGKILL);
    EXPECT_EQ(server_->Wait(), 1000 + SIGKILL);
  }
  void Restart() {
    Start(address_);
    load_->WaitForAnswers(20);
  }
  void TearDown() override {
    load_->Stop();
    EXPECT_EQ(load_->wrong(), 0u);
    EXPECT_EQ(load_->refused(), 0u);
    server_->Signal(SIGTERM);
    EXPECT_EQ(server_->Wait(), 0);
  }

  grpc::Status Upload(const std::vector<v1::CreateSceneRequest>& messages, size_t count,
                      const std::function<void()>& after) {
    const auto stub = v1::SceneService::NewStub(server_->Channel());
    v1::Scene scene;
    return Send([&](grpc::ClientContext* c) { return stub->CreateScene(c, &scene); }, messages,
                count, after);
  }
  grpc::Status Upload(const std::vector<v1::UpdateSceneRequest>& messages, size_t count,
                      const std::function<void()>& after) {
    const auto stub = v1::SceneService::NewStub(server_->Channel());
    v1::Scene scene;
    return Send([&](grpc::ClientContext* c) { return stub->UpdateScene(c, &scene); }, messages,
                count, after);
  }
  grpc::Status Upload(const std::vector<v1::CreatePointSetRequest>& messages, size_t count,
                      const std::function<void()>& after) {
    const auto stub = v1::PointSetService::NewStub(server_->Channel());
    v1::PointSet set;
    return Send([&](grpc::ClientContext* c) { return stub->CreatePointSet(c, &set); }, messages,
                count, after);
  }
  template <typename Message>
  void ExpectUploaded(const std::vector<Message>& messages) {
    const grpc::Status status = Upload(messages, messages.size(), [] {});
    EXPECT_TRUE(status.ok()) << status.error_message();
  }
  // Half of the upload, the kill, and the start after it.
  template <typename Message>
  void KillHalfWay(const std::vector<Message>& messages) {
    const grpc::Status status = Upload(messages, messages.size() / 2, [&] { Kill(); });
    EXPECT_EQ(status.error_code(), grpc::StatusCode::UNAVAILABLE) << status.error_message();
    Restart();
  }

  // 0: there is no such scene.
  int Revision(const std::string& name) const {
    const auto stub = v1::SceneService::NewStub(server_->Channel());
    grpc::ClientContext context;
    v1::GetSceneRequest request;
    request.set_name(name);
    v1::Scene scene;
    const grpc::Status status = stub->GetScene(&context, request, &scene);
    if (status.error_code() == grpc::StatusCode::NOT_FOUND) return 0;
    EXPECT_TRUE(status.ok()) << status.error_message();
    return static_cast<int>(scene.revision());
  }
  bool Blocked(const std::string& name, double top) const {
    return GridBlocks(server_->Channel(), name, top);
  }
  // Of stored scenes and of whatever else was being written.
  size_t Files() const {
    size_t files = 0;
    for ([[maybe_unused]] const auto& file : std::filesystem::directory_iterator(dir_.path())) {
      ++files;
    }
    return files;
  }

  const KnownTiles tiles_;
  const GridUpload grid_{kSide};
  const testing_support::TempDir dir_;
  std::unique_ptr<ServingProcess> server_;
  std::string address_;
  std::unique_ptr<TileLoad> load_;

 private:
  void Start(const std::string& listen) {
    server_ = std::make_unique<ServingProcess>(
        std::vector<std::string>{tiles_.flag(), absl::StrCat("--repository=", dir_.path())},
        ServingProcess::Options{.limits = {}, .listen = listen});
    address_ = server_->address();
  }
};

TEST_F(UploadFaultTest, KilledInTheMiddleOfAnUploadItKeepsNoneOfIt) {
  const auto grid = grid_.Scene("grid", 1);
  KillHalfWay(grid);
  EXPECT_EQ(Revision("scenes/grid"), 0);
  ExpectUploaded(grid);
  EXPECT_TRUE(Blocked("scenes/grid", 1.5));
  // The edit of a scene that is stored: the revision before it is there.
  const auto move = grid_.Move("scenes/grid", 2);
  KillHalfWay(move);
  EXPECT_EQ(Revision("scenes/grid"), 1);
  EXPECT_TRUE(Blocked("scenes/grid", 1.5));
  ExpectUploaded(move);
  EXPECT_FALSE(Blocked("scenes/grid", 1.5));
  EXPECT_TRUE(Blocked("scenes/grid", 2.5));
  // Points; they go with the server that held them.
  const auto points = grid_.Points("scenes/grid", 0);
  KillHalfWay(points);
  EXPECT_EQ(Revision("scenes/grid"), 2);
  EXPECT_FALSE(Blocked("scenes/grid", 1.5));
  ExpectUploaded(points);
}

// While the file is written beside its place, or just before or after it is renamed: all or
// nothing.
TEST_F(UploadFaultTest, KilledWhileItStoresItHasAllOrNothing) {
  const auto grid = grid_.Scene("grid", 1);
  const size_t before = Files();
  const grpc::Status status = Upload(grid, grid.size(), [&] {
    EXPECT_TRUE(testing_support::Until("a file is begun", [&] { return Files() != before; }));
    Kill();
  });
  Restart();
  const int revision = Revision("scenes/grid");
  EXPECT_TRUE(revision == 1 || (revision == 0 && !status.ok())) << revision;
  if (revision == 0) ExpectUploaded(grid);
  EXPECT_TRUE(Blocked("scenes/grid", 1.5));
  EXPECT_FALSE(Blocked("scenes/grid", 0.5));
}

}  // namespace
}  // namespace sightline

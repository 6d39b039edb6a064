// SPDX-License-Identifier: Apache-2.0
//
// What is short does not wait for what builds. The one thread that builds is held up in a file of
// the repository for as long as the test likes, so that nothing below depends on how long a build
// takes.
#include <atomic>
#include <chrono>
#include <future>
#include <string>
#include <thread>
#include <vector>

#include "tests/integration/server_harness.h"
#include "tests/support/faulty_file_calls.h"
#include "tests/support/temp_dir.h"
#include "tests/support/until.h"

namespace sightline {
namespace {

using testing_support::FaultyFileCalls;
using testing_support::TempDir;
using testing_support::Until;

// Loads the stored scene "wall", which does not end before the object does.
class HeldLoad {
 public:
  HeldLoad(ServerHarness& harness, FaultyFileCalls& calls) {
    // The first file alone: a delete looks at its own.
    calls.on_map = [this, until = go_on_.get_future().share()] {
      if (!held_.exchange(true)) until.wait();
    };
    thread_ = std::thread([this, &harness] {
      grpc::ClientContext context;
      v1::LoadSceneRequest request;
      v1::Scene scene;
      request.set_name("scenes/wall");
      status_ = harness.scenes->LoadScene(&context, request, &scene);
    });
  }
  ~HeldLoad() {
    if (thread_.joinable()) (void)Finish();
  }
  bool held() const { return held_; }
  grpc::Status Finish() {
    go_on_.set_value();
    thread_.join();
    return status_;
  }

 private:
  std::promise<void> go_on_;
  std::atomic<bool> held_ = false;
  grpc::Status status_;
  std::thread thread_;
};

class CallPoolTest : public testing::Test {
 protected:
  static ServerOptions Options(const TempDir& dir, FaultyFileCalls* calls) {
    ServerOptions options;
    options.build_threads = 1;
    options.repository = dir.path();
    options.files = calls;
    return options;
  }
  void SetUp() override {
    v1::Scene scene;
    ASSERT_TRUE(harness_.CreateBuiltin("small", "builtin:box:1000", &scene).ok());
    ASSERT_TRUE(harness_.CreateScene(WallUpload("wall"), &scene).ok());
    grpc::ClientContext context;
    v1::UnloadSceneRequest request;
    google::protobuf::Empty nothing;
    request.set_name("scenes/wall");
    ASSERT_TRUE(harness_.scenes->UnloadScene(&context, request, &nothing).ok());
  }
  // What waits for the build ends as late as this, and fails the test.
  static void LimitTo(grpc::ClientContext* context) {
    context->set_deadline(std::chrono::system_clock::now() + std::chrono::minutes(1));
  }

  const TempDir dir_;
  FaultyFileCalls calls_;
  ServerHarness harness_{Options(dir_, &calls_)};
};

TEST_F(CallPoolTest, WhatIsDeletedGoesWhileABuildIsUnderWay) {
  HeldLoad load(harness_, calls_);
  ASSERT_TRUE(Until("the load is held up", [&] { return load.held(); }));
  grpc::ClientContext context;
  LimitTo(&context);
  v1::DeleteSceneRequest request;
  google::protobuf::Empty nothing;
  request.set_name("scenes/small");
  const grpc::Status status = harness_.scenes->DeleteScene(&context, request, &nothing);
  EXPECT_TRUE(status.ok()) << status.error_message();
  EXPECT_TRUE(load.Finish().ok());
}

// Its messages are read, and it is told what is wrong with them.
TEST_F(CallPoolTest, AnUploadIsReadWhileABuildIsUnderWay) {
  HeldLoad load(harness_, calls_);
  ASSERT_TRUE(Until("the load is held up", [&] { return load.held(); }));
  grpc::ClientContext context;
  LimitTo(&context);
  v1::Scene scene;
  const auto writer = harness_.scenes->CreateScene(&context, &scene);
  const v1::CreateSceneRequest header = WallUpload("other").front();
  writer->Write(header);
  writer->Write(header);  // It comes once.
  writer->WritesDone();
  const grpc::Status status = writer->Finish();
  EXPECT_EQ(ReasonIn(status), "BAD_SEQUENCE") << status.error_message();
  EXPECT_TRUE(load.Finish().ok());
}

}  // namespace
}  // namespace sightline

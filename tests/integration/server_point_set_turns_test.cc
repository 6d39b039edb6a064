// SPDX-License-Identifier: Apache-2.0
//
// Point sets that a camera makes, beside others' queries: by turns with them, within the same
// quotas, and ended when they are told to.
#include <algorithm>
#include <atomic>
#include <memory>
#include <thread>
#include <utility>

#include "server/admission/scheduler.h"
#include "tests/integration/server_harness.h"
#include "tests/support/until.h"

namespace sightline {
namespace {

using testing_support::Until;

constexpr char kSphereSpec[] = "sphere:2000";
constexpr uint32_t kImage = 512;

// Every ray against every triangle, so that a picture takes its time.
v1::TraceTilesRequest Header(v1::Strategy strategy) {
  v1::TraceTilesRequest request;
  request.mutable_header()->mutable_stream()->set_scene("scenes/heavy");
  request.mutable_header()->mutable_stream()->mutable_options()->set_strategy(strategy);
  EncodeTestCamera(ViewCamera(FirstView(kSphereSpec), kImage, kImage),
                   request.mutable_header()->mutable_camera());
  return request;
}

// Has the server make a point set of what a camera sees, while the test does something else.
class CameraSet {
 public:
  // `side` pixels square.
  CameraSet(const ServerHarness& harness, uint32_t side) {
    v1::CreatePointSetRequest request;
    v1::CreatePointSetHeader* const header = request.mutable_header();
    header->set_parent("scenes/heavy");
    EncodeTestCamera(ViewCamera(FirstView(kSphereSpec), side, side),
                     header->mutable_camera()->mutable_camera());
    header->mutable_camera()->mutable_options()->set_strategy(v1::STRATEGY_BRUTE_FORCE);
    writer_ = harness.point_sets->CreatePointSet(&context_, &set_);
    writer_->WriteLast(request, grpc::WriteOptions());
  }
  ~CameraSet() {
    if (writer_ != nullptr) Cancel();
  }
  grpc::Status Finish() { return std::exchange(writer_, nullptr)->Finish(); }
  grpc::Status Cancel() {
    context_.TryCancel();
    return Finish();
  }
  const v1::PointSet& set() const { return set_; }

 private:
  grpc::ClientContext context_;
  v1::PointSet set_;
  std::unique_ptr<grpc::ClientWriter<v1::CreatePointSetRequest>> writer_;
};

// A set of minutes of work: another client's tile comes before the rest of it, by the scheduler's
// turns, and a cancel ends it.
TEST(PointSetTurnsTest, OneTileDoesNotWaitForAnotherClientsPointSet) {
  ServerOptions options;
  options.threads = 1;
  ServerHarness harness(options);
  v1::Scene scene;
  ASSERT_TRUE(harness.CreateBuiltin("heavy", "builtin:sphere:2000", &scene).ok());
  CameraSet bulk(harness, 4096);
  ASSERT_TRUE(Until("the set is being traced", [&] { return harness.server->queued_rays() > 0; }));
  // The same machine by another way is another client.
  grpc::ClientContext context;
  const auto stub =
      v1::VisibilityService::NewStub(harness.server->InProcessChannel(grpc::ChannelArguments()));
  const auto small = stub->TraceTiles(&context);
  small->Write(Header(v1::STRATEGY_AUTO));
  v1::TraceTilesResponse response;
  ASSERT_TRUE(small->Read(&response));
  for (uint64_t tile = 0; tile < 3; ++tile) {
    small->Write(TileRequest(tile, 0, 0, 16, 16));
    ASSERT_TRUE(small->Read(&response));
    EXPECT_EQ(response.reply().header().status().code(), 0);
  }
  small->WritesDone();
  EXPECT_FALSE(small->Read(&response));
  EXPECT_TRUE(small->Finish().ok());
  // What the set holds it gives back before anybody hears that it has ended: it is under way.
  EXPECT_GT(harness.server->queued_rays(), 0u);
  EXPECT_EQ(bulk.Cancel().error_code(), grpc::StatusCode::CANCELLED);
  EXPECT_TRUE(Until("the set lets go of what it holds", [&] {
    return harness.server->queued_rays() == 0 && harness.server->active_calls() == 0;
  }));
}

// A set counts against its client's rays: it waits for none, and holds no more of them than there
// are, so that it may be larger than all of them.
TEST(PointSetTurnsTest, APointSetKeepsItsClientsQuota) {
  constexpr uint32_t kTile = 128;
  constexpr uint64_t kQuota = kTile * kTile;
  static_assert(kQuota < Scheduler::kFirstPartRays);
  ServerOptions options;
  options.threads = 1;
  options.limits.max_queued_rays_per_client = kQuota;
  ServerHarness harness(options);
  v1::Scene scene;
  ASSERT_TRUE(harness.CreateBuiltin("heavy", "builtin:sphere:2000", &scene).ok());
  {
    // The second item's answer is not wanted yet: it holds all that there is.
    v1::TraceTilesRequest header = Header(v1::STRATEGY_BRUTE_FORCE);
    header.mutable_header()->mutable_stream()->set_result_credit_rays(1);
    TileStream stream(harness, header);
    v1::TraceTilesResponse response;
    ASSERT_TRUE(stream.Read(&response));
    stream.Write(TileRequest(1, 0, 0, 16, 16));
    ASSERT_TRUE(stream.Read(&response));
    stream.Write(TileRequest(2, 0, 0, kTile, kTile));
    ASSERT_TRUE(
        Until("the item is accepted", [&] { return harness.server->queued_rays() == kQuota; }));
    const grpc::Status refused = CameraSet(harness, kImage).Finish();
    EXPECT_EQ(refused.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
    EXPECT_EQ(ReasonIn(refused), "QUOTA_EXCEEDED") << refused.error_message();
  }
  ASSERT_TRUE(Until("the stream is gone", [&] { return harness.server->queued_rays() == 0; }));
  CameraSet larger(harness, kImage);
  std::atomic<bool> ended = false;
  grpc::Status made;
  std::thread client([&] {
    made = larger.Finish();
    ended = true;
  });
  uint64_t most = 0;
  EXPECT_TRUE(Until("the set is made", [&] {
    most = std::max(most, harness.server->queued_rays());
    return ended.load();
  }));
  client.join();
  EXPECT_TRUE(made.ok()) << made.error_message();
  EXPECT_EQ(larger.set().point_count(), uint64_t{kImage} * kImage);
  EXPECT_LE(most, kQuota);
}

}  // namespace
}  // namespace sightline

// SPDX-License-Identifier: Apache-2.0
//
// A camera's point set by hand: its tasks run when the test says so, on a clock that stands still,
// so that every order below is the only one possible.
#include "server/points/camera_trace.h"

#include <algorithm>
#include <chrono>
#include <deque>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "core/base/parallel.h"
#include "core/mesh/builtin/builtin.h"
#include "core/query/tiles.h"
#include "gtest/gtest.h"
#include "server/base/error.h"
#include "server/base/limits.h"

namespace sightline {
namespace {

constexpr uint64_t kTileRays = CameraPoints::kTileRays;

class CameraTraceTest : public testing::Test {
 protected:
  void SetUp() override {
    BuiltinScene box = *MakeBuiltin(*ParseBuiltin("box:1000"));
    ThreadPool pool(1);
    scene_ = *BuildScene("box", 1, box.objects, std::nullopt, {}, pool);
    view_ = box.views[0];
  }
  void TearDown() override { RunAll(); }

  void MakeScheduler(int threads) {
    scheduler_.emplace(
        threads, [this](absl::AnyInvocable<void()> work) { workers_.push_back(std::move(work)); },
        [] { return Scheduler::Clock::time_point(); }, [] { return std::chrono::nanoseconds(0); });
  }
  Camera CameraOf(uint32_t width, uint32_t height) const {
    return *LookAt(view_.eye, view_.at, view_.up, view_.fov_y_degrees, width, height);
  }
  absl::StatusOr<std::shared_ptr<CameraTrace>> Admit(RayQueue& queue, uint32_t width,
                                                     uint32_t height) {
    return CameraTrace::Admit(*scheduler_, queue, {"camera", {}},
                              *CameraPoints::Make(scene_, CameraOf(width, height), {}), &cancel_);
  }
  void Start(CameraTrace& trace) {
    trace.Start([this] { ++done_; });
  }
  // A thread of the scheduler takes its turns: about as much work as the largest part.
  bool RunWorker() {
    if (workers_.empty()) return false;
    absl::AnyInvocable<void()> work = std::move(workers_.front());
    workers_.pop_front();
    work();
    return true;
  }
  void RunAll() {
    while (RunWorker()) {
    }
  }

  std::shared_ptr<const Scene> scene_;
  BuiltinView view_;
  CancelToken cancel_;
  std::deque<absl::AnyInvocable<void()>> workers_;
  std::optional<Scheduler> scheduler_;
  int done_ = 0;
};

// However the picture is cut, and with tiles that the edges cut.
TEST_F(CameraTraceTest, ThePointsAreThoseOfThePictureInOnePiece) {
  const Camera camera = CameraOf(200, 150);
  TileResult whole;
  ASSERT_TRUE(
      TraceTile(*scene_, camera, {0, 0, 200, 150}, {}, {.hits = true, .points = true}, {}, &whole)
          .ok());
  ASSERT_FALSE(whole.points.positions.empty());
  for (const int threads : {1, 3}) {
    MakeScheduler(threads);
    RayQueue queue(Limits().max_queued_rays, Limits().max_queued_rays_per_client);
    std::shared_ptr<CameraTrace> trace = *Admit(queue, 200, 150);
    Start(*trace);
    RunAll();
    ASSERT_EQ(done_, 1);
    done_ = 0;
    const absl::StatusOr<PreparedPoints> points = trace->Take();
    trace.reset();
    ASSERT_TRUE(points.ok()) << points.status();
    ASSERT_EQ(points->size(), 200u * 150u);
    EXPECT_EQ(points->attached, whole.points.size());
    EXPECT_EQ(points->invalid, 200u * 150u - whole.points.size());
    EXPECT_EQ(points->near_surface, whole.points.near_surface);
    size_t valid = 0;
    for (const uint8_t flag : points->valid) valid += flag;
    EXPECT_EQ(valid, whole.points.size());
    for (size_t i = 0; i < whole.points.size(); ++i) {
      const uint32_t pixel = whole.point_pixel[i];
      EXPECT_EQ(points->positions[pixel], whole.points.positions[i]) << pixel;
      EXPECT_EQ(points->sources[pixel], whole.points.sources[i]) << pixel;
    }
    EXPECT_EQ(queue.queued_rays(), 0u);
    scheduler_.reset();
  }
}

// A groove of half a degree, where a float's step is 2^-7: near its bottom no place is clear of
// both walls. The set states it as the engine does.
TEST_F(CameraTraceTest, PointsNearASurfaceAreCounted) {
  const double x = 1e5, y = 1e5, z = 1e5, half = 0.175;
  const ObjectInput groove = {.name = "groove",
                              .vertices = {{x, y - 9, z},
                                           {x, y + 9, z},
                                           {x - half, y + 9, z + 40},
                                           {x - half, y - 9, z + 40},
                                           {x + half, y + 9, z + 40},
                                           {x + half, y - 9, z + 40}},
                              .indices = {0, 1, 2, 0, 2, 3, 1, 0, 5, 1, 5, 4}};
  ThreadPool pool(1);
  scene_ = *BuildScene("groove", 1, {&groove, 1}, Vec3d{}, {}, pool);
  view_ = {.eye = {x, y, z + 90}, .at = {x, y, z}, .up = {0, 1, 0}, .fov_y_degrees = 0.25};
  TileResult whole;
  ASSERT_TRUE(
      TraceTile(*scene_, CameraOf(96, 80), {0, 0, 96, 80}, {}, {.points = true}, {}, &whole).ok());
  EXPECT_GT(whole.points.near_surface, 100u);
  MakeScheduler(1);
  RayQueue queue(Limits().max_queued_rays, Limits().max_queued_rays_per_client);
  std::shared_ptr<CameraTrace> trace = *Admit(queue, 96, 80);
  Start(*trace);
  RunAll();
  const absl::StatusOr<PreparedPoints> points = trace->Take();
  ASSERT_TRUE(points.ok()) << points.status();
  EXPECT_EQ(points->near_surface, whole.points.near_surface);
  EXPECT_EQ(points->attached, whole.points.attached);
}

TEST_F(CameraTraceTest, AnothersTileComesBeforeTheRestOfTheSet) {
  MakeScheduler(1);
  RayQueue queue(Limits().max_queued_rays, Limits().max_queued_rays_per_client);
  std::shared_ptr<CameraTrace> trace = *Admit(queue, 2048, 1024);
  Start(*trace);
  ASSERT_TRUE(RunWorker());
  const auto other = scheduler_->Open("other");
  bool tile = false;
  other->Announce(256);
  other->Add({}, 256, [&] { return tile = true; });
  ASSERT_TRUE(RunWorker());
  EXPECT_TRUE(tile);
  EXPECT_EQ(done_, 0);
  // Some four parts of the largest size have run.
  EXPECT_GT(scheduler_->load().announced_rays, 2048u * 512u);
  RunAll();
  EXPECT_EQ(done_, 1);
}

// One task for each thread and one more, and as many rays as those have; or as many as there is
// room for, and the set goes on all the same.
TEST_F(CameraTraceTest, HoldsNoMoreOfTheQueueThanWhatIsUnderWay) {
  constexpr int kThreads = 3;
  for (const uint64_t quota : {Limits().max_queued_rays_per_client, 5 * kTileRays, kTileRays}) {
    MakeScheduler(kThreads);
    RayQueue queue(Limits().max_queued_rays, quota);
    std::shared_ptr<CameraTrace> trace = *Admit(queue, 1024, 1024);
    EXPECT_EQ(queue.queued_rays(), kTileRays);
    Start(*trace);
    const uint64_t most = std::min(quota, (kThreads + 1) * Scheduler::kMostPartRays);
    do {
      const Scheduler::Load load = scheduler_->load();
      EXPECT_LE(load.waiting_tasks, size_t{kThreads + 1});
      EXPECT_LE(queue.queued_rays(), most);
      EXPECT_GE(queue.queued_rays(), done_ == 0 ? kTileRays : 0);
    } while (RunWorker());
    EXPECT_EQ(done_, 1);
    EXPECT_EQ(queue.queued_rays(), 0u);
    EXPECT_EQ(scheduler_->load().announced_rays, 0u);
    EXPECT_TRUE(trace->Take().ok());
    trace.reset();
    scheduler_.reset();
    done_ = 0;
  }
}

TEST_F(CameraTraceTest, IsRefusedWhereNotEvenATileHasRoom) {
  MakeScheduler(1);
  RayQueue queue(/*max_rays=*/4 * kTileRays, /*max_rays_per_client=*/2 * kTileRays);
  const RayAccount own = queue.Open("camera"), others = queue.Open("other");
  {
    const RayTicket ticket = *queue.Admit(own, kTileRays + 1);
    const absl::Status status = Admit(queue, 1024, 1024).status();
    EXPECT_EQ(ReasonOf(status), v1::ERROR_REASON_QUOTA_EXCEEDED) << status;
    EXPECT_TRUE(status.GetPayload(kRetryInfoUrl).has_value()) << status;
    // One that is small enough has room.
    EXPECT_TRUE(Admit(queue, 32, 32).ok());
  }
  {
    const RayTicket ticket = *queue.Admit(others, 3 * kTileRays + 1);
    const absl::Status status = Admit(queue, 1024, 1024).status();
    EXPECT_EQ(ReasonOf(status), v1::ERROR_REASON_QUEUE_FULL) << status;
    EXPECT_TRUE(status.GetPayload(kRetryInfoUrl).has_value()) << status;
  }
  EXPECT_EQ(queue.queued_rays(), 0u);
  EXPECT_EQ(scheduler_->load().flows, 0u);
}

TEST_F(CameraTraceTest, ACancelEndsItByTheNextTurn) {
  MakeScheduler(2);
  RayQueue queue(Limits().max_queued_rays, Limits().max_queued_rays_per_client);
  std::shared_ptr<CameraTrace> trace = *Admit(queue, 2048, 2048);
  Start(*trace);
  ASSERT_TRUE(RunWorker());
  ASSERT_EQ(done_, 0);
  ASSERT_GT(scheduler_->load().waiting_tasks, 0u);
  cancel_.Cancel();
  EXPECT_TRUE(RunWorker());
  EXPECT_EQ(done_, 1);
  EXPECT_TRUE(absl::IsCancelled(trace->Take().status()));
  EXPECT_EQ(queue.queued_rays(), 0u);
  EXPECT_EQ(scheduler_->load().waiting_tasks, 0u);
  EXPECT_EQ(scheduler_->load().announced_rays, 0u);
}

}  // namespace
}  // namespace sightline

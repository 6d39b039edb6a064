// SPDX-License-Identifier: Apache-2.0
#include "server/metrics/metrics.h"

#include <chrono>
#include <string>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace sightline {
namespace {

using std::chrono::milliseconds;
using ::testing::HasSubstr;
using ::testing::Not;

TEST(MetricsTest, ItemsAreCountedByResult) {
  Metrics metrics([] { return ServerState(); });
  ItemRecord record;
  record.operation = Operation::kComputeShadows;
  record.queue = milliseconds(2);
  record.total = milliseconds(30);
  record.stats.rays = 1000;
  record.stats.strategy = Strategy::kShaft;
  record.stats.nodes = 70;
  record.stats.doubt_exact = 3;
  record.stats.answered_by = {0, 600, 300, 0, 100};
  record.stats.compute_nanoseconds = 20'000'000;
  metrics.RecordItem(record);
  metrics.RecordItem(record);
  record.code = absl::StatusCode::kDeadlineExceeded;
  metrics.RecordItem(record);
  record = {.operation = Operation::kComputeShadows,
            .code = absl::StatusCode::kResourceExhausted,
            .total = milliseconds(1)};
  metrics.RecordItem(record);
  metrics.RecordCall(Operation::kCreateScene, absl::StatusCode::kInvalidArgument, milliseconds(5));
  metrics.RecordCall(Operation::kGetScene, absl::StatusCode::kNotFound, milliseconds(5));
  const std::string text = metrics.Text();
  for (const char* line : {
           "sightline_requests_total{method=\"ComputeShadows\",result=\"ok\"} 2",
           "sightline_requests_total{method=\"ComputeShadows\",result=\"expired\"} 1",
           "sightline_requests_total{method=\"ComputeShadows\",result=\"rejected\"} 1",
           "sightline_requests_total{method=\"TraceTiles\",result=\"ok\"} 0",
           "sightline_requests_total{method=\"CreateScene\",result=\"failed\"} 1",
           "sightline_rays_total{method=\"ComputeShadows\"} 3000",
           "sightline_strategy_rays_total{strategy=\"SHAFT\"} 3000",
           "sightline_nodes_total 210",
           "sightline_exact_tests_total 9",
           "sightline_answered_rays_total{by=\"shaft\"} 1800",
           "sightline_answered_rays_total{by=\"triangles\"} 900",
           "sightline_answered_rays_total{by=\"packet\"} 0",
           "sightline_answered_rays_total{by=\"ray\"} 300",
           "sightline_requests_total{method=\"GetScene\",result=\"failed\"} 1",
           "sightline_requests_total{method=\"UnloadScene\",result=\"ok\"} 0",
           // What was refused at once is in no time.
           "sightline_request_seconds_count{method=\"ComputeShadows\"} 3",
           "sightline_request_seconds_bucket{method=\"ComputeShadows\",le=\"0.025\"} 0",
           "sightline_request_seconds_bucket{method=\"ComputeShadows\",le=\"0.05\"} 3",
           "sightline_queue_seconds_bucket{method=\"ComputeShadows\",le=\"0.0025\"} 3",
           "sightline_compute_seconds_count{method=\"ComputeShadows\"} 3",
           "sightline_request_seconds_count{method=\"CreateScene\"} 1",
       }) {
    EXPECT_THAT(text, HasSubstr(std::string(line) + "\n"));
  }
  EXPECT_THAT(text, Not(HasSubstr("sightline_queue_seconds_count{method=\"CreateScene\"}")));
}

TEST(MetricsTest, TheStateIsThatOfTheMoment) {
  ServerState state;
  Metrics metrics([&] { return state; });
  EXPECT_THAT(metrics.Text(), HasSubstr("sightline_pending_rays 0\n"));
  state.queued_rays = 4096;
  state.open_connections = 3;
  state.refused_connections = 2;
  state.scenes = {{.id = "hall", .revision = 4, .bytes = 1000, .triangles = 12}};
  state.draining = true;
  state.unstored_scenes = 1;
  state.failed_scene_stores = 5;
  state.max_scene_bytes = 3000;
  state.max_point_set_bytes = 2000;
  state.max_queued_rays = 8192;
  const std::string text = metrics.Text();
  for (const char* line :
       {"sightline_pending_rays 4096", "sightline_open_connections 3", "sightline_scenes 1",
        "sightline_refused_connections_total 2", "sightline_scene_bytes{scene=\"hall\"} 1000",
        "sightline_scene_revision{scene=\"hall\"} 4", "sightline_draining 1",
        "sightline_unstored_scenes 1", "sightline_failed_scene_stores_total 5",
        "sightline_scene_memory_limit_bytes 3000", "sightline_point_set_limit_bytes 2000",
        "sightline_pending_rays_limit 8192"}) {
    EXPECT_THAT(text, HasSubstr(std::string(line) + "\n"));
  }
  EXPECT_THAT(text, HasSubstr("sightline_build_info{version=\""));
  EXPECT_THAT(text, HasSubstr("# TYPE sightline_refused_connections_total counter\n"));
  EXPECT_THAT(text, HasSubstr("# TYPE sightline_pending_rays gauge\n"));
}

TEST(MetricsTest, EveryCodeHasAResult) {
  Metrics metrics([] { return ServerState(); });
  for (int code = 0; code <= 16; ++code) {
    metrics.RecordCall(Operation::kWatchScene, static_cast<absl::StatusCode>(code),
                       milliseconds(1));
  }
  const std::string text = metrics.Text();
  for (const char* result :
       {"ok\"} 1", "rejected\"} 4", "cancelled\"} 1", "expired\"} 1", "failed\"} 10"}) {
    EXPECT_THAT(text, HasSubstr(absl::StrCat(
                          "sightline_requests_total{method=\"WatchScene\",result=\"", result)));
  }
}

}  // namespace
}  // namespace sightline

// SPDX-License-Identifier: Apache-2.0
#include "server/metrics/metrics.h"

#include <prometheus/counter.h>
#include <prometheus/family.h>
#include <prometheus/histogram.h>
#include <prometheus/registry.h>
#include <prometheus/text_serializer.h>

#include <array>
#include <iterator>
#include <utility>

#include "core/base/check.h"
#include "server/metrics/process_usage.h"
#include "server/version.h"

namespace sightline {
namespace {

constexpr absl::string_view kOperationNames[] = {
    "TraceTiles",     "ComputeShadows", "TestSegments", "CreateScene",      "UpdateScene",
    "CreatePointSet", "GetScene",       "ListScenes",   "ListSceneObjects", "DeleteScene",
    "LoadScene",      "ReloadScene",    "UnloadScene",  "ListStoredScenes", "GetPointSet",
    "ListPointSets",  "DeletePointSet", "RenewLease",   "GetCapabilities",  "WatchScene"};
static_assert(std::size(kOperationNames) == kOperations);

// By AnsweredBy.
constexpr const char* kAnsweredBy[] = {"", "shaft", "triangles", "packet", "ray"};
static_assert(std::size(kAnsweredBy) == kAnsweredByCount);

enum Result { kOk, kRejected, kCancelled, kExpired, kFailed };
constexpr absl::string_view kResultNames[] = {"ok", "rejected", "cancelled", "expired", "failed"};

Result ResultOf(absl::StatusCode code) {
  switch (code) {
    case absl::StatusCode::kOk:
      return kOk;
    case absl::StatusCode::kResourceExhausted:
    case absl::StatusCode::kUnavailable:
    case absl::StatusCode::kPermissionDenied:
    case absl::StatusCode::kUnauthenticated:
      return kRejected;
    case absl::StatusCode::kCancelled:
      return kCancelled;
    case absl::StatusCode::kDeadlineExceeded:
      return kExpired;
    default:
      return kFailed;
  }
}

// From a tile alone (0.1 ms) to a build of many millions of triangles.
const prometheus::Histogram::BucketBoundaries& Seconds() {
  static const auto* const bounds = new prometheus::Histogram::BucketBoundaries{
      0.0001, 0.00025, 0.0005, 0.001, 0.0025, 0.005, 0.01, 0.025, 0.05,
      0.1,    0.25,    0.5,    1,     2.5,    5,     10,   30,    60};
  return *bounds;
}

double ToSeconds(std::chrono::nanoseconds time) {
  return std::chrono::duration<double>(time).count();
}

prometheus::Counter& MakeCounter(prometheus::Registry& registry, const char* name,
                                 const char* help) {
  return prometheus::BuildCounter().Name(name).Help(help).Register(registry).Add({});
}

// A family without counters of its own: what the server's state says at this moment.
class StatePage {
 public:
  void Add(const char* name, const char* help, prometheus::MetricType type, double value) {
    Family(name, help, type);
    Sample({}, value);
  }
  void Gauge(const char* name, const char* help, double value) {
    Add(name, help, prometheus::MetricType::Gauge, value);
  }
  void Counter(const char* name, const char* help, double value) {
    Add(name, help, prometheus::MetricType::Counter, value);
  }
  void Family(const char* name, const char* help, prometheus::MetricType type) {
    families_.push_back({name, help, type, {}});
  }
  void Sample(std::vector<prometheus::ClientMetric::Label> labels, double value) {
    prometheus::ClientMetric metric;
    metric.label = std::move(labels);
    metric.gauge.value = metric.counter.value = value;  // The family's type says which counts.
    families_.back().metric.push_back(std::move(metric));
  }
  std::vector<prometheus::MetricFamily> Take() { return std::move(families_); }

 private:
  std::vector<prometheus::MetricFamily> families_;
};

void AddScenes(const ServerState& state, StatePage* page) {
  using Type = prometheus::MetricType;
  page->Gauge("sightline_scenes", "Scenes at hand.", static_cast<double>(state.scenes.size()));
  const auto each = [&](const char* name, const char* help, uint64_t ServerState::Scene::*value) {
    page->Family(name, help, Type::Gauge);
    for (const ServerState::Scene& scene : state.scenes) {
      page->Sample({{"scene", scene.id}}, static_cast<double>(scene.*value));
    }
  };
  each("sightline_scene_bytes", "Memory of a scene's current revision.",
       &ServerState::Scene::bytes);
  each("sightline_scene_triangles", "Triangles of a scene's current revision.",
       &ServerState::Scene::triangles);
  each("sightline_scene_revision", "How many revisions a scene has had.",
       &ServerState::Scene::revision);
  page->Gauge("sightline_unstored_scenes",
              "Scenes that serve and should be stored, but whose last store failed.",
              static_cast<double>(state.unstored_scenes));
  page->Counter("sightline_failed_scene_stores_total",
                "Revisions of scenes that could not be stored: a restart loses them.",
                static_cast<double>(state.failed_scene_stores));
  page->Gauge("sightline_scene_memory_bytes",
              "Memory of all revisions alive and builds under way; max_scene_bytes bounds it.",
              static_cast<double>(state.scene_bytes));
  page->Gauge("sightline_scene_memory_limit_bytes", "max_scene_bytes.",
              static_cast<double>(state.max_scene_bytes));
  page->Gauge("sightline_point_set_bytes",
              "Memory of all point sets; max_point_set_bytes bounds it.",
              static_cast<double>(state.point_set_bytes));
  page->Gauge("sightline_point_set_limit_bytes", "max_point_set_bytes.",
              static_cast<double>(state.max_point_set_bytes));
}

void AddLoad(const ServerState& state, StatePage* page) {
  page->Gauge("sightline_active_calls", "Streams, uploads and other calls under way.",
              static_cast<double>(state.active_calls));
  page->Gauge("sightline_active_uploads", "Uploads under way.",
              static_cast<double>(state.active_uploads));
  page->Gauge("sightline_pending_rays",
              "Rays accepted and not yet answered; max_queued_rays bounds it.",
              static_cast<double>(state.queued_rays));
  page->Gauge("sightline_pending_rays_limit", "max_queued_rays.",
              static_cast<double>(state.max_queued_rays));
  page->Gauge("sightline_clients",
              "Clients with a visibility stream, or a set of a camera's points being made.",
              static_cast<double>(state.clients));
  page->Gauge("sightline_waiting_tasks", "Parts of items that wait for a thread.",
              static_cast<double>(state.waiting_tasks));
  page->Gauge("sightline_running_tasks", "Parts of items that are computed now.",
              static_cast<double>(state.running_tasks));
  page->Gauge("sightline_rays_per_second",
              "Rays that all threads together compute a second, by the latest tasks.",
              state.rays_per_second);
  page->Gauge("sightline_open_connections", "Connections of clients.",
              static_cast<double>(state.open_connections));
  page->Counter("sightline_accepted_connections_total", "Connections taken.",
                static_cast<double>(state.accepted_connections));
  page->Counter("sightline_refused_connections_total",
                "Connections closed at once: too many, or no descriptor left.",
                static_cast<double>(state.refused_connections));
  if (state.certificate_end != absl::InfiniteFuture()) {
    page->Gauge("sightline_certificate_end_seconds",
                "When the server's certificate expires, seconds since 1970.",
                static_cast<double>(absl::ToUnixSeconds(state.certificate_end)));
  }
  page->Counter("sightline_refused_calls_total", "Calls refused for want of a role.",
                static_cast<double>(state.refused_calls));
  page->Gauge("sightline_draining", "1 while the server shuts down.", state.draining ? 1 : 0);
  page->Counter("sightline_security_reloads_total",
                "Times that certificates and the access file were read again, and were good.",
                static_cast<double>(state.security_reloads));
  page->Counter("sightline_failed_security_reloads_total",
                "Times that one of them was not, and the last good one stayed.",
                static_cast<double>(state.failed_security_reloads));
  page->Counter("sightline_dropped_log_lines_total",
                "Lines of the log that were dropped because nobody read it as fast as it was "
                "written.",
                static_cast<double>(state.dropped_log_lines));
}

void AddProcess(StatePage* page) {
  const ProcessUsage usage = MeasureProcess();
  page->Counter("process_cpu_seconds_total", "CPU time, user and system.", usage.cpu_seconds);
  page->Gauge("process_resident_memory_bytes", "Resident memory.",
              static_cast<double>(usage.resident_bytes));
  page->Gauge("process_open_fds", "Open descriptors.", static_cast<double>(usage.open_descriptors));
  page->Gauge("process_max_fds", "Limit on open descriptors.",
              static_cast<double>(usage.max_descriptors));
  page->Gauge("process_threads", "Threads.", static_cast<double>(usage.threads));
  page->Family("sightline_build_info", "1, with the version.", prometheus::MetricType::Gauge);
  page->Sample({{"version", std::string(kVersion)}}, 1);
}

}  // namespace

absl::string_view OperationName(Operation operation) {
  return kOperationNames[static_cast<size_t>(operation)];
}

class Metrics::Impl {
 public:
  explicit Impl(std::function<ServerState()> state) : state_(std::move(state)) {
    auto& requests = prometheus::BuildCounter()
                         .Name("sightline_requests_total")
                         .Help("Items of streams and other calls, by how they ended.")
                         .Register(registry_);
    auto& total = Times("sightline_request_seconds", "From arrival to the last reply.");
    auto& queue = Times("sightline_queue_seconds", "From arrival to the start of computation.");
    auto& compute = Times("sightline_compute_seconds", "Computation, summed over threads.");
    auto& rays = prometheus::BuildCounter()
                     .Name("sightline_rays_total")
                     .Help("Rays and segments traced.")
                     .Register(registry_);
    auto& answered =
        prometheus::BuildCounter()
            .Name("sightline_answered_rays_total")
            .Help(
                "Rays by what answered them, of the items in which that was counted: every "
                "sixteenth of a stream, and those that asked for statistics.")
            .Register(registry_);
    for (size_t by = 1; by < answered_.size(); ++by) {
      answered_[by] = &answered.Add({{"by", kAnsweredBy[by]}});
    }
    for (size_t i = 0; i < kOperations; ++i) {
      const std::string method(kOperationNames[i]);
      PerOperation& mine = operations_[i];
      for (size_t r = 0; r < std::size(kResultNames); ++r) {
        mine.requests[r] =
            &requests.Add({{"method", method}, {"result", std::string(kResultNames[r])}});
      }
      mine.total = &total.Add({{"method", method}}, Seconds());
      if (static_cast<Operation>(i) > Operation::kTestSegments) continue;
      mine.queue = &queue.Add({{"method", method}}, Seconds());
      mine.compute = &compute.Add({{"method", method}}, Seconds());
      mine.rays = &rays.Add({{"method", method}});
    }
  }

  void RecordItem(const ItemRecord& record) {
    PerOperation& mine = operations_[static_cast<size_t>(record.operation)];
    SIGHTLINE_CHECK(mine.rays != nullptr) << "a call has no rays: use RecordCall";
    const Result result = ResultOf(record.code);
    mine.requests[result]->Increment();
    const QueryStats& stats = record.stats;
    mine.rays->Increment(static_cast<double>(stats.rays));
    if (stats.rays > 0) {
      strategies_.Add({{"strategy", std::string(StrategyName(stats.strategy))}})
          .Increment(static_cast<double>(stats.rays));
    }
    nodes_.Increment(static_cast<double>(stats.nodes));
    leaves_.Increment(static_cast<double>(stats.leaves));
    triangle_tests_.Increment(static_cast<double>(stats.triangle_tests));
    double_tests_.Increment(static_cast<double>(stats.doubt_double));
    exact_tests_.Increment(static_cast<double>(stats.doubt_exact));
    for (size_t by = 1; by < answered_.size(); ++by) {
      if (stats.answered_by[by] > 0) {
        answered_[by]->Increment(static_cast<double>(stats.answered_by[by]));
      }
    }
    // What was refused at once would make the server look fast.
    if (result == kRejected) return;
    mine.total->Observe(ToSeconds(record.total));
    mine.queue->Observe(ToSeconds(record.queue));
    mine.compute->Observe(ToSeconds(std::chrono::nanoseconds(stats.compute_nanoseconds)));
  }

  void RecordCall(Operation operation, absl::StatusCode code, std::chrono::nanoseconds time) {
    PerOperation& mine = operations_[static_cast<size_t>(operation)];
    const Result result = ResultOf(code);
    mine.requests[result]->Increment();
    if (result != kRejected) mine.total->Observe(ToSeconds(time));
  }

  std::string Text() const {
    StatePage page;
    const ServerState state = state_();
    AddLoad(state, &page);
    AddScenes(state, &page);
    AddProcess(&page);
    std::vector<prometheus::MetricFamily> families = registry_.Collect();
    std::vector<prometheus::MetricFamily> now = page.Take();
    std::move(now.begin(), now.end(), std::back_inserter(families));
    return prometheus::TextSerializer().Serialize(families);
  }

 private:
  struct PerOperation {
    std::array<prometheus::Counter*, std::size(kResultNames)> requests{};
    prometheus::Histogram* total = nullptr;
    // Of queries alone.
    prometheus::Histogram *queue = nullptr, *compute = nullptr;
    prometheus::Counter* rays = nullptr;
  };

  prometheus::Family<prometheus::Histogram>& Times(const char* name, const char* help) {
    return prometheus::BuildHistogram().Name(name).Help(help).Register(registry_);
  }

  const std::function<ServerState()> state_;
  prometheus::Registry registry_;
  std::array<PerOperation, kOperations> operations_;
  prometheus::Family<prometheus::Counter>& strategies_ =
      prometheus::BuildCounter()
          .Name("sightline_strategy_rays_total")
          .Help("Rays by what answered their item; AUTO where more than one strategy did.")
          .Register(registry_);
  std::array<prometheus::Counter*, kAnsweredByCount> answered_{};  // None for kNoRay.
  prometheus::Counter& nodes_ = MakeCounter(registry_, "sightline_nodes_total",
                                            "Tree nodes visited, once per packet or ray.");
  prometheus::Counter& leaves_ =
      MakeCounter(registry_, "sightline_leaves_total", "Leaves visited, once per packet or ray.");
  prometheus::Counter& triangle_tests_ =
      MakeCounter(registry_, "sightline_triangle_tests_total", "Pairs of triangle and ray tested.");
  prometheus::Counter& double_tests_ =
      MakeCounter(registry_, "sightline_double_tests_total",
                  "Pairs that the float filter left to the double one.");
  prometheus::Counter& exact_tests_ =
      MakeCounter(registry_, "sightline_exact_tests_total", "Pairs that needed exact arithmetic.");
};

Metrics::Metrics(std::function<ServerState()> state)
    : impl_(std::make_unique<Impl>(std::move(state))) {}
Metrics::~Metrics() = default;

void Metrics::RecordItem(const ItemRecord& record) { impl_->RecordItem(record); }
void Metrics::RecordCall(Operation operation, absl::StatusCode code,
                         std::chrono::nanoseconds total) {
  impl_->RecordCall(operation, code, total);
}
std::string Metrics::Text() const { return impl_->Text(); }

}  // namespace sightline

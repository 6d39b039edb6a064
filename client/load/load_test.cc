// SPDX-License-Identifier: Apache-2.0
#include "client/load/load_test.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/cli/exit_code.h"
#include "client/lib/new_id.h"
#include "client/load/knee.h"
#include "client/load/monitor.h"
#include "client/load/plain_number.h"
#include "client/load/server_answers.h"
#include "client/load/server_metrics.h"
#include "client/load/stability.h"
#include "core/base/parallel.h"
#include "core/base/status_macros.h"
#include "server/base/periodic_task.h"

namespace sightline::load {
namespace {

constexpr double kStabilityTolerance = 0.10;
// Of Check::kSample: every eighth item.
constexpr size_t kSampleStride = 8;
// From the lease's beginning to the first request: a reference may have to be made. The set goes
// with the test.
constexpr absl::Duration kLeaseMargin = absl::Minutes(30);

// How soon an interruption is heard of while a run is prepared.
constexpr absl::Duration kInterruptionLook = absl::Milliseconds(20);

absl::Duration TimeOf(const RunPlan& plan) { return plan.warm_up + plan.duration + plan.drain; }

// The calls after the preparation, for which --timeout is.
client::CallOptions LateCall() { return {.deadline = absl::Now() + absl::Seconds(10)}; }

// Answers on their way to the driver also count toward the next edit.
class CountingTarget final : public Target {
 public:
  CountingTarget(Target& inner, Reloader* reloader) : inner_(inner), reloader_(reloader) {}
  void SetOnDone(OnDone on_done) override {
    inner_.SetOnDone([reloader = reloader_, on_done = std::move(on_done)](const Outcome& outcome) {
      if (reloader != nullptr && outcome.status.ok()) reloader->CountAnswer();
      on_done(outcome);
    });
  }
  void Send(const Request& request) override { inner_.Send(request); }
  void CancelAll() override { inner_.CancelAll(); }
  absl::Status status() const override { return inner_.status(); }

 private:
  Target& inner_;
  Reloader* const reloader_;
};

}  // namespace

LoadTest::LoadTest(const LoadOptions& options, std::ostream& err, bool is_terminal,
                   const std::atomic<bool>* interrupted)
    : options_(options), err_(err), is_terminal_(is_terminal), interrupted_(interrupted) {}

LoadTest::~LoadTest() {
  target_.reset();
  reloader_.reset();
  if (!point_set_.empty()) {
    // Its lease ends it where this fails.
    session_->client().DeletePointSet(point_set_, LateCall()).IgnoreError();
  }
}

absl::Status LoadTest::Prepare() {
  absl::Status status;
  {
    // What a signal's handler may do is set a flag.
    const PeriodicTask watch(kInterruptionLook, [this] { HearOfInterruption(); });
    status = PrepareAll();
  }
  if (!Interrupted()) return status;
  if (!status.ok() && !cli::MayComeOfInterruption(status)) return status;
  // Whichever step it was that could not go on.
  return absl::CancelledError("interrupted before the first request: there is nothing to report");
}

void LoadTest::Begin(const std::string& step) {
  if (is_terminal_) err_ << step << '\n' << std::flush;
  HearOfInterruption();
}

void LoadTest::HearOfInterruption() {
  if (!Interrupted()) return;
  cancelled_work_.Cancel();
  cancelled_calls_.Cancel();
}

absl::Status LoadTest::PrepareAll() {
  SL_ASSIGN_OR_RETURN(metrics_token_,
                      MetricsToken(options_.metrics_token_file, options_.server_metrics));
  if (!options_.server_metrics.empty()) {
    const absl::Status readable = ReadMetrics(options_.server_metrics, metrics_token_).status();
    if (!readable.ok()) err_ << "warning: " << readable.message() << "; the run goes on without\n";
  }
  const std::string& server = options_.session.server;
  Begin(server.empty() ? "starting a server in this process"
                       : absl::StrCat("connecting to ", server));
  SL_ASSIGN_OR_RETURN(session_, cli::Session::Open(options_.session, &cancelled_calls_));
  SL_ASSIGN_OR_RETURN(capabilities_, session_->client().GetCapabilities(session_->call()));
  SL_RETURN_IF_ERROR(CheckMessages(options_, capabilities_.limits));
  Begin(absl::StrCat("opening ", options_.scene));
  SL_ASSIGN_OR_RETURN(scene_, OpenTestScene(*session_, options_, err_));
  const client::Scene& scene = scene_.opened->scene();
  const WorkloadSpec spec{.scene = scene.name,
                          .cameras = scene_.cameras,
                          .lights = scene_.lights,
                          .mix = options_.mix,
                          .tile_size = options_.tile,
                          .points_per_item = static_cast<uint32_t>(options_.points),
                          .segments_per_item = static_cast<uint32_t>(options_.segments),
                          .distinct_items = static_cast<uint32_t>(options_.distinct),
                          .seed = options_.plan.seed};
  SL_ASSIGN_OR_RETURN(Workload workload, Workload::Make(spec, std::move(scene_.surface)));
  workload_ = std::move(workload);
  // Before the set of points: who asks the server twice asks for the points themselves.
  SL_RETURN_IF_ERROR(FindReference());
  SL_RETURN_IF_ERROR(OpenPointSet());
  if (options_.reload_every > 0) {
    reloader_ = std::make_unique<Reloader>(
        session_->client(), scene, scene_.extra,
        Reloader::Options{.every = options_.reload_every, .by = options_.reload_by},
        reference_.get());
  }
  client::RetryOptions retry;
  retry.give_up_after = absl::Seconds(options_.session.retry_seconds);
  Begin("opening streams");
  SL_ASSIGN_OR_RETURN(
      target_,
      ServerTarget::Open(
          *session_->connection(), *workload_, reference_.get(),
          {.item_timeout = options_.item_timeout, .retry = retry, .limits = capabilities_.limits},
          clock_, &cancelled_calls_));
  return absl::OkStatus();
}

// The points go to the server once, as a set; a scene that is edited has sets of old revisions
// only, and is sent the points with every request.
absl::Status LoadTest::OpenPointSet() {
  if (workload_->StreamCount(Kind::kPoints) == 0 || options_.reload_every > 0) {
    return absl::OkStatus();
  }
  Begin("keeping points on the server");
  const std::string id = client::NewId("load");
  const std::string& scene = scene_.opened->scene().name;
  // Before the answer: a set that was given up may be there all the same, and goes with the test.
  point_set_ = absl::StrCat(scene, "/pointSets/", id);
  const absl::StatusOr<client::PointSet> set =
      session_->client().CreatePointSet({.scene = scene,
                                         .point_set_id = id,
                                         .lease = LeaseFor(options_.plan),
                                         .points = workload_->shadow_query().points},
                                        session_->call());
  if (!set.ok()) {
    if (!absl::IsCancelled(set.status()) && !absl::IsDeadlineExceeded(set.status())) {
      point_set_.clear();
    }
    return set.status();
  }
  if (TimeOf(options_.plan) > capabilities_.limits.max_lease) {
    err_ << "warning: a run may take " << absl::FormatDuration(TimeOf(options_.plan))
         << ", but the server keeps points for max_lease = "
         << absl::FormatDuration(capabilities_.limits.max_lease)
         << " at most: shorten --duration, or have the server's --max-lease-seconds raised\n";
  }
  workload_->UsePointSet(point_set_);
  return absl::OkStatus();
}

absl::Duration LoadTest::LeaseFor(const RunPlan& plan) const {
  return std::min(TimeOf(plan) + kLeaseMargin, capabilities_.limits.max_lease);
}

absl::Status LoadTest::FindReference() {
  const client::Scene& scene = scene_.opened->scene();
  const size_t stride = options_.check == Check::kAll ? 1 : kSampleStride;
  SL_ASSIGN_OR_RETURN(check_, ChooseCheck(options_, scene));
  switch (check_.by) {
    case CheckSource::By::kNothing:
      return absl::OkStatus();
    case CheckSource::By::kEngine: {
      Begin(absl::StrCat("finding what is due, on ", check_.what));
      ThreadPool pool(0);
      SL_ASSIGN_OR_RETURN(const std::shared_ptr<const sightline::Scene> here,
                          OpenCheckScene(check_.what, scene, pool, &cancelled_work_));
      std::optional<ObjectInput> extra;
      if (options_.reload_every > 0) extra = scene_.extra;
      SL_ASSIGN_OR_RETURN(reference_,
                          Reference::Make(here, extra, *workload_, stride, pool, &cancelled_work_));
      break;
    }
    case CheckSource::By::kServer: {
      const client::Strategy strategy = StrategyFor(*workload_, scene.triangles);
      check_.what = NameOf(strategy);
      err_ << "warning: '" << options_.scene << "' is checked against the server's own answers by "
           << check_.what << ", since it does not say what the scene is made of: --check-scene "
           << "checks them against the engine in this process\n";
      Begin("asking the server what is due");
      SL_ASSIGN_OR_RETURN(Answers due, ServerAnswers(session_->client(), *workload_, scene.revision,
                                                     strategy, stride, session_->stream()));
      reference_ = Reference::Of(std::move(due), stride);
      break;
    }
  }
  reference_->ExpectRevision(scene.revision, 0);
  return absl::OkStatus();
}

absl::Status LoadTest::Measure(const RunPlan& plan, bool until_stable, const std::string& title,
                               Measurement* measured) {
  // The search for the knee is many runs.
  if (!point_set_.empty()) {
    SL_RETURN_IF_ERROR(
        session_->client().RenewLease(point_set_, LeaseFor(plan), LateCall()).status());
  }
  CountingTarget target(*target_, reloader_.get());
  Recorder recorder(options_.window);
  Driver driver(plan, clock_, target, recorder,
                [this](uint64_t number) { return workload_->Pick(number); });
  absl::Status status;
  {
    const MonitorOptions watch{.is_terminal = is_terminal_,
                               .until_stable = until_stable,
                               .tolerance = kStabilityTolerance,
                               .title = title,
                               .duration = plan.duration,
                               .interrupted = interrupted_};
    Monitor monitor(watch, recorder, driver, clock_, err_);
    status = driver.Run();
  }
  *measured = recorder.Result(driver.end());
  if (reloader_ != nullptr) {
    reloader_->WaitUntilIdle();
    status.Update(reloader_->report().status);
  }
  return status;
}

absl::Status LoadTest::MeasureReported(LoadReport* report) {
  RunPlan plan = options_.plan;
  plan.rate = report->rate;
  // Around this run: a search for the knee is many before it.
  absl::StatusOr<Metrics> before = Metrics();
  if (!options_.server_metrics.empty()) {
    before = ReadMetrics(options_.server_metrics, metrics_token_);
  }
  absl::Status status =
      Measure(plan, options_.until_stable,
              plan.mode == Mode::kOpen ? absl::StrCat(PlainNumber(plan.rate, 4), "/s")
                                       : absl::StrCat(plan.concurrency, " at once"),
              &report->measured);
  if (options_.server_metrics.empty()) return status;
  const absl::StatusOr<Metrics> after = ReadMetrics(options_.server_metrics, metrics_token_);
  report->server_metrics.clear();
  report->server_metrics_error.clear();
  if (before.ok() && after.ok()) {
    report->server_metrics = ChangedMetrics(*before, *after);
  } else {
    const absl::Status& failed = before.ok() ? after.status() : before.status();
    report->server_metrics_error = std::string(failed.message());
  }
  return status;
}

absl::StatusOr<KneeTrial> LoadTest::Try(double rate, LoadReport* report) {
  const auto interrupted = [] {
    return absl::CancelledError(
        "interrupted while the knee was searched: the report has the trials made by then");
  };
  if (Interrupted()) return interrupted();
  RunPlan plan = options_.plan;
  plan.rate = rate;
  plan.duration = options_.trial;
  Measurement measured;
  const absl::Status status = Measure(
      plan, /*until_stable=*/false, absl::StrCat("trying ", PlainNumber(rate, 4), "/s"), &measured);
  absl::StatusOr<KneeTrial> judged = JudgeTrial(rate, measured, options_.slo);
  // Wrong answers are what the report is about then.
  if (measured.wrong > 0) {
    report->rate = rate;
    report->measured = std::move(measured);
    return judged;
  }
  SL_RETURN_IF_ERROR(status);
  // One that was cut short says nothing of its rate.
  if (Interrupted()) return interrupted();
  return judged;
}

absl::Status LoadTest::RunAtKnee(LoadReport* report) {
  Knee& knee = report->knee.emplace();
  SL_RETURN_IF_ERROR(FindKnee(
      options_.plan.rate, [&](double rate) { return Try(rate, report); }, &knee));
  // Without a knee, what the first rate does is of interest still.
  if (knee.rate == 0) return MeasureReported(report);
  return HoldKnee(&knee, [&](double rate) -> absl::StatusOr<KneeTrial> {
    report->rate = rate;
    SL_RETURN_IF_ERROR(MeasureReported(report));
    if (Interrupted()) return absl::CancelledError("interrupted while the knee was measured");
    return JudgeTrial(rate, report->measured, options_.slo);
  });
}

absl::Status LoadTest::Run(LoadReport* report) {
  report->options = &options_;
  report->scene_name = scene_.opened->scene().name;
  report->triangles = scene_.opened->scene().triangles;
  report->server = capabilities_;
  report->check = check_;
  report->streams = target_->stream_count();
  report->rate = options_.plan.rate;
  absl::Status status = options_.find_knee ? RunAtKnee(report) : MeasureReported(report);
  report->interrupted = Interrupted();
  report->stability = JudgeStability(report->measured.windows, kStabilityTolerance);
  report->slo = options_.slo.Judge(report->measured);
  if (reloader_ != nullptr) report->reloads = reloader_->report();
  return status;
}

}  // namespace sightline::load

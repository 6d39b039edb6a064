// SPDX-License-Identifier: Apache-2.0
//
// sightline-bench service: what the way through gRPC costs. Servers of this process, one behind a
// loopback port and one behind a Unix socket, against the engine on the same scene; client, server
// and engine are all charged by the process's CPU clock, so that a busy machine changes no ratio.
//
// Two ratios, since two things are asked of the service; which one must reach kBar is said below.
//
//   CPU ratio    what the work takes without the service, over what it takes through it, in CPU
//                seconds. Without it: the engine's work in process, where bits and sums come back;
//                that and the moving of as many bytes by plain gRPC, where depth and ids do. Beside
//                it gRPC's bound: the ratio of a service that took no more than engine and gRPC.
//   byte ratio   bytes of results that the service delivers a second, over those that plain gRPC
//                moves in messages of the same sizes and with nothing to compute, by the clock.
//                Beside it the engine's bound: the same for the engine in process, since nothing is
//                delivered faster than it is traced.
//
// Bits and sums are small, and judged by the CPU ratio; depth and ids are large, and judged by the
// byte ratio, also where the engine's bound is below the bar. Latency: one 16 x 16 tile at a time,
// beside the engine's.
#include <grpcpp/create_channel.h>
#include <grpcpp/security/credentials.h>
#include <time.h>  // NOLINT(modernize-deprecated-headers): clock_gettime is POSIX.
#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <iterator>
#include <memory>
#include <numeric>
#include <optional>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "client/cli/exit_code.h"
#include "core/base/status_macros.h"
#include "server/base/log.h"
#include "server/server.h"
#include "sightline/v1/visibility_service.grpc.pb.h"
#include "tests/bench/bench_scene.h"
#include "tests/bench/command.h"
#include "tests/bench/measure.h"
#include "tests/bench/report.h"
#include "tests/bench/service_exchange.h"
#include "tests/bench/service_workload.h"

namespace sightline::bench {
namespace {

constexpr char kSceneId[] = "bench";
constexpr char kLatency[] = "latency";  // The workload that is not one of kServiceWorkloads.
constexpr uint32_t kLatencyTile = 16;
// What the ratio that a workload is judged by is to reach.
constexpr double kBar = 0.85;

constexpr char kLegend[] =
    "CPU ratio: CPU seconds without the service (in process; with plain gRPC's for depth and ids) "
    "over those\n"
    "through it. gRPC's bound: that ratio if there were nothing but engine and plain gRPC.\n"
    "Byte ratio: MB/s of results over what plain gRPC moves alone. Engine's bound: the same of the "
    "engine in\n"
    "process; where it is below the bar, tracing sets the pace, and not moving.\n"
    "The bar is 0.85, on the median of the repetitions: of the CPU ratio where bits or sums come "
    "back, of the\n"
    "byte ratio where depth and ids do.\n";

struct ServiceFlags {
  std::vector<std::string> scenes;
  std::vector<std::string> workloads;
  std::string views;
  uint64_t width = 1024, height = 1024, segments = 1 << 20;
  uint64_t threads = 0, repeats = 5, calls = 2000;
  bool quick = false, json = false;
};

cli::FlagSet Flags(ServiceFlags* o) {
  cli::FlagSet flags(
      "sightline-bench service --scene SCENE [flags]",
      "Sends bulk queries and single tiles through a server of this process, over loopback and a "
      "Unix socket, and times them against the engine and against plain gRPC.");
  flags.Texts("scene", "SCENE", "a mesh file or a built-in scene", &o->scenes);
  flags.Texts(
      "workload", "NAME",
      absl::StrCat(absl::StrJoin(kServiceWorkloads, ", "), " or ", kLatency, "; all unless named"),
      &o->workloads);
  flags.Text("views", "FILE", "views by scene, instead of views.json beside the scene file",
             &o->views);
  flags.Count("width", "PIXELS", "of the view", &o->width, 64, 16384);
  flags.Count("height", "PIXELS", "of the view", &o->height, 64, 16384);
  flags.Count("segments", "N", "of segments-bits", &o->segments, 1, 1 << 28);
  flags.Count("calls", "N", "of latency, per repetition", &o->calls, 10, 1 << 24);
  RegisterThreads(&flags, &o->threads);
  flags.Count("repeats", "N", "repetitions, of whose ratios the median is given", &o->repeats, 1,
              1000);
  RegisterQuick(&flags, &o->quick);
  flags.Switch("json", "one JSON object per line, instead of a table", &o->json);
  return flags;
}

// Usage errors: a name that is none.
absl::Status CheckWorkloads(const std::vector<std::string>& asked) {
  std::vector<std::string> names(std::begin(kServiceWorkloads), std::end(kServiceWorkloads));
  names.push_back(kLatency);
  for (const std::string& name : asked) {
    if (std::find(names.begin(), names.end(), name) != names.end()) continue;
    return cli::UsageError(
        absl::StrCat("--workload wants one of ", absl::StrJoin(names, ", "), "; got '", name, "'"));
  }
  return absl::OkStatus();
}

// Of the whole process: client, server and engine.
double CpuSeconds() {
  timespec time{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

// What a run took.
struct Cost {
  double cpu = 0, wall = 0;
};

template <typename Run>
absl::Status Measure(const Run& run, Cost* cost) {
  const double cpu = CpuSeconds(), wall = Now();
  SL_RETURN_IF_ERROR(run());
  cost->cpu += CpuSeconds() - cpu;
  cost->wall += Now() - wall;
  return absl::OkStatus();
}

// A server with the scene, and a plain one, at the same kind of address.
struct Endpoint {
  std::string name;  // "tcp" or "unix".
  std::unique_ptr<Server> server;
  std::unique_ptr<RawServer> raw;
  std::shared_ptr<grpc::Channel> channel, raw_channel;
};

std::shared_ptr<grpc::Channel> ChannelTo(const std::string& target) {
  grpc::ChannelArguments arguments;
  arguments.SetMaxReceiveMessageSize(-1);
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  return grpc::CreateCustomChannel(target, grpc::InsecureChannelCredentials(), arguments);
}

class Sockets {
 public:
  Sockets()
      : folder_(std::filesystem::temp_directory_path() /
                absl::StrCat("sightline-bench-", getpid())) {
    std::filesystem::create_directories(folder_);
  }
  ~Sockets() {
    std::error_code ignored;
    std::filesystem::remove_all(folder_, ignored);
  }
  std::string Address(const std::string& name) const {
    return absl::StrCat("unix:", (folder_ / name).string());
  }

 private:
  const std::filesystem::path folder_;
};

absl::StatusOr<Endpoint> MakeEndpoint(const std::string& name, const Sockets& sockets,
                                      const SceneSource& source, int threads) {
  const bool tcp = name == "tcp";
  Endpoint endpoint{.name = name};
  ServerOptions options;
  const std::string address = tcp ? "127.0.0.1:0" : sockets.Address("service");
  options.listen = {address};
  options.threads = threads;
  options.log_level = LogLevel::kWarning;
  SL_ASSIGN_OR_RETURN(endpoint.server, Server::Start(options));
  SL_RETURN_IF_ERROR(
      endpoint.server->scenes().Create({.scene_id = kSceneId}, source.objects, nullptr).status());
  const std::string raw = tcp ? "127.0.0.1:0" : sockets.Address("raw");
  SL_ASSIGN_OR_RETURN(endpoint.raw, RawServer::Start(raw));
  endpoint.channel = ChannelTo(tcp ? absl::StrCat("127.0.0.1:", endpoint.server->port()) : address);
  endpoint.raw_channel = ChannelTo(tcp ? absl::StrCat("127.0.0.1:", endpoint.raw->port()) : raw);
  return endpoint;
}

std::vector<Column> Columns() {
  return {TextColumn("workload", "workload"),
          SceneColumn("scene"),
          TextColumn("through", "through"),
          CountColumn("threads", "threads"),
          MegaColumn("in process M/cpu s", "peer_rate_per_s"),
          MegaColumn("service M/cpu s", "rate_per_s"),
          SpreadColumn("CPU ratio", "ratio"),
          NumberColumn("gRPC's bound", "bound", 2),
          MegaColumn("MB/s", "bytes_per_s"),
          MegaColumn("plain gRPC MB/s", "raw_bytes_per_s"),
          SpreadColumn("byte ratio", "bytes_ratio"),
          NumberColumn("engine's bound", "bytes_bound", 2),
          TextColumn("judged by", "judged_by"),
          TextColumn("bar", "bar_verdict")};
}

class ServiceRun {
 public:
  ServiceRun(const ServiceFlags& flags, Context& context, Report* report, Report* latencies)
      : flags_(flags), context_(context), report_(report), latencies_(latencies) {}

  absl::Status RunScene(const std::string& name);
  uint64_t disagreements() const { return disagreements_; }

 private:
  bool Wanted(const std::string& workload) const {
    return flags_.workloads.empty() || std::find(flags_.workloads.begin(), flags_.workloads.end(),
                                                 workload) != flags_.workloads.end();
  }
  absl::Status RunBulk(const SceneSource& source, const ServiceWorkload& workload,
                       const std::vector<Endpoint>& endpoints, ThreadPool& pool);
  absl::Status RunLatency(const SceneSource& source, const Endpoint& endpoint);

  const ServiceFlags& flags_;
  Context& context_;
  Report* const report_;
  Report* const latencies_;
  std::shared_ptr<const Scene> scene_;
  uint64_t disagreements_ = 0;
};

// Messages of the sizes that the workload's have, through plain gRPC.
absl::Status RunRaw(const Endpoint& endpoint, const ServiceWorkload& workload,
                    const Answer& answer) {
  const uint64_t replies = std::max<uint64_t>(1, answer.replies);
  endpoint.raw->SetReplyBytes(answer.bytes / replies);
  const grpc::ByteBuffer request = RawMessage(workload.request_bytes * workload.items / replies);
  Exchange<grpc::ByteBuffer, grpc::ByteBuffer> exchange(
      {.method = "/raw/Move",
       .items = replies,
       .window = 8,
       .make = [&](size_t) { return request; },
       .take = [](grpc::ByteBuffer*) { return true; }});
  return exchange.Run(endpoint.raw_channel);
}

absl::Status ServiceRun::RunBulk(const SceneSource& source, const ServiceWorkload& workload,
                                 const std::vector<Endpoint>& endpoints, ThreadPool& pool) {
  // Warms up, and compares.
  SL_ASSIGN_OR_RETURN(const Answer ours, workload.run_engine(pool));
  std::vector<Answer> theirs;
  std::vector<uint64_t> differing;  // By side: runs that answered otherwise.
  for (const Endpoint& endpoint : endpoints) {
    SL_ASSIGN_OR_RETURN(const Answer answer, workload.run_service(endpoint.channel));
    theirs.push_back(answer);
    differing.push_back(answer.Agrees(ours) ? 0 : 1);
    SL_RETURN_IF_ERROR(RunRaw(endpoint, workload, answer));
  }
  const size_t sides = endpoints.size();
  std::vector<std::vector<double>> ratios(sides), bounds(sides), bytes_ratios(sides),
      bytes_bounds(sides);
  Cost engine_all;
  std::vector<Cost> service_all(sides), raw_all(sides);
  double passes_all = 0;
  for (uint64_t repeat = 0; repeat < flags_.repeats; ++repeat) {
    context_.err << source.name << ", " << workload.name << ": repetition " << repeat + 1 << " of "
                 << flags_.repeats << std::endl;
    Cost engine;
    std::vector<Cost> service(sides), raw(sides);
    do {
      SL_RETURN_IF_ERROR(Measure([&] { return workload.run_engine(pool).status(); }, &engine));
      for (size_t side = 0; side < sides; ++side) {
        const Endpoint& endpoint = endpoints[side];
        absl::StatusOr<Answer> answer = Answer();
        SL_RETURN_IF_ERROR(Measure(
            [&] {
              answer = workload.run_service(endpoint.channel);
              return answer.status();
            },
            &service[side]));
        differing[side] += answer->Agrees(ours) ? 0 : 1;
        SL_RETURN_IF_ERROR(
            Measure([&] { return RunRaw(endpoint, workload, theirs[side]); }, &raw[side]));
      }
      ++passes_all;
    } while (engine.wall < MinSeconds(flags_.quick));
    engine_all.cpu += engine.cpu;
    for (size_t side = 0; side < sides; ++side) {
      const double ideal = engine.cpu + (workload.moves_arrays ? raw[side].cpu : 0);
      ratios[side].push_back(ideal / service[side].cpu);
      bounds[side].push_back(ideal / (engine.cpu + raw[side].cpu));
      // The bytes are the same.
      bytes_ratios[side].push_back(raw[side].wall / service[side].wall);
      bytes_bounds[side].push_back(raw[side].wall / engine.wall);
      service_all[side].cpu += service[side].cpu;
      service_all[side].wall += service[side].wall;
      raw_all[side].cpu += raw[side].cpu;
      raw_all[side].wall += raw[side].wall;
    }
  }
  const double rays = passes_all * static_cast<double>(workload.rays);
  const double bytes = passes_all * static_cast<double>(ours.bytes);
  for (size_t side = 0; side < sides; ++side) {
    const Spread ratio = SpreadOf(ratios[side]), bytes_ratio = SpreadOf(bytes_ratios[side]);
    disagreements_ += differing[side];
    const bool met = (workload.moves_arrays ? bytes_ratio : ratio).median >= kBar;
    report_->Add(
        WithCommonKeys({{"workload", absl::StrCat("service-", workload.name)},
                        {"scene", source.name},
                        {"triangles", scene_->geometry.triangles.size()},
                        {"views", 1},
                        {"queries", workload.rays},
                        {"threads", pool.threads()},
                        {"isa", std::string(SimdTargetName(BestSimdTarget()))},
                        {"strategy", std::string(StrategyName(Strategy::kAuto))},
                        {"through", endpoints[side].name},
                        {"rate_per_s", rays / service_all[side].cpu},
                        {"peer", workload.moves_arrays ? "in process and raw gRPC" : "in process"},
                        {"peer_mode", "per CPU second"},
                        {"peer_rate_per_s", rays / engine_all.cpu},
                        {"bytes_per_s", bytes / service_all[side].wall},
                        {"raw_bytes_per_s", bytes / raw_all[side].wall},
                        {"service_cpu_s", service_all[side].cpu / passes_all},
                        {"engine_cpu_s", engine_all.cpu / passes_all},
                        {"raw_cpu_s", raw_all[side].cpu / passes_all},
                        {"replies", theirs[side].replies},
                        {"ratio", ratio.median},
                        {"ratio_min", ratio.min},
                        {"ratio_max", ratio.max},
                        {"bound", SpreadOf(bounds[side]).median},
                        {"bytes_ratio", bytes_ratio.median},
                        {"bytes_ratio_min", bytes_ratio.min},
                        {"bytes_ratio_max", bytes_ratio.max},
                        {"bytes_bound", SpreadOf(bytes_bounds[side]).median},
                        {"judged_by", workload.moves_arrays ? "byte ratio" : "CPU ratio"},
                        {"bar", kBar},
                        {"bar_verdict", met ? "met" : "missed"},
                        {"disagreements", differing[side]},
                        {"disagreements_beyond_rounding", differing[side]},
                        {"repeats", flags_.repeats}}));
  }
  return absl::OkStatus();
}

double Percentile(std::vector<double> values, double share) {
  std::sort(values.begin(), values.end());
  return values[static_cast<size_t>(share * static_cast<double>(values.size() - 1))];
}

// One at a time by the blocking interface, from the write to the last reply, in microseconds.
absl::Status ServiceRun::RunLatency(const SceneSource& source, const Endpoint& endpoint) {
  SL_ASSIGN_OR_RETURN(const Camera camera,
                      LookAt(source.views[0].eye, source.views[0].at, source.views[0].up,
                             source.views[0].fov_y_degrees, static_cast<uint32_t>(flags_.width),
                             static_cast<uint32_t>(flags_.height)));
  const auto stub = v1::VisibilityService::NewStub(endpoint.channel);
  grpc::ClientContext context;
  const auto stream = stub->TraceTiles(&context);
  v1::TraceTilesRequest request;
  request.mutable_header()->mutable_stream()->set_scene(absl::StrCat("scenes/", kSceneId));
  EncodeBenchCamera(camera, request.mutable_header()->mutable_camera());
  request.mutable_header()->mutable_outputs()->set_depths(true);
  v1::TraceTilesResponse response;
  if (!stream->Write(request) || !stream->Read(&response)) {
    return absl::InternalError(stream->Finish().error_message());
  }
  std::vector<double> took, engine;
  uint64_t differing = 0;
  const uint32_t across = camera.width / kLatencyTile, down = camera.height / kLatencyTile;
  for (uint64_t call = 0; call < flags_.calls * flags_.repeats; ++call) {
    const auto tile = static_cast<uint32_t>(call * 7919 % (uint64_t{across} * down));
    const TileRect rect{tile % across * kLatencyTile, tile / across * kLatencyTile, kLatencyTile,
                        kLatencyTile};
    request.mutable_item()->mutable_item()->set_item_id(call);
    request.mutable_item()->set_x(rect.x);
    request.mutable_item()->set_y(rect.y);
    request.mutable_item()->set_width(rect.width);
    request.mutable_item()->set_height(rect.height);
    const double begin = Now();
    if (!stream->Write(request) || !stream->Read(&response)) {
      return absl::InternalError(stream->Finish().error_message());
    }
    took.push_back(1e6 * (Now() - begin));
    const double traced = Now();
    TileResult result;
    SL_RETURN_IF_ERROR(TraceTile(*scene_, camera, rect, {}, {.depth = true}, {}, &result));
    engine.push_back(1e6 * (Now() - traced));
    const std::string& depths = response.reply().tile().depths();
    if (depths.size() != 4 * result.depth.size() ||
        std::memcmp(depths.data(), result.depth.data(), depths.size()) != 0) {
      ++differing;
    }
  }
  disagreements_ += differing;
  stream->WritesDone();
  while (stream->Read(&response)) {
  }
  SL_RETURN_IF_ERROR(absl::Status(static_cast<absl::StatusCode>(stream->Finish().error_code()),
                                  "the stream of latency"));
  const auto sum_of = [](const std::vector<double>& all) {
    return std::accumulate(all.begin(), all.end(), 0.0);
  };
  const auto calls = static_cast<double>(took.size());
  std::vector<double> ratios;
  for (size_t i = 0; i < took.size(); ++i) ratios.push_back(engine[i] / took[i]);
  const Spread ratio = SpreadOf(std::move(ratios));
  latencies_->Add(WithCommonKeys({{"workload", "service-latency"},
                                  {"views", 1},
                                  {"isa", std::string(SimdTargetName(BestSimdTarget()))},
                                  {"strategy", std::string(StrategyName(Strategy::kAuto))},
                                  {"rate_per_s", 1e6 * calls / sum_of(took)},
                                  {"peer", "in process"},
                                  {"peer_mode", "one tile at a time"},
                                  {"peer_rate_per_s", 1e6 * calls / sum_of(engine)},
                                  {"ratio", ratio.median},
                                  {"ratio_min", ratio.min},
                                  {"ratio_max", ratio.max},
                                  {"disagreements", differing},
                                  {"disagreements_beyond_rounding", differing},
                                  {"scene", source.name},
                                  {"triangles", scene_->geometry.triangles.size()},
                                  {"queries", took.size()},
                                  {"threads", ResolveThreads(flags_.threads)},
                                  {"through", endpoint.name},
                                  {"median_us", Percentile(took, 0.5)},
                                  {"p90_us", Percentile(took, 0.9)},
                                  {"p99_us", Percentile(took, 0.99)},
                                  {"engine_median_us", Percentile(engine, 0.5)}}));
  return absl::OkStatus();
}

absl::Status ServiceRun::RunScene(const std::string& name) {
  context_.err << name << ": reading and building" << std::endl;
  SL_ASSIGN_OR_RETURN(const SceneSource source, ReadScene(name, flags_.views));
  if (source.views.empty()) {
    return absl::InvalidArgumentError(absl::StrCat(name, " has no views; give --views"));
  }
  const int threads = ResolveThreads(flags_.threads);
  const Sockets sockets;
  std::vector<Endpoint> endpoints;
  for (const char* kind : {"tcp", "unix"}) {
    SL_ASSIGN_OR_RETURN(Endpoint endpoint, MakeEndpoint(kind, sockets, source, threads));
    endpoints.push_back(std::move(endpoint));
  }
  const ServiceSpec spec{.scene_id = kSceneId,
                         .width = static_cast<uint32_t>(flags_.width),
                         .height = static_cast<uint32_t>(flags_.height),
                         .segments = flags_.segments};
  SL_ASSIGN_OR_RETURN(scene_, endpoints[0].server->scenes().Pin(kSceneId, 0));
  if (Wanted(kLatency)) {
    for (const Endpoint& endpoint : endpoints) SL_RETURN_IF_ERROR(RunLatency(source, endpoint));
  }
  for (const Endpoint& endpoint : endpoints) {
    SL_RETURN_IF_ERROR(MakePointSet(endpoint.channel, source.views[0], spec));
  }
  ThreadPool pool(threads);
  SL_ASSIGN_OR_RETURN(const std::vector<ServiceWorkload> workloads,
                      MakeServiceWorkloads(scene_, source.views[0], spec, pool));
  for (const ServiceWorkload& workload : workloads) {
    if (Wanted(workload.name)) SL_RETURN_IF_ERROR(RunBulk(source, workload, endpoints, pool));
  }
  scene_ = nullptr;
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<bool> ServiceCommand(std::span<const std::string> args, Context& context) {
  ServiceFlags options;
  cli::FlagSet flags = Flags(&options);
  SL_ASSIGN_OR_RETURN(const bool go_on, ParseOrHelp(&flags, args, context));
  if (!go_on) return true;
  if (options.scenes.empty()) return cli::UsageError("wants --scene");
  SL_RETURN_IF_ERROR(CheckWorkloads(options.workloads));
  SetLogLevel(LogLevel::kWarning);
  Report report(Columns(), options.json, context.out);
  Report latencies(
      {TextColumn("workload", "workload"), SceneColumn("scene"), TextColumn("through", "through"),
       NumberColumn("median us", "median_us", 0), NumberColumn("p90 us", "p90_us", 0),
       NumberColumn("p99 us", "p99_us", 0), NumberColumn("engine us", "engine_median_us", 0)},
      options.json, context.out);
  ServiceRun run(options, context, &report, &latencies);
  const absl::Status status =
      RunScenes(options.scenes, &report, context.err,
                [&](const std::string& scene) { return run.RunScene(scene); });
  if (!options.json && !report.rows().empty()) context.out << kLegend;
  latencies.Finish();
  SL_RETURN_IF_ERROR(status);
  return run.disagreements() == 0;
}

}  // namespace sightline::bench

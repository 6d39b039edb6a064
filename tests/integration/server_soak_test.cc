// SPDX-License-Identifier: Apache-2.0
//
// The real server under everything at once, for a minute or for as long as deploy/soak.sh says:
// what comes and goes leaves no memory behind, and every answer is the one that brute force gives.
#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "tests/integration/raw_connection.h"
#include "tests/integration/tile_load.h"
#include "tests/support/http_get.h"
#include "tests/support/random.h"
#include "tests/support/temp_dir.h"
#include "tests/support/test_scale.h"
#include "tests/support/until.h"

namespace sightline {
namespace {

constexpr char kKnown[] = "room:15000";
// glibc's heaps, one for every few threads, take hours to fill up: what is freed in one is of no
// use in another. With one for all, what is lost stands out after minutes.
constexpr std::pair<const char*, const char*> kOneArena = {"MALLOC_ARENA_MAX", "1"};
// By what share of resident memory it may grow in all, and in a thousand rounds, in each of which
// scenes are loaded and unloaded, at the pace of a short run.
constexpr double kMostGrowth = 0.05, kPaceRounds = 1000;

// What one client does in a round: scenes come, are stored, unloaded, loaded again, reloaded,
// edited and go, points are kept, and all of them are asked about.
class Visit {
 public:
  Visit(const std::shared_ptr<grpc::Channel>& channel, v1::Strategy strategy)
      : strategy_(strategy),
        scenes_(v1::SceneService::NewStub(channel)),
        point_sets_(v1::PointSetService::NewStub(channel)),
        visibility_(v1::VisibilityService::NewStub(channel)) {
    for (double& x : segments_) x = rng_.Uniform(-2, 2);
    for (double& x : points_) x = rng_.Uniform(-2, 2);
  }

  // The bits of all answers, the same each time; failures are the test's.
  std::string Run() {
    bits_.clear();
    Ask("scenes/known");
    v1::CreateSceneRequest builtin;
    builtin.mutable_header()->set_scene_id("coming");
    builtin.mutable_header()->mutable_builtin()->set_spec("builtin:box:5000");
    Create({builtin});
    Ask("scenes/coming");
    Unload("scenes/coming");
    Load("scenes/coming");
    Ask("scenes/coming");
    Reload("scenes/coming");
    Ask("scenes/coming");
    KeepPoints("scenes/coming");
    Create(WallUpload("wall"));
    Ask("scenes/wall");
    MoveWall();
    Ask("scenes/wall");
    Delete("scenes/wall");
    Delete("scenes/coming");
    return bits_;
  }

 private:
  static constexpr size_t kSegments = 800, kPoints = 200;

  static void Expect(const grpc::Status& status) {
    EXPECT_TRUE(status.ok()) << status.error_message();
  }

  void Create(const std::vector<v1::CreateSceneRequest>& messages) {
    grpc::ClientContext context;
    v1::Scene scene;
    const auto writer = scenes_->CreateScene(&context, &scene);
    for (const auto& message : messages) writer->Write(message);
    writer->WritesDone();
    Expect(writer->Finish());
    EXPECT_TRUE(scene.stored()) << scene.state_message();
    triangles_ = scene.triangle_count();
  }
  void MoveWall() {
    v1::UpdateSceneRequest header, edit;
    header.mutable_header()->set_name("scenes/wall");
    edit.mutable_set_transform()->set_object_name("wall");
    for (const double x : {1., 0., 0., 0.25, 0., 1., 0., 0.5, 0., 0., 1., 0.}) {
      edit.mutable_set_transform()->add_transform(x);
    }
    grpc::ClientContext context;
    v1::Scene scene;
    const auto writer = scenes_->UpdateScene(&context, &scene);
    writer->Write(header);
    writer->Write(edit);
    writer->WritesDone();
    Expect(writer->Finish());
    EXPECT_EQ(scene.revision(), 2);
    EXPECT_TRUE(scene.stored()) << scene.state_message();
  }
  void Unload(const std::string& name) {
    grpc::ClientContext context;
    v1::UnloadSceneRequest request;
    request.set_name(name);
    google::protobuf::Empty empty;
    Expect(scenes_->UnloadScene(&context, request, &empty));
  }
  void Load(const std::string& name) {
    grpc::ClientContext context;
    v1::LoadSceneRequest request;
    request.set_name(name);
    v1::Scene scene;
    Expect(scenes_->LoadScene(&context, request, &scene));
    EXPECT_EQ(scene.triangle_count(), triangles_);
  }
  void Reload(const std::string& name) {
    grpc::ClientContext context;
    v1::ReloadSceneRequest request;
    request.set_name(name);
    v1::Scene scene;
    Expect(scenes_->ReloadScene(&context, request, &scene));
    EXPECT_EQ(scene.revision(), 2);
    EXPECT_EQ(scene.triangle_count(), triangles_);
  }
  void Delete(const std::string& name) {
    grpc::ClientContext context;
    v1::DeleteSceneRequest request;
    request.set_name(name);
    google::protobuf::Empty empty;
    Expect(scenes_->DeleteScene(&context, request, &empty));
  }

  // One set that is uploaded and deleted, and one of a camera's that goes with its scene.
  void KeepPoints(const std::string& scene) {
    v1::CreatePointSetRequest header, chunk;
    header.mutable_header()->set_parent(scene);
    header.mutable_header()->set_point_set_id("uploaded");
    header.mutable_header()->mutable_upload()->set_point_count(kPoints);
    chunk.mutable_chunk()->set_points(PackArray(points_));
    Keep({header, chunk});
    AskKept(scene, "uploaded", kPoints);
    v1::DeletePointSetRequest request;
    request.set_name(absl::StrCat(scene, "/pointSets/uploaded"));
    grpc::ClientContext context;
    google::protobuf::Empty empty;
    Expect(point_sets_->DeletePointSet(&context, request, &empty));

    constexpr uint32_t kSide = 32;
    v1::CreatePointSetRequest camera;
    camera.mutable_header()->set_parent(scene);
    camera.mutable_header()->set_point_set_id("seen");
    v1::CameraSource* const source = camera.mutable_header()->mutable_camera();
    EncodeTestCamera(ViewCamera(FirstView("box:5000"), kSide, kSide), source->mutable_camera());
    source->mutable_options()->set_strategy(strategy_);
    Keep({camera});
    AskKept(scene, "seen", uint64_t{kSide} * kSide);
  }
  void Keep(const std::vector<v1::CreatePointSetRequest>& messages) {
    grpc::ClientContext context;
    v1::PointSet set;
    const auto writer = point_sets_->CreatePointSet(&context, &set);
    for (const auto& message : messages) writer->Write(message);
    writer->WritesDone();
    Expect(writer->Finish());
  }

  v1::StreamHeader StreamOf(const std::string& scene) const {
    v1::StreamHeader header;
    header.set_scene(scene);
    header.mutable_options()->set_strategy(strategy_);
    return header;
  }
  // Segments and points.
  void Ask(const std::string& scene) {
    {
      grpc::ClientContext context;
      const auto stream = visibility_->TestSegments(&context);
      v1::TestSegmentsRequest request;
      *request.mutable_header()->mutable_stream() = StreamOf(scene);
      stream->Write(request);
      request.mutable_item()->set_segments(PackArray(segments_));
      stream->Write(request);
      stream->WritesDone();
      v1::TestSegmentsResponse response;
      while (stream->Read(&response)) bits_ += response.reply().segments().blocked_bits();
      Expect(stream->Finish());
    }
    v1::ShadowItem item;
    item.mutable_points()->set_points(PackArray(points_));
    AskShadows(scene, item);
  }
  void AskKept(const std::string& scene, const std::string& id, uint64_t count) {
    v1::ShadowItem item;
    item.mutable_point_set_range()->set_point_set(absl::StrCat(scene, "/pointSets/", id));
    item.mutable_point_set_range()->set_count(count);
    AskShadows(scene, item);
  }
  void AskShadows(const std::string& scene, const v1::ShadowItem& item) {
    grpc::ClientContext context;
    const auto stream = visibility_->ComputeShadows(&context);
    v1::ComputeShadowsRequest request;
    *request.mutable_header()->mutable_stream() = StreamOf(scene);
    EncodeTestVector({0.5, 0.25, 1.5},
                     request.mutable_header()->add_lights()->mutable_point()->mutable_position());
    stream->Write(request);
    *request.mutable_item() = item;
    stream->Write(request);
    stream->WritesDone();
    v1::ComputeShadowsResponse response;
    while (stream->Read(&response)) bits_ += response.reply().shadows().lit_bits();
    Expect(stream->Finish());
  }

  testing_support::TestRng rng_;  // As long as what it made: failures name its seed.
  const v1::Strategy strategy_;
  const std::unique_ptr<v1::SceneService::Stub> scenes_;
  const std::unique_ptr<v1::PointSetService::Stub> point_sets_;
  const std::unique_ptr<v1::VisibilityService::Stub> visibility_;
  std::vector<double> segments_ = std::vector<double>(6 * kSegments);
  std::vector<double> points_ = std::vector<double>(3 * kPoints);
  uint64_t triangles_ = 0;
  std::string bits_;
};

// What a round's answers are by brute force, from a server in this process.
std::string BitsByBruteForce() {
  const testing_support::TempDir repository;
  ServerOptions options;
  options.repository = repository.path();
  options.scenes = {absl::StrCat("known=builtin:", kKnown)};
  const ServerHarness harness(options);
  return Visit(harness.channel, v1::STRATEGY_BRUTE_FORCE).Run();
}

class SoakTest : public testing::Test {
 protected:
  SoakTest()
      : tiles_(kKnown),
        server_({tiles_.flag(), "--repository", repository_.path(), "--metrics-listen=127.0.0.1:0"},
                {.environment = {kOneArena}}),
        channel_(server_.Channel()),
        visit_(channel_, v1::STRATEGY_AUTO),
        visibility_(v1::VisibilityService::NewStub(channel_)),
        expected_(BitsByBruteForce()) {}

  void Round() {
    EXPECT_EQ(visit_.Run(), expected_);
    CancelAStream();
    OpenNoStream();
    VanishInTheMiddle();
  }

  const KnownTiles tiles_;
  const testing_support::TempDir repository_;
  ServingProcess server_;

 private:
  void CancelAStream() {
    grpc::ClientContext context;
    const auto stream = visibility_->TraceTiles(&context);
    stream->Write(tiles_.Header());
    for (uint64_t id = 0; id < 100; ++id) stream->Write(tiles_.Request(id));
    v1::TraceTilesResponse response;
    stream->Read(&response);
    context.TryCancel();
    EXPECT_FALSE(stream->Finish().ok());
  }
  void OpenNoStream() {
    grpc::ClientContext context;
    v1::TraceTilesRequest wrong = tiles_.Header();
    wrong.mutable_header()->mutable_stream()->set_scene("scenes/none");
    const auto stream = visibility_->TraceTiles(&context);
    stream->Write(wrong);
    EXPECT_EQ(ReasonIn(stream->Finish()), "SCENE_NOT_FOUND");
  }
  // Clients that leave without a word: with tiles unanswered, and half of a mesh and of a point set
  // sent.
  void VanishInTheMiddle() {
    std::vector<std::string> tiles = {tiles_.Header().SerializeAsString()};
    for (uint64_t id = 0; id < 20; ++id) tiles.push_back(tiles_.Request(id).SerializeAsString());
    Vanish(CallBytes("/sightline.v1.VisibilityService/TraceTiles", tiles));
    const auto wall = WallUpload("gone");
    Vanish(CallBytes("/sightline.v1.SceneService/CreateScene",
                     {wall[0].SerializeAsString(), wall[1].SerializeAsString()}));
    v1::CreatePointSetRequest points;
    points.mutable_header()->set_parent("scenes/known");
    points.mutable_header()->mutable_upload()->set_point_count(1000);
    Vanish(CallBytes("/sightline.v1.PointSetService/CreatePointSet", {points.SerializeAsString()}));
    // What they held of their address's uploads, another round is to have.
    EXPECT_TRUE(testing_support::Until("nobody uploads", [&] {
      return testing_support::MetricOf(server_.metrics_port(), "sightline_active_uploads") == 0;
    }));
  }
  // Once the server has read all of it: a reset takes back what was not.
  void Vanish(const std::string& bytes) const {
    constexpr char kMark[] = "read it?";
    const RawConnection client(server_.port());
    ASSERT_TRUE(client.connected());
    client.Send(absl::StrCat(bytes, PingBytes(kMark)));
    EXPECT_TRUE(absl::StrContains(client.ReadUntil(kMark), kMark));
    client.Abort();
  }

  const std::shared_ptr<grpc::Channel> channel_;
  Visit visit_;
  const std::unique_ptr<v1::VisibilityService::Stub> visibility_;
  const std::string expected_;
};

uint64_t Median(std::vector<uint64_t> values) {
  const auto middle = values.begin() + static_cast<ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// How long the soak lasts at least: SIGHTLINE_SOAK_SECONDS, no time without it.
std::chrono::duration<double> SoakTime() {
  const char* const text = std::getenv("SIGHTLINE_SOAK_SECONDS");
  double seconds = 0;
  if (text == nullptr || !absl::SimpleAtod(text, &seconds)) seconds = 0;
  return std::chrono::duration<double>(seconds);
}

TEST_F(SoakTest, MixedLoadLeavesMemoryWhereItWas) {
  using Clock = std::chrono::steady_clock;
  TileLoad load(tiles_, {.address = server_.address(), .clients = 1});
  load.WaitForAnswers(100);
  const auto least = static_cast<size_t>(std::max<int64_t>(4, testing_support::ScaledCount(800)));
  const Clock::time_point begin = Clock::now();
  const auto lasted = [&] { return std::chrono::duration<double>(Clock::now() - begin); };
  std::vector<uint64_t> resident;
  while (!HasFailure() && (resident.size() < least || lasted() < SoakTime())) {
    Round();
    resident.push_back(server_.ResidentBytes());
  }
  load.Stop();
  EXPECT_EQ(load.wrong(), 0u);
  EXPECT_EQ(load.refused(), 0u);
  EXPECT_EQ(load.broken_streams(), 0u);
  // The first quarter fills pools and caches. What the allocator holds free comes and goes by more
  // than what is looked for, but what is lost is lost in every round: the lesser of the two steps
  // between the medians of the others is the pace.
  const auto quarter = static_cast<ptrdiff_t>(resident.size() / 4);
  ASSERT_GT(quarter, 0);
  const auto median = [&](ptrdiff_t from_end) {
    return static_cast<double>(
        Median({resident.end() - from_end * quarter, resident.end() - (from_end - 1) * quarter}));
  };
  const double second = median(3), third = median(2), last = median(1);
  const double pace = std::min(third - second, last - third) / static_cast<double>(quarter);
  std::printf(
      "soak: %.0f s, %zu rounds, %llu answers, resident %.2f MiB, then %.2f, then %.2f: %+.2f %%, "
      "%+.0f bytes a round\n",
      lasted().count(), resident.size(), static_cast<unsigned long long>(load.answers()),
      second / (1 << 20), third / (1 << 20), last / (1 << 20), 100 * (last / second - 1), pace);
  RecordProperty("rounds", static_cast<int>(resident.size()));
  RecordProperty("bytes_a_round", static_cast<int>(pace));
  if (testing_support::kSanitizerBuild) return;  // Their allocators hold on to what is freed.
  EXPECT_LT(pace * kPaceRounds, kMostGrowth * second);
  EXPECT_LT(last - second, kMostGrowth * second);
}

}  // namespace
}  // namespace sightline

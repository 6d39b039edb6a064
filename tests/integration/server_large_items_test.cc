// SPDX-License-Identifier: Apache-2.0
//
// Items whose arrays are large enough to stay in gRPC's slices are answered as those are that are
// copied: the same points and segments in one item, and in many. What is no message ends the
// stream.
#include <grpcpp/generic/generic_stub.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "core/query/shadows.h"
#include "server/admission/scheduler.h"
#include "server/codec/result_codec.h"
#include "server/codec/wire_request.h"
#include "server/stream/placement_pace.h"
#include "tests/integration/server_harness.h"
#include "tests/support/random.h"

namespace sightline {
namespace {

using testing_support::TestRng;

class LargeItemsTest : public testing::Test {
 protected:
  void SetUp() override {
    v1::Scene scene;
    ASSERT_TRUE(harness_.CreateBuiltin("room", "builtin:room:15000", &scene).ok());
  }
  static std::vector<double> Coordinates(TestRng& rng, size_t count) {
    std::vector<double> numbers(count);
    for (double& x : numbers) x = rng.Uniform(-4, 4);
    return numbers;
  }
  static std::string Part(const std::string& all, size_t offset, size_t count, size_t element) {
    return all.substr(offset * element, count * element);
  }

  ServerHarness harness_;
};

// The answers of all replies to an item, in the order of the elements, which are whole bytes.
template <typename Replies, typename Take>
std::string Answers(const Replies& replies, const Take& take) {
  std::map<uint64_t, std::string> by_offset;
  for (const auto& reply : replies) {
    EXPECT_EQ(reply.reply().header().status().code(), 0)
        << reply.reply().header().status().message();
    by_offset[reply.reply().header().offset()] = take(reply.reply());
  }
  std::string all;
  for (const auto& [offset, bytes] : by_offset) all += bytes;
  return all;
}

TEST_F(LargeItemsTest, SegmentsAreAnsweredAlikeInOneItemAndInMany) {
  constexpr size_t kCount = 20'000, kSmall = 1000, kBytes = 6 * sizeof(double);
  static_assert(kCount * kBytes > kLeastLifted && kSmall * kBytes < kLeastLifted);
  TestRng rng;
  std::vector<double> numbers = Coordinates(rng, 6 * kCount);
  for (int i = 0; i < 20; ++i) numbers[rng.Below(numbers.size())] = std::nan("");
  const std::string ends = PackArray(numbers);
  v1::TestSegmentsRequest request;
  request.mutable_header()->mutable_stream()->set_scene("scenes/room");
  SegmentStream stream(harness_, request);
  request.Clear();
  request.mutable_item()->mutable_item()->set_item_id(0);
  request.mutable_item()->set_segments(ends);
  stream.Write(request);
  for (size_t at = 0; at < kCount; at += kSmall) {
    request.mutable_item()->mutable_item()->set_item_id(1 + at / kSmall);
    request.mutable_item()->set_segments(Part(ends, at, kSmall, kBytes));
    stream.Write(request);
  }
  const auto replies = stream.ReadAll();
  ASSERT_TRUE(stream.Finish().ok());
  const auto bits = [](const v1::SegmentReply& r) { return r.segments().blocked_bits(); };
  const std::string whole = Answers(replies.at(0), bits);
  std::string parts;
  for (size_t id = 1; id <= kCount / kSmall; ++id) parts += Answers(replies.at(id), bits);
  EXPECT_EQ(whole, parts);
  EXPECT_EQ(whole.size(), kCount / 8);
  EXPECT_NE(whole, std::string(kCount / 8, '\0'));

  // Half the bytes: the same segments in their stored form.
  const Vec3d origin = harness_.server->scenes().Pin("room", 0).value()->geometry.origin;
  std::vector<float> stored(numbers.size());
  for (size_t i = 0; i < numbers.size(); ++i) {
    stored[i] = static_cast<float>(numbers[i] - origin[static_cast<int>(i % 3)]);
  }
  static_assert(kCount * 6 * sizeof(float) > kLeastLifted);
  v1::TestSegmentsRequest other;
  other.mutable_header()->mutable_stream()->set_scene("scenes/room");
  EncodeTestVector(origin, other.mutable_header()->mutable_origin());
  SegmentStream stored_stream(harness_, other);
  other.Clear();
  other.mutable_item()->set_segments_f32(PackArray(stored));
  stored_stream.Write(other);
  const auto stored_replies = stored_stream.ReadAll();
  ASSERT_TRUE(stored_stream.Finish().ok());
  EXPECT_EQ(Answers(stored_replies.at(0), bits), whole);
}

TEST_F(LargeItemsTest, PointsWithSourcesAndNormalsAreAnsweredAlikeInOneItemAndInMany) {
  constexpr size_t kCount = 70'000, kSmall = 2000;
  static_assert(kCount * sizeof(uint32_t) > kLeastLifted);
  TestRng rng;
  const std::string points = PackArray(Coordinates(rng, 3 * kCount));
  const std::string normals = PackArray(Coordinates(rng, 3 * kCount));
  std::vector<uint32_t> sources(kCount);
  for (uint32_t& source : sources) source = static_cast<uint32_t>(rng.Below(10));
  const std::string triangles = PackArray(sources);
  const std::string objects(4 * kCount, '\0');
  v1::ComputeShadowsRequest request;
  request.mutable_header()->mutable_stream()->set_scene("scenes/room");
  EncodeTestVector({0.5, 0.25, 1.5},
                   request.mutable_header()->add_lights()->mutable_point()->mutable_position());
  request.mutable_header()->mutable_point_options()->set_normal_offset(1e-3);
  ShadowStream stream(harness_, request);
  const auto send = [&](uint64_t id, size_t offset, size_t count) {
    v1::ComputeShadowsRequest item;
    item.mutable_item()->mutable_item()->set_item_id(id);
    v1::PointArrays* const arrays = item.mutable_item()->mutable_points();
    arrays->set_points(Part(points, offset, count, 24));
    arrays->set_normals(Part(normals, offset, count, 24));
    arrays->set_source_objects(Part(objects, offset, count, 4));
    arrays->set_source_triangles(Part(triangles, offset, count, 4));
    stream.Write(item);
  };
  send(0, 0, kCount);
  for (size_t at = 0; at < kCount; at += kSmall) send(1 + at / kSmall, at, kSmall);
  const auto replies = stream.ReadAll();
  ASSERT_TRUE(stream.Finish().ok());
  const auto bits = [](const v1::ShadowReply& r) { return r.shadows().lit_bits(); };
  const std::string whole = Answers(replies.at(0), bits);
  std::string parts;
  for (size_t id = 1; id <= kCount / kSmall; ++id) parts += Answers(replies.at(id), bits);
  EXPECT_EQ(whole, parts);
  EXPECT_EQ(whole.size(), kCount / 8);
}

// The parts of an item find out by themselves what their points lie on, whether they come in order
// or are put into one.
TEST_F(LargeItemsTest, PointsAreAttachedAsTheEngineDoes) {
  const std::shared_ptr<const Scene> scene = *harness_.server->scenes().Pin("room", 0);
  TestRng rng;
  std::vector<Vec3d> points, normals;
  // On surfaces, and anywhere.
  for (const Vec3f vertex : scene->geometry.vertices) {
    points.push_back(ToDouble(vertex) + scene->geometry.origin);
  }
  while (points.size() < 20'000) {
    points.push_back({rng.Uniform(-4, 4), rng.Uniform(-4, 4), rng.Uniform(0, 3)});
  }
  std::shuffle(points.begin(), points.end(), rng);
  points[3].x = std::nan("");
  for (size_t i = 0; i < points.size(); ++i) {
    normals.push_back({rng.Uniform(-1, 1), rng.Uniform(-1, 1), rng.Uniform(-1, 1)});
  }
  for (const double attach : {0.0, 0.05}) {
    PreparedPoints prepared =
        *PreparePoints(*scene, {points, normals, {}}, {.attach_distance = attach});
    ASSERT_GT(prepared.near_surface, 0u);
    ASSERT_EQ(prepared.attached > 0, attach > 0);
    for (const uint32_t lights : {1u, 20u}) {
      v1::ComputeShadowsRequest request;
      request.mutable_header()->mutable_stream()->set_scene("scenes/room");
      request.mutable_header()->mutable_point_options()->set_attach_distance(attach);
      std::vector<LightSample> samples;
      for (uint32_t i = 0; i < lights; ++i) {
        const Vec3d at = {rng.Uniform(-2, 2), rng.Uniform(-2, 2), rng.Uniform(0, 3)};
        EncodeTestVector(
            at, request.mutable_header()->add_lights()->mutable_point()->mutable_position());
        ASSERT_TRUE(AppendSamples(Light::Point(at), i, scene->geometry.origin, &samples).ok());
      }
      ShadowStream stream(harness_, request);
      request.Clear();
      request.mutable_item()->mutable_points()->set_points(PackArray(points));
      request.mutable_item()->mutable_points()->set_normals(PackArray(normals));
      stream.Write(request);
      const auto replies = stream.ReadAll();
      ASSERT_TRUE(stream.Finish().ok());
      ShadowResult engine;
      ASSERT_TRUE(ComputeShadows(*scene, PointRange::All(prepared), samples, {}, {}, {.bits = true},
                                 {.strategy = Strategy::kSingle}, &engine)
                      .ok());
      std::string valid;
      EncodeBits(prepared.valid, &valid);
      EXPECT_EQ(
          Answers(replies.at(0), [](const v1::ShadowReply& r) { return r.shadows().valid_bits(); }),
          valid);
      for (uint32_t light = 0; light < lights; ++light) {
        const size_t row = points.size() / 8;
        EXPECT_EQ(Answers(replies.at(0),
                          [&](const v1::ShadowReply& r) {
                            const std::string& bits = r.shadows().lit_bits();
                            const size_t length = bits.size() / lights;
                            return bits.substr(light * length, length);
                          }),
                  PackArray(std::span(engine.lit_bits).subspan(light * row, row)))
            << light;
      }
      const v1::ComputeShadowsResponse& last = replies.at(0).back();
      EXPECT_TRUE(last.reply().header().last());
      EXPECT_EQ(last.reply().shadows().near_surface_point_count(), prepared.near_surface);
    }
  }
}

// Points in rows, which come in an order of neighbours, so that each part has a reply of its own:
// others' turns come between few of them.
TEST_F(LargeItemsTest, PointsThatAreAttachedComeInSmallParts) {
  constexpr size_t kSide = 200, kCount = kSide * kSide;
  static_assert(kCount < Scheduler::kFirstPartRays);  // Whose rays alone would be one part.
  v1::ComputeShadowsRequest request;
  request.mutable_header()->mutable_stream()->set_scene("scenes/room");
  request.mutable_header()->mutable_point_options()->set_attach_distance(1);
  EncodeTestVector({0.5, 0.25, 1.5},
                   request.mutable_header()->add_lights()->mutable_point()->mutable_position());
  ShadowStream stream(harness_, request);
  std::vector<Vec3d> points;
  for (size_t i = 0; i < kCount; ++i) {
    points.push_back(
        {static_cast<double>(i % kSide) / kSide, static_cast<double>(i / kSide) / kSide, 0.01});
  }
  request.Clear();
  request.mutable_item()->mutable_points()->set_points(PackArray(points));
  stream.Write(request);
  const auto replies = stream.ReadAll();
  ASSERT_TRUE(stream.Finish().ok());
  uint64_t answered = 0;
  for (const v1::ComputeShadowsResponse& reply : replies.at(0)) {
    const uint64_t count = reply.reply().header().element_count();
    // Nothing was known of their pace; parts are even, so about as many.
    EXPECT_LE(count, 3 * PlacementPace::kFirstPoints / 2);
    answered += count;
  }
  EXPECT_EQ(answered, kCount);
}

// Bytes that are no message, before the header and after it.
TEST_F(LargeItemsTest, WhatIsNoMessageEndsTheStreamAndSaysSo) {
  v1::TestSegmentsRequest header;
  header.mutable_header()->mutable_stream()->set_scene("scenes/room");
  for (const bool opened : {false, true}) {
    for (const std::string& bytes : {std::string("\x0a\x05"
                                                 "abc"),
                                     std::string(kLeastLifted + 100, '\xff')}) {
      grpc::GenericStub stub(harness_.channel);
      grpc::ClientContext context;
      grpc::CompletionQueue queue;
      const auto call =
          stub.PrepareCall(&context, "/sightline.v1.VisibilityService/TestSegments", &queue);
      void* tag = nullptr;
      bool ok = false;
      const auto wait = [&] {
        queue.Next(&tag, &ok);
        return ok;
      };
      call->StartCall(nullptr);
      ASSERT_TRUE(wait());
      std::vector<std::string> messages = {bytes};
      if (opened) messages.insert(messages.begin(), header.SerializeAsString());
      for (const std::string& message : messages) {
        const grpc::Slice slice(message);
        call->Write(grpc::ByteBuffer(&slice, 1), nullptr);
        ASSERT_TRUE(wait());
      }
      grpc::ByteBuffer answer;
      do {
        call->Read(&answer, nullptr);
      } while (wait());
      grpc::Status status;
      call->Finish(&status, nullptr);
      ASSERT_TRUE(wait());
      EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT) << status.error_message();
      EXPECT_EQ(ReasonIn(status), "INVALID_FIELD");
      EXPECT_TRUE(absl::StrContains(status.error_message(), "sightline.v1.TestSegmentsRequest"))
          << status.error_message();
    }
  }
}

}  // namespace
}  // namespace sightline

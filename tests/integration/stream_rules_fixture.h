// SPDX-License-Identifier: Apache-2.0
//
// A server of one thread with a scene that takes long, for what happens while it works: long work
// is known to run once its first part has been answered.
//
// Thread safety: none; belongs to one test.
//
//   TEST_F(StreamRulesTest, ...) {
//     TileStream stream(harness_, Header(v1::STRATEGY_BRUTE_FORCE));
//     stream.Write(Endless(1));
//     ReadSomePart(stream, 1);
#ifndef SIGHTLINE_TESTS_INTEGRATION_STREAM_RULES_FIXTURE_H_
#define SIGHTLINE_TESTS_INTEGRATION_STREAM_RULES_FIXTURE_H_

#include <cstdint>
#include <map>

#include "gtest/gtest.h"
#include "tests/integration/server_harness.h"

namespace sightline {

// 512 x 512 rays against every one of 60,000 triangles: minutes of one thread's work.
inline constexpr char kSlowSpec[] = "builtin:sphere:60000";
inline constexpr uint32_t kSide = 1024;
// Longer than any test: no stream is ended because the machine is slow.
inline constexpr uint64_t kStallSeconds = 3600;

inline ServerOptions OneThread() {
  ServerOptions options;
  options.threads = 1;
  options.limits.target_reply_bytes = 1024;  // Many small parts.
  options.limits.max_stream_stall_seconds = kStallSeconds;
  return options;
}

class StreamRulesTest : public testing::Test {
 protected:
  explicit StreamRulesTest(const ServerOptions& options = OneThread()) : harness_(options) {}

  void SetUp() override {
    v1::Scene scene;
    const grpc::Status status = harness_.CreateBuiltin("slow", kSlowSpec, &scene);
    ASSERT_TRUE(status.ok()) << status.error_message();
    camera_ = ViewCamera(FirstView("sphere:60000"), kSide, kSide);
  }

  v1::TraceTilesRequest Header(v1::Strategy strategy) const {
    v1::TraceTilesRequest request;
    request.mutable_header()->mutable_stream()->set_scene("scenes/slow");
    request.mutable_header()->mutable_stream()->mutable_options()->set_strategy(strategy);
    EncodeTestCamera(camera_, request.mutable_header()->mutable_camera());
    request.mutable_header()->mutable_outputs()->set_depths(true);
    return request;
  }
  // A whole image by brute force: far more than a test's time.
  static v1::TraceTilesRequest Endless(uint64_t id) { return TileRequest(id, 0, 0, kSide, kSide); }

  // Reads until a reply with `last`; returns its item's status and adds up the elements of each
  // item.
  v1::TileReply ReadLast(TileStream& stream) {
    v1::TraceTilesResponse response;
    while (stream.Read(&response)) {
      if (!response.has_reply()) continue;
      elements_[response.reply().header().item_id()] += response.reply().header().element_count();
      if (response.reply().header().last()) return response.reply();
    }
    ADD_FAILURE() << "the stream ended: " << stream.Finish().error_message();
    return {};
  }
  // Reads until some part of item `id` has been answered: it is being computed.
  void ReadSomePart(TileStream& stream, uint64_t id) {
    v1::TraceTilesResponse response;
    while (stream.Read(&response)) {
      if (response.has_reply() && response.reply().header().item_id() == id) {
        ASSERT_FALSE(response.reply().header().last());
        return;
      }
    }
    FAIL() << "the stream ended: " << stream.Finish().error_message();
  }

  ServerHarness harness_;
  Camera camera_;
  std::map<uint64_t, uint64_t> elements_;
};

// One whose queue holds one such item.
class SmallQueueTest : public StreamRulesTest {
 protected:
  static ServerOptions Small() {
    ServerOptions options = OneThread();
    options.limits.max_queued_rays = uint64_t{kSide} * kSide;
    return options;
  }
  SmallQueueTest() : StreamRulesTest(Small()) {}
};

}  // namespace sightline

#endif  // SIGHTLINE_TESTS_INTEGRATION_STREAM_RULES_FIXTURE_H_

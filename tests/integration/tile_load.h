// SPDX-License-Identifier: Apache-2.0
//
// Clients that keep a server busy with tiles whose answers are known from the engine in this
// process, and check each one they get, whatever happens to the server meanwhile.
//
// Thread safety: TileLoad's counts from any thread; its clients are threads of their own.
//
//   const KnownTiles tiles("room:15000");
//   TileLoad load(tiles, {.address = server.address(), .clients = 3});
//   load.WaitForAnswers(100);
//   load.Stop();
//   EXPECT_EQ(load.wrong(), 0u);
#ifndef SIGHTLINE_TESTS_INTEGRATION_TILE_LOAD_H_
#define SIGHTLINE_TESTS_INTEGRATION_TILE_LOAD_H_

#include <atomic>
#include <cstdint>
#include <cstring>
#include <map>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "core/query/tiles.h"
#include "tests/integration/server_harness.h"
#include "tests/integration/serving_process.h"
#include "tests/support/until.h"

namespace sightline {

// The tiles of a built-in scene's first view, with the engine's depths.
class KnownTiles {
 public:
  static constexpr uint32_t kSide = 64, kAcross = 4;

  // `spec` without "builtin:". The server is to have the scene as "scenes/known".
  explicit KnownTiles(const std::string& spec) : spec_(spec) {
    ServerHarness engine;
    v1::Scene scene;
    EXPECT_TRUE(engine.CreateBuiltin("known", "builtin:" + spec, &scene).ok());
    const std::shared_ptr<const Scene> built = *engine.server->scenes().Pin("known", 0);
    camera_ = ViewCamera(FirstView(spec), kSide * kAcross, kSide * kAcross);
    for (size_t i = 0; i < count(); ++i) {
      const v1::TileItem item = Request(i).item();
      TileResult result;
      EXPECT_TRUE(TraceTile(*built, camera_, {item.x(), item.y(), kSide, kSide}, {},
                            {.depth = true}, {}, &result)
                      .ok());
      depths_.push_back(std::move(result.depth));
    }
  }

  std::string scene_option() const { return "known=builtin:" + spec_; }
  std::string flag() const { return "--scene=" + scene_option(); }
  const std::string& spec() const { return spec_; }
  size_t count() const { return size_t{kAcross} * kAcross; }
  v1::TraceTilesRequest Header() const {
    v1::TraceTilesRequest request;
    request.mutable_header()->mutable_stream()->set_scene("scenes/known");
    EncodeTestCamera(camera_, request.mutable_header()->mutable_camera());
    request.mutable_header()->mutable_outputs()->set_depths(true);
    return request;
  }
  v1::TraceTilesRequest Request(uint64_t id) const {
    const auto tile = static_cast<uint32_t>(id % count());
    return TileRequest(id, tile % kAcross * kSide, tile / kAcross * kSide, kSide, kSide);
  }
  // Whether these are the depths of the elements that the reply says.
  bool Right(const v1::TileReply& reply) const {
    const AlignedVector<float>& depths = depths_[reply.header().item_id() % count()];
    const uint64_t from = reply.header().offset(), n = reply.header().element_count();
    return from + n <= depths.size() && reply.tile().depths().size() == 4 * n &&
           std::memcmp(reply.tile().depths().data(), depths.data() + from, 4 * n) == 0;
  }

 private:
  const std::string spec_;
  Camera camera_;
  std::vector<AlignedVector<float>> depths_;
};

class TileLoad {
 public:
  struct Options {
    std::string address;
    int clients = 2;
    int window = 8;  // Items unanswered at once, of each client.
  };

  TileLoad(const KnownTiles& tiles, const Options& options) : tiles_(tiles), options_(options) {
    for (int i = 0; i < options_.clients; ++i) threads_.emplace_back([this] { RunClient(); });
  }
  ~TileLoad() { Stop(); }

  // Returns once so many more items were answered than when it was called.
  void WaitForAnswers(uint64_t more) const {
    const uint64_t until = answers_ + more;
    ASSERT_TRUE(
        testing_support::Until("the clients are answered", [&] { return answers_ >= until; }));
  }
  // Answers what is under way, and ends the clients.
  void Stop() {
    stop_ = true;
    Join();
  }
  // From now on a client whose stream ends does not open another.
  void KeepStreams() { last_stream_ = true; }
  // Returns when the clients have ended by themselves.
  void Join() {
    for (std::thread& thread : threads_) thread.join();
    threads_.clear();
  }

  uint64_t answers() const { return answers_; }        // Items with every element right.
  uint64_t wrong() const { return wrong_; }            // Items with some element wrong or missing.
  uint64_t refused() const { return refused_; }        // Items that ended with an error.
  uint64_t broken_streams() const { return broken_; }  // That ended with an error.
  uint64_t lost_accepted() const { return lost_; }     // Accepted by a draining server; no answer.
  uint64_t drained_streams() const { return drained_; }  // That were told of the drain.

 private:
  void RunClient() {
    const auto channel = ServingProcess::ChannelTo(options_.address);
    const auto stub = v1::VisibilityService::NewStub(channel);
    uint64_t id = 0;
    while (!stop_ && !(last_stream_ && id > 0)) RunStream(*stub, &id);
  }

  void RunStream(v1::VisibilityService::Stub& stub, uint64_t* id) {
    grpc::ClientContext context;
    context.set_wait_for_ready(true);
    const auto stream = stub.TraceTiles(&context);
    v1::TraceTilesResponse response;
    std::map<uint64_t, uint64_t> elements;  // Right so far, by unanswered item.
    uint64_t ok = 0, accepted = 0;
    bool draining = false, more = true;
    stream->Write(tiles_.Header());
    while (stream->Read(&response)) {
      if (response.has_draining()) {
        draining = true;
        accepted = response.draining().accepted_item_count();
        ++drained_;
      }
      if (response.has_reply()) ok += Take(response.reply(), &elements);
      if (more && (stop_ || draining)) {
        more = false;
        stream->WritesDone();
      }
      while (more && elements.size() < static_cast<size_t>(options_.window)) {
        elements[*id] = 0;
        if (!stream->Write(tiles_.Request((*id)++))) break;
      }
    }
    if (!stream->Finish().ok()) ++broken_;
    // With a draining server every accepted item is answered, before the stream ends.
    if (draining && ok < accepted) lost_ += accepted - ok;
  }

  // Whether an item was answered in full.
  bool Take(const v1::TileReply& reply, std::map<uint64_t, uint64_t>* elements) {
    const v1::ReplyHeader& header = reply.header();
    const auto item = elements->find(header.item_id());
    if (item == elements->end()) {
      ++wrong_;
      return false;
    }
    const bool ok = header.status().code() == 0;
    if (ok && tiles_.Right(reply)) item->second += header.element_count();
    if (!header.last()) return false;
    const bool whole = item->second == uint64_t{KnownTiles::kSide} * KnownTiles::kSide;
    elements->erase(item);
    ++(!ok ? refused_ : whole ? answers_ : wrong_);
    return ok && whole;
  }

  const KnownTiles& tiles_;
  const Options options_;
  std::atomic<bool> stop_ = false, last_stream_ = false;
  std::atomic<uint64_t> answers_ = 0, wrong_ = 0, refused_ = 0, broken_ = 0, lost_ = 0,
                        drained_ = 0;
  std::vector<std::thread> threads_;
};

}  // namespace sightline

#endif  // SIGHTLINE_TESTS_INTEGRATION_TILE_LOAD_H_

// SPDX-License-Identifier: Apache-2.0
//
// A scripted server of TestSegments streams, after the rules of visibility_service.proto: it counts
// credit, answers in any order and in pieces, and can drain, break off or be full. A segment is
// blocked when its from.x is above zero and not valid when its from.x is NaN, in either form.
//
// Thread safety: a stream as BidiStream has it; the server's members under its mutex.
#ifndef SIGHTLINE_TESTS_CLIENT_LIB_FAKE_SEGMENTS_H_
#define SIGHTLINE_TESTS_CLIENT_LIB_FAKE_SEGMENTS_H_

#include <algorithm>
#include <cmath>
#include <cstring>
#include <deque>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "client/lib/connection.h"
#include "client/lib/mutex.h"
#include "client/lib/status.h"

namespace sightline::client {

struct FakeServer {
  int64_t credit = 1000;
  int64_t min_cost = 1;
  // Per stream in order of opening; the last entry holds for all later ones.
  struct Script {
    int drain_after = -1;               // Accepts so many items, then drains.
    int break_after = -1;               // Accepts so many items, then the connection is lost.
    int full_every = 0;                 // Every k-th item finds the queue full.
    int full_first = 0;                 // So many items find the queue full, then none.
    bool refuse = false;                // The stream ends at once with UNAVAILABLE.
    bool hang = false;                  // Items are never answered.
    uint64_t fail_item = ~uint64_t{0};  // This item gets INVALID_ARGUMENT.
    int short_every = 0;                // Every k-th item's answer lacks its last elements.
  };
  std::vector<Script> scripts = {{}};
  int64_t gone_revision = 0;  // Streams that ask for it end with REVISION_MISMATCH.

  Mutex mutex;
  int streams = 0;
  int items = 0;
  int stored_items = 0;  // Those of them that came in the stored form.
  int violations = 0;    // Items sent without credit, or twice at once.
  std::map<uint64_t, int> sent;
};

class FakeSegmentStream final : public Connection::SegmentStream {
 public:
  explicit FakeSegmentStream(FakeServer* server) : server_(server) {
    MutexLock lock(&server_->mutex);
    const size_t i =
        std::min<size_t>(static_cast<size_t>(server_->streams++), server_->scripts.size() - 1);
    script_ = server_->scripts[i];
    credit_ = server_->credit;
  }

  bool Write(const v1::TestSegmentsRequest& request) override {
    MutexLock lock(&server_->mutex);
    if (ended_) return false;
    if (request.has_header()) {
      if (script_.refuse) {
        End(absl::UnavailableError("not yet"));
        return true;
      }
      if (server_->gone_revision != 0 &&
          request.header().stream().revision() == server_->gone_revision) {
        v1::ItemStatus gone;
        gone.set_code(9);
        gone.set_reason(v1::ERROR_REASON_REVISION_MISMATCH);
        End(FromItem(gone));
        return true;
      }
      v1::TestSegmentsResponse response;
      response.mutable_opened()->set_revision(request.header().stream().revision());
      response.mutable_opened()->set_credit_rays(credit_);
      ready_.push_back(std::move(response));
      return true;
    }
    const uint64_t id = request.item().item().item_id();
    const uint64_t n =
        request.item().segments().size() / 48 + request.item().segments_f32().size() / 24;
    if (!request.item().segments_f32().empty()) ++server_->stored_items;
    ++server_->items;
    ++server_->sent[id];
    if (credit_ <= 0 || open_.contains(id)) ++server_->violations;
    const int64_t cost = std::max(static_cast<int64_t>(n), server_->min_cost);
    if (draining_) {
      ready_.push_back(Failure(id, 14, v1::ERROR_REASON_DRAINING));
      return true;
    }
    credit_ -= cost;
    open_[id] = cost;
    ++accepted_;
    if (script_.hang) return true;
    if (id == script_.fail_item) {
      held_.push_back({Failure(id, 3, v1::ERROR_REASON_INVALID_FIELD)});
    } else if (accepted_ <= script_.full_first ||
               (script_.full_every > 0 && accepted_ % script_.full_every == 0)) {
      held_.push_back({Failure(id, 8, v1::ERROR_REASON_QUEUE_FULL)});
    } else {
      held_.push_back(request.item().segments_f32().empty()
                          ? Results<double>(id, request.item().segments())
                          : Results<float>(id, request.item().segments_f32()));
      if (script_.short_every > 0 && accepted_ % script_.short_every == 0) {
        // Those that come first: the reply that says that it is the last is still there.
        held_.back().erase(held_.back().begin());
      }
    }
    if (accepted_ == script_.break_after) End(absl::UnavailableError("connection lost"));
    if (accepted_ == script_.drain_after) {
      draining_ = true;
      v1::TestSegmentsResponse response;
      response.mutable_draining()->set_accepted_item_count(static_cast<uint64_t>(accepted_));
      response.mutable_draining()->set_last_accepted_item_id(id);
      ready_.push_back(std::move(response));
    }
    return true;
  }

  bool WritesDone() override {
    MutexLock lock(&server_->mutex);
    done_ = true;
    return true;
  }

  bool Read(v1::TestSegmentsResponse* response) override {
    MutexLock lock(&server_->mutex);
    const auto something = [this] { return ended_ || done_ || !ready_.empty() || !held_.empty(); };
    server_->mutex.Await(absl::Condition(&something));
    if (ended_) return false;
    if (ready_.empty() && !held_.empty()) {
      // The item that waited shortest is answered first: never in order.
      std::vector<v1::TestSegmentsResponse> replies = std::move(held_.back());
      held_.pop_back();
      const uint64_t id = replies.front().reply().header().item_id();
      credit_ += open_[id];
      open_.erase(id);
      for (auto& reply : replies) ready_.push_back(std::move(reply));
    }
    if (!ready_.empty()) {
      *response = std::move(ready_.front());
      ready_.pop_front();
      return true;
    }
    if (done_) End(draining_ ? absl::UnavailableError("draining") : absl::OkStatus());
    return false;
  }

  void Cancel() override {
    MutexLock lock(&server_->mutex);
    End(absl::CancelledError("cancelled"));
  }
  absl::Status Finish() override {
    MutexLock lock(&server_->mutex);
    return status_;
  }

 private:
  void End(absl::Status status) {
    if (ended_) return;
    ended_ = true;
    status_ = std::move(status);
  }

  static v1::TestSegmentsResponse Failure(uint64_t id, int code, v1::ErrorReason reason) {
    v1::TestSegmentsResponse response;
    v1::ReplyHeader* header = response.mutable_reply()->mutable_header();
    header->set_item_id(id);
    header->set_last(true);
    header->mutable_status()->set_code(code);
    header->mutable_status()->set_reason(reason);
    header->mutable_status()->set_message("scripted");
    return response;
  }

  // In pieces of 8 elements, the later half first.
  template <typename Number>
  static std::vector<v1::TestSegmentsResponse> Results(uint64_t id, const std::string& bytes) {
    constexpr size_t kBytes = 6 * sizeof(Number);
    const size_t n = bytes.size() / kBytes;
    std::vector<v1::TestSegmentsResponse> replies;
    for (size_t at = 0; at < n; at += 8) {
      const size_t count = std::min<size_t>(8, n - at);
      unsigned char blocked = 0, valid = 0;
      for (size_t i = 0; i < count; ++i) {
        Number x;
        std::memcpy(&x, bytes.data() + (at + i) * kBytes, sizeof x);
        if (!std::isnan(x)) valid = static_cast<unsigned char>(valid | (1u << i));
        if (x > 0) blocked = static_cast<unsigned char>(blocked | (1u << i));
      }
      v1::TestSegmentsResponse response;
      v1::ReplyHeader* header = response.mutable_reply()->mutable_header();
      header->set_item_id(id);
      header->set_offset(at);
      header->set_element_count(count);
      response.mutable_reply()->mutable_segments()->set_blocked_bits(
          std::string(1, static_cast<char>(blocked)));
      response.mutable_reply()->mutable_segments()->set_valid_bits(
          std::string(1, static_cast<char>(valid)));
      replies.push_back(std::move(response));
    }
    std::reverse(replies.begin(), replies.end());
    replies.back().mutable_reply()->mutable_header()->set_last(true);
    replies.back().mutable_reply()->mutable_header()->mutable_statistics()->set_ray_count(n);
    return replies;
  }

  FakeServer* const server_;
  FakeServer::Script script_;
  int64_t credit_ = 0;
  int accepted_ = 0;
  bool ended_ = false, done_ = false, draining_ = false;
  absl::Status status_;
  std::map<uint64_t, int64_t> open_;  // Cost by item.
  std::deque<v1::TestSegmentsResponse> ready_;
  std::vector<std::vector<v1::TestSegmentsResponse>> held_;
};

}  // namespace sightline::client

#endif  // SIGHTLINE_TESTS_CLIENT_LIB_FAKE_SEGMENTS_H_

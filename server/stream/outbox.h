// SPDX-License-Identifier: Apache-2.0
//
// Messages of one call that wait for the transport, in order, each with what is due when it goes;
// and how many bytes they are, so that the answers of a client that does not read stay uncomputed.
//
// Thread safety: guarded by its stream's lock.
//
//   outbox.Push(std::move(response), item);
//   if (outbox.full()) flow->Hold(true);
#ifndef SIGHTLINE_SERVER_STREAM_OUTBOX_H_
#define SIGHTLINE_SERVER_STREAM_OUTBOX_H_

#include <cstdint>
#include <deque>
#include <memory>
#include <utility>

namespace sightline {

template <typename Message, typename Due>
class Outbox {
 public:
  // What a stream may have computed ahead of its reader.
  static constexpr uint64_t kMaxBytes = 8 << 20;

  bool empty() const { return waiting_.empty(); }
  bool full() const { return bytes_ > kMaxBytes; }
  void Push(std::unique_ptr<Message> message, Due due) {
    const uint64_t bytes = message->ByteSizeLong();
    bytes_ += bytes;
    waiting_.push_back({std::move(message), bytes, std::move(due)});
  }
  // REQUIRES, for both: not empty.
  const Message& first() const { return *waiting_.front().message; }
  std::pair<std::unique_ptr<Message>, Due> Pop() {
    Waiting first = std::move(waiting_.front());
    waiting_.pop_front();
    bytes_ -= first.bytes;
    return {std::move(first.message), std::move(first.due)};
  }
  void Clear() {
    waiting_.clear();
    bytes_ = 0;
  }

 private:
  struct Waiting {
    std::unique_ptr<Message> message;
    uint64_t bytes;
    Due due;
  };
  std::deque<Waiting> waiting_;
  uint64_t bytes_ = 0;
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_STREAM_OUTBOX_H_

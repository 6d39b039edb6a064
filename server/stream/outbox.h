// SPDX-License-Identifier: Apache-2.0
//
// Messages of one call that wait for the transport, in order, each with what is due when it goes;
// and how many bytes they are, so that the answers of a client that does not read stay uncomputed.
//
// Thread safety: guarded by its stream's lock.
//
//   outbox.Push({.bytes = ReplyBytes(header, reply), .is_reply = true}, item);
//   if (outbox.full()) flow->Hold(true);
#ifndef SIGHTLINE_SERVER_STREAM_OUTBOX_H_
#define SIGHTLINE_SERVER_STREAM_OUTBOX_H_

#include <grpcpp/support/byte_buffer.h>

#include <cstdint>
#include <deque>
#include <utility>

namespace sightline {

struct OutgoingMessage {
  grpc::ByteBuffer bytes;
  bool is_reply = false;
};

template <typename Due>
class Outbox {
 public:
  // What a stream may have computed ahead of its reader.
  static constexpr uint64_t kMaxBytes = 8 << 20;

  bool empty() const { return waiting_.empty(); }
  bool full() const { return bytes_ > kMaxBytes; }
  void Push(OutgoingMessage message, Due due) {
    bytes_ += message.bytes.Length();
    waiting_.emplace_back(std::move(message), std::move(due));
  }
  // REQUIRES, for both: not empty.
  const OutgoingMessage& first() const { return waiting_.front().first; }
  std::pair<OutgoingMessage, Due> Pop() {
    std::pair<OutgoingMessage, Due> first = std::move(waiting_.front());
    waiting_.pop_front();
    bytes_ -= first.first.bytes.Length();
    return first;
  }
  void Clear() {
    waiting_.clear();
    bytes_ = 0;
  }

 private:
  std::deque<std::pair<OutgoingMessage, Due>> waiting_;
  uint64_t bytes_ = 0;
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_STREAM_OUTBOX_H_

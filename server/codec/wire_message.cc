// SPDX-License-Identifier: Apache-2.0
#include "server/codec/wire_message.h"

#include <utility>

#include "server/codec/wire_format.h"

namespace sightline {

std::string& WireMessage::Small() {
  if (parts_.empty() || parts_.back().shared.size() > 0) parts_.emplace_back();
  return parts_.back().small;
}

void WireMessage::AddHead(int field, size_t bytes) {
  std::string& small = Small();
  const size_t before = small.size();
  AppendLengthHead(field, bytes, &small);
  size_ += small.size() - before;
}

void WireMessage::AddArray(int field, const WireArray& array) {
  if (array.empty()) return;
  AddHead(field, array.size());
  size_ += array.size();
  if (array.size() < kLeastShared) {
    std::string& small = Small();
    const size_t before = small.size();
    small.resize(before + array.size());
    CopyBytes(array, small.data() + before);
    return;
  }
  for (const WireArray::Piece& piece : array.pieces()) {
    Small();  // A part that has no slice yet.
    parts_.back().shared = piece.slice;
  }
}

void WireMessage::AddMessage(int field, const google::protobuf::MessageLite& message) {
  AddHead(field, message.ByteSizeLong());
  AddFields(message);
}

void WireMessage::AddFields(const google::protobuf::MessageLite& message) {
  std::string& small = Small();
  const size_t before = small.size();
  message.AppendToString(&small);
  size_ += small.size() - before;
}

void WireMessage::AddMessage(int field, WireMessage message) {
  AddHead(field, message.size());
  size_ += message.size();
  for (Part& part : message.parts_) {
    Small() += part.small;
    parts_.back().shared = std::move(part.shared);
  }
}

grpc::ByteBuffer WireMessage::Finish() const {
  std::vector<grpc::Slice> slices;
  slices.reserve(2 * parts_.size());
  for (const Part& part : parts_) {
    if (!part.small.empty()) slices.emplace_back(part.small);
    if (part.shared.size() > 0) slices.push_back(part.shared);
  }
  return {slices.data(), slices.size()};
}

std::string WireMessage::ToString() const {
  std::string bytes;
  bytes.reserve(size_);
  for (const Part& part : parts_) {
    bytes += part.small;
    bytes.append(reinterpret_cast<const char*>(part.shared.begin()), part.shared.size());
  }
  return bytes;
}

}  // namespace sightline

// SPDX-License-Identifier: Apache-2.0
#include "server/codec/wire_request.h"

#include <google/protobuf/descriptor.h>
#include <grpcpp/impl/codegen/proto_utils.h>

#include <algorithm>
#include <limits>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "core/base/check.h"
#include "server/base/error.h"
#include "server/codec/wire_format.h"

namespace sightline {
namespace {

using google::protobuf::Descriptor;
using google::protobuf::FieldDescriptor;

// Beyond so many bytes the rest of a message is not small, and better read where it is.
constexpr size_t kMostRest = 64 << 10;

// A place in a message's slices.
class Cursor {
 public:
  explicit Cursor(const std::vector<grpc::Slice>& slices) : slices_(slices) { SkipEmpty(); }

  size_t at() const { return at_; }
  // Numbers that protobuf would not read, or reads by rules of their own, are none here: more than
  // five bytes for what has 32 bits, ten for 64.
  std::optional<uint64_t> ReadVarint(int most_bytes) {
    uint64_t value = 0;
    for (int i = 0; i < most_bytes && slice_ < slices_.size(); ++i) {
      const uint8_t byte = slices_[slice_].begin()[within_];
      Advance(1);
      value |= static_cast<uint64_t>(byte & 0x7F) << (7 * i);
      if ((byte & 0x80) == 0) return value;
    }
    return std::nullopt;
  }
  // REQUIRES, for all three: that many bytes are left.
  void Skip(size_t bytes) {
    Walk(bytes, [](const grpc::Slice&, size_t, size_t) {});
  }
  void Copy(size_t bytes, std::string* out) {
    Walk(bytes, [&](const grpc::Slice& slice, size_t from, size_t count) {
      out->append(reinterpret_cast<const char*>(slice.begin()) + from, count);
    });
  }
  void Lift(size_t bytes, WireArray* out) {
    Walk(bytes, [&](const grpc::Slice& slice, size_t from, size_t count) {
      out->Append(slice.sub(from, from + count));
    });
  }

 private:
  template <typename Take>
  void Walk(size_t bytes, const Take& take) {
    while (bytes > 0) {
      SIGHTLINE_CHECK(slice_ < slices_.size());
      const size_t here = std::min(bytes, slices_[slice_].size() - within_);
      take(slices_[slice_], within_, here);
      Advance(here);
      bytes -= here;
    }
  }
  void Advance(size_t bytes) {
    within_ += bytes;
    at_ += bytes;
    SkipEmpty();
  }
  void SkipEmpty() {
    while (slice_ < slices_.size() && within_ == slices_[slice_].size()) {
      ++slice_;
      within_ = 0;
    }
  }

  const std::vector<grpc::Slice>& slices_;
  size_t slice_ = 0, within_ = 0, at_ = 0;
};

class Scan {
 public:
  Scan(const std::vector<grpc::Slice>& slices, std::span<const WirePath> paths, size_t least,
       std::span<WireArray> arrays)
      : cursor_(slices), paths_(paths), least_(least), arrays_(arrays) {}

  // Appends what of the message of `type`, up to `end`, is not lifted to `rest`. False: it is not
  // plain. `depth` fields have led here, those of `paths_[i]` for which within[i] is set.
  bool Message(const Descriptor& type, size_t end, size_t depth, const std::vector<bool>& within,
               std::string* rest) {
    std::vector<int> seen;  // The fields on the way that were found.
    while (cursor_.at() < end) {
      const std::optional<uint64_t> tag = cursor_.ReadVarint(5);
      if (!tag.has_value() || *tag > std::numeric_limits<uint32_t>::max()) return false;
      const int number = static_cast<int>(*tag >> 3);
      if (number == 0) return false;
      const auto wire_type = static_cast<WireType>(*tag & 7);
      std::vector<bool> onward(paths_.size());
      for (size_t i = 0; i < paths_.size(); ++i) {
        onward[i] = within[i] && paths_[i][depth] == number;
      }
      const auto path = std::find(onward.begin(), onward.end(), true);
      if (path == onward.end()) {
        if (Excludes(type, number, within, depth)) return false;
        if (!CopyField(*tag, wire_type, end, rest)) return false;
        continue;
      }
      // A field that comes twice is the last one, or the merge of both.
      if (wire_type != WireType::kLength ||
          std::find(seen.begin(), seen.end(), number) != seen.end()) {
        return false;
      }
      seen.push_back(number);
      const std::optional<size_t> length = ReadLength(end);
      if (!length.has_value()) return false;
      const size_t which = static_cast<size_t>(path - onward.begin());
      const bool leaf = depth + 1 == paths_[which].size() || paths_[which][depth + 1] == 0;
      if (leaf) {
        if (*length >= least_) {
          cursor_.Lift(*length, &arrays_[which]);
          continue;
        }
        AppendLengthHead(number, *length, rest);
        if (!CopyBytes(*length, rest)) return false;
        continue;
      }
      std::string inner;
      const Descriptor& inner_type = *type.FindFieldByNumber(number)->message_type();
      if (!Message(inner_type, cursor_.at() + *length, depth + 1, onward, &inner)) return false;
      AppendLengthHead(number, inner.size(), rest);
      *rest += inner;
    }
    return cursor_.at() == end;
  }

 private:
  // Whether the field and one on the way are two of a oneof, of which the last one counts.
  bool Excludes(const Descriptor& type, int number, const std::vector<bool>& within,
                size_t depth) const {
    const FieldDescriptor* const field = type.FindFieldByNumber(number);
    if (field == nullptr || field->containing_oneof() == nullptr) return false;
    for (size_t i = 0; i < paths_.size(); ++i) {
      if (within[i] && type.FindFieldByNumber(paths_[i][depth])->containing_oneof() ==
                           field->containing_oneof()) {
        return true;
      }
    }
    return false;
  }

  std::optional<size_t> ReadLength(size_t end) {
    const std::optional<uint64_t> length = cursor_.ReadVarint(5);
    if (!length.has_value() || cursor_.at() > end || *length > end - cursor_.at()) {
      return std::nullopt;
    }
    return static_cast<size_t>(*length);
  }

  bool CopyBytes(size_t bytes, std::string* rest) {
    if (bytes > kMostRest - std::min(kMostRest, rest->size())) return false;
    cursor_.Copy(bytes, rest);
    return true;
  }

  // A field that nobody looks into; the tag has been read.
  bool CopyField(uint64_t tag, WireType wire_type, size_t end, std::string* rest) {
    AppendVarint(tag, rest);
    size_t bytes = 0;
    switch (wire_type) {
      case WireType::kVarint: {
        const std::optional<uint64_t> value = cursor_.ReadVarint(10);
        if (!value.has_value()) return false;
        AppendVarint(*value, rest);
        return cursor_.at() <= end;
      }
      case WireType::kFixed64:
        bytes = 8;
        break;
      case WireType::kFixed32:
        bytes = 4;
        break;
      case WireType::kLength: {
        const std::optional<size_t> length = ReadLength(end);
        if (!length.has_value()) return false;
        AppendVarint(*length, rest);
        bytes = *length;
        break;
      }
      default:
        return false;
    }
    return cursor_.at() <= end && bytes <= end - cursor_.at() && CopyBytes(bytes, rest);
  }

  Cursor cursor_;
  const std::span<const WirePath> paths_;
  const size_t least_;
  const std::span<WireArray> arrays_;
};

// What of the message is not lifted; nothing if it is not plain.
std::optional<std::string> LiftArrays(const grpc::ByteBuffer& buffer,
                                      std::span<const WirePath> paths, const Descriptor& type,
                                      std::span<WireArray> arrays, size_t least) {
  std::vector<grpc::Slice> slices;
  if (!buffer.Dump(&slices).ok()) return std::nullopt;
  std::string rest;
  Scan scan(slices, paths, least, arrays);
  if (scan.Message(type, buffer.Length(), 0, std::vector<bool>(paths.size(), true), &rest)) {
    return rest;
  }
  for (WireArray& array : arrays) array = WireArray();
  return std::nullopt;
}

}  // namespace

absl::Status ReadRequest(grpc::ByteBuffer* buffer, std::span<const WirePath> paths,
                         google::protobuf::Message* message, std::span<WireArray> arrays,
                         size_t least) {
  SIGHTLINE_CHECK_EQ(paths.size(), arrays.size());
  const size_t bytes = buffer->Length();
  bool parsed = false;
  std::optional<std::string> rest;
  if (!paths.empty() && bytes >= least) {
    rest = LiftArrays(*buffer, paths, *message->GetDescriptor(), arrays, least);
  }
  if (rest.has_value()) {
    parsed = message->ParseFromString(*rest);
    buffer->Clear();
  } else {
    parsed = grpc::GenericDeserialize<grpc::ProtoBufferReader, google::protobuf::Message>(buffer,
                                                                                          message)
                 .ok();
  }
  if (parsed) return absl::OkStatus();
  for (WireArray& array : arrays) array = WireArray();
  return InvalidField("message", absl::StrCat(bytes, " bytes"),
                      absl::StrCat("must be a ", message->GetDescriptor()->full_name()));
}

}  // namespace sightline

// SPDX-License-Identifier: Apache-2.0
#include "server/codec/wire_request.h"

#include <google/protobuf/descriptor.h>
#include <grpcpp/impl/codegen/proto_utils.h>

#include <algorithm>
#include <bit>
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

// As protobuf's own: messages and groups within each other.
constexpr int kDeepest = 100;

// A place in a message's slices.
class Cursor {
 public:
  explicit Cursor(const std::vector<grpc::Slice>& slices) : slices_(&slices) { SkipEmpty(); }

  size_t at() const { return at_; }
  // Nothing if it has more bytes: protobuf takes five for what has 32 bits, ten for 64.
  std::optional<uint64_t> ReadVarint(int most_bytes) {
    uint64_t value = 0;
    for (int i = 0; i < most_bytes && slice_ < slices_->size(); ++i) {
      const uint8_t byte = (*slices_)[slice_].begin()[within_];
      Advance(1);
      value |= static_cast<uint64_t>(byte & 0x7F) << (7 * i);
      if ((byte & 0x80) == 0) return value;
    }
    return std::nullopt;
  }
  // REQUIRES, for all four: that many bytes are left.
  void Skip(size_t bytes) {
    Walk(bytes, [](const grpc::Slice&, size_t, size_t) {});
  }
  // How many numbers of variable length end in them.
  uint64_t SkipVarints(size_t bytes) {
    uint64_t ends = 0;
    Walk(bytes, [&](const grpc::Slice& slice, size_t from, size_t count) {
      ends +=
          static_cast<uint64_t>(std::count_if(slice.begin() + from, slice.begin() + from + count,
                                              [](uint8_t byte) { return (byte & 0x80) == 0; }));
    });
    return ends;
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
      SIGHTLINE_CHECK(slice_ < slices_->size());
      const size_t here = std::min(bytes, (*slices_)[slice_].size() - within_);
      take((*slices_)[slice_], within_, here);
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
    while (slice_ < slices_->size() && within_ == (*slices_)[slice_].size()) {
      ++slice_;
      within_ = 0;
    }
  }

  const std::vector<grpc::Slice>* slices_;
  size_t slice_ = 0, within_ = 0, at_ = 0;
};

// What a field's single values are written as.
WireType WireTypeOf(const FieldDescriptor& field) {
  switch (field.type()) {
    case FieldDescriptor::TYPE_DOUBLE:
    case FieldDescriptor::TYPE_FIXED64:
    case FieldDescriptor::TYPE_SFIXED64:
      return WireType::kFixed64;
    case FieldDescriptor::TYPE_FLOAT:
    case FieldDescriptor::TYPE_FIXED32:
    case FieldDescriptor::TYPE_SFIXED32:
      return WireType::kFixed32;
    case FieldDescriptor::TYPE_STRING:
    case FieldDescriptor::TYPE_BYTES:
    case FieldDescriptor::TYPE_MESSAGE:
      return WireType::kLength;
    case FieldDescriptor::TYPE_GROUP:
      return WireType::kGroup;
    default:
      return WireType::kVarint;
  }
}

// Two walks over one message: the first looks, the second writes what is left of it.
class Scan {
 public:
  Scan(const std::vector<grpc::Slice>& slices, std::span<const WirePath> paths, size_t least)
      : slices_(slices), cursor_(slices), paths_(paths), least_(least) {}

  // False: protobuf would not read it.
  bool Look(const Descriptor& type, size_t bytes) {
    return Message(type, bytes, {.within = (1u << paths_.size()) - 1}, nullptr);
  }
  // What the look has found.
  bool unknown() const { return unknown_; }
  bool liftable() const { return plain_ && large_; }
  uint64_t elements() const {
    uint64_t all = 0;
    for (const Count& count : counts_) all += count.elements;
    return all;
  }
  // The repeated field that has most of them. REQUIRES: elements() > 0.
  std::pair<const FieldDescriptor*, uint64_t> most_elements() const {
    const auto most =
        std::max_element(counts_.begin(), counts_.end(),
                         [](const Count& a, const Count& b) { return a.elements < b.elements; });
    return {most->field, most->elements};
  }

  // The message without its unknown fields, and without the arrays, if it is liftable.
  // REQUIRES: Look said yes.
  std::string Rewrite(const Descriptor& type, size_t bytes, std::span<WireArray> arrays) {
    cursor_ = Cursor(slices_);
    arrays_ = liftable() ? arrays : std::span<WireArray>();
    std::string rest;
    SIGHTLINE_CHECK(Message(type, bytes, {.within = (1u << paths_.size()) - 1}, &rest));
    return rest;
  }

 private:
  struct Count {
    const FieldDescriptor* field;
    uint64_t elements;
  };
  struct Place {
    int level = 0;        // Messages and groups that it is in.
    uint32_t within = 0;  // Bit i: the fields that have led here are those of paths_[i].
  };

  // Appends what is left of the message of `type`, up to `end`, to `rest`, unless that is null.
  bool Message(const Descriptor& type, size_t end, const Place& place, std::string* rest) {
    if (place.level > kDeepest) return false;
    uint32_t seen = 0;  // The paths that were found to go on here.
    while (cursor_.at() < end) {
      Cursor begin = cursor_;
      int number = 0;
      WireType wire_type;
      if (!ReadTag(&number, &wire_type)) return false;
      const FieldDescriptor* const field = type.FindFieldByNumber(number);
      const bool packed =
          field != nullptr && field->is_packable() && wire_type == WireType::kLength;
      if (field == nullptr || (wire_type != WireTypeOf(*field) && !packed)) {
        unknown_ = true;
        if (!SkipValue(number, wire_type, end, place.level)) return false;
        continue;
      }
      const uint32_t onward = Onward(number, place);
      // A field that comes twice is the last one, or the merge of both; of a oneof the last counts.
      if (onward != 0 ? (onward & seen) != 0 : Excludes(type, *field, place)) plain_ = false;
      seen |= onward;
      if (wire_type != WireType::kLength) {
        if (field->is_repeated()) AddElements(*field, 1);
        if (!SkipValue(number, wire_type, end, place.level)) return false;
        if (rest != nullptr) begin.Copy(cursor_.at() - begin.at(), rest);
        continue;
      }
      const std::optional<size_t> length = ReadLength(end);
      if (!length.has_value()) return false;
      if (packed) {
        Cursor values = cursor_;
        AddElements(*field, Packed(*field, *length, &values));
      } else if (field->is_repeated()) {
        AddElements(*field, 1);
      }
      if (!Value(*field, *length, {place.level + 1, onward}, rest)) return false;
    }
    return cursor_.at() == end;
  }

  // Of a known field with a length.
  bool Value(const FieldDescriptor& field, size_t length, const Place& place, std::string* rest) {
    if (field.message_type() != nullptr) {
      std::string inner;
      if (!Message(*field.message_type(), cursor_.at() + length, place,
                   rest == nullptr ? nullptr : &inner)) {
        return false;
      }
      if (rest == nullptr) return true;
      AppendLengthHead(field.number(), inner.size(), rest);
      *rest += inner;
      return true;
    }
    if (place.within != 0 && length >= least_) {
      large_ = true;
      if (!arrays_.empty()) {
        cursor_.Lift(length, &arrays_[static_cast<size_t>(std::countr_zero(place.within))]);
        return true;
      }
    }
    if (rest == nullptr) {
      cursor_.Skip(length);
    } else {
      AppendLengthHead(field.number(), length, rest);
      cursor_.Copy(length, rest);
    }
    return true;
  }

  // Of the paths that have led here, those that go on by the field.
  uint32_t Onward(int number, const Place& place) const {
    uint32_t onward = 0;
    for (size_t i = 0; i < paths_.size(); ++i) {
      const uint32_t bit = 1u << i;
      if ((place.within & bit) != 0 && paths_[i][static_cast<size_t>(place.level)] == number) {
        onward |= bit;
      }
    }
    return onward;
  }

  // Whether the field and one on the way are two of a oneof, of which the last one counts.
  bool Excludes(const Descriptor& type, const FieldDescriptor& field, const Place& place) const {
    if (field.containing_oneof() == nullptr) return false;
    for (size_t i = 0; i < paths_.size(); ++i) {
      if ((place.within & (1u << i)) == 0) continue;
      const int number = paths_[i][static_cast<size_t>(place.level)];
      if (type.FindFieldByNumber(number)->containing_oneof() == field.containing_oneof()) {
        return true;
      }
    }
    return false;
  }

  // Also beyond what is too many, so that an error can say how many.
  void AddElements(const FieldDescriptor& field, uint64_t elements) {
    const auto known = std::find_if(counts_.begin(), counts_.end(),
                                    [&](const Count& count) { return count.field == &field; });
    if (known != counts_.end()) {
      known->elements += elements;
    } else {
      counts_.push_back({&field, elements});
    }
  }
  static uint64_t Packed(const FieldDescriptor& field, size_t bytes, Cursor* values) {
    switch (WireTypeOf(field)) {
      case WireType::kFixed64:
        return bytes / 8;
      case WireType::kFixed32:
        return bytes / 4;
      default:
        return values->SkipVarints(bytes);
    }
  }

  // Of the five bytes that a tag may have protobuf takes 32 bits.
  bool ReadTag(int* number, WireType* wire_type) {
    const std::optional<uint64_t> tag = cursor_.ReadVarint(5);
    if (!tag.has_value()) return false;
    const auto bits = static_cast<uint32_t>(*tag);
    *number = static_cast<int>(bits >> 3);
    *wire_type = static_cast<WireType>(bits & 7);
    return *number != 0;
  }

  std::optional<size_t> ReadLength(size_t end) {
    const std::optional<uint64_t> length = cursor_.ReadVarint(5);
    if (!length.has_value() || cursor_.at() > end || *length > end - cursor_.at()) {
      return std::nullopt;
    }
    return static_cast<size_t>(*length);
  }

  // The tag has been read.
  bool SkipValue(int number, WireType wire_type, size_t end, int level) {
    size_t bytes = 0;
    switch (wire_type) {
      case WireType::kVarint:
        return cursor_.ReadVarint(10).has_value() && cursor_.at() <= end;
      case WireType::kFixed64:
        bytes = 8;
        break;
      case WireType::kFixed32:
        bytes = 4;
        break;
      case WireType::kLength: {
        const std::optional<size_t> length = ReadLength(end);
        if (!length.has_value()) return false;
        bytes = *length;
        break;
      }
      case WireType::kGroup:
        return SkipGroup(number, end, level + 1);
      default:
        return false;
    }
    if (cursor_.at() > end || bytes > end - cursor_.at()) return false;
    cursor_.Skip(bytes);
    return true;
  }

  bool SkipGroup(int number, size_t end, int level) {  // NOLINT(misc-no-recursion)
    if (level > kDeepest) return false;
    while (cursor_.at() < end) {
      int inner = 0;
      WireType wire_type;
      if (!ReadTag(&inner, &wire_type)) return false;
      if (wire_type == WireType::kEndGroup) return inner == number && cursor_.at() <= end;
      if (!SkipValue(inner, wire_type, end, level)) return false;
    }
    return false;
  }

  const std::vector<grpc::Slice>& slices_;
  Cursor cursor_;
  const std::span<const WirePath> paths_;
  const size_t least_;
  std::span<WireArray> arrays_;
  bool plain_ = true;  // What is on the way to an array is there once.
  bool large_ = false;
  bool unknown_ = false;
  std::vector<Count> counts_;  // A message's type has few repeated fields.
};

}  // namespace

absl::Status TooManyElements(const FieldDescriptor& field, uint64_t count, uint64_t most) {
  return InvalidField(field.full_name(), absl::StrCat(count, " elements"),
                      absl::StrCat("send fewer: no message of use has more than ", most));
}

absl::Status ReadRequest(grpc::ByteBuffer* buffer, std::span<const WirePath> paths,
                         const ElementLimit& elements, google::protobuf::Message* message,
                         std::span<WireArray> arrays, size_t least) {
  SIGHTLINE_CHECK_EQ(paths.size(), arrays.size());
  const Descriptor& type = *message->GetDescriptor();
  const size_t bytes = buffer->Length();
  std::vector<grpc::Slice> slices;
  bool parsed = buffer->Dump(&slices).ok();
  Scan scan(slices, paths, least);
  parsed = parsed && scan.Look(type, bytes);
  if (parsed && scan.elements() > elements.most) {
    buffer->Clear();
    const auto [field, count] = scan.most_elements();
    return elements.error ? elements.error(*field, count)
                          : TooManyElements(*field, count, elements.most);
  }
  if (parsed && (scan.liftable() || scan.unknown())) {
    parsed = message->ParseFromString(scan.Rewrite(type, bytes, arrays));
  } else if (parsed) {
    parsed = grpc::GenericDeserialize<grpc::ProtoBufferReader, google::protobuf::Message>(buffer,
                                                                                          message)
                 .ok();
  }
  buffer->Clear();
  if (parsed) return absl::OkStatus();
  for (WireArray& array : arrays) array = WireArray();
  return InvalidField("message", absl::StrCat(bytes, " bytes"),
                      absl::StrCat("must be a ", type.full_name()));
}

}  // namespace sightline

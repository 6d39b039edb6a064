// SPDX-License-Identifier: Apache-2.0
//
// The scan for large arrays against protobuf's own parser: on messages of every shape, whole,
// spoiled and cut into slices anywhere, both find the same fields or both refuse.
#include "server/codec/wire_request.h"

#include <google/protobuf/stubs/logging.h>

#include <algorithm>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"
#include "server/base/error.h"
#include "server/codec/wire_format.h"
#include "server/stream/segment_method.h"
#include "server/stream/shadow_method.h"
#include "server/stream/tile_method.h"
#include "tests/support/random.h"

namespace sightline {
namespace {

using google::protobuf::Message;
using testing_support::TestRng;

constexpr uint64_t kManyElements = 1 << 20;

grpc::ByteBuffer Slices(const std::string& bytes, TestRng& rng, size_t longest) {
  std::vector<grpc::Slice> slices;
  for (size_t at = 0; at < bytes.size();) {
    const size_t count = std::min<size_t>(bytes.size() - at, rng.Below(longest + 1));
    slices.emplace_back(bytes.data() + at, count);
    at += count;
  }
  return {slices.data(), slices.size()};
}

// The field that a path leads to, set to the array.
void PutBack(const WireArray& array, const WirePath& path, Message* message) {
  size_t depth = 0;
  const auto field = [&] { return message->GetDescriptor()->FindFieldByNumber(path[depth]); };
  for (; depth + 1 < path.size() && path[depth + 1] != 0; ++depth) {
    message = message->GetReflection()->MutableMessage(message, field());
  }
  std::string bytes(array.size(), '\0');
  CopyBytes(array, bytes.data());
  message->GetReflection()->SetString(message, field(), bytes);
}

struct Outcome {
  int lifted = 0;
  bool parsed = false;
};

// Reads `bytes` both ways and compares.
template <typename Method>
Outcome Compare(const std::string& bytes, TestRng& rng, size_t least) {
  const std::span<const WirePath> paths = Method::ArrayPaths();
  typename Method::Request expected, read;
  Outcome outcome;
  outcome.parsed = expected.ParseFromString(bytes);
  expected.DiscardUnknownFields();
  std::vector<WireArray> arrays(paths.size());
  grpc::ByteBuffer buffer = Slices(bytes, rng, 1 + rng.Below(64));
  const absl::Status status = ReadRequest(&buffer, paths, {kManyElements}, &read, arrays, least);
  EXPECT_EQ(status.ok(), outcome.parsed) << status;
  EXPECT_EQ(buffer.Length(), 0u);
  if (!status.ok()) {
    EXPECT_EQ(ReasonOf(status), v1::ERROR_REASON_INVALID_FIELD);
    for (const WireArray& array : arrays) EXPECT_TRUE(array.empty());
    return outcome;
  }
  for (size_t i = 0; i < paths.size(); ++i) {
    if (arrays[i].empty()) continue;
    EXPECT_GE(arrays[i].size(), least);
    PutBack(arrays[i], paths[i], &read);
    ++outcome.lifted;
  }
  EXPECT_EQ(read.SerializeAsString(), expected.SerializeAsString());
  return outcome;
}

std::string RandomBytes(TestRng& rng, size_t most) {
  std::string bytes(rng.Below(most + 1), '\0');
  for (char& byte : bytes) byte = static_cast<char>(rng.Below(256));
  return bytes;
}

void FillHeader(TestRng& rng, v1::ItemHeader* header) {
  if (rng.Chance(0.8)) header->set_item_id(rng());
  if (rng.Chance(0.3)) header->set_priority(static_cast<int32_t>(rng.Below(200)) - 100);
  if (rng.Chance(0.3)) header->mutable_timeout()->set_seconds(5);
}

v1::TestSegmentsRequest RandomSegments(TestRng& rng) {
  v1::TestSegmentsRequest request;
  if (rng.Chance(0.1)) {
    request.mutable_header()->mutable_stream()->set_scene("scenes/a");
  } else if (rng.Chance(0.1)) {
    request.mutable_cancel()->add_item_ids(7);
  } else {
    if (rng.Chance(0.9)) FillHeader(rng, request.mutable_item()->mutable_item());
    if (rng.Chance(0.7)) request.mutable_item()->set_segments(RandomBytes(rng, 300));
    if (rng.Chance(0.5)) request.mutable_item()->set_segments_f32(RandomBytes(rng, 300));
  }
  return request;
}

v1::ComputeShadowsRequest RandomPoints(TestRng& rng) {
  v1::ComputeShadowsRequest request;
  if (rng.Chance(0.1)) {
    request.mutable_header()->add_lights()->mutable_point()->mutable_position()->set_x(1);
    return request;
  }
  v1::ShadowItem* const item = request.mutable_item();
  if (rng.Chance(0.9)) FillHeader(rng, item->mutable_item());
  if (rng.Chance(0.1)) {
    item->mutable_point_set_range()->set_point_set("scenes/a/pointSets/b");
    return request;
  }
  item->mutable_points()->set_points(RandomBytes(rng, 300));
  if (rng.Chance(0.5)) item->mutable_points()->set_normals(RandomBytes(rng, 300));
  if (rng.Chance(0.5)) item->mutable_points()->set_source_objects(RandomBytes(rng, 300));
  if (rng.Chance(0.5)) item->mutable_points()->set_source_triangles(RandomBytes(rng, 300));
  return request;
}

// Changes a few bytes, cuts, repeats or drops a piece, or adds fields or a group that nobody knows.
std::string Spoil(std::string bytes, TestRng& rng) {
  if (bytes.empty()) return bytes;
  const size_t at = rng.Below(bytes.size());
  const size_t count = rng.Below(std::min<size_t>(bytes.size() - at, 32) + 1);
  switch (rng.Below(7)) {
    case 0:
      bytes.resize(at);
      break;
    case 1:
      bytes.insert(rng.Below(bytes.size() + 1), bytes.substr(at, count));
      break;
    case 2:
      bytes.erase(at, count);
      break;
    case 3:
      AppendLengthHead(static_cast<int>(1 + rng.Below(40)), rng.Below(4), &bytes);
      break;
    case 4: {
      const auto number = static_cast<uint32_t>(1 + rng.Below(40));
      std::string group;
      AppendVarint(number << 3 | static_cast<uint32_t>(WireType::kGroup), &group);
      AppendLengthHead(3, 0, &group);
      AppendVarint(
          (number + (rng.Chance(0.2) ? 1 : 0)) << 3 | static_cast<uint32_t>(WireType::kEndGroup),
          &group);
      bytes.insert(rng.Chance(0.5) ? 0 : bytes.size(), group);
      break;
    }
    default:
      // Mostly where tags and lengths are.
      for (size_t i = 0; i <= rng.Below(3); ++i) {
        bytes[rng.Chance(0.7) ? rng.Below(std::min<size_t>(bytes.size(), 24))
                              : rng.Below(bytes.size())] = static_cast<char>(rng.Below(256));
      }
      break;
  }
  return bytes;
}

// Protobuf says on stderr whatever does not parse.
class WireRequestTest : public testing::Test {
 protected:
  WireRequestTest() : old_handler_(google::protobuf::SetLogHandler(nullptr)) {}
  ~WireRequestTest() override { google::protobuf::SetLogHandler(old_handler_); }

  template <typename Method, typename Make>
  void CompareMany(const Make& make) {
    TestRng rng;
    int lifted = 0, refused = 0, both = 0;
    for (int i = 0; i < 20'000; ++i) {
      std::string bytes = make(rng).SerializeAsString();
      // Two messages in a row are their merge.
      if (rng.Chance(0.2)) bytes += make(rng).SerializeAsString();
      if (rng.Chance(0.6)) bytes = Spoil(std::move(bytes), rng);
      const Outcome outcome = Compare<Method>(bytes, rng, rng.Below(3) * 50);
      lifted += outcome.lifted;
      both += outcome.lifted > 0 && outcome.parsed ? 1 : 0;
      refused += outcome.parsed ? 0 : 1;
      if (testing::Test::HasFailure()) return;
    }
    // All of it was met.
    EXPECT_GT(both, 5000);
    EXPECT_GE(lifted, both);
    EXPECT_GT(refused, 500);
  }

 private:
  google::protobuf::LogHandler* const old_handler_;
};

TEST_F(WireRequestTest, SegmentsAreReadAsProtobufReadsThem) {
  CompareMany<SegmentMethod>(RandomSegments);
}

TEST_F(WireRequestTest, PointsAreReadAsProtobufReadsThem) {
  CompareMany<ShadowMethod>(RandomPoints);
}

// What is not plain is protobuf's: nothing is lifted, and the last or the merge of both counts.
TEST_F(WireRequestTest, WhatComesTwiceIsLeftToProtobuf) {
  TestRng rng;
  v1::TestSegmentsRequest request;
  request.mutable_item()->set_segments(std::string(96, 'a'));
  const std::string once = request.SerializeAsString();
  EXPECT_EQ(Compare<SegmentMethod>(once, rng, 1).lifted, 1);
  EXPECT_EQ(Compare<SegmentMethod>(once + once, rng, 1).lifted, 0);
  v1::TestSegmentsRequest header;
  header.mutable_header()->mutable_stream()->set_scene("scenes/a");
  EXPECT_EQ(Compare<SegmentMethod>(header.SerializeAsString() + once, rng, 1).lifted, 0);
  EXPECT_EQ(Compare<SegmentMethod>(once + header.SerializeAsString(), rng, 1).lifted, 0);
  v1::ShadowItem points, range;
  points.mutable_points()->set_points(std::string(48, 'p'));
  range.mutable_point_set_range()->set_count(1);
  const auto shadows = [](const std::string& item) {
    std::string bytes;
    AppendLengthHead(v1::ComputeShadowsRequest::kItemFieldNumber, item.size(), &bytes);
    return bytes + item;
  };
  EXPECT_EQ(Compare<ShadowMethod>(shadows(points.SerializeAsString()), rng, 1).lifted, 1);
  for (const std::string& item : {points.SerializeAsString() + range.SerializeAsString(),
                                  range.SerializeAsString() + points.SerializeAsString(),
                                  points.SerializeAsString() + points.SerializeAsString()}) {
    EXPECT_EQ(Compare<ShadowMethod>(shadows(item), rng, 1).lifted, 0);
  }
}

// An array that is long enough stays in the slices that it came in; one that is not is copied.
TEST_F(WireRequestTest, LargeArraysStayWhereTheyCame) {
  for (const size_t bytes : {kLeastLifted - 48, kLeastLifted + 48}) {
    v1::TestSegmentsRequest request;
    request.mutable_item()->mutable_item()->set_item_id(9);
    request.mutable_item()->set_segments(std::string(bytes / 48 * 48, 's'));
    const std::string whole = request.SerializeAsString();
    const grpc::Slice slice(whole);
    grpc::ByteBuffer buffer(&slice, 1);
    v1::TestSegmentsRequest read;
    SegmentMethod::Item item;
    ASSERT_TRUE(SegmentMethod::Read(&buffer, {kManyElements}, &read, &item).ok());
    EXPECT_EQ(item.message.item().item_id(), 9u);
    EXPECT_EQ(item.segments.size(), bytes / 48 * 48);
    ASSERT_EQ(item.segments.pieces().size(), 1u);
    const uint8_t* const where = item.segments.pieces()[0].slice.begin();
    EXPECT_EQ(where >= slice.begin() && where<slice.end(), bytes> kLeastLifted);
  }
}

// Each form of segments stays apart from the other.
TEST_F(WireRequestTest, StoredSegmentsStayWhereTheyCame) {
  v1::TestSegmentsRequest request;
  request.mutable_item()->set_segments_f32(std::string(2 * kLeastLifted, 's'));
  const grpc::Slice slice(request.SerializeAsString());
  grpc::ByteBuffer buffer(&slice, 1);
  v1::TestSegmentsRequest read;
  SegmentMethod::Item item;
  ASSERT_TRUE(SegmentMethod::Read(&buffer, {kManyElements}, &read, &item).ok());
  EXPECT_TRUE(item.segments.empty());
  ASSERT_EQ(item.stored_segments.size(), 2 * kLeastLifted);
  const uint8_t* const where = item.stored_segments.pieces()[0].slice.begin();
  EXPECT_TRUE(where >= slice.begin() && where < slice.end());
}

// Of nothing that the server knows: two bytes each on the wire, which protobuf keeps in seventy.
std::string UnknownFields(size_t bytes) {
  std::string fields;
  while (fields.size() < bytes) AppendLengthHead(15, 0, &fields);
  return fields;
}

template <typename Method>
size_t HeldOf(const std::string& bytes) {
  const grpc::Slice slice(bytes);
  grpc::ByteBuffer buffer(&slice, 1);
  typename Method::Request request;
  typename Method::Item item;
  const absl::Status status = Method::Read(&buffer, {kManyElements}, &request, &item);
  EXPECT_TRUE(status.ok()) << status;
  return request.SpaceUsedLong() + item.message.SpaceUsedLong();
}

// Wherever they stand, and whatever else is wrong with the message's shape.
TEST_F(WireRequestTest, UnknownFieldsTakeNoMemory) {
  constexpr size_t kBytes = 1 << 20, kFew = 2048;
  const std::string junk = UnknownFields(kBytes);
  const auto within = [](int field, const std::string& inner) {
    std::string bytes;
    AppendLengthHead(field, inner.size(), &bytes);
    return bytes + inner;
  };
  v1::TileItem tile;
  tile.mutable_item()->set_item_id(1);
  tile.set_width(8);
  const std::string item = tile.SerializeAsString();
  EXPECT_LT(HeldOf<TileMethod>(within(2, item + junk)), kFew);
  EXPECT_LT(HeldOf<TileMethod>(within(2, item) + junk), kFew);
  EXPECT_LT(HeldOf<TileMethod>(within(2, junk + item + within(1, junk))), kFew);
  EXPECT_LT(HeldOf<TileMethod>(within(2, item + junk) + within(2, item + junk)), kFew);
  // Right numbers with wrong types are unknown as well.
  std::string mistyped;
  while (mistyped.size() < kBytes) mistyped += within(4, "") + within(5, "");
  EXPECT_LT(HeldOf<TileMethod>(within(2, item + mistyped)), kFew);
  // Beside an array that is lifted, one that is not, and two of one oneof.
  for (const size_t array : {size_t{96}, 2 * kLeastLifted}) {
    v1::SegmentItem segments;
    segments.set_segments(std::string(array, 's'));
    const std::string some = segments.SerializeAsString();
    EXPECT_LT(HeldOf<SegmentMethod>(within(2, some + junk)), kFew + array);
    EXPECT_LT(HeldOf<SegmentMethod>(within(2, some + junk + some)), kFew + array);
    EXPECT_LT(HeldOf<SegmentMethod>(within(1, junk) + within(2, some + junk)), kFew + array);
  }
}

// An empty light is two bytes on the wire, and eighty in memory.
TEST_F(WireRequestTest, ElementsAreCountedBeforeTheyAreMade) {
  const auto read = [](const v1::ComputeShadowsRequest& sent, uint64_t most) {
    const grpc::Slice slice(sent.SerializeAsString());
    grpc::ByteBuffer buffer(&slice, 1);
    v1::ComputeShadowsRequest request;
    ShadowMethod::Item item;
    const absl::Status status = ShadowMethod::Read(&buffer, {most}, &request, &item);
    EXPECT_EQ(buffer.Length(), 0u);
    EXPECT_EQ(status.ok(), request.ByteSizeLong() > 0);
    return status;
  };
  v1::ComputeShadowsRequest lights, ids;
  for (uint64_t i = 0; i < 1000; ++i) {
    lights.mutable_header()->add_lights();
    ids.mutable_cancel()->add_item_ids(i);
  }
  for (const auto& message : {lights, ids}) {
    EXPECT_TRUE(read(message, 1000).ok());
    const absl::Status status = read(message, 999);
    EXPECT_EQ(ReasonOf(status), v1::ERROR_REASON_INVALID_FIELD);
    EXPECT_TRUE(absl::StrContains(status.message(), "1000 elements")) << status;
    EXPECT_TRUE(absl::StrContains(status.message(), "more than 999")) << status;
    EXPECT_TRUE(absl::StrContains(status.message(), message.has_header() ? "lights" : "item_ids"));
  }
  // Not packed, as protobuf reads them, too.
  std::string unpacked, cancel;
  for (int i = 0; i < 1000; ++i) unpacked += {8, 7};
  AppendLengthHead(v1::ComputeShadowsRequest::kCancelFieldNumber, unpacked.size(), &cancel);
  ASSERT_TRUE(ids.ParseFromString(cancel + unpacked));
  const grpc::Slice slice(cancel + unpacked);
  for (const uint64_t most : {999, 1000}) {
    grpc::ByteBuffer buffer(&slice, 1);
    v1::ComputeShadowsRequest request;
    ShadowMethod::Item item;
    EXPECT_EQ(ShadowMethod::Read(&buffer, {most}, &request, &item).ok(), most == 1000);
  }
}

// As one that has a few too many of them is: by the limit's name and value.
TEST_F(WireRequestTest, ElementsFarBeyondALimitAreToldOfIt) {
  const Limits limits;
  const auto read = [&](const v1::ComputeShadowsRequest& sent) {
    const grpc::Slice slice(sent.SerializeAsString());
    grpc::ByteBuffer buffer(&slice, 1);
    v1::ComputeShadowsRequest request;
    ShadowMethod::Item item;
    return ShadowMethod::Read(&buffer, MostElements(limits), &request, &item);
  };
  v1::ComputeShadowsRequest lights, ids;
  const uint64_t count = MostElements(limits).most + 1000;
  for (uint64_t i = 0; i < count; ++i) {
    lights.mutable_header()->add_lights();
    ids.mutable_cancel()->add_item_ids(i);
  }
  v1::ItemStatus told;
  ToItemStatus(read(lights), &told);
  EXPECT_EQ(told.code(), static_cast<int>(absl::StatusCode::kResourceExhausted));
  EXPECT_EQ(told.reason(), v1::ERROR_REASON_LIMIT_EXCEEDED);
  EXPECT_EQ(told.metadata().at("limit"), "max_lights");
  EXPECT_EQ(told.metadata().at("limit_value"), absl::StrCat(limits.max_lights));
  EXPECT_EQ(told.metadata().at("value"), absl::StrCat(count));
  EXPECT_EQ(read(ids).message(), CheckCancelled(count, limits).message());
}

}  // namespace
}  // namespace sightline

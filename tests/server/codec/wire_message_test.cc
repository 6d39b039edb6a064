// SPDX-License-Identifier: Apache-2.0
#include "server/codec/wire_message.h"

#include <cstring>
#include <string>
#include <utility>
#include <vector>

#include "gtest/gtest.h"
#include "server/stream/item_reply.h"
#include "sightline/v1/visibility_service.pb.h"
#include "tests/support/random.h"

namespace sightline {
namespace {

using testing_support::TestRng;

std::vector<grpc::Slice> SlicesOf(const grpc::ByteBuffer& buffer) {
  std::vector<grpc::Slice> slices;
  EXPECT_TRUE(buffer.Dump(&slices).ok());
  return slices;
}

std::string Joined(const grpc::ByteBuffer& buffer) {
  std::string bytes;
  for (const grpc::Slice& slice : SlicesOf(buffer)) {
    bytes.append(reinterpret_cast<const char*>(slice.begin()), slice.size());
  }
  return bytes;
}

std::vector<float> Floats(TestRng& rng, size_t count) {
  std::vector<float> values(count);
  for (float& value : values) value = rng.AnyFloat();
  return values;
}

std::string BytesOf(const std::vector<float>& values) {
  return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(float)};
}

// What goes out for a reply of arrays around every length at which its form changes is, byte for
// byte, what the generated class writes for it, and reads back as that.
TEST(WireMessageTest, RepliesAreThoseOfTheGeneratedClass) {
  TestRng rng;
  for (const size_t count : {0, 1, 31, 32, 1023, 1024, 1025, 4096, 70'000}) {
    for (int seed = 0; seed < 8; ++seed) {
      v1::TraceTilesResponse expected;
      v1::TileReply* const reply = expected.mutable_reply();
      reply->mutable_header()->set_item_id(rng());
      reply->mutable_header()->set_offset(rng.Below(1 << 20) * 8);
      reply->mutable_header()->set_element_count(count);
      reply->mutable_header()->mutable_status()->set_message(std::string(rng.Below(9), 'x'));
      ItemReply ours;
      WireMessage tile, shadows;
      reply->mutable_tile();
      if (rng.Chance(0.7)) {
        const std::vector<float> depths = Floats(rng, count);
        reply->mutable_tile()->set_depths(BytesOf(depths));
        tile.AddArray(v1::TileResult::kDepthsFieldNumber, WireArray(depths));
      }
      if (rng.Chance(0.7)) {
        const std::vector<float> u = Floats(rng, count);
        reply->mutable_tile()->set_barycentric_u(BytesOf(u));
        tile.AddArray(v1::TileResult::kBarycentricUFieldNumber, WireArray(u));
      }
      ours.Add(v1::TileReply::kTileFieldNumber, std::move(tile));
      if (rng.Chance(0.5)) {
        const std::string bits(count, '\5');
        reply->mutable_shadows()->set_lit_bits(bits);
        shadows.AddArray(v1::ShadowResult::kLitBitsFieldNumber, WireArray(bits));
        v1::ShadowResult samples;
        samples.add_invalid_samples(3);
        samples.add_invalid_samples(70'000);
        reply->mutable_shadows()->MergeFrom(samples);
        shadows.AddFields(samples);
        ours.Add(v1::TileReply::kShadowsFieldNumber, std::move(shadows));
      }
      const grpc::ByteBuffer sent = ReplyBytes(reply->header(), std::move(ours));
      const std::string bytes = Joined(sent);
      EXPECT_EQ(sent.Length(), bytes.size());
      EXPECT_EQ(bytes, expected.SerializeAsString()) << count << " elements";
      v1::TraceTilesResponse read;
      ASSERT_TRUE(read.ParseFromString(bytes));
      EXPECT_EQ(read.SerializeAsString(), expected.SerializeAsString());
    }
  }
}

// What is said of a whole item when its last reply is there already.
TEST(WireMessageTest, FieldsAreAddedToAResultOrMakeOne) {
  v1::ShadowResult whole;
  whole.set_near_surface_point_count(7);
  ItemReply with, without;
  WireMessage shadows;
  shadows.AddArray(v1::ShadowResult::kLitBitsFieldNumber, WireArray(std::string("\1\2")));
  with.Add(v1::ShadowReply::kShadowsFieldNumber, std::move(shadows));
  with.AddFields(v1::ShadowReply::kShadowsFieldNumber, whole);
  without.AddFields(v1::ShadowReply::kShadowsFieldNumber, whole);
  v1::ComputeShadowsResponse response;
  ASSERT_TRUE(response.ParseFromString(Joined(ReplyBytes({}, std::move(with)))));
  EXPECT_EQ(response.reply().shadows().lit_bits(), "\1\2");
  EXPECT_EQ(response.reply().shadows().near_surface_point_count(), 7u);
  ASSERT_TRUE(response.ParseFromString(Joined(ReplyBytes({}, std::move(without)))));
  EXPECT_EQ(response.reply().shadows().lit_bits(), "");
  EXPECT_EQ(response.reply().shadows().near_surface_point_count(), 7u);
}

// A large array goes out from where it was computed; a small one beside the rest.
TEST(WireMessageTest, LargeArraysAreNotCopied) {
  std::vector<float> large(10'000, 1.5f);
  const void* const where = large.data();
  WireMessage tile;
  tile.AddArray(v1::TileResult::kDepthsFieldNumber, WireArray(std::move(large)));
  ItemReply reply;
  reply.Add(v1::TileReply::kTileFieldNumber, std::move(tile));
  const grpc::ByteBuffer sent = ReplyBytes({}, std::move(reply));
  const std::vector<grpc::Slice> slices = SlicesOf(sent);
  ASSERT_EQ(slices.size(), 2u);
  EXPECT_EQ(slices[1].begin(), where);
  EXPECT_EQ(slices[1].size(), 40'000u);
}

TEST(WireArrayTest, CopiesAnyRangeOfItsPieces) {
  TestRng rng;
  std::string bytes(1000, '\0');
  for (char& byte : bytes) byte = static_cast<char>(rng.Below(256));
  WireArray array;
  for (size_t at = 0; at < bytes.size();) {
    const size_t count = std::min<size_t>(bytes.size() - at, rng.Below(40));
    array.Append(grpc::Slice(bytes.data() + at, count));
    at += count;
  }
  ASSERT_EQ(array.size(), bytes.size());
  for (int i = 0; i < 2000; ++i) {
    const size_t begin = rng.Below(bytes.size() + 1), count = rng.Below(bytes.size() - begin + 1);
    std::string copy(count, '\0');
    array.Copy(begin, count, copy.data());
    EXPECT_EQ(copy, bytes.substr(begin, count));
  }
  EXPECT_TRUE(WireArray(std::string()).empty());
  EXPECT_TRUE(WireArray(std::vector<float>()).empty());
}

}  // namespace
}  // namespace sightline

// SPDX-License-Identifier: Apache-2.0
#include "client/import/decompress.h"

#include <string>

#include "gtest/gtest.h"
#include "tests/client/import/import_testing.h"

namespace sightline {
namespace {

using import_testing::Gzip;
using import_testing::Xz;

struct Codec {
  const char* name;
  std::string (*compress)(std::string_view);
  absl::StatusOr<std::string> (*decompress)(std::string_view, uint64_t, const CancelToken*);
};

class DecompressTest : public testing::TestWithParam<Codec> {
 protected:
  std::string Compress(std::string_view text) const { return GetParam().compress(text); }
  absl::StatusOr<std::string> Decompress(std::string_view bytes, uint64_t limit = 1 << 24,
                                         const CancelToken* cancel = nullptr) const {
    return GetParam().decompress(bytes, limit, cancel);
  }
};

std::string Text() {
  std::string text;
  for (int i = 0; i < 4000; ++i) text += std::to_string(i * 2654435761u) + "\n";
  return text;
}

TEST_P(DecompressTest, GivesBackWhatWentIn) {
  const std::string text = Text();
  EXPECT_EQ(Decompress(Compress(text)).value_or("error"), text);
  EXPECT_EQ(Decompress(Compress("")).value_or("error"), "");
}

TEST_P(DecompressTest, ReadsSeveralStreamsInOneFile) {
  EXPECT_EQ(Decompress(Compress("one ") + Compress("two")).value_or("error"), "one two");
}

TEST_P(DecompressTest, KeepsToTheLimit) {
  const std::string text = Text();
  EXPECT_TRUE(Decompress(Compress(text), text.size()).ok());
  EXPECT_IMPORT_ERROR(Decompress(Compress(text), text.size() - 1).status(), kResourceExhausted,
                      "max_file_bytes");
  EXPECT_IMPORT_ERROR(Decompress(Compress(std::string(4 << 20, '\0')), 1000).status(),
                      kResourceExhausted, "1000");
}

// In parts, between which it looks: more than one of them.
TEST_P(DecompressTest, IsGivenUpOnceNobodyWantsIt) {
  const std::string zeros(5 << 20, '\0');
  CancelToken cancel;
  EXPECT_EQ(Decompress(Compress(zeros), 1 << 24, &cancel).value_or("error"), zeros);
  cancel.Cancel();
  EXPECT_EQ(Decompress(Compress(zeros), 1 << 24, &cancel).status().code(),
            absl::StatusCode::kCancelled);
}

TEST_P(DecompressTest, ReportsTruncationAndDamage) {
  const std::string whole = Compress(Text());
  for (const size_t size : {size_t{0}, size_t{1}, size_t{5}, whole.size() / 2, whole.size() - 1}) {
    EXPECT_EQ(Decompress(whole.substr(0, size)).status().code(), absl::StatusCode::kDataLoss)
        << size;
  }
  std::string damaged = whole;
  damaged[damaged.size() / 2] ^= 0x55;
  EXPECT_EQ(Decompress(damaged).status().code(), absl::StatusCode::kDataLoss);
  EXPECT_IMPORT_ERROR(Decompress("v 0 0 0\nv 1 0 0\n").status(), kDataLoss, "is not a");
  EXPECT_EQ(Decompress(whole + "garbage").status().code(), absl::StatusCode::kDataLoss);
}

INSTANTIATE_TEST_SUITE_P(Codecs, DecompressTest,
                         testing::Values(Codec{"xz", &Xz, &DecompressXz},
                                         Codec{"gzip", &Gzip, &DecompressGzip}),
                         [](const auto& info) { return info.param.name; });

TEST(DecompressGzipTest, IgnoresZerosAfterTheLastMember) {
  EXPECT_EQ(DecompressGzip(Gzip("x") + std::string(10, '\0'), 100).value_or("error"), "x");
}

}  // namespace
}  // namespace sightline

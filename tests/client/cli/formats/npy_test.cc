// SPDX-License-Identifier: Apache-2.0
#include "client/cli/formats/npy.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/support/random.h"
#include "tests/support/temp_dir.h"

namespace sightline::cli {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using testing_support::TestRng;

// A file as NumPy writes it, with the header given word for word.
std::string File(const std::string& header, const std::string& data, int version = 1) {
  std::string bytes("\x93NUMPY", 6);
  bytes += static_cast<char>(version);
  bytes += '\0';
  const size_t length = header.size();
  for (int i = 0; i < (version == 1 ? 2 : 4); ++i)
    bytes += static_cast<char>((length >> (8 * i)) & 255);
  return bytes + header + data;
}

std::string Header(const std::string& descr, bool fortran, const std::string& shape) {
  return absl::StrCat("{'descr': '", descr, "', 'fortran_order': ", fortran ? "True" : "False",
                      ", 'shape': ", shape, ", }\n");
}

template <typename T>
std::string Bytes(std::initializer_list<T> values, bool big_endian = false) {
  std::string bytes;
  for (T value : values) {
    char raw[sizeof(T)];
    std::memcpy(raw, &value, sizeof(T));
    if (big_endian) std::reverse(raw, raw + sizeof(T));
    bytes.append(raw, sizeof(T));
  }
  return bytes;
}

std::string NpyError(const std::string& bytes) {
  const absl::StatusOr<NpyArray> array = ParseNpy(bytes, "P.npy");
  EXPECT_FALSE(array.ok());
  EXPECT_EQ(array.status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(array.status().message()), HasSubstr("P.npy"));
  return std::string(array.status().message());
}

TEST(NpyTest, WriterGivesTheBytesOfNumpySave) {
  // np.save of np.array([[1, 0, 255], [2, 3, 4]], dtype=np.uint8), byte by byte.
  const uint8_t values[] = {1, 0, 255, 2, 3, 4};
  const size_t shape[] = {2, 3};
  const std::string bytes = FormatNpy<uint8_t>(shape, values);
  std::string expected("\x93NUMPY\x01\x00\x76\x00", 10);
  expected += "{'descr': '|u1', 'fortran_order': False, 'shape': (2, 3), }";
  expected.resize(127, ' ');
  expected += '\n';
  expected += std::string("\x01\x00\xff\x02\x03\x04", 6);
  EXPECT_EQ(bytes, expected);
}

TEST(NpyTest, ReadsWhatItWrites) {
  const double values[] = {1.5, -2, 1e300, 0.1, 4, 5};
  const size_t shape[] = {3, 2};
  const absl::StatusOr<NpyArray> array = ParseNpy(FormatNpy<double>(shape, values), "x");
  ASSERT_TRUE(array.ok()) << array.status();
  EXPECT_EQ(array->dtype, "<f8");
  EXPECT_THAT(array->shape, ElementsAre(3, 2));
  EXPECT_THAT(array->values, testing::ElementsAreArray(values));
}

TEST(NpyTest, ReadsEveryTypeInBothByteOrders) {
  for (bool big : {false, true}) {
    const std::string order = big ? ">" : "<";
    const auto read = [&](const std::string& type, const std::string& data) {
      const absl::StatusOr<NpyArray> array =
          ParseNpy(File(Header(order + type, false, "(2,)"), data), "x");
      EXPECT_TRUE(array.ok()) << type << " " << array.status();
      return array.ok() ? array->values : std::vector<double>();
    };
    EXPECT_THAT(read("f8", Bytes<double>({1.25, -1e-300}, big)), ElementsAre(1.25, -1e-300));
    EXPECT_THAT(read("f4", Bytes<float>({1.25f, -0.1f}, big)), ElementsAre(1.25, double{-0.1f}));
    // 1.5, and the smallest subnormal half, 2^-24.
    EXPECT_THAT(read("f2", Bytes<uint16_t>({0x3E00, 0x0001}, big)), ElementsAre(1.5, 0x1p-24));
    EXPECT_THAT(read("i8", Bytes<int64_t>({-5, int64_t{1} << 53}, big)), ElementsAre(-5, 0x1p53));
    EXPECT_THAT(read("i4", Bytes<int32_t>({-5, 7}, big)), ElementsAre(-5, 7));
    EXPECT_THAT(read("i2", Bytes<int16_t>({-5, 7}, big)), ElementsAre(-5, 7));
    EXPECT_THAT(read("i1", Bytes<int8_t>({-5, 7}, big)), ElementsAre(-5, 7));
    EXPECT_THAT(read("u8", Bytes<uint64_t>({5, 7}, big)), ElementsAre(5, 7));
    EXPECT_THAT(read("u4", Bytes<uint32_t>({5, 4000000000u}, big)), ElementsAre(5, 4e9));
    EXPECT_THAT(read("u1", Bytes<uint8_t>({5, 255}, big)), ElementsAre(5, 255));
  }
}

TEST(NpyTest, FortranOrderComesOutInCOrder) {
  // Column by column: [[1, 3, 5], [2, 4, 6]].
  const absl::StatusOr<NpyArray> array =
      ParseNpy(File(Header("<f8", true, "(2, 3)"), Bytes<double>({1, 2, 3, 4, 5, 6})), "x");
  ASSERT_TRUE(array.ok()) << array.status();
  EXPECT_THAT(array->values, ElementsAre(1, 3, 5, 2, 4, 6));
}

TEST(NpyTest, FortranOrderOfThreeDimensions) {
  std::string data;
  // Element (i, j, k) of a (2, 3, 2) array holds 100 i + 10 j + k.
  for (int k = 0; k < 2; ++k) {
    for (int j = 0; j < 3; ++j) {
      for (int i = 0; i < 2; ++i) data += Bytes<double>({100.0 * i + 10.0 * j + k});
    }
  }
  const absl::StatusOr<NpyArray> array =
      ParseNpy(File(Header("<f8", true, "(2, 3, 2)"), data), "x");
  ASSERT_TRUE(array.ok()) << array.status();
  EXPECT_THAT(array->values, ElementsAre(0, 1, 10, 11, 20, 21, 100, 101, 110, 111, 120, 121));
}

TEST(NpyTest, VersionsTwoAndThreeAndOddHeaders) {
  const std::string data = Bytes<double>({1, 2, 3});
  for (int version : {2, 3}) {
    EXPECT_TRUE(ParseNpy(File(Header("<f8", false, "(1, 3)"), data, version), "x").ok()) << version;
  }
  // Keys in another order, double quotes, Python 2's long integers, no trailing comma.
  EXPECT_TRUE(
      ParseNpy(File("{\"shape\":(1L,3L),\"fortran_order\":False , 'descr' : '<f8'}", data), "x")
          .ok());
}

TEST(NpyTest, ScalarsAndEmptyArrays) {
  absl::StatusOr<NpyArray> scalar =
      ParseNpy(File(Header("<f8", false, "()"), Bytes<double>({4})), "x");
  ASSERT_TRUE(scalar.ok()) << scalar.status();
  EXPECT_THAT(scalar->values, ElementsAre(4));
  EXPECT_TRUE(scalar->shape.empty());
  absl::StatusOr<NpyArray> empty = ParseNpy(File(Header("<f8", false, "(0, 3)"), ""), "x");
  ASSERT_TRUE(empty.ok()) << empty.status();
  EXPECT_THAT(empty->shape, ElementsAre(0, 3));
  EXPECT_TRUE(empty->values.empty());
}

TEST(NpyTest, HostileFilesGetErrorsThatSayWhy) {
  EXPECT_THAT(NpyError(""), HasSubstr("empty"));
  EXPECT_THAT(NpyError("1,2,3\n"), HasSubstr("np.save"));
  EXPECT_THAT(NpyError(std::string("\x93NUMPY\x01", 7)), HasSubstr("ends within"));
  EXPECT_THAT(NpyError(File(Header("<f8", false, "(1,)"), Bytes<double>({1}), 9)),
              HasSubstr("version 9"));
  // A header length beyond the file, and one beyond sense.
  EXPECT_THAT(NpyError(std::string("\x93NUMPY\x02\x00\xff\xff\xff\x7f", 12)),
              HasSubstr("ends within"));
  EXPECT_THAT(NpyError(File(std::string(20000, ' '), "", 2)), HasSubstr("20000"));
  EXPECT_THAT(NpyError(File("nonsense", "")), HasSubstr("dictionary"));
  EXPECT_THAT(NpyError(File("{'descr': '<f8'}", "")), HasSubstr("lacks"));
  EXPECT_THAT(
      NpyError(File("{'descr': [('x', '<f8')], 'fortran_order': False, 'shape': (1,)}", "")),
      HasSubstr("records"));
  EXPECT_THAT(NpyError(File(Header("|O", false, "(1,)"), "x")), HasSubstr("astype"));
  EXPECT_THAT(NpyError(File(Header("<c16", false, "(1,)"), "x")), HasSubstr("<c16"));
  EXPECT_THAT(NpyError(File(Header("<f8", false, "(-1,)"), "x")), HasSubstr("shape"));
  EXPECT_THAT(NpyError(File(Header("<f8", false, "(99999999999999999999,)"), "x")),
              HasSubstr("shape"));
  // A shape whose product overflows must not be believed.
  EXPECT_THAT(NpyError(File(Header("<f8", false, "(4294967296, 4294967296)"), Bytes<double>({1}))),
              HasSubstr("cut short"));
  EXPECT_THAT(NpyError(File(Header("<f8", false, "(2, 3)"), Bytes<double>({1, 2, 3, 4, 5}))),
              testing::AllOf(HasSubstr("(2, 3)"), HasSubstr("<f8"), HasSubstr("40 bytes")));
  EXPECT_THAT(NpyError(File(Header("<f8", false, "(1,)"), Bytes<double>({1, 2}))),
              HasSubstr("16 bytes"));
  EXPECT_THAT(NpyError(File(Header("<f8", false, "()"), "")), HasSubstr("cut short"));
  EXPECT_THAT(
      NpyError(File(Header("<i8", false, "(1,)"), Bytes<int64_t>({(int64_t{1} << 53) + 1}))),
      HasSubstr("2^53"));
}

TEST(NpyTest, NoFlippedOrCutFileCrashes) {
  TestRng rng;
  const double values[] = {1, 2, 3, 4, 5, 6};
  const size_t shape[] = {2, 3};
  const std::string good = FormatNpy<double>(shape, values);
  int accepted = 0;
  for (int i = 0; i < 20000; ++i) {
    std::string bytes = good;
    for (uint64_t k = rng.Below(4) + 1; k > 0; --k) {
      bytes[rng.Below(bytes.size())] = static_cast<char>(rng.Below(256));
    }
    if (rng.Chance(0.3)) bytes.resize(rng.Below(bytes.size()));
    const absl::StatusOr<NpyArray> array = ParseNpy(bytes, "x");
    if (!array.ok()) continue;
    ++accepted;
    size_t count = 1;
    for (size_t n : array->shape) count *= n;
    EXPECT_EQ(count, array->values.size());
  }
  EXPECT_GT(accepted, 0);
}

TEST(NpyTest, MissingFilesAreNamed) {
  const absl::StatusOr<NpyArray> array = ReadNpy("no/such/file.npy");
  EXPECT_EQ(array.status().code(), absl::StatusCode::kNotFound);
  EXPECT_THAT(std::string(array.status().message()), HasSubstr("no/such/file.npy"));
}

}  // namespace
}  // namespace sightline::cli

// SPDX-License-Identifier: Apache-2.0
//
// What the importers' tests share: reading from memory, compressing, writing a file, boxes.
//
// Thread safety: free functions.
#ifndef SIGHTLINE_TESTS_CLIENT_IMPORT_IMPORT_TESTING_H_
#define SIGHTLINE_TESTS_CLIENT_IMPORT_IMPORT_TESTING_H_

#include <lzma.h>
#include <zlib.h>

#include <cstdint>
#include <cstring>
#include <fstream>
#include <string>
#include <string_view>
#include <vector>

#include "client/import/import.h"
#include "core/geometry/box3.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace sightline::import_testing {

// The scene, or a failure that says why not and an empty scene.
inline ImportedScene MustImport(std::string_view bytes, MeshFormat format,
                                ImportOptions options = {}) {
  if (options.name.empty()) options.name = "test";
  absl::StatusOr<ImportedScene> scene = ImportBytes(bytes, format, options);
  EXPECT_TRUE(scene.ok()) << scene.status();
  return scene.ok() ? *std::move(scene) : ImportedScene{};
}

inline absl::Status ImportError(std::string_view bytes, MeshFormat format,
                                ImportOptions options = {}) {
  if (options.name.empty()) options.name = "test";
  return ImportBytes(bytes, format, options).status();
}

// A Status of this code whose message names the file and holds these words.
#define EXPECT_IMPORT_ERROR(status, expected_code, words)                                          \
  do {                                                                                             \
    const absl::Status actual_status = (status);                                                   \
    EXPECT_EQ(actual_status.code(), absl::StatusCode::expected_code) << actual_status;             \
    EXPECT_THAT(std::string(actual_status.message()), ::testing::HasSubstr(words));                \
    EXPECT_THAT(std::string(actual_status.message()), ::testing::Not(::testing::HasSubstr("\n"))); \
  } while (false)

inline std::string Repeated(std::string_view text, uint64_t count) {
  std::string out;
  out.reserve(text.size() * count);
  for (uint64_t i = 0; i < count; ++i) out += text;
  return out;
}

inline std::string Xz(std::string_view text) {
  std::string out(lzma_stream_buffer_bound(text.size()), '\0');
  size_t size = 0;
  EXPECT_EQ(lzma_easy_buffer_encode(6, LZMA_CHECK_CRC64, nullptr,
                                    reinterpret_cast<const uint8_t*>(text.data()), text.size(),
                                    reinterpret_cast<uint8_t*>(out.data()), &size, out.size()),
            LZMA_OK);
  out.resize(size);
  return out;
}

inline std::string Gzip(std::string_view text) {
  z_stream stream{};
  EXPECT_EQ(deflateInit2(&stream, 9, Z_DEFLATED, 16 + MAX_WBITS, 8, Z_DEFAULT_STRATEGY), Z_OK);
  std::string out(deflateBound(&stream, text.size()) + 32, '\0');
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(text.data()));
  stream.avail_in = static_cast<uInt>(text.size());
  stream.next_out = reinterpret_cast<Bytef*>(out.data());
  stream.avail_out = static_cast<uInt>(out.size());
  EXPECT_EQ(deflate(&stream, Z_FINISH), Z_STREAM_END);
  out.resize(stream.total_out);
  deflateEnd(&stream);
  return out;
}

inline void WriteFile(const std::string& path, std::string_view bytes) {
  std::ofstream(path, std::ios::binary) << bytes;
}

// A value's bytes, in this machine's (little-endian) order.
template <typename... T>
std::string Bytes(T... values) {
  std::string out;
  (out.append(reinterpret_cast<const char*>(&values), sizeof(values)), ...);
  return out;
}

// Of the vertices in use, placed in the world.
inline Box3d WorldBox(const ImportedScene& scene) {
  Box3d box;
  for (const ObjectInput& object : scene.objects) {
    for (const uint32_t i : object.indices) {
      const Vec3d p = object.transform.Apply(object.vertices[i]);
      if (IsFinite(p)) box.Extend(p);
    }
  }
  return box;
}

// Equal to the last bit, NaNs and signs of zero included.
inline bool SameBits(const ImportedScene& a, const ImportedScene& b) {
  if (a.objects.size() != b.objects.size() || a.report != b.report) return false;
  for (size_t i = 0; i < a.objects.size(); ++i) {
    const ObjectInput& p = a.objects[i];
    const ObjectInput& q = b.objects[i];
    if (p.name != q.name || p.indices != q.indices || p.vertices.size() != q.vertices.size() ||
        std::memcmp(p.vertices.data(), q.vertices.data(), p.vertices.size() * sizeof(Vec3d)) != 0 ||
        std::memcmp(p.transform.m.data(), q.transform.m.data(), sizeof(p.transform.m)) != 0) {
      return false;
    }
  }
  return true;
}

}  // namespace sightline::import_testing

#endif  // SIGHTLINE_TESTS_CLIENT_IMPORT_IMPORT_TESTING_H_

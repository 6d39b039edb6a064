// SPDX-License-Identifier: Apache-2.0
#include "client/import/decompress.h"

#include <lzma.h>
#include <zlib.h>

#include <algorithm>
#include <limits>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/str_cat.h"

namespace sightline {
namespace {

constexpr size_t kFirstOutputBytes = size_t{64} << 10;
// Some ten milliseconds of work: so often the decoders look whether they are still wanted.
constexpr size_t kOutputAtOnce = size_t{1} << 20;

absl::Status OverLimit(uint64_t max_bytes) {
  return absl::ResourceExhaustedError(
      absl::StrCat("decompresses to more than the limit max_file_bytes, ", max_bytes, " bytes"));
}

// Output that doubles as it fills, up to one byte more than the limit: that byte tells a file that
// just fits from one that does not.
class GrowingOutput {
 public:
  explicit GrowingOutput(uint64_t max_bytes) : max_bytes_(max_bytes) {}

  // Makes room if there is none; false once more than the limit is there.
  bool MakeRoom() {
    if (used_ > max_bytes_) return false;
    if (used_ < buffer_.size()) return true;
    const uint64_t most = std::min<uint64_t>(max_bytes_, buffer_.max_size() - 1) + 1;
    buffer_.resize(std::min<uint64_t>(most, std::max(kFirstOutputBytes, 2 * buffer_.size())));
    return used_ < buffer_.size();
  }
  char* next() { return buffer_.data() + used_; }
  // To be filled at once.
  size_t room() const { return std::min(kOutputAtOnce, buffer_.size() - used_); }
  void Advance(size_t n) { used_ += n; }
  bool within_limit() const { return used_ <= max_bytes_; }

  std::string Take() {
    buffer_.resize(used_);
    return std::move(buffer_);
  }

 private:
  const uint64_t max_bytes_;
  std::string buffer_;
  size_t used_ = 0;
};

absl::Status LzmaError(lzma_ret code) {
  switch (code) {
    case LZMA_FORMAT_ERROR:
      return absl::DataLossError("is not an xz file");
    case LZMA_MEMLIMIT_ERROR:
      return absl::ResourceExhaustedError(absl::StrCat("the xz decoder would need more than ",
                                                       kXzDecoderBytes, " bytes of memory"));
    case LZMA_MEM_ERROR:
      return absl::ResourceExhaustedError("no memory for the xz decoder");
    case LZMA_BUF_ERROR:
      return absl::DataLossError("the xz data are truncated");
    case LZMA_OPTIONS_ERROR:
      return absl::DataLossError("the xz data use options that this liblzma does not know");
    default:
      return absl::DataLossError("the xz data are corrupt");
  }
}

}  // namespace

absl::StatusOr<std::string> DecompressXz(std::string_view bytes, uint64_t max_bytes,
                                         const CancelToken* cancel) {
  lzma_stream stream = LZMA_STREAM_INIT;
  if (const lzma_ret code = lzma_stream_decoder(&stream, kXzDecoderBytes, LZMA_CONCATENATED);
      code != LZMA_OK) {
    return LzmaError(code);
  }
  absl::Cleanup end_stream = [&stream] { lzma_end(&stream); };
  stream.next_in = reinterpret_cast<const uint8_t*>(bytes.data());
  stream.avail_in = bytes.size();
  GrowingOutput output(max_bytes);
  for (;;) {
    if (cancel != nullptr && cancel->cancelled()) return cancel->ToStatus();
    if (!output.MakeRoom()) return OverLimit(max_bytes);
    stream.next_out = reinterpret_cast<uint8_t*>(output.next());
    stream.avail_out = output.room();
    const size_t room = stream.avail_out;
    const lzma_ret code = lzma_code(&stream, LZMA_FINISH);
    output.Advance(room - stream.avail_out);
    if (code == LZMA_STREAM_END) break;
    if (code != LZMA_OK) return LzmaError(code);
  }
  if (!output.within_limit()) return OverLimit(max_bytes);
  return output.Take();
}

absl::StatusOr<std::string> DecompressGzip(std::string_view bytes, uint64_t max_bytes,
                                           const CancelToken* cancel) {
  z_stream stream{};
  constexpr int kGzipOnly = 16 + MAX_WBITS;
  if (inflateInit2(&stream, kGzipOnly) != Z_OK) {
    return absl::ResourceExhaustedError("no memory for the gzip decoder");
  }
  absl::Cleanup end_stream = [&stream] { inflateEnd(&stream); };
  GrowingOutput output(max_bytes);
  size_t position = 0;
  constexpr size_t kMost = std::numeric_limits<uInt>::max();  // zlib counts in 32 bits.
  for (;;) {
    if (cancel != nullptr && cancel->cancelled()) return cancel->ToStatus();
    if (!output.MakeRoom()) return OverLimit(max_bytes);
    const size_t in = std::min(bytes.size() - position, kMost);
    const size_t out = std::min(output.room(), kMost);
    stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(bytes.data() + position));
    stream.avail_in = static_cast<uInt>(in);
    stream.next_out = reinterpret_cast<Bytef*>(output.next());
    stream.avail_out = static_cast<uInt>(out);
    const int code = inflate(&stream, Z_NO_FLUSH);
    position += in - stream.avail_in;
    output.Advance(out - stream.avail_out);
    if (code == Z_STREAM_END) {
      // Another member, or padding: gzip itself ignores zeros after the last one.
      const size_t rest = bytes.find_first_not_of('\0', position);
      if (rest == std::string_view::npos) break;
      position = rest;
      if (inflateReset(&stream) != Z_OK) return absl::DataLossError("the gzip data are corrupt");
      continue;
    }
    if (code == Z_BUF_ERROR || (code == Z_OK && position == bytes.size() && stream.avail_out > 0)) {
      return absl::DataLossError("the gzip data are truncated");
    }
    if (code == Z_MEM_ERROR) return absl::ResourceExhaustedError("no memory for the gzip decoder");
    if (code != Z_OK) {
      return absl::DataLossError(stream.total_out == 0 && position < 3
                                     ? "is not a gzip file"
                                     : "the gzip data are corrupt");
    }
  }
  if (!output.within_limit()) return OverLimit(max_bytes);
  return output.Take();
}

}  // namespace sightline

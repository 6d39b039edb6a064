// SPDX-License-Identifier: Apache-2.0
//
// An ostream whose writes a test sees one by one, in the thread that writes.
//
// Thread safety: that of OnWrite, which is called from whichever thread writes.
//
//   class Lines : public WatchedStream {
//     void OnWrite(std::string_view bytes) override { count_ += bytes.ends_with('\n'); }
//     ...
//   };
//   Lines lines;
//   lines.stream << "a line\n" << std::flush;
#ifndef SIGHTLINE_TESTS_SUPPORT_WATCHED_STREAM_H_
#define SIGHTLINE_TESTS_SUPPORT_WATCHED_STREAM_H_

#include <ostream>
#include <streambuf>
#include <string_view>

namespace sightline::testing_support {

class WatchedStream : private std::streambuf {
 public:
  WatchedStream() : stream(this) {}
  std::ostream stream;

 private:
  virtual void OnWrite(std::string_view bytes) = 0;

  int_type overflow(int_type c) final {
    if (traits_type::eq_int_type(c, traits_type::eof())) return traits_type::not_eof(c);
    const char byte = traits_type::to_char_type(c);
    OnWrite({&byte, 1});
    return c;
  }
  std::streamsize xsputn(const char* bytes, std::streamsize count) final {
    OnWrite({bytes, static_cast<size_t>(count)});
    return count;
  }
};

}  // namespace sightline::testing_support

#endif  // SIGHTLINE_TESTS_SUPPORT_WATCHED_STREAM_H_
